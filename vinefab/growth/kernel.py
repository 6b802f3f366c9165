"""The compiled growth simulator: event by event, in closed form, without a time step.

`tests/oracles/growth_reference.py` is the same model in plain Python; its `World` has the rules as
methods of the same names.
All that grows a branch is in this file, and it imports no module of vinefab but `core.compiling`:
the cache of a compiled file does not notice changes of another. The arrays are described in
`vinefab.growth.arrays`.

A wall has its free side on the left: its normal is its tangent turned by +90 degrees. A tip that
slides with ``sense`` +1 moves along the tangent and the body turns left; with -1, both reverse.
This follows from the body pressing on the wall, so no small number ever decides a turning sense.

A third of the time goes into branches of the code that the processor cannot foresee. Tests are
therefore joined with ``|`` and ``&``, which take one branch together (`vinefab.core.compiling`),
where the parts cost little. Numbers from the grid index are made unsigned, because signed ones
could count from an array's end. Python can run the same code without compiling it:
`vinefab.growth.batch.chosen_engine`.
"""

import math
from collections import namedtuple
from typing import NamedTuple

import numpy as np

from vinefab.core.compiling import compiled, inlined, takes

# mypy: allow-untyped-defs, allow-untyped-calls, disable-error-code=arg-type
# ruff: noqa: ANN001, ANN202, ANN201, FBT003  numba infers the types of compiled functions
# ruff: noqa: PLR0913, PLR0917  scalars are the compiled way to hand things over


FULL_LENGTH = 0
HEAD_ON = 1
CORNER = 2
NOT_DEPLOYED = 3
PRESSURE = 4
GROWING = -1

_HALVINGS = 60
"""Bisections of a slide until the place where the pressure is used up is known to the last bit."""

TIE_STEPS = 8.0
"""Lengths that differ by up to so many tolerances are equal: a wall that is turned with its map may
be rounded by several."""

NO_WALL = -1
NO_POINT = -1


class TipState(NamedTuple):
    """State of a growing branch.

    Parameters
    ----------
    x, y
        The tip.
    ux, uy
        Heading, from pivot to tip.
    pivot
        Index of the pivot among the chain points.
    wall, place, sense
        Wall that the tip slides on, how far along it, and which way; wall -1 for free growth.
    corner
        Place that free growth just left, -1 if none: its walls are not met again.
    stop
        Why it stopped, or `GROWING`.
    """

    x: float
    y: float
    ux: float
    uy: float
    pivot: int
    wall: int
    place: float
    sense: float
    corner: int
    stop: int


# --- The rules that decide the answer, one function each --------------------------------------


@inlined
def presses(walls, rules, ux, uy, wall):
    """Tell whether a body that points along u presses on a wall: u.n < 0."""
    return ux * -walls.wall[wall, 3] + uy * walls.wall[wall, 2] < -rules.tolerance_rad


@inlined
def is_head_on(walls, rules, ux, uy, wall):
    """Tell whether a tip that meets a wall stops: the angle between u and -n is small.

    An angle equal to the half-angle stops, so that no rounding decides which way a tip slides.
    """
    tx, ty = walls.wall[wall, 2], walls.wall[wall, 3]
    along = abs(ux * tx + uy * ty)
    # An angle is not smaller than its sine: most contacts need no arc tangent.
    if along > rules.head_on_half_angle_rad + 2.0 * rules.tie:
        return False
    against = ux * ty - uy * tx
    return math.atan2(along, against) <= rules.head_on_half_angle_rad + rules.tie


@inlined
def is_split(walls, rules, ux, uy, wall, place):
    """Tell whether a tip meets a convex corner that turns it as much one way as the other."""
    at_end = place >= walls.wall[wall, 4] - rules.tolerance_mm
    if (place > rules.tolerance_mm) & (not at_end):
        return False
    other = np.int64(walls.link[wall, 1] if at_end else walls.link[wall, 0])
    tx, ty = walls.wall[wall, 2], walls.wall[wall, 3]
    nx, ny = -walls.wall[other, 3], walls.wall[other, 2]
    is_convex = (1.0 if at_end else -1.0) * (tx * nx + ty * ny) > 0.0
    return is_convex & (abs(ux * nx + uy * ny - (uy * tx - ux * ty)) <= rules.tie)


@inlined
def slide_sense(walls, ux, uy, wall):
    """Return +1 if the tip slides along the wall's tangent, -1 if against it: sign(u.t)."""
    return 1.0 if ux * walls.wall[wall, 2] + uy * walls.wall[wall, 3] >= 0.0 else -1.0


@inlined
def leaves_at_end(walls, rules, ux, uy, following):
    """Tell whether a tip at a convex end of its wall leaves: it does not press on the next wall."""
    return not presses(walls, rules, ux, uy, following)


@inlined
def is_wedged(walls, rules, wall, sense, first):
    """Tell whether sliding on ``wall`` would drive the tip back into the wall it comes from."""
    sx, sy = sense * walls.wall[wall, 2], sense * walls.wall[wall, 3]
    return sx * -walls.wall[first, 3] + sy * walls.wall[first, 2] <= rules.tolerance_rad


# --- What the tip meets -----------------------------------------------------------------------


