"""Straight side that joints and pouches leave of the branches of each level, in closed form."""

import math

from vinefab.geometry.joint import level_lengths_mm, level_tapers_rad
from vinefab.geometry.layout import level_fillets_mm
from vinefab.model.design import Design

Pair = tuple[float, float]


def rooms_mm(design: Design) -> list[Pair]:
    """Return, for each level, the straight side left of its shortest branch, and its length.

    Fillets count with their designed radius. The outline draws them smaller where an angle allows
    no more, so that what it leaves is never less than this.

    Returns
    -------
    list of (float, float)
        Room, negative where the two ends of a branch overlap, and length; trunk first.
    """
    ends = [*(_joint(design, level) for level in range(1, design.depth))]
    bases_mm = [0.0, *(child_mm for _, child_mm in ends)]
    tips_mm = [*(parent_mm for parent_mm, _ in ends), _tip_mm(design)]
    lengths_mm = [_trunk_mm(design)]
    for number in range(2, design.depth + 1):
        leans, all_mm = level_tapers_rad(design, number), level_lengths_mm(design, number)
        shortest = min(range(len(all_mm)), key=all_mm.__getitem__)
        lengths_mm.append(all_mm[shortest] * math.cos(leans[shortest]))
    return [
        (length - base - tip, length)
        for length, base, tip in zip(lengths_mm, bases_mm, tips_mm, strict=True)
    ]


def _trunk_mm(design: Design) -> float:
    """Return the length of the trunk's side; that of an even one goes on along the tail."""
    lean = level_tapers_rad(design, 1)[0]
    if lean:
        return design.trunk_length_mm * math.cos(lean)
    collar = design.build.collar
    even_mm = design.build.tail_mm - (collar.reach_mm if collar else 0.0)
    return design.trunk_length_mm + even_mm


def _joint(design: Design, number: int) -> Pair:
    """Return how much of parent and child the joint below level ``number`` takes."""
    level = design.levels[number - 1]
    wide = design.build.end_widths_mm[number - 1] / 2.0
    narrow = design.build.widths_mm[number] / 2.0
    radius = design.build.fillet_mm[number - 1]
    fan = level.fan_rad if level.branches > 1 else 0.0
    parent, child = _gap(
        math.pi - fan / 2.0 - max(level_tapers_rad(design, number)), (wide, narrow), radius
    )
    if level.branches > 1:
        child = max(child, _gap(fan / (level.branches - 1), (narrow, narrow), radius, wide)[0])
    return parent, child


def _gap(angle_rad: float, halves_mm: Pair, radius_mm: float, disc_mm: float = 0.0) -> Pair:
    """Return how far from the joint the straight sides of two neighbours begin."""
    disc = max(disc_mm, *halves_mm)
    one, two = (half + radius_mm for half in halves_mm)
    hidden = sum(math.asin(reach / (disc + radius_mm)) for reach in (one, two))
    if hidden <= angle_rad:
        first, second = (_neck_mm(half, disc, radius_mm) for half in halves_mm)
        return first, second
    sin, cos = math.sin(angle_rad), math.cos(angle_rad)
    if sin < 1e-9:
        return math.inf, math.inf
    return max(0.0, (two + one * cos) / sin), max(0.0, (one + two * cos) / sin)


def _neck_mm(half_mm: float, disc_mm: float, radius_mm: float) -> float:
    """Return how far from a disc's centre a side at ``half_mm`` meets its fillet."""
    return math.sqrt(max(0.0, (disc_mm - half_mm) * (disc_mm + half_mm + 2.0 * radius_mm)))


def _tip_mm(design: Design) -> float:
    """Return how much of a leaf its pouch takes, before the end of its planned length."""
    pouch, half_mm = design.build.pouch, design.build.end_widths_mm[-1] / 2.0
    radius_mm = level_fillets_mm(design)[-1]
    if pouch is None or pouch.flat_width_mm <= 2.0 * half_mm:
        return 0.0
    if pouch.shape == "round":
        return _neck_mm(half_mm, pouch.radius_mm or 0.0, radius_mm)
    return (pouch.length_mm or 0.0) / 2.0 + radius_mm
