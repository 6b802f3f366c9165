"""Laser jobs as SVG: millimetres, one path per contour, the same bytes for the same job.

The only module that touches svgwrite.
"""

import math
from itertools import pairwise

import svgwrite
from svgwrite.extensions import Inkscape

from vinefab.export.colours import DEFAULT, Colours
from vinefab.export.drawn import StyledPath, metadata, one_line, styled_paths
from vinefab.model.job import Job
from vinefab.model.outline import Contour, Segment

DECIMALS = 3
HAIRLINE_MM = 0.01
LARGEST_TURN_RAD = math.pi / 2
LEAST_SAGITTA_MM = 0.0005


def svg_text(job: Job, colours: Colours = DEFAULT, *, hairline_mm: float = HAIRLINE_MM) -> str:
    """Return a job as the text of an SVG file, to be encoded as UTF-8.

    Width and height are in millimetres with an equal view box, so that a user unit is a
    millimetre in every program; there are no transforms (y is flipped in the coordinates) and no
    path commands but M, L, A and Z.

    Parameters
    ----------
    job
        The paths, in millimetres from the sheet's lower left corner.
    colours
        Layers and colours.
    hairline_mm
        Stroke width; programs take a line as thin as this for a vector to be cut.
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
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{drawing.tostring()}\n'


def drawn_contour(contour: Contour) -> Contour:
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
    if abs(segment.bulge) * segment.chord_mm / 2 < LEAST_SAGITTA_MM and turn < LARGEST_TURN_RAD:
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
    return drawing.path(
        d=_commands(drawn_contour(styled.path.contour), height_mm),
        fill="none",
        stroke=rgb,
        stroke_width=width,
        style=f"fill:none;stroke:{rgb};stroke-width:{width}",
        **extra,
    )


def _commands(contour: Contour, height_mm: float) -> str:
    segments = list(contour.segments)
    words = ["M", *_point(segments[0].start_mm, height_mm)]
    for segment in segments[:-1]:
        words.extend(_command(segment, height_mm))
    if not contour.closed or segments[-1].bulge:
        words.extend(_command(segments[-1], height_mm))
    return " ".join([*words, "Z"] if contour.closed else words)


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
    return f"{round(float(value), DECIMALS) + 0.0:.{DECIMALS}f}"
