"""DXF drawings, R12 to R2018: layers, blocks, units and entities."""

import io
import logging
import math
import struct
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from ezdxf import recover
from ezdxf.audit import AuditError
from ezdxf.entities.boundary_paths import ArcEdge, EdgePath, EllipseEdge, LineEdge, SplineEdge
from ezdxf.entities.dxfgfx import DXFGraphic
from ezdxf.entities.insert import Insert
from ezdxf.entities.spline import Spline
from ezdxf.filemanagement import readfile
from ezdxf.lldxf.const import DXFError
from ezdxf.math import BSpline, Vec2, Vec3
from scipy.interpolate import BSpline as Interpolated
from scipy.interpolate import make_interp_spline

from vinefab.core.errors import BadInputError, UnknownNameError, UnreadableFileError
from vinefab.core.validation import Floats
from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.importers.source_drawing import (
    Arc,
    CurvePiece,
    DrawingItem,
    Ring,
    SourceDrawing,
    Straight,
    bulge_arc,
    drawing_map,
)
from vinefab.model.files.shipped import read_bytes
from vinefab.model.map import Map

_FLAT = "flat drawings: equal z all along an entity, seen from straight above or below"
_SPLINE_FRAME = 16
_FINEST_SPAN = 4096
_MANY_SPANS = 10_000
"""Of a spline: each is short already, and begins with one chord instead of four."""
_MOST_SAMPLES = 1_000_000
"""On a spline, chords and their middles."""
_LEAST_SLOPE = 1e-6
_EXTRUSION_SLACK = 1e-6


@dataclass(frozen=True, slots=True)
class _SplineCurve:
    """A B-spline, rational or not.

    Evaluated here, not by ezdxf, which evaluates closed splines over knots outside their range.
    """

    spline: BSpline
    mirror: float = 1.0  # -1: mirrored in x

    def hull(self) -> Floats:
        """Return the control points: their convex hull contains the curve."""
        points = [(self.mirror * point.x, point.y) for point in self.spline.control_points]
        return np.array(points)

    def flat(self, tolerance: float) -> Floats:
        """Return points on the curve: spans between knots are halved until they are flat."""
        knots, order = np.array(self.spline.knots()), self.spline.order
        inner = np.unique(knots[order - 1 : len(knots) - order + 1])
        parts = 4 if len(inner) <= _MANY_SPANS else 1
        while True:
            if 2 * parts * len(inner) > _MOST_SAMPLES:
                spans = f"{len(inner) - 1} spans with more than {parts // 2} chords each"
                allowed = "a smoother curve, fewer points, or a larger --simplify-mm"
                raise BadInputError("spline", spans, allowed)
            share = np.arange(2 * parts) / (2 * parts)
            params = (inner[:-1, None] + np.diff(inner)[:, None] * share).ravel()
            points = self._at(np.append(params, inner[-1]))
            chords, middles = points[::2], points[1::2]
            off = np.hypot(*(middles - 0.5 * (chords[:-1] + chords[1:])).T)
            if off.max() <= tolerance or parts >= _FINEST_SPAN:
                return np.asarray(chords)
            parts *= 2

    def _at(self, params: Floats) -> Floats:
        weights = np.array(self.spline.weights() or [1.0] * len(self.spline.control_points))
        lifted = np.column_stack([self.hull() * weights[:, None], weights])
        curve = Interpolated(np.array(self.spline.knots()), lifted, self.spline.order - 1)
        values = np.asarray(curve(params), dtype=np.float64)
        return np.asarray(values[:, :2] / values[:, 2:])


_DRAWN = frozenset(
    [
        "LINE",
        "CIRCLE",
        "ARC",
        "ELLIPSE",
        "SPLINE",
        "HELIX",
        "LWPOLYLINE",
        "POLYLINE",
        "SOLID",
        "TRACE",
        "3DFACE",
        "HATCH",
        "MPOLYGON",
    ]
)
"""Types of entities that are read."""


