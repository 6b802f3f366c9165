"""Which parts of a flat robot come near each other, and how near."""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from vinefab.checks.closest import closest
from vinefab.checks.hulls import Hulls, hull_gap_mm
from vinefab.checks.shapes import Shapes
from vinefab.model.checked import Floats, Ints

MOST_PAIRS = 2_000_000
"""So many near pairs are worked out; a tree with more lies on itself everywhere anyway."""

_CHUNK = 512


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Spacing:
    """Pairs of capsules of different branches that are nearer than a reach, k of them.

    Parameters
    ----------
    first, second
        Indices of the capsules, shape (k,).
    gap_mm
        Free distance between them, negative where they overlap, shape (k,).
    crossing_mm
        Where the segments themselves cross: by how much the nearest end runs past the crossing;
        0 elsewhere, shape (k,).
    first_mm, second_mm
        Closest points of the segments, shape (k, 2).
    joined
        Whether the two branches share a joint, shape (k,).
    pouch
        Whether one of the two belongs to a pouch, shape (k,).
    complete
        Whether all near pairs are here; False past `MOST_PAIRS`.
    """

    first: Ints
    second: Ints
    gap_mm: Floats
    crossing_mm: Floats
    first_mm: Floats
    second_mm: Floats
    joined: NDArray[np.bool_]
    pouch: NDArray[np.bool_]
    complete: bool


def spacing(shapes: Shapes, reach_mm: float) -> Spacing:
    """Return all pairs of capsules that are nearer to each other than ``reach_mm``.

    Capsules of one branch are left out, and so are pairs of branches that share a joint unless a
    pouch is involved: such branches meet by design.

    Parameters
    ----------
    shapes
        The flat robot.
    reach_mm
        Pairs with a gap of this much or more may be left out, or not.
    """
    first, second, complete = _near(shapes, reach_mm)
    first, second = _of_different_branches(shapes, first, second)
    near = closest(
        shapes.start_mm[first], shapes.end_mm[first], shapes.start_mm[second], shapes.end_mm[second]
    )
    run_a = shapes.end_mm[first] - shapes.start_mm[first]
    run_b = shapes.end_mm[second] - shapes.start_mm[second]
    short_a = np.minimum(near.along_a, 1.0 - near.along_a) * np.hypot(*run_a.T)
    short_b = np.minimum(near.along_b, 1.0 - near.along_b) * np.hypot(*run_b.T)
    crossing = np.where(near.distance_mm < 1e-9, np.minimum(short_a, short_b), 0.0)
    return Spacing(
        first=first,
        second=second,
        gap_mm=_gap_mm(shapes, first, second, near.distance_mm),
        crossing_mm=crossing,
        first_mm=shapes.start_mm[first] + near.along_a[:, None] * run_a,
        second_mm=shapes.start_mm[second] + near.along_b[:, None] * run_b,
        joined=_joined(shapes, first, second),
        pouch=shapes.pouch[first] | shapes.pouch[second],
        complete=complete,
    )


def _gap_mm(shapes: Shapes, first: Ints, second: Ints, distance_mm: Floats) -> Floats:
    """Return the free distance between pairs of capsules, shape (k,).

    Between even capsules that is the distance of their segments less both half widths. Where one
    is tapered, it is the least distance of two places on the segments less the half widths there:
    a convex function of the two places, so that a search along one segment finds it when the other
    place is the best for it.
    """
    gap = distance_mm - shapes.half_mm[first] - shapes.half_mm[second]
    even = shapes.half_mm == shapes.end_half_mm
    rows = np.flatnonzero(~(even[first] & even[second]))
    if len(rows):
        gap[rows] = hull_gap_mm(_hulls(shapes, first[rows]), _hulls(shapes, second[rows]))
    return gap


def _hulls(shapes: Shapes, rows: Ints) -> Hulls:
    return Hulls(
        start_mm=shapes.start_mm[rows],
        run_mm=shapes.end_mm[rows] - shapes.start_mm[rows],
        half_mm=shapes.half_mm[rows],
        growth_mm=shapes.end_half_mm[rows] - shapes.half_mm[rows],
    )


def _near(shapes: Shapes, reach_mm: float) -> tuple[Ints, Ints, bool]:
    """Return pairs (first < second) whose boxes come within the reach, and whether all are."""
    grown = shapes.most_half_mm[:, None] + reach_mm / 2
    low = np.minimum(shapes.start_mm, shapes.end_mm) - grown
    high = np.maximum(shapes.start_mm, shapes.end_mm) + grown
    boxes = shapely.box(low[:, 0], low[:, 1], high[:, 0], high[:, 1])
    tree = shapely.STRtree(boxes)
    firsts, seconds, count = [], [], 0
    for begin in range(0, len(shapes), _CHUNK):
        first, second = tree.query(boxes[begin : begin + _CHUNK])
        first = first + begin
        keep = first < second
        firsts.append(first[keep])
        seconds.append(second[keep])
        count += len(firsts[-1])
        if count > MOST_PAIRS:
            break
    complete = count <= MOST_PAIRS
    return np.concatenate(firsts), np.concatenate(seconds), complete


def _of_different_branches(shapes: Shapes, first: Ints, second: Ints) -> tuple[Ints, Ints]:
    different = shapes.branch[first] != shapes.branch[second]
    meant = _joined(shapes, first, second) & ~(shapes.pouch[first] | shapes.pouch[second])
    keep = different & ~meant
    return first[keep], second[keep]


def _joined(shapes: Shapes, first: Ints, second: Ints) -> NDArray[np.bool_]:
    """Return whether pairs of capsules belong to siblings or to parent and child, shape (k,)."""
    a, b = shapes.branch[first], shapes.branch[second]
    parent_a, parent_b = shapes.parent[a], shapes.parent[b]
    return np.asarray((parent_a == parent_b) | (parent_a == b) | (parent_b == a))
