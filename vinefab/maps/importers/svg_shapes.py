"""Shapes of SVG drawings as curves: path data and the basic shapes.

`svgelements` reads path data. Their grammar is checked here: it accepts unknown commands, infinite
coordinates and paths without a move, and its errors name no position; and it keeps the axes of a
sheared arc at right angles (0.5 % of a rounded rectangle under skewX(20)).
"""

import math
import re
from dataclasses import dataclass, field

import numpy as np
import svgelements as svg

from vinefab.core.errors import BadInputError
from vinefab.core.foreign import reading_element
from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats
from vinefab.maps.importers.source_drawing import Arc, Bezier, CurvePiece, Straight
from vinefab.maps.importers.svg_document import (
    LARGEST_NUMBER,
    NUMBER,
    Node,
    View,
    length_px,
    numbers,
)

SHAPES = {"path", "rect", "circle", "ellipse", "line", "polyline", "polygon"}
"""Tags of elements that draw an outline or a line."""

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


def moved(piece: CurvePiece, matrix: Floats) -> CurvePiece:
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


def svg_outlines(node: Node, view: View = View()) -> list[Subpath]:  # noqa: B008  frozen
    """Return the subpaths of a shape, in its own coordinates."""
    try:
        if node.tag == "path":
            data = re.sub(r"^path\(\s*[\"']|[\"']\s*\)$", "", node.style.get("d", ""))
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
    at = {name: length_px(node, name, view) for name in names}
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
