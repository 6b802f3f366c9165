"""Skeletons as drawings: lines, polylines and curves of a file become straight segments.

DXF, SVG and GeoJSON are read as for maps. A CSV has ``x1,y1,x2,y2`` in mm and perhaps ``width``, a
line each: commas, semicolons or tabs separate; ``#`` begins a comment; a header may come first.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

import numpy as np
import scipy  # its parts load at their first use

from vinefab.core.bounded import bounded
from vinefab.core.errors import BadInputError, UnfitInputError, located, shortened
from vinefab.core.foreign import reading
from vinefab.core.limits import positive
from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats
from vinefab.maps.cleanup.drawn_shapes import SAME_POINT_MM, SourceFrame
from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.importers.source_drawing import DrawingItem, SourceDrawing, Straight
from vinefab.model.files.shipped import read_text
from vinefab.model.skeleton import MOST_SEGMENTS, place_text

BASE_NAME = "base"
"""Layer, group, feature or point that marks where the trunk begins."""

_ROOM = "vinefab.maps.importers"
_SOURCES = {
    ".dxf": f"{_ROOM}.dxf_drawing:dxf_source",
    ".svg": f"{_ROOM}.svg_drawing:svg_source",
    ".geojson": f"{_ROOM}.geojson_any:geojson_source",
    ".json": f"{_ROOM}.geojson_any:geojson_source",
}
"""Readers by suffix; only the process that reads a file loads them."""

_LARGEST_BYTES = 64 << 20
_COLUMNS = ("x1", "y1", "x2", "y2", "width")
_FINER = 1000.0
"""Curves are sampled so much finer than the chords that replace them."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SkeletonLines:
    """Straight lines of a drawing, and which of their ends it marks as the base."""

    segments_mm: Floats  # x and y of both ends of each, shape (n, 4)
    widths_mm: Floats  # shape (n,), NaN where none is given
    is_marked: tuple[bool, ...]  # whether each is drawn on the layer of the base, shape (n,)
    marks_mm: Floats  # points that mark the base, shape (k, 2)
    unit: str  # of the file and how it is known

    def base_mm(self, snap_mm: float) -> tuple[float, float] | None:
        """Return the place that the drawing marks as the base; None if it marks none.

        That is a point, or the loose end of a line, in something that is called ``base``.

        Raises
        ------
        BadInputError
            If it marks several; the message names them.
        """
        found = [(x, y) for x, y in self.marks_mm.tolist()]
        rows = np.flatnonzero(self.is_marked)
        if len(rows):
            every = scipy.spatial.KDTree(self.segments_mm.reshape(-1, 2))
            ends = self.segments_mm[rows].reshape(-1, 2)
            meeting = every.query_ball_point(ends, snap_mm, return_length=True)
            found += [(x, y) for x, y in ends[np.asarray(meeting) == 1].tolist()]
        if not found:
            return None
        apart = [place for place in found if math.dist(place, found[0]) > snap_mm]
        if apart:
            places = ", ".join(map(place_text, [found[0], *apart][:5]))
            several = counted(len(apart) + 1, "place")
            problem = f"the drawing calls {several} {BASE_NAME}: {places}"
            raise UnfitInputError("base", problem, "call one so, or give --base X,Y")
        return found[0]


def read_skeleton(
    path: Path,
    *,
    chord_mm: float,
    layers: tuple[str, ...] = (),
    scale_mm_per_unit: float | None = None,
) -> SkeletonLines:
    """Return the lines that a file draws.

    Parameters
    ----------
    path
        ``.csv``, ``.dxf``, ``.svg``, ``.geojson`` or ``.json``.
    chord_mm
        Curves become straight parts within this distance, as few as it allows.
    layers
        Layers of a DXF or groups of an SVG to read; all if empty.
    scale_mm_per_unit
        Millimetres per unit of the file, in place of the unit that it names.

    Raises
    ------
    BadInputError
        If something in the file cannot be a line; it is named.
    UnreadableFileError
        If there is no such file, it cannot be read, or not in a bounded time and memory.
    """
    positive("chord_mm", chord_mm)
    if scale_mm_per_unit is not None:
        positive("scale_mm_per_unit", scale_mm_per_unit, 1e9, "mm per unit")
    suffix = path.suffix.lower()
    if suffix not in (known := (".csv", *_SOURCES)):
        raise BadInputError("skeleton", str(path), f"a file ending in {', '.join(known)}")
    options = ImportOptions(layers=layers, scale_mm_per_unit=scale_mm_per_unit)
    reader = _of_csv if suffix == ".csv" else _of_drawing
    return bounded(path, reader, path, options, chord_mm)


