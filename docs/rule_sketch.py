"""The hand that draws rules and words: a sketch in millimetres with dimensions and labels.

The case that breaks a rule stands left or above, the case that keeps it next to it. Both have one
scale. Text is as large as the page's own on a telephone, and the paper is white under every theme
of the site.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from xml.sax.saxutils import escape

import numpy as np
import shapely
from numpy.typing import ArrayLike
from shapely.geometry.base import BaseGeometry

from vinefab.model.outline import Contour
from vinefab.pages.plan_svg import contour_path

WIDTH_PX = 400.0
_BETWEEN_PX, _HEAD_PX, _PAD_PX = 8.0, 40.0, 12.0
_MOST_PX, _LEAST_PX = 210.0, 40.0
_NARROW, _WIDE = frozenset("fijlrt.,:|' "), frozenset("mwMW%")

STYLE = """text{font:12px Arial,Helvetica,sans-serif;fill:#1d2a30}.head{font-weight:bold}
.halo{paint-order:stroke;stroke:#fff;stroke-width:4px;stroke-linejoin:round}
path,circle{fill:none;stroke-linejoin:round;stroke-linecap:round}.film{fill:#d3dade;stroke:none}
.rim{stroke:#1d2a30;stroke-width:1.3px}.soft{stroke:#5c6b73;stroke-width:1px}
.dash{stroke:#5c6b73;stroke-width:1px;stroke-dasharray:4 3}.rock{fill:#8b989f;stroke:#5c6b73}
.seam{fill:#e0a33c;stroke:none}.fillet{stroke:#c0392b;stroke-width:2.6px}
.trunk{stroke:#2a6f97;stroke-width:4px}.child{stroke:#2e7d4f;stroke-width:4px}
.beam{stroke:#2b6cb0;stroke-width:1.6px}.other{fill:#bcd3ea;stroke:none}
.wrong .m{stroke:#c0392b}.right .m{stroke:#2e7d4f}.m{stroke:#1d2a30;stroke-width:1.6px}
.wrong .t{fill:#c0392b}.right .t{fill:#2e7d4f}.t{fill:#1d2a30;stroke:none}
.wrong .zone{fill:#c0392b;fill-opacity:.45}.right .zone{fill:#2e7d4f;fill-opacity:.35}
.wrong .head{fill:#c0392b}.right .head{fill:#2e7d4f}.leader{stroke:#1d2a30;stroke-width:.8px}
.tip{fill:#1d2a30;stroke:none}.wrong .edge{stroke:#c0392b}.right .edge{stroke:#2e7d4f}
.edge{stroke-width:1px}"""

Point = tuple[float, float]
Box = tuple[float, float, float, float]


@dataclass(frozen=True, slots=True, kw_only=True)
class Mark:
    """One thing drawn: a shape or words, with its place in millimetres."""

    style: str
    shape: BaseGeometry | Contour | None = None
    closed: bool = False
    words: str = ""
    at_mm: Point = (0.0, 0.0)
    off_px: Point = (0.0, 0.0)
    anchor: str = "middle"
    ends_mm: tuple[Point, Point] | None = None
    aside_px: float = 0.0
    points: bool = False  # whether an arrow leads from the words to the place


@dataclass(slots=True, kw_only=True)
class Sketch:
    """What stands on one side of a picture, y upward."""

    says: str = ""  # next to the verdict
    box_mm: Box | None = None  # what is seen; all of it by default
    marks: list[Mark] = field(default_factory=list)

    def draw(self, shape: BaseGeometry | Contour, style: str) -> None:
        """Draw a shape in a style."""
        self.marks.append(Mark(style=style, shape=shape))

    def line(self, points_mm: ArrayLike, style: str) -> None:
        """Draw a line through points."""
        self.draw(shapely.LineString(np.asarray(points_mm, dtype=float)), style)

    def body(self, contour: Contour, fill: str = "film") -> None:
        """Draw a flat outline, filled, with its mouth left open."""
        self.marks.append(Mark(style=fill, shape=contour))
        self.marks.append(Mark(style="rim", shape=contour))

    def disc(self, centre_mm: ArrayLike, radius_mm: float, style: str) -> None:
        """Draw a circle."""
        self.draw(shapely.Point(np.asarray(centre_mm)).buffer(radius_mm, quad_segs=16), style)

    def write(
        self, words: str, at_mm: ArrayLike, off_px: Point = (0.0, 0.0), anchor: str = "middle"
    ) -> None:
        """Write words at a place, moved by pixels right and down."""
        x, y = np.asarray(at_mm, dtype=float).tolist()
        self.marks.append(
            Mark(style="words", words=words, at_mm=(x, y), off_px=off_px, anchor=anchor)
        )

    def point_out(
        self, words: str, at_mm: ArrayLike, off_px: Point, anchor: str = "middle"
    ) -> None:
        """Write words away from a place, with an arrow to it; lines are parted by ``|``."""
        self.write(words, at_mm, off_px, anchor)
        self.marks[-1] = replace(self.marks[-1], points=True)

    def dimension(
        self, start_mm: ArrayLike, end_mm: ArrayLike, words: str = "", aside_px: float = 0.0
    ) -> None:
        """Draw a dimension line with its length, or other words; ``aside_px`` to its left."""
        one, two = (np.asarray(end, dtype=float) for end in (start_mm, end_mm))
        words = words or f"{np.hypot(*(two - one)):.3g} mm"
        ends = (one[0], one[1]), (two[0], two[1])
        self.marks.append(Mark(style="m", words=words, ends_mm=ends, aside_px=aside_px))

    def angle(self, corner_mm: ArrayLike, sides_rad: Sequence[float], radius_mm: float) -> None:
        """Draw an angle between two directions, with its size."""
        low, high = sides_rad
        turns = np.linspace(low, high, 24)
        around = np.column_stack([np.cos(turns), np.sin(turns)])
        corner = np.asarray(corner_mm, dtype=float)
        for turn in (low, high):
            along = np.array([math.cos(turn), math.sin(turn)])
            self.line([corner, corner + 1.25 * radius_mm * along], "m")
        self.line(corner + radius_mm * around, "m")
        middle = corner + 1.25 * radius_mm * around[len(around) // 2]
        off = 18.0 * around[len(around) // 2]
        words = f"{math.degrees(abs(high - low)):.3g} deg"
        self.write(words, middle, (float(off[0]) + 6.0, 4.0 - float(off[1])))

    def seen_mm(self) -> Box:
        """Return the box that is to be seen."""
        if self.box_mm is not None:
            return self.box_mm
        boxes = [_box(mark) for mark in self.marks]
        low = np.min([box[:2] for box in boxes], axis=0)
        high = np.max([box[2:] for box in boxes], axis=0)
        return (*low.tolist(), *high.tolist())


def _box(mark: Mark) -> Box:
    if mark.ends_mm is not None:
        return shapely.LineString(mark.ends_mm).bounds
    if mark.shape is None:
        return (*mark.at_mm, *mark.at_mm)
    return mark.shape.box_mm if isinstance(mark.shape, Contour) else mark.shape.bounds


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """Where millimetres of a sketch lie in its panel."""

    left_mm: float
    top_mm: float
    scale: float  # pixels per millimetre
    width_px: float
    height_px: float
    head_px: float = _HEAD_PX  # kept free for the verdict

    def at(self, point_mm: ArrayLike) -> Point:
        """Return a place in pixels, y downward."""
        x, y = np.asarray(point_mm, dtype=float).tolist()
        return (x - self.left_mm) * self.scale, (self.top_mm - y) * self.scale

    def path(self, shape: BaseGeometry) -> str:
        """Return a shape as the ``d`` of a path, to a tenth of a pixel."""
        parts = shapely.get_parts(shape)
        rings = [
            ring
            for part in parts
            for ring in (shapely.get_rings(part) if part.geom_type == "Polygon" else [part])
        ]
        return "".join(_chain([self.at(p) for p in shapely.get_coordinates(r)]) for r in rings)

    def contour(self, contour: Contour) -> str:
        """Return a contour of lines and arcs as the ``d`` of a path; arcs stay arcs."""
        moved = Contour(
            points_mm=np.round((contour.points_mm - (self.left_mm, self.top_mm)) * self.scale, 2),
            bulges=contour.bulges,
            parts=contour.parts,
            branches=contour.branches,
            closed=contour.closed,
        )
        return contour_path(moved)


def long_px(words: str) -> float:
    """Return the approximate length of words of 12 px in a wide font.

    >>> long_px("film") < long_px("mm mm")
    True
    """
    narrow = sum(one in _NARROW for one in words)
    wide = sum(one in _WIDE for one in words)
    return 4.4 * narrow + 11.5 * wide + 7.2 * (len(words) - narrow - wide)


def short_number(value: float) -> str:
    """Return a number as it stands in a picture.

    >>> short_number(1524.0), short_number(0.26667)
    ('1524', '0.267')
    """
    return f"{value:.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"


def _chain(points: Iterable[Point]) -> str:
    return "M" + "L".join(f"{x:.1f} {y:.1f}".replace(".0", "") for x, y in points)


def picture(title: str, sides: Sequence[tuple[str, str, Sketch]]) -> str:
    """Return a document of two sketches.

    Parameters
    ----------
    sides
        Class (``wrong``, ``right``), verdict and sketch of each.
    """
    sketches = [sketch for _, _, sketch in sides]
    boxes = np.array([sketch.seen_mm() for sketch in sketches])
    size_mm = (boxes[:, 2:] - boxes[:, :2]).max(axis=0)
    stacked = bool(size_mm[0] > 2.9 * size_mm[1])
    wide_px = WIDTH_PX if stacked else (WIDTH_PX - _BETWEEN_PX) / 2.0
    room_px = wide_px - 2.0 * _PAD_PX, (_MOST_PX if not stacked else _MOST_PX / 1.6)
    scale = min(room_px[0] / max(size_mm[0], 1e-9), room_px[1] / max(size_mm[1], 1e-9))
    high_px = max(_LEAST_PX, float(size_mm[1]) * scale) + _HEAD_PX + 2.0 * _PAD_PX
    parts = []
    for number, ((kind, verdict, sketch), box) in enumerate(zip(sides, boxes, strict=True)):
        left, top = (
            (0.0, number * (high_px + _BETWEEN_PX))
            if stacked
            else (
                number * (wide_px + _BETWEEN_PX),
                0.0,
            )
        )
        view = View(
            left_mm=float(box[0] + box[2] - wide_px / scale) / 2.0,
            top_mm=float(box[1] + box[3] + (high_px + _HEAD_PX) / scale) / 2.0,
            scale=float(scale),
            width_px=wide_px,
            height_px=high_px,
        )
        inner = _panel(kind, verdict, sketch, view)
        parts.append(
            f'<svg x="{left:g}" y="{top:.0f}" width="{wide_px:g}" height="{high_px:.0f}" '
            f'class="{kind}">{inner}</svg>'
        )
    whole_px = high_px * (2.0 if stacked else 1.0) + (_BETWEEN_PX if stacked else 0.0)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" role="img" width="{WIDTH_PX:g}" '
        f'height="{whole_px:.0f}" viewBox="0 0 {WIDTH_PX:g} {whole_px:.0f}">\n'
        f"<title>{escape(title)}</title>\n<style>{STYLE}</style>\n"
        + "\n".join(parts)
        + "\n</svg>\n"
    )


def single(title: str, sketch: Sketch) -> str:
    """Return a document of one sketch, without a verdict."""
    box = sketch.seen_mm()
    scale = WIDTH_PX / (box[2] - box[0])
    high_px = (box[3] - box[1]) * scale
    view = View(
        left_mm=box[0],
        top_mm=box[3],
        scale=scale,
        width_px=WIDTH_PX,
        height_px=high_px,
        head_px=0.0,
    )
    inner = [_drawn(mark, view) for mark in sketch.marks if mark.style != "words"]
    inner += [_written(mark, view) for mark in sketch.marks if mark.style == "words"]
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" role="img" width="{WIDTH_PX:g}" '
        f'height="{high_px:.0f}" viewBox="0 0 {WIDTH_PX:g} {high_px:.0f}">\n'
        f"<title>{escape(title)}</title>\n<style>{STYLE}</style>\n"
        f'<rect width="100%" height="100%" fill="#fff"/>\n' + "\n".join(inner) + "\n</svg>\n"
    )


_SIGNS = {"wrong": "M11 9l9 9m0-9l-9 9", "right": "M10 14l4 4 7-10"}


def _panel(kind: str, verdict: str, sketch: Sketch, view: View) -> str:
    edge = f"M.5 .5H{view.width_px - 0.5:g}V{view.height_px - 0.5:.1f}H.5Z"
    for words, room in ((verdict, view.width_px - 29.0), (sketch.says, view.width_px - 12.0)):
        if long_px(words) > room:
            raise ValueError(f"too long for a panel: {words}")
    head = [
        f'<path style="fill:#fff" d="{edge}"/>',
        *[_drawn(mark, view) for mark in sketch.marks if mark.style != "words"],
        *[_written(mark, view) for mark in sketch.marks if mark.style == "words"],
        f'<path d="M0 0H{view.width_px:g}V{_HEAD_PX:g}H0Z" style="fill:#fff"/>',
        f'<path class="edge" d="{edge}"/>',
        f'<path class="m" style="stroke-width:2.4px" d="{_SIGNS[kind]}"/>',
        f'<text class="head" x="27" y="18">{escape(verdict)}</text>',
        f'<text x="10" y="35">{escape(sketch.says)}</text>' if sketch.says else "",
    ]
    return "".join(head)


def _drawn(mark: Mark, view: View) -> str:
    if mark.ends_mm is not None:
        return _dimension(mark, view)
    if isinstance(mark.shape, Contour):
        return f'<path class="{mark.style}" d="{view.contour(mark.shape)}"/>'
    if mark.shape is None:
        return ""
    return f'<path class="{mark.style}" d="{view.path(mark.shape)}"/>'


def _written(mark: Mark, view: View) -> str:
    place = np.array(view.at(mark.at_mm))
    at = place + mark.off_px
    lines = mark.words.split("|")
    words = "".join(
        _text(line, (at[0], at[1] + 14.0 * number), view, mark.anchor)
        for number, line in enumerate(lines)
    )
    return (_leader(place, at, lines, mark.anchor) if mark.points else "") + words


def _leader(place: np.ndarray, at: np.ndarray, lines: list[str], anchor: str) -> str:
    """Return an arrow from the side of a label that is nearest to a place."""
    long, high = max(map(long_px, lines)), 14.0 * len(lines)
    left = {"middle": at[0] - long / 2.0, "start": at[0], "end": at[0] - long}[anchor]
    low, top = at[1] + high - 9.0, at[1] - 12.0
    inside = np.clip(place, (left - 3.0, top), (left + long + 3.0, low))
    start = np.array([min(max(inside[0], left - 3.0), left + long + 3.0), inside[1]])
    along = (place - start) / max(float(np.hypot(*(place - start))), 1e-6)
    line = _chain([tuple(start), tuple(place)])
    return f'<path class="leader" d="{line}"/><path class="tip" d="{_arrow(place, along)}"/>'


def _text(words: str, at_px: Point, view: View, anchor: str = "middle", kind: str = "") -> str:
    """Return words that stay inside the panel."""
    long = long_px(words)
    first = {"middle": at_px[0] - long / 2.0, "start": at_px[0], "end": at_px[0] - long}[anchor]
    first = min(max(first, 5.0), max(view.width_px - 5.0 - long, 5.0))
    x = first + {"middle": long / 2.0, "start": 0.0, "end": long}[anchor]
    y = min(max(at_px[1], view.head_px + 10.0), view.height_px - 5.0)
    return (
        f'<text class="{f"halo {kind}".strip()}" text-anchor="{anchor}" '
        f'x="{x:.0f}" y="{y:.0f}">{escape(words)}</text>'
    )


def _dimension(mark: Mark, view: View) -> str:
    """Return a dimension: arrows, extension lines where it stands aside, words next to it."""
    assert mark.ends_mm is not None  # noqa: S101  one of two kinds of marks
    ends = np.array([view.at(end) for end in mark.ends_mm])
    long = float(np.hypot(*(ends[1] - ends[0])))
    along = (ends[1] - ends[0]) / long if long > 1e-6 else np.array([1.0, 0.0])
    left = np.array([along[1], -along[0]])
    one, two = ends + mark.aside_px * left
    inside = long >= 22.0
    drawn = _arrow(one, -along if inside else along) + _arrow(two, along if inside else -along)
    runs = [(one, two)] if inside else [(one - 14.0 * along, one), (two, two + 14.0 * along)]
    if mark.aside_px:
        over = math.copysign(4.0, mark.aside_px) * left
        runs += [(ends[0], one + over), (ends[1], two + over)]
    lines = "".join(_chain([tuple(a), tuple(b)]) for a, b in runs)
    middle = (one + two) / 2.0
    if abs(along[0]) > 0.7:  # words above or below a line that lies
        up = -1.0 if mark.aside_px * left[1] <= 0.0 else 1.0
        place = middle + np.array([0.0, -6.0 if up < 0.0 else 15.0])
        words = _text(mark.words, tuple(place), view)
    else:
        right = mark.aside_px * left[0] >= 0.0
        beside = middle if inside else two + 14.0 * along
        place = beside + np.array([8.0 if right else -8.0, 4.0])
        words = _text(mark.words, tuple(place), view, "start" if right else "end")
    return f'<path class="m" d="{lines}"/><path class="t" d="{drawn}"/>{words}'


def _arrow(tip: np.ndarray, along: np.ndarray) -> str:
    side = np.array([-along[1], along[0]])
    back = tip - 8.0 * along
    corners = [tuple(tip), tuple(back + 3.0 * side), tuple(back - 3.0 * side)]
    return _chain(corners) + "Z"
