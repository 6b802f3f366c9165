"""Seeded generators: one child per draw, so that results depend on neither order nor workers."""

import numpy as np


def child(seed: int, *path: int) -> np.random.Generator:
    """Return the generator that belongs to one place in a tree of seeds.

    Parameters
    ----------
    path
        Place of the draw (generation, candidate, map, ...). The same path gives the same stream,
        whatever is drawn elsewhere.

    Examples
    --------
    >>> float(child(7, 1, 2).random()) == float(child(7, 1, 2).random())
    True
    """
    return np.random.Generator(np.random.PCG64(np.random.SeedSequence(seed, spawn_key=path)))
