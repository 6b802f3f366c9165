"""SVG drawings: path data, shapes, groups, uses and styles.

`svgelements` reads path data and transforms. Their grammar is checked here: it accepts unknown
commands, infinite coordinates and paths without a move, and its errors name no position. Elements
are walked and moved here: it draws symbols that are not used, knows no view box of those that are,
and keeps the axes of a sheared arc at right angles (0.5 % of a rounded rectangle under skewX(20)).
"""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from xml.parsers import expat

import numpy as np
import svgelements as svg
from svgelements import Matrix, Viewbox

from vinefab.core.errors import BadInputError, UnknownNameError, UnreadableFileError, located
from vinefab.core.foreign import reading_element
from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats
from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.importers.source_drawing import (
    Arc,
    Bezier,
    CurvePiece,
    DrawingItem,
    DrawingReader,
    Ring,
    SourceDrawing,
    Straight,
    drawing_map,
)
from vinefab.maps.importers.source_unit import SourceUnit
from vinefab.model.files.shipped import read_bytes
from vinefab.model.map import Map

WIDTH_ATTRIBUTE = "data-width"
"""Of a line of a skeleton: its lay-flat width in user units; strokes are for the eye."""

LARGEST_NUMBER = 1e12
"""Of a coordinate, length or factor: products of a few stay finite, and no drawing needs more."""


@dataclass(slots=True)
class Node:
    """An element."""

    tag: str  # without namespace
    attributes: dict[str, str]  # by name without namespace
    line: int  # where it begins
    children: list["Node"] = field(default_factory=list)  # in order
    text: str = ""  # characters directly in it

    @property
    def where(self) -> str:
        """Its name in messages."""
        name = self.attributes.get("id")
        return f"{self.tag}{f' {name!r}' if name else ''} (line {self.line})"


def read_nodes(path: Path) -> Node:
    """Return the root of an SVG file."""
    data = read_bytes(path)
    if not data.strip():
        raise UnreadableFileError(path, "is empty")
    builder = _Builder(path)
    parser = expat.ParserCreate(namespace_separator="}")
    parser.buffer_text = True
    builder.parser = parser
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.characters
    parser.EntityDeclHandler = builder.entity
    try:
        parser.Parse(data, True)  # noqa: FBT003  expat's isfinal
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise UnreadableFileError(path, f"is not SVG: {error}") from None
    if builder.root is None or builder.root.tag != "svg":
        raise UnreadableFileError(path, "is not SVG: its root is not <svg>")
    return builder.root


