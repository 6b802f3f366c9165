"""Where the robot's base enters the rig."""

import math
from dataclasses import dataclass

import shapely
from shapely import LineString, Point, Polygon
from shapely.geometry.base import BaseGeometry
from shapely.ops import nearest_points

from vinefab.model.map import Start
from vinefab.rig.clean import pieces_of
from vinefab.rig.options import RigOptions

_HOLE_SEGMENTS = 12
_WALL_TO_HOLE_MM = 1.0
_NEAR_MM = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class Entry:
    """What one start asks to be taken away.

    Parameters
    ----------
    from_border
        Area of the border wall to leave open, or empty.
    from_plate
        Area of the plate to leave open, or empty.
    note
        What a person should know, or an empty string.
    """

    from_border: BaseGeometry
    from_plate: BaseGeometry
    note: str = ""


def entry_of(
    start: Start, bounds: Polygon, border: BaseGeometry, solids: BaseGeometry, options: RigOptions
) -> Entry:
    """Return the opening for one start, in the coordinates of the plan.

    Looking back from the start against its heading: if the bounds are within
    ``options.entry_reach_mm``, the border is open there, as wide as ``options.entry_width_mm``
    and the start's sideways spread on both sides, straight along the heading. A start further
    inside gets a round hole of the same width through the plate, so that the robot comes up from
    below; if obstacles leave no room for the hole, nothing is opened and the note says so.

    Parameters
    ----------
    start
        Scaled to the rig.
    bounds, border, solids
        Free space's outer limit, the wall around it, the obstacles.
    options
        Widths and reach.
    """
    nothing = Polygon()
    if options.entry_width_mm <= 0.0:
        return Entry(from_border=nothing, from_plate=nothing)
    base = Point(start.pose.x_mm, start.pose.y_mm)
    reach_mm = options.entry_reach_mm
    ray = _backwards(start, reach_mm + max(1.0, reach_mm) * 1e-6)
    if not ray.intersects(bounds.exterior):
        return _through_plate(base, solids, options)
    met = nearest_points(base, ray.intersection(bounds.exterior))[1]
    line = _backwards(start, base.distance(met) + _depth_mm(options))
    strip = line.buffer(_half_width_mm(start, options), cap_style="flat")
    # Not what the strip meets further on: the wall of another room of a winding hall.
    cut = [piece for piece in pieces_of(border.intersection(strip)) if piece.dwithin(met, _NEAR_MM)]
    blocked = strip.intersection(bounds).intersection(solids).area > 0.0
    note = "obstacles narrow the way between the entry and its start" if blocked else ""
    return Entry(from_border=shapely.union_all(cut), from_plate=nothing, note=note)


def _through_plate(base: Point, solids: BaseGeometry, options: RigOptions) -> Entry:
    hole = base.buffer(0.5 * options.entry_width_mm, quad_segs=_HOLE_SEGMENTS)
    if hole.buffer(_WALL_TO_HOLE_MM).intersects(solids):
        note = "a start far from the bounds has no room for a hole in the plate: no entry is made"
        return Entry(from_border=Polygon(), from_plate=Polygon(), note=note)
    note = "a start far from the bounds has a hole in the plate: the robot comes up from below"
    return Entry(from_border=Polygon(), from_plate=hole, note=note)


def _backwards(start: Start, length_mm: float) -> LineString:
    pose = start.pose
    back_x, back_y = -math.cos(pose.heading_rad), -math.sin(pose.heading_rad)
    end = (pose.x_mm + length_mm * back_x, pose.y_mm + length_mm * back_y)
    return LineString([(pose.x_mm, pose.y_mm), end])


def _half_width_mm(start: Start, options: RigOptions) -> float:
    """Half the opening: the base, moved sideways over the start's range of positions."""
    heading_rad = start.pose.heading_rad
    sideways_mm = abs(math.sin(heading_rad)) * start.spread_x_mm
    sideways_mm += abs(math.cos(heading_rad)) * start.spread_y_mm
    return 0.5 * options.entry_width_mm + sideways_mm


def _depth_mm(options: RigOptions) -> float:
    """How far behind the bounds the border is surely crossed, also when met at 60 degrees."""
    return 2.0 * options.border_mm + 2.0 * options.entry_width_mm
