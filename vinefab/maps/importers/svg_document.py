"""SVG documents: elements, the cascade of their styles, lengths, transforms and the page.

Styles are found as a browser finds them: presentation attributes, style sheets (parsed by tinycss2,
selected by cssselect2), ``style``, each with ``!important``. What hides or moves a shape and is not
understood is refused with its name.
"""

import math
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element
from xml.parsers import expat

import cssselect2
import numpy as np
import tinycss2
from svgelements import Matrix, Viewbox

from vinefab.core.errors import BadInputError, UnfitInputError, UnreadableFileError
from vinefab.core.foreign import reading_element
from vinefab.core.validation import Floats
from vinefab.maps.importers.source_unit import SourceUnit
from vinefab.model.files.shipped import read_bytes

LARGEST_NUMBER = 1e12
"""Of a coordinate, length or factor: products of a few stay finite, and no drawing needs more."""

INHERITED = {
    "clip-rule": "nonzero",
    "fill": "black",
    "fill-opacity": "1",
    "fill-rule": "nonzero",
    "stroke": "none",
    "stroke-opacity": "1",
    "stroke-width": "1",
    "visibility": "visible",
}
"""Properties that an element takes from the one around it, and their initial values."""

GEOMETRY = {"x", "y", "width", "height", "cx", "cy", "r", "rx", "ry"}
_PROPERTIES = {
    *(INHERITED.keys() | GEOMETRY),
    *("clip-path", "d", "display", "font-size", "mask", "opacity", "overflow"),
    *("transform", "transform-box", "transform-origin"),
}
_MOVING = {"animation", "animation-name", "offset-path", "rotate", "scale", "translate", "zoom"}
"""Properties that move a shape and are not read."""


class Node(Element):
    """An element; tag and names of attributes are without namespace."""

    line: int = 0  # where it begins
    program: str = ""  # of the root: comments and attributes that tell the program that wrote it
    declared: dict[str, str] | None = None  # its own properties after the cascade

    @property
    def style(self) -> dict[str, str]:
        """Its own properties by name, before inheritance."""
        return self.attrib if self.declared is None else self.declared

    @property
    def children(self) -> list["Node"]:
        """The elements in it, in order."""
        return [one for one in self if isinstance(one, Node)]

    def nodes(self) -> Iterator["Node"]:
        """Yield itself and all elements in it, in order."""
        return (one for one in self.iter() if isinstance(one, Node))

    @property
    def where(self) -> str:
        """Its name in messages."""
        name = self.get("id")
        return f"{self.tag}{f' {name!r}' if name else ''} (line {self.line})"


def read_nodes(path: Path) -> Node:
    """Return the root of an SVG file."""
    data = read_bytes(path)
    if not data.strip():
        raise UnreadableFileError(path, "is empty")
    builder = _Builder(path)
    # Without namespaces: browsers draw shapes with attributes of prefixes that no one declares.
    parser = expat.ParserCreate()
    parser.buffer_text = True
    builder.parser = parser
    parser.StartElementHandler = builder.start
    parser.EndElementHandler = builder.end
    parser.CharacterDataHandler = builder.characters
    parser.CommentHandler = builder.comment
    parser.ProcessingInstructionHandler = builder.instruction
    parser.EntityDeclHandler = builder.entity
    try:
        parser.Parse(data, True)  # noqa: FBT003  expat's isfinal
    except (expat.ExpatError, ValueError, LookupError) as error:
        raise UnreadableFileError(path, f"is not SVG: {error}") from None
    if builder.root is None or builder.root.tag != "svg":
        raise UnreadableFileError(path, "is not SVG: its root is not <svg>")
    builder.root.program = " ".join([*builder.comments, builder.root.program])
    return builder.root


