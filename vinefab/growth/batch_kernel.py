"""Compiled bookkeeping around batches, which Python would spend as long on as on growth.

Like `vinefab.growth.kernel` it imports no module of vinefab but `core.compiling`: the cache of a
compiled file does not notice changes of another.
"""

from vinefab.core.compiling import compiled, inlined, takes

# mypy: allow-untyped-defs, allow-untyped-calls
# ruff: noqa: ANN001, ANN202, ANN201  numba infers the types of compiled functions
# ruff: noqa: PLR0913, PLR0917  arrays are the compiled way to hand things over


@compiled
@takes("i1 f1 i2 f2 f2 f2 i1 i1 i1 f1 f1", seconds=0.3)
def plan_trees(depth, trunk, branches, fan, size, growth, first, parent, level, offset, length):
    """Write the branches of trees that branch alike on each level, parents first.

    Parameters
    ----------
    depth
        Number of levels of each tree, the trunk included, shape (m,).
    trunk
        Length of each trunk, mm, shape (m,).
    branches, fan, size, growth
        As ``branches``, ``fan_rad``, ``length_mm`` and ``growth`` of `vinefab.model.design.Level`,
        for each tree and level below the trunk, shape (m, n).
    first
        Where each tree begins in the results, shape (m + 1,).
    parent
        Where the parents go, counted within their tree, -1 for trunks.
    level
        Where the levels go, 1 for trunks.
    offset, length
        Where angles from the parent's heading (rad) and lengths (mm) go.
    """
    for tree in range(len(depth)):
        at = first[tree]
        parent[at], level[at], offset[at], length[at] = -1, 1, 0.0, trunk[tree]
        one, two = 0, 1
        for below in range(depth[tree] - 1):
            count, until = branches[tree, below], two
            half = fan[tree, below] / 2.0
            for above in range(one, two):
                for sibling in range(count):
                    k = at + until
                    parent[k], level[k] = above, below + 2
                    offset[k] = _evenly(-half, half, sibling, count) if count > 1 else 0.0
                    share = _evenly(1.0, growth[tree, below], sibling, count)
                    length[k] = size[tree, below] * share
                    until += 1
            one, two = two, until


@compiled
@takes("i1 i1 i1 f1 f1 f1", seconds=0.1)
def riding_film(first, parent, level, length, width, riding):
    """Write the film that rides inside each branch, as `growth_pressure.riding_mm` for one tree.

    Parameters
    ----------
    first, parent, level, length
        Trees as `plan_trees` writes them; ``first`` with the total at the end.
    width
        Lay-flat width of each level, mm.
    riding
        Where the lengths go, mm.
    """
    riding[:] = 0.0
    for tree in range(len(first) - 1):
        base = first[tree]
        for k in range(first[tree + 1] - 1, base, -1):
            riding[base + parent[k]] += riding[k] + length[k] * width[level[k] - 1]
        for k in range(base, first[tree + 1]):
            riding[k] /= width[level[k] - 1]


@inlined
def _evenly(first, last, index, count):
    """Return one of ``count`` numbers evenly spaced, with the roundings of `numpy.linspace`."""
    if index == count - 1 and count > 1:
        return last
    return index * ((last - first) / max(count - 1, 1)) + first


@compiled
@takes("i1 i1 f2 i1 i1 i f2 i1", seconds=0.1)
def gather_tips(branch, room, points, first_point, stop, hidden, tips, first):
    """Write the tips of all branches that emerged, growth by growth; return their number.

    Parameters
    ----------
    branch, room, points, first_point, stop
        Several growths as `vinefab.growth.batch.GrowthBlock` holds them.
    hidden
        What ``stop`` is for a branch that did not emerge.
    tips
        Where the tips go, mm; a row for every branch that there is.
    first
        Where each growth's tips begin, shape (j + 1,).
    """
    count = 0
    for job in range(len(branch) - 1):
        first[job] = count
        for k in range(branch[job], branch[job + 1]):
            if stop[k] != hidden:
                last = room[job] + first_point[k + job + 1] - 1
                tips[count, 0], tips[count, 1] = points[last, 0], points[last, 1]
                count += 1
    first[len(branch) - 1] = count
    return count


# Types of arguments, see `takes`.
_GROWTH = "vinefab.growth.arrays:Growth(f2 i1 i1 f1 f1 f2 i1 f1 f1 f1 i1 f1 f1)"


@compiled
@takes(f"i1 i1 i1 i1 i1 i1 {_GROWTH} i1 i {_GROWTH} b1", seconds=0.6)
def join_parts(plan, first, part_first, part, branch, room, grown, to, hidden, whole, at_bend):
    """Join the straight parts of branches with bends into branches.

    Parameters
    ----------
    plan
        Tree of each growth, shape (j,).
    first, part_first, part
        As in `vinefab.growth.plan.BranchParts`.
    branch, room, grown
        Growths of the parts, as `vinefab.growth.batch.GrowthBlock` holds them.
    to
        Where each growth's branches begin in the result, shape (j + 1,).
    hidden
        What ``stop`` is for a part that did not emerge.
    whole
        Where the growths of the branches go, with the same room for points.
    at_bend
        Where the marks of points at bends go.
    """
    for job in range(len(plan)):
        at, base = 0, room[job]
        whole.first_point[to[job] + job] = 0
        for k in range(to[job + 1] - to[job]):
            row, planned = to[job] + k, first[plan[job]] + k
            whole.grown[row] = whole.turn[row] = 0.0
            whole.events[row] = 0
            for i in range(part_first[planned], part_first[planned + 1]):
                this, is_first = branch[job] + part[i], i == part_first[planned]
                if (not is_first) & (grown.stop[this] == hidden):
                    break
                whole.stop[row] = grown.stop[this]
                whole.grown[row] += grown.grown[this]
                whole.turn[row] += grown.turn[this]
                whole.events[row] += grown.events[this]
                whole.heading[row, 0] = grown.heading[this, 0]
                whole.heading[row, 1] = grown.heading[this, 1]
                whole.gain[row], whole.drawn[row] = grown.gain[this], grown.drawn[this]
                one, two = grown.first_point[this + job], grown.first_point[this + job + 1]
                if not is_first:
                    if grown.grown[this] == 0.0:
                        break  # it stopped where it should have turned
                    at_bend[base + at - 1] = True
                    one += 1  # the tip of the part before
                for point in range(base + one, base + two):
                    whole.points[base + at, 0] = grown.points[point, 0]
                    whole.points[base + at, 1] = grown.points[point, 1]
                    at += 1
            whole.first_point[row + job + 1] = at
