"""A vine as a dynamic chain of rigid links: the model that the event-driven one is compared with.

Nothing of vinefab's growth rules is in here. The body is a planar chain of rigid links with their
mass at the joints. A joint resists bending with the elastic moment of an inflated tube, up to the
moment at which the tube collapses. Walls push back in proportion to how deep they are entered
(penalty), with Coulomb friction if asked for. The link at the tip grows at constant speed whatever
stands in its way, along its own heading, and is cut in two when it is two links long. The base is
clamped. Self-contact and self-weight are ignored, as in vinefab.

Units: mm, s, N, hence t (1000 kg) for mass. What nobody measured is marked assumed.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon, box
from shapely.affinity import rotate

from vinefab.core.compiling import compiled
from vinefab.model.map import Map, Pose
from vinefab.physics import tube as tubes

Floats = NDArray[np.float64]

PLY_MM = 0.0375
FILM_T_MM3 = 1.2e-9
MODULUS_MPA = 30.0  # assumed, as in physics.md


class Vine(NamedTuple):
    """The chain: what it is made of and how finely it is cut and stepped."""

    radius_mm: float
    bending_n_mm2: float  # E I
    collapse_n_mm: float  # a joint's moment is at most this
    mass_t_mm: float
    drag_n_s_mm2: float  # of the whole body, per mm and mm/s
    joint_n_mm_s: float  # damping of a joint
    base_n_mm: float  # stiffness of the clamp at the base, per rad; 0: a free hinge
    link_mm: float
    step_s: float
    speed_mm_s: float
    wall_n_mm: float  # stiffness of walls
    friction: float  # of body and tip on walls


def vine_of(width_mm: float = 20.0, pressure_kpa: float = 30.0, **changes: float) -> Vine:
    """Return a chain like a tube of TPU film.

    Assumed: modulus, drag, damping; ten times the mass of two layers of film, which allows longer
    steps; growth at 200 mm/s, slow enough that halving it changes little where the path does not
    fork.
    """
    bending = MODULUS_MPA * math.pi * tubes.inflated_radius_mm(width_mm) ** 3 * PLY_MM
    link_mm = float(changes.get("link_mm", 10.0))
    mass_t_mm = 10.0 * 4.0 * width_mm * PLY_MM * FILM_T_MM3
    step_s = 0.3 * link_mm**2 * math.sqrt(mass_t_mm / bending) / 2.0
    vine = Vine(
        radius_mm=tubes.inflated_radius_mm(width_mm),
        bending_n_mm2=bending,
        collapse_n_mm=tubes.collapse_moment_n_mm(pressure_kpa, width_mm, 1.0),
        mass_t_mm=mass_t_mm,
        drag_n_s_mm2=2e-7,
        joint_n_mm_s=0.02 * mass_t_mm * link_mm**3 / step_s,
        base_n_mm=2.0 * bending / link_mm,
        link_mm=link_mm,
        step_s=step_s,
        speed_mm_s=200.0,
        wall_n_mm=0.1 * mass_t_mm * link_mm / step_s**2,
        friction=0.0,
    )
    return vine._replace(**changes)


@dataclass(frozen=True, slots=True, kw_only=True)
class Box:
    """A box that is turned about its centre."""

    x_mm: float
    y_mm: float
    half_width_mm: float
    half_height_mm: float
    turn_rad: float

    @property
    def polygon(self) -> Polygon:
        w, h = self.half_width_mm, self.half_height_mm
        flat = box(self.x_mm - w, self.y_mm - h, self.x_mm + w, self.y_mm + h)
        return rotate(flat, self.turn_rad, use_radians=True)


class Arena(NamedTuple):
    """Boxes in a rectangle of free space."""

    side_mm: float
    boxes: tuple[Box, ...]

    def map(self) -> Map:
        bounds = box(0.0, 0.0, self.side_mm, self.side_mm)
        return Map(name="boxes", bounds=bounds, obstacles=tuple(b.polygon for b in self.boxes))

    def rows(self) -> Floats:
        """Centre, cosine and sine, half sizes, reach of each box, shape (n, 7)."""
        return np.array(
            [
                [
                    *(b.x_mm, b.y_mm, math.cos(b.turn_rad), math.sin(b.turn_rad)),
                    *(b.half_width_mm, b.half_height_mm),
                    math.hypot(b.half_width_mm, b.half_height_mm),
                ]
                for b in self.boxes
            ]
        ).reshape(-1, 7)


BOXES = 20


def arena_of(seed: int, side_mm: float) -> Arena:
    """Return 20 turned boxes with sides of 0.06 to 0.16 of the arena's, at least 0.04 apart."""
    rng = np.random.default_rng([20, seed])
    gap_mm, start = 0.04 * side_mm, start_of(side_mm, 90.0)
    kept: list[Box] = []
    taken = [shapely.Point(start.x_mm, start.y_mm).buffer(0.06 * side_mm)]
    while len(kept) < BOXES:
        x, y = rng.uniform(0.05 * side_mm, 0.95 * side_mm, 2)
        w, h = rng.uniform(0.03 * side_mm, 0.08 * side_mm, 2)
        one = Box(
            x_mm=float(x),
            y_mm=float(y),
            half_width_mm=float(w),
            half_height_mm=float(h),
            turn_rad=float(rng.uniform(0.0, math.pi)),
        )
        shape = one.polygon
        inside = box(gap_mm, gap_mm, side_mm - gap_mm, side_mm - gap_mm).contains(shape)
        if inside and all(shape.distance(other) >= gap_mm for other in taken):
            kept.append(one)
            taken.append(shape)
    return Arena(side_mm, tuple(kept))