class _Builder:
    """Builds nodes from a parser's events."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.parser: expat.XMLParserType | None = None
        self.root: Node | None = None
        self.open: list[Node] = []

    @property
    def line(self) -> int:
        return self.parser.CurrentLineNumber if self.parser is not None else 0

    def start(self, name: str, attributes: dict[str, str]) -> None:
        plain: dict[str, str] = {}
        for key, value in attributes.items():
            # An attribute without namespace precedes one of the same name with.
            if "}" not in key or _plain(key) not in attributes:
                plain[_plain(key)] = value
        node = Node(_plain(name), plain, self.line)
        if self.open:
            self.open[-1].children.append(node)
        else:
            self.root = node
        self.open.append(node)

    def end(self, name: str) -> None:  # noqa: ARG002  expat passes it
        self.open.pop()

    def characters(self, text: str) -> None:
        if self.open and self.open[-1].tag == "style":
            self.open[-1].text += text

    def entity(
        self,
        name: str,
        is_parameter: int,  # noqa: ARG002  expat passes it
        value: str | None,
        *outside: str | None,  # noqa: ARG002  expat passes them
    ) -> None:
        if value is None or "&" in value or "%" in value:
            raise UnreadableFileError(
                self.path, f"declares the entity {name!r}, which is nested or external"
            )


def _plain(name: str) -> str:
    return name.rpartition("}")[2]


_UNITS_PX = {
    "": 1.0,
    "px": 1.0,
    "mm": 96.0 / 25.4,
    "cm": 960.0 / 25.4,
    "q": 24.0 / 25.4,
    "in": 96.0,
    "pt": 96.0 / 72.0,
    "pc": 16.0,
}
NUMBER = r"[+-]?(?:\d++\.?+\d*+|\.\d++)(?:[eE][+-]?\d++)?+"
_LENGTH = re.compile(rf"\s*+({NUMBER})\s*+([a-zA-Z%]*+)\s*+")
_TRANSFORM = re.compile(r"[\s,]*+(\w++)\s*+\(([^)]*+)\)[\s,]*+")
_OPERANDS = {
    "matrix": (6,),
    "translate": (1, 2),
    "scale": (1, 2),
    "rotate": (1, 3),
    "skewX": (1,),
    "skewY": (1,),
}
IDENTITY = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])


def length_px(node: Node, name: str) -> float:
    """Return an attribute that is a length, in user units (px); 0 where it is left out."""
    text = node.attributes.get(name)
    if text is None or text.strip() == "auto":
        return 0.0
    match = _LENGTH.fullmatch(text)
    if (
        match is None
        or match[2].lower() not in _UNITS_PX
        or not abs(float(match[1])) <= LARGEST_NUMBER
    ):
        allowed = "a number up to 1e12, perhaps with px, mm, cm, in, pt or pc"
        raise BadInputError(f"{node.where}: {name}", text, allowed)
    return float(match[1]) * _UNITS_PX[match[2].lower()]


def page_frame(root: Node) -> tuple[Floats, SourceUnit]:
    """Return the frame set by the outermost element.

    Returns
    -------
    tuple
        View box as x, y, width, height in user units (zeros where there is none), and the unit.
    """
    box = _view_box(root)
    texts = [root.attributes.get(name, "").strip().lower() for name in ("width", "height")]
    size = [
        length_px(root, name) if text and not text.endswith("%") else 0.0
        for name, text in zip(("width", "height"), texts, strict=True)
    ]
    mm_per_px = 25.4 / 96.0
    if box is None:
        whole = np.array([0.0, 0.0, *np.maximum(size, 0.0)])
        return whole, SourceUnit(name="px", mm=mm_per_px, known="guess", by="1/96 inch; no viewBox")
    known = [side / part for side, part in zip(size, box[2:], strict=True) if side > 0.0]
    if not known:
        by = "1/96 inch; no absolute width or height"
        return box, SourceUnit(name="px", mm=mm_per_px, known="guess", by=by)
    # Rounded: 210 mm for 210 units is 1 mm, whatever the last bit of 96 / 25.4 says.
    mm_per_unit = float(f"{min(known) * mm_per_px:.12g}")
    if any(text.removesuffix("px")[-1:].isalpha() for text in texts):
        by = "width, height and viewBox"
        return box, SourceUnit(name="user unit", mm=mm_per_unit, known="file", by=by)
    by = "1/96 inch; width and height name no other unit"
    return box, SourceUnit(name="px", mm=mm_per_unit, known="guess", by=by)


def _view_box(node: Node) -> Floats | None:
    """Return x, y, width and height of a view box, None if there is none."""
    text = node.attributes.get("viewBox")
    if text is None:
        return None
    values = _numbers(text, f"{node.where}: viewBox")
    if len(values) != 4 or values[2] <= 0.0 or values[3] <= 0.0:
        raise BadInputError(f"{node.where}: viewBox", text, "x y width height, sizes above 0")
    return np.array(values)


def viewport(node: Node) -> Floats:
    """Return the affine map of a nested ``svg`` or a used ``symbol``, shape (2, 3)."""
    x, y = length_px(node, "x"), length_px(node, "y")
    box = _view_box(node)
    if box is None or not {"width", "height"} <= set(node.attributes):
        return np.array([[1.0, 0.0, x], [0.0, 1.0, y]])
    place = (x, y, length_px(node, "width"), length_px(node, "height"))
    aspect = node.attributes.get("preserveAspectRatio", "xMidYMid")
    return _affine(Viewbox.viewbox_transform(*place, *box.tolist(), aspect))


def transform(node: Node) -> Floats:
    """Return the affine map in a node's ``transform``, shape (2, 3)."""
    text = node.attributes.get("transform", "")
    at, end = 0, len(text.rstrip())
    while at < end:
        # svgelements leaves out elements that it does not know, or that lack numbers.
        match = _TRANSFORM.match(text, at)
        if match is None:
            raise _bad_transform(node, text)
        values = _numbers(match[2], f"{node.where}: transform")
        if len(values) not in _OPERANDS.get(match[1], ()):
            raise _bad_transform(node, f"{match[1]}({values})")
        at = match.end()
    with reading_element(f"{node.where}: transform", text):
        matrix = _affine(text)
    if abs(np.linalg.det(matrix[:, :2])) < 1e-30:
        raise BadInputError(f"{node.where}: transform", text, "one that is not singular")
    return matrix


