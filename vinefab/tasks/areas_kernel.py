"""Compiled measures of free space: strips, discs and bodies on them, and lines of sight.

Like `vinefab.growth.kernel` it imports no module of vinefab but `core.compiling`: the cache of a
compiled file does not notice changes of another. The arrays are described in
`vinefab.tasks.areas`. Walls have free space on their left.
"""

import math

import numpy as np

from vinefab.core.compiling import compiled, inlined, takes

# mypy: allow-untyped-defs, allow-untyped-calls
# ruff: noqa: ANN001, ANN202, ANN201  numba infers the types of compiled functions
# ruff: noqa: PLR0913, PLR0917  arrays are the compiled way to hand things over

NOTHING = -1


# --- Free space as strips ---------------------------------------------------------------------


@compiled
@takes("f3r f1 f2 f2", seconds=0.5)
def fill_strips(edges, box, free, slope):
    """Compute how much free area each strip has to the left of each abscissa.

    Every piece of an edge that rises by dy, with free space on its left, ends a run of free space
    there: to its right the strip has ``dy (x - x_piece)`` less of it. Falling pieces begin one.

    Parameters
    ----------
    edges
        Directed edges with the free space on their left, shape (e, 2, 2), mm.
    box
        Lower left corner and the side of the cells, mm.
    free
        Where the result goes, mm2; zeros, shape (rows, columns + 1).
    slope
        Working room of the same shape; zeros.
    """
    rows, columns = free.shape[0], free.shape[1] - 1
    for e in range(len(edges)):
        _fill_edge(edges[e, 0, 0], edges[e, 0, 1], edges[e, 1, 0], edges[e, 1, 1], box, free, slope)
    for row in range(rows):
        run = 0.0
        for column in range(1, columns + 1):
            run += slope[row, column - 1]
            free[row, column] += free[row, column - 1] + run * box[2]


@inlined
def _fill_edge(ax, ay, bx, by, box, free, slope):
    """Add one edge, row by row."""
    if ay == by:
        return
    rows, side = free.shape[0], box[2]
    low, high = min(ay, by), max(ay, by)
    bottom = min(max(int((low - box[1]) / side), 0), rows - 1)
    top = min(max(int((high - box[1]) / side), 0), rows - 1)
    per_y = (bx - ax) / (by - ay)
    for row in range(bottom, top + 1):
        one = low if row == bottom else box[1] + row * side
        two = high if row == top else box[1] + (row + 1) * side
        if two > one:
            rise = two - one if by > ay else one - two
            x_one, x_two = ax + (one - ay) * per_y, ax + (two - ay) * per_y
            _fill_row(min(x_one, x_two), max(x_one, x_two), rise, row, box, free, slope)


@inlined
def _fill_row(left, right, rise, row, box, free, slope):
    """Add the piece of an edge within one row, cell by cell."""
    columns, side = free.shape[1] - 1, box[2]
    first = min(max(int((left - box[0]) / side), 0), columns - 1)
    last = min(max(int((right - box[0]) / side), 0), columns - 1)
    for column in range(first, last + 1):
        one = left if column == first else box[0] + column * side
        two = right if column == last else box[0] + (column + 1) * side
        part = rise
        if last > first:
            part = rise * (two - one) / (right - left)
        middle = 0.5 * (one + two)
        free[row, column + 1] -= part * (box[0] + (column + 1) * side - middle)
        if column + 1 < columns:
            slope[row, column + 1] -= part


# --- Discs on strips --------------------------------------------------------------------------

# Look-ups in tables stand in loops of their own: the arithmetic before them is compiled to vector
# instructions, which look-ups are not.


@inlined
def _cell_of(place, last):
    """Return the cell of a place, of those from 0 to ``last``, and how far along it the place is.

    Places beyond either end count as that end.
    """
    place = min(max(place, 0.0), float(last))
    cell = min(np.int64(place), last - 1)
    return cell, place - cell


@inlined
def _between(table, cell, along):
    """Return the value some way along a cell: linear between those at its two ends."""
    one = table[np.uint64(cell)]
    return one + along * (table[np.uint64(cell) + np.uint64(1)] - one)


