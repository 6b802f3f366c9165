"""Compiled measure of the area that sensors see past walls, line by line, and the walls by cells.

The arrays are described in `vinefab.tasks.fast_areas`. Walls have free
space on their left.
"""

import math

from vinefab.core.compiling import compiled, inlined

# mypy: allow-untyped-defs, allow-untyped-calls
# ruff: noqa: ANN001, ANN202, ANN201  numba infers the types of compiled functions
# ruff: noqa: PLR0913, PLR0917  arrays are the compiled way to hand things over


NOTHING = -1


# --- Walls by cells ---------------------------------------------------------------------------


@compiled
def count_walls(walls, grid, reach, number):
    """Add up how many walls come within a distance of each cell.

    Parameters
    ----------
    walls, grid
        As in `fast_areas.WallCells`, mm.
    reach
        The distance, mm.
    number
        Where the result goes, row by row; zeros.
    """
    for e in range(len(walls)):
        lowest, highest = _rows(walls[e], grid, reach)
        for row in range(lowest, highest + 1):
            left, right = _columns(walls[e], grid, row, reach)
            for column in range(left, right + 1):
                number[row * int(grid[3]) + column] += 1


@compiled
def place_walls(walls, grid, reach, free, item):
    """List the walls within a distance of each cell.

    Parameters
    ----------
    walls, grid, reach
        As in `count`.
    free
        Where the walls of each cell begin; counted up.
    item
        Where the walls go, in rising order in each cell.
    """
    for e in range(len(walls)):
        lowest, highest = _rows(walls[e], grid, reach)
        for row in range(lowest, highest + 1):
            left, right = _columns(walls[e], grid, row, reach)
            for column in range(left, right + 1):
                cell = row * int(grid[3]) + column
                item[free[cell]] = e
                free[cell] += 1


@inlined
def _rows(wall, grid, reach):
    """Return the first and the last row of cells that a wall comes near."""
    low, high = min(wall[1], wall[3]) - reach, max(wall[1], wall[3]) + reach
    lowest = max(math.floor((low - grid[1]) / grid[2]), 0)
    return lowest, min(math.floor((high - grid[1]) / grid[2]), int(grid[4]) - 1)


@inlined
def _columns(wall, grid, row, reach):
    """Return the first and the last cell of a row that a wall comes near; at most some too many."""
    ax, ay, dx, dy = wall[0], wall[1], wall[2] - wall[0], wall[3] - wall[1]
    low, high = grid[1] + row * grid[2] - reach, grid[1] + (row + 1) * grid[2] + reach
    # The part of the wall that is near enough in y bounds what can be near in x.
    first, last = 0.0, 1.0
    if dy != 0.0:
        one, two = (low - ay) / dy, (high - ay) / dy
        first, last = max(0.0, min(one, two)), min(1.0, max(one, two))
    x_one, x_two = ax + first * dx, ax + last * dx
    left = max(math.floor((min(x_one, x_two) - reach - grid[0]) / grid[2]), 0)
    right = math.floor((max(x_one, x_two) + reach - grid[0]) / grid[2])
    return left, min(right, int(grid[3]) - 1)


# --- Sensors on lines -------------------------------------------------------------------------


@compiled
def seen_areas_by_lines(
    tips, first, sensor, walls, grid, cell_first, item, line, near, index, begins, run, seen, summed
):
    """Compute the area that sensors see together, and the sum of the areas that each sees.

    What a sensor sees of a line is the chord that its disc cuts out, minus the shadows of walls.
    Every line stands for a strip about it.

    Parameters
    ----------
    tips
        The sensors, set after set, mm; shape (m, 2); places on walls are moved off them.
    first
        Where each set begins, shape (j + 1,).
    sensor
        How far sensors see, how near a wall counts as touched, and how far off it a sensor is
        moved then, mm; shape (3,).
    walls, grid, cell_first, item
        As in `fast_areas.WallCells`: walls that can hide something from a sensor in each
        cell, mm.
    line
        Lower side of the lowest strip, and how high each is, mm; shape (2,).
    near
        Working room: ends of the walls before each sensor of a set, as seen from it; shape (w, 4).
    index
        Working room: next sensor whose disc begins at the same line, last line of each, sensors
        of the line in order, where the walls of each begin; shape (4, n + 1).
    begins
        Working room: first sensor whose disc begins at each line, shape (lines,).
    run
        Working room: ends of the stretches of a line that are seen, shape (2, w + n).
    seen, summed
        Where the results go, mm2; shape (j,).
    """
    for j in range(len(seen)):
        own = tips[first[j] : first[j + 1]]
        index[3, 0] = 0
        for k in range(len(own)):
            begin, end = _cell(own[k, 0], own[k, 1], grid, cell_first)
            walls_here = item[begin:end]
            _step_off(own[k], sensor, walls, walls_here)
            index[3, k + 1] = _facing_walls(own[k], sensor[0], walls, walls_here, near, index[3, k])
        seen[j], summed[j] = _see_one(own, sensor[0], line, near, index, begins, run)


