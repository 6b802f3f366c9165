"""Joints and elbows: the outline through each gap, with its largest fillet.

In the joint's frame the joint is the origin and the parent's heading is +x. The core is the parent
with a rounded end: a disc of its half width R and, behind it, two sides. The outline comes along
the parent's right side, around the disc and back along its left side. The sides of an even parent
are y = -R and y = R; those of a tapered one touch the disc a little further ahead and lean by the
tilt. Behind a child that bends backwards the parent's side shows again.

A fillet of radius r is a ball that rolls in the gap between two children, down the left side of
the first and down the right side of the second, until it rests on the core. Where the first would
rest behind the second, it never reaches the core: it rests on both children.

An elbow, where a tube continues behind a preformed bend, has a fillet on its inner side; its outer
edge is an arc around the same centre, so that the tube keeps its width.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise

from vinefab.model.outline import Contour, Part, Segment

LEAST_SEGMENT_MM = 0.05
"""Length of the shortest segment of an outline."""

LEAST_CUT_MM = 0.2
"""Length of the shortest segment that a laser draws well: rule VF-L02 refuses shorter ones."""

LEAST_ARC_RADIUS_MM = 0.5
"""Radius of the smallest arc that a laser draws well: rule VF-L02 refuses smaller ones."""

WORST_ERROR_MM = 0.002
"""An arc too short to draw may become a corner that is this far from the exact shape."""

MOST_TURN_RAD = math.radians(174.9)
"""Largest turn of an arc, longer ones are split: readers fail near half a circle."""

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class StrokeSegment:
    """One line or arc that begins at the end of the previous one."""

    end_mm: Point  # in the frame of its run
    bulge: float  # tangent of a quarter of its turn, as in `Segment`
    part: Part
    owner: int = 0  # which of the run's branches it belongs to


@dataclass(frozen=True, slots=True)
class StrokeRun:
    """Connected lines and arcs, in a frame of their own."""

    start_mm: Point  # where the first piece begins
    pieces: tuple[StrokeSegment, ...] = ()  # none for a bare corner

    @property
    def end_mm(self) -> Point:
        """Where the last piece ends."""
        return self.pieces[-1].end_mm if self.pieces else self.start_mm

    def mirrored(self) -> "StrokeRun":
        """Return the run on the other side of the x axis."""
        (x, y), pieces = self.start_mm, self.pieces
        turned_over = (
            StrokeSegment((p.end_mm[0], -p.end_mm[1]), -p.bulge, p.part, p.owner) for p in pieces
        )
        return StrokeRun((x, -y), tuple(turned_over))

    def reversed(self) -> "StrokeRun":
        """Return the run from its other end."""
        ends = [self.start_mm, *(piece.end_mm for piece in self.pieces)][::-1]
        back = zip(ends[1:], self.pieces[::-1], strict=True)
        pieces = (StrokeSegment(end, -p.bulge, p.part, p.owner) for end, p in back)
        return StrokeRun(ends[0], tuple(pieces))


@dataclass(frozen=True, slots=True)
class LocalFrame:
    """A frame of a run, placed on the sheet."""

    origin_mm: Point
    heading_rad: float  # direction of its x axis


def polar(radius_mm: float, angle_rad: float) -> Point:
    """Return the point at a distance and direction from the origin."""
    return radius_mm * math.cos(angle_rad), radius_mm * math.sin(angle_rad)


def turned(point: Point, angle_rad: float) -> Point:
    """Return a point turned counter-clockwise about the origin."""
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    return cos * point[0] - sin * point[1], sin * point[0] + cos * point[1]


def arc(
    center_mm: Point, start_mm: Point, turn_rad: float, part: Part, owner: int = 0
) -> list[StrokeSegment]:
    """Return an arc from its start, split into equal pieces below 175 degrees."""
    count = max(1, math.ceil(abs(turn_rad) / MOST_TURN_RAD))
    bulge = math.tan(turn_rad / count / 4.0)
    spoke = start_mm[0] - center_mm[0], start_mm[1] - center_mm[1]
    pieces = []
    for step in range(1, count + 1):
        x, y = turned(spoke, turn_rad * step / count)
        pieces.append(StrokeSegment((center_mm[0] + x, center_mm[1] + y), bulge, part, owner))
    return pieces


class Pen:
    """Draws a contour, segment by segment."""

    def __init__(self, start_mm: Point) -> None:
        self.at_mm, self.segments = start_mm, list[Segment]()

    def go_to(self, point: Point, part: Part, branch: str, bulge: float = 0.0) -> None:
        """Draw to a point, unless the pen is there already; an arc that turns too far as two."""
        if math.dist(self.at_mm, point) < 1e-9:
            return
        if abs(bulge) > math.tan(MOST_TURN_RAD / 4.0):
            (x0, y0), (x1, y1) = self.at_mm, point
            middle = (x0 + x1 + bulge * (y1 - y0)) / 2.0, (y0 + y1 - bulge * (x1 - x0)) / 2.0
            bulge = math.tan(math.atan(bulge) / 2.0)
            self.go_to(middle, part, branch, bulge)
        self.segments.append(
            Segment(start_mm=self.at_mm, end_mm=point, bulge=bulge, part=part, branch=branch)
        )
        self.at_mm = point

    def pieces(self, run: StrokeRun, frame: LocalFrame, owners: Sequence[str]) -> None:
        """Draw a run's pieces; the pen stands at the run's start."""
        for piece in run.pieces:
            point = placed(piece.end_mm, frame)
            self.go_to(point, piece.part, owners[piece.owner], piece.bulge)

    def contour(self) -> Contour:
        """Return the open contour drawn so far."""
        return Contour.from_segments(self.segments, closed=False)


def placed(point: Point, frame: LocalFrame) -> Point:
    """Return where a frame's point lies on the sheet."""
    x, y = turned(point, frame.heading_rad)
    return frame.origin_mm[0] + x, frame.origin_mm[1] + y