class _Builder:
    """Builds nodes from a parser's events."""

    _SVG = "http://www.w3.org/2000/svg"
    _DEEPEST = 250

    def __init__(self, path: Path) -> None:
        self.path = path
        self.parser: expat.XMLParserType | None = None
        self.root: Node | None = None
        self.open: list[Node] = []
        self.prefixes: dict[str, str] = {}
        self.comments: list[str] = []

    @property
    def line(self) -> int:
        return self.parser.CurrentLineNumber if self.parser is not None else 0

    def start(self, name: str, attributes: dict[str, str]) -> None:
        for key, value in attributes.items():
            if key.startswith("xmlns:"):
                self.prefixes[key[6:]] = value
        # An attribute without namespace precedes one of the same name with.
        named = sorted(attributes.items(), key=lambda pair: ":" not in pair[0])
        prefix, _, tag = name.rpartition(":")
        if prefix and self.prefixes.get(prefix, self._SVG) != self._SVG:
            tag = name
        node = Node(tag, {key.rpartition(":")[2]: value for key, value in named})
        node.line = self.line
        if self.open:
            self.open[-1].append(node)
        else:
            self.root = node
            told = ("inkscape:version", "sodipodi:version", "data-name")
            node.program = " ".join(f"{key}={attributes[key]}" for key in told if key in attributes)
        self.open.append(node)
        if len(self.open) > self._DEEPEST:
            raise UnreadableFileError(self.path, "has elements nested too deep")

    def end(self, name: str) -> None:  # noqa: ARG002  expat passes it
        self.open.pop()

    def characters(self, text: str) -> None:
        if self.open and self.open[-1].tag == "style":
            self.open[-1].text = (self.open[-1].text or "") + text

    def comment(self, text: str) -> None:
        if len(self.comments) < 20:
            self.comments.append(text[:200])

    def instruction(self, target: str, data: str) -> None:
        if target == "xml-stylesheet":
            raise UnfitInputError(
                f"line {self.line}",
                f"has a style sheet of another file ({data[:60]})",
                "put its rules into a <style> of the drawing",
                self.path,
            )

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


# --- Styles ---------------------------------------------------------------------------------------


@dataclass(slots=True)
class _Declared:
    """Properties that one rule or one ``style`` sets."""

    plain: dict[str, str]
    important: dict[str, str]

    def __bool__(self) -> bool:
        return bool(self.plain or self.important)


def cascade(root: Node) -> None:
    """Find the properties of every element of a document, and set them."""
    matcher = cssselect2.Matcher()
    for node in root.nodes():
        if node.tag != "style":
            continue
        sheet = node.get("media", "all")
        if node.get("type", "text/css") in ("", "text/css") and _applies(sheet, node.where):
            _add_rules(matcher, _parsed(node.text or ""), node.where)
    has_rules = bool(matcher.order)
    for wrapped in cssselect2.ElementWrapper.from_xml_root(root).iter_subtree():
        node = wrapped.etree_element
        own = node.get("style", "")
        if not (own or has_rules):
            continue
        layers = [one[3] for one in sorted(matcher.match(wrapped), key=lambda one: one[:2])]
        if own:
            parsed = _block(own)
            layers.append(_declarations(parsed, node.where))
        found = dict(node.attrib)
        for part in ("plain", "important"):
            for layer in layers:
                found |= getattr(layer, part)
        node.declared = found


def _add_rules(matcher: cssselect2.Matcher, rules: Iterable[Any], where: str) -> None:
    """Add the rules of a style sheet that set a property that is read."""
    for rule in rules:
        if rule.type == "at-rule":
            _add_at_rule(matcher, rule, where)
        elif rule.type == "qualified-rule":
            parsed = _block(rule.content)
            declared = _declarations(parsed, where)
            if not declared:
                continue
            try:
                selectors = cssselect2.compile_selector_list(rule.prelude)
            except cssselect2.SelectorError:
                shown = tinycss2.serialize(rule.prelude).strip()
                raise _not_read(where, f"the selector {shown!r}") from None
            for selector in selectors:
                if selector.pseudo_element is None:
                    matcher.add_selector(selector, declared)


def _parsed(sheet: Any) -> list[Any]:  # noqa: ANN401  text, or parsed tokens
    return list(tinycss2.parse_stylesheet(sheet, skip_comments=True, skip_whitespace=True))


def _block(content: Any) -> list[Any]:  # noqa: ANN401  text, or parsed tokens
    return list(tinycss2.parse_blocks_contents(content, skip_comments=True, skip_whitespace=True))


_HARMLESS = {"charset", "font-face", "keyframes", "namespace", "page", "property", "counter-style"}


def _add_at_rule(matcher: cssselect2.Matcher, rule: Any, where: str) -> None:  # noqa: ANN401  untyped
    kind = rule.lower_at_keyword.removeprefix("-webkit-")
    head = tinycss2.serialize(rule.prelude).strip()
    if kind == "media" and rule.content is not None:
        if _applies(head, where):
            _add_rules(matcher, _parsed(rule.content), where)
    elif kind not in _HARMLESS and not (kind == "import" and "font" in head):
        raise _not_read(where, f"@{kind} {head[:40]}")