@inlined
def _passes_end(walls, rules, dx, dy, wall, at_end, distance):
    """Tell whether a ray through an end of a wall that faces it goes by.

    At a convex corner it does if the other wall of the wedge does not face it. At a point where
    rings touch it may come from another wedge altogether: then this wall is out of its reach.
    """
    other = np.int64(walls.link[wall, 1] if at_end else walls.link[wall, 0])
    outward = 1.0 if at_end else -1.0
    nx, ny = -walls.wall[other, 3], walls.wall[other, 2]
    facing = dx * nx + dy * ny
    is_convex = outward * (walls.wall[wall, 2] * nx + walls.wall[wall, 3] * ny) > 0.0
    if is_convex:
        return facing >= -rules.tolerance_rad
    run_up = min(distance, walls.wall[other, 4])
    return run_up * facing > 4.0 * rules.tolerance_mm


@inlined
def _meeting(walls, rules, ox, oy, dx, dy, wall):
    """Return the distances along a ray and along a wall at which they meet; else infinity.

    A wall within the tolerance of the origin counts as in front of it, at distance zero.
    """
    tx, ty, length = walls.wall[wall, 2], walls.wall[wall, 3], walls.wall[wall, 4]
    facing = dy * tx - dx * ty
    rx, ry = ox - walls.wall[wall, 0], oy - walls.wall[wall, 1]
    height, place = ry * tx - rx * ty, rx * tx + ry * ty
    tolerance = rules.tolerance_mm
    # Distances of the wall's ends from the ray's line, so that no ray slips between two walls.
    to_start = dx * ry - dy * rx
    to_end = -length * facing - to_start
    slips = (to_start < -tolerance) | (to_end < -tolerance)
    behind = (facing >= -rules.tolerance_rad) | (height < -tolerance)
    if behind | ((height > tolerance) & slips):
        return math.inf, 0.0
    if (height <= tolerance) & (-tolerance <= place) & (place <= length + tolerance):
        to_start, to_end = place, length - place
    elif (height <= 0.0) | slips:
        return math.inf, 0.0
    else:
        place -= height / facing * (dx * tx + dy * ty)
    place = min(max(place, 0.0), length)
    distance = (place * tx - rx) * dx + (place * ty - ry) * dy
    if distance < -tolerance:
        # Nearly parallel to the ray, and touched by its line only behind the origin.
        return math.inf, 0.0
    distance = max(0.0, distance)
    passes_start = to_start <= tolerance and _passes_end(
        walls, rules, dx, dy, wall, False, distance
    )
    if passes_start or (
        to_end <= tolerance and _passes_end(walls, rules, dx, dy, wall, True, distance)
    ):
        return math.inf, 0.0
    return distance, place


@inlined
def _nearest_in_cell(walls, rules, ray, skip, cell, best):
    """Improve on the nearest wall found so far with those of one cell.

    ``best`` is (wall, distance, place, facing). Of walls met at the same distance, the one that
    turns the tip least is taken.
    """
    found, nearest, at, gentlest = best
    ox, oy, dx, dy = ray
    first, last = np.uint64(walls.wall_first[cell]), np.uint64(walls.wall_first[cell + 1])
    for k in range(first, last):
        item = np.uint64(walls.wall_item[k])
        start, end = walls.link[item, 2], walls.link[item, 3]
        if (start == skip[0]) | (start == skip[1]) | (end == skip[0]) | (end == skip[1]):
            continue
        distance, place = _meeting(walls, rules, ox, oy, dx, dy, item)
        wall = np.int64(item)
        if (distance > nearest + rules.tolerance_mm) | (wall == found):
            continue
        facing = dy * walls.wall[item, 2] - dx * walls.wall[item, 3]
        ties = (found != NO_WALL) & (distance >= nearest - rules.tolerance_mm)
        gentler = (facing > gentlest) | ((facing == gentlest) & (wall < found))
        if (ties & gentler) | ((not ties) & (distance <= nearest)):
            found, nearest, at, gentlest = wall, distance, place, facing
    return found, nearest, at, gentlest


@inlined
def _wall_ahead(walls, rules, ray, skip, reach):
    """Return the first wall that a ray meets within reach, how far away, and where on the wall.

    Walls that have an end at one of the places in ``skip`` are left out. The ray is followed from
    grid cell to grid cell.
    """
    ox, oy, dx, dy = ray
    cell, per_mm, columns, rows = walls.box[2], walls.box[3], walls.shape[0], walls.shape[1]
    column = min(max(int((ox - walls.box[0]) * per_mm), 0), columns - 1)
    row = min(max(int((oy - walls.box[1]) * per_mm), 0), rows - 1)
    right, up = 1 if dx > 0.0 else -1, 1 if dy > 0.0 else -1
    per_column = cell / abs(dx) if dx != 0.0 else math.inf
    per_row = cell / abs(dy) if dy != 0.0 else math.inf
    edge_x = walls.box[0] + (column + (right > 0)) * cell
    edge_y = walls.box[1] + (row + (up > 0)) * cell
    to_column = (edge_x - ox) / dx if dx != 0.0 else math.inf
    to_row = (edge_y - oy) / dy if dy != 0.0 else math.inf
    best = (NO_WALL, reach, 0.0, 0.0)
    while (column >= 0) & (column < columns) & (row >= 0) & (row < rows):
        best = _nearest_in_cell(walls, rules, ray, skip, row * columns + column, best)
        if min(to_column, to_row) > best[1] + rules.tolerance_mm:
            break
        aside = to_column < to_row
        column += right if aside else 0
        row += 0 if aside else up
        to_column += per_column if aside else 0.0
        to_row += 0.0 if aside else per_row
    return best[0], best[1], best[2]


