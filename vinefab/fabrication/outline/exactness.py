"""The pieces of a design's outline, and the reasons why they may not form an exact one."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum
from functools import lru_cache

import numpy as np

from vinefab.core.plain_text import counted
from vinefab.core.validation import LARGEST_MM
from vinefab.fabrication.outline.ends import (
    Tail,
    TipStroke,
    least_convex_radius_mm,
    tail_of,
    tip_of,
)
from vinefab.fabrication.outline.gap import STEEPEST, crotch_reach_mm
from vinefab.fabrication.outline.joint import (
    Joint,
    allowed_reach_mm,
    joint_of,
    level_lengths_mm,
    level_tapers_rad,
)
from vinefab.fabrication.outline.layout import FlatLayout
from vinefab.fabrication.outline.stroke import LEAST_SEGMENT_MM, WORST_ERROR_MM
from vinefab.model.design import Build, Design, Level
from vinefab.model.outline import Contour


class ProblemKind(StrEnum):
    """The ways in which a design has no exact outline."""

    CHILD_WIDTH = "child_width"
    """A child is not narrower than its parent."""

    NARROW_CROTCH = "narrow_crotch"
    """Two neighbours at a joint part only beyond half the shorter of them."""

    NO_ROOM = "no_room"
    """Fillets, joints or a pouch at the two ends of a branch overlap along its side."""

    POUCH_WIDTH = "pouch_width"
    """A pouch is not wider than its branch."""

    VANISHED = "vanished"
    """An inward offset leaves nothing of a branch."""

    COLLAR = "collar"
    """A collar takes the whole tail."""

    COLLAR_FLARE = "collar_flare"
    """A collar goes over into the tail too suddenly."""

    SHORT_SEGMENT = "short_segment"
    """A line or arc would be too short to draw."""


@dataclass(frozen=True, slots=True, kw_only=True)
class OutlineProblem:
    """One reason why an outline is not exact."""

    kind: ProblemKind
    branches: tuple[str, ...]  # ids of the branches concerned, at the first place of the problem
    x_mm: float  # of that place in the flat layout
    y_mm: float
    count: int = 1  # number of places: all joints of a level are alike
    measured_mm: float
    limit_mm: float
    message: str  # one sentence: what is wrong and what would fix it


@dataclass(frozen=True, slots=True, kw_only=True)
class OutlineParts:
    """The pieces that an outline repeats."""

    offset_mm: float  # how far outside the lumen's edge they run
    tail: Tail  # from the mouth to the trunk's base
    # For each level with children, trunk first: one kind of joint, or, where the level tapers, one
    # for each child of a fan.
    joints: tuple[tuple[Joint, ...], ...]
    tips: tuple[TipStroke, ...]  # the far end of a leaf: one, or one for each child of a fan

    def joint(self, level: int, sibling: int) -> Joint:
        """Return the joint at the end of a branch."""
        kinds = self.joints[level - 1]
        return kinds[sibling % len(kinds)]

    def tip(self, sibling: int) -> TipStroke:
        """Return the far end of a leaf."""
        return self.tips[sibling % len(self.tips)]


def outline_parts(design: Design, offset_mm: float, least_fillet_mm: float = 0.0) -> OutlineParts:
    """Return the pieces of a design's outline at an offset; smaller fillets there are corners."""
    return _outline_parts(drawn_of(design), offset_mm, least_fillet_mm)


DrawnDesign = tuple[float, tuple[Level, ...], Build]
"""What of a design its outline is drawn from: length of the trunk, levels, build."""


def drawn_of(design: Design) -> DrawnDesign:
    """Return what of a design its outline is drawn from; it can be the key of a cache."""
    return design.trunk_length_mm, design.levels, design.build


def design_drawn(drawn: DrawnDesign) -> Design:
    """Return a design without a name of its own that has the same outline."""
    trunk_mm, levels, build = drawn
    return Design(name="drawn", trunk_length_mm=trunk_mm, levels=levels, build=build)


@lru_cache(maxsize=16)
def _outline_parts(drawn: DrawnDesign, offset_mm: float, least_fillet_mm: float) -> OutlineParts:
    # Whatever looks at a robot asks for the same few patterns: of its lumen and of its paths.
    design = design_drawn(drawn)
    return OutlineParts(
        offset_mm=offset_mm,
        tail=tail_of(design, offset_mm),
        joints=tuple(
            tuple(
                joint_of(design, level, offset_mm, sibling, least_fillet_mm=least_fillet_mm)
                for sibling in range(_kinds(design, level))
            )
            for level in range(1, design.depth)
        ),
        tips=tuple(
            tip_of(design, offset_mm, lean, least_fillet_mm)
            for lean in level_tapers_rad(design, design.depth)[: _kinds(design, design.depth)]
        ),
    )


