"""The search itself: generation after generation, then the final."""

import time
from collections.abc import Callable, Sequence

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.model.checked import Floats
from vinefab.model.map import Map
from vinefab.optimize.finalists import finalist_points, judged
from vinefab.optimize.history import Generation, Progress
from vinefab.optimize.identity import RunIdentity
from vinefab.optimize.optimizer import Optimizer
from vinefab.optimize.registry import make_recipe
from vinefab.optimize.result import Finalist, RunResult, with_origin
from vinefab.optimize.settings import RunSettings, SearchSettings
from vinefab.optimize.store import RunStore
from vinefab.optimize.trial import FINAL, TRAINING, Candidate, Penalty, Trial
from vinefab.optimize.workers import Evaluate, working


def optimize(
    settings: RunSettings,
    maps: Sequence[Map],
    *,
    penalty: Penalty | None = None,
    store: RunStore | None = None,
    progress: Callable[[Progress], None] | None = None,
    workers: int = 1,
) -> RunResult:
    """Search for the best design.

    Parameters
    ----------
    settings
        What to search, how, and for how long.
    maps
        The maps to train on.
    penalty
        How far a design is from one that can be made; needed when the settings ask for designs
        that can be made, not used otherwise. When it is an `Inspector` too, only designs that pass
        its inspection can win, as long as there is one.
    store
        The record of the run; what it holds already is not done again.
    progress
        Called after every generation.
    workers
        Threads; no result depends on their number.

    Raises
    ------
    BadInputError
        If the settings cannot be used, no point is a design, or the optimizer proposes points
        outside the space.
    CannotWriteError
        If the record cannot be written; what it held is kept.
    """
    trial = Trial.of(settings, maps, penalty)
    optimizer = _started(settings, trial)
    history: list[Generation] = []
    if store is not None:
        history = store.generations()
        if history:
            optimizer.restore(store.optimizer_state())
    with working(trial, workers) as evaluate:
        while (stopped := why_stop(history, settings.search)) is None:
            generation = _generation(settings, trial, optimizer, evaluate, len(history))
            history.append(generation)
            if store is not None:
                store.add(generation, optimizer.state())
            if progress is not None:
                progress(_progress(history, settings.search))
        finalists = _final(settings, trial, evaluate, history, store)
    identity = store.identity if store is not None else RunIdentity.of(settings, maps)
    if store is not None:
        store.finish(finalists, stopped)
    return RunResult(
        run_id=identity.run_id,
        best=with_origin(finalists[0], settings, identity.run_id, identity.versions),
        finalists=finalists,
        history=tuple(history),
        stopped=stopped,
    )


def why_stop(history: Sequence[Generation], search: SearchSettings) -> str | None:
    """Return why a run with such a history is over, or None when it is not."""
    if len(history) >= search.generations:
        return "generations"
    if search.evaluations and sum(len(g.fitness) for g in history) >= search.evaluations:
        return "evaluations"
    if search.stall_generations and len(history) > search.stall_generations:
        best = [float(generation.fitness.max()) for generation in history]
        before = max(best[: -search.stall_generations])
        if max(best[-search.stall_generations :]) <= before + search.stall_tolerance * abs(before):
            return "stall"
    if search.wall_time_s and sum(g.seconds for g in history) >= search.wall_time_s:
        return "wall_time"
    return None


def _started(settings: RunSettings, trial: Trial) -> Optimizer:
    recipe = make_recipe(settings.optimizer.name, settings.optimizer.parameters)
    return recipe.start(trial.space.axes, settings.search.population, settings.search.seed)


def _generation(
    settings: RunSettings,
    trial: Trial,
    optimizer: Optimizer,
    evaluate: Evaluate,
    number: int,
) -> Generation:
    """Ask, evaluate and tell."""
    began = time.perf_counter()
    x = optimizer.ask()
    if not (x.ndim == 2 and x.shape[1] == len(trial.space) and ((x >= 0.0) & (x <= 1.0)).all()):
        name = settings.optimizer.name
        raise BadInputError(f"optimizer {name}", "points outside the space", "numbers from 0 to 1")
    draw = number if settings.evaluation.redraw else 0
    poses = trial.poses(settings.search.seed, TRAINING, draw, settings.evaluation.poses_per_map)
    candidates = evaluate(x, poses)
    fitness = np.array([candidate.fitness for candidate in candidates])
    optimizer.tell(x, fitness)
    weighed = [
        np.nan if c.score is None else c.score.composite[settings.evaluation.composite]
        for c in candidates
    ]
    return Generation(
        number=number,
        x=x,
        fitness=fitness,
        composite=np.array(weighed),
        penalty=np.array([candidate.penalty for candidate in candidates]),
        terms=_mean_terms(candidates),
        seconds=time.perf_counter() - began,
    )


def _mean_terms(candidates: Sequence[Candidate]) -> dict[str, Floats]:
    """Return each term's mean over the evaluations, per candidate; NaN without a design."""
    tables = [
        [] if candidate.score is None else [e.terms for e in candidate.score.evaluations]
        for candidate in candidates
    ]
    names = next((tuple(table[0]) for table in tables if table), ())
    return {
        name: np.array(
            [np.mean([terms[name] for terms in table]) if table else np.nan for table in tables]
        )
        for name in names
    }


def _final(
    settings: RunSettings,
    trial: Trial,
    evaluate: Evaluate,
    history: Sequence[Generation],
    store: RunStore | None,
) -> tuple[Finalist, ...]:
    """Return the finalists of the record, or judge them now."""
    if store is not None and (kept := store.finalists(trial.space)):
        return kept
    points = finalist_points(history, trial, settings.evaluation.finalists)
    count = settings.evaluation.final_poses_per_map
    return judged(points, evaluate, trial.poses(settings.search.seed, FINAL, 0, count), trial)


def _progress(history: Sequence[Generation], search: SearchSettings) -> Progress:
    last = history[-1]
    designs = last.composite[np.isfinite(last.composite)]
    elapsed_s = sum(generation.seconds for generation in history)
    return Progress(
        generation=len(history),
        generations=search.generations,
        best=max(float(generation.fitness.max()) for generation in history),
        mean=float(designs.mean()) if len(designs) else 0.0,
        spread=float(designs.std()) if len(designs) else 0.0,
        fabricable_share=last.fabricable_share,
        elapsed_s=elapsed_s,
        left_s=elapsed_s / len(history) * (search.generations - len(history)),
    )
