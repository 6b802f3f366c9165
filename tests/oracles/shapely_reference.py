"""The growth model as a user of Shapely would write it.

It follows the same rules as `vinefab.growth.kernel`, for bare centrelines, with the tools at hand:
an `STRtree` over the walls for rays, one over the corners for what the turning body sweeps, and
plain Python in between. It does without the kernel's care for exact ties and touching rings, so
that it is no slower than it must be; on maps without these it ends at the same tips.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from shapely import LineString, Point, Polygon, STRtree
from shapely.geometry.base import BaseGeometry

from vinefab.growth.options import GrowthOptions
from vinefab.model.deployment import Stop
from vinefab.model.map import Pose
from vinefab.model.tree import BranchTree

TOUCH_MM = 1e-7
PARALLEL = 1e-11

Vector = tuple[float, float]


class ReferenceWall(NamedTuple):
    """A straight wall with free space on its left, and the numbers of those before and after."""

    start: Vector
    end: Vector
    tangent: Vector
    length: float
    before: int
    after: int

    @property
    def normal(self) -> Vector:
        """Unit vector into free space."""
        return -self.tangent[1], self.tangent[0]


class ReferenceWorld:
    """Walls and corners of a free space, in trees."""

    def __init__(self, free: BaseGeometry) -> None:
        self.walls: list[ReferenceWall] = []
        for polygon in shapely.get_parts(shapely.orient_polygons(free)):
            for ring in (polygon.exterior, *polygon.interiors):
                self._add(list(ring.coords))
        self.wall_tree = STRtree([LineString([wall.start, wall.end]) for wall in self.walls])
        self.corners = [
            (wall.end, wall, self.walls[wall.after])
            for wall in self.walls
            if _cross(wall.tangent, self.walls[wall.after].tangent) < 0.0
        ]
        self.corner_tree = STRtree([Point(corner) for corner, _, _ in self.corners])

    def _add(self, points: list[Vector]) -> None:
        first, count = len(self.walls), len(points) - 1
        for index in range(count):
            start, end = points[index], points[index + 1]
            length = math.dist(start, end)
            tangent = ((end[0] - start[0]) / length, (end[1] - start[1]) / length)
            before, after = first + (index - 1) % count, first + (index + 1) % count
            self.walls.append(ReferenceWall(start, end, tangent, length, before, after))

    def first_wall(
        self, tip: Vector, u: Vector, reach: float, skip: tuple[Vector, ...]
    ) -> tuple[int, float] | None:
        """Return the first wall that a ray meets from its free side, and how far away."""
        ray = LineString([tip, _along(tip, u, reach)])
        best = None
        for index in self.wall_tree.query(ray, "dwithin", TOUCH_MM).tolist():
            wall = self.walls[index]
            facing = _dot(u, wall.normal)
            if facing >= -PARALLEL or wall.start in skip or wall.end in skip:
                continue
            height = _dot((tip[0] - wall.start[0], tip[1] - wall.start[1]), wall.normal)
            distance = max(0.0, -height / facing)
            if height >= -TOUCH_MM and (best is None or distance < best[1]):
                best = index, distance
        return best

    def first_corner(
        self, branch: "ReferenceBranch", s: Vector, reach: float, skip: tuple[Vector, ...]
    ) -> tuple[Vector, float] | None:
        """Return the first corner that the turning body meets, and how far the tip slides to it."""
        pivot, tip, sense = branch.pivots[-1], branch.tip, branch.sense
        swept = Polygon([pivot, tip, _along(tip, s, reach)])
        q = (tip[0] - pivot[0], tip[1] - pivot[1])
        best = None
        for index in self.corner_tree.query(swept, "dwithin", TOUCH_MM).tolist():
            corner, wall, following = self.corners[index]
            v = (corner[0] - pivot[0], corner[1] - pivot[1])
            if corner in skip or math.hypot(*v) <= TOUCH_MM:
                continue
            closing = sense * _cross(v, s)
            if closing <= 0.0 or _is_left_behind(q, v, sense, (wall, following)):
                continue
            distance = max(0.0, sense * _cross(q, v) / closing)
            if distance <= reach and (best is None or distance < best[1]):
                best = corner, distance
        return best


def _is_left_behind(
    q: Vector, v: Vector, sense: float, walls: tuple[ReferenceWall, ReferenceWall]
) -> bool:
    """Tell whether the body touches a corner already and turns away from its solid."""
    if abs(_cross(q, v)) > TOUCH_MM * math.hypot(*q):
        return False
    solid = [-one - other for one, other in zip(walls[0].normal, walls[1].normal, strict=True)]
    return sense * _cross(q, (solid[0], solid[1])) <= 0.0


@dataclass(slots=True)
class ReferenceBranch:
    """A growing branch: its pivots so far, and its tip."""

    # course, length, half_angle_rad: where it grows, how long it may become and what is head-on
    course: ReferenceWorld
    length: float
    half_angle_rad: float
    # tip, u: its tip and heading
    tip: Vector
    u: Vector
    pivots: list[Vector]  # base and contacts
    used: float = 0.0  # length up to the last pivot, mm
    # wall, sense: what it slides on and which way
    wall: int | None = None
    sense: float = 0.0
    left: tuple[Vector, ...] = ()  # the corner that it has just left
    stop: Stop | None = None  # why it stopped

    def grow(self) -> None:
        """Grow until it stops."""
        while self.stop is None:
            if self.wall is None:
                self.grow_free()
            else:
                self.slide(self.course.walls[self.wall])

    def grow_free(self) -> None:
        """Grow along the heading to the end or to the first wall."""
        room = self.length - self.used - math.dist(self.tip, self.pivots[-1])
        met = self.course.first_wall(self.tip, self.u, room, self.left)
        self.tip = _along(self.tip, self.u, room if met is None else met[1])
        if met is None:
            self.stop = Stop.FULL_LENGTH
        else:
            self.meet(met[0])

    def meet(self, index: int) -> None:
        """Stop at a wall or begin to slide on it."""
        wall = self.course.walls[index]
        along, against = _dot(self.u, wall.tangent), -_dot(self.u, wall.normal)
        sense = math.copysign(1.0, along)
        if self.wall is not None and against <= 0.0:
            self.stop = Stop.CORNER
        elif math.atan2(abs(along), against) <= self.half_angle_rad:
            self.stop = Stop.HEAD_ON
        elif self.wall is not None:
            s = (sense * wall.tangent[0], sense * wall.tangent[1])
            if _dot(s, self.course.walls[self.wall].normal) <= 0.0:
                self.stop = Stop.CORNER
        self.wall, self.sense, self.left = index, sense, ()

    def slide(self, wall: ReferenceWall) -> None:
        """Slide along a wall to what comes first."""
        s = (self.sense * wall.tangent[0], self.sense * wall.tangent[1])
        end = wall.end if self.sense > 0.0 else wall.start
        pivot, ends = self.pivots[-1], (wall.start, wall.end)
        to_end, to_length = math.dist(self.tip, end), self.to_length(s)
        reach = min(to_end, to_length)
        met = self.course.first_wall(self.tip, s, reach, ends)
        reach = reach if met is None else met[1]
        corner = self.course.first_corner(self, s, reach, ends)
        self.move(s, reach if corner is None else corner[1])
        if corner is not None:
            self.used += math.dist(pivot, corner[0])
            self.pivots.append(corner[0])
        elif met is not None:
            self.meet(met[0])
        elif to_length <= to_end:
            self.stop = Stop.FULL_LENGTH
        else:
            self.pass_end(wall, end)

    def to_length(self, s: Vector) -> float:
        """Return how far the tip slides until the length is used up."""
        pivot, room = self.pivots[-1], self.length - self.used
        q = (self.tip[0] - pivot[0], self.tip[1] - pivot[1])
        along = _dot(q, s)
        return math.sqrt(max(0.0, along * along + room * room - _dot(q, q))) - along

    def move(self, s: Vector, distance: float) -> None:
        """Move the tip and turn the body after it."""
        self.tip = _along(self.tip, s, distance)
        pivot = self.pivots[-1]
        reach = math.dist(self.tip, pivot)
        if reach > TOUCH_MM:
            self.u = (self.tip[0] - pivot[0]) / reach, (self.tip[1] - pivot[1]) / reach

    def pass_end(self, wall: ReferenceWall, end: Vector) -> None:
        """Go on from the end of a wall."""
        self.tip = end
        index = wall.after if self.sense > 0.0 else wall.before
        following = self.course.walls[index]
        opens = self.sense * _dot(wall.tangent, following.normal)
        if opens <= 0.0:
            self.meet(index)
        elif _dot(self.u, following.normal) >= 0.0:
            self.wall, self.left = None, (end,)
        else:
            self.wall = index


def grow_tree(
    course: ReferenceWorld, tree: BranchTree, pose: Pose, options: GrowthOptions
) -> list[ReferenceBranch]:
    """Return every branch of a tree, grown; those that never emerged are stopped at length 0."""
    branches: list[ReferenceBranch] = []
    headings = [pose.heading_rad]
    for parent, offset, length in zip(
        tree.parent.tolist(), tree.offset_rad.tolist(), tree.length_mm.tolist(), strict=True
    ):
        before = branches[parent] if parent >= 0 else None
        base = before.tip if before else (pose.x_mm, pose.y_mm)
        heading = (math.atan2(before.u[1], before.u[0]) if before else headings[0]) + offset
        u = (math.cos(heading), math.sin(heading))
        branch = ReferenceBranch(course, length, options.only_half_angle_rad, base, u, [base])
        if before is None or _evers(before, options):
            branch.grow()
        else:
            branch.stop = Stop.NOT_DEPLOYED
        branches.append(branch)
    return branches


def tips_mm(branches: list[ReferenceBranch]) -> np.ndarray[tuple[int, ...], np.dtype[np.float64]]:
    """Return the tips of the branches that deployed, shape (m, 2)."""
    tips = [branch.tip for branch in branches if branch.stop is not Stop.NOT_DEPLOYED]
    return np.array(tips, dtype=np.float64).reshape(-1, 2)


def _evers(branch: ReferenceBranch, options: GrowthOptions) -> bool:
    """Tell whether a branch's children emerge."""
    if branch.stop is Stop.FULL_LENGTH:
        return True
    return options.deploys_stuck and branch.stop is not Stop.NOT_DEPLOYED


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1]


def _cross(a: Vector, b: Vector) -> float:
    return a[0] * b[1] - a[1] * b[0]


def _along(point: Vector, direction: Vector, distance: float) -> Vector:
    return point[0] + distance * direction[0], point[1] + distance * direction[1]
