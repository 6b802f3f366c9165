"""The search itself: generation after generation, then the final."""

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats
from vinefab.model.design import MOST_BRANCHES
from vinefab.model.map import Map
from vinefab.search.costs import check_objectives, costs_of
from vinefab.search.evaluator import FINAL, Evaluator, Penalty
from vinefab.search.finalists import choose_finalists, reevaluated
from vinefab.search.optimizers.nsga2 import FrontFinder
from vinefab.search.optimizers.optimizer import Optimizer
from vinefab.search.optimizers.shipped_optimizers import make_optimizer_config
from vinefab.search.parallel.evaluators import Begin, PointEvaluator, ThreadEvaluator
from vinefab.search.record.identity import RunIdentity
from vinefab.search.record.record_reading import damage_errors
from vinefab.search.record.recorder import Recorder
from vinefab.search.record.result import Finalist, Generation, Progress, RunResult, with_origin
from vinefab.search.record.store import RunStore
from vinefab.search.record.timing import Ledger
from vinefab.search.settings import RunSettings, SearchSettings
from vinefab.tasks.evaluate import Poses

AHEAD = 8
"""Generations whose poses are drawn in one go: that takes half of the time of one at a time."""


class Schedule:
    """Poses drawn some generations ahead, with the places on the maps that belong to them."""

    def __init__(self, trial: Evaluator, seed: int) -> None:
        self._trial, self._seed = trial, seed
        self._drawn: dict[int, Poses] = {}

    def poses(self, generation: int) -> Poses:
        """Return what all points of a generation meet."""
        draw = generation if self._trial.evaluation.redraw else 0
        if draw not in self._drawn:
            count = AHEAD if self._trial.evaluation.redraw else 1
            drawn = {draw: self._trial.training_poses(self._seed, draw)}
            # What is wrong with poses further ahead is nobody's matter if the run ends before.
            with suppress(BadInputError):
                for number in range(draw + 1, draw + count):
                    drawn[number] = self._trial.training_poses(self._seed, number)
            self._drawn = drawn
            self._trial.make_ready(drawn.values())
        return self._drawn[draw]


