"""The joints of a design: every branch of a level sprouts alike, or every n-th child does.

Branches of one level that taper from the same width to the same width over different lengths lean
differently: then there is one kind of joint for each child of a fan.
"""

import math
from dataclasses import dataclass
from itertools import pairwise

from vinefab.fabrication.outline.gap import (
    LEFT,
    RIGHT,
    Core,
    Gap,
    JointBranch,
    Strip,
    largest_fillet_mm,
    solve_gap,
    taper_rad,
)
from vinefab.model.design import Design, Level
from vinefab.model.tree import child_lengths_mm, fan_offsets_rad

DEEPEST_CORNER_MM = 1.5
"""A corner in place of a small fillet lies at most this much deeper in its crotch (assumed).

A cut that goes 2 mm outside a seam then still keeps off it.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class Joint:
    """The outline at every joint of one level."""

    level: int  # level of the parents, 1 for the trunk
    disc_mm: float  # radius of the joint's disc on the lumen
    # From the parent's right side to the first child, between children, and from the last child to
    # the parent's left side.
    gaps: tuple[Gap, ...]
    fillet_mm: float  # designed fillet radius
    # Largest fillet radius that the angle allows in each gap; negative if the neighbours part too
    # far from the joint for any.
    allowed_mm: tuple[float, ...]


def joint_of(
    design: Design, level: int, offset_mm: float, sibling: int = 0, *, least_fillet_mm: float = 0.0
) -> Joint:
    """Return the joint at the ends of the branches of one level.

    Fillet radii are capped on the lumen itself, so that every offset has the same fillet centres.
    Fillets that the offset leaves smaller than ``least_fillet_mm`` are corners.
    """
    around = _around(design, level, sibling)
    # The joint's disc is the parent's. A wider child is a problem of its own; the larger disc at
    # least draws it as it would be.
    disc = max(branch.half_mm for branch in around)
    tilt = -around[0].narrowing_rad
    designed = design.build.fillet_mm[level - 1]
    gaps, allowed = [], []
    for one, two in pairwise(around):
        first, second = one.side(LEFT), two.side(RIGHT)
        angle, halves = second.angle_rad - first.angle_rad, (first.half_mm, second.half_mm)
        most = largest_fillet_mm(angle, halves, allowed_reach_mm(first, second, disc))
        radius = max(0.0, min(designed, most))
        # Beyond its own radius an outward offset turns a fillet into a corner: exactly what
        # rolling a ball around the body gives.
        drawn = max(0.0, radius - offset_mm)
        if drawn < least_fillet_mm and drawn / math.sin(angle / 2) - drawn < DEEPEST_CORNER_MM:
            drawn = 0.0
        core = Core(radius_mm=disc + offset_mm, tilt_rad=tilt)
        gaps.append(solve_gap(_wider(first, offset_mm), _wider(second, offset_mm), core, drawn))
        allowed.append(most)
    return Joint(
        level=level,
        disc_mm=disc,
        gaps=tuple(gaps),
        fillet_mm=designed,
        allowed_mm=tuple(allowed),
    )


def allowed_reach_mm(first: Strip, second: Strip, disc_mm: float) -> float:
    """Return how far from the joint two neighbours must have parted: half the shorter one.

    Within the joint's disc there is nothing to web.
    """
    return max(0.5 * min(first.length_mm, second.length_mm), disc_mm)


def level_tapers_rad(design: Design, level: int) -> tuple[float, ...]:
    """Return by how much the sides of a level's branches lean, one per child of a fan."""
    base, end = design.build.widths_mm[level - 1] / 2, design.build.end_widths_mm[level - 1] / 2
    return tuple(taper_rad(base, end, length) for length in level_lengths_mm(design, level))


def level_lengths_mm(design: Design, level: int) -> tuple[float, ...]:
    """Return the lengths of a level's branches, one per child of a fan; 1 is the trunk."""
    if level == 1:
        return (design.trunk_length_mm,)
    return tuple(child_lengths_mm(design.levels[level - 2]).tolist())


def _around(design: Design, level: int, sibling: int) -> tuple[JointBranch, ...]:
    """Return the parent, the children and the parent again, counter-clockwise."""
    below: Level = design.levels[level - 1]
    # Branches of one level may differ in length; the shortest parent caps the fillets of all.
    parent = min(level_lengths_mm(design, level))
    end_half, tilt = design.build.end_widths_mm[level - 1] / 2, level_tapers_rad(design, level)
    angles, lengths = fan_offsets_rad(below).tolist(), child_lengths_mm(below).tolist()
    leans = level_tapers_rad(design, level + 1)
    children = [
        JointBranch(
            angle_rad=angles[child],
            half_mm=design.build.widths_mm[level] / 2,
            length_mm=lengths[child],
            owner=child + 1,
            narrowing_rad=leans[child],
        )
        for child in range(below.branches)
    ]
    ends = [
        JointBranch(
            angle_rad=angle,
            half_mm=end_half,
            length_mm=parent,
            owner=0,
            narrowing_rad=-tilt[sibling],
        )
        for angle in (-math.pi, math.pi)
    ]
    return (ends[0], *children, ends[1])


def _wider(strip: Strip, offset_mm: float) -> Strip:
    return Strip(
        angle_rad=strip.angle_rad,
        half_mm=strip.half_mm + offset_mm,
        length_mm=strip.length_mm,
        owner=strip.owner,
    )
