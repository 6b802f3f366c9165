"""Scores of designs over maps and poses, and their composition into one number."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.validation import Floats
from vinefab.growth.batch import Batch, BlockMapper, Launches, TerrainSet
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plans
from vinefab.growth.terrain import Terrain
from vinefab.maps.poses import draw_poses
from vinefab.model.design import Design
from vinefab.model.map import Map, Pose, Start
from vinefab.model.score import MEAN_SHARE, STANDARD_DEVIATION, Evaluation, Score
from vinefab.tasks.map_context import MapContext
from vinefab.tasks.reach import check_targets_on
from vinefab.tasks.task import Task, TaskOutcomes, check_on_map, concatenated_outcomes, outcomes

Poses = tuple[tuple[Pose, ...], ...]
"""For each map, the poses to grow from."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Conditions:
    """Conditions of all designs of a generation: their start poses and contact options."""

    poses: Poses
    # head-on half-angle of each pose, map by map, where a range of it is drawn from; else empty
    half_angles_rad: tuple[float, ...] = ()
    # seed of the draws in each deployment, map by map, where children may stay in; else empty
    draw_seeds: tuple[int, ...] = ()

    def on_maps(self, taken: Sequence[int]) -> "Conditions":
        """Return the conditions on some of the maps only, by their index."""
        map_of = [index for index, places in enumerate(self.poses) for _ in places]
        angles = zip(map_of, self.half_angles_rad, strict=False)
        seeds = zip(map_of, self.draw_seeds, strict=False)
        return Conditions(
            poses=tuple(p if index in taken else () for index, p in enumerate(self.poses)),
            half_angles_rad=tuple(angle for index, angle in angles if index in taken),
            draw_seeds=tuple(seed for index, seed in seeds if index in taken),
        )

    @property
    def weights(self) -> Floats | None:
        """Weight of each evaluation, see `map_weights`."""
        return map_weights([len(places) for places in self.poses])

    def launches(self, terrains: TerrainSet) -> Launches:
        """Return the launches on the maps' terrains."""
        return Launches.of(terrains, self.poses, self.half_angles_rad, self.draw_seeds)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PreparedMap:
    """A map prepared for growth and scoring."""

    world: Map
    terrain: Terrain  # its walls, for growth
    context: MapContext  # its free space, for tasks
    around_starts: BaseGeometry  # bounds minus the obstacles near its starts, to draw poses in

    @classmethod
    def of(cls, world: Map) -> "PreparedMap":
        """Return a map with all that growth and tasks need of it.

        Raises
        ------
        BadInputError
            If the map has no free space.
        """
        terrain = Terrain.of(world)
        # Only obstacles that a pose drawn from a start could lie in.
        boxes = np.array([_reach_box(start) for start in world.starts], dtype=np.object_)
        near = np.unique(shapely.STRtree(world.obstacles).query(boxes)[1]).tolist()
        free = replace(world, obstacles=tuple(world.obstacles[index] for index in near)).free_space
        shapely.prepare(free)
        return cls(
            world=world,
            terrain=terrain,
            context=MapContext.of(world, terrain.free_space()),
            around_starts=free,
        )


def _reach_box(start: Start) -> Polygon:
    """Return a box around all that says which poses may be drawn from a start."""
    if start.area is not None:
        x_min, y_min, x_max, y_max = start.area.bounds
        reach_x_mm = reach_y_mm = start.clearance_mm + 1.0
    else:
        x_min = x_max = start.pose.x_mm
        y_min = y_max = start.pose.y_mm
        reach_x_mm, reach_y_mm = start.spread_x_mm, start.spread_y_mm
    return shapely.box(
        x_min - reach_x_mm, y_min - reach_y_mm, x_max + reach_x_mm, y_max + reach_y_mm
    )


def poses_on(
    maps: Sequence[PreparedMap], count: int, seeds: Sequence[int], *, repeats: bool = False
) -> Poses:
    """Draw poses from the starts of every map, in free space; all that differ.

    Parameters
    ----------
    maps
        The maps; each offers at least one start.
    count
        Number of poses per map; a start without spread gives one.
    seeds
        One seed per map.
    repeats
        Whether it gives its pose as often as asked: where every deployment has its own contacts.

    Raises
    ------
    BadInputError
        If a map has no start, or no free place within the range of one.
    """
    return tuple(
        draw_poses(prepared.world, count, seed, free=prepared.around_starts, repeats=repeats)
        for prepared, seed in zip(maps, seeds, strict=True)
    )


def trunks_with_room(
    design: Design, maps: Sequence[PreparedMap], poses: Poses, options: GrowthOptions
) -> list[bool]:
    """Tell for each pose whether a design's trunk has room there to leave its start at all."""
    if options.body == "centerline":
        return [True for places in poses for _ in places]
    radius_mm = options.radius_mm(design.build.widths_mm[0])
    rows = [
        prepared.terrain.have_room(prepared.terrain.starts_mm(places), radius_mm)
        for prepared, places in zip(maps, poses, strict=True)
        if places
    ]
    return [bool(has) for row in rows for has in row]


