"""The compiled penalty of trees of any shape.

It computes the penalties of many trees without building an object for any of them. The tests
compare it with a readable twin (``tests/oracles/penalty.py``); the pattern of a compensated design
is `vinefab.inflation.pattern.quick_pattern`, that of single joints `vinefab.inflation.law.law_of`.
Like `vinefab.growth.kernel` it imports no module of vinefab but `core.compiling`.

Rows are straight parts of branches, parents first; the rows that begin at the end of another, its
children, follow each other. Of alike rules the worst place of each level counts, or every place.
Joints that are alike, as all of a level are where designs branch evenly, are worked out once.
"""

import math

from vinefab.core.compiling import called, compiled, inlined, takes

# mypy: allow-untyped-defs, allow-untyped-calls
# ruff: noqa: ANN001, ANN202, ANN201  numba infers the types of compiled functions
# ruff: noqa: PLR0913, PLR0917  arrays are the compiled way to hand things over


# Types of arguments, see `takes`.
_TREES = "vinefab.search.penalty_batch:TreeRows(i1 i1 i1 i1 i1 i1 i1 i1 i1 f1 f1 f1 f1 f1 f1 f1)"
_TABLES = (
    "vinefab.search.penalty_batch:BuildTables("
    "f2 f2 f2 f2 f1 f1 f1 f1 i2 i1 f2 i1 f2 i3 f3 f1 f3 f f f2 f2 f2 f2 f f i f)"
)
_LIMITS = (
    "vinefab.search.penalty_batch:PenaltyLimits("
    "f f f f f f f f f f f f f f b f f f f f f i f i i f f f f f f f f b f f f f f f b)"
)
_SCRATCH = (
    "vinefab.search.penalty_batch:Scratch("
    "f1 f1 f1 f1 f1 f1 f1 f1 i1 f1 f1 f1 f1 f1 f2 f2 f2 f2 i1 i1 f2 f1 f1 f2)"
)
_CUTTING = (
    "vinefab.search.penalty_batch:CutScratch("
    "i1 i1 f1 i1 i1 i2 i1 i1 i1 i1 i1 i1 i1 i1 f1 i1 f1 f1 f1 f1 f1 f1 i2 i1 i1 i1 i1 i1 f1 "
    "f2 i1 f1)"
)

BODIES, WIDTHS, JOINTS, SIDES, PACKING = range(5)
"""Kinds of rules of which the worst place of each level, or every place, counts."""

ABOUT, GAIN_STEPS = 8, 8  # as `vinefab.inflation.law`

RATIO, FILLET, STRAIN = range(3)
"""Rows of the law's ranges."""

WANTED, AIMED, RATIOS, FILLETS, CUT, BACK, ASIDE, LAW_ROWS = range(3, 11)
"""Rows of memory for the children of a joint, behind those of the law, and how many in all."""


@compiled
@takes(f"{_TREES} {_TABLES} {_LIMITS} {_SCRATCH} f1", seconds=7.4)
def penalize(trees, tables, limits, scratch, penalty):
    """Write the penalty of every tree: of growth and of the cheap geometric rules.

    Parameters
    ----------
    trees, tables, limits, scratch
        As `TreeRows`, `BuildTables`, `PenaltyLimits` and `Scratch` of the batch.
    penalty
        Where the penalties go, shape (m,).
    """
    for d in range(len(trees.depth)):
        rows = trees.first[d + 1] - trees.first[d]
        penalty[d] = _of_branches(trees, d, tables, limits, scratch)
        if rows > limits.most_branches:
            penalty[d] += math.log1p(float(rows) ** 2)
        else:
            capsules = _lay_out(trees, d, tables, limits, scratch)
            near, bare = 0.0, scratch.bare[0]
            for one in range(capsules):
                for two in range(one + 1, capsules):
                    if _may_conflict(trees, d, one, two, bare, scratch):
                        near += _pair_depth(scratch.capsule, one, two, limits.clearance_mm)
            penalty[d] += math.log1p(near + _over_sheet(trees, d, capsules, limits, scratch))


@compiled
@takes(f"{_TREES} {_TABLES} {_LIMITS} {_SCRATCH} {_CUTTING} f1 i1", seconds=23.3)
def penalize_pieces(trees, tables, limits, scratch, cutting, penalty, joints):
    """Write the penalty of every tree that may be cut in pieces, and how often it is cut."""
    for d in range(len(trees.depth)):
        rows, joints[d] = trees.first[d + 1] - trees.first[d], 0
        penalty[d] = _of_branches(trees, d, tables, limits, scratch)
        if rows > limits.most_branches:
            penalty[d] += math.log1p(float(rows) ** 2)
            continue
        capsules = _lay_out(trees, d, tables, limits, scratch)
        near, pairs = _near_pairs(trees, d, capsules, limits, scratch, cutting)
        if rows > len(cutting.cut) or pairs > len(cutting.one):
            penalty[d] += math.log1p(near + _over_sheet(trees, d, capsules, limits, scratch))
        else:
            _place_joints(trees, d, capsules, tables, limits, scratch, cutting)
            _prepare_pairs(trees, d, capsules, pairs, limits, scratch, cutting)
            left, joints[d] = _in_pieces(
                trees, d, capsules, pairs, tables, limits, scratch, cutting
            )
            cutting.left[0] = left
            penalty[d] += math.log1p(left)


@compiled
@takes(f"{_TREES} {_TABLES} {_LIMITS} {_SCRATCH} f1", seconds=1.0)
def add_path_excess(trees, tables, limits, scratch, excess):
    """Add every tree's distance from paths fit for the laser: side lengths and drawn fillets."""
    for d in range(len(trees.depth)):
        _clear_worst(trees, d, scratch)
        _cut_joints(trees, d, tables, limits, scratch)
        _joints(trees, d, limits, scratch)
        _clear_worst(trees, d, scratch)
        _drawn_fillets(trees, d, limits, scratch)
        _short_sides(trees, d, limits.side_mm, tables, limits, scratch)
        excess[d] += _worst(trees, d, JOINTS, scratch) + _worst(trees, d, SIDES, scratch)


@inlined
def _of_branches(trees, d, tables, limits, scratch):
    """Return the penalty of the rules that need no flat layout."""
    _clear_worst(trees, d, scratch)
    _cut_joints(trees, d, tables, limits, scratch)
    _joints(trees, d, limits, scratch)
    _short_sides(trees, d, limits.segment_mm, tables, limits, scratch)
    _widths(trees, d, limits, scratch)
    _packing(trees, d, tables, limits, scratch)
    penalty = math.log1p(_growth_excess(trees, d, tables, limits, scratch))
    penalty += math.log1p(_worst(trees, d, WIDTHS, scratch))
    joints = _worst(trees, d, JOINTS, scratch) + _worst(trees, d, SIDES, scratch)
    penalty += math.log1p(joints + _worst(trees, d, BODIES, scratch))
    return penalty + math.log1p(_worst(trees, d, PACKING, scratch))


@inlined
def _clear_worst(trees, d, scratch):
    for kind in range(scratch.worst.shape[0]):
        for level in range(trees.depth[d]):
            scratch.worst[kind, level] = 0.0


@inlined
def _note(kind, level, depth, limits, scratch):
    """Note how deep a place on a level violates rules of a kind."""
    before = scratch.worst[kind, level]
    scratch.worst[kind, level] = before + depth if limits.each_place else max(before, depth)


@inlined
def _worst(trees, d, kind, scratch):
    """Return the worst violations of a kind on each level, added up."""
    found = 0.0
    for level in range(trees.depth[d]):
        found += scratch.worst[kind, level]
    return found


# --- The pattern --------------------------------------------------------------------------------


@inlined
def _cut_joints(trees, d, tables, limits, scratch):
    """Write the flat angles and lengths of all rows, the gaps between them and their passages.

    They are the planned ones where nothing is compensated, else those of
    `vinefab.inflation.pattern.quick_pattern`. Noted are fans narrower than any that was simulated,
    and inflated siblings that lie on each other too far.
    """
    base, rows, build = trees.first[d], trees.first[d + 1] - trees.first[d], trees.build[d]
    stretch, away, twin = trees.stretch, scratch.away, scratch.twin
    scratch.passage[0], scratch.angle[0] = 1.0, 0.0
    scratch.run[0] = trees.length[base] / stretch[base]
    for k in range(rows - 1, -1, -1):
        away[k] = 0.0
        for c in range(trees.kid[base + k], trees.kid[base + k] + trees.kids[base + k]):
            away[k] += trees.length[base + c] + away[c]
        away[k] /= max(1, trees.kids[base + k])
    last = -1  # the joint before
    for k in range(rows):
        children, first = trees.kids[base + k], trees.kid[base + k]
        twin[k] = k
        if children == 0:
            continue
        level = trees.level[base + first] - 1  # of the children, from 0
        if last >= 0 and not limits.each_place and _is_twin(trees, base, k, last, scratch):
            twin[k] = last
            for n in range(children):
                _copy_row(first + n, trees.kid[base + last] + n, scratch)
            continue
        last = k
        fan = _even_fan(trees, base, k)
        law = -1
        if fan >= 0.0 and children < tables.law_at.shape[2]:
            law = tables.law_at[build, level - 1, children]
        if limits.compensated and children > 1:
            _note(BODIES, level, _touching(trees, base, k, limits), limits, scratch)
        if limits.compensated and law >= 0:
            beyond = _compensate(trees, base, k, fan, law, tables, scratch)
            scratch.worst[BODIES, level] += beyond
        elif law < 0 and fan < 0.0:
            _note(BODIES, level, _by_law(trees, base, k, tables, limits, scratch), limits, scratch)
        else:
            passage = _at(tables.drawn[law], fan, 0) if law >= 0 else 1.0
            for c in range(first, first + children):
                scratch.angle[c], scratch.run[c] = trees.offset[base + c], trees.length[base + c]
                scratch.passage[c] = passage
        _measure_gaps(first, children, scratch)


