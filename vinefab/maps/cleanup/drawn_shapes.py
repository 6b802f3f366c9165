"""Shapes of a drawing before it is a map: their frame, what was changed, and ring repair."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Generic, Literal, TypeVar

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.core.validation import LARGEST_MM, Floats, positive
from vinefab.model.start import refuse_jagged

Role = Literal["bounds", "obstacle"]

SAME_POINT_MM = 1e-6
"""Points nearer than this are one point: map files hold no finer coordinates."""

_LEAST_SIZE_MM = 0.01
_FAR = 10.0


R = TypeVar("R")


@dataclass(frozen=True, slots=True, kw_only=True)
class Drawn(Generic[R]):
    """A drawn line, outline or filled area of rings in the units of the source."""

    # A line or outline has one; the rings of a filled area count by even-odd among themselves.
    rings: tuple[R, ...]
    where: str  # its name in messages: ``LINE (handle 2F)``, ``path in line 12``
    # whether the source says that it is closed; the last point need not repeat the first
    closed: bool = True
    # whether the inside is solid wherever it lies; an outline in an outline is a hole
    filled: bool = False
    holes: tuple[R, ...] = ()  # rings that are surely not part of a filled area
    role: Role | None = None  # as the source names it
    # number of the painted element of an SVG drawing that an outline belongs to, None for others
    paint: int | None = None
    even_odd: bool = False  # whether what a ring encloses twice is outside, as the source says


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnShape(Drawn[Floats]):
    """A drawn line, outline or filled area whose rings are points, each of shape (n, 2)."""


def as_areas(shapes: tuple[DrawnShape, ...]) -> tuple[DrawnShape, ...]:
    """Return shapes with the outlines of each painted element as one filled area."""
    kept = [shape for shape in shapes if shape.paint is None]
    painted: dict[int, list[DrawnShape]] = {}
    for shape in shapes:
        if shape.paint is not None:
            painted.setdefault(shape.paint, []).append(shape)
    fills = (
        replace(group[0], rings=tuple(shape.rings[0] for shape in group), filled=True, role=None)
        for group in painted.values()
    )
    return (*kept, *fills)


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
    if size_mm == 0.0:
        raise BadInputError("drawing", "one single point", "lines, outlines or areas")
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
    layered: bool = False  # whether the source has layers that ``--layer`` can choose

    @property
    def layer_advice(self) -> str:
        """What helps to leave shapes out, as the beginning of a list."""
        return "--layer to choose, " if self.layered else ""

    def add(self, what: str, number: int = 1) -> None:
        """Count a change; 0 leaves no entry."""
        if number:
            before = self.counts.get(what, 0)
            self.counts[what] = (before if isinstance(before, int) else 0) + number

    def total(self, what: str, size: float) -> None:
        """Add to a sum of sizes."""
        before = self.counts.get(what, 0.0)
        self.counts[what] = round(size + (before if isinstance(before, float) else 0.0), 6)

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
    points_mm: Floats,
    where: str,
    sliver_mm2: float,
    changes: Changes,
    *,
    even_odd: bool = False,
    may_be_line: bool = True,
) -> list[Polygon]:
    """Return what a ring encloses, as valid polygons.

    A self-crossing ring is cut at its crossings: both lobes of a bow-tie are inside, a hole that
    a bridge joins to its outline is not, spikes vanish. What it encloses twice is inside (the
    nonzero rule) unless the source says even-odd. A ring without area is dropped, but refused if
    it is long and may be meant as a line.
    """
    points = without_repeats(points_mm, changes)
    if len(points) >= 4 or (len(points) == 3 and (points[0] != points[-1]).any()):
        polygon = Polygon(points)
        allowed = "fewer or shorter teeth, no tangle: draw it simpler, or clean the drawing"
        refuse_jagged(where, polygon, allowed)
        if polygon.is_valid and polygon.area > sliver_mm2:
            return [polygon]
        if not polygon.is_valid:
            odd = shapely.make_valid(polygon, method="linework")
            whole = shapely.make_valid(polygon, method="structure", keep_collapsed=False)
            polygons = polygons_of(odd if even_odd else whole, sliver_mm2)
            if polygons:
                changes.add("self_crossings_repaired")
                twice_mm2 = float(whole.area - odd.area)
                if twice_mm2 > sliver_mm2:
                    name = "outside_by_even_odd" if even_odd else "inside_by_nonzero"
                    changes.total(f"enclosed_twice_{name}_mm2", twice_mm2)
                return polygons
    size_mm = float(max(np.ptp(points, axis=0)))
    if may_be_line and size_mm > 10.0 * sliver_mm2**0.5:
        raise BadInputError(
            f"{where} at {changes.frame.place(points[0])}",
            f"an outline without area, {size_mm:.4g} mm long",
            f"outlines of more than {sliver_mm2:.3g} mm2; --wall-mm makes lines walls",
        )
    changes.add("slivers_dropped")
    changes.most("largest_sliver_dropped_mm", size_mm)
    return []


def polygons_of(geometry: BaseGeometry, least_mm2: float = 0.0) -> list[Polygon]:
    """Return the polygons in a geometry that have more than some area."""
    parts = shapely.get_parts(geometry)
    return [part for part in parts if isinstance(part, Polygon) and part.area > least_mm2]
