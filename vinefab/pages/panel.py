"""The drawing layer: panels hold primitives in millimetres (or a chart's units), pages place them.

A `Panel` is a plan or a chart: it maps its box to a rectangle on paper and knows its axes, title
and legend. A `Page` puts panels in rows and turns everything into primitives in points, y down.
`vinefab.pages.page_files` and `vinefab.pages.page_pdf` write those. Sizes of lines, signs and
letters are points; places are in the panel's units. Every label of a picture asks one `Labels` for
its place, so that none lies on another and few on what is drawn.
"""

import math
import unicodedata
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from textwrap import wrap
from typing import Literal

import numpy as np
import shapely
from numpy.typing import ArrayLike, NDArray
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import shortened
from vinefab.core.validation import Floats

INK = "#1d2a30"
SOFT = "#5c6b73"
ROCK = "#d3dade"
ROCK_EDGE = "#8b989f"
ALERT = "#c2185b"
START = "#2e7d4f"
START_SHADE = "#c4dacd"

LEVEL_COLOURS = ("#12355b", "#b8430a", "#1c9a9a", "#eab000", "#6d2a82", "#7cc0f0", "#5f6b12")
"""Colour of each level, trunk first; they repeat after the last.

Levels that meet differ in lightness as well as in hue: they stay apart in a grey print and for
colour-blind readers (tests/pages/test_drawing.py measures both).
"""

HEAT_COLOURS = ("#fdf1dc", "#f6b65c", "#d9622b", "#8c2155", "#14213d")
"""From seldom to always: from light to dark, so that a grey print shows the same order."""


def level_colour(level: int) -> str:
    """Return the colour of a level, counted from 1."""
    return LEVEL_COLOURS[(level - 1) % len(LEVEL_COLOURS)]


_FAR_PT = (1.5, 4.0, 8.0, 13.0, 19.0, 26.0, 34.0, 44.0, 58.0, 76.0)
"""Gaps tried between a place and its label."""

_ANGLES = np.radians(45.0 + 22.5 * np.arange(16))

_TAKEN, _LINE_COST, _OUTSIDE = 40.0, 0.8, 1000.0
"""Cost of each square point of taken area, of each point of a line, of leaving the page."""

_BETWEEN_PT, _CLEAR_PT = 2.0, 1.0
"""Least gaps, where labels have ways: from label to label, and from a way to anything."""


class Labels:
    """The labels of one picture: each takes the cheapest place that is left."""

    def __init__(
        self,
        *,
        page_pt: tuple[float, float, float, float] | None = None,
        lines_pt: Sequence[Floats] = (),
        taken: Sequence[BaseGeometry] = (),
    ) -> None:
        """Begin with the areas that labels keep off.

        Parameters
        ----------
        page_pt
            Left, lower, right and upper end of where labels may lie.
        lines_pt
            Lines that labels keep off where there is room elsewhere, shape (k, 2) each.
        taken
            What labels do not cover.
        """
        self.page = shapely.box(*page_pt) if page_pt else None
        # Stretch by stretch: a label meets few of them.
        ends = [np.stack([line[:-1], line[1:]], axis=1) for line in lines_pt if len(line) > 1]
        self.lines = shapely.STRtree([shapely.LineString(two) for line in ends for two in line])
        self.taken = list(taken)
        self.ways: list[BaseGeometry] = []

    def place(
        self, spots_pt: Floats, costs: Floats, size_pt: ArrayLike, *, line_cost: float = _LINE_COST
    ) -> int:
        """Take the cheapest of some spots, shape (n, 2), for the middle of a label; return its row.

        Parameters
        ----------
        costs
            What each spot costs by itself, points.
        line_cost
            Cost of a point of the lines.
        """
        boxes = boxes_around(spots_pt, size_pt)
        x0, y0, x1, y1 = shapely.total_bounds(boxes).tolist()
        near = shapely.STRtree(self.taken).query(shapely.box(x0, y0, x1, y1))
        covered = shapely.union_all([self.taken[one] for one in sorted(near.tolist())])
        hidden = shapely.area(shapely.intersection(boxes, covered))
        cost = np.asarray(costs, dtype=np.float64) + _TAKEN * hidden
        box, line = self.lines.query(boxes)
        crossed = shapely.length(shapely.intersection(boxes[box], self.lines.geometries[line]))
        cost += line_cost * np.bincount(box, crossed, minlength=len(boxes))
        if self.page is not None:
            cost += _OUTSIDE * ~shapely.covers(self.page, boxes)
        best = int(cost.argmin())
        self.taken.append(boxes[best])
        return best

    def place_with_way(
        self,
        spots_pt: Floats,
        costs: Floats,
        size_pt: ArrayLike,
        ways: NDArray[np.object_],
        own: int,
    ) -> int | None:
        """Take the cheapest free spot of a label to which a way leads; return its row.

        Parameters
        ----------
        ways
            The way to each spot. No way meets a label or another way.
        own
            Row in what was taken at first of the sign that the label belongs to.

        Returns
        -------
        int or None
            None if no spot is free.
        """
        boxes = boxes_around(spots_pt, size_pt)
        free = ~shapely.intersects(boxes, self.taken[own])
        free &= ~_meet(boxes, self.taken, _BETWEEN_PT, own) & ~_meet(boxes, self.ways, _CLEAR_PT)
        free &= ~_meet(ways, self.taken, _CLEAR_PT, own) & ~_meet(ways, self.ways, _CLEAR_PT)
        if self.page is not None:
            free &= shapely.covers(self.page, boxes)
        if not free.any():
            return None
        best = int(np.where(free, costs, np.inf).argmin())
        self.taken.append(boxes[best])
        self.ways.append(ways[best])
        return best


