"""The compiled penalty of designs that branch alike on each level.

The readable twin is `vinefab.fabrication.rules.penalty`: this file computes the same for many even
designs (no tapers, no collar) without building a design, a tree or an array for any of them. Like
`vinefab.growth.kernel` it imports no module of vinefab but `core.compiling`.
"""

import math

from vinefab.core.compiling import compiled, inlined

# mypy: allow-untyped-defs, allow-untyped-calls
# ruff: noqa: ANN001, ANN202, ANN201  numba infers the types of what it compiles


@compiled
def penalize(designs, tables, limits, scratch, penalty):
    """Write the penalty of every design: `window_penalty` plus `fabrication_penalty`.

    Parameters
    ----------
    designs, tables, limits, scratch
        As `DesignArrays`, `LevelTables`, `PenaltyLimits` and `Scratch` of the batch.
    penalty
        Where the penalties go, shape (m,).
    """
    for d in range(len(designs.depth)):
        total = math.log1p(_growth_excess(designs, d, tables, limits, scratch))
        total += math.log1p(tables.widths[designs.depth[d] - 1])
        total += math.log1p(_joints(designs, d, tables, limits))
        total += math.log1p(_packing(designs, d, tables, limits))
        count = designs.first[d + 1] - designs.first[d]
        if count > limits.most_branches:
            total += math.log1p(float(count) ** 2)
        else:
            capsules = _lay_out(designs, d, tables, limits, scratch)
            near = _too_near(designs, d, capsules, limits, scratch)
            over = _over_sheet(capsules, limits, scratch)
            shorter = min(limits.sheet_wide_mm, limits.sheet_high_mm)
            total += math.log1p(near + max(0.0, over / shorter))
        penalty[d] = total


# --- Pressure for growth ------------------------------------------------------------------------


@inlined
def _growth_excess(designs, d, tables, limits, scratch):
    """Return the relative excess of the pressure that growth to the worst tip takes.

    As `vinefab.physics.growth_pressure.planned_growth_kpa`, branch by branch.
    """
    base, until = designs.first[d], designs.first[d + 1]
    riding, factor, drag = scratch.riding, scratch.factor, scratch.drag
    for k in range(until - base):
        riding[k] = 0.0
    for k in range(until - base - 1, 0, -1):
        width = 2.0 * tables.half[designs.level[base + k] - 1]
        riding[designs.parent[base + k]] += riding[k] + designs.length[base + k] * width
    worst = 0.0
    for k in range(until - base):
        level, parent = designs.level[base + k] - 1, designs.parent[base + k]
        factor[k], drag[k] = 1.0, 0.0
        if parent >= 0:
            bend = math.exp(limits.friction * abs(designs.offset[base + k]))
            factor[k] = factor[parent] * bend
            above_kpa = limits.drag_kpa_mm * designs.length[base + parent]
            drag[k] = (drag[parent] + above_kpa) * bend
        own_kpa = limits.drag_kpa_mm * designs.length[base + k]
        store_kpa = limits.storage_kpa + limits.drag_kpa_mm * riding[k] / (2.0 * tables.half[level])
        takes_kpa = limits.yield_kpa + store_kpa * factor[k] + drag[k] + own_kpa
        worst = max(worst, takes_kpa * tables.scale[level])
    return min(limits.most, max(0.0, worst / limits.most_kpa - 1.0))


# --- Joints, level by level ---------------------------------------------------------------------


@inlined
def _joints(designs, d, tables, limits):
    """Return the summed violations by angles, crotches, and branches too short for their ends."""
    found, above_mm = 0.0, designs.trunk[d]
    base_mm, length_mm = 0.0, designs.trunk[d] + limits.tail_mm
    for below in range(designs.depth[d] - 1):
        wide, narrow = tables.half[below], tables.half[below + 1]
        branches, size = designs.branches[d, below], designs.size[d, below]
        fan = designs.fan[d, below] if branches > 1 else 0.0
        beside, between = math.pi - fan / 2.0, fan / max(branches - 1, 1)
        shortest_mm = size * min(1.0, designs.growth[d, below])
        disc = max(wide, narrow)
        reach_mm = _bare_reach(beside, wide, narrow, disc)
        within_mm = shortest_mm if reach_mm <= disc else min(shortest_mm, above_mm)
        found += _narrow(beside, limits) + _excess(reach_mm / within_mm, limits.crotch, limits.most)
        fillet = tables.fillet[below + 1]
        parent_mm, child_mm = _straight_begins(beside, wide, narrow, fillet, 0.0)
        if branches > 1:
            share = _bare_reach(between, narrow, narrow, disc) / shortest_mm
            found += _narrow(between, limits) + _excess(share, limits.crotch, limits.most)
            sibling_mm, _ = _straight_begins(between, narrow, narrow, fillet, wide)
            child_mm = max(child_mm, sibling_mm)
        found += _crowded(length_mm - base_mm - parent_mm, length_mm, limits)
        above_mm, base_mm = shortest_mm, child_mm
        length_mm = shortest_mm if branches > 1 else size
    tip_mm = tables.tip[designs.depth[d] - 1]
    return found + _crowded(length_mm - base_mm - tip_mm, length_mm, limits)


