"""A whole pattern under pressure: the deployed centre line of every branch, and its tips.

Siblings that touch or overlap under pressure do not feel each other (no contact).
"""

import math
from dataclasses import dataclass

import numpy as np
import scipy  # its parts load at their first use
import shapely

from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats
from vinefab.inflation.joint import JointShape, axis_of
from vinefab.inflation.membrane import Equilibrium
from vinefab.inflation.mesh import Sheet, StraightSide, sheet_of
from vinefab.inflation.pattern import joint_families
from vinefab.model.design import Design
from vinefab.model.outline import Contour, Part, Segment
from vinefab.outline.body_outline import DrawnTree, FlatLayout, body_outline, flat_layout
from vinefab.outline.joint import joint_of

_FINE_MM = 0.05  # arcs become chords that lie this close to them


@dataclass(frozen=True, slots=True, kw_only=True)
class Crossing:
    """Two branches whose edges cross."""

    branches: tuple[str, str]  # their ids; twice the same where a branch crosses itself
    at_mm: tuple[float, float]


def crossings(contour: Contour) -> tuple[Crossing, ...]:
    """Return where segments of an outline that are no neighbours cross or touch, a pair once.

    The mouth of an open outline counts as its last segment.
    """
    segments = list(contour.segments)
    lines = [shapely.LineString(one.flattened_mm(_FINE_MM)) for one in segments]
    names = [one.branch for one in segments]
    if not contour.closed:
        lines.append(shapely.LineString([segments[-1].end_mm, segments[0].start_mm]))
        names.append(names[0])
    one, two = shapely.STRtree(lines).query(lines, predicate="intersects")
    apart = (one < two) & (two - one > 1) & ~((one == 0) & (two == len(lines) - 1))
    found: dict[tuple[str, str], Crossing] = {}
    for first, second in np.column_stack([one, two])[apart].tolist():
        low, high = sorted((names[first], names[second]))
        if (low, high) not in found:
            place = shapely.intersection(lines[first], lines[second]).representative_point()
            found[low, high] = Crossing(branches=(low, high), at_mm=(place.x, place.y))
    return tuple(found.values())


ACROSS = 8
"""Triangles across a tube of a robot."""

TAIL_WIDTHS = 2.0
"""Length of tail that is simulated at most: a tube that runs on changes nothing."""

_CENTER_POINTS = 33
_MARGIN = 0.15  # of a width, from a joint to the rows of a straight stretch
_LEAST_STRAIGHT = 0.3  # widths; shorter stretches get the lattice of joints


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class InflatedRobot:
    """A pattern under pressure (simulated), in the coordinates of its flat layout.

    It is turned and shifted so that the trunk's base and heading are those of the layout.
    """

    layout: FlatLayout  # the flat pattern
    # Where the axis of each branch lies, from its joint to its end, shape (branches, 33, 2).
    center_lines_mm: Floats
    headings_rad: Floats  # of the straight part of each branch, shape (branches,)
    sheet: Sheet  # in widths of the trunk, not turned
    equilibrium: Equilibrium
    positions_mm: Floats  # corners of the upper sheet in space, shape (n, 3)

    @property
    def ends_mm(self) -> Floats:
        """Deployed end of each branch, shape (branches, 2)."""
        return self.center_lines_mm[:, -1]

    @property
    def deployed_offsets_rad(self) -> Floats:
        """Deployed angle from the parent's heading to each branch's, shape (branches,)."""
        parent = self.layout.tree.parent
        turns = self.headings_rad - self.headings_rad[parent]
        turns[parent < 0] = 0.0
        return np.remainder(turns + math.pi, math.tau) - math.pi

    def tip_errors_mm(self, designed: FlatLayout | None = None) -> Floats:
        """Return the distance of each leaf's end from its designed place, shape (leaves,).

        Parameters
        ----------
        designed
            The designed tree; the flat pattern itself if left out.
        """
        aim = self.layout if designed is None else designed
        errors: Floats = np.hypot(*(self.ends_mm - aim.end_mm)[aim.is_leaf].T)
        return errors


