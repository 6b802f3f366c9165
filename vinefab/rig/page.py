"""Pictures and page of a rig: where each part goes, sheets for the laser, drawings at true scale.

Lengths are millimetres of the rig's plan. Drawings at true scale (plan, paper markers) carry a
ruler of 100 mm, by which a user sees whether a printer scaled the page.
"""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from xml.sax.saxutils import escape

import numpy as np
import shapely
from shapely import LineString, Point, Polygon, box
from shapely.affinity import translate
from shapely.geometry.base import BaseGeometry

from vinefab.core.jsontext import GENERATOR
from vinefab.core.plain_text import counted, one_line
from vinefab.core.view import Answer, Fact, Facts, Picture, Section, Table
from vinefab.fabrication.package.package_page import check_section
from vinefab.model.finding import CheckReport
from vinefab.model.job import Job, Operation
from vinefab.model.map import Map, Pose
from vinefab.pages.colours import INK, ROCK, ROCK_EDGE, SOFT, START, level_colour
from vinefab.pages.html import page
from vinefab.pages.map_view import UNSEEN_DETAIL, Box, longer_mm, start_marks
from vinefab.pages.plan_document import LONGEST_PX, RANGE, START_ENTRY, plan_document
from vinefab.pages.plan_svg import contour_path, pose_svg
from vinefab.rig.board import LoosePiece
from vinefab.rig.comparison_with_map import RigComparison
from vinefab.rig.fixtures import Fixtures, MarkerPad, black_cells, outside_of, paper_crop_mm
from vinefab.rig.open_shell import shell_words
from vinefab.rig.part import Rig
from vinefab.rig.printing import BASIS, Printing

A4_MM = (210.0, 297.0)
MARGIN_MM = 15.0
RULER_MM = 100.0

UNSEEN_MM = 0.02
"""Walls are drawn to this at true scale: less than a printer's dot."""

MOST_SHEETS = 24
"""A page shows at most so many sheets; the folder has a picture of each."""

_CROP_MM, _TEXT_MM, _CROSS_MM, _FOOT_MM = 5.0, 14.0, 1.0, 24.0
_CORNERS = ("lower left", "lower right", "upper right", "upper left")
_CUT, _PAPER, _OBSTACLE = "#d00000", "#fbfcfd", "#d9dee2"
_THICKENED = level_colour(4)
_FONT_MM = 2.8


# --- Primitives: y counts upwards here and downwards in SVG


def _path(shapes: BaseGeometry | Sequence[BaseGeometry], fill: str, line: str, wide: float) -> str:
    """Return polygons and lines as one path."""
    parts = shapely.get_parts(shapes)
    lines = [*shapely.get_rings(parts), *parts[shapely.get_dimensions(parts) == 1]]
    points, owner = shapely.get_coordinates(lines, return_index=True)
    texts = [f"{x:.10g} {y:.10g}" for x, y in (np.round(points * (1, -1), 3) + 0.0).tolist()]
    first = np.searchsorted(owner, np.arange(len(lines) + 1)).tolist()
    course = "".join(f"M{'L'.join(texts[a:b])}" for a, b in pairwise(first))
    style = f"fill:{fill};fill-rule:evenodd;stroke:{line};stroke-width:{wide:.4g}"
    return f'<path d="{course}" style="{style}"/>'


def _text(words: str, at: tuple[float, float], size: float, style: str = "") -> str:
    style = f"font:{size:.4g}px sans-serif;fill:{INK};{style}"
    return (
        f'<text x="{at[0]:.3f}" y="{-at[1]:.3f}" style="{style}">{escape(one_line(words))}</text>'
    )


_MIDDLE = "text-anchor:middle;dominant-baseline:central;"


def _true_scale(box_mm: Box, parts: Iterable[str]) -> bytes:
    """Return parts as a page of which each unit is a millimetre of paper."""
    wide, high = box_mm[2] - box_mm[0], box_mm[3] - box_mm[1]
    return "\n".join(
        [
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{wide:.3f}mm" height="{high:.3f}mm" '
            f'viewBox="{box_mm[0]:.3f} {-box_mm[3]:.3f} {wide:.3f} {high:.3f}">',
            f"<desc>{GENERATOR}</desc>",
            *parts,
            "</svg>\n",
        ]
    ).encode()


def _ruler(x_mm: float, y_mm: float) -> list[str]:
    """Return a ruler of 100 mm with a tick every 10 mm."""
    ticks = [
        LineString([(x_mm + at, y_mm), (x_mm + at, y_mm + (4.0 if at % 50.0 == 0.0 else 2.5))])
        for at in np.arange(0.0, RULER_MM + 1.0, 10.0).tolist()
    ]
    base = LineString([(x_mm, y_mm), (x_mm + RULER_MM, y_mm)])
    end = (x_mm + RULER_MM + 2.0, y_mm)
    return [_path([base, *ticks], "none", INK, 0.18), _text("100 mm", end, _FONT_MM)]


