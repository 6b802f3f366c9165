"""The far end of a branch: a rounded tip or a pouch, in the frame of the branch's end.

The frame's origin is the end of the branch's planned length and +x is the branch's heading. A
rounded tip and a round pouch are centred on the origin, a rectangular pouch is too: half of its
length lies beyond the planned length.
"""

import math
from dataclasses import dataclass

from vinefab.geometry.layout import level_fillets_mm
from vinefab.geometry.neck import Neck, neck
from vinefab.geometry.stroke import LEAST_SEGMENT_MM, Piece, Point, Run, arc, polar
from vinefab.model.design import Design, Pouch
from vinefab.model.outline import Part


@dataclass(frozen=True, slots=True, kw_only=True)
class Tip:
    """What the walk does at the end of a leaf.

    Parameters
    ----------
    run
        From the branch's right side to its left side.
    used_mm
        How far before the end of the branch its straight sides stop.
    """

    run: Run
    used_mm: float


def tip_of(design: Design, offset_mm: float) -> Tip:
    """Return the far end of every leaf of a design.

    Parameters
    ----------
    design
        The design.
    offset_mm
        How far outside the lumen's edge the outline runs.
    """
    half, pouch = design.build.widths_mm[-1] / 2, design.build.pouch
    # A pouch no wider than its branch is a named problem; the bare tip is what can be drawn.
    if pouch is None or pouch.flat_width_mm <= 2.0 * half:
        return round_tip(half + offset_mm)
    return pouch_tip(pouch, half, level_fillets_mm(design)[-1], offset_mm)


def round_tip(half_mm: float) -> Tip:
    """Return half a circle on the end of a branch of half width ``half_mm``."""
    pieces = arc((0.0, 0.0), (0.0, -half_mm), math.pi, Part.TIP)
    return Tip(run=Run((0.0, -half_mm), tuple(pieces)), used_mm=0.0)


def pouch_tip(pouch: Pouch, half_mm: float, fillet_mm: float, offset_mm: float) -> Tip:
    """Return a pouch on the end of a branch.

    Parameters
    ----------
    pouch
        Its flat size, wider than the branch.
    half_mm
        Half the lumen width of the branch.
    fillet_mm
        Fillet radius of the neck.
    offset_mm
        How far outside the lumen's edge the outline runs.
    """
    drawn = max(0.0, fillet_mm - offset_mm)
    if pouch.shape == "round":
        return _round_pouch((pouch.radius_mm or 0.0) + offset_mm, half_mm + offset_mm, drawn)
    return _rectangle(pouch, half_mm, fillet_mm, offset_mm)


def _mirrored(right: list[Piece], start: Point, middle: list[Piece]) -> Tip:
    """Return the tip whose left side mirrors its right side about the branch's axis."""
    ends = [start, *(piece.end_mm for piece in right)]
    left = [
        Piece((end[0], -end[1]), piece.bulge, piece.part)
        for end, piece in zip(reversed(ends[:-1]), reversed(right), strict=True)
    ]
    return Tip(run=Run(start, (*right, *middle, *left)), used_mm=-start[0])


def _round_pouch(pouch_mm: float, half_mm: float, fillet_mm: float) -> Tip:
    found = neck(half_mm, pouch_mm, fillet_mm)
    start = (-found.used_mm, -half_mm)
    enter = polar(pouch_mm, found.angle_rad - math.pi)
    right = _neck_fillet(found, enter)
    turn = 2.0 * (math.pi - found.angle_rad)
    return _mirrored(right, start, arc((0.0, 0.0), enter, turn, Part.POUCH))


def _neck_fillet(found: Neck, enter: Point) -> list[Piece]:
    if found.radius_mm * found.turn_rad == 0.0:
        return []
    return [Piece(enter, -math.tan(found.turn_rad / 4.0), Part.FILLET)]


