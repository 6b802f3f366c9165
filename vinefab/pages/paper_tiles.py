"""A drawing at true scale on several sheets of paper, which are printed and put together.

Every sheet is a window onto the drawing. Windows of neighbours overlap, and the same crosses are
printed in the middle of the overlap on both sheets::

    +---------------+ - - +      o  crosses: the corners of the grid
    |  o . . . . o  |  .  |
    |  .         .  |     |      Two sheets lie right when their crosses lie on each other.
    |  o . . . . o  |  .  |
    +---------------+ - - +

The sheets are numbered by rows from the top and columns from the left. A place where nothing is
drawn has none. The first sheet shows the whole, small, and says how the others are put together.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from textwrap import wrap

import numpy as np
import shapely

from vinefab.core.errors import UnknownNameError
from vinefab.core.plain_text import counted, one_line
from vinefab.pages.panel import INK, SOFT, Box, Ink, Page, Panel, Shape, fitted, page_of_paper
from vinefab.pages.true_scale import A4_MM, PT_PER_MM, draw_ruler, true_scale

PAPERS = {"a4": A4_MM, "letter": (215.9, 279.4)}
"""Width and height of a sheet of paper by its name, upright, in mm."""

PAPER_TITLES = {"a4": "A4", "letter": "US letter"}
"""How texts name each paper."""

OVERLAP_MM = 10.0
"""By which the windows of neighbours overlap."""

CROSS_MM = 8.0
"""Width and height of a cross."""

EDGE_MM = 10.0
"""Edge of a sheet that stays white: printers do not reach it (assumed)."""

_HEAD_MM, _FOOT_MM = 6.0, 9.0
_TITLE_PT, _TEXT_PT, _LINE_MM = 11.0, 8.25, 4.2
_CROSS, _WINDOW = Ink(line=INK, width_pt=0.4), Ink(line=SOFT, width_pt=0.3, dash_pt=(2.0, 3.0))

Tile = tuple[int, int]
"""Row from the top and column from the left of a sheet, from 0."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperSheet:
    """One sheet of paper: a window onto a drawing, with crosses and words around it."""

    page: Page  # crosses, ruler and words
    window_mm: Box  # in which the drawing is seen, from the lower left corner of the paper
    shift_mm: tuple[float, float]  # where the drawing's lower left corner lies on the paper
    scale: float = 1.0  # of the drawing; 1: true


