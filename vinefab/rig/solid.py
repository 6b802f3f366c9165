"""Closed solids from plans, by manifold3d, with numbers engraved into or laid next to them."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from manifold3d import CrossSection, FillRule, Manifold, OpType
from shapely import LineString, Polygon
from shapely.affinity import scale, translate
from shapely.geometry.base import BaseGeometry
from shapely.ops import nearest_points

from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import agreeing, counted
from vinefab.core.validation import Floats, Ints
from vinefab.rig.part import GRID_MM, Printer, Rig, RigOptions, RigPart, different_points
from vinefab.rig.rig_plan import Polygons, polygon_parts, snapped_union, touching_points


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Course:
    """An upright prism of a solid, or to be taken out of it."""

    pieces: Polygons  # its outline, in plan
    # lower and upper end; of a pocket below 0 to open it downwards
    low_mm: float
    high_mm: float


def stacked(
    plate: Polygons,
    solids: Polygons,
    plate_mm: float,
    height_mm: float,
    pockets: Sequence[Course] = (),
) -> tuple[Floats, Ints]:
    """Return corners and triangles of solids standing on a plate.

    The plate fills z from 0 to ``plate_mm``, what stands on it reaches from there up by
    ``height_mm``.
    """
    courses = [Course(pieces=plate, low_mm=0.0, high_mm=plate_mm)]
    if len(solids):
        # From the middle of the plate: bodies that overlap join more surely than ones that touch.
        top_mm = plate_mm + height_mm
        courses.append(Course(pieces=solids, low_mm=0.5 * plate_mm, high_mm=top_mm))
    return built_of(courses, pockets)


def built_of(
    courses: Sequence[Course], pockets: Sequence[Course] = (), weld_mm: float = 0.0
) -> tuple[Floats, Ints]:
    """Return corners and triangles of prisms joined into one solid, pockets taken out.

    With ``weld_mm``, corners and edges nearer than that to each other are joined. Where prisms side
    by side meet in one upright edge, which is not printable, they are joined by a thin post.
    """
    vertices, faces = _joined(courses, pockets, weld_mm)
    _, index = different_points(vertices)
    edges = np.sort(index[faces[:, [0, 1, 1, 2, 2, 0]]].reshape(-1, 2), axis=1)
    # Both ends in one number: edges are then counted without comparing rows.
    triangles = np.unique(edges @ (len(index), 1), return_counts=True)[1]
    if triangles.max(initial=0) <= 2:
        return vertices, faces
    lowest_mm, highest_mm = min(c.low_mm for c in courses), max(c.high_mm for c in courses)
    posts = []
    # Radius of a post: more than a wall's error of rounding, less than a line of the printer.
    post_mm = 0.1
    for low_mm, high_mm, here in _storeys(courses):
        points = touching_points(snapped_union(*here))
        if len(points):
            discs = shapely.buffer(shapely.MultiPoint(points), post_mm, quad_segs=2)
            from_mm = max(lowest_mm, low_mm - post_mm)
            to_mm = min(highest_mm, high_mm + post_mm)
            posts.append(Course(pieces=polygon_parts(discs), low_mm=from_mm, high_mm=to_mm))
    return _joined([*courses, *posts], pockets, weld_mm)


def _joined(
    courses: Sequence[Course], pockets: Sequence[Course], weld_mm: float
) -> tuple[Floats, Ints]:
    body = Manifold.batch_boolean([prism(course) for course in courses], OpType.Add)
    for pocket in pockets:
        if len(pocket.pieces):
            body -= prism(pocket)
    return solid_mesh(body.simplify(weld_mm) if weld_mm else body)


def _storeys(courses: Sequence[Course]) -> Iterator[tuple[float, float, list[Polygons]]]:
    """Yield lower and upper end of the heights between which nothing changes, with the plans."""
    heights = sorted({height for one in courses for height in (one.low_mm, one.high_mm)})
    for low_mm, high_mm in pairwise(heights):
        here = [one for one in courses if one.low_mm <= low_mm and one.high_mm >= high_mm]
        yield low_mm, high_mm, [one.pieces for one in here]


def solid_mesh(body: Manifold) -> tuple[Floats, Ints]:
    """Return corners, as single precision holds them, and triangles of a solid.

    Their order depends on the shape alone.
    """
    mesh = body.to_mesh64()
    vertices = np.asarray(mesh.vert_properties[:, :3], dtype=np.float32).astype(np.float64)
    faces = np.asarray(mesh.tri_verts, dtype=np.int64)
    merged, index = different_points(vertices)
    corners = index[faces]
    flat = (corners == np.roll(corners, 1, axis=1)).any(axis=1)
    if flat.any():  # two corners of a triangle became one when they were rounded
        vertices, faces = merged, corners[~flat]
    order = np.lexsort(vertices.T[::-1])
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    faces = place[faces]
    first, rows = faces.argmin(axis=1)[:, None], np.arange(len(faces))[:, None]
    faces = faces[rows, (first + np.arange(3)) % 3]
    return vertices[order], faces[np.lexsort(faces.T[::-1])]


def outlines_at(body: Manifold, z_mm: float) -> shapely.geometry.base.BaseGeometry:
    """Return the cross-section of a solid at a height, as polygons."""
    rings = [shapely.linearrings(ring) for ring in body.slice(z_mm).to_polygons()]
    # Outer rings run counter-clockwise and holes clockwise: crossing counts do not need to know.
    return shapely.build_area(shapely.union_all(rings)) if rings else shapely.Polygon()


def plan_volume_mm3(courses: Sequence[Course]) -> float:
    """Return the volume that courses take together, from the areas of their plans."""
    volume_mm3 = 0.0
    for low_mm, high_mm, here in _storeys(courses):
        if here:
            volume_mm3 += shapely.union_all(np.concatenate(here)).area * (high_mm - low_mm)
    return volume_mm3


def prism(course: Course) -> Manifold:
    """Return a prism as a solid."""
    rings = shapely.get_rings(shapely.orient_polygons(course.pieces))
    contours = [shapely.get_coordinates(ring)[:-1] for ring in rings]
    flat = CrossSection(contours, FillRule.Positive)
    body = Manifold.extrude(flat, course.high_mm - course.low_mm)
    return body.translate((0.0, 0.0, course.low_mm))


_WIDE, _HIGH, _ADVANCE = 4.0, 7.0, 6.2
_CORNERS = {
    "0": ["0,1 0,6 1,7 3,7 4,6 4,1 3,0 1,0 0,1"],
    "1": ["0.8,5.6 2.4,7 2.4,0", "0.8,0 4,0"],
    "2": ["0,6 1,7 3,7 4,6 4,4.6 0,0 4,0"],
    "3": ["0,7 4,7 1.8,4.2 3,4.2 4,3.2 4,1 3,0 1,0 0,1"],
    "4": ["3,0 3,7 0,2 4,2"],
    "5": ["4,7 0,7 0,4.2 3,4.2 4,3.2 4,1 3,0 0,0"],
    "6": ["4,6 3,7 1,7 0,6 0,1 1,0 3,0 4,1 4,3 3,4 0,4"],
    "7": ["0,7 4,7 1.4,0"],
    "8": ["1,3.8 0,4.8 0,6 1,7 3,7 4,6 4,4.8 3,3.8 1,3.8 0,2.8 0,1 1,0 3,0 4,1 4,2.8 3,3.8"],
    "9": ["0,1 1,0 3,0 4,1 4,6 3,7 1,7 0,6 0,4 1,3 4,3"],
    "N": ["0,0 0,7 4,0 4,7"],
    "-": ["0.5,3.5 3.5,3.5"],
}


def strokes(text: str, height_mm: float) -> list[LineString]:
    """Return a text as lines, its lower left corner at the origin."""
    unit_mm, found = height_mm / _HIGH, []
    for place, sign in enumerate(text):
        for run in _CORNERS.get(sign, []):
            points = np.array([point.split(",") for point in run.split()], dtype=np.float64)
            found.append(LineString((points + np.array([_ADVANCE * place, 0.0])) * unit_mm))
    return found


def arrow(height_mm: float) -> list[LineString]:
    """Return an arrow that points to +y, its foot at the origin."""
    head = 0.35 * height_mm
    tip = (0.0, height_mm)
    return [
        LineString([(0.0, 0.0), tip]),
        LineString([(-0.6 * head, height_mm - head), tip, (0.6 * head, height_mm - head)]),
    ]


def centred(lines: list[LineString], x_mm: float, y_mm: float) -> list[LineString]:
    """Move lines so that the middle of their box lies at a point."""
    x_min, y_min, x_max, y_max = shapely.total_bounds(lines).tolist()
    shift = x_mm - 0.5 * (x_min + x_max), y_mm - 0.5 * (y_min + y_max)
    return [translate(line, *shift) for line in lines]


def grooves(lines: list[LineString], width_mm: float) -> BaseGeometry:
    """Return lines as polygons of some width, with blunt corners so that they stay few."""
    return shapely.union_all(shapely.buffer(lines, 0.5 * width_mm, quad_segs=1))


STROKE_MM = 1.0
"""Width of the grooves: the printer bridges over them without supports."""

_DIGIT_MM, _ARROW_MM, _APART_MM = 10.0, 14.0, 5.0


def engraved_marks(number: int, plate: Polygon, *, from_below: bool = True) -> Polygons:
    """Return the grooves of a tile's number and north arrow, in the coordinates of the plan.

    They lie around the middle of the largest circle in the plate and shrink to fit it; below two
    fifths of their full size there are none. Seen from above they are mirrored, so that they read
    right from below; north is +y of the map either way.
    """
    circle = shapely.maximum_inscribed_circle(plate, 0.1)
    (x_mm, y_mm), _ = circle.coords
    block = _block(number, 1.0, from_below=from_below)
    x_min, y_min, x_max, y_max = block.bounds
    diagonal_mm = ((x_max - x_min) ** 2 + (y_max - y_min) ** 2) ** 0.5
    room_mm = 1.5
    size = min(1.0, 2.0 * (circle.length - room_mm) / diagonal_mm)
    smallest = 0.4
    if size < smallest:
        return polygon_parts(Polygon())
    moved = translate(_block(number, size, from_below=from_below), x_mm, y_mm)
    return polygon_parts(shapely.set_precision(moved, GRID_MM))


def _block(number: int, size: float, *, from_below: bool) -> BaseGeometry:
    """Return arrow and number side by side, the middle of both at the origin."""
    digits = strokes(str(number), size * _DIGIT_MM)
    if from_below:
        digits = [scale(line, -1.0, 1.0, origin=(0.0, 0.0)) for line in digits]
    digits_mm = shapely.total_bounds(digits)
    pointer = arrow(size * _ARROW_MM)
    pointer_mm = shapely.total_bounds(pointer)
    wide_mm = digits_mm[2] - digits_mm[0] + pointer_mm[2] - pointer_mm[0] + size * _APART_MM
    digits = centred(digits, -0.5 * (wide_mm - (digits_mm[2] - digits_mm[0])), 0.0)
    pointer = centred(pointer, 0.5 * (wide_mm - (pointer_mm[2] - pointer_mm[0])), 0.0)
    return grooves([*digits, *pointer], STROKE_MM)


CUBE_MM = 20.0
_DEPTH_MM, _CUBE_APART_MM = 0.6, 12.0


def extra_parts(
    plate_box_mm: tuple[float, float, float, float], to_map: Floats
) -> tuple[RigPart, ...]:
    """Return the scale cube and the north arrow, each with a text engraved into its top."""
    right_mm, top_mm = plate_box_mm[2] + _CUBE_APART_MM, plate_box_mm[3]
    arrow_size_mm = (24.0, 44.0, 4.0)
    wide_mm, long_mm, thick_mm = arrow_size_mm
    shape = [(0.3, 0), (0.7, 0), (0.7, 0.5), (1, 0.5), (0.5, 1), (0, 0.5), (0.3, 0.5)]
    outline = Polygon([(x * wide_mm, y * long_mm) for x, y in shape])
    cube, half_mm = shapely.box(0.0, 0.0, CUBE_MM, CUBE_MM), 0.5 * CUBE_MM
    number, north = strokes(f"{CUBE_MM:.0f}", 10.0), strokes("N", 8.0)
    cube_mm, arrow_mm = top_mm - long_mm - _CUBE_APART_MM - CUBE_MM, top_mm - long_mm
    parts = []
    for name, flat, high_mm, text, y_mm in (
        ("scale_cube_20mm", cube, CUBE_MM, centred(number, half_mm, half_mm), cube_mm),
        ("north_arrow", outline, thick_mm, centred(north, 0.5 * wide_mm, 0.42 * long_mm), arrow_mm),
    ):
        marks = shapely.set_precision(grooves(text, STROKE_MM), GRID_MM)
        low_mm = high_mm - _DEPTH_MM
        vertices, faces = built_of(
            [Course(pieces=polygon_parts(flat), low_mm=0.0, high_mm=high_mm)],
            [Course(pieces=polygon_parts(marks), low_mm=low_mm, high_mm=high_mm + 1.0)],
        )
        shift = np.eye(4)
        shift[:2, 3] = right_mm, y_mm
        parts.append(
            RigPart(
                name=name,
                vertices_mm=vertices,
                faces=faces,
                to_map=np.asarray(to_map @ shift, dtype=np.float64),
                volume_mm3=flat.area * high_mm - marks.area * _DEPTH_MM,
            )
        )
    return tuple(parts)


LEAST_ROOM_MM = 1.2
"""A cavity narrower than this everywhere is filled: it would save nothing."""

RIB_SPAN_MM = 60.0
"""Longest stretch of wall without a rib (computed as a beam of assumed PLA, 3 GPa: 0.8 mm
thick and 30 mm high, it gives way by 1.5 mm under 5 N in its middle)."""

CORBEL_STEP_MM = 0.5
"""Courses under a peg reach this much farther, and are this high: 45 degrees need no supports."""

_MITRE_LIMIT = 5.0
_MULTIPLE = 1e-6

_NEAR_MM = 1e-6
"""Overlays leave corners a rounding error apart; a mitre between two such divides by zero."""


def shell_wall_mm(printer: Printer, options: RigOptions) -> float:
    """Return the thickness of the walls of shells; 0 when obstacles are solid.

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
    """Return the hollow parts of a rig and their stiffness; empty when all is solid."""
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
    """Return the cavities that an outline may have so that every wall is thick enough.

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
    # A cavity that fills less of its convex hull goes around a corner: it is halved first.
    slender = 0.5
    if room.interiors:
        hole = shapely.get_coordinates(shapely.centroid(Polygon(room.interiors[0])))[0]
        shares = [float((hole - low) @ along) / long_mm**2]
    elif room.area > slender * shapely.convex_hull(room).area:
        count = math.ceil(long_mm / RIB_SPAN_MM)
        shares = [number / count for number in range(1, count)]
    across = 3.0 * np.array([-along[1], along[0]])
    middles = [low + share * along for share in shares]
    lines = [LineString([middle - across, middle + across]) for middle in middles]
    ribs = shapely.buffer(lines, 0.5 * wall_mm + GRID_MM, cap_style="flat")
    for part in _roomy(shapely.difference(room, shapely.union_all(ribs))):
        yield from _ribbed(part, wall_mm)


def corbelled(
    walls: Polygon, outline: Polygon, pegs: Sequence[Polygon], height_mm: float, wall_mm: float
) -> list[Course]:
    """Return the courses that carry pegs out from the walls, one above the other.

    Printed upwards, each reaches `CORBEL_STEP_MM` farther than the one below, up to the height at
    which the pegs begin. Each lies within the next, ends within it and within the walls, so that no
    two faces nearly coincide.
    """
    within = _in_walls(outline, wall_mm)
    feet = []
    for peg in pegs:  # a hair more than the peg, and a neck into the nearest wall
        middle = shapely.centroid(peg)
        radius_mm = middle.distance(shapely.Point(peg.exterior.coords[0])) + _HAIR_MM
        ends = [middle, nearest_points(walls, middle)[0]]
        neck = shapely.union_all(shapely.buffer(ends, radius_mm, quad_segs=4)).convex_hull
        feet.append(shapely.intersection(neck, within))
    target = shapely.set_precision(shapely.union_all(feet), _NEAR_MM)
    far_mm = shapely.hausdorff_distance(shapely.union_all([walls, target]), walls)
    count = max(1, math.ceil(far_mm / CORBEL_STEP_MM - _MULTIPLE)) if pegs else 0
    courses = []
    peg_foot_mm = 1.5
    for left in range(count - 1, -1, -1):
        low_mm = height_mm - peg_foot_mm - left * CORBEL_STEP_MM
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


def number_marks(number: int, outline: Polygon, wall_mm: float) -> tuple[Polygons, Polygons]:
    """Return the tongue in a shell's top that bears its number, and the grooves of the number.

    It grows from the wall on the left, at the height of the widest place; where there is no room,
    there is none.
    """
    nothing = polygon_parts(Polygon())
    lines = strokes(str(number), _TONGUE_DIGIT_MM)
    x_min, _, x_max, _ = shapely.total_bounds(lines).tolist()
    tongue_rim_mm = 1.0  # width of the tongue next to its number
    wide_mm, high_mm = (
        side + STROKE_MM + 2.0 * tongue_rim_mm for side in (x_max - x_min, _TONGUE_DIGIT_MM)
    )
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


_TONGUE_DIGIT_MM, _LABEL_STEP_MM = 6.0, 0.5


_ROOT_MM, _HAIR_MM, _INSET_MM, _RECESS_MM = 0.3, 0.05, 0.01, 0.2