def score_design(
    design: Design,
    maps: Sequence[PreparedMap],
    poses: Poses,
    task: Task,
    options: GrowthOptions | None = None,
) -> Score:
    """Grow a design on every map from every pose and score each final state.

    Parameters
    ----------
    design
        The robot.
    maps
        The maps, prepared with `PreparedMap.of`.
    poses
        Poses on each map, at least one in all.
    task
        What final states are scored on; see `make_task`.
    options
        Options of the growth model; the defaults if None.

    Returns
    -------
    Score
        The evaluations, map by map and pose by pose, and their composites.

    Raises
    ------
    BadInputError
        If a pose is inside an obstacle or outside the bounds, or the task does not fit a map.
    """
    for prepared in maps:
        check_on_map(task, prepared.world, prepared.context)
    check_targets_on(task, [prepared.world for prepared in maps])
    terrains = TerrainSet([prepared.terrain for prepared in maps])
    (score,) = score_designs([design], maps, Launches.of(terrains, poses), task, options)
    return score


def score_designs(
    designs: Sequence[Design],
    maps: Sequence[PreparedMap],
    launches: Launches,
    task: Task,
    options: GrowthOptions | None = None,
    over: BlockMapper = map,
) -> tuple[Score, ...]:
    """Score several designs as `score_design` does, in blocks of growths.

    Parameters
    ----------
    designs, maps, task, options
        As in `score_design`.
    launches
        The poses on the maps, prepared with `Launches.of`.
    over
        How blocks are processed: `map`, or that of a pool of threads.

    Returns
    -------
    tuple of Score
        One per design. It depends neither on the other designs nor on the threads.
    """
    if not designs:
        return ()
    options = options or GrowthOptions()
    batch = Batch(Plans.of(designs, options), launches, options, engine="auto")
    contexts = [prepared.context for prepared in maps]
    evaluated = concatenated_outcomes(
        list(batch.each(lambda block: outcomes(task, block, contexts), over))
    )
    return tuple(scores_of(evaluated, task, maps, launches))


def scores_of(
    evaluated: TaskOutcomes, task: Task, maps: Sequence[PreparedMap], launches: Launches
) -> Iterator[Score]:
    """Yield the score of each design of a batch.

    Parameters
    ----------
    evaluated
        Outcomes of all growths: number ``launch * designs + design``.
    task, maps, launches
        Of the batch.
    """
    count = len(evaluated.score) // len(launches)
    names = [maps[terrain].world.name for terrain in launches.terrain.tolist()]
    weights = map_weights(np.bincount(launches.terrain).tolist())
    values, terms = evaluated.score.tolist(), {n: v.tolist() for n, v in evaluated.terms.items()}
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
        weighed = composite([evaluation.score for evaluation in evaluations], weights=weights)
        yield Score(task=task.name, evaluations=evaluations, composite=weighed)


# --- Composition ------------------------------------------------------------------------------


def map_weights(counts: Sequence[int]) -> Floats | None:
    """Return weights of evaluations by which maps count alike; None where all weigh the same.

    Parameters
    ----------
    counts
        Number of evaluations on each map, in their order.
    """
    some = [count for count in counts if count]
    if len(set(some)) < 2:
        return None
    return np.repeat(1.0 / (len(some) * np.array(some)), some)


def composite(
    scores: Sequence[float] | Floats,
    reference_deviation: float = STANDARD_DEVIATION,
    weights: Floats | None = None,
) -> dict[str, float]:
    """Return every composite of some scores.

    Parameters
    ----------
    scores
        At least one score.
    reference_deviation
        Standard deviation at which steadiness earns nothing.
    weights
        Weight of each score; None: all the same.

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
    return {kind: float(composites(row, kind, reference_deviation, weights)[0]) for kind in kinds}


def composites(
    scores: Floats,
    kind: str,
    reference_deviation: float = STANDARD_DEVIATION,
    weights: Floats | None = None,
) -> Floats:
    """Return one kind of composite for each of m rows of scores, shape (m,)."""
    rows = np.ascontiguousarray(scores)
    if kind == "best":
        return np.asarray(rows.max(axis=1))
    mean = np.asarray(rows.mean(axis=1) if weights is None else rows @ weights)
    if kind != "min_deviation":
        return mean
    squares = (rows - mean[:, None]) ** 2
    deviation = rows.std(axis=1) if weights is None else np.sqrt(squares @ weights)
    steadiness = np.maximum(0.0, 1.0 - deviation / reference_deviation)
    return np.asarray(MEAN_SHARE * mean + (1.0 - MEAN_SHARE) * steadiness)
