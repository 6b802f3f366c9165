"""What stands around a rig: the holder of the robot's base, and its corner markers.

Markers are printed tiles with black cells, or pads of the board that carry them.

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
from dataclasses import dataclass, field, replace
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
    DEFAULT_MARKER_GAP_MM,
    MARKER_CELLS,
    MARKER_SIDE_CELLS,
    CornerMarker,
    Map,
    Start,
    corner_markers,
)
from vinefab.physics.tube import inflated_diameter_mm
from vinefab.rig.part import GRID_MM, Mesh, Printer, Rig, RigOptions, RigPart, mesh_problems
from vinefab.rig.rig_plan import Polygons, bridged, polygon_parts, snapped_union
from vinefab.rig.solid import (
    Course,
    centred,
    engraved_marks,
    grooves,
    prism,
    solid_mesh,
    stacked,
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
    outline: BaseGeometry  # of the dial, in the plan
    notes: tuple[str, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Stand:
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
        return _rotated(box(self.rear_mm, -radius_mm, 0.0, radius_mm), angle_deg)

    def turned(self, shape: Polygon) -> BaseGeometry:
        """Return the area that a shape covers at all headings, those between two holes included."""
        turns = np.linspace(self.headings[0], self.headings[-1], 2 * len(self.headings) + 1)
        return shapely.union_all([_rotated(shape, turn) for turn in turns.tolist()])


def _rotated(shape: G, angle_deg: float) -> G:
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


def _stand_of(start: Start, world: Map, rig: Rig, taken: BaseGeometry, tube: BaseTube) -> _Stand:
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
    axis_mm = max(options.plate_mm + tube.axis_mm, bore_mm + floor_mm + least_mm)
    dial_mm = min(most_mm, math.floor(5.0 * (axis_mm - bore_mm - floor_mm) + 1e-6) / 5.0)
    return _Stand(
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


def _holder(number: int, start: Start, stand: _Stand, tube: BaseTube) -> BaseHolder | str:
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
    to_plan = stand.to_plan
    return BaseHolder(
        start=number,
        tube=tube,
        bore_mm=2.0 * stand.bore_mm,
        axis_mm=axis_mm,
        reach_mm=stand.reach_mm,
        headings_deg=stand.headings,
        screw_mm=screw_mm,
        parts=parts,
        outline=affine_transform(dial, [*to_plan[0, :2], *to_plan[1, :2], *to_plan[:2, 2]]),
        notes=tuple(f"base holder of start {number}: {text}" for text in notes if notes[text]),
    )


def _at_headings(start: Start, stand: _Stand) -> _Stand | str:
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
            if not any(_rotated(block, angle).intersects(clear) for angle in ends):
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


def _entry(stand: _Stand) -> BaseGeometry:
    """Return the opening of the border between the mouth and the block."""
    low, side = stand.rear_mm, stand.half_mm
    near = box(low, -3.0 * side, 0.0, 3.0 * side)
    border = stand.plate.difference(stand.inside).difference(stand.walls)
    # Opened a little: slivers that rounding leaves along the border's edges are not gaps.
    opened = border.buffer(-_SLIVER_MM, join_style="mitre").buffer(_SLIVER_MM, join_style="mitre")
    way = LineString([(0.0, 0.0), (low, 0.0)])
    gaps = [gap for gap in polygon_parts(opened) if gap.intersects(way)]
    return shapely.union_all(gaps).intersection(near)


def _hooks(dial: Polygon, stand: _Stand) -> list[tuple[BaseGeometry, BaseGeometry]]:
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
    dial: Polygon, hooks: list[tuple[BaseGeometry, BaseGeometry]], stand: _Stand
) -> RigPart:
    """Return the dial as a solid: flat, with holes, hooks and marks."""
    dial_mm, pin_mm = stand.dial_mm, 0.5 * _PIN_MM + _PIN_GAP_MM
    pins = [
        _rotated(pin, angle).buffer(pin_mm, quad_segs=6)
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
        lines += [translate(_rotated(line, at_deg + angle + 90.0), *middle) for line in text]
    scale = shapely.set_precision(grooves(lines, 0.6 * _STROKE_MM), GRID_MM)
    marks = snapped_union(scale.intersection(flat.buffer(-0.5)))
    low = np.array(flat.bounds[:2])
    body = _prism(polygon_parts(flat), (0.0, dial_mm), low)
    volume_mm3 = flat.area * dial_mm
    for pieces, low_mm, high_mm in _hook_slices(hooks, stand):
        body += _prism(pieces, (low_mm, high_mm), low)
        volume_mm3 += float(shapely.area(pieces).sum()) * (high_mm - max(low_mm, dial_mm))
    body -= _prism(marks, (dial_mm - _MARK_MM, dial_mm + 0.5), low)
    volume_mm3 -= float(shapely.area(marks).sum()) * _MARK_MM
    shift = np.eye(4)
    shift[:2, 3] = low
    return _part("base_dial", body, shift, volume_mm3, stand)


def _prism(pieces: Polygons, heights_mm: tuple[float, float], low: Floats) -> Manifold:
    moved = np.asarray(shapely.transform(pieces, lambda points: points - low), dtype=object)
    return prism(Course(pieces=moved, low_mm=heights_mm[0], high_mm=heights_mm[1]))


def _hook_slices(
    hooks: list[tuple[BaseGeometry, BaseGeometry]], stand: _Stand
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


def _circle(z_mm: float, radius_mm: float) -> Polygon:
    """Return a circle as a polygon of 96 corners whose sides, not corners, touch it."""
    turns = 2.0 * np.pi * np.arange(96) / 96.0
    corners = radius_mm / math.cos(math.pi / 96.0) * np.c_[np.cos(turns), np.sin(turns)]
    return Polygon(corners + np.array([0.0, z_mm]))


def _block_part(stand: _Stand) -> RigPart:
    """Return the block, standing on its rear face: nothing needs supports."""
    half, high = stand.half_mm, stand.block_mm
    bore = _circle(high + 0.5 * SPLIT_MM, stand.bore_mm)
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
    return _part("base_block", body.translate((0.0, pin_mm, 0.0)), to_frame, volume_mm3, stand)


def _cap_part(stand: _Stand) -> RigPart:
    """Return the cap, standing on its rear face."""
    half, dome = stand.half_mm, stand.bore_mm + _CAP_WALL_MM
    top_mm = stand.bore_mm + _CAP_WALL_MM - 0.5 * SPLIT_MM
    ear_mm = min(_CAP_EAR_MM, top_mm)
    ears, roof = box(-half, 0.0, half, ear_mm), box(-dome, 0.0, dome, top_mm)
    bore = _circle(-0.5 * SPLIT_MM, stand.bore_mm)
    profile = snapped_union(shapely.union(ears, roof).difference(bore))
    cuts = [*stand.screws, _stretched(stand.notch)]
    body = _along(profile) - _upright(cuts, (-1.0, top_mm + 1.0), stand)
    cut_mm2 = sum(cut.area for cut in (*stand.screws, stand.notch))
    volume_mm3 = float(shapely.area(profile).sum()) * CLAMP_MM - cut_mm2 * ear_mm
    to_frame = _standing(stand, stand.axis_mm + 0.5 * SPLIT_MM)
    return _part("base_cap", body, to_frame, volume_mm3, stand)


def _stretched(notch: Polygon) -> BaseGeometry:
    """Return a notch in the rear face that begins behind it, so that no skin is left."""
    x_min, y_min, _, y_max = notch.bounds
    return shapely.union(notch, box(x_min - 1.0, y_min, x_min, y_max))


def _along(profile: Polygons) -> Manifold:
    """Return a profile (y, z) as a solid along the tube, as printed: (y + half, z, x + length)."""
    return _prism(profile, (0.0, CLAMP_MM), np.array([shapely.total_bounds(profile)[0], 0.0]))


def _upright(
    shapes: Sequence[BaseGeometry], heights_mm: tuple[float, float], stand: _Stand
) -> Manifold:
    """Return shapes (x, y) as upright prisms, turned as the part is printed."""
    body = _prism(polygon_parts(*shapes), heights_mm, np.zeros(2))
    rows = [[0.0, 1.0, 0.0, stand.half_mm], [0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 0.0, -stand.rear_mm]]
    return body.transform(np.array(rows))


def _standing(stand: _Stand, low_mm: float) -> Floats:
    """Return the transform, shape (4, 4), from a part as printed into the holder's frame."""
    matrix = np.eye(4)[[2, 0, 1, 3]]
    matrix[:3, 3] = stand.rear_mm, -stand.half_mm, low_mm
    return matrix