def _items_of(entity: Any, where: str) -> list[DrawingItem]:  # noqa: ANN401  each type has its own
    """Return the items that an entity draws, in world coordinates."""
    pieces: tuple[CurvePiece, ...]
    closed = filled = False
    match entity.dxftype():
        case "LINE":
            pieces = (Straight(_flat_points(where, [entity.dxf.start, entity.dxf.end])),)
        case "CIRCLE" | "ARC" as kind:
            closed = kind == "CIRCLE"
            angles = (0.0, 360.0) if closed else (entity.dxf.start_angle, entity.dxf.end_angle)
            mirror = _mirror(entity, where)
            x, y, _ = entity.dxf.center
            pieces = (_angled((x, y), entity.dxf.radius, angles, mirror),)
        case "ELLIPSE":
            # Stored in world coordinates; mirroring only flips the minor axis.
            up, major = _mirror(entity, where), entity.dxf.major_axis
            _flat_points(where, [Vec3(0, 0, 0), major])
            x, y, _ = entity.dxf.center
            params = (entity.dxf.start_param, entity.dxf.end_param)
            axis = np.array([major.x, major.y])
            arc = _elliptic(np.array([x, y]), axis, up * entity.dxf.ratio, params)
            pieces, closed = (arc,), abs(arc.turn_rad - math.tau) < 1e-9
        case "SPLINE" | "HELIX":
            spline = _fitted(entity) or entity.construction_tool()
            _flat_points(where, list(spline.control_points))
            curve = _SplineCurve(spline)
            curve.flat(math.inf)  # finds wrong knots while the entity is known
            pieces, closed = (curve,), bool(entity.closed)
        case "LWPOLYLINE":
            closed = bool(entity.closed)
            vertices = entity.get_points("xyb")
            pieces = _bulged_pieces(vertices, _mirror(entity, where), closed=closed)
        case "POLYLINE":
            if entity.is_polygon_mesh or entity.is_poly_face_mesh:
                raise BadInputError(where, "a mesh in space", _FLAT)
            drawn = [one for one in entity.vertices if not one.dxf.flags & _SPLINE_FRAME]
            closed, mirror, bulges = bool(entity.is_closed), 1.0, [0.0] * len(drawn)
            if not entity.is_3d_polyline:
                bulges, mirror = [one.dxf.bulge for one in drawn], _mirror(entity, where)
            points = _flat_points(where, [one.dxf.location for one in drawn])
            rows = np.column_stack([points, bulges]).tolist()
            pieces = _bulged_pieces(rows, mirror, closed=closed)
        case "SOLID" | "TRACE" | "3DFACE":
            pieces = (Straight(_flat_points(where, entity.wcs_vertices())),)
            closed = filled = True
        case _:
            rings = _hatch_rings(entity, _mirror(entity, where))
            return [DrawingItem(rings=rings, where=where, filled=True)] if rings else []
    ring = Ring(pieces=pieces)
    return [DrawingItem(rings=(ring,), where=where, closed=closed, filled=filled)] if pieces else []


def _angled(
    middle: Sequence[float], radius: float, angles_deg: tuple[float, float], mirror: float
) -> Arc:
    """Return the counter-clockwise arc between two angles; equal ones give the whole circle."""
    turn_deg = (angles_deg[1] - angles_deg[0]) % 360.0
    return Arc(
        middle=np.array([mirror * middle[0], middle[1]]),
        first=np.array([mirror * radius, 0.0]),
        second=np.array([0.0, radius]),
        start_rad=math.radians(angles_deg[0]),
        turn_rad=math.radians(turn_deg if turn_deg > 1e-9 else 360.0),
    )


def _elliptic(middle: Floats, major: Floats, ratio: float, params: tuple[float, float]) -> Arc:
    turn = (params[1] - params[0]) % math.tau
    return Arc(
        middle=middle,
        first=major,
        second=ratio * np.array([-major[1], major[0]]),
        start_rad=params[0],
        turn_rad=turn if turn > 1e-9 else math.tau,
    )


def _fitted(entity: DXFGraphic) -> BSpline | None:
    """Return the spline of an entity that has points on its curve only."""
    if not isinstance(entity, Spline) or entity.control_point_count():
        return None
    if not entity.fit_point_count():
        return None
    ends = ("start_tangent", "end_tangent")
    given = all(entity.dxf.hasattr(end) for end in ends)
    tangents = np.array([Vec3(entity.dxf.get(end)).xyz for end in ends]) if given else None
    return _spline_through(np.array([Vec3(point).xyz for point in entity.fit_points]), tangents)