def after(outer: Floats, inner: Floats) -> Floats:
    """Return the affine map that applies first the inner, then the outer one."""
    linear = outer[:, :2] @ inner[:, :2]
    return np.column_stack([linear, outer[:, :2] @ inner[:, 2] + outer[:, 2]])


def _affine(text: str) -> Floats:
    found = Matrix(text)
    return np.array([[found.a, found.c, found.e], [found.b, found.d, found.f]])


def numbers(node: Node, name: str) -> list[float]:
    """Return an attribute that is a list of numbers."""
    return _numbers(node.attributes.get(name, ""), f"{node.where}: {name}")


def _numbers(text: str, key: str) -> list[float]:
    # Signs and second points may separate numbers: 1-2 and .5.5 are two each.
    words = re.findall(rf"{NUMBER}|[^\s,]", text)
    try:
        values = [float(word) for word in words]
    except ValueError:
        raise BadInputError(key, text, "numbers") from None
    if not all(abs(value) <= LARGEST_NUMBER for value in values):
        raise BadInputError(key, text, f"numbers up to {LARGEST_NUMBER:g}")
    return values


def _bad_transform(node: Node, text: str) -> BadInputError:
    allowed = "matrix, translate, scale, rotate, skewX and skewY with their numbers"
    return BadInputError(f"{node.where}: transform", text, allowed)


_PATH_DATA = f"path data such as M 0 0 L 9 9 Z, numbers up to {LARGEST_NUMBER:g}"
_N = rf"[\s,]*+{NUMBER}"
_FLAG = r"[\s,]*+[01]"
_PATH = re.compile(
    rf"(?:[\s,]*+(?:[MmLlTt](?:{_N}{_N})++|[HhVv](?:{_N})++|[SsQq](?:(?:{_N}){{4}})++"
    rf"|[Cc](?:(?:{_N}){{6}})++|[Aa](?:{_N}{_N}{_N}{_FLAG}{_FLAG}{_N}{_N})++|[Zz]))*+[\s,]*+"
)
_VALUE = re.compile(NUMBER)


@dataclass(slots=True)
class Subpath:
    """A part of a path between two moves."""

    pieces: list[CurvePiece] = field(default_factory=list)
    closed: bool = False


def path_outlines(data: str) -> list[Subpath]:
    """Return the subpaths of a path's ``d``.

    Examples
    --------
    >>> [(len(run.pieces), run.closed) for run in path_outlines("M0 0h9v9z m20 0 l5,5")]
    [(2, True), (1, False)]
    """
    read = _PATH.match(data)
    end = read.end() if read is not None else 0
    if data[: end + 1].strip(" \t\r\n\f,")[:1] not in ("", "M", "m"):
        end = 0
    huge = (one for one in _VALUE.finditer(data) if not abs(float(one[0])) <= LARGEST_NUMBER)
    end = min(end, next((one.start() for one in huge), end))
    if end < len(data):
        rest = " ".join(data[end:].split())[:30]
        raise BadInputError(f"d, character {end + 1}", rest, _PATH_DATA)
    runs: list[Subpath] = []
    for segment in svg.Path(data):
        if isinstance(segment, svg.Move):
            runs.append(Subpath())
        elif isinstance(segment, svg.Close):
            runs[-1].closed = True
        else:
            if runs[-1].closed:
                # A segment after a close begins a new subpath at the same place.
                runs.append(Subpath())
            runs[-1].pieces += _curve(segment)
    return [run for run in runs if run.pieces]


