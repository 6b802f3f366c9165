"""Slabs heaped up so that a stated width stays passable between the heaps.

Every slab is convex and either stands free, at least the passage from everything, or leans on
exactly one host (an earlier slab, or one side of the bounds) and keeps the passage to all else.
So who leans on whom is a forest, and that is why a round body as wide as the passage can go from
anywhere it fits to anywhere else it fits: grown by half the passage, the slabs and the outside
overlap along the branches of a forest only, each time in a convex set, and such a union cannot
close in on a hole.
"""

import math
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.environments.slabs import way_to_contact
from vinefab.model.checked import Floats

_TRIES = 150
_SIDES = 4
_DEEPEST_IN_SIDE = 0.4
_BITE = 0.15
"""How far a leaning slab goes into its host, as a share of the root of its area."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PileRules:
    """Where slabs may lie.

    Parameters
    ----------
    size_mm
        Width and height of the bounds, from the origin.
    passage_mm
        Least distance between slabs that do not lean on each other, and to the sides.
    keep_out
        What slabs keep ``keep_out_mm`` from.
    keep_out_mm
        That distance.
    """

    size_mm: float
    passage_mm: float
    keep_out: BaseGeometry
    keep_out_mm: float


class Pile:
    """Slabs that lie already, and room for more.

    Parameters
    ----------
    rules
        Where slabs may lie.
    """

    def __init__(self, rules: PileRules) -> None:
        self.rules = rules
        self._count = 0
        self._corners_mm: list[Floats] = []
        self._polygons: NDArray[np.object_] = np.empty(64, dtype=object)
        self._middles_mm = np.zeros((64, 2))
        self._radii_mm = np.zeros(64)

    @property
    def polygons(self) -> NDArray[np.object_]:
        """The slabs, in the order they were put down; some overlap, some reach over the bounds."""
        return self._polygons[: self._count]

    def add(self, rng: np.random.Generator, slab_mm: Floats, *, leaning: bool) -> bool:
        """Put down a slab where there is room, and return whether a place was found.

        Parameters
        ----------
        rng
            Draws the places to try.
        slab_mm
            Corners around the origin.
        leaning
            Whether it leans on a slab or a side, where such a place is found.
        """
        for lean in (True, False) if leaning else (False,):
            for _ in range(_TRIES):
                host, off_mm = self._place(rng, slab_mm, lean=lean)
                if off_mm is not None and self._put(slab_mm + off_mm, host):
                    return True
        return False

    def _place(
        self, rng: np.random.Generator, slab_mm: Floats, *, lean: bool
    ) -> tuple[int, Floats | None]:
        """Draw a host and an offset; hosts -4 .. -1 are the sides, -5 is none."""
        if not lean:
            return -_SIDES - 1, self._amid(rng, slab_mm)
        host = int(rng.integers(-_SIDES, self._count))
        if host < 0:
            return host, self._at_side(rng, slab_mm, host + _SIDES)
        return host, self._on_slab(rng, slab_mm, host)

    def _amid(self, rng: np.random.Generator, slab_mm: Floats) -> Floats:
        low = self.rules.passage_mm - slab_mm.min(axis=0)
        high = self.rules.size_mm - self.rules.passage_mm - slab_mm.max(axis=0)
        return np.asarray(low + rng.random(2) * (high - low))

    def _at_side(self, rng: np.random.Generator, slab_mm: Floats, side: int) -> Floats:
        """Return an offset that pushes a slab through a side: 0 and 2 left and right."""
        off_mm = self._amid(rng, slab_mm)
        axis = side % 2
        low, high = float(slab_mm[:, axis].min()), float(slab_mm[:, axis].max())
        deep_mm = (high - low) * (0.05 + (_DEEPEST_IN_SIDE - 0.05) * rng.random())
        off_mm[axis] = -low - deep_mm if side < 2 else self.rules.size_mm - high + deep_mm
        return off_mm

    def _on_slab(self, rng: np.random.Generator, slab_mm: Floats, host: int) -> Floats | None:
        """Return an offset that slides a slab against another until it just bites into it."""
        turn = 2.0 * math.pi * rng.random()
        way = np.array([math.cos(turn), math.sin(turn)])
        aside = self._radii_mm[host] * (2.0 * rng.random() - 1.0) * np.array([-way[1], way[0]])
        far_mm = self._radii_mm[host] + _radius(slab_mm) + 1.0
        begin_mm = self._middles_mm[host] + aside - far_mm * way
        contact_mm = way_to_contact(slab_mm + begin_mm, self._corners_mm[host], way)
        if not math.isfinite(contact_mm):
            return None
        bite_mm = _BITE * math.sqrt(Polygon(slab_mm).area)
        return np.asarray(begin_mm + (contact_mm + bite_mm) * way)

    def _put(self, slab_mm: Floats, host: int) -> bool:
        """Put a slab down if it touches nothing but its host; return whether it did."""
        polygon = Polygon(slab_mm)
        if not (self._clear_of_sides(slab_mm, host) and self._clear_of_slabs(polygon, host)):
            return False
        if shapely.distance(polygon, self.rules.keep_out) < self.rules.keep_out_mm:
            return False
        if host >= 0 and not self._bites(polygon, host):
            return False
        if self._count == len(self._polygons):
            self._grow()
        self._polygons[self._count] = polygon
        self._middles_mm[self._count] = slab_mm.mean(axis=0)
        self._radii_mm[self._count] = _radius(slab_mm - slab_mm.mean(axis=0))
        self._corners_mm.append(slab_mm)
        self._count += 1
        return True

    def _grow(self) -> None:
        self._polygons = np.concatenate([self._polygons, np.empty(self._count, dtype=object)])
        self._middles_mm = np.concatenate([self._middles_mm, np.zeros((self._count, 2))])
        self._radii_mm = np.concatenate([self._radii_mm, np.zeros(self._count)])

    def _clear_of_sides(self, slab_mm: Floats, host: int) -> bool:
        gaps_mm = np.concatenate([slab_mm.min(axis=0), self.rules.size_mm - slab_mm.max(axis=0)])
        if -_SIDES <= host < 0:
            gaps_mm[host + _SIDES] = np.inf
        return bool((gaps_mm >= self.rules.passage_mm - 1e-9).all())

    def _clear_of_slabs(self, polygon: Polygon, host: int) -> bool:
        corners = shapely.get_coordinates(polygon)[:-1]
        middle_mm = corners.mean(axis=0)
        reach_mm = _radius(corners - middle_mm) + self.rules.passage_mm
        away_mm = np.hypot(*(self._middles_mm[: self._count] - middle_mm).T)
        near = away_mm < self._radii_mm[: self._count] + reach_mm
        if host >= 0:
            near[host] = False
        distances_mm = shapely.distance(self.polygons[near], polygon)
        return bool((distances_mm >= self.rules.passage_mm).all())

    def _bites(self, polygon: Polygon, host: int) -> bool:
        """Return whether the overlap is broad enough to hold, and is no overlap of the whole."""
        shared_mm2 = shapely.intersection(polygon, self._polygons[host]).area
        least_mm2, most_mm2 = 0.1 * _BITE**2 * polygon.area, 0.5 * polygon.area
        return bool(least_mm2 < shared_mm2 < most_mm2)


def _radius(slab_mm: Floats) -> float:
    return float(np.hypot(*slab_mm.T).max())
