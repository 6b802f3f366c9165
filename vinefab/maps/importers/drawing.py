"""What the readers of drawings share: items, tolerances, and the way from there to a map."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats, number, positive
from vinefab.maps.cleanup.assemble import AssembleOptions, assemble
from vinefab.maps.cleanup.curves import CurvePiece, run_flat
from vinefab.maps.cleanup.shapes import Role, Shape, SourceFrame, framed
from vinefab.model.map import Map, Pose

SIMPLIFY_SHARE = 1e-4
"""Default tolerance of curves, by the drawing's larger side: 0.05 mm in 500 mm."""
JOIN_SHARE = 2e-4
"""Default width of gaps that are closed, by the drawing's larger side: 0.1 mm in 500 mm."""
MARGIN_SHARE = 0.05
"""Default margin of a rectangle around everything, by the drawing's larger side."""
_FINEST_SHARE = 1e-7
_MOST_POINTS = 5_000_000


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportOptions:
    """What a user may choose about an import; None leaves it to the importer.

    Parameters
    ----------
    scale_mm_per_unit
        Millimetres of the map per unit of the source (per metre for ROS maps); instead of the
        unit that the source names.
    simplify_mm
        Largest distance between imported walls and those of the source.
    unknown
        What cells of a ROS map that were never seen count as: ``obstacle`` or ``free``.
    start
        Where robots start, in the map's millimetres.
    join_mm
        Widest gap in an outline that is closed.
    layers
        Names of the layers (DXF) or groups (SVG) to read; empty for all.
    bounds
        ``outline``, ``largest``, ``wall`` or ``box``, see `AssembleOptions`.
    margin_mm
        Around the drawing when the bounds are a box.
    wall_mm
        Thickness of walls that are drawn as lines.
    open_lines
        ``refuse`` or ``drop``.
    """

    scale_mm_per_unit: float | None = None
    simplify_mm: float | None = None
    unknown: str | None = None
    start: Pose | None = None
    join_mm: float | None = None
    layers: tuple[str, ...] = ()
    bounds: Literal["outline", "largest", "wall", "box"] | None = None
    margin_mm: float | None = None
    wall_mm: float | None = None
    open_lines: Literal["refuse", "drop"] | None = None

    def refuse(self, names: tuple[str, ...], kind: str, source: Path) -> None:
        """Raise BadInputError if one of some options was given; they mean nothing there."""
        for name in names:
            value = getattr(self, name)
            if value is not None and value != ():
                option = {"open_lines": "open", "layers": "layer"}.get(name, name)
                raise BadInputError(option, value, f"nothing for {kind}", source)


@dataclass(frozen=True, slots=True, kw_only=True)
class Ring:
    """Pieces that follow one another."""

    pieces: tuple[CurvePiece, ...]  # at least one

    def hull(self) -> Floats:
        """Return points whose box holds all the pieces."""
        return np.concatenate([piece.hull() for piece in self.pieces])


