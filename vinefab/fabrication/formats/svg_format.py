"""SVG: a small subset of the format is written, and nothing else is read."""

import math
import re
import xml.etree.ElementTree as ET
from functools import lru_cache
from itertools import pairwise

import svgwrite
from svgwrite.extensions import Inkscape

from vinefab.core.errors import BadInputError, UnreadableFileError
from vinefab.core.plain_text import one_line
from vinefab.fabrication.formats.laser_drawing import (
    DEFAULT,
    HAIRLINE_MM,
    Colours,
    DrawnPath,
    LaserFormat,
    ReadDrawing,
    StyledPath,
    metadata,
    styled_paths,
    xml_root,
)
from vinefab.model.job import Job
from vinefab.model.outline import Contour, Segment

_DECIMALS = 3
SVG_TOLERANCE_MM = 2e-3
"""Three decimals: 0.0007 mm at a vertex, twice that in the middle of an arc."""

ON_SCREEN = (
    "@supports (vector-effect: non-scaling-stroke) { @media screen { :root { width: 100vw; "
    "height: 100vh } path { vector-effect: non-scaling-stroke; stroke-width: 1px !important } } }"
)
"""Shows the whole sheet with lines a pixel wide in a browser. What reads laser files knows no
``@supports`` rule and, as CSS 2.1 asks, skips all that it holds: it takes colour and width of each
path's own style. On paper, and so through a printer driver, lines stay hairlines."""

LARGEST_TURN_RAD = math.pi / 2


def svg_text(job: Job, colours: Colours = DEFAULT, *, hairline_mm: float = HAIRLINE_MM) -> str:
    """Return a job as the text of an SVG file, to be encoded as UTF-8.

    Width and height are in millimetres with an equal view box, so that a user unit is a
    millimetre in every program; there are no transforms (y is flipped in the coordinates) and no
    path commands but M, L, A and Z.
    """
    width, height = _number(job.sheet_width_mm), _number(job.sheet_height_mm)
    drawing = svgwrite.Drawing(
        size=(f"{width}mm", f"{height}mm"), viewBox=f"0 0 {width} {height}", debug=False
    )
    inkscape = Inkscape(drawing)
    lines = [f"{key}: {value}" for key, value in metadata(job, colours).items()]
    drawing.set_desc(title=one_line(job.name), desc="\n".join(lines))
    layers: dict[str, svgwrite.container.Group] = {}
    for styled in styled_paths(job, colours):
        layer = styled.style.layer
        if layer not in layers:
            # An XML id may not start with a digit, a layer's name may.
            layers[layer] = drawing.add(inkscape.layer(label=layer, id=f"layer_{layer}"))
        layers[layer].add(_path(drawing, styled, float(height), hairline_mm))
    # svgwrite would wrap the rule in CDATA, which simple readers of SVG do not know.
    text = drawing.tostring().replace("<defs />", f"<defs><style>{ON_SCREEN}</style></defs>", 1)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n'


@lru_cache(maxsize=4096)
def svg_contour(contour: Contour) -> Contour:
    """Return a contour as SVG can hold it: arcs of at most 90 degrees.

    SVG gives an arc by its ends and radius. Near a semicircle the centre follows from the small
    difference of radius and half chord: rounding to 0.001 mm would move a 175 degree arc by more
    than 0.02 mm, and where the rounded radius is less than half the chord, renderers enlarge it.
    At 90 degrees no error grows. Arcs that differ from their chord by less than the rounding
    become lines.
    """
    pieces = [piece for segment in contour.segments for piece in _split(segment)]
    return Contour.from_segments(pieces, closed=contour.closed)


def _split(segment: Segment) -> list[Segment]:
    turn = abs(segment.turn_rad)
    least_sagitta_mm = 0.0005
    if abs(segment.bulge) * segment.chord_mm / 2 < least_sagitta_mm and turn < LARGEST_TURN_RAD:
        return [_piece(segment, segment.start_mm, segment.end_mm, 0.0)]
    count = math.ceil(turn / LARGEST_TURN_RAD - 1e-9)
    if count <= 1:
        return [segment]
    x, y = segment.center_mm
    first = math.atan2(segment.start_mm[1] - y, segment.start_mm[0] - x)
    angles = [first + segment.turn_rad * k / count for k in range(1, count)]
    radius = segment.radius_mm
    middle = [(x + radius * math.cos(angle), y + radius * math.sin(angle)) for angle in angles]
    ends = [segment.start_mm, *middle, segment.end_mm]
    bulge = math.tan(segment.turn_rad / count / 4)
    return [_piece(segment, *pair, bulge) for pair in pairwise(ends)]


