"""The coverage task: as much seen area as possible from as simple a robot as possible."""

import itertools
import math
from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar, Literal

import numpy as np
from annotated_types import Ge, Le, Unit
from typing_extensions import Doc

from vinefab.core.table import Table
from vinefab.core.validation import LARGEST_MM, SMALLEST, Floats, Ints
from vinefab.growth.batch import GrowthBlock
from vinefab.model.deployment import Deployment
from vinefab.tasks.areas import (
    CellGrid,
    Cover,
    FreeArea,
    SightLines,
    TipCover,
    disc_polygons,
    disc_union,
    free_disc_areas_mm2,
    seen_areas,
)
from vinefab.tasks.map_context import MapContext
from vinefab.tasks.task import Outcome, TaskOutcomes, are_many, concatenated_outcomes, one_by_one

_ROUNDING = 1e-12
TERMS = ("area", "count", "length", "film", "eta")


Weight = Annotated[float, Ge(0), Le(1e3)]


class Coverage(Table):
    """Every deployed branch has a sensor at its tip; seen area counts, branches and film cost.

    ``score = w_area A/A_free - w_count N/N_max (1 - eta) - w_length L/L_max (1 - eta)
    - w_film L/L_max`` with A the area of the union of the discs, N their number, L the planned
    length of all branches together and eta = A over the sum of the discs' areas, the share of the
    sensed area that is not sensed twice. N/N_max and L/L_max count as 1 beyond 1. The four terms
    are the paper's (section 2.3); weights, N_max and L_max are vinefab's, for the paper's are not
    published.

    ``exact`` areas are by polygons, for a score that is reported. ``fast`` ones are by strips of
    free space, or lines across it in line of sight (`FreeArea.covered_mm2` and
    `SightLines.covered_mm2` state the error), a hundred times faster, for searching; taken only
    where the map is not too large for such discs.
    """

    name: ClassVar[str] = "coverage"

    radius_mm: Annotated[
        float, Ge(SMALLEST), Le(LARGEST_MM), Unit("mm"), Doc("of the disc that one sensor sees")
    ] = 50.0
    most_branches: Annotated[int, Ge(1), Le(100_000), Doc("N_max")] = 100
    most_diagonals: Annotated[
        float, Ge(SMALLEST), Le(1e4), Doc("L_max over the diagonal of the map's bounds")
    ] = 20.0
    weight_area: Annotated[Weight, Doc("of the seen area")] = 1.0
    weight_count: Annotated[Weight, Doc("of the number of branches")] = 0.5
    weight_length: Annotated[Weight, Doc("of the length")] = 0.5
    weight_film: Annotated[Weight, Doc("of the film")] = 0.1
    clip: Annotated[
        Literal["free", "none", "sight"],
        Doc(
            "free: only free space is seen and every area above is taken within it; none: whole "
            "discs, as the paper's words have it; sight: free space that no wall hides from the "
            "sensor"
        ),
    ] = "free"
    area: Annotated[
        Literal["auto", "exact", "fast"], Doc("how areas are found; auto: fast in a search")
    ] = "auto"

    def for_search(self) -> "Coverage":
        """Return the task with fast areas, unless its parameters say how to measure them."""
        return self.changed(area="fast") if self.area == "auto" else self

    def cover(self, context: MapContext) -> Cover:
        """Return the joint area that several robots see: free space alone, nothing subtracted."""
        edges_mm = context.edges_mm if self.clip == "sight" else None
        grid = CellGrid.of(context.edges_mm, self.radius_mm)
        return TipCover(grid=grid, radius_mm=self.radius_mm, edges_mm=edges_mm)

    @property
    def lowest(self) -> float:
        """The score of a robot that sees nothing at the highest cost."""
        return -(self.weight_count + self.weight_length + self.weight_film)

    def evaluate(self, deployment: Deployment, context: MapContext) -> Outcome:
        """Return the score and its terms: ``area``, ``count``, ``length``, ``film``, ``eta``.

        The first four are the numbers from 0 to 1 that the weights multiply, ``count`` and
        ``length`` with their (1 - eta). The area's error is that of `disc_union`.
        """
        tips_mm = deployment.tips_mm
        seen_mm2, summed_mm2 = self._areas_mm2(tips_mm, context)
        return self._outcomes(
            np.array([seen_mm2]),
            np.array([summed_mm2]),
            np.array([len(tips_mm)]),
            np.array([deployment.tree.total_length_mm]),
            context,
        ).one(0)

    def parts(self, _score: float, terms: Mapping[str, float]) -> dict[str, float]:
        """Return the terms with their weights: the area earns, the others cost."""
        return {
            "area seen": self.weight_area * terms["area"],
            "branches that see twice": -self.weight_count * terms["count"],
            "length that sees twice": -self.weight_length * terms["length"],
            "film": -self.weight_film * terms["film"],
        }

    def evaluate_block(self, block: GrowthBlock, contexts: Sequence[MapContext]) -> TaskOutcomes:
        """Return the outcome of `evaluate` for every growth of a block."""
        is_fast = self.area == "fast"
        if not is_fast and (self.clip != "free" or not are_many(block, contexts)):
            return one_by_one(self, block, contexts)
        tips_mm, first = block.tips_mm()
        lengths_mm = block.planned_mm()
        parts: list[TaskOutcomes] = []
        for terrain, one, two in block.by_terrain():
            strips = self._strips(contexts[terrain]) if is_fast else None
            if is_fast and strips is None:
                return one_by_one(self, block, contexts)
            begins, own_mm = first[one : two + 1] - first[one], tips_mm[first[one] : first[two]]
            if strips is None:
                seen, summed = self._free_areas_mm2(own_mm, begins, contexts[terrain])
            else:
                seen, summed = strips.covered_mm2(own_mm, begins)
            counts = np.diff(begins)
            parts.append(
                self._outcomes(seen, summed, counts, lengths_mm[one:two], contexts[terrain])
            )
        return concatenated_outcomes(parts)

    def _outcomes(
        self,
        seen_mm2: Floats,
        summed_mm2: Floats,
        tips: Ints,
        length_mm: Floats,
        context: MapContext,
    ) -> TaskOutcomes:
        """Return score and terms for several final states on one map."""
        overlap = np.zeros_like(seen_mm2)
        sees = summed_mm2 > 0.0
        overlap[sees] = np.clip(1.0 - seen_mm2[sees] / summed_mm2[sees], 0.0, 1.0)
        # A union of polygons against a sum of true discs: a remainder this small is rounding.
        overlap[overlap <= _ROUNDING] = 0.0
        film = np.minimum(1.0, length_mm / (self.most_diagonals * context.diagonal_mm))
        area = np.minimum(1.0, seen_mm2 / context.area_mm2)
        count = np.minimum(1.0, tips / self.most_branches) * overlap
        length = film * overlap
        score = (
            self.weight_area * area
            - self.weight_count * count
            - self.weight_length * length
            - self.weight_film * film
        )
        columns = (area, count, length, film, 1.0 - overlap)
        return TaskOutcomes(score, dict(zip(TERMS, columns, strict=True)))

    def _areas_mm2(self, tips_mm: Floats, context: MapContext) -> tuple[float, float]:
        """Return the area of the union of the discs and the sum of their areas."""
        if len(tips_mm) == 0:
            return 0.0, 0.0
        strips = self._strips(context) if self.area == "fast" else None
        if strips is not None:
            seen, summed = strips.covered_mm2(tips_mm, np.array([0, len(tips_mm)]))
            return float(seen[0]), float(summed[0])
        if self.clip == "sight":
            each_mm2, union = seen_areas(tips_mm, self.radius_mm, context.edges_mm)
            return union.area, float(each_mm2.sum())
        union = disc_union(tips_mm, self.radius_mm)
        if self.clip == "none":
            return union.area, len(tips_mm) * math.pi * self.radius_mm**2
        each_mm2 = free_disc_areas_mm2(tips_mm, self.radius_mm, context.edges_mm)
        return context.free_area_mm2(union), float(each_mm2.sum())

    def _free_areas_mm2(
        self, tips_mm: Floats, begins: Ints, context: MapContext
    ) -> tuple[Floats, Floats]:
        """Return `_areas_mm2` within free space for several final states on one map."""
        discs = disc_polygons(tips_mm, self.radius_mm)
        lines = np.arange(len(tips_mm) + 1)
        seen = context.rows.areas_mm2(discs, begins, tips_mm, lines, self.radius_mm)
        each_mm2 = free_disc_areas_mm2(tips_mm, self.radius_mm, context.edges_mm)
        edges = itertools.pairwise(begins.tolist())
        summed = np.array([each_mm2[one:two].sum() for one, two in edges])
        for index in np.flatnonzero(np.isnan(seen)).tolist():
            union = disc_union(tips_mm[begins[index] : begins[index + 1]], self.radius_mm)
            seen[index] = context.free_area_mm2(union)
        return seen, summed

    def _strips(self, context: MapContext) -> FreeArea | SightLines | None:
        """Return the strips or lines for fast areas; None where the map is too large for them."""
        if self.clip == "sight":
            return context.sight_lines(self.radius_mm)
        return context.raster(self.radius_mm, walls=self.clip == "free")