def optimize(
    settings: RunSettings,
    maps: Sequence[Map],
    *,
    penalty: Penalty | None = None,
    store: RunStore | None = None,
    progress: Callable[[Progress], None] | None = None,
    workers: int | PointEvaluator = 1,
) -> RunResult:
    """Search for the best design.

    Parameters
    ----------
    penalty
        How far a design is from one that can be made; needed when the settings ask for designs
        that can be made, not used otherwise. When it is an `Inspector` too, only designs that pass
        its inspection can win, as long as there is one.
    """
    search = Search.of(settings, maps, penalty)
    return search.run(store=store, progress=progress, workers=workers)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Search:
    """A run that is ready to go: all that it was given has been found usable."""

    # settings, maps: the run
    settings: RunSettings
    maps: tuple[Map, ...]
    trial: Evaluator  # what a point is worth
    optimizer: Optimizer  # before its first generation

    @classmethod
    def of(cls, settings: RunSettings, maps: Sequence[Map], penalty: Penalty | None) -> "Search":
        """Return the search of a run, before anything is evaluated or written."""
        trial = Evaluator.of(settings, maps, penalty)
        recipe = make_optimizer_config(settings.optimizer.name, settings.optimizer.parameters)
        seed, population = settings.search.seed, settings.search.population
        optimizer = recipe.start(trial.space.axes, population, seed)
        check_objectives(settings.objectives, settings.task.name, settings.optimizer.name)
        if settings.objectives and isinstance(optimizer, FrontFinder):
            optimizer.weigh(lambda x: costs_of(x, trial.space, settings.costs), trial.lowest)
        search = cls(settings=settings, maps=tuple(maps), trial=trial, optimizer=optimizer)
        poses = trial.training_poses(seed, 0)
        trial.launches(poses)
        _check_room(trial, poses)
        return search

    def run(
        self,
        *,
        store: RunStore | None = None,
        progress: Callable[[Progress], None] | None = None,
        workers: int | PointEvaluator = 1,
    ) -> RunResult:
        """Search; see `optimize`.

        A generation is recorded while the next one is evaluated, so that nobody waits for it.
        """
        settings, history = self.settings, list[Generation]()
        if store is not None:
            history = store.generations()
            if history:
                with damage_errors(store.path):
                    self.optimizer.restore(store.optimizer_state())
        crew = ThreadEvaluator(workers) if isinstance(workers, int) else workers
        ledger = Ledger(crew.count)
        schedule = Schedule(self.trial, settings.search.seed)
        with crew.hired(self.trial, ledger) as begin:
            with Recorder(store, progress, settings.search, ledger) as diary:
                while (stopped := why_stop(history, settings.search)) is None:
                    last = self._generation(len(history), schedule, begin, diary, ledger)
                    history.append(last)
                    diary.note(history, self.optimizer.state())
            finalists, repair = self._final(history, store, begin, ledger)
        identity = store.identity if store is not None else RunIdentity.of(settings, self.maps)
        if store is not None:
            with ledger.spending("store"):
                store.finish(finalists, stopped, ledger.split(), repair)
        return RunResult(
            run_id=identity.run_id,
            best=with_origin(finalists[0], settings, identity.run_id, identity.versions),
            finalists=finalists,
            history=tuple(history),
            stopped=stopped,
            times=ledger.split(),
            asked=settings.evaluation.fabricable,
            repair=repair,
            drift=store.drift if store is not None else (),
        )

    def _generation(
        self, number: int, schedule: Schedule, begin: Begin, diary: Recorder, ledger: Ledger
    ) -> Generation:
        """Ask, evaluate and tell."""
        began = time.perf_counter()
        with ledger.spending("optimizer"):
            asked = self.optimizer.ask()
        self._check(asked)
        # Copies are kept: an optimizer may go on working in what it hands out or is given.
        x = np.array(asked, dtype=np.float64)
        with ledger.spending("evaluating"):
            finish = begin(x, schedule.poses(number))
            diary.write()
            if number + 1 < self.settings.search.generations:
                schedule.poses(number + 1)
            found = finish()
        composite = self.trial.composites(found.score)
        fitness = self.trial.fitness(composite, found.penalty)
        with ledger.spending("optimizer"):
            self.optimizer.tell(asked, fitness.copy())
        return Generation(
            number=number,
            x=x,
            fitness=fitness,
            composite=composite,
            penalty=found.penalty,
            terms={name: values.mean(axis=1) for name, values in found.terms.items()},
            seconds=time.perf_counter() - began,
        )

    def _check(self, x: Floats) -> None:
        shaped = x.ndim == 2 and len(x) > 0 and x.shape[1] == len(self.trial.space)
        if not (shaped and ((x >= 0.0) & (x <= 1.0)).all()):
            name = self.settings.optimizer.name
            wanted = "numbers from 0 to 1"
            raise BadInputError(f"optimizer {name}", "points outside the space", wanted)

    def _final(
        self,
        history: Sequence[Generation],
        store: RunStore | None,
        begin: Begin,
        ledger: Ledger,
    ) -> tuple[tuple[Finalist, ...], str]:
        """Return the finalists of the record, or judge them now; and what was repaired."""
        if store is not None and (kept := store.finalists(self.trial.space)):
            return kept, store.repair
        finalists, costs = self.settings.evaluation.finalists, self.settings.costs
        found = choose_finalists(history, self.trial, finalists, costs)
        count = self.settings.evaluation.final_poses_per_map
        poses = self.trial.poses(self.settings.search.seed, FINAL, 0, count)
        with ledger.spending("evaluating"):
            return reevaluated(found.points, begin, poses, self.trial), found.repair


def _check_room(trial: Evaluator, poses: Poses) -> None:
    """Complain of designs that are too large, or trunks too wide, whatever a search would do."""
    space = trial.space
    least = int(space.fleet(np.zeros((1, len(space)))).sizes[0])
    if least > MOST_BRANCHES:
        allowed = f"designs with at most {MOST_BRANCHES} branches; the smallest has more"
        raise BadInputError("space", "too many levels or branches", allowed)
    radius_mm = trial.radii_mm[0]
    rooms = [
        site.terrain.have_room(site.terrain.starts_mm(places), radius_mm).any()
        for site, places in zip(trial.sites, poses, strict=True)
        if places
    ]
    if radius_mm > 0.0 and not any(rooms):
        allowed = f"a trunk with room at a start of the maps: inflated it is {2 * radius_mm:.0f} mm"
        raise BadInputError("build.trunk_width_mm", space.build.trunk_width_mm, allowed)


def why_stop(history: Sequence[Generation], search: SearchSettings) -> str | None:
    """Return why a run with such a history is over, or None when it is not."""
    if len(history) >= search.generations:
        return "generations"
    if search.evaluations and sum(len(g.fitness) for g in history) >= search.evaluations:
        return "evaluations"
    if search.stall_generations and len(history) > search.stall_generations:
        best = [generation.best for generation in history]
        before = max(best[: -search.stall_generations])
        if max(best[-search.stall_generations :]) <= before + search.stall_tolerance * abs(before):
            return "stall"
    if search.wall_time_s and sum(g.seconds for g in history) >= search.wall_time_s:
        return "wall_time"
    return None