def _part(name: str, body: Manifold, to_frame: Floats, volume_mm3: float, stand: _Stand) -> RigPart:
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


RAISED_LAYERS = 3
"""Layers of the second filament: black that lets no white through (assumed)."""


ARM_MM = 25.0
"""Length of a tile's arms along the two sides of the rig's corner."""

_RELIEF_MM, _BOARD_RIM_MM, _PAPER_GAP_MM = 1.0, 1.0, 0.25


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MarkerPad:
    """What carries one marker: a tile, or a part of the board."""

    marker: CornerMarker  # in map coordinates
    square: Polygon  # the marker, its black frame included
    paper: Polygon  # with the quiet zone around it
    cells: Polygons  # black cells, joined where they touch in a point
    outline: Polygon  # tile, with arms along the rig's sides if it has a corner there
    corner: Point | None  # of the rig, which its arms lie against


def marker_gap_mm(options: RigOptions) -> float:
    """Return the distance of the markers from the bounds' box, so that no border hides them."""
    # How far a border hides the ground behind it, over its height: a camera above the middle, as
    # high as the rig is long, looks over the middle of a side at this slope.
    hiding_slope = 0.5
    hidden_mm = options.border_mm + hiding_slope * options.height_mm
    quiet_mm = options.border_mm + options.marker_mm / MARKER_SIDE_CELLS
    return max(DEFAULT_MARKER_GAP_MM, quiet_mm, hidden_mm)


