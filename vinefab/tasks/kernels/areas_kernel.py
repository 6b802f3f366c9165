"""Compiled measures of free space: strips, and discs and bodies on them.

Like `vinefab.growth.kernel` it imports no module of vinefab but `core.compiling`: the cache of a
compiled file does not notice changes of another. The arrays are described in
`vinefab.tasks.fast_areas`.
"""

import math

from vinefab.core.compiling import compiled, inlined

# mypy: allow-untyped-defs, allow-untyped-calls
# ruff: noqa: ANN001, ANN202, ANN201  numba infers the types of what it compiles
# ruff: noqa: PLR0913, PLR0917  arrays are the compiled way to hand things over


NOTHING = -1


# --- Free space as strips ---------------------------------------------------------------------


@compiled
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


@inlined
def _free_to(free, row, place):
    """Return the free area of a strip up to a place in cells: linear between the cells' sides."""
    columns = free.shape[1] - 1
    place = min(max(place, 0.0), float(columns))
    column = min(int(place), columns - 1)
    one = free[row, column]
    return one + (place - column) * (free[row, column + 1] - one)


@inlined
def _below(half, place):
    """Return the area of the unit disc below a place in a table of heights from -1 to 1."""
    place = min(max(place, 0.0), float(len(half) - 1))
    index = min(int(place), len(half) - 2)
    one = half[index]
    return one + (place - index) * (half[index + 1] - one)


@compiled
def cover_areas(tips, first, radius, half, free, box, work, index, begins, seen, summed):
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
        The strips, as `fill` left them.
    work
        Working room for the discs of one set: area of the unit disc below the strip; free area to
        the left and to the right ends of stretches that rectangles cover; x of the centre in
        cells; place in ``half`` of the lowest strip's lower side; shape (5, n).
    index
        Working room: next disc that begins in the same row, last row, discs of the strip in order;
        shape (3, n).
    begins
        Working room: first disc that begins in each row, shape (rows,).
    seen, summed
        Where the results go, mm2; shape (j,).
    """
    for j in range(len(seen)):
        seen[j], summed[j] = _cover_one(
            tips[first[j] : first[j + 1]], radius / box[2], half, free, box, work, index, begins
        )


@inlined
def _begin(tips, radius, half, free, box, work, index, begins):
    """Sort discs by the row that they begin in; return the first and last row of all."""
    following, until = index[0], index[1]
    rows, lowest, highest = free.shape[0], free.shape[0], -1
    per_row = 0.5 * (len(half) - 1) / radius
    for row in range(rows):
        begins[row] = NOTHING
    for disc in range(len(tips)):
        y = (tips[disc, 1] - box[1]) / box[2]
        begin = max(int(y - radius), 0)
        end = min(int(y + radius), rows - 1)
        if y + radius <= 0.0 or begin > end:
            continue
        following[disc], until[disc] = begins[begin], end
        begins[begin] = disc
        work[3, disc] = (tips[disc, 0] - box[0]) / box[2]
        work[4, disc] = (radius - y) * per_row
        work[0, disc] = _below(half, work[4, disc] + begin * per_row)
        lowest, highest = min(lowest, begin), max(highest, end)
    return lowest, highest


@inlined
def _insert(order, x, active, disc):
    """Add a disc to those of the strip, which are in the order of their centres' x."""
    at = active
    while at > 0 and x[order[at - 1]] > x[disc]:
        order[at] = order[at - 1]
        at -= 1
    order[at] = disc


@inlined
def _cover_one(tips, radius, half, free, box, work, index, begins):
    """Return the area that one set of discs covers, and the sum over the discs."""
    following, until, order = index[0], index[1], index[2]
    below, x, place = work[0], work[3], work[4]
    lowest, highest = _begin(tips, radius, half, free, box, work, index, begins)
    seen, summed, active = 0.0, 0.0, 0
    scale, per_row = 0.5 * radius * radius, 0.5 * (len(half) - 1) / radius
    for row in range(lowest, highest + 1):
        disc = begins[row]
        while disc != NOTHING:
            _insert(order, x, active, disc)
            active += 1
            disc = following[disc]
        above = (row + 1) * per_row
        kept, runs = 0, 0
        for k in range(active):
            disc = order[k]
            under = _below(half, place[disc] + above)
            half_width = scale * (under - below[disc])
            below[disc] = under
            left = _free_to(free, row, x[disc] - half_width)
            right = _free_to(free, row, x[disc] + half_width)
            summed += right - left
            runs = _join(work[1], work[2], runs, left, right)
            order[kept] = disc
            kept += until[disc] > row
        for k in range(runs):
            seen += work[2, k] - work[1, k]
        active = kept
    return seen, summed


@inlined
def _join(left, right, runs, one, two):
    """Add a stretch to disjoint ones, joined with those that it meets; return their number.

    Stretches come in the order of their middles, so that only the last ones can be met.
    """
    while runs > 0 and one <= right[runs - 1]:
        runs -= 1
        one, two = min(one, left[runs]), max(two, right[runs])
    left[runs], right[runs] = one, two
    return runs + 1


# --- Bodies on cells --------------------------------------------------------------------------


@compiled
def reach_areas(points, first_point, branch, room, radius, weight, box, level, mark, out):
    """Compute the free area within a distance of each of several bodies.

    A cell counts by the distance of its centre: in full up to half a side within the radius, not
    at all from half a side beyond it, linearly in between.

    Parameters
    ----------
    points, first_point, branch, room
        Chains of several growths as `vinefab.growth.batch.Block` holds them, mm.
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
        # The part of the piece that is near enough in y bounds what can be near in x.
        first, last = 0.0, 1.0
        if dy != 0.0:
            one, two = (row - outer - ay) / dy, (row + outer - ay) / dy
            first, last = max(0.0, min(one, two)), min(1.0, max(one, two))
        x_one, x_two = ax + first * dx, ax + last * dx
        left = max(math.ceil(min(x_one, x_two) - outer), 0)
        right = min(math.floor(max(x_one, x_two) + outer), columns - 1)
        for column in range(left, right + 1):
            before = level[row, column] if mark[row, column] == stamp else 0.0
            if before == 1.0 or weight[row, column] == 0.0:
                continue
            now = _nearness(column - ax, row - ay, dx, dy, radius)
            if now > before:
                level[row, column], mark[row, column] = now, stamp
                added += (now - before) * weight[row, column]
    return added


@inlined
def _nearness(x, y, dx, dy, radius):
    """Return how far a cell counts whose centre is at x, y from the start of a piece."""
    square = dx * dx + dy * dy
    if square > 0.0:
        along = min(max((x * dx + y * dy) / square, 0.0), 1.0)
        x, y = x - along * dx, y - along * dy
    away = x * x + y * y
    if radius > 0.5 and away <= (radius - 0.5) * (radius - 0.5):
        return 1.0
    return min(max(radius + 0.5 - math.sqrt(away), 0.0), 1.0)