@dataclass(frozen=True, slots=True, kw_only=True)
class DrawingItem:
    """A `Shape` whose curves are still curves."""

    # as there
    rings: tuple[Ring, ...]
    where: str
    closed: bool = True
    filled: bool = False
    holes: tuple[Ring, ...] = ()
    role: Role | None = None

    def flat(self, tolerance: float) -> Shape:
        """Return it with curves as chords within a tolerance in units of the source."""
        rings, holes = (
            tuple(run_flat(ring.pieces, tolerance) for ring in group)
            for group in (self.rings, self.holes)
        )
        if not all(np.isfinite(ring).all() for ring in (*rings, *holes)):
            raise BadInputError(self.where, "a curve that is not finite", "finite numbers")
        return Shape(
            rings=rings,
            where=self.where,
            closed=self.closed,
            filled=self.filled,
            holes=holes,
            role=self.role,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class SourceDrawing:
    """What a file of another program holds."""

    items: tuple[DrawingItem, ...]  # everything that can be a wall
    mm_per_unit: float = 1.0  # what the file says about its unit, or what is taken
    down: bool = False  # whether y points down
    origin: tuple[float, float] = (0.0, 0.0)  # position in the file that becomes the map's origin
    facts: Mapping[str, object] = field(default_factory=dict)  # what was read and what was left out
    curved: bool = True  # whether such files hold curves


def drawing_map(path: Path, drawing: SourceDrawing, options: ImportOptions) -> Map:
    """Return the map that a drawing shows, see `assemble`."""
    try:
        return _drawing_map(path, drawing, options)
    except BadInputError as error:
        raise error.at(path) if error.source is None else error from error


def _drawing_map(path: Path, drawing: SourceDrawing, options: ImportOptions) -> Map:
    options.refuse(("unknown",), "a drawing", path)
    if not drawing.items:
        held = drawing.facts.get("ignored") or "nothing"
        raise BadInputError("drawing", f"without outlines: {held}", "lines, outlines or areas")
    given = options.scale_mm_per_unit
    scale = drawing.mm_per_unit if given is None else given
    frame, size_mm = framed(
        _hull(drawing.items),
        SourceFrame(
            scale_mm_per_unit=scale, x=drawing.origin[0], y=drawing.origin[1], down=drawing.down
        ),
    )
    chosen, tolerance_mm = _assembling(options, size_mm, curved=drawing.curved)
    shapes = tuple(item.flat(tolerance_mm / scale) for item in drawing.items)
    points = sum(len(ring) for shape in shapes for ring in (*shape.rings, *shape.holes))
    if points > _MOST_POINTS:
        raise BadInputError("drawing", f"{points} points", f"at most {_MOST_POINTS}")
    facts = {
        "source": path.name,
        **drawing.facts,
        "scale_mm_per_unit": scale,
        "shapes_read": len(shapes),
        "curves_within_mm": tolerance_mm,
        "simplify_mm": chosen.simplify_mm,
    }
    return assemble(path.stem, shapes, frame, chosen, facts)


def _hull(items: tuple[DrawingItem, ...]) -> Floats:
    """Return the corners of every item's box; refuse the first that is not finite."""
    corners = []
    for item in items:
        points = np.concatenate([ring.hull() for ring in (*item.rings, *item.holes)])
        if not np.isfinite(points).all():
            raise BadInputError(item.where, "a coordinate that is not finite", "finite numbers")
        corners += [points.min(axis=0), points.max(axis=0)]
    return np.array(corners)


def _assembling(
    options: ImportOptions, size_mm: float, *, curved: bool
) -> tuple[AssembleOptions, float]:
    """Return the options with their defaults for a drawing's size, and the curves' tolerance.

    What the user allows is split between curves made chords and corners left out.
    """
    join_mm = _short(JOIN_SHARE * size_mm) if options.join_mm is None else options.join_mm
    number("join_mm", join_mm, 0.0, 0.1 * size_mm, "mm, a tenth of the drawing")
    simplify_mm = options.simplify_mm
    tolerance_mm = _short(SIMPLIFY_SHARE * size_mm)
    if simplify_mm is not None:
        number("simplify_mm", simplify_mm, _FINEST_SHARE * size_mm, size_mm, "mm")
        tolerance_mm = 0.5 * simplify_mm if curved else 0.0
        simplify_mm -= tolerance_mm
    if options.wall_mm is not None:
        positive("wall_mm", options.wall_mm, size_mm)
    margin_mm = _short(MARGIN_SHARE * size_mm) if options.margin_mm is None else options.margin_mm
    return AssembleOptions(
        join_mm=join_mm,
        simplify_mm=simplify_mm or 0.0,
        sliver_mm2=_short(max(join_mm, 1e-4) ** 2),
        bounds=options.bounds or "outline",
        margin_mm=margin_mm,
        wall_mm=options.wall_mm,
        open_lines=options.open_lines or "refuse",
        start=options.start,
    ), tolerance_mm


def _short(value: float) -> float:
    """Return a default with four digits: it is printed, and may be typed again."""
    return float(f"{value:.4g}")
