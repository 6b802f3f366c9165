"""The gap between two neighbours at a joint: what it is, and how large a fillet it allows."""

import math
from dataclasses import dataclass

from vinefab.fabrication.outline.stroke import Point, StrokeRun

LEFT, RIGHT = 1, -1
"""Sides of a strip, seen along its direction away from the joint; and of the core."""


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
    owner: int  # 0 for the parent, 1, 2, ... for the children.


@dataclass(frozen=True, slots=True, kw_only=True)
class JointBranch:
    """One branch as its joint sees it."""

    angle_rad: float  # direction of its axis away from the joint, relative to the parent's heading
    half_mm: float  # half its width at the joint
    length_mm: float  # its planned length
    owner: int  # 0 for the parent, 1, 2, ... for the children.
    # angle by which its sides lean towards its axis, away from the joint; negative for a parent
    # that is narrower here than at its base
    narrowing_rad: float = 0.0

    def side(self, side: int) -> Strip:
        """Return its left or right side."""
        return Strip(
            angle_rad=self.angle_rad - side * self.narrowing_rad,
            half_mm=self.half_mm,
            length_mm=self.length_mm,
            owner=self.owner,
        )


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
    """What the walk does between two neighbours."""

    # first, second: the neighbours
    first: Strip
    second: Strip
    run: StrokeRun  # pieces in the joint's frame
    # first_used_mm, second_used_mm: how far from the joint each one's straight side begins
    first_used_mm: float
    second_used_mm: float
    radius_mm: float  # fillet radius drawn
    reach_mm: float  # distance from the joint to the nearest point of the outline in the gap
    # how far the pieces are from the exact shape: not 0 only where an arc too short to draw became
    # a corner
    error_mm: float = 0.0

    @property
    def angle_rad(self) -> float:
        """Angle from the first strip to the second, 0 to 2 pi."""
        return self.second.angle_rad - self.first.angle_rad


def crotch_reach_mm(angle_rad: float, first_half_mm: float, second_half_mm: float) -> float:
    """Return how far from the joint the lines of two sides cross; infinite if they never do."""
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