def _applies(query: str, where: str) -> bool:
    """Return whether a list of media queries holds on a screen."""
    parts = [" ".join(part.lower().removeprefix("only ").split()) for part in query.split(",")]
    known = {"": True, "all": True, "screen": True, "print": False, "not print": True,
             "not screen": False, "speech": False, "not all": False}  # fmt: skip
    unknown = [part for part in parts if part not in known]
    if any(known.get(part) for part in parts) or not unknown:
        return any(known.get(part) for part in parts)
    raise _not_read(where, f"@media {unknown[0][:40]}")


def _declarations(parsed: Iterable[Any], where: str) -> _Declared:
    """Return the properties in a block that are read; what moves shapes and is not is refused."""
    found = _Declared({}, {})
    for one in parsed:
        if one.type in ("qualified-rule", "at-rule"):
            raise _not_read(where, "a rule in a rule")
        if one.type != "declaration":
            continue
        name, value = one.lower_name, tinycss2.serialize(one.value).strip()
        if name in _MOVING and value not in ("none", "auto", "1", "initial", "unset"):
            raise _not_read(where, f"{name}: {value[:40]}")
        if name == "font":
            size = re.search(r"(?<!\S)([\d.]+(?:px|pt|em|mm|%))(?:/|\s|$)", value)
            name, value = "font-size", size[1] if size else "medium"
        if name not in _PROPERTIES:
            continue
        if "var(" in value and name not in ("fill", "stroke"):
            raise _not_read(where, f"{name}: {value[:40]}")
        (found.important if one.important else found.plain)[name] = value
    return found


def _not_read(where: str, what: str) -> UnfitInputError:
    remedy = "it may hide or move shapes: save as plain SVG, or take it out"
    return UnfitInputError(where, f"{what} is not read", remedy)


# --- Lengths --------------------------------------------------------------------------------------

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
_EM_PX = 16.0
NUMBER = r"[+-]?(?:\d++\.?+\d*+|\.\d++)(?:[eE][+-]?\d++)?+"
_LENGTH = re.compile(rf"\s*+({NUMBER})\s*+([a-zA-Z%]*+)\s*+")


@dataclass(frozen=True, slots=True)
class View:
    """The sizes that relative lengths refer to."""

    width: float = 0.0  # of the viewport, in user units; 0 if it is not known
    height: float = 0.0
    font_px: float = _EM_PX
    root_font_px: float = _EM_PX

    def reference(self, name: str) -> float:
        """Return the length that is 100 % of a property."""
        if name in ("x", "width", "cx", "rx", "x1", "x2"):
            return self.width
        if name in ("y", "height", "cy", "ry", "y1", "y2"):
            return self.height
        return math.hypot(self.width, self.height) / math.sqrt(2.0)

    def length(self, text: str, name: str, where: str) -> float:
        """Return a length in user units (px)."""
        match = _LENGTH.fullmatch(text)
        unit = match[2].lower() if match is not None else "?"
        relative = {
            "em": self.font_px,
            "rem": self.root_font_px,
            "%": 0.01 * self.reference(name),
        }
        factor = _UNITS_PX.get(unit) or relative.get(unit)
        if match is None or not factor or not abs(float(match[1])) <= LARGEST_NUMBER:
            allowed = "a number up to 1e12, perhaps with px, mm, cm, in, pt, pc, em or %"
            if unit == "%":
                allowed += "; % needs a width and height, or a viewBox"
            raise BadInputError(f"{where}: {name}", text, allowed)
        return float(match[1]) * factor


def length_px(node: Node, name: str, view: View = View()) -> float:
    """Return a property that is a length, in user units (px); 0 where it is left out."""
    text = node.style.get(name)
    if text is None or text.strip() in ("auto", "initial", "unset", ""):
        return 0.0
    return view.length(text, name, node.where)


def font_px(node: Node, view: View) -> float:
    """Return the size of an element's font, px."""
    sizes = ("xx-small", "x-small", "small", "medium", "large", "x-large", "xx-large")
    text = node.style.get("font-size", "inherit").strip()
    if text in ("inherit", "unset"):
        return view.font_px
    if text in ("smaller", "larger"):
        return view.font_px * (1.2 if text == "larger" else 1.0 / 1.2)
    if text in (*sizes, "initial"):
        shares = dict(zip(sizes, (9, 10, 13, 16, 18, 24, 32), strict=True))
        return float(shares.get(text, _EM_PX))
    if text.endswith("%"):
        text = f"{text[:-1]}e-2em"
    return view.length(text, "font-size", node.where)


