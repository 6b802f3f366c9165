"""What a laser cuts for a rig: the drilled board and a lid."""

import math
from collections.abc import Iterable, Iterator, Sequence

import numpy as np
import shapely
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.fabrication.formats.dxf_format import DXF
from vinefab.fabrication.formats.laser_drawing import LaserFileSpec
from vinefab.fabrication.formats.laser_formats import ensure_read_back
from vinefab.fabrication.formats.readback import file_problems
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.outline import Contour, Part
from vinefab.rig.build import LoosePiece, Peg
from vinefab.rig.fixtures import BoardMarkers
from vinefab.rig.part import Rig
from vinefab.rig.rig_options import GRID_MM, Printer, RigOptions
from vinefab.rig.rig_plan import Polygons, polygon_parts
from vinefab.rig.solid import arrow, centred, strokes
from vinefab.rig.split import cuts_of

SHEET_MARGIN_MM = 5.0
_DIGIT_MM = 8.0
_SMALLEST_DIGIT_MM = 2.0


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
        marks: list[LineString] = []
        for piece in near:
            rings = map(shapely.get_coordinates, shapely.get_rings(piece.outline))
            marks += _lines_within(tile, [*map(LineString, rings), *_number_marks(piece)])
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


def _sheets(plate: BaseGeometry, holes: Polygons, options: RigOptions) -> Iterator[Polygon]:
    """Yield a board divided by straight cuts into what fits a sheet, away from its holes."""
    width_mm = options.sheet_width_mm - 2.0 * SHEET_MARGIN_MM
    depth_mm = options.sheet_depth_mm - 2.0 * SHEET_MARGIN_MM
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
    """Return one board or lid on a sheet, its lower left corner at the margin.

    Marks, holes and outline; the beam runs half a kerf off the material that stays.
    """
    marks, pegs, gap_mm = content
    half_mm, turns = 0.5 * options.kerf_mm, np.array([[1, 0], [0, 1], [-1, 0], [0, -1]])
    drawn = [
        (Operation.MARK, "mark", Contour.polyline(shapely.get_coordinates(line), closed=False))
        for line in marks
    ]
    for peg in pegs:
        radius_mm = 0.5 * peg.diameter_mm + gap_mm - half_mm
        circle = Contour(
            points_mm=np.array([peg.x_mm, peg.y_mm]) + radius_mm * turns,
            bulges=np.full(4, math.tan(math.pi / 8.0)),
            parts=(Part.OTHER,) * 4,
            branches=("",) * 4,
            closed=True,
        )
        drawn.append((Operation.CUT, "hole", circle))
    grown = shapely.buffer(outline, half_mm, join_style="mitre", mitre_limit=2.0)
    for piece in polygon_parts(grown):
        for ring in (*piece.interiors, piece.exterior):
            edge = Contour.polyline(shapely.get_coordinates(ring)[:-1], closed=True)
            drawn.append((Operation.CUT, "outline", edge))
    x_min, y_min, x_max, y_max = outline.bounds
    margin_mm = SHEET_MARGIN_MM + half_mm
    return Job(
        name=name,
        sheet_width_mm=x_max - x_min + 2.0 * margin_mm,
        sheet_height_mm=y_max - y_min + 2.0 * margin_mm,
        paths=tuple(
            LaserPath(
                operation=operation,
                contour=contour.moved(0.0, margin_mm - x_min, margin_mm - y_min),
                label=label,
            )
            for operation, label, contour in drawn
        ),
        facts={
            "kerf_mm": options.kerf_mm,
            "kerf_standing": "assumed unless measured on this sheet",
            "sheet_thickness_mm": options.plate_mm,
        },
    )


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


def laser_jobs(
    rig: Rig,
    pieces: tuple[LoosePiece, ...],
    markers: BoardMarkers | None = None,
    *,
    lid: bool,
) -> dict[str, Job]:
    """Return what is cut for a rig, by the names of its DXF files."""
    plate, options = rig.on_plan(rig.plate), rig.options
    named: dict[str, list[Job]] = {}
    if rig.style != "plate":
        named["board"] = board_jobs(rig.name, plate, pieces, options, markers)
    if lid:
        named["lid"] = lid_jobs(rig.name, plate, options)
    return {
        f"{kind}_{number:02d}.dxf": job
        for kind, jobs in named.items()
        for number, job in enumerate(jobs, 1)
    }
