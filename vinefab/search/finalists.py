"""The choice of a winner: the best designs of a run, evaluated again on fresh poses.

Of a run with several objectives these are designs of the front, which no other dominates. Where
none of the best is manufacturable, they are repaired: moved to a nearby design that is.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from vinefab.core.errors import BadInputError, UnfitInputError
from vinefab.core.limits import rad
from vinefab.core.plain_text import counted
from vinefab.core.progress import each, phase
from vinefab.core.rng import child
from vinefab.core.validation import Floats
from vinefab.model.design import MOST_BRANCHES, Design
from vinefab.model.map import Map
from vinefab.model.score import Score
from vinefab.search.evaluator import FRESH, INVALID_FITNESS, Begin, Evaluator, FullCheck, penalty_at
from vinefab.search.manufacturability import FAILED
from vinefab.search.record.generations import Finalist, Generation
from vinefab.search.space import COSTS, DesignSpace
from vinefab.tasks.evaluate import Conditions, score_designs
from vinefab.tasks.reach import design_touches


def minimized(
    x: Floats, scores: Mapping[str, Floats], space: DesignSpace, names: Sequence[str]
) -> Floats:
    """Return the further values that a front minimizes, shape (m, k).

    These are costs, and the scores of other tasks with the opposite sign; infinite where there is
    no valid design.

    Parameters
    ----------
    x
        The points, shape (m, d).
    scores
        Composite scores of the points, shape (m,), by the names of their tasks; without any where
        none of the points has a design.
    names
        Costs and other tasks.
    """
    values, designs = np.full((len(x), len(names)), np.inf), space.batch(x)
    rows = np.flatnonzero(designs.sizes <= MOST_BRANCHES)
    for column, name in enumerate(names):
        if name in COSTS:
            values[rows, column] = COSTS[name].of(designs.part(rows), space.build_of)
        elif name in scores:
            values[:, column] = np.where(np.isfinite(scores[name]), -scores[name], np.inf)
    return values


def non_dominated(fitness: Floats, costs: Floats) -> NDArray[np.bool_]:
    """Return the mask of the points that no other point dominates, shape (m,).

    A point dominates another when it is not worse in fitness and all costs and better in at least
    one. Of equal points, the first counts as non-dominated.

    Parameters
    ----------
    fitness
        Larger is better, shape (m,).
    costs
        Smaller is better, shape (m, k).

    Examples
    --------
    >>> non_dominated(np.array([1.0, 2.0, 0.5]), np.array([[1.0], [3.0], [2.0]])).tolist()
    [True, True, False]
    """
    values = np.column_stack([-fitness, costs])
    on_front = np.ones(len(values), dtype=np.bool_)
    for row in range(len(values)):
        no_worse = (values <= values[row]).all(axis=1)
        better = (values < values[row]).any(axis=1)
        equal_before = no_worse & ~better & (np.arange(len(values)) < row)
        on_front[row] = not (no_worse & better).any() and not equal_before.any()
    return on_front


LEAST_BEND = 0.05
"""Least height of a knee above the line between the ends of the front, as a share of the range
(assumed); less is within the noise of scores."""


def knee(fitness: Floats, costs: Floats) -> int | None:
    """Return the knee of a front, the point where it bends most, or None.

    At a knee, a little more fitness costs much and a little less saves little: it lies above the
    straight line between the cheapest and the fittest point. A front of fewer than three points,
    a straight one and a convex one have none.

    Parameters
    ----------
    costs
        The cost, shape (m,). Points that are dominated in these two, as a front with more costs
        may have, are left out.

    Examples
    --------
    >>> knee(np.array([0.0, 0.8, 1.0]), np.array([1.0, 2.0, 9.0]))
    1
    >>> knee(np.array([0.0, 0.2, 1.0]), np.array([1.0, 8.0, 9.0])) is None
    True
    """
    rows = np.flatnonzero(non_dominated(fitness, costs[:, None]))
    rows = rows[np.argsort(costs[rows], kind="stable")]
    if len(rows) < 3:
        return None
    # Along a front, fitness rises with the cost: both spans are above 0.
    gained, spent = fitness[rows] - fitness[rows[0]], costs[rows] - costs[rows[0]]
    above = gained / gained[-1] - spent / spent[-1]
    place = int(np.argmax(above))
    return int(rows[place]) if above[place] >= LEAST_BEND else None


def feasible_points(
    history: Sequence[Generation], lowest: float, space: DesignSpace, names: Sequence[str]
) -> tuple[Floats, Floats, Floats]:
    """Return points, fitness and `minimized` of all manufacturable designs of a run, in order."""
    x = np.concatenate([generation.x for generation in history])
    fitness = np.concatenate([generation.fitness for generation in history])
    values = np.concatenate([minimized(g.x, g.terms, space, names) for g in history])
    feasible = fitness >= lowest
    return x[feasible], fitness[feasible], values[feasible]


def spread_out(costs: Floats, count: int) -> list[int]:
    """Return at most ``count`` points of a front, ends included, evenly spaced by first cost."""
    order = np.argsort(costs[:, 0], kind="stable")
    if len(order) > count:
        places = np.linspace(0, len(order) - 1, count).round().astype(np.int64)
        order = order[np.unique(places)]
    return [int(row) for row in order]


STEPS = 4000
"""Most changes for all points of a run together; each costs one penalty, a few milliseconds.
Repairs that succeeded took at most 400 (measured)."""

PATIENCE = 300
"""Changes in a row without a lower penalty after which a point is given up; repairs that succeeded
had at most 45 (measured)."""

MOST_CHECKS = 50
"""Most full checks of designs without penalty for one point; twice as many for all points."""


@dataclass(slots=True)
class RepairBudget:
    """What repairs may still cost."""

    steps: int = STEPS  # changes
    checks: int = 2 * MOST_CHECKS  # full checks


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RepairResult:
    """The result of repairing one point."""

    x: Floats  # the last point, shape (d,)
    penalty: float  # its penalty
    passed: bool  # whether its design passes the full check


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RepairResults:
    """The results of the repairs of a run, all within one budget."""

    repaired: list[Floats] = field(default_factory=list)  # points of designs that pass now
    message: str = ""  # the attempt and its result

    @classmethod
    def of(
        cls,
        points: Sequence[Floats],
        space: DesignSpace,
        penalty: Callable[[Design], float],
        passes: Callable[[Design], bool],
        asked: str = "manufacturable",
    ) -> "RepairResults":
        """Repair points one after the other until the budget is spent.

        Messages call designs that pass what is ``asked``.
        """
        budget, results = RepairBudget(), list[RepairResult]()
        for x in points:
            if budget.steps > 0 and budget.checks > 0:
                results.append(repair_design(x, space, penalty, passes, budget))
        repaired = [result.x for result in results if result.passed]
        outcome = f"{len(repaired)} of them are {asked} now"
        if not repaired:
            least = min(result.penalty for result in results)
            outcome = f"none is {asked}, lowest penalty {least:.3g}"
        tried = f"tried {STEPS - budget.steps} changes of the best {len(results)}"
        message = f"the search found no {asked} design; {tried}: {outcome}"
        return cls(repaired=repaired, message=message)


def repair_design(
    x: Floats,
    space: DesignSpace,
    penalty: Callable[[Design], float],
    passes: Callable[[Design], bool],
    budget: RepairBudget | None = None,
) -> RepairResult:
    """Search near a point for one whose design passes the full check.

    A random walk: each step changes one or two coordinates a little, now and then to anywhere in
    the range, and is kept unless it raises the penalty; nothing is grown. The result depends on
    the point alone. The walk ends when the penalty has not fallen for `PATIENCE` steps, when
    `MOST_CHECKS` designs failed the full check, or when the budget is spent.

    Parameters
    ----------
    x
        The point, shape (d,).
    budget
        What may be spent; costs are subtracted from it. None: enough for one point.
    """
    budget = RepairBudget() if budget is None else budget
    repair_stream = 1413
    rng, checks, vain = child(0, repair_stream), 0, 0
    here, lowest = x, _penalty_at(x, space, penalty)
    nearby = 0.15  # usual change of a coordinate, as a share of its range
    with phase("changes that may repair the best", STEPS) as tried:
        while budget.steps > 0 and budget.checks > 0 and checks < MOST_CHECKS and vain < PATIENCE:
            tried.at(STEPS - budget.steps)
            budget.steps -= 1
            there = here.copy()
            for place in rng.integers(0, len(x), rng.integers(1, 3)).tolist():  # one or two
                jump = rng.random() < 0.1
                step = rng.random() if jump else nearby * rng.standard_normal()
                there[place] = step if jump else there[place] + step
            there = np.clip(there, 0.0, 1.0)
            there_penalty = _penalty_at(there, space, penalty)
            vain = 0 if there_penalty < lowest or there_penalty == 0.0 else vain + 1
            if there_penalty > lowest:
                continue
            here, lowest = there, there_penalty
            if lowest == 0.0:
                if passes(space.design(here)):
                    return RepairResult(x=here, penalty=0.0, passed=True)
                checks, budget.checks = checks + 1, budget.checks - 1
    return RepairResult(x=here, penalty=lowest, passed=False)


def _penalty_at(x: Floats, space: DesignSpace, penalty: Callable[[Design], float]) -> float:
    """Return a point's penalty, infinite where there is no valid design."""
    try:
        value = penalty_at(penalty, space.design(x))
    except BadInputError:
        return np.inf
    return np.inf if np.isnan(value) else value


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FinalistChoice:
    """The points that are evaluated again at the end of a run."""

    points: list[Floats]  # at least one
    checked: bool = False  # whether they are known to pass the full check
    repair: str = ""  # message on the feasibility repair; empty where none was needed


