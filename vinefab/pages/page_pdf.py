"""Pages as PDF, for drawings that are printed.

Written here: to load matplotlib took as long as all other files of a fabrication package. A file of
PDF 1.4 with one page: lines and areas as paths, pixels as images with their opacity, and text that
can be searched, in letters of DejaVu Sans that stand in the file (fonts of type 3).
"""

import io
import zlib
from collections.abc import Iterator, Sequence
from functools import cache
from itertools import count, groupby
from operator import itemgetter

import numpy as np
from fontTools.pens.basePen import BasePen
from fontTools.ttLib import TTFont

from vinefab.core.file_mark import ROOMY_GENERATOR
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
    Words,
    font_file,
    rgb,
)

_ROUND = 0.5523  # length of the handles of a quarter of a circle drawn as a curve, per radius
_MOST_CODES = 255  # letters of one font


def page_pdf(page: Page) -> bytes:
    """Return a page as PDF; the same page gives the same bytes."""
    sheet = _Sheet()
    drawn = [f"1 0 0 -1 0 {page.height_pt:.2f} cm"]  # y runs down, as in pages
    for layer in page.layers:
        drawn += sheet.layer(layer)
    content = sheet.file.stream("", "\n".join(drawn).encode())
    resources = sheet.resources()
    tree = sheet.file.reserved()
    box = f"[0 0 {page.width_pt:.2f} {page.height_pt:.2f}]"
    leaf = sheet.file.add(
        f"<< /Type /Page /Parent {tree} 0 R /MediaBox {box} /Contents {content} 0 R "
        f"/Resources {resources} >>"
    )
    sheet.file.put(tree, f"<< /Type /Pages /Kids [{leaf} 0 R] /Count 1 >>")
    return sheet.file.written(root=sheet.file.add(f"<< /Type /Catalog /Pages {tree} 0 R >>"))


class _File:
    """The numbered objects of a PDF file."""

    def __init__(self) -> None:
        self._objects: dict[int, bytes] = {}
        self._numbers = count(1)

    def reserved(self) -> int:
        """Return the number of an object that is put later."""
        return next(self._numbers)

    def put(self, number: int, body: str | bytes) -> None:
        self._objects[number] = body.encode("ascii") if isinstance(body, str) else body

    def add(self, body: str | bytes) -> int:
        number = self.reserved()
        self.put(number, body)
        return number

    def stream(self, keys: str, data: bytes) -> int:
        """Add data, compressed, with what its dictionary says besides its length."""
        packed = zlib.compress(data)
        head = f"<< {keys} /Length {len(packed)} /Filter /FlateDecode >>\nstream\n"
        return self.add(head.encode() + packed + b"\nendstream")

    def written(self, root: int) -> bytes:
        """Return the file; the comment of its first line says that it holds more than text."""
        info = self.add(f"<< /Creator ({ROOMY_GENERATOR}) >>")
        stream, places = io.BytesIO(), list[int]()
        stream.write(b"%PDF-1.4\n%\xe2\xe3\xcf\xd3\n")
        for number in sorted(self._objects):
            places.append(stream.tell())
            stream.write(b"%d 0 obj\n%b\nendobj\n" % (number, self._objects[number]))
        start, size = stream.tell(), len(places) + 1
        stream.write(b"xref\n0 %d\n0000000000 65535 f \n" % size)
        stream.write(b"".join(b"%010d 00000 n \n" % place for place in places))
        end = f"trailer\n<< /Size {size} /Root {root} 0 R /Info {info} 0 R >>\nstartxref\n{start}\n"
        stream.write(end.encode() + b"%%EOF\n")
        return stream.getvalue()


