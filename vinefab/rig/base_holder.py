"""The holder of a robot's base: a dial at the rig's edge, and a block with a cap on it.

The tail of a robot is slipped over the tube of its base; block and cap clamp both between two
screws, outside the border, so that the trunk's mouth lies at the start pose. Pins of the block
stand in holes of the dial, one pair for each heading. The dial lies against the rig's edge, its
hooks reach between the ends of the border at the entry.

Lengths are millimetres of the rig; the frame of a holder has its origin below the mouth on the
table, x forward along the heading, y to the left, z upwards.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from manifold3d import Manifold
from shapely import LineString, Point, Polygon, box
from shapely.affinity import rotate, translate
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.core.units import deg
from vinefab.core.validation import Floats, Ints
from vinefab.model.design import Design
from vinefab.model.map import Map, Start
from vinefab.physics.tube import inflated_diameter_mm
from vinefab.rig.part import Mesh, Rig, RigPart, mesh_problems
from vinefab.rig.rig_options import GRID_MM
from vinefab.rig.rig_plan import Polygons, polygon_parts, snapped_union
from vinefab.rig.solid import Pocket, centred, grooves, mesh_of, prism, strokes

ASSUMED_COLLAR_MM = 25.5
"""Diameter of the base's tube where neither design nor user gives one: a trunk 40 mm wide."""

CLAMP_MM = 30.0
"""Length of block and cap along the tube."""

SPLIT_MM = 1.5
"""Gap between block and cap, which the screws narrow."""

FLOOR_MM = 1.2
"""Least material below the bore."""