@inlined
def _sweep_to(walls, rules, vertex, sweep, skip, reach):
    """Return the distance that the tip slides until the turning body meets a vertex.

    Infinity if it never does, if it may as well be left out because it is farther than ``reach``,
    or if the vertex is at one of the places in ``skip``. A vertex that the body touches already
    blocks at once if its solid is on the side that the body turns towards, else not at all.
    """
    px, py, qx, qy, sx, sy, ux, uy, sense = sweep
    vx, vy = walls.vertex[vertex, 0] - px, walls.vertex[vertex, 1] - py
    ahead = sense * (ux * vy - uy * vx)
    along = ux * vx + uy * vy
    closing = sense * (vx * sy - vy * sx)
    # Beyond the wall's line a vertex is out of the body's reach.
    above = sense * ((vy - qy) * sx - (vx - qx) * sy)
    tolerance = rules.tolerance_mm
    swept = sense * (qx * vy - qy * vx)
    is_far = swept > reach * closing * (1.0 + 1e-9)
    out_of_reach = (closing <= 0.0) | (above <= tolerance) | is_far
    place = walls.vertex_point[vertex]
    out = (place == skip[0]) | (place == skip[1]) | (ahead < -tolerance) | (along <= tolerance)
    if out | ((ahead > tolerance) & out_of_reach):
        return math.inf
    if ahead <= tolerance:
        if along > ux * qx + uy * qy + tolerance:
            return math.inf
        solid = sense * (ux * walls.solid[vertex, 1] - uy * walls.solid[vertex, 0])
        return 0.0 if solid > 0.0 else math.inf
    return swept / closing


@inlined
def _first_in_cells(walls, rules, sweep, skip, cells, best):
    """Improve on the first vertex met so far, ``best`` = (vertex, distance, span squared).

    ``cells`` is the first and last of some neighbours in a row. Of vertices met together, the
    farthest from the pivot is taken: the body turns about it.
    """
    found, nearest, farthest = best
    first = np.uint64(walls.vertex_first[cells[0]])
    last = np.uint64(walls.vertex_first[cells[1] + 1])
    for vertex in range(first, last):
        distance = _sweep_to(walls, rules, vertex, sweep, skip, nearest)
        if distance > nearest:
            continue
        vx, vy = walls.vertex[vertex, 0] - sweep[0], walls.vertex[vertex, 1] - sweep[1]
        span = vx * vx + vy * vy
        if (found == NO_POINT) | (distance < nearest) | (span > farthest):
            found, nearest, farthest = np.int64(vertex), distance, span
    return found, nearest, farthest


@inlined
def _band(ax, ay, bx, by, low, high, span):
    """Widen ``span`` to the x that an edge from a to b takes between two heights."""
    if (max(ay, by) < low) | (min(ay, by) > high):
        return span
    one, two = 0.0, 1.0
    if ay != by:
        one = min(max((low - ay) / (by - ay), 0.0), 1.0)
        two = min(max((high - ay) / (by - ay), 0.0), 1.0)
    x_one, x_two = ax + one * (bx - ax), ax + two * (bx - ax)
    return min(span[0], x_one, x_two), max(span[1], x_one, x_two)


@inlined
def _vertex_swept(walls, rules, sweep, skip, reach):
    """Return the first vertex that the body meets while its tip slides as far as ``reach``.

    The body sweeps a triangle; only the vertices in the grid cells under it are tested.
    """
    px, py, qx, qy, sx, sy = sweep[0], sweep[1], sweep[2], sweep[3], sweep[4], sweep[5]
    x, y = px + qx, py + qy
    zx, zy = x + reach * sx, y + reach * sy
    x0, y0, cell, per_mm = walls.box[0], walls.box[1], walls.box[2], walls.box[3]
    columns, rows = walls.shape[0], walls.shape[1]
    margin = 2.0 * rules.tolerance_mm
    bottom = min(max(int((min(py, y, zy) - margin - y0) * per_mm), 0), rows - 1)
    top = min(max(int((max(py, y, zy) + margin - y0) * per_mm), 0), rows - 1)
    left = min(max(int((min(px, x, zx) - margin - x0) * per_mm), 0), columns - 1)
    right = min(max(int((max(px, x, zx) + margin - x0) * per_mm), 0), columns - 1)
    # Under a small triangle it takes longer to leave cells out than to test them.
    is_wide = right > left + 1 and top > bottom
    best = (NO_POINT, reach, 0.0)
    for row in range(bottom, top + 1):
        if is_wide:
            low, high = y0 + row * cell - margin, y0 + (row + 1) * cell + margin
            span = (math.inf, -math.inf)
            span = _band(px, py, x, y, low, high, span)
            span = _band(x, y, zx, zy, low, high, span)
            span = _band(zx, zy, px, py, low, high, span)
            if span[0] > span[1]:
                continue
            left = min(max(int((span[0] - margin - x0) * per_mm), 0), columns - 1)
            right = min(max(int((span[1] + margin - x0) * per_mm), 0), columns - 1)
        cells = (row * columns + left, row * columns + right)
        best = _first_in_cells(walls, rules, sweep, skip, cells, best)
    return best[0], best[1]


