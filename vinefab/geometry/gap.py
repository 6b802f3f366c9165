"""The walk between two neighbours at a joint: from one's side, past the core, to the other's.

A fillet of radius r is a ball that rolls in the gap between two children, down the left side of
the first and down the right side of the second, until it rests on the core. Where the first would
rest behind the second, a ball between the two never reaches the core: it rests on both of them.
"""

import math
from dataclasses import dataclass

from vinefab.geometry.core import DISC, Contact, Core, contact
from vinefab.geometry.crotch import LEFT, RIGHT, Gap, Strip
from vinefab.geometry.stroke import LEAST_SEGMENT_MM, Piece, Point, Run, arc, turned
from vinefab.model.outline import Part

PARENT = 0
"""Owner number of the parent."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Given:
    """The core, and the fillet radius asked for."""

    core: Core
    fillet_mm: float


def solve_gap(first: Strip, second: Strip, core: Core, fillet_mm: float) -> Gap:
    """Return the walk between two neighbours at a joint.

    Between two fillets the core shows for at least the shortest segment, or not at all. Where it
    would show for less, one ball that rests on both sides presses into it: no radius is bent to
    make it fit, and the gap says how far off that is.

    Parameters
    ----------
    first, second
        Left side of one neighbour, right side of the next one counter-clockwise; the parent comes
        first or last.
    core
        The parent with the joint's disc, which is at least as wide as any child.
    fillet_mm
        Fillet radius.
    """
    given = _Given(core=core, fillet_mm=fillet_mm)
    one, two = _contacts(first, second, given)
    hidden = one is not None and two is not None and _shown_mm(one, two) < LEAST_SEGMENT_MM
    if hidden:
        return _between_children(first, second, given)
    return _past_core((first, second), (one, two), given)


def _contacts(first: Strip, second: Strip, given: _Given) -> tuple[Contact | None, Contact | None]:
    """Return where the ball rests on the core at both ends of the gap; None for the parent.

    Where the way begins or ends on the parent's side, no arc may follow that is too short: then a
    ball just past the disc's end counts as resting on the side too. The error is of second order.
    """

    def rest(strip: Strip, side: int, tolerance_mm: float) -> Contact | None:
        if strip.owner == PARENT:
            return None
        return contact(strip, side, given.core, given.fillet_mm, tolerance_mm=tolerance_mm)

    one, two = (
        rest(strip, side, -LEAST_SEGMENT_MM) for strip, side in ((first, LEFT), (second, RIGHT))
    )
    if one is None or one.zone == RIGHT:
        two = rest(second, RIGHT, LEAST_SEGMENT_MM)
    if two is None or two.zone == LEFT:
        one = rest(first, LEFT, LEAST_SEGMENT_MM)
    return one, two


def _shown_mm(one: Contact, two: Contact) -> float:
    """Return how much of the core shows between two contacts, negative if they are crossed."""
    return two.position_mm - one.position_mm


def _past_core(
    strips: tuple[Strip, Strip], contacts: tuple[Contact | None, Contact | None], given: _Given
) -> Gap:
    """Return the walk along one side, along the core and along the other side."""
    one, two = contacts
    core = _along_core(one, two, given.core)
    start, pieces = core.start_mm, list(core.pieces)
    if one is not None:
        start = one.side_mm
        pieces = [*_fillet(one, one.core_mm, strips[0].owner), *pieces]
    if two is not None:
        pieces += _fillet(two, two.side_mm, strips[1].owner)
    ends = [end for end in contacts if end is not None]
    return Gap(
        first=strips[0],
        second=strips[1],
        run=Run(start, tuple(pieces)),
        first_used_mm=_used_mm(one, two),
        second_used_mm=_used_mm(two, one),
        radius_mm=min(end.radius_mm for end in ends),
        reach_mm=_reach_mm(one, two, given.core.radius_mm),
        error_mm=max(_lost_mm(given.fillet_mm - end.radius_mm, end.turn_rad) for end in ends),
    )


def _fillet(end: Contact, to: Point, owner: int) -> list[Piece]:
    if end.radius_mm * end.turn_rad == 0.0:
        return []
    return [Piece(to, end.bulge, Part.FILLET, owner)]


def _along_core(one: Contact | None, two: Contact | None, core: Core) -> Run:
    """Return the walk along the core between two contacts, or from or to the parent's sides."""
    begins = RIGHT if one is None else one.zone
    ends = LEFT if two is None else two.zone
    if begins == RIGHT and ends == RIGHT and two is not None:
        start = two.core_mm if one is None else one.core_mm
        return Run(start, (Piece(two.core_mm, 0.0, Part.SIDE, PARENT),))
    if begins == LEFT and one is not None:
        to = one.core_mm if two is None else two.core_mm
        return Run(one.core_mm, (Piece(to, 0.0, Part.SIDE, PARENT),))
    corner = core.corner_mm(RIGHT)
    start = corner if one is None else one.core_mm
    on_disc = one.core_mm if one is not None and begins == DISC else corner
    from_rad = one.normal_rad if one is not None and begins == DISC else -core.side_rad
    to_rad = two.normal_rad if two is not None and ends == DISC else core.side_rad
    pieces = [Piece(corner, 0.0, Part.SIDE, PARENT)] if begins == RIGHT else []
    pieces += arc((0.0, 0.0), on_disc, to_rad - from_rad, Part.JOINT, PARENT)
    if two is not None and ends == LEFT:
        pieces += [Piece(two.core_mm, 0.0, Part.SIDE, PARENT)]
    return Run(start, tuple(pieces))