def _kinds(design: Design, level: int) -> int:
    """Return how many kinds of ends the branches of a level have: one if all are even."""
    leans = level_tapers_rad(design, level)
    return 1 if len(set(leans)) == 1 else len(leans)


LEAST_STEP_MM = 0.1
"""A child must be narrower than its parent, and a pouch wider than its branch, by this much."""

LEAST_COLLAR_RADIUS_MM = 1.0
"""The arcs that lead from a collar to the trunk's width keep at least this radius (assumed)."""


class _Places:
    """Where the pieces of a pattern first occur: branch ids and coordinates."""

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
        """Return a problem that occurs at the end of every branch of one level."""
        count = int(np.count_nonzero(self.layout.tree.level == level))
        x, y = self.layout.end_mm[self.first[level]].tolist()
        message = _MESSAGES[kind].format(
            names=" and ".join(branches), found=found[0], limit=found[1]
        )
        return OutlineProblem(
            kind=kind,
            branches=branches,
            x_mm=x,
            y_mm=y,
            count=count,
            measured_mm=min(max(found[0], -LARGEST_MM), LARGEST_MM),
            limit_mm=found[1],
            message=message
            if count == 1
            else f"{message} It is so at {counted(count, 'place')} alike.",
        )


_MESSAGES = {
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
        "side, {limit:.3g} mm are needed: make it longer, or fillets, pouch or taper smaller."
    ),
    ProblemKind.POUCH_WIDTH: (
        "The pouch of {names} is {found:.4g} mm wide, its branch asks for at least {limit:.4g} mm."
    ),
    ProblemKind.VANISHED: (
        "The offset leaves {names} a half width or corner radius of {found:.3g} mm, at least "
        "{limit:.3g} mm are needed."
    ),
    ProblemKind.COLLAR: (
        "The collar leaves {found:.3g} mm of straight tail before the trunk of {names}, "
        "{limit:.3g} mm are needed: lengthen build.tail_mm or shorten the collar."
    ),
    ProblemKind.COLLAR_FLARE: (
        "The collar of {names} goes over into the tail within {found:.3g} mm, at least "
        "{limit:.3g} mm are needed: lengthen its flare_mm."
    ),
    ProblemKind.SHORT_SEGMENT: (
        "Near {names} the outline has a detail of {found:.2g} mm, too short to draw exactly "
        "({limit:.2g} mm): change the fillet radius or the angle a little."
    ),
}


def parts_problems(
    design: Design, layout: FlatLayout, pattern: OutlineParts
) -> tuple[OutlineProblem, ...]:
    """Return why the pieces of an outline do not fit together, in the order of the levels."""
    places = _Places(layout)
    found = [*_widths(design, places, pattern.offset_mm)]
    for kinds in pattern.joints:
        for number in range(len(kinds[0].gaps)):
            # Joints that differ only by the taper of their parents' sides share one problem.
            each = (_gap_problems(places, joint, number, pattern.offset_mm) for joint in kinds)
            found += next(filter(None, map(list, each)), [])
    return (*found, *_tail(design, places, pattern), *_rooms(design, places, pattern))


def drawing_problems(
    layout: FlatLayout, pattern: OutlineParts, contour: Contour
) -> tuple[OutlineProblem, ...]:
    """Return a problem for the shortest segment of a contour, if it is too short to draw."""
    shortest = min(contour.segments, key=lambda segment: segment.length_mm)
    # The mouth's width, the tip's arcs: only designs of microscopic size get here.
    if shortest.length_mm >= LEAST_SEGMENT_MM * (1.0 - 1e-6) and pattern.tail.start_mm[1] < 0.0:
        return ()
    level = int(layout.tree.level[layout.tree.ids.index(shortest.branch)])
    found = (shortest.length_mm, LEAST_SEGMENT_MM)
    problem = _Places(layout).problem(ProblemKind.SHORT_SEGMENT, level, (shortest.branch,), found)
    return (problem,)