LEFT, RIGHT = 1, -1
"""Sides of a strip, seen along its direction away from the joint, and of the core."""

PARENT = 0
"""Owner number of the parent."""

STEEPEST = 0.99
"""Sine of the largest angle by which the sides of a tapered branch may lean."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Strip:
    """One side of a branch as its joint sees it.

    A tapered branch is the hull of two discs: its sides touch the disc at the joint and lean
    against its axis. Seen from the joint, such a side is the side of an even strip of the disc's
    half width whose axis leans as the side does.
    """

    angle_rad: float  # direction of the side away from the joint, relative to the parent's heading
    half_mm: float  # its distance from the joint
    length_mm: float  # its planned length
    owner: int  # `PARENT`, or 1, 2, ... for the children


def taper_rad(base_half_mm: float, end_half_mm: float, length_mm: float) -> float:
    """Return the angle by which a branch's sides lean towards its axis: 0 for an even one.

    The hull of two discs of radii a and b, a length l apart, has sides that lean by
    asin((a - b) / l); discs that hide each other have none, and give what is left of a right angle.
    Such a branch is a named problem.
    """
    sin = (base_half_mm - end_half_mm) / length_mm
    return math.asin(max(-STEEPEST, min(STEEPEST, sin)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Gap:
    """The outline between two neighbours."""

    first: Strip
    second: Strip
    run: StrokeRun  # in the joint's frame
    first_used_mm: float  # how far from the joint the straight side of the first begins
    second_used_mm: float  # and that of the second
    radius_mm: float  # fillet radius drawn
    reach_mm: float  # distance from the joint to the nearest point of the outline in the gap
    # Deviation from the exact shape: above 0 only where an arc too short to draw became a corner.
    error_mm: float = 0.0

    @property
    def angle_rad(self) -> float:
        """Angle from the first strip to the second, 0 to 2 pi."""
        return self.second.angle_rad - self.first.angle_rad


def crotch_reach_mm(angle_rad: float, first_half_mm: float, second_half_mm: float) -> float:
    """Return the distance from the joint at which two sides' lines cross; else infinity."""
    sin, cos = math.sin(angle_rad), math.cos(angle_rad)
    if sin < 1e-9:
        return math.inf
    a, b = first_half_mm, second_half_mm
    return math.sqrt(a * a + b * b + 2.0 * a * b * cos) / sin