def inflated_robot(
    design: Design, *, hoop_strain: float = 0.01, across: int = ACROSS
) -> InflatedRobot:
    """Return a design under pressure, cut with flat angles and lengths as designed.

    Parameters
    ----------
    hoop_strain
        p W / (pi E t) of the trunk.
    across
        Triangles across a tube, even.

    Raises
    ------
    BadInputError
        If the outline is not exact, or overlaps itself on the sheet.
    NotConvergedError
        If no equilibrium is found.
    """
    cut = with_short_tail(design)
    layout, outline = flat_layout(cut), body_outline(cut)
    if outline.problems:
        words = f"a design with an exact outline. {outline.problems[0].message}"
        raise BadInputError("design", design.name, words)
    if crossing := crossings(outline.contour):
        raise BadInputError("design", design.name, _apart_words(layout, crossing))
    return inflated_pattern(outline.contour, layout, hoop_strain=hoop_strain, across=across)


def with_short_tail(design: Design) -> Design:
    """Return the part of a pattern that is simulated: without collar, with a tail of two widths."""
    tail_mm = min(design.build.tail_mm, TAIL_WIDTHS * design.build.widths_mm[0])
    return design.changed(build=design.build.changed(tail_mm=tail_mm, collar=None))


def _apart_words(layout: FlatLayout, found: tuple[Crossing, ...]) -> str:
    """Return the branches that must not cross on the sheet, and ways to keep them apart."""
    tree = layout.tree
    number = {name: branch for branch, name in enumerate(tree.ids)}

    def ancestors(branch: int) -> list[int]:
        chain = [branch]
        while tree.parent[chain[-1]] >= 0:
            chain.append(int(tree.parent[chain[-1]]))
        return chain

    # The pair that parts last is the one whose joint is easiest to change.
    pairs = []
    for crossing in found:
        one, two = (ancestors(number[name]) for name in crossing.branches)
        joint = next(branch for branch in one if branch in two)
        if joint in (one[0], two[0]) and tree.parent[joint] >= 0:
            joint = int(tree.parent[joint])
        pairs.append((int(tree.level[joint]), joint, crossing))
    level, joint, first = max(pairs, key=lambda pair: pair[0])
    names = "{} and {}".format(*first.branches)
    outer = max(int(tree.level[number[name]]) for name in first.branches)
    more = f", as do {counted(len(found) - 1, 'other pair')}" if len(found) > 1 else ""
    return (
        f"a design whose flat pattern does not cross itself: on the sheet branches {names} do, "
        f"which part at the end of branch {tree.ids[joint]}{more}; make level {outer} shorter or "
        f"narrower, or change the angle of level {level + 1}"
    )


def joints_of(design: Design, *, hoop_strain: float = 0.01) -> tuple[JointShape, ...]:
    """Return each kind of joint and bend of a design, in the order of the first part of each.

    Fillets are those that the outline has, capped where angles are narrow. Branches count as even:
    a taper gives the widths at the joint alone.

    Parameters
    ----------
    hoop_strain
        p W / (pi E t) of the trunk. That of a joint is smaller by its parent's width.
    """
    trunk_mm, found = design.build.widths_mm[0], []
    for family in joint_families(DrawnTree.of(design)):
        plan, parent_mm = family.plan, 2.0 * family.plan.parent.half_mm
        found.append(
            JointShape(
                angles_deg=tuple(math.degrees(one.angle_rad) for one in plan.children),
                widths=tuple(2.0 * one.half_mm / parent_mm for one in plan.children),
                fillets=tuple(gap.radius_mm / parent_mm for gap in joint_of(plan, 0.0).gaps),
                hoop_strain=hoop_strain * parent_mm / trunk_mm,
                is_bend=plan.is_bend,
            )
        )
    return tuple(found)


