"""Pages as SVG, where text stays text, and as PNG, by Pillow: the same page, the same bytes."""

import base64
import io
import re
from functools import cache
from html import escape
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import shapely
from PIL import Image, ImageChops, ImageDraw, ImageFont
from PIL.PngImagePlugin import PngInfo

from vinefab.core.hashing import ROOMY_GENERATOR
from vinefab.core.plain_text import GENERATOR
from vinefab.core.validation import Floats
from vinefab.pages.panel import (
    MIDDLE,
    OPEN_SIGNS,
    SIGNS,
    Box,
    Ink,
    Marks,
    Page,
    Primitive,
    Raster,
    Shape,
    Words,
    rgb,
)

_FONT = "'DejaVu Sans', Verdana, Helvetica, Arial, sans-serif"
_NOT_XML = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\ud800-\udfff\ufffe\uffff]")


def page_svg(page: Page) -> bytes:
    """Return a page as an SVG document."""
    size = f"{page.width_pt:.2f} {page.height_pt:.2f}"
    wide, high = size.split()
    parts = [
        '<?xml version="1.0" encoding="utf-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{wide}pt" height="{high}pt" '
        f'viewBox="0 0 {size}" font-family="{_FONT}" xml:space="preserve">',
        f"<desc>{GENERATOR}</desc>",
        '<rect width="100%" height="100%" fill="#fff"/>',
    ]
    for layer in page.layers:
        body = "\n".join(_primitive(primitive) for primitive in layer.primitives)
        if layer.window is not None:
            # A nested document cuts off what reaches over its edge, without names that could meet.
            x, y, right, low = layer.window
            place = f'x="{x:.2f}" y="{y:.2f}" width="{right - x:.2f}" height="{low - y:.2f}"'
            box = f"{x:.2f} {y:.2f} {right - x:.2f} {low - y:.2f}"
            body = f'<svg {place} viewBox="{box}">\n{body}\n</svg>'
        parts.append(body)
    return "\n".join([*parts, "</svg>\n"]).encode()


def _primitive(primitive: Primitive) -> str:
    if isinstance(primitive, Shape):
        path = "".join(_chain(chain, closed=primitive.closed) for chain in primitive.chains)
        return f'<path d="{path}"{_painted(primitive.ink)}/>' if path else ""
    if isinstance(primitive, Marks):
        return _marks(primitive)
    if isinstance(primitive, Raster):
        x0, y0, x1, y1 = primitive.box
        stream = io.BytesIO()
        Image.fromarray(primitive.pixels).save(stream, format="PNG")
        data = base64.b64encode(stream.getvalue()).decode()
        return (
            f'<image x="{x0:.2f}" y="{y0:.2f}" width="{x1 - x0:.2f}" height="{y1 - y0:.2f}" '
            'preserveAspectRatio="none" style="image-rendering:pixelated" '
            f'href="data:image/png;base64,{data}"/>'
        )
    x, y = primitive.at[0] + primitive.shift_pt[0], primitive.at[1] - primitive.shift_pt[1]
    anchor = "" if primitive.anchor == "start" else f' text-anchor="{primitive.anchor}"'
    bold = ' font-weight="bold"' if primitive.bold else ""
    rim = f' stroke="#fff" stroke-width="{0.25 * primitive.size_pt:.2g}" paint-order="stroke"'
    halo = f'{rim} stroke-linejoin="round"' if primitive.halo else ""
    # The middle of small letters lies about a third of the size above the base line.
    low = MIDDLE * primitive.size_pt
    if primitive.turned:
        place = f'transform="translate({x + low:.2f} {y:.2f}) rotate(-90)"'
    else:
        place = f'x="{x:.2f}" y="{y + low:.2f}"'
    return (
        f'<text {place} font-size="{primitive.size_pt:g}" fill="{primitive.colour}"'
        f"{anchor}{bold}{halo}>{escape(_NOT_XML.sub('?', primitive.text), quote=False)}</text>"
    )


