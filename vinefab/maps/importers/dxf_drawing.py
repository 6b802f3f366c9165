"""DXF drawings, R12 to R2018: layers, blocks, units and entities, read by ezdxf.

Curves stay exact until the drawing's size gives a tolerance. ezdxf's own paths are cubic curves:
the arcs of its hatches are off by 0.03 % of their radius, and splines whose knots are not clamped
are evaluated over knots outside their range.
"""

import io
import logging
import math
import struct
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from ezdxf import recover
from ezdxf.audit import AuditError
from ezdxf.document import Drawing as Document
from ezdxf.entities.boundary_paths import ArcEdge, EdgePath, EllipseEdge, LineEdge, SplineEdge
from ezdxf.entities.dxfgfx import DXFGraphic
from ezdxf.entities.insert import Insert
from ezdxf.entities.lwpolyline import LWPolyline
from ezdxf.filemanagement import readfile
from ezdxf.lldxf.const import DXFError
from ezdxf.math import OCS, BSpline, ConstructionEllipse, UVec, Vec2, Vec3
from scipy.interpolate import BSpline as Interpolated
from scipy.interpolate import make_interp_spline

from vinefab.core.errors import (
    BadInputError,
    UnfitInputError,
    UnknownNameError,
    UnreadableFileError,
)
from vinefab.core.foreign import reading_element
from vinefab.core.validation import Floats
from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.importers.source_drawing import (
    Arc,
    CurvePiece,
    DrawingItem,
    DrawingReader,
    DrawnPoint,
    Ring,
    SourceDrawing,
    Straight,
    drawing_map,
    drawn_points,
)
from vinefab.maps.importers.source_unit import SourceUnit
from vinefab.maps.summary import PLAUSIBLE_MM
from vinefab.model.files.shipped import read_bytes
from vinefab.model.map import Map

_FLAT = "flat drawings: cut it at one height, and save the section"


@dataclass(frozen=True, slots=True)
class _SplineCurve:
    """A B-spline, rational or not."""

    spline: BSpline

    def hull(self) -> Floats:
        """Return the control points: their convex hull contains the curve."""
        return np.array([point.vec2 for point in self.spline.control_points])

    def flat(self, tolerance: float) -> Floats:
        """Return points on the curve: spans between knots are halved until they are flat."""
        knots, order = np.array(self.spline.knots()), self.spline.order
        inner = np.unique(knots[order - 1 : len(knots) - order + 1])
        weights = np.array(self.spline.weights() or [1.0] * len(self.spline.control_points))
        lifted = np.column_stack([self.hull() * weights[:, None], weights])
        curve = Interpolated(knots, lifted, order - 1)
        parts = 4
        finest_span = 4096
        while True:
            share = np.arange(2 * parts) / (2 * parts)
            params = (inner[:-1, None] + np.diff(inner)[:, None] * share).ravel()
            values = np.asarray(curve(np.append(params, inner[-1])), dtype=np.float64)
            points = values[:, :2] / values[:, 2:]
            chords, middles = points[::2], points[1::2]
            off = np.hypot(*(middles - 0.5 * (chords[:-1] + chords[1:])).T)
            if off.max() <= tolerance or parts >= finest_span:
                return np.asarray(chords)
            parts *= 2


_CURVES = ("LINE", "CIRCLE", "ARC", "ELLIPSE", "SPLINE", "HELIX", "LWPOLYLINE", "POLYLINE")
_AREAS = ("SOLID", "TRACE", "3DFACE")
_HATCHES = ("HATCH", "MPOLYGON")
_DRAWN = {*_CURVES, *_AREAS, *_HATCHES}
"""Types of entities that are read."""