# --- Drawings


def rig_pictures(
    rig: Rig, world: Map, outlines: Mapping[int, BaseGeometry], jobs: Mapping[str, Job]
) -> dict[str, bytes]:
    """Return the assembly drawing and a picture of every sheet for the laser, by file name."""
    sheets = {f"{Path(name).stem}.svg": sheet_picture(job) for name, job in jobs.items()}
    return {"assembly.svg": assembly_picture(rig, world, outlines), **sheets}


def assembly_picture(rig: Rig, world: Map, outlines: Mapping[int, BaseGeometry]) -> bytes:
    """Return the numbered plan of a rig; ``outlines`` are in map coordinates, by number."""
    plate = rig.on_plan(rig.plate)
    x_min, y_min, x_max, y_max = plate.bounds
    long_mm = longer_mm(plate.bounds)
    beside_mm = 0.05 * long_mm  # for the arrow to north
    px = 1.04 * (long_mm + beside_mm) / LONGEST_PX
    walls = shapely.simplify(rig.on_plan(rig.walls), UNSEEN_DETAIL * long_mm)
    parts = [
        _path(plate, _PAPER, SOFT, px),
        _path(walls, ROCK, ROCK_EDGE, px),
        _path(rig.on_plan(rig.thickened), _THICKENED, _THICKENED, px),
    ]
    count = len(outlines)
    size = px * (16.0 if count < 30 else max(4.0, 107.0 / count**0.5))
    halo = (
        f"{_MIDDLE}font-weight:bold;stroke:#fff;stroke-width:{0.25 * size:.3g};paint-order:stroke"
    )
    shapes = {number: rig.on_plan(outline) for number, outline in outlines.items()}
    parts.append(_path(list(shapes.values()), "none", level_colour(2), px))
    shade = f"{START};fill-opacity:0.28"
    for mark in start_marks(world, world.bounds.bounds):
        shaded = [*mark.free, *([mark.fan] if mark.fan is not None else [])]
        parts += [_path(rig.on_plan(shape), shade, "none", 0.0) for shape in shaded]
        if mark.whole is not None:
            dashed = f"{START};stroke-dasharray:{5 * px:.4g} {4 * px:.4g}"
            parts.append(_path(rig.on_plan(mark.whole), "none", dashed, px))
    for start in world.starts:
        at = rig.on_plan(Point(start.pose.x_mm, start.pose.y_mm))
        pose = Pose(x_mm=at.x, y_mm=at.y, heading_rad=start.pose.heading_rad)
        parts.append(pose_svg(pose, 30.0 * px))
    for number, shape in shapes.items():
        biggest = max(shapely.get_parts(shape), key=shapely.area, default=Polygon())
        if not biggest.is_empty:
            middle = biggest.centroid
            middle = middle if biggest.covers(middle) else biggest.representative_point()
            parts.append(_text(str(number), (middle.x, middle.y), size, halo))
    north = x_max + 0.6 * beside_mm, y_max - 14.0 * px
    head = Polygon(
        [
            (north[0] + dx * px, north[1] + dy * px)
            for dx, dy in ((0, 0), (-5, -14), (0, -11), (5, -14))
        ]
    )
    parts += [
        _path(head, INK, INK, px),
        _text("N", (north[0], north[1] + 7 * px), 12 * px, _MIDDLE),
    ]
    thickened = "; yellow: thickened to print" if rig.thickened.area else ""
    title = (
        f"{rig.name}: {counted(count, 'part')}, {x_max - x_min:.0f} x {y_max - y_min:.0f} mm, "
        f"obstacles {rig.options.height_mm:g} mm high, scale {rig.options.scale:.4g}{thickened}"
    )
    legend = [START_ENTRY, RANGE] if world.starts else []
    around = (x_min, y_min, x_max + beside_mm, y_max)
    return plan_document(parts, around, title=title, legend=legend).encode()


def sheet_picture(job: Job) -> bytes:
    """Return a plan of a sheet for the laser: cuts and marks, without numbers."""
    sheet = (0.0, 0.0, job.sheet_width_mm, job.sheet_height_mm)
    px = 1.04 * longer_mm(sheet) / LONGEST_PX
    parts = [_path(box(*sheet), _PAPER, SOFT, px)]
    for operation, colour in ((Operation.MARK, INK), (Operation.CUT, _CUT)):
        course = "".join(contour_path(path.contour) for path in job.along(operation))
        parts.append(f'<path d="{course}" style="stroke:{colour};stroke-width:{px:.4g}"/>')
    return plan_document(parts, sheet, title=f"{job.name}: red is cut, black is marked").encode()


