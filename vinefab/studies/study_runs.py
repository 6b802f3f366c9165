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
    DEFAULT_GROWTH,
    FIRST_UNSEEN,
    JobStore,
    StudySize,
    Testing,
    Training,
)

ENVIRONMENTS = ("grid", "cave")

NAMES = {"grid": "Grid", "cave": "Cave"}

STUDY_MAP_OPTIONS: Mapping[str, Mapping[str, object]] = {"grid": {}, "cave": {"loops": 1.0}}
"""What the maps of an environment have in common, where it is not the generator's default: the
paper's Cave is "a series of interconnected closed pathways" (DECISIONS.md says how it was set)."""

FIRST_TRAINING = 1

COVERAGE = PartSettings(name="coverage")

SWARM = PartSettings(name="particleswarm")
"""The paper's optimizer."""


def maps_of(environment: str, first: int, count: int) -> MapSettings:
    """Return maps of an environment from the seed of the first."""
    return MapSettings(
        environment=environment, count=count, seed=first, options=STUDY_MAP_OPTIONS[environment]
    )


def coverage_run(size: StudySize, environment: str, number: int) -> RunSettings:
    """Return the run that most experiments start from: coverage, all of Table 1, no making."""
    return RunSettings(
        name=f"coverage_{environment}",
        maps=maps_of(environment, FIRST_TRAINING, size.training_maps),
        task=COVERAGE,
        growth=DEFAULT_GROWTH,
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
    return replace(run, evaluation=replace(run.evaluation, **changes))


def trained(store: JobStore, runs: list[RunSettings]) -> list[dict[str, Any]]:
    """Return what each run found."""
    return store.train([Training(settings=run) for run in runs])


def unseen_test(
    size: StudySize,
    design: Mapping[str, Any],
    environment: str,
    task: PartSettings = COVERAGE,
    growth: GrowthOptions | None = None,
) -> Testing:
    """Return the test of a design on unseen maps of an environment."""
    return Testing(
        design=design,
        worlds=maps_of(environment, FIRST_UNSEEN, size.unseen_maps),
        poses=size.poses,
        task=task,
        growth=growth or DEFAULT_GROWTH,
    )


def training_test(size: StudySize, design: Mapping[str, Any], environment: str) -> Testing:
    """Return the test of a design on its training maps, from fresh poses."""
    test = unseen_test(size, design, environment)
    return replace(test, worlds=maps_of(environment, FIRST_TRAINING, size.training_maps))


def study_scores(store: JobStore, tests: list[Testing]) -> Floats:
    """Return the scores of several tests, shape (tests, maps, poses)."""
    return np.stack(store.test(tests))


def kept(found: list[dict[str, Any]]) -> int:
    """Return which run's design is kept: the best by its score in training."""
    return int(np.argmax([run["fitness"] for run in found]))


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
        group = found[place * each : (place + 1) * each]
        tests = [unseen_test(store.size, run["design"], "grid") for run in group]
        scores[name] = study_scores(store, tests)
        best[name] = scores[name][kept(group)][None]
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
        cls, store: JobStore, make_run: MakeRun, count: int, task: PartSettings | None = None
    ) -> "Exchange":
        """Train designs and test them, as their runs grow robots and score them."""
        runs = {home: [make_run(home, number) for number in range(count)] for home in ENVIRONMENTS}
        found = trained(store, [run for home in ENVIRONMENTS for run in runs[home]])
        groups = {
            home: found[place * count : (place + 1) * count]
            for place, home in enumerate(ENVIRONMENTS)
        }
        designs = {home: [run["design"] for run in group] for home, group in groups.items()}
        training, unseen = {}, {}
        for home in ENVIRONMENTS:
            size = store.size
            tests = [training_test(size, design, home) for design in designs[home]]
            training[home] = study_scores(store, _as_run(tests, runs[home][0], task))
            for place in ENVIRONMENTS:
                tests = [unseen_test(size, design, place) for design in designs[home]]
                unseen[home, place] = study_scores(store, _as_run(tests, runs[place][0], task))
        return cls(
            designs=designs,
            best={home: kept(group) for home, group in groups.items()},
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
        other = ENVIRONMENTS[1 - ENVIRONMENTS.index(place)]
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
            worlds=replace(test.worlds, options=run.maps.options),
            task=task or run.task,
            growth=run.growth,
        )
        for test in tests
    ]