@dataclass(frozen=True, slots=True, kw_only=True)
class PaperGrid:
    """How sheets of paper lie on a drawing."""

    paper_mm: tuple[float, float]  # width and height of a sheet as it is printed
    low_mm: tuple[float, float]  # lower left corner of the grid on the drawing
    pitch_mm: tuple[float, float]  # from sheet to sheet
    rows: int
    columns: int

    @classmethod
    def over(cls, box_mm: Box, paper: str) -> "PaperGrid":
        """Return the grid with the fewest sheets over a box, upright or across.

        Raises
        ------
        UnknownNameError
            If there is no such paper.
        """
        if paper not in PAPERS:
            raise UnknownNameError("paper", paper, set(PAPERS))
        upright = PAPERS[paper]
        grids = [cls._of(box_mm, size) for size in (upright, (upright[1], upright[0]))]
        return min(grids, key=lambda grid: grid.rows * grid.columns)

    @classmethod
    def _of(cls, box_mm: Box, paper_mm: tuple[float, float]) -> "PaperGrid":
        wide, high = paper_mm[0] - 2.0 * EDGE_MM, paper_mm[1] - 2.0 * EDGE_MM - _HEAD_MM - _FOOT_MM
        pitch = wide - OVERLAP_MM, high - OVERLAP_MM
        sides = box_mm[2] - box_mm[0], box_mm[3] - box_mm[1]
        columns, rows = (
            max(1, math.ceil(side / step)) for side, step in zip(sides, pitch, strict=True)
        )
        middle = (box_mm[0] + box_mm[2]) / 2.0, (box_mm[1] + box_mm[3]) / 2.0
        low = middle[0] - columns * pitch[0] / 2.0, middle[1] - rows * pitch[1] / 2.0
        return cls(paper_mm=paper_mm, low_mm=low, pitch_mm=pitch, rows=rows, columns=columns)

    @property
    def tiles(self) -> list[Tile]:
        """All places of sheets, row by row."""
        return [(row, column) for row in range(self.rows) for column in range(self.columns)]

    def cell_mm(self, tile: Tile) -> Box:
        """Return the cell of a sheet on the drawing: its crosses are the corners."""
        row, column = tile
        x = self.low_mm[0] + column * self.pitch_mm[0]
        y = self.low_mm[1] + (self.rows - 1 - row) * self.pitch_mm[1]
        return x, y, x + self.pitch_mm[0], y + self.pitch_mm[1]

    def window_mm(self, tile: Tile) -> Box:
        """Return what a sheet shows of the drawing."""
        x0, y0, x1, y1 = self.cell_mm(tile)
        half = OVERLAP_MM / 2.0
        return x0 - half, y0 - half, x1 + half, y1 + half

    def used(self, drawing: Page) -> list[Tile]:
        """Return the sheets that show something; all of them, should the others fall apart."""
        lines = [
            chain / PT_PER_MM * (1.0, -1.0) + (0.0, drawing.height_pt / PT_PER_MM)
            for layer in drawing.layers
            for primitive in layer.primitives
            if isinstance(primitive, Shape)
            for chain in primitive.chains
            if len(chain) > 1
        ]
        tree = shapely.STRtree([shapely.LineString(line) for line in lines])
        seen = [
            tile
            for tile in self.tiles
            if len(tree.query(shapely.box(*self.window_mm(tile)), predicate="intersects"))
        ]
        return seen if seen and _hang_together(seen) else self.tiles


def _hang_together(tiles: Sequence[Tile]) -> bool:
    """Whether sheets meet edge to edge, so that every one has a neighbour to be aligned with."""
    left, border = set(tiles[1:]), [tiles[0]]
    while border:
        row, column = border.pop()
        near = {(row + 1, column), (row - 1, column), (row, column + 1), (row, column - 1)} & left
        left -= near
        border += near
    return not left


def paper_sheets(
    drawing: Page, box_mm: Box, paper: str, title: str, notes: Sequence[str] = ()
) -> list[PaperSheet]:
    """Return the sheets of a drawing at true scale, the overview first.

    Parameters
    ----------
    drawing
        At true scale.
    box_mm
        The part to be shown, from the drawing's lower left corner, y up.
    paper
        A name of `PAPERS`.
    title
        Words over every sheet.
    notes
        Sentences for the overview.

    Raises
    ------
    UnknownNameError
        If there is no such paper.
    """
    grid = PaperGrid.over(box_mm, paper)
    used = grid.used(drawing)
    title = one_line(title)
    return [
        _overview(grid, used, title, notes),
        *(_sheet(grid, used, number, title) for number in range(1, len(used) + 1)),
    ]


def tile_name(tile: Tile) -> str:
    """Return the name of a sheet: row and column from 1."""
    return f"{tile[0] + 1}-{tile[1] + 1}"


