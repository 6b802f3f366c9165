"""The tail: from the mouth to the base of the trunk, with the collar that fits it to a clamp.

Coordinates are those of the flat layout: the trunk's base is the origin and the tail lies along
-x. Only the right side is worked out; the left one mirrors it.
"""

import math
from dataclasses import dataclass

from vinefab.geometry.joint import level_tapers_rad
from vinefab.geometry.stroke import LEAST_SEGMENT_MM, Piece, Point, turned
from vinefab.model.design import Collar, Design
from vinefab.model.outline import Part


@dataclass(frozen=True, slots=True, kw_only=True)
class Tail:
    """The right side of a tail.

    Parameters
    ----------
    start_mm
        Right corner of the mouth.
    pieces
        From the mouth to where the tail is as wide as the trunk; none without a collar.
    even_mm
        Where that is, along x; not after the trunk's base unless the collar is too long.
    base_mm
        Where the trunk's base ends the tail's side.
    bend
        From there to where a tapered trunk's side begins; none for an even trunk.
    """

    start_mm: Point
    pieces: tuple[Piece, ...]
    even_mm: float
    base_mm: Point
    bend: tuple[Piece, ...] = ()


def tail_of(design: Design, offset_mm: float) -> Tail:
    """Return the tail of a design.

    Parameters
    ----------
    design
        The design.
    offset_mm
        How far outside the lumen's edge the outline runs; the mouth stays where it is.
    """
    mouth, half = -design.build.tail_mm, design.build.widths_mm[0] / 2 + offset_mm
    base, bend = _bend(half, level_tapers_rad(design, 1)[0])
    collar = design.build.collar
    if collar is None:
        return Tail(start_mm=(mouth, -half), pieces=(), even_mm=mouth, base_mm=base, bend=bend)
    wide = collar.flat_width_mm / 2 + offset_mm
    # A straight piece too short to draw is left out.
    start = mouth + (collar.length_mm if collar.length_mm >= LEAST_SEGMENT_MM else 0.0)
    pieces = _transition(collar, (start, wide - half), offset_mm)
    straight = [Piece((start, -wide), 0.0, Part.TAIL)] if start > mouth else []
    shifted = [Piece((p.end_mm[0], p.end_mm[1] - wide), p.bulge, p.part) for p in pieces]
    return Tail(
        start_mm=(mouth, -wide),
        pieces=(*straight, *shifted),
        even_mm=start + collar.flare_mm,
        base_mm=base,
        bend=bend,
    )


def _bend(half_mm: float, lean_rad: float) -> tuple[Point, tuple[Piece, ...]]:
    """Return where the tail's side ends and how it goes over into the trunk's."""
    if half_mm * lean_rad < LEAST_SEGMENT_MM:
        return (half_mm * math.tan(lean_rad / 2), -half_mm), ()
    end = turned((0.0, -half_mm), lean_rad)
    return (0.0, -half_mm), (Piece(end, math.tan(lean_rad / 4), Part.JOINT),)


def _transition(collar: Collar, start_and_rise_mm: Point, offset_mm: float) -> list[Piece]:
    """Return two arcs that rise from the clamp's side to the trunk's.

    Arcs of one radius r that both turn by t rise 2 r (1 - cos t) over 2 r sin t. An offset keeps
    centres and turns, makes the one that bulges outward larger and the other one smaller.

    Parameters
    ----------
    collar
        The collar.
    start_and_rise_mm
        Where they begin along x; by how much the right side rises towards the axis.
    offset_mm
        As in `tail_of`.
    """
    start, rise = start_and_rise_mm
    if abs(rise) < 1e-9:
        return []
    turn = 2.0 * math.atan(rise / collar.flare_mm)
    radius = collar.flare_mm / (2.0 * math.sin(abs(turn)))
    outward, inward = radius + offset_mm, radius - offset_mm
    # A mouth wider than the trunk: its side first turns in, around the body's own side.
    first = outward if rise > 0.0 else inward
    middle = start + first * math.sin(abs(turn))
    risen = math.copysign(first * (1.0 - math.cos(turn)), rise)
    bulge = math.tan(turn / 4.0)
    return [
        Piece((middle, risen), bulge, Part.COLLAR),
        Piece((start + collar.flare_mm, rise), -bulge, Part.COLLAR),
    ]