class _Sheet:
    """What a page draws, as operators of PDF, and the resources that they name."""

    def __init__(self) -> None:
        self.file = _File()
        self._opacities: dict[tuple[float, float], str] = {}
        self._images: list[int] = []
        self._fonts: dict[tuple[bool, int], _Font] = {}

    def resources(self) -> str:
        """Return the dictionary of all that the page names."""
        states = " ".join(
            f"/{name} << /ca {fill:g} /CA {line:g} >>"
            for (fill, line), name in self._opacities.items()
        )
        images = " ".join(f"/I{place} {one} 0 R" for place, one in enumerate(self._images))
        fonts = " ".join(
            f"/{one.name} {one.put_into(self.file)} 0 R" for one in self._fonts.values()
        )
        return f"<< /ExtGState << {states} >> /XObject << {images} >> /Font << {fonts} >> >>"

    def layer(self, layer: Layer) -> Iterator[str]:
        """Yield the operators of a layer, cut off at its window."""
        yield "q"
        if layer.window is not None:
            x, y, right, low = layer.window
            yield f"{x:.2f} {y:.2f} {right - x:.2f} {low - y:.2f} re W n"
        for primitive in layer.primitives:
            yield from self._primitive(primitive)
        yield "Q"

    def _primitive(self, primitive: Primitive) -> Iterator[str]:
        if isinstance(primitive, Words):
            yield from self._words(primitive)
        elif isinstance(primitive, Raster):
            yield self._raster(primitive)
        elif path := _path(primitive):
            yield from self._painted(path, primitive.ink)

    def _painted(self, path: str, ink: Ink) -> Iterator[str]:
        """Yield a path filled by the even-odd rule, then its line."""
        if not ink.fill and not ink.line:
            return
        key = (ink.fill_alpha, ink.line_alpha)
        yield f"q /{self._opacities.setdefault(key, f'G{len(self._opacities)}')} gs"
        if ink.fill:
            yield f"{_colour(ink.fill)} rg"
        if ink.line:
            dashes = " ".join(f"{part:g}" for part in ink.dash_pt)
            cap = 0 if ink.butt or ink.dash_pt else 1
            yield f"{_colour(ink.line)} RG {ink.width_pt:g} w {cap} J 1 j [{dashes}] 0 d"
        way = "S" if not ink.fill else "B*" if ink.line else "f*"
        yield f"{path} {way} Q"

    def _raster(self, raster: Raster) -> str:
        rows, columns = raster.pixels.shape[:2]
        keys = f"/Type /XObject /Subtype /Image /Width {columns} /Height {rows} /BitsPerComponent 8"
        mask = self.file.stream(
            f"{keys} /ColorSpace /DeviceGray", np.ascontiguousarray(raster.pixels[..., 3]).tobytes()
        )
        colours = np.ascontiguousarray(raster.pixels[..., :3]).tobytes()
        image = self.file.stream(f"{keys} /ColorSpace /DeviceRGB /SMask {mask} 0 R", colours)
        self._images.append(image)
        x0, y0, x1, y1 = raster.box
        place = f"{x1 - x0:.2f} 0 0 {y0 - y1:.2f} {x0:.2f} {y1:.2f} cm"
        return f"q {place} /I{len(self._images) - 1} Do Q"

    def _words(self, words: Words) -> Iterator[str]:
        x, y = words.at[0] + words.shift_pt[0], words.at[1] - words.shift_pt[1]
        codes = list(self._coded(words.text, bold=words.bold))
        wide = sum(font.advance(letter) for font, letter in codes) * words.size_pt
        back = {"start": 0.0, "middle": 0.5, "end": 1.0}[words.anchor] * wide
        low = MIDDLE * words.size_pt
        if words.turned:
            turn, x, y = "0 -1 -1 0", x + low, y + back
        else:
            turn, x, y = "1 0 0 -1", x - back, y + low
        yield f"BT {_colour(words.colour)} rg {turn} {x:.2f} {y:.2f} Tm"
        for font, run in groupby(codes, key=itemgetter(0)):
            text = "".join(f"{font.code(letter):02x}" for _, letter in run)
            yield f"/{font.name} {words.size_pt:g} Tf <{text}> Tj"
        yield "ET"

    def _coded(self, text: str, *, bold: bool) -> Iterator[tuple["_Font", str]]:
        """Yield each letter of a text with the font that has it."""
        for letter in text:
            for number in count():
                key = (bold, number)
                font = self._fonts.setdefault(key, _Font(f"F{len(self._fonts)}", bold=bold))
                if font.takes(letter):
                    yield font, letter
                    break


