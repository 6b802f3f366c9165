"""The core of a joint, and where a ball that rolls down a child's side rests on it.

All of it happens in the joint's frame: the joint is the origin and the parent's heading is +x. The
core is the parent with a rounded end: a disc of its half width R and, behind the disc, its two
sides. The walk round the core comes along the parent's right side, around the disc and back along
its left side. The sides of an even parent are y = -R and y = R; those of a tapered one touch the
disc a little further ahead and lean by the tilt. Children stick out of the core; one that bends
backwards sticks out of the parent's side, and behind it that side shows again.
"""

import math
from dataclasses import dataclass

from vinefab.geometry.crotch import LEFT, RIGHT, Strip
from vinefab.geometry.neck import neck
from vinefab.geometry.stroke import LEAST_SEGMENT_MM, Point, polar, turned

DISC = 0
"""The core's rounded end."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Core:
    """A parent with a rounded end.

    Parameters
    ----------
    radius_mm
        Radius of its end.
    tilt_rad
        Angle by which its sides lean towards its axis, along its heading.
    """

    radius_mm: float
    tilt_rad: float = 0.0

    @property
    def side_rad(self) -> float:
        """Direction out of the left side; the right side's is its negative."""
        return math.pi / 2 - self.tilt_rad

    def corner_mm(self, zone: int) -> Point:
        """Return where a side touches the disc."""
        return polar(self.radius_mm, zone * self.side_rad)

    def depth_mm(self, point: Point) -> float:
        """Return how far inside a point lies, negative outside."""
        x, y = turned((point[0], abs(point[1])), self.tilt_rad)
        return self.radius_mm - (math.hypot(x, y) if x > 0.0 else y)


@dataclass(frozen=True, slots=True, kw_only=True)
class Contact:
    """Where a ball that rolls down one side of a child rests on the core.

    Parameters
    ----------
    side
        `LEFT` or `RIGHT` side of the child.
    used_mm
        How far from the joint, along the child, the child's straight side ends.
    side_mm
        The end of the child's straight side.
    core_mm
        The point of the core that the ball touches.
    zone
        What of the core that is: `LEFT` or `RIGHT` side of the parent, or `DISC`.
    normal_rad
        Direction out of the core at that point.
    radius_mm
        The ball's radius, 0 for a bare corner.
    turn_rad
        Angle that the walk turns clockwise around the ball, not negative.
    along_mm
        How far ahead of where the parent's side touches the disc the point is, along that side;
        0 on the disc.
    position_mm
        How far around the core the point is: 0 where its right side touches the disc, rising
        counter-clockwise.
    """

    side: int
    used_mm: float
    side_mm: Point
    core_mm: Point
    zone: int
    normal_rad: float
    radius_mm: float
    turn_rad: float
    along_mm: float
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
    strip, side
        The child, and which of its sides.
    core
        The parent.
    radius_mm
        The ball's radius.
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
        side=side,
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
        side=side,
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
