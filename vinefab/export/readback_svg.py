"""Reading an SVG file of ours again: exactly the subset that is written, anything else is odd."""

import math
import re
import xml.etree.ElementTree as ET
from dataclasses import dataclass, field
from pathlib import Path

from vinefab.core.errors import BadInputError, UnreadableFileError
from vinefab.export.drawing import Drawing, DrawnPath, Format
from vinefab.model.outline import Contour, Segment

_SVG = "{http://www.w3.org/2000/svg}"
_LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"
_SILENT = {f"{_SVG}{name}" for name in ("title", "desc", "defs")}
_NUMBER = re.compile(r"-?\d+\.\d+")
_SIZE = re.compile(r"(-?\d+(?:\.\d+)?)(\D*)")
_ARGUMENTS = {"M": 2, "L": 2, "A": 7, "Z": 0}


def read_svg(source: Path | str) -> Drawing:
    """Return what an SVG file says, y up again.

    Parameters
    ----------
    source
        A path, or the text itself when it is a string.

    Raises
    ------
    UnreadableFileError
        If it is missing, not well formed, declares a document type (and with it, perhaps,
        entities that expand without end), or has paths that vinefab does not write.
    """
    name = str(source) if isinstance(source, Path) else "SVG text"
    try:
        text = source.read_text("utf-8") if isinstance(source, Path) else source
        return _drawing(_root(text))
    except (ET.ParseError, BadInputError, UnicodeDecodeError) as error:
        raise UnreadableFileError(name, f"not an SVG file of ours: {error}") from error
    except OSError as error:
        raise UnreadableFileError(name, error.strerror or str(error)) from error


def _root(text: str) -> ET.Element:
    if "<!" in text:
        raise BadInputError("<!", text[text.index("<!") :][:40], "no declarations and comments")
    # Without declarations there are no entities that could expand without end.
    return ET.fromstring(text.encode("utf-8"))  # noqa: S314


def _drawing(root: ET.Element) -> Drawing:
    (width, unit), (height, unit_y) = _size(root, "width"), _size(root, "height")
    paths: list[DrawnPath] = []
    odd = [] if root.tag == f"{_SVG}svg" else [f"root element {root.tag}"]
    for group in root:
        if group.tag == f"{_SVG}g":
            paths.extend(_group(group, height, odd))
        elif group.tag not in _SILENT:
            odd.append(f"element {group.tag.removeprefix(_SVG)} outside the layers")
    odd.extend(f"a transform on {e.tag}" for e in root.iter() if "transform" in e.attrib)
    box = root.get("viewBox", "").split()
    equal = [float(number) for number in box] == [0.0, 0.0, width, height] if box else False
    return Drawing(
        format=Format.SVG,
        unit=unit if equal and unit == unit_y else f"{unit} with view box {' '.join(box)!r}",
        sheet=(width, height),
        paths=tuple(paths),
        layer_colours={},
        oddities=tuple(odd),
    )


def _size(root: ET.Element, key: str) -> tuple[float, str]:
    match = _SIZE.fullmatch(root.get(key, ""))
    if match is None:
        raise BadInputError(key, root.get(key), "a number with its unit, such as 300mm")
    return float(match[1]), match[2]


def _group(group: ET.Element, height_mm: float, odd: list[str]) -> list[DrawnPath]:
    layer = group.get(_LABEL, "")
    found = []
    for element in group:
        if element.tag != f"{_SVG}path":
            odd.append(f"element {element.tag.removeprefix(_SVG)} on layer {layer}")
            continue
        stroke = element.get("stroke", "none")
        style = dict(item.split(":", 1) for item in element.get("style", "").split(";") if item)
        if style.get("stroke") != stroke:
            odd.append(f"stroke {stroke} but style {style.get('stroke')} on layer {layer}")
        if {element.get("fill"), style.get("fill")} != {"none"}:
            odd.append(f"a filled path on layer {layer}")
        contour = read_commands(element.get("d", ""), height_mm)
        found.append(DrawnPath(layer=layer, colour=stroke.upper(), contour=contour))
    return found


@dataclass(slots=True)
class _Pen:
    """Where the pen stands while a path is read."""

    first: tuple[float, float]
    now: tuple[float, float]
    segments: list[Segment] = field(default_factory=list)

    def draw(self, end: tuple[float, float], bulge: float = 0.0) -> None:
        self.segments.append(Segment(start_mm=self.now, end_mm=end, bulge=bulge))
        self.now = end


def read_commands(text: str, height_mm: float) -> Contour:
    """Return the contour of one path's commands (absolute M, L, A and Z only), y up.

    Parameters
    ----------
    text
        The path's ``d``.
    height_mm
        The sheet's height, from which y is taken.

    Raises
    ------
    BadInputError
        If there is anything that vinefab does not write.
    """
    words = text.split()
    if words[:1] != ["M"]:
        raise BadInputError("d", text[:40], "one path that begins with M")
    start = _point(words[1:3], height_mm)
    pen = _Pen(first=start, now=start)
    at, closed = 3, False
    while at < len(words):
        letter = words[at]
        count = _ARGUMENTS.get(letter, -1)
        arguments = words[at + 1 : at + 1 + count]
        if closed or letter == "M" or len(arguments) != count:
            raise BadInputError("d", " ".join(words[at : at + 8]), "L, A and one closing Z")
        _run(pen, letter, arguments, height_mm)
        closed = letter == "Z"
        at += 1 + count
    if not pen.segments:
        raise BadInputError("d", text[:40], "at least one line or arc")
    return Contour.from_segments(pen.segments, closed=closed)


def _run(pen: _Pen, letter: str, arguments: list[str], height_mm: float) -> None:
    if letter == "Z":
        if pen.now != pen.first:
            pen.draw(pen.first)
        return
    end = _point(arguments[-2:], height_mm)
    pen.draw(end, _bulge(pen.now, end, arguments) if letter == "A" else 0.0)


def _bulge(start: tuple[float, float], end: tuple[float, float], arguments: list[str]) -> float:
    """Return the bulge of an arc command, read as the SVG standard says.

    A radius less than half the chord counts as half the chord; with a radius of 0 or no distance
    between the ends there is no arc.
    """
    radius, other = _value(arguments[0]), _value(arguments[1])
    if radius != other or arguments[2] != "0" or not set(arguments[3:5]) <= {"0", "1"}:
        raise BadInputError("d", " ".join(arguments), "a circular arc")
    chord = math.dist(start, end)
    if radius == 0.0 or chord == 0.0:
        return 0.0
    turn = 2.0 * math.asin(min(1.0, chord / (2.0 * radius)))
    if arguments[3] == "1":
        turn = math.tau - turn
    return math.tan(turn / 4) * (1.0 if arguments[4] == "0" else -1.0)


def _point(words: list[str], height_mm: float) -> tuple[float, float]:
    if len(words) != 2:
        raise BadInputError("d", " ".join(words), "x and y")
    return _value(words[0]), height_mm - _value(words[1])


def _value(word: str) -> float:
    if _NUMBER.fullmatch(word) is None:
        raise BadInputError("d", word, "a decimal number")
    return float(word)