@inlined
def _measure_gaps(first, children, scratch):
    """Write the gaps before and after each child of a joint."""
    before = -math.pi
    for c in range(first, first + children):
        scratch.before[c] = scratch.angle[c] - before
        scratch.after[c] = math.pi - scratch.angle[c]
        if c > first:
            scratch.after[c - 1] = scratch.before[c]
        before = scratch.angle[c]


@inlined
def _is_twin(trees, base, k, other, scratch):
    """Return whether two joints are alike, and their children."""
    one, two = base + trees.kid[base + k], base + trees.kid[base + other]
    same = trees.kids[base + k] == trees.kids[base + other]
    same &= trees.level[base + k] == trees.level[base + other]
    same &= trees.half[base + k] == trees.half[base + other]
    same &= trees.end_half[base + k] == trees.end_half[base + other]
    same &= scratch.away[k] == scratch.away[other]
    if not same:
        return False
    for n in range(trees.kids[base + k]):
        a, b = one + n, two + n
        same &= (trees.offset[a] == trees.offset[b]) & (trees.length[a] == trees.length[b])
        same &= (trees.half[a] == trees.half[b]) & (trees.end_half[a] == trees.end_half[b])
        same &= (trees.fillet[a] == trees.fillet[b]) & (trees.bend[a] == trees.bend[b])
    return same


@inlined
def _copy_row(to, row, scratch):
    """Write what is known of a row to another one."""
    scratch.angle[to], scratch.run[to] = scratch.angle[row], scratch.run[row]
    scratch.before[to], scratch.after[to] = scratch.before[row], scratch.after[row]
    scratch.passage[to] = scratch.passage[row]


@inlined
def _even_fan(trees, base, k):
    """Return the fan of a joint whose children are alike and evenly apart; -1 of any other."""
    children, first = trees.kids[base + k], base + trees.kid[base + k]
    fan, close = trees.offset[first + children - 1] - trees.offset[first], 1e-9
    if trees.bend[first] or fan < 0.0:
        return -1.0
    for n in range(children):
        even = fan * (n / (children - 1.0) - 0.5) if children > 1 else 0.0
        c = first + n
        alike = trees.half[c] == trees.half[first] and trees.fillet[c] == trees.fillet[first]
        if not alike or abs(trees.offset[c] - even) > close:
            return -1.0
    return fan


@inlined
def _touching(trees, base, k, limits):
    """Return by how much too far siblings of a deployed fan lie on each other, as VF-I04."""
    worst, first = 0.0, base + trees.kid[base + k]
    for c in range(first + 1, first + trees.kids[base + k]):
        gap, contact_mm = trees.offset[c] - trees.offset[c - 1], math.inf
        if gap >= math.pi:
            continue
        one, two = trees.half[c - 1], trees.half[c]
        if gap > 0.0 and one == two:
            contact_mm = 2.0 * one / math.pi / math.sin(gap / 2.0)
        elif gap > 0.0:
            cos = math.cos(gap)
            contact_mm = math.sqrt(one * one + two * two + 2.0 * one * two * cos) / math.sin(gap)
            contact_mm *= 2.0 / math.pi
        shortest_mm = min(trees.length[c], trees.length[c - 1])
        worst = max(worst, _excess(contact_mm / shortest_mm, limits.sibling_share, limits.most))
    return worst


@inlined
def _compensate(trees, base, k, fan, place, tables, scratch):
    """Write the children of a joint as the law cuts them."""
    law, most = tables.law[place], (tables.law.shape[2] - 2) // 2
    least, children, first = tables.least[place], trees.kids[base + k], trees.kid[base + k]
    width = 2.0 * trees.end_half[base + k]
    # Children stand off their designed axes: turned a little, their tips come nearer.
    offset_mm = width * _at(law, fan, 2 * most)
    most_rad = min(tables.most_turn, fan / 10.0)
    cut = fan - 2.0 * min(max(offset_mm / scratch.away[k], -most_rad), most_rad)
    passage = _at(law, cut, 2 * most + 1)
    for child in range(children):
        c = first + child
        scratch.angle[c] = _at(law, cut, child)
        back_mm = width * _at(law, cut, most + child)
        run_mm = trees.length[base + c]
        run_mm = max(run_mm + back_mm, tables.least_length * run_mm)
        scratch.run[c] = run_mm / trees.stretch[base + c]
        scratch.passage[c] = passage
    return (least - fan) / least if fan < least else 0.0


@inlined
def _at(law, fan, column):
    """Return a column of a law at a deployed fan, between those of whole degrees."""
    place = min(math.degrees(fan), law.shape[0] - 1.0)
    row = min(int(place), law.shape[0] - 2)
    return law[row, column] + (place - row) * (law[row + 1, column] - law[row, column])


@called
def _by_law(trees, base, k, tables, limits, scratch):
    """Write the children of an uneven fan, or behind a bend, as the law of single joints tells.

    Returned is by how much the joint lies beyond the law's range; with too many children it is cut
    as designed.
    """
    children, first, law = trees.kids[base + k], trees.kid[base + k], scratch.law
    width, passage, beyond, within = 2.0 * trees.end_half[base + k], 1.0, 0.0, tables.law_within
    if children > tables.law_children:
        beyond = float(children - tables.law_children)
    else:
        for n in range(children):
            c = base + first + n
            law[WANTED, n] = law[AIMED, n] = trees.offset[c]
            law[RATIOS, n] = _between(2.0 * trees.half[c] / width, within[RATIO])
            law[FILLETS, n] = _between(trees.fillet[c] / width, within[FILLET])
            turn = abs(math.degrees(trees.offset[c])) / tables.law_most_deg
            beyond = max(beyond, turn - 1.0)
            if n:
                gap = math.degrees(trees.offset[c] - trees.offset[c - 1]) / tables.law_least_deg
                beyond = max(beyond, 1.0 - gap)
        passage = _single_joint(trees, base, k, tables, limits, scratch)
    for n in range(children):
        c = first + n
        angle, run_mm = trees.offset[base + c], trees.length[base + c]
        if limits.compensated and children <= tables.law_children:
            # Turned a little, as even fans are.
            most_rad = min(tables.most_turn, abs(angle) / 5.0)
            turn_rad = width * law[ASIDE, n] / (run_mm + scratch.away[c])
            angle = law[CUT, n] - min(max(turn_rad, -most_rad), most_rad)
            run_mm = max(run_mm + width * law[BACK, n], tables.least_length * run_mm)
            run_mm /= trees.stretch[base + c]
        elif n and not limits.compensated and children <= tables.law_children:
            # As cut siblings deploy through each other.
            gap = math.degrees(law[CUT, n] - law[CUT, n - 1]) / tables.law_least_deg
            beyond = max(beyond, 1.0 - gap if gap <= 0.0 else 0.0)
        scratch.angle[c], scratch.run[c], scratch.passage[c] = angle, run_mm, passage
    return beyond


@inlined
def _between(value, ends):
    return min(max(value, ends[0]), ends[1])


@inlined
def _single_joint(trees, base, k, tables, limits, scratch):
    """Write a joint that deploys as aimed, or what it deploys to as drawn; return its passage.

    As `vinefab.inflation.law.flat_by_law`, or as its ``law_of("deployed", ...)``.
    """
    children, first, law = trees.kids[base + k], base + trees.kid[base + k], scratch.law
    strain, is_bend = _between(trees.strain[base + k], tables.law_within[STRAIN]), trees.bend[first]
    if is_bend and trees.offset[first] == 0.0:  # straight on
        law[CUT, 0] = law[BACK, 0] = law[ASIDE, 0] = 0.0
        return 1.0
    passage = _law_of(tables, children, strain, is_bend, limits.compensated, law)
    if limits.compensated and tables.gain != 1.0:
        for _ in range(GAIN_STEPS):
            for n in range(children):
                turned = law[CUT, n] + tables.gain * (law[AIMED, n] - law[CUT, n])
                law[AIMED, n] += law[WANTED, n] - turned
            passage = _law_of(tables, children, strain, is_bend, limits.compensated, law)
    return passage


