"""The law of single joints, compiled: flat angles of uneven fans and bends in microseconds.

A twin of `vinefab.inflation.law.law_of`, which the tests hold it against. Like
`vinefab.growth.kernel` it imports no module of vinefab but `core.compiling`.
"""

import math

from vinefab.core.compiling import called, compiled, inlined, takes

# mypy: allow-untyped-defs, allow-untyped-calls
# ruff: noqa: ANN001, ANN202, ANN201  numba infers the types of compiled functions
# ruff: noqa: PLR0913, PLR0917  arrays are the compiled way to hand things over

ABOUT = 8  # as `vinefab.inflation.law`


@compiled
@takes("f2 f2 f2 f2 i1 f2 f2 f1 b1 f2 f2 f2 f2 f1", seconds=2.0)
def flat_joints(
    first, second, last, angle, count, ratio, fillet, strain, is_bend, room, flat, back, aside,
    passage,
):  # fmt: skip
    """Write the flat angles of many joints, as `vinefab.inflation.law.law_of`, in radians.

    Parameters
    ----------
    first, second, last
        Coefficients: those of `vinefab.inflation.law.network("flat")`.
    angle, count, ratio, fillet, strain, is_bend
        As of `flat_by_law_of`, a row for each joint.
    room
        Memory: three rows as long as the first layer's rows or columns.
    flat, back, aside, passage
        Where the results go.
    """
    for row in range(len(count)):
        passage[row] = flat_by_law_of(
            first, second, last, angle[row], count[row], ratio[row], fillet[row], strain[row],
            is_bend[row], room, flat[row], back[row], aside[row],
        )  # fmt: skip


@called
def flat_by_law_of(
    first, second, last, angle, count, ratio, fillet, strain, is_bend, room, flat, back, aside
):
    """Write the flat angles, pull-backs and side offsets of one joint; return its passage.

    Parameters
    ----------
    first, second, last
        Coefficients: those of `vinefab.inflation.law.network("flat")`.
    angle
        Deployed angle of each child, rad, rising.
    count
        Children, at most 4.
    ratio, fillet
        Width of each child, and fillet radius that each has, over the parent's width; within the
        ranges of the law.
    strain, is_bend
        Hoop strain of the parent; whether the only child is the parent behind a bend.
    room
        Memory: three rows as long as the first layer's rows or columns.
    flat, back, aside
        Where angles (rad), pull-backs and side offsets (over the parent's width) go.
    """
    passage, x = 1.0, room[0]
    if is_bend and angle[0] == 0.0:  # straight on
        flat[0] = back[0] = aside[0] = 0.0
        return 1.0
    for child in range(count):
        x[0] = math.degrees(angle[child]) / 60.0
        x[1] = 2.0 * ratio[child] - 1.4
        x[2] = math.log(strain) / 2.0 + 1.8
        x[3] = 1.0 if is_bend else 0.0
        x[4] = count / 2.0 - 1.25
        _neighbours(x, 5, 1, child, angle, count, ratio, fillet)
        _neighbours(x, 5 + ABOUT, -1, child, angle, count, ratio, fillet)
        turn, side, away, through = _outputs(first, second, last, room)
        x[0] = -x[0]
        for k in range(5, 5 + ABOUT):
            x[k], x[k + ABOUT] = x[k + ABOUT], x[k]
        turn_there, side_there, away_there, through_there = _outputs(first, second, last, room)
        flat[child] = angle[child] - math.radians(turn - turn_there) / 2.0
        aside[child] = (side - side_there) / 2.0
        back[child] = (away + away_there) / 2.0
        passage = min(passage, (through + through_there) / 2.0)
    return max(passage, 0.1)


@inlined
def _neighbours(x, base, way, child, angle, count, ratio, fillet):
    """Write what tells of the two neighbours on one side."""
    before = math.degrees(angle[child])
    for step in range(2):
        place = (child + 1 + way * (step + 1)) % (count + 1)
        there, width = 180.0, 1.0
        if place > 0:
            there, width = math.degrees(angle[place - 1]), ratio[place - 1]
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
def _outputs(first, second, last, room):
    """Return turn, side offset, pull-back and passage of the child in the first row of memory."""
    inputs, units = first.shape[0] - 1, first.shape[1]
    x, one, two = room[0], room[1], room[2]
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
