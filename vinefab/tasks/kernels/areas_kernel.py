"""Compiled measures of free space: strips, and discs and bodies on them.

Like `vinefab.growth.kernel` it imports no module of vinefab but `core.compiling`: the cache of a
compiled file does not notice changes of another. The arrays are described in
`vinefab.tasks.fast_areas`.
"""

import math

import numpy as np

from vinefab.core.compiling import compiled, inlined

# mypy: allow-untyped-defs, allow-untyped-calls
# ruff: noqa: ANN001, ANN202, ANN201  numba infers the types of compiled functions
# ruff: noqa: PLR0913, PLR0917  arrays are the compiled way to hand things over


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