@compiled
@takes("f2 i1 f f1 f2 f1 i2 i2 f2 f2 f1 f1", seconds=1.1)
def cover_areas(tips, first, radius, half, free, box, disc, row, place, piece, seen, summed):
    """Compute the free area that equal discs cover together, and the sum of each one's free area.

    Strip by strip, a disc is taken for the rectangle of the same area in that strip. Rectangles of
    a strip overlap in their x alone, so that their union is a matter of joining stretches.

    Parameters
    ----------
    tips
        Centres of the discs, set after set, mm; shape (m, 2).
    first
        Where each set begins, shape (j + 1,).
    radius
        Radius of the discs, mm.
    half
        Area of the unit disc below each of the heights evenly spaced from -1 to 1.
    free, box
        The strips, as `fill_strips` left them.
    disc
        Working room: discs of one set in the order of their x, and the first row of each; shape
        (2, n) for the largest set.
    row
        Working room for each row: where its pieces end, and cells along a disc; shape
        (3, rows + 2).
    place
        Working room for each row: least left end so far, and places along a disc; shape
        (4, rows + 2).
    piece
        Working room for the pieces of discs in rows, row by row and in each in the order of x:
        least left end of it and those to its right, its right end, its free area, and its row;
        shape (4, p).
    seen, summed
        Where the results go, mm2; shape (j,).
    """
    for j in range(len(seen)):
        own = tips[first[j] : first[j + 1]]
        placed = _in_order(own, radius / box[2], box, disc, row[0])
        count = _begin_rows(row[0], place[0])
        for k in range(placed, 0, -1):
            x, y = _in_cells(own, box, disc[0, np.uint64(k - 1)])
            _cut(x, y, radius / box[2], half, free, row, place, piece)
        seen[j], summed[j] = _joined(piece, count)


@inlined
def _in_cells(tips, box, disc):
    """Return the centre of a disc in cells."""
    at = np.uint64(disc)
    return (tips[at, 0] - box[0]) / box[2], (tips[at, 1] - box[1]) / box[2]


@inlined
def _rows_of(y, radius, rows):
    """Return the first and the last row that a disc meets, the last before the first if none."""
    return max(int(y - radius), 0), min(int(y + radius), rows - 1) if y + radius > 0.0 else -1


@inlined
def _in_order(tips, radius, box, disc, change):
    """Put the discs that meet rows in the order of their x; return how many there are.

    ``change`` becomes how many more discs each row meets than the one before it. Of equal x, the
    disc that begins in the lower row is first, then the one with the higher number.
    """
    order, begins, placed = disc[0], disc[1], 0
    change[:] = 0
    for number in range(len(tips) - 1, -1, -1):
        x, y = _in_cells(tips, box, number)
        begin, end = _rows_of(y, radius, len(change) - 2)
        if begin > end:
            continue
        begins[np.uint64(number)] = begin
        change[np.uint64(begin)] += 1
        change[np.uint64(end + 1)] -= 1
        at = placed
        while at > 0:
            before = order[np.uint64(at - 1)]
            x_before, _ = _in_cells(tips, box, before)
            if x_before < x or (x_before == x and begins[np.uint64(before)] <= begin):
                break
            order[np.uint64(at)] = before
            at -= 1
        order[np.uint64(at)] = number
        placed += 1
    return placed


@inlined
def _begin_rows(change, least):
    """Turn the changes of the rows' numbers of pieces into where their pieces end.

    Returns how many pieces there are in all.
    """
    here, total = 0, 0
    for row in range(len(change)):
        here += change[row]
        total += here
        change[row], least[row] = total, math.inf
    return total