def _piece(
    whole: Segment, start_mm: tuple[float, float], end_mm: tuple[float, float], bulge: float
) -> Segment:
    return Segment(
        start_mm=start_mm, end_mm=end_mm, bulge=bulge, part=whole.part, branch=whole.branch
    )


def _path(
    drawing: svgwrite.Drawing, styled: StyledPath, height_mm: float, hairline_mm: float
) -> svgwrite.path.Path:
    rgb, width = styled.style.rgb, f"{hairline_mm:g}"
    extra = {"inkscape:label": one_line(styled.path.label)} if styled.path.label else {}
    contour = svg_contour(styled.path.contour)
    segments = list(contour.segments)
    words = ["M", *_point(segments[0].start_mm, height_mm)]
    for segment in segments[:-1]:
        words.extend(_command(segment, height_mm))
    if not contour.closed or segments[-1].bulge:
        words.extend(_command(segments[-1], height_mm))
    return drawing.path(
        d=" ".join([*words, "Z"] if contour.closed else words),
        fill="none",
        stroke=rgb,
        stroke_width=width,
        style=f"fill:none;stroke:{rgb};stroke-width:{width}",
        **extra,
    )


def _command(segment: Segment, height_mm: float) -> list[str]:
    end = _point(segment.end_mm, height_mm)
    if not segment.bulge:
        return ["L", *end]
    radius = _number(segment.radius_mm)
    # With y pointing down, SVG's positive (sweep 1) direction looks clockwise: our negative one.
    return ["A", radius, radius, "0", "0", "0" if segment.bulge > 0 else "1", *end]


def _point(point_mm: tuple[float, float], height_mm: float) -> tuple[str, str]:
    return _number(point_mm[0]), _number(height_mm - point_mm[1])


def _number(value: float) -> str:
    # Adding 0 turns a negative zero into a positive one.
    return f"{round(float(value), _DECIMALS) + 0.0:.{_DECIMALS}f}"


_SVG = "{http://www.w3.org/2000/svg}"
_LABEL = "{http://www.inkscape.org/namespaces/inkscape}label"
_SILENT = {f"{_SVG}{name}" for name in ("title", "desc", "defs")}
_NUMBER = re.compile(r"-?\d+\.\d+")
_SIZE = re.compile(r"(-?\d+(?:\.\d+)?)(\D*)")
_ARGUMENTS = {"M": 2, "L": 2, "A": 7, "Z": 0}


def read_svg(text: str) -> ReadDrawing:
    """Read an SVG file of ours; y is up again."""
    try:
        root = xml_root(text)
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
        return ReadDrawing(
            unit=unit if equal and unit == unit_y else f"{unit} with view box {' '.join(box)!r}",
            sheet=(width, height),
            paths=tuple(paths),
            oddities=tuple(odd),
        )
    except (ET.ParseError, BadInputError) as error:
        raise UnreadableFileError("SVG text", f"not an SVG file of ours: {error}") from None


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


def read_commands(text: str, height_mm: float) -> Contour:
    """Return the contour of one path's commands (absolute M, L, A and Z only), y up."""
    words = text.split()
    if words[:1] != ["M"]:
        raise BadInputError("d", text[:40], "one path that begins with M")
    first = now = _read_point(words[1:3], height_mm)
    segments: list[Segment] = []
    at, closed = 3, False
    while at < len(words):
        letter = words[at]
        count = _ARGUMENTS.get(letter, -1)
        arguments = words[at + 1 : at + 1 + count]
        if closed or letter == "M" or len(arguments) != count:
            raise BadInputError("d", " ".join(words[at : at + 8]), "L, A and one closing Z")
        closed = letter == "Z"
        end = first if closed else _read_point(arguments[-2:], height_mm)
        if not closed or now != first:
            bulge = _bulge(now, end, arguments) if letter == "A" else 0.0
            segments.append(Segment(start_mm=now, end_mm=end, bulge=bulge))
        now, at = end, at + 1 + count
    if not segments:
        raise BadInputError("d", text[:40], "at least one line or arc")
    return Contour.from_segments(segments, closed=closed)


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


def _read_point(words: list[str], height_mm: float) -> tuple[float, float]:
    if len(words) != 2:
        raise BadInputError("d", " ".join(words), "x and y")
    return _value(words[0]), height_mm - _value(words[1])


def _value(word: str) -> float:
    if _NUMBER.fullmatch(word) is None:
        raise BadInputError("d", word, "a decimal number")
    return float(word)


SVG = LaserFormat(
    title="SVG in millimetres",
    use="a browser shows its lines of 0.01 mm a pixel wide",
    suffix=".svg",
    write=lambda spec: svg_text(spec.job, spec.colours, hairline_mm=spec.hairline_mm),
    read=read_svg,
    tolerance_mm=SVG_TOLERANCE_MM,
    contour=svg_contour,
)