def label_middles(
    places_pt: Floats,
    sizes_pt: Floats,
    *,
    mark_pt: float = 3.0,
    lines_pt: Sequence[Floats] = (),
    page_pt: tuple[float, float, float, float] | None = None,
) -> Floats:
    """Return the middles of labels, shape (n, 2).

    Parameters
    ----------
    places_pt
        Places that the labels belong to, shape (n, 2).
    sizes_pt
        Width and height of each label, shape (n, 2).
    mark_pt
        Half the side of the mark at each place, which no label covers either.
    lines_pt, page_pt
        As of `Labels`.
    """
    marks = boxes_around(places_pt, (2.0 * mark_pt, 2.0 * mark_pt))
    labels = Labels(page_pt=page_pt, lines_pt=lines_pt, taken=list(marks))
    middles = np.empty_like(places_pt, dtype=float)
    far, towards = spots_around(_FAR_PT, _ANGLES)
    for row, (place, size) in enumerate(zip(places_pt, sizes_pt, strict=True)):
        spots = place + towards * (mark_pt + far[:, None] + size / 2.0)
        middles[row] = spots[labels.place(spots, far, size)]
    return middles


def spots_around(far_pt: Sequence[float], angles_rad: ArrayLike) -> tuple[Floats, Floats]:
    """Return every distance in every direction: distances, shape (n,), and units, shape (n, 2)."""
    far, angle = (
        grid.ravel() for grid in np.meshgrid(far_pt, np.asarray(angles_rad), indexing="ij")
    )
    return far, np.column_stack([np.cos(angle), np.sin(angle)])


def boxes_around(middles_pt: Floats, sizes_pt: ArrayLike) -> NDArray[np.object_]:
    """Return boxes around middles, shape (n, 2), of one size, shape (2,), or of one each."""
    half = np.asarray(sizes_pt) / 2.0
    return np.asarray(shapely.box(*(middles_pt - half).T, *(middles_pt + half).T))


def _meet(
    shapes: NDArray[np.object_], taken: Sequence[BaseGeometry], near_pt: float, but: int = -1
) -> NDArray[np.bool_]:
    """Tell for each shape whether it comes near an entry of a list, one of them left out."""
    inputs, met = shapely.STRtree(taken).query(shapes, predicate="dwithin", distance=near_pt)
    found = np.zeros(len(shapes), dtype=np.bool_)
    found[inputs[met != but]] = True
    return found


Box = tuple[float, float, float, float]
Anchor = Literal["start", "middle", "end"]

MOST_LETTERS, MOST_LINES = 120, 8  # of one text; longer ones leave no room for the picture


@dataclass(frozen=True, slots=True, kw_only=True)
class Ink:
    """Colours and line of a primitive; empty colours are not painted."""

    fill: str = ""
    fill_alpha: float = 1.0
    line: str = ""
    width_pt: float = 0.7
    line_alpha: float = 1.0
    dash_pt: tuple[float, ...] = ()
    butt: bool = False  # whether lines end where they end, without half a circle more


@dataclass(frozen=True, slots=True)
class Shape:
    """Rings, filled by the even-odd rule, or open lines."""

    chains: Sequence[Floats]
    ink: Ink
    closed: bool = False


@dataclass(frozen=True, slots=True)
class Marks:
    """A sign of one size (width, pt) at each of many points."""

    points: Floats
    sign: str  # a key of `SIGNS`, or "o" for a circle
    size_pt: float
    ink: Ink


@dataclass(frozen=True, slots=True)
class Words:
    """A line of text at a point."""

    at: tuple[float, float]
    text: str
    size_pt: float
    colour: str = INK
    anchor: Anchor = "start"
    shift_pt: tuple[float, float] = (0.0, 0.0)  # to the right and up; of the middle of its height
    turned: bool = False  # whether it runs upwards
    bold: bool = False
    halo: bool = False  # a white rim, to be read on top of lines


@dataclass(frozen=True, slots=True)
class Raster:
    """Pixels, red, green, blue and opacity, shape (rows, columns, 4), the top row first."""

    box: Box
    pixels: NDArray[np.uint8]


Primitive = Shape | Marks | Words | Raster

_X = ((-5, -2.5), (-2.5, -5), (0, -2.5), (2.5, -5), (5, -2.5), (2.5, 0), (5, 2.5), (2.5, 5),
      (0, 2.5), (-2.5, 5), (-5, 2.5), (-2.5, 0))  # fmt: skip
SIGNS: dict[str, Floats] = {
    "X": np.array(_X) / 10.0,
    "^": np.array([(0.0, -0.5), (0.5, 0.5), (-0.5, 0.5)]),
    "s": np.array([(-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5)]),
    "D": np.array([(0.0, -0.7), (0.7, 0.0), (0.0, 0.7), (-0.7, 0.0)]),
    "+": np.array([(-0.5, 0.0), (0.5, 0.0), (0.0, 0.0), (0.0, -0.5), (0.0, 0.5)]),
    "x": np.array([(-0.5, -0.5), (0.5, 0.5), (0.0, 0.0), (-0.5, 0.5), (0.5, -0.5)]),
}
"""Corners of each sign of width 1, y down; the last two are lines."""
OPEN_SIGNS = "+x"


