"""The runs and tests that several experiments share."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from vinefab.core.validation import Floats
from vinefab.growth.options import GrowthOptions
from vinefab.search.settings import (
    EvaluationSettings,
    MapSettings,
    PartSettings,
    RunSettings,
    SearchSettings,
)
from vinefab.studies.claims import Claim, difference
from vinefab.studies.study_jobs import (
    FIRST_TEST_SEED,
    PAPER_GROWTH,
    JobStore,
    StudySize,
    Testing,
    Training,
)
from vinefab.tasks.evaluate import composites

STUDIED_ENVIRONMENTS = ("grid", "cave")

NAMES = {"grid": "Grid", "cave": "Cave"}

STUDY_MAP_OPTIONS: Mapping[str, Mapping[str, object]] = {"grid": {}, "cave": {"loops": 1.0}}
"""What the maps of an environment have in common, where it is not the generator's default: the
paper's Cave is "a series of interconnected closed pathways" (docs/studies/paper.md)."""

FIRST_TRAINING = 1

FIRST_CHOICE = 800_001
"""Seed of the first map on which the kept design of several is chosen: none trains or is tested
there."""

COVERAGE_TASK = PartSettings(name="coverage")


def measured_fast(task: PartSettings) -> PartSettings:
    """Return a task with areas measured as in a search; anchoring has none."""
    if task.name == "anchoring":
        return task
    return task.changed(parameters={**task.parameters, "area": "fast"})


FAST_COVERAGE = measured_fast(COVERAGE_TASK)
"""Coverage in tests: 0.1 % off in the mean square, and a hundred times faster than exact areas."""

SWARM = PartSettings(name="particleswarm")
"""The paper's optimizer."""


def maps_of(environment: str, first: int, count: int) -> MapSettings:
    """Return maps of an environment from the seed of the first."""
    return MapSettings(
        environment=environment, count=count, seed=first, options=STUDY_MAP_OPTIONS[environment]
    )


def coverage_run(size: StudySize, environment: str, number: int) -> RunSettings:
    """Return the run that most experiments start from: coverage, all of Table 1, no making.

    Runs of other numbers have other training maps: what is said of all of them is not of one
    choice of maps only.
    """
    return RunSettings(
        name=f"coverage_{environment}",
        maps=maps_of(environment, FIRST_TRAINING + number * size.training_maps, size.training_maps),
        task=COVERAGE_TASK,
        growth=PAPER_GROWTH,
        optimizer=SWARM,
        search=SearchSettings(
            population=size.population, generations=size.generations, seed=size.seed + number
        ),
        evaluation=EvaluationSettings(
            maps_per_generation=size.maps_at_once, final_poses_per_map=2, fabricable=False
        ),
    )


def with_evaluation(run: RunSettings, **changes: Any) -> RunSettings:  # noqa: ANN401
    """Return a run with another way of evaluating."""
    return run.changed(evaluation=run.evaluation.changed(**changes))


def trained(store: JobStore, runs: list[RunSettings]) -> list[dict[str, Any]]:
    """Return what each run found."""
    return store.train([Training(settings=run) for run in runs])


def unseen_test(
    size: StudySize,
    design: Mapping[str, Any],
    environment: str,
    task: PartSettings = FAST_COVERAGE,
    growth: GrowthOptions | None = None,
) -> Testing:
    """Return the test of a design on unseen maps of an environment."""
    return Testing(
        design=design,
        worlds=maps_of(environment, FIRST_TEST_SEED, size.unseen_maps),
        poses=size.poses,
        task=task,
        growth=growth or PAPER_GROWTH,
    )


def training_test(size: StudySize, run: RunSettings, design: Mapping[str, Any]) -> Testing:
    """Return the test of a run's design on its training maps, from fresh poses."""
    return replace(unseen_test(size, design, run.maps.environment), worlds=run.maps)


def study_scores(store: JobStore, tests: list[Testing]) -> Floats:
    """Return the scores of several tests, shape (tests, maps, poses)."""
    return np.stack(store.test(tests))


def kept(store: JobStore, runs: list[RunSettings], designs: list[dict[str, Any]]) -> int:
    """Return which run's design is kept: the best by its own weighting on maps for the choice.

    The paper takes the best in training. Here every run trains on maps of its own, and the best in
    training would be the one with the easiest maps.
    """
    size = store.size
    tests = [
        replace(
            unseen_test(size, design, run.maps.environment, measured_fast(run.task), run.growth),
            worlds=run.maps.changed(seed=FIRST_CHOICE, count=size.choice_maps),
            poses=1,
        )
        for run, design in zip(runs, designs, strict=True)
    ]
    evaluation = runs[0].evaluation
    scores = study_scores(store, tests).reshape(len(runs), -1)
    worth = composites(scores, evaluation.composite, evaluation.reference_deviation)
    return int(np.argmax(worth))


