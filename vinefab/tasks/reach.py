"""The reach task: how much of the free space lies close to the deployed body."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar, Literal

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats, Ints, positive
from vinefab.growth.batch import Block
from vinefab.model.deployment import Deployment
from vinefab.tasks.fast_areas import Chains
from vinefab.tasks.map_context import MapContext
from vinefab.tasks.task import Outcome, TaskOutcomes, concatenated_outcomes, one_by_one

QUARTER_SEGMENTS = 32
"""Sides of the polygon that stands for a quarter of a round end: it has 0.04 % less area."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Reach:
    """Share of the free space within a buffer of the body (paper, Fig. 4)."""

    name: ClassVar[str] = "reach"
    lowest: ClassVar[float] = 0.0

    buffer_mm: float = 40.0  # largest distance from the body's centreline that counts as reached
    # ``exact``: by polygons, for a score that is reported. ``fast``: on cells of free space
    # (`Raster.reached_mm2` states the error), a hundred times faster, for searching; taken
    # only where the map is not too large for such a buffer. ``auto``: fast in a search, else exact.
    area: Literal["auto", "exact", "fast"] = "auto"

    def __post_init__(self) -> None:
        positive("task.buffer_mm", self.buffer_mm)
        if self.area not in ("auto", "exact", "fast"):
            raise BadInputError("task.area", self.area, "'auto', 'exact' or 'fast'")

    def for_search(self) -> "Reach":
        """Return the task with fast areas, unless its parameters say how to measure them."""
        return replace(self, area="fast") if self.area == "auto" else self

    def evaluate(self, deployment: Deployment, context: MapContext) -> Outcome:
        """Return the share, 0 to 1, and as terms the reached area and the grown length."""
        raster = context.raster(self.buffer_mm) if self.area == "fast" else None
        if raster is None:
            reached_mm2 = self._exact_mm2(deployment, context)
        else:
            count, points = len(deployment.tree), len(deployment.points_mm)
            (reached_mm2,) = raster.reached_mm2(
                Chains(
                    deployment.points_mm,
                    deployment.first_point,
                    np.array([0, count]),
                    np.array([0, points]),
                )
            ).tolist()
        grown_mm = float(deployment.grown_mm.sum())
        return _outcomes(np.array([reached_mm2]), np.array([grown_mm]), context).one(0)

    def parts(self, score: float, _terms: Mapping[str, float]) -> dict[str, float]:
        """Return the score: the area reached is all that counts."""
        return {"area reached": score}

    def evaluate_block(self, block: Block, contexts: Sequence[MapContext]) -> TaskOutcomes:
        """Return what `evaluate` would for every growth of a block."""
        if self.area != "fast":
            return one_by_one(self, block, contexts)
        growth, parts = block.growth, list[TaskOutcomes]()
        for terrain, one, two in block.by_terrain():
            context = contexts[terrain]
            raster = context.raster(self.buffer_mm)
            if raster is None:
                return one_by_one(self, block, contexts)
            first, last = block.branch[one], block.branch[two]
            chains = Chains(
                growth.points,
                growth.first_point[first + one : last + two],
                block.branch[one : two + 1] - first,
                block.room[one : two + 1],
            )
            reached_mm2 = raster.reached_mm2(chains)
            grown_mm = _sums(growth.grown, block.branch[one : two + 1])
            parts.append(_outcomes(reached_mm2, grown_mm, context))
        return concatenated_outcomes(parts)

    def _exact_mm2(self, deployment: Deployment, context: MapContext) -> float:
        reached = near_chains(_chains(deployment), self.buffer_mm)
        return float(shapely.intersection(reached, context.free).area)


def near_chains(chains: Sequence[Sequence[Sequence[float]]], buffer_mm: float) -> BaseGeometry:
    """Return the area within a distance of some lines.

    Notes
    -----
    One line after the other and then together: buffering them all as one shape takes minutes where
    hundreds of them cross each other, instead of a tenth of a second.
    """
    lines = [shapely.LineString(chain) for chain in chains]
    return shapely.union_all(shapely.buffer(lines, buffer_mm, quad_segs=QUARTER_SEGMENTS))


def _outcomes(reached_mm2: Floats, grown_mm: Floats, context: MapContext) -> TaskOutcomes:
    share = np.minimum(1.0, reached_mm2 / context.area_mm2)
    return TaskOutcomes(share, {"reached_mm2": reached_mm2, "grown_mm": grown_mm})


def _sums(values: Floats, first: Ints) -> Floats:
    """Return the sum of each range, added up as for a single deployment."""
    sums = [float(values[one:two].sum()) for one, two in itertools.pairwise(first.tolist())]
    return np.array(sums, dtype=np.float64)


def _chains(deployment: Deployment) -> list[list[list[float]]]:
    """Return the points of every deployed branch's centreline."""
    deployed = np.flatnonzero(deployment.deployed)
    return [deployment.chain_mm(int(branch)).tolist() for branch in deployed]
