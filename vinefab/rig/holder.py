"""The holder of a robot's base: block and cap that clamp the tail, on a dial next to a rig.

The tail of a robot is slipped over the tube of its base; block and cap clamp both between two
screws, outside the border, so that the trunk's mouth lies at the start pose. Pins of the block
stand in holes of the dial, one pair for each heading. The dial lies against the rig's edge, its
hooks reach between the ends of the border at the entry.

The frame of a holder has its origin below the mouth on the table, in millimetres of the rig: x
forward along the heading, y to the left, z upwards.

All lengths are millimetres of the rig in the coordinates of its plan: (0, 0) is the lower left
corner of the bounds' box, z = 0 the table under tiles as printed.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import shapely
from manifold3d import Manifold
from shapely import LineString, Point, Polygon, box
from shapely.affinity import affine_transform, rotate, translate
from shapely.geometry.base import BaseGeometry
from shapely.ops import nearest_points

from vinefab.core.errors import BadInputError, UnfitInputError
from vinefab.core.limits import deg
from vinefab.core.validation import Floats
from vinefab.model.design import Design
from vinefab.model.map import (
    Map,
    Start,
)
from vinefab.physics.tube import inflated_diameter_mm
from vinefab.rig.part import GRID_MM, Mesh, Rig, RigOptions, RigPart, mesh_problems
from vinefab.rig.rig_plan import Polygons, polygon_parts, snapped_union
from vinefab.rig.solid import (
    Course,
    centred,
    grooves,
    prism,
    solid_mesh,
    strokes,
)

G = TypeVar("G", bound=BaseGeometry)

ASSUMED_COLLAR_MM = 25.5
"""Diameter of the base's tube where neither design nor user gives one: a trunk 40 mm wide."""

CLAMP_MM = 30.0
"""Length of block and cap along the tube."""

SPLIT_MM = 1.5
"""Gap between block and cap, which the screws narrow."""


_DIAL_MM = (1.0, 3.0)  # thickness of the dial, least and most
_EAR_MM = 13.0  # from the bore to the block's side
_CAP_WALL_MM, _CAP_EAR_MM = 4.0, 8.0
_SCREW_MM, _NUT_MM, _NUT_DEEP_MM = 3.4, 5.8, 2.6  # M3: hole, width across flats, pocket
_PIN_MM, _PIN_GAP_MM, _HOLE_APART_MM = 3.0, 0.15, 4.4
_HOOK_MM, _LEAST_HOOK_MM, _HOOK_POST_MM = 8.0, 1.6, 3.0
_RIM_MM = 9.0  # of the dial around the block
_MARK_MM, _STROKE_MM, _DIGIT_MM = 0.4, 0.8, 5.0
_STEP_MM = 0.5
_TOUCH_MM, _SLIVER_MM, _FREE_MM = 0.02, 0.05, 3.0


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
    stand: "Stand"
    dial: Polygon  # from above, in the holder's frame
    notes: tuple[str, ...]

    @property
    def outline(self) -> BaseGeometry:
        """The dial, in the plan."""
        return self.stand.on_plan(self.dial)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stand:
    """The rig around a start, in the holder's frame, and the sizes of block, cap and dial."""

    plate: BaseGeometry
    walls: BaseGeometry
    inside: BaseGeometry  # bounds without their holes
    taken: BaseGeometry  # areas of objects next to the rig
    options: RigOptions
    gap_mm: float
    to_plan: Floats  # homogeneous transform, shape (3, 3), from the frame
    to_map: Floats  # the same in space, shape (4, 4), into map coordinates
    bore_mm: float  # radius
    dial_mm: float  # thickness
    axis_mm: float  # above the table
    # what depends on the rig's outline
    reach_mm: float = 0.0  # from the block's front to the mouth
    headings: tuple[float, ...] = (0.0,)
    step_deg: float = 30.0

    @property
    def half_mm(self) -> float:
        """Half the block's width."""
        return self.bore_mm + _EAR_MM

    @property
    def block_mm(self) -> float:
        """Height of the block."""
        return self.axis_mm - 0.5 * SPLIT_MM - self.dial_mm

    @property
    def ear_mm(self) -> float:
        """Distance of screws and pins from the middle."""
        return self.bore_mm + 0.5 * _EAR_MM

    @property
    def rear_mm(self) -> float:
        """Where the block's rear face is, along the tube."""
        return -self.reach_mm - CLAMP_MM

    @property
    def block(self) -> Polygon:
        """The block from above."""
        return box(self.rear_mm, -self.half_mm, -self.reach_mm, self.half_mm)

    @property
    def screws(self) -> list[Polygon]:
        """Holes of the two screws, left and right."""
        middle = -self.reach_mm - 0.5 * CLAMP_MM
        places = [Point(middle, y) for y in (-self.ear_mm, self.ear_mm)]
        return [place.buffer(0.5 * _SCREW_MM, quad_segs=6) for place in places]

    @property
    def pins(self) -> tuple[Point, Point]:
        """Two pins; not at one distance from the mouth, so that no hole serves both."""
        return Point(-self.reach_mm - 8.0, self.ear_mm), Point(self.rear_mm + 8.0, -self.ear_mm)

    @property
    def pointer_mm(self) -> tuple[float, float]:
        """The notch in the block's rear by which the heading is read."""
        return self.rear_mm, self.half_mm - 6.0

    @property
    def notch(self) -> Polygon:
        """The notch from above."""
        x_mm, y_mm = self.pointer_mm
        return Polygon([(x_mm, y_mm - 1.5), (x_mm + 3.0, y_mm), (x_mm, y_mm + 1.5)])

    def tube(self, angle_deg: float, radius_mm: float) -> Polygon:
        """Return the tube from above at a heading."""
        return rotated(box(self.rear_mm, -radius_mm, 0.0, radius_mm), angle_deg)

    def on_plan(self, shape: BaseGeometry) -> BaseGeometry:
        """Return a shape of the frame in the plan."""
        to_plan = self.to_plan
        return affine_transform(shape, [*to_plan[0, :2], *to_plan[1, :2], *to_plan[:2, 2]])

    def turned(self, shape: Polygon) -> BaseGeometry:
        """Return the area that a shape covers at all headings, those between two holes included."""
        turns = np.linspace(self.headings[0], self.headings[-1], 2 * len(self.headings) + 1)
        return shapely.union_all([rotated(shape, turn) for turn in turns.tolist()])


