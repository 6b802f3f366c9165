"""Compiled area of a union of polygons within a free space.

Like `vinefab.growth.kernel` it imports no module of vinefab but `core.compiling`: the cache of a
compiled file does not notice changes of another. `vinefab.tasks.map_context` calls it.
"""

import math

from vinefab.core.compiling import compiled, inlined, takes

# mypy: allow-untyped-defs, allow-untyped-calls
# ruff: noqa: ANN001, ANN202, ANN201  numba infers the types of compiled functions
# ruff: noqa: FBT003, PLR0913, PLR0917  arrays are the compiled way to hand things over

# Columns of an edge: its lower end, its upper end, x per y, and how the winding number changes
# from its left to its right.
X, Y, X_TOP, Y_TOP, SLOPE, STEP = 0, 1, 2, 3, 4, 5

RUN = 8
"""Edges that follow each other are looked at together, so many at most, by their common box."""

FREE = 1 << 30
"""What being in free space adds to the number of polygons that a point is in."""


@compiled
@takes("f2 i1 i1 f2 i1 f f2 i1 f1 f2 i1 f2 f2 f2 f2", seconds=3.1)
def union_areas(
    corner,
    ring,
    polygon,
    line,
    line_first,
    radius,
    free,
    free_first,
    box,
    edge,
    first,
    bounds,
    run,
    event,
    out,
):
    """Compute the area of several unions of polygons within a free space.

    The area is the integral of x over y along its outline. An edge of a polygon belongs to the
    outline where no other polygon covers it and it is in free space, an edge of the free space
    where a polygon covers it. How a pair of edges lies is worked out from the same numbers for
    both: which is further left where both begin and where both end, and where they cross.

    Parameters
    ----------
    corner
        Corners of closed rings, ring after ring, mm; shape (p, 2).
    ring
        Where the corners of each ring begin, with the total at the end.
    polygon
        Where the rings of each polygon begin, with the total at the end; the outer ring is first.
    line, line_first, radius
        Corners of the line that each polygon surrounds at about a distance, where those of each
        begin, and that distance, mm.
    free, free_first
        Edges of the free space, a row of columns each, row of the plane by row, and where the
        edges of each row begin. An edge that lies in several rows stands in each.
    box
        Lower end and height of the rows, mm.
    edge, first, bounds, run, event
        Working room: edges of one union, where those of each polygon begin, the polygons' boxes,
        the least y, greatest y and least x of every `RUN` edges, and events along an edge: y and
        step.
    out
        Where each union's polygons begin, with the total at the end, as the first column; the
        others take the area (mm2) and twice how far the outline is from closed.
    """
    for j in range(len(out) - 1):
        one, two = int(out[j, 0]), int(out[j + 1, 0])
        _take_edges(corner, ring, polygon, one, two, edge, first, bounds, run)
        count, rows = two - one, len(free_first) - 1
        out[j, 1], out[j, 2], out[j, 3] = 0.0, 0.0, 0.0
        cover = 0  # the edges after one that a polygon covers are often covered by it too
        for k in range(count):
            for e in range(first[k], first[k + 1]):
                if edge[e, Y_TOP] < edge[e, Y]:
                    break
                if cover != k and _reach(edge[e], one + cover, line, line_first, radius) < 0.0:
                    continue
                events, cover = _along_polygons(
                    edge[e], k, count, one, line, line_first, radius, edge, first, bounds, run,
                    event,
                )  # fmt: skip
                if cover == k:
                    events = _along_free(edge[e], free, free_first, box, event, events)
                    _add(edge[e], event, events, False, out[j])
        for row in range(rows):
            for e in range(free_first[row], free_first[row + 1]):
                if _first_row(free[e, Y], box, rows) == row:
                    events, _ = _along_polygons(
                        free[e], count, count, one, line, line_first, radius, edge, first, bounds,
                        run, event,
                    )  # fmt: skip
                    _add(free[e], event, events, True, out[j])


@inlined
def _first_row(y, box, rows):
    """Return the row of a height; those beyond either end count as that end."""
    return min(max(int((y - box[0]) / box[1]), 0), rows - 1)