# Advance widths of the letters from blank to tilde in DejaVu Sans, thousandths of its size.
_WIDTHS = [
    318, 401, 460, 838, 636, 950, 780, 275, 390, 390, 500, 838, 318, 361, 318, 337,
    636, 636, 636, 636, 636, 636, 636, 636, 636, 636, 337, 337, 838, 838, 838, 531,
    1000, 684, 686, 698, 770, 632, 575, 775, 752, 295, 295, 656, 557, 863, 748, 787,
    603, 787, 695, 635, 611, 732, 684, 989, 685, 611, 685, 390, 337, 390, 838, 500,
    500, 613, 635, 550, 635, 615, 352, 635, 634, 278, 278, 579, 278, 974, 634, 612,
    635, 635, 411, 521, 392, 634, 592, 818, 592, 592, 525, 636, 337, 636, 838,
]  # fmt: skip


_BOLD = 1.13  # bold letters are so much wider


def text_width(text: str, size_pt: float, *, bold: bool = False) -> float:
    """Return about how wide a text is, in points."""
    thousandths = 0
    for letter in text:
        if " " <= letter <= "~":
            thousandths += _WIDTHS[ord(letter) - 32]
        else:
            is_wide = letter == "…" or unicodedata.east_asian_width(letter) in "WF"
            thousandths += 1000 if is_wide else 750
    return (_BOLD if bold else 1.0) * thousandths * size_pt / 1000.0


def fitted(text: str, room_pt: float, size_pt: float, *, bold: bool = False) -> str:
    """Return a text in one line, cut to a width."""
    line = "".join(c if c.isprintable() else " " for c in text[:400])
    if len(line) == len(text) and text_width(line, size_pt, bold=bold) <= room_pt:
        return line
    room_pt -= text_width("…", size_pt, bold=bold)
    while line and text_width(line, size_pt, bold=bold) > room_pt:
        line = line[:-1]
    return f"{line.rstrip()}…"


# --- Panels ---------------------------------------------------------------------------------------

TICK_PT, TITLE_PT, NAME_PT = 8.25, 8.5, 9.0  # 8.25 pt are 11 px: smaller type is not readable
COLUMN_PT = 196.0  # longer side of a plan that takes a third of a page, or a phone's whole width
MIDDLE = 0.36  # from the base line to the middle of small letters, as a share of their size
_LINE = 1.35  # from one line of text to the next, as a share of its size


