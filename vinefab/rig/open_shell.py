"""Obstacles as open shells: upright walls around nothing, closed on one side or on none.

What touches a robot is the outside of an obstacle; the inside only costs hours and filament.
"""

import math
from collections.abc import Iterator, Sequence

import numpy as np
import shapely
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry
from shapely.ops import nearest_points

from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import agreeing, counted
from vinefab.rig.part import Rig
from vinefab.rig.rig_options import GRID_MM, Printer, RigOptions
from vinefab.rig.rig_plan import Polygons, polygon_parts
from vinefab.rig.solid import STROKE_MM, Course, centred, grooves, strokes

LEAST_ROOM_MM = 1.2
"""A cavity narrower than this everywhere is filled: it would save nothing."""

RIB_SPAN_MM = 60.0
"""Longest stretch of wall without a rib (computed as a beam of assumed PLA, 3 GPa: 0.8 mm
thick and 30 mm high, it gives way by 1.5 mm under 5 N in its middle)."""

CORBEL_STEP_MM = 0.5
"""Courses under a peg reach this much farther, and are this high: 45 degrees need no supports."""

_PEG_FOOT_MM = 1.5
_MITRE_LIMIT = 5.0
_MULTIPLE = 1e-6

_NEAR_MM = 1e-6
"""Overlays leave corners a rounding error apart; a mitre between two such divides by zero."""


def shell_wall_mm(printer: Printer, options: RigOptions) -> float:
    """Return how thick the walls of shells are; 0 when obstacles are solid.

    Raises
    ------
    BadInputError
        If the printer cannot print such a wall with whole lines.
    """
    nozzle_mm, least_mm = printer.nozzle_mm, printer.least_wall_mm
    lines = math.ceil(least_mm / nozzle_mm - _MULTIPLE)
    if options.wall_mm is None:
        return lines * nozzle_mm
    if options.wall_mm == 0.0:
        return 0.0
    found = options.wall_mm / nozzle_mm
    if found < lines - _MULTIPLE or abs(found - round(found)) > _MULTIPLE:
        some = ", ".join(f"{count * nozzle_mm:g}" for count in range(lines, lines + 3))
        allowed = (
            f"0 (solid), or whole lines of the nozzle of {printer.name} ({nozzle_mm:g} mm), at "
            f"least {lines}: {some} and so on"
        )
        raise BadInputError("wall_mm", options.wall_mm, allowed)
    return options.wall_mm


def shell_words(rig: Rig) -> str:
    """Return what is hollow in a rig and how stiff that is; empty when all is solid."""
    hollow = sum(part.hollow for part in rig.parts)
    if not hollow:
        return ""
    wall_mm, height_mm = shell_wall_mm(rig.printer, rig.options), rig.options.height_mm
    # A beam between two ribs, both ends held, the load in its middle.
    give_mm = _PUSH_N * RIB_SPAN_MM**3 / (16.0 * _YOUNG_MPA * height_mm * wall_mm**3)
    top = f"a top of {rig.options.top_mm:g} mm" if rig.options.top_mm else "no top"
    return (
        f"{hollow} of {counted(len(rig.parts), 'part')} "
        f"{agreeing(len(rig.parts), 'is a shell', 'are shells')} with walls of {wall_mm:g} mm "
        f"and {top}; "
        f"{_PUSH_N:g} N between two ribs or corners {RIB_SPAN_MM:g} mm apart bend a wall by at "
        f"most {give_mm:.1f} mm (computed as a beam, PLA of {_YOUNG_MPA / 1000:g} GPa assumed)"
    )


_PUSH_N, _YOUNG_MPA = 5.0, 3000.0


def cavities_in(outline: Polygon, wall_mm: float) -> Polygons:
    """Return what may be left empty in an outline so that every wall is thick enough.

    Long cavities, and those that go around something, are divided by ribs.
    """
    # Two steps of the grid more, so that no wall is thinner after the corners were rounded to it.
    inner = shapely.buffer(
        outline, -(wall_mm + 2.0 * GRID_MM), join_style="mitre", mitre_limit=_MITRE_LIMIT
    )
    found = [room for part in _roomy(inner) for room in _ribbed(part, wall_mm)]
    return polygon_parts(shapely.set_precision(np.array(found, dtype=object), GRID_MM), Polygon())


def hollowed(pieces: Polygons, wall_mm: float) -> Polygons:
    """Return polygons without what may be left empty in them."""
    if wall_mm <= 0.0:
        return pieces
    return polygon_parts(*(shell_walls(piece, wall_mm) for piece in pieces), Polygon())


def shell_walls(outline: Polygon, wall_mm: float) -> Polygon:
    """Return an outline without its cavities."""
    cavities = cavities_in(outline, wall_mm) if wall_mm > 0.0 else ()
    return Polygon(outline.exterior, [*outline.interiors, *(room.exterior for room in cavities)])


def _roomy(inner: BaseGeometry) -> Polygons:
    """Return where there is room: an opening drops narrow places and round-off at corners."""
    half_mm = 0.5 * LEAST_ROOM_MM
    shrunk = shapely.buffer(
        shapely.set_precision(inner, _NEAR_MM),
        -half_mm,
        join_style="mitre",
        mitre_limit=_MITRE_LIMIT,
    )
    grown = shapely.buffer(shrunk, half_mm, quad_segs=2)
    # A rounding error of the two buffers must not thin the wall.
    return polygon_parts(shapely.intersection(grown, inner))


