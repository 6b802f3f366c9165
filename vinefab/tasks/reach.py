"""The reach task: how much of the free space, or of some targets, the deployed body comes to."""

import itertools
from collections.abc import Mapping, Sequence
from typing import Annotated, ClassVar, Literal

import numpy as np
import shapely
from annotated_types import Ge, Le, Unit
from pydantic import BeforeValidator, Field
from shapely.geometry.base import BaseGeometry
from typing_extensions import Doc

from vinefab.core.errors import BadInputError
from vinefab.core.table import Table
from vinefab.core.validation import LARGEST_MM, SMALLEST, Floats, Ints
from vinefab.growth.batch import Block
from vinefab.model.deployment import Deployment
from vinefab.model.map import Map
from vinefab.tasks.covered_cells import BodyCover, CellGrid, Cover, TargetCover
from vinefab.tasks.fast_areas import Chains
from vinefab.tasks.map_context import MapContext
from vinefab.tasks.task import Outcome, TaskOutcomes, are_many, concatenated_outcomes, one_by_one

QUARTER_SEGMENTS = 32
"""Sides of the polygon that stands for a quarter of a round end: it has 0.04 % less area."""


Distance = Annotated[float, Ge(SMALLEST), Le(LARGEST_MM), Unit("mm")]
Coordinate = Annotated[float, Ge(-LARGEST_MM), Le(LARGEST_MM)]
Point = Annotated[tuple[Coordinate, Coordinate], Field(strict=False)]


def _points(given: object) -> object:
    """Return points of any length as given, where they are points."""
    if not isinstance(given, list | tuple) or len(given) > MOST_TARGETS:
        raise ValueError(f"[[x, y], ...], at most {MOST_TARGETS}")
    for place, point in enumerate(given, start=1):
        if not isinstance(point, list | tuple) or len(point) != 2:
            raise BadInputError(f"[{place}]", point, "[x, y] in mm")
    return tuple(given)


