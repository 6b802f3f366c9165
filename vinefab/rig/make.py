"""Pictures and page of a rig: where each part goes, sheets for the laser, drawings at true scale.

Lengths are millimetres of the rig's plan. Drawings at true scale (plan, paper markers) carry a
ruler of 100 mm, by which a user sees whether a printer scaled the page.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
import shapely
from shapely import LineString, Point, Polygon, box
from shapely.affinity import translate
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError, ReadBackError, UnfitInputError
from vinefab.core.hashing import sha256_of
from vinefab.core.plain_text import counted, one_line
from vinefab.core.progress import each, phase
from vinefab.core.view import (
    Answer,
    Block,
    Fact,
    Facts,
    Notes,
    Number,
    Picture,
    Remark,
    Result,
    Rows,
    Section,
)
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
from vinefab.pages.page_files import page_svg
from vinefab.pages.panel import (
    INK,
    ROCK,
    ROCK_EDGE,
    SOFT,
    Ink,
    Page,
    Panel,
    level_colour,
    page_of,
    page_of_paper,
    plan_panel,
)
from vinefab.pages.plan import UNSEEN_DETAIL, StartMark, draw_start_range, start_marks
from vinefab.pages.true_scale import A4_MM, MARGIN_MM, RULER_MM, draw_ruler, true_scale
from vinefab.rig.base_drawing import base_drawing
from vinefab.rig.build import (
    LoosePiece,
    Peg,
    build_board,
    build_rig,
    compare_with_map,
    footprints,
    refuse_early,
)
from vinefab.rig.fixtures import (
    BoardMarkers,
    Fixtures,
    MarkerPad,
    black_cells,
    outside_of,
    paper_crop_mm,
    with_fixtures,
)
from vinefab.rig.part import GRID_MM, Printer, Rig, RigOptions
from vinefab.rig.part_files import (
    BASIS,
    RIG_NAME,
    RigRecord,
    part_files,
    part_problems,
    parts_text,
    printing_of,
    rig_text,
)
from vinefab.rig.rig_plan import Polygons, RigPlan, cuts_of, plan_of, polygon_parts, usable_mm
from vinefab.rig.solid import arrow, centred, shell_words, strokes

_CROP_MM, _TEXT_MM, _CROSS_MM, _FOOT_MM = 5.0, 14.0, 1.0, 24.0

_CORNERS = ("lower left", "lower right", "upper right", "upper left")
_THICKENED = level_colour(4)
_PAPER = Ink(fill="#fbfcfd", line=SOFT)
_THIN, _PLAIN = Ink(line=INK, width_pt=0.4), Ink(line=INK)


BASE_NAME = "base.svg"
"""The drawing of a printed base."""

_CAPTIONS = {
    "assembly.svg": "Where each part goes; the arrow points to the map's north.",
    BASE_NAME: "Section through holder and printed base; base.svg is at true scale.",
}


# --- Drawings


def rig_pictures(
    rig: Rig,
    world: Map,
    fixtures: Fixtures,
    outlines: Mapping[int, BaseGeometry],
    jobs: Mapping[str, Job],
) -> dict[str, bytes]:
    """Return the assembly drawing and a picture of every sheet for the laser, by file name."""
    sheets = {f"{Path(name).stem}.svg": page_svg(sheet_plan(job)) for name, job in jobs.items()}
    return {"assembly.svg": page_svg(assembly_plan(rig, world, fixtures, outlines)), **sheets}


def assembly_plan(
    rig: Rig, world: Map, fixtures: Fixtures, outlines: Mapping[int, BaseGeometry]
) -> Page:
    """Return the numbered plan of a rig, in millimetres of the rig from its lower left corner.

    Parameters
    ----------
    outlines
        In map coordinates, by number.
    """
    low, scale = np.array(rig.plate.bounds[:2]), rig.options.scale

    def on_rig(shape: BaseGeometry) -> BaseGeometry:
        return shapely.transform(shape, lambda points: scale * (points - low))

    plate = on_rig(rig.plate)
    _, _, wide_mm, deep_mm = plate.bounds
    long_mm, count = max(wide_mm, deep_mm), len(outlines)
    # Markers and holder lie around the rig, in its plan.
    shift = -np.array(rig.on_plan(rig.plate).bounds[:2])

    def beside(shape: BaseGeometry) -> BaseGeometry:
        return translate(shape, *shift)

    left, low_mm, right, high_mm = shapely.union(plate, beside(outside_of(fixtures))).bounds
    panel = plan_panel((left, low_mm, right + 0.05 * long_mm, high_mm), 504.0)
    panel.polygons([beside(pad.outline) for pad in fixtures.pads], Ink(line=SOFT))
    for pad in fixtures.pads:
        _draw_cells(panel, pad, tuple(shift.tolist()))
    if (base := fixtures.base) is not None:
        holder = Ink(line=level_colour(3), fill=level_colour(3), fill_alpha=0.15)
        panel.polygons([beside(base.outline)], holder, rank=3, label="holder of the base")
    panel.x_name = panel.y_name = "mm of the rig"
    panel.polygons([plate], _PAPER)
    walls = shapely.simplify(on_rig(rig.walls), UNSEEN_DETAIL * long_mm)
    panel.polygons([walls], Ink(fill=ROCK, line=ROCK_EDGE))
    panel.polygons([on_rig(rig.thickened)], Ink(fill=_THICKENED, line=_THICKENED), rank=2)
    shapes = {number: on_rig(outline) for number, outline in outlines.items()}
    panel.polygons(shapes.values(), Ink(line=level_colour(2)), rank=4)
    size_pt = 14.0 if count < 30 else max(3.0, 90.0 / count**0.5)
    pt_per_mm = panel.width_pt / (panel.box[2] - panel.box[0])
    small_pt = 9.0  # smallest number on a plan of few parts
    for number, shape in shapes.items():
        at = _number_place(shape)
        if not at.is_empty:
            # A number much larger than its piece would hide a wall and its ends.
            room_pt = 2.0 * pt_per_mm * at.distance(shape.boundary)
            high_pt = min(size_pt, max(small_pt, room_pt))
            panel.words((at.x, at.y), str(number), high_pt, bold=True, anchor="middle", halo=True)
    for mark in start_marks(world, world.bounds.bounds):
        whole, fan = mark.whole and on_rig(mark.whole), mark.fan and on_rig(mark.fan)
        draw_start_range(panel, StartMark(whole=whole, free=tuple(map(on_rig, mark.free)), fan=fan))
    places = [on_rig(Point(start.pose.x_mm, start.pose.y_mm)) for start in world.starts]
    if places:
        dot = Ink(fill=INK, line="#ffffff")
        panel.marks(shapely.get_coordinates(places), "o", 4.5, dot, rank=6, label="start")
    at_mm, arrow = right + 0.04 * long_mm, Ink(line=INK, width_pt=1.6)
    panel.arrow((at_mm, 0.86 * deep_mm), (at_mm, 0.94 * deep_mm), arrow, head_pt=8.0, rank=8)
    panel.words((at_mm, 0.97 * deep_mm), "N", anchor="middle")
    thickened = "; yellow: thickened to print" if rig.thickened.area else ""
    panel.title = one_line(
        f"{rig.name}: {counted(count, 'part')}, {wide_mm:.0f} x {deep_mm:.0f} mm, obstacles "
        f"{rig.options.height_mm:g} mm high, scale {scale:.4g}{thickened}"
    )
    return page_of(panel)


def _number_place(shape: BaseGeometry) -> Point:
    """Return the middle of a shape's largest part if that is inside, else a point that is."""
    biggest = max(shapely.get_parts(shape), key=shapely.area, default=Polygon())
    at: Point = biggest.centroid
    return at if biggest.covers(at) else biggest.representative_point()