def _used_mm(own: Contact | None, other: Contact | None) -> float:
    """Return how much of one neighbour's straight side the gap takes; None is the parent."""
    if own is not None:
        return own.used_mm
    if other is None or other.zone == DISC:
        return 0.0
    return max(0.0, -other.along_mm)


def _reach_mm(one: Contact | None, two: Contact | None, core_mm: float) -> float:
    """Return how near to the joint the outline comes in a gap that shows the core."""
    begins = RIGHT if one is None else one.zone
    ends = LEFT if two is None else two.zone
    if begins != ends or begins == DISC:
        return core_mm
    # Only one of the parent's sides shows: its nearest point is an end of the way, or, beside the
    # parent, the crotch's own nearest point.
    nearest = two if begins == RIGHT else one
    if nearest is None:
        return core_mm
    if one is not None and two is not None:
        return math.hypot(*nearest.core_mm)
    center = math.hypot(nearest.along_mm, core_mm + nearest.radius_mm)
    return max(core_mm, center - nearest.radius_mm)


def _lost_mm(radius_mm: float, turn_rad: float) -> float:
    """Return how deep a corner is that stands for a fillet of some radius and turn."""
    return radius_mm * (1.0 / max(math.cos(turn_rad / 2), 1e-3) - 1.0)


def _between_children(first: Strip, second: Strip, given: _Given) -> Gap:
    """Return the walk from one side straight to the other, around a ball that rests on both."""
    gap = second.angle_rad - first.angle_rad
    turn = math.pi - gap
    radius = given.fillet_mm if given.fillet_mm * turn >= LEAST_SEGMENT_MM else 0.0
    one, two = _rests_mm(first, second, radius)
    start = turned((one, first.half_mm), first.angle_rad)
    end = turned((two, -second.half_mm), second.angle_rad)
    pieces: tuple[Piece, ...] = ()
    if radius > 0.0:
        pieces = (Piece(end, -math.tan(turn / 4), Part.FILLET, first.owner),)
    center = turned((one, first.half_mm + radius), first.angle_rad)
    away = math.hypot(*center)
    near = 1.0 - radius / away
    depth = given.core.depth_mm((center[0] * near, center[1] * near))
    return Gap(
        first=first,
        second=second,
        run=Run(start, pieces),
        first_used_mm=one,
        second_used_mm=two,
        radius_mm=radius,
        reach_mm=away - radius,
        error_mm=max(depth, _lost_mm(given.fillet_mm - radius, turn), 0.0),
    )


def _rests_mm(first: Strip, second: Strip, radius_mm: float) -> Point:
    """Return how far along each side a ball between them rests; never far beyond their ends."""
    gap = second.angle_rad - first.angle_rad
    sin, cos = math.sin(gap), math.cos(gap)
    one, two = first.half_mm + radius_mm, second.half_mm + radius_mm
    # Neighbours that (almost) coincide never part: a named problem, drawn where they end.
    longest = 2.0 * max(first.length_mm, second.length_mm)
    if sin < 1e-9:
        return longest, longest
    return min((two + one * cos) / sin, longest), min((one + two * cos) / sin, longest)