def start_of(side_mm: float, heading_deg: float) -> Pose:
    """Return a start in the middle of the lower side."""
    return Pose(x_mm=0.5 * side_mm, y_mm=0.03 * side_mm, heading_rad=math.radians(heading_deg))


class Shape(NamedTuple):
    """How a chain ended."""

    points_mm: Floats  # joints, base first, tip last, shape (n, 2)
    deepest_mm: float  # that any joint was in a wall on the way
    fastest_mm_s: float  # that any joint moved
    stretched_mm: float  # that any link was off its length, at worst
    push_n: float  # greatest push along the link at the tip, over PUSH_S


MOST_STEPS = 20_000_000
FAR_MM = 1e4  # from all walls
PUSH_S = 0.1


def grow_chain(arena: Arena, pose: Pose, length_mm: float, vine: Vine) -> Shape:
    """Return the shape of a chain that was forced to grow to a length."""
    room = int(length_mm / vine.link_mm) + 4
    x, v, work = np.zeros((room, 2)), np.zeros((room, 2)), np.zeros((room, 8))
    heading = np.array([math.cos(pose.heading_rad), math.sin(pose.heading_rad)])
    x[0] = pose.x_mm, pose.y_mm
    x[1] = x[0] + vine.link_mm * heading
    v[1] = vine.speed_mm_s * heading
    seen = np.zeros(5)
    count = _grow(x, v, work, arena.rows(), arena.side_mm, vine, heading, length_mm, seen)
    return Shape(x[:count].copy(), *seen[:4].tolist())


def bend_under_load(length_mm: float, load_n: float, vine: Vine, time_s: float) -> Floats:
    """Return the joints of a clamped chain that does not grow, with a load across its tip."""
    count = round(length_mm / vine.link_mm) + 1
    x, v, work = np.zeros((count, 2)), np.zeros((count, 2)), np.zeros((count, 8))
    x[:, 0], x[:, 1] = FAR_MM + vine.link_mm * np.arange(count), FAR_MM
    heading, still = np.array([1.0, 0.0]), vine._replace(speed_mm_s=0.0)
    for _ in range(round(time_s / vine.step_s)):
        work[:, :2] = 0.0
        work[count - 1, 1] = load_n
        _forces(x, v, work, np.zeros((0, 7)), 10.0 * FAR_MM, still, heading, count, vine.link_mm)
        _move(x, v, work, still, count, vine.link_mm, 0.0)
    return x - FAR_MM


# --- Compiled -------------------------------------------------------------------------------------
# work: force x, y; mass; right side, diagonal, beside it, impulse of the link after; depth


@compiled
def _grow(x, v, work, boxes, side, vine, heading, length, seen):
    """Grow to a length; return how many joints there are."""
    count, last, grown, steps = 2, vine.link_mm, vine.link_mm, 0
    while grown < length and steps < MOST_STEPS:
        work[:count, :2] = 0.0
        _forces(x, v, work, boxes, side, vine, heading, count, last)
        for i in range(count):
            seen[0] = max(seen[0], work[i, 7])
            seen[1] = max(seen[1], math.hypot(v[i, 0], v[i, 1]))
        off = _move(x, v, work, vine, count, last, vine.speed_mm_s)
        seen[2] = max(seen[2], off)
        push = work[count - 2, 6] / vine.step_s
        seen[4] += vine.step_s / PUSH_S * (push - seen[4])
        seen[3] = max(seen[3], seen[4])
        last += vine.speed_mm_s * vine.step_s
        grown += vine.speed_mm_s * vine.step_s
        if last >= 2.0 * vine.link_mm:
            share = vine.link_mm / last
            for k in range(2):
                x[count, k], v[count, k] = x[count - 1, k], v[count - 1, k]
                x[count - 1, k] += (share - 1.0) * (x[count, k] - x[count - 2, k])
                v[count - 1, k] += (share - 1.0) * (v[count, k] - v[count - 2, k])
            last -= vine.link_mm
            count += 1
        steps += 1
    return count