@inlined
def _length(dx, dy):
    return math.sqrt(dx * dx + dy * dy)


# --- What ends a slide ------------------------------------------------------------------------


@inlined
def _is_as_long(qx, qy, sx, sy, distance, room):
    """Tell whether the body from the pivot is ``room`` long once its tip has slid some way."""
    zx, zy = qx + distance * sx, qy + distance * sy
    return (room <= 0.0) | (zx * zx + zy * zy >= room * room)


@inlined
def _length_distance(qx, qy, sx, sy, room):
    """Return the distance that the tip slides until the body from the pivot is ``room`` long."""
    along = qx * sx + qy * sy
    short = room * room - qx * qx - qy * qy
    if short <= 0.0:
        return 0.0
    return short / (along + math.sqrt(along * along + short))


@inlined
def _release_distance(growth, tip, base, qx, qy, sx, sy):
    """Return the distance that the tip slides until the body straightens over its last contact.

    Whole growths never get that far: only a free flight can reverse the turning, and then the
    corner that it left blocks the turn first. A body that bows off corners will need the rule.
    """
    if tip.pivot == base or growth.chain_sense[tip.pivot] == tip.sense:
        return math.inf
    ex = growth.points[tip.pivot, 0] - growth.points[tip.pivot - 1, 0]
    ey = growth.points[tip.pivot, 1] - growth.points[tip.pivot - 1, 1]
    closing = tip.sense * (ex * sy - ey * sx)
    if closing <= 0.0:
        return math.inf
    return max(0.0, -tip.sense * (ex * qy - ey * qx)) / closing


@inlined
def _moved(walls, rules, growth, tip, distance):
    """Return the tip after sliding on along its wall."""
    wall = tip.wall
    place = min(max(tip.place + tip.sense * distance, 0.0), walls.wall[wall, 4])
    x = walls.wall[wall, 0] + place * walls.wall[wall, 2]
    y = walls.wall[wall, 1] + place * walls.wall[wall, 3]
    ux, uy = _heading(walls, rules, growth, tip, x, y)
    return TipState(x, y, ux, uy, tip.pivot, wall, place, tip.sense, NO_POINT, GROWING)


@inlined
def _heading(walls, rules, growth, tip, x, y):
    """Return the heading of a body whose tip has slid to (x, y): from pivot to tip.

    Rounding would turn a short body. Hence one no longer than `TIE_STEPS` tolerances keeps its
    heading, and one that begins on its tip's wall lies along it.
    """
    qx, qy = x - growth.points[tip.pivot, 0], y - growth.points[tip.pivot, 1]
    reach, near = _length(qx, qy), TIE_STEPS * rules.tolerance_mm
    if reach <= near:
        return tip.ux, tip.uy
    tx, ty = walls.wall[tip.wall, 2], walls.wall[tip.wall, 3]
    if abs(qx * ty - qy * tx) <= near:
        return tip.sense * tx, tip.sense * ty
    return qx / reach, qy / reach


@inlined
def _stopped(tip, stop):
    return TipState(
        tip.x, tip.y, tip.ux, tip.uy, tip.pivot, tip.wall, tip.place, tip.sense, NO_POINT, stop
    )


@inlined
def _meet(walls, rules, tip, wall, place):
    """Return the tip after meeting a wall: stopped, or about to slide on it."""
    if tip.wall != NO_WALL and not presses(walls, rules, tip.ux, tip.uy, wall):
        return _stopped(tip, CORNER)
    if is_head_on(walls, rules, tip.ux, tip.uy, wall) or is_split(
        walls, rules, tip.ux, tip.uy, wall, place
    ):
        return _stopped(tip, HEAD_ON)
    sense = slide_sense(walls, tip.ux, tip.uy, wall)
    if tip.wall != NO_WALL and is_wedged(walls, rules, wall, sense, tip.wall):
        return _stopped(tip, CORNER)
    x = walls.wall[wall, 0] + place * walls.wall[wall, 2]
    y = walls.wall[wall, 1] + place * walls.wall[wall, 3]
    return TipState(x, y, tip.ux, tip.uy, tip.pivot, wall, place, sense, NO_POINT, GROWING)


@inlined
def _reach_end(walls, rules, tip):
    """Return the tip after reaching the end of its wall: on the next wall, free, or stopped."""
    wall, forward = tip.wall, tip.sense > 0.0
    following = np.int64(walls.link[wall, 1] if forward else walls.link[wall, 0])
    point = np.int64(walls.link[wall, 3] if forward else walls.link[wall, 2])
    # A wall ends where the following one starts.
    x = walls.wall[following, 0] if forward else walls.wall[wall, 0]
    y = walls.wall[following, 1] if forward else walls.wall[wall, 1]
    nx, ny = -walls.wall[following, 3], walls.wall[following, 2]
    opens = tip.sense * (walls.wall[wall, 2] * nx + walls.wall[wall, 3] * ny)
    place = 0.0 if forward else walls.wall[following, 4]
    at_end = TipState(x, y, tip.ux, tip.uy, tip.pivot, wall, tip.place, tip.sense, point, GROWING)
    if opens <= 0.0:
        return _meet(walls, rules, at_end, following, place)
    if leaves_at_end(walls, rules, tip.ux, tip.uy, following):
        return TipState(x, y, tip.ux, tip.uy, tip.pivot, NO_WALL, 0.0, 0.0, point, GROWING)
    return TipState(x, y, tip.ux, tip.uy, tip.pivot, following, place, tip.sense, NO_POINT, GROWING)


