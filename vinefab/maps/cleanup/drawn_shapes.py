"""Shapes of a drawing before it is a map: their frame, what was changed, and ring repair."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.core.validation import LARGEST_MM, Floats, Ints, positive

Role = Literal["bounds", "obstacle"]

SAME_POINT_MM = 1e-6
"""Points nearer than this are one point: map files hold no finer coordinates."""

_LEAST_SIZE_MM = 0.01
_FAR = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Shape:
    """A drawn line, outline or filled area."""

    # points in the units of the source, each (n, 2). A line or outline has one; the rings of a
    # filled area count by even-odd among themselves.
    rings: tuple[Floats, ...]
    where: str  # its name in messages: ``LINE (handle 2F)``, ``path in line 12``
    # whether the source says that it is closed; the last point need not repeat the first
    closed: bool = True
    # whether the inside is solid wherever it lies; an outline in an outline is a hole
    filled: bool = False
    holes: tuple[Floats, ...] = ()  # rings that are surely not part of a filled area
    role: Role | None = None  # as the source names it


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceFrame:
    """How positions in the source become positions in the map."""

    scale_mm_per_unit: float = 1.0  # millimetres of the map per unit of the source
    # x, y: position in the source that becomes the origin of the map
    x: float = 0.0
    y: float = 0.0
    down: bool = False  # whether y points down in the source

    def to_map(self, points: Floats) -> Floats:
        """Return points in the map, mm."""
        away = (points - np.array([self.x, self.y])) * self.scale_mm_per_unit
        return np.asarray(away * np.array([1.0, -1.0 if self.down else 1.0]) + 0.0)

    def place(self, point_mm: Sequence[float] | Floats) -> str:
        """Return a position of the map as text in the coordinates of the source."""
        x = self.x + point_mm[0] / self.scale_mm_per_unit
        y = self.y + point_mm[1] / self.scale_mm_per_unit * (-1.0 if self.down else 1.0)
        digits = 10 if max(abs(x), abs(y)) >= 1e5 else 6
        return f"({x:.{digits}g}, {y:.{digits}g})"


def extent(points: Floats) -> tuple[Floats, Floats]:
    """Return the lower left and upper right corner of points, shape (n, 2), n at least 1."""
    return points.min(axis=0), points.max(axis=0)


def framed(points: Floats, frame: SourceFrame) -> tuple[SourceFrame, float]:
    """Return a frame in which a drawing lies near the origin, and the drawing's larger side.

    A drawing that is farther than ten times its own size from the origin, or farther than a map
    may be, is moved: its lower left corner becomes the map's origin. Survey coordinates come so.
    """
    positive("scale_mm_per_unit", frame.scale_mm_per_unit, 1e9, "mm per unit")
    low, high = extent(points)
    # Halves first: the difference of two huge numbers may not be finite.
    size_mm = float(max(0.5 * high - 0.5 * low)) * frame.scale_mm_per_unit * 2.0
    if not _LEAST_SIZE_MM <= size_mm <= LARGEST_MM:
        raise BadInputError(
            "drawing",
            f"{size_mm:.6g} mm wide at {frame.scale_mm_per_unit:g} mm per unit",
            f"{_LEAST_SIZE_MM:g} to {LARGEST_MM:g} mm; --scale-mm-per-unit sets the unit",
        )
    reach_mm = float(np.abs(frame.to_map(np.array([low, high]))).max())
    if reach_mm <= min(_FAR * size_mm, LARGEST_MM):
        return frame, size_mm
    y = high[1] if frame.down else low[1]
    return (
        SourceFrame(
            scale_mm_per_unit=frame.scale_mm_per_unit, x=float(low[0]), y=float(y), down=frame.down
        ),
        size_mm,
    )


@dataclass(slots=True)
class Changes:
    """Counts of the changes between a drawing and its map."""

    frame: SourceFrame  # for positions in messages
    # by kind of change: number, or largest size
    counts: dict[str, object] = field(default_factory=dict)

    def add(self, what: str, number: int = 1) -> None:
        """Count a change; 0 leaves no entry."""
        if number:
            before = self.counts.get(what, 0)
            self.counts[what] = (before if isinstance(before, int) else 0) + number

    def most(self, what: str, size: float) -> None:
        """Record a size if it is the largest so far."""
        before = self.counts.get(what, 0.0)
        self.counts[what] = max(round(size, 6), before if isinstance(before, float) else 0.0)


def without_repeats(points: Floats, changes: Changes) -> Floats:
    """Return points without those that repeat the one before; a closed ring stays closed."""
    if len(points) < 2:
        return points
    steps = np.hypot(*np.diff(points, axis=0).T)
    if steps.min() > SAME_POINT_MM:
        return points
    kept = np.append(True, steps > SAME_POINT_MM)
    changes.add("duplicate_points_removed", int((~kept).sum()))
    return np.asarray(points[kept])


def ring_polygons(
    points_mm: Floats, where: str, sliver_mm2: float, changes: Changes
) -> list[Polygon]:
    """Return what a ring encloses, as valid polygons.

    A self-crossing ring is cut at its crossings. Where the even-odd and the nonzero rule agree on
    what is inside, that is the repair: both lobes of a bow-tie, a hole that a bridge joins to its
    outline. Spikes vanish. (`shapely.make_valid` can give both rules, too, but disagrees on rings
    that run along themselves, and takes 2 to 7 times as long.)
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
    """Drop a ring without area; refuse a long one, which was surely meant as something else."""
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
    """Return the polygons in a geometry that have more than some area."""
    parts = shapely.get_parts(geometry)
    return [part for part in parts if isinstance(part, Polygon) and part.area > least_mm2]


def winding_numbers(spots: NDArray[np.object_], ring: Floats) -> Ints:
    """Return the winding number of a closed ring around each of some points.

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
