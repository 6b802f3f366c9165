"""Changes of single branches by hand: a dragged tip or bend, a branch more, less or mirrored."""

import cmath
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Any

import numpy as np
import shapely
from shapely import LineString, Point

from vinefab.core.errors import BadInputError, UnfitInputError
from vinefab.core.limits import deg
from vinefab.core.validation import LARGEST_MM, number
from vinefab.model.deployment import Deployment
from vinefab.model.design import (
    DEFAULT_WIDTH_RATIO,
    TRUNK,
    Branch,
    Build,
    Design,
    Trunk,
    default_fillets_mm,
    design_content,
    design_of,
)
from vinefab.model.tree import Bend, child_lengths_mm
from vinefab.studio.chosen_branch import by_name, part_of, place_on, row_of
from vinefab.studio.live_answers import deployed_robot, live_answer
from vinefab.studio.state import PAGE, StudioState, branches_named

_LEAST_MM = 1.0
"""Branches are dragged no shorter than this."""


# --- What is dragged ------------------------------------------------------------------------------


def tip_answer(state: StudioState, ask: Mapping[str, Any]) -> dict[str, Any]:
    """Return the values for which a tip, or a bend, lies where it is dragged to.

    A tip of a design of branches turns its branch about its base and makes it longer. In a design
    of levels the length follows the tip along its last stretch, the fan turns with the part across
    it. A bend moves between its neighbours, which stay, as does the tip. Where a branch has been
    bent by walls that is the first step of the way, and the next drag continues from there. Locked
    values stay.

    Parameters
    ----------
    ask
        ``branch``: name, or id where the design has levels; ``to``: where, map coordinates in mm,
        or ``by``: by how much; ``bend``: the place of a bend in the branch's list, else its tip;
        ``live``: what is asked of the growth of the changed design, as of `live_answer`.

    Returns
    -------
    dict
        ``key``: the table of the design, ``trunk``, ``level.0`` or ``branch.3``; ``values``: its
        new values by name, units as in design files; ``bend``: the place of the bend among them;
        ``live``: the growth with them, where it was asked for.
    """
    deployment = deployed_robot(state).deployment
    design, label = state.design, ask.get("branch")
    row = row_of(design, label)
    chain_mm = deployment.chain_mm(row)
    if len(chain_mm) < 2:
        return {"key": "", "values": {}}
    chain = [complex(x, y) for x, y in chain_mm.tolist()]
    part = part_of(design, str(label))
    if part is None:
        found = _of_level(state, deployment, row, chain, _wanted(chain[-1], ask))
    elif ask.get("bend") is not None:
        found = _bend_moved(part, chain, ask)
    else:
        grown_mm = float(deployment.grown_mm[row])
        found = {"values": _tip_moved(part, grown_mm, chain, _wanted(chain[-1], ask), state.locks)}
    values = {key: _rounded(value) for key, value in found["values"].items()}
    answer = {"key": _key(design, str(label)), **found, "values": values}
    # A drag never leaves a design that cannot be: the next one could not begin there.
    changed = _with_values(design, str(label), answer["key"], values)
    live = ask.get("live")
    if not values or not isinstance(live, Mapping):
        return answer
    return {**answer, "live": live_answer(replace(state, design=changed), live)}


def _with_values(design: Design, label: str, key: str, values: Mapping[str, Any]) -> Design:
    """Return a design with some values of a branch, or of the table of its level."""
    if design.branches is not None:
        names = {"length": "length_mm"}
        with branches_named([*by_name(design)]):
            return design.with_branch(label, **{names.get(one, one): values[one] for one in values})
    content = dict(design_content(design))
    table, _, place = key.partition(".")
    changed = content[table] if not place else content[table][int(place)]
    changed |= values
    return design_of(content, PAGE)


def _rounded(value: Any) -> Any:  # noqa: ANN401  a number, or bends
    """Return numbers with the digits that the page gives to what a hand sets."""
    if isinstance(value, list):
        return tuple(tuple(round(one, 2) for one in bend) for bend in value)
    return round(value, 2)


