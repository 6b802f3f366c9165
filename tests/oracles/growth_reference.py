"""The growth model in plain Python: the oracle that the compiled kernel is held against.

It follows the same rules on the same arrays, but tests every wall and every vertex whose box comes
near a move, and keeps its state in ordinary objects. The rules that decide the answer are methods
of `World`, under the names that the kernel's functions have. Points and directions are complex
numbers, x + iy. See `vinefab.growth.kernel` for the conventions on walls and senses.
"""

import itertools
import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import brentq

from vinefab.core.validation import Floats
from vinefab.growth.arrays import Growth, Launch, Rules, TreesArrays, WallArrays
from vinefab.model.deployment import Stop


def _dot(a: complex, b: complex) -> float:
    """Return the scalar product of two vectors."""
    return a.real * b.real + a.imag * b.imag


def _cross(a: complex, b: complex) -> float:
    """Return the z component of the vector product: positive if b points to the left of a."""
    return a.real * b.imag - a.imag * b.real


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Wall:
    """One straight wall with free space on its left."""

    # the tangent is a unit vector from start to end
    start: complex
    end: complex
    tangent: complex
    length: float
    ends: tuple[int, int]  # numbers of the places at its start and end

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
    """Walls and vertices as objects, with the tolerances."""

    walls: list[Wall]
    vertices: list[Vertex]
    # the walls before and after each wall, in the same wedge of free space
    neighbours: list[tuple[int, int]]
    rules: Rules  # half angle and tolerances
    # least and largest x and y of each wall, and of each vertex, shape (n, 2, 2)
    wall_boxes_mm: Floats
    vertex_boxes_mm: Floats

    @classmethod
    def of(cls, arrays: WallArrays, rules: Rules) -> "World":
        """Return the arrays as objects."""
        walls = [
            Wall(
                start=complex(ax, ay),
                end=complex(bx, by),
                tangent=complex(tx, ty),
                length=length,
                ends=(start, end),
            )
            for (ax, ay, tx, ty, length), (bx, by), (_, _, start, end, _) in zip(
                arrays.wall.tolist(), arrays.end.tolist(), arrays.link.tolist(), strict=True
            )
        ]
        vertices = [
            Vertex(complex(x, y), place, complex(mx, my))
            for (x, y), (mx, my), place in zip(
                arrays.vertex.tolist(),
                arrays.solid.tolist(),
                arrays.vertex_point.tolist(),
                strict=True,
            )
        ]
        neighbours = [(before, after) for before, after, *_ in arrays.link.tolist()]
        ends = arrays.wall[:, :2], arrays.end
        return cls(
            walls=walls,
            vertices=vertices,
            neighbours=neighbours,
            rules=rules,
            wall_boxes_mm=np.stack([np.minimum(*ends), np.maximum(*ends)], axis=1),
            vertex_boxes_mm=np.repeat(arrays.vertex[:, None], 2, axis=1),
        )

    def near(self, boxes_mm: Floats, *points: complex) -> list[int]:
        """Return which boxes come near the box of some points."""
        away_mm = 16.0 * self.rules.tolerance_mm
        corners = np.array([(point.real, point.imag) for point in points])
        low, high = corners.min(axis=0) - away_mm, corners.max(axis=0) + away_mm
        meets = (boxes_mm[:, 0] <= high) & (boxes_mm[:, 1] >= low)
        numbers: list[int] = np.flatnonzero(meets.all(axis=1)).tolist()
        return numbers

    # --- The rules that decide the answer ---

    def presses(self, u: complex, wall: int) -> bool:
        """Tell whether a body that points along u presses on a wall: u.n < 0."""
        return _dot(u, self.walls[wall].normal) < -self.rules.tolerance_rad

    def is_head_on(self, u: complex, wall: int) -> bool:
        """Tell whether a tip that meets a wall stops: the angle between u and -n is small."""
        along, against = abs(_dot(u, self.walls[wall].tangent)), -_dot(u, self.walls[wall].normal)
        rules = self.rules
        return math.atan2(along, against) <= rules.head_on_half_angle_rad + rules.tie

    def is_split(self, u: complex, number: int, place: float) -> bool:
        """Tell whether a tip meets a convex corner that turns it as much one way as the other."""
        wall, tolerance = self.walls[number], self.rules.tolerance_mm
        end = 1 if place >= wall.length - tolerance else 0
        if not end and place > tolerance:
            return False
        other = self.walls[self.neighbours[number][end]]
        outward = wall.tangent if end else -wall.tangent
        turns_alike = abs(_dot(u, other.normal) - _dot(u, wall.normal)) <= self.rules.tie
        return turns_alike and _dot(outward, other.normal) > 0.0

    def slide_sense(self, u: complex, wall: int) -> int:
        """Return +1 if the tip slides along the wall's tangent, -1 if against it: sign(u.t)."""
        return 1 if _dot(u, self.walls[wall].tangent) >= 0.0 else -1

    def leaves_at_end(self, u: complex, following: int) -> bool:
        """Tell whether a tip at a convex end of its wall leaves: the next wall is not pressed."""
        return not self.presses(u, following)

    def is_wedged(self, wall: int, sense: int, first: int) -> bool:
        """Tell whether sliding on a wall would drive the tip back into the wall it comes from."""
        along = sense * self.walls[wall].tangent
        return _dot(along, self.walls[first].normal) <= self.rules.tolerance_rad

    # --- What the tip meets ---

    def passes_end(self, u: complex, wall: int, end: int, distance: float) -> bool:
        """Tell whether a ray through an end (0 start, 1 end) of a wall that faces it goes by."""
        other = self.walls[self.neighbours[wall][end]]
        outward = self.walls[wall].tangent if end else -self.walls[wall].tangent
        facing = _dot(u, other.normal)
        if _dot(outward, other.normal) > 0.0:
            return facing >= -self.rules.tolerance_rad
        # Where rings touch, the ray may come from another wedge of free space than this wall's.
        return min(distance, other.length) * facing > 4.0 * self.rules.tolerance_mm

    def meeting(self, origin: complex, u: complex, number: int) -> Meeting | None:
        """Return where a ray meets a wall that faces it."""
        wall, tolerance = self.walls[number], self.rules.tolerance_mm
        facing = _dot(u, wall.normal)
        height = _dot(origin - wall.start, wall.normal)
        foot = _dot(origin - wall.start, wall.tangent)
        if facing >= -self.rules.tolerance_rad or height < -tolerance:
            return None
        if height <= tolerance and -tolerance <= foot <= wall.length + tolerance:
            place, margins = foot, (foot, wall.length - foot)
        elif height <= 0.0:
            return None
        else:
            place = foot - height / facing * _dot(u, wall.tangent)
            from_start = _cross(u, origin - wall.start)
            margins = (from_start, -wall.length * facing - from_start)
        if min(margins) < -tolerance:
            return None
        place = min(max(place, 0.0), wall.length)
        distance = _dot(wall.at(place) - origin, u)
        if distance < -tolerance:
            return None
        distance = max(0.0, distance)
        for end in (0, 1):
            if margins[end] <= tolerance and self.passes_end(u, number, end, distance):
                return None
        return Meeting(number, distance, place)

    def wall_ahead(
        self, origin: complex, u: complex, skip: tuple[int, ...], reach: float
    ) -> Meeting | None:
        """Return the first wall met within reach; of several at once, the one that turns u least.

        Walls with an end at one of the places in ``skip`` are left out.
        """
        found = []
        for number in self.near(self.wall_boxes_mm, origin, origin + reach * u):
            if not set(self.walls[number].ends) & set(skip):
                met = self.meeting(origin, u, number)
                if met is not None and met.distance <= reach:
                    found.append(met)
        if not found:
            return None
        limit = min(met.distance for met in found) + self.rules.tolerance_mm
        return max(
            (met for met in found if met.distance <= limit),
            key=lambda met: _dot(u, self.walls[met.wall].normal),
        )


