"""Compiled parts of anchoring: turns on the way to each tip, gaps there, and pulls on branches."""

import math

from vinefab.core.compiling import compiled, inlined, takes

# mypy: allow-untyped-defs, allow-untyped-calls
# ruff: noqa: ANN001, ANN202, ANN201  numba infers the types of compiled functions
# ruff: noqa: PLR0913, PLR0917  arrays are the compiled way to hand things over


# --- Turns and tensions -----------------------------------------------------------------------


@compiled
@takes("i1r i1r i1 i1 i1 f2r i1r b1r f1 f1 b1", seconds=0.3)
def turns(parent, tree_first, tree, branch, room, points, first_point, at_bend, own, total, leaf):
    """Add up the turns at contacts of each branch and from the base to each tip, and mark leaves.

    Parameters
    ----------
    parent
        Of each planned branch, within its tree, -1 for trunks; trees one after the other.
    tree_first
        Where each tree begins.
    tree
        Tree of each growth, shape (j,).
    branch, room
        Where the branches and the chain points of each growth begin, shape (j + 1,).
    points, first_point
        As in `vinefab.growth.arrays.Growth`.
    at_bend
        Whether each chain point is a preformed bend, whose turn does not count.
    own
        Other turns of each branch, to which those at its contacts are added.
    total
        Where the sums from the base to each tip go.
    leaf
        Where the marks go, for each branch.
    """
    for j in range(len(tree)):
        first, planned = branch[j], tree_first[tree[j]]
        for k in range(branch[j + 1] - first):
            # Every growth has one more entry in `first_point` than it has branches.
            chain = first_point[first + k + j], first_point[first + k + j + 1]
            chain = room[j] + chain[0], room[j] + chain[1]
            own[first + k] += _contact_turns(points, at_bend, chain[0], chain[1])
            total[first + k] = own[first + k]
            leaf[first + k] = True
            above = parent[planned + k]
            if above >= 0:
                total[first + k] += total[first + above]
                leaf[first + above] = False


@inlined
def _contact_turns(points, at_bend, one, two):
    """Return the sum of absolute turns between base and tip of a chain, where it is wrapped."""
    total, ux, uy = 0.0, 0.0, 0.0
    bent = False
    for k in range(one, two - 1):
        bent |= at_bend[k]
        dx, dy = points[k + 1, 0] - points[k, 0], points[k + 1, 1] - points[k, 1]
        if (dx != 0.0) | (dy != 0.0):
            # The first stretch turns at the base hinge, which is not a contact.
            if ((ux != 0.0) | (uy != 0.0)) & (not bent):
                total += math.atan2(abs(ux * dy - uy * dx), ux * dx + uy * dy)
            ux, uy, bent = dx, dy, False
    return total


@compiled
@takes("i1r i1r i1 i1 f1 f1 f1 f1 f1", seconds=0.4)
def tensions(parent, tree_first, tree, branch, factor, limit, free, held, capped):
    """Compute the pull at the base end of every branch: all that holds beyond it.

    Parameters
    ----------
    parent, tree_first, tree, branch
        As in `turns`.
    factor
        Capstan factor of each branch's own turns.
    limit
        Largest pull that each branch stands, N.
    free, held
        Force of each engaged leaf's pouch, N, 0 for other branches; the pulls go there: ``free``
        if nothing ever failed, ``held`` with every branch at most at its limit.
    capped
        Where the number of limited branches of each growth goes, shape (j,).
    """
    for j in range(len(tree)):
        first, planned = branch[j], tree_first[tree[j]]
        capped[j] = 0.0
        for k in range(branch[j + 1] - first - 1, -1, -1):
            this = first + k
            free[this] *= factor[this]
            held[this] *= factor[this]
            if held[this] > limit[this]:
                held[this] = limit[this]
                capped[j] += 1.0
            above = parent[planned + k]
            if above >= 0:
                free[first + above] += free[this]
                held[first + above] += held[this]


# --- Gaps -------------------------------------------------------------------------------------


@compiled
@takes("f2 f2 f2r f1 i1 i1 f f1", seconds=0.9)
def gaps(tips, across, walls, grid, cell_first, item, tolerance, out):
    """Compute the width of free space at some points, each across some direction.

    Parameters
    ----------
    tips
        The points, in free space or on its border, mm; shape (m, 2).
    across
        Unit vectors along which to measure, shape (m, 2).
    walls, grid, cell_first, item
        As in `areas.WallCells`, with free space on the left of the walls, mm.
    tolerance
        A wall so near counts as touched, mm; walls are listed in cells that they miss by more.
    out
        Where the results go, mm; shape (m,).

    Notes
    -----
    A wall through a point hides the side that it is solid on; between two such walls back to back
    the sides are added up, as if the point were free.
    """
    for k in range(len(tips)):
        x, y, ux, uy = tips[k, 0], tips[k, 1], across[k, 0], across[k, 1]
        column = min(max(int((x - grid[0]) / grid[2]), 0), int(grid[3]) - 1)
        row = min(max(int((y - grid[1]) / grid[2]), 0), int(grid[4]) - 1)
        cell = row * int(grid[3]) + column
        turned = 0
        for e in item[cell_first[cell] : cell_first[cell + 1]]:
            place, side = _crossing(x, y, ux, uy, walls[e])
            if abs(place) <= tolerance:
                turned += side
        out[k] = 0.0
        for way in (1.0, -1.0):
            if turned * way >= 0.0:
                out[k] += _free(
                    x, y, ux, uy, way, column, row, walls, grid, cell_first, item, tolerance
                )


@inlined
def _crossing(x, y, ux, uy, wall):
    """Return where along a line through a place a wall crosses it, infinite where it does not.

    The second is 1 if the wall crosses from left to right, with its free side ahead, else -1.
    """
    ax, ay, bx, by = wall[0] - x, wall[1] - y, wall[2] - x, wall[3] - y
    side_a, side_b = ux * ay - uy * ax, ux * by - uy * bx
    if (side_a > 0.0) == (side_b > 0.0):
        return math.inf, 0
    share = side_a / (side_a - side_b)
    place = ux * (ax + share * (bx - ax)) + uy * (ay + share * (by - ay))
    return place, 1 if side_b < side_a else -1


@inlined
def _free(x, y, ux, uy, way, column, row, walls, grid, cell_first, item, tolerance):
    """Return the free distance of a line one way from a place, cell by cell; infinite if endless.

    Parameters
    ----------
    x, y
        The place.
    ux, uy
        Direction of the line.
    way
        1 or -1: along it or against it.
    column, row
        The place's cell.
    walls, grid, cell_first, item, tolerance
        As in `gaps`.
    """
    dx, dy, side = way * ux, way * uy, grid[2]
    right, up = 1 if dx > 0.0 else 0, 1 if dy > 0.0 else 0
    # How far it is to the next column and row, and from one to the next.
    to_column = (grid[0] + (column + right) * side - x) / dx if dx != 0.0 else math.inf
    to_row = (grid[1] + (row + up) * side - y) / dy if dy != 0.0 else math.inf
    columns, rows, nearest = int(grid[3]), int(grid[4]), math.inf
    while 0 <= column < columns and 0 <= row < rows:
        cell = row * columns + column
        for e in item[cell_first[cell] : cell_first[cell + 1]]:
            place, _ = _crossing(x, y, ux, uy, walls[e])
            if way * place > tolerance:
                nearest = min(nearest, way * place)
        if nearest <= min(to_column, to_row):
            break
        if to_column < to_row:
            column += 2 * right - 1
            to_column += side / abs(dx)
        else:
            row += 2 * up - 1
            to_row += side / abs(dy)
    return nearest
