"""How near bodies come to targets, and which targets deployments touch."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats
from vinefab.growth.batch import Batch, Launches
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plans
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.map import Map
from vinefab.model.target import Branches, Target, TargetsResult
from vinefab.tasks.fast_areas import Chains
from vinefab.tasks.task import Task

TARGETS, TOUCHED = "targets", "targets_reached"
"""Terms of scores of targets: how many there are, and how many are touched."""


def nearest_mm(chains: Chains, targets: Sequence[Target], *, tips: bool = False) -> Floats:
    """Return the distances of targets from the bodies of several growths, shape (j, t).

    Parameters
    ----------
    tips
        Whether only tips count, instead of every point of a centreline. Where no branch came out
        the distance is infinite.
    """
    count = np.diff(chains.branch)
    growth = np.repeat(np.arange(len(count)), count)
    place = np.arange(len(growth)) + growth  # every growth has one more entry than branches
    first = chains.room[growth] + chains.first_point[place]
    end = chains.room[growth] + chains.first_point[place + 1]
    away_mm = np.full((len(count), len(targets)), np.inf)
    branches = Branches(chains.points_mm, first, end)
    owner, gaps_mm = branches.gaps_mm(targets, tips=tips)
    owners, begin = np.unique(growth[owner], return_index=True)
    if len(owners):
        away_mm[owners] = np.minimum.reduceat(gaps_mm, begin, axis=0)
    return away_mm


def one_chain(deployment: Deployment) -> Chains:
    """Return the body of one deployment."""
    count, points = len(deployment.tree), len(deployment.points_mm)
    ends = np.array([0, count]), np.array([0, points])
    return Chains(deployment.points_mm, deployment.first_point, *ends)


def task_targets(task: Task | None, world: Map) -> tuple[Target, ...]:
    """Return the targets that count on a map: the task's own, or those of the map."""
    of_task: Callable[[Sequence[Target]], tuple[Target, ...]] | None
    of_task = getattr(_inner(task), "goals", None)
    return world.targets if of_task is None else of_task(world.targets)


def _inner(task: Task | None) -> Task | None:
    """Return the task that others are wrapped around."""
    while (inside := getattr(task, "task", None)) is not None:
        task = inside
    return task


def check_targets_on(task: Task, worlds: Sequence[Map]) -> None:
    """Raise `BadInputError` where a task would count targets on some maps and areas on others."""
    if not hasattr(_inner(task), "goals"):
        return
    aimed = [bool(task_targets(task, world)) for world in worlds]
    if any(aimed) and not all(aimed):
        bare = worlds[aimed.index(False)].name
        allowed = "targets on every map, or targets of the task, which hold on all"
        raise BadInputError("maps", f"map {bare!r} without targets", allowed)


def touched_targets(
    deployments: Iterable[tuple[Deployment, Map]], task: Task | None = None
) -> TargetsResult | None:
    """Return the targets that deployments touch; None where no map and no task has any.

    Targets of one name on several maps count as one.

    Parameters
    ----------
    deployments
        Each with its map.
    task
        Has its own targets, or says that only tips touch; None: the maps' targets, by bodies.
    """
    tips = getattr(_inner(task), "reached_by", "body") == "tip"
    aimed = ((one, task_targets(task, world)) for one, world in deployments)
    return TargetsResult.touched(aimed, tips=tips)


def design_touches(
    design: Design,
    worlds: Sequence[Map],
    launches: Launches,
    options: GrowthOptions,
    task: Task | None = None,
) -> TargetsResult | None:
    """Grow a design from every launch, and return which targets it touches; None without targets.

    Parameters
    ----------
    worlds
        One for each terrain of the launches.
    task
        As in `touched_targets`.
    """
    if not any(task_targets(task, world) for world in worlds):
        return None
    grown = Batch(Plans.of([design], options), launches, options, engine="auto").regrown()
    on = [worlds[index] for index in launches.terrain.tolist()]
    return touched_targets(zip(grown, on, strict=True), task)