# --- One branch -------------------------------------------------------------------------------


@dataclass(slots=True, eq=False)
class Film:
    """The film that is drawn along a branch's path, and the tension that its tip still everts.

    ``P = Y + (T + f l_r) G + f M`` of `vinefab.physics.growth_pressure`, in its tube's pressures.
    """

    before: complex  # heading with which the film comes to the base
    store: float  # T + f l_r
    limit: float  # working pressure less Y
    rules: Rules  # friction and drag
    # G and M (mm) up to each pivot
    gain: list[float]
    drawn: list[float]

    def turned(self, pivots: list[complex], u: complex) -> float:
        """Return the factor of the turn at the last pivot, for a body that goes on along u."""
        into = pivots[-1] - pivots[-2] if len(pivots) > 1 else self.before
        return math.exp(self.rules.friction * math.atan2(abs(_cross(into, u)), _dot(into, u)))

    def to(self, pivots: list[complex], tip: complex, u: complex) -> tuple[float, float]:
        """Return G and M of the path to a tip."""
        factor = self.turned(pivots, u)
        return self.gain[-1] * factor, self.drawn[-1] * factor + abs(tip - pivots[-1])

    def used_up(self, pivots: list[complex], tip: complex, u: complex) -> bool:
        """Tell whether the tension at a tip is above the limit; just as much is not."""
        return self.excess(pivots, tip, u) > self.limit * self.rules.tie

    def excess(self, pivots: list[complex], tip: complex, u: complex) -> float:
        """Return by how much the tension at a tip is above the limit."""
        gain, drawn = self.to(pivots, tip, u)
        return self.store * gain + self.rules.drag_kpa_mm * drawn - self.limit

    def wrap(self, pivots: list[complex], vertex: complex, u: complex) -> None:
        """Add a pivot, which the body does not turn at yet."""
        gain, drawn = self.to(pivots, vertex, u)
        self.gain.append(gain)
        self.drawn.append(drawn)


