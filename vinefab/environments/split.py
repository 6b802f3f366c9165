"""Where traced loops are split into sections that a straight line follows."""

import numpy as np
import shapely

from vinefab.environments.lines import unit
from vinefab.environments.trace import CORNER_CUT
from vinefab.environments.walls import FEWEST_CORNERS, Walls
from vinefab.model.checked import Floats, Ints

_STRAIGHT = 1.05
"""In cells: the middles of a straight wall's cell edges lie up to 0.5 to both of its sides, so a
chord between two of them may have others 1 beside it and still all belong to one wall."""

_SMALL_CELLS = 20.0
"""Smaller loops are split more finely: a pillar has no straight walls."""

_SHARP = float(np.cos(np.radians(115.0)))


def split_loops(loops: list[Floats], tolerance: Floats) -> Walls:
    """Return loops as fitted walls, freed of needless breaks.

    Parameters
    ----------
    loops
        From `boundary_loops`, one at least.
    tolerance
        Shape (r,), in cells: largest deviation from each loop.
    """
    rough = _split([_from_extreme(loop) for loop in loops], tolerance)
    walls = _split(_from_best_corner(rough), tolerance)
    walls.divide()
    walls.merge()
    walls.settle()
    return walls


def _split(loops: list[Floats], tolerance: Floats) -> Walls:
    """Split loops where chords between their midpoints bend, beginning at their first."""
    closed = [np.vstack([loop, loop[:1]]) for loop in loops]
    owner = np.repeat(np.arange(len(loops)), [len(loop) for loop in closed])
    lines = shapely.linestrings(np.concatenate(closed), indices=owner)
    size = np.array([np.ptp(loop, axis=0).max() for loop in loops])
    coarse = np.where(size > _SMALL_CELLS, _STRAIGHT, 0.0)
    allowed = np.maximum(tolerance - CORNER_CUT, coarse)
    kept = shapely.simplify(lines, allowed, preserve_topology=False)
    first = np.cumsum([0, *(len(loop) for loop in loops[:-1])])
    breaks = [
        start + _breaks(loop, shapely.get_coordinates(line)[:-1])
        for start, loop, line in zip(first, loops, kept, strict=True)
    ]
    walls = Walls(
        midpoints=np.concatenate(loops),
        first=first,
        tolerance=tolerance,
        breaks=np.concatenate(breaks),
        holds=np.zeros(sum(len(part) for part in breaks), dtype=np.int64),
    )
    walls.settle()
    return walls


def _from_best_corner(walls: Walls) -> list[Floats]:
    """Return loops turned to begin between two long walls that meet at a clear angle.

    Where a loop begins it has a corner for good, so that must be a true one.
    """
    weight = np.minimum(walls.sizes, walls.sizes[walls.before]) * walls.turns_rad()
    openings = np.append(walls.opening, len(weight))
    ends = np.append(walls.first, len(walls.midpoints))
    loops = []
    for low, high, begin, end in zip(openings[:-1], openings[1:], ends[:-1], ends[1:], strict=True):
        best = low + int(np.argmax(weight[low:high]))
        loops.append(np.roll(walls.midpoints[begin:end], begin - walls.breaks[best], axis=0))
    return loops


def _from_extreme(loop: Floats) -> Floats:
    """Return a loop turned to begin where it surely has a corner."""
    return np.roll(loop, -int(np.argmin(loop @ np.array([1.0, 0.618]))), axis=0)


def _breaks(loop: Floats, kept: Floats) -> Ints:
    """Return the indices of the midpoints kept, and what else must be a break."""
    # Twice a midpoint is whole, and no midpoint comes twice: a number names each exactly.
    weights = np.array([2.0, 2.0**27])
    names = loop @ weights
    order = np.argsort(names)
    breaks = _blunted(loop, np.sort(order[np.searchsorted(names[order], kept @ weights)]))
    if len(breaks) >= FEWEST_CORNERS:
        return breaks
    evenly = np.arange(FEWEST_CORNERS) * len(loop) // FEWEST_CORNERS
    return np.unique(np.append(breaks, evenly))


def _blunted(loop: Floats, breaks: Ints) -> Ints:
    """Split the tip of a thin wall on both of its sides: it has an end, not a needle's point."""
    ahead = unit(np.roll(loop[breaks], -1, axis=0) - loop[breaks])
    turn = np.sum(ahead * np.roll(ahead, 1, axis=0), axis=1)
    sharp = breaks[turn < _SHARP]
    both = np.concatenate([breaks[turn >= _SHARP], sharp - 1, sharp + 1]) % len(loop)
    return np.unique(np.append(both, 0))