@dataclass(slots=True, kw_only=True)
class Panel:
    """One plan or chart: primitives in its own units, and the parts around them.

    Methods draw; what has a higher ``rank`` lies on top, of the same rank what came later. With a
    ``label`` the first such primitive stands in the legend.
    """

    box: Box  # least x, least y, greatest x, greatest y of the shown part
    width_pt: float
    height_pt: float
    x_name: str = ""
    y_name: str = ""
    title: str = ""  # lines above the panel
    title_colour: str = INK
    title_bold: bool = False
    x_ticks: Sequence[tuple[float, str]] | None = None  # None: round values
    y_ticks: Sequence[tuple[float, str]] | None = None
    tick_pt: float = TICK_PT
    frame: bool = False  # whether lines stand at the left and below, with a faint grid
    y_grid: bool = True
    legend_shown: bool = True
    bar: tuple[str, float, float, Sequence[str]] | None = None  # colour scale: name, ends, colours
    _drawn: list[tuple[float, Primitive]] = field(default_factory=list)
    _labelled: dict[str, Primitive] = field(default_factory=dict)

    # Where a place lies within the panel's rectangle, points to the right and down.
    def placed(self, points: ArrayLike) -> Floats:
        """Return places as points from the upper left corner of the panel, shape (n, 2)."""
        x0, y0, x1, y1 = self.box
        per = np.array([self.width_pt / (x1 - x0), -self.height_pt / (y1 - y0)])
        places: Floats = np.asarray(points, dtype=float).reshape(-1, 2)
        return np.asarray((places - (x0, y1)) * per)

    def add(self, primitive: Primitive, rank: float = 1.0, label: str = "") -> None:
        """Draw a primitive."""
        self._drawn.append((rank, primitive))
        if label:
            self._labelled.setdefault(label, primitive)

    def explain(self, label: str, primitive: Primitive) -> None:
        """Put an entry into the legend; it takes the place of one with the same words."""
        self._labelled[label] = primitive

    @property
    def legend(self) -> dict[str, Primitive]:
        """The entries of the legend; in a plan levels first, then by the alphabet."""
        if self.frame:
            return self._labelled
        return dict(sorted(self._labelled.items(), key=lambda e: (e[0][:5] != "level", e[0])))

    @property
    def primitives(self) -> list[Primitive]:
        """The primitives in their order of painting."""
        return [primitive for _, primitive in sorted(self._drawn, key=lambda pair: pair[0])]

    def polygons(
        self, shapes: Iterable[BaseGeometry], ink: Ink, *, rank: float = 1.0, label: str = ""
    ) -> None:
        """Fill polygons, holes left open, as one path: thousands of them stay quick and small."""
        parts = shapely.get_parts(list(shapes))
        solid = [part for part in parts if isinstance(part, Polygon) and not part.is_empty]
        if solid:
            # Holes run the other way round, for programs that do not know the even-odd rule.
            rings = shapely.get_rings(shapely.orient_polygons(solid))
            corners, ring = shapely.get_coordinates(rings, return_index=True)
            self.add(
                Shape(np.split(corners, np.flatnonzero(np.diff(ring)) + 1), ink, closed=True),
                rank,
                label,
            )

    def line(self, points: ArrayLike, ink: Ink, *, rank: float = 2.0, label: str = "") -> None:
        """Draw a line through points, shape (n, 2)."""
        self.lines([np.asarray(points, dtype=float).reshape(-1, 2)], ink, rank=rank, label=label)

    def lines(
        self, chains: Sequence[Floats], ink: Ink, *, rank: float = 2.0, label: str = ""
    ) -> None:
        """Draw several lines in one way."""
        self.add(Shape([chain for chain in chains if len(chain)], ink), rank, label)

    def band(
        self, x: ArrayLike, low: ArrayLike, high: ArrayLike, colour: str, alpha: float
    ) -> None:
        """Fill the area between two curves; values that are not finite are left out."""
        rows = np.array([np.asarray(values, dtype=float) for values in (x, low, high)])
        across, lower, upper = rows[:, np.isfinite(rows).all(axis=0)]
        ends = np.append(across, across[::-1]), np.append(upper, lower[::-1])
        if len(across):
            ring = np.column_stack(ends)
            self.add(Shape([ring], Ink(fill=colour, fill_alpha=alpha), closed=True), 1.0)

    def bars(
        self, boxes: Iterable[tuple[float, float, float, float]], colour: str, alpha: float
    ) -> None:
        """Fill rectangles: left, lower, right and upper end of each."""
        rings = [np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)]) for x0, y0, x1, y1 in boxes]
        self.add(Shape(rings, Ink(fill=colour, fill_alpha=alpha), closed=True), 1.5)

    def marks(
        self,
        points: ArrayLike,
        sign: str,
        size_pt: float,
        ink: Ink,
        *,
        rank: float = 3.0,
        label: str = "",
    ) -> None:
        """Draw a sign at each of some points, shape (n, 2)."""
        self.add(
            Marks(np.asarray(points, dtype=float).reshape(-1, 2), sign, size_pt, ink), rank, label
        )

    def words(
        self, at: tuple[float, float], text: str, size_pt: float = NAME_PT, **how: object
    ) -> None:
        """Write a line of text at a place."""
        self.add(Words(at, text, size_pt, **how), 9.0)  # type: ignore[arg-type]

    def written(
        self, at: tuple[float, float], text: str, size_pt: float = NAME_PT, **how: object
    ) -> float:
        """Write a line of text on a base line and return its width, in points."""
        self.words(at, text, size_pt, shift_pt=(0.0, MIDDLE * size_pt), **how)
        return text_width(text, size_pt, bold=bool(how.get("bold")))

    def boxed(
        self, at: tuple[float, float], text: str, size_pt: float, ink: Ink, **how: object
    ) -> None:
        """Write a line of text in the middle of a filled box that fits it."""
        wide = text_width(text, size_pt, bold=bool(how.get("bold"))) / 2.0 + 0.3 * size_pt
        across = wide * (self.box[2] - self.box[0]) / self.width_pt
        up = 0.7 * size_pt * (self.box[3] - self.box[1]) / self.height_pt
        (x, y), sides = at, np.array([(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0)])
        self.add(Shape([sides * (across, up) + (x, y)], ink, closed=True), 9.0)
        self.words(at, text, size_pt, anchor="middle", **how)

    def scale_bar(self, at: tuple[float, float], pt_per_mm: float, most_pt: float) -> float:
        """Draw a bar of a round length on paper, and return how far its words reach."""
        length_mm = round_length_mm(most_pt / pt_per_mm)
        (x, y), end = at, at[0] + length_mm * pt_per_mm
        ends = [(x, y), (x, y + 6), (x, y + 3), (end, y + 3), (end, y + 6), (end, y)]
        self.line(ends, Ink(line=INK, width_pt=1.2))
        return end + 6.0 + self.written((end + 6.0, y), f"{length_mm:g} mm", TICK_PT, colour=SOFT)

    def arrow(
        self, start: ArrayLike, end: ArrayLike, ink: Ink, head_pt: float, rank: float
    ) -> None:
        """Draw an arrow with a head of some length."""
        tail, tip = np.asarray(start, dtype=float), np.asarray(end, dtype=float)
        mm_per_pt = (self.box[2] - self.box[0]) / self.width_pt
        away = tip - tail
        along = away / max(1e-12, float(np.hypot(*away)))
        across = np.array([-along[1], along[0]])
        neck = tip - head_pt * mm_per_pt * along
        wing = 0.4 * head_pt * mm_per_pt * across
        self.line([tail, neck], replace(ink, butt=True), rank=rank)
        head = np.array([tip, neck + wing, neck - wing])
        self.add(Shape([head], Ink(fill=ink.line, fill_alpha=ink.line_alpha), closed=True), rank)

    def write_labels(
        self,
        places: ArrayLike,
        words: Sequence[str],
        colours: Sequence[str],
        *,
        size_pt: float,
        mark_pt: float = 3.0,
        lines: Sequence[Floats] = (),
    ) -> None:
        """Write a label next to each place, none on another and few on some lines.

        Parameters
        ----------
        places, lines
            In the panel's units, shape (n, 2) and (k, 2) each.
        """
        if not words:
            return
        at = self.placed(places)
        sizes = np.array([(text_width(text, size_pt) + 3.0, size_pt + 1.0) for text in words])
        page = (-12.0, -8.0, self.width_pt + 12.0, self.height_pt)
        middles = label_middles(
            at, sizes, mark_pt=mark_pt, lines_pt=[self.placed(one) for one in lines], page_pt=page
        )
        here = np.asarray(places, dtype=float).reshape(-1, 2)
        mm_per_pt = np.array(
            [
                (self.box[2] - self.box[0]) / self.width_pt,
                (self.box[1] - self.box[3]) / self.height_pt,
            ]
        )
        leader_pt = 9.0  # from this gap on a line leads to the label
        for place, offset, size, text, colour in zip(
            here, middles - at, sizes, words, colours, strict=True
        ):
            gap = float(np.hypot(*np.maximum(np.abs(offset) - size / 2.0, 0.0)))
            if gap > leader_pt:
                towards = offset / np.hypot(*offset)
                ends = [place + mm_per_pt * towards * mark_pt, place + mm_per_pt * offset]
                self.line(ends, Ink(line=SOFT, width_pt=0.5), rank=8.9)
            self.words(
                (float(place[0]), float(place[1])), text, size_pt, colour=colour,
                anchor="middle", shift_pt=(float(offset[0]), -float(offset[1])), halo=True,
            )  # fmt: skip

    def ticks(self, axis: int) -> Sequence[tuple[float, str]]:
        """Return the ticks of an axis, 0 across and 1 upwards: values and words."""
        chosen = self.y_ticks if axis else self.x_ticks
        if chosen is not None:
            return chosen
        low, high = sorted((self.box[axis], self.box[axis + 2]))
        room_pt = self.height_pt / 28.0 if axis else self.width_pt / 48.0
        return round_ticks(low, high, max(2.0, min(9.0, room_pt)))


