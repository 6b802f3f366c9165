"""The joints of a design: one for each level, since every branch of a level sprouts alike."""

import math
from dataclasses import dataclass
from itertools import pairwise

from vinefab.geometry.crotch import Gap, Strip, largest_fillet_mm
from vinefab.geometry.gap import solve_gap
from vinefab.model.design import Design
from vinefab.model.tree import child_lengths_mm, fan_offsets_rad


@dataclass(frozen=True, slots=True, kw_only=True)
class Joint:
    """What the walk does at every joint of one level.

    Parameters
    ----------
    level
        Level of the parents, 1 for the trunk.
    disc_mm
        Radius of the joint's disc on the lumen.
    gaps
        From the parent's right side to the first child, between children, and from the last child
        to the parent's left side.
    fillet_mm
        Designed fillet radius.
    allowed_mm
        The largest radius that the angle allows in each gap, negative if the neighbours part too
        late for any.
    """

    level: int
    disc_mm: float
    gaps: tuple[Gap, ...]
    fillet_mm: float
    allowed_mm: tuple[float, ...]


def joint_of(design: Design, level: int, offset_mm: float) -> Joint:
    """Return the joint at the ends of all branches of one level.

    Fillet radii are capped on the lumen itself, so that every offset has the same fillet centres.

    Parameters
    ----------
    design
        The design.
    level
        Level of the parents, 1 for the trunk.
    offset_mm
        How far outside the lumen's edge the outline runs.
    """
    strips = _strips(design, level)
    # The joint's disc is the parent's; a child that is wider is a problem of its own, and the
    # larger disc at least draws it as it would be.
    disc = max(strip.half_mm for strip in strips)
    designed = design.build.fillet_mm[level - 1]
    gaps, allowed = [], []
    for first, second in pairwise(strips):
        angle, halves = second.angle_rad - first.angle_rad, (first.half_mm, second.half_mm)
        most = largest_fillet_mm(angle, halves, allowed_reach_mm(first, second, disc))
        radius = max(0.0, min(designed, most))
        # Beyond its own radius an outward offset turns a fillet into a corner: exactly what
        # rolling a ball around the body gives.
        drawn = max(0.0, radius - offset_mm)
        gaps.append(
            solve_gap(_wider(first, offset_mm), _wider(second, offset_mm), disc + offset_mm, drawn)
        )
        allowed.append(most)
    return Joint(
        level=level,
        disc_mm=disc,
        gaps=tuple(gaps),
        fillet_mm=designed,
        allowed_mm=tuple(allowed),
    )


def allowed_reach_mm(first: Strip, second: Strip, disc_mm: float) -> float:
    """Return how far from the joint two neighbours must have parted.

    Half the shorter neighbour; within the joint's disc there is nothing to web.
    """
    return max(0.5 * min(first.length_mm, second.length_mm), disc_mm)


def _strips(design: Design, level: int) -> tuple[Strip, ...]:
    """Return the parent, the children and the parent again, counter-clockwise."""
    below = design.levels[level - 1]
    widths = design.build.widths_mm
    # Branches of one level may differ in length; the shortest parent caps the fillets of all.
    above = design.levels[level - 2] if level > 1 else None
    parent = min(child_lengths_mm(above).tolist()) if above else design.trunk_length_mm
    angles, lengths = fan_offsets_rad(below).tolist(), child_lengths_mm(below).tolist()
    children = [
        Strip(angle_rad=angle, half_mm=widths[level] / 2, length_mm=length, owner=owner)
        for owner, (angle, length) in enumerate(zip(angles, lengths, strict=True), start=1)
    ]
    ends = [
        Strip(angle_rad=angle, half_mm=widths[level - 1] / 2, length_mm=parent, owner=0)
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