def _chain(points: Floats, *, closed: bool) -> str:
    if len(points) == 0:
        return ""
    placed = (np.round(points, 2) + 0.0).tolist()  # no -0
    if closed and len(placed) > 1 and placed[0] == placed[-1]:
        placed.pop()
    return "M" + " ".join(f"{x:.7g} {y:.7g}" for x, y in placed) + ("Z" if closed else "")


@cache
def _painted(ink: Ink) -> str:
    fill = f' fill="{ink.fill}"' if ink.fill else ' fill="none"'
    if ink.fill:
        fill += ' fill-rule="evenodd"'
        fill += f' fill-opacity="{ink.fill_alpha:g}"' if ink.fill_alpha < 1.0 else ""
    if not ink.line:
        return fill
    line = f' stroke="{ink.line}" stroke-width="{ink.width_pt:g}"'
    line += f' stroke-opacity="{ink.line_alpha:g}"' if ink.line_alpha < 1.0 else ""
    line += f' stroke-dasharray="{" ".join(f"{part:g}" for part in ink.dash_pt)}"' * bool(
        ink.dash_pt
    )
    line += "" if ink.butt or ink.dash_pt else ' stroke-linecap="round"'
    return f'{fill}{line} stroke-linejoin="round"'


def _marks(marks: Marks) -> str:
    places = (np.round(marks.points, 2) + 0.0).tolist()
    if marks.sign == "o":
        radius = f"{marks.size_pt / 2.0:.4g}"
        body = "".join(f'<circle cx="{x:.7g}" cy="{y:.7g}" r="{radius}"/>' for x, y in places)
    else:
        corners = marks.size_pt * SIGNS[marks.sign]
        split = len(corners) // 2 + 1 if marks.sign in OPEN_SIGNS else len(corners)
        chains = [corners[:2], corners[3:]] if split < len(corners) else [corners]
        path = "".join(
            _chain(chain + place, closed=len(chains) == 1)
            for place in marks.points
            for chain in chains
        )
        body = f'<path d="{path}"/>'
    return f"<g{_painted(marks.ink)}>{body}</g>"


_Place = tuple[float, float]


def page_png(page: Page, dpi: int = 150) -> bytes:
    """Return a page as a PNG file."""
    sharpness = 3  # pages are drawn so many times larger and then reduced: smooth edges
    painter = _Painter(page, sharpness * dpi / 72.0)
    for layer in page.layers:
        # Only the part of a layer within its window is kept.
        around = painter.around(layer.window) if layer.window else []
        for primitive in layer.primitives:
            painter.paint(primitive)
        for strip, place in around:
            painter.image.paste(strip, place)
    info = PngInfo()
    info.add_text("Software", ROOMY_GENERATOR)
    stream = io.BytesIO()
    small = painter.image.reduce(sharpness)
    small.save(stream, format="PNG", pnginfo=info, dpi=(dpi, dpi))
    return stream.getvalue()


