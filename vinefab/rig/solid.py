"""Closed solids from plans, by manifold3d, and what is engraved into them or laid beside them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from manifold3d import CrossSection, FillRule, Manifold, Mesh64, OpType
from shapely import LineString, Polygon
from shapely.affinity import scale, translate
from shapely.geometry.base import BaseGeometry

from vinefab.core.validation import Floats, Ints
from vinefab.rig.part import RigPart, different_points
from vinefab.rig.rig_options import GRID_MM
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
    by side meet in one upright edge, which is no printable body, they are joined by a thin post.
    """
    made = _joined(courses, pockets, weld_mm)
    posts = _posts(courses) if _is_pinched(*made) else []
    return _joined([*courses, *posts], pockets, weld_mm) if posts else made


def _joined(
    courses: Sequence[Course], pockets: Sequence[Course], weld_mm: float
) -> tuple[Floats, Ints]:
    body = Manifold.batch_boolean([prism(course) for course in courses], OpType.Add)
    for pocket in pockets:
        if len(pocket.pieces):
            body -= prism(pocket)
    return solid_mesh(body.simplify(weld_mm) if weld_mm else body)


def _is_pinched(vertices: Floats, faces: Ints) -> bool:
    """Tell whether more than two triangles meet at an edge."""
    _, index = different_points(vertices)
    edges = np.sort(index[faces[:, [0, 1, 1, 2, 2, 0]]].reshape(-1, 2), axis=1)
    # Both ends in one number: edges are then counted without comparing rows.
    return bool(np.unique(edges @ (len(index), 1), return_counts=True)[1].max(initial=0) > 2)


_POST_MM = 0.1
"""Radius of a post: more than a wall's error of rounding, less than a line of the printer."""


def _posts(courses: Sequence[Course]) -> list[Course]:
    """Return thin posts where the plans of courses at one height touch in a point."""
    lowest_mm, highest_mm = min(c.low_mm for c in courses), max(c.high_mm for c in courses)
    posts = []
    for low_mm, high_mm, here in _storeys(courses):
        points = touching_points(snapped_union(*here))
        if len(points):
            discs = shapely.buffer(shapely.MultiPoint(points), _POST_MM, quad_segs=2)
            from_mm = max(lowest_mm, low_mm - _POST_MM)
            to_mm = min(highest_mm, high_mm + _POST_MM)
            posts.append(Course(pieces=polygon_parts(discs), low_mm=from_mm, high_mm=to_mm))
    return posts


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


def manifold_of(vertices_mm: Floats, faces: Ints) -> Manifold:
    """Return corners and triangles as a solid of manifold3d, empty when they do not bound one."""
    # Copies: manifold3d does not take read-only arrays.
    vertices = np.array(vertices_mm, dtype=np.float64, order="C")
    return Manifold(Mesh64(vertices, np.array(faces, dtype=np.uint64, order="C")))


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
_SMALLEST = 0.4
_ROOM_MM = 1.5


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
    size = min(1.0, 2.0 * (circle.length - _ROOM_MM) / diagonal_mm)
    if size < _SMALLEST:
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
_ARROW_SIZE_MM = (24.0, 44.0, 4.0)
_DEPTH_MM, _CUBE_APART_MM = 0.6, 12.0


def extra_parts(
    plate_box_mm: tuple[float, float, float, float], to_map: Floats
) -> tuple[RigPart, ...]:
    """Return the scale cube and the north arrow, each with a text engraved into its top."""
    right_mm, top_mm = plate_box_mm[2] + _CUBE_APART_MM, plate_box_mm[3]
    wide_mm, long_mm, thick_mm = _ARROW_SIZE_MM
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