def _sheet(grid: PaperGrid, used: Sequence[Tile], number: int, title: str) -> PaperSheet:
    tile, half = used[number - 1], OVERLAP_MM / 2.0
    wide, high = grid.paper_mm
    panel = true_scale((0.0, 0.0, wide, high))
    left, low = EDGE_MM, EDGE_MM + _FOOT_MM
    right, top = left + grid.pitch_mm[0] + OVERLAP_MM, low + grid.pitch_mm[1] + OVERLAP_MM
    place = f"row {tile[0] + 1}, column {tile[1] + 1}: sheet {number} of {len(used)}"
    room_pt = PT_PER_MM * (right - left) - 200.0
    panel.words((left, top + 3.0), fitted(title, room_pt, _TEXT_PT), _TEXT_PT)
    panel.words((right, top + 3.0), place, _TITLE_PT, anchor="end", bold=True)
    draw_ruler(panel, left, EDGE_MM + 1.0)
    print_words = "Printed at 100 %, the ruler measures 100 mm"
    panel.words((right, EDGE_MM + 2.0), print_words, _TEXT_PT, anchor="end")
    ring = np.array([(left, low), (right, low), (right, top), (left, top), (left, low)])
    panel.line(ring, _WINDOW)
    if len(grid.tiles) > 1:
        row, column = tile
        for x, across in ((left + half, 0), (right - half, 1)):
            for y, down in ((low + half, 1), (top - half, 0)):
                node = f"{row + down + 1}.{column + across + 1}"
                _draw_cross(panel, (x, y), node)
    x0, y0, *_ = grid.window_mm(tile)
    return PaperSheet(
        page=page_of_paper(panel),
        window_mm=(left, low, right, top),
        shift_mm=(left - x0, low - y0),
    )


def _draw_cross(panel: Panel, at_mm: tuple[float, float], name: str) -> None:
    (x, y), half = at_mm, CROSS_MM / 2.0
    lines = [np.array([(x - half, y), (x + half, y)]), np.array([(x, y - half), (x, y + half)])]
    panel.lines(lines, _CROSS)
    panel.words((x + 1.0, y + 2.0), name, 5.5)


def _overview(
    grid: PaperGrid, used: Sequence[Tile], title: str, notes: Sequence[str]
) -> PaperSheet:
    """Return the first sheet: the whole in small, with the names of the sheets, and words."""
    wide, high = grid.paper_mm
    panel = true_scale((0.0, 0.0, wide, high))
    room_mm = wide - 2.0 * EDGE_MM
    top = high - EDGE_MM - 4.0
    panel.words((EDGE_MM, top), fitted(title, PT_PER_MM * room_mm, _TITLE_PT), _TITLE_PT, bold=True)
    letters = int(PT_PER_MM * room_mm / (0.55 * _TEXT_PT))
    lines = [line for words in (*_how_to(used), *notes) for line in wrap(words, letters)]
    for row, line in enumerate(lines):
        panel.words((EDGE_MM, top - 7.0 - row * _LINE_MM), line, _TEXT_PT)
    head_mm = 11.0 + len(lines) * _LINE_MM
    low = EDGE_MM + _FOOT_MM
    sides = grid.columns * grid.pitch_mm[0], grid.rows * grid.pitch_mm[1]
    scale = min(room_mm / sides[0], (top - head_mm - low) / sides[1])
    left, upper = EDGE_MM, top - head_mm
    shift = left - scale * grid.low_mm[0], upper - scale * (grid.low_mm[1] + sides[1])
    for tile in grid.tiles:
        if tile not in used:
            continue
        x0, y0, x1, y1 = (
            scale * side + shift[number % 2] for number, side in enumerate(grid.cell_mm(tile))
        )
        panel.line([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)], _CROSS)
        panel.words((x0 + 1.5, y1 - 2.5), tile_name(tile), _TEXT_PT, bold=True)
    draw_ruler(panel, EDGE_MM, EDGE_MM + 1.0)
    window = left, upper - scale * sides[1], left + scale * sides[0], upper
    return PaperSheet(page=page_of_paper(panel), window_mm=window, shift_mm=shift, scale=scale)


def _how_to(used: Sequence[Tile]) -> Iterator[str]:
    """Yield how sheets are printed and put together."""
    yield (
        f"{counted(len(used), 'sheet')}, named by row and column. Print at 100 % (actual size, no "
        "fitting to the page) and measure the ruler of 100 mm on every sheet. If it is off by more "
        "than 0.5 mm, print again."
    )
    if len(used) > 1:
        yield (
            "Cut each sheet along the dashed line at its right and lower edge. Lay it onto its "
            "neighbours so that crosses of one name lie on each other, against a window or a lamp, "
            "and tape."
        )
