"""What branches do to each other after each was grown alone: compiled.

A tip that meets the body of another branch stops there, and its children stay in. The path of a
branch is its final chain. Every tip moves along its path at one speed (assumed), and sets out when
its parent has ended: so time is length, and the body of a branch at some time is the part of its
path that was grown by then. A meeting belongs to the tip that comes later; tips that meet each
other stop both. Branches that touch where one sets out are free of each other until they were
apart.

A tip on one segment, and the laid part of another: the times at which they are within some reach
are an interval, because the reach is convex and both move evenly. It is the union of the times
within reach of the segment's start, of its sides, of its end once that is laid, and of the other
tip until then; each has a closed form.

`tests/oracles/branch_contact.py` is the same rule in small steps. Like `vinefab.growth.kernel` this
file imports no module of vinefab but `core.compiling`.
"""

import math

import numpy as np

from vinefab.core.compiling import called, compiled, inlined, takes

# mypy: allow-untyped-defs, allow-untyped-calls
# ruff: noqa: ANN001, ANN202, ANN201  numba infers the types of compiled functions
# ruff: noqa: PLR0913, PLR0917  scalars are the compiled way to hand things over

FULL_LENGTH = 0
NOT_DEPLOYED = 3
BRANCH = 5
NOT_EVERTED = 6

# Columns of the working room: when a branch sets out and ends, when it meets which other, the box
# around its body, and whether it is whole, cut or gone. The last two are lists: all branches in the
# order in which they set out, and those that have.
BEGIN, END, MEETING, OTHER, LEFT, LOW, RIGHT, HIGH, STATE, ORDER, OUT = range(11)
WORK_COLUMNS = 11
WHOLE, CUT, GONE = 0.0, 1.0, 2.0

# Tips stop one step of contact short of touching, and meet only what they would come a step nearer
# to: what starts or passes just where another came to rest is not decided by rounding.
STEPS = 1024.0
"""A step of contact, in the map's tolerances: above what rounding leaves of lengths and places."""


# --- A tip and one segment of another body -------------------------------------------------------


@inlined
def _disc(ex, ey, vx, vy, reach, low, high):
    """Return when e + v t is within reach of the origin, for t of low to high.

    Infinity and minus infinity if it never is.
    """
    square = vx * vx + vy * vy
    if square <= 1e-24:
        if (ex * ex + ey * ey <= reach * reach) & (low <= high):
            return low, high
        return math.inf, -math.inf
    across = (ex * vy - ey * vx) ** 2 / square
    rest = reach * reach - across
    if rest < 0.0:
        return math.inf, -math.inf
    foot, half = -(ex * vx + ey * vy) / square, math.sqrt(rest / square)
    low, high = max(low, foot - half), min(high, foot + half)
    if low > high:
        return math.inf, -math.inf
    return low, high


@inlined
def _clip(value, slope, low, high):
    """Return the part of low to high where value + slope t is not negative."""
    if slope > 0.0:
        return max(low, -value / slope), high
    if slope < 0.0:
        return low, min(high, -value / slope)
    return (low, high) if value >= 0.0 else (math.inf, -math.inf)


@inlined
def _sides(along, gain, across, drift, size, laid, reach, high):
    """Return when a tip is within reach of the sides of the part of a segment that is laid.

    The tip is at (along + gain t, across + drift t) of the segment, of whose ``size`` the part up
    to laid + t is there.
    """
    low, high = _clip(reach - across, -drift, 0.0, high)
    low, high = _clip(reach + across, drift, low, high)
    low, high = _clip(along, gain, low, high)
    low, high = _clip(size - along, -gain, low, high)
    low, high = _clip(laid - along, 1.0 - gain, low, high)
    if low > high:
        return math.inf, -math.inf
    return low, high


