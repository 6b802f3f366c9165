"""Several maps together, as one set of arrays per set of body radii."""

import threading
from collections.abc import Sequence

import numpy as np

from vinefab.growth.batch_arrays import AtlasArrays
from vinefab.growth.terrain import Terrain
from vinefab.model.checked import Ints

MOST_KEPT = 8
"""Sets of radii whose arrays are kept; then the oldest is dropped."""


class Atlas:
    """Terrains whose walls are put together once and then used by many batches.

    Parameters
    ----------
    terrains
        At least one.
    """

    __slots__ = ("_kept", "_making", "terrains")

    def __init__(self, terrains: Sequence[Terrain]) -> None:
        self.terrains = tuple(terrains)
        self._kept: dict[tuple[float, ...], AtlasArrays] = {}
        self._making = threading.Lock()

    def arrays(self, radii_mm: tuple[float, ...]) -> AtlasArrays:
        """Return the walls of all terrains for some body radii: one page for each pair.

        Several threads may ask at once.
        """
        with self._making:
            if radii_mm not in self._kept:
                pages = [terrain.walls(radius) for terrain in self.terrains for radius in radii_mm]
                tolerances = np.repeat([t.tolerance_mm for t in self.terrains], len(radii_mm))
                while len(self._kept) >= MOST_KEPT:
                    self._kept.pop(next(iter(self._kept)))
                self._kept[radii_mm] = AtlasArrays.of(pages, tolerances.tolist())
            return self._kept[radii_mm]

    def pages(self, radii_mm: tuple[float, ...]) -> Ints:
        """Return the page of each terrain and radius, shape (terrains, radii)."""
        return np.arange(len(self.terrains) * len(radii_mm)).reshape(-1, len(radii_mm))