def train_and_test(
    store: JobStore, names: Sequence[str], runs: list[RunSettings]
) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """Train several kinds of runs and test their designs on the Grid's unseen maps.

    Returns
    -------
    scores
        By kind, of all its designs, shape (runs, maps, poses).
    best
        Of the kept one only, shape (1, maps, poses).
    """
    found, each = trained(store, runs), len(runs) // len(names)
    scores: dict[str, Floats] = {}
    best: dict[str, Floats] = {}
    for place, name in enumerate(names):
        some = slice(place * each, (place + 1) * each)
        designs = [run["design"] for run in found[some]]
        scores[name] = study_scores(store, [unseen_test(store.size, d, "grid") for d in designs])
        best[name] = scores[name][kept(store, runs[some], designs)][None]
    return scores, best


MakeRun = Callable[[str, int], RunSettings]
"""The run of an environment and a number."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Exchange:
    """Designs of both environments, and their scores in both."""

    # for each environment, the designs that trained there, as plain values
    designs: Mapping[str, list[dict[str, Any]]]
    best: Mapping[str, int]  # for each environment, which of them is kept
    # scores on fresh poses on the training maps, each of shape (runs, maps, poses)
    training: Mapping[str, Floats]
    # scores by where a design trained and where it was tested, likewise
    unseen: Mapping[tuple[str, str], Floats]

    @classmethod
    def of(
        cls,
        store: JobStore,
        make_run: MakeRun,
        count: int,
        task: PartSettings | None = None,
        *,
        unseen_maps: int = 0,
    ) -> "Exchange":
        """Train designs and test them, as their runs grow robots and score them.

        Parameters
        ----------
        unseen_maps
            On how many unseen maps; 0: as many as most experiments.
        """
        size = replace(store.size, unseen_maps=unseen_maps or store.size.unseen_maps)
        runs = {
            home: [make_run(home, number) for number in range(count)]
            for home in STUDIED_ENVIRONMENTS
        }
        found = trained(store, [run for home in STUDIED_ENVIRONMENTS for run in runs[home]])
        groups = {
            home: found[place * count : (place + 1) * count]
            for place, home in enumerate(STUDIED_ENVIRONMENTS)
        }
        designs = {home: [run["design"] for run in group] for home, group in groups.items()}
        training, unseen = {}, {}
        for home in STUDIED_ENVIRONMENTS:
            tests = [
                training_test(size, run, design)
                for run, design in zip(runs[home], designs[home], strict=True)
            ]
            training[home] = study_scores(store, _as_run(tests, runs[home][0], task))
            for place in STUDIED_ENVIRONMENTS:
                tests = [unseen_test(size, design, place) for design in designs[home]]
                unseen[home, place] = study_scores(store, _as_run(tests, runs[place][0], task))
        return cls(
            designs=designs,
            best={home: kept(store, runs[home], designs[home]) for home in STUDIED_ENVIRONMENTS},
            training=training,
            unseen=unseen,
        )

    def kept_design(self, home: str) -> dict[str, Any]:
        """Return the kept design of an environment."""
        return self.designs[home][self.best[home]]

    def kept_training(self, home: str) -> Floats:
        """Return the scores of a kept design on its training maps, shape (1, maps, poses)."""
        best = self.best[home]
        return self.training[home][best : best + 1]

    def kept_unseen(self, home: str, place: str) -> Floats:
        """Return the scores of a kept design on unseen maps, shape (1, maps, poses)."""
        best = self.best[home]
        return self.unseen[home, place][best : best + 1]

    def native_claim(self, place: str) -> Claim:
        """Return the claim that an environment's own designs do better there."""
        other = STUDIED_ENVIRONMENTS[1 - STUDIED_ENVIRONMENTS.index(place)]
        return Claim(
            text=f"On unseen {NAMES[place]} maps, {NAMES[place]} designs score above "
            f"{NAMES[other]} designs",
            tested=difference(self.unseen[place, place], self.unseen[other, place]),
            kept=difference(self.kept_unseen(place, place), self.kept_unseen(other, place)),
        )

    def harder_claim(self) -> Claim:
        """Return the claim that the Cave gives lower scores than the Grid."""
        return Claim(
            text="The Cave gives lower scores than the Grid, each to its own designs",
            tested=difference(
                self.unseen["grid", "grid"], self.unseen["cave", "cave"], same_maps=False
            ),
            kept=difference(
                self.kept_unseen("grid", "grid"),
                self.kept_unseen("cave", "cave"),
                same_maps=False,
            ),
        )


def _as_run(tests: list[Testing], run: RunSettings, task: PartSettings | None) -> list[Testing]:
    """Return tests on a run's kind of maps that grow robots and score them as it does."""
    return [
        replace(
            test,
            worlds=test.worlds.changed(options=run.maps.options),
            task=task or measured_fast(run.task),
            growth=run.growth,
        )
        for test in tests
    ]