@inlined
def _touch(tip, body, reach):
    """Return the start and end of a tip's time within reach of the laid part of a segment.

    ``tip`` and ``body`` are (x, y, ux, uy, begin, end): a segment from its start, and when the tip
    of its branch moves along it. Infinity and minus infinity if it never is.
    """
    px, py, ux, uy, tip_begin, tip_end = tip
    qx, qy, wx, wy, begin, end = body
    start = max(tip_begin, begin)
    high = tip_end - start
    if high < 0.0:
        return math.inf, -math.inf
    dx, dy = px + ux * (start - tip_begin) - qx, py + uy * (start - tip_begin) - qy
    size, laid = end - begin, start - begin
    across, drift = wx * dy - wy * dx, wx * uy - wy * ux
    last = across + drift * high
    if ((across > reach) & (last > reach)) | ((across < -reach) & (last < -reach)):
        return math.inf, -math.inf
    along, gain = dx * wx + dy * wy, ux * wx + uy * wy
    last = along + gain * high
    if ((along > size + reach) & (last > size + reach)) | ((along < -reach) & (last < -reach)):
        return math.inf, -math.inf
    enter, leave = _disc(dx, dy, ux, uy, reach, 0.0, high)
    if size > 0.0:
        one, two = _sides(along, gain, across, drift, size, laid, reach, high)
        enter, leave = min(enter, one), max(leave, two)
    # The end of the segment is there once it is laid; until then the other tip is.
    there = max(0.0, size - laid)
    ex, ey = dx - wx * size, dy - wy * size
    one, two = _disc(ex, ey, ux, uy, reach, there, high)
    enter, leave = min(enter, one), max(leave, two)
    if there > 0.0:
        ex, ey = dx - wx * laid, dy - wy * laid
        one, two = _disc(ex, ey, ux - wx, uy - wy, reach, 0.0, min(there, high))
        enter, leave = min(enter, one), max(leave, two)
    return start + enter, start + leave


# --- Two branches --------------------------------------------------------------------------------


# A chain as (x and y, length up to it, direction from there) of its points.


@inlined
def _measure(chains, first, last):
    """Write how long a chain is up to each of its points, and its direction from there."""
    points, length, ux, uy = chains
    length[first] = 0.0
    for i in range(first, last - 1):
        dx, dy = points[i + 1, 0] - points[i, 0], points[i + 1, 1] - points[i, 1]
        size = math.sqrt(dx * dx + dy * dy)
        length[i + 1] = length[i] + size
        ux[i], uy[i] = (dx / size, dy / size) if size > 0.0 else (0.0, 0.0)


@inlined
def _next_touch(chains, first_point, work, one, other, reach, after, until):
    """Return the touch of a tip with another body that begins first, of those that end after.

    Infinity where it begins later than ``until``.
    """
    points, length, ux, uy = chains
    enter, leave = until, -math.inf
    born, done = work[one, BEGIN], work[one, END]
    laid, whole = work[other, BEGIN], work[other, END]
    left, right = work[other, LEFT] - reach, work[other, RIGHT] + reach
    low, high = work[other, LOW] - reach, work[other, HIGH] + reach
    for j in range(first_point[one], first_point[one + 1] - 1):
        begin, end = born + length[j], min(born + length[j + 1], done)
        if begin > min(enter, done):
            break
        x, y, to_x, to_y = points[j, 0], points[j, 1], points[j + 1, 0], points[j + 1, 1]
        if (
            (end < after)
            | (end < laid)
            | (min(x, to_x) > right)
            | (max(x, to_x) < left)
            | (min(y, to_y) > high)
            | (max(y, to_y) < low)
        ):
            continue
        tip = (x, y, ux[j], uy[j], begin, end)
        from_x, from_y = min(x, to_x) - reach, min(y, to_y) - reach
        to_x, to_y = max(x, to_x) + reach, max(y, to_y) + reach
        for k in range(first_point[other], first_point[other + 1] - 1):
            at = laid + length[k]
            if at > min(end, whole):
                break
            qx, qy, rx, ry = points[k, 0], points[k, 1], points[k + 1, 0], points[k + 1, 1]
            if (
                (min(qx, rx) > to_x)
                | (max(qx, rx) < from_x)
                | (min(qy, ry) > to_y)
                | (max(qy, ry) < from_y)
            ):
                continue
            body = (qx, qy, ux[k], uy[k], at, min(laid + length[k + 1], whole))
            first, last = _touch(tip, body, reach)
            if (last > after) & (first < enter):
                enter, leave = first, last
    return (enter, leave) if leave > -math.inf else (math.inf, leave)


