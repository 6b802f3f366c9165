"""The task protocol: scores of final states, one by one or for a whole block of growths."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.foreign import broken, calling, ensure_finite, ensure_numbers, is_own
from vinefab.core.validation import Floats, Ints
from vinefab.growth.batch import GrowthBlock
from vinefab.growth.options import HALF_ANGLE_DEG
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.map import Map
from vinefab.tasks.areas import Cover
from vinefab.tasks.map_context import MOST_EDGES_AT_ONCE, MapContext

Outcome = tuple[float, Mapping[str, float]]
"""A score, higher is better, and its terms: the named numbers that make it up."""


class TaskOutcomes(NamedTuple):
    """Scores and terms of j growths."""

    score: Floats  # shape (j,)
    terms: Mapping[str, Floats]  # the named numbers that make up the scores, each of shape (j,)

    def one(self, index: int) -> Outcome:
        """Return the score and the terms of one growth."""
        terms = {name: float(values[index]) for name, values in self.terms.items()}
        return float(self.score[index]), terms


class Task(Protocol):
    """Scores one deployment; a frozen dataclass whose fields are its parameters.

    A task may also define ``evaluate_block(block: GrowthBlock, contexts: Sequence[MapContext]) ->
    TaskOutcomes``, which returns what `evaluate` would for every growth of a block, but faster;
    `outcomes` uses it where it exists. One that cannot be scored on every map may define
    ``check_map(world: Map, context: MapContext)``, which raises `BadInputError`.
    """

    @property
    def name(self) -> str:
        """Its name in the registry and in files."""
        ...

    @property
    def lowest(self) -> float:
        """A lower bound of all scores; designs that are not manufacturable rank below it."""
        ...

    def evaluate(self, deployment: Deployment, context: MapContext) -> Outcome:
        """Return the score of one final state and its terms.

        Parameters
        ----------
        deployment
            The final state; positions in mm, turns in rad.
        context
            The map that it grew on.
        """
        ...


def check_on_map(task: Task, world: Map, context: MapContext) -> None:
    """Raise `BadInputError` for a task that cannot be scored on a map."""
    check: Callable[[Map, MapContext], None] | None = getattr(task, "check_map", None)
    if check is not None:
        with calling(_what(task), task):
            check(world, context)


def _what(task: Task) -> str:
    return f"task {task.name!r}"


def ensure_task(task: object) -> None:
    """Raise an error for an object of another package that cannot score.

    Raises
    ------
    BrokenPluginError
        If it has no name, no finite lowest score, or nothing that evaluates.
    """
    if is_own(task):
        return
    what = f"task {type(task).__name__}"
    with calling(what, task):
        name, lowest = getattr(task, "name", None), getattr(task, "lowest", None)
        evaluate = getattr(task, "evaluate", None)
    if not isinstance(name, str) or not name:
        raise broken(what, task, "its name is not a text")
    ensure_finite(what, task, "lowest", lowest)
    if not callable(evaluate):
        raise broken(what, task, "it has no function evaluate(deployment, context)")


def evaluated(task: Task, deployment: Deployment, context: MapContext) -> Outcome:
    """Return a task's score and terms of one final state; of a foreign task they are checked.

    Raises
    ------
    BrokenPluginError
        If a foreign task breaks down, or returns anything but finite numbers.
    """
    if is_own(task):
        return task.evaluate(deployment, context)
    what = _what(task)
    with calling(what, task):
        found: object = task.evaluate(deployment, context)
    if not isinstance(found, tuple) or len(found) != 2:
        raise broken(what, task, f"evaluate returns {found!r:.60}, not (score, terms)")
    score = ensure_finite(what, task, "score", found[0])
    return score, ensure_numbers(what, task, "terms", found[1])


def _at_once(
    task: Task,
    evaluate: Callable[[GrowthBlock, Sequence[MapContext]], TaskOutcomes],
    block: GrowthBlock,
    contexts: Sequence[MapContext],
) -> TaskOutcomes:
    """Return the outcomes of a block by the task's function; of a foreign one they are checked."""
    if is_own(task):
        return evaluate(block, contexts)
    what = _what(task)
    with calling(what, task):
        found: object = evaluate(block.read_only(), contexts)
    if not isinstance(found, TaskOutcomes):
        returned = type(found).__name__
        raise broken(what, task, f"evaluate_block returns {returned}, not TaskOutcomes")
    with calling(what, task):
        columns = {"score": found.score, **found.terms}
    for name, column in columns.items():
        fits = isinstance(column, np.ndarray) and column.shape == (len(block),)
        if not fits or column.dtype.kind not in "fiu" or not np.isfinite(column).all():
            allowed = f"not {len(block)} finite numbers"
            raise broken(what, task, f"{name} of evaluate_block is {column!r:.60}, {allowed}")
    return TaskOutcomes(
        np.array(found.score, dtype=np.float64),
        {name: np.array(one, dtype=np.float64) for name, one in found.terms.items()},
    )


