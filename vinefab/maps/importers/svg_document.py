"""SVG documents: elements with line numbers, lengths, transforms and view boxes."""

import re
from dataclasses import dataclass, field
from pathlib import Path
from xml.parsers import expat

import numpy as np
from svgelements import Matrix, Viewbox

from vinefab.core.errors import BadInputError, UnreadableFileError
from vinefab.core.validation import Floats
from vinefab.model.files.shipped import read_bytes

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
        raise UnreadableFileError(path, f"is not SVG: {error}") from error
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


_MM_PER_PX = 25.4 / 96.0
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


def length_px(node: Node, name: str, default: float = 0.0) -> float:
    """Return an attribute that is a length, in user units (px)."""
    text = node.attributes.get(name)
    if text is None or text.strip() == "auto":
        return default
    match = _LENGTH.fullmatch(text)
    if (
        match is None
        or match[2].lower() not in _UNITS_PX
        or not abs(float(match[1])) <= LARGEST_NUMBER
    ):
        allowed = "a number up to 1e12, perhaps with px, mm, cm, in, pt or pc"
        raise BadInputError(f"{node.where}: {name}", text, allowed)
    return float(match[1]) * _UNITS_PX[match[2].lower()]


def page_frame(root: Node) -> tuple[Floats, float, str]:
    """Return the frame set by the outermost element.

    Returns
    -------
    tuple
        View box as x, y, width, height in user units (zeros where there is none); millimetres
        per user unit in x; and the origin of that scale, as text.
    """
    box = _view_box(root)
    size = tuple(_absolute(root, name) for name in ("width", "height"))
    if box is None:
        whole = np.array([0.0, 0.0, size[0] or 0.0, size[1] or 0.0])
        return whole, _MM_PER_PX, "px of 1/96 inch (no viewBox)"
    known = [side / part for side, part in zip(size, box[2:], strict=True) if side is not None]
    if not known:
        return box, _MM_PER_PX, "px of 1/96 inch (no absolute width or height)"
    # Rounded: 210 mm for 210 units is 1 mm, whatever the last bit of 96 / 25.4 says.
    return box, float(f"{min(known) * _MM_PER_PX:.12g}"), _scale_origin(root)


def _scale_origin(root: Node) -> str:
    """Return what set the scale of a page with a size: a unit, or pixels for want of one."""
    sides = [root.attributes.get(name, "").strip().lower() for name in ("width", "height")]
    if any(side.removesuffix("px")[-1:].isalpha() for side in sides):
        return "width, height and viewBox"
    return "px of 1/96 inch (taken; width and height name no other unit)"


def _absolute(root: Node, name: str) -> float | None:
    """Return the page's width or height in px, None if it is not given or in percent."""
    text = root.attributes.get(name, "")
    value = length_px(root, name) if text and not text.strip().endswith("%") else 0.0
    return value if value > 0.0 else None


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
        # svgelements leaves out what it does not know, and what lacks numbers.
        match = _TRANSFORM.match(text, at)
        if match is None:
            raise _bad_transform(node, text)
        values = _numbers(match[2], f"{node.where}: transform")
        if len(values) not in _OPERANDS.get(match[1], ()):
            raise _bad_transform(node, f"{match[1]}({values})")
        at = match.end()
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
    except ValueError as error:
        raise BadInputError(key, text, "numbers") from error
    if not all(abs(value) <= LARGEST_NUMBER for value in values):
        raise BadInputError(key, text, f"numbers up to {LARGEST_NUMBER:g}")
    return values


def _bad_transform(node: Node, text: str) -> BadInputError:
    allowed = "matrix, translate, scale, rotate, skewX and skewY with their numbers"
    return BadInputError(f"{node.where}: transform", text, allowed)
