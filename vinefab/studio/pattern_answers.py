"""Answers about the flat pattern and the inflated body: the cut angles of designed ones."""

import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely

from vinefab.core.errors import BadInputError
from vinefab.core.front_door import imported_later
from vinefab.core.view import plain_blocks
from vinefab.fabrication.rules.pressure_rules import check_sensitivity, degrees_text
from vinefab.inflation.pattern import Pattern, PatternJoint, pattern_of
from vinefab.inflation.robot import with_short_tail
from vinefab.model.design import TRUNK, Design
from vinefab.model.laser import LaserProfile
from vinefab.outline.body_outline import body_outline
from vinefab.pages.plan_svg import area_svg, lines_svg, outline_svg
from vinefab.studio.chosen_branch import by_name
from vinefab.studio.state import StudioState

if TYPE_CHECKING:
    from vinefab.prediction import inflation_report
else:  # the thread that draws the flat outline has no use for it
    inflation_report = imported_later("vinefab.prediction.inflation_report")


_WIDER_RAD, _FAN_STEP_RAD = math.radians(120.0), math.radians(1.0)
"""Range and step of the search for the nearest possible fan."""


def cut_answer(state: StudioState, _ask: Mapping[str, Any]) -> dict[str, Any]:
    """Return the flat outline and the cut shape of each level, without any simulation.

    Joints come from the table or the user's cache. The rules, once the pointer rests, simulate what
    neither knows, and say all of it exactly.
    """
    # Outlines of more branches take longer than a pointer may wait; the rules' panel draws them.
    most_flat = 1500
    if state.design.branch_count > most_flat:
        return {"cut": {}, "outline_svg": "", "outline_box": None}
    pattern = pattern_of(state.design, state.profile, known_only=True)
    notes = cut_notes(pattern, state.profile)
    try:
        contour = body_outline(pattern.flat).contour
    except BadInputError:  # a tree that no sheet could hold: the rules say so
        return {"cut": notes, "outline_svg": "", "outline_box": None}
    return {
        "cut": notes, "outline_svg": outline_svg(contour), "outline_box": list(contour.box_mm)
    }  # fmt: skip


def cut_notes(pattern: Pattern, profile: LaserProfile) -> dict[str, dict[str, str]]:
    """Return the note at the angle of each level or branch, by its key: kind, text and details.

    Kinds are ``known``, ``sensitive`` (errors are multiplied), ``bad`` (nothing deploys so), and
    ``pending`` (a simulation will tell).
    """
    shown = [joint for joint in pattern.joints if any(joint.wanted_deg) or joint.problem]
    if pattern.design.branches is not None:
        return {
            key: _note(pattern, joint, child)
            for joint in shown
            for key, child in _turns(pattern.design, joint)
        }
    return {
        f"level.{place}.angle_deg": _note(pattern, joint, profile=profile)
        for joint in shown
        if not joint.is_bend
        for place in (joint.level - 2,)
    }


def _turns(design: Design, joint: PatternJoint) -> Iterator[tuple[str, int]]:
    """Yield the key of each turn that is cut as a joint, and its place in the joint."""
    straight, named = design.tree.straight, by_name(design)
    number = {branch.name: index for index, branch in enumerate(design.branches or ())}
    for row in joint.rows:
        for child, part in enumerate(np.flatnonzero(straight.parent == row).tolist()):
            label = design.names[straight.branch[part]]
            table = "trunk" if label == TRUNK else f"branch.{number[label]}"
            if not joint.is_bend:
                yield f"{table}.angle_deg", child
                continue
            bends = (design.trunk if label == TRUNK else named[label]).bends or ()
            turning = sorted((at_mm, i) for i, (at_mm, turn_deg) in enumerate(bends) if turn_deg)
            before = int((straight.branch[:row] == straight.branch[row]).sum())
            if before < len(turning):
                yield f"{table}.bends.{turning[before][1]}.1", 0