def largest_fillet_mm(angle_rad: float, halves_mm: Point, reach_mm: float) -> float:
    """Return the radius whose fillet comes to ``reach_mm`` from the joint, negative if none does.

    For strips of one width w this is (reach sin(a/2) - w/2) / (1 - sin(a/2)).
    """
    sin, cos = math.sin(angle_rad), math.cos(angle_rad)
    if angle_rad >= math.pi - 1e-6:
        return math.inf
    a, b = halves_mm
    # At an obtuse angle a wide strip hides where the sides' lines cross: that is behind the joint.
    ahead = min(b + a * cos, a + b * cos) >= 0.0
    if sin < 1e-9 or (ahead and crotch_reach_mm(angle_rad, a, b) > reach_mm):
        return -1.0
    square = (1.0 + cos) / (1.0 - cos)
    half_linear = (a + b) / (1.0 - cos) - reach_mm
    constant = (a * a + b * b + 2.0 * a * b * cos) / (sin * sin) - reach_mm * reach_mm
    root = math.sqrt(max(0.0, half_linear**2 - square * constant))
    return (root - half_linear) / square


@dataclass(frozen=True, slots=True)
class Neck:
    """Where a straight side meets a disc that bulges out of it."""

    used_mm: float  # distance along the side from the disc's centre to where the side ends
    angle_rad: float  # angle, from the strip's axis, at which the disc begins
    radius_mm: float  # fillet radius, 0 for a bare corner or where side and disc are tangent

    @property
    def turn_rad(self) -> float:
        """Angle through which the fillet turns, not negative."""
        return math.pi / 2 - self.angle_rad


def neck_length_mm(half_mm: float, disc_mm: float, radius_mm: float) -> float:
    """Return the distance from a disc's centre to a fillet with a side ``half_mm`` off the axis."""
    # The product keeps its zero exact when side and disc are tangent; a difference of squares
    # would leave 1e-7 mm of fillet behind.
    return math.sqrt(max(0.0, (disc_mm - half_mm) * (disc_mm + half_mm + 2.0 * radius_mm)))


def neck(half_mm: float, disc_mm: float, radius_mm: float) -> Neck:
    """Return the neck where a side at ``half_mm`` from the axis meets a disc, with a fillet.

    A fillet shorter than the shortest segment becomes a corner.
    """
    used = neck_length_mm(half_mm, disc_mm, radius_mm)
    found = Neck(used, math.atan2(half_mm + radius_mm, used), radius_mm)
    if radius_mm > 0.0 and radius_mm * found.turn_rad < LEAST_SEGMENT_MM:
        return neck(half_mm, disc_mm, 0.0)
    return found


DISC = 0
"""The core's rounded end."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Core:
    """A parent with a rounded end."""

    radius_mm: float  # radius of its end
    tilt_rad: float = 0.0  # angle by which its sides lean towards its axis, along its heading

    @property
    def side_rad(self) -> float:
        """Direction out of the left side; the right side's is its negative."""
        return math.pi / 2 - self.tilt_rad

    def corner_mm(self, zone: int) -> Point:
        """Return where a side touches the disc."""
        return polar(self.radius_mm, zone * self.side_rad)

    def depth_mm(self, point: Point) -> float:
        """Return the depth of a point inside, negative outside."""
        x, y = turned((point[0], abs(point[1])), self.tilt_rad)
        return self.radius_mm - (math.hypot(x, y) if x > 0.0 else y)


@dataclass(frozen=True, slots=True, kw_only=True)
class Contact:
    """Where a ball that rolls down one side of a child rests on the core."""

    used_mm: float  # how far from the joint, along the child, the child's straight side ends
    side_mm: Point  # the end of the child's straight side
    core_mm: Point  # the point of the core that the ball touches
    zone: int  # where that is: on the `LEFT` or `RIGHT` side of the parent, or on the `DISC`
    normal_rad: float  # direction out of the core at that point
    radius_mm: float  # the ball's radius, 0 for a bare corner
    turn_rad: float  # angle that the outline turns clockwise around the ball, not negative
    # Distance of the point ahead of where the parent's side touches the disc, along that side; 0 on
    # the disc.
    along_mm: float
    # Distance of the point around the core: 0 where its right side touches the disc, rising
    # counter-clockwise.
    position_mm: float

    @property
    def bulge(self) -> float:
        """Bulge of the fillet around the ball."""
        return -math.tan(self.turn_rad / 4.0)


