"""One branch grown by small steps: the slow, independent check of the event-driven simulator.

Nothing is solved for here. The tip moves a hundredth of a millimetre; then the simulation looks
whether a wall was crossed, whether the body swept over a vertex, whether the last contact has
straightened. Points are complex numbers, x + iy, in mm. Walls come from the rings of the free
space, so overlapping obstacles are one solid.

A step never ends in a solid: the tip is put back on the wall that it crossed, or at the end of
the wall that it slides on. Hence the error is not the step; the step only blurs the order of
events that fall into the same one.
"""

import cmath
import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from shapely import LinearRing, Point
from shapely.geometry.base import BaseGeometry

STEP_MM = 0.01
LEAP_STEPS = 100
NEAR_MM = 0.1
TOUCH_MM = 1e-9
FLUSH_RAD = 1e-8
NO_TURN = 1e-14
MOST_STEPS = 2_000_000


def dot(a: complex, b: complex) -> float:
    return (a.conjugate() * b).real


def cross(a: complex, b: complex) -> float:
    return (a.conjugate() * b).imag


def unit(a: complex) -> complex:
    return a / abs(a)


def shaken(a: complex, by: float, rng: np.random.Generator) -> complex:
    dx, dy = rng.uniform(-by, by, 2)
    return a + complex(dx, dy)