def _of_drawing(path: Path, options: ImportOptions, chord_mm: float) -> SkeletonLines:
    module, _, function = _SOURCES[path.suffix.lower()].partition(":")
    with reading(path), np.errstate(all="ignore"):
        drawing: SourceDrawing = getattr(import_module(module), function)(path, options)
    given = options.scale_mm_per_unit
    scale = drawing.unit.mm if given is None else given
    with located(path):
        x, y = drawing.origin
        frame = SourceFrame(scale_mm_per_unit=scale, x=x, y=y, down=drawing.down)
        rows: list[Floats] = []
        widths: list[float] = []
        is_marked: list[bool] = []
        marks = [frame.to_map(np.array(one.place)) for one in drawing.points if _is_base(one.names)]
        for item in drawing.items:
            if item.wide is not None and item.width is None:
                continue  # a wall over a part of another item
            if _is_closed(item):
                middle = _middle_of(item)
                if not _is_base(item.names):
                    place = place_text(frame.to_map(middle).tolist())
                    problem = f"is closed, or an area, around {place} mm"
                    raise UnfitInputError(item.where, problem, "draw a skeleton as open lines")
                marks.append(frame.to_map(middle))
                continue
            lines = _straightened(item, frame, chord_mm)
            rows.append(lines)
            widths += [math.nan if item.width is None else item.width * scale] * len(lines)
            is_marked += [_is_base(item.names)] * len(lines)
            if len(widths) > MOST_SEGMENTS:
                given_lines = counted(len(widths), "line")
                raise BadInputError("segments", f"{given_lines} or more", f"1 to {MOST_SEGMENTS}")
        if not widths:
            held = drawing.facts.get("ignored") or "nothing"
            problem = f"the drawing has no lines: {held}"
            raise UnfitInputError("", problem, "draw lines or polylines")
    unit = drawing.unit.scaled(given).words
    return SkeletonLines(
        segments_mm=np.concatenate(rows),
        widths_mm=np.array(widths),
        is_marked=tuple(is_marked),
        marks_mm=np.array(marks).reshape(-1, 2),
        unit=unit,
    )


def _is_base(names: tuple[str, ...]) -> bool:
    return any(name.strip().lower() == BASE_NAME for name in names)


def _is_closed(item: DrawingItem) -> bool:
    return item.filled or bool(item.holes) or (item.closed and not item.unjoined)


def _middle_of(item: DrawingItem) -> Floats:
    """Return the middle of an item's bounding box, in units of the source."""
    hull = np.concatenate([ring.hull() for ring in item.rings])
    return np.asarray(0.5 * (hull.min(axis=0) + hull.max(axis=0)))


def _straightened(item: DrawingItem, frame: SourceFrame, chord_mm: float) -> Floats:
    """Return the segments of an open line, mm, shape (n, 4)."""
    tolerance = chord_mm / frame.scale_mm_per_unit
    found = []
    for ring in item.rings:
        for piece in ring.pieces:
            if isinstance(piece, Straight):
                points = frame.to_map(piece.points)
            else:
                points = chords(frame.to_map(piece.flat(tolerance / _FINER)), chord_mm)
            if not np.isfinite(points).all():
                raise UnfitInputError(item.where, "a coordinate is not finite", "draw it anew")
            lines = np.hstack([points[:-1], points[1:]])
            found.append(lines[np.hypot(*(lines[:, 2:] - lines[:, :2]).T) > SAME_POINT_MM])
    return np.concatenate(found)