def _items_of(entity: Any, where: str, heights: "_Heights") -> list[DrawingItem]:  # noqa: ANN401  each type has its own
    """Return the items that an entity draws, in world coordinates."""
    kind = entity.dxftype()
    if kind in _HATCHES:
        rings = _hatch_rings(entity, where, heights)
        return [DrawingItem(rings=rings, where=where, filled=True)] if rings else []
    with reading_element(where, str(entity)):
        pieces = _pieces(entity, where, heights)
    filled = kind in _AREAS
    closed = filled or kind == "CIRCLE"
    if kind == "ELLIPSE":
        closed = abs(pieces[0].turn_rad - math.tau) < 1e-9
    elif kind == "POLYLINE":
        closed = entity.is_closed
    elif kind in ("LWPOLYLINE", "SPLINE", "HELIX"):
        closed = bool(entity.closed)
    widths = _widths(entity) if kind.endswith("POLYLINE") and pieces else []
    wide = max(widths, default=0.0)
    item = DrawingItem(
        rings=(Ring(pieces=pieces),),
        where=where,
        closed=closed,
        filled=filled,
        width=wide or None,
        wide=(wide, wide) if wide else None,
    )
    if wide and max(widths) - min(widths) > 1e-9 * wide:
        return _tapered(entity, item)
    return [item] if pieces else []


def _widths(entity: Any) -> list[float]:  # noqa: ANN401  of two types
    """Return the widths of a polyline at both ends of each of its parts, in order."""
    closed = entity.closed if entity.dxftype() == "LWPOLYLINE" else entity.is_closed
    if entity.dxftype() == "LWPOLYLINE":
        const = entity.dxf.get("const_width", 0.0)
        if const:
            return [const]
        ends = [(start, end) for _, _, start, end, _ in entity.get_points()]
    else:
        whole = [entity.dxf.get(f"default_{end}_width", 0.0) for end in ("start", "end")]
        ends = [
            (one.dxf.get("start_width", whole[0]), one.dxf.get("end_width", whole[1]))
            for one in entity.vertices
        ]
    parts = ends if closed else ends[:-1]
    return [abs(float(width)) for pair in parts for width in pair]


def _tapered(entity: Any, whole: DrawingItem) -> list[DrawingItem]:  # noqa: ANN401  of two types
    """Return the parts of a polyline whose width changes: arcs have the mean of both ends.

    With parts that have no width it is the outline that it would be without any, and the others
    are walls over it.
    """
    widths = _pairs(_widths(entity))
    is_outline = any(start + end == 0.0 for start, end in widths)
    items = [replace(whole, width=None, wide=None)] if is_outline else []
    for part, (start, end) in zip(entity.copy().virtual_entities(), widths, strict=False):
        mean = 0.5 * (start + end)
        if mean:
            ring = Ring(pieces=_pieces(part, whole.where, _Heights(flatten=True)))
            ends = (start, end) if part.dxftype() == "LINE" else (mean, mean)
            width = None if is_outline else mean
            items.append(replace(whole, rings=(ring,), closed=False, width=width, wide=ends))
    return items


def _pairs(values: list[float]) -> list[tuple[float, float]]:
    return list(zip(values[::2], values[1::2], strict=True))


def _pieces(entity: Any, where: str, heights: "_Heights") -> tuple[Any, ...]:  # noqa: ANN401  each type has its own
    """Return the curves of an entity other than a hatch."""
    dxf = entity.dxf
    match entity.dxftype():
        case "LINE":
            return (_straight(where, [dxf.start, dxf.end], heights),)
        case "CIRCLE" | "ARC" as kind:
            angles = (0.0, 360.0) if kind == "CIRCLE" else (dxf.start_angle, dxf.end_angle)
            circle = (dxf.center, abs(dxf.radius), dxf.extrusion)
            return (_arc(where, ConstructionEllipse.from_arc(*circle, *angles), heights),)
        case "ELLIPSE":
            return (_arc(where, entity.construction_tool(), heights),)
        case "SPLINE" | "HELIX":
            points = () if entity.control_point_count() else entity.fit_points
            ends = [dxf.get(end) for end in ("start_tangent", "end_tangent")]
            through = _spline_through(points, ends) if len(points) else entity.construction_tool()
            return (_spline(where, through, heights),)
        case "POLYLINE" | "LWPOLYLINE":
            return _polyline(entity, where, heights)
        case _:
            return (_straight(where, entity.wcs_vertices(), heights),)