def _curve(segment: object) -> list[CurvePiece]:
    least_radius = 1e-12  # of an arc: below, it is a straight line
    match segment:
        case svg.CubicBezier():
            points = (segment.start, segment.control1, segment.control2, segment.end)
            return [Bezier(np.array(points, dtype=np.float64))]
        case svg.QuadraticBezier():
            start, control, end = np.array([segment.start, segment.control, segment.end])
            thirds = (start + 2.0 * control) / 3.0, (end + 2.0 * control) / 3.0
            return [Bezier(np.array([start, *thirds, end]))]
        case svg.Arc() if segment.start == segment.end:
            return []
        case svg.Arc() if min(segment.rx, segment.ry) >= least_radius:
            middle, first, second = np.array([segment.center, segment.prx, segment.pry])
            arc = Arc(
                middle=middle,
                first=first - middle,
                second=second - middle,
                start_rad=segment.get_start_t(),
                turn_rad=segment.sweep,
            )
            return [arc]
        case svg.PathSegment():
            return [Straight(np.array([segment.start, segment.end], dtype=np.float64))]
    raise TypeError(f"a segment of the unknown kind {type(segment).__name__}")


def _rectangle(
    x: float, y: float, size: tuple[float, float], radii: tuple[float, float]
) -> Subpath:
    """Return a rectangle, its corners rounded by elliptical radii (0 for sharp ones)."""
    width, height = size
    rx, ry = min(radii[0], 0.5 * width), min(radii[1], 0.5 * height)
    if rx <= 0.0 or ry <= 0.0:
        corners = [(x, y), (x + width, y), (x + width, y + height), (x, y + height)]
        return Subpath([Straight(np.array(corners, dtype=np.float64))], closed=True)
    pieces: list[CurvePiece] = []
    for index, (side_x, side_y) in enumerate(((1, 1), (0, 1), (0, 0), (1, 0))):
        middle = (x + rx + side_x * (width - 2 * rx), y + ry + side_y * (height - 2 * ry))
        arc = Arc(
            middle=np.array(middle),
            first=np.array([rx, 0.0]),
            second=np.array([0.0, ry]),
            start_rad=0.5 * math.pi * index,
            turn_rad=0.5 * math.pi,
        )
        pieces.append(arc)
    return Subpath(pieces, closed=True)


def _moved(piece: CurvePiece, matrix: Floats) -> CurvePiece:
    """Return a piece transformed by an affine map, shape (2, 3)."""
    linear, shift = matrix[:, :2], matrix[:, 2]
    if isinstance(piece, Straight):
        return Straight(piece.points @ linear.T + shift)
    if isinstance(piece, Bezier):
        return Bezier(piece.controls @ linear.T + shift)
    if not isinstance(piece, Arc):
        raise TypeError(f"no affine map for {type(piece).__name__}")
    return Arc(
        middle=linear @ piece.middle + shift,
        first=linear @ piece.first,
        second=linear @ piece.second,
        start_rad=piece.start_rad,
        turn_rad=piece.turn_rad,
    )


_GROUPS = {"svg", "g", "a", "switch", "symbol"}
_SHAPES = {"path", "rect", "circle", "ellipse", "line", "polyline", "polygon"}
_DRAWN = _GROUPS | _SHAPES | {"use"}
_SILENT = {
    "defs", "title", "desc", "metadata", "style", "script", "namedview", "clipPath", "mask",
    "marker", "pattern", "linearGradient", "radialGradient", "filter", "symbol",
}  # fmt: skip
_PAGE_IS_AREA = (
    "its background is an outline too; --drawn free if the areas on it are the free space"
)
_COMMENT = re.compile(r"/\*.*?(?:\*/|\Z)", re.DOTALL)
_PROPERTIES = {"clip-path", "display", "fill", "fill-rule", "stroke", "visibility"}


