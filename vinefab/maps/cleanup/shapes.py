"""What a drawing of another program holds, before it is a map: shapes, their frame, changes."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.validation import LARGEST_MM, Floats, positive

Role = Literal["bounds", "obstacle"]

SAME_MM = 1e-6
"""Points nearer than this are one point: map files hold no finer coordinates."""

_LEAST_SIZE_MM = 0.01
_FAR = 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Shape:
    """One thing drawn: a line, an outline, or a filled area."""

    # points in the units of the source, each (n, 2). A line or outline has one; the rings of a
    # filled area count by even-odd among themselves.
    rings: tuple[Floats, ...]
    where: str  # what messages call it: ``LINE (handle 2F)``, ``path in line 12``
    # whether the source says that it is closed; the last point need not repeat the first
    closed: bool = True
    # whether the inside is solid, whatever it lies in; an outline in an outline is a hole
    filled: bool = False
    holes: tuple[Floats, ...] = ()  # rings that are not part of a filled area for certain
    role: Role | None = None  # what the source says that it is


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
    """Counts of what was changed on the way from a drawing to a map."""

    frame: SourceFrame  # for positions in messages
    # number, or largest size, by what happened
    counts: dict[str, object] = field(default_factory=dict)

    def add(self, what: str, number: int = 1) -> None:
        """Count something; nothing is noted when it did not happen."""
        if number:
            before = self.counts.get(what, 0)
            self.counts[what] = (before if isinstance(before, int) else 0) + number

    def most(self, what: str, size: float) -> None:
        """Note a size if it is the largest so far."""
        before = self.counts.get(what, 0.0)
        self.counts[what] = max(round(size, 6), before if isinstance(before, float) else 0.0)