def rotated(shape: G, angle_deg: float) -> G:
    """Return a shape turned about the mouth."""
    return rotate(shape, angle_deg, origin=(0, 0))


def base_holder(
    world: Map, rig: Rig, design: Design | None, taken: BaseGeometry
) -> tuple[BaseHolder | None, tuple[str, ...]]:
    """Return the holder for a start, or None, and the reason as a note.

    Parameters
    ----------
    taken
        Areas of objects on the table next to the rig, in the coordinates of the plan.

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
    start, tube = world.starts[number - 1], base_tube(design, rig.options.collar_mm)
    made = _holder(number, start, _stand_of(start, world, rig, taken, tube), tube)
    if isinstance(made, BaseHolder):
        return made, made.notes
    if asked:
        why, _, helps = made.rpartition(": ")
        raise UnfitInputError("base_start", f"no holder can stand at start {asked}: {why}", helps)
    return None, (f"start {number} has no base holder: {made}",)


def _stand_of(start: Start, world: Map, rig: Rig, taken: BaseGeometry, tube: BaseTube) -> Stand:
    """Return the rig as seen from a start: origin at the start, heading along x."""
    options, pose = rig.options, start.pose
    low = np.array(rig.origin_mm)
    at = (np.array([pose.x_mm, pose.y_mm]) - low) * options.scale
    cos, sin = math.cos(pose.heading_rad), math.sin(pose.heading_rad)
    turn = np.array([[cos, -sin], [sin, cos]])
    to_plan, lift = np.eye(3), np.eye(4)
    to_plan[:2, :2], to_plan[:2, 2] = turn, at
    lift[:2, :2], lift[:2, 3] = turn, at

    near_box_mm = (-1500.0, -1500.0, 1500.0, 1500.0)

    def seen(shape: BaseGeometry) -> BaseGeometry:
        moved = shapely.transform(
            shape, lambda points: ((points - low) * options.scale - at) @ turn
        )
        return shapely.union_all(snapped_union(shapely.clip_by_rect(moved, *near_box_mm)))

    gap_mm = options.gap_mm(rig.printer)
    bore_mm = 0.5 * tube.diameter_mm + gap_mm
    least_mm, most_mm = _DIAL_MM
    floor_mm = 1.2  # least material below the bore
    # A tube wider than the trunk would otherwise lie in the plate.
    over_mm = options.plate_mm + max(tube.axis_mm, 0.5 * tube.diameter_mm)
    axis_mm = max(over_mm, bore_mm + floor_mm + least_mm)
    dial_mm = min(most_mm, math.floor(5.0 * (axis_mm - bore_mm - floor_mm) + 1e-6) / 5.0)
    return Stand(
        plate=seen(rig.plate),
        walls=seen(rig.walls),
        inside=seen(Polygon(world.bounds.exterior)),
        taken=shapely.transform(taken, lambda points: (points - at) @ turn),
        options=options,
        gap_mm=gap_mm,
        to_plan=to_plan,
        to_map=rig.table_to_map @ lift,
        bore_mm=bore_mm,
        dial_mm=max(dial_mm, least_mm),
        axis_mm=axis_mm,
    )


def _holder(number: int, start: Start, stand: Stand, tube: BaseTube) -> BaseHolder | str:
    """Return the holder of a start, or why there is none."""
    found = _at_headings(start, stand)
    if isinstance(found, str):
        return found
    stand = found
    if stand.turned(stand.block).buffer(_FREE_MM).intersects(stand.taken):
        return "a corner marker lies where its block would be: --markers none, or another start"
    # The dial: below the block at all headings, up to the rig's edge.
    around = stand.turned(stand.block).buffer(_RIM_MM, join_style="mitre", mitre_limit=2.0)
    entry = _entry(stand).buffer(_RIM_MM).difference(stand.inside)
    hull = shapely.convex_hull(shapely.union_all([around, entry]))
    rig = shapely.union_all([Polygon(piece.exterior) for piece in polygon_parts(stand.plate)])
    pieces = snapped_union(hull.difference(rig).difference(stand.taken.buffer(stand.gap_mm)))
    dial: Polygon = max(pieces, key=lambda piece: piece.intersection(stand.block).area)
    hooks = _hooks(dial, stand)
    parts = (_dial_part(dial, hooks, stand), _block_part(stand), _cap_part(stand))
    if any(mesh_problems(Mesh.of_corners(part.vertices_mm[part.faces]), part) for part in parts):
        return "its dial comes out as no closed solid there: another --entry-mm may help"
    nut_height_mm = 2.4
    screw_mm = stand.block_mm - _NUT_DEEP_MM + nut_height_mm + SPLIT_MM + _CAP_EAR_MM
    axis_mm, needed_mm = stand.axis_mm - stand.options.plate_mm, stand.reach_mm + CLAMP_MM
    notes = {
        f"its tube, {tube.diameter_mm:.4g} mm outside ({tube.standing}), stands "
        f"{stand.reach_mm:.1f} mm out of block and cap; two M3 screws, at least {screw_mm:.0f} mm "
        "long, clamp it": True,
        f"its pins stand in one of the holes for headings, every {stand.step_deg:g} degrees": (
            start.spread_heading_rad > 0.0
        ),
        "it stands at the middle of the start's positions": (
            start.spread_x_mm > 0.0 or start.spread_y_mm > 0.0
        ),
        f"the tube lies {axis_mm:.1f} mm above the floor, not at the trunk's radius "
        f"{tube.axis_mm:.1f} mm: its diameter leaves no room below": (
            axis_mm > tube.axis_mm + _TOUCH_MM
        ),
        "the entry leaves no room for two hooks: lay its dial by plan.svg": len(hooks) < 2,
        f"a tail of {needed_mm:.0f} mm is needed from mouth to clamp, the design has "
        f"{tube.tail_mm or 0.0:g}": tube.tail_mm is not None and tube.tail_mm < needed_mm,
    }
    return BaseHolder(
        start=number,
        tube=tube,
        bore_mm=2.0 * stand.bore_mm,
        axis_mm=axis_mm,
        reach_mm=stand.reach_mm,
        headings_deg=stand.headings,
        screw_mm=screw_mm,
        parts=parts,
        stand=stand,
        dial=dial,
        notes=tuple(f"base holder of start {number}: {text}" for text in notes if notes[text]),
    )


def _at_headings(start: Start, stand: Stand) -> Stand | str:
    """Return a stand with its reach and the headings that it can have; or why there are none."""
    most_deg, reach_mm = deg(start.spread_heading_rad), stand.options.entry_reach_mm
    fine_deg = 2.5
    fine = np.arange(-90.0, 90.1, fine_deg)
    wanted = [angle for angle in fine.tolist() if abs(angle) <= most_deg + 1e-6]
    way = LineString([(-reach_mm - _TOUCH_MM, 0.0), (0.0, 0.0)])
    if not way.intersects(stand.inside.boundary):
        return (
            f"the border is more than {reach_mm:g} mm behind it: the robot comes up through the "
            "plate, from a base of your own below"
        )
    most_mm = reach_mm + 2.0 * (stand.options.border_mm + stand.half_mm) + CLAMP_MM
    post_mm = _HOOK_POST_MM + stand.gap_mm
    clear = stand.plate.buffer(post_mm, join_style="mitre", mitre_limit=2.0)
    for _ in range(len(wanted)):
        # How far behind the mouth the block stands clear of the rig at all headings.
        stand, ends = replace(stand, reach_mm=0.0), (wanted[0], wanted[-1])
        while stand.reach_mm <= most_mm:
            block = stand.block
            if not any(rotated(block, angle).intersects(clear) for angle in ends):
                break
            stand = replace(stand, reach_mm=stand.reach_mm + _STEP_MM)
        free = [
            angle
            for angle in wanted
            if not stand.tube(angle, stand.bore_mm).intersects(stand.walls)
        ]
        if 0.0 not in free:
            return "its tube does not pass the border and obstacles behind it: widen --entry-mm"
        if len(free) == len(wanted):
            break
        wanted = free
    if stand.reach_mm > most_mm:
        return "other walls of the rig leave no room for it"
    inner_mm = math.hypot(stand.reach_mm + 8.0, stand.ear_mm)
    steps_deg = (5.0, 10.0, 15.0, 30.0)
    step_deg = next(
        (step for step in steps_deg if math.radians(step) * inner_mm >= _HOLE_APART_MM), 30.0
    )
    headings = tuple(angle for angle in wanted if angle % step_deg == 0.0)
    return replace(stand, headings=headings, step_deg=step_deg)


def _entry(stand: Stand) -> BaseGeometry:
    """Return the opening of the border between the mouth and the block."""
    low, side = stand.rear_mm, stand.half_mm
    near = box(low, -3.0 * side, 0.0, 3.0 * side)
    border = stand.plate.difference(stand.inside).difference(stand.walls)
    # Opened a little: slivers that rounding leaves along the border's edges are not gaps.
    opened = border.buffer(-_SLIVER_MM, join_style="mitre").buffer(_SLIVER_MM, join_style="mitre")
    way = LineString([(0.0, 0.0), (low, 0.0)])
    gaps = [gap for gap in polygon_parts(opened) if gap.intersects(way)]
    return shapely.union_all(gaps).intersection(near)


def _hooks(dial: Polygon, stand: Stand) -> list[tuple[BaseGeometry, BaseGeometry]]:
    """Return the hooks at the ends of the border: what stands on the dial, what reaches over."""
    swept = stand.turned(stand.tube(0.0, stand.bore_mm + 1.0))
    beside = stand.walls.buffer(stand.gap_mm)
    taken = shapely.union_all([stand.turned(stand.block).buffer(0.4), swept, beside])
    room = _entry(stand).difference(taken).intersection(stand.walls.buffer(_HOOK_MM))
    found = []
    for piece in snapped_union(room):
        post = dial.intersection(piece.buffer(_HOOK_POST_MM, join_style="mitre")).difference(taken)
        wide = piece.buffer(-0.5 * _LEAST_HOOK_MM).area > 0.0
        if wide and post.area > _LEAST_HOOK_MM * _HOOK_POST_MM and piece.distance(post) < _TOUCH_MM:
            found.append((post, piece))
    return found


def _dial_part(
    dial: Polygon, hooks: list[tuple[BaseGeometry, BaseGeometry]], stand: Stand
) -> RigPart:
    """Return the dial as a solid: flat, with holes, hooks and marks."""
    dial_mm, pin_mm = stand.dial_mm, 0.5 * _PIN_MM + _PIN_GAP_MM
    pins = [
        rotated(pin, angle).buffer(pin_mm, quad_segs=6)
        for pin in stand.pins
        for angle in stand.headings
    ]
    # To fix it to a table or board: a hole in its rim at the left, and one at the right.
    free = dial.difference(shapely.union_all([post.buffer(2.0) for post, _ in hooks]))
    rim = free.difference(stand.turned(stand.block).buffer(0.5)).buffer(-4.0)
    corners = [Point(free.bounds[2], side * 1e3) for side in (-1.0, 1.0)]
    fixing = [
        nearest_points(rim, corner)[0].buffer(2.1, quad_segs=6)
        for corner in corners
        if not rim.is_empty
    ]
    (flat,) = snapped_union(dial.difference(shapely.union_all([*pins, *fixing])))
    # The scale: a line and a number for each heading.
    x_mm, y_mm = stand.pointer_mm
    at_deg, far_mm = math.degrees(math.atan2(y_mm, x_mm)), math.hypot(x_mm, y_mm)
    lines: list[LineString] = []
    for angle in stand.headings:
        out_rad = math.radians(at_deg + angle)
        out = np.array([math.cos(out_rad), math.sin(out_rad)])
        lines.append(LineString([(far_mm + 0.8) * out, (far_mm + 3.5) * out]))
        # The heading of the robot: the block's rear goes right when its front goes left.
        text = centred(strokes(f"{angle:.0f}", 0.5 * _DIGIT_MM), 0.0, 0.0)
        middle = (far_mm + 6.2) * out
        lines += [translate(rotated(line, at_deg + angle + 90.0), *middle) for line in text]
    scale = shapely.set_precision(grooves(lines, 0.6 * _STROKE_MM), GRID_MM)
    marks = snapped_union(scale.intersection(flat.buffer(-0.5)))
    low = np.array(flat.bounds[:2])
    body = flat_prism(polygon_parts(flat), (0.0, dial_mm), low)
    volume_mm3 = flat.area * dial_mm
    for pieces, low_mm, high_mm in _hook_slices(hooks, stand):
        body += flat_prism(pieces, (low_mm, high_mm), low)
        volume_mm3 += float(shapely.area(pieces).sum()) * (high_mm - max(low_mm, dial_mm))
    body -= flat_prism(marks, (dial_mm - _MARK_MM, dial_mm + 0.5), low)
    volume_mm3 -= float(shapely.area(marks).sum()) * _MARK_MM
    shift = np.eye(4)
    shift[:2, 3] = low
    return solid_part("base_dial", body, shift, volume_mm3, stand)


def flat_prism(pieces: Polygons, heights_mm: tuple[float, float], low: Floats) -> Manifold:
    """Return outlines between two heights as a solid, moved so that ``low`` is the origin."""
    moved = np.asarray(shapely.transform(pieces, lambda points: points - low), dtype=object)
    return prism(Course(pieces=moved, low_mm=heights_mm[0], high_mm=heights_mm[1]))


def _hook_slices(
    hooks: list[tuple[BaseGeometry, BaseGeometry]], stand: Stand
) -> Iterator[tuple[Polygons, float, float]]:
    """Yield the hooks from the dial up; each slice reaches a step further over the rig."""
    if not hooks:
        return
    posts = shapely.union_all([post for post, _ in hooks])
    over = shapely.union_all([piece for _, piece in hooks])
    over_mm, border_mm = stand.options.plate_mm + stand.gap_mm, stand.options.border_mm
    yield polygon_parts(posts), 0.5 * stand.dial_mm, over_mm
    steps = max(1, math.ceil(border_mm / _STEP_MM))
    for step in range(1, steps + 1):
        # Each step is as high as it reaches out: it prints without supports.
        reached = over.intersection(posts.buffer(step * border_mm / steps, quad_segs=2))
        both = shapely.union(posts, reached).buffer(_TOUCH_MM, join_style="mitre")
        pieces = snapped_union(both.buffer(-_TOUCH_MM, join_style="mitre"))
        from_mm = over_mm + (step - 1) * _STEP_MM
        yield pieces, from_mm, from_mm + (_STEP_MM if step < steps else 2.0)


def circle_over(z_mm: float, radius_mm: float) -> Polygon:
    """Return a circle as a polygon of 96 corners whose sides, not corners, touch it."""
    turns = 2.0 * np.pi * np.arange(96) / 96.0
    corners = radius_mm / math.cos(math.pi / 96.0) * np.c_[np.cos(turns), np.sin(turns)]
    return Polygon(corners + np.array([0.0, z_mm]))


def _block_part(stand: Stand) -> RigPart:
    """Return the block, standing on its rear face: nothing needs supports."""
    half, high = stand.half_mm, stand.block_mm
    bore = circle_over(high + 0.5 * SPLIT_MM, stand.bore_mm)
    profile = snapped_union(box(-half, 0.0, half, high).difference(bore))
    holes, notch = stand.screws, stand.notch
    turns = np.pi / 3.0 * np.arange(6)
    nut = _NUT_MM / math.sqrt(3.0) * np.c_[np.cos(turns), np.sin(turns)]
    middle = -stand.reach_mm - 0.5 * CLAMP_MM
    nuts = [
        Polygon(nut + np.array([middle, y])).difference(hole)
        for y, hole in zip((-stand.ear_mm, stand.ear_mm), holes, strict=True)
    ]
    pins = [pin.buffer(0.5 * _PIN_MM, quad_segs=6) for pin in stand.pins]
    pin_mm = stand.dial_mm - 0.2
    body = _along(profile)
    for shapes, low_mm, high_mm in (
        (holes, -1.0, high + 1.0),
        (nuts, -1.0, _NUT_DEEP_MM),
        ([_stretched(notch)], -1.0, high + 1.0),
    ):
        body -= _upright(shapes, (low_mm, high_mm), stand)
    body += _upright(pins, (-pin_mm, 0.5 * _PIN_MM), stand)
    volume_mm3 = (
        float(shapely.area(profile).sum()) * CLAMP_MM
        - sum(hole.area for hole in holes) * high
        - sum(nut.area for nut in nuts) * _NUT_DEEP_MM
        - notch.area * high
        + sum(pin.area for pin in pins) * pin_mm
    )
    to_frame = _standing(stand, stand.dial_mm - pin_mm)
    return solid_part("base_block", body.translate((0.0, pin_mm, 0.0)), to_frame, volume_mm3, stand)


def _cap_part(stand: Stand) -> RigPart:
    """Return the cap, standing on its rear face."""
    half, dome = stand.half_mm, stand.bore_mm + _CAP_WALL_MM
    top_mm = stand.bore_mm + _CAP_WALL_MM - 0.5 * SPLIT_MM
    ear_mm = min(_CAP_EAR_MM, top_mm)
    ears, roof = box(-half, 0.0, half, ear_mm), box(-dome, 0.0, dome, top_mm)
    bore = circle_over(-0.5 * SPLIT_MM, stand.bore_mm)
    profile = snapped_union(shapely.union(ears, roof).difference(bore))
    cuts = [*stand.screws, _stretched(stand.notch)]
    body = _along(profile) - _upright(cuts, (-1.0, top_mm + 1.0), stand)
    cut_mm2 = sum(cut.area for cut in (*stand.screws, stand.notch))
    volume_mm3 = float(shapely.area(profile).sum()) * CLAMP_MM - cut_mm2 * ear_mm
    to_frame = _standing(stand, stand.axis_mm + 0.5 * SPLIT_MM)
    return solid_part("base_cap", body, to_frame, volume_mm3, stand)


def _stretched(notch: Polygon) -> BaseGeometry:
    """Return a notch in the rear face that begins behind it, so that no skin is left."""
    x_min, y_min, _, y_max = notch.bounds
    return shapely.union(notch, box(x_min - 1.0, y_min, x_min, y_max))


def _along(profile: Polygons) -> Manifold:
    """Return a profile (y, z) as a solid along the tube, as printed: (y + half, z, x + length)."""
    return flat_prism(profile, (0.0, CLAMP_MM), np.array([shapely.total_bounds(profile)[0], 0.0]))


def _upright(
    shapes: Sequence[BaseGeometry], heights_mm: tuple[float, float], stand: Stand
) -> Manifold:
    """Return shapes (x, y) as upright prisms, turned as the part is printed."""
    body = flat_prism(polygon_parts(*shapes), heights_mm, np.zeros(2))
    rows = [[0.0, 1.0, 0.0, stand.half_mm], [0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 0.0, -stand.rear_mm]]
    return body.transform(np.array(rows))


def _standing(stand: Stand, low_mm: float) -> Floats:
    """Return the transform, shape (4, 4), from a part as printed into the holder's frame."""
    matrix = np.eye(4)[[2, 0, 1, 3]]
    matrix[:3, 3] = stand.rear_mm, -stand.half_mm, low_mm
    return matrix


def solid_part(
    name: str, body: Manifold, to_frame: Floats, volume_mm3: float, stand: Stand
) -> RigPart:
    """Return a solid as a part, corners joined that lie nearer than a file can tell apart.

    Where edges of hooks and dial nearly meet, rounding to single precision would leave triangles
    without an area; the least welding that avoids them is taken.
    """
    welds_mm = (2e-3, 5e-3, 1e-2, 2e-2)
    for weld_mm in welds_mm:
        vertices, faces = solid_mesh(body.simplify(weld_mm))
        if not Mesh.of_corners(vertices[faces]).form_problems():
            break
    return RigPart(
        name=name,
        vertices_mm=vertices,
        faces=faces,
        to_map=stand.to_map @ to_frame,
        volume_mm3=volume_mm3,
    )