@called
def _meeting(chains, first_point, work, one, other, reach, step, until):
    """Return when a tip meets the body of another branch; infinity if not before ``until``.

    Where they touch as the later one sets out, they are free of each other until they were apart.
    """
    apart = max(work[one, BEGIN], work[other, BEGIN])
    enter, leave = _next_touch(chains, first_point, work, one, other, reach, -math.inf, until)
    if enter == math.inf:
        return math.inf
    if enter <= apart + step and (
        first_point[one + 1] - first_point[one] + first_point[other + 1] - first_point[other] == 4
    ):
        return math.inf  # two segments touch but once
    # Touches that follow each other, segment by segment, are one.
    while enter <= apart + step:
        apart = max(apart, leave)
        enter, leave = _next_touch(
            chains, first_point, work, one, other, reach, apart + step, until
        )
    if enter == math.inf:
        return math.inf
    # It stops a step before that, where it came within reach of the same place.
    before, _ = _next_touch(chains, first_point, work, one, other, reach + step, apart, until)
    return min(max(before, apart), enter)


@inlined
def _reach(radius, one, other, step):
    """Return the least distance of a tip's middle to that of another body: two steps inside."""
    return max(radius[one] + radius[other] - 2.0 * step, 2.0 * step)


@inlined
def _meet(chains, first_point, radius, work, one, other, step):
    """Write when a tip meets another body, where that is the first one that it meets."""
    reach = _reach(radius, one, other, step)
    near = reach + step
    if (
        (work[one, LEFT] > work[other, RIGHT] + near)
        | (work[other, LEFT] > work[one, RIGHT] + near)
        | (work[one, LOW] > work[other, HIGH] + near)
        | (work[other, LOW] > work[one, HIGH] + near)
        | (work[other, BEGIN] > min(work[one, END] - step, work[one, MEETING]))
    ):
        return
    until = work[one, MEETING]
    time = _meeting(chains, first_point, work, one, other, reach, step, until)
    if time < work[one, MEETING]:
        work[one, MEETING], work[one, OTHER] = time, other


# --- A deployment --------------------------------------------------------------------------------


