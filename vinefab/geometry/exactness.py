"""Where a design has no exact outline, found on the patterns that the walk repeats."""

from collections.abc import Iterator

import numpy as np

from vinefab.geometry.crotch import Gap, crotch_reach_mm
from vinefab.geometry.joint import Joint, allowed_reach_mm
from vinefab.geometry.layout import FlatLayout
from vinefab.geometry.pattern import Pattern
from vinefab.geometry.problem import OutlineProblem, ProblemKind
from vinefab.geometry.stroke import LEAST_SEGMENT_MM
from vinefab.geometry.tip import least_convex_radius_mm
from vinefab.model.checked import LARGEST_MM
from vinefab.model.design import Design
from vinefab.model.outline import Contour
from vinefab.model.tree import child_lengths_mm

LEAST_STEP_MM = 0.1
"""A child must be narrower than its parent, and a pouch wider than its branch, by this much."""

WORST_ERROR_MM = 0.002
"""An arc too short to draw may become a corner that is this far from the exact shape."""


class _Places:
    """Names the branches of a pattern and the place where it first occurs."""

    def __init__(self, layout: FlatLayout) -> None:
        self.layout = layout
        self.ids = layout.tree.ids
        self.first = {
            level: int(np.flatnonzero(layout.tree.level == level)[0])
            for level in np.unique(layout.tree.level).tolist()
        }

    def branch(self, joint: Joint, owner: int) -> str:
        """Return the id of a strip at the first joint of its level."""
        if owner == 0:
            return self.ids[self.first[joint.level]]
        return self.ids[self.first[joint.level + 1] + owner - 1]

    def problem(
        self, kind: ProblemKind, level: int, branches: tuple[str, ...], found: tuple[float, float]
    ) -> OutlineProblem:
        """Return a problem that occurs at the end of every branch of one level.

        Parameters
        ----------
        kind
            What is wrong.
        level
            Level of the branches at whose ends it happens.
        branches
            Ids concerned at the first of them.
        found
            Measured and allowed length, in mm.
        """
        count = int(np.count_nonzero(self.layout.tree.level == level))
        x, y = self.layout.end_mm[self.first[level]].tolist()
        words = _WORDS[kind].format(names=" and ".join(branches), found=found[0], limit=found[1])
        return OutlineProblem(
            kind=kind,
            branches=branches,
            x_mm=x,
            y_mm=y,
            count=count,
            measured_mm=min(max(found[0], -LARGEST_MM), LARGEST_MM),
            limit_mm=found[1],
            words=words if count == 1 else f"{words} It is so at {count} places alike.",
        )


_WORDS = {
    ProblemKind.CHILD_WIDTH: (
        "Of {names} the child is {found:.3g} mm wide and its parent leaves it {limit:.3g} mm: "
        "make the child's level narrower."
    ),
    ProblemKind.NARROW_CROTCH: (
        "The sides of {names} part only {found:.4g} mm from their joint, more than the "
        "{limit:.4g} mm that are half the shorter one: widen the angle between them, make them "
        "narrower or longer."
    ),
    ProblemKind.NO_ROOM: (
        "Fillets, joints or pouches at the two ends of {names} leave {found:.3g} mm of straight "
        "side, {limit:.3g} mm are needed: make it longer, or fillets and pouch smaller."
    ),
    ProblemKind.POUCH_WIDTH: (
        "The pouch of {names} is {found:.4g} mm wide, its branch asks for at least {limit:.4g} mm."
    ),
    ProblemKind.VANISHED: (
        "The offset leaves {names} a half width or corner radius of {found:.3g} mm, at least "
        "{limit:.3g} mm are needed."
    ),
    ProblemKind.SHORT_SEGMENT: (
        "Near {names} the outline has a detail of {found:.2g} mm, too short to draw exactly "
        "({limit:.2g} mm): change the fillet radius or the angle a little."
    ),
}


def pattern_problems(
    design: Design, layout: FlatLayout, pattern: Pattern
) -> tuple[OutlineProblem, ...]:
    """Return why the pieces of an outline do not fit together, in the order of the levels.

    Parameters
    ----------
    design, layout
        The design and its flat layout.
    pattern
        The pieces, at the offset in question.
    """
    places = _Places(layout)
    found = [*_widths(design, places, pattern.offset_mm)]
    for joint in pattern.joints:
        for number, gap in enumerate(joint.gaps):
            found += _gap_problems(places, joint, number, gap, pattern.offset_mm)
    return (*found, *_rooms(design, places, pattern))


