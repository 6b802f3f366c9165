"""What generators share: exact decimals, boxes, starting zones."""

import math

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.model.checked import Floats
from vinefab.model.map import Pose, Start

DECIMALS = 4
"""Generated coordinates are whole multiples of 1e-4 mm.

A file then holds exactly what was generated, and the last bit of somebody's cosine does not make
another map.
"""


def rounded(points_mm: Floats) -> Floats:
    """Return points on the grid of `DECIMALS`, without negative zeros."""
    return np.asarray(np.round(points_mm, DECIMALS) + 0.0, dtype=np.float64)


def box(width_mm: float, height_mm: float) -> Polygon:
    """Return the rectangle from the origin to (width, height), counter-clockwise."""
    corners = [(0.0, 0.0), (width_mm, 0.0), (width_mm, height_mm), (0.0, height_mm)]
    return Polygon(rounded(np.array(corners)))


def start_zone(start: Start) -> BaseGeometry:
    """Return all the positions within a start's range: a rectangle, a line or a point."""
    x, y = start.pose.x_mm, start.pose.y_mm
    half_x, half_y = start.spread_x_mm, start.spread_y_mm
    corners = [
        (x + sign_x * half_x, y + sign_y * half_y) for sign_x in (-1, 1) for sign_y in (-1, 1)
    ]
    return shapely.convex_hull(shapely.multipoints(corners))


def upward_start(x_mm: float, y_mm: float, spreads: tuple[float, float, float]) -> Start:
    """Return a start that launches along +y.

    Parameters
    ----------
    x_mm, y_mm
        Position of the middle of the range.
    spreads
        Half-widths of the range of x (mm), y (mm) and heading (rad).
    """
    return Start(
        pose=Pose(x_mm=x_mm, y_mm=y_mm, heading_rad=math.pi / 2),
        spread_x_mm=spreads[0],
        spread_y_mm=spreads[1],
        spread_heading_rad=spreads[2],
    )