def sheet_plan(job: Job) -> Page:
    """Return a plan of a sheet for the laser: cuts and marks, without numbers."""
    sheet = (0.0, 0.0, job.sheet_width_mm, job.sheet_height_mm)
    panel = plan_panel(sheet, 504.0)
    panel.polygons([box(*sheet)], _PAPER)
    for operation, colour in ((Operation.MARK, INK), (Operation.CUT, "#d00000")):
        lines = [path.contour for path in job.along(operation)]
        chains = [(line.flattened_mm(0.05), line.closed) for line in lines]
        panel.lines(
            [np.vstack([chain, chain[:1]]) if closed else chain for chain, closed in chains],
            Ink(line=colour),
        )
    panel.title = one_line(f"{job.name}: red is cut, black is marked")
    return page_of(panel)


def true_scale_files(
    rig: Rig, world: Map, fixtures: Fixtures, pieces: Sequence[LoosePiece] = ()
) -> dict[str, bytes]:
    """Return the paper markers, the plan and the printed base as SVG, by file name."""
    files = {"plan.svg": page_svg(plan_sheet(rig, world, fixtures, pieces))}
    if fixtures.pads:
        files["markers.svg"] = page_svg(marker_sheet(fixtures.pads))
    if fixtures.base is not None and fixtures.printed is not None:
        drawing = base_drawing(rig.name, fixtures.base, fixtures.printed)
        files[BASE_NAME] = page_svg(drawing)
    return files


