"""A wedge that gives way (an experiment): where a tip is stuck, a long free span folds.

The rule of ``contact.md``: a span of length L between pivot and tip carries the push of the growth
only while that is below Fichter's buckling load and below the load that collapses it. Where a stop
is due and the span is longer than that, a hinge comes at mid-span. The near link keeps L/2 and
turns about the pivot; the far link grows from L/2 and turns about the tip, which stays. So the knee
runs along a circle about the pivot, and its side is free: a bifurcation. The fold ends when

- the far link leaves the friction cone of the walls that hold the tip: the tip slides on, and the
  knee is the pivot, until the body straightens over it;
- the knee or the far link meets a wall: a new pivot; if the tip is still held, the rest of the
  span is asked again;
- the length is used up, or the links lie on each other (a true stop).

Every event is the angle at which the knee's circle meets a line: closed form.
"""

import cmath
import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tests.oracles.growth_reference import GrowingBranch, World
from tests.oracles.tube_mechanics import axial_buckling_n, growth_push_n
from vinefab.growth.engine import rules_of
from vinefab.growth.options import GrowthOptions
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Stop
from vinefab.model.map import Pose
from vinefab.physics import tube as tubes

MOST_FOLDS = 60
FLUSH_RAD = 1e-7


def cross(a: complex, b: complex) -> float:
    return (a.conjugate() * b).imag


def dot(a: complex, b: complex) -> float:
    return (a.conjugate() * b).real


class Push(NamedTuple):
    """A tube under the push of its own growth. Modulus, shear modulus (E/3) and P_path: assumed."""

    width_mm: float = 20.0
    pressure_kpa: float = 30.0
    path_kpa: float = 10.5
    ply_mm: float = 0.0375
    modulus_mpa: float = 30.0

    def folds(self, span_mm: float, from_normal_rad: float) -> bool:
        """Tell whether a span is too long for the push at its tip."""
        push_n = growth_push_n(self.pressure_kpa, self.path_kpa, self.width_mm)
        film = (self.ply_mm, self.modulus_mpa, self.modulus_mpa / 3.0)
        axial_n = axial_buckling_n(span_mm, self.pressure_kpa, self.width_mm, *film)
        across_n_mm = push_n * math.sin(from_normal_rad) * span_mm
        collapse_n_mm = tubes.collapse_moment_n_mm(self.pressure_kpa, self.width_mm, 1.0)
        return push_n >= axial_n or across_n_mm >= collapse_n_mm


class Exit(NamedTuple):
    """A way out of a wedge: heading at which the tip begins to slide, on which wall, which way."""

    heading: complex
    wall: int
    sense: int


class Turned(NamedTuple):
    """What a fold meets first: after which turn of the near link, what, and which one."""

    angle: float
    what: str
    exit: Exit | None = None
    vertex: complex | None = None