@inlined
def _take_edges(corner, ring, polygon, one, two, edge, first, bounds, run):
    """Take the edges of some polygons that are not level, and the polygons' boxes."""
    count = 0
    for k in range(one, two):
        first[k - one] = count
        doubled = 0.0
        bounds[k - one, 0] = bounds[k - one, 1] = math.inf
        bounds[k - one, 2] = bounds[k - one, 3] = -math.inf
        for r in range(polygon[k], polygon[k + 1]):
            x, y = corner[ring[r], 0], corner[ring[r], 1]
            for i in range(ring[r], ring[r + 1] - 1):
                bounds[k - one, 0] = min(bounds[k - one, 0], corner[i, 0])
                bounds[k - one, 1] = min(bounds[k - one, 1], corner[i, 1])
                bounds[k - one, 2] = max(bounds[k - one, 2], corner[i, 0])
                bounds[k - one, 3] = max(bounds[k - one, 3], corner[i, 1])
                if r == polygon[k]:
                    doubled += (corner[i, 0] - x) * (corner[i + 1, 1] - y)
                    doubled -= (corner[i + 1, 0] - x) * (corner[i, 1] - y)
                if corner[i, 1] != corner[i + 1, 1]:
                    up = corner[i + 1, 1] > corner[i, 1]
                    low, high = (i, i + 1) if up else (i + 1, i)
                    edge[count, X], edge[count, Y] = corner[low, 0], corner[low, 1]
                    edge[count, X_TOP], edge[count, Y_TOP] = corner[high, 0], corner[high, 1]
                    across = edge[count, X_TOP] - edge[count, X]
                    edge[count, SLOPE] = across / (edge[count, Y_TOP] - edge[count, Y])
                    # A ring that turns left has its inside on the left of its rising edges.
                    edge[count, STEP] = -1.0 if up else 1.0
                    count += 1
        if doubled < 0.0:
            for e in range(first[k - one], count):
                edge[e, STEP] = -edge[e, STEP]
        while count % RUN > 0:  # the last run of a polygon is filled with edges that nothing meets
            edge[count, X] = edge[count, Y] = edge[count, X_TOP] = math.inf
            edge[count, Y_TOP] = -math.inf
            count += 1
        for r in range(first[k - one] // RUN, count // RUN):
            run[r, 0], run[r, 1], run[r, 2] = math.inf, -math.inf, math.inf
            for e in range(r * RUN, (r + 1) * RUN):
                run[r, 0] = min(run[r, 0], edge[e, Y])
                run[r, 1] = max(run[r, 1], edge[e, Y_TOP])
                run[r, 2] = min(run[r, 2], edge[e, X], edge[e, X_TOP])
    first[two - one] = count


@inlined
def _along_polygons(
    own, number, polygons, one, line, line_first, radius, edge, first, bounds, run, event
):
    """List where an edge enters and leaves other polygons than its own.

    Returns how many events there are, and the number of a polygon that covers all of the edge, its
    own number if there is none.
    """
    count = 0
    left, right = min(own[X], own[X_TOP]), max(own[X], own[X_TOP])
    for k in range(polygons):
        if k == number or bounds[k, 0] > right or bounds[k, 2] < left:
            continue
        if bounds[k, 1] >= own[Y_TOP] or bounds[k, 3] <= own[Y]:
            continue
        reach = _reach(own, one + k, line, line_first, radius)
        if reach < 0.0:
            event[0, 0], event[0, 1] = own[Y], 1.0
            return 1, k
        if reach > 0.0:
            continue
        for r in range(first[k] // RUN, first[k + 1] // RUN):
            if run[r, 1] <= own[Y] or run[r, 0] >= own[Y_TOP] or run[r, 2] > right:
                continue
            for e in range(r * RUN, (r + 1) * RUN):
                if edge[e, Y_TOP] <= own[Y] or edge[e, Y] >= own[Y_TOP]:
                    continue
                if min(edge[e, X], edge[e, X_TOP]) <= right:
                    count = _meet(own, edge[e], k < number, edge[e, STEP], event, count)
    return count, number


@inlined
def _reach(own, polygon, line, line_first, radius):
    """Tell whether an edge is well inside a polygon (-1), well outside (1) or perhaps neither (0).

    A polygon surrounds its line at between 0.99 and 1.05 of the distance.
    """
    near, last = math.inf, line_first[polygon + 1] - 1
    for i in range(line_first[polygon], last + 1):
        a_x, a_y = line[i, 0], line[i, 1]
        d_x, d_y = line[min(i + 1, last), 0] - a_x, line[min(i + 1, last), 1] - a_y
        low = _away(own[X] - a_x, own[Y] - a_y, d_x, d_y)
        high = _away(own[X_TOP] - a_x, own[Y_TOP] - a_y, d_x, d_y)
        # What surrounds a straight piece is convex: with its ends an edge is inside.
        if max(low, high) < 0.98 * radius * radius:
            return -1.0
        near = min(near, low, high)
    beyond = 1.05 * radius + math.hypot(own[X_TOP] - own[X], own[Y_TOP] - own[Y])
    return 1.0 if near > beyond * beyond else 0.0


@inlined
def _away(x, y, d_x, d_y):
    """Return the square of the distance of a point from a straight piece that begins at 0, 0."""
    square = d_x * d_x + d_y * d_y
    along = min(max((x * d_x + y * d_y) / square, 0.0), 1.0) if square > 0.0 else 0.0
    x, y = x - along * d_x, y - along * d_y
    return x * x + y * y


@inlined
def _along_free(own, free, free_first, box, event, count):
    """List where an edge enters and leaves the free space."""
    rows = len(free_first) - 1
    right = max(own[X], own[X_TOP])
    begin, end = _first_row(own[Y], box, rows), _first_row(own[Y_TOP], box, rows)
    for row in range(begin, end + 1):
        for e in range(free_first[row], free_first[row + 1]):
            if free[e, Y_TOP] <= own[Y] or free[e, Y] >= own[Y_TOP]:
                continue
            if min(free[e, X], free[e, X_TOP]) > right:
                continue
            # An edge in several rows is met in the first that both are in.
            if row == max(begin, _first_row(free[e, Y], box, rows)):
                count = _meet(own, free[e], False, FREE * free[e, STEP], event, count)
    return count


@inlined
def _meet(own, other, first, step, event, count):
    """List where an edge is on the right of another; of equal ones that of the higher number is."""
    low, high = max(own[Y], other[Y]), min(own[Y_TOP], other[Y_TOP])
    at_low, at_high = _x_at(own, low) - _x_at(other, low), _x_at(own, high) - _x_at(other, high)
    if at_low == 0.0 and at_high == 0.0:
        if not first:
            return count
    elif at_low <= 0.0 and at_high <= 0.0:
        return count
    elif at_low < 0.0 or at_high < 0.0:
        across = low + (high - low) * (at_low / (at_low - at_high))
        if at_low > 0.0:
            high = across
        else:
            low = across
    # Mostly the other continues where the one before it ended, or began: then both are one.
    if count > 0 and event[count - 1, 0] == low and event[count - 1, 1] == -step:
        event[count - 1, 0] = high
        return count
    if count > 1 and event[count - 2, 0] == high and event[count - 2, 1] == step:
        event[count - 2, 0] = low
        return count
    event[count, 0], event[count, 1] = low, step
    event[count + 1, 0], event[count + 1, 1] = high, -step
    return count + 2


@inlined
def _x_at(edge, y):
    """Return the x of an edge at a height: exactly that of an end at its height."""
    return edge[X_TOP] if y == edge[Y_TOP] else edge[X] + (y - edge[Y]) * edge[SLOPE]


@inlined
def _add(edge, event, count, is_free, out):
    """Add the parts of an edge that belong to the outline."""
    for i in range(1, count):
        y, step = event[i, 0], event[i, 1]
        at = i
        while at > 0 and event[at - 1, 0] > y:
            event[at, 0], event[at, 1] = event[at - 1, 0], event[at - 1, 1]
            at -= 1
        event[at, 0], event[at, 1] = y, step
    within, below = 0.0, edge[Y]
    for i in range(count + 1):
        above = event[i, 0] if i < count else edge[Y_TOP]
        if above > below:
            if within >= 1.0 if is_free else within == FREE:
                rise = -edge[STEP] * (above - below)
                # From the left end of the outline's edges, which is not far: little is lost.
                middle = edge[X] + (0.5 * (below + above) - edge[Y]) * edge[SLOPE]
                out[1] += middle * rise
                out[2] += rise
                out[3] += 0.5 * (below + above) * rise
            below = above
        if i < count:
            within += event[i, 1]
