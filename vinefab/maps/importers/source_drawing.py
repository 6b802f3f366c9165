"""Drawings as their readers give them: curves, items and options, and how they become a map."""

import math
import shlex
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Protocol

import numpy as np

from vinefab.core.errors import BadInputError, UnfitInputError, located
from vinefab.core.plain_text import counted, visible
from vinefab.core.validation import Floats, number, positive
from vinefab.maps.cleanup.assemble import AssembleOptions, assemble
from vinefab.maps.cleanup.drawn_shapes import Changes, Drawn, DrawnShape, SourceFrame, framed
from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.importers.source_unit import SourceUnit
from vinefab.model.map import Map


class CurvePiece(Protocol):
    """A straight or curved part of a line, in the units of its source."""

    def hull(self) -> Floats:
        """Return points, shape (n, 2), whose bounding box contains the piece."""

    def flat(self, tolerance: float) -> Floats:
        """Return points on it, shape (n, 2), whose chords stay within a tolerance."""


@dataclass(frozen=True, slots=True)
class Straight:
    """A polyline."""

    points: Floats  # shape (n, 2)

    def hull(self) -> Floats:
        """Return the points."""
        return self.points

    def flat(self, tolerance: float) -> Floats:  # noqa: ARG002  nothing to flatten
        """Return the points."""
        return self.points


@dataclass(frozen=True, slots=True, kw_only=True)
class Arc:
    """An arc of an ellipse: ``middle + first cos(t) + second sin(t)``."""

    middle: Floats  # shape (2,)
    first: Floats  # shape (2,), one of two conjugate radii, so that it may be sheared and scaled
    second: Floats  # shape (2,), the other one
    start_rad: float = 0.0  # first t
    turn_rad: float = math.tau  # by how much t grows, or shrinks when negative

    def hull(self) -> Floats:
        """Return samples, moved out and in by the most that it may bulge between them."""
        turns = np.linspace(self.start_rad, self.start_rad + self.turn_rad, 17)
        bulge = 1.0 - math.cos(self.turn_rad / 32.0)
        reach = bulge * np.hypot(self.first, self.second)
        samples = self.at(turns)
        return np.vstack([samples - reach, samples + reach])

    def at(self, turns_rad: Floats) -> Floats:
        """Return the points at some values of t, shape (n, 2)."""
        cosine, sine = np.cos(turns_rad)[:, None], np.sin(turns_rad)[:, None]
        return np.asarray(self.middle + cosine * self.first + sine * self.second)

    def flat(self, tolerance: float) -> Floats:
        """Return points on the arc whose chords stay within a tolerance."""
        # For a sheared ellipse the longer radius is at most the root of the sum of squares.
        radius = math.hypot(*self.first, *self.second)
        chord_rad = math.tau
        if radius > tolerance:
            chord_rad = 2.0 * math.acos(1.0 - tolerance / radius)
        count = _steps(abs(self.turn_rad) / chord_rad)
        count = max(count, math.ceil(abs(self.turn_rad) / (0.5 * math.pi) - 1e-9))
        points = self.at(self.start_rad + self.turn_rad * np.linspace(0.0, 1.0, count + 1))
        if abs(abs(self.turn_rad) - math.tau) < 1e-12:
            points[-1] = points[0]
        return points


@dataclass(frozen=True, slots=True)
class Bezier:
    """A cubic Bezier curve."""

    controls: Floats  # control points, shape (4, 2)

    def hull(self) -> Floats:
        """Return the control points."""
        return self.controls

    def flat(self, tolerance: float) -> Floats:
        """Return points on the curve, evenly spaced in its parameter (Wang's bound)."""
        bend = np.diff(self.controls, n=2, axis=0)
        worst = float(np.hypot(*bend.T).max())
        count = _steps(math.sqrt(0.75 * worst / tolerance))
        share = np.linspace(0.0, 1.0, count + 1)[:, None]
        rest = 1.0 - share
        weights = (rest**3, 3 * rest**2 * share, 3 * rest * share**2, share**3)
        points = sum(w * c for w, c in zip(weights, self.controls, strict=True))
        return np.asarray(points, dtype=np.float64)


def _steps(wanted: float) -> int:
    # In one curve: a tolerance that needs more surely has the wrong unit.
    most_curve_points = 1_000_000
    return max(1, min(math.ceil(wanted - 1e-9), most_curve_points)) if math.isfinite(wanted) else 1