@dataclass(slots=True, eq=False)
class Fold:
    """Two links between a pivot and a tip that stays; the knee turns about the pivot."""

    world: World
    pivot: complex
    tip: complex
    near: float
    start: float  # direction of the near link before it turns
    side: int  # +1: the knee turns to the left of the near link

    def knee(self, angle: float) -> complex:
        return self.pivot + cmath.rect(self.near, self.start + self.side * angle)

    def angle_of(self, point: complex) -> float:
        """Return the turn, 0 to 2 pi, that points the near link at a point; 2 pi is 0."""
        turn = self.side * (cmath.phase(point - self.pivot) - self.start) % math.tau
        return turn - math.tau if turn > math.tau - FLUSH_RAD else turn

    def angles_on(self, origin: complex, along: complex, reach: float) -> Iterator[float]:
        """Yield the turns at which the knee is on a segment from an origin along a unit vector."""
        back = origin - self.pivot
        half, apart = dot(back, along), abs(back) ** 2 - self.near**2
        under = half * half - apart
        if under < 0.0:
            return
        for root in (-half - math.sqrt(under), -half + math.sqrt(under)):
            if 0.0 <= root <= reach:
                yield self.angle_of(origin + root * along)

    def first(self, exits: list[Exit], far: float) -> Turned:
        """Return what comes first; ``far``: the longest that the far link may grow."""
        found = [*self.lengths(far), *self.exits(exits), *self.walls(), *self.vertices()]
        return min(found, key=lambda met: met.angle, default=Turned(math.pi, "flat"))

    def lengths(self, far: float) -> Iterator[Turned]:
        """The far link uses up the length: a triangle with three known sides."""
        span = abs(self.tip - self.pivot)
        cosine = (span**2 + self.near**2 - far**2) / (2.0 * span * self.near)
        offset = self.angle_of(self.tip)
        offset = offset if offset < math.pi else offset - math.tau
        if -1.0 < cosine < 1.0:
            yield Turned(max(0.0, math.acos(cosine) + offset), "length")

    def exits(self, exits: list[Exit]) -> Iterator[Turned]:
        for way in exits:
            for angle in self.angles_on(self.tip, -way.heading, math.inf):
                if angle > FLUSH_RAD:
                    yield Turned(angle, "exit", exit=way)

    def walls(self) -> Iterator[Turned]:
        for wall in self.world.walls:
            for angle in self.angles_on(wall.start, wall.tangent, wall.length):
                into = dot(1j * self.side * (self.knee(angle) - self.pivot), wall.normal) < 0.0
                if into and angle > -FLUSH_RAD:
                    yield Turned(max(0.0, angle), "knee")

    def vertices(self) -> Iterator[Turned]:
        tolerance = 1e-6
        for vertex in self.world.vertices:
            away, ahead = abs(vertex.point - self.pivot), vertex.point - self.tip
            if tolerance < away < self.near - tolerance:
                angle = self.angle_of(vertex.point)
                towards = 1j * self.side * (vertex.point - self.pivot)
                if angle > FLUSH_RAD or dot(towards, vertex.solid) > 0.0:
                    yield Turned(max(0.0, angle), "near", vertex=vertex.point)
            if abs(ahead) > tolerance:
                for angle in self.angles_on(vertex.point, ahead / abs(ahead), math.inf):
                    if angle > FLUSH_RAD:
                        yield Turned(angle, "far", vertex=vertex.point)


@dataclass(slots=True, eq=False)
class KneeBranch(GrowingBranch):
    """A branch that folds where the growth model stops."""

    push: Push = field(default_factory=Push)
    side: int = 1  # that a knee goes to, unless a wall is there
    folds: int = 0

    def meet(self, wall: int, place: float) -> None:
        held = self.wall
        GrowingBranch.meet(self, wall, place)
        if self.stop in {Stop.HEAD_ON, Stop.CORNER} and self.fold(wall, held):
            self.stop = None

    def exits(self, wall: int, held: int | None) -> list[Exit]:
        """Return the headings at which a held tip begins to slide, on each wall that holds it."""
        angle = self.world.rules.head_on_half_angle_rad + 1e-9
        ways = []
        for one, other in [(wall, held)] if held is None else [(wall, held), (held, wall)]:
            track = self.world.walls[one]
            for sense in (1, -1):
                along = sense * track.tangent
                if other is None or dot(along, self.world.walls[other].normal) > 0.0:
                    heading = math.sin(angle) * along - math.cos(angle) * track.normal
                    ways.append(Exit(heading, one, sense))
        return ways

    def fold(self, wall: int, held: int | None) -> bool:
        """Fold the last span until the tip slides; return False if it stays where it is."""
        while self.folds < MOST_FOLDS:
            span = self.tip - self.pivots[-1]
            normal = self.world.walls[wall].normal
            from_normal = abs(cmath.phase(-span / normal)) if span else 0.0
            if abs(span) < 1e-6 or not self.push.folds(abs(span), from_normal):
                return False
            self.folds += 1
            choices = [self.halved(side) for side in (self.side, -self.side)]
            exits, far = self.exits(wall, held), self.length - self.lengths[-1] - 0.5 * abs(span)
            firsts = [fold.first(exits, far) for fold in choices]
            blocked = firsts[0].angle <= FLUSH_RAD
            met, fold = firsts[blocked], choices[blocked]
            if self.follow(fold, met, exits):
                return met.what != "flat"
            if self.stop is Stop.FULL_LENGTH:
                return False
        return False

    def halved(self, side: int) -> Fold:
        span = self.tip - self.pivots[-1]
        near, start = 0.5 * abs(span), cmath.phase(span)
        return Fold(self.world, self.pivots[-1], self.tip, near, start, side)

    def follow(self, fold: Fold, met: Turned, exits: list[Exit]) -> bool:
        """Go on from what a fold met; return whether it is over: the tip slides or stays."""
        while met.what == "near" and met.vertex is not None:
            self.add_pivot(met.vertex, fold.side)
            near = fold.near - abs(met.vertex - fold.pivot)
            start = fold.start + fold.side * met.angle
            fold = Fold(fold.world, met.vertex, fold.tip, near, start, fold.side)
            met = fold.first(exits, self.length - self.lengths[-1] - near)
        knee = fold.knee(met.angle)
        self.add_pivot(knee, -fold.side)
        if met.what == "far" and met.vertex is not None:
            self.add_pivot(met.vertex, fold.side)
        self.turn_to(self.tip)
        if met.what == "length":
            self.stop = Stop.FULL_LENGTH
            return False
        if met.exit is not None:
            track = self.world.walls[met.exit.wall]
            self.wall, self.sense, self.corner = met.exit.wall, met.exit.sense, -1
            self.place = min(max(dot(self.tip - track.start, track.tangent), 0.0), track.length)
        return met.what in {"exit", "flat"}

    def add_pivot(self, point: complex, sense: int) -> None:
        self.lengths.append(self.lengths[-1] + abs(point - self.pivots[-1]))
        self.pivots.append(point)
        self.senses.append(sense)