def _tip_moved(
    part: Trunk | Branch,
    grown_mm: float,
    chain: list[complex],
    to: complex,
    locks: frozenset[str],
) -> dict[str, float]:
    """Return angle and length of a branch for which its tip comes to a place."""
    # How much longer the last stretch gets, and by how much the branch turns about its base.
    pivot = chain[0] if part.bends else chain[-2]
    stretch_mm, turn_rad = _turned(chain[-2] - pivot, chain[-1] - chain[-2], to - pivot)
    longer_mm = stretch_mm - abs(chain[-1] - chain[-2])
    length = {"length": min(max(_LEAST_MM, grown_mm + longer_mm), LARGEST_MM)}
    if isinstance(part, Branch):
        return {**length, "angle_deg": math.remainder(part.angle_deg + deg(turn_rad), 360.0)}
    return {} if "trunk.length" in locks else length


def _wanted(at: complex, ask: Mapping[str, Any]) -> complex:
    """Return the place that is asked for."""
    key = "by" if "by" in ask else "to"
    given = ask.get(key)
    if not isinstance(given, list) or len(given) != 2:
        raise BadInputError(key, given, "a point [x, y], mm", PAGE)
    place = complex(*(number(key, value, -LARGEST_MM, LARGEST_MM, "mm") for value in given))
    return at + place if key == "by" else place


def _key(design: Design, label: str) -> str:
    """Return the key of the table of a branch; empty where its level has one."""
    names = [branch.name for branch in design.branches or ()]
    return f"branch.{names.index(label)}" if label in names else TRUNK if names else ""


def _turned(knee: complex, stretch: complex, reach: complex) -> tuple[float, float]:
    """Return the length of the last stretch, and the turn about the origin, that reach a place.

    Parameters
    ----------
    knee
        Where the last stretch begins, seen from the pivot.
    stretch
        The last stretch as it is.
    """
    along = stretch / abs(stretch)
    ahead = (knee * along.conjugate()).real
    across = (knee * along.conjugate()).imag
    length_mm = max(_LEAST_MM, math.sqrt(max(0.0, abs(reach) ** 2 - across**2)) - ahead)
    if abs(reach) < _LEAST_MM:
        return length_mm, 0.0
    turn = cmath.phase(reach) - cmath.phase(knee + length_mm * along)
    return length_mm, math.remainder(turn, math.tau)


def _of_level(
    state: StudioState, deployment: Deployment, row: int, chain: list[complex], to: complex
) -> dict[str, Any]:
    """Return the values of the level of a branch for which its tip comes to a place."""
    stretch = chain[-1] - chain[-2]
    stretch_mm, turn_rad = _turned(0j, stretch, to - chain[-2])
    wanted_mm = max(_LEAST_MM, float(deployment.grown_mm[row]) + stretch_mm - abs(stretch))
    index = int(deployment.tree.level[row]) - 2
    if index < 0:
        free = "trunk.length" not in state.locks
        return {"key": "trunk", "values": {"length": min(wanted_mm, LARGEST_MM)} if free else {}}
    level = state.design.levels[index]
    sibling = int(deployment.tree.ids[row].rsplit(".", 1)[-1])
    values: dict[str, float] = {}
    if f"level.{index}.length" not in state.locks:
        share = float(child_lengths_mm(level)[sibling]) / level.length_mm
        values["length"] = min(wanted_mm / share, LARGEST_MM)
    # By this share of the fan a child leans to the left of its parent; 0 in the middle.
    lean = sibling / (level.branches - 1) - 0.5 if level.branches > 1 else 0.0
    if lean and f"level.{index}.angle_deg" not in state.locks:
        values["angle_deg"] = min(360.0, max(0.0, deg(level.fan_rad + turn_rad / lean)))
    return {"key": f"level.{index}", "values": values}