@called
def _law_of(tables, count, strain, is_bend, is_flat, law):
    """Write angles (rad), pull-backs and side offsets by the law; return the passage.

    Angles are the flat ones of those aimed at, or those that these deploy to.
    """
    passage, x, aimed = 1.0, law[0], law[AIMED]
    for child in range(count):
        x[0] = math.degrees(aimed[child]) / 60.0
        x[1] = 2.0 * law[RATIOS, child] - 1.4
        x[2] = math.log(strain) / 2.0 + 1.8
        x[3] = 1.0 if is_bend else 0.0
        x[4] = count / 2.0 - 1.25
        _neighbours(x, 5, 1, child, count, law)
        _neighbours(x, 5 + ABOUT, -1, child, count, law)
        turn, side, away, through = _outputs(tables, law)
        x[0] = -x[0]
        for k in range(5, 5 + ABOUT):
            x[k], x[k + ABOUT] = x[k + ABOUT], x[k]
        turn_there, side_there, away_there, through_there = _outputs(tables, law)
        turn_rad = math.radians(turn - turn_there) / 2.0
        law[CUT, child] = aimed[child] - (turn_rad if is_flat else -turn_rad)
        law[ASIDE, child] = (side - side_there) / 2.0
        law[BACK, child] = (away + away_there) / 2.0
        passage = min(passage, (through + through_there) / 2.0)
    return max(passage, 0.1)


@inlined
def _neighbours(x, base, way, child, count, law):
    """Write what tells of the two neighbours on one side."""
    before, fillet = math.degrees(law[AIMED, child]), law[FILLETS]
    for step in range(2):
        place = (child + 1 + way * (step + 1)) % (count + 1)
        there, width = 180.0, 1.0
        if place > 0:
            there, width = math.degrees(law[AIMED, place - 1]), law[RATIOS, place - 1]
        gap = (way * (there - before)) % 360.0
        if gap == 0.0:
            gap = 360.0
        between = (child + 1 + step if way > 0 else child - step) % (count + 1)
        radius = fillet[min(between, count - 1)]
        if between > 0:
            radius = min(radius, fillet[between - 1])
        at = base + 4 * step
        x[at] = gap / 60.0 - 1.5
        x[at + 1] = 2.0 * math.exp(-gap / 25.0)
        x[at + 2] = math.log(radius) + 2.0
        x[at + 3] = 2.0 * width - 1.4
        before = there


@called
def _outputs(tables, law):
    """Return turn, side offset, pull-back and passage of the child in the first row of memory."""
    first, second, last = tables.law_first, tables.law_second, tables.law_last
    inputs, units = first.shape[0] - 1, first.shape[1]
    x, one, two = law[0], law[1], law[2]
    for j in range(units):
        one[j] = first[inputs, j]
    for i in range(inputs):
        for j in range(units):
            one[j] += x[i] * first[i, j]
    for j in range(units):
        one[j] /= math.sqrt(1.0 + one[j] * one[j])
        two[j] = second[units, j]
    for i in range(units):
        for j in range(units):
            two[j] += one[i] * second[i, j]
    turn, side, away, through = last[units, 0], last[units, 1], last[units, 2], last[units, 3]
    for j in range(units):
        two[j] /= math.sqrt(1.0 + two[j] * two[j])
        turn += two[j] * last[j, 0]
        side += two[j] * last[j, 1]
        away += two[j] * last[j, 2]
        through += two[j] * last[j, 3]
    return turn, side, away, through


# --- Pressure for growth ------------------------------------------------------------------------


@inlined
def _growth_excess(trees, d, tables, limits, scratch):
    """Return the relative excess of the pressure that growth to the worst tip takes.

    As `vinefab.physics.growth_pressure.planned_growth_kpa`, row by row.
    """
    base, rows = trees.first[d], trees.first[d + 1] - trees.first[d]
    riding, factor, drag = scratch.riding, scratch.factor, scratch.drag
    for k in range(rows):
        riding[k] = 0.0
    for k in range(rows - 1, 0, -1):
        own_mm2 = 0.0 if trees.bend[base + k] else _film_mm2(trees, base, k)
        riding[trees.parent[base + k]] += riding[k] + own_mm2
    worst = 0.0
    for k in range(rows):
        parent, width = trees.parent[base + k], 2.0 * trees.half[base + k]
        factor[k], drag[k] = 1.0, 0.0
        if parent >= 0:
            bend = math.exp(limits.friction * abs(trees.offset[base + k]))
            factor[k] = factor[parent] * bend
            above_kpa = limits.drag_kpa_mm * trees.length[base + parent]
            drag[k] = (drag[parent] + above_kpa) * bend
        own_kpa = limits.drag_kpa_mm * trees.length[base + k]
        store_kpa = limits.storage_kpa + limits.drag_kpa_mm * riding[k] / width
        takes_kpa = limits.yield_kpa + store_kpa * factor[k] + drag[k] + own_kpa
        worst = max(worst, takes_kpa * limits.fitted_width_mm / width)
    return min(limits.most, max(0.0, worst / tables.most_kpa[trees.build[d]] - 1.0))


@inlined
def _film_mm2(trees, base, k):
    """Return the lay-flat area of the branch that begins with a row."""
    area_mm2 = 0.0
    while True:
        area_mm2 += trees.length[base + k] * 2.0 * trees.half[base + k]
        if trees.kids[base + k] == 0 or not trees.bend[base + trees.kid[base + k]]:
            return area_mm2
        k = trees.kid[base + k]


# --- Joints -------------------------------------------------------------------------------------


@inlined
def _joints(trees, d, limits, scratch):
    """Note the violations by angles, crotches, fillets and arcs, and write where sides begin.

    Joints that are alike are judged once, with the shortest of their parents.
    """
    base, rows = trees.first[d], trees.first[d + 1] - trees.first[d]
    twin, above = scratch.twin, scratch.above
    scratch.begin[0] = 0.0
    for k in range(rows):
        above[k] = scratch.run[k]
        above[twin[k]] = min(above[twin[k]], scratch.run[k])
    for k in range(rows):
        children, first, other = trees.kids[base + k], trees.kid[base + k], twin[k]
        if children == 0:
            continue
        if other != k:
            scratch.stop[k] = scratch.stop[other]
            for n in range(children):
                scratch.begin[first + n] = scratch.begin[trees.kid[base + other] + n]
            continue
        level = trees.level[base + first] - 1
        depth = _joint_depth(trees, base, k, above[k], limits, scratch)
        _note(JOINTS, level, depth, limits, scratch)


@inlined
def _joint_depth(trees, base, k, above_mm, limits, scratch):
    """Return the summed violations at a joint; write where its sides begin to be straight."""
    children, first = trees.kids[base + k], trees.kid[base + k]
    wide, disc = trees.end_half[base + k], _disc(trees, base, k)
    lean = _least_lean(trees, base, k, limits, scratch)
    tilt = lean - _lean(trees.half[base + k], wide, above_mm, limits)
    beside, between, share = 0.0, math.inf, 0.0
    scratch.stop[k] = 0.0
    for gap in range(children + 1):
        left, right, after, before = _beside_gap(first, children, gap)
        one, two, angle, fillet = _gap(trees, base, k, left, right, after, before, scratch)
        if after and before:
            angle += 2.0 * lean
            between = min(between, angle)
            shorter_mm = min(scratch.run[left], scratch.run[right])
            reach_mm = _bare_reach(angle, one, two, disc)
            share = max(share, reach_mm / shorter_mm)
        else:
            angle += tilt
            child_mm = scratch.run[right] if before else scratch.run[left]
            reach_mm = _bare_reach(angle, one, two, disc)
            within_mm = child_mm if reach_mm <= disc else min(child_mm, above_mm)
            deep = _excess(reach_mm / within_mm, limits.crotch, limits.most)
            beside = max(beside, _narrow(angle, limits) + deep)
        a, b = _straight_begins(angle, one, two, fillet, disc)
        if after:
            scratch.begin[left] = max(scratch.begin[left], a)
        else:
            scratch.stop[k] = max(scratch.stop[k], a)
        if before:
            scratch.begin[right] = b
        else:
            scratch.stop[k] = max(scratch.stop[k], b)
    found = beside
    if children > 1:
        found += _narrow(between, limits) + _excess(share, limits.crotch, limits.most)
    return found + _small_arcs(trees, base, k, above_mm, limits, scratch)


@inlined
def _least_lean(trees, base, k, limits, scratch):
    """Return by how much the sides of all children at a joint lean at least."""
    lean, first = math.inf, trees.kid[base + k]
    for c in range(first, first + trees.kids[base + k]):
        one, end = trees.half[base + c], trees.end_half[base + c]
        lean = min(lean, _lean(one, end, scratch.run[c], limits))
    return lean