# --- The two kinds of growth ------------------------------------------------------------------


@inlined
def _grow_free(walls, rules, growth, tip, length):
    """Return the tip after growing along its heading as far as possible (rule 1)."""
    px, py = growth.points[tip.pivot, 0], growth.points[tip.pivot, 1]
    room = length - growth.chain_length[tip.pivot]
    left = room - _length(tip.x - px, tip.y - py)
    ray = (tip.x, tip.y, tip.ux, tip.uy)
    wall, distance, place = _wall_ahead(walls, rules, ray, (tip.corner, tip.corner), left)
    if wall == NO_WALL:
        x, y = px + room * tip.ux, py + room * tip.uy
        return TipState(x, y, tip.ux, tip.uy, tip.pivot, NO_WALL, 0.0, 0.0, NO_POINT, FULL_LENGTH)
    x = walls.wall[wall, 0] + place * walls.wall[wall, 2]
    y = walls.wall[wall, 1] + place * walls.wall[wall, 3]
    arrived = TipState(x, y, tip.ux, tip.uy, tip.pivot, NO_WALL, 0.0, 0.0, NO_POINT, GROWING)
    if distance >= left - TIE_STEPS * rules.tolerance_mm:
        return _stopped(arrived, FULL_LENGTH)
    return _meet(walls, rules, arrived, wall, place)


@inlined
def _wrapped(walls, growth, tip, vertex):
    """Return the tip with a vertex as its new pivot; the turning sense is remembered."""
    px, py = growth.points[tip.pivot, 0], growth.points[tip.pivot, 1]
    vx, vy = walls.vertex[vertex, 0], walls.vertex[vertex, 1]
    pivot = tip.pivot + 1
    growth.points[pivot, 0], growth.points[pivot, 1] = vx, vy
    step = _length(vx - px, vy - py)
    growth.chain_length[pivot] = growth.chain_length[pivot - 1] + step
    growth.chain_sense[pivot] = int(tip.sense)
    return _with_pivot(tip, pivot)


@inlined
def _with_pivot(tip, pivot):
    return TipState(
        tip.x, tip.y, tip.ux, tip.uy, pivot, tip.wall, tip.place, tip.sense, NO_POINT, GROWING
    )


@inlined
def _slide(walls, rules, growth, tip, base, length):
    """Return the tip after sliding to the next event (rule 2)."""
    wall, sense = tip.wall, tip.sense
    sx, sy = sense * walls.wall[wall, 2], sense * walls.wall[wall, 3]
    px, py = growth.points[tip.pivot, 0], growth.points[tip.pivot, 1]
    qx, qy = tip.x - px, tip.y - py
    ux, uy = _heading(walls, rules, growth, tip, tip.x, tip.y)
    to_end = walls.wall[wall, 4] - tip.place if sense > 0.0 else tip.place
    room_left = length - growth.chain_length[tip.pivot]
    # What happens just as the length is used up does not happen any more (`TIE_STEPS`).
    room = room_left - TIE_STEPS * rules.tolerance_mm
    to_length = math.inf
    if _is_as_long(qx, qy, sx, sy, to_end, room):
        to_length = _length_distance(qx, qy, sx, sy, room_left)
    reach = min(to_length, to_end)
    ends = (np.int64(walls.link[wall, 2]), np.int64(walls.link[wall, 3]))
    hit, to_hit = NO_WALL, reach
    # Walls do not cross: only one that another all but touches can be blocked before its end.
    if walls.link[wall, 4] != 0:
        hit, to_hit, _ = _wall_ahead(walls, rules, (tip.x, tip.y, sx, sy), ends, reach)
    to_release = _release_distance(growth, tip, base, qx, qy, sx, sy)
    sweep = (px, py, qx, qy, sx, sy, ux, uy, sense)
    reach = min(reach, to_hit, to_release)
    vertex, reach = _vertex_swept(walls, rules, sweep, ends, reach)
    tip = _moved(walls, rules, growth, tip, reach)
    if (to_length < math.inf) and _is_as_long(qx, qy, sx, sy, reach, room):
        return _stopped(tip, FULL_LENGTH)
    if to_release <= reach:
        return _with_pivot(tip, tip.pivot - 1)
    if vertex != NO_POINT:
        return _wrapped(walls, growth, tip, vertex)
    if hit != NO_WALL:
        rx, ry = tip.x - walls.wall[hit, 0], tip.y - walls.wall[hit, 1]
        along = rx * walls.wall[hit, 2] + ry * walls.wall[hit, 3]
        return _meet(walls, rules, tip, hit, min(max(along, 0.0), walls.wall[hit, 4]))
    return _reach_end(walls, rules, tip)


# --- Pressure ---------------------------------------------------------------------------------

# Film that goes to the tip is drawn along the path: each straight part adds drag, each turn
# multiplies the tension behind it (the capstan effect, `vinefab.physics.growth_pressure`). Turns
# count net: at a base, the angle from the parent's last heading to the first stretch.


@inlined
def _capstan(growth, rules, base, before, pivot, ux, uy):
    """Return the factor of the turn at a pivot, for a body that continues along u.

    ``before`` is the heading with which the film comes to the base.
    """
    ix, iy = before
    if pivot > base:
        ix = growth.points[pivot, 0] - growth.points[pivot - 1, 0]
        iy = growth.points[pivot, 1] - growth.points[pivot - 1, 1]
    return math.exp(rules.friction * math.atan2(abs(ix * uy - iy * ux), ix * ux + iy * uy))