class Reach(Table):
    """Share of the free space within a buffer of the body (paper, Fig. 4), or of given targets.

    ``exact`` areas are by polygons, for a score that is reported; ``fast`` ones on cells of free
    space (`FreeArea.reached_mm2` states the error), a hundred times faster, for searching; taken
    only where the map is not too large for such a buffer.
    """

    name: ClassVar[str] = "reach"
    lowest: ClassVar[float] = 0.0

    buffer_mm: Annotated[
        Distance, Doc("largest distance from the body's centreline that counts as reached")
    ] = 40.0
    area: Annotated[
        Literal["auto", "exact", "fast"], Doc("how areas are found; auto: fast in a search")
    ] = "auto"
    target_mm: Annotated[
        tuple[Point, ...],
        BeforeValidator(_points),
        Unit("mm"),
        Doc(
            "points in the coordinates of every map: where there are any, the score is the share "
            "of them that is reached, and `buffer_mm` and `area` have no effect"
        ),
    ] = ()
    tolerance_mm: Annotated[
        Distance,
        Doc(
            "largest distance, straight, walls or not, at which a target counts as reached "
            "(assumed)"
        ),
    ] = 20.0
    falloff_mm: Annotated[
        float,
        Ge(0),
        Le(LARGEST_MM),
        Unit("mm"),
        Doc(
            "beyond the tolerance a target counts less and less, and nothing so much farther; 0: "
            "nothing"
        ),
    ] = 0.0
    reached_by: Annotated[
        Literal["body", "tip"],
        Doc("body: any point of a centreline; tip: the tip of a branch"),
    ] = "body"

    def for_search(self) -> "Reach":
        """Return the task with fast areas, unless its parameters say how to measure them."""
        return self.changed(area="fast") if self.area == "auto" else self

    def check_map(self, world: Map, context: MapContext) -> None:
        """Raise `BadInputError` where a target is not in the free space of a map."""
        points = np.array(self.target_mm).reshape(-1, 2)
        free = shapely.intersects_xy(context.free, *points.T)
        for place in np.flatnonzero(~free).tolist():
            x_mm, y_mm = self.target_mm[place]
            inside = world.bounds.covers(shapely.Point(x_mm, y_mm))
            solid = "inside an obstacle" if inside else "outside the bounds"
            allowed = f"a point in free space of every map; it is {solid} of {world.name!r}"
            key = f"task.target_mm[{place + 1}]"
            raise BadInputError(key, f"({x_mm:g}, {y_mm:g}) mm", allowed)

    def cover(self, context: MapContext) -> Cover:
        """Return what several robots reach together."""
        if not self.target_mm:
            return BodyCover(grid=CellGrid.of(context, self.buffer_mm), radius_mm=self.buffer_mm)
        targets = np.array(self.target_mm)
        tips = self.reached_by == "tip"
        return TargetCover(
            targets_mm=targets,
            away_mm=lambda chains: nearest_mm(chains, targets, tips=tips),
            tolerance_mm=self.tolerance_mm,
        )

    def evaluate(self, deployment: Deployment, context: MapContext) -> Outcome:
        """Return the share, 0 to 1, and as terms what was reached and the grown length."""
        if self.target_mm:
            summed_mm = np.array([float(deployment.grown_mm.sum())])
            return self._of_targets(_one_chain(deployment), summed_mm, context).one(0)
        raster = context.raster(self.buffer_mm) if self.area == "fast" else None
        if raster is None:
            deployed = np.flatnonzero(deployment.deployed)
            chains = [deployment.chain_mm(int(branch)).tolist() for branch in deployed]
            reached_mm2 = context.free_area_mm2(near_chains(chains, self.buffer_mm))
        else:
            (reached_mm2,) = raster.reached_mm2(_one_chain(deployment)).tolist()
        grown_mm = float(deployment.grown_mm.sum())
        return _outcomes(np.array([reached_mm2]), np.array([grown_mm]), context).one(0)

    def parts(self, score: float, _terms: Mapping[str, float]) -> dict[str, float]:
        """Return the score: what is reached is all that counts."""
        targets = f"targets within {self.tolerance_mm:g} mm"
        return {targets if self.target_mm else "area reached": score}

    def evaluate_block(self, block: Block, contexts: Sequence[MapContext]) -> TaskOutcomes:
        """Return what `evaluate` would for every growth of a block."""
        if self.area != "fast" and not self.target_mm:
            if not are_many(block, contexts):
                return one_by_one(self, block, contexts)
            return concatenated_outcomes(
                [self._of_bodies(block, *part, contexts[part[0]]) for part in block.by_terrain()]
            )
        growth, parts = block.growth, list[TaskOutcomes]()
        for terrain, one, two in block.by_terrain():
            context = contexts[terrain]
            raster = None if self.target_mm else context.raster(self.buffer_mm)
            if raster is None and not self.target_mm:
                return one_by_one(self, block, contexts)
            first, last = block.branch[one], block.branch[two]
            chains = Chains(
                growth.points,
                growth.first_point[first + one : last + two],
                block.branch[one : two + 1] - first,
                block.room[one : two + 1],
            )
            grown_mm = _sums(growth.grown, block.branch[one : two + 1])
            if raster is None:
                parts.append(self._of_targets(chains, grown_mm, context))
            else:
                parts.append(_outcomes(raster.reached_mm2(chains), grown_mm, context))
        return concatenated_outcomes(parts)

    def _of_bodies(
        self, block: Block, _terrain: int, one: int, two: int, context: MapContext
    ) -> TaskOutcomes:
        """Return what `evaluate` would for the growths ``one .. two - 1``, on one map."""
        growth, branches = block.growth, np.arange(block.branch[one], block.branch[two])
        of_growth = np.repeat(np.arange(one, two), np.diff(block.branch[one : two + 1]))
        first = block.room[of_growth] + growth.first_point[branches + of_growth]
        count = np.diff(growth.first_point)[branches + of_growth]
        out = np.flatnonzero(count)
        line_first = np.concatenate([[0], np.cumsum(count[out])])
        at = np.repeat(first[out] - line_first[:-1], count[out]) + np.arange(line_first[-1])
        lines_mm = growth.points[at]
        near = shapely.buffer(
            shapely.linestrings(lines_mm, indices=np.repeat(np.arange(len(out)), count[out])),
            self.buffer_mm,
            quad_segs=QUARTER_SEGMENTS,
        )
        begins = np.searchsorted(of_growth[out], np.arange(one, two + 1))
        reached_mm2 = context.rows.areas_mm2(near, begins, lines_mm, line_first, self.buffer_mm)
        for index in np.flatnonzero(np.isnan(reached_mm2)).tolist():
            union = shapely.union_all(near[begins[index] : begins[index + 1]])
            reached_mm2[index] = context.free_area_mm2(union)
        return _outcomes(reached_mm2, _sums(growth.grown, block.branch[one : two + 1]), context)

    def _of_targets(self, chains: Chains, grown_mm: Floats, context: MapContext) -> TaskOutcomes:
        """Return the share of the targets that is reached, and as terms how many and how near."""
        away_mm = nearest_mm(chains, np.array(self.target_mm), tips=self.reached_by == "tip")
        away_mm = np.minimum(away_mm, context.diagonal_mm)
        beyond_mm = away_mm - self.tolerance_mm
        reached = beyond_mm <= 0.0
        counted = reached.astype(np.float64)
        if self.falloff_mm > 0.0:
            counted = np.clip(1.0 - beyond_mm / self.falloff_mm, 0.0, 1.0)
        terms = {
            "targets_reached": reached.sum(axis=1).astype(np.float64),
            "farthest_mm": away_mm.max(axis=1),
            "grown_mm": grown_mm,
        }
        return TaskOutcomes(counted.mean(axis=1), terms)