def round_ticks(low: float, high: float, most: float) -> list[tuple[float, str]]:
    """Return round values between two, at most so many, with words of as many digits as needed."""
    step = round_step((high - low) / most)
    values = step * np.arange(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    return [(float(value), f"{value + 0.0:.{digits}f}") for value in np.round(values, 12)]


def round_length_mm(most_mm: float) -> float:
    """Return the largest of 1, 2, 5, 10, ... millimetres that is at most so long.

    Examples
    --------
    >>> round_length_mm(130.0)
    100.0
    """
    power = 10.0 ** math.floor(math.log10(most_mm))
    return float(max(step * power for step in (1.0, 2.0, 5.0) if step * power <= most_mm * 1.001))


def round_step(least: float) -> float:
    """Return the smallest of 1, 2, 5, 10, ... times a power of ten that is not below a number."""
    power = 10.0 ** math.floor(math.log10(max(least, 1e-12)))
    return next(power * n for n in (1.0, 2.0, 5.0, 10.0) if power * n >= least * (1 - 1e-9))


def plan_panel(box_mm: Box, longest_pt: float = 468.0) -> Panel:
    """Return a panel for a plan: equal scales, millimetres."""
    wide, high = max(box_mm[2] - box_mm[0], 1e-9), max(box_mm[3] - box_mm[1], 1e-9)
    margin = 0.02 * max(wide, high)
    per_mm = longest_pt / (max(wide, high) + 2.0 * margin)
    # A flat box keeps some height, a slim one some width: room for its ticks and words.
    x_more = max(margin, (160.0 / per_mm - wide) / 2.0)
    y_more = max(margin, (60.0 / per_mm - high) / 2.0)
    shown = (box_mm[0] - x_more, box_mm[1] - y_more, box_mm[2] + x_more, box_mm[3] + y_more)
    return Panel(
        box=shown,
        width_pt=per_mm * (shown[2] - shown[0]),
        height_pt=per_mm * (shown[3] - shown[1]),
        x_name="x (mm)",
        y_name="y (mm)",
    )


# --- Pages ----------------------------------------------------------------------------------------

_BAR_PT, _BAR_GAP_PT = 9.0, 10.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Layer:
    """Primitives in points of the page, y down; cut off outside of a rectangle, if one is set."""

    primitives: Sequence[Primitive]
    window: Box | None = None  # left, upper, right, lower end
    name: str = ""  # by which programs that read a PDF know it


@dataclass(frozen=True, slots=True, kw_only=True)
class Page:
    """A picture: layers on white paper, sizes in points."""

    width_pt: float
    height_pt: float
    layers: Sequence[Layer]
    panels: Sequence[Panel] = ()  # what it was put together from


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PageView:
    """From millimetres of a plan to points of a page."""

    low_mm: Floats
    pt_per_mm: float
    corner_pt: Floats

    @classmethod
    def into(cls, box_mm: Box, box_pt: Box) -> "PageView":
        """Return the view that shows a box of the plan in the middle of a box of the page."""
        low, high = np.array(box_mm[:2]), np.array(box_mm[2:])
        size, room = np.maximum(high - low, 1e-3), np.array(box_pt[2:]) - np.array(box_pt[:2])
        scale = float((room / size).min())
        corner = np.array(box_pt[:2]) + (room - size * scale) / 2.0
        return PageView(low_mm=low, pt_per_mm=scale, corner_pt=corner)

    def points(self, places_mm: Floats) -> Floats:
        """Return places on the page."""
        return np.asarray((places_mm - self.low_mm) * self.pt_per_mm + self.corner_pt)


def paper(wide_pt: float, high_pt: float) -> Panel:
    """Return an empty sheet whose units are points from its lower left corner."""
    box = (0.0, 0.0, wide_pt, high_pt)
    return Panel(box=box, width_pt=wide_pt, height_pt=high_pt, x_ticks=(), y_ticks=())


def page_of_paper(panel: Panel) -> Page:
    """Return a page that a panel fills, with nothing around it: also drawings at true scale."""
    drawn = [_moved(primitive, panel, np.zeros(2)) for primitive in panel.primitives]
    layers = [Layer(primitives=drawn)]
    return Page(width_pt=panel.width_pt, height_pt=panel.height_pt, layers=layers, panels=[panel])


def page_of(*panels: Panel) -> Page:
    """Return a page with panels in one row."""
    return page_of_rows([panels])


def page_of_rows(
    rows: Sequence[Sequence[Panel]], legend: dict[str, Primitive] | None = None
) -> Page:
    """Return a page with rows of panels, columns flush, and perhaps one legend for all below."""
    around = [[_margins(panel) for panel in row] for row in rows]
    columns = max(len(row) for row in rows)

    # The last panel of a shorter row may reach over the columns to its right.
    counted = [
        [
            (row[column], margins[column])
            for row, margins in zip(rows, around, strict=True)
            if column < len(row) - (len(row) < columns)
        ]
        for column in range(columns)
    ]
    left = [max(m[column][0] for m in around if column < len(m)) for column in range(columns)]
    right = [max(margins[2] for _, margins in column) for column in counted]
    wide = [max(panel.width_pt for panel, _ in column) for column in counted]
    pad = 6.0
    begin = [pad + sum(left[:c]) + sum(wide[:c]) + sum(right[:c]) for c in range(columns)]
    width_pt = begin[-1] + left[-1] + wide[-1] + right[-1] + pad
    for row, margins in zip(rows, around, strict=True):
        last = len(row) - 1
        width_pt = max(width_pt, begin[last] + left[last] + row[last].width_pt + margins[last][2])
    layers, top_pt = list[Layer](), pad
    for row, margins in zip(rows, around, strict=True):
        head = max(margin[1] for margin in margins)
        feet = [0.0]
        for column, panel in enumerate(row):
            x = begin[column] + left[column]
            layers += _panel_layers(panel, x, top_pt + head)
            foot = margins[column][3]
            if panel.legend_shown and panel.legend:
                across = (begin[column], width_pt if len(row) == 1 else x + panel.width_pt)
                below = top_pt + head + panel.height_pt + foot + 4.0
                entries, high = _legend(panel.legend, across, below)
                layers.append(Layer(primitives=entries))
                foot += high + 4.0
            feet.append(head + panel.height_pt + foot)
        top_pt += max(feet) + pad
    if legend:
        entries, high = _legend(legend, (pad, width_pt - pad), top_pt)
        layers.append(Layer(primitives=entries))
        top_pt += high + pad
    every = [panel for row in rows for panel in row]
    return Page(width_pt=width_pt, height_pt=top_pt, layers=layers, panels=every)


def _lines_of(text: str) -> list[str]:
    return [shortened(line, MOST_LETTERS) for line in text.split("\n")[:MOST_LINES]] if text else []


def _margins(panel: Panel) -> tuple[float, float, float, float]:
    """Return the room that axes, names and title take: left, above, right, below."""
    size = panel.tick_pt
    y_ticks, x_ticks = panel.ticks(1), panel.ticks(0)
    left = max((text_width(words, size) for _, words in y_ticks), default=-4.0) + 5.0
    left += NAME_PT * _LINE * len(_lines_of(panel.y_name)) + 2.0
    above = TITLE_PT * _LINE * len(_lines_of(panel.title)) + (3.0 if panel.title else 1.0)
    below = (size * _LINE + 4.0 if x_ticks else 0.0) + NAME_PT * _LINE * len(
        _lines_of(panel.x_name)
    )
    last = max((text_width(words, size) / 2.0 for _, words in x_ticks), default=0.0)
    right = max(4.0, last - 4.0)
    if panel.bar:
        ends = round_ticks(panel.bar[1], panel.bar[2], 6)
        right = _BAR_GAP_PT + _BAR_PT + 6.0 + NAME_PT * _LINE * len(_bar_name(panel))
        right += max((text_width(words, size) for _, words in ends), default=0.0)
    titles = max((text_width(line, TITLE_PT) for line in _lines_of(panel.title)), default=0.0)
    return left, above, max(right, titles - panel.width_pt), below


def _panel_layers(panel: Panel, x: float, y: float) -> list[Layer]:
    """Return a panel as layers, its upper left corner at a place of the page."""
    at = np.array([x, y])
    wide, high = panel.width_pt, panel.height_pt
    x_ticks = [(panel.placed([(v, panel.box[1])])[0, 0] + x, w) for v, w in panel.ticks(0)]
    y_ticks = [(panel.placed([(panel.box[0], v)])[0, 1] + y, w) for v, w in panel.ticks(1)]
    low, size = y + high, panel.tick_pt
    around = list[Primitive]()
    if panel.frame:
        grid = [np.array([(t, y), (t, low)]) for t, _ in x_ticks]
        grid += [np.array([(x, t), (x + wide, t)]) for t, _ in y_ticks if panel.y_grid]
        around.append(Shape(grid, Ink(line=SOFT, line_alpha=0.15, width_pt=0.8)))
        edges = [np.array([(x, low), (x + wide, low)])]
        if panel.y_grid:
            edges.append(np.array([(x, y), (x, low)]))
        around.append(Shape(edges, Ink(line=SOFT, width_pt=0.8)))
    notches = [np.array([(t, low), (t, low + 3.0)]) for t, _ in x_ticks]
    notches += [np.array([(x - 3.0, t), (x, t)]) for t, _ in y_ticks]
    around.append(Shape(notches, Ink(line=SOFT, width_pt=0.7)))
    below = low + 4.0 + 0.7 * size
    around += [Words((t, below), words, size, SOFT, "middle") for t, words in x_ticks]
    around += [Words((x - 5.0, t), words, size, SOFT, "end") for t, words in y_ticks]
    below += 0.65 * size + 0.75 * NAME_PT if x_ticks else 0.3 * NAME_PT
    for number, line in enumerate(_lines_of(panel.x_name)):
        place = (x + wide / 2.0, below + number * _LINE * NAME_PT)
        around.append(Words(place, line, NAME_PT, INK, "middle"))
    names = _lines_of(panel.y_name)
    beside = x - 7.0 - max((text_width(words, size) for _, words in y_ticks), default=-4.0)
    for number, line in enumerate(reversed(names)):
        place = (beside - (number + 0.5) * _LINE * NAME_PT, y + high / 2.0)
        around.append(Words(place, line, NAME_PT, INK, "middle", turned=True))
    for number, line in enumerate(reversed(_lines_of(panel.title))):
        place = (x, y - 3.0 - (number + 0.5) * _LINE * TITLE_PT)
        around.append(Words(place, line, TITLE_PT, panel.title_colour, bold=panel.title_bold))
    if panel.bar:
        around += _colour_bar(panel, x + wide + _BAR_GAP_PT, y + 0.1 * high)
    inside = [_moved(primitive, panel, at) for primitive in panel.primitives]
    # Signs and labels may reach over the edge, as they stand at places inside; the rest may not.
    free = [one for one in inside if isinstance(one, Words)]
    cut = [one for one in inside if not isinstance(one, Words)]
    rim = 0.0 if not panel.frame else 5.0
    window = (x - rim, y - rim, x + wide + rim, low + rim)
    return [Layer(primitives=around), Layer(primitives=cut, window=window), Layer(primitives=free)]


def _moved(primitive: Primitive, panel: Panel, at: Floats) -> Primitive:
    """Return a primitive in points of the page."""
    if isinstance(primitive, Shape):
        return replace(primitive, chains=[panel.placed(c) + at for c in primitive.chains])
    if isinstance(primitive, Marks):
        return replace(primitive, points=panel.placed(primitive.points) + at)
    if isinstance(primitive, Words):
        x, y = (panel.placed([primitive.at])[0] + at).tolist()
        return replace(primitive, at=(x, y))
    (x0, y0), (x1, y1) = panel.placed([primitive.box[:2], primitive.box[2:]]) + at
    return replace(primitive, box=(float(x0), float(y1), float(x1), float(y0)))


def _bar_name(panel: Panel) -> list[str]:
    """Return the name of the scale of colours, in lines no longer than the panel is high."""
    name = "" if panel.bar is None else panel.bar[0]
    fits = panel.height_pt / max(text_width(name, NAME_PT), panel.height_pt)
    return wrap(name, max(1, int(fits * len(name)))) if name else []


def _colour_bar(panel: Panel, x: float, top: float) -> list[Primitive]:
    """Return the scale of colours at the right of a panel."""
    if panel.bar is None:
        return []
    _, low, high, colours = panel.bar
    tall, steps = 0.8 * panel.height_pt, 64
    pixels = blended(np.linspace(1.0, 0.0, steps), colours)[:, None, :]
    ticks = round_ticks(low, high, 6)
    at = [top + tall * (1.0 - (value - low) / (high - low)) for value, _ in ticks]
    notches = [np.array([(x + _BAR_PT, t), (x + _BAR_PT + 3.0, t)]) for t in at]
    words = max((text_width(text, panel.tick_pt) for _, text in ticks), default=0.0)
    side = x + _BAR_PT + 8.0 + words + 0.5 * NAME_PT
    return [
        Raster((x, top, x + _BAR_PT, top + tall), pixels),
        Shape(notches, Ink(line=SOFT, width_pt=0.7)),
        *(
            Words((x + _BAR_PT + 5.0, t), text, panel.tick_pt, SOFT)
            for t, (_, text) in zip(at, ticks, strict=True)
        ),
        *(
            Words((side + number * _LINE * NAME_PT, top + tall / 2.0), line, NAME_PT, INK,
                  "middle", turned=True)
            for number, line in enumerate(_bar_name(panel))
        ),
    ]  # fmt: skip


def blended(shares: ArrayLike, colours: Sequence[str]) -> NDArray[np.uint8]:
    """Return colours on the way through some, at shares from 0 to 1; what is not finite is clear.

    The shape is that of the shares with 4 more.
    """
    shares = np.asarray(shares, dtype=float)
    known = np.isfinite(shares)
    places = np.linspace(0.0, 1.0, len(colours))
    stops = np.array([rgb(colour) for colour in colours])
    at = np.clip(np.where(known, shares, 0.0), 0.0, 1.0)
    channels = [np.interp(at, places, stops[:, channel]) for channel in range(3)]
    return np.stack([*channels, 255.0 * known], axis=-1).round().astype(np.uint8)


def photo(pixels: NDArray[np.uint8], box: Box) -> Raster:
    """Return a photo, grey or in colours, as a primitive."""
    shades = pixels if pixels.ndim == 3 else np.repeat(pixels[:, :, None], 3, axis=2)
    opaque = np.full((*shades.shape[:2], 1), 255)
    return Raster(box, np.concatenate([shades[:, :, :3], opaque], axis=2).astype(np.uint8))


def rgb(colour: str) -> tuple[int, int, int]:
    """Return red, green and blue of ``#rrggbb``, or of white and black."""
    text = {"white": "#ffffff", "black": "#000000"}.get(colour, colour)
    return int(text[1:3], 16), int(text[3:5], 16), int(text[5:7], 16)


_LEGEND_PT, _SYMBOL_PT = TICK_PT, 16.0


def _legend(
    entries: dict[str, Primitive], across: tuple[float, float], top: float
) -> tuple[list[Primitive], float]:
    """Return symbols and words in rows from a height on down, and how high they are."""
    texts = [shortened(words, MOST_LETTERS) for words in entries]
    each = [text_width(words, _LEGEND_PT) + _SYMBOL_PT + 14.0 for words in texts]
    columns = max(1, min(4, len(texts), int((across[1] - across[0]) // max(each))))
    # Where one long entry leaves no room for a second column, entries follow each other as words.
    wides = each if columns == 1 else [max(each)] * len(each)
    drawn, x, row = list[Primitive](), across[0], 0
    for number, (words, wide, primitive) in enumerate(
        zip(texts, wides, entries.values(), strict=True)
    ):
        full = x + wide > across[1] + 9.0 if columns == 1 else number % columns == 0
        if number and full:
            x, row = across[0], row + 1
        y = top + _LINE * _LEGEND_PT * (row + 0.5)
        drawn.append(_symbol(primitive, x, y))
        drawn.append(Words((x + _SYMBOL_PT + 5.0, y), words, _LEGEND_PT, INK))
        x += wide
    return drawn, _LINE * _LEGEND_PT * (row + 1)


def _symbol(primitive: Primitive, x: float, y: float) -> Primitive:
    """Return the symbol of a primitive in the legend."""
    if isinstance(primitive, Marks):
        return replace(primitive, points=np.array([(x + _SYMBOL_PT / 2.0, y)]))
    if isinstance(primitive, Shape) and primitive.closed:
        ring = [(x, y - 3.5), (x + _SYMBOL_PT, y - 3.5), (x + _SYMBOL_PT, y + 3.5), (x, y + 3.5)]
        return replace(primitive, chains=[np.array(ring)])
    ink = primitive.ink if isinstance(primitive, Shape) else Ink(line=INK)
    return Shape([np.array([(x, y), (x + _SYMBOL_PT, y)])], ink)


# --- Charts ---------------------------------------------------------------------------------------


def series_colour(index: int) -> str:
    """Return the colour of a series, counted from 0; they repeat."""
    return LEVEL_COLOURS[index % len(LEVEL_COLOURS)]


def ends_of(*values: ArrayLike, rim: float = 0.05) -> tuple[float, float]:
    """Return the ends of an axis that shows some values, with a rim; what is not finite is out."""
    every = np.concatenate([np.asarray(some, dtype=float).ravel() for some in values])
    every = every[np.isfinite(every)]
    if not len(every):
        return 0.0, 1.0
    low, high = float(every.min()), float(every.max())
    room = rim * (high - low) or 0.05 * abs(high) or 1.0
    return low - room, high + room


def curve(panel: Panel, x: ArrayLike, y: ArrayLike, colour: str, label: str = "") -> None:
    """Draw a line with a dot at every value; gaps where values are not finite."""
    points = np.column_stack([np.asarray(x, dtype=float), np.asarray(y, dtype=float)])
    points = points[np.isfinite(points).all(axis=1)]
    panel.line(points, Ink(line=colour, width_pt=1.5), label=label)
    panel.marks(points, "o", 5.0, Ink(fill=colour))


def jitter(count: int) -> Floats:
    """Return a fixed, even jitter from -1 to 1: dots on top of each other cannot be counted."""
    return ((np.arange(count) % 5) - 2) / 2.0


def upright(panel: Panel, x: float, ends: Sequence[float], colour: str, width_pt: float) -> None:
    """Draw a short line across a row at a value."""
    panel.line([(x, ends[0]), (x, ends[1])], Ink(line=colour, width_pt=width_pt, butt=True))