# --- The page -------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class PageFrame:
    """The frame that the outermost element sets."""

    box: Floats  # x, y, width, height in user units; zeros where there is none
    unit: SourceUnit  # in x
    stretch: float = 1.0  # units in y over those in x: not 1 under preserveAspectRatio="none"


def page_frame(root: Node) -> PageFrame:
    """Return the frame set by the outermost element."""
    box = _view_box(root)
    texts = [root.style.get(name, "").strip().lower() for name in ("width", "height")]
    size = [
        length_px(root, name) if text and not text.endswith("%") else 0.0
        for name, text in zip(("width", "height"), texts, strict=True)
    ]
    per_inch, program = _px_per_inch(root.program)
    mm_per_px = 25.4 / per_inch

    def of_px(mm: float, missing: str) -> SourceUnit:
        by = f"{program}: 1/{per_inch:g} inch" if program else f"1/96 inch; {missing}"
        known: Any = "program" if program else "guess"
        return SourceUnit(name="px", mm=mm, known=known, by=by)

    if box is None:
        whole = np.array([0.0, 0.0, *np.maximum(size, 0.0)])
        return PageFrame(whole, of_px(mm_per_px, "no viewBox"))
    pairs = [(side, part) for side, part in zip(size, box[2:].tolist(), strict=True) if side > 0.0]
    if not pairs:
        return PageFrame(box, of_px(mm_per_px, "no absolute width or height"))
    ratios = [side / part for side, part in pairs]
    aspect = root.get("preserveAspectRatio", "")
    ratio = max(ratios) if "slice" in aspect else min(ratios)
    stretch = 1.0
    if aspect.split()[:1] == ["none"] and len(ratios) == 2:
        ratio, stretch = ratios[0], ratios[1] / ratios[0]
    if any(text.removesuffix("px")[-1:].isalpha() for text in texts):
        # Rounded: 210 mm for 210 units is 1 mm, whatever the last bit of 96 / 25.4 says.
        mm = float(f"{ratio * 25.4 / 96.0:.12g}")
        by = "width, height and viewBox"
        unit = SourceUnit(name="user unit", mm=mm, known="file", by=by)
        return PageFrame(box, unit, stretch)
    missing = "width and height name no other unit"
    return PageFrame(box, of_px(float(f"{ratio * mm_per_px:.12g}"), missing), stretch)


def _px_per_inch(program: str) -> tuple[float, str]:
    """Return what a px is by the program that wrote a file, and its name; empty of others."""
    if "Adobe Illustrator" in program or "data-name=" in program:
        return 72.0, "Adobe Illustrator"
    version = re.search(r"inkscape:version=(\d+)\.(\d+)", program)
    if version is not None and (int(version[1]), int(version[2])) < (0, 92):
        return 90.0, f"Inkscape {version[1]}.{version[2]}"
    if version is None and "sodipodi:version" in program:
        return 90.0, "Sodipodi or an old Inkscape"
    return 96.0, ""


def _view_box(node: Node) -> Floats | None:
    """Return x, y, width and height of a view box, None if there is none."""
    text = node.get("viewBox")
    if text is None:
        return None
    values = _numbers(text, f"{node.where}: viewBox")
    if len(values) != 4 or values[2] <= 0.0 or values[3] <= 0.0:
        raise BadInputError(f"{node.where}: viewBox", text, "x y width height, sizes above 0")
    return np.array(values)


@dataclass(frozen=True, slots=True)
class Viewport:
    """A nested ``svg`` or a used ``symbol``."""

    matrix: Floats  # affine map of the elements in it, shape (2, 3)
    frame: Floats  # x, y, width, height, in the coordinates around it
    size: tuple[float, float]  # of 100 %, in the coordinates in it


def viewport(node: Node, view: View, size: tuple[float, float] | None) -> Viewport:
    """Return the viewport of a nested element; ``size`` is that which a ``use`` gives, if any."""
    x, y = length_px(node, "x", view), length_px(node, "y", view)
    width, height = size or (
        length_px(node, name, view) if name in node.style else view.reference(name)
        for name in ("width", "height")
    )
    box = _view_box(node)
    frame = np.array([x, y, width, height])
    if box is None or min(width, height) <= 0.0:
        return Viewport(np.array([[1.0, 0.0, x], [0.0, 1.0, y]]), frame, (width, height))
    aspect = node.get("preserveAspectRatio", "xMidYMid")
    matrix = _affine(Viewbox.viewbox_transform(x, y, width, height, *box.tolist(), aspect))
    return Viewport(matrix, frame, (float(box[2]), float(box[3])))