def _bend_moved(
    part: Trunk | Branch, chain: list[complex], ask: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the values of a branch one of whose bends has been dragged; its tip stays."""
    bends = sorted(part.bends or ())
    given = ask.get("bend")
    if type(given) is not int or not 0 <= given < len(bends):
        raise BadInputError("bend", given, "the place of a bend of the branch", PAGE)
    index = bends.index((part.bends or ())[given])
    angle_deg = part.angle_deg if isinstance(part, Branch) else 0.0
    corners = _corners(angle_deg, part.length_mm, bends)
    course = LineString([(place.real, place.imag) for place in chain])
    at = complex(*place_on(course, bends[index][0]))
    # The map's axes as the branch has them: it begins with its angle from its parent's heading.
    turned = cmath.rect(1.0, math.radians(angle_deg) - cmath.phase(chain[1] - chain[0]))
    corners[index + 1] += (_wanted(at, ask) - at) * turned
    values = _values_of(corners, keeps_heading=not isinstance(part, Branch))
    return {"values": values, "bend": index}


def _corners(angle_deg: float, length_mm: float, bends: list[Bend]) -> list[complex]:
    """Return base, bends and tip of a branch; its parent's heading is the first axis."""
    corners, heading_deg, done_mm = [0j], angle_deg, 0.0
    for at_mm, turn_deg in [*bends, (length_mm, 0.0)]:
        step = cmath.rect(at_mm - done_mm, math.radians(heading_deg))
        corners.append(corners[-1] + step)
        heading_deg, done_mm = heading_deg + turn_deg, at_mm
    return corners


def _values_of(corners: list[complex], *, keeps_heading: bool) -> dict[str, Any]:
    """Return angle, length and bends of a branch with these corners.

    A trunk keeps its heading: the whole of it turns back about its base.
    """
    steps = [after - before for before, after in pairwise(corners)]
    at_mm = np.cumsum([abs(step) for step in steps]).tolist()
    turns_deg = [
        math.remainder(deg(cmath.phase(after) - cmath.phase(before)), 360.0)
        for before, after in pairwise(steps)
    ]
    angle = {} if keeps_heading else {"angle_deg": deg(cmath.phase(steps[0]))}
    bends = [[at, turn] for at, turn in zip(at_mm, turns_deg, strict=False)]
    return {**angle, "length": at_mm[-1], "bends": bends}


# --- Which branches there are ---------------------------------------------------------------------


def edit_answer(state: StudioState, ask: Mapping[str, Any]) -> dict[str, Any]:
    """Return the design after an edit of which branches and bends it has.

    Parameters
    ----------
    ask
        ``do``: a name of `EDITS`; ``branch``: name, or id where the design has levels; ``to``:
        where on the map, for a bend: the middle of its longest straight part if left out.

    Returns
    -------
    dict
        ``design``: its content; ``branch``: the one to be chosen now, None for none.
    """
    do = ask.get("do")
    if not isinstance(do, str) or do not in EDITS:
        raise BadInputError("do", do, f"one of {', '.join(EDITS)}", PAGE)
    with branches_named([*by_name(state.design)]):
        design, chosen = EDITS[do](state, ask)
    return {"design": design_content(design), "branch": chosen}


Edited = tuple[Design, str | None]


def _free(state: StudioState, ask: Mapping[str, Any]) -> Edited:
    """Write the design branch by branch, so that every one can be changed for itself."""
    design, label = state.design, ask.get("branch")
    free = design.by_branches
    return free, None if label is None else free.names[row_of(design, label)]


def _with_child(state: StudioState, ask: Mapping[str, Any]) -> Edited:
    """Add an outer child of a branch, on the side where it turns less."""
    design, parent = _free_design(state), str(ask.get("branch"))
    row = row_of(design, parent)
    siblings = sorted(one.angle_deg for one in design.branches or () if one.of == parent)
    step_deg = 30.0
    outer = [siblings[0] - step_deg, siblings[-1] + step_deg] if siblings else [0.0]
    angle_deg = min(outer, key=abs)
    length_mm = round(0.7 * float(design.tree.length_mm[row]), 1)
    name = _new_name(f"{parent}-" if parent != TRUNK else "", design.names)
    child = Branch(name=name, of=parent, angle_deg=angle_deg, length_mm=max(_LEAST_MM, length_mm))
    return _with_branches(design, [*(design.branches or ()), child]), name


def _new_name(start: str, taken: Sequence[str]) -> str:
    """Return a name with a number that no other branch has."""
    numbered = (f"{start}{number}" for number in range(len(taken) + 1))
    return next(name for name in numbered if name not in taken)


def _without(state: StudioState, ask: Mapping[str, Any]) -> Edited:
    """Remove a branch with all that grow from it."""
    design, label = _free_design(state), str(ask.get("branch"))
    row_of(design, label)
    if label == TRUNK:
        raise UnfitInputError("", "the trunk carries the robot", "choose another branch", PAGE)
    gone = _below(design, label)
    left = [one for one in design.branches or () if one.name not in gone]
    return _with_branches(design, left), by_name(design)[label].of


def _mirrored(state: StudioState, ask: Mapping[str, Any]) -> Edited:
    """Put the mirror image of a branch, with all that grow from it, on its parent's other side.

    It takes the place of a sibling at the same angle.
    """
    design, label = _free_design(state), str(ask.get("branch"))
    row_of(design, label)
    named = by_name(design)
    if label == TRUNK or not named[label].angle_deg:
        problem = f"branch {label!r} goes straight on, it has no other side"
        raise UnfitInputError("", problem, "turn it first", PAGE)
    source = named[label]
    gone = {
        name
        for one in design.branches or ()
        if one.of == source.of and one.angle_deg == -source.angle_deg
        for name in _below(design, one.name)
    }
    branches = [one for one in design.branches or () if one.name not in gone]
    names: dict[str, str] = {}
    copied = _below(design, label)
    for one in (named[name] for name in design.names if name in copied):
        names[one.name] = _new_name(f"{one.name}-m", [branch.name for branch in branches])
        branches.append(
            one.changed(
                name=names[one.name],
                of=names.get(one.of, one.of),
                angle_deg=-one.angle_deg,
                bends=one.bends and tuple((at_mm, -turn_deg) for at_mm, turn_deg in one.bends),
            )
        )
    return _with_branches(design, branches), names[label]


def _with_bend(state: StudioState, ask: Mapping[str, Any]) -> Edited:
    """Add a bend of 0 degrees, to be dragged or typed."""
    design, label = _free_design(state), str(ask.get("branch"))
    row = row_of(design, label)
    part = part_of(design, label)
    bends = [] if part is None else sorted(part.bends or ())
    if ask.get("to") is not None:
        course = LineString(deployed_robot(state).deployment.chain_mm(row))
        place = _wanted(0j, ask)
        at_mm = float(shapely.line_locate_point(course, Point(place.real, place.imag)))
    else:
        ends = [0.0, *(at for at, _ in bends), float(design.tree.length_mm[row])]
        long_mm, start_mm = max((b - a, a) for a, b in pairwise(ends))
        at_mm = start_mm + long_mm / 2.0
    added = tuple(sorted([*bends, (round(at_mm, 1), 0.0)]))
    return design.with_branch(label, bends=added), label


EDITS: Mapping[str, Callable[[StudioState, Mapping[str, Any]], Edited]] = {
    "free": _free,
    "child": _with_child,
    "remove": _without,
    "mirror": _mirrored,
    "bend": _with_bend,
}
"""Edits by the name that the page has for them."""


def _free_design(state: StudioState) -> Design:
    if state.design.branches is None:
        problem = "the branches of a level are alike in this design"
        raise UnfitInputError("", problem, "free it first: then each is its own", PAGE)
    return state.design


def _below(design: Design, label: str) -> set[str]:
    """Return a branch and all that grow from it."""
    found, named = {label}, by_name(design)
    for name in design.names[1:]:  # parents come first
        if named[name].of in found:
            found.add(name)
    return found


def _with_branches(design: Design, branches: Sequence[Branch]) -> Design:
    """Return the design with other branches, its build with as many levels as they have."""
    of = {branch.name: branch.of for branch in branches}
    depth = 1
    for parent in of.values():
        level, at = 2, parent
        while at != TRUNK:
            level, at = level + 1, of[at]
        depth = max(depth, level)
    return design.changed(branches=tuple(branches), build=_for_depth(design.build, depth))


def _for_depth(build: Build, depth: int) -> Build:
    """Return a build with the lists of so many levels; a new one follows from the one before."""
    widths_mm = build.widths_mm[:depth]
    while len(widths_mm) < depth:
        widths_mm += (round(widths_mm[-1] * DEFAULT_WIDTH_RATIO, 2),)
    fillets_mm = (*build.fillet_mm, *default_fillets_mm(widths_mm)[len(build.fillet_mm) :])
    taper = (*build.taper, *(1.0,) * depth)[:depth] if build.taper else ()
    return build.changed(widths_mm=widths_mm, fillet_mm=fillets_mm[: depth - 1], taper=taper)