def choose_finalists(
    history: Sequence[Generation],
    evaluator: Evaluator,
    count: int,
    further: Sequence[str] = (),
    *,
    held: Sequence[Floats] = (),
    by_table: bool = True,
) -> FinalistChoice:
    """Return the points that are evaluated again at the end of a run.

    Without a full check these are the best of the run. With one, they are the best that pass it;
    if none does, the best are repaired, and if that fails too they stay as they are. With further
    objectives, they are taken from the front. ``held``: points that the optimizer holds for the
    best, in place of those with the best fitness. ``by_table``: joints come from the table where
    they can; then the winner's are left to be simulated.
    """
    if further and (front := front_points(history, evaluator, count, further)):
        return FinalistChoice(points=front, checked=True)
    penalty, space = evaluator.winner_penalty, evaluator.space
    if not isinstance(penalty, FullCheck):
        points = list(held) or best_points(history, space, count)
        return FinalistChoice(points=points[:count])
    passes = evaluator.may_win if by_table and evaluator.has_table else penalty.passes
    # Most full checks among the designs of a run: joints are simulated, which may take seconds.
    most_full_checks = 60
    passing = list[Floats]()
    ranked = [(x, 0.0) for x in held]
    ranked = ranked or _ranked(history, space, max(most_full_checks, 2 * count))
    with phase("finalists chosen", count) as chosen:
        for tried, (x, broken) in enumerate(ranked):
            chosen.at(len(passing), f"{counted(tried, 'design')} checked")
            if len(passing) == count or broken > 0.0:
                break
            if passes(space.design(x)):
                passing.append(x)
    if passing:
        return FinalistChoice(points=passing, checked=True)
    best = list(held[:count]) or best_points(history, space, count)
    asked = "permitted" if evaluator.penalty is None else "manufacturable"
    repairs = RepairResults.of(best, space, penalty, passes, asked)
    if repairs.repaired:
        return FinalistChoice(points=repairs.repaired, checked=True, repair=repairs.message)
    return FinalistChoice(points=best, repair=repairs.message)


