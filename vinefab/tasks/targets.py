"""How near bodies come to targets, and which targets deployments touch."""

from collections.abc import Callable, Iterable, Sequence

import numpy as np
import shapely

from vinefab.core.validation import Floats
from vinefab.growth.batch import Batch, Launches
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plans
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.map import Map
from vinefab.model.target import Target, TargetOutcome, TargetsResult
from vinefab.tasks.fast_areas import Chains
from vinefab.tasks.task import Task


def nearest_mm(chains: Chains, targets: Sequence[Target], *, tips: bool = False) -> Floats:
    """Return how far targets are from the bodies of several growths, shape (j, t).

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
    stretches = np.maximum(end - first - 1, 0)
    if tips:
        out = np.flatnonzero(end > first)
        a = b = end[out] - 1
        owner = growth[out]
    else:
        before = np.cumsum(stretches) - stretches
        a = np.repeat(first - before, stretches) + np.arange(stretches.sum())
        b, owner = a + 1, np.repeat(growth, stretches)
    away_mm = np.full((len(count), len(targets)), np.inf)
    owners, begin = np.unique(owner, return_index=True)
    if not len(owners):
        return away_mm
    base, along = chains.points_mm[a], chains.points_mm[b] - chains.points_mm[a]
    squared = np.maximum((along**2).sum(axis=1), np.finfo(np.float64).tiny)
    for column, target in enumerate(targets):
        if target.point_mm is None:
            ends = np.stack([base, base + along], axis=1)
            gap_mm = shapely.distance(shapely.linestrings(ends), target.shape)
        else:
            point = np.array(target.point_mm)
            share = np.clip(((point - base) * along).sum(axis=1) / squared, 0.0, 1.0)
            gap_mm = np.hypot(*(point - base - share[:, None] * along).T)
        away_mm[owners, column] = np.minimum.reduceat(gap_mm, begin)
    return away_mm


def one_chain(deployment: Deployment) -> Chains:
    """Return the body of one deployment."""
    count, points = len(deployment.tree), len(deployment.points_mm)
    ends = np.array([0, count]), np.array([0, points])
    return Chains(deployment.points_mm, deployment.first_point, *ends)


def _each_branch(deployment: Deployment) -> Chains:
    """Return the branches of a deployment as bodies, one for each."""
    first, count = deployment.first_point, len(deployment.tree)
    ends = np.stack([first[:-1], first[1:]], axis=1).ravel()
    none = np.zeros(count, dtype=np.int64)
    return Chains(deployment.points_mm, ends, np.arange(count + 1), none)


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


def touched_targets(
    deployments: Iterable[tuple[Deployment, Map]], task: Task | None = None
) -> TargetsResult | None:
    """Return which targets deployments touch; None where no map and no task has any.

    Targets of one name on several maps count as one.

    Parameters
    ----------
    deployments
        Each with its map.
    task
        Has targets of its own, or says that only tips touch; None: the maps' targets, by bodies.
    """
    tips = getattr(_inner(task), "reached_by", "body") == "tip"
    found: dict[str, list[tuple[Target, float, str]]] = {}
    together: list[float] = []
    for deployment, world in deployments:
        targets = task_targets(task, world)
        if not targets:
            continue
        each_mm = nearest_mm(_each_branch(deployment), targets, tips=tips)
        nearest = each_mm.argmin(axis=0)
        away_mm = each_mm[nearest, np.arange(len(targets))]
        for target, branch, far_mm in zip(targets, nearest.tolist(), away_mm.tolist(), strict=True):
            name = deployment.tree.ids[branch] if np.isfinite(far_mm) else ""
            found.setdefault(target.name, []).append((target, far_mm, name))
        within_mm = np.array([target.tolerance_mm for target in targets])
        together.append(float((away_mm <= within_mm).all()))
    if not found:
        return None
    outcomes = [
        TargetOutcome(
            target=rows[0][0],
            away_mm=np.array([far_mm for _, far_mm, _ in rows]),
            branches=tuple(name for *_, name in rows),
        )
        for rows in found.values()
    ]
    return TargetsResult.of(outcomes, np.array(together))


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