def marker_sheet(pads: Sequence[MarkerPad]) -> Page:
    """Return the markers on one page, each with crop marks and the corner that it belongs to."""
    side_mm = paper_crop_mm(pads[0])
    pitch_mm, half_mm = side_mm + 2.0 * _CROP_MM + _TEXT_MM, 0.5 * side_mm
    wide_mm = max(A4_MM[0], 2.0 * pitch_mm + 2.0 * MARGIN_MM)
    high_mm = max(A4_MM[1], 2.0 * pitch_mm + 2.0 * MARGIN_MM + 60.0)
    panel, top = true_scale((0.0, 0.0, wide_mm, high_mm)), high_mm - MARGIN_MM
    panel.words((MARGIN_MM, top - 2.0), "Corner markers", 12.0)
    for row, words in enumerate(
        (
            "Print at 100 % (not fitted to the page) and measure the ruler. Cut along the crop "
            "marks;",
            "glue each marker into its place, upright as printed here when the map's north is up.",
        )
    ):
        panel.words((MARGIN_MM, top - 9.0 - 4.0 * row), words, 8.0)
    draw_ruler(panel, MARGIN_MM, MARGIN_MM)
    crop = np.array([[(1.0, 0.0), (_CROP_MM, 0.0)], [(0.0, 1.0), (0.0, _CROP_MM)]])
    for pad in pads:
        right, upper = pad.marker.number in (1, 2), pad.marker.number in (2, 3)
        x_mm = 0.5 * wide_mm + (0.5 if right else -0.5) * pitch_mm
        y_mm = 0.5 * high_mm + (0.5 if upper else -0.5) * pitch_mm
        middle = pad.square.centroid
        _draw_cells(panel, pad, (x_mm - middle.x, y_mm - middle.y))
        signs = [np.array([x, y]) for x in (-1.0, 1.0) for y in (-1.0, 1.0)]
        lines = [(x_mm, y_mm) + sign * (half_mm + line) for sign in signs for line in crop]
        panel.lines(lines, _THIN)
        name = f"marker {pad.marker.number}: {_CORNERS[pad.marker.number]}"
        below_mm = y_mm - half_mm - _CROP_MM - 2.5
        panel.words((x_mm, below_mm), name, 8.0, anchor="middle")
    return page_of_paper(panel)


def plan_sheet(rig: Rig, world: Map, fixtures: Fixtures, pieces: Sequence[LoosePiece] = ()) -> Page:
    """Return the plan of a rig at true scale: walls, markers, base and ruler, to be laid below.

    Loose pieces are outlined one by one, with their numbers and the holes for their pegs: by them a
    board is drilled by hand. A cross is the middle of a peg.
    """
    plate, around = rig.on_plan(rig.plate), outside_of(fixtures)
    x_min, y_min, x_max, y_max = shapely.union(plate, around).bounds
    left, low = x_min - MARGIN_MM, y_min - MARGIN_MM - _FOOT_MM
    right = left + max(x_max - x_min, RULER_MM) + 2.0 * MARGIN_MM
    panel = true_scale((left, low, right, y_max + MARGIN_MM))
    panel.polygons([plate, around], Ink(line=SOFT))
    panel.polygons([rig.on_plan(Polygon(world.bounds.exterior))], _PLAIN)
    unseen_mm = 0.02  # walls are drawn to this at true scale: less than a printer's dot
    walls = shapely.simplify(rig.on_plan(rig.walls), unseen_mm)
    panel.polygons([walls], Ink(fill="#d9dee2", line=INK))
    panel.polygons([piece.outline for piece in pieces], _PLAIN)
    pegs = [peg for piece in pieces for peg in piece.pegs]
    panel.polygons([peg.outline for peg in pegs], Ink(fill="#ffffff", line=INK))
    cross = _CROSS_MM * np.array([[(-1.0, 0.0), (1.0, 0.0)], [(0.0, -1.0), (0.0, 1.0)]])
    panel.lines(
        [cross[way] + np.array([peg.x_mm, peg.y_mm]) for peg in pegs for way in (0, 1)], _THIN
    )
    for piece in pieces:
        at = _number_place(piece.outline - shapely.union_all([peg.outline for peg in piece.pegs]))
        panel.words((at.x, at.y), str(piece.number), 8.0, anchor="middle")
    for pad in fixtures.pads:
        _draw_cells(panel, pad)
    for start in world.starts:  # the mouth of the trunk as a cross, and its heading
        at = rig.on_plan(Point(start.pose.x_mm, start.pose.y_mm)).centroid
        cos, sin = np.cos(start.pose.heading_rad), np.sin(start.pose.heading_rad)
        mouth = np.array([(at.x + side * sin, at.y - side * cos) for side in (5.0, -5.0)])
        ahead = np.array([(at.x, at.y), (at.x + 20.0 * cos, at.y + 20.0 * sin)])
        panel.lines([ahead, mouth], Ink(line=INK, width_pt=1.2), rank=6)
    draw_ruler(panel, x_min, low + MARGIN_MM)
    words = (
        f"{one_line(rig.name)} at {rig.options.scale:.4g} of the map's size. Print at 100 % (as a "
        "poster) and measure the ruler."
    )
    panel.words((x_min, low + MARGIN_MM - 5.0), words, 8.0)
    return page_of_paper(panel)