@dataclass(slots=True, eq=False)
class GrowingBranch:
    """A growing branch."""

    # where it grows, and its planned length
    world: World
    length: float
    # tip, and heading from the pivot to the tip
    tip: complex
    u: complex
    # base and contacts, and the sense in which each was wrapped (0 for the base)
    pivots: list[complex]
    senses: list[int] = field(default_factory=lambda: [0])
    # length of the chain up to each of them
    lengths: list[float] = field(default_factory=lambda: [0.0])
    # the wall that the tip slides on (None in free growth), how far along it, and which way
    wall: int | None = None
    place: float = 0.0
    sense: int = 0
    corner: int = -1  # place that free growth has just left
    stop: Stop | None = None  # why it stopped
    film: Film | None = None  # None where no pressure stops it

    def grow(self) -> int:
        """Grow until it stops; return the number of events."""
        events = 0
        if self.film is not None and self.film.used_up(self.pivots, self.tip, self.u):
            self.stop = Stop.PRESSURE
        while self.stop is None and events < self.world.rules.most_events:
            start, pivots, u, along = self.tip, list(self.pivots), self.u, self.u
            if self.wall is None:
                self.grow_free()
            else:
                along = self.sense * self.world.walls[self.wall].tangent
                self.slide(self.wall)
            if self.film is not None:
                self.hold_back(self.film, start, pivots, u, along)
            events += 1
        if self.stop is None:
            self.stop = Stop.CORNER
        return events

    def hold_back(
        self, film: Film, start: complex, pivots: list[complex], u: complex, along: complex
    ) -> None:
        """Stop on the way from ``start``, which one event went, if the pressure is used up there.

        ``pivots`` and ``u`` are those before the event; the tip went ``along``.
        """
        near = self.world.rules.tolerance_mm
        from_pivot = abs(start - pivots[-1]) <= near

        def at(share: float) -> tuple[complex, complex]:
            tip = start + share * (self.tip - start)
            # a body that begins at its pivot lies along the way from the beginning
            return tip, along if from_pivot else self.heading_to(tip, pivots[-1], along, u)

        def excess(share: float) -> float:
            return film.excess(pivots, *at(share))

        tip, heading = self.tip, self.heading_to(self.tip, pivots[-1], along, u)
        if film.used_up(pivots, tip, heading):
            share = float(brentq(excess, 0.0, 1.0, xtol=1e-15)) if excess(0.0) < 0.0 else 0.0
            stays = from_pivot and share * abs(self.tip - start) <= near
            self.tip, self.u = (start, u) if stays else at(share)
            self.stop, self.wall = Stop.PRESSURE, None
            del self.pivots[len(pivots) :], self.senses[len(pivots) :], self.lengths[len(pivots) :]
        elif len(self.pivots) > len(pivots):
            film.wrap(pivots, self.pivots[-1], heading)
        elif len(self.pivots) < len(pivots):
            film.gain.pop()
            film.drawn.pop()

    def grow_free(self) -> None:
        """Rule 1: along the heading until the length is used up or a wall is met."""
        room = self.length - self.lengths[-1]
        left = room - abs(self.tip - self.pivots[-1])
        met = self.world.wall_ahead(self.tip, self.u, (self.corner,), left)
        if met is None:
            self.tip = self.pivots[-1] + room * self.u
            self.stop = Stop.FULL_LENGTH
        elif met.distance >= left - 8.0 * self.world.rules.tolerance_mm:
            self.tip = self.world.walls[met.wall].at(met.place)
            self.stop = Stop.FULL_LENGTH
        else:
            self.meet(met.wall, met.place)

    def slide(self, wall: int) -> None:
        """Rule 2: along the wall to the first event; the body turns about the pivot."""
        along = self.sense * self.world.walls[wall].tangent
        ends = self.world.walls[wall].ends
        self.turn_to(self.tip, wall)
        to_end = self.world.walls[wall].length - self.place if self.sense > 0 else self.place
        to_length = self.distance_to_length(along, to_end)
        met = self.world.wall_ahead(self.tip, along, ends, min(to_length, to_end))
        reach = min(to_length, to_end) if met is None else met.distance
        to_release = self.distance_to_release(along)
        vertex, to_vertex = self.first_vertex(along, ends, min(reach, to_release))
        self.move(wall, min(reach, to_release, to_vertex))
        if self.is_used_up():
            self.stop = Stop.FULL_LENGTH
        elif to_release <= min(reach, to_vertex):
            self.release()
        elif vertex is not None:
            self.wrap(vertex)
        elif met is not None:
            self.meet(met.wall, met.place)
        else:
            self.reach_end(wall)

    def move(self, wall: int, distance: float) -> None:
        """Slide along the wall."""
        track = self.world.walls[wall]
        self.place = min(max(self.place + self.sense * distance, 0.0), track.length)
        self.tip = track.at(self.place)
        self.turn_to(self.tip, wall)

    def turn_to(self, point: complex, wall: int) -> None:
        """Point from the pivot to a point of the wall that the tip slides on."""
        along = self.sense * self.world.walls[wall].tangent
        self.u = self.heading_to(point, self.pivots[-1], along, self.u)

    def heading_to(self, point: complex, pivot: complex, along: complex, u: complex) -> complex:
        """Return the heading from a pivot to a point that the tip reached along some direction.

        A body as short as rounding keeps its heading u, and one on its tip's wall lies along it.
        """
        span, near = point - pivot, 8.0 * self.world.rules.tolerance_mm
        reach = math.sqrt(_dot(span, span))
        if reach <= near:
            return u
        is_flush = abs(_cross(along, span)) <= near
        return along if is_flush else complex(span.real / reach, span.imag / reach)

    def meet(self, wall: int, place: float) -> None:
        """Stop at a wall, or slide on along it."""
        sense = self.world.slide_sense(self.u, wall)
        if self.wall is not None and not self.world.presses(self.u, wall):
            self.stop = Stop.CORNER
        elif self.world.is_head_on(self.u, wall) or self.world.is_split(self.u, wall, place):
            self.stop = Stop.HEAD_ON
        elif self.wall is not None and self.world.is_wedged(wall, sense, self.wall):
            self.stop = Stop.CORNER
        if self.stop is None or self.wall is None:
            self.tip = self.world.walls[wall].at(place)
        self.wall, self.place, self.sense, self.corner = wall, place, sense, -1

    def reach_end(self, wall: int) -> None:
        """Go on from the end of a wall: along the next one, freely, or not at all."""
        end = 1 if self.sense > 0 else 0
        following = self.world.neighbours[wall][end]
        self.tip = self.world.walls[wall].end if end else self.world.walls[wall].start
        place = 0.0 if end else self.world.walls[following].length
        along = self.sense * self.world.walls[wall].tangent
        if _dot(along, self.world.walls[following].normal) <= 0.0:
            self.meet(following, place)
        elif self.world.leaves_at_end(self.u, following):
            self.wall, self.corner = None, self.world.walls[wall].ends[end]
        else:
            self.wall, self.place = following, place

    def is_used_up(self, way: complex = 0j) -> bool:
        """Tell whether the length is used up once the tip has gone some way; ties count."""
        body = self.tip + way - self.pivots[-1]
        room = self.length - self.lengths[-1] - 8.0 * self.world.rules.tolerance_mm
        return room <= 0.0 or _dot(body, body) >= room * room

    def distance_to_length(self, along: complex, reach: float) -> float:
        """Return how far the tip slides until the length is used up; infinity if not in reach."""
        q, room = self.tip - self.pivots[-1], self.length - self.lengths[-1]
        if not self.is_used_up(reach * along):
            return math.inf
        short = room * room - q.real * q.real - q.imag * q.imag
        if short <= 0.0:
            return 0.0
        return short / (_dot(q, along) + math.sqrt(_dot(q, along) * _dot(q, along) + short))

    def distance_to_release(self, along: complex) -> float:
        """Return how far the tip slides until the body straightens over its last contact."""
        if len(self.pivots) == 1 or self.senses[-1] == self.sense:
            return math.inf
        edge, q = self.pivots[-1] - self.pivots[-2], self.tip - self.pivots[-1]
        closing = self.sense * _cross(edge, along)
        if closing <= 0.0:
            return math.inf
        return max(0.0, -self.sense * _cross(edge, q)) / closing

    def distance_to_vertex(self, vertex: Vertex, along: complex) -> float:
        """Return how far the tip slides until the turning body meets a vertex."""
        tolerance = self.world.rules.tolerance_mm
        q, v = self.tip - self.pivots[-1], vertex.point - self.pivots[-1]
        ahead, reach = self.sense * _cross(self.u, v), _dot(self.u, v)
        if ahead < -tolerance or reach <= tolerance:
            return math.inf
        if ahead <= tolerance:
            touches = reach <= _dot(self.u, q) + tolerance
            blocks = self.sense * _cross(self.u, vertex.solid) > 0.0
            return 0.0 if touches and blocks else math.inf
        closing = self.sense * _cross(v, along)
        above = self.sense * _cross(along, v - q)
        if closing <= 0.0 or above <= tolerance:
            return math.inf
        return self.sense * _cross(q, v) / closing

    def first_vertex(
        self, along: complex, skip: tuple[int, ...], reach: float
    ) -> tuple[Vertex | None, float]:
        """Return the first vertex met, the farthest from the pivot if several are met at once."""
        best: tuple[float, float] = (reach, 0.0)
        found = None
        swept = self.pivots[-1], self.tip, self.tip + reach * along
        for number in self.world.near(self.world.vertex_boxes_mm, *swept):
            vertex = self.world.vertices[number]
            if vertex.place in skip:
                continue
            key = (self.distance_to_vertex(vertex, along), -abs(vertex.point - self.pivots[-1]))
            if key[0] <= reach and (found is None or key < best):
                found, best = vertex, key
        return found, best[0] if found else math.inf

    def wrap(self, vertex: Vertex) -> None:
        """Make a vertex the new pivot and remember the turning sense."""
        span = vertex.point - self.pivots[-1]
        self.lengths.append(self.lengths[-1] + math.sqrt(_dot(span, span)))
        self.pivots.append(vertex.point)
        self.senses.append(self.sense)

    def release(self) -> None:
        """Drop the last contact."""
        self.pivots.pop()
        self.senses.pop()
        self.lengths.pop()