def _polyline(
    entity: Any,  # noqa: ANN401  of two types
    where: str,
    heights: "_Heights",
) -> tuple[CurvePiece, ...]:
    spline_frame = 16
    if entity.dxftype() == "LWPOLYLINE":
        points, closed = list(entity.vertices_in_wcs()), entity.closed
    elif entity.is_polygon_mesh or entity.is_poly_face_mesh:
        raise BadInputError(where, "a mesh in space", _FLAT)
    else:
        # The frame that controls a spline is not drawn.
        drawn = [one for one in entity.vertices if not one.dxf.flags & spline_frame]
        entity.vertices[:] = drawn
        points, closed = list(entity.points_in_wcs()), entity.is_closed
    if len(points) < 2:
        return ()
    straight = _straight(where, [*points, points[0]] if closed else points, heights)
    if not entity.has_arc:
        return (straight,)
    return tuple(
        piece for part in entity.virtual_entities() for piece in _pieces(part, where, heights)
    )


def _arc(where: str, tool: ConstructionEllipse, heights: "_Heights") -> Arc:
    axes = (tool.center + tool.major_axis, tool.center + tool.minor_axis)
    middle, first, second = heights.flat(where, [tool.center, *axes])
    turn = (tool.end_param - tool.start_param) % math.tau
    return Arc(
        middle=middle,
        first=first - middle,
        second=second - middle,
        start_rad=tool.start_param,
        turn_rad=turn if turn > 1e-9 else math.tau,
    )


def _spline(where: str, spline: BSpline, heights: "_Heights") -> _SplineCurve:
    heights.flat(where, spline.control_points)
    curve = _SplineCurve(spline)
    curve.flat(math.inf)  # finds wrong knots while the entity is known
    return curve


def _spline_through(points: Sequence[UVec], tangents: Sequence[UVec | None]) -> BSpline:
    """Return the cubic spline through points, parametrized by chord length.

    It ends along the tangents, or without curvature, as CAD programs draw it. (ezdxf computes the
    same one with full matrices: 20,000 points take 3 GB there.)
    """
    places = np.array([Vec3(point).xyz for point in points])
    if len(places) < 2:
        raise ValueError("fewer than two points on a spline")
    steps = np.sqrt((np.diff(places, axis=0) ** 2).sum(axis=1))
    params = np.append(0.0, np.cumsum(steps))
    if not steps.min() > 0.0 or not math.isfinite(params[-1]):
        raise ValueError("equal or infinite points on a spline one after the other")
    ends: Any = "natural"
    if all(tangent is not None for tangent in tangents):
        first, last = (params[-1] * np.array(Vec3(one).normalize().xyz) for one in tangents)
        ends = ([(1, first)], [(1, last)])
    curve = make_interp_spline(params / params[-1], places, k=3, bc_type=ends)
    controls: list[list[float]] = np.asarray(curve.c).tolist()
    return BSpline([Vec3(place) for place in controls], order=4, knots=np.asarray(curve.t).tolist())


def _hatch_rings(
    hatch: Any,  # noqa: ANN401  HATCH or MPOLYGON
    where: str,
    heights: "_Heights",
) -> tuple[Ring, ...]:
    is_mpolygon = hatch.dxftype() == "MPOLYGON"
    shift = Vec2(hatch.dxf.get("offset_vector", Vec2())) if is_mpolygon else Vec2()
    ocs = hatch.ocs()
    rings = []
    for path in hatch.paths:
        if isinstance(path, EdgePath):
            pieces = [_edge(edge, where, ocs, heights) for edge in path.edges]
            rings += [Ring(pieces=tuple(loop)) for loop in _loops(pieces)]
        elif len(path.vertices) >= 2:
            ring = LWPolyline.new(dxfattribs={"extrusion": ocs.uz})
            ring.closed = True
            corners = [(x + shift.x, y + shift.y, bulge) for x, y, bulge in path.vertices]
            ring.append_points(corners, format="xyb")
            rings.append(Ring(pieces=_pieces(ring, where, heights)))
    return tuple(rings)


