"""Pages as PDF, through reportlab: for drawings that are printed."""

import io
from functools import cache
from itertools import groupby

from PIL import Image
from reportlab.lib.colors import HexColor
from reportlab.lib.utils import ImageReader
from reportlab.pdfbase.pdfmetrics import registerFont, stringWidth
from reportlab.pdfbase.ttfonts import TTFont
from reportlab.pdfgen.canvas import Canvas
from reportlab.pdfgen.pathobject import PDFPathObject

from vinefab.core.hashing import ROOMY_GENERATOR
from vinefab.core.validation import Floats
from vinefab.pages.page_files import font_file
from vinefab.pages.panel import MIDDLE, OPEN_SIGNS, SIGNS, Marks, Page, Raster, Shape, Words

_ROUND, _BUTT = 1, 0


def page_pdf(page: Page) -> bytes:
    """Return a page as PDF; the same page gives the same bytes."""
    stream, high = io.BytesIO(), page.height_pt
    canvas = Canvas(stream, pagesize=(page.width_pt, high), invariant=1, pageCompression=1)
    canvas.setCreator(ROOMY_GENERATOR)
    canvas.setLineJoin(_ROUND)
    for layer in page.layers:
        for is_text, group in groupby(layer.primitives, key=lambda one: isinstance(one, Words)):
            canvas.saveState()
            if layer.window is not None and not is_text:  # a name may stand over the rim
                x, y, right, low = layer.window
                window = canvas.beginPath()
                window.rect(x, high - low, right - x, low - y)
                canvas.clipPath(window, stroke=0, fill=0)
            for primitive in group:
                if isinstance(primitive, Words):
                    _write(canvas, primitive, high)
                else:
                    _draw(canvas, primitive, high)
            canvas.restoreState()
    canvas.save()
    return stream.getvalue()


def _draw(canvas: Canvas, primitive: Shape | Marks | Raster, high: float) -> None:
    if isinstance(primitive, Raster):
        x0, y0, x1, y1 = primitive.box
        pixels = ImageReader(Image.fromarray(primitive.pixels))
        canvas.drawImage(pixels, x0, high - y1, x1 - x0, y1 - y0, mask="auto")
        return
    path = canvas.beginPath()
    if isinstance(primitive, Shape):
        for chain in primitive.chains:
            _chain(path, chain, high, closed=primitive.closed)
    else:
        for x, y in primitive.points.tolist():
            if primitive.sign == "o":
                path.circle(x, high - y, primitive.size_pt / 2.0)
                continue
            corners = primitive.size_pt * SIGNS[primitive.sign] + (x, y)
            is_open = primitive.sign in OPEN_SIGNS
            for stroke in (corners[:2], corners[3:]) if is_open else (corners,):
                _chain(path, stroke, high, closed=not is_open)
    ink = primitive.ink
    if ink.fill:
        canvas.setFillColor(HexColor(ink.fill), alpha=ink.fill_alpha)
    if ink.line:
        canvas.setStrokeColor(HexColor(ink.line), alpha=ink.line_alpha)
        canvas.setLineWidth(ink.width_pt)
        canvas.setDash(list(ink.dash_pt))
        canvas.setLineCap(_BUTT if ink.butt or ink.dash_pt else _ROUND)
    canvas.drawPath(path, stroke=int(bool(primitive.ink.line)), fill=int(bool(primitive.ink.fill)))


def _chain(path: PDFPathObject, chain: Floats, high: float, *, closed: bool) -> None:
    if not len(chain):
        return
    (x, y), *rest = chain.tolist()
    path.moveTo(x, high - y)
    for x, y in rest:
        path.lineTo(x, high - y)
    if closed:
        path.close()


def _write(canvas: Canvas, words: Words, high: float) -> None:
    font = _font(bold=words.bold)
    wide = stringWidth(words.text, font, words.size_pt)
    start = {"start": 0.0, "middle": -wide / 2.0, "end": -wide}[words.anchor]
    canvas.saveState()
    canvas.translate(words.at[0] + words.shift_pt[0], high - words.at[1] + words.shift_pt[1])
    canvas.rotate(90.0 if words.turned else 0.0)
    canvas.setFont(font, words.size_pt)
    canvas.setFillColor(HexColor(words.colour), alpha=1.0)
    canvas.drawString(start, -MIDDLE * words.size_pt, words.text)
    canvas.restoreState()


@cache
def _font(*, bold: bool) -> str:
    """Return the name of DejaVu Sans in PDF files; of Helvetica where it is not installed."""
    name, path = f"DejaVu-{'Bold' if bold else 'Sans'}", font_file(bold=bold)
    if path is None:
        return "Helvetica-Bold" if bold else "Helvetica"
    registerFont(TTFont(name, str(path)))
    return name