@inlined
def _tension(growth, rules, film, tip, x, y, ux, uy):
    """Return the tension of the film at a tip (x, y) that points along u.

    ``film`` is (base, heading before it, tension in the store, limit).
    """
    base, before, store, _ = film
    turned = _capstan(growth, rules, base, before, tip.pivot, ux, uy)
    held = store * growth.chain_gain[tip.pivot] + rules.drag_kpa_mm * growth.chain_drawn[tip.pivot]
    qx, qy = x - growth.points[tip.pivot, 0], y - growth.points[tip.pivot, 1]
    return turned * held + rules.drag_kpa_mm * _length(qx, qy)


@inlined
def _held_at(tip, x, y, ux, uy):
    return TipState(x, y, ux, uy, tip.pivot, tip.wall, tip.place, tip.sense, NO_POINT, PRESSURE)


@inlined
def _straight_to_limit(growth, rules, film, tip, x, y, ux, uy):
    """Return the tip where going along u to (x, y) has used up the pressure: linear in length.

    Where the pressure does not suffice to turn into u, the tip keeps its place and heading.
    """
    px, py = growth.points[tip.pivot, 0], growth.points[tip.pivot, 1]
    tension = _tension(growth, rules, film, tip, px, py, ux, uy)
    reach = min((film[3] - tension) / rules.drag_kpa_mm, _length(x - px, y - py))
    if reach <= _length(tip.x - px, tip.y - py) + rules.tolerance_mm:
        return _held_at(tip, tip.x, tip.y, tip.ux, tip.uy)
    return _held_at(tip, px + reach * ux, py + reach * uy, ux, uy)


@inlined
def _slid_to_limit(walls, growth, rules, film, tip, x, y):
    """Return the tip where a slide to (x, y) has used up the pressure.

    The tension is convex in the way slid while the body turns back towards the heading before the
    pivot, and rises after that: it passes the limit once.
    """
    low, high = 0.0, 1.0
    for _ in range(_HALVINGS):
        share = 0.5 * (low + high)
        at_x, at_y = tip.x + share * (x - tip.x), tip.y + share * (y - tip.y)
        ux, uy = _heading(walls, rules, growth, tip, at_x, at_y)
        if _tension(growth, rules, film, tip, at_x, at_y, ux, uy) <= film[3]:
            low = share
        else:
            high = share
    at_x, at_y = tip.x + low * (x - tip.x), tip.y + low * (y - tip.y)
    ux, uy = _heading(walls, rules, growth, tip, at_x, at_y)
    return _held_at(tip, at_x, at_y, ux, uy)


@inlined
def _is_used_up(rules, film, tension):
    """Tell whether a tension is more than the pressure everts; just as much is not."""
    return tension > film[3] * (1.0 + rules.tie)


@inlined
def _within_pressure(walls, growth, rules, film, tip, after):
    """Return the tip after an event, or where on the way the pressure was used up."""
    if film[3] == math.inf:
        return after
    ux, uy = tip.ux, tip.uy
    if tip.wall != NO_WALL:
        ux, uy = _heading(walls, rules, growth, tip, after.x, after.y)
    tension = _tension(growth, rules, film, tip, after.x, after.y, ux, uy)
    if _is_used_up(rules, film, tension):
        px, py = growth.points[tip.pivot, 0], growth.points[tip.pivot, 1]
        if tip.wall == NO_WALL:
            return _straight_to_limit(growth, rules, film, tip, after.x, after.y, ux, uy)
        if _length(tip.x - px, tip.y - py) <= rules.tolerance_mm:
            # A body that slides from its pivot on lies along the wall from the beginning.
            sx, sy = tip.sense * walls.wall[tip.wall, 2], tip.sense * walls.wall[tip.wall, 3]
            return _straight_to_limit(growth, rules, film, tip, after.x, after.y, sx, sy)
        return _slid_to_limit(walls, growth, rules, film, tip, after.x, after.y)
    if after.pivot > tip.pivot:
        turned = _capstan(growth, rules, film[0], film[1], tip.pivot, ux, uy)
        step = growth.chain_length[after.pivot] - growth.chain_length[tip.pivot]
        growth.chain_gain[after.pivot] = growth.chain_gain[tip.pivot] * turned
        growth.chain_drawn[after.pivot] = growth.chain_drawn[tip.pivot] * turned + step
    return after


@inlined
def _film_at_base(tree, start, growth, branch):
    """Return the film of a branch at its base, as `_tension` takes it."""
    base, parent, limit = growth.first_point[branch], tree.parent[branch], tree.limit[branch]
    if limit == math.inf:
        return base, (0.0, 0.0), 0.0, limit
    if parent < 0:
        growth.chain_gain[base], growth.chain_drawn[base] = 1.0, 0.0
        return base, (start[2], start[3]), tree.store[branch], limit
    growth.chain_gain[base] = growth.gain[parent]
    growth.chain_drawn[base] = growth.drawn[parent]
    before = (growth.heading[parent, 0], growth.heading[parent, 1])
    return base, before, tree.store[branch], limit


# --- A branch, and the tree -------------------------------------------------------------------