class Walls:
    """Edges of the free space; wall i runs from vertex i to vertex after[i], free on its left.

    The vertices can be moved at random by a little, to see what an exact tie hangs on.
    """

    def __init__(
        self,
        free_space: BaseGeometry,
        jitter_mm: float = 0.0,
        rng: np.random.Generator | None = None,
    ) -> None:
        self.boundary = free_space.boundary
        shapely.prepare(self.boundary)
        self.vertex: list[complex] = []
        self.after: list[int] = []
        self.before: list[int] = []
        for polygon in shapely.get_parts(free_space):
            self._add(polygon.exterior, free_inside=True)
            for hole in polygon.interiors:
                self._add(hole, free_inside=False)
        if rng is not None:
            self.vertex = [shaken(v, jitter_mm, rng) for v in self.vertex]
        ends = [self.vertex[i] for i in self.after]
        self.length = [abs(e - v) for v, e in zip(self.vertex, ends, strict=True)]
        self.tangent = [unit(e - v) for v, e in zip(self.vertex, ends, strict=True)]
        self.normal = [1j * t for t in self.tangent]

    def _add(self, ring: LinearRing, *, free_inside: bool) -> None:
        points = [complex(x, y) for x, y in ring.coords[:-1]]
        if ring.is_ccw != free_inside:
            points.reverse()
        first, count = len(self.vertex), len(points)
        self.vertex.extend(points)
        self.after.extend(first + (i + 1) % count for i in range(count))
        self.before.extend(first + (i - 1) % count for i in range(count))

    def height(self, wall: int, point: complex) -> float:
        """Return how far a point lies on the free side of a wall's line."""
        return dot(self.normal[wall], point - self.vertex[wall])

    def beside(self, wall: int, point: complex, slack: float = 0.0) -> bool:
        """Return whether the foot of a point on the wall's line is on the wall."""
        along = dot(self.tangent[wall], point - self.vertex[wall])
        return -slack <= along <= self.length[wall] + slack

    def is_hollow(self, vertex: int) -> bool:
        """Return whether the corner is concave as the tip sees it (solid fills over 180 deg)."""
        return cross(self.tangent[self.before[vertex]], self.tangent[vertex]) > 0.0

    def clearance(self, point: complex) -> float:
        return float(shapely.distance(self.boundary, Point(point.real, point.imag)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Grown:
    """Where a growth ended: stop reason, chain base..contacts..tip, and what happened."""

    stop: str
    chain: list[complex]
    log: list[str]

    @property
    def tip(self) -> complex:
        return self.chain[-1]

    @property
    def length(self) -> float:
        return sum(abs(b - a) for a, b in pairwise(self.chain))


class SmallSteps:
    """The state of one growing branch."""

    def __init__(
        self,
        walls: Walls,
        base: complex,
        heading_rad: float,
        length_mm: float,
        half_angle_rad: float,
        step_mm: float = STEP_MM,
    ) -> None:
        self.walls = walls
        self.length_mm = length_mm
        self.half_angle_rad = half_angle_rad
        self.step_mm = step_mm
        self.launch = cmath.rect(1.0, heading_rad)
        self.tip = base
        self.pivots = [base]
        self.pivot_vertex = [-1]
        self.senses = [0]
        self.wall = -1
        self.along = self.launch
        self.left: tuple[int, ...] = ()
        self.near: list[int] = []
        self.near_steps = 0
        self.stop = ""
        self.log: list[str] = []

    def run(self) -> Grown:
        self.begin()
        for _ in range(MOST_STEPS):
            if self.stop:
                return Grown(stop=self.stop, chain=[*self.pivots, self.tip], log=self.log)
            if self.wall >= 0:
                self.slide()
            else:
                self.fly()
        raise RuntimeError(f"no end after {MOST_STEPS} steps: {self.log[-10:]}")

    @property
    def heading(self) -> complex:
        """Unit vector from pivot to tip; the launch heading while the tip is at the base."""
        body = self.tip - self.pivots[-1]
        return unit(body) if abs(body) > TOUCH_MM else self.launch

    def grown(self, tip: complex) -> float:
        points = [*self.pivots, tip]
        return sum(abs(b - a) for a, b in pairwise(points))

    # ---- free growth

    def begin(self) -> None:
        """Start free, or on a wall that the base stands on and heads into."""
        for wall, normal in enumerate(self.walls.normal):
            touches = abs(self.walls.height(wall, self.tip)) <= TOUCH_MM
            if touches and self.walls.beside(wall, self.tip, TOUCH_MM):
                self.left += (wall,)
                if dot(self.launch, normal) < 0.0:
                    self.meet(wall)
                    return

    def fly(self) -> None:
        # Nothing can happen within the clearance, so that far the tip may go at once.
        stride = max(self.step_mm, self.walls.clearance(self.tip) - NEAR_MM)
        ahead = min(stride, self.length_mm - self.grown(self.tip))
        new = self.tip + ahead * self.along
        hit = self.crossed(self.tip, new)
        if hit is not None:
            self.tip, wall = hit
            self.meet(wall)
        else:
            self.tip = new
            if ahead < stride:
                self.stop = "full_length"
        self.left = ()

    def crossed(self, old: complex, new: complex) -> tuple[complex, int] | None:
        """Return the first wall that the step old -> new runs into, and the point there."""
        found = []
        for wall in range(len(self.walls.vertex)):
            below, above = self.walls.height(wall, new), self.walls.height(wall, old)
            if below < 0.0 <= above and wall not in self.left:
                point = old + (new - old) * (above / (above - below))
                if self.walls.beside(wall, point, TOUCH_MM) and not self.grazes(wall, point):
                    found.append((abs(point - old), wall, point))
        if not found:
            return None
        _, wall, point = min(found, key=lambda item: item[:2])
        return point, wall

    def grazes(self, wall: int, point: complex) -> bool:
        """Return whether the tip only touches the end of a wall, a corner that it can pass."""
        for vertex in (wall, self.walls.after[wall]):
            if abs(self.walls.vertex[vertex] - point) <= TOUCH_MM:
                sides = [self.walls.normal[w] for w in (self.walls.before[vertex], vertex)]
                presses = all(dot(self.along, normal) < -TOUCH_MM for normal in sides)
                return not presses and not self.walls.is_hollow(vertex)
        return False

    # ---- walls met, and their ends

    def meet(self, wall: int) -> None:
        """Decide what happens at a wall ahead, met in free growth or while sliding on another."""
        heading, normal, tangent = self.heading, self.walls.normal[wall], self.walls.tangent[wall]
        pressing = -dot(heading, normal)
        if self.wall >= 0 and pressing <= 0.0:
            self.stop = "corner"
            return
        if math.acos(min(1.0, pressing)) <= self.half_angle_rad or self.is_split():
            self.stop = "head_on"
            return
        along = math.copysign(1.0, dot(heading, tangent)) * tangent
        if self.wall >= 0 and dot(along, self.walls.normal[self.wall]) <= 0.0:
            self.stop = "corner"
            return
        self.take(wall, along)

    def is_split(self) -> bool:
        """Return whether the tip is at a corner that turns it as much one way as the other."""
        normals, before = self.walls.normal, self.walls.before
        return any(
            abs(dot(self.heading, normals[before[vertex]] - normals[vertex])) <= TOUCH_MM
            for vertex, place in enumerate(self.walls.vertex)
            if abs(place - self.tip) <= TOUCH_MM and not self.walls.is_hollow(vertex)
        )

    def take(self, wall: int, along: complex) -> None:
        self.wall, self.along, self.near_steps = wall, along, 0
        self.log.append(f"slide {wall}")

    def pass_end(self, vertex: int) -> None:
        """Go on from the end of the wall: onto the next wall, into a wedge, or free."""
        ahead = self.walls.after[self.wall] if vertex != self.wall else self.walls.before[vertex]
        if self.walls.is_hollow(vertex):
            self.meet(ahead)
            return
        heading, tangent = self.heading, self.walls.tangent[ahead]
        if dot(heading, self.walls.normal[ahead]) < 0.0:
            self.take(ahead, math.copysign(1.0, dot(heading, tangent)) * tangent)
        else:
            self.left = (self.wall, ahead)
            self.wall, self.along = -1, heading
            self.log.append(f"leave at {vertex}")

    # ---- sliding

    def slide(self) -> None:
        forward = dot(self.along, self.walls.tangent[self.wall]) > 0.0
        end = self.walls.after[self.wall] if forward else self.wall
        goal = self.walls.vertex[end]
        stride = self.step_mm * (LEAP_STEPS if self.is_quiet(goal) else 1)
        if abs(goal - self.tip) > stride:
            self.swing(self.tip + stride * self.along)
        else:
            self.swing(goal)
            if not self.stop:
                self.pass_end(end)

    def is_quiet(self, goal: complex) -> bool:
        """Return whether the next hundred steps cannot meet anything; keep what they could."""
        if self.near_steps > 0:
            self.near_steps -= 1
            return False
        stride = self.step_mm * LEAP_STEPS
        new = self.tip + stride * self.along
        self.near = self.vertices_near(new)
        if self.near or self.grown(new) > self.length_mm or abs(goal - self.tip) < 2.0 * stride:
            self.near_steps = LEAP_STEPS
            return False
        if self.is_straightened(self.tip, new):
            self.near_steps = LEAP_STEPS
            return False
        return True

    def vertices_near(self, new: complex) -> list[int]:
        """Return the vertices that the body comes close to on the tip's way to ``new``."""
        corners = [self.pivots[-1], self.tip, new]
        hull = shapely.convex_hull(shapely.MultiPoint([(p.real, p.imag) for p in corners]))
        points = shapely.points([(v.real, v.imag) for v in self.walls.vertex])
        near = (shapely.distance(hull, points) < NEAR_MM).nonzero()[0].tolist()
        return [v for v in near if v != self.pivot_vertex[-1]]

    def swing(self, new: complex) -> None:
        """Move the tip along the wall and let the body follow: wrap, release, or just turn."""
        released: set[int] = set()
        while True:
            vertex = self.swept(self.tip, new, released)
            if vertex is not None:
                self.wrap(vertex, new)
            elif self.is_straightened(self.tip, new):
                released.add(self.release(new))
            else:
                break
        if self.grown(new) >= self.length_mm:
            new = self.cut_back(new)
            self.stop = "full_length"
        self.tip = new

    def swept(self, old: complex, new: complex, released: set[int]) -> int | None:
        """Return the first vertex that blocks the body on its way from tip old to tip new."""
        was, becomes = old - self.pivots[-1], new - self.pivots[-1]
        turn = cross(was, becomes)
        if abs(turn) <= NO_TURN * abs(was) * abs(becomes):
            return None
        sense = math.copysign(1.0, turn)
        found = []
        for vertex in self.near:
            arm = self.walls.vertex[vertex] - self.pivots[-1]
            ahead = max(0.0, sense * cross(was, arm) / abs(was))
            if (
                vertex not in released
                and vertex != self.pivot_vertex[-1]
                and self.is_within(vertex, was, becomes, sense)
                and (ahead > TOUCH_MM or self.faces(vertex, was, sense))
            ):
                found.append((ahead / abs(arm), abs(arm), vertex))
        return min(found)[2] if found else None

    def is_within(self, vertex: int, was: complex, becomes: complex, sense: float) -> bool:
        """Return whether a vertex is in the triangle that the body sweeps, or on its first side.

        The tip's own path does not count: the ends of the wall it slides on lie there.
        """
        arm = self.walls.vertex[vertex] - self.pivots[-1]
        not_behind = sense * cross(was, arm) >= -TOUCH_MM * abs(was)
        passed = sense * cross(becomes, arm) <= 0.0
        before_tip = sense * cross(self.along, arm - was) > TOUCH_MM
        return dot(was, arm) > 0.0 and not_behind and passed and before_tip

    def faces(self, vertex: int, body: complex, sense: float) -> bool:
        """Return whether the solid of a touched vertex lies where the body turns to."""
        here = self.walls.vertex[vertex]
        sides = [self.walls.vertex[n[vertex]] - here for n in (self.walls.before, self.walls.after)]
        return any(sense * cross(unit(body), unit(side)) > FLUSH_RAD for side in sides)

    def wrap(self, vertex: int, new: complex) -> None:
        turn = cross(self.tip - self.pivots[-1], new - self.pivots[-1])
        self.senses.append(1 if turn > 0.0 else -1)
        self.pivots.append(self.walls.vertex[vertex])
        self.pivot_vertex.append(vertex)
        self.log.append(f"wrap {vertex}")

    def is_straightened(self, old: complex, new: complex) -> bool:
        """Return whether the body, turning back, has become straight at the last contact."""
        if len(self.pivots) == 1:
            return False
        before, pivot, sense = self.pivots[-2], self.pivots[-1], self.senses[-1]
        turn = sense * cross(old - pivot, new - pivot)
        return turn < 0.0 and sense * cross(pivot - before, new - pivot) < 0.0

    def release(self, new: complex) -> int:
        vertex = self.pivot_vertex.pop()
        self.pivots.pop()
        self.senses.pop()
        self.near = self.vertices_near(new)
        self.near_steps = 0
        self.log.append(f"release {vertex}")
        return vertex

    def cut_back(self, new: complex) -> complex:
        """Return the point before ``new`` at which the whole length is grown, by halving."""
        low, high = 0.0, 1.0
        for _ in range(60):
            middle = 0.5 * (low + high)
            over = self.grown(self.tip + middle * (new - self.tip)) > self.length_mm
            low, high = (low, middle) if over else (middle, high)
        return self.tip + low * (new - self.tip)
