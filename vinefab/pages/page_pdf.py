"""Pages as PDF, through reportlab: for drawings that are printed."""

import io
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
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
from vinefab.pages.panel import (
    MIDDLE,
    OPEN_SIGNS,
    SIGNS,
    Marks,
    Page,
    Raster,
    Shape,
    Words,
    blended,
)
from vinefab.pages.paper_tiles import PaperSheet
from vinefab.pages.true_scale import PT_PER_MM

_ROUND, _BUTT = 1, 0


def page_pdf(page: Page) -> bytes:
    """Return a page as PDF; the same page gives the same bytes."""
    stream = io.BytesIO()
    canvas = _canvas(stream, page)
    _draw_page(canvas, page)
    canvas.save()
    return stream.getvalue()


def sheets_pdf(drawing: Page, sheets: Sequence[PaperSheet]) -> bytes:
    """Return a drawing on sheets of paper as PDF; the same sheets give the same bytes.

    The drawing stands in the file once; every page shows a part of it. What is clear becomes pale.
    """
    stream = io.BytesIO()
    canvas = _canvas(stream, sheets[0].page)
    canvas.beginForm(_DRAWING, 0, 0, drawing.width_pt, drawing.height_pt)
    _draw_page(canvas, drawing, opaque=True)
    canvas.endForm()
    for sheet in sheets:
        canvas.setPageSize((sheet.page.width_pt, sheet.page.height_pt))
        x0, y0, x1, y1 = (PT_PER_MM * side for side in sheet.window_mm)
        x, y = (PT_PER_MM * shift for shift in sheet.shift_mm)
        canvas.saveState()
        window = canvas.beginPath()
        window.rect(x0, y0, x1 - x0, y1 - y0)
        canvas.clipPath(window, stroke=0, fill=0)
        canvas.transform(sheet.scale, 0, 0, sheet.scale, x, y)
        canvas.doForm(_DRAWING)
        canvas.restoreState()
        _draw_page(canvas, sheet.page)
        canvas.showPage()
    canvas.save()
    return stream.getvalue()


_DRAWING = "drawing"


def _canvas(stream: io.BytesIO, first: Page) -> Canvas:
    size = first.width_pt, first.height_pt
    canvas = Canvas(stream, pagesize=size, invariant=1, pageCompression=1)
    canvas.setCreator(ROOMY_GENERATOR)
    return canvas


def _draw_page(canvas: Canvas, page: Page, *, opaque: bool = False) -> None:
    high = page.height_pt
    canvas.setLineJoin(_ROUND)
    for layer in page.layers:
        for is_text, group in groupby(layer.primitives, key=lambda one: isinstance(one, Words)):
            canvas.saveState()
            if layer.window is not None and not is_text:  # a name may stand over the rim
                x, y, right, low = layer.window
                window = canvas.beginPath()
                window.rect(x, high - low, right - x, low - y)
                canvas.clipPath(window, stroke=0, fill=0)
            with _marked(canvas, layer.name):
                for primitive in group:
                    if isinstance(primitive, Words):
                        _write(canvas, primitive, high)
                    else:
                        _draw(canvas, primitive, high, opaque=opaque)
            canvas.restoreState()


@contextmanager
def _marked(canvas: Canvas, name: str) -> Iterator[None]:
    """Mark what is drawn with the name of its layer, if it has one, for programs that read it."""
    if name:
        canvas.addLiteral(f"/{name} BMC")
    yield
    if name:
        canvas.addLiteral("EMC")


def _draw(
    canvas: Canvas, primitive: Shape | Marks | Raster, high: float, *, opaque: bool = False
) -> None:
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
        _set(canvas.setFillColor, ink.fill, ink.fill_alpha, opaque=opaque)
    if ink.line:
        _set(canvas.setStrokeColor, ink.line, ink.line_alpha, opaque=opaque)
        canvas.setLineWidth(ink.width_pt)
        canvas.setDash(list(ink.dash_pt))
        canvas.setLineCap(_BUTT if ink.butt or ink.dash_pt else _ROUND)
    canvas.drawPath(path, stroke=int(bool(primitive.ink.line)), fill=int(bool(primitive.ink.fill)))


def _set(paint: Callable[..., None], colour: str, alpha: float, *, opaque: bool) -> None:
    """Set a colour: a clear one, or as pale as it looks on white paper."""
    if opaque and alpha < 1.0:
        paint(HexColor("#{:02x}{:02x}{:02x}".format(*blended(alpha, ("white", colour))[:3])))
    else:
        paint(HexColor(colour), alpha=alpha)


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
