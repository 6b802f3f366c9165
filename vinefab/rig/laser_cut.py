"""What a laser cuts for a rig: the drilled board, a lid, and obstacles in layers of sheet."""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.fabrication.formats.dxf_format import DXF, read_dxf
from vinefab.fabrication.formats.laser_drawing import LaserFileSpec
from vinefab.fabrication.formats.laser_formats import ensure_read_back
from vinefab.fabrication.formats.readback import file_problems
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.map import Map
from vinefab.model.outline import Contour, Part
from vinefab.rig.board import LoosePiece, Peg
from vinefab.rig.comparison_with_map import RigComparison, compare_walls, footprints
from vinefab.rig.corner_tiles import BoardMarkers
from vinefab.rig.part import Rig
from vinefab.rig.printing import packed_on_beds
from vinefab.rig.rig_options import GRID_MM, Printer, RigOptions
from vinefab.rig.rig_plan import Polygons, polygon_parts
from vinefab.rig.solid import arrow, centred, strokes
from vinefab.rig.split import cuts_of

SHEET_MARGIN_MM = 5.0
PIECE_GAP_MM = 3.0
_DIGIT_MM = 8.0
_SMALLEST_DIGIT_MM = 2.0


@dataclass(frozen=True, slots=True, kw_only=True)
class LayerCopy:
    """One layer of a piece on a sheet."""

    piece: LoosePiece
    layer: int  # from 1, the lowest
    sheet: int  # index of its sheet, from 0
    shift_mm: tuple[float, float]  # from the plan to the sheet


def board_jobs(
    name: str,
    plate: BaseGeometry,
    pieces: tuple[LoosePiece, ...],
    options: RigOptions,
    markers: BoardMarkers | None = None,
) -> list[Job]:
    """Return the jobs of the drilled board, one per sheet: outlines as marks, holes, outline."""
    pegs = [peg for piece in pieces for peg in piece.pegs]
    markers = markers or BoardMarkers()
    plate = shapely.union(plate, markers.pads, grid_size=GRID_MM)
    outlines = polygon_parts(*(peg.outline for peg in pegs), *markers.squares, Polygon())
    gap_mm = 0.1 if options.clearance_mm is None else options.clearance_mm
    jobs = []
    for number, tile in enumerate(_sheets(plate, outlines, options), 1):
        shapely.prepare(tile)
        near = [piece for piece in pieces if tile.intersects(piece.outline)]
        marks = [line for piece in near for line in _piece_marks(piece, tile)]
        holes = [peg for peg in pegs if tile.intersects(shapely.Point(peg.x_mm, peg.y_mm))]
        marks += _lines_within(tile, markers.marks)
        taken = [*(piece.outline for piece in near), *markers.squares]
        marks += _compass(tile, number, taken)
        jobs.append(_job(f"{name} board {number}", tile, (marks, holes, gap_mm), options))
    return jobs


def lid_jobs(name: str, plate: BaseGeometry, options: RigOptions) -> list[Job]:
    """Return the jobs of a lid: the plate's outline without its holes, and a compass."""
    whole = shapely.union_all([Polygon(piece.exterior) for piece in polygon_parts(plate)])
    return [
        _job(f"{name} lid {number}", tile, (_compass(tile, number, []), [], 0.0), options)
        for number, tile in enumerate(_sheets(whole, polygon_parts(Polygon()), options), 1)
    ]