def front_points(
    history: Sequence[Generation], evaluator: Evaluator, count: int, further: Sequence[str]
) -> list[Floats]:
    """Return points of the front of all manufacturable designs of a run, perhaps none."""
    space, penalty = evaluator.space, evaluator.winner_penalty
    x, fitness, cost = feasible_points(history, evaluator.lowest, space, further)
    left = np.ones(len(x), dtype=np.bool_)
    while left.any():
        rows = np.flatnonzero(left)
        front = rows[non_dominated(fitness[rows], cost[rows])]
        chosen = front[spread_out(cost[front], count)]
        failed = [
            row
            for row in chosen
            if isinstance(penalty, FullCheck)
            and not (evaluator.may_win(design := space.design(x[row])) and penalty.passes(design))
        ]
        if not failed:
            return [x[row] for row in chosen]
        left[failed] = False
    return []


def best_points(history: Sequence[Generation], space: DesignSpace, count: int) -> list[Floats]:
    """Return the points of the best designs of a run, best first, each design once."""
    points = [x for x, _ in _ranked(history, space, count)]
    if not points:
        raise UnfitInputError("space", "no point of it was a design", "give other bounds")
    return points


def _ranked(
    history: Sequence[Generation], space: DesignSpace, count: int
) -> list[tuple[Floats, float]]:
    """Return points and penalties of the best designs, best first, each design once."""
    x = np.concatenate([generation.x for generation in history])
    fitness = np.concatenate([generation.fitness for generation in history])
    penalty = np.concatenate([generation.penalty for generation in history])
    ranked: dict[object, tuple[Floats, float]] = {}
    for index in np.argsort(-fitness, kind="stable"):
        if fitness[index] <= INVALID_FITNESS or len(ranked) == count:
            break
        design = space.design(x[index])
        ranked.setdefault(design.tree.key, (x[index], float(penalty[index])))
    return list(ranked.values())