def run_flat(pieces: tuple[CurvePiece, ...], tolerance: float) -> Floats:
    """Return the points of consecutive pieces, each reversed where it fits better so."""
    parts = [piece.flat(tolerance) for piece in pieces]
    for index in range(1, len(parts)):
        if index == 1:
            off = [
                min(math.dist(place, end) for end in (parts[1][0], parts[1][-1]))
                for place in (parts[0][0], parts[0][-1])
            ]
            if off[0] < off[1]:
                parts[0] = parts[0][::-1]
        here = parts[index - 1][-1]
        if math.dist(parts[index][-1], here) < math.dist(parts[index][0], here):
            parts[index] = parts[index][::-1]
        if len(parts[index]) > 1 and (parts[index][0] == here).all():
            parts[index] = parts[index][1:]
    return np.concatenate(parts)


_MOST_POINTS = 5_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class Ring:
    """Consecutive pieces."""

    pieces: tuple[CurvePiece, ...]  # at least one

    def hull(self) -> Floats:
        """Return points whose bounding box contains all pieces."""
        return np.concatenate([piece.hull() for piece in self.pieces])

    def flattened(self) -> Floats:
        """Return points on it, within 1e-5 of its size."""
        size = float(np.ptp(self.hull(), axis=0).max())
        return run_flat(self.pieces, max(1e-5 * size, 1e-12))

    def is_rectangle(self) -> bool:
        """Return whether it is the outline of a rectangle along the axes."""
        corners = np.unique(self.hull(), axis=0)
        sides = [np.unique(corners[:, axis]) for axis in (0, 1)]
        return len(corners) == 4 and all(len(side) == 2 for side in sides)


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawingItem(Drawn[Ring]):
    """A `DrawnShape` whose curves are still curves."""

    names: tuple[str, ...] = ()  # layer, groups or feature that it stands in, and its own
    width: float | None = None  # of a line that has one, in units of the source
    unjoined: bool = False  # whether the line ends apart, though its fill counts as closed
    bare: bool = False  # whether it is a fill without a line around it

    def flat(self, tolerance: float) -> DrawnShape:
        """Return it with chords for curves, within a tolerance in units of the source."""
        if self.wide is not None:
            tolerance *= 0.25  # its outer edge has a larger radius
        try:
            rings, holes = (
                tuple(run_flat(ring.pieces, tolerance) for ring in group)
                for group in (self.rings, self.holes)
            )
        except BadInputError as error:
            raise error.under(self.where) from None
        if not all(np.isfinite(ring).all() for ring in (*rings, *holes)):
            raise UnfitInputError(self.where, "a curve is not finite", "draw it anew")
        same = {one.name: getattr(self, one.name) for one in fields(Drawn)}
        return DrawnShape(**same | {"rings": rings, "holes": holes})


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawnPoint:
    """A point of a drawing; maps leave it out."""

    place: tuple[float, float]  # in units of the source
    names: tuple[str, ...]  # layer or feature that it stands in


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceDrawing:
    """The content of a drawing file."""

    items: tuple[DrawingItem, ...]  # what can be walls
    unit: SourceUnit  # of its coordinates
    points: tuple[DrawnPoint, ...] = ()
    down: bool = False  # whether y points down
    origin: tuple[float, float] = (0.0, 0.0)  # position in the file that becomes the map's origin
    facts: Mapping[str, object] = field(default_factory=dict)  # what was read and left out
    curved: bool = True  # whether such files hold curves
    layered: bool = False  # whether such files have layers to choose from


@dataclass(slots=True)
class DrawingReader:
    """What a reader of drawings was asked for, read and left out."""

    layers: frozenset[str]  # to read; empty for all
    points: list[DrawnPoint] = field(default_factory=list)
    read: Counter[str] = field(default_factory=Counter)  # by kind
    ignored: Counter[str] = field(default_factory=Counter)  # by reason or kind

    def facts(self, names: tuple[str, ...], what: str) -> dict[str, object]:
        """Return it as facts of a map; ``names`` are the layers as the user gave them."""
        return {
            **({"layers": sorted(names)} if names else {}),
            what: dict(self.read),
            **({"ignored": dict(self.ignored)} if self.ignored else {}),
        }