def drawing_problems(
    layout: FlatLayout, pattern: Pattern, contour: Contour
) -> tuple[OutlineProblem, ...]:
    """Return a problem for the shortest segment of a contour, if it is too short to draw.

    Parameters
    ----------
    layout, pattern
        Layout and pieces that the contour was drawn from.
    contour
        The finished contour.
    """
    shortest = min(contour.segments, key=lambda segment: segment.length_mm)
    # The mouth's width, the tip's arcs: anything here comes from a design of microscopic size.
    if shortest.length_mm >= LEAST_SEGMENT_MM * (1.0 - 1e-6) and pattern.mouth_half_mm > 0.0:
        return ()
    level = int(layout.tree.level[layout.tree.ids.index(shortest.branch)])
    found = (shortest.length_mm, LEAST_SEGMENT_MM)
    problem = _Places(layout).problem(ProblemKind.SHORT_SEGMENT, level, (shortest.branch,), found)
    return (problem,)


def _widths(design: Design, places: _Places, offset_mm: float) -> Iterator[OutlineProblem]:
    widths, pouch = design.build.widths_mm, design.build.pouch
    for level, width in enumerate(widths, start=1):
        name = places.ids[places.first[level]]
        if width / 2 + offset_mm < LEAST_SEGMENT_MM:
            found = (width / 2 + offset_mm, LEAST_SEGMENT_MM)
            yield places.problem(ProblemKind.VANISHED, level, (name,), found)
        limit = widths[level - 2] - LEAST_STEP_MM
        if level > 1 and width > limit:
            parent = places.ids[places.first[level - 1]]
            yield places.problem(ProblemKind.CHILD_WIDTH, level - 1, (parent, name), (width, limit))
    limit = widths[-1] + LEAST_STEP_MM
    name = places.ids[places.first[design.depth]]
    if pouch is not None and pouch.flat_width_mm < limit:
        found = (pouch.flat_width_mm, limit)
        yield places.problem(ProblemKind.POUCH_WIDTH, design.depth, (name,), found)
    elif pouch is not None and least_convex_radius_mm(design) + offset_mm < 0.0:
        found = (least_convex_radius_mm(design) + offset_mm, 0.0)
        yield places.problem(ProblemKind.VANISHED, design.depth, (name,), found)


def _gap_problems(
    places: _Places, joint: Joint, number: int, gap: Gap, offset_mm: float
) -> Iterator[OutlineProblem]:
    names = (places.branch(joint, gap.first.owner), places.branch(joint, gap.second.owner))
    if joint.allowed_mm[number] < 0.0:
        halves = gap.first.half_mm - offset_mm, gap.second.half_mm - offset_mm
        found = (
            crotch_reach_mm(gap.angle_rad, *halves),
            allowed_reach_mm(gap.first, gap.second, joint.disc_mm),
        )
        yield places.problem(ProblemKind.NARROW_CROTCH, joint.level, names, found)
    elif gap.error_mm > WORST_ERROR_MM and min(joint.allowed_mm) >= 0.0:
        found = (gap.error_mm, WORST_ERROR_MM)
        yield places.problem(ProblemKind.SHORT_SEGMENT, joint.level, names, found)


def _rooms(design: Design, places: _Places, pattern: Pattern) -> Iterator[OutlineProblem]:
    """Check the straight side that is left between the two ends of every kind of branch."""
    trunk = design.trunk_length_mm + design.build.tail_mm
    yield from _room(places, pattern, 1, "0", (trunk, 0.0, 0.0))
    for joint in pattern.joints:
        lengths = child_lengths_mm(design.levels[joint.level - 1]).tolist()
        for child, length in enumerate(lengths):
            right = joint.gaps[child].second_used_mm
            left = joint.gaps[child + 1].first_used_mm
            name = places.branch(joint, child + 1)
            yield from _room(places, pattern, joint.level + 1, name, (length, right, left))


def _room(
    places: _Places, pattern: Pattern, level: int, name: str, base: tuple[float, float, float]
) -> Iterator[OutlineProblem]:
    """Check one branch: ``base`` holds its length and what its base takes, right and left."""
    right = left = pattern.tip.used_mm
    if level <= len(pattern.joints):
        gaps = pattern.joints[level - 1].gaps
        right, left = gaps[0].first_used_mm, gaps[-1].second_used_mm
    room = base[0] - max(base[1] + right, base[2] + left)
    if room < LEAST_SEGMENT_MM:
        yield places.problem(ProblemKind.NO_ROOM, level, (name,), (room, LEAST_SEGMENT_MM))
