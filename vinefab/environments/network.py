"""Places spread over an area and the ways that connect them."""

import numpy as np

from vinefab.model.checked import Floats

_CANDIDATES = 12


def spread_points(
    rng: np.random.Generator, count: int, limits: tuple[float, float], first: Floats
) -> Floats:
    """Return points in a square, each the candidate farthest from those before it.

    Mitchell's best-candidate sampling: random, but neither crowded nor regular.

    Parameters
    ----------
    rng
        Draws the candidates.
    count
        How many points besides the first.
    limits
        Smallest and largest x and y.
    first
        The point to begin with.

    Returns
    -------
    array
        Shape (count + 1, 2).
    """
    points = [first]
    for _ in range(count):
        candidates = rng.uniform(*limits, (_CANDIDATES, 2))
        off = np.linalg.norm(candidates[:, None] - np.array(points), axis=2).min(axis=1)
        points.append(candidates[int(np.argmax(off))])
    return np.array(points)


def links(rng: np.random.Generator, points: Floats, extra: float) -> list[tuple[int, int]]:
    """Return pairs of points to connect: a shortest tree over all, and some short cuts.

    Short cuts come from the Gabriel graph: pairs with no other point in the circle between them.

    Parameters
    ----------
    rng
        Chooses the short cuts.
    points
        Shape (n, 2).
    extra
        Share of the possible short cuts to take, 0 to 1.
    """
    distance = np.linalg.norm(points[:, None] - points, axis=2)
    tree = _shortest_tree(distance)
    possible = [pair for pair in _gabriel(distance) if pair not in tree]
    chosen = rng.random(len(possible)) < extra
    return sorted(tree) + [pair for pair, take in zip(possible, chosen, strict=True) if take]


def _shortest_tree(distance: Floats) -> set[tuple[int, int]]:
    """Return the minimum spanning tree (Prim): pairs (smaller, larger)."""
    nearest, gap = np.zeros(len(distance), dtype=np.int64), distance[0].copy()
    gap[0] = np.inf
    tree = set()
    for _ in range(len(distance) - 1):
        new = int(np.argmin(gap))
        tree.add((min(new, int(nearest[new])), max(new, int(nearest[new]))))
        closer = (distance[new] < gap) & np.isfinite(gap)
        nearest[closer], gap[closer] = new, distance[new][closer]
        gap[new] = np.inf
    return tree


def _gabriel(distance: Floats) -> list[tuple[int, int]]:
    square = distance**2
    one, other = np.triu_indices(len(distance), 1)
    detour = square[one] + square[other]
    detour[np.arange(len(one)), one] = detour[np.arange(len(one)), other] = np.inf
    clear = detour.min(axis=1) >= square[one, other]
    return list(zip(one[clear].tolist(), other[clear].tolist(), strict=True))