@dataclass(frozen=True, slots=True)
class _Place:
    """Properties that an element inherits."""

    matrix: Floats
    layers: tuple[str, ...]
    filled: bool
    even_odd: bool = False
    uses: tuple[str, ...] = ()  # names of the elements that are used around it


def import_svg(path: Path, options: ImportOptions) -> Map:
    """Return the map in an SVG drawing.

    All shapes are outlines or lines, whatever their colour. With ``wall_mm`` shapes without fill
    are walls of that thickness, filled ones outlines. The lower left corner of the page is the
    map's origin.
    """
    drawing = _source(path, options, lines_only=False)
    return replace(drawing_map(path, drawing, options), environment="svg")


def svg_source(path: Path, options: ImportOptions) -> SourceDrawing:
    """Return the lines of an SVG drawing in the groups that are asked for, curves as curves.

    The background of the page is left out.
    """
    return _source(path, options, lines_only=True)


def _source(path: Path, options: ImportOptions, *, lines_only: bool) -> SourceDrawing:
    root = read_nodes(path)
    # What overflows in nested transforms is found, and named, by `drawing_map`.
    try:
        with located(path), np.errstate(over="ignore", invalid="ignore"):
            return _drawing(root, options, lines_only=lines_only)
    except RecursionError:
        raise UnreadableFileError(path, "has elements nested too deep") from None


def _drawing(root: Node, options: ImportOptions, *, lines_only: bool) -> SourceDrawing:
    box, unit = page_frame(root)
    walls, free = options.wall_mm is not None, options.drawn == "free"
    walk = _Walk(
        frozenset(options.layers),
        root=root,
        page=box,
        walls=walls,
        free=free,
        lines_only=lines_only,
    )
    items = walk.items()
    unknown = sorted(set(options.layers) - walk.names)
    if unknown:
        raise UnknownNameError("layer or group", unknown[0], walk.names)
    return SourceDrawing(
        items=tuple(items),
        unit=unit,
        down=True,
        layered=len(walk.drawn_in) > 1,
        origin=(float(box[0]), float(box[1] + box[3])),
        facts={
            **walk.facts(options.layers, "elements"),
            **({"page": _PAGE_IS_AREA} if walk.backgrounds and options.drawn is None else {}),
        },
    )