def _widths(design: Design, places: _Places, offset_mm: float) -> Iterator[OutlineProblem]:
    widths, pouch = design.build.widths_mm, design.build.pouch
    ends = design.build.end_widths_mm
    for level, width in enumerate(ends, start=1):
        name = places.ids[places.first[level]]
        if width / 2 + offset_mm < LEAST_SEGMENT_MM:
            found = (width / 2 + offset_mm, LEAST_SEGMENT_MM)
            yield places.problem(ProblemKind.VANISHED, level, (name,), found)
        found = (widths[level - 1], ends[level - 2] - LEAST_STEP_MM)
        if level > 1 and found[0] > found[1]:
            parent = places.ids[places.first[level - 1]]
            yield places.problem(ProblemKind.CHILD_WIDTH, level - 1, (parent, name), found)
    limit = ends[-1] + LEAST_STEP_MM
    name = places.ids[places.first[design.depth]]
    if pouch is not None and pouch.flat_width_mm < limit:
        found = (pouch.flat_width_mm, limit)
        yield places.problem(ProblemKind.POUCH_WIDTH, design.depth, (name,), found)
    elif pouch is not None and least_convex_radius_mm(design) + offset_mm < 0.0:
        found = (least_convex_radius_mm(design) + offset_mm, 0.0)
        yield places.problem(ProblemKind.VANISHED, design.depth, (name,), found)


def _gap_problems(
    places: _Places, joint: Joint, number: int, offset_mm: float
) -> Iterator[OutlineProblem]:
    gap = joint.gaps[number]
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


def _tail(design: Design, places: _Places, pattern: OutlineParts) -> Iterator[OutlineProblem]:
    """Check that a collar leaves some straight tail, and that its arcs are not too small."""
    collar, tail = design.build.collar, pattern.tail
    if collar is None:
        return
    room = tail.base_mm[0] - tail.even_mm
    if room < LEAST_SEGMENT_MM:
        yield places.problem(ProblemKind.COLLAR, 1, ("0",), (room, LEAST_SEGMENT_MM))
    rise = abs(collar.flat_width_mm - design.build.widths_mm[0]) / 2
    # Arcs that turn by more than a right angle run back; a radius r takes a flare of
    # sqrt((4 r - rise) rise).
    radius = LEAST_COLLAR_RADIUS_MM + abs(pattern.offset_mm)
    least = max(rise, math.sqrt(max(0.0, (4.0 * radius - rise) * rise)))
    if collar.flare_mm < least:
        yield places.problem(ProblemKind.COLLAR_FLARE, 1, ("0",), (collar.flare_mm, least))
    if -tail.start_mm[1] < LEAST_SEGMENT_MM:
        found = (-tail.start_mm[1], LEAST_SEGMENT_MM)
        yield places.problem(ProblemKind.VANISHED, 1, ("0",), found)


def _rooms(design: Design, places: _Places, pattern: OutlineParts) -> Iterator[OutlineProblem]:
    """Check the straight side that is left between the two ends of every kind of branch."""
    trunk = design.trunk_length_mm
    if level_tapers_rad(design, 1)[0]:
        # The side of a tapered trunk ends where the tail's begins.
        trunk = _side_mm(design, 1, 0)
    else:
        trunk -= pattern.tail.even_mm
    yield from _room(places, pattern, (1, 0), (trunk, 0.0, 0.0))
    for kinds in pattern.joints:
        level = kinds[0].level + 1
        for child in range(design.levels[level - 2].branches):
            right = max(joint.gaps[child].second_used_mm for joint in kinds)
            left = max(joint.gaps[child + 1].first_used_mm for joint in kinds)
            base = (_side_mm(design, level, child), right, left)
            yield from _room(places, pattern, (level, child), base)


def _side_mm(design: Design, level: int, child: int) -> float:
    """Return the length of a branch's side between the discs at its ends.

    Where the larger disc hides the smaller one it is negative: by how much the branch is too short.
    """
    build, length = design.build, level_lengths_mm(design, level)[child]
    least = (build.widths_mm[level - 1] - build.end_widths_mm[level - 1]) / 2.0 / STEEPEST
    if length < least:
        return length - least
    return length * math.cos(level_tapers_rad(design, level)[child])


def _room(
    places: _Places,
    pattern: OutlineParts,
    branch: tuple[int, int],
    base: tuple[float, float, float],
) -> Iterator[OutlineProblem]:
    """Check one branch: ``base`` holds its length and what its base takes, right and left."""
    level, child = branch
    if level <= len(pattern.joints):
        gaps = pattern.joint(level, child).gaps
        right, left = gaps[0].first_used_mm, gaps[-1].second_used_mm
    else:
        right = left = pattern.tip(child).used_mm
    room = base[0] - max(base[1] + right, base[2] + left)
    if room < LEAST_SEGMENT_MM:
        name = places.ids[places.first[level] + child]
        yield places.problem(ProblemKind.NO_ROOM, level, (name,), (room, LEAST_SEGMENT_MM))