def base_layers(printer: Printer, options: RigOptions) -> int:
    """Return the number of a printed tile's white layers; its black top is level with the floor."""
    above = 0 if options.marker_kind == "paper" else RAISED_LAYERS
    least_base_layers = 6  # layers of a tile below its cells, at least
    return max(round(options.plate_mm / printer.layer_mm) - above, least_base_layers)


def marker_face_mm(printer: Printer, options: RigOptions) -> float:
    """Return the height of the markers' faces above the floor that the robot lies on."""
    if options.style != "plate" and options.marker_kind != "print":
        return 0.0  # on the board
    above = 0 if options.marker_kind == "paper" else RAISED_LAYERS
    high_mm = (base_layers(printer, options) + above) * printer.layer_mm
    return round(high_mm - options.plate_mm, 6)


def marker_pads(
    world: Map, plate: BaseGeometry, printer: Printer, options: RigOptions
) -> tuple[MarkerPad, ...]:
    """Return the four pads of a rig, none for markers ``none``.

    Parameters
    ----------
    plate
        Outline of the rig's plate or board, in the coordinates of the plan.
    """
    if options.marker_kind == "none":
        return ()
    scale = options.scale
    markers = corner_markers(
        world,
        side_mm=options.marker_mm / scale,
        gap_mm=marker_gap_mm(options) / scale,
        z_mm=marker_face_mm(printer, options) / scale,
    )
    rig = shapely.union_all([Polygon(piece.exterior) for piece in polygon_parts(plate)])
    low_mm = np.array(world.bounds.bounds[:2])
    return tuple(
        _pad(marker, (marker.corners_mm - low_mm) * scale, rig, printer) for marker in markers
    )


def _pad(
    marker: CornerMarker, corners_mm: Floats, rig: BaseGeometry, printer: Printer
) -> MarkerPad:
    low, high = corners_mm.min(axis=0), corners_mm.max(axis=0)
    square = box(*low, *high)
    cell_mm = (high[0] - low[0]) / MARKER_SIDE_CELLS
    paper = square.buffer(cell_mm, join_style="mitre")
    # The corner of the rig's box that it belongs to, and the signs that lead inward.
    x_min, y_min, x_max, y_max = rig.bounds
    right, top = marker.number in (1, 2), marker.number in (2, 3)
    corner = np.array([x_max if right else x_min, y_max if top else y_min])
    inward = np.array([-1.0 if right else 1.0, -1.0 if top else 1.0])
    # Two arms along the sides of the rig's corner; none where it has no such corner.
    long_mm = np.minimum(ARM_MM, 0.3 * np.array([x_max - x_min, y_max - y_min]))
    pad_touch_mm = 0.01
    edge, arms = rig.boundary.buffer(pad_touch_mm), list[Polygon]()
    board_screw_mm = 4.2
    arm_wide_mm = 12.0
    for axis in (0, 1):
        along, across = np.zeros(2), np.zeros(2)
        along[axis] = long_mm[axis] * inward[axis]
        across[1 - axis] = -arm_wide_mm * inward[1 - axis]
        if not edge.covers(LineString([corner, corner + along])):
            arms = []
            break
        hole = Point(*(corner + along + 0.5 * across - 0.3 * arm_wide_mm * np.sign(along)))
        arm = box(*np.sort([corner, corner + along + across], axis=0).ravel())
        arms.append(arm.difference(hole.buffer(0.5 * board_screw_mm, quad_segs=6)))
    outline = paper
    if arms:
        foot = box(*np.sort([corner, corner - arm_wide_mm * inward], axis=0).ravel())
        hull = shapely.convex_hull(shapely.union(paper, foot))
        outline = shapely.union_all([hull, *arms]).difference(rig)
    (whole,) = snapped_union(outline)
    return MarkerPad(
        marker=marker,
        square=square,
        paper=paper,
        cells=bridged(black_cells(marker.number, square), square, 0.5 * printer.nozzle_mm)[0],
        outline=whole,
        corner=Point(corner) if arms else None,
    )