def contact(
    strip: Strip, side: int, core: Core, radius_mm: float, *, tolerance_mm: float
) -> Contact:
    """Return where a ball that rolls down a child's side rests on the core.

    Parameters
    ----------
    tolerance_mm
        Where the disc ends and the parent's side begins, a ball that would touch the disc less
        than this ahead of it counts as touching the side.
    """
    found = neck(strip.half_mm, core.radius_mm, radius_mm)
    normal = strip.angle_rad + side * found.angle_rad
    zone = LEFT if normal > 0.0 else RIGHT
    past = min(abs(normal) - core.side_rad, math.pi / 2)
    leans = zone * math.sin(strip.angle_rad + zone * core.tilt_rad)
    if -core.radius_mm * math.sin(past) < tolerance_mm and leans > 1e-9:
        return _on_parent((strip, side, zone), core, radius_mm)
    return Contact(
        used_mm=found.used_mm,
        side_mm=turned((found.used_mm, side * strip.half_mm), strip.angle_rad),
        core_mm=polar(core.radius_mm, normal),
        zone=DISC,
        normal_rad=normal,
        radius_mm=found.radius_mm,
        turn_rad=found.turn_rad,
        along_mm=0.0,
        position_mm=(normal + core.side_rad) * core.radius_mm,
    )


def _on_parent(child: tuple[Strip, int, int], core: Core, radius_mm: float) -> Contact:
    """Return where the ball rests on one of the parent's straight sides.

    Worked out in a frame that is turned so that this side of the parent runs along x.
    """
    strip, side, zone = child
    back = -zone * core.tilt_rad
    angle = strip.angle_rad - back
    sin, cos = math.sin(angle), math.cos(angle)
    radius = radius_mm
    # In front of the child it closes the angle between child and parent, behind the child the
    # rest of the half turn.
    turn = math.remainder(zone * angle, math.tau)
    turn = turn if side == zone else math.pi - turn
    if radius * turn < LEAST_SEGMENT_MM:
        radius = 0.0
    used = (zone * (core.radius_mm + radius) - side * (strip.half_mm + radius) * cos) / sin
    # Almost parallel to the parent they never part: a named problem, drawn where the child ends.
    used = min(used, 2.0 * strip.length_mm + core.radius_mm)
    x = turned((used, side * (strip.half_mm + radius)), angle)[0]
    around = 2.0 * core.side_rad * core.radius_mm
    return Contact(
        used_mm=used,
        side_mm=turned((used, side * strip.half_mm), strip.angle_rad),
        core_mm=turned((x, zone * core.radius_mm), back),
        zone=zone,
        normal_rad=zone * core.side_rad,
        radius_mm=radius,
        turn_rad=turn,
        along_mm=x,
        position_mm=x if zone == RIGHT else around - x,
    )


