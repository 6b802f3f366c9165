"""From a map to the files of its rig: built, compared with the map, checked, written, read back.

Sheets for the laser are made here too.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError, ReadBackError
from vinefab.core.hashing import sha256_of
from vinefab.fabrication.checking import corridors_in
from vinefab.fabrication.formats.dxf_format import DXF
from vinefab.fabrication.formats.laser_drawing import LaserFileSpec, file_problems
from vinefab.fabrication.formats.laser_formats import ensure_read_back
from vinefab.fabrication.rules.catalog import run_rig_checks
from vinefab.fabrication.rules.rule import MapCorridors, RigFacts, RigPartFacts, RigSubject
from vinefab.model.design import Design
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.map import Map
from vinefab.model.outline import Contour, Part
from vinefab.rig.build import (
    LoosePiece,
    Peg,
    build_board,
    build_rig,
    compare_with_map,
    footprints,
    refuse_early,
)
from vinefab.rig.fixtures import BoardMarkers, with_fixtures
from vinefab.rig.page import RigFiles, rig_pictures, true_scale_files
from vinefab.rig.part import Rig
from vinefab.rig.part_files import part_files, part_problems, printing_of
from vinefab.rig.rig_json import RIG_NAME, parts_text, rig_text
from vinefab.rig.rig_options import GRID_MM, Printer, RigOptions
from vinefab.rig.rig_plan import Polygons, RigPlan, cuts_of, plan_of, polygon_parts, usable_mm
from vinefab.rig.solid import arrow, centred, strokes

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
    """Yield the parts of lines on a tile, joined where they meet themselves."""
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
    """Return the jobs cut for a rig, by the names of its DXF files."""
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


RIG_MARK = RIG_NAME

MOST_DIFFERENCE = 1e-3
"""Largest share of the walls by which an assembled rig may differ from its map."""

_CONVEX = 1e-9
_STYLE_WORDS = {"plate": "tiles of a plate", "board": "loose pieces on a board"}

ProgressCallback = Callable[[float, str], None]
"""Called with the share of the work that is done, 0 to 1, and the next step."""


@dataclass(frozen=True, slots=True, kw_only=True)
class RigRequest:
    """Choices about a rig's files, apart from its sizes."""

    design: Design | None = None  # robot for the rules about corridors and heights
    allow_empty: bool = False  # accept a map without obstacles: a bare tray
    pictures: bool = True  # draw the plan and sheets, and write report.html
    lid: bool = False  # add a lid, to be cut from a transparent sheet


def make_rig(
    world: Map,
    printer: Printer,
    options: RigOptions,
    request: RigRequest | None = None,
    *,
    progress: ProgressCallback | None = None,
) -> RigFiles:
    """Make a map's rig and all its files.

    Raises
    ------
    BadInputError
        If the map has no obstacles (unless the request allows it), or the rig does not fit the
        printer, its options or the number of parts.
    ReadBackError
        If a file, read back, or the assembled rig differs from its specification.
    """
    request = request or RigRequest()
    tell = progress or (lambda _, __: None)
    bounds = world.bounds
    walled = bounds.area < bounds.convex_hull.area * (1.0 - _CONVEX)
    solid = walled or any(obstacle.intersects(bounds) for obstacle in world.obstacles)
    if not (solid or request.allow_empty):
        allowed = "at least one in the bounds, or bounds with a corner to go around; --allow-empty"
        key = f"map {world.name}: number of obstacles"
        raise BadInputError(key, 0, f"{allowed} makes a bare tray")
    tell(0.0, "building solids")
    rig, pieces, why_style = _built(world, printer, options)
    rig, fixtures = with_fixtures(rig, world, request.design)
    jobs = laser_jobs(rig, pieces, fixtures.board, lid=request.lid)
    sheets = {name: sheet_file(name, job) for name, job in jobs.items()}
    tell(0.25, "comparing with the map")
    comparison = compare_with_map(rig, world)
    if comparison.share > MOST_DIFFERENCE:
        problem = f"assembled, its walls differ from the map by {100 * comparison.share:.3f} %"
        raise ReadBackError(f"rig of {world.name}", problem)
    printing = printing_of(rig)
    tell(0.35, "writing and reading back")
    files = part_files(rig, printing)
    problems = part_problems(files, rig, printing)
    facts = RigFacts(
        name=rig.name,
        printer=rig.printer.name,
        room_mm=(*usable_mm(rig.printer, rig.options), rig.printer.height_mm),
        height_mm=rig.options.height_mm,
        parts=tuple(
            RigPartFacts(name=part.name, size_mm=part.size_mm, problems=problems[part.name])
            for part in rig.printed
        ),
    )
    courses = tuple[MapCorridors, ...]()
    if request.design:  # the corridors as they will be printed, thickened walls included
        free = shapely.difference(shapely.Polygon(bounds.exterior), rig.walls)
        place = f"the rig of {world.name}"
        courses = (corridors_in(world, free, request.design, options.scale, place),)
    report = run_rig_checks(RigSubject(design=request.design, rig=facts, corridors=courses))
    made = RigFiles(
        rig=rig,
        world=world,
        printing=printing,
        comparison=comparison,
        report=report,
        jobs=jobs,
        why_style=why_style,
        fixtures=fixtures,
    )
    if report.blocking:
        return made
    files |= sheets | true_scale_files(rig, world, fixtures, pieces)
    if request.pictures:
        tell(0.5, "drawing the plan")
        outlines = {piece.number: rig.on_map(piece.outline) for piece in pieces} or footprints(rig)
        made = replace(made, pictures=rig_pictures(rig, world, outlines, jobs))
        files |= {**made.pictures, "report.html": made.page().encode()}
    files["parts.csv"] = parts_text(rig, printing).encode()
    digests = {name: sha256_of(data) for name, data in files.items()}
    files[RIG_NAME] = rig_text(made, digests).encode()
    return replace(made, files=files)


def _built(
    world: Map, printer: Printer, options: RigOptions
) -> tuple[Rig, tuple[LoosePiece, ...], str]:
    """Return a rig in the style of its options, its loose pieces, and why it has this style."""
    if options.style != "auto":
        return *_in_style(world, printer, options), f"style {options.style}: as asked for"
    refuse_early(world, printer, options)
    plan = plan_of(world, printer, options)  # the same for both styles
    made: dict[str, tuple[Rig, tuple[LoosePiece, ...]]] = {}
    refused: dict[str, BadInputError] = {}
    for style in ("plate", "board"):
        try:
            made[style] = _in_style(world, printer, options.changed(style=style), plan)
        except BadInputError as error:
            refused[style] = error
    if not made:
        raise refused["plate"]
    takes = {style: printing_of(rig).total for style, (rig, _) in made.items()}
    chosen = min(takes, key=lambda style: takes[style].time_s)
    other = "plate" if chosen == "board" else "board"
    if other in takes:
        why = (
            f"style {chosen}, {_STYLE_WORDS[chosen]}, is the quicker to print: "
            f"{takes[chosen].words()}; style {other}, {_STYLE_WORDS[other]}: "
            f"{takes[other].words()} (estimates, without markers and holder)"
        )
    else:
        why = f"style {chosen}: {_STYLE_WORDS[chosen]}; style {other} was refused: {refused[other]}"
    return *made[chosen], why


def _in_style(
    world: Map, printer: Printer, options: RigOptions, plan: RigPlan | None = None
) -> tuple[Rig, tuple[LoosePiece, ...]]:
    """Return a rig, and its loose pieces if it has any."""
    if options.style == "plate":
        return build_rig(world, printer, options, plan), ()
    return build_board(world, printer, options, plan)