@inlined
def _cell(x, y, grid, cell_first):
    """Return where the walls of the cell of a place begin and end."""
    column = min(max(int((x - grid[0]) / grid[2]), 0), int(grid[3]) - 1)
    row = min(max(int((y - grid[1]) / grid[2]), 0), int(grid[4]) - 1)
    at = row * int(grid[3]) + column
    return cell_first[at], cell_first[at + 1]


@inlined
def _square_from(x, y, wall):
    """Return the square of the distance of a wall from a place."""
    ax, ay, dx, dy = wall[0] - x, wall[1] - y, wall[2] - wall[0], wall[3] - wall[1]
    share = min(max(-(ax * dx + ay * dy) / (dx * dx + dy * dy), 0.0), 1.0)
    ax, ay = ax + share * dx, ay + share * dy
    return ax * ax + ay * ay


@inlined
def _step_off(tip, sensor, walls, items):
    """Move a sensor off the walls that it lies on, into the middle of the widest wedge there."""
    x, y, near = tip[0], tip[1], sensor[1]
    widest, ux, uy = 0.0, 0.0, 0.0
    for e in items:
        leaves = math.hypot(walls[e, 2] - x, walls[e, 3] - y) > near
        if leaves and _square_from(x, y, walls[e]) < near * near:
            wedge = _wedge(x, y, near, e, walls, items)
            if wedge > widest:
                widest, ux, uy = wedge, walls[e, 2] - walls[e, 0], walls[e, 3] - walls[e, 1]
    if widest > 0.0:
        step = sensor[2] / math.hypot(ux, uy)
        along, aside = step * math.cos(0.5 * widest), step * math.sin(0.5 * widest)
        tip[0] += along * ux - aside * uy
        tip[1] += along * uy + aside * ux


@inlined
def _wedge(x, y, near, leaving, walls, items):
    """Return the angle from a wall that leaves a place to the next one that arrives there."""
    ux, uy = walls[leaving, 2] - walls[leaving, 0], walls[leaving, 3] - walls[leaving, 1]
    least = 2.0 * math.pi
    for e in items:
        arrives = math.hypot(walls[e, 0] - x, walls[e, 1] - y) > near
        if arrives and _square_from(x, y, walls[e]) < near * near:
            vx, vy = walls[e, 0] - walls[e, 2], walls[e, 1] - walls[e, 3]
            angle = math.atan2(ux * vy - uy * vx, ux * vx + uy * vy)
            least = min(least, angle if angle > 0.0 else angle + 2.0 * math.pi)
    return least


@inlined
def _facing_walls(tip, radius, walls, items, near, at):
    """Append the walls that a sensor may see to ``near``; return where they end."""
    x, y = tip[0], tip[1]
    for e in items:
        ax, ay, bx, by = walls[e, 0] - x, walls[e, 1] - y, walls[e, 2] - x, walls[e, 3] - y
        # Only walls that face the sensor hide anything: what is beyond others is hidden already.
        if ax * by - ay * bx > 0.0 and _square_from(x, y, walls[e]) < radius * radius:
            near[at, 0], near[at, 1], near[at, 2], near[at, 3] = ax, ay, bx, by
            at += 1
    return at


@inlined
def _begin(tips, radius, line, index, begins):
    """Sort sensors by the line that their discs begin at; return the first and last line of all."""
    lines, lowest, highest = len(begins), len(begins), -1
    for row in range(lines):
        begins[row] = NOTHING
    for k in range(len(tips)):
        y = tips[k, 1] - line[0]
        begin = max(math.ceil((y - radius) / line[1] - 0.5), 0)
        end = min(math.floor((y + radius) / line[1] - 0.5), lines - 1)
        if begin <= end:
            index[0, k], index[1, k] = begins[begin], end
            begins[begin] = k
            lowest, highest = min(lowest, begin), max(highest, end)
    return lowest, highest