def inflated_pattern(
    contour: Contour,
    layout: FlatLayout,
    *,
    hoop_strain: float = 0.01,
    across: int = ACROSS,
) -> InflatedRobot:
    """Return any flat pattern under pressure.

    Parameters
    ----------
    contour
        Open, counter-clockwise from the mouth's right corner to its left one, in mm, each segment
        with the id of its branch; the mouth lies across the trunk.
    layout
        Where its branches lie on the sheet; the trunk's heading is +x.
    hoop_strain, across
        As of `inflated_robot`.
    """
    ids, unit = layout.tree.ids, float(layout.width_mm[0])
    widths = {name: float(w) / unit for name, w in zip(ids, layout.width_mm, strict=True)}
    closed = Contour(
        points_mm=contour.points_mm / unit,
        bulges=np.append(contour.bulges, 0.0),
        parts=(*contour.parts, Part.MOUTH),
        branches=(*contour.branches, ids[0]),
        closed=True,
    )
    straights = _straights(closed, layout, unit)
    sheet = sheet_of(
        closed, tuple(straights.values()), widths, across=across, hoop_strain=hoop_strain
    )
    found = sheet.inflated()
    flat = scipy.interpolate.LinearNDInterpolator(sheet.mesh.points, found.positions[:, :2])
    shares = np.linspace(0.0, 1.0, _CENTER_POINTS)[None, :, None]
    start, end = layout.start_mm[:, None] / unit, layout.end_mm[:, None] / unit
    lines = flat((start + shares * (end - start)).reshape(-1, 2)).reshape(len(ids), -1, 2)
    headings = np.zeros(len(ids))
    for branch, name in enumerate(ids):
        along = lines[branch, _CENTER_POINTS // 2] - lines[branch, 0]
        if name in straights:
            place = list(straights).index(name)
            straight, (right, left) = straights[name], sheet.mesh.sides[place]
            sides = found.positions[right, :2], found.positions[left, :2]
            width = 2.0 * straight.half_end
            length = straight.end - straight.begin
            leave = min(0.5 * width, length / 4.0)
            along = axis_of(straight, sides, (leave, leave)).heading
        headings[branch] = math.atan2(along[1], along[0])
    turn, base = -headings[0], lines[0, 0].copy()
    rotation = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    positions = found.positions * unit
    positions[:, :2] = ((found.positions[:, :2] - base) @ rotation) * unit
    return InflatedRobot(
        layout=layout,
        center_lines_mm=((lines - base) @ rotation) * unit + layout.start_mm[0],
        headings_rad=np.remainder(headings + turn + math.pi, math.tau) - math.pi,
        sheet=sheet,
        equilibrium=found,
        positions_mm=positions,
    )


def _straights(contour: Contour, layout: FlatLayout, unit: float) -> dict[str, StraightSide]:
    """Return the straight stretches of a pattern by the ids of their branches."""
    lines: dict[str, list[Segment]] = {}
    for segment in contour.segments:
        if segment.bulge == 0.0 and segment.part in (Part.SIDE, Part.TAIL):
            lines.setdefault(segment.branch, []).append(segment)
    found = {}
    for branch, name in enumerate(layout.tree.ids):
        x, y = (layout.start_mm[branch] / unit).tolist()
        heading = float(layout.heading_rad[branch])
        length = float(layout.tree.length_mm[branch]) / unit
        half = float(layout.width_mm[branch]) / unit / 2.0
        end_half = float(layout.end_width_mm[branch]) / unit / 2.0
        axis = StraightSide(
            origin=(x, y), heading_rad=heading, begin=0.0, end=1.0, half_begin=half, half_end=half
        )
        slope = abs(half - end_half) / length
        sides = [_longest(axis, lines.get(name, []), side, slope) for side in (-1.0, 1.0)]
        if any(side is None for side in sides):
            continue
        right, left = (np.array(side) for side in sides)
        begin, end = max(right[0, 0], left[0, 0]), min(right[1, 0], left[1, 0])
        margin = 2.0 * _MARGIN * half
        # Away from the joint at its end; the trunk begins at the mouth.
        end -= 0.0 if layout.is_leaf[branch] else margin
        if end - begin < 2.0 * half * _LEAST_STRAIGHT:
            continue
        halves = [float(np.interp(at, right[:, 0], -right[:, 1])) for at in (begin, end)]
        found[name] = StraightSide(
            origin=(x, y),
            heading_rad=heading,
            begin=float(begin),
            end=float(end),
            half_begin=halves[0],
            half_end=halves[1],
        )
    return found


def _longest(
    axis: StraightSide, lines: list[Segment], side: float, slope: float
) -> list[tuple[float, float]] | None:
    """Return the ends, along and across, of the longest straight run on one side of a branch."""
    runs: list[list[tuple[float, float]]] = []
    for line in lines:
        ends = sorted(map(tuple, axis.local(np.array([line.start_mm, line.end_mm])).tolist()))
        (a, off_a), (b, off_b) = ends
        if b - a < 1e-9 or abs(off_b - off_a) > (1.1 * slope + 1e-6) * (b - a):
            continue
        if min(side * off_a, side * off_b) <= 0.0:
            continue
        runs.append([(a, off_a), (b, off_b)])
    runs.sort()
    merged: list[list[tuple[float, float]]] = []
    for run in runs:
        if merged and abs(run[0][0] - merged[-1][1][0]) < 1e-6:
            merged[-1][1] = run[1]
        else:
            merged.append(run)
    return max(merged, key=lambda run: run[1][0] - run[0][0], default=None)
