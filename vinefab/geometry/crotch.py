"""Between two neighbours at a joint: from one's side, past the joint's disc, to the other's.

A gap is worked out in the frame of its first strip: the joint is the origin, the first strip lies
along +x and the second at the gap's angle, counter-clockwise. The walk comes in along the first
strip's left side and leaves along the second strip's right side.

A fillet of radius r is a ball that rolls in the gap until it rests on two things. Rolled along a
strip of half width h it meets the disc of radius R when its centre stands at the angle
asin((h + r) / (R + r)) from the strip's axis. If those angles of both strips together fill the
gap, the ball rests on both strips first and the disc is out of its reach.
"""

import math
from dataclasses import dataclass

from vinefab.geometry.stroke import LEAST_SEGMENT_MM, Piece, Point, Run, arc, polar, turned
from vinefab.model.outline import Part

_JOINT = 0
"""Owner number of the joint's disc: the parent."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Strip:
    """One branch as its joint sees it.

    Parameters
    ----------
    angle_rad
        Direction away from the joint, relative to the parent's heading.
    half_mm
        Half its width.
    length_mm
        Its planned length.
    owner
        0 for the parent, 1, 2, ... for the children.
    """

    angle_rad: float
    half_mm: float
    length_mm: float
    owner: int


@dataclass(frozen=True, slots=True, kw_only=True)
class Gap:
    """What the walk does between two neighbours.

    Parameters
    ----------
    first, second
        The neighbours.
    run
        Pieces in the frame of the first.
    first_used_mm, second_used_mm
        How far from the joint each one's straight side begins.
    radius_mm
        Fillet radius drawn.
    reach_mm
        Distance from the joint to the nearest point of the outline in the gap.
    error_mm
        How far the pieces are from the exact shape: not 0 only where an arc too short to draw
        became a corner.
    """

    first: Strip
    second: Strip
    run: Run
    first_used_mm: float
    second_used_mm: float
    radius_mm: float
    reach_mm: float
    error_mm: float = 0.0

    @property
    def angle_rad(self) -> float:
        """Angle from the first strip to the second, 0 to 2 pi."""
        return self.second.angle_rad - self.first.angle_rad


def crotch_reach_mm(angle_rad: float, first_half_mm: float, second_half_mm: float) -> float:
    """Return how far from the joint two sides cross; infinite if they never do.

    Parameters
    ----------
    angle_rad
        Angle between the strips, 0 to pi.
    first_half_mm, second_half_mm
        Their half widths.
    """
    sin, cos = math.sin(angle_rad), math.cos(angle_rad)
    if sin < 1e-9:
        return math.inf
    a, b = first_half_mm, second_half_mm
    return math.sqrt(a * a + b * b + 2.0 * a * b * cos) / sin


def largest_fillet_mm(angle_rad: float, halves_mm: Point, reach_mm: float) -> float:
    """Return the radius whose fillet comes to ``reach_mm`` from the joint, negative if none does.

    For strips of one width w this is (reach sin(a/2) - w/2) / (1 - sin(a/2)).

    Parameters
    ----------
    angle_rad
        Angle between the strips.
    halves_mm
        Their half widths.
    reach_mm
        Distance from the joint to the nearest point of the fillet.
    """
    sin, cos = math.sin(angle_rad), math.cos(angle_rad)
    if angle_rad >= math.pi - 1e-6:
        return math.inf
    if sin < 1e-9 or crotch_reach_mm(angle_rad, *halves_mm) > reach_mm:
        return -1.0
    a, b = halves_mm
    square = (1.0 + cos) / (1.0 - cos)
    half_linear = (a + b) / (1.0 - cos) - reach_mm
    constant = (a * a + b * b + 2.0 * a * b * cos) / (sin * sin) - reach_mm * reach_mm
    return (-half_linear + math.sqrt(half_linear**2 - square * constant)) / square


@dataclass(frozen=True, slots=True)
class Neck:
    """Where a straight side meets a disc that bulges out of it.

    Parameters
    ----------
    used_mm
        Distance along the side from the disc's centre to where the side ends.
    angle_rad
        Angle, from the strip's axis, at which the disc begins.
    radius_mm
        Fillet radius, 0 for a bare corner or where side and disc are tangent.
    """

    used_mm: float
    angle_rad: float
    radius_mm: float

    @property
    def turn_rad(self) -> float:
        """Angle through which the fillet turns, not negative."""
        return math.pi / 2 - self.angle_rad


def neck(half_mm: float, disc_mm: float, radius_mm: float) -> Neck:
    """Return how a side at ``half_mm`` from the axis meets a disc, with a fillet.

    A fillet shorter than the shortest segment becomes a corner.
    """
    # The product keeps its zero exact when side and disc are tangent; a difference of squares
    # would leave 1e-7 mm of fillet behind.
    used = math.sqrt(max(0.0, (disc_mm - half_mm) * (disc_mm + half_mm + 2.0 * radius_mm)))
    found = Neck(used, math.atan2(half_mm + radius_mm, used), radius_mm)
    if radius_mm > 0.0 and radius_mm * found.turn_rad < LEAST_SEGMENT_MM:
        return neck(half_mm, disc_mm, 0.0)
    return found


def solve_gap(first: Strip, second: Strip, disc_mm: float, radius_mm: float) -> Gap:
    """Return the walk between two neighbours at a joint.

    Parameters
    ----------
    first, second
        The neighbours, counter-clockwise.
    disc_mm
        Radius of the joint's disc, at least the half width of both.
    radius_mm
        Fillet radius.
    """
    gap = second.angle_rad - first.angle_rad
    free = gap - sum(_ball_angle(s.half_mm, disc_mm, radius_mm) for s in (first, second))
    if free * disc_mm < LEAST_SEGMENT_MM:
        return _without_disc(first, second, disc_mm, radius_mm)
    return _past_disc(first, second, disc_mm, radius_mm)


def _ball_angle(half_mm: float, disc_mm: float, radius_mm: float) -> float:
    return neck(half_mm, disc_mm, radius_mm).angle_rad


def _fillet_owner(first: Strip, second: Strip) -> int:
    """Return the child that a fillet belongs to: the first one that is not the parent."""
    return first.owner or second.owner


def _past_disc(first: Strip, second: Strip, disc_mm: float, radius_mm: float) -> Gap:
    gap = second.angle_rad - first.angle_rad
    one = neck(first.half_mm, disc_mm, radius_mm)
    two = neck(second.half_mm, disc_mm, radius_mm)
    start, leave = (one.used_mm, first.half_mm), polar(disc_mm, one.angle_rad)
    end = turned((two.used_mm, -second.half_mm), gap)
    pieces: list[Piece] = []
    owner = _fillet_owner(first, second)
    if one.radius_mm * one.turn_rad > 0.0:
        pieces += [Piece(leave, -math.tan(one.turn_rad / 4), Part.FILLET, first.owner or owner)]
    turn = gap - one.angle_rad - two.angle_rad
    pieces += arc((0.0, 0.0), leave, turn, Part.JOINT, _JOINT)
    if two.radius_mm * two.turn_rad > 0.0:
        pieces += [Piece(end, -math.tan(two.turn_rad / 4), Part.FILLET, second.owner or owner)]
    return Gap(
        first=first,
        second=second,
        run=Run(start, tuple(pieces)),
        first_used_mm=one.used_mm,
        second_used_mm=two.used_mm,
        radius_mm=max(one.radius_mm, two.radius_mm),
        reach_mm=disc_mm,
    )


def _without_disc(first: Strip, second: Strip, disc_mm: float, radius_mm: float) -> Gap:
    gap = second.angle_rad - first.angle_rad
    turn = math.pi - gap
    radius = radius_mm if radius_mm * turn >= LEAST_SEGMENT_MM else 0.0
    one, two = _tangent_points(first, second, radius)
    start, end = (one, first.half_mm), turned((two, -second.half_mm), gap)
    pieces: tuple[Piece, ...] = ()
    if radius > 0.0:
        pieces = (Piece(end, -math.tan(turn / 4), Part.FILLET, _fillet_owner(first, second)),)
    reach = math.hypot(one, first.half_mm + radius) - radius
    dropped = (radius_mm - radius) * (1.0 / max(math.cos(turn / 2), 1e-3) - 1.0)
    return Gap(
        first=first,
        second=second,
        run=Run(start, pieces),
        first_used_mm=one,
        second_used_mm=two,
        radius_mm=radius,
        reach_mm=reach,
        error_mm=max(disc_mm - reach, dropped, 0.0),
    )


def _tangent_points(first: Strip, second: Strip, radius_mm: float) -> Point:
    """Return how far along each side a ball between them rests; never beyond the sheet."""
    gap = second.angle_rad - first.angle_rad
    sin, cos = math.sin(gap), math.cos(gap)
    one, two = first.half_mm + radius_mm, second.half_mm + radius_mm
    if abs(sin) < 1e-9 and cos < 0.0:
        return 0.0, 0.0
    # Neighbours that (almost) coincide never part: a named problem, drawn where they end.
    longest = 2.0 * max(first.length_mm, second.length_mm)
    if sin < 1e-9:
        return longest, longest
    return min((two + one * cos) / sin, longest), min((one + two * cos) / sin, longest)