def solve_gap(first: Strip, second: Strip, core: Core, fillet_mm: float) -> Gap:
    """Return the walk between two neighbours at a joint.

    Between two fillets the core shows for at least the shortest segment, or not at all. Where it
    would show for less, one ball that rests on both sides presses into it: no radius is bent to
    make it fit, and the gap says how far off that is.
    """

    def rest(strip: Strip, side: int, tolerance_mm: float) -> Contact | None:
        if strip.owner == PARENT:
            return None
        return contact(strip, side, core, fillet_mm, tolerance_mm=tolerance_mm)

    one, two = rest(first, LEFT, -LEAST_SEGMENT_MM), rest(second, RIGHT, -LEAST_SEGMENT_MM)
    # Where the way begins or ends on the parent's side, no arc may follow that is too short: then a
    # ball just past the disc's end counts as resting on the side too. The error is of second order.
    if one is None or one.zone == RIGHT:
        two = rest(second, RIGHT, LEAST_SEGMENT_MM)
    if two is None or two.zone == LEFT:
        one = rest(first, LEFT, LEAST_SEGMENT_MM)
    if one and two and two.position_mm - one.position_mm < LEAST_SEGMENT_MM:
        # Too little of the parent's end would show between the two.
        return inner_bend(first, second, core, fillet_mm)
    way = _along_core(one, two, core)
    start, pieces = way.start_mm, list(way.pieces)
    if one is not None:
        start = one.side_mm
        pieces = [*_fillet(one, one.core_mm, first.owner), *pieces]
    if two is not None:
        pieces += _fillet(two, two.side_mm, second.owner)
    ends = [end for end in (one, two) if end is not None]
    return Gap(
        first=first,
        second=second,
        run=StrokeRun(start, tuple(pieces)),
        first_used_mm=_used_mm(one, two),
        second_used_mm=_used_mm(two, one),
        radius_mm=min(end.radius_mm for end in ends),
        reach_mm=_reach_mm(one, two, core.radius_mm),
        error_mm=max(_lost_mm(fillet_mm - end.radius_mm, end.turn_rad) for end in ends),
    )


def _fillet(end: Contact, to: Point, owner: int) -> list[StrokeSegment]:
    if end.radius_mm * end.turn_rad == 0.0:
        return []
    return [StrokeSegment(to, end.bulge, Part.FILLET, owner)]


def _along_core(one: Contact | None, two: Contact | None, core: Core) -> StrokeRun:
    """Return the walk along the core between two contacts, or from or to the parent's sides."""
    begins = RIGHT if one is None else one.zone
    ends = LEFT if two is None else two.zone
    if begins == RIGHT and ends == RIGHT and two is not None:
        start = two.core_mm if one is None else one.core_mm
        return StrokeRun(start, (StrokeSegment(two.core_mm, 0.0, Part.SIDE, PARENT),))
    if begins == LEFT and one is not None:
        to = one.core_mm if two is None else two.core_mm
        return StrokeRun(one.core_mm, (StrokeSegment(to, 0.0, Part.SIDE, PARENT),))
    corner = core.corner_mm(RIGHT)
    start = corner if one is None else one.core_mm
    on_disc = one.core_mm if one is not None and begins == DISC else corner
    from_rad = one.normal_rad if one is not None and begins == DISC else -core.side_rad
    to_rad = two.normal_rad if two is not None and ends == DISC else core.side_rad
    pieces = [StrokeSegment(corner, 0.0, Part.SIDE, PARENT)] if begins == RIGHT else []
    pieces += arc((0.0, 0.0), on_disc, to_rad - from_rad, Part.JOINT, PARENT)
    if two is not None and ends == LEFT:
        pieces += [StrokeSegment(two.core_mm, 0.0, Part.SIDE, PARENT)]
    return StrokeRun(start, tuple(pieces))


def _used_mm(own: Contact | None, other: Contact | None) -> float:
    """Return the length of a neighbour's straight side that the gap takes; None is the parent."""
    if own is not None:
        return own.used_mm
    if other is None or other.zone == DISC:
        return 0.0
    return max(0.0, -other.along_mm)


def _reach_mm(one: Contact | None, two: Contact | None, core_mm: float) -> float:
    """Return the least distance of the outline from the joint in a gap that shows the core."""
    begins = RIGHT if one is None else one.zone
    ends = LEFT if two is None else two.zone
    if begins != ends or begins == DISC:
        return core_mm
    # Only one of the parent's sides shows: its nearest point is an end of the way, or, next to the
    # parent, the crotch's own nearest point.
    nearest = two if begins == RIGHT else one
    if nearest is None:
        return core_mm
    if one is not None and two is not None:
        return math.hypot(*nearest.core_mm)
    center = math.hypot(nearest.along_mm, core_mm + nearest.radius_mm)
    return max(core_mm, center - nearest.radius_mm)