def layer_jobs(
    name: str, pieces: tuple[LoosePiece, ...], layers: int, options: RigOptions
) -> tuple[list[Job], list[LayerCopy]]:
    """Return the jobs of obstacles cut in layers, and where each layer of each piece lies."""
    kerf_mm = options.kerf_mm
    boxes = [piece.outline.bounds for piece in pieces for _ in range(layers)]
    sizes = [(box[2] - box[0] + kerf_mm, box[3] - box[1] + kerf_mm) for box in boxes]
    room_mm = tuple(side - 2.0 * SHEET_MARGIN_MM for side in sheet_mm(options))
    copies, jobs = [], []
    for sheet, places in enumerate(packed_on_beds(sizes, (room_mm[0], room_mm[1]), PIECE_GAP_MM)):
        paths: dict[Operation, list[LaserPath]] = {Operation.MARK: [], Operation.CUT: []}
        for at in sorted(places, key=lambda at: at.index):
            piece, layer = pieces[at.index // layers], at.index % layers + 1
            low = boxes[at.index]
            shift = (
                at.x_mm + SHEET_MARGIN_MM + 0.5 * kerf_mm - low[0],
                at.y_mm + SHEET_MARGIN_MM + 0.5 * kerf_mm - low[1],
            )
            copies.append(LayerCopy(piece=piece, layer=layer, sheet=sheet, shift_mm=shift))
            marks = _number_marks(piece)
            for operation, path in _paths(piece.outline, (marks, list(piece.pegs), 0.0), kerf_mm):
                moved = path.contour.moved(0.0, *shift)
                paths[operation].append(
                    LaserPath(operation=operation, contour=moved, label=f"piece {piece.number}")
                )
        jobs.append(_sheet_job(f"{name} layers {sheet + 1}", paths, sheet_mm(options), options))
    return jobs, copies


def sheet_mm(options: RigOptions) -> tuple[float, float]:
    """Return width and depth of the sheets that the laser takes."""
    return options.sheet_width_mm, options.sheet_depth_mm


def _sheets(plate: BaseGeometry, holes: Polygons, options: RigOptions) -> Iterator[Polygon]:
    """Yield a board divided by straight cuts into what fits a sheet, away from its holes."""
    width_mm, depth_mm = (side - 2.0 * SHEET_MARGIN_MM for side in sheet_mm(options))
    laser = Printer(name="the laser", bed_width_mm=width_mm, bed_depth_mm=depth_mm, height_mm=1.0)
    free = RigOptions(bed_margin_mm=0.0, most_parts=options.most_parts)
    cuts = cuts_of(plate.bounds, holes, laser, free)
    for _, cell in cuts.cells():
        yield from polygon_parts(shapely.intersection(plate, cell))


def _job(
    name: str,
    outline: Polygon,
    content: tuple[list[LineString], list[Peg], float],
    options: RigOptions,
) -> Job:
    """Return one board or lid as a sheet of its own, its lower left corner at the margin."""
    x_min, y_min, x_max, y_max = outline.bounds
    margin_mm = SHEET_MARGIN_MM + 0.5 * options.kerf_mm
    paths: dict[Operation, list[LaserPath]] = {Operation.MARK: [], Operation.CUT: []}
    for operation, path in _paths(outline, content, options.kerf_mm):
        moved = path.contour.moved(0.0, margin_mm - x_min, margin_mm - y_min)
        paths[operation].append(LaserPath(operation=operation, contour=moved, label=path.label))
    size_mm = x_max - x_min + 2.0 * margin_mm, y_max - y_min + 2.0 * margin_mm
    return _sheet_job(name, paths, size_mm, options)


def _sheet_job(
    name: str,
    paths: dict[Operation, list[LaserPath]],
    size_mm: tuple[float, float],
    options: RigOptions,
) -> Job:
    return Job(
        name=name,
        sheet_width_mm=size_mm[0],
        sheet_height_mm=size_mm[1],
        paths=(*paths[Operation.MARK], *paths[Operation.CUT]),
        facts={
            "kerf_mm": options.kerf_mm,
            "kerf_standing": "assumed unless measured on this sheet",
            "sheet_thickness_mm": options.plate_mm,
        },
    )


def _paths(
    outline: Polygon, content: tuple[list[LineString], list[Peg], float], kerf_mm: float
) -> Iterator[tuple[Operation, LaserPath]]:
    """Yield marks, holes and outline, the beam half a kerf off the material that stays."""
    marks, pegs, gap_mm = content
    for line in marks:
        contour = Contour.polyline(shapely.get_coordinates(line), closed=False)
        yield Operation.MARK, LaserPath(operation=Operation.MARK, contour=contour, label="mark")
    for peg in pegs:
        radius_mm = 0.5 * peg.diameter_mm + gap_mm - 0.5 * kerf_mm
        contour = _circle(peg.x_mm, peg.y_mm, radius_mm)
        yield Operation.CUT, LaserPath(operation=Operation.CUT, contour=contour, label="hole")
    grown = shapely.buffer(outline, 0.5 * kerf_mm, join_style="mitre", mitre_limit=2.0)
    for piece in polygon_parts(grown):
        for ring in (*piece.interiors, piece.exterior):
            points = shapely.get_coordinates(ring)[:-1]
            contour = Contour.polyline(points, closed=True)
            yield (
                Operation.CUT,
                LaserPath(operation=Operation.CUT, contour=contour, label="outline"),
            )


def _circle(x_mm: float, y_mm: float, radius_mm: float) -> Contour:
    """Return a circle as four arcs."""
    turns = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
    return Contour(
        points_mm=np.array([x_mm, y_mm]) + radius_mm * turns,
        bulges=np.full(4, math.tan(math.pi / 8.0)),
        parts=(Part.OTHER,) * 4,
        branches=("",) * 4,
        closed=True,
    )


def _piece_marks(piece: LoosePiece, tile: Polygon) -> Iterator[LineString]:
    """Yield a piece's outline and number, as far as they lie on a tile of the board."""
    rings = shapely.get_rings(piece.outline)
    shapes = [LineString(shapely.get_coordinates(ring)) for ring in rings]
    yield from _lines_within(tile, (*shapes, *_number_marks(piece)))


def _lines_within(tile: Polygon, lines: Sequence[LineString]) -> Iterator[LineString]:
    """Yield what lies on a tile of lines, joined where they meet themselves."""
    for shape in lines:
        cut = shapely.line_merge(shapely.intersection(shape, tile))
        for line in shapely.get_parts(cut):
            if isinstance(line, LineString) and line.length > 0.0:
                yield line


def _number_marks(piece: LoosePiece) -> list[LineString]:
    """Return a piece's number in the largest circle within it that no peg takes, if it fits."""
    pegs = shapely.union_all([peg.outline.buffer(0.5) for peg in piece.pegs])
    rooms: Iterable[Polygon] = polygon_parts(shapely.difference(piece.outline, pegs))
    room = max(rooms, key=shapely.area, default=None)
    if room is None:
        return []
    circle = shapely.maximum_inscribed_circle(room, 0.05)
    text = str(piece.number)
    height_mm = min(_DIGIT_MM, 1.6 * circle.length / math.hypot(1.0, 0.9 * len(text)))
    if height_mm < _SMALLEST_DIGIT_MM:
        return []
    x_mm, y_mm = shapely.get_coordinates(circle)[0].tolist()
    return centred(strokes(text, height_mm), x_mm, y_mm)


def _compass(tile: Polygon, number: int, taken: list[Polygon]) -> list[LineString]:
    """Return an arrow to north and the sheet's number, where nothing stands."""
    free = polygon_parts(shapely.difference(tile, shapely.union_all(taken)))
    circle = max(
        (shapely.maximum_inscribed_circle(piece, 0.5) for piece in free),
        key=shapely.length,
        default=None,
    )
    if circle is None or circle.length < 3.0:
        return []
    size_mm = min(15.0, circle.length)
    x_mm, y_mm = shapely.get_coordinates(circle)[0].tolist()
    pointer = centred(arrow(size_mm), x_mm + 0.35 * size_mm, y_mm)
    return [*pointer, *centred(strokes(str(number), 0.6 * size_mm), x_mm - 0.35 * size_mm, y_mm)]


def sheet_file(name: str, job: Job) -> bytes:
    """Return a sheet as a DXF file, read back.

    Raises
    ------
    ReadBackError
        If the file, read back, differs from the job.
    """
    spec = LaserFileSpec(job=job)
    data = DXF.write(spec).encode()
    ensure_read_back({name: file_problems(DXF, data, spec)})
    return data


def material_left(data: bytes, kerf_mm: float) -> BaseGeometry:
    """Return what a sheet's closed straight cuts leave as pieces, the kerf taken off.

    Round holes are left out; they do not reach through to a piece's outline.
    """
    layer = Operation.CUT.layer
    rings = [
        shapely.LinearRing(path.contour.points_mm)
        for path in read_dxf(data.decode()).paths
        if path.layer == layer and path.contour.closed and not path.contour.arc_count
    ]
    pieces = shapely.build_area(shapely.GeometryCollection(rings))
    return shapely.union_all(
        polygon_parts(shapely.buffer(pieces, -0.5 * kerf_mm, join_style="mitre", mitre_limit=5.0))
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LaserCutFiles:
    """Everything that a laser cuts for a rig."""

    jobs: dict[str, Job] = field(default_factory=dict)  # by file name
    files: dict[str, bytes] = field(default_factory=dict)  # DXF, read back without a difference
    copies: tuple[LayerCopy, ...] = ()  # where each layer of each piece lies, for style ``sheet``


def layers_of(rig: Rig) -> int:
    """Return how many layers of sheet make the obstacles' height, rounded up."""
    return math.ceil(rig.options.height_mm / rig.options.plate_mm - 1e-9)


def standing_mm(rig: Rig) -> float:
    """Return the height of the obstacles as they are made: of whole layers when cut in layers."""
    layered = rig.style == "sheet"
    return layers_of(rig) * rig.options.plate_mm if layered else rig.options.height_mm


def laser_cut_files(
    rig: Rig,
    world: Map,
    pieces: tuple[LoosePiece, ...],
    markers: BoardMarkers | None = None,
    *,
    lid: bool,
) -> LaserCutFiles:
    """Return what is cut for a rig."""
    options, named = rig.options, list[tuple[str, list[Job]]]()
    plate, copies = _on_plan(rig.plate, rig, world), list[LayerCopy]()
    if rig.style != "plate":
        named.append(("board", board_jobs(rig.name, plate, pieces, options, markers)))
    if rig.style == "sheet":
        jobs, copies = layer_jobs(rig.name, pieces, layers_of(rig), options)
        named.append(("layers", jobs))
    if lid:
        named.append(("lid", lid_jobs(rig.name, plate, options)))
    jobs_by_name = {
        f"{kind}_{number:02d}.dxf": job
        for kind, jobs in named
        for number, job in enumerate(jobs, 1)
    }
    files = {name: sheet_file(name, job) for name, job in jobs_by_name.items()}
    return LaserCutFiles(jobs=jobs_by_name, files=files, copies=tuple(copies))


def compare_layers(rig: Rig, world: Map, cut: LaserCutFiles) -> RigComparison:
    """Put every layer of every piece back where it belongs and compare each layer with the map.

    Works on the DXF files as read back; the worst layer counts.
    """
    sheets = [
        list(shapely.get_parts(material_left(cut.files[name], rig.options.kerf_mm)))
        for name in cut.jobs
        if name.startswith("layers")
    ]
    trees = [shapely.STRtree(pieces) for pieces in sheets]
    layers: dict[int, list[BaseGeometry]] = {}
    for copy in cut.copies:
        inside = copy.piece.outline.representative_point()
        at = shapely.affinity.translate(inside, *copy.shift_mm)
        for found in trees[copy.sheet].query(at, predicate="intersects"):
            x_mm, y_mm = copy.shift_mm
            back = shapely.affinity.translate(sheets[copy.sheet][int(found)], -x_mm, -y_mm)
            layers.setdefault(copy.layer, []).append(_on_map(back, rig, world))
    compared = [
        compare_walls(rig, world, shapely.union_all(layers.get(layer, [])))
        for layer in range(1, layers_of(rig) + 1)
    ]
    return max(compared, key=lambda comparison: comparison.share)


def outlines_of(rig: Rig, world: Map, pieces: tuple[LoosePiece, ...]) -> dict[int, BaseGeometry]:
    """Return what the assembly drawing numbers: outlines by number, in map coordinates."""
    if pieces:
        return {piece.number: _on_map(piece.outline, rig, world) for piece in pieces}
    standing = footprints(rig)
    return {part.number: standing[part.name] for part in rig.parts}


def _on_plan(shape: BaseGeometry, rig: Rig, world: Map) -> BaseGeometry:
    low_mm = world.bounds.bounds[:2]
    return shapely.transform(shape, lambda points: (points - low_mm) * rig.options.scale)


def _on_map(shape: BaseGeometry, rig: Rig, world: Map) -> BaseGeometry:
    low_mm = world.bounds.bounds[:2]
    return shapely.transform(shape, lambda points: points / rig.options.scale + low_mm)