def _loops(pieces: Iterable[CurvePiece]) -> list[list[CurvePiece]]:
    """Return consecutive pieces that make loops, whichever way each of them runs."""
    loops: list[list[CurvePiece]] = []
    first = last = np.full(2, math.nan)
    for piece in pieces:
        begin, end = piece.flat(math.inf)[[0, -1]]
        if loops and len(loops[-1]) == 1 and not (_near(last, begin) or _near(last, end)):
            first, last = last, first
        if loops and _near(last, end):
            begin, end = end, begin
        if not loops or (_near(first, last) and not _near(last, begin)):
            loops.append([])
            first = begin
        loops[-1].append(piece)
        last = end
    return loops


def _edge(edge: object, where: str, ocs: OCS, heights: "_Heights") -> CurvePiece:
    match edge:
        case LineEdge():
            ends = list(ocs.points_to_wcs([Vec3(edge.start), Vec3(edge.end)]))
            return _straight(where, ends, heights)
        case ArcEdge():
            angles = (edge.start_angle, edge.end_angle)
            circle = ConstructionEllipse.from_arc(Vec3(edge.center), edge.radius, ocs.uz, *angles)
            return _arc(where, circle, heights)
        case EllipseEdge():
            flat = edge.construction_tool()
            middle, major = ocs.points_to_wcs([flat.center, flat.major_axis])
            params = (flat.start_param, flat.end_param)
            return _arc(
                where, ConstructionEllipse(middle, major, ocs.uz, flat.ratio, *params), heights
            )
        case SplineEdge() if not edge.control_points:
            points = list(ocs.points_to_wcs([Vec3(point) for point in edge.fit_points]))
            return _spline(where, _spline_through(points, (None, None)), heights)
        case SplineEdge():
            points = list(ocs.points_to_wcs([Vec3(point) for point in edge.control_points]))
            knots, weights = edge.knot_values or None, edge.weights or None
            return _spline(where, BSpline(points, edge.degree + 1, knots, weights), heights)
    raise TypeError(f"an edge of the unknown kind {type(edge).__name__}")


def _near(one: Floats, other: Floats) -> bool:
    return math.dist(one, other) <= 1e-9 * (1.0 + float(np.abs(one).max()))


def _straight(where: str, points: Sequence[UVec], heights: "_Heights") -> Straight:
    return Straight(heights.flat(where, points))


@dataclass(slots=True)
class _Heights:
    """How heights are taken, and how many there were."""

    flatten: bool  # whether any height is seen from above
    flattened: int = 0  # entities with heights
    most: float = 0.0  # the largest rise among them
    vertical: int = 0  # entities that are points when seen from above

    def flat(self, where: str, points: Sequence[UVec]) -> Floats:
        """Return x and y of points, shape (n, 2).

        Raises
        ------
        UnfitInputError
            If their heights differ so much that a view from above may not be a plan.
        """
        array = np.array([Vec3(point).xyz for point in points]).reshape(-1, 3)
        if not np.isfinite(array).all():
            raise BadInputError(where, "a coordinate that is not finite", "finite numbers")
        rise = np.ptp(array, axis=0) if len(array) else np.zeros(3)
        least_slope, most_slope = 1e-6, 0.05  # the second one shortens a line by 0.13 %
        length = float(max(rise[0], rise[1]))
        if rise[2] > least_slope * length:
            is_vertical = length <= least_slope * rise[2]
            if not (is_vertical or self.flatten or rise[2] <= most_slope * length):
                low, high = array[:, 2].min(), array[:, 2].max()
                place = f"{where} at ({array[0, 0]:.8g}, {array[0, 1]:.8g})"
                problem = f"is 3-D, z from {low:.6g} to {high:.6g}"
                remedy = "--flatten sees all from above; or draw a plan: equal z along an entity"
                raise UnfitInputError(place, problem, remedy)
            self.vertical += is_vertical
            self.flattened += not is_vertical
            self.most = max(self.most, float(rise[2]))
        return np.asarray(array[:, :2])

    @property
    def facts(self) -> dict[str, object]:
        """What was done, as facts of a map."""
        if not (self.flattened or self.vertical):
            return {}
        return {
            "heights_flattened": self.flattened,
            "vertical_lines_left_out": self.vertical,
            "largest_rise_in_units": round(self.most, 6),
        }