@inlined
def _disc(trees, base, k):
    """Return the radius of the disc at a joint: half the widest of its bodies."""
    disc, first = trees.end_half[base + k], base + trees.kid[base + k]
    for c in range(first, first + trees.kids[base + k]):
        disc = max(disc, trees.half[c])
    return disc


@inlined
def _beside_gap(first, children, gap):
    """Return the children before and after a gap, and whether there are such."""
    return first + gap - 1, first + gap, gap > 0, gap < children


@inlined
def _gap(trees, base, k, left, right, after, before, scratch):
    """Return half the widths of the bodies at a gap, its bare angle, and its designed fillet."""
    one = trees.half[base + left] if after else trees.end_half[base + k]
    two = trees.half[base + right] if before else trees.end_half[base + k]
    angle = scratch.before[right] if before else scratch.after[left]
    return one, two, angle, _designed_fillet(trees, base, left, right, after, before)


@inlined
def _designed_fillet(trees, base, left, right, after, before):
    """Return the fillet of a gap: between two children the smaller one, else the child's own."""
    if after and before:
        return min(trees.fillet[base + left], trees.fillet[base + right])
    return trees.fillet[base + left] if after else trees.fillet[base + right]


@inlined
def _short_sides(trees, d, least_mm, tables, limits, scratch):
    """Note what is missing for straight sides of a least length.

    The side of an even trunk continues along the tail.
    """
    base, rows, build = trees.first[d], trees.first[d + 1] - trees.first[d], trees.build[d]
    for k in range(rows):
        half, end, length_mm = trees.half[base + k], trees.end_half[base + k], scratch.run[k]
        level, lean = trees.level[base + k] - 1, 0.0
        if half != end:
            lean = _lean(half, end, length_mm, limits)
        if k == 0 and lean == 0.0:
            length_mm += tables.even_mm[build]
        elif lean != 0.0:
            length_mm *= math.cos(lean)
        stop_mm = scratch.stop[k] if trees.kids[base + k] else tables.tip[build, level]
        room_mm = length_mm - scratch.begin[k] - stop_mm
        _note(SIDES, level, _crowded(room_mm, length_mm, least_mm, limits), limits, scratch)


@inlined
def _drawn_fillets(trees, d, limits, scratch):
    """Note by how much the fillets of the tightest gaps fall short of the least."""
    base, rows = trees.first[d], trees.first[d + 1] - trees.first[d]
    for k in range(rows):
        children, first = trees.kids[base + k], trees.kid[base + k]
        if children == 0 or scratch.twin[k] != k:
            continue
        wide, disc, above_mm = trees.end_half[base + k], _disc(trees, base, k), scratch.above[k]
        lean = _least_lean(trees, base, k, limits, scratch)
        tilt = lean - _lean(trees.half[base + k], wide, above_mm, limits)
        beside, between = 0.0, 0.0
        for gap in range(children + 1):
            left, right, after, before = _beside_gap(first, children, gap)
            one, two, angle, fillet = _gap(trees, base, k, left, right, after, before, scratch)
            angle += 2.0 * lean if after and before else tilt
            shorter_mm = _shorter(first, children, gap, above_mm, scratch)
            most = _largest_fillet(angle, one, two, max(0.5 * shorter_mm, disc))
            lack = _excess(limits.drawn_mm, max(0.0, min(fillet, most)), limits.most)
            if after and before:
                between = max(between, lack)
            else:
                beside = max(beside, lack)
        _note(JOINTS, trees.level[base + first] - 1, beside + between, limits, scratch)


@inlined
def _lean(half, end, length, limits):
    """Return the angle by which a branch's sides lean, as `outline.joint.taper_rad`."""
    if half == end:
        return 0.0
    return math.asin(max(-limits.steepest, min(limits.steepest, (half - end) / length)))


@inlined
def _small_arcs(trees, base, k, above_mm, limits, scratch):
    """Return by how much fillets, and the arcs between them, fall short of rules and laser.

    An even fan is its own mirror image: of two like gaps the one next to the shorter branch counts.
    """
    found, children, first = 0.0, trees.kids[base + k], trees.kid[base + k]
    disc, even = _disc(trees, base, k), _even_fan(trees, base, k)
    gaps = (children + 2) // 2 if even >= 0.0 else children + 1
    for gap in range(gaps):
        left, right, after, before = _beside_gap(first, children, gap)
        one, two, angle, fillet = _gap(trees, base, k, left, right, after, before, scratch)
        shorter_mm = _shorter(first, children, gap, above_mm, scratch)
        if even >= 0.0:
            mirrored_mm = _shorter(first, children, children - gap, above_mm, scratch)
            shorter_mm = min(shorter_mm, mirrored_mm)
        most = _largest_fillet(angle, one, two, max(0.5 * shorter_mm, disc))
        radius, least = max(0.0, min(fillet, most)), limits.fillet_mm
        arc = (radius - limits.seal_mm) * _largest_turn(angle, one, two, radius, disc)
        if radius < limits.run_mm and arc >= limits.segment_mm:
            least = max(least, limits.run_mm)
        if angle < math.pi or not trees.bend[base + first]:
            found += _excess(least, radius, limits.most)
        if angle < math.pi and trees.bend[base + first] and arc >= limits.segment_mm:
            found += max(0.0, (limits.end_mm - arc) / limits.end_mm)  # of a bend that hardly turns
        end = (disc + limits.seal_mm) * _end_shown(angle, one, two, radius, disc)
        if end >= limits.segment_mm:
            found += max(0.0, (limits.end_mm - end) / limits.end_mm)
    return found


@inlined
def _shorter(first, children, gap, above_mm, scratch):
    """Return the length of the shorter body at a gap."""
    one_mm = scratch.run[first + gap - 1] if gap > 0 else above_mm
    two_mm = scratch.run[first + gap] if gap < children else above_mm
    return min(one_mm, two_mm)


@inlined
def _end_shown(angle, one, two, radius, disc):
    """Return the angle over which a parent's round end shows between two fillets."""
    a, b = math.asin((one + radius) / (disc + radius)), math.asin((two + radius) / (disc + radius))
    return angle - a - b


@inlined
def _largest_turn(angle, one, two, radius, disc):
    """Return the largest angle that a fillet between two neighbours turns through."""
    a, b = math.asin((one + radius) / (disc + radius)), math.asin((two + radius) / (disc + radius))
    return math.pi / 2.0 - min(a, b) if a + b <= angle else math.pi - angle


@inlined
def _narrow(angle, limits):
    """Return by how much an angle is narrower than the least, relative to it."""
    return max(0.0, (limits.angle_deg - math.degrees(angle)) / limits.angle_deg)


@inlined
def _excess(value, limit, most):
    """Return the relative excess of a value over a limit, capped."""
    return 0.0 if value <= limit else min(most, (value - limit) / max(abs(limit), 1e-9))


@inlined
def _crowded(room_mm, length_mm, least_mm, limits):
    """Return the share of a branch missing for its side to keep a least length, capped."""
    return min(limits.most, max(0.0, (least_mm - room_mm) / length_mm))


@inlined
def _bare_reach(angle, one, two, disc):
    """Return the distance from the joint to where two sides part: a crossing or the disc's edge."""
    if math.asin(one / disc) + math.asin(two / disc) <= angle:
        return disc
    sin, cos = math.sin(angle), math.cos(angle)
    if sin < 1e-9:
        return math.inf
    return math.sqrt(one * one + two * two + 2.0 * one * two * cos) / sin


@inlined
def _straight_begins(angle, one, two, fillet, least_disc):
    """Return the distance from the joint at which straight sides of two neighbours begin."""
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
def _widths(trees, d, limits, scratch):
    """Note branches that are too narrow, or too wide for their parents."""
    base, rows = trees.first[d], trees.first[d + 1] - trees.first[d]
    for k in range(rows):
        end_mm, wide_mm, lack = 2.0 * trees.end_half[base + k], 2.0 * trees.half[base + k], 0.0
        if end_mm < limits.width_mm:
            lack += (limits.width_mm - end_mm) / limits.width_mm
        if k > 0 and not trees.bend[base + k]:
            ratio = 2.0 * trees.end_half[base + trees.parent[base + k]] / wide_mm
            if ratio < limits.width_ratio:
                lack += (limits.width_ratio - ratio) / limits.width_ratio
        _note(WIDTHS, trees.level[base + k] - 1, lack, limits, scratch)


@inlined
def _packing(trees, d, tables, limits, scratch):
    """Note by how much folded film overfills the lumens that it rides in.

    What rides in a child comes through its joint's passage.
    """
    base, rows, build = trees.first[d], trees.first[d + 1] - trees.first[d], trees.build[d]
    inside, depth = scratch.inside, trees.depth[d]
    for k in range(rows):
        for level in range(depth):
            inside[k, level] = 0.0
    for k in range(rows - 1, -1, -1):
        level, parent = trees.level[base + k] - 1, trees.parent[base + k]
        own = 2.0 * trees.end_half[base + k]
        room_mm2, most_mm = limits.lumen * own * own * scratch.passage[k], 0.0
        for at in range(level + 1, depth):
            most_mm = max(most_mm, inside[k, at])
        percent = 100.0 * most_mm * limits.film_mm / room_mm2
        found = _excess(percent, limits.packing_percent, limits.most)
        if trees.leaf[base + k] and trees.kids[base + k] == 0:
            own_percent = 100.0 * tables.pouch_share[build, level] / scratch.passage[k]
            found += _excess(own_percent, limits.packing_percent, limits.most)
        _note(PACKING, level, found, limits, scratch)
        if parent >= 0:
            for at in range(level + 1, depth):
                inside[parent, at] += inside[k, at]
            if not trees.bend[base + k]:
                inside[parent, level] += _across(trees, base, k, tables, build)