class _Painter:
    """A sheet of pixels, and how primitives come onto it."""

    def __init__(self, page: Page, scale: float) -> None:
        self.scale = scale  # pixels per point
        size = (round(scale * page.width_pt), round(scale * page.height_pt))
        self.image = Image.new("RGB", size, "white")
        self.draw = ImageDraw.Draw(self.image)
        self.blended = ImageDraw.Draw(self.image, "RGBA")  # lays see-through colours over it

    def around(self, window: Box) -> list[tuple[Image.Image, tuple[int, int]]]:
        """Return the strips of the image around a window, and their places."""
        left, top, right, low = (round(self.scale * end) for end in window)
        wide, high = self.image.size
        places = (
            (0, 0, wide, top), (0, low, wide, high), (0, top, left, low), (right, top, wide, low)
        )  # fmt: skip
        boxes = [box for box in places if box[2] > box[0] and box[3] > box[1]]
        return [(self.image.crop(box), box[:2]) for box in boxes]

    def paint(self, primitive: Primitive) -> None:
        if isinstance(primitive, Shape):
            self._shape(
                [self.scale * c for c in primitive.chains], primitive.ink, closed=primitive.closed
            )
        elif isinstance(primitive, Marks):
            self._marks(primitive)
        elif isinstance(primitive, Words):
            self._words(primitive)
        else:
            x0, y0, x1, y1 = (round(self.scale * end) for end in primitive.box)
            size = (max(1, x1 - x0), max(1, y1 - y0))
            pixels = Image.fromarray(primitive.pixels).resize(size, Image.Resampling.NEAREST)
            self.image.paste(pixels.convert("RGB"), (x0, y0), pixels.getchannel("A"))

    def _shape(self, chains: list[Floats], ink: Ink, *, closed: bool) -> None:
        corners = [_pairs(chain) for chain in chains if len(chain)]
        if closed and ink.fill:
            self._fill(corners, rgb(ink.fill), ink.fill_alpha)
        if not ink.line:
            return
        ends = [[*places, places[0]] if closed else places for places in corners]
        if ink.dash_pt:
            ends = [dash for places in ends for dash in self._dashes(places, ink.dash_pt)]
        width = max(1, round(self.scale * ink.width_pt))
        if ink.line_alpha < 1.0:
            mask = Image.new("L", self.image.size)
            _lines(ImageDraw.Draw(mask), ends, round(255 * ink.line_alpha), width, butt=ink.butt)
            self.image.paste(rgb(ink.line), mask=mask)
        else:
            _lines(self.draw, ends, rgb(ink.line), width, butt=ink.butt or bool(ink.dash_pt))

    def _fill(self, rings: list[list[_Place]], colour: tuple[int, int, int], alpha: float) -> None:
        rings = [ring for ring in rings if len(ring) > 2]
        # Even-odd: a ring within a ring takes away, one within that fills again. Rings that meet no
        # other one, mostly thousands of obstacles, are just filled.
        boxes = [shapely.box(*np.min(ring, axis=0), *np.max(ring, axis=0)) for ring in rings]
        met = np.bincount(shapely.STRtree(boxes).query(boxes)[0], minlength=len(rings)) > 1
        for alone in (ring for ring, has_others in zip(rings, met, strict=True) if not has_others):
            if alpha == 1.0:
                self.draw.polygon(alone, fill=colour)
            else:
                self.blended.polygon(alone, fill=(*colour, round(255 * alpha)))
        meeting = [
            np.array(ring) for ring, has_others in zip(rings, met, strict=True) if has_others
        ]
        if not meeting:
            return
        every, limits = np.concatenate(meeting), np.array(self.image.size)
        low = np.clip(np.floor(every.min(axis=0)).astype(int), 0, limits)
        high = np.clip(np.ceil(every.max(axis=0)).astype(int) + 1, 0, limits)
        if (high <= low).any():
            return
        mask = Image.new("1", tuple((high - low).tolist()))
        for ring in meeting:
            xs, ys = (ring - low).T
            left, top = max(0, int(xs.min()) - 1), max(0, int(ys.min()) - 1)
            right = min(mask.size[0], int(xs.max()) + 2)
            lower = min(mask.size[1], int(ys.max()) + 2)
            if right <= left or lower <= top:
                continue
            one = Image.new("1", (right - left, lower - top))
            ImageDraw.Draw(one).polygon(_pairs(np.column_stack([xs - left, ys - top])), fill=1)
            under = mask.crop((left, top, right, lower))
            mask.paste(ImageChops.logical_xor(under, one), (left, top))
        opacity = mask.convert("L").point([round(alpha * level) for level in range(256)])
        self.image.paste(colour, (int(low[0]), int(low[1])), opacity)

    def _dashes(self, places: list[_Place], dash_pt: tuple[float, ...]) -> list[list[_Place]]:
        points = np.array(places)
        along = np.append(0.0, np.cumsum(np.hypot(*np.diff(points, axis=0).T)))
        steps = self.scale * np.resize(dash_pt, 2 * (len(dash_pt) + len(dash_pt) % 2))
        ends = np.append(0.0, np.cumsum(np.resize(steps, 4 + int(4 * along[-1] / steps.sum() + 4))))
        ends = ends[ends < along[-1]]
        pieces = []
        for begin, end in zip(ends[::2], [*ends[1::2], along[-1]], strict=False):
            inner = points[(along > begin) & (along < end)]
            tips = [
                [np.interp(at, along, points[:, axis]) for axis in (0, 1)] for at in (begin, end)
            ]
            pieces.append(_pairs(np.vstack([tips[:1], inner, tips[1:]])))
        return pieces

    def _marks(self, marks: Marks) -> None:
        size = self.scale * marks.size_pt
        line = max(1, round(self.scale * marks.ink.width_pt)) if marks.ink.line else 0
        for x, y in (self.scale * marks.points).tolist():
            if marks.sign == "o":
                half = (size + line) / 2.0
                box = (x - half, y - half, x + half, y + half)
                fill = rgb(marks.ink.fill) if marks.ink.fill else None
                if fill and marks.ink.fill_alpha < 1.0:
                    turns = np.linspace(0.0, 2.0 * np.pi, 25)[:-1]
                    ring = np.column_stack([np.cos(turns), np.sin(turns)]) * size / 2.0 + (x, y)
                    self._fill([_pairs(ring)], fill, marks.ink.fill_alpha)
                    fill = None
                outline = rgb(marks.ink.line) if line else None
                self.draw.ellipse(box, fill=fill, outline=outline, width=line)
            elif marks.sign in OPEN_SIGNS:
                corners = size * SIGNS[marks.sign] + (x, y)
                self._shape([corners[:2], corners[3:]], marks.ink, closed=False)
            else:
                self._shape([size * SIGNS[marks.sign] + (x, y)], marks.ink, closed=True)

    def _words(self, words: Words) -> None:
        size = self.scale * words.size_pt
        font = _font(max(1, round(size)), bold=words.bold)
        x = self.scale * (words.at[0] + words.shift_pt[0])
        y = self.scale * (words.at[1] - words.shift_pt[1])
        rim = round(0.125 * size) if words.halo else 0
        anchor = {"start": "l", "middle": "m", "end": "r"}[words.anchor]
        if not words.turned:
            self.draw.text(
                (x, y + MIDDLE * size), words.text, rgb(words.colour), font, f"{anchor}s",
                stroke_width=rim, stroke_fill="white",
            )  # fmt: skip
            return
        wide = int(font.getlength(words.text)) + 2
        high = int(1.4 * size)
        strip = Image.new("L", (wide, high))
        ImageDraw.Draw(strip).text((1, high / 2.0 + MIDDLE * size), words.text, 255, font, "ls")
        turned = strip.rotate(90, expand=True)
        down = {"start": 1.0, "middle": 0.5, "end": 0.0}[words.anchor]
        place = (round(x - high / 2.0), round(y - down * wide))
        self.image.paste(rgb(words.colour), place, turned)


def _pairs(points: Floats) -> list[_Place]:
    return [(x, y) for x, y in np.asarray(points).tolist()]


def _lines(
    draw: ImageDraw.ImageDraw,
    chains: list[list[_Place]],
    colour: int | tuple[int, int, int],
    width: int,
    *,
    butt: bool,
) -> None:
    for places in chains:
        draw.line(places, fill=colour, width=width, joint="curve")
        if not butt and width > 2:
            half = width / 2.0
            for x, y in (places[0], places[-1]):
                draw.ellipse((x - half, y - half, x + half, y + half), fill=colour)


def font_file(*, bold: bool) -> Path | None:
    """Return the file of DejaVu Sans; None if it is not installed.

    It is looked for and not imported: matplotlib comes with it, and takes half a second to load.
    """
    found = find_spec("matplotlib")
    if found is None or not found.origin:
        return None
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    path = Path(found.origin).parent / "mpl-data" / "fonts" / "ttf" / name
    return path if path.exists() else None


@cache
def _font(size: int, *, bold: bool) -> ImageFont.FreeTypeFont | ImageFont.ImageFont:
    path = font_file(bold=bold)
    return ImageFont.load_default(size) if path is None else ImageFont.truetype(str(path), size)