def _lost_mm(radius_mm: float, turn_rad: float) -> float:
    """Return the depth of a corner that stands for a fillet of some radius and turn."""
    return radius_mm * (1.0 / max(math.cos(turn_rad / 2), 1e-3) - 1.0)


def inner_bend(first: Strip, second: Strip, core: Core, fillet_mm: float) -> Gap:
    """Return the walk from one side straight to the other, around a ball that rests on both."""
    gap = second.angle_rad - first.angle_rad
    sin, cos, turn = math.sin(gap), math.cos(gap), math.pi - gap
    radius = fillet_mm if fillet_mm * turn >= LEAST_SEGMENT_MM else 0.0
    a, b = first.half_mm + radius, second.half_mm + radius
    # Neighbours that (almost) coincide never part: a named problem, drawn where they end.
    longest = 2.0 * max(first.length_mm, second.length_mm)
    one = two = longest
    if sin >= 1e-9:
        one, two = min((b + a * cos) / sin, longest), min((a + b * cos) / sin, longest)
    start = turned((one, first.half_mm), first.angle_rad)
    end = turned((two, -second.half_mm), second.angle_rad)
    pieces: tuple[StrokeSegment, ...] = ()
    if radius > 0.0:
        pieces = (StrokeSegment(end, -math.tan(turn / 4), Part.FILLET, first.owner),)
    center = turned((one, a), first.angle_rad)
    away = math.hypot(*center)
    near = 1.0 - radius / away
    depth = core.depth_mm((center[0] * near, center[1] * near))
    return Gap(
        first=first,
        second=second,
        run=StrokeRun(start, pieces),
        first_used_mm=one,
        second_used_mm=two,
        radius_mm=radius,
        reach_mm=away - radius,
        error_mm=max(depth, _lost_mm(fillet_mm - radius, turn), 0.0),
    )


DEEPEST_CORNER_MM = 1.5
"""A corner in place of a small fillet lies at most this much deeper in its crotch (assumed).

A cut that goes 2 mm outside a seam then still keeps off it.
"""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlannedSide:
    """A branch as the joint at one of its ends sees it."""

    half_mm: float  # half its lay-flat width there
    length_mm: float  # planned
    lean_rad: float  # angle by which its sides lean towards its axis, seen from its base
    angle_rad: float = 0.0  # to the parent's heading, of a child
    fillet_mm: float = 0.0  # designed radius of its fillets, of a child


@dataclass(frozen=True, slots=True, kw_only=True)
class JointPlan:
    """Everything that a joint is drawn from."""

    parent: PlannedSide
    children: tuple[PlannedSide, ...]  # clockwise-most first
    is_bend: bool = False  # whether its only child is the same tube behind a preformed bend

    def turned(self, angles_deg: Sequence[float]) -> "JointPlan":
        """Return the plan with other angles of its children."""
        pairs = zip(self.children, angles_deg, strict=True)
        children = (replace(one, angle_rad=math.radians(angle)) for one, angle in pairs)
        return replace(self, children=tuple(children))


@dataclass(frozen=True, slots=True, kw_only=True)
class Joint:
    """The outline at a joint."""

    disc_mm: float  # radius of the joint's disc on the lumen
    # From the parent's right side to the first child, between children, and from the last child to
    # the parent's left side.
    gaps: tuple[Gap, ...]
    fillets_mm: tuple[float, ...]  # designed fillet radius of each gap
    # Largest fillet radius that the angle allows in each gap; negative if the neighbours part too
    # far from the joint for any.
    allowed_mm: tuple[float, ...]


