"""Score a design over maps and poses."""

from collections.abc import Sequence
from dataclasses import dataclass

from vinefab.environments.poses import draw_poses
from vinefab.growth.grow import grow
from vinefab.growth.options import GrowthOptions
from vinefab.growth.terrain import Terrain
from vinefab.model.design import Design
from vinefab.model.map import Map, Pose
from vinefab.model.score import Evaluation, Score
from vinefab.tasks.composite import composite
from vinefab.tasks.ground import Ground
from vinefab.tasks.task import Task

Poses = tuple[tuple[Pose, ...], ...]
"""For each map, the poses to grow from."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Site:
    """A map made ready for growing and scoring.

    Parameters
    ----------
    world
        The map.
    terrain
        Its walls, for growth.
    ground
        Its free space, for tasks.
    """

    world: Map
    terrain: Terrain
    ground: Ground

    @classmethod
    def of(cls, world: Map) -> "Site":
        """Return the site of a map."""
        return cls(world=world, terrain=Terrain.of(world), ground=Ground.of(world))


def poses_on(sites: Sequence[Site], count: int, seeds: Sequence[int]) -> Poses:
    """Draw poses on every map.

    Parameters
    ----------
    sites
        The maps.
    count
        Poses per map.
    seeds
        One per map.
    """
    return tuple(
        draw_poses(site.world, count, seed) for site, seed in zip(sites, seeds, strict=True)
    )


def score_design(
    design: Design,
    sites: Sequence[Site],
    poses: Poses,
    task: Task,
    options: GrowthOptions | None = None,
) -> Score:
    """Grow a design on every map from every pose and score each final state.

    Parameters
    ----------
    design
        The design.
    sites
        The maps.
    poses
        For each map, the poses to grow from; designs that meet the same ones can be compared.
    task
        What a final state is worth.
    options
        How to grow; the defaults when None.

    Returns
    -------
    Score
        One evaluation per map and pose, map by map, and their composites.
    """
    options = options or GrowthOptions()
    evaluations = tuple(
        _evaluation(design, site, pose, task, options)
        for site, places in zip(sites, poses, strict=True)
        for pose in places
    )
    return Score(
        task=task.name,
        evaluations=evaluations,
        composite=composite([evaluation.score for evaluation in evaluations]),
    )


def _evaluation(
    design: Design, site: Site, pose: Pose, task: Task, options: GrowthOptions
) -> Evaluation:
    score, terms = task.evaluate(grow(design, site.terrain, pose, options), site.ground)
    return Evaluation(map_name=site.world.name, pose=pose, score=score, terms=terms)