def _spline_through(points: Floats, tangents: Floats | None) -> BSpline:
    """Return the cubic spline through points, parametrized by chord length.

    It ends along the tangents, or without curvature, as CAD programs draw it. (ezdxf computes the
    same one with full matrices: 20,000 points take 3 GB there.)
    """
    if len(points) < 2:
        raise ValueError("fewer than two points on a spline")
    steps = np.sqrt((np.diff(points, axis=0) ** 2).sum(axis=1))
    params = np.append(0.0, np.cumsum(steps))
    if not steps.min() > 0.0 or not math.isfinite(params[-1]):
        raise ValueError("equal or infinite points on a spline one after the other")
    ends: Any = "natural"
    if tangents is not None:
        sizes = np.sqrt((tangents**2).sum(axis=1))
        first, last = params[-1] * tangents / sizes[:, None]
        ends = ([(1, first)], [(1, last)])
    curve = make_interp_spline(params / params[-1], points, k=3, bc_type=ends)
    controls: list[list[float]] = np.asarray(curve.c).tolist()
    return BSpline([Vec3(place) for place in controls], order=4, knots=np.asarray(curve.t).tolist())


def _bulged_pieces(
    vertices: Sequence[Sequence[float]], mirror: float, *, closed: bool
) -> tuple[CurvePiece, ...]:
    """Return the pieces of a polyline; consecutive straight ones are merged."""
    if len(vertices) < 2:
        return ()
    points = np.array([(mirror * x, y) for x, y, *_ in vertices])
    bulges = [mirror * vertex[2] for vertex in vertices]
    if closed:
        points, bulges = np.vstack([points, points[:1]]), [*bulges, 0.0]
    pieces: list[CurvePiece] = []
    begin = 0
    for index, bulge in enumerate(bulges[:-1]):
        if bulge == 0.0:
            continue
        if index > begin:
            pieces.append(Straight(points[begin : index + 1]))
        pieces.append(bulge_arc(points[index], points[index + 1], bulge))
        begin = index + 1
    if begin < len(points) - 1:
        pieces.append(Straight(points[begin:]))
    return tuple(pieces)


def _hatch_rings(hatch: Any, mirror: float) -> tuple[Ring, ...]:  # noqa: ANN401  HATCH or MPOLYGON
    is_mpolygon = hatch.dxftype() == "MPOLYGON"
    shift = Vec2(hatch.dxf.get("offset_vector", Vec2())) if is_mpolygon else Vec2()
    rings = []
    for path in hatch.paths:
        if isinstance(path, EdgePath):
            # Edges make loops whichever way each of them runs.
            loops: list[list[CurvePiece]] = []
            first = last = np.full(2, math.nan)
            for piece in [_edge(edge, mirror) for edge in path.edges]:
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
            rings += [Ring(pieces=tuple(loop)) for loop in loops]
        elif len(path.vertices) >= 2:
            moved = [(x + shift.x, y + shift.y, bulge) for x, y, bulge in path.vertices]
            rings.append(Ring(pieces=_bulged_pieces(moved, mirror, closed=True)))
    return tuple(rings)


def _edge(edge: object, mirror: float) -> CurvePiece:
    match edge:
        case LineEdge():
            ends = (edge.start, edge.end)
            return Straight(np.array([(mirror * point.x, point.y) for point in ends]))
        case ArcEdge():
            return _angled(edge.center, edge.radius, (edge.start_angle, edge.end_angle), mirror)
        case EllipseEdge():
            ellipse = edge.construction_tool()
            major = np.array([mirror * ellipse.major_axis.x, ellipse.major_axis.y])
            middle = np.array([mirror * ellipse.center.x, ellipse.center.y])
            params = (ellipse.start_param, ellipse.end_param)
            return _elliptic(middle, major, mirror * ellipse.ratio, params)
        case SplineEdge() if not edge.control_points:
            points = np.array([Vec3(point).xyz for point in edge.fit_points])
            return _SplineCurve(_spline_through(points, None), mirror)
        case SplineEdge():
            spline = BSpline(
                edge.control_points,
                order=edge.degree + 1,
                knots=edge.knot_values or None,
                weights=edge.weights or None,
            )
            return _SplineCurve(spline, mirror)
    raise TypeError(f"an edge of the unknown kind {type(edge).__name__}")