@inlined
def _cut(x, y, radius, half, free, row, place, piece):
    """Cut a disc into its pieces and put each before those of its row to its right."""
    ends, cell, far_cell = row[0], row[1], row[2]
    least, along, far_along, height = place[0], place[1], place[2], place[3]
    begin, end = _rows_of(y, radius, len(free))
    per_row, scale = 0.5 * (len(half) - 1) / radius, 0.5 * radius * radius
    for i in range(end - begin + 2):
        at = (radius - y) * per_row + (begin + i) * per_row
        cell[i], along[i] = _cell_of(at, len(half) - 1)
    for i in range(end - begin + 2):
        height[i] = _between(half, cell[i], along[i])
    for i in range(end - begin + 1):
        height[i] = scale * (height[i + 1] - height[i])
    for i in range(end - begin + 1):
        cell[i], along[i] = _cell_of(x - height[i], free.shape[1] - 1)
    for i in range(end - begin + 1):
        far_cell[i], far_along[i] = _cell_of(x + height[i], free.shape[1] - 1)
    for i in range(end - begin + 1):
        strip = np.uint64(begin + i)
        left = _between(free[strip], cell[i], along[i])
        right = _between(free[strip], far_cell[i], far_along[i])
        least[strip] = min(least[strip], left)
        ends[strip] -= 1
        to = np.uint64(ends[strip])
        piece[0, to], piece[1, to], piece[2, to] = least[strip], right, right - left
        piece[3, to] = begin + i


@inlined
def _joined(piece, count):
    """Return the free area that pieces cover together, and the sum of their areas.

    A stretch ends before a piece that begins, as all to its right do, beyond all to its left.
    """
    seen, summed, start, reached, row = 0.0, 0.0, 0.0, 0.0, -1.0
    for k in range(count):
        is_other_row = piece[3, k] != row
        is_apart = is_other_row | (piece[0, k] > reached)
        seen += reached - start if is_apart else 0.0
        start = piece[0, k] if is_apart else start
        reached = max(-math.inf if is_other_row else reached, piece[1, k])
        summed += piece[2, k]
        row = piece[3, k]
    return seen + (reached - start), summed


# --- Bodies on cells --------------------------------------------------------------------------


SLACK = 1e-6
"""Cells so near to a limit are looked at one by one: far more than rounding."""


@compiled
@takes("f2 i1 i1 i1 f f2 f1 f2 i2 f1", seconds=0.7)
def reach_areas(points, first_point, branch, room, radius, weight, box, level, mark, out):
    """Compute the free area within a distance of each of several bodies.

    A cell counts by the distance of its centre: in full up to half a side within the radius, not
    at all from half a side beyond it, linearly in between.

    Parameters
    ----------
    points, first_point, branch, room
        Chains of several growths as `vinefab.growth.batch.GrowthBlock` holds them, mm.
    radius
        The distance, mm.
    weight
        Free area of each cell, mm2; shape (rows, columns).
    box
        Lower left corner and the side of the cells, mm.
    level
        Working room: how far each cell counts so far; shape (rows, columns).
    mark
        Working room: growth that ``level`` is of, counted from 1; zeros, shape (rows, columns).
    out
        Where the results go, mm2; shape (j,).
    """
    for j in range(len(out)):
        out[j] = 0.0
        for k in range(branch[j], branch[j + 1]):
            for i in range(first_point[k + j], first_point[k + j + 1] - 1):
                at = room[j] + i
                out[j] += _reach_from(
                    (points[at, 0] - box[0]) / box[2] - 0.5,
                    (points[at, 1] - box[1]) / box[2] - 0.5,
                    (points[at + 1, 0] - points[at, 0]) / box[2],
                    (points[at + 1, 1] - points[at, 1]) / box[2],
                    radius / box[2],
                    weight,
                    level,
                    mark,
                    j + 1,
                )