_DWG = b"AC10"
_MM = {
    1: ("inches", 25.4),
    2: ("feet", 304.8),
    3: ("miles", 1_609_344.0),
    4: ("mm", 1.0),
    5: ("cm", 10.0),
    6: ("m", 1000.0),
    7: ("km", 1e6),
    8: ("microinches", 25.4e-6),
    9: ("mils", 25.4e-3),
    10: ("yards", 914.4),
    13: ("micrometres", 1e-3),
    14: ("dm", 100.0),
    15: ("decametres", 1e4),
    16: ("hectometres", 1e5),
    21: ("US survey feet", 1_200_000.0 / 3937.0),
    22: ("US survey inches", 100_000.0 / 3937.0),
    23: ("US survey yards", 3_600_000.0 / 3937.0),
    24: ("US survey miles", 6_336_000_000.0 / 3937.0),
}
_SOLIDS = {"3DSOLID", "BODY", "MESH", "REGION", "SURFACE"}
_INCONSISTENT = (DXFError, ValueError, TypeError, AttributeError, IndexError, ArithmeticError)
_BROKEN = (*_INCONSISTENT, KeyError, RecursionError, StopIteration, struct.error)
"""What ezdxf raises on files with damage that it does not expect."""


_GUESSED = (AuditError.INVALID_INTEGER_VALUE, AuditError.INVALID_FLOATING_POINT_VALUE)
_NO_OUTPUT = logging.NullHandler()


@np.errstate(over="ignore", invalid="ignore")  # what becomes infinite is refused by its place
def import_dxf(path: Path, options: ImportOptions) -> Map:
    """Return the map in a DXF drawing.

    Hatches and solids are areas, everything else lines and outlines. Blocks are exploded. What is
    frozen, off, invisible, text or outside model space is counted and left out.
    """
    return replace(drawing_map(path, dxf_source(path, options), options), environment="dxf")


def dxf_source(path: Path, options: ImportOptions) -> SourceDrawing:
    """Return what a DXF drawing shows on the layers that are asked for, curves as curves."""
    document, repaired = _document(path)
    try:
        drawing = _drawing(document, options)
    except (BadInputError, UnknownNameError) as error:
        raise error.at(path) from None
    except _BROKEN as error:
        problem = " ".join(str(error).split()) or type(error).__name__
        raise UnreadableFileError(path, f"cannot be read by ezdxf: {problem[:120]}") from None
    if repaired:
        drawing = replace(drawing, facts={**drawing.facts, "faults_mended_by_reader": repaired})
    return drawing


def _document(path: Path) -> tuple[Document, int]:
    """Return the document and how many of its faults ezdxf repaired."""
    data = read_bytes(path)
    if not data.strip():
        raise UnreadableFileError(path, "is empty")
    if data.startswith(_DWG):
        raise UnreadableFileError(path, "is a DWG file, not DXF: save it as DXF in a CAD program")
    # Its warnings are not printed with the one line that a user gets.
    logging.getLogger("ezdxf").addHandler(_NO_OUTPUT)
    try:
        document, repaired = readfile(path), 0
    except (OSError, *_BROKEN):
        document, repaired = _recovered(path, data)
    if b"$INSUNITS" not in data:
        # ezdxf assumes metres then; the file names no unit.
        document.header["$INSUNITS"] = 0
    if b"$MEASUREMENT" not in data:
        document.header["$MEASUREMENT"] = 1
    return document, repaired