@dataclass(slots=True)
class _Walk(DrawingReader):
    """Traversal of the elements of a drawing."""

    root: Node = field(kw_only=True)
    page: Floats = field(kw_only=True)
    walls: bool = field(kw_only=True)
    free: bool = field(kw_only=True)
    lines_only: bool = field(kw_only=True)
    names: set[str] = field(default_factory=set)
    drawn_in: set[tuple[str, ...]] = field(default_factory=set)  # groups of the elements read
    by_id: dict[str, Node] = field(default_factory=dict)
    styles: dict[str, dict[str, str]] = field(default_factory=dict)
    backgrounds: list[DrawingItem] = field(default_factory=list)
    seen: int = 0

    def items(self) -> list[DrawingItem]:
        nodes = [self.root]
        while nodes:
            node = nodes.pop()
            nodes += reversed(node.children)
            self.by_id.setdefault(node.attributes.get("id", ""), node)
            if node.tag == "style":
                self.styles |= _rules(node.text)
        place = _Place(IDENTITY, (), filled=True)
        found = [item for node in self.root.children for item in self._items(node, place)]
        if self.lines_only:
            return [item for item in found if not any(item is page for page in self.backgrounds)]
        return self._without_backgrounds(found)

    def _items(self, node: Node, place: _Place) -> Iterator[DrawingItem]:
        self.seen += 1
        style = self._style(node)
        if self._left_out(node, style, place):
            return
        place = self._inner(node, style, place)
        if node.tag in _GROUPS:
            for child in node.children:
                yield from self._items(child, place)
        elif node.tag == "use":
            yield from self._used(node, place)
        else:
            yield from self._drawn(node, style, place)

    def _left_out(self, node: Node, style: dict[str, str], place: _Place) -> bool:
        """Return whether an element draws nothing; count it if it might be expected to."""
        if node.tag in _SILENT and not (node.tag == "symbol" and place.uses):
            return True
        if node.tag not in _DRAWN:
            self.ignored[node.tag] += 1
        elif style.get("display") == "none":
            self.ignored["display:none"] += 1
        else:
            if style.get("clip-path", "none") != "none":
                self.ignored["clip-path"] += 1
            return False
        return True

    def _style(self, node: Node) -> dict[str, str]:
        """Return an element's own properties: attributes, then style sheets, then its style."""
        attributes = node.attributes
        names = [node.tag, *(f".{name}" for name in attributes.get("class", "").split())]
        found = dict(attributes)
        for name in [*names, f"#{attributes.get('id', '')}"]:
            found |= self.styles.get(name, {})
        return found | _declarations(attributes.get("style", ""))

    def _inner(self, node: Node, style: dict[str, str], place: _Place) -> _Place:
        matrix = after(place.matrix, transform(node))
        if node.tag in ("svg", "symbol"):
            matrix = after(matrix, viewport(node))
        layers = place.layers
        if node.tag in _GROUPS or node.tag == "use":
            names = [node.attributes[key] for key in ("id", "label") if key in node.attributes]
            self.names.update(names)
            layers = (*layers, *names)
        fill = style.get("fill", "inherit").strip()
        filled = place.filled if fill == "inherit" else fill not in ("none", "transparent")
        rule = style.get("fill-rule", "inherit").strip()
        even_odd = place.even_odd if rule == "inherit" else rule == "evenodd"
        return _Place(matrix, layers, filled, even_odd, place.uses)

    def _used(self, node: Node, place: _Place) -> Iterator[DrawingItem]:
        name = node.attributes.get("href", "")
        target = self.by_id.get(name.removeprefix("#")) if name.startswith("#") else None
        if target is None:
            raise BadInputError(f"{node.where}: href", name, "the id of an element in the file")
        if name in place.uses:
            raise BadInputError(node.where, "a use that contains itself", "uses of other elements")
        shift = np.array([[1.0, 0.0, length_px(node, "x")], [0.0, 1.0, length_px(node, "y")]])
        place = replace(place, matrix=after(place.matrix, shift), uses=(*place.uses, name))
        if target.tag in ("symbol", "svg"):
            size = {k: v for k, v in node.attributes.items() if k in ("width", "height")}
            target = replace(target, attributes=target.attributes | size)
        yield from self._items(target, place)

    def _drawn(self, node: Node, style: dict[str, str], place: _Place) -> Iterator[DrawingItem]:
        if self.layers and not self.layers & set(place.layers):
            self.ignored["in other groups"] += 1
            return
        if style.get("visibility") in ("hidden", "collapse"):
            self.ignored["hidden"] += 1
            return
        self.read[node.tag] += 1
        self.drawn_in.add(place.layers)
        own = [node.attributes[key] for key in ("id", "label") if key in node.attributes]
        width = 0.0
        if self.lines_only:
            stretch = math.sqrt(abs(float(np.linalg.det(place.matrix[:, :2]))))
            width = length_px(node, WIDTH_ATTRIBUTE) * stretch
        for run in svg_outlines(node):
            pieces = tuple(_moved(piece, place.matrix) for piece in run.pieces)
            ring = Ring(pieces=pieces)
            # A fill closes an open path with a straight line.
            fills = place.filled and len(ring.hull()) > 2
            item = DrawingItem(
                rings=(ring,),
                where=node.where,
                closed=run.closed or fills,
                role="obstacle" if self.walls and fills else None,
                paint=self.seen if fills else None,
                even_odd=place.even_odd,
                names=(*place.layers, *own),
                width=width or None,
                unjoined=not run.closed,
            )
            if fills and style.get("stroke", "none") == "none" and self._is_page(ring):
                self.backgrounds.append(item)
            yield item

    def _without_backgrounds(self, items: list[DrawingItem]) -> list[DrawingItem]:
        """Return items without the page's background, unless it is the bounds of the others."""
        rest = [item for item in items if not any(item is page for page in self.backgrounds)]
        if not self.backgrounds or len(rest) < 2:
            return items
        painted = any(item.paint is not None for item in rest)
        if not (self.free and painted):
            hulls = [item.rings[0].hull() for item in rest]
            low = np.array([hull.min(axis=0) for hull in hulls])
            high = np.array([hull.max(axis=0) for hull in hulls])
            around = (low <= low.min(axis=0)).all(axis=1) & (high >= high.max(axis=0)).all(axis=1)
            if not around.any():
                return items
        self.ignored["background of the page"] += len(self.backgrounds)
        self.backgrounds.clear()
        return rest

    def _is_page(self, ring: Ring) -> bool:
        """Return whether an outline is the rectangle of the page."""
        points, corner, size = ring.hull(), self.page[:2], self.page[2:]
        page_slack = 5e-5  # of the page's larger side: programs round the corners of its background
        slack = page_slack * float(size.max())
        low = np.abs(points.min(axis=0) - corner).max()
        high = np.abs(points.max(axis=0) - corner - size).max()
        if not (size.min() > 0.0 and low <= slack and high <= slack):
            return False
        return len(np.unique(points, axis=0)) == 4