_DIAL_MM = (1.0, 3.0)  # thickness of the dial, least and most
_EAR_MM = 13.0  # from the bore to the block's side
_CAP_WALL_MM, _CAP_EAR_MM = 4.0, 8.0
_SCREW_MM, _NUT_MM, _NUT_DEEP_MM = 3.4, 5.8, 2.6  # M3: hole, width across flats, pocket
_NUT_HEIGHT_MM = 2.4
_PIN_MM, _PIN_GAP_MM, _HOLE_APART_MM = 3.0, 0.15, 4.4
_HOOK_MM, _LEAST_HOOK_MM, _HOOK_POST_MM = 8.0, 1.6, 3.0
_RIM_MM = 9.0  # of the dial around the block
_MARK_MM, _STROKE_MM, _DIGIT_MM = 0.4, 0.8, 5.0
_STEPS_DEG = (5.0, 10.0, 15.0, 30.0)
_FINE_DEG = 2.5
_STEP_MM = 0.5
_TOUCH_MM, _SLIVER_MM, _FREE_MM = 0.02, 0.05, 3.0
_WELDS_MM = (2e-3, 5e-3, 1e-2, 2e-2)
_NEAR_BOX_MM = (-1500.0, -1500.0, 1500.0, 1500.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class BaseTube:
    """The tube that the tail is slipped over, and how high it lies."""

    diameter_mm: float  # outside
    standing: str  # where the diameter comes from
    axis_mm: float  # of the trunk's middle line above the floor: its inflated radius
    tail_mm: float | None = None  # of the design


def base_tube(design: Design | None, collar_mm: float | None) -> BaseTube:
    """Return the tube of a base: as the user says, else as the design, else assumed."""
    if design is None:
        diameter_mm = collar_mm or ASSUMED_COLLAR_MM
        standing = "given" if collar_mm else "assumed: give --design or --collar-mm"
        return BaseTube(diameter_mm=diameter_mm, standing=standing, axis_mm=0.5 * diameter_mm)
    build, trunk_mm = design.build, inflated_diameter_mm(design.build.widths_mm[0])
    diameter_mm, standing = trunk_mm, "computed: as wide as the design's inflated trunk"
    if build.collar is not None:
        diameter_mm, standing = build.collar.clamp_diameter_mm, "the design's collar"
    if collar_mm is not None:
        diameter_mm, standing = collar_mm, "given"
    return BaseTube(
        diameter_mm=diameter_mm,
        standing=standing,
        axis_mm=0.5 * trunk_mm,
        tail_mm=build.tail_mm,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BaseHolder:
    """A holder with its parts."""

    start: int  # number of the map's start, from 1
    tube: BaseTube
    bore_mm: float  # diameter
    axis_mm: float  # of the bore above the floor
    reach_mm: float  # from the block's front to the mouth, along the tube
    headings_deg: tuple[float, ...]  # that the dial has holes for, against the start's own
    screw_mm: float  # least length of the two M3 screws
    parts: tuple[RigPart, ...]
    outline: BaseGeometry  # of the dial, in the plan
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Place:
    """The rig around a start, in the holder's frame."""

    plate: BaseGeometry
    walls: BaseGeometry
    inside: BaseGeometry  # bounds without their holes
    taken: BaseGeometry  # what stands beside the rig
    plate_mm: float
    border_mm: float
    gap_mm: float
    reach_mm: float  # how far inside the bounds a start has an entry
    to_plan: Floats  # homogeneous transform, shape (3, 3), from the frame
    to_map: Floats  # the same in space, shape (4, 4), into map coordinates


def base_holder(
    world: Map, rig: Rig, design: Design | None, taken: BaseGeometry
) -> tuple[BaseHolder | None, tuple[str, ...]]:
    """Return the holder for a start, or None, and the reason as a note.

    Parameters
    ----------
    taken
        What stands on the table beside the rig, in the coordinates of the plan.

    Raises
    ------
    BadInputError
        If a holder was asked for by the start's number and none can stand there.
    """
    asked = rig.options.base_start
    if asked == 0 or not (world.starts or asked):
        return None, ()
    if asked and asked > len(world.starts):
        raise BadInputError("base_start", asked, f"0 to {len(world.starts)}")
    number = asked or 1
    place = _place_of(world.starts[number - 1], world, rig, taken)
    tube = base_tube(design, rig.options.collar_mm)
    made = _holder(number, world.starts[number - 1], place, tube)
    if isinstance(made, BaseHolder):
        return made, made.notes
    if asked:
        raise BadInputError("base_start", asked, f"a start where a holder can stand: {made}")
    return None, (f"start {number} has no base holder: {made}",)


def _place_of(start: Start, world: Map, rig: Rig, taken: BaseGeometry) -> _Place:
    """Return the rig as seen from a start: origin at the start, heading along x."""
    scale, pose = rig.options.scale, start.pose
    low = np.array(world.bounds.bounds[:2])
    at = (np.array([pose.x_mm, pose.y_mm]) - low) * scale
    cos, sin = math.cos(pose.heading_rad), math.sin(pose.heading_rad)
    turn = np.array([[cos, -sin], [sin, cos]])
    to_plan = np.eye(3)
    to_plan[:2, :2], to_plan[:2, 2] = turn, at

    lift = np.eye(4)
    lift[:2, :2], lift[:2, 3] = turn, at

    def seen(shape: BaseGeometry) -> BaseGeometry:
        moved = shapely.transform(shape, lambda points: ((points - low) * scale - at) @ turn)
        return shapely.union_all(snapped_union(shapely.clip_by_rect(moved, *_NEAR_BOX_MM)))

    options = rig.options
    return _Place(
        plate=seen(rig.plate),
        walls=seen(rig.walls),
        inside=seen(Polygon(world.bounds.exterior)),
        taken=shapely.transform(taken, lambda points: (points - at) @ turn),
        plate_mm=options.plate_mm,
        border_mm=options.border_mm,
        gap_mm=options.gap_mm(rig.printer),
        reach_mm=options.entry_reach_mm,
        to_plan=to_plan,
        to_map=table_to_map(world, rig) @ lift,
    )


def table_to_map(world: Map, rig: Rig) -> Floats:
    """Return the transform, shape (4, 4), from plan and table into map coordinates."""
    matrix = np.diag([1.0 / rig.options.scale] * 3 + [1.0])
    matrix[:2, 3] = world.bounds.bounds[:2]
    matrix[2, 3] = -rig.options.plate_mm / rig.options.scale
    return matrix


@dataclass(frozen=True, slots=True, kw_only=True)
class _Sizes:
    """Everything about block, cap and dial that does not depend on the rig's outline."""

    bore_mm: float  # radius
    half_mm: float  # half the block's width
    dial_mm: float  # thickness
    axis_mm: float  # above the table

    @property
    def block_mm(self) -> float:
        """Height of the block."""
        return self.axis_mm - 0.5 * SPLIT_MM - self.dial_mm

    @property
    def ear_mm(self) -> float:
        """Distance of screws and pins from the middle."""
        return self.bore_mm + 0.5 * _EAR_MM


def _sizes(tube: BaseTube, plate_mm: float, gap_mm: float) -> _Sizes:
    bore_mm = 0.5 * tube.diameter_mm + gap_mm
    least_mm, most_mm = _DIAL_MM
    axis_mm = max(plate_mm + tube.axis_mm, bore_mm + FLOOR_MM + least_mm)
    dial_mm = min(most_mm, math.floor(5.0 * (axis_mm - bore_mm - FLOOR_MM) + 1e-6) / 5.0)
    return _Sizes(
        bore_mm=bore_mm, half_mm=bore_mm + _EAR_MM, dial_mm=max(dial_mm, least_mm), axis_mm=axis_mm
    )


def _holder(number: int, start: Start, place: _Place, tube: BaseTube) -> BaseHolder | str:
    """Return the holder of a start, or why there is none."""
    sizes = _sizes(tube, place.plate_mm, place.gap_mm)
    found = _headings(start, place, sizes)
    if isinstance(found, str):
        return found
    headings, reach_mm, step_deg = found
    block = box(-reach_mm - CLAMP_MM, -sizes.half_mm, -reach_mm, sizes.half_mm)
    if _turned(block, headings).buffer(_FREE_MM).intersects(place.taken):
        return "a corner marker lies where its block would be: --markers none, or another start"
    dial = _dial_outline(block, headings, place)
    outline = shapely.affinity.affine_transform(
        dial, [*place.to_plan[0, :2], *place.to_plan[1, :2], *place.to_plan[:2, 2]]
    )
    hooks = _hooks(dial, block, headings, (place, sizes))
    parts = (
        _dial_part(dial, hooks, headings, (place, sizes, reach_mm, step_deg)),
        _block_part(place, sizes, reach_mm),
        _cap_part(place, sizes, reach_mm),
    )
    if any(mesh_problems(Mesh.of_corners(part.vertices_mm[part.faces]), part) for part in parts):
        return "its dial comes out as no closed solid there: another --entry-mm may help"
    screw_mm = sizes.block_mm - _NUT_DEEP_MM + _NUT_HEIGHT_MM + SPLIT_MM + _CAP_EAR_MM
    axis_mm = sizes.axis_mm - place.plate_mm
    return BaseHolder(
        start=number,
        tube=tube,
        bore_mm=2.0 * sizes.bore_mm,
        axis_mm=axis_mm,
        reach_mm=reach_mm,
        headings_deg=tuple(headings),
        screw_mm=screw_mm,
        parts=parts,
        outline=outline,
        notes=_notes(number, start, tube, (axis_mm, reach_mm, step_deg, screw_mm, len(hooks))),
    )


def _notes(
    number: int,
    start: Start,
    tube: BaseTube,
    made: tuple[float, float, float, float, int],
) -> tuple[str, ...]:
    """Return what the person who builds the holder should read."""
    axis_mm, reach_mm, step_deg, screw_mm, hooks = made
    sideways = start.spread_x_mm > 0.0 or start.spread_y_mm > 0.0
    needed_mm = reach_mm + CLAMP_MM
    conditions = {
        f"its tube, {tube.diameter_mm:.4g} mm outside ({tube.standing}), stands {reach_mm:.1f} mm "
        f"out of block and cap; two M3 screws, at least {screw_mm:.0f} mm long, clamp it": True,
        f"its pins stand in one of the holes for headings, every {step_deg:g} degrees": (
            start.spread_heading_rad > 0.0
        ),
        "it stands at the middle of the start's positions": sideways,
        f"the tube lies {axis_mm:.1f} mm above the floor, not at the trunk's radius "
        f"{tube.axis_mm:.1f} mm: its diameter leaves no room below": (
            axis_mm > tube.axis_mm + _TOUCH_MM
        ),
        "the entry leaves no room for two hooks: lay its dial by plan.svg": hooks < 2,
        f"a tail of {needed_mm:.0f} mm is needed from mouth to clamp, the design has "
        f"{tube.tail_mm or 0.0:g}": tube.tail_mm is not None and tube.tail_mm < needed_mm,
    }
    return tuple(
        f"base holder of start {number}: {text}" for text, holds in conditions.items() if holds
    )


def _headings(start: Start, place: _Place, sizes: _Sizes) -> tuple[list[float], float, float] | str:
    """Return the headings that a holder can stand at, its reach and the step; or why none."""
    most_deg = deg(start.spread_heading_rad)
    fine = np.arange(-90.0, 90.1, _FINE_DEG)
    wanted = [angle for angle in fine.tolist() if abs(angle) <= most_deg + 1e-6]
    way = LineString([(-place.reach_mm - _TOUCH_MM, 0.0), (0.0, 0.0)])
    if not way.intersects(place.inside.boundary):
        return (
            f"the border is more than {place.reach_mm:g} mm behind it: the robot comes up through "
            "the plate, from a base of your own below"
        )
    for _ in range(len(wanted)):
        reach_mm = _reach_mm(wanted or [0.0], place, sizes)
        free = [angle for angle in wanted if _passes(angle, reach_mm, place, sizes)]
        if 0.0 not in free:
            return "its tube does not pass the border and obstacles behind it: widen --entry-mm"
        if len(free) == len(wanted):
            break
        wanted = free
    if reach_mm > _most_reach_mm(place, sizes):
        return "other walls of the rig leave no room for it"
    inner_mm = math.hypot(reach_mm + 8.0, sizes.ear_mm)
    step_deg = next(
        (step for step in _STEPS_DEG if math.radians(step) * inner_mm >= _HOLE_APART_MM), 30.0
    )
    return [angle for angle in wanted if angle % step_deg == 0.0], reach_mm, step_deg


def _most_reach_mm(place: _Place, sizes: _Sizes) -> float:
    return place.reach_mm + 2.0 * (place.border_mm + sizes.half_mm) + CLAMP_MM


def _reach_mm(headings: list[float], place: _Place, sizes: _Sizes) -> float:
    """Return how far behind the mouth the block stands clear of the rig at all headings."""
    clear = place.plate.buffer(_HOOK_POST_MM + place.gap_mm, join_style="mitre", mitre_limit=2.0)
    reach_mm, most_mm = 0.0, _most_reach_mm(place, sizes)
    ends = (headings[0], headings[-1])
    while reach_mm <= most_mm:
        block = box(-reach_mm - CLAMP_MM, -sizes.half_mm, -reach_mm, sizes.half_mm)
        if not any(rotate(block, angle, origin=(0, 0)).intersects(clear) for angle in ends):
            break
        reach_mm += _STEP_MM
    return reach_mm


def _passes(angle_deg: float, reach_mm: float, place: _Place, sizes: _Sizes) -> bool:
    return not _tube(angle_deg, reach_mm, sizes.bore_mm).intersects(place.walls)


def _tube(angle_deg: float, reach_mm: float, radius_mm: float) -> Polygon:
    tube = box(-reach_mm - CLAMP_MM, -radius_mm, 0.0, radius_mm)
    return rotate(tube, angle_deg, origin=(0, 0))


def _turned(shape: Polygon, headings: list[float]) -> BaseGeometry:
    """Return what a shape covers at all headings, those between two holes included."""
    turns = np.linspace(headings[0], headings[-1], 2 * len(headings) + 1)
    return shapely.union_all([rotate(shape, turn, origin=(0, 0)) for turn in turns.tolist()])


def _dial_outline(block: Polygon, headings: list[float], place: _Place) -> Polygon:
    """Return the dial: below the block at all headings, up to the rig's edge."""
    around = _turned(block, headings).buffer(_RIM_MM, join_style="mitre", mitre_limit=2.0)
    entry = _entry(place, block)
    hull = shapely.convex_hull(
        shapely.union_all([around, entry.buffer(_RIM_MM).difference(place.inside)])
    )
    rig = shapely.union_all([Polygon(piece.exterior) for piece in polygon_parts(place.plate)])
    pieces = snapped_union(hull.difference(rig).difference(place.taken.buffer(place.gap_mm)))
    best: Polygon = max(pieces, key=lambda piece: piece.intersection(block).area)
    return best


def _entry(place: _Place, block: Polygon) -> BaseGeometry:
    """Return the opening of the border between the mouth and the block."""
    low, side = block.bounds[0], block.bounds[3]
    near = box(low, -3.0 * side, 0.0, 3.0 * side)
    border = place.plate.difference(place.inside).difference(place.walls)
    # Opened a little: what rounding leaves along the border's edges is no gap.
    opened = border.buffer(-_SLIVER_MM, join_style="mitre").buffer(_SLIVER_MM, join_style="mitre")
    gaps = polygon_parts(opened)
    way = LineString([(0.0, 0.0), (low, 0.0)])
    return shapely.union_all([gap for gap in gaps if gap.intersects(way)]).intersection(near)


def _hooks(
    dial: Polygon, block: Polygon, headings: list[float], job: tuple[_Place, _Sizes]
) -> list[tuple[BaseGeometry, BaseGeometry]]:
    """Return the hooks at the ends of the border: what stands on the dial, what reaches over."""
    place, sizes = job
    swept = _turned(_tube(0.0, -block.bounds[2], sizes.bore_mm + 1.0), headings)
    beside = place.walls.buffer(place.gap_mm)
    taken = shapely.union_all([_turned(block, headings).buffer(0.4), swept, beside])
    room = _entry(place, block).difference(taken).intersection(place.walls.buffer(_HOOK_MM))
    found = []
    for piece in snapped_union(room):
        post = dial.intersection(piece.buffer(_HOOK_POST_MM, join_style="mitre")).difference(taken)
        wide = piece.buffer(-0.5 * _LEAST_HOOK_MM).area > 0.0
        if wide and post.area > _LEAST_HOOK_MM * _HOOK_POST_MM and piece.distance(post) < _TOUCH_MM:
            found.append((post, piece))
    return found


_Job = tuple[_Place, _Sizes, float, float]


def _dial_part(
    dial: Polygon,
    hooks: list[tuple[BaseGeometry, BaseGeometry]],
    headings: list[float],
    job: _Job,
) -> RigPart:
    """Return the dial as a solid: flat, with holes, hooks and marks."""
    place, sizes, _, _ = job
    taken = shapely.union_all([post.buffer(2.0) for post, _ in hooks])
    fixing = _screw_holes(dial.difference(taken), headings, job)
    holes = shapely.union_all([*_pin_holes(headings, job), *fixing])
    (flat,) = snapped_union(dial.difference(holes))
    marks = snapped_union(_marks(headings, job).intersection(flat.buffer(-0.5)))
    slices = list(_hook_slices(hooks, place, sizes))
    low = np.array(flat.bounds[:2])
    body = _prism(polygon_parts(flat), (0.0, sizes.dial_mm), low)
    volume_mm3 = flat.area * sizes.dial_mm
    for pieces, low_mm, high_mm in slices:
        body += _prism(pieces, (low_mm, high_mm), low)
        volume_mm3 += float(shapely.area(pieces).sum()) * (high_mm - max(low_mm, sizes.dial_mm))
    body -= _prism(marks, (sizes.dial_mm - _MARK_MM, sizes.dial_mm + 0.5), low)
    volume_mm3 -= float(shapely.area(marks).sum()) * _MARK_MM
    shift = np.eye(4)
    shift[:2, 3] = low
    return _part("base_dial", body, shift, volume_mm3, place)


def _prism(pieces: Polygons, heights_mm: tuple[float, float], low: Floats) -> Manifold:
    moved = np.asarray(shapely.transform(pieces, lambda points: points - low), dtype=object)
    return prism(Pocket(pieces=moved, low_mm=heights_mm[0], high_mm=heights_mm[1]))


def _hook_slices(
    hooks: list[tuple[BaseGeometry, BaseGeometry]], place: _Place, sizes: _Sizes
) -> Iterator[tuple[Polygons, float, float]]:
    """Yield the hooks from the dial up; each slice reaches a step further over the rig."""
    if not hooks:
        return
    posts = shapely.union_all([post for post, _ in hooks])
    over = shapely.union_all([piece for _, piece in hooks])
    over_mm = place.plate_mm + place.gap_mm
    yield polygon_parts(posts), 0.5 * sizes.dial_mm, over_mm
    steps = max(1, math.ceil(place.border_mm / _STEP_MM))
    for step in range(1, steps + 1):
        # Each step is as high as it reaches out: it prints without supports.
        reached = over.intersection(posts.buffer(step * place.border_mm / steps, quad_segs=2))
        both = shapely.union(posts, reached).buffer(_TOUCH_MM, join_style="mitre")
        pieces = snapped_union(both.buffer(-_TOUCH_MM, join_style="mitre"))
        from_mm = over_mm + (step - 1) * _STEP_MM
        yield pieces, from_mm, from_mm + (_STEP_MM if step < steps else 2.0)


def _pin_places(reach_mm: float, sizes: _Sizes) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return the two pins; not at one distance from the mouth, so that no hole serves both."""
    back_mm = reach_mm + CLAMP_MM
    return (-reach_mm - 8.0, sizes.ear_mm), (8.0 - back_mm, -sizes.ear_mm)


def _pin_holes(headings: list[float], job: _Job) -> list[Polygon]:
    _, sizes, reach_mm, _ = job
    radius_mm = 0.5 * _PIN_MM + _PIN_GAP_MM
    return [
        rotate(Point(pin), angle, origin=(0, 0)).buffer(radius_mm, quad_segs=6)
        for pin in _pin_places(reach_mm, sizes)
        for angle in headings
    ]


def _screw_holes(dial: BaseGeometry, headings: list[float], job: _Job) -> list[Polygon]:
    """Return holes to fix the dial to a table or board: in its rim, left and right."""
    _, sizes, reach_mm, _ = job
    block = box(-reach_mm - CLAMP_MM, -sizes.half_mm, -reach_mm, sizes.half_mm)
    rim = dial.difference(_turned(block, headings).buffer(0.5)).buffer(-4.0)
    if rim.is_empty:
        return []
    holes = []
    for side in (-1.0, 1.0):
        corner = Point(dial.bounds[2], side * 1e3)
        near = shapely.ops.nearest_points(rim, corner)[0]
        holes.append(near.buffer(2.1, quad_segs=6))
    return holes


def _pointer(reach_mm: float, sizes: _Sizes) -> tuple[float, float]:
    """Return the notch in the block's rear by which the heading is read."""
    return -reach_mm - CLAMP_MM, sizes.half_mm - 6.0


def _notch(reach_mm: float, sizes: _Sizes) -> Polygon:
    x_mm, y_mm = _pointer(reach_mm, sizes)
    return Polygon([(x_mm, y_mm - 1.5), (x_mm + 3.0, y_mm), (x_mm, y_mm + 1.5)])


def _marks(headings: list[float], job: _Job) -> BaseGeometry:
    """Return the grooves of the scale: a line and a number for each heading."""
    _, sizes, reach_mm, _ = job
    x_mm, y_mm = _pointer(reach_mm, sizes)
    at_deg = math.degrees(math.atan2(y_mm, x_mm))
    far_mm = math.hypot(x_mm, y_mm)
    lines: list[LineString] = []
    for angle in headings:
        out = np.array(
            [math.cos(math.radians(at_deg + angle)), math.sin(math.radians(at_deg + angle))]
        )
        lines.append(LineString([(far_mm + 0.8) * out, (far_mm + 3.5) * out]))
        # The heading of the robot: the block's rear goes right when its front goes left.
        text = centred(strokes(f"{angle:.0f}", 0.5 * _DIGIT_MM), 0.0, 0.0)
        middle = (far_mm + 6.2) * out
        lines += [
            translate(rotate(line, at_deg + angle + 90.0, origin=(0, 0)), *middle) for line in text
        ]
    return shapely.set_precision(grooves(lines, 0.6 * _STROKE_MM), GRID_MM)


def _circle(y_mm: float, z_mm: float, radius_mm: float) -> Polygon:
    """Return a circle as a polygon of 96 corners whose sides, not corners, touch it."""
    turns = 2.0 * np.pi * np.arange(96) / 96.0
    corners = radius_mm / math.cos(math.pi / 96.0) * np.c_[np.cos(turns), np.sin(turns)]
    return Polygon(corners + np.array([y_mm, z_mm]))


def _block_part(place: _Place, sizes: _Sizes, reach_mm: float) -> RigPart:
    """Return the block, standing on its rear face: nothing needs supports."""
    half, high = sizes.half_mm, sizes.block_mm
    bore = _circle(0.0, high + 0.5 * SPLIT_MM, sizes.bore_mm)
    profile = snapped_union(box(-half, 0.0, half, high).difference(bore))
    middle = -reach_mm - 0.5 * CLAMP_MM
    holes = [Point(middle, y).buffer(0.5 * _SCREW_MM, quad_segs=6) for y in _ears(sizes)]
    nuts = [
        _hexagon(middle, y).difference(hole) for y, hole in zip(_ears(sizes), holes, strict=True)
    ]
    notch = _notch(reach_mm, sizes)
    pins = [Point(pin).buffer(0.5 * _PIN_MM, quad_segs=6) for pin in _pin_places(reach_mm, sizes)]
    pin_mm = sizes.dial_mm - 0.2
    body = _along(profile, CLAMP_MM)
    rear = (-half, 0.0, -reach_mm - CLAMP_MM)
    for shapes, low_mm, high_mm in ((holes, -1.0, high + 1.0), (nuts, -1.0, _NUT_DEEP_MM)):
        body -= _upright(shapes, (low_mm, high_mm), rear)
    body -= _upright([_stretched(notch)], (-1.0, high + 1.0), rear)
    body += _upright(pins, (-pin_mm, 0.5 * _PIN_MM), rear)
    volume_mm3 = (
        float(shapely.area(profile).sum()) * CLAMP_MM
        - sum(hole.area for hole in holes) * high
        - sum(nut.area for nut in nuts) * _NUT_DEEP_MM
        - notch.area * high
        + sum(pin.area for pin in pins) * pin_mm
    )
    body = body.translate((0.0, pin_mm, 0.0))
    return _part("base_block", body, _standing(rear, sizes.dial_mm - pin_mm), volume_mm3, place)


def _cap_part(place: _Place, sizes: _Sizes, reach_mm: float) -> RigPart:
    """Return the cap, standing on its rear face."""
    half, dome = sizes.half_mm, sizes.bore_mm + _CAP_WALL_MM
    top_mm = sizes.bore_mm + _CAP_WALL_MM - 0.5 * SPLIT_MM
    bore = _circle(0.0, -0.5 * SPLIT_MM, sizes.bore_mm)
    ears, roof = box(-half, 0.0, half, min(_CAP_EAR_MM, top_mm)), box(-dome, 0.0, dome, top_mm)
    profile = snapped_union(shapely.union(ears, roof).difference(bore))
    middle = -reach_mm - 0.5 * CLAMP_MM
    holes = [Point(middle, y).buffer(0.5 * _SCREW_MM, quad_segs=6) for y in _ears(sizes)]
    rear = (-half, 0.0, -reach_mm - CLAMP_MM)
    notch, ear_mm = _notch(reach_mm, sizes), min(_CAP_EAR_MM, top_mm)
    cuts = [*holes, _stretched(notch)]
    body = _along(profile, CLAMP_MM) - _upright(cuts, (-1.0, top_mm + 1.0), rear)
    cut_mm2 = sum(cut.area for cut in (*holes, notch))
    volume_mm3 = float(shapely.area(profile).sum()) * CLAMP_MM - cut_mm2 * ear_mm
    low_mm = sizes.axis_mm + 0.5 * SPLIT_MM
    return _part("base_cap", body, _standing(rear, low_mm), volume_mm3, place)


def _ears(sizes: _Sizes) -> tuple[float, float]:
    return -sizes.ear_mm, sizes.ear_mm


def _hexagon(x_mm: float, y_mm: float) -> Polygon:
    turns = np.pi / 3.0 * np.arange(6)
    corners = _NUT_MM / math.sqrt(3.0) * np.c_[np.cos(turns), np.sin(turns)]
    return Polygon(corners + np.array([x_mm, y_mm]))


def _stretched(notch: Polygon) -> BaseGeometry:
    """Return a notch in the rear face that begins behind it, so that no skin is left."""
    x_min, y_min, _, y_max = notch.bounds
    return shapely.union(notch, box(x_min - 1.0, y_min, x_min, y_max))


def _along(profile: Polygons, length_mm: float) -> Manifold:
    """Return a profile (y, z) as a solid along the tube, as printed: (y + half, z, x + length)."""
    low = np.array([shapely.total_bounds(profile)[0], 0.0])
    return _prism(profile, (0.0, length_mm), low)


def _upright(
    shapes: Sequence[BaseGeometry],
    heights_mm: tuple[float, float],
    rear: tuple[float, float, float],
) -> Manifold:
    """Return shapes (x, y) as upright prisms, turned as the part is printed."""
    body = _prism(polygon_parts(*shapes), heights_mm, np.zeros(2))
    y_mm, z_mm, x_mm = rear
    return body.transform(
        np.array([[0.0, 1.0, 0.0, -y_mm], [0.0, 0.0, 1.0, -z_mm], [1.0, 0.0, 0.0, -x_mm]])
    )


def _standing(rear: tuple[float, float, float], low_mm: float) -> Floats:
    """Return the transform, shape (4, 4), from a part as printed into the holder's frame."""
    y_mm, _, x_mm = rear
    return np.array(
        [
            [0.0, 0.0, 1.0, x_mm],
            [1.0, 0.0, 0.0, y_mm],
            [0.0, 1.0, 0.0, low_mm],
            [0.0, 0.0, 0.0, 1.0],
        ]
    )


def _welded(body: Manifold) -> tuple[Floats, Ints]:
    """Return a solid's mesh, corners joined that lie nearer than a file can tell apart.

    Where edges of hooks and dial nearly meet, rounding to single precision would leave triangles
    without an area; the least welding that avoids them is taken.
    """
    vertices, faces = mesh_of(body)
    for weld_mm in _WELDS_MM:
        vertices, faces = mesh_of(body.simplify(weld_mm))
        if not Mesh.of_corners(vertices[faces]).form_problems():
            break
    return vertices, faces


def _part(name: str, body: Manifold, to_frame: Floats, volume_mm3: float, place: _Place) -> RigPart:
    vertices, faces = _welded(body)
    return RigPart(
        name=name,
        vertices_mm=vertices,
        faces=faces,
        to_map=place.to_map @ to_frame,
        volume_mm3=volume_mm3,
    )