def black_cells(number: int, square: Polygon) -> Polygons:
    """Return the black cells of a marker in its square, frame included, joined along edges."""
    x_mm, y_mm, right_mm, _ = square.bounds
    cell_mm, edge = (right_mm - x_mm) / MARKER_SIDE_CELLS, "." * MARKER_SIDE_CELLS
    rows = [edge, *(f".{row}." for row in MARKER_CELLS[number]), edge]
    cells = [
        box(
            x_mm + column * cell_mm,
            y_mm + (MARKER_SIDE_CELLS - 1 - row) * cell_mm,
            x_mm + (column + 1) * cell_mm,
            y_mm + (MARKER_SIDE_CELLS - row) * cell_mm,
        )
        for row, signs in enumerate(rows)
        for column, sign in enumerate(signs)
        if sign == "."
    ]
    return snapped_union(*cells)


def marker_tiles(
    pads: tuple[MarkerPad, ...], printer: Printer, options: RigOptions, plan_to_map: Floats
) -> tuple[RigPart, ...]:
    """Return the printed tiles of pads; none where the board carries the markers.

    Parameters
    ----------
    plan_to_map
        Transform, shape (4, 4), from the plan into map coordinates, z = 0 being the table.
    """
    if options.style != "plate" and options.marker_kind != "print":
        return ()
    return tuple(_tile(pad, printer, options, plan_to_map) for pad in pads)


def _tile(pad: MarkerPad, printer: Printer, options: RigOptions, plan_to_map: Floats) -> RigPart:
    base_mm = base_layers(printer, options) * printer.layer_mm
    outline = pad.outline
    if pad.corner is not None:  # a round relief where the rig's sharp corner lies
        relief = pad.corner.buffer(_RELIEF_MM, quad_segs=4)
        outline = snapped_union(outline.difference(relief))[0]
    low_mm = np.array(outline.bounds[:2])
    depth_mm = min(options.mark_depth_mm, 0.25 * base_mm)
    # On the underside of the marker's middle: the arms have no room.
    marks = engraved_marks(pad.marker.number, pad.square) if depth_mm else polygon_parts(Polygon())
    cells, recess = polygon_parts(Polygon()), polygon_parts(Polygon())
    raised_mm = recess_mm = 0.0
    recess_layers = 2  # depth of the recess for a paper marker
    if options.marker_kind == "print":
        cells, raised_mm = pad.cells, RAISED_LAYERS * printer.layer_mm
    else:
        recess_mm = recess_layers * printer.layer_mm
        recess = polygon_parts(_recess(pad))
    thick_mm = base_mm + recess_mm

    def moved(pieces: Polygons) -> Polygons:
        return np.asarray(shapely.transform(pieces, lambda points: points - low_mm), dtype=object)

    pockets = [
        Course(pieces=moved(marks), low_mm=-1.0, high_mm=depth_mm),
        Course(pieces=moved(recess), low_mm=base_mm, high_mm=thick_mm + 1.0),
    ]
    vertices, faces = stacked(
        moved(polygon_parts(outline)), moved(cells), thick_mm, raised_mm, pockets
    )
    shift = np.eye(4)
    shift[:2, 3] = low_mm
    return RigPart(
        name=f"marker_{pad.marker.number}",
        vertices_mm=vertices,
        faces=faces,
        to_map=plan_to_map @ shift,
        volume_mm3=float(
            outline.area * thick_mm
            + shapely.area(cells).sum() * raised_mm
            - shapely.area(marks).sum() * depth_mm
            - shapely.area(recess).sum() * recess_mm
        ),
        colour_change_mm=base_mm if options.marker_kind == "print" else 0.0,
    )


def _recess(pad: MarkerPad) -> Polygon:
    """Return the recess for a paper marker; the tile keeps a rim around it."""
    return pad.paper.buffer(-_BOARD_RIM_MM, join_style="mitre")


def paper_crop_mm(pad: MarkerPad) -> float:
    """Return the side of a paper marker with its quiet zone, as it is cut out."""
    x_min, _, x_max, _ = _recess(pad).bounds
    return float(x_max - x_min) - 2.0 * _PAPER_GAP_MM


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BoardMarkers:
    """What a board gets for its markers."""

    pads: BaseGeometry = field(default_factory=Polygon)  # what is added to the board
    squares: Polygons = field(default_factory=lambda: polygon_parts(Polygon()))  # not to be divided
    marks: tuple[LineString, ...] = ()  # engraved