def svg_outlines(node: Node) -> list[Subpath]:
    """Return the subpaths of a shape, in its own coordinates."""
    try:
        if node.tag == "path":
            data = node.attributes.get("d", "")
            with reading_element("d", data):
                return path_outlines(data)
    except BadInputError as error:
        raise error.under(f"{node.where}: {error.key}") from None
    if node.tag in ("polyline", "polygon"):
        values = numbers(node, "points")
        if len(values) % 2:
            raise BadInputError(
                f"{node.where}: points", counted(len(values), "number"), "x,y pairs"
            )
        points = np.array(values).reshape(-1, 2)
        run = Subpath([Straight(points)], closed=node.tag == "polygon")
        return [run] if len(points) >= 2 else []
    names = ("x", "y", "width", "height", "rx", "ry", "r", "cx", "cy", "x1", "y1", "x2", "y2")
    at = {name: length_px(node, name) if name in node.attributes else 0.0 for name in names}
    for name in ("width", "height", "rx", "ry", "r"):
        if at[name] < 0.0:
            raise BadInputError(f"{node.where}: {name}", at[name], "at least 0")
    if node.tag == "line":
        return [Subpath([Straight(np.array([[at["x1"], at["y1"]], [at["x2"], at["y2"]]]))])]
    rx, ry = (at[name] or at[other] for name, other in (("rx", "ry"), ("ry", "rx")))
    if node.tag == "rect":
        size = (at["width"], at["height"])
        return [_rectangle(at["x"], at["y"], size, (rx, ry))] if min(size) > 0.0 else []
    radii = (at["r"], at["r"]) if node.tag == "circle" else (rx, ry)
    middle = np.array([at["cx"], at["cy"]])
    whole = Arc(middle=middle, first=np.array([radii[0], 0.0]), second=np.array([0.0, radii[1]]))
    return [Subpath([whole], closed=True)] if min(radii) > 0.0 else []


def _rules(sheet: str) -> dict[str, dict[str, str]]:
    """Return the declarations of a style sheet's simple selectors: tag, .class and #id."""
    found: dict[str, dict[str, str]] = {}
    for block in _COMMENT.sub("", sheet).split("}"):
        head, brace, body = block.rpartition("{")
        declared = _declarations(body) if brace else {}
        # Of `@media print { rect` the selectors stand after the other brace.
        for selector in head.rpartition("{")[2].split(",") if declared else ():
            found.setdefault(selector.strip(), {}).update(declared)
    return found


def _declarations(text: str) -> dict[str, str]:
    pairs = (part.partition(":") for part in text.split(";"))
    named = ((name.strip(), value.strip()) for name, colon, value in pairs if colon)
    return {name: value for name, value in named if name in _PROPERTIES}
