"""The core of a joint, and where a ball that rolls down a child's side rests on it.

All of it happens in the joint's frame: the joint is the origin and the parent's heading is +x. The
core is the parent with a rounded end: a disc of its half width R and, behind the disc, its two
sides. The walk round the core comes along the parent's right side (y = -R), around the disc and
back along its left side (y = R). Children stick out of the core; one that bends backwards sticks
out of the parent's side, and behind it that side shows again.
"""

import math
from dataclasses import dataclass

from vinefab.geometry.crotch import Strip
from vinefab.geometry.neck import neck
from vinefab.geometry.stroke import LEAST_SEGMENT_MM, Point, polar, turned

LEFT, RIGHT = 1, -1
"""Sides of a strip, seen along its direction away from the joint; and of the core."""

DISC = 0
"""The core's rounded end."""


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
    position_mm
        How far around the core the point is: 0 at (0, -R), rising counter-clockwise.
    """

    side: int
    used_mm: float
    side_mm: Point
    core_mm: Point
    zone: int
    normal_rad: float
    radius_mm: float
    turn_rad: float
    position_mm: float

    @property
    def bulge(self) -> float:
        """Bulge of the fillet around the ball."""
        return -math.tan(self.turn_rad / 4.0)


def contact(
    strip: Strip, side: int, radii_mm: tuple[float, float], *, tolerance_mm: float
) -> Contact:
    """Return where a ball that rolls down a child's side rests on the core.

    Parameters
    ----------
    strip, side
        The child, and which of its sides.
    radii_mm
        Of the core's disc and of the ball.
    tolerance_mm
        Where the disc ends, at x = 0, and the parent's side begins, a ball that would touch the
        disc at a smaller x than this counts as touching the side.
    """
    core, radius = radii_mm
    found = neck(strip.half_mm, core, radius)
    normal = math.remainder(strip.angle_rad + side * found.angle_rad, math.tau)
    touched = polar(core, normal)
    if touched[0] < tolerance_mm and abs(math.sin(strip.angle_rad)) > 1e-9:
        return _on_parent(strip, side, radii_mm)
    return Contact(
        side=side,
        used_mm=found.used_mm,
        side_mm=turned((found.used_mm, side * strip.half_mm), strip.angle_rad),
        core_mm=touched,
        zone=DISC,
        normal_rad=normal,
        radius_mm=found.radius_mm,
        turn_rad=found.turn_rad,
        position_mm=(normal + math.pi / 2) * core,
    )


def _on_parent(strip: Strip, side: int, radii_mm: tuple[float, float]) -> Contact:
    """Return where the ball rests on one of the parent's straight sides."""
    core, radius = radii_mm
    sin, cos = math.sin(strip.angle_rad), math.cos(strip.angle_rad)
    zone = LEFT if sin > 0.0 else RIGHT
    # In front of the child it closes the angle between child and parent, behind the child the
    # rest of the half turn.
    turn = abs(strip.angle_rad) if side == zone else math.pi - abs(strip.angle_rad)
    if radius * turn < LEAST_SEGMENT_MM:
        radius = 0.0
    used = (zone * (core + radius) - side * (strip.half_mm + radius) * cos) / sin
    # Almost parallel to the parent they never part: a named problem, drawn where the child ends.
    used = min(used, 2.0 * strip.length_mm + core)
    x = turned((used, side * (strip.half_mm + radius)), strip.angle_rad)[0]
    return Contact(
        side=side,
        used_mm=used,
        side_mm=turned((used, side * strip.half_mm), strip.angle_rad),
        core_mm=(x, zone * core),
        zone=zone,
        normal_rad=zone * math.pi / 2,
        radius_mm=radius,
        turn_rad=turn,
        position_mm=x if zone == RIGHT else math.pi * core - x,
    )