def chords(points_mm: Floats, within_mm: float) -> Floats:
    """Return some of the points of a curve: the fewest chords within a distance, evened out.

    Parameters
    ----------
    points_mm
        Of the curve, close together, shape (n, 2).
    within_mm
        Largest distance between the points left out and their chord.

    Returns
    -------
    Floats
        Shape (m, 2). Of the chains with as few chords it is one with the smallest distance, so
        that no chord is much shorter than the curve needs.

    Examples
    --------
    >>> turn = np.linspace(0.0, np.pi / 2, 91)
    >>> arc = 100.0 * np.column_stack([np.cos(turn), np.sin(turn)])
    >>> np.degrees(np.arctan2(*chords(arc, 2.0).T[::-1])).round().tolist()
    [0.0, 18.0, 36.0, 54.0, 72.0, 90.0]
    """
    low, high = 0.0, within_mm
    best = list(_longest_chords(points_mm, high))
    for _ in range(20 if len(best) > 2 else 0):
        middle = 0.5 * (low + high)
        tried = list(_longest_chords(points_mm, middle, most=len(best)))
        if len(tried) > len(best):
            low = middle
        else:
            best, high = tried, middle
    return points_mm[best]


def _longest_chords(points_mm: Floats, within_mm: float, most: int | None = None) -> Iterator[int]:
    """Yield the ends of chords, each as long as a distance allows; at most some, and one more."""
    last, place, count = len(points_mm) - 1, 0, 1
    yield 0
    while place < last and (most is None or count <= most):
        step = 1
        while (
            place + 2 * step <= last
            and _off_mm(points_mm[place : place + 2 * step + 1]) <= within_mm
        ):
            step *= 2
        end = min(place + 2 * step, last)
        # Between a chord that fits and one that does not, or the end, lies the longest.
        fits = place + step
        while fits < end:
            middle = (fits + end + 1) // 2
            if _off_mm(points_mm[place : middle + 1]) <= within_mm:
                fits = middle
            else:
                end = middle - 1
        place = fits
        count += 1
        yield place


def _off_mm(points_mm: Floats) -> float:
    """Return how far points lie from the chord between the first and the last."""
    from_start = points_mm - points_mm[0]
    chord = from_start[-1]
    length_mm = math.hypot(*chord.tolist())
    if length_mm == 0.0:
        return float(np.hypot(*from_start.T).max())
    along = np.clip(from_start @ chord / length_mm**2, 0.0, 1.0)
    return float(np.hypot(*(from_start - along[:, None] * chord).T).max())


def _of_csv(path: Path, options: ImportOptions, _chord_mm: float) -> SkeletonLines:
    options.refuse(("layers",), "a CSV file", path)
    rows: list[list[float]] = []
    with located(path):
        for number, raw in enumerate(read_text(path, _LARGEST_BYTES).splitlines(), start=1):
            line = raw.partition("#")[0].strip()
            mark = next((one for one in ";\t," if one in line), ",")
            cells = [cell.strip().strip('"').lower() for cell in line.split(mark)]
            names = tuple(cell.removesuffix("_mm") for cell in cells)
            if not line or (not rows and names in (_COLUMNS, _COLUMNS[:4])):
                continue
            if len(rows) == MOST_SEGMENTS:
                problem = f"is one too many: a skeleton has at most {MOST_SEGMENTS:,} lines"
                raise UnfitInputError(f"line {number}", problem, "leave short branches out")
            rows.append(_row(number, line, cells))
        if not rows:
            remedy = "write a row x1,y1,x2,y2[,width] for each line drawn"
            raise UnfitInputError("", "the table has no lines", remedy)
    scale = options.scale_mm_per_unit
    unit = "mm" if scale is None else "as given"
    table = np.array(rows) * (1.0 if scale is None else scale)
    return SkeletonLines(
        segments_mm=table[:, :4],
        widths_mm=table[:, 4],
        is_marked=(False,) * len(rows),
        marks_mm=np.zeros((0, 2)),
        unit=unit,
    )


def _row(number: int, line: str, cells: list[str]) -> list[float]:
    """Return the four coordinates and the width of a line, NaN where it has none."""
    try:
        values = [float(cell) for cell in cells[:4]]
        width = float(cells[4]) if len(cells) == 5 and cells[4] else math.nan
    except ValueError:
        values, width = [], math.nan
    has_width = len(cells) == 5 and bool(cells[4])
    if len(cells) not in (4, 5) or not all(map(math.isfinite, values)) or len(values) != 4:
        problem = f"{shortened(line)!r} is not four finite numbers and, if there is one, a width"
        raise UnfitInputError(f"line {number}", problem, "write x1,y1,x2,y2[,width]")
    if has_width and not (math.isfinite(width) and width > 0.0):
        raise BadInputError(f"line {number}: width", cells[4], "a width above 0, or nothing")
    return [*values, width]