@inlined
def _insert(order, tips, active, k):
    """Add a sensor to those of the line, which are in the order of their x."""
    at = active
    while at > 0 and tips[order[at - 1], 0] > tips[k, 0]:
        order[at] = order[at - 1]
        at -= 1
    order[at] = k


@inlined
def _see_one(tips, radius, line, near, index, begins, run):
    """Return the area that one set of sensors sees, and the sum over the sensors."""
    order, until, first = index[2], index[1], index[3]
    lowest, highest = _begin(tips, radius, line, index, begins)
    seen, summed, active = 0.0, 0.0, 0
    for row in range(lowest, highest + 1):
        k = begins[row]
        while k != NOTHING:
            _insert(order, tips, active, k)
            active += 1
            k = index[0, k]
        y = line[0] + (row + 0.5) * line[1]
        kept, runs = 0, 0
        for place_in_order in range(active):
            k = order[place_in_order]
            before = runs
            walls = near[first[k] : first[k + 1]]
            runs += _stretches(tips[k, 0], y - tips[k, 1], radius, walls, run[:, before:])
            for i in range(before, runs):
                summed += run[1, i] - run[0, i]
            order[kept] = k
            kept += until[k] > row
        seen += _union(run[0], run[1], runs)
        active = kept
    return seen * line[1], summed * line[1]


@inlined
def _stretches(x, ahead, radius, walls, run):
    """Compute the stretches of a line that a sensor sees, from left to right.

    Parameters
    ----------
    x
        Of the sensor.
    ahead
        How far the line is from it, upwards.
    radius
        How far it sees.
    walls
        Ends of walls as seen from it, clockwise end first; shape (w, 4).
    run
        Where the stretches' ends go.

    Returns
    -------
    int
        Number of stretches.
    """
    if abs(ahead) < 1e-9 * radius:
        ahead = 1e-9 * radius
    square = radius * radius - ahead * ahead
    if square <= 0.0:
        return 0
    half = math.sqrt(square)
    run[0, 0], run[1, 0] = -half, half
    runs, per = 1, 1.0 / ahead
    for e in range(len(walls)):
        # How far from the sensor to the line the ends are.
        one, two = walls[e, 1] * per, walls[e, 3] * per
        if max(one, two) > 0.0 and min(one, two) < 1.0:
            begin = _shadow_end(walls[e, 0], one, walls[e, 2], two, ahead)
            end = _shadow_end(walls[e, 2], two, walls[e, 0], one, -ahead)
            runs = _minus(run[0], run[1], runs, min(begin, end), max(begin, end))
    for i in range(runs):
        run[0, i] += x
        run[1, i] += x
    return runs


@inlined
def _shadow_end(x, share, other_x, other_share, side):
    """Return where the shadow of one end of a wall lies on a line.

    Parameters
    ----------
    x, share
        Of the end, as seen from the sensor, and how far from the sensor to the line it is.
    other_x, other_share
        Of the other end, which is not beyond the line if this one is.
    side
        Above 0 where shadows of such ends run to the right when they run out of sight.
    """
    if share >= 1.0:
        return x + (other_x - x) * (share - 1.0) / (share - other_share)
    if share > 0.0:
        return x / share
    return math.inf if side > 0.0 else -math.inf


@inlined
def _minus(left, right, runs, one, two):
    """Take a stretch away from disjoint ones in rising order; return their number."""
    kept = 0
    for i in range(runs):
        begin, end = left[i], right[i]
        if begin < one and two < end:
            for k in range(runs, i + 1, -1):
                left[k], right[k] = left[k - 1], right[k - 1]
            right[i], left[i + 1], right[i + 1] = one, two, end
            return runs + 1
        begin = max(begin, two) if one <= begin else begin
        end = min(end, one) if two >= right[i] else end
        if begin < end:
            left[kept], right[kept] = begin, end
            kept += 1
    return kept


@inlined
def _union(left, right, runs):
    """Return the length that stretches cover together; puts them in order."""
    total, reached = 0.0, -math.inf
    for i in range(1, runs):
        one, two, at = left[i], right[i], i
        while at > 0 and left[at - 1] > one:
            left[at], right[at] = left[at - 1], right[at - 1]
            at -= 1
        left[at], right[at] = one, two
    for i in range(runs):
        total += max(right[i] - max(left[i], reached), 0.0)
        reached = max(reached, right[i])
    return total