@inlined
def _turning(rules, growth, first, last, ux, uy):
    """Return the sum of absolute turns along a chain that was launched along u.

    Steps as short as rounding have no direction, and are left out.
    """
    total = 0.0
    for k in range(first, last):
        dx = growth.points[k + 1, 0] - growth.points[k, 0]
        dy = growth.points[k + 1, 1] - growth.points[k, 1]
        if _length(dx, dy) > TIE_STEPS * rules.tolerance_mm:
            total += math.atan2(abs(ux * dy - uy * dx), ux * dx + uy * dy)
            ux, uy = dx, dy
    return total


@inlined
def _record(growth, branch, tip, length):
    """Write how a branch ended."""
    last = tip.pivot + 1
    px, py = growth.points[tip.pivot, 0], growth.points[tip.pivot, 1]
    step = _length(tip.x - px, tip.y - py)
    growth.points[last, 0], growth.points[last, 1] = tip.x, tip.y
    growth.first_point[branch + 1] = last + 1
    growth.stop[branch] = tip.stop
    growth.grown[branch] = length
    if tip.stop != FULL_LENGTH:
        growth.grown[branch] = min(length, growth.chain_length[tip.pivot] + step)
    growth.heading[branch, 0], growth.heading[branch, 1] = tip.ux, tip.uy


@inlined
def _grow_branch(walls, tree, rules, start, growth, branch):
    """Grow and record one branch; return False if the chain points need more room."""
    base, length = growth.first_point[branch], tree.length[branch]
    room = len(growth.points)
    if base + 2 > room:
        return False
    x, y, hx, hy = start
    parent = tree.parent[branch]
    if parent >= 0:
        foot = growth.first_point[parent + 1] - 1
        x, y = growth.points[foot, 0], growth.points[foot, 1]
        hx, hy = growth.heading[parent, 0], growth.heading[parent, 1]
    cosine, sine = tree.turn[branch, 0], tree.turn[branch, 1]
    ux, uy = hx * cosine - hy * sine, hx * sine + hy * cosine
    growth.points[base, 0], growth.points[base, 1] = x, y
    growth.chain_length[base] = 0.0
    tip = TipState(x, y, ux, uy, base, NO_WALL, 0.0, 0.0, NO_POINT, GROWING)
    film = _film_at_base(tree, start, growth, branch)
    is_fed = film[3] != math.inf
    if is_fed and _is_used_up(rules, film, _tension(growth, rules, film, tip, x, y, ux, uy)):
        tip = _stopped(tip, PRESSURE)
    events = 0
    while tip.stop == GROWING and events < rules.most_events:
        # A wrap takes one more point, and the tip one after that.
        if tip.pivot + 3 > room:
            return False
        before = tip
        if tip.wall == NO_WALL:
            tip = _grow_free(walls, rules, growth, tip, length)
        else:
            tip = _slide(walls, rules, growth, tip, base, length)
        tip = _within_pressure(walls, growth, rules, film, before, tip)
        events += 1
    if tip.stop == GROWING:
        tip = _stopped(tip, CORNER)
    if is_fed:  # what the path does to the tension of film that is drawn along it
        turned = _capstan(growth, rules, film[0], film[1], tip.pivot, tip.ux, tip.uy)
        qx, qy = tip.x - growth.points[tip.pivot, 0], tip.y - growth.points[tip.pivot, 1]
        growth.gain[branch] = growth.chain_gain[tip.pivot] * turned
        growth.drawn[branch] = growth.chain_drawn[tip.pivot] * turned + _length(qx, qy)
    growth.events[branch] = events
    _record(growth, branch, tip, length)
    # A single event is a flight: straight.
    growth.turn[branch] = 0.0
    if events > 1:
        growth.turn[branch] = _turning(rules, growth, base, tip.pivot + 1, ux, uy)
    return True


@compiled
def grow_branches(walls, tree, fits, rules, start, growth, first, last):
    """Grow the branches ``first .. last - 1`` of a tree, parents before children.

    Parameters
    ----------
    walls, tree, fits, rules, start
        See `vinefab.growth.arrays`.
    growth
        Where the result goes; ``growth.first_point[first]`` says where its chain points begin.
    first, last
        Which branches to grow.

    Returns
    -------
    int
        ``last``, or the branch for which ``growth.points`` had too little room: give it more and
        go on from there.
    """
    for branch in range(first, last):
        parent = tree.parent[branch]
        emerges = parent < 0 or growth.stop[parent] == FULL_LENGTH
        if not emerges and rules.deploys_stuck:
            emerges = growth.stop[parent] != NOT_DEPLOYED
        if not (emerges and fits[branch]):
            growth.first_point[branch + 1] = growth.first_point[branch]
            growth.stop[branch] = NOT_DEPLOYED
        elif not _grow_branch(walls, tree, rules, start, growth, branch):
            return branch
    return last


# --- Many trees on many maps ------------------------------------------------------------------

# Parts of a batch, with the names that `vinefab.growth.arrays` gives them.
_Walls = namedtuple(
    "_Walls",
    "wall link vertex solid vertex_point box shape wall_first wall_item vertex_first",
)
_Tree = namedtuple("_Tree", "parent turn length limit store")
_Rules = namedtuple(
    "_Rules",
    "head_on_half_angle_rad deploys_stuck tolerance_mm tolerance_rad tie most_events friction "
    "drag_kpa_mm",
)
_Growth = namedtuple(
    "_Growth",
    "points first_point stop grown turn heading events gain drawn chain_length chain_sense "
    "chain_gain chain_drawn",
)