def _ribbed(room: Polygon, wall_mm: float) -> Iterator[Polygon]:
    """Yield a cavity divided until no part is long and none goes around anything."""
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(room))
    sides = corners[1] - corners[0], corners[2] - corners[1]
    along = max(sides, key=lambda side: float(np.hypot(*side)))
    long_mm = float(np.hypot(*along))
    if long_mm <= RIB_SPAN_MM and not room.interiors:
        yield room
        return
    low = corners[np.argmin(corners @ along)]
    shares = [0.5]
    if room.interiors:
        hole = shapely.get_coordinates(shapely.centroid(Polygon(room.interiors[0])))[0]
        shares = [float((hole - low) @ along) / long_mm**2]
    elif room.area > _SLENDER * shapely.convex_hull(room).area:
        count = math.ceil(long_mm / RIB_SPAN_MM)
        shares = [number / count for number in range(1, count)]
    across = 3.0 * np.array([-along[1], along[0]])
    middles = [low + share * along for share in shares]
    lines = [LineString([middle - across, middle + across]) for middle in middles]
    ribs = shapely.buffer(lines, 0.5 * wall_mm + GRID_MM, cap_style="flat")
    for part in _roomy(shapely.difference(room, shapely.union_all(ribs))):
        yield from _ribbed(part, wall_mm)


_SLENDER = 0.5
"""A cavity that fills less of its convex hull goes around a corner: it is halved first."""


def corbelled(
    walls: Polygon, outline: Polygon, pegs: Sequence[Polygon], height_mm: float, wall_mm: float
) -> list[Course]:
    """Return the courses that carry pegs out from the walls, one above the other.

    Printed upwards, each reaches `CORBEL_STEP_MM` farther than the one below, up to the height at
    which the pegs begin. Each lies within the next, ends within it and within the walls, so that no
    two faces nearly coincide.
    """
    within = _in_walls(outline, wall_mm)
    feet = [_foot(walls, within, peg) for peg in pegs]
    target = shapely.set_precision(shapely.union_all(feet), _NEAR_MM)
    far_mm = shapely.hausdorff_distance(shapely.union_all([walls, target]), walls)
    count = max(1, math.ceil(far_mm / CORBEL_STEP_MM - _MULTIPLE)) if pegs else 0
    courses = []
    for left in range(count - 1, -1, -1):
        low_mm = height_mm - _PEG_FOOT_MM - left * CORBEL_STEP_MM
        if left and low_mm + CORBEL_STEP_MM <= 0.0:
            continue  # the next one stands on the bed too
        reach = shapely.buffer(walls, (count - left) * CORBEL_STEP_MM, quad_segs=8)
        inset = shapely.buffer(target, -left * _INSET_MM, join_style="mitre")
        grown = shapely.intersection(inset, reach if left else within)
        courses.append(
            Course(
                pieces=polygon_parts(shapely.set_precision(grown, GRID_MM)),
                low_mm=max(0.0, low_mm),
                high_mm=low_mm + 1.5 * CORBEL_STEP_MM if left else height_mm - _RECESS_MM,
            )
        )
    return courses


def _in_walls(outline: Polygon, wall_mm: float) -> BaseGeometry:
    """Return an outline shrunk so that its edge lies within its walls."""
    return shapely.buffer(outline, -min(0.5 * wall_mm, _ROOT_MM), join_style="mitre")


def _foot(walls: Polygon, within: BaseGeometry, peg: Polygon) -> BaseGeometry:
    """Return what carries a peg: a hair more than the peg, and a neck into the nearest wall."""
    middle = shapely.centroid(peg)
    near = nearest_points(walls, middle)[0]
    radius_mm = middle.distance(shapely.Point(peg.exterior.coords[0])) + _HAIR_MM
    ends = shapely.buffer([middle, near], radius_mm, quad_segs=4)
    return shapely.intersection(shapely.union_all(ends).convex_hull, within)


def number_marks(number: int, outline: Polygon, wall_mm: float) -> tuple[Polygons, Polygons]:
    """Return the tongue in a shell's top that bears its number, and the grooves of the number.

    It grows from the wall on the left, at the height of the widest place; where there is no room,
    there is none.
    """
    nothing = polygon_parts(Polygon())
    lines = strokes(str(number), _DIGIT_MM)
    x_min, _, x_max, _ = shapely.total_bounds(lines).tolist()
    wide_mm, high_mm = (side + STROKE_MM + 2.0 * _RIM_MM for side in (x_max - x_min, _DIGIT_MM))
    _, y_mm = shapely.get_coordinates(shapely.maximum_inscribed_circle(outline, 0.1))[0].tolist()
    within = _in_walls(outline, wall_mm)
    shapely.prepare(within)
    left_mm, _, right_mm, _ = outline.bounds
    low_mm, top_mm = y_mm - 0.5 * high_mm, y_mm + 0.5 * high_mm
    starts = np.arange(left_mm + wall_mm, right_mm - wide_mm, _LABEL_STEP_MM)
    boxes = shapely.box(starts, low_mm, starts + wide_mm, top_mm)
    inside = np.flatnonzero(shapely.covers(within, boxes))
    if not len(inside):
        return nothing, nothing
    box = boxes[inside[0]]
    strip = shapely.box(left_mm, low_mm, box.bounds[2], top_mm)
    tongue = min(polygon_parts(shapely.intersection(within, strip)), key=box.distance)
    marks = grooves(centred(lines, *shapely.get_coordinates(box.centroid)[0].tolist()), STROKE_MM)
    snapped = shapely.set_precision([tongue, marks], GRID_MM)
    return polygon_parts(snapped[0]), polygon_parts(snapped[1])


_DIGIT_MM, _LABEL_STEP_MM = 6.0, 0.5

_RIM_MM = 1.0
"""Width of the tongue beside its number."""

_ROOT_MM, _HAIR_MM, _INSET_MM, _RECESS_MM = 0.3, 0.05, 0.01, 0.2