# --- Transforms -----------------------------------------------------------------------------------

_TRANSFORM = re.compile(r"[\s,]*+(\w++)\s*+\(([^)]*+)\)[\s,]*+")
_OPERANDS = {
    "matrix": (6,),
    "translate": (1, 2),
    "translateX": (1,),
    "translateY": (1,),
    "scale": (1, 2),
    "scaleX": (1,),
    "scaleY": (1,),
    "rotate": (1, 3),
    "skew": (1, 2),
    "skewX": (1,),
    "skewY": (1,),
}
_ANGLES_DEG = {"deg": 1.0, "rad": 180.0 / math.pi, "grad": 0.9, "turn": 360.0}
_SIZED = re.compile(rf"({NUMBER})(px|mm|cm|q|in|pt|pc|em|rem|deg|grad|rad|turn)\b", re.IGNORECASE)


def transform(node: Node, view: View = View()) -> Floats:
    """Return the affine map in a node's ``transform``, shape (2, 3)."""
    text = node.style.get("transform", "").strip()
    if text in ("", "none", "initial", "unset"):
        return np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    parts, at = [], 0
    while at < len(text):
        # svgelements leaves out elements that it does not know, or that lack numbers.
        match = _TRANSFORM.match(text, at)
        if match is None:
            raise _bad_transform(node, text)
        plain = _SIZED.sub(lambda one: _plain_operand(one, view, node.where), match[2])
        values = _numbers(plain, f"{node.where}: transform")
        if len(values) not in _OPERANDS.get(match[1], ()):
            raise _bad_transform(node, f"{match[1]}({values})")
        name = "matrix" if match[1] == "skew" else match[1]
        if match[1] == "skew":
            across, up = (math.tan(math.radians(angle)) for angle in (*values, 0.0)[:2])
            values = [1.0, up, across, 1.0, 0.0, 0.0]
        parts.append(f"{name}({', '.join(map(repr, values))})")
        at = match.end()
    with reading_element(f"{node.where}: transform", text):
        matrix = _affine(" ".join(parts))
    if abs(np.linalg.det(matrix[:, :2])) < 1e-30:
        raise BadInputError(f"{node.where}: transform", text, "one that is not singular")
    return matrix


def _plain_operand(match: re.Match[str], view: View, where: str) -> str:
    angle = _ANGLES_DEG.get(match[2].lower())
    if angle is not None:
        return repr(float(match[1]) * angle)
    return repr(view.length(match[0], "transform", where))


def about(matrix: Floats, origin: Floats) -> Floats:
    """Return an affine map about another origin than 0, 0."""
    shifted = matrix.copy()
    shifted[:, 2] += origin - matrix[:, :2] @ origin
    return shifted


def transform_origin(node: Node, view: View, box: Floats | None) -> Floats:
    """Return the origin of a node's transform, shape (2,).

    Parameters
    ----------
    box
        x, y, width, height of the shape where ``transform-box`` says so; else None, and shares
        refer to the viewport.
    """
    x, y, width, height = (0.0, 0.0, view.width, view.height) if box is None else box.tolist()
    words = node.style.get("transform-origin", "").split()
    if not words or words[0] in ("initial", "unset"):
        return np.array([x, y] if box is None else [x + 0.5 * width, y + 0.5 * height])
    if words[0] in ("top", "bottom") or words[-1] in ("left", "right"):
        words = words[::-1]
    words = [*words, "center"][:2]
    shares = {"left": "0%", "top": "0%", "center": "50%", "right": "100%", "bottom": "100%"}
    own = View(width, height, view.font_px, view.root_font_px)
    pairs = zip(words, ("x", "y"), strict=True)
    away = [
        0.0
        if (text := shares.get(word, word)) in ("0%", "0")
        else own.length(text, name, node.where)
        for word, name in pairs
    ]
    return np.array([x + away[0], y + away[1]])


def after(outer: Floats, inner: Floats) -> Floats:
    """Return the affine map that applies first the inner, then the outer one."""
    linear = outer[:, :2] @ inner[:, :2]
    return np.column_stack([linear, outer[:, :2] @ inner[:, 2] + outer[:, 2]])


def _affine(text: str) -> Floats:
    found = Matrix(text)
    return np.array([[found.a, found.c, found.e], [found.b, found.d, found.f]])


def numbers(node: Node, name: str) -> list[float]:
    """Return an attribute that is a list of numbers."""
    return _numbers(node.get(name, ""), f"{node.where}: {name}")


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