# --- The tree ---------------------------------------------------------------------------------


def _emerges(
    tree: TreesArrays, fits: NDArray[np.bool_], rules: Rules, growth: Growth, branch: int
) -> bool:
    """Tell whether a branch leaves its parent's tip at all."""
    parent = tree.parent[branch]
    if not fits[branch]:
        return False
    if parent < 0 or growth.stop[parent] == Stop.FULL_LENGTH:
        return True
    return rules.deploys_stuck and bool(growth.stop[parent] != Stop.NOT_DEPLOYED)


def _launched(
    world: World, tree: TreesArrays, start: Launch, growth: Growth, branch: int
) -> GrowingBranch:
    """Return a branch at its base, with its launch heading."""
    parent = int(tree.parent[branch])
    base, heading = complex(*start[:2]), complex(*start[2:])
    if parent >= 0:
        base = complex(*growth.points[growth.first_point[parent + 1] - 1].tolist())
        heading = complex(*growth.heading[parent].tolist())
    u = heading * complex(*tree.turn[branch].tolist())
    grown = GrowingBranch(world, float(tree.length[branch]), base, u, [base])
    if tree.limit[branch] < math.inf:
        gain, drawn = (growth.gain[parent], growth.drawn[parent]) if parent >= 0 else (1.0, 0.0)
        grown.film = Film(
            before=heading,
            store=float(tree.store[branch]),
            limit=float(tree.limit[branch]),
            rules=world.rules,
            gain=[float(gain)],
            drawn=[float(drawn)],
        )
    return grown