def _draw_cells(panel: Panel, pad: MarkerPad, shift: tuple[float, float] = (0.0, 0.0)) -> None:
    """Draw a marker's black cells, edges sharp: no line is drawn around them."""
    cells = shapely.union_all(black_cells(pad.marker.number, pad.square))
    panel.polygons([translate(cells, *shift)], Ink(fill="#000000"), rank=5)


# --- Result


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigFiles(RigRecord, Result):
    """A rig as files."""

    # by name, every solid read back; empty when a rule forbids the rig
    files: Mapping[str, bytes] = field(default_factory=dict)
    pictures: Mapping[str, bytes] = field(default_factory=dict)  # those of the page, by file name

    @property
    def title(self) -> str:
        """What its page is called."""
        return f"{self.rig.name}: test rig"

    def view(self) -> Iterator[Block]:
        """Yield where each part goes, how many there are, how they are printed, and notes."""
        rig, options = self.rig, self.rig.options
        yield from self._pictures("assembly")
        sheets = f" and {counted(len(self.jobs), 'sheet')} for the laser" if self.jobs else ""
        yield Answer(
            f"{rig.name}: {counted(len(rig.parts), 'part')} for {rig.printer.name}{sheets} at "
            f"{options.scale:.4g} of the map's size; every STL and 3MF read back closed and "
            "oriented; assembled, the outsides of the walls differ from the map by "
            f"{100 * self.comparison.share:.4f} %",
            "bad" if self.report.findings else "good",
        )
        x_min, y_min, x_max, y_max = (options.scale * side for side in rig.plate.bounds)
        size = f"{x_max - x_min:.0f} x {y_max - y_min:.0f} mm"
        volume = Number(rig.volume_mm3, "cm3", ".0f", standing="computed", per=1000.0)
        basis = "computed from assumed settings of the printer"
        yield Facts(
            (
                Fact("size", f"{size}, obstacles {options.height_mm:g} mm high"),
                Fact("volume", volume),
                Fact("printing", self.printing.total.words(), detail=basis),
            )
        )
        yield Notes((self.why_style, *filter(None, [shell_words(rig)])))
        yield Notes(tuple(f"note: {note}" for note in rig.notes))
        yield from (block for block in self.report.view() if isinstance(block, Remark))
        yield replace(self.section, pictures=self._pictures("base", "board", "lid"), folded=True)
        yield self.report.applied

    @property
    def section(self) -> Section:
        """The rig as a part of a report."""
        marked = self.rig.options.marker_kind != "none"
        return Section(
            title="Test rig",
            paragraphs=(
                f"Printing on {self.rig.printer.name} takes about {self.printing.total.words()}: "
                f"{BASIS}.",
                "plan.svg is the rig's plan at true scale with markers and a ruler: lay "
                "the rig onto it, or draw the map on paper."
                + (" markers.svg has paper markers." if marked else ""),
            ),
            pictures=self._pictures("assembly", "base", "board", "lid"),
            tables=(
                Rows(
                    caption="Beds (estimate)",
                    headings=("bed", "takes"),
                    rows=tuple((bed.name, bed.estimate.words()) for bed in self.printing.beds),
                ),
                Rows(
                    caption="Parts (computed)",
                    headings=("number", "file", "bed", "size as printed, mm", "volume, cm3"),
                    rows=tuple(
                        (
                            str(part.number or ""),
                            f"{part.name}.stl",
                            self.printing.bed_of(index).name,
                            " x ".join(f"{size:.1f}" for size in part.size_mm),
                            f"{part.volume_mm3 / 1000.0:.1f}",
                        )
                        for index, part in enumerate(self.rig.printed)
                    ),
                ),
            ),
        )

    def _pictures(self, *kinds: str) -> tuple[Picture, ...]:
        """Return the assembly plan or sheets that were drawn."""
        names = [name for kind in kinds for name in sorted(self.pictures) if name.startswith(kind)]
        most_sheets = 24  # A page shows at most so many sheets; the folder has a picture of each
        return tuple(
            Picture(
                image=self.pictures[name],
                caption=_CAPTIONS.get(name, f"{name}: a sheet for the laser."),
            )
            for name in names[:most_sheets]
        )