@inlined
def _narrow(angle, limits):
    """Return by how much an angle is narrower than the least, relative to it."""
    return max(0.0, (limits.angle_deg - math.degrees(angle)) / limits.angle_deg)


@inlined
def _excess(value, limit, most):
    """Return the relative excess of a value over a limit, capped."""
    return 0.0 if value <= limit else min(most, (value - limit) / max(abs(limit), 1e-9))


@inlined
def _crowded(room_mm, length_mm, limits):
    """Return how much of a branch is missing for its two ends to fit on it, capped."""
    return min(limits.most, max(0.0, (limits.segment_mm - room_mm) / length_mm))


@inlined
def _bare_reach(angle, one, two, disc):
    """Return how far from the joint two sides part: where they cross, or at the joint's disc."""
    if math.asin(one / disc) + math.asin(two / disc) <= angle:
        return disc
    sin, cos = math.sin(angle), math.cos(angle)
    if sin < 1e-9:
        return math.inf
    return math.sqrt(one * one + two * two + 2.0 * one * two * cos) / sin


@inlined
def _straight_begins(angle, one, two, fillet, least_disc):
    """Return how far from the joint the straight sides of two neighbours begin."""
    disc = max(least_disc, one, two)
    a, b = one + fillet, two + fillet
    if math.asin(a / (disc + fillet)) + math.asin(b / (disc + fillet)) <= angle:
        first = math.sqrt(max(0.0, (disc - one) * (disc + one + 2.0 * fillet)))
        second = math.sqrt(max(0.0, (disc - two) * (disc + two + 2.0 * fillet)))
        return first, second
    sin, cos = math.sin(angle), math.cos(angle)
    if sin < 1e-9:
        return math.inf, math.inf
    return max(0.0, (b + a * cos) / sin), max(0.0, (a + b * cos) / sin)


@inlined
def _packing(designs, d, tables, limits):
    """Return the summed excesses of folded film in the lumens that it rides in."""
    levels, found = designs.depth[d] - 1, 0.0
    for above in range(levels):
        count, most_mm = 1.0, 0.0
        for below in range(above, levels):
            count *= designs.branches[d, below]
            leaf = below == levels - 1
            wide = tables.leaf_width[levels] if leaf else 2.0 * tables.half[below + 1]
            most_mm = max(most_mm, count * wide)
        percent = 100.0 * most_mm * limits.film_mm / tables.area[above]
        found += _excess(percent, limits.packing_percent, limits.most)
    own_percent = 100.0 * tables.pouch_share[levels]
    return found + _excess(own_percent, limits.packing_percent, limits.most)


# --- The flat robot -----------------------------------------------------------------------------


@inlined
def _lay_out(designs, d, tables, limits, scratch):
    """Write the capsules of a flat robot, pouches last, and their boxes; return their number."""
    base, branches = designs.first[d], designs.first[d + 1] - designs.first[d]
    depth, capsule, heading = designs.depth[d], scratch.capsule, scratch.heading
    for k in range(branches):
        parent, length = designs.parent[base + k], designs.length[base + k]
        heading[k], x, y = 0.0, 0.0, 0.0
        if parent >= 0:
            heading[k] = heading[parent] + designs.offset[base + k]
            x, y = capsule[parent, 2], capsule[parent, 3]
        capsule[k, 0], capsule[k, 1] = x, y
        capsule[k, 2] = x + length * math.cos(heading[k])
        capsule[k, 3] = y + length * math.sin(heading[k])
        capsule[k, 4] = tables.half[designs.level[base + k] - 1]
        scratch.owner[k] = k
    capsule[0, 0] -= limits.tail_mm
    count = branches
    for pouch in range(tables.pouch_first[depth - 1], tables.pouch_first[depth]):
        for k in range(branches):
            if designs.level[base + k] == depth:
                _add_pouch(capsule, count, k, tables.pouch, pouch, heading[k])
                scratch.owner[count] = k
                count += 1
    reach = limits.clearance_mm / 2.0
    for k in range(count):
        grown = capsule[k, 4] + reach
        scratch.box[k, 0] = min(capsule[k, 0], capsule[k, 2]) - grown
        scratch.box[k, 1] = min(capsule[k, 1], capsule[k, 3]) - grown
        scratch.box[k, 2] = max(capsule[k, 0], capsule[k, 2]) + grown
        scratch.box[k, 3] = max(capsule[k, 1], capsule[k, 3]) + grown
    return count