def drawn_points(items: Sequence[DrawingItem]) -> Floats:
    """Return the corners of every item's bounding box, in units of the source, shape (n, 2)."""
    corners = []
    for item in items:
        hull = np.concatenate([ring.hull() for ring in (*item.rings, *item.holes)])
        if not np.isfinite(hull).all():
            raise UnfitInputError(item.where, "a coordinate is not finite", "draw it anew")
        corners += [hull.min(axis=0), hull.max(axis=0)]
    return np.array(corners)


def drawing_map(path: Path, drawing: SourceDrawing, options: ImportOptions) -> Map:
    """Return the map that a drawing shows, see `assemble`."""
    with located(path):
        options.refuse(("unknown", "least_obstacle_mm2"), "a drawing", path)
        if not drawing.items:
            held = drawing.facts.get("ignored") or "nothing"
            problem = f"the drawing has no outlines: {held}"
            raise UnfitInputError("", problem, "draw lines, outlines or areas")
        unit = drawing.unit.scaled(options.scale_mm_per_unit)
        frame, size_mm = framed(
            drawn_points(drawing.items),
            SourceFrame(
                scale_mm_per_unit=unit.mm,
                x=drawing.origin[0],
                y=drawing.origin[1],
                down=drawing.down,
            ),
        )
        chosen, tolerance_mm = _assembling(options, size_mm, curved=drawing.curved)
        shapes = tuple(item.flat(tolerance_mm / unit.mm) for item in drawing.items)
        points = sum(len(ring) for shape in shapes for ring in (*shape.rings, *shape.holes))
        if points > _MOST_POINTS:
            problem = f"the drawing has {counted(points, 'point')}, and {_MOST_POINTS} are allowed"
            raise UnfitInputError("", problem, "simplify it (--simplify-mm)")
        facts = {
            "source": path.name,
            **drawing.facts,
            "shapes_read": len(shapes),
            "curves_within_mm": tolerance_mm,
            "simplify_mm": chosen.simplify_mm,
        }
        name = visible(path.stem)
        layers = [word for layer in options.layers for word in ("--layer", layer)]
        given = options.scale_mm_per_unit
        scaled = [] if given is None else ["--scale-mm-per-unit", f"{given:g}"]
        command = shlex.join(["vinefab", "map", "import", str(path), *layers, *scaled])
        changes = Changes(frame, layered=drawing.layered, command=command)
        return unit.of(assemble(name, shapes, changes, chosen, facts))


def _assembling(
    options: ImportOptions, size_mm: float, *, curved: bool
) -> tuple[AssembleOptions, float]:
    """Return the options with defaults for a drawing's size, and the tolerance of curves, mm.

    ``simplify_mm`` is split between the chords of curves and corners that are left out.
    """
    # Default width of gaps that are closed, by the drawing's larger side: 0.1 mm in 500 mm.
    join_share = 2e-4
    join_mm = _four_digits(join_share * size_mm) if options.join_mm is None else options.join_mm
    # Largest width of gaps that a user may have closed, by the drawing's larger side.
    most_join_share = 0.1
    most_join_mm = most_join_share * size_mm
    number("join_mm", join_mm, 0.0, most_join_mm, "mm, a tenth of the drawing")
    simplify_mm = options.simplify_mm
    # Default tolerance of curves, by the drawing's larger side: 0.05 mm in 500 mm.
    simplify_share = 1e-4
    tolerance_mm = _four_digits(simplify_share * size_mm)
    finest_share = 1e-7
    if simplify_mm is not None:
        number("simplify_mm", simplify_mm, finest_share * size_mm, size_mm, "mm")
        tolerance_mm = 0.5 * simplify_mm if curved else 0.0
        simplify_mm -= tolerance_mm
    if options.wall_mm is not None:
        positive("wall_mm", options.wall_mm, size_mm)
    # Default margin of a rectangle around everything, by the drawing's larger side.
    margin_share = 0.05
    margin_mm = (
        _four_digits(margin_share * size_mm) if options.margin_mm is None else options.margin_mm
    )
    given = {one.name: getattr(options, one.name) for one in fields(options)}
    sizes = {
        "join_mm": join_mm,
        "simplify_mm": simplify_mm or 0.0,
        "margin_mm": margin_mm,
        "sliver_mm2": _four_digits(max(join_mm, 1e-4) ** 2),
        "most_join_mm": most_join_mm,
    }
    return AssembleOptions(**given | sizes), tolerance_mm


def _four_digits(value: float) -> float:
    """Return a default rounded to four digits: it is printed, and may be typed again."""
    return float(f"{value:.4g}")
