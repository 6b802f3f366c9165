"""What is engraved into the underside of a tile: its number, and an arrow to the map's north."""

import shapely
from shapely import Polygon
from shapely.affinity import translate
from shapely.geometry.base import BaseGeometry

from vinefab.rig.clean import Pieces, pieces_of
from vinefab.rig.glyphs import arrow, centred, grooves, mirrored, strokes
from vinefab.rig.options import GRID_MM

STROKE_MM = 1.0
"""Width of the grooves: the printer bridges over them without supports."""

_DIGIT_MM, _ARROW_MM, _APART_MM = 10.0, 14.0, 5.0
_SMALLEST = 0.4
_ROOM_MM = 1.5


def marks_for(number: int, plate: Polygon, *, from_below: bool = True) -> Pieces:
    """Return the grooves of a tile's number and north arrow, in the coordinates of the plan.

    They lie around the middle of the largest circle in the plate and shrink to fit it; below two
    fifths of their full size there are none. Seen from above they are mirrored, so that they read
    right from below; north is +y of the map either way.

    Parameters
    ----------
    number
        The tile's number.
    plate
        Its outline.
    from_below
        Whether they are read from below.
    """
    circle = shapely.maximum_inscribed_circle(plate, 0.1)
    (x_mm, y_mm), _ = circle.coords
    block = _block(number, 1.0, from_below=from_below)
    x_min, y_min, x_max, y_max = block.bounds
    diagonal_mm = ((x_max - x_min) ** 2 + (y_max - y_min) ** 2) ** 0.5
    size = min(1.0, 2.0 * (circle.length - _ROOM_MM) / diagonal_mm)
    if size < _SMALLEST:
        return pieces_of(Polygon())
    moved = translate(_block(number, size, from_below=from_below), x_mm, y_mm)
    return pieces_of(shapely.set_precision(moved, GRID_MM))


def _block(number: int, size: float, *, from_below: bool) -> BaseGeometry:
    """Return arrow and number side by side, the middle of both at the origin."""
    digits = strokes(str(number), size * _DIGIT_MM)
    digits = mirrored(digits) if from_below else digits
    digits_mm = shapely.total_bounds(digits)
    pointer = arrow(size * _ARROW_MM)
    pointer_mm = shapely.total_bounds(pointer)
    wide_mm = digits_mm[2] - digits_mm[0] + pointer_mm[2] - pointer_mm[0] + size * _APART_MM
    digits = centred(digits, -0.5 * (wide_mm - (digits_mm[2] - digits_mm[0])), 0.0)
    pointer = centred(pointer, 0.5 * (wide_mm - (pointer_mm[2] - pointer_mm[0])), 0.0)
    return grooves([*digits, *pointer], STROKE_MM)
