"""Drawings at true scale: paper markers to cut out, and the plan that a rig is laid onto.

One unit of the axes is one millimetre of paper. Each drawing carries a ruler of 100 mm, by which a
user sees whether a printer scaled the page.
"""

from collections.abc import Sequence

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from shapely import Polygon
from shapely.affinity import translate

from vinefab.model.map import Map
from vinefab.pages.colours import INK, SOFT
from vinefab.pages.drawing import fill_geometry
from vinefab.pages.figure import house_style, svg_bytes
from vinefab.rig.board import LoosePiece
from vinefab.rig.corner_tiles import MarkerPad, black_cells, paper_crop_mm
from vinefab.rig.fixtures import Fixtures, on_rig, outside_of
from vinefab.rig.part import Rig
from vinefab.rig.rig_plan import polygon_parts

A4_MM = (210.0, 297.0)
MM_PER_INCH = 25.4
MARGIN_MM = 15.0
RULER_MM = 100.0

UNSEEN_MM = 0.02
"""Walls are drawn to this: less than a printer's dot."""

_CROP_MM, _TEXT_MM, _CROSS_MM = 5.0, 14.0, 1.0
_CORNERS = ("lower left", "lower right", "upper right", "upper left")
_BLACK, _OBSTACLE = "#000000", "#d9dee2"


def true_scale_files(
    rig: Rig, world: Map, fixtures: Fixtures, pieces: Sequence[LoosePiece] = ()
) -> dict[str, bytes]:
    """Return the paper markers and the plan as SVG, by file name."""
    drawings = {"plan": plan_sheet(rig, world, fixtures, pieces)}
    if fixtures.pads:
        drawings["markers"] = marker_sheet(fixtures.pads)
    return {f"{name}.svg": svg_bytes(one, whole_page=True) for name, one in drawings.items()}


def marker_sheet(pads: Sequence[MarkerPad]) -> Figure:
    """Return the markers on one page, each with crop marks and the corner that it belongs to."""
    side_mm = paper_crop_mm(pads[0])
    pitch_mm = side_mm + 2.0 * _CROP_MM + _TEXT_MM
    wide_mm = max(A4_MM[0], 2.0 * pitch_mm + 2.0 * MARGIN_MM)
    high_mm = max(A4_MM[1], 2.0 * pitch_mm + 2.0 * MARGIN_MM + 60.0)
    with house_style():
        figure, axes = _page(wide_mm, high_mm)
        top = high_mm - MARGIN_MM
        axes.text(MARGIN_MM, top, "Corner markers", fontsize=12, va="top", color=INK)
        note = (
            "Print at 100 % (not fitted to the page) and measure the ruler. Cut along the crop "
            "marks;\nglue each marker into its place, upright as printed here when the map's north "
            "is up."
        )
        axes.text(MARGIN_MM, top - 7.0, note, fontsize=8, va="top", color=INK)
        _draw_ruler(axes, MARGIN_MM, MARGIN_MM)
        for pad in pads:
            right, upper = pad.marker.number in (1, 2), pad.marker.number in (2, 3)
            x_mm = 0.5 * wide_mm + (0.5 if right else -0.5) * pitch_mm
            y_mm = 0.5 * high_mm + (0.5 if upper else -0.5) * pitch_mm
            _draw_paper(axes, pad, (x_mm, y_mm), side_mm)
    return figure


def _draw_paper(axes: Axes, pad: MarkerPad, at_mm: tuple[float, float], side_mm: float) -> None:
    """Draw one marker with crop marks around its middle."""
    centre = pad.square.centroid
    shift = at_mm[0] - centre.x, at_mm[1] - centre.y
    _draw_cells(axes, pad, shift)
    half, lines = 0.5 * side_mm, []
    for x_sign in (-1.0, 1.0):
        for y_sign in (-1.0, 1.0):
            corner = np.array(at_mm) + half * np.array([x_sign, y_sign])
            for axis, sign in ((0, x_sign), (1, y_sign)):
                out = np.eye(2)[axis] * sign
                lines.append(np.array([corner + 1.0 * out, corner + _CROP_MM * out]))
    axes.add_collection(LineCollection(lines, colors=INK, linewidths=0.4))
    text = f"marker {pad.marker.number}: {_CORNERS[pad.marker.number]}"
    below = at_mm[1] - half - _CROP_MM
    axes.text(at_mm[0], below - 1.0, text, fontsize=8, ha="center", va="top", color=INK)


def _draw_cells(axes: Axes, pad: MarkerPad, shift: tuple[float, float] = (0.0, 0.0)) -> None:
    """Draw a marker's black cells, edges sharp: no line is drawn around them."""
    cells = shapely.union_all(black_cells(pad.marker.number, pad.square))
    fill_geometry(axes, [translate(cells, *shift)], face=_BLACK, edge="none", rank=5)