def _recovered(path: Path, data: bytes) -> tuple[Document, int]:
    """Return a damaged document, if only its structure had to be repaired."""
    try:
        document, auditor = recover.read(io.BytesIO(data))
    except (OSError, *_BROKEN) as error:
        problem = " ".join(str(error).split()) or type(error).__name__
        raise UnreadableFileError(path, f"is not a DXF file: {problem[:120]}") from None
    for fix in (*auditor.fixes, *auditor.errors):
        if fix.code in _GUESSED:
            raise UnreadableFileError(path, f"is a damaged DXF file: {fix.message}")
    return document, len(auditor.fixes)


def _drawing(document: Document, options: ImportOptions) -> SourceDrawing:
    layers = options.layers
    known = {layer.dxf.name for layer in document.layers}
    space = list(document.modelspace())
    drawn_on = {_layer(entity) for entity in space}
    known |= drawn_on
    by_key = {name.lower(): name for name in known}
    for name in layers:
        if name.lower() not in by_key:
            raise UnknownNameError("layer", name, known)
    chosen = frozenset(name.lower() for name in layers)
    walk = _Walk(chosen, document=document, heights=_Heights(options.flatten))
    items = walk.items(space)
    return SourceDrawing(
        items=tuple(items),
        points=tuple(walk.points),
        unit=_unit(document, items),
        layered=len(drawn_on) > 1,
        facts={
            "dxf_version": document.acad_release,
            **walk.facts(layers, "entities"),
            **walk.heights.facts,
        },
    )


def _unit(document: Document, items: list[DrawingItem]) -> SourceUnit:
    """Return the unit of a drawing: ``$INSUNITS``, else what ``$MEASUREMENT`` leaves."""
    code = int(document.header.get("$INSUNITS", 0))
    if code in _MM:
        name, mm = _MM[code]
        # ``$LIMMAX`` of a template in inches, which GDAL before 3.11 copies into every drawing.
        gdal_limits = (12.0, 9.0)
        if name == "inches" and tuple(document.header.get("$LIMMAX", ()))[:2] == gdal_limits:
            by = "$INSUNITS; GDAL and QGIS write so whatever the unit is"
            return SourceUnit(name=name, mm=mm, known="guess", by=by)
        return SourceUnit(name=name, mm=mm, known="file", by="$INSUNITS")
    if document.header.get("$MEASUREMENT") != 0:
        return SourceUnit(name="mm", mm=1.0, known="guess", by="the file names none")
    by = "the file names none; $MEASUREMENT is English"
    # As mm no robot would fit; as inches it may.
    points = drawn_points(items) if items else np.zeros((1, 2))
    if float(np.ptp(points, axis=0).max()) < PLAUSIBLE_MM[0]:
        return SourceUnit(name="inches", mm=25.4, known="guess", by=by)
    by += ", so --scale-mm-per-unit 25.4 if it is inches"
    return SourceUnit(name="mm", mm=1.0, known="guess", by=by)


def _layer(entity: DXFGraphic) -> str:
    """Return an entity's layer; entities of unknown types have none."""
    return str(entity.dxf.layer) if entity.dxf.hasattr("layer") else "0"