@compiled
def _forces(x, v, work, boxes, side, vine, heading, count, last):
    """Add up the forces on all joints: drag, bending, walls."""
    for i in range(count):
        ahead = 0.0 if i == count - 1 else (last if i == count - 2 else vine.link_mm)
        behind = 0.0 if i == 0 else (last if i == count - 1 else vine.link_mm)
        share = 0.5 * (ahead + behind)
        work[i, 2], work[i, 7] = vine.mass_t_mm * share, 0.0
        work[i, 0] -= vine.drag_n_s_mm2 * share * v[i, 0]
        work[i, 1] -= vine.drag_n_s_mm2 * share * v[i, 1]
    _bend(x, v, work, vine, heading, count)
    for i in range(1, count):
        _press_bounds(x, v, work, side, vine, i)
        for b in range(len(boxes)):
            dx, dy = x[i, 0] - boxes[b, 0], x[i, 1] - boxes[b, 1]
            reach = boxes[b, 6] + vine.radius_mm + 2.0 * vine.link_mm
            if dx * dx + dy * dy < reach * reach:
                _press_box(x, v, work, boxes, vine, i, b)
                _press_corners(x, v, work, boxes, vine, i, b)


@compiled
def _bend(x, v, work, vine, heading, count):
    """Add the moments of all joints, as pairs of forces on the links that they join."""
    for i in range(count - 1):
        ex, ey = x[i + 1, 0] - x[i, 0], x[i + 1, 1] - x[i, 1]
        e2 = ex * ex + ey * ey
        spin = (ex * (v[i + 1, 1] - v[i, 1]) - ey * (v[i + 1, 0] - v[i, 0])) / e2
        if i == 0:
            dx, dy, d2, stiffness = heading[0], heading[1], 1.0, vine.base_n_mm
        else:
            dx, dy = x[i, 0] - x[i - 1, 0], x[i, 1] - x[i - 1, 1]
            d2 = dx * dx + dy * dy
            spin -= (dx * (v[i, 1] - v[i - 1, 1]) - dy * (v[i, 0] - v[i - 1, 0])) / d2
            stiffness = 2.0 * vine.bending_n_mm2 / (math.sqrt(d2) + math.sqrt(e2))
        angle = math.atan2(dx * ey - dy * ex, dx * ex + dy * ey)
        moment = vine.collapse_n_mm * math.tanh(stiffness * angle / vine.collapse_n_mm)
        # A body cannot fold through itself.
        if abs(angle) > 2.5:
            moment += stiffness * (angle - math.copysign(2.5, angle))
        moment += vine.joint_n_mm_s * spin
        fx, fy = ey / e2 * moment, -ex / e2 * moment
        work[i + 1, 0] += fx
        work[i + 1, 1] += fy
        work[i, 0] -= fx
        work[i, 1] -= fy
        if i > 0:
            fx, fy = -dy / d2 * moment, dx / d2 * moment
            work[i, 0] += fx
            work[i, 1] += fy
            work[i - 1, 0] -= fx
            work[i - 1, 1] -= fy


@compiled
def _push(v, work, vine, i, depth, nx, ny, share):
    """Push a joint out of a wall, with friction against its way along the wall."""
    work[i, 7] = max(work[i, 7], depth)
    mass = work[i, 2]
    out = v[i, 0] * nx + v[i, 1] * ny
    damping = math.sqrt(vine.wall_n_mm * mass)
    normal = share * max(0.0, vine.wall_n_mm * depth - damping * out)
    along = -v[i, 0] * ny + v[i, 1] * nx
    stick = 0.2 * mass * abs(along) / vine.step_s
    rub = -math.copysign(min(vine.friction * normal, stick), along)
    work[i, 0] += normal * nx - rub * ny
    work[i, 1] += normal * ny + rub * nx


@compiled
def _press_bounds(x, v, work, side, vine, i):
    for k in range(2):
        depth = vine.radius_mm - x[i, k]
        if depth > 0.0:
            _push(v, work, vine, i, depth, 1.0 - k, 0.0 + k, 1.0)
        depth = x[i, k] + vine.radius_mm - side
        if depth > 0.0:
            _push(v, work, vine, i, depth, k - 1.0, 0.0 - k, 1.0)


