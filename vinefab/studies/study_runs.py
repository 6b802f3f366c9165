"""The runs and tests that several experiments share."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
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
from vinefab.studies.study_jobs import DEFAULT_GROWTH, FIRST_UNSEEN, JobStore, Testing, Training
from vinefab.studies.study_sizes import StudySize

ENVIRONMENTS = ("grid", "cave")
NAMES = {"grid": "Grid", "cave": "Cave"}
OPTIONS: Mapping[str, Mapping[str, object]] = {"grid": {}, "cave": {"loops": 1.0}}
"""What the maps of an environment have in common, where it is not the generator's default: the
paper's Cave is "a series of interconnected closed pathways" (DECISIONS.md says how it was set)."""

FIRST_TRAINING = 1
COVERAGE = PartSettings(name="coverage")
SWARM = PartSettings(name="particleswarm")
"""The paper's optimizer."""


def maps_of(environment: str, first: int, count: int) -> MapSettings:
    """Return maps of an environment from the seed of the first."""
    return MapSettings(
        environment=environment, count=count, seed=first, options=OPTIONS[environment]
    )


def coverage_run(size: StudySize, environment: str, number: int) -> RunSettings:
    """Return the run that most experiments start from: coverage, all of Table 1, no making."""
    return RunSettings(
        name=f"coverage_{environment}",
        maps=maps_of(environment, FIRST_TRAINING, size.training_maps),
        task=COVERAGE,
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


def trained(lab: JobStore, runs: list[RunSettings]) -> list[dict[str, Any]]:
    """Return what each run found."""
    return lab.train([Training(settings=run) for run in runs])


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


def study_scores(lab: JobStore, tests: list[Testing]) -> Floats:
    """Return the scores of several tests, shape (tests, maps, poses)."""
    return np.stack(lab.test(tests))


def kept(found: list[dict[str, Any]]) -> int:
    """Return which run's design is kept: the best by its score in training."""
    return int(np.argmax([run["fitness"] for run in found]))


def judged_claim(
    lab: JobStore, names: Sequence[str], runs: list[RunSettings]
) -> tuple[dict[str, Floats], dict[str, Floats]]:
    """Train several kinds of runs and test their designs on the Grid's unseen maps.

    Returns
    -------
    scores
        By kind, of all its designs, shape (runs, maps, poses).
    best
        Of the kept one only, shape (1, maps, poses).
    """
    found, each = trained(lab, runs), len(runs) // len(names)
    scores: dict[str, Floats] = {}
    best: dict[str, Floats] = {}
    for place, name in enumerate(names):
        group = found[place * each : (place + 1) * each]
        tests = [unseen_test(lab.size, run["design"], "grid") for run in group]
        scores[name] = study_scores(lab, tests)
        best[name] = scores[name][kept(group)][None]
    return scores, best