class _Font:
    """At most 255 letters of DejaVu Sans, by their outlines."""

    def __init__(self, name: str, *, bold: bool) -> None:
        self.name = name
        self._face = _face(bold=bold)
        self._letters: dict[str, int] = {}  # code by letter

    def takes(self, letter: str) -> bool:
        """Give a letter a code, unless there are too many."""
        if letter not in self._letters and len(self._letters) < _MOST_CODES:
            self._letters[letter] = len(self._letters) + 1
        return letter in self._letters

    def code(self, letter: str) -> int:
        return self._letters[letter]

    def advance(self, letter: str) -> float:
        """Return how far a letter moves the next one, per size."""
        return float(self._face["hmtx"][self._glyph(letter)][0] / self._face["head"].unitsPerEm)

    def _glyph(self, letter: str) -> str:
        return str(self._face.getBestCmap().get(ord(letter), ".notdef"))

    def put_into(self, file: _File) -> int:
        """Add the font with the letters that were taken."""
        outlines, head = self._face.getGlyphSet(), self._face["head"]
        units, box = head.unitsPerEm, f"{head.xMin} {head.yMin} {head.xMax} {head.yMax}"
        shapes, widths = list[str](), list[str]()
        for letter, code in self._letters.items():
            glyph = self._glyph(letter)
            wide = self._face["hmtx"][glyph][0]
            pen = _Pen(outlines)
            outlines[glyph].draw(pen)
            stream = file.stream(
                "", f"{wide} 0 {box} d1\n{' '.join([*pen.operators, 'f'])}".encode()
            )
            shapes.append(f"/g{code} {stream} 0 R")
            widths.append(str(wide))
        names = " ".join(f"/g{code}" for code in self._letters.values())
        return file.add(
            f"<< /Type /Font /Subtype /Type3 /FontBBox [{box}] /FontMatrix "
            f"[{1 / units:.9f} 0 0 {1 / units:.9f} 0 0] /CharProcs << {' '.join(shapes)} >> "
            f"/Encoding << /Type /Encoding /Differences [1 {names}] >> /FirstChar 1 "
            f"/LastChar {len(widths)} /Widths [{' '.join(widths)}] /Resources << >> "
            f"/ToUnicode {file.stream('', self._meanings().encode())} 0 R >>"
        )

    def _meanings(self) -> str:
        """Return which letter each code means, for searching and copying."""
        lines = [
            f"<{code:02x}> <{letter.encode('utf-16-be', 'replace').hex()}>"
            for letter, code in self._letters.items()
        ]
        parts = [lines[first : first + 100] for first in range(0, len(lines), 100)]
        body = "\n".join(f"{len(p)} beginbfchar\n{chr(10).join(p)}\nendbfchar" for p in parts)
        return (
            "/CIDInit /ProcSet findresource begin 12 dict begin begincmap\n"
            "/CMapName /Letters def /CMapType 2 def\n"
            f"1 begincodespacerange <00> <ff> endcodespacerange\n{body}\n"
            "endcmap CMapName currentdict /CMap defineresource pop end end"
        )


class _Pen(BasePen):  # type: ignore[misc]
    """Takes the outline of a letter as operators; fontTools makes cubic curves of others."""

    def __init__(self, outlines: object) -> None:
        super().__init__(outlines)
        self.operators: list[str] = []

    def _moveTo(self, point: Sequence[float]) -> None:  # noqa: N802  as fontTools calls it
        self.operators.append(f"{point[0]:g} {point[1]:g} m")

    def _lineTo(self, point: Sequence[float]) -> None:  # noqa: N802
        self.operators.append(f"{point[0]:g} {point[1]:g} l")

    def _curveToOne(self, *points: Sequence[float]) -> None:  # noqa: N802
        self.operators.append(" ".join(f"{x:.6g} {y:.6g}" for x, y in points) + " c")

    def _closePath(self) -> None:  # noqa: N802
        self.operators.append("h")


@cache
def _face(*, bold: bool) -> TTFont:
    return TTFont(font_file(bold=bold), lazy=True)


def _colour(text: str) -> str:
    return " ".join(f"{part / 255.0:.4g}" for part in rgb(text))


def _path(primitive: Shape | Marks) -> str:
    if isinstance(primitive, Shape):
        return "\n".join(
            _chain(chain, closed=primitive.closed) for chain in primitive.chains if len(chain)
        )
    if primitive.sign == "o":
        return "\n".join(_circle(x, y, primitive.size_pt / 2.0) for x, y in primitive.points)
    corners = primitive.size_pt * SIGNS[primitive.sign]
    is_open = primitive.sign in OPEN_SIGNS
    chains = [corners[:2], corners[3:]] if is_open else [corners]
    return "\n".join(
        _chain(chain + place, closed=not is_open) for place in primitive.points for chain in chains
    )


def _chain(points: Floats, *, closed: bool) -> str:
    first, *others = (f"{x:.2f} {y:.2f}" for x, y in np.asarray(points).tolist())
    # A line of one point is a dot where ends are round.
    lines = " ".join(f"{place} l" for place in others or [first])
    return f"{first} m {lines}{' h' if closed else ''}"


def _circle(x: float, y: float, radius: float) -> str:
    hand = _ROUND * radius
    quarters = [
        (radius, hand, hand, radius, 0.0, radius), (-hand, radius, -radius, hand, -radius, 0.0),
        (-radius, -hand, -hand, -radius, 0.0, -radius), (hand, -radius, radius, -hand, radius, 0.0),
    ]  # fmt: skip
    curves = [
        " ".join(f"{value + (x, y)[at % 2]:.3f}" for at, value in enumerate(quarter)) + " c"
        for quarter in quarters
    ]
    return f"{x + radius:.3f} {y:.3f} m {' '.join(curves)} h"
