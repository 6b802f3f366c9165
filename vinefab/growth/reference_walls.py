"""What the plain Python twin knows of walls: the rules that decide, and what a ray meets.

The rules have the names that they have in `vinefab.growth.kernel`. Points and directions are
complex numbers, x + iy.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

from vinefab.growth.arrays import Rules, WallArrays


def dot(a: complex, b: complex) -> float:
    """Return the scalar product of two vectors."""
    return a.real * b.real + a.imag * b.imag


def cross(a: complex, b: complex) -> float:
    """Return the z component of the vector product: positive if b points to the left of a."""
    return a.real * b.imag - a.imag * b.real


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Wall:
    """One straight wall with free space on its left.

    Parameters
    ----------
    start, end, tangent, length
        Its geometry; the tangent is a unit vector from start to end.
    ends
        Numbers of the places at its start and end.
    """

    start: complex
    end: complex
    tangent: complex
    length: float
    ends: tuple[int, int]

    @property
    def normal(self) -> complex:
        """Unit vector into free space."""
        return complex(-self.tangent.imag, self.tangent.real)

    def at(self, place: float) -> complex:
        """Return the point so far along the wall."""
        return self.start + place * self.tangent


class Vertex(NamedTuple):
    """A vertex that a body can wrap around: where, its place's number, a unit vector into solid."""

    point: complex
    place: int
    solid: complex


class Meeting(NamedTuple):
    """A wall that a ray meets: which one, how far away, how far along the wall."""

    wall: int
    distance: float
    place: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class World:
    """Walls and vertices as objects, with the tolerances.

    Parameters
    ----------
    walls, vertices
        All of them.
    neighbours
        The walls before and after each wall, in the same wedge of free space.
    rules
        Half angle and tolerances.
    """

    walls: list[Wall]
    vertices: list[Vertex]
    neighbours: list[tuple[int, int]]
    rules: Rules


def world_of(arrays: WallArrays, rules: Rules) -> World:
    """Return the arrays as objects."""
    walls = [
        Wall(
            start=complex(ax, ay),
            end=complex(bx, by),
            tangent=complex(tx, ty),
            length=length,
            ends=(start, end),
        )
        for (ax, ay, tx, ty, length, bx, by), (_, _, start, end, _) in zip(
            arrays.wall.tolist(), arrays.link.tolist(), strict=True
        )
    ]
    vertices = [
        Vertex(complex(x, y), place, complex(mx, my))
        for (x, y, mx, my), place in zip(
            arrays.vertex.tolist(), arrays.vertex_point.tolist(), strict=True
        )
    ]
    neighbours = [(before, after) for before, after, *_ in arrays.link.tolist()]
    return World(walls=walls, vertices=vertices, neighbours=neighbours, rules=rules)


# --- The rules that decide the answer ---------------------------------------------------------


def presses(world: World, u: complex, wall: int) -> bool:
    """Tell whether a body that points along u presses on a wall: u.n < 0."""
    return dot(u, world.walls[wall].normal) < -world.rules.tolerance_rad


def is_head_on(world: World, u: complex, wall: int) -> bool:
    """Tell whether a tip that meets a wall stops: the angle between u and -n is small."""
    along, against = abs(dot(u, world.walls[wall].tangent)), -dot(u, world.walls[wall].normal)
    rules = world.rules
    return math.atan2(along, against) <= rules.head_on_half_angle_rad + rules.tolerance_rad


def slide_sense(world: World, u: complex, wall: int) -> int:
    """Return +1 if the tip slides along the wall's tangent, -1 if against it: sign(u.t)."""
    return 1 if dot(u, world.walls[wall].tangent) >= 0.0 else -1


def leaves_at_end(world: World, u: complex, following: int) -> bool:
    """Tell whether a tip at a convex end of its wall leaves: it does not press on the next wall."""
    return not presses(world, u, following)


def is_wedged(world: World, wall: int, sense: int, first: int) -> bool:
    """Tell whether sliding on a wall would drive the tip back into the wall it comes from."""
    along = sense * world.walls[wall].tangent
    return dot(along, world.walls[first].normal) <= world.rules.tolerance_rad


# --- What the tip meets -----------------------------------------------------------------------


def passes_end(world: World, u: complex, wall: int, end: int, distance: float) -> bool:
    """Tell whether a ray through an end (0 start, 1 end) of a wall that faces it goes by."""
    other = world.walls[world.neighbours[wall][end]]
    outward = world.walls[wall].tangent if end else -world.walls[wall].tangent
    facing = dot(u, other.normal)
    if dot(outward, other.normal) > 0.0:
        return facing >= -world.rules.tolerance_rad
    # Where rings touch, the ray may come from another wedge of free space than this wall's.
    return min(distance, other.length) * facing > 4.0 * world.rules.tolerance_mm


def meeting(world: World, origin: complex, u: complex, number: int) -> Meeting | None:
    """Return where a ray meets a wall that faces it."""
    wall, tolerance = world.walls[number], world.rules.tolerance_mm
    facing = dot(u, wall.normal)
    height, foot = dot(origin - wall.start, wall.normal), dot(origin - wall.start, wall.tangent)
    if facing >= -world.rules.tolerance_rad or height < -tolerance:
        return None
    if height <= tolerance and -tolerance <= foot <= wall.length + tolerance:
        place, margins = foot, (foot, wall.length - foot)
    elif height <= 0.0:
        return None
    else:
        place = foot - height / facing * dot(u, wall.tangent)
        from_start = cross(u, origin - wall.start)
        margins = (from_start, -wall.length * facing - from_start)
    if min(margins) < -tolerance:
        return None
    place = min(max(place, 0.0), wall.length)
    distance = dot(wall.at(place) - origin, u)
    if distance < -tolerance:
        return None
    distance = max(0.0, distance)
    for end in (0, 1):
        if margins[end] <= tolerance and passes_end(world, u, number, end, distance):
            return None
    return Meeting(number, distance, place)


def wall_ahead(
    world: World, origin: complex, u: complex, skip: tuple[int, ...], reach: float
) -> Meeting | None:
    """Return the first wall met within reach; of several at once, the one that turns u least.

    Walls with an end at one of the places in ``skip`` are left out.
    """
    found = []
    for number, wall in enumerate(world.walls):
        if not set(wall.ends) & set(skip):
            met = meeting(world, origin, u, number)
            if met is not None and met.distance <= reach:
                found.append(met)
    if not found:
        return None
    limit = min(met.distance for met in found) + world.rules.tolerance_mm
    return max(
        (met for met in found if met.distance <= limit),
        key=lambda met: dot(u, world.walls[met.wall].normal),
    )