@dataclass(slots=True, eq=False)
class TurningBranch(KneeBranch):
    """A branch whose tip turns over where the growth model stops: the hinge is at the tip.

    It grows on along the wall that it met, off the wall that it came along. Where one wall alone
    holds it (head-on), both ways are open: ``side`` +1 is to the left.
    """

    along: int | None = None  # wall that the body has turned to lie along

    def meet(self, wall: int, place: float) -> None:
        held = self.along if self.wall is None else self.wall
        GrowingBranch.meet(self, wall, place)
        if self.stop in {Stop.HEAD_ON, Stop.CORNER} and self.turns(wall, held):
            self.stop = None

    def turns(self, wall: int, held: int | None) -> bool:
        """Turn the tip over, if the last span is too long to hold it."""
        track, span = self.world.walls[wall], self.tip - self.pivots[-1]
        if held is not None and not self.touches(held):
            held = None
        from_normal = abs(cmath.phase(-span / track.normal)) if span else 0.0
        if self.folds >= MOST_FOLDS or not self.push.folds(abs(span), from_normal):
            return False
        self.folds += 1
        off = self.world.walls[held].normal if held is not None else 1j * self.side * self.u
        self.u = track.tangent if dot(track.tangent, off) > 0.0 else -track.tangent
        self.add_pivot(self.tip, 1 if cross(span, self.u) > 0.0 else -1)
        self.wall, self.corner, self.along = None, -1, wall
        return True

    def touches(self, wall: int) -> bool:
        track = self.world.walls[wall]
        return abs(dot(self.tip - track.start, track.normal)) < 1e-6


def grow_with_rule(  # a tip that is stuck, and what it does
    rule: type[KneeBranch], terrain: Terrain, pose: Pose, length_mm: float, push: Push, side: int
) -> KneeBranch:
    """Return a plain vine, body inflated, that gives way to one side where it can."""
    options = GrowthOptions(body="inflated")
    rules = rules_of(options, terrain.tolerance_mm)
    world = World.of(terrain.walls(tubes.inflated_radius_mm(push.width_mm)), rules)
    base = complex(*terrain.start_mm(pose))
    heading = cmath.rect(1.0, pose.heading_rad)
    branch = rule(world, length_mm, base, heading, [base], push=push, side=side)
    branch.grow()
    return branch