@inlined
def _add_pouch(capsule, row, leaf, pouch, piece, heading):
    """Write one capsule of a leaf's pouch."""
    x, y, cos, sin = capsule[leaf, 2], capsule[leaf, 3], math.cos(heading), math.sin(heading)
    for end in (0, 2):
        along, across = pouch[piece, end], pouch[piece, end + 1]
        capsule[row, end] = x + (cos * along - sin * across)
        capsule[row, end + 1] = y + (sin * along + cos * across)
    capsule[row, 4] = pouch[piece, 4]


@inlined
def _too_near(designs, d, capsules, limits, scratch):
    """Return the summed depths of all pairs of capsules that are nearer than the clearance."""
    base, branches = designs.first[d], designs.first[d + 1] - designs.first[d]
    box, owner, found = scratch.box, scratch.owner, 0.0
    for one in range(capsules):
        low_x, low_y, high_x, high_y = box[one, 0], box[one, 1], box[one, 2], box[one, 3]
        for two in range(one + 1, capsules):
            beside = (box[two, 0] > high_x) | (box[two, 2] < low_x)
            if beside | (box[two, 1] > high_y) | (box[two, 3] < low_y):
                continue
            a, b = owner[one], owner[two]
            up_a, up_b = designs.parent[base + a], designs.parent[base + b]
            joined = (up_a == up_b) | (up_a == b) | (up_b == a)
            if a != b and not (joined and two < branches):
                found += _pair_depth(scratch.capsule, one, two, limits.clearance_mm)
    return found


@inlined
def _pair_depth(capsule, one, two, clearance):
    """Return the depth of a pair: 0 if just clear, 1 if centre lines touch, to 2 if they cross.

    The closest points of two segments, as in `vinefab.fabrication.rules.spacing.closest`.
    """
    ax, ay = capsule[one, 2] - capsule[one, 0], capsule[one, 3] - capsule[one, 1]
    bx, by = capsule[two, 2] - capsule[two, 0], capsule[two, 3] - capsule[two, 1]
    rx, ry = capsule[one, 0] - capsule[two, 0], capsule[one, 1] - capsule[two, 1]
    aa, bb = max(ax * ax + ay * ay, 1e-12), max(bx * bx + by * by, 1e-12)
    ab, ar, br = ax * bx + ay * by, ax * rx + ay * ry, bx * rx + by * ry
    cross = aa * bb - ab * ab
    along_a = 0.0
    if cross > 1e-12 * aa * bb:
        along_a = min(1.0, max(0.0, (ab * br - ar * bb) / cross))
    along_b = min(1.0, max(0.0, (ab * along_a + br) / bb))
    along_a = min(1.0, max(0.0, (ab * along_b - ar) / aa))
    gap_x, gap_y = rx + along_a * ax - along_b * bx, ry + along_a * ay - along_b * by
    distance = math.sqrt(gap_x * gap_x + gap_y * gap_y)
    room = clearance + capsule[one, 4] + capsule[two, 4]
    depth = max(0.0, (room - distance) / room)
    if distance < 1e-9:
        short_a = min(along_a, 1.0 - along_a) * math.sqrt(ax * ax + ay * ay)
        short_b = min(along_b, 1.0 - along_b) * math.sqrt(bx * bx + by * by)
        crossing = min(short_a, short_b)
        depth += crossing / (crossing + room)
    return depth


@inlined
def _over_sheet(capsules, limits, scratch):
    """Return by how much a flat robot exceeds the sheet in its best rotation.

    Of a branch only the end counts: it begins within the wider end of its parent. The trunk begins
    with the two corners of the tail.
    """
    turns = scratch.turn.shape[1]
    low, high, capsule = scratch.low, scratch.high, scratch.capsule
    for t in range(turns):
        middle = capsule[0, 0] * scratch.turn[0, t] + capsule[0, 1] * scratch.turn[1, t]
        half = capsule[0, 4] * abs(scratch.turn[1, t])
        low[t], high[t] = middle - half, middle + half
    for k in range(capsules):
        x, y, half = capsule[k, 2], capsule[k, 3], capsule[k, 4]
        for t in range(turns):
            across = x * scratch.turn[0, t] + y * scratch.turn[1, t]
            low[t] = across - half if across - half < low[t] else low[t]
            high[t] = across + half if across + half > high[t] else high[t]
    least, quarter = math.inf, turns // 2
    for t in range(turns):
        other = t + quarter if t + quarter < turns else t + quarter - turns
        wide, tall = high[t] - low[t], high[other] - low[other]
        over = max(wide - limits.sheet_wide_mm, tall - limits.sheet_high_mm)
        least = min(least, over)
    return least