@lru_cache(maxsize=4096)
def joint_of(plan: JointPlan, offset_mm: float, *, least_fillet_mm: float = 0.0) -> Joint:
    """Return the joint of a plan, or the elbow of a bend.

    Fillet radii are capped on the lumen itself, so that every offset has the same fillet centres.
    Fillets that the offset leaves smaller than ``least_fillet_mm`` are corners.
    """
    tilt = plan.parent.lean_rad
    parent = Strip(
        angle_rad=-math.pi,
        half_mm=plan.parent.half_mm,
        length_mm=plan.parent.length_mm,
        owner=PARENT,
    )
    around = [
        parent,
        *(
            Strip(angle_rad=one.angle_rad, half_mm=one.half_mm, length_mm=one.length_mm, owner=n)
            for n, one in enumerate(plan.children, start=1)
        ),
        replace(parent, angle_rad=math.pi),
    ]
    # Away from the joint sides lean towards their axis, but those of a parent that narrows here.
    leans = (-tilt, *(one.lean_rad for one in plan.children), -tilt)
    designed = [one.fillet_mm for one in plan.children]
    # Between two children the smaller one; next to the parent the child's own.
    fillets = (designed[0], *(min(pair) for pair in pairwise(designed)), designed[-1])
    # The joint's disc is the parent's. A wider child is a separate problem; the larger disc at
    # least draws it as it would be.
    disc = max(strip.half_mm for strip in around)
    core, gaps, allowed = Core(radius_mm=disc + offset_mm, tilt_rad=tilt), [], []
    neighbours = pairwise(zip(around, leans, strict=True))
    bend_mm = 0.0
    for ((one, lean), (two, other_lean)), fillet in zip(neighbours, fillets, strict=True):
        first = replace(one, angle_rad=one.angle_rad - LEFT * lean)
        second = replace(two, angle_rad=two.angle_rad - RIGHT * other_lean)
        angle, halves = second.angle_rad - first.angle_rad, (first.half_mm, second.half_mm)
        most = largest_fillet_mm(angle, halves, allowed_reach_mm(first, second, disc))
        radius = max(0.0, min(fillet, most))
        if plan.is_bend and angle < math.pi:
            bend_mm = radius
        # Beyond its own radius an outward offset turns a fillet into a corner: exactly what
        # rolling a ball around the body gives.
        drawn = max(0.0, radius - offset_mm)
        if drawn < least_fillet_mm and drawn / math.sin(angle / 2) - drawn < DEEPEST_CORNER_MM:
            drawn = 0.0
        first, second = (
            replace(side, half_mm=side.half_mm + offset_mm) for side in (first, second)
        )
        is_inside = plan.is_bend and angle < math.pi
        gaps.append((inner_bend if is_inside else solve_gap)(first, second, core, drawn))
        allowed.append(most)
    if plan.is_bend:
        gaps = outer_bends(gaps, bend_mm + 2.0 * disc + offset_mm)
    return Joint(
        disc_mm=disc,
        gaps=tuple(gaps),
        fillets_mm=fillets,
        allowed_mm=tuple(allowed),
    )


def outer_bends(gaps: Sequence[Gap], radius_mm: float) -> list[Gap]:
    """Return the gaps of an elbow with an outer edge of some radius."""
    return [gap if gap.angle_rad < math.pi else _outer_bend(gap, radius_mm) for gap in gaps]


def _outer_bend(gap: Gap, radius_mm: float) -> Gap:
    """Return the outer edge of an elbow: an arc that touches both sides from inside."""
    first, second = gap.first, gap.second
    sin, cos, turn = math.sin(gap.angle_rad), math.cos(gap.angle_rad), gap.angle_rad - math.pi
    if turn * radius_mm < LEAST_SEGMENT_MM:
        return gap
    # The centre lies on the inner side, so far from both axes.
    a, b = first.half_mm - radius_mm, second.half_mm - radius_mm
    one, two = (b + a * cos) / sin, (a + b * cos) / sin
    start = turned((one, first.half_mm), first.angle_rad)
    center = turned((one, a), first.angle_rad)
    return replace(
        gap,
        run=StrokeRun(start, tuple(arc(center, start, turn, Part.JOINT, PARENT))),
        first_used_mm=one,
        second_used_mm=two,
        reach_mm=radius_mm - math.hypot(*center),
        error_mm=0.0,
    )


def allowed_reach_mm(first: Strip, second: Strip, disc_mm: float) -> float:
    """Return the distance from the joint by which two neighbours must part: half the shorter.

    Within the joint's disc there is nothing to web.
    """
    return max(0.5 * min(first.length_mm, second.length_mm), disc_mm)