SHEET_MARGIN_MM = 5.0


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
    smallest_digit_mm = 2.0
    digit_mm = 8.0
    for number, tile in enumerate(_sheets(plate, outlines, options), 1):
        shapely.prepare(tile)
        near = [piece for piece in pieces if tile.intersects(piece.outline)]
        marks: list[LineString] = []
        for piece in near:
            rings = map(shapely.get_coordinates, shapely.get_rings(piece.outline))
            lines = [*map(LineString, rings)]
            # The number, in the largest circle within the piece that no peg takes, if it fits.
            taken = shapely.union_all([peg.outline.buffer(0.5) for peg in piece.pegs])
            rooms: Iterable[Polygon] = polygon_parts(shapely.difference(piece.outline, taken))
            room = max(rooms, key=shapely.area, default=None)
            if room is not None:
                circle, text = shapely.maximum_inscribed_circle(room, 0.05), str(piece.number)
                fits_mm = 1.6 * circle.length / math.hypot(1.0, 0.9 * len(text))
                if fits_mm >= smallest_digit_mm:
                    at = shapely.get_coordinates(circle)[0].tolist()
                    lines += centred(strokes(text, min(digit_mm, fits_mm)), *at)
            marks += _lines_within(tile, lines)
        holes = [peg for peg in pegs if tile.intersects(shapely.Point(peg.x_mm, peg.y_mm))]
        marks += _lines_within(tile, markers.marks)
        marks += _compass(tile, number, [*(piece.outline for piece in near), *markers.squares])
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


_STYLE_WORDS = {"plate": "tiles of a plate", "board": "loose pieces on a board"}


@dataclass(frozen=True, slots=True, kw_only=True)
class RigRequest:
    """Choices about a rig's files, apart from its sizes."""

    design: Design | None = None  # robot for the rules about corridors and heights
    allow_empty: bool = False  # accept a map without obstacles: a bare tray
    pictures: bool = True  # draw the plan and sheets, and write report.html
    lid: bool = False  # add a lid, to be cut from a transparent sheet
    base: bool = False  # add a printed base, clamped by the holder
    extras: bool = True  # add a scale cube and a north arrow


def make_rig(
    world: Map,
    printer: Printer,
    options: RigOptions,
    request: RigRequest | None = None,
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
    bounds = world.bounds
    convex = 1e-9
    walled = bounds.area < bounds.convex_hull.area * (1.0 - convex)
    solid = walled or any(obstacle.intersects(bounds) for obstacle in world.obstacles)
    if not (solid or request.allow_empty):
        problem = "no obstacle is in its bounds, and these have no corner to go around"
        remedy = "add one, or give --allow-empty for a bare tray"
        raise UnfitInputError(f"map {world.name!r}", problem, remedy)
    with phase("solids of the rig"):
        rig, pieces, why_style = _built(world, printer, options)
        rig = rig if request.extras else replace(rig, extras=())
        rig, fixtures = with_fixtures(rig, world, request.design, with_base=request.base)
    jobs = laser_jobs(rig, pieces, fixtures.board, lid=request.lid)
    sheets = {name: sheet_file(name, jobs[name]) for name in each("sheets of the rig", jobs)}
    with phase("the assembled rig against the map"):
        comparison = compare_with_map(rig, world)
    # Largest share of the walls by which an assembled rig may differ from its map.
    most_difference = 1e-3
    if comparison.share > most_difference:
        problem = f"assembled, its walls differ from the map by {100 * comparison.share:.3f} %"
        raise ReadBackError(f"rig of {world.name}", problem)
    printing = printing_of(rig)
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
    drawings = true_scale_files(rig, world, fixtures, pieces)
    files |= sheets | drawings
    if request.pictures:
        outlines = {piece.number: rig.on_map(piece.outline) for piece in pieces} or footprints(rig)
        with phase("pictures of the rig"):
            drawn = rig_pictures(rig, world, fixtures, outlines, jobs)
        shown = {name: drawings[name] for name in (BASE_NAME,) if name in drawings}
        made = replace(made, pictures=drawn | shown)
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