def _turning(launch: complex, chain: list[complex], shortest: float) -> float:
    """Return the sum of absolute turns along a chain that was launched along a heading.

    Steps no longer than ``shortest`` have no direction, and are left out.
    """
    steps = [b - a for a, b in itertools.pairwise(chain) if abs(b - a) > shortest]
    headings = [launch, *steps]
    return sum(math.atan2(abs(_cross(a, b)), _dot(a, b)) for a, b in itertools.pairwise(headings))


def _record(growth: Growth, number: int, branch: GrowingBranch, launch: complex) -> bool:
    """Write how a branch ended; return False if the chain points need more room."""
    chain = [*branch.pivots, branch.tip]
    first = growth.first_point[number]
    last = first + len(chain)
    if last > len(growth.points):
        return False
    growth.points[first:last] = [(point.real, point.imag) for point in chain]
    growth.first_point[number + 1] = last
    growth.stop[number] = Stop.CORNER if branch.stop is None else branch.stop
    grown = branch.lengths[-1] + abs(branch.tip - branch.pivots[-1])
    is_full = branch.stop is Stop.FULL_LENGTH
    growth.grown[number] = branch.length if is_full else min(branch.length, grown)
    growth.heading[number] = branch.u.real, branch.u.imag
    if branch.film is not None:
        path = branch.film.to(branch.pivots, branch.tip, branch.u)
        growth.gain[number], growth.drawn[number] = path
    # A single event is a flight: straight.
    shortest = 8.0 * branch.world.rules.tolerance_mm
    growth.turn[number] = _turning(launch, chain, shortest) if growth.events[number] > 1 else 0.0
    return True


def grow_reference_branches(
    walls: WallArrays,
    tree: TreesArrays,
    fits: NDArray[np.bool_],
    rules: Rules,
    start: Launch,
    growth: Growth,
    first: int,
    last: int,
) -> int:
    """Grow some branches of a tree, as `vinefab.growth.kernel.grow_branches` does."""
    world = World.of(walls, rules)
    for number in range(first, last):
        if not _emerges(tree, fits, rules, growth, number):
            growth.first_point[number + 1] = growth.first_point[number]
            growth.stop[number] = Stop.NOT_DEPLOYED
            continue
        branch = _launched(world, tree, start, growth, number)
        launch = branch.u
        growth.events[number] = branch.grow()
        if not _record(growth, number, branch, launch):
            return number
    return last