def _near(one: Floats, other: Floats) -> bool:
    return math.dist(one, other) <= 1e-9 * (1.0 + float(np.abs(one).max()))


def _mirror(entity: DXFGraphic, where: str) -> float:
    """Return -1 for an entity drawn from below, 1 from above; refuse slanted ones."""
    direction = Vec3(entity.dxf.get("extrusion", Vec3(0, 0, 1)))
    if not abs(direction.x) + abs(direction.y) <= _EXTRUSION_SLACK * abs(direction.z):
        value = f"extruded along ({direction.x:.4g}, {direction.y:.4g}, {direction.z:.4g})"
        raise BadInputError(where, value, _FLAT)
    return -1.0 if direction.z < 0.0 else 1.0


def _flat_points(where: str, points: Sequence[Vec3]) -> Floats:
    """Return x and y of points, or raise BadInputError if their heights differ."""
    array = np.array([(point.x, point.y, Vec3(point).z) for point in points]).reshape(-1, 3)
    if not np.isfinite(array).all():
        raise BadInputError(where, "a coordinate that is not finite", "finite numbers")
    rise = np.ptp(array, axis=0) if len(array) else np.zeros(3)
    if rise[2] > _LEAST_SLOPE * max(rise[0], rise[1]):
        low, high = array[:, 2].min(), array[:, 2].max()
        place = f"{where} at ({array[0, 0]:.8g}, {array[0, 1]:.8g})"
        raise BadInputError(place, f"3-D, z from {low:.6g} to {high:.6g}", _FLAT)
    return np.asarray(array[:, :2])


if TYPE_CHECKING:
    from ezdxf.document import Drawing as Document

_LARGEST_BYTES = 128 << 20
_MOST_TAGS = 2_000_000
"""Pairs of group code and value: ezdxf takes 3 us and 270 bytes for each."""
_MOST_MENDED_TAGS = 1_000_000
"""In a damaged file, which is read twice."""
_DWG = b"AC10"
_BINARY = b"AutoCAD Binary DXF"
_BYTES_PER_BINARY_TAG = 8
_MOST_ENTITIES = 500_000
_DEEPEST_BLOCK = 16
_MOST_COPIED = 50_000
"""Entities that come out of blocks, every copy counted: each takes about 50 us."""
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
_GDAL_LIMITS = (12.0, 9.0)
"""``$LIMMAX`` of a template in inches, which GDAL before 3.11 copies into every drawing."""
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
    document, repaired = _document(path)
    try:
        drawing = _drawing(document, options.layers)
    except (BadInputError, UnknownNameError) as error:
        raise error.at(path) from error
    except _BROKEN as error:
        problem = " ".join(str(error).split()) or type(error).__name__
        raise UnreadableFileError(path, f"is a damaged DXF file: {problem[:120]}") from error
    if repaired:
        drawing = replace(drawing, facts={**drawing.facts, "faults_mended_by_reader": repaired})
    return replace(drawing_map(path, drawing, options), environment="dxf")


def _document(path: Path) -> tuple["Document", int]:
    """Return the document and how many of its faults ezdxf repaired."""
    data = read_bytes(path, _LARGEST_BYTES)
    if not data.strip():
        raise UnreadableFileError(path, "is empty")
    if data.startswith(_DWG):
        raise UnreadableFileError(path, "is a DWG file, not DXF: save it as DXF in a CAD program")
    tags = max(data.count(b"\n"), data.count(b"\r")) // 2
    if data.startswith(_BINARY):
        tags = len(data) // _BYTES_PER_BINARY_TAG
    if tags > _MOST_TAGS:
        problem = f"is a drawing of about {tags} values; at most {_MOST_TAGS} can be read"
        raise UnreadableFileError(path, f"{problem}: save only the layers that are walls")
    # Its warnings are not printed beside the one line that a user gets.
    logging.getLogger("ezdxf").addHandler(_NO_OUTPUT)
    try:
        document, repaired = readfile(path), 0
    except (OSError, *_BROKEN) as error:
        if tags > _MOST_MENDED_TAGS:
            raise _not_dxf(path, error) from error
        document, repaired = _recovered(path, data)
    if b"$INSUNITS" not in data:
        # ezdxf assumes metres then; the file names no unit.
        document.header["$INSUNITS"] = 0
    return document, repaired