def settled(
    finalists: Sequence[Finalist],
    conditions: Conditions,
    evaluator: Evaluator,
) -> tuple[Finalist, ...]:
    """Return finalists, best first, of which the first passes the full check; none if none does.

    Finalists are asked from the best on until one passes: its joints are simulated.
    """
    penalty = evaluator.winner_penalty
    if not isinstance(penalty, FullCheck) or not evaluator.has_table:
        return tuple(finalists)
    failed = list[Finalist]()
    for place, finalist in enumerate(each("full checks of finalists", finalists)):
        if penalty.passes(finalist.design):
            return (*finalists[place:], *failed)
        fitness = _fitness(finalist.x, finalist.score, FAILED, conditions, evaluator)
        failed.append(replace(finalist, penalty=FAILED, fitness=fitness))
    return ()


def reevaluated(
    choice: FinalistChoice,
    begin: Begin,
    conditions: Conditions,
    evaluator: Evaluator,
    fresh_maps: Sequence[Map] = (),
) -> tuple[Finalist, ...]:
    """Return the points chosen, evaluated on fresh poses, best first.

    The best of many noisy evaluations is overestimated; here all finalists are evaluated on the
    same poses, more of them, and none by which it was selected. Designs without a penalty come
    first, because their fitness is above that of all others; one that fails the full check counts
    as penalized.
    """
    x = np.array(choice.points)
    evaluations = begin(x, conditions)()
    designs = [evaluator.space.design(point) for point in x]
    worlds = [prepared.world for prepared in evaluator.maps]
    launches, spec = evaluator.launches(conditions), evaluator.spec
    full = evaluator.winner_penalty if isinstance(evaluator.winner_penalty, FullCheck) else None
    if spec.approximates:  # a run reports what `vinefab score` gives
        whole = spec.reported_task
        scores = score_designs(designs, evaluator.maps, launches, whole, evaluator.growth)
    else:
        places = range(len(designs))
        scores = tuple(evaluator.score(evaluations, row, conditions) for row in places)
    others, finalists = [other.name for other in spec.settings.other_tasks], list[Finalist]()
    found = zip(x, designs, scores, evaluations.penalty.tolist(), strict=True)
    for point, design, score, lack in each("finalists on fresh poses", found, total=len(x)):
        failed = not choice.checked and lack == 0.0 and full is not None and not full.passes(design)
        penalty = FAILED if failed else lack
        rows = {name: np.array([[e.terms[name] for e in score.evaluations]]) for name in others}
        means = evaluator.term_means(rows, conditions.weights)
        composite = {**score.composite, **{name: float(v[0]) for name, v in means.items()}}
        touches = design_touches(design, worlds, launches, evaluator.growth, spec.tasks[0])
        finalists.append(
            Finalist(
                x=point,
                design=design,
                score=replace(score, targets=touches, composite=composite),
                penalty=penalty,
                fitness=_fitness(point, score, penalty, conditions, evaluator),
            )
        )
    if evaluator.evaluation.finalists_by == "contact_range":
        finalists = _over_contacts(finalists, begin, conditions, evaluator)
    elif fresh_maps:
        finalists = _on_fresh_maps(finalists, fresh_maps, evaluator)
    # Stable: of equals, the one that was better in the search stays first.
    return tuple(sorted(finalists, key=lambda f: -f.fitness))