@dataclass(slots=True)
class _Walk(DrawingReader):
    """Traversal of model space and the blocks inserted in it."""

    document: Document = field(kw_only=True)
    heights: _Heights = field(kw_only=True)

    def items(self, space: Iterable[DXFGraphic]) -> list[DrawingItem]:
        found: list[DrawingItem] = []
        for entity, layer, where in self._leaves(space, None, ()):
            kind = entity.dxftype()
            hidden = self._hidden(entity, layer)
            if hidden is not None:
                self.ignored[hidden] += 1
            elif kind in _SOLIDS or kind.endswith("SURFACE"):
                raise BadInputError(where, "a solid or surface", _FLAT)
            elif kind not in _DRAWN:
                self.ignored[kind] += 1
                if kind == "POINT":
                    x, y, _ = entity.dxf.location
                    self.points.append(DrawnPoint(place=(x, y), names=(layer,)))
            else:
                try:
                    vertical = self.heights.vertical
                    items = _items_of(entity, where, self.heights)
                    if self.heights.vertical == vertical:
                        found += [replace(one, names=(layer,)) for one in items]
                except BadInputError:
                    raise
                except _INCONSISTENT as error:
                    problem = " ".join(str(error).split()) or type(error).__name__
                    allowed = "a consistent entity"
                    raise BadInputError(where, problem[:80], allowed) from None
                self.read[kind] += 1
        return found

    def _hidden(self, entity: DXFGraphic, layer: str) -> str | None:
        """Return the reason why an entity is not drawn, None when it is."""
        if self.layers and layer.lower() not in self.layers:
            return "on other layers"
        if entity.dxf.hasattr("invisible") and entity.dxf.invisible:
            return "invisible"
        if layer.lower() == "defpoints":
            return "on layer Defpoints, which never plots"
        if layer in self.document.layers:
            state = self.document.layers.get(layer)
            if state.is_frozen() or state.is_off():
                return f"on layer {layer}, which is {'frozen' if state.is_frozen() else 'off'}"
        return None

    def _leaves(
        self, space: Iterable[DXFGraphic], outer: str | None, blocks: tuple[Insert, ...]
    ) -> Iterator[tuple[DXFGraphic, str, str]]:
        """Yield entities other than blocks, with their layer and their name in messages."""
        for entity in space:
            kind, layer = entity.dxftype(), _layer(entity)
            # Layer 0 in a block means the layer on which the block is inserted.
            layer = outer if outer is not None and layer == "0" else layer
            where = f"{kind} (handle {entity.dxf.handle})"
            if blocks:
                first = blocks[0].dxf
                where = f"{kind} in block {first.name} (INSERT handle {first.handle})"
            if isinstance(entity, Insert):
                yield from self._of_block(entity, layer, (*blocks, entity))
            elif kind == "MLINE":
                with reading_element(where, str(entity)):
                    parts = list(entity.virtual_entities())  # type: ignore[attr-defined]
                yield from ((part, layer, where) for part in parts)
            else:
                yield entity, layer, where

    def _of_block(
        self, insert: Insert, layer: str, blocks: tuple[Insert, ...]
    ) -> Iterator[tuple[DXFGraphic, str, str]]:
        name = insert.dxf.name
        if name in {outer.dxf.name for outer in blocks[:-1]}:
            where = f"INSERT (handle {blocks[0].dxf.handle})"
            raise BadInputError(where, f"a block {name} in itself", "blocks of others")
        if insert.block() is None:
            self.ignored[f"INSERT of the missing block {name}"] += 1
            return
        if layer in self.document.layers and self.document.layers.get(layer).is_frozen():
            self.ignored[f"on layer {layer}, which is frozen"] += 1
            return
        # LibreCAD writes 0 for z, where other programs read 1; nothing is drawn 0 high.
        for axis in ("xscale", "yscale", "zscale"):
            if insert.dxf.get(axis, 1.0) == 0.0:
                insert.dxf.set(axis, 1.0)
        where = f"INSERT of block {name} (handle {insert.dxf.handle or blocks[0].dxf.handle})"
        with reading_element(where, str(insert)):
            parts = [
                part
                for single in (insert.multi_insert() if insert.mcount > 1 else [insert])
                for part in single.virtual_entities(skipped_entity_callback=self._skipped)
            ]
        yield from self._leaves(parts, layer, blocks)

    def _skipped(self, entity: DXFGraphic, reason: str) -> None:
        if entity.dxftype() in _DRAWN:
            where = f"{entity.dxftype()} (handle {entity.dxf.handle}) in a block"
            raise BadInputError(
                where, reason, "blocks that can be exploded; explode it in the drawing program"
            )
        self.ignored[entity.dxftype()] += 1