def _not_dxf(path: Path, error: Exception) -> UnreadableFileError:
    problem = " ".join(str(error).split()) or type(error).__name__
    return UnreadableFileError(path, f"is not a DXF file: {problem[:120]}")


def _recovered(path: Path, data: bytes) -> tuple["Document", int]:
    """Return a damaged document, if only its structure had to be repaired."""
    try:
        document, auditor = recover.read(io.BytesIO(data))
    except (OSError, *_BROKEN) as error:
        raise _not_dxf(path, error) from error
    for fix in (*auditor.fixes, *auditor.errors):
        if fix.code in _GUESSED:
            raise UnreadableFileError(path, f"is a damaged DXF file: {fix.message}")
    return document, len(auditor.fixes)


def _drawing(document: "Document", layers: tuple[str, ...]) -> SourceDrawing:
    known = {layer.dxf.name for layer in document.layers}
    space = list(document.modelspace())
    drawn_on = {_layer(entity) for entity in space}
    known |= drawn_on
    by_key = {name.lower(): name for name in known}
    for name in layers:
        if name.lower() not in by_key:
            raise UnknownNameError("layer", name, known)
    walk = _Walk(document, frozenset(name.lower() for name in layers))
    items = walk.items(space)
    code = int(document.header.get("$INSUNITS", 0))
    unit, mm_per_unit = _MM.get(code, ("mm (taken; the file names none)", 1.0))
    if unit == "inches" and tuple(document.header.get("$LIMMAX", ()))[:2] == _GDAL_LIMITS:
        unit += " (GDAL and QGIS write so whatever the unit is; --scale-mm-per-unit if not)"
    return SourceDrawing(
        items=tuple(items),
        mm_per_unit=mm_per_unit,
        layered=len(drawn_on) > 1,
        facts={
            "dxf_version": document.acad_release,
            "units": unit,
            **({"layers": sorted(layers)} if layers else {}),
            "entities": dict(walk.read),
            **({"ignored": dict(walk.ignored)} if walk.ignored else {}),
        },
    )


def _layer(entity: DXFGraphic) -> str:
    """Return an entity's layer; entities of unknown types have none."""
    return str(entity.dxf.layer) if entity.dxf.hasattr("layer") else "0"


def _size(entity: DXFGraphic) -> int:
    """Return how many simple entities take as long to copy."""
    points: int
    match entity.dxftype():
        case "LWPOLYLINE":
            points = len(entity)  # type: ignore[arg-type]
        case "POLYLINE":
            points = len(entity.vertices)  # type: ignore[attr-defined]
        case "SPLINE" | "HELIX":
            points = entity.control_point_count() + entity.fit_point_count()  # type: ignore[attr-defined]
        case "HATCH" | "MPOLYGON":
            paths: list[Any] = entity.paths  # type: ignore[attr-defined]
            held = [path.edges if isinstance(path, EdgePath) else path.vertices for path in paths]
            points = sum(map(len, held))
        case _:
            points = 0
    # ezdxf copies a polyline vertex by vertex, all that came before with each.
    return 1 + points // 2 + points**2 // 25_000