def _over_contacts(
    finalists: Sequence[Finalist], begin: Begin, conditions: Conditions, evaluator: Evaluator
) -> list[Finalist]:
    """Return finalists whose fitness is that of their mean over the range of contacts."""
    x = np.array([finalist.x for finalist in finalists])
    count = sum(len(places) for places in conditions.poses)
    means = []
    for angle_deg in each("contact angles of finalists", evaluator.growth.contact_angles_deg):
        at_angle = replace(conditions, half_angles_rad=(rad(angle_deg),) * count)
        evaluations = begin(x, at_angle)()
        means.append(evaluator.composites(evaluations.score, conditions.weights))
    return _with_composites(finalists, np.mean(means, axis=0), evaluator)


FRESH_POSES = 2
"""Poses on each of the fresh maps."""


def _on_fresh_maps(
    finalists: Sequence[Finalist], worlds: Sequence[Map], evaluator: Evaluator
) -> list[Finalist]:
    """Return finalists whose fitness is that on maps that the search has not seen."""
    x = np.array([finalist.x for finalist in finalists])
    settings = evaluator.spec.settings
    # Penalties are known already.
    grown = settings.evaluation.changed(maps_per_generation=0, fabricable=False, joint_weight=0.0)
    spec = replace(evaluator.spec, maps=tuple(worlds), settings=settings.changed(evaluation=grown))
    unseen = Evaluator.of(spec)
    conditions = unseen.conditions(settings.search.seed, FRESH, 0, FRESH_POSES)
    with phase("finalists on fresh maps"):
        scores = unseen.evaluate(x, conditions)[0].score
    composites = evaluator.composites(scores, conditions.weights)
    return _with_composites(finalists, composites, evaluator)


def _with_composites(
    finalists: Sequence[Finalist], composites: Floats, evaluator: Evaluator
) -> list[Finalist]:
    """Return finalists whose fitness is that of other composite scores, shape (m,)."""
    penalty = np.array([finalist.penalty for finalist in finalists])
    costs = evaluator.joint_costs(np.array([finalist.x for finalist in finalists]))
    fitness = evaluator.fitness(composites, penalty, costs).tolist()
    return [replace(one, fitness=value) for one, value in zip(finalists, fitness, strict=True)]


def _fitness(
    x: Floats, score: Score, penalty: float, conditions: Conditions, evaluator: Evaluator
) -> float:
    composite = evaluator.composites(score.scores[None], conditions.weights)
    costs = evaluator.joint_costs(x[None])
    return float(evaluator.fitness(composite, np.array([penalty]), costs)[0])