def plan_sheet(
    rig: Rig, world: Map, fixtures: Fixtures, pieces: Sequence[LoosePiece] = ()
) -> Figure:
    """Return the plan of a rig at true scale: walls, markers, base and ruler, to be laid below.

    Loose pieces are outlined one by one, with their numbers and the holes for their pegs: by them a
    board is drilled by hand.
    """
    plate = on_rig(rig.plate, rig, world)
    walls = shapely.simplify(on_rig(rig.walls, rig, world), UNSEEN_MM)
    around = outside_of(fixtures)
    x_min, y_min, x_max, y_max = shapely.union(plate, around).bounds
    foot_mm = 24.0
    low = np.array([x_min - MARGIN_MM, y_min - MARGIN_MM - foot_mm])
    wide_mm = max(x_max - x_min + 2.0 * MARGIN_MM, RULER_MM + 2.0 * MARGIN_MM)
    high_mm = y_max - y_min + 2.0 * MARGIN_MM + foot_mm
    with house_style():
        figure, axes = _page(wide_mm, high_mm)
        axes.set_xlim(low[0], low[0] + wide_mm)
        axes.set_ylim(low[1], low[1] + high_mm)
        inside = on_rig(Polygon(world.bounds.exterior), rig, world)
        fill_geometry(axes, [plate], face="none", edge=SOFT, rank=2)
        fill_geometry(axes, [around], face="none", edge=SOFT, rank=2)
        fill_geometry(axes, [inside], face="none", edge=INK, rank=3)
        fill_geometry(axes, list(polygon_parts(walls)), face=_OBSTACLE, edge=INK, rank=3)
        _draw_pieces(axes, pieces)
        for pad in fixtures.pads:
            _draw_cells(axes, pad)
        _draw_starts(axes, rig, world)
        _draw_ruler(axes, x_min, low[1] + MARGIN_MM)
        words = (
            f"{rig.name} at {rig.options.scale:.4g} of the map's size. Print at 100 % (as a "
            "poster) and measure the ruler."
        )
        axes.text(x_min, low[1] + MARGIN_MM - 4.0, words, fontsize=8, va="top", color=INK)
    return figure


def _draw_pieces(axes: Axes, pieces: Sequence[LoosePiece]) -> None:
    """Draw outline, number and pegs of loose pieces; a peg's middle is a small cross."""
    fill_geometry(axes, [piece.outline for piece in pieces], face="none", edge=INK, rank=4)
    pegs = [peg for piece in pieces for peg in piece.pegs]
    fill_geometry(axes, [peg.outline for peg in pegs], face="white", edge=INK, rank=4)
    lines = []
    for peg in pegs:
        x_mm, y_mm = peg.x_mm, peg.y_mm
        lines.append([(x_mm - _CROSS_MM, y_mm), (x_mm + _CROSS_MM, y_mm)])
        lines.append([(x_mm, y_mm - _CROSS_MM), (x_mm, y_mm + _CROSS_MM)])
    axes.add_collection(LineCollection(lines, colors=INK, linewidths=0.3, zorder=5))
    for piece in pieces:
        circle = shapely.maximum_inscribed_circle(piece.outline, 0.5)
        x_mm, y_mm = shapely.get_coordinates(circle)[0].tolist()
        axes.text(x_mm, y_mm, str(piece.number), fontsize=8, ha="center", va="center", color=INK)


def _draw_starts(axes: Axes, rig: Rig, world: Map) -> None:
    """Draw every start: the mouth of the trunk as a cross, and its heading."""
    lines: list[list[tuple[float, float]]] = []
    for start in world.starts:
        point = on_rig(shapely.Point(start.pose.x_mm, start.pose.y_mm), rig, world)
        x_mm, y_mm = point.centroid.x, point.centroid.y
        cos, sin = np.cos(start.pose.heading_rad), np.sin(start.pose.heading_rad)
        lines.append([(x_mm, y_mm), (x_mm + 20.0 * cos, y_mm + 20.0 * sin)])
        side = 5.0 * sin, -5.0 * cos
        lines.append([(x_mm + side[0], y_mm + side[1]), (x_mm - side[0], y_mm - side[1])])
    axes.add_collection(LineCollection(lines, colors=INK, linewidths=1.2, zorder=6))


def _draw_ruler(axes: Axes, x_mm: float, y_mm: float) -> None:
    """Draw a ruler of 100 mm with a tick every 10 mm."""
    ticks = [
        [(x_mm + at, y_mm), (x_mm + at, y_mm + (4.0 if at % 50.0 == 0.0 else 2.5))]
        for at in np.arange(0.0, RULER_MM + 1.0, 10.0).tolist()
    ]
    base = [[(x_mm, y_mm), (x_mm + RULER_MM, y_mm)]]
    axes.add_collection(LineCollection([*base, *ticks], colors=INK, linewidths=0.5, zorder=6))
    axes.text(x_mm + RULER_MM + 2.0, y_mm, "100 mm", fontsize=8, va="bottom", color=INK)


def _page(wide_mm: float, high_mm: float) -> tuple[Figure, Axes]:
    """Return a page whose axes fill it, in millimetres from its lower left corner."""
    figure = Figure(figsize=(wide_mm / MM_PER_INCH, high_mm / MM_PER_INCH))
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    axes.set_xlim(0.0, wide_mm)
    axes.set_ylim(0.0, high_mm)
    return figure, axes
