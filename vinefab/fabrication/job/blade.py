r"""Where the axis of a trailing blade runs, so that its cutting point follows a path.

The point trails the axis by e along the blade's heading t, and moves along t alone::

    point p o------> t
             \__e__\
                     x axis c = p + e t

So the axis of a straight cut is the same line, e ahead; that of an arc of radius r is an arc around
the same centre, of radius sqrt(r^2 + e^2) and the same turn: both are exact. At a corner the axis
swivels around the point, which rests, on an arc of radius e.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass

from vinefab.core.errors import BadInputError
from vinefab.model.outline import Contour, Segment

Point = tuple[float, float]
SAME_RAD = 1e-9
"""Turns at a join up to this are rounding."""


@dataclass(frozen=True, slots=True, kw_only=True)
class AxisMove:
    """One line or arc of the axis."""

    segment: Segment
    turn_rad: float = 0.0  # by which the blade swivels around its resting point; 0: it cuts

    @property
    def swivels(self) -> bool:
        """Whether the point rests."""
        return self.turn_rad != 0.0


def ahead_mm(point_mm: Point, heading_rad: float, offset_mm: float) -> Point:
    """Return the place of the axis over a point."""
    x, y = point_mm
    return x + offset_mm * math.cos(heading_rad), y + offset_mm * math.sin(heading_rad)


def axis_moves(contour: Contour, offset_mm: float, heading_rad: float) -> Iterator[AxisMove]:
    """Yield the moves of the axis along an open path.

    Parameters
    ----------
    offset_mm
        By how much the point trails.
    heading_rad
        Of the blade as it comes down on the start of the path.
    """
    if contour.closed:
        raise BadInputError("contour", "closed", "an open path, which runs past its start")
    now = heading_rad
    for segment in contour.segments:
        first, last = segment.direction_rad(), segment.direction_rad(at_end=True)
        turn = math.remainder(first - now, math.tau)
        if abs(turn) > SAME_RAD:
            start, end = (ahead_mm(segment.start_mm, angle, offset_mm) for angle in (now, first))
            yield AxisMove(segment=_between(start, end, turn), turn_rad=turn)
        start = ahead_mm(segment.start_mm, first, offset_mm)
        end = ahead_mm(segment.end_mm, last, offset_mm)
        yield AxisMove(segment=_between(start, end, segment.turn_rad))
        now = last


def _between(start_mm: Point, end_mm: Point, turn_rad: float) -> Segment:
    return Segment(start_mm=start_mm, end_mm=end_mm, bulge=math.tan(turn_rad / 4.0))


def point_after(move: Segment, point_mm: Point, offset_mm: float) -> Point:
    """Return where the cutting point is after a move of the axis.

    Parameters
    ----------
    point_mm
        Where it was before.
    """
    if move.bulge:
        # It turns with the axis around the arc's centre; if that is the point, it rests.
        (x, y), (px, py) = move.center_mm, point_mm
        cos, sin = math.cos(move.turn_rad), math.sin(move.turn_rad)
        return x + cos * (px - x) - sin * (py - y), y + sin * (px - x) + cos * (py - y)
    (x, y), away = move.end_mm, math.dist(move.end_mm, point_mm)
    share = offset_mm / away if away else 0.0
    return x - share * (x - point_mm[0]), y - share * (y - point_mm[1])
