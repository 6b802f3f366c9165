"""Score designs over maps and poses."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from vinefab.core.validation import Floats
from vinefab.growth.batch import Batch, BlockMapper, Launches, TerrainSet
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plans
from vinefab.growth.terrain import Terrain
from vinefab.maps.poses import draw_poses
from vinefab.model.design import Design
from vinefab.model.map import Map, Pose
from vinefab.model.score import Evaluation, Score
from vinefab.tasks.map_context import MapContext
from vinefab.tasks.task import Task, TaskOutcomes, concatenated_outcomes, outcomes

Poses = tuple[tuple[Pose, ...], ...]
"""For each map, the poses to grow from."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PreparedMap:
    """A map made ready for growing and scoring."""

    world: Map  # the map
    terrain: Terrain  # its walls, for growth
    ground: MapContext  # its free space, for tasks
    # free space if there were only the obstacles near its starts, to draw poses in
    around_starts: BaseGeometry

    @classmethod
    def of(cls, world: Map) -> "PreparedMap":
        """Return the site of a map."""
        terrain = Terrain.of(world)
        return cls(
            world=world,
            terrain=terrain,
            ground=MapContext.of(world, terrain.free_space()),
            around_starts=_around_starts(world),
        )


def _around_starts(world: Map) -> BaseGeometry:
    """Return free space beside the obstacles that a pose drawn from a map's starts could lie in."""
    boxes = shapely.box(
        [start.pose.x_mm - start.spread_x_mm for start in world.starts],
        [start.pose.y_mm - start.spread_y_mm for start in world.starts],
        [start.pose.x_mm + start.spread_x_mm for start in world.starts],
        [start.pose.y_mm + start.spread_y_mm for start in world.starts],
    )
    near = np.unique(shapely.STRtree(world.obstacles).query(boxes)[1]).tolist()
    free = replace(world, obstacles=tuple(world.obstacles[index] for index in near)).free_space
    shapely.prepare(free)
    return free


def poses_on(sites: Sequence[PreparedMap], count: int, seeds: Sequence[int]) -> Poses:
    """Draw poses on every map."""
    return tuple(
        draw_poses(site.world, count, seed, free=site.around_starts)
        for site, seed in zip(sites, seeds, strict=True)
    )


def score_design(
    design: Design,
    sites: Sequence[PreparedMap],
    poses: Poses,
    task: Task,
    options: GrowthOptions | None = None,
) -> Score:
    """Grow a design on every map from every pose and score each final state."""
    atlas = TerrainSet([site.terrain for site in sites])
    (score,) = score_designs([design], sites, Launches.of(atlas, poses), task, options)
    return score


def score_designs(
    designs: Sequence[Design],
    sites: Sequence[PreparedMap],
    launches: Launches,
    task: Task,
    options: GrowthOptions | None = None,
    over: BlockMapper = map,
) -> tuple[Score, ...]:
    """Score several designs as `score_design` does, in batches."""
    if not designs:
        return ()
    options = options or GrowthOptions()
    batch = Batch(Plans.of(designs, options), launches, options)
    grounds = [site.ground for site in sites]
    found = concatenated_outcomes(
        list(batch.each(lambda block: outcomes(task, block, grounds), over))
    )
    return tuple(scores_of(found, task, sites, launches))


def scores_of(
    found: TaskOutcomes, task: Task, sites: Sequence[PreparedMap], launches: Launches
) -> Iterator[Score]:
    """Give the score of each design of a batch."""
    count = len(found.score) // len(launches)
    names = [sites[terrain].world.name for terrain in launches.terrain.tolist()]
    values, terms = found.score.tolist(), {n: v.tolist() for n, v in found.terms.items()}
    for design in range(count):
        evaluations = tuple(
            Evaluation(
                map_name=name,
                pose=pose,
                score=values[row],
                terms={term: column[row] for term, column in terms.items()},
            )
            for row, name, pose in zip(
                range(design, len(values), count), names, launches.poses, strict=True
            )
        )
        weighed = composite([evaluation.score for evaluation in evaluations])
        yield Score(task=task.name, evaluations=evaluations, composite=weighed)


# --- One number for a design -----------------------------------------------------------------

MEAN_SHARE = 0.25
"""Share of the mean in ``min_deviation`` [paper]; its form is vinefab's."""

STANDARD_DEVIATION = 0.5
"""The deviation that earns nothing: the largest that scores between 0 and 1 can have."""

COMPOSITES = ("mean", "best", "min_deviation", "single")
"""Ways to weigh scores in a search; ``single`` takes one evaluation for what it is."""


def composite(
    scores: Sequence[float] | Floats, reference_deviation: float = STANDARD_DEVIATION
) -> dict[str, float]:
    """Return every way of weighing scores into one number.

    Returns
    -------
    dict
        ``mean``; ``best``, the largest; ``min_deviation``, a quarter of the mean plus three
        quarters of ``1 - std / reference_deviation`` (not below 0).

    Examples
    --------
    >>> composite([0.2, 0.6])["mean"]
    0.4
    """
    row = np.asarray(scores, dtype=np.float64)[None]
    kinds = ("mean", "best", "min_deviation")
    return {kind: float(composites(row, kind, reference_deviation)[0]) for kind in kinds}


def composites(
    scores: Floats, kind: str, reference_deviation: float = STANDARD_DEVIATION
) -> Floats:
    """Return one of the numbers of `composite` for each of m rows of scores."""
    rows = np.ascontiguousarray(scores)
    if kind == "best":
        return np.asarray(rows.max(axis=1))
    mean = np.asarray(rows.mean(axis=1))
    if kind != "min_deviation":
        return mean
    steadiness = np.maximum(0.0, 1.0 - rows.std(axis=1) / reference_deviation)
    return np.asarray(MEAN_SHARE * mean + (1.0 - MEAN_SHARE) * steadiness)