@dataclass(slots=True)
class _Walk:
    """Traversal of model space and the blocks inserted in it."""

    document: "Document"
    layers: frozenset[str]
    read: Counter[str] = field(default_factory=Counter)
    ignored: Counter[str] = field(default_factory=Counter)
    seen: int = 0
    copied: int = 0
    sizes: dict[str, int] = field(default_factory=dict)  # of blocks, with all that is in them

    def items(self, space: Iterable[DXFGraphic]) -> list[DrawingItem]:
        found: list[DrawingItem] = []
        for entity, layer, where in self._leaves(space, None, ""):
            kind = entity.dxftype()
            hidden = self._hidden(entity, layer)
            if hidden is not None:
                self.ignored[hidden] += 1
            elif kind in _SOLIDS or kind.endswith("SURFACE"):
                raise BadInputError(where, "a solid or surface", _FLAT)
            elif kind not in _DRAWN:
                self.ignored[kind] += 1
            else:
                try:
                    found += _items_of(entity, where)
                except BadInputError:
                    raise
                except _INCONSISTENT as error:
                    problem = " ".join(str(error).split()) or type(error).__name__
                    allowed = "a consistent entity"
                    raise BadInputError(where, problem[:80], allowed) from error
                self.read[kind] += 1
        return found

    def _hidden(self, entity: DXFGraphic, layer: str) -> str | None:
        """Return why an entity is not drawn, None when it is."""
        if self.layers and layer.lower() not in self.layers:
            return "on other layers"
        if entity.dxf.hasattr("invisible") and entity.dxf.invisible:
            return "invisible"
        if layer in self.document.layers:
            state = self.document.layers.get(layer)
            if state.is_frozen() or state.is_off():
                return f"on layer {layer}, which is {'frozen' if state.is_frozen() else 'off'}"
        return None

    def _leaves(
        self, space: Iterable[DXFGraphic], outer: str | None, inside: str
    ) -> Iterator[tuple[DXFGraphic, str, str]]:
        """Yield entities other than blocks, with their layer and their name in messages."""
        for entity in space:
            self.seen += 1
            if self.seen > _MOST_ENTITIES:
                raise BadInputError(
                    "entities", f"more than {_MOST_ENTITIES}", "fewer, in blocks too"
                )
            kind, layer = entity.dxftype(), _layer(entity)
            # Layer 0 in a block means the layer on which the block is inserted.
            layer = outer if outer is not None and layer == "0" else layer
            where = f"{kind} {inside}" if inside else f"{kind} (handle {entity.dxf.handle})"
            if isinstance(entity, Insert):
                yield from self._of_block(entity, layer, inside)
            elif kind == "MLINE":
                parts = entity.virtual_entities()  # type: ignore[attr-defined]
                yield from ((part, layer, where) for part in parts)
            else:
                yield entity, layer, where

    def _of_block(
        self, insert: Insert, layer: str, inside: str
    ) -> Iterator[tuple[DXFGraphic, str, str]]:
        name = insert.dxf.name
        if not inside:
            inside = f"in block {name} (INSERT handle {insert.dxf.handle})"
            self.copied += self._copied_by(insert, inside, 0)
            if self.copied > _MOST_COPIED:
                value = f"over {_MOST_COPIED} entities in blocks, every copy counted"
                raise BadInputError(
                    inside, value, "fewer; explode large blocks in the drawing program"
                )
        if insert.block() is None:
            self.ignored[f"INSERT of the missing block {name}"] += 1
            return
        if layer in self.document.layers and self.document.layers.get(layer).is_frozen():
            self.ignored[f"on layer {layer}, which is frozen"] += 1
            return
        for single in insert.multi_insert() if insert.mcount > 1 else [insert]:
            parts = single.virtual_entities(skipped_entity_callback=self._skipped)
            yield from self._leaves(parts, layer, inside)

    def _copied_by(self, insert: Insert, inside: str, depth: int) -> int:
        name = insert.dxf.name
        if depth >= _DEEPEST_BLOCK:
            raise BadInputError(inside, f"blocks {depth} deep", f"at most {_DEEPEST_BLOCK}")
        if name not in self.sizes:
            self.sizes[name] = 1 + sum(
                self._copied_by(part, inside, depth + 1)
                if isinstance(part, Insert)
                else _size(part)
                for part in insert.block() or ()
            )
        return insert.mcount * self.sizes[name]

    def _skipped(self, entity: DXFGraphic, reason: str) -> None:
        if entity.dxftype() in _DRAWN:
            where = f"{entity.dxftype()} (handle {entity.dxf.handle}) in a block"
            raise BadInputError(
                where, reason, "blocks that can be exploded; explode it in the drawing program"
            )
        self.ignored[entity.dxftype()] += 1
