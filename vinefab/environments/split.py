"""Where traced loops are split into sections that a straight line follows."""

import numpy as np
import shapely

from vinefab.environments.lines import unit
from vinefab.environments.trace import CORNER_CUT
from vinefab.environments.walls import FEWEST_CORNERS, Walls
from vinefab.model.checked import Floats, Ints

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
    turned = [_from_extreme(loop) for loop in loops]
    closed = [np.vstack([loop, loop[:1]]) for loop in turned]
    owner = np.repeat(np.arange(len(loops)), [len(loop) for loop in closed])
    lines = shapely.linestrings(np.concatenate(closed), indices=owner)
    kept = shapely.simplify(lines, tolerance - CORNER_CUT, preserve_topology=False)
    first = np.cumsum([0, *(len(loop) for loop in turned[:-1])])
    breaks = np.concatenate(
        [
            start + _breaks(loop, shapely.get_coordinates(line)[:-1])
            for start, loop, line in zip(first, turned, kept, strict=True)
        ]
    )
    midpoints = np.concatenate(turned)
    walls = Walls(
        midpoints=midpoints,
        first=first,
        tolerance=tolerance,
        breaks=breaks,
        holds=np.zeros(len(breaks), dtype=np.int64),
        corners=midpoints[breaks],
    )
    walls.settle()
    walls.merge()
    walls.settle()
    return walls


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
