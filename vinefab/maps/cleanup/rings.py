"""Rings as they come in files, made into valid polygons where there is only one way to."""

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats, Ints
from vinefab.maps.cleanup.shapes import SAME_MM, Changes


def without_repeats(points: Floats, changes: Changes) -> Floats:
    """Return points without those that repeat the one before; a closed ring stays closed."""
    if len(points) < 2:
        return points
    steps = np.hypot(*np.diff(points, axis=0).T)
    kept = np.append(True, steps > SAME_MM)
    changes.add("duplicate_points_removed", int((~kept).sum()))
    return np.asarray(points[kept])


def ring_polygons(
    points_mm: Floats, where: str, sliver_mm2: float, changes: Changes
) -> list[Polygon]:
    """Return what a ring encloses, as valid polygons.

    A ring that crosses itself is cut at the crossings. Where the even-odd and the nonzero rule
    agree on what is inside, that is the repair: both lobes of a bow-tie, a hole that is joined to
    its outline by a bridge. Spikes vanish.
    """
    points = without_repeats(points_mm, changes)
    if len(points) >= 4 or (len(points) == 3 and (points[0] != points[-1]).any()):
        polygon = Polygon(points)
        if polygon.is_valid and polygon.area > sliver_mm2:
            return [polygon]
        if not polygon.is_valid:
            polygons = _by_winding(points, where, sliver_mm2, changes)
            if polygons:
                changes.add("self_crossings_repaired")
                return polygons
    _drop(points, where, sliver_mm2, changes)
    return []


def _drop(points: Floats, where: str, sliver_mm2: float, changes: Changes) -> None:
    """Drop a ring without area, unless it is so long that it must mean something."""
    size_mm = float(max(np.ptp(points, axis=0)))
    if size_mm > 10.0 * sliver_mm2**0.5:
        raise BadInputError(
            f"{where} at {changes.frame.place(points[0])}",
            f"an outline without area, {size_mm:.4g} mm long",
            f"outlines of more than {sliver_mm2:.3g} mm2; --wall-mm makes lines walls",
        )
    changes.add("slivers_dropped")
    changes.most("largest_sliver_dropped_mm", size_mm)


def _by_winding(points: Floats, where: str, sliver_mm2: float, changes: Changes) -> list[Polygon]:
    ring = np.vstack([points, points[:1]])
    noded = shapely.union_all(shapely.linestrings(np.stack([ring[:-1], ring[1:]], axis=1)))
    faces = shapely.get_parts(shapely.polygonize(shapely.get_parts(noded)))
    turns = winding_numbers(shapely.point_on_surface(faces), ring)
    twice = faces[(turns != 0) & (turns % 2 == 0)]
    if float(shapely.area(twice).sum()) > sliver_mm2:
        worst = max(twice, key=lambda face: float(face.area))
        raise BadInputError(
            f"{where} at {changes.frame.place(_middle(worst))}",
            f"crosses itself and encloses {worst.area:.4g} mm2 twice",
            "outlines that enclose each place once",
        )
    solid = shapely.union_all(faces[turns % 2 == 1])
    return polygons_of(solid, sliver_mm2)


def polygons_of(geometry: BaseGeometry, least_mm2: float = 0.0) -> list[Polygon]:
    """Return the polygons in a geometry that are larger than some area."""
    parts = shapely.get_parts(geometry)
    return [part for part in parts if isinstance(part, Polygon) and part.area > least_mm2]


def winding_numbers(spots: NDArray[np.object_], ring: Floats) -> Ints:
    """Return how often a closed ring runs around each of some points, counter-clockwise.

    Examples
    --------
    >>> square = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0, 0]], dtype=float)
    >>> winding_numbers(shapely.points([[0.5, 0.5], [2.0, 0.5]]), square).tolist()
    [1, 0]
    """
    first, last = ring[:-1], ring[1:]
    numbers = np.zeros(len(spots), dtype=np.int64)
    for index, (x, y) in enumerate(shapely.get_coordinates(spots)):
        up = (first[:, 1] <= y) & (last[:, 1] > y)
        down = (first[:, 1] > y) & (last[:, 1] <= y)
        side = (last[:, 0] - first[:, 0]) * (y - first[:, 1]) - (x - first[:, 0]) * (
            last[:, 1] - first[:, 1]
        )
        numbers[index] = int((up & (side > 0)).sum()) - int((down & (side < 0)).sum())
    return numbers


def _middle(polygon: Polygon) -> Floats:
    return np.asarray(shapely.get_coordinates(shapely.point_on_surface(polygon))[0])