def true_scale_files(
    rig: Rig, world: Map, fixtures: Fixtures, pieces: Sequence[LoosePiece] = ()
) -> dict[str, bytes]:
    """Return the paper markers and the plan as SVG, by file name."""
    files = {"plan.svg": plan_picture(rig, world, fixtures, pieces)}
    return files | ({"markers.svg": marker_picture(fixtures.pads)} if fixtures.pads else {})


def marker_picture(pads: Sequence[MarkerPad]) -> bytes:
    """Return the markers on one page, each with crop marks and the corner that it belongs to."""
    side_mm = paper_crop_mm(pads[0])
    pitch_mm = side_mm + 2.0 * _CROP_MM + _TEXT_MM
    wide_mm = max(A4_MM[0], 2.0 * pitch_mm + 2.0 * MARGIN_MM)
    high_mm = max(A4_MM[1], 2.0 * pitch_mm + 2.0 * MARGIN_MM + 60.0)
    top = high_mm - MARGIN_MM
    words = (
        "Print at 100 % (not fitted to the page) and measure the ruler. Cut along the crop marks;",
        "glue each marker into its place, upright as printed here when the map's north is up.",
    )
    parts = [
        _text("Corner markers", (MARGIN_MM, top - 4.0), 4.2),
        *(_text(line, (MARGIN_MM, top - 10.0 - 4.0 * row), 2.8) for row, line in enumerate(words)),
        *_ruler(MARGIN_MM, MARGIN_MM),
    ]
    half = 0.5 * side_mm
    for pad in pads:
        right, upper = pad.marker.number in (1, 2), pad.marker.number in (2, 3)
        x_mm = 0.5 * wide_mm + (0.5 if right else -0.5) * pitch_mm
        y_mm = 0.5 * high_mm + (0.5 if upper else -0.5) * pitch_mm
        middle = pad.square.centroid
        parts.append(_cells(pad, (x_mm - middle.x, y_mm - middle.y)))
        crops = [
            LineString([(x_mm + x * (half + a), y_mm + y * (half + b)) for a, b in ends])
            for x in (-1.0, 1.0)
            for y in (-1.0, 1.0)
            for ends in (((1.0, 0.0), (_CROP_MM, 0.0)), ((0.0, 1.0), (0.0, _CROP_MM)))
        ]
        parts.append(_path(crops, "none", INK, 0.14))
        below = (x_mm, y_mm - half - _CROP_MM - 3.5)
        name = f"marker {pad.marker.number}: {_CORNERS[pad.marker.number]}"
        parts.append(_text(name, below, _FONT_MM, "text-anchor:middle"))
    return _true_scale((0.0, 0.0, wide_mm, high_mm), parts)


def _cells(pad: MarkerPad, shift: tuple[float, float] = (0.0, 0.0)) -> str:
    """Return a marker's black cells, edges sharp: no line is drawn around them."""
    cells = shapely.union_all(black_cells(pad.marker.number, pad.square))
    return _path(translate(cells, *shift), "#000", "none", 0.0)