@inlined
def _page(atlas, page):
    """Return the walls of one page of an atlas."""
    walls, one, two = atlas.walls, atlas.offset[page], atlas.offset[page + 1]
    return _Walls(
        walls.wall[one[0] : two[0]],
        walls.link[one[0] : two[0]],
        walls.vertex[one[1] : two[1]],
        walls.solid[one[1] : two[1]],
        walls.vertex_point[one[1] : two[1]],
        walls.box[page],
        walls.shape[page],
        walls.wall_first[one[2] : two[2]],
        walls.wall_item[one[3] : two[3]],
        walls.vertex_first[one[2] : two[2]],
    )


@inlined
def _tree_of(trees, jobs, job):
    """Return the tree of one job."""
    first, last = trees.first[jobs.tree[job]], trees.first[jobs.tree[job] + 1]
    return _Tree(
        trees.parent[first:last],
        trees.turn[first:last],
        trees.length[first:last],
        trees.limit[first:last],
        trees.store[first:last],
    )


@inlined
def _growth_of(jobs, growth, job):
    """Return the part of a growth that belongs to one job."""
    first, last = jobs.branch[job], jobs.branch[job + 1]
    one, two = jobs.room[job], jobs.room[job + 1]
    return _Growth(
        growth.points[one:two],
        growth.first_point[first + job : last + job + 1],
        growth.stop[first:last],
        growth.grown[first:last],
        growth.turn[first:last],
        growth.heading[first:last],
        growth.events[first:last],
        growth.gain[first:last],
        growth.drawn[first:last],
        growth.chain_length[one:two],
        growth.chain_sense[one:two],
        growth.chain_gain[one:two],
        growth.chain_drawn[one:two],
    )


# Types of arguments, see `takes`.
_ATLAS = (
    "vinefab.growth.arrays:TerrainSetArrays("
    "vinefab.growth.arrays:WallArrays(f2r j2r f2r f2r j1r f2r i2r j1r j1r j1r) f1r i2r)"
)
_TREES = "vinefab.growth.arrays:TreesArrays(i1r f2r f1r f1r f1r i1r)"
_RULES = "vinefab.growth.arrays:Rules(f b f f f i f f)"
_JOBS = "vinefab.growth.arrays:JobArrays(i1 i1 f2 f1 b1 i1 i1 i1 i1)"
_GROWTH = "vinefab.growth.arrays:Growth(f2 i1 i1 f1 f1 f2 i1 f1 f1 f1 i1 f1 f1)"


@compiled
@takes(f"{_ATLAS} {_TREES} {_RULES} {_JOBS} {_GROWTH} i i", seconds=7.1)
def grow_jobs(atlas, trees, rules, jobs, growth, first, last):
    """Grow one span of branches of each of the jobs ``first .. last - 1``.

    Parameters
    ----------
    atlas, trees, rules, jobs
        See `vinefab.growth.arrays`; ``jobs.done`` is written to.
    growth
        Where the results go, job by job.
    first, last
        Which jobs to do. Jobs share nothing that is written to, so that several threads may each
        do some of them.
    """
    for job in range(first, last):
        start = jobs.start[job]
        here = _Rules(
            jobs.half_angle[job],
            rules.deploys_stuck,
            atlas.tolerance[jobs.page[job]],
            rules.tolerance_rad,
            rules.tie,
            rules.most_events,
            rules.friction,
            rules.drag_kpa_mm,
        )
        jobs.done[job] = grow_branches(
            _page(atlas, jobs.page[job]),
            _tree_of(trees, jobs, job),
            jobs.fits[jobs.branch[job] : jobs.branch[job + 1]],
            here,
            (start[0], start[1], start[2], start[3]),
            _growth_of(jobs, growth, job),
            jobs.done[job],
            jobs.until[job],
        )


# --- The cost of one test: the benchmark's floor ----------------------------------------------


@compiled
def meet_all(walls, rules, rays, wall):
    """Test rays against walls, one each, and return the sum of the finite distances.

    Parameters
    ----------
    walls, rules
        As in `grow_branches`.
    rays
        Origins and directions, shape (n, 4).
    wall
        The walls' numbers, shape (n,).
    """
    total = 0.0
    for k in range(len(wall)):
        ray = rays[k]
        distance, _ = _meeting(walls, rules, ray[0], ray[1], ray[2], ray[3], wall[k])
        if distance < math.inf:
            total += distance
    return total


@compiled
def sweep_all(walls, rules, sweeps, vertex):
    """Test turning bodies against vertices, one each, and return the sum of the finite distances.

    Parameters
    ----------
    walls, rules
        As in `grow_branches`.
    sweeps
        Pivot, tip from the pivot, direction of sliding, heading, sense, the two places to leave
        out, and the reach; shape (n, 12).
    vertex
        The vertices' numbers, shape (n,).
    """
    total = 0.0
    for k in range(len(vertex)):
        s = sweeps[k]
        sweep = (s[0], s[1], s[2], s[3], s[4], s[5], s[6], s[7], s[8])
        skip = np.int64(s[9]), np.int64(s[10])
        distance = _sweep_to(walls, rules, vertex[k], sweep, skip, s[11])
        if distance < math.inf:
            total += distance
    return total