@inlined
def _across(trees, base, k, tables, build):
    """Return the lay-flat width of the branch that begins with a row, with its pouch."""
    wide_mm = 2.0 * trees.half[base + k]
    if trees.leaf[base + k]:
        wide_mm = max(wide_mm, tables.pouch_width[build, trees.level[base + k] - 1])
    return wide_mm


_SURELY_MM = 1e-6
"""Room beyond the rounding of turned coordinates."""

# --- The flat robot -----------------------------------------------------------------------------


@inlined
def _lay_out(trees, d, tables, limits, scratch):
    """Write the capsules of a flat robot, pouches last, and their boxes; return their number."""
    base, rows, build = trees.first[d], trees.first[d + 1] - trees.first[d], trees.build[d]
    capsule, heading = scratch.capsule, scratch.heading
    for k in range(rows):
        parent, length = trees.parent[base + k], scratch.run[k]
        heading[k], x, y = 0.0, 0.0, 0.0
        if parent >= 0:
            heading[k] = heading[parent] + scratch.angle[k]
            x, y = capsule[parent, 2], capsule[parent, 3]
        capsule[k, 0], capsule[k, 1] = x, y
        capsule[k, 2] = x + length * math.cos(heading[k])
        capsule[k, 3] = y + length * math.sin(heading[k])
        capsule[k, 4], capsule[k, 5] = trees.half[base + k], trees.end_half[base + k]
        scratch.owner[k] = k
    capsule[0, 0] -= tables.tail_mm[build]
    count = rows
    for row in range(tables.tail_first[build], tables.tail_first[build + 1]):
        for column in range(6):
            capsule[count, column] = tables.tail[row, column]
        scratch.owner[count] = 0
        count += 1
    scratch.bare[0] = count
    for piece in range(tables.pouch_count[build]):
        for k in range(rows):
            if trees.kids[base + k] == 0:
                row = tables.pouch_first[build, trees.level[base + k] - 1] + piece
                _add_pouch(capsule, count, k, tables.pouch, row, heading[k])
                scratch.owner[count] = k
                count += 1
    for k in range(count):
        _box(capsule, scratch.box, k, limits)
    return count


@inlined
def _box(capsule, box, k, limits):
    """Write the box around a capsule, grown by half the clearance."""
    grown = max(capsule[k, 4], capsule[k, 5]) + limits.clearance_mm / 2.0
    box[k, 0] = min(capsule[k, 0], capsule[k, 2]) - grown
    box[k, 1] = min(capsule[k, 1], capsule[k, 3]) - grown
    box[k, 2] = max(capsule[k, 0], capsule[k, 2]) + grown
    box[k, 3] = max(capsule[k, 1], capsule[k, 3]) + grown


@inlined
def _add_pouch(capsule, row, leaf, pouch, piece, heading):
    """Write one capsule of a leaf's pouch."""
    x, y, cos, sin = capsule[leaf, 2], capsule[leaf, 3], math.cos(heading), math.sin(heading)
    for end in (0, 2):
        along, across = pouch[piece, end], pouch[piece, end + 1]
        capsule[row, end] = x + (cos * along - sin * across)
        capsule[row, end + 1] = y + (sin * along + cos * across)
    capsule[row, 4] = capsule[row, 5] = pouch[piece, 4]


@inlined
def _near_pairs(trees, d, capsules, limits, scratch, cutting):
    """Write down as many of these pairs as there is room for; return their depths and number."""
    found, pairs, bare = 0.0, 0, scratch.bare[0]
    for one in range(capsules):
        for two in range(one + 1, capsules):
            if not _may_conflict(trees, d, one, two, bare, scratch):
                continue
            depth = _pair_depth(scratch.capsule, one, two, limits.clearance_mm)
            found += depth
            if depth <= limits.least_depth:
                continue
            if pairs < len(cutting.one):
                cutting.one[pairs], cutting.two[pairs], cutting.depth[pairs] = one, two, depth
            pairs += 1
    return found, pairs


@inlined
def _may_conflict(trees, d, one, two, bare, scratch):
    """Return whether the boxes of two capsules meet, and their branches not by design.

    Capsules from ``bare`` on are those of pouches, which meet no branch by design.
    """
    box, base = scratch.box, trees.first[d]
    beside = (box[two, 0] > box[one, 2]) | (box[two, 2] < box[one, 0])
    if beside | (box[two, 1] > box[one, 3]) | (box[two, 3] < box[one, 1]):
        return False
    a, b = scratch.owner[one], scratch.owner[two]
    up_a, up_b = trees.parent[base + a], trees.parent[base + b]
    joined = (up_a == up_b) | (up_a == b) | (up_b == a)
    return a != b and not (joined and two < bare)


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
    room = clearance + max(capsule[one, 4], capsule[one, 5])
    room += max(capsule[two, 4], capsule[two, 5])
    depth = max(0.0, (room - distance) / room)
    if capsule[one, 4] != capsule[one, 5] or capsule[two, 4] != capsule[two, 5]:
        depth = max(0.0, (clearance - _hull_gap(capsule, one, two)) / room)
    if distance < 1e-9:
        short_a = min(along_a, 1.0 - along_a) * math.sqrt(ax * ax + ay * ay)
        short_b = min(along_b, 1.0 - along_b) * math.sqrt(bx * bx + by * by)
        crossing = min(short_a, short_b)
        depth += crossing / (crossing + room)
    return depth


@called
def _hull_gap(capsule, one, two):
    """Return the free distance of two capsules of which one is tapered, negative if they overlap.

    The least distance of places on both is found by golden section along the first, as in
    `vinefab.fabrication.rules.spacing.hull_gap_mm`.
    """
    low, high = 0.0, 1.0
    for _ in range(_STEPS):
        left, right = high - _GOLDEN * (high - low), low + _GOLDEN * (high - low)
        if _disc_gap(capsule, one, left, two) <= _disc_gap(capsule, one, right, two):
            high = right
        else:
            low = left
    middle = _disc_gap(capsule, one, (low + high) / 2.0, two)
    ends = min(_disc_gap(capsule, one, 0.0, two), _disc_gap(capsule, one, 1.0, two))
    return min(middle, ends)


@called
def _disc_gap(capsule, one, along, two):
    """Return the free distance of a disc of one capsule from another capsule."""
    x = capsule[one, 0] + along * (capsule[one, 2] - capsule[one, 0])
    y = capsule[one, 1] + along * (capsule[one, 3] - capsule[one, 1])
    half = capsule[one, 4] + along * (capsule[one, 5] - capsule[one, 4])
    run_x, run_y = capsule[two, 2] - capsule[two, 0], capsule[two, 3] - capsule[two, 1]
    length, growth = math.hypot(run_x, run_y), capsule[two, 5] - capsule[two, 4]
    length = max(length, 1e-12)
    unit_x, unit_y = run_x / length, run_y / length
    lean = min(0.99, max(-0.99, growth / length))
    away_x, away_y = x - capsule[two, 0], y - capsule[two, 1]
    foot = away_x * unit_x + away_y * unit_y
    across = abs(away_x * unit_y - away_y * unit_x)
    place = min(1.0, max(0.0, (foot + across * lean / math.sqrt(1.0 - lean * lean)) / length))
    distance = math.hypot(away_x - place * run_x, away_y - place * run_y)
    return distance - capsule[two, 4] - place * growth - half


@inlined
def _over_sheet(trees, d, capsules, limits, scratch):
    """Return by how much a flat robot exceeds the sheet, over the sheet's shorter side.

    The trunk begins with the two corners of the tail.
    """
    if _fits_as_laid(capsules, limits, scratch):
        return 0.0
    _span_of_mouth(scratch)
    for k in range(capsules):
        _widen_span(scratch, k, 2)
        _widen_to_begin(trees, d, k, scratch)
    return _excess_of_span(limits, scratch)


@inlined
def _fits_as_laid(capsules, limits, scratch):
    """Return whether all boxes fit the sheet as they lie or by a quarter turn, which most do."""
    box, low_x, low_y, high_x, high_y = scratch.box, math.inf, math.inf, -math.inf, -math.inf
    for k in range(capsules):
        low_x, low_y = min(low_x, box[k, 0]), min(low_y, box[k, 1])
        high_x, high_y = max(high_x, box[k, 2]), max(high_y, box[k, 3])
    room = _SURELY_MM + max(0.0, -limits.clearance_mm)  # boxes hold half the clearance on each side
    wide, high = high_x - low_x + room, high_y - low_y + room
    lies = wide <= limits.sheet_wide_mm and high <= limits.sheet_high_mm
    return lies or (high <= limits.sheet_wide_mm and wide <= limits.sheet_high_mm)