@compiled
def _press_box(x, v, work, boxes, vine, i, b):
    """Push a joint out of a box with rounded corners: all that is within the body's radius."""
    dx, dy = x[i, 0] - boxes[b, 0], x[i, 1] - boxes[b, 1]
    c, s = boxes[b, 2], boxes[b, 3]
    px, py = c * dx + s * dy, c * dy - s * dx
    qx, qy = abs(px) - boxes[b, 4], abs(py) - boxes[b, 5]
    if qx > 0.0 and qy > 0.0:
        apart = math.hypot(qx, qy)
        nx, ny = qx / apart, qy / apart
    elif qx > qy:
        apart, nx, ny = qx, 1.0, 0.0
    else:
        apart, nx, ny = qy, 0.0, 1.0
    if apart < vine.radius_mm:
        nx, ny = math.copysign(nx, px), math.copysign(ny, py)
        _push(v, work, vine, i, vine.radius_mm - apart, c * nx - s * ny, s * nx + c * ny, 1.0)


@compiled
def _press_corners(x, v, work, boxes, vine, i, b):
    """Push the link before a joint off the corners of a box that lie beside it."""
    ex, ey = x[i, 0] - x[i - 1, 0], x[i, 1] - x[i - 1, 1]
    length = math.hypot(ex, ey)
    ux, uy = ex / length, ey / length
    for corner in range(4):
        px = boxes[b, 4] if corner < 2 else -boxes[b, 4]
        py = boxes[b, 5] if corner % 2 == 0 else -boxes[b, 5]
        gx = boxes[b, 0] + boxes[b, 2] * px - boxes[b, 3] * py - x[i - 1, 0]
        gy = boxes[b, 1] + boxes[b, 3] * px + boxes[b, 2] * py - x[i - 1, 1]
        along, aside = gx * ux + gy * uy, ux * gy - uy * gx
        depth = vine.radius_mm - abs(aside)
        if depth > 0.0 and 0.0 < along < length:
            side = math.copysign(1.0, aside)
            share = along / length
            _push(v, work, vine, i, depth, side * uy, -side * ux, share)
            if i > 1:
                _push(v, work, vine, i - 1, depth, side * uy, -side * ux, 1.0 - share)


@compiled
def _move(x, v, work, vine, count, last, speed):
    """Step all joints but the base, links keeping their lengths; return the worst error of one."""
    step = vine.step_s
    for i in range(1, count):
        v[i, 0] += step * work[i, 0] / work[i, 2]
        v[i, 1] += step * work[i, 1] / work[i, 2]
    v[0, 0] = v[0, 1] = 0.0
    worst = _find_impulses(x, v, work, vine, count, last, speed)
    for i in range(count - 1):
        ex, ey = x[i + 1, 0] - x[i, 0], x[i + 1, 1] - x[i, 1]
        length = math.hypot(ex, ey)
        px, py = work[i, 6] * ex / length, work[i, 6] * ey / length
        if i > 0:
            v[i, 0] -= px / work[i, 2]
            v[i, 1] -= py / work[i, 2]
        v[i + 1, 0] += px / work[i + 1, 2]
        v[i + 1, 1] += py / work[i + 1, 2]
    for i in range(1, count):
        x[i, 0] += step * v[i, 0]
        x[i, 1] += step * v[i, 1]
    return worst


@compiled
def _find_impulses(x, v, work, vine, count, last, speed):
    """Solve for the impulses along the links; return by how much a link is off its length.

    Link i lies between joints i and i + 1, so the system is tridiagonal: elimination forward, then
    back. A tenth of an error in length is taken back at every step.
    """
    worst = bx = by = 0.0
    for i in range(count - 1):
        ex, ey = x[i + 1, 0] - x[i, 0], x[i + 1, 1] - x[i, 1]
        length = math.hypot(ex, ey)
        ex, ey = ex / length, ey / length
        is_tip = i == count - 2
        off = length - (last if is_tip else vine.link_mm)
        worst = max(worst, abs(off))
        rate = (speed if is_tip else 0.0) - 0.1 * off / vine.step_s
        work[i, 3] = rate - (v[i + 1, 0] - v[i, 0]) * ex - (v[i + 1, 1] - v[i, 1]) * ey
        work[i, 4] = 1.0 / work[i + 1, 2]
        if i > 0:
            # The base does not move: it adds nothing to the first link.
            work[i, 4] += 1.0 / work[i, 2]
            beside = -(bx * ex + by * ey) / work[i, 2]
            work[i - 1, 5] = beside
            work[i, 4] -= beside / work[i - 1, 4] * beside
            work[i, 3] -= beside / work[i - 1, 4] * work[i - 1, 3]
        bx, by = ex, ey
    work[count - 2, 6] = work[count - 2, 3] / work[count - 2, 4]
    for i in range(count - 3, -1, -1):
        work[i, 6] = (work[i, 3] - work[i, 5] * work[i + 1, 6]) / work[i, 4]
    return worst
