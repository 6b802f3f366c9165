"""The order in which paths are run: marks, welds, weld-cuts, cuts; what lies inside comes first."""

import math
from collections.abc import Iterable

import numpy as np
import shapely

from vinefab.model.job import LaserPath, Operation
from vinefab.model.outline import Contour

_OPERATIONS = tuple(Operation)
_MEETS_MM = 1e-6


def closes(contour: Contour) -> bool:
    """Whether a path ends where it began, or past that, on its first segment."""
    if contour.closed:
        return True
    first = next(iter(contour.segments))
    if first.bulge:
        return False
    start, end = np.array(first.start_mm), np.array(first.end_mm)
    last, along = contour.points_mm[-1], end - start
    share = float(np.dot(last - start, along) / np.dot(along, along))
    foot = start + share * along
    return len(contour) > 2 and -1e-9 <= share <= 1.0 and math.dist(foot, last) < _MEETS_MM


def frees(path: LaserPath) -> bool:
    """Whether a path cuts a piece out of the sheet."""
    return path.operation in (Operation.WELDCUT, Operation.CUT) and closes(path.contour)


def in_order(paths: Iterable[LaserPath]) -> tuple[LaserPath, ...]:
    """Return paths in process order.

    Within an operation, paths inside of many others come first; paths alike keep their order.
    """
    given = list(paths)
    depth = dict.fromkeys(range(len(given)), 0)
    rings = {row: _area(path) for row, path in enumerate(given) if frees(path)}
    for outer, area in rings.items():
        for inner in rings:
            if inner != outer and given[inner].operation is given[outer].operation:
                x, y = given[inner].contour.points_mm[0]
                depth[inner] += bool(shapely.contains_xy(area, x, y))
    order = sorted(
        range(len(given)), key=lambda row: (_OPERATIONS.index(given[row].operation), -depth[row])
    )
    return tuple(given[row] for row in order)


def _area(path: LaserPath) -> shapely.Polygon:
    return shapely.Polygon(path.contour.flattened_mm(0.1))
