"""Digits and a compass N as strokes, and as polygons a nozzle can follow."""

import numpy as np
import shapely
from shapely import LineString
from shapely.affinity import scale, translate
from shapely.geometry.base import BaseGeometry

_WIDE, _HIGH, _ADVANCE = 4.0, 7.0, 6.2
_CORNERS = {
    "0": ["0,1 0,6 1,7 3,7 4,6 4,1 3,0 1,0 0,1"],
    "1": ["0.8,5.6 2.4,7 2.4,0", "0.8,0 4,0"],
    "2": ["0,6 1,7 3,7 4,6 4,4.6 0,0 4,0"],
    "3": ["0,7 4,7 1.8,4.2 3,4.2 4,3.2 4,1 3,0 1,0 0,1"],
    "4": ["3,0 3,7 0,2 4,2"],
    "5": ["4,7 0,7 0,4.2 3,4.2 4,3.2 4,1 3,0 0,0"],
    "6": ["4,6 3,7 1,7 0,6 0,1 1,0 3,0 4,1 4,3 3,4 0,4"],
    "7": ["0,7 4,7 1.4,0"],
    "8": ["1,3.8 0,4.8 0,6 1,7 3,7 4,6 4,4.8 3,3.8 1,3.8 0,2.8 0,1 1,0 3,0 4,1 4,2.8 3,3.8"],
    "9": ["0,1 1,0 3,0 4,1 4,6 3,7 1,7 0,6 0,4 1,3 4,3"],
    "N": ["0,0 0,7 4,0 4,7"],
    "-": ["0.5,3.5 3.5,3.5"],
}


def strokes(text: str, height_mm: float) -> list[LineString]:
    """Return a text as lines, its lower left corner at the origin.

    Parameters
    ----------
    text
        Digits, ``N`` and ``-``; other characters leave a gap.
    height_mm
        Height of a digit.
    """
    unit_mm, found = height_mm / _HIGH, []
    for place, sign in enumerate(text):
        for run in _CORNERS.get(sign, []):
            points = np.array([point.split(",") for point in run.split()], dtype=np.float64)
            found.append(LineString((points + np.array([_ADVANCE * place, 0.0])) * unit_mm))
    return found


def arrow(height_mm: float) -> list[LineString]:
    """Return an arrow that points to +y, its foot at the origin."""
    head = 0.35 * height_mm
    tip = (0.0, height_mm)
    return [
        LineString([(0.0, 0.0), tip]),
        LineString([(-0.6 * head, height_mm - head), tip, (0.6 * head, height_mm - head)]),
    ]


def centred(lines: list[LineString], x_mm: float, y_mm: float) -> list[LineString]:
    """Move lines so that the middle of their box lies at a point."""
    x_min, y_min, x_max, y_max = shapely.total_bounds(lines).tolist()
    shift = x_mm - 0.5 * (x_min + x_max), y_mm - 0.5 * (y_min + y_max)
    return [translate(line, *shift) for line in lines]


def mirrored(lines: list[LineString]) -> list[LineString]:
    """Mirror lines left to right about x = 0: they read right when seen from below."""
    return [scale(line, -1.0, 1.0, origin=(0.0, 0.0)) for line in lines]


def grooves(lines: list[LineString], width_mm: float) -> BaseGeometry:
    """Return lines as polygons of some width, with blunt corners so that they stay few."""
    return shapely.union_all(shapely.buffer(lines, 0.5 * width_mm, quad_segs=1))
