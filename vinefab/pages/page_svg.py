"""Pages as SVG: text stays text, the same page gives the same bytes."""

import base64
import io
import re
from functools import cache
from html import escape

import numpy as np
from PIL import Image

from vinefab.core.jsontext import GENERATOR
from vinefab.core.validation import Floats
from vinefab.pages.panel import (
    MIDDLE,
    OPEN_SIGNS,
    SIGNS,
    Ink,
    Layer,
    Marks,
    Page,
    Primitive,
    Raster,
    Shape,
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
        *(_layer(layer) for layer in page.layers),
        "</svg>\n",
    ]
    return "\n".join(parts).encode()


def _layer(layer: Layer) -> str:
    body = "\n".join(_primitive(primitive) for primitive in layer.primitives)
    if layer.window is None:
        return body
    # A nested document cuts off what reaches over its edge, without names that could meet others.
    x, y, right, low = layer.window
    place = f'x="{x:.2f}" y="{y:.2f}" width="{right - x:.2f}" height="{low - y:.2f}"'
    return f'<svg {place} viewBox="{x:.2f} {y:.2f} {right - x:.2f} {low - y:.2f}">\n{body}\n</svg>'


def _primitive(primitive: Primitive) -> str:
    if isinstance(primitive, Shape):
        path = "".join(_chain(chain, closed=primitive.closed) for chain in primitive.chains)
        return f'<path d="{path}"{_painted(primitive.ink)}/>' if path else ""
    if isinstance(primitive, Marks):
        return _marks(primitive)
    if isinstance(primitive, Raster):
        x0, y0, x1, y1 = primitive.box
        return (
            f'<image x="{x0:.2f}" y="{y0:.2f}" width="{x1 - x0:.2f}" height="{y1 - y0:.2f}" '
            'preserveAspectRatio="none" style="image-rendering:pixelated" '
            f'href="data:image/png;base64,{_png(primitive)}"/>'
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


def _png(raster: Raster) -> str:
    stream = io.BytesIO()
    Image.fromarray(raster.pixels).save(stream, format="PNG")
    return base64.b64encode(stream.getvalue()).decode()