def outcomes(task: Task, block: GrowthBlock, contexts: Sequence[MapContext]) -> TaskOutcomes:
    """Return a task's score and terms for every growth of a block.

    Parameters
    ----------
    contexts
        One per terrain of the block's launches.
    """
    # Not a protocol check: this runs for every block, and `isinstance` would take longer.
    at_once: Callable[[GrowthBlock, Sequence[MapContext]], TaskOutcomes] | None
    at_once = getattr(task, "evaluate_block", None)
    if at_once is None:
        found = one_by_one(task, block, contexts)
    else:
        found = _at_once(task, at_once, block, contexts)
    angle_rad = block.launches.half_angle_rad
    if angle_rad is None:
        return found
    # Each evaluation has its own: it stands with the terms wherever these are recorded.
    return TaskOutcomes(
        found.score, {**found.terms, HALF_ANGLE_DEG: np.degrees(angle_rad[block.launch])}
    )


def one_by_one(task: Task, block: GrowthBlock, contexts: Sequence[MapContext]) -> TaskOutcomes:
    """Return a task's score and terms for every growth of a block, each from its deployment."""
    terrain = block.terrain.tolist()
    return stacked_outcomes(
        [
            evaluated(task, block.deployment(index), contexts[terrain[index]])
            for index in range(len(block))
        ]
    )


def are_many(block: GrowthBlock, contexts: Sequence[MapContext]) -> bool:
    """Tell whether exact areas of a block are worth compiled code, which small maps have."""
    corners = max((len(contexts[index].edges_mm) for index, *_ in block.by_terrain()), default=0)
    # The exact areas of fewer growths are measured one by one: sooner than code is loaded.
    few_growths = 16
    return len(block) >= few_growths and corners <= MOST_EDGES_AT_ONCE


def stacked_outcomes(single: Sequence[Outcome]) -> TaskOutcomes:
    """Return several growths' scores and terms as columns."""
    names = tuple(single[0][1]) if single else ()
    for _, terms in single:
        if tuple(terms) != names:
            raise BadInputError("a task's terms", list(terms), f"always the same: {list(names)}")
    rows = np.array([(score, *terms.values()) for score, terms in single], dtype=np.float64)
    columns = np.ascontiguousarray(rows.reshape(len(single), 1 + len(names)).T)
    return TaskOutcomes(columns[0], dict(zip(names, columns[1:], strict=True)))


def concatenated_outcomes(parts: Sequence[TaskOutcomes]) -> TaskOutcomes:
    """Return the outcomes of several blocks, at least one, as those of one."""
    if len(parts) == 1:
        return parts[0]
    names = list(parts[0].terms)
    for part in parts:
        if part.terms.keys() != parts[0].terms.keys():
            raise BadInputError("a task's terms", list(part.terms), f"always the same: {names}")
    terms = {name: np.concatenate([part.terms[name] for part in parts]) for name in names}
    return TaskOutcomes(np.concatenate([part.score for part in parts]), terms)


def score_parts(task: Task, score: float, terms: Mapping[str, float]) -> dict[str, float]:
    """Return the gains and costs in a score, by name; they add up to it.

    A task may define ``parts(score, terms) -> Mapping[str, float]``; of others nothing is known.
    """
    parts: Callable[[float, Mapping[str, float]], Mapping[str, float]] | None
    parts = getattr(task, "parts", None)
    if parts is None:
        return {}
    with calling(_what(task), task):
        found = dict(parts(score, dict(terms)))
    return found if is_own(task) else ensure_numbers(_what(task), task, "parts", found)