def corner_radii_mm(pouch: Pouch, half_mm: float, fillet_mm: float) -> Point:
    """Return neck fillet and corner radius of a rectangular pouch's lumen.

    The shoulder between branch and pouch is shared: the neck gets its designed radius but at most
    half the shoulder, the corner the same radius as long as a quarter of the pouch's length and
    the rest of the shoulder allow.

    Parameters
    ----------
    pouch
        A rectangular pouch.
    half_mm
        Half the lumen width of the branch.
    fillet_mm
        Designed radius of the neck.
    """
    length, width = pouch.length_mm or 0.0, pouch.width_mm or 0.0
    shoulder = width / 2 - half_mm
    inner = min(fillet_mm, shoulder / 2)
    wanted = fillet_mm if fillet_mm > 0.0 else shoulder / 2
    outer = min(wanted, shoulder - inner, length / 4)
    # Between the two the shoulder is straight for at least the shortest segment, or not at all.
    straight = shoulder - inner - outer
    if 1e-9 < straight < LEAST_SEGMENT_MM:
        grows = outer + straight <= length / 4
        outer += straight if grows else straight - LEAST_SEGMENT_MM
    return inner, outer


def least_convex_radius_mm(design: Design) -> float:
    """Return the smallest convex radius at the lumen's tips: of the pouches, or else of the tips.

    Parameters
    ----------
    design
        The design.
    """
    half, pouch = design.build.widths_mm[-1] / 2, design.build.pouch
    if pouch is None:
        return half
    if pouch.shape == "round":
        return pouch.flat_width_mm / 2
    return corner_radii_mm(pouch, half, level_fillets_mm(design)[-1])[1]


def _rectangle(pouch: Pouch, half_mm: float, fillet_mm: float, offset_mm: float) -> Tip:
    inner, outer = corner_radii_mm(pouch, half_mm, fillet_mm)
    front = (pouch.length_mm or 0.0) / 2 + offset_mm
    side = (pouch.width_mm or 0.0) / 2 + offset_mm
    # Inward beyond its radius, a rounded corner becomes a sharp one.
    radius = max(0.0, outer + offset_mm)
    axis = (radius - front, radius - side)
    right, start = _shoulder(half_mm + offset_mm, axis, radius, max(0.0, inner - offset_mm))
    right += [Piece((-axis[0], -side), 0.0, Part.POUCH)]
    right += arc((-axis[0], axis[1]), (-axis[0], -side), math.pi / 2, Part.POUCH)
    middle = [Piece((-axis[0] + radius, -axis[1]), 0.0, Part.POUCH)]
    return _mirrored(right, start, middle)


def _shoulder(
    half_mm: float, axis: Point, radius_mm: float, fillet_mm: float
) -> tuple[list[Piece], Point]:
    """Return the way from the branch's side round the back corner, and where it starts.

    Parameters
    ----------
    half_mm
        Half the branch's width as drawn.
    axis, radius_mm
        Centre and radius of the back corner's arc.
    fillet_mm
        Radius of the neck's fillet.
    """
    back = axis[0] - radius_mm
    risen = half_mm + fillet_mm + axis[1]
    if risen > 1e-9:
        # The fillet is gone and the branch's side has risen past the start of the corner's arc.
        along = math.sqrt(max(0.0, radius_mm**2 - risen**2))
        turn = math.acos(min(1.0, risen / max(radius_mm, risen)))
        start = (axis[0] - along, -half_mm)
        return arc(axis, start, turn, Part.POUCH), start
    start = (back - fillet_mm, -half_mm)
    pieces: list[Piece] = []
    if fillet_mm > 0.0:
        pieces += [Piece((back, -half_mm - fillet_mm), -math.tan(math.pi / 8), Part.FILLET)]
    pieces += [Piece((back, axis[1]), 0.0, Part.POUCH)]
    return [*pieces, *arc(axis, (back, axis[1]), math.pi / 2, Part.POUCH)], start