@inlined
def _draw(seed, branch):
    """Return a number from 0 to below 1 that depends on a seed and a branch: splitmix64."""
    state = np.uint64(seed) + np.uint64(0x9E3779B97F4A7C15) * np.uint64(branch + 1)
    state = (state ^ (state >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
    state = (state ^ (state >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
    state ^= state >> np.uint64(31)
    return float(state >> np.uint64(11)) / 9007199254740992.0


@inlined
def _set_out(parent, chains, first_point, stop, grown, emergence, seed, work):
    """Write when branches begin and end, their boxes, and which never come out.

    A branch that was not everted is cut at its base, where it takes part in no meeting.
    """
    changed = False
    for k in range(len(parent)):
        one, two = first_point[k], first_point[k + 1]
        above = parent[k]
        work[k, STATE], work[k, MEETING], work[k, OTHER] = WHOLE, math.inf, -1
        work[k, BEGIN] = work[k, END] = 0.0
        if stop[k] == NOT_DEPLOYED or (above >= 0 and work[above, STATE] != WHOLE):
            changed |= stop[k] != NOT_DEPLOYED
            work[k, STATE] = GONE
            continue
        if above >= 0:
            work[k, BEGIN] = work[above, END]
            if emergence[k] < 1.0 and _draw(seed, k) >= emergence[k]:
                work[k, STATE], work[k, END] = CUT, work[k, BEGIN]
                stop[k] = -NOT_EVERTED
                changed = True
                continue
        work[k, END] = work[k, BEGIN] + grown[k]
        _measure(chains, one, two)
        points = chains[0]
        left = right = points[one, 0]
        low = high = points[one, 1]
        for i in range(one + 1, two):
            left, right = min(left, points[i, 0]), max(right, points[i, 0])
            low, high = min(low, points[i, 1]), max(high, points[i, 1])
        work[k, LEFT], work[k, RIGHT], work[k, LOW], work[k, HIGH] = left, right, low, high
    return changed


@inlined
def _sort(work, count):
    """List the branches that may set out, in the order in which they do; return their number."""
    found = 0
    for k in range(count):
        if work[k, STATE] != WHOLE:
            continue
        at = found
        while at > 0 and work[int(work[at - 1, ORDER]), BEGIN] > work[k, BEGIN]:
            work[at, ORDER] = work[at - 1, ORDER]
            at -= 1
        work[at, ORDER] = k
        found += 1
    return found


@inlined
def _is_outdated(chains, first_point, radius, work, one, out, now, step):
    """Tell whether cuts just made may change when a tip meets another body."""
    other = int(work[one, OTHER])
    if other >= 0 and (work[other, STATE] == GONE or _is_cut(work, other, now)):
        return True
    x, y = chains[0][first_point[one], 0], chains[0][first_point[one], 1]
    for place in range(out):
        cut = int(work[place, OUT])
        if _is_cut(work, cut, now):
            # A tip that started next to a body, which ended sooner, may be apart from it sooner.
            reach = _reach(radius, one, cut, step) + step
            if (
                (x >= work[cut, LEFT] - reach)
                & (x <= work[cut, RIGHT] + reach)
                & (y >= work[cut, LOW] - reach)
                & (y <= work[cut, HIGH] + reach)
            ):
                return True
    return False


@inlined
def _is_cut(work, branch, now):
    """Tell whether a branch was just cut."""
    return (work[branch, STATE] == CUT) & (work[branch, MEETING] >= now)


@inlined
def _cut(parent, chains, first_point, stop, radius, work, out, now, step):
    """Cut the branches that meet others now: ties stop all."""
    for place in range(out):
        k = int(work[place, OUT])
        if parent[k] >= 0 and (stop[parent[k]] < 0 or work[parent[k], STATE] == GONE):
            work[k, STATE] = GONE
        elif work[k, STATE] == WHOLE and work[k, MEETING] <= now + step:
            work[k, STATE], work[k, END] = CUT, work[k, MEETING]
            stop[k] = -BRANCH
    for place in range(out):
        k = int(work[place, OUT])
        if work[k, STATE] == WHOLE and _is_outdated(
            chains, first_point, radius, work, k, out, now, step
        ):
            work[k, MEETING], work[k, OTHER] = math.inf, -1
            for other_place in range(out):
                other = int(work[other_place, OUT])
                if (other != k) & (work[other, STATE] != GONE):
                    _meet(chains, first_point, radius, work, k, other, step)


@inlined
def _settle(parent, chains, first_point, stop, radius, work, step):
    """Cut branches where they meet others, in the order of time; return whether any was."""
    count = _sort(work, len(parent))
    next_out, out, changed = 0, 0, False
    while True:
        now = math.inf
        for place in range(out):
            k = int(work[place, OUT])
            if work[k, STATE] == WHOLE:
                now = min(now, work[k, MEETING])
        while next_out < count:
            k = int(work[next_out, ORDER])
            if work[k, BEGIN] > now + step:
                break
            next_out += 1
            above = parent[k]
            if above >= 0 and (stop[above] < 0 or work[above, STATE] == GONE):
                work[k, STATE] = GONE
                continue
            for place in range(out):
                other = int(work[place, OUT])
                if work[other, STATE] == GONE:
                    continue
                _meet(chains, first_point, radius, work, k, other, step)
                if (work[other, STATE] == WHOLE) & (work[other, END] > work[k, BEGIN] + step):
                    _meet(chains, first_point, radius, work, other, k, step)
                    now = min(now, work[other, MEETING])
            now = min(now, work[k, MEETING])
            work[out, OUT] = k
            out += 1
        if now == math.inf:
            return changed
        changed = True
        _cut(parent, chains, first_point, stop, radius, work, out, now, step)


@inlined
def _turned(points, first, last, ux, uy, least):
    """Return the sum of absolute turns along a chain that was launched along u, and its heading."""
    total = 0.0
    for k in range(first, last):
        dx, dy = points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1]
        size = math.sqrt(dx * dx + dy * dy)
        if size > least:
            total += math.atan2(abs(ux * dy - uy * dx), ux * dx + uy * dy)
            ux, uy = dx / size, dy / size
    return total, ux, uy


@inlined
def _write(tree_parent, tree_turn, growth, first_branch, room, job, work, tolerance):
    """Cut chains, and close the gaps between them."""
    points = growth.points
    at = growth.first_point[first_branch + job]
    begin = at
    for k in range(len(tree_parent)):
        row, edge = first_branch + k, first_branch + job + k + 1
        one, two = begin, growth.first_point[edge]
        begin = two
        if work[k, STATE] == GONE:
            growth.stop[row], growth.grown[row], growth.turn[row] = NOT_DEPLOYED, 0.0, 0.0
            growth.events[row] = 0
            growth.first_point[edge] = at
            continue
        left = math.inf if work[k, STATE] == WHOLE else work[k, END] - work[k, BEGIN]
        from_point = room + at
        for i in range(one, two):
            x, y = points[room + i, 0], points[room + i, 1]
            if i > one:
                px, py = points[room + at - 1, 0], points[room + at - 1, 1]
                size = math.sqrt((x - px) ** 2 + (y - py) ** 2)
                if (size >= left) | ((i == two - 1) & (left < math.inf)):
                    share = min(left / size, 1.0) if size > 0.0 else 0.0
                    x, y = px + share * (x - px), py + share * (y - py)
                    left = -1.0
                else:
                    left -= size
            points[room + at, 0], points[room + at, 1] = x, y
            at += 1
            if left < 0.0:
                break
        growth.first_point[edge] = at
        if work[k, STATE] == CUT:
            above = first_branch + tree_parent[k]
            hx, hy = growth.heading[above, 0], growth.heading[above, 1]
            cosine, sine = tree_turn[k, 0], tree_turn[k, 1]
            ux, uy = hx * cosine - hy * sine, hx * sine + hy * cosine
            turn, ux, uy = _turned(points, from_point, room + at - 1, ux, uy, tolerance)
            growth.stop[row] = -growth.stop[row]
            growth.grown[row] = work[k, END] - work[k, BEGIN]
            # A straight flight has no turn, not even that of rounding.
            growth.turn[row] = min(growth.turn[row], turn)
            growth.heading[row, 0], growth.heading[row, 1] = ux, uy


# Types of arguments, see `takes`.
_TREES = "vinefab.growth.arrays:TreesArrays(i1r f2r f1r f1r f1r i1r)"
_JOBS = "vinefab.growth.arrays:JobArrays(i1 i1 f2 f1 b1 i1 i1 i1 i1)"
_GROWTH = "vinefab.growth.arrays:Growth(f2 i1 i1 f1 f1 f2 i1 f1 f1 f1 i1 f1 f1)"


@compiled
@takes(f"{_TREES} f1 {_JOBS} f1 f1 i1 b {_GROWTH} f2", seconds=4.7)
def settle_jobs(trees, radius, jobs, tolerance, emergence, seeds, stops, growth, work):
    """Let children fail to come out, and branches stop at each other, in finished growths.

    Parameters
    ----------
    trees, jobs, growth
        See `vinefab.growth.arrays`; ``growth`` is written to.
    radius
        Radius of each planned branch's body, mm, in the order of ``trees``.
    tolerance
        Distances up to this count as touching, on the map of each job; shape (j,).
    emergence
        Probability that each planned branch comes out of its parent's tip, in the order of
        ``trees``.
    seeds
        Seed of each job's draws; shape (j,).
    stops
        Whether a tip that meets the body of another branch stops there.
    work
        Working room for the branches of the largest tree, shape (n, `WORK_COLUMNS`).
    """
    for job in range(len(jobs.tree)):
        first, last = trees.first[jobs.tree[job]], trees.first[jobs.tree[job] + 1]
        one, two = jobs.branch[job], jobs.branch[job + 1]
        room = jobs.room[job]
        parent = trees.parent[first:last]
        until = jobs.room[job + 1]
        # What was working room of the growth is free now.
        chains = (
            growth.points[room:until],
            growth.chain_length[room:until],
            growth.chain_gain[room:until],
            growth.chain_drawn[room:until],
        )
        first_point = growth.first_point[one + job : two + job + 1]
        stop, grown = growth.stop[one:two], growth.grown[one:two]
        share = emergence[first:last]
        changed = _set_out(parent, chains, first_point, stop, grown, share, seeds[job], work)
        if stops:
            step = STEPS * tolerance[job]
            changed |= _settle(parent, chains, first_point, stop, radius[first:last], work, step)
        if changed:
            turn = trees.turn[first:last]
            _write(parent, turn, growth, one, room, job, work, tolerance[job])