MOST_TARGETS = 1000


def nearest_mm(chains: Chains, points_mm: Floats, *, tips: bool = False) -> Floats:
    """Return how far points are from the bodies of several growths, shape (j, t).

    Parameters
    ----------
    points_mm
        The points, shape (t, 2).
    tips
        Whether only tips count, instead of every point of a centreline. Where no branch came out
        the distance is infinite.
    """
    count = np.diff(chains.branch)
    growth = np.repeat(np.arange(len(count)), count)
    place = np.arange(len(growth)) + growth  # every growth has one more entry than branches
    first = chains.room[growth] + chains.first_point[place]
    end = chains.room[growth] + chains.first_point[place + 1]
    stretches = np.maximum(end - first - 1, 0)
    if tips:
        out = np.flatnonzero(end > first)
        a = b = end[out] - 1
        owner = growth[out]
    else:
        before = np.cumsum(stretches) - stretches
        a = np.repeat(first - before, stretches) + np.arange(stretches.sum())
        b, owner = a + 1, np.repeat(growth, stretches)
    away_mm = np.full((len(count), len(points_mm)), np.inf)
    owners, begin = np.unique(owner, return_index=True)
    base, along = chains.points_mm[a], chains.points_mm[b] - chains.points_mm[a]
    squared = np.maximum((along**2).sum(axis=1), np.finfo(np.float64).tiny)
    for column, point in enumerate(points_mm):
        share = np.clip(((point - base) * along).sum(axis=1) / squared, 0.0, 1.0)
        gap_mm = np.hypot(*(point - base - share[:, None] * along).T)
        if len(owners):
            away_mm[owners, column] = np.minimum.reduceat(gap_mm, begin)
    return away_mm


def _one_chain(deployment: Deployment) -> Chains:
    """Return the body of one deployment."""
    count, points = len(deployment.tree), len(deployment.points_mm)
    ends = np.array([0, count]), np.array([0, points])
    return Chains(deployment.points_mm, deployment.first_point, *ends)


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