@inlined
def _reach_from(ax, ay, dx, dy, radius, weight, level, mark, stamp):
    """Add what one straight piece reaches; lengths in cells, centres at whole numbers."""
    rows, columns = weight.shape
    outer = radius + 0.5
    added = 0.0
    lowest = max(math.ceil(min(ay, ay + dy) - outer), 0)
    highest = min(math.floor(max(ay, ay + dy) + outer), rows - 1)
    for row in range(lowest, highest + 1):
        # No cell beyond these counts, and every cell within those counts in full.
        one, two = _stretch(ax, row - ay, dx, dy, outer + SLACK)
        left, right = max(math.ceil(one), 0), min(math.floor(two), columns - 1)
        full_from, full_to = right + 1, right
        if radius > 0.5 + SLACK:
            one, two = _stretch(ax, row - ay, dx, dy, radius - 0.5 - SLACK)
            if one <= two:
                full_from, full_to = math.ceil(one), math.floor(two)
        for column in range(left, right + 1):
            before = level[row, column] if mark[row, column] == stamp else 0.0
            if before == 1.0 or weight[row, column] == 0.0:
                continue
            now = 1.0
            if column < full_from or column > full_to:
                now = _nearness(column - ax, row - ay, dx, dy, radius)
            if now > before:
                level[row, column], mark[row, column] = now, stamp
                added += (now - before) * weight[row, column]
    return added


@inlined
def _stretch(ax, y, dx, dy, radius):
    """Return from where to where a row is within a distance of a piece; inf and -inf if nowhere.

    The outline of the points so near consists of two half circles and two straight sides.
    """
    one, two = math.inf, -math.inf
    square = radius * radius - y * y
    if square >= 0.0:
        half = math.sqrt(square)
        one, two = ax - half, ax + half
    square = radius * radius - (y - dy) * (y - dy)
    if square >= 0.0:
        half = math.sqrt(square)
        one, two = min(one, ax + dx - half), max(two, ax + dx + half)
    length = math.sqrt(dx * dx + dy * dy)
    if length > 0.0 and dy != 0.0:
        aside, up = radius * dy / length, radius * dx / length
        share = (y - up) / dy
        if 0.0 <= share <= 1.0:
            x = ax - aside + share * dx
            one, two = min(one, x), max(two, x)
        share = (y + up) / dy
        if 0.0 <= share <= 1.0:
            x = ax + aside + share * dx
            one, two = min(one, x), max(two, x)
    return one, two


@inlined
def _nearness(x, y, dx, dy, radius):
    """Return the weight of a cell whose centre is at x, y from the start of a piece."""
    square = dx * dx + dy * dy
    if square > 0.0:
        along = min(max((x * dx + y * dy) / square, 0.0), 1.0)
        x, y = x - along * dx, y - along * dy
    away = x * x + y * y
    if radius > 0.5 and away <= (radius - 0.5) * (radius - 0.5):
        return 1.0
    return min(max(radius + 0.5 - math.sqrt(away), 0.0), 1.0)


# --- Walls by cells ---------------------------------------------------------------------------


@compiled
@takes("f2r f1 f i1", seconds=0.6)
def count_walls(walls, grid, reach, number):
    """Add up how many walls come within a distance of each cell.

    Parameters
    ----------
    walls, grid
        As in `areas.WallCells`, mm.
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
@takes("f2r f1 f i1 i1", seconds=0.1)
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
        As in `areas.WallCells`: walls that can hide something from a sensor in each
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
            column = min(max(int((own[k, 0] - grid[0]) / grid[2]), 0), int(grid[3]) - 1)
            row = min(max(int((own[k, 1] - grid[1]) / grid[2]), 0), int(grid[4]) - 1)
            cell = row * int(grid[3]) + column
            walls_here = item[cell_first[cell] : cell_first[cell + 1]]
            _step_off(own[k], sensor, walls, walls_here)
            index[3, k + 1] = _facing_walls(own[k], sensor[0], walls, walls_here, near, index[3, k])
        seen[j], summed[j] = _see_one(own, sensor[0], line, near, index, begins, run)


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
def _see_one(tips, radius, line, near, index, begins, run):
    """Return the area that one set of sensors sees, and the sum over the sensors."""
    order, until, first = index[2], index[1], index[3]
    lowest, highest = _begin(tips, radius, line, index, begins)
    seen, summed, active = 0.0, 0.0, 0
    for row in range(lowest, highest + 1):
        k = begins[row]
        while k != NOTHING:
            at = active  # the sensors of the line are in the order of their x
            while at > 0 and tips[order[at - 1], 0] > tips[k, 0]:
                order[at] = order[at - 1]
                at -= 1
            order[at] = k
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