def board_markers(pads: tuple[MarkerPad, ...], options: RigOptions) -> BoardMarkers:
    """Return pads and engraved lines of a board: hatched cells, or where a paper marker goes."""
    if options.style == "plate" or options.marker_kind not in ("engrave", "paper"):
        return BoardMarkers()
    if options.marker_kind == "engrave":
        marks = []
        beam_mm = max(options.kerf_mm, 0.1)
        for pad in pads:  # level lines that fill the black cells, one beam's width apart
            x_min, y_min, x_max, y_max = pad.square.bounds
            count = math.ceil((y_max - y_min) / beam_mm)
            heights = y_min + (np.arange(count) + 0.5) * (y_max - y_min) / count
            ends = [[(x_min - 1.0, y), (x_max + 1.0, y)] for y in heights.tolist()]
            rows = shapely.linestrings(ends)
            cut = shapely.get_parts(shapely.intersection(rows, shapely.union_all(pad.cells)))
            # The beam is round: half of it reaches beyond the ends.
            marks += [
                LineString([(left + 0.5 * beam_mm, low), (right - 0.5 * beam_mm, high)])
                for left, low, right, high in (line.bounds for line in cut)
                if right - left > 1.5 * beam_mm
            ]
    else:  # the square of a paper marker, with its number in it
        marks = [LineString(_recess(pad).exterior.coords) for pad in pads]
        for pad in pads:
            middle = pad.paper.centroid
            marks += centred(strokes(str(pad.marker.number), 8.0), middle.x, middle.y)
    return BoardMarkers(
        pads=shapely.union_all([pad.outline for pad in pads]),
        squares=polygon_parts(*(pad.paper for pad in pads)),
        marks=tuple(marks),
    )


def marker_notes(pads: tuple[MarkerPad, ...], printer: Printer, options: RigOptions) -> list[str]:
    """Return the notes for the person who prints or cuts the markers."""
    if not pads:
        return []
    layers = base_layers(printer, options)
    notes = [
        {
            "print": "markers: print the marker tiles in white and change to black at "
            f"{layers * printer.layer_mm:.2f} mm (layer {layers + 1}); push each into its corner "
            "of the rig",
            "paper": "markers: print markers.svg at 100 %, cut along its marks and glue in place",
            "engrave": "markers: engraved with the board; they have to come out dark on it "
            "(assumed)",
        }[options.marker_kind]
    ]
    loose = [str(pad.marker.number) for pad in pads if pad.corner is None]
    if loose:
        notes.append(
            f"markers {', '.join(loose)}: the rig has no corner there to push them against: lay "
            "the rig and them onto plan.svg, printed at 100 %"
        )
    return notes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fixtures:
    """Markers and base holder of a rig."""

    pads: tuple[MarkerPad, ...] = ()
    base: BaseHolder | None = None
    board: BoardMarkers = field(default_factory=BoardMarkers)

    @property
    def markers(self) -> tuple[CornerMarker, ...]:
        """The corner markers, in map coordinates."""
        return tuple(pad.marker for pad in self.pads)


def with_fixtures(rig: Rig, world: Map, design: Design | None) -> tuple[Rig, Fixtures]:
    """Return a rig with markers and base holder in its extras and notes, and these fixtures."""
    plate = rig.on_plan(rig.plate)
    pads = marker_pads(world, plate, rig.printer, rig.options)
    taken = shapely.union_all([pad.outline for pad in pads])
    base, notes = base_holder(world, rig, design, taken)
    tiles = marker_tiles(pads, rig.printer, rig.options, rig.table_to_map)
    board = board_markers(pads, rig.options)
    fixtures = Fixtures(pads=pads, base=base, board=board)
    beside = rig.extras
    if pads:  # what lies at the rig's upper right corner moves down, below the tile there
        down = np.zeros((4, 4))
        down[1, 3] = (ARM_MM + 10.0) / rig.options.scale
        beside = tuple(replace(part, to_map=part.to_map - down) for part in beside)
    whole = replace(
        rig,
        extras=(*beside, *tiles, *(base.parts if base else ())),
        notes=(*rig.notes, *marker_notes(pads, rig.printer, rig.options), *notes),
    )
    return whole, fixtures


def outside_of(fixtures: Fixtures) -> BaseGeometry:
    """Return everything that lies around the rig, in the plan."""
    dial = fixtures.base.outline if fixtures.base else Polygon()
    return shapely.union_all([dial, *(pad.outline for pad in fixtures.pads)])