def search_form(task: Task) -> Task:
    """Return the form of a task that a search evaluates.

    A task may define ``for_search() -> Task``: itself with faster approximations, unless its
    parameters ask for exact scores. Reported scores take the task as it is.
    """
    faster: Callable[[], Task] | None = getattr(task, "for_search", None)
    if faster is None:
        return task
    with calling(_what(task), task):
        found = faster()
    if found is not task:
        ensure_task(found)
    return found


def cover_of(task: Task, context: MapContext) -> Cover:
    """Return the measure of the area that a task's deployments cover on a map.

    A task may define ``cover(context: MapContext) -> Cover``.

    Raises
    ------
    BadInputError
        If the task does not define the covered area, or the map is too large.
    """
    offered: Callable[[MapContext], Cover] | None = getattr(task, "cover", None)
    if offered is None:
        allowed = "coverage, reach, or a task with a method cover: others have no union"
        raise BadInputError("task of several robots", task.name, allowed)
    with calling(_what(task), task):
        return offered(context)


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadOnPenalty:
    """Another task minus a weight times the share of deployed branches that stopped head-on.

    Head-on collisions, at branching points above all, keep real robots from growing on (paper,
    3.3.2); its discussion asks for penalties that make them rarer.
    """

    task: Task
    weight: float  # penalty of a robot whose branches all stop head-on

    @property
    def name(self) -> str:
        """The task's name."""
        return self.task.name

    @property
    def lowest(self) -> float:
        """The task's lowest score, with all branches stopped head-on."""
        return self.task.lowest - self.weight

    def evaluate(self, deployment: Deployment, context: MapContext) -> Outcome:
        """Return the task's score minus the penalty, and its terms with ``head_on``, the share."""
        score, terms = evaluated(self.task, deployment, context)
        share = float(_shares(deployment.stop, np.array([0, len(deployment.stop)]))[0])
        return score - self.weight * share, {**terms, "head_on": share}

    def evaluate_block(self, block: GrowthBlock, contexts: Sequence[MapContext]) -> TaskOutcomes:
        """Return the outcome of `evaluate` for every growth of a block."""
        share = _shares(block.growth.stop, block.branch)
        score, terms = outcomes(self.task, block, contexts)
        return TaskOutcomes(score - self.weight * share, {**terms, "head_on": share})


@dataclass(frozen=True, slots=True, kw_only=True)
class TaskWithOthers:
    """A task and others scored from the same final states: their scores are terms with its own.

    A run with several tasks as objectives takes the other scores from there.
    """

    task: Task
    others: Mapping[str, Task]  # by the names of their terms

    @property
    def name(self) -> str:
        """The task's name."""
        return self.task.name

    @property
    def lowest(self) -> float:
        """The task's lowest score."""
        return self.task.lowest

    def evaluate(self, deployment: Deployment, context: MapContext) -> Outcome:
        """Return the task's score, and its terms with the other tasks' scores."""
        score, terms = evaluated(self.task, deployment, context)
        scores = {name: evaluated(o, deployment, context)[0] for name, o in self.others.items()}
        return score, {**terms, **scores}

    def evaluate_block(self, block: GrowthBlock, contexts: Sequence[MapContext]) -> TaskOutcomes:
        """Return the outcome of `evaluate` for every growth of a block."""
        score, terms = outcomes(self.task, block, contexts)
        scores = {name: outcomes(o, block, contexts).score for name, o in self.others.items()}
        return TaskOutcomes(score, {**terms, **scores})


def _shares(stop: Ints, first: Ints) -> Floats:
    """Return the share of each growth's deployed branches that stopped head-on; 0 if none did.

    Parameters
    ----------
    first
        Where the branches of each growth begin, shape (j + 1,).
    """
    growth = np.repeat(np.arange(len(first) - 1), np.diff(first))
    deployed, head_on = (
        np.bincount(growth[which], minlength=len(first) - 1)
        for which in (np.not_equal(stop, Stop.NOT_DEPLOYED), np.equal(stop, Stop.HEAD_ON))
    )
    return np.asarray(head_on / np.maximum(deployed, 1))