def _note(
    pattern: Pattern,
    joint: PatternJoint,
    child: int | None = None,
    profile: LaserProfile | None = None,
) -> dict[str, str]:
    """Return the note on a joint: on its fan, or on one of its children.

    Parameters
    ----------
    profile
        Where the nearest fan that is possible is to be searched for, in a design of levels.
    """
    is_compensated = pattern.design.build.compensation != "none"

    def angle(angles_deg: tuple[float, ...]) -> str:
        return _fan(angles_deg) if child is None else f"{angles_deg[child]:.1f}"

    if not joint.is_known:
        why = "This joint is not in the table: it is simulated once the design rests."
        return {"kind": "pending", "text": "simulated when you pause", "about": why}
    found = joint.found
    if joint.problem or found is None:
        why = joint.problem.partition(": ")[2] or "siblings pass through each other"
        nearest = ""
        if found is not None:
            nearest = f": nearest {angle(found.deployed_deg)}°"
        elif profile is not None:
            nearest = _nearest(pattern.design, profile, joint.level - 2)
        return {"kind": "bad", "text": f"✕ not possible{nearest}", "about": f"{why}."}
    shown = found.flat.angles_deg if is_compensated else found.deployed_deg
    how = "cut" if is_compensated else "deploys at"
    kind = "sensitive" if found.sensitivity > check_sensitivity.limits["warning"] else "known"
    text = f"{how} {angle(shown)}°, x{found.sensitivity:.1f} sensitive"
    told = {"table": "from the table", "law": "from the law of joints"}
    source = told.get(found.source, "simulated joint")
    about = (
        f"Children cut at {degrees_text(found.flat.angles_deg)}° deploy at "
        f"{degrees_text(found.deployed_deg)}° ({source}, good for {found.within_deg:.1f}°; "
        f"unverified). 1° of error in the flat angles becomes {found.sensitivity:.1f}°."
    )
    return {"kind": kind, "text": text, "about": about}


def _nearest(design: Design, profile: LaserProfile, place: int) -> str:
    """Return the narrowest fan of a level, wider than designed, that the table knows, as text."""
    if design.levels[place].branches == 1:
        return ""
    level = design.levels[place]

    def is_known(fan_rad: float) -> bool:
        levels = list(design.levels)
        levels[place] = level.changed(fan_rad=fan_rad)
        wider = pattern_of(design.changed(levels=tuple(levels)), profile, known_only=True)
        return all(
            joint.found is not None and not joint.problem
            for joint in wider.joints
            if joint.level == place + 2
        )

    low, high = level.fan_rad, min(level.fan_rad + _WIDER_RAD, math.tau)
    if not is_known(high):
        return ""
    while high - low > _FAN_STEP_RAD:
        middle = (low + high) / 2.0
        low, high = (low, middle) if is_known(middle) else (middle, high)
    return f": nearest about {math.degrees(high):.0f}°"


def _fan(angles_deg: tuple[float, ...]) -> str:
    """Return the angle from the first to the last child; of a single one, its own."""
    fan = angles_deg[-1] - (angles_deg[0] if len(angles_deg) > 1 else 0.0)
    return f"{fan:.1f}"


def inflated_answer(state: StudioState, _: Mapping[str, Any]) -> dict[str, Any]:
    """Return flat outline, inflated body and designed branches, as `vinefab inflate` draws them."""
    found = inflation_report.inflate_design(state.design, state.profile, alone=True)
    shape = found.deployed
    contour = body_outline(with_short_tail(shape.pattern.flat)).contour
    axes = np.stack([shape.designed.start_mm, shape.designed.end_mm], axis=1)
    corners = np.concatenate([contour.flattened_mm(), shapely.get_coordinates(shape.seen)])
    return {
        "svg": f'<g class="flat">{outline_svg(contour)}</g>'
        f"{area_svg(shape.seen, 'inflated')}{lines_svg(list(axes), 'designed')}",
        "box": [*corners.min(axis=0).tolist(), *corners.max(axis=0).tolist()],
        "blocks": plain_blocks(found.view()),
    }