def plan_picture(
    rig: Rig, world: Map, fixtures: Fixtures, pieces: Sequence[LoosePiece] = ()
) -> bytes:
    """Return the plan of a rig at true scale: walls, markers, base and ruler, to be laid below.

    Loose pieces are outlined one by one, with their numbers and the holes for their pegs: by them a
    board is drilled by hand. A cross is the middle of a peg.
    """
    plate, around = rig.on_plan(rig.plate), outside_of(fixtures)
    x_min, y_min, x_max, y_max = shapely.union(plate, around).bounds
    low = y_min - MARGIN_MM - _FOOT_MM
    wide_mm = max(x_max - x_min, RULER_MM) + 2.0 * MARGIN_MM
    walls = shapely.simplify(rig.on_plan(rig.walls), UNSEEN_MM)
    pegs = [peg for piece in pieces for peg in piece.pegs]
    crosses = [
        LineString([(peg.x_mm - dx, peg.y_mm - dy), (peg.x_mm + dx, peg.y_mm + dy)])
        for peg in pegs
        for dx, dy in ((_CROSS_MM, 0.0), (0.0, _CROSS_MM))
    ]
    starts = []
    for start in world.starts:
        at = rig.on_plan(Point(start.pose.x_mm, start.pose.y_mm))
        cos, sin = np.cos(start.pose.heading_rad), np.sin(start.pose.heading_rad)
        mouth = [(at.x + side * sin, at.y - side * cos) for side in (5.0, -5.0)]
        starts += [LineString([at, (at.x + 20.0 * cos, at.y + 20.0 * sin)]), LineString(mouth)]
    numbers = []
    for piece in pieces:
        circle = shapely.maximum_inscribed_circle(piece.outline, 0.5)
        x_mm, y_mm = shapely.get_coordinates(circle)[0].tolist()
        numbers.append(_text(str(piece.number), (x_mm, y_mm), _FONT_MM, _MIDDLE))
    words = (
        f"{rig.name} at {rig.options.scale:.4g} of the map's size. Print at 100 % (as a poster) "
        "and measure the ruler."
    )
    parts = [
        _path([plate, around], "none", SOFT, 0.25),
        _path(rig.on_plan(Polygon(world.bounds.exterior)), "none", INK, 0.25),
        _path(walls, _OBSTACLE, INK, 0.25),
        _path([piece.outline for piece in pieces], "none", INK, 0.25),
        _path([peg.outline for peg in pegs], "#fff", INK, 0.25),
        _path(crosses, "none", INK, 0.1),
        *numbers,
        *(_cells(pad) for pad in fixtures.pads),
        _path(starts, "none", INK, 0.42),
        *_ruler(x_min, low + MARGIN_MM),
        _text(words, (x_min, low + MARGIN_MM - 6.5), _FONT_MM),
    ]
    corner = x_min - MARGIN_MM
    return _true_scale((corner, low, corner + wide_mm, y_max + MARGIN_MM), parts)


# --- Page


def rig_section(
    rig: Rig, printing: Printing, pictures: Mapping[str, bytes], why_style: str
) -> Section:
    """Return the section about a rig."""
    sheets = sorted(name for name in pictures if name.startswith(("board", "lid")))
    captions = {"assembly.svg": "Where each part goes; the arrow points to the map's north."}
    captions |= {name: f"{name}: a sheet for the laser." for name in sheets[:MOST_SHEETS]}
    marked = rig.options.marker_kind != "none"
    said = [words for words in (why_style, shell_words(rig)) if words]
    return Section(
        title="Test rig",
        paragraphs=(
            f"Printing on {rig.printer.name} takes about {printing.total.words()}: {BASIS}.",
            *(f"{words[0].upper()}{words[1:]}." for words in said),
            "plan.svg is the rig's plan at true scale with markers and a ruler: lay "
            "the rig onto it, or draw the map on paper."
            + (" markers.svg has paper markers." if marked else ""),
            *(f"Note: {note}." for note in rig.notes),
        ),
        pictures=tuple(
            Picture(image=pictures[name], caption=caption, wide=True)
            for name, caption in captions.items()
        ),
        tables=(
            Table(
                caption="Beds (estimate)",
                headings=("bed", "takes"),
                rows=tuple((bed.name, bed.estimate.words()) for bed in printing.beds),
            ),
            Table(
                caption="Parts (computed)",
                headings=("number", "file", "bed", "size as printed, mm", "volume, cm3"),
                rows=tuple(
                    (
                        str(part.number or ""),
                        f"{part.name}.stl",
                        printing.bed_of(index).name,
                        " x ".join(f"{size:.1f}" for size in part.size_mm),
                        f"{part.volume_mm3 / 1000.0:.1f}",
                    )
                    for index, part in enumerate(rig.printed)
                ),
            ),
        ),
    )


def rig_page(rig: Rig, section: Section, report: CheckReport, comparison: RigComparison) -> str:
    """Return the page about a rig as HTML."""
    x_min, y_min, x_max, y_max = (rig.options.scale * side for side in rig.plate.bounds)
    found = len(report.findings)
    words = (
        f"{counted(len(rig.parts), 'part')}; every file read back closed and oriented; assembled, "
        f"the walls differ from the map by {100 * comparison.share:.4f} %; "
        f"{counted(found, 'finding')}"
    )
    facts = (
        Fact("size", f"{x_max - x_min:.0f} x {y_max - y_min:.0f} mm"),
        Fact("scale", f"{rig.options.scale:.4g}"),
        Fact("obstacles", f"{rig.options.height_mm:g} mm high"),
        Fact("printer", rig.printer.name),
        Fact("volume", f"{rig.volume_mm3 / 1000.0:.0f} cm3 (computed)"),
    )
    blocks = (
        Answer(words, "bad" if found else "good"),
        *section.pictures[:1],
        Facts(facts),
        replace(section, pictures=section.pictures[1:]),
        check_section(report),
    )
    return page(f"{rig.name}: test rig", blocks)