@inlined
def _widen_to_begin(trees, d, k, scratch):
    """Widen the span to where a capsule begins; mostly that is within the wider end before it."""
    capsule, branches = scratch.capsule, trees.first[d + 1] - trees.first[d]
    if 0 < k < branches:
        if capsule[k, 4] > capsule[trees.parent[trees.first[d] + k], 5]:
            _widen_span(scratch, k, 0)
    elif branches <= k < scratch.bare[0]:
        _widen_span(scratch, k, 0)


@inlined
def _span_of_mouth(scratch):
    """Begin the places across each rotation with the tail's two corners."""
    capsule = scratch.capsule
    for t in range(scratch.turn.shape[1]):
        middle = capsule[0, 0] * scratch.turn[0, t] + capsule[0, 1] * scratch.turn[1, t]
        half = capsule[0, 4] * abs(scratch.turn[1, t])
        scratch.low[t], scratch.high[t] = middle - half, middle + half


@inlined
def _widen_span(scratch, k, end):
    """Widen the places across each rotation to the disc at one end of a capsule."""
    low, high, capsule = scratch.low, scratch.high, scratch.capsule
    x, y, half = capsule[k, end], capsule[k, end + 1], capsule[k, 4 + end // 2]
    for t in range(scratch.turn.shape[1]):
        across = x * scratch.turn[0, t] + y * scratch.turn[1, t]
        low[t] = across - half if across - half < low[t] else low[t]
        high[t] = across + half if across + half > high[t] else high[t]


@inlined
def _excess_of_span(limits, scratch):
    """Return by how much what spans these places exceeds the sheet, as `_over_sheet`."""
    low, high, turns = scratch.low, scratch.high, scratch.turn.shape[1]
    least, quarter = math.inf, turns // 2
    for t in range(turns):
        other = t + quarter if t + quarter < turns else t + quarter - turns
        wide, tall = high[t] - low[t], high[other] - low[other]
        over = max(wide - limits.sheet_wide_mm, tall - limits.sheet_high_mm)
        least = min(least, over)
    return max(0.0, least / min(limits.sheet_wide_mm, limits.sheet_high_mm))


# --- Pieces -------------------------------------------------------------------------------------
# The tests compare them with ``tests/oracles/quick_cuts.py``. After the capsules of the flat robot
# come three for each branch that may be cut: its stub, its outer part, and the outer part's socket.

STUB, OUTER, SOCKET = 0, 1, 2
"""Places of the three."""

_GOLDEN, _STEPS = (math.sqrt(5.0) - 1.0) / 2.0, 48
"""Golden section: 1e-10 of a branch is left of the search interval."""

_PARTED = 1.0 - 1e-9
"""A further cut must leave at most this share of the rest without it."""

TOO_MANY = 1_000_000
"""Cuts needed to part a pair between which no branch may be cut."""


@inlined
def _place_joints(trees, d, capsules, tables, limits, scratch, cutting):
    """Write which rows have room for a sleeve, and the capsules of their parts."""
    base, rows, build = trees.first[d], trees.first[d + 1] - trees.first[d], trees.build[d]
    capsule, known = scratch.capsule, base < len(cutting.begins)
    if not known:
        _find_straight_sides(trees, d, limits, scratch, cutting)
    for k in range(rows):
        length = scratch.run[k]
        begin = cutting.begins[base + k] if known else cutting.begin[k]
        stop = cutting.stops[base + k] if known else cutting.stop[k]
        if trees.kids[base + k] == 0:
            stop = tables.tip_cut[build, trees.level[base + k] - 1]
        begin += limits.before_mm
        rise = limits.rise_mm
        if limits.on_stub:
            # The plug is wider at its rim than farther out, where the socket's rim is.
            lean = _lean(capsule[k, 4], capsule[k, 5], length, limits)
            rise += limits.lap_mm * math.sin(lean)
        blend_mm = limits.blend_ratio * rise
        needed = begin + limits.lap_mm + blend_mm + limits.after_mm + stop
        cutting.can[k] = 0
        if k == 0 or not needed <= length + limits.least_depth:
            continue
        outer = begin + (blend_mm if limits.on_stub else 0.0)
        wide = 2.0 * (capsule[k, 4] + outer / length * (capsule[k, 5] - capsule[k, 4]))
        if not wide <= tables.widest_mm[build]:
            continue
        cutting.can[k] = 1
        row, end = capsules + 3 * k, outer + limits.lap_mm
        cutting.wide[k], cutting.rise[k] = wide, rise
        _part(scratch, row + STUB, k, 0.0, end / length, 0.0, limits)
        _part(scratch, row + OUTER, k, outer / length, 1.0, 0.0, limits)
        rim, blend = (end, begin) if limits.on_stub else (outer, end + blend_mm)
        _part(scratch, row + SOCKET, k, rim / length, blend / length, rise, limits)


@inlined
def _find_straight_sides(trees, d, limits, scratch, cutting):
    """Write where even sides of each row begin to be straight, and where they stop.

    Corners in place of small fillets lie farther from the joint where the cut runs.
    """
    base, rows = trees.first[d], trees.first[d + 1] - trees.first[d]
    begin, stop = cutting.begin, cutting.stop
    begin[0] = stop[0] = 0.0
    for k in range(rows):
        children, first, other = trees.kids[base + k], trees.kid[base + k], scratch.twin[k]
        stop[k] = 0.0
        if children and other != k:
            stop[k] = stop[other]
            for n in range(children):
                begin[first + n] = begin[trees.kid[base + other] + n]
        elif children:
            _find_sides_at(trees, base, k, limits, scratch, cutting)


@inlined
def _find_sides_at(trees, base, k, limits, scratch, cutting):
    """Write where the sides at a joint begin to be straight, and where those of its parent stop."""
    children, first, begin = trees.kids[base + k], trees.kid[base + k], cutting.begin
    disc, stop = _disc(trees, base, k), 0.0
    for c in range(first, first + children):
        begin[c] = 0.0
    for gap in range(children + 1):
        left, right, after, before = _beside_gap(first, children, gap)
        one, two, angle, fillet = _gap(trees, base, k, left, right, after, before, scratch)
        shorter_mm = _shorter(first, children, gap, scratch.above[k], scratch)
        fillet = min(fillet, _largest_fillet(angle, one, two, max(0.5 * shorter_mm, disc)))
        for place in range(3):
            # Sockets next to each other lie on children alone, beyond the straight and a blend.
            out = (0.0, limits.reach_mm, limits.beside_mm)[place]
            less = (0.0, 0.0, limits.before_mm + limits.blend_ratio * limits.rise_mm)[place]
            none = (0.0, 0.0, math.inf)[place]
            radius = max(0.0, max(0.0, fillet) - out)
            a, b = _straight_begins(angle, one + out, two + out, radius, disc + out)
            if after:
                begin[left] = max(begin[left], a - less)
            else:
                stop = max(stop, a - none)
            if before:
                begin[right] = max(begin[right], b - less)
            else:
                stop = max(stop, b - none)
    cutting.stop[k] = stop


@inlined
def _largest_fillet(angle, one, two, reach):
    """Return the radius whose fillet comes to a distance from the joint, negative if none does.

    As `vinefab.outline.joint.largest_fillet_mm`.
    """
    sin, cos = math.sin(angle), math.cos(angle)
    if angle >= math.pi - 1e-6:
        return math.inf
    if sin < 1e-9:
        return -1.0
    bare = one * one + two * two + 2.0 * one * two * cos
    if min(two + one * cos, one + two * cos) >= 0.0 and math.sqrt(bare) / sin > reach:
        return -1.0
    square = (1.0 + cos) / (1.0 - cos)
    half_linear = (one + two) / (1.0 - cos) - reach
    constant = bare / (sin * sin) - reach * reach
    root = math.sqrt(max(0.0, half_linear * half_linear - square * constant))
    return (root - half_linear) / square


@inlined
def _part(scratch, row, k, low, high, rise, limits):
    """Write the capsule of part of a branch, between two shares of its length, wider by a rise."""
    capsule = scratch.capsule
    x, y = capsule[k, 0], capsule[k, 1]
    run_x, run_y = capsule[k, 2] - x, capsule[k, 3] - y
    capsule[row, 0], capsule[row, 1] = x + low * run_x, y + low * run_y
    capsule[row, 2], capsule[row, 3] = x + high * run_x, y + high * run_y
    growth = capsule[k, 5] - capsule[k, 4]
    capsule[row, 4] = capsule[k, 4] + low * growth + rise
    capsule[row, 5] = capsule[k, 4] + high * growth + rise
    _box(capsule, scratch.box, row, limits)


@inlined
def _prepare_pairs(trees, d, capsules, pairs, limits, scratch, cutting):
    """Write which cuts part each pair, how many pairs each part, and the order of pairs."""
    base, branches = trees.first[d], trees.first[d + 1] - trees.first[d]
    owner, weight = scratch.owner, cutting.weight
    for k in range(branches):
        cutting.cut[k] = cutting.banned[k] = cutting.used[k] = weight[k] = 0
    for p in range(pairs):
        one, two = cutting.one[p], cutting.two[p]
        meet, other, also = owner[one], owner[two], -1
        while meet != other:  # the lowest branch that both are, or lie beyond
            if meet > other:  # parents stand before their children
                meet = trees.parent[base + meet]
            else:
                other = trees.parent[base + other]
        if meet == owner[one] and _outer_clears(meet, capsules, two, limits, scratch, cutting):
            also = meet
        if meet == owner[two] and _outer_clears(meet, capsules, one, limits, scratch, cutting):
            also = meet
        cutting.also[p] = also
        cutting.top[p] = trees.level[base + meet] - (1 if also >= 0 else 0)
        ways = _ways(trees, base, owner[one], owner[two], also, cutting)
        cutting.ways[p] = ways
        for way in range(ways):
            cutting.between[p, way] = cutting.path[way]
            weight[cutting.path[way]] += 1
    placed = 0  # those that meet farthest from the base first
    for level in range(trees.depth[d], -1, -1):
        for p in range(pairs):
            if cutting.top[p] == level:
                cutting.order[placed] = p
                placed += 1


@called
def _outer_clears(k, capsules, row, limits, scratch, cutting):
    """Return whether a branch may be cut with its rest beyond the cut clear of a capsule."""
    if cutting.can[k] == 0:
        return False
    outer, socket = capsules + 3 * k + OUTER, capsules + 3 * k + SOCKET
    clear = _pair_depth(scratch.capsule, outer, row, limits.clearance_mm) <= limits.least_depth
    if limits.on_stub or not clear:
        return clear
    return _pair_depth(scratch.capsule, socket, row, limits.clearance_mm) <= limits.least_depth


@called
def _ways(trees, base, a, b, also, cutting):
    """Write the branches between two whose cut may part them; return their number.

    ``also`` is the branch where they meet, if a cut there parts them too.
    """
    ways = 0
    while a != b:
        if a > b:
            ways = _add_way(cutting, a, ways)
            a = trees.parent[base + a]
        else:
            ways = _add_way(cutting, b, ways)
            b = trees.parent[base + b]
    if also == a:
        ways = _add_way(cutting, a, ways)
    return ways


@inlined
def _add_way(cutting, k, ways):
    """Write down a branch if it may be cut; return the number of those written."""
    free = cutting.can[k] == 1 and cutting.banned[k] == 0 and cutting.cut[k] == 0
    if free and ways < len(cutting.path):
        cutting.path[ways] = k
        return ways + 1
    return ways


@inlined
def _in_pieces(trees, d, capsules, pairs, tables, limits, scratch, cutting):
    """Cut a design; return what is left of conflicts and excess, and the number of cuts."""
    made = _fewest_cuts(trees, d, capsules, pairs, tables, limits, scratch, cutting)
    searched = made >= 0
    if not searched:
        made = _deepest_cuts(trees, d, pairs, limits, scratch, cutting)
    left = _left(trees, d, capsules, pairs, tables, limits, scratch, cutting)
    # Further cuts, for pieces that are larger than the sheet.
    while searched and left > 0.0 and made < limits.most_cuts:
        chosen, least = _further_cut(trees, d, capsules, pairs, tables, limits, scratch, cutting)
        if least >= left * _PARTED:
            break
        cutting.cut[chosen] = 1
        left, made = least, made + 1
    return left, made


@inlined
def _further_cut(trees, d, capsules, pairs, tables, limits, scratch, cutting):
    """Return the further cut that leaves least, and its remainder."""
    chosen, least = -1, math.inf
    for k in range(trees.first[d + 1] - trees.first[d]):
        if cutting.can[k] == 1 and cutting.cut[k] == 0:
            cutting.cut[k] = 1
            left = _left(trees, d, capsules, pairs, tables, limits, scratch, cutting)
            cutting.cut[k] = 0
            if left < least * _PARTED:
                chosen, least = k, left
    return chosen, least


@called
def _left(trees, d, capsules, pairs, tables, limits, scratch, cutting):
    """Return the rest after the cuts: conflicts in a piece, excess over the sheet and of laps."""
    _label(trees, d, cutting)
    left = _stubs_left(trees, d, capsules, pairs, limits, scratch, cutting)
    left += _sockets_left(trees, d, capsules, limits, scratch, cutting)
    for p in range(pairs):
        if _together(p, scratch, cutting):
            left += cutting.depth[p]
    over = 0.0  # of all pieces over the sheet, relative to its shorter side
    for root in range(trees.first[d + 1] - trees.first[d]):
        if cutting.piece[root] == root:
            _span_of_piece(trees, d, capsules, root, limits, scratch, cutting)
            over += _excess_of_span(limits, scratch)
    left += over
    return left + _overfull(trees, d, tables, limits, scratch, cutting)


@called
def _overfull(trees, d, tables, limits, scratch, cutting):
    """Return by how much film with the laps of the cuts overfills lumens, as VF-J04.

    As `vinefab.fabrication.rules.tree_rules.lap_occupancies`, the fullest branch of each level.
    """
    base, depth, below = trees.first[d], trees.depth[d], cutting.below
    build = trees.build[d]
    rows, found = trees.first[d + 1] - base, 0.0
    for level in range(depth):
        cutting.fullest[level] = 0.0
    for k in range(rows):
        cutting.laps[k] = 0
        for level in range(depth):
            below[k, level] = 0.0
    for k in range(rows - 1, -1, -1):
        level, parent = trees.level[base + k] - 1, trees.parent[base + k]
        own, most_mm = 2.0 * trees.end_half[base + k], 0.0
        for at in range(level + 1, depth):
            most_mm = max(most_mm, below[k, at])
        if cutting.laps[k]:
            share = most_mm * limits.lap_film_mm / (limits.lumen * own * own) / scratch.passage[k]
            cutting.fullest[level] = max(cutting.fullest[level], share)
        if parent < 0:
            continue
        if not trees.bend[base + k]:
            across = _across(trees, base, k, tables, build)
            if cutting.cut[k]:
                across = max(across, 2.0 * (cutting.wide[k] + cutting.rise[k]))
            below[parent, level] += across
        for at in range(level + 1, depth):
            below[parent, at] += below[k, at]
        if cutting.cut[k] or cutting.laps[k]:
            cutting.laps[parent] = 1
    for level in range(depth):
        percent = 100.0 * cutting.fullest[level]
        found += _excess(percent, limits.lap_percent, limits.most)
    return found


@inlined
def _label(trees, d, cutting):
    """Write the piece that each branch ends on, named by the branch that the piece begins with."""
    base, branches = trees.first[d], trees.first[d + 1] - trees.first[d]
    cutting.piece[0] = 0
    for k in range(1, branches):
        cutting.piece[k] = k if cutting.cut[k] else cutting.piece[trees.parent[base + k]]


@inlined
def _together(p, scratch, cutting):
    """Return whether a pair of whole branches is still on one piece."""
    one, two = scratch.owner[cutting.one[p]], scratch.owner[cutting.two[p]]
    also = cutting.also[p]
    return cutting.piece[one] == cutting.piece[two] and not (also >= 0 and cutting.cut[also] == 1)


@called
def _stubs_left(trees, d, capsules, pairs, limits, scratch, cutting):
    """Return the summed depths of stubs that conflict with something on their piece.

    The first conflict is written to ``cutting.hit``: two branches that end on the pieces of the
    two, and a branch whose own cut may part them too.
    """
    left = 0.0
    cutting.hit[0] = -1
    for place in range(pairs):
        p = cutting.order[place]
        if not _together(p, scratch, cutting):
            one, two = cutting.one[p], cutting.two[p]
            left += _stub_left(trees, d, capsules, one, two, 1, limits, scratch, cutting)
            left += _stub_left(trees, d, capsules, two, one, 0, limits, scratch, cutting)
    return left


@inlined
def _stub_left(trees, d, capsules, one, two, stubs, limits, scratch, cutting):
    """Return the depth of the stub of a capsule's branch in another capsule, or what is left of it.

    ``stubs`` is 1 if the other's stub counts too.
    """
    base, branches = trees.first[d], trees.first[d + 1] - trees.first[d]
    a, b = scratch.owner[one], scratch.owner[two]
    if one >= branches or cutting.cut[a] == 0:
        return 0.0
    stub, up = capsules + 3 * a + STUB, trees.parent[base + a]
    if two >= branches:
        return _depth_in_piece(up, stub, b, two, -1, limits, scratch, cutting)
    if cutting.cut[b] == 0:
        also = b if _outer_clears(b, capsules, stub, limits, scratch, cutting) else -1
        return _depth_in_piece(up, stub, b, two, also, limits, scratch, cutting)
    other = capsules + 3 * b
    left = _depth_in_piece(up, stub, b, other + OUTER, -1, limits, scratch, cutting)
    if stubs:
        up_b = trees.parent[base + b]
        left += _depth_in_piece(up, stub, up_b, other + STUB, -1, limits, scratch, cutting)
    return left


@called
def _sockets_left(trees, d, capsules, limits, scratch, cutting):
    """Return the summed depths of sockets that conflict with something on their piece."""
    branches, left = trees.first[d + 1] - trees.first[d], 0.0
    for a in range(1, branches):
        if cutting.cut[a]:
            left += _socket_left(trees, d, capsules, a, limits, scratch, cutting)
    return left


@inlined
def _socket_left(trees, d, capsules, a, limits, scratch, cutting):
    """Return the summed depths of a branch's socket in everything that is not joined to it."""
    base, branches = trees.first[d], trees.first[d + 1] - trees.first[d]
    socket, left, above = capsules + 3 * a + SOCKET, 0.0, trees.parent[base + a]
    home = above if limits.on_stub else a
    for row in range(capsules):
        b = scratch.owner[row]
        up = trees.parent[base + b]
        joined = up == a or (limits.on_stub and above in (up, b))
        if a != b and not (row < scratch.bare[0] and joined):
            left += _depth_in_piece(home, socket, b, row, -1, limits, scratch, cutting)
    for b in range(1 if limits.on_stub else a + 1, branches):
        up = trees.parent[base + b]
        if a == b or not cutting.cut[b] or up == a or (limits.on_stub and up == above):
            continue
        stub, other = capsules + 3 * b + STUB, capsules + 3 * b + SOCKET
        left += _depth_in_piece(home, socket, up, stub, -1, limits, scratch, cutting)
        if limits.on_stub and b > a:
            left += _depth_in_piece(home, socket, up, other, -1, limits, scratch, cutting)
    return left


@called
def _depth_in_piece(a, one, b, two, also, limits, scratch, cutting):
    """Return the depth of two capsules that hang on two branches, 0 in different pieces."""
    box = scratch.box
    if cutting.piece[a] != cutting.piece[b]:
        return 0.0
    beside = (box[two, 0] > box[one, 2]) | (box[two, 2] < box[one, 0])
    if beside | (box[two, 1] > box[one, 3]) | (box[two, 3] < box[one, 1]):
        return 0.0
    depth = _pair_depth(scratch.capsule, one, two, limits.clearance_mm)
    if depth <= limits.least_depth:
        return 0.0
    if cutting.hit[0] < 0:
        cutting.hit[0], cutting.hit[1], cutting.hit[2] = a, b, also
    return depth


@inlined
def _span_of_piece(trees, d, capsules, root, limits, scratch, cutting):
    """Write how far a piece reaches across each rotation."""
    base, branches, piece = trees.first[d], trees.first[d + 1] - trees.first[d], cutting.piece
    if root == 0:
        _span_of_mouth(scratch)
    else:
        for t in range(scratch.turn.shape[1]):
            scratch.low[t], scratch.high[t] = math.inf, -math.inf
        part = OUTER if limits.on_stub else SOCKET
        _widen_span(scratch, capsules + 3 * root + part, 0)
        _widen_span(scratch, capsules + 3 * root + part, 2)
    for k in range(capsules):
        if piece[scratch.owner[k]] == root:
            _widen_span(scratch, k, 2)
            if k != root:
                _widen_to_begin(trees, d, k, scratch)
    for k in range(root + 1, branches):
        if cutting.cut[k] and piece[trees.parent[base + k]] == root:
            part, end = (SOCKET, 0) if limits.on_stub else (STUB, 2)
            _widen_span(scratch, capsules + 3 * k + part, end)


@inlined
def _fewest_cuts(trees, d, capsules, pairs, tables, limits, scratch, cutting):
    """Make the fewest cuts that were found to part all conflicts; return their number, or -1.

    Depth first: the first pair that is still on one piece is parted by one branch after another.
    """
    branches = trees.first[d + 1] - trees.first[d]
    made, most, found, least, overfull = 0, limits.most_cuts, -1, 0, math.inf
    for step in range(limits.most_steps):
        more = _expand(trees, d, capsules, pairs, made, most, step, limits, scratch, cutting)
        if step == 0:
            least = cutting.needed[0]
        if more == 0:
            # Further cuts only add laps: those that overfill a lumen are kept for want of better.
            over = _overfull(trees, d, tables, limits, scratch, cutting)
            if over < overfull or over <= 0.0:
                found, overfull = made, over
                for k in range(branches):
                    cutting.best[k] = cutting.cut[k]
            if over <= 0.0:
                most = made - 1
        made = _go_back(made, most, cutting)
        if made < 0 or (overfull <= 0.0 and most < least):
            break
        way = cutting.option[made, cutting.tried[made]]
        cutting.cut[way] = 1
        cutting.tried[made] += 1
        made += 1
    for k in range(branches):
        cutting.cut[k] = cutting.best[k] if found >= 0 else 0
        cutting.banned[k] = 0
    return found


@inlined
def _go_back(made, most, cutting):
    """Undo cuts back to the last pair that has an untried branch; return how many are left, or -1.

    A branch that was tried is banned while others are tried in its place.
    """
    option, tried = cutting.option, cutting.tried
    tried[made] = 0
    while made >= 0 and (made >= most or tried[made] == cutting.options[made]):
        for way in range(tried[made]):
            cutting.banned[option[made, way]] = 0
        made -= 1
        if made >= 0:
            last = option[made, tried[made] - 1]
            cutting.cut[last], cutting.banned[last] = 0, 1
    return made


@called
def _expand(trees, d, capsules, pairs, made, most, step, limits, scratch, cutting):
    """Write the branches that may part the first conflict; return 0 if there is none, else 1.

    There are no such branches if more cuts than ``most`` are needed for certain: each of some pairs
    needs its own cut (Garg, Vazirani and Yannakakis 1997: pairs are taken in the order in which
    they meet farthest from the base). That number is written to ``cutting.needed``.
    """
    base, first, needed = trees.first[d], -1, 0
    cutting.options[made] = 0
    _label(trees, d, cutting)
    for place in range(pairs):
        p = cutting.order[place]
        if needed <= most - made and _together(p, scratch, cutting):
            first = p if first < 0 else first
            needed += _claim(p, step, cutting)
    cutting.needed[0] = needed
    if needed > most - made:
        return 1
    if first >= 0:
        ways = 0
        for way in range(cutting.ways[first]):
            ways = _add_way(cutting, cutting.between[first, way], ways)
    else:
        left = _stubs_left(trees, d, capsules, pairs, limits, scratch, cutting)
        left += _sockets_left(trees, d, capsules, limits, scratch, cutting)
        if left <= 0.0:
            return 0
        ways = _ways(trees, base, cutting.hit[0], cutting.hit[1], cutting.hit[2], cutting)
    _sort_ways(ways, made, cutting)
    return 1


@inlined
def _claim(p, step, cutting):
    """Return the number of cuts a pair needs after those of the pairs before: 0, 1, or too many."""
    free = 0
    for way in range(cutting.ways[p]):
        k = cutting.between[p, way]
        if cutting.banned[k] == 0:
            free += 1
            if cutting.used[k] == step + 1:
                return 0
    for way in range(cutting.ways[p]):
        if cutting.banned[cutting.between[p, way]] == 0:
            cutting.used[cutting.between[p, way]] = step + 1
    return 1 if free else TOO_MANY


@inlined
def _sort_ways(ways, made, cutting):
    """Write options by how many pairs their cut parts; of equals the narrower, later one first."""
    weight, row = cutting.weight, cutting.option[made]
    for way in range(ways):
        k, place = cutting.path[way], way
        while place > 0 and (
            weight[row[place - 1]] < weight[k]
            or (weight[row[place - 1]] == weight[k] and row[place - 1] < k)
        ):
            row[place] = row[place - 1]
            place -= 1
        row[place] = k
    cutting.options[made] = ways


@inlined
def _deepest_cuts(trees, d, pairs, limits, scratch, cutting):
    """Cut, one after the other, where pairs of the most depth are parted; return how often."""
    share, made = cutting.share, 0
    while made < limits.most_cuts:
        _label(trees, d, cutting)
        for k in range(trees.first[d + 1] - trees.first[d]):
            share[k] = 0.0
        for p in range(pairs):  # summed depths of the pairs that a cut in each branch parts
            if _together(p, scratch, cutting):
                for way in range(cutting.ways[p]):
                    share[cutting.between[p, way]] += cutting.depth[p]
        chosen = 0
        for k in range(trees.first[d + 1] - trees.first[d]):
            if share[k] > share[chosen] + limits.least_depth:
                chosen = k
        if share[chosen] <= 0.0:
            break
        cutting.cut[chosen] = 1
        made += 1
    return made
