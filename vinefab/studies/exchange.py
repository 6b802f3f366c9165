"""Designs of both environments, each tested in both."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from vinefab.core.validation import Floats
from vinefab.search.settings import PartSettings, RunSettings
from vinefab.studies.claims import Claim
from vinefab.studies.intervals import difference
from vinefab.studies.study_jobs import JobStore, Testing
from vinefab.studies.study_runs import (
    ENVIRONMENTS,
    NAMES,
    kept,
    study_scores,
    trained,
    training_test,
    unseen_test,
)

MakeRun = Callable[[str, int], RunSettings]
"""The run of an environment and a number."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Exchange:
    """What became of the designs of both environments."""

    # for each environment, the designs that trained there, as plain values
    designs: Mapping[str, list[dict[str, Any]]]
    best: Mapping[str, int]  # for each environment, which of them is kept
    # scores on fresh poses on the training maps, each of shape (runs, maps, poses)
    training: Mapping[str, Floats]
    # scores by where a design trained and where it was tested, likewise
    unseen: Mapping[tuple[str, str], Floats]

    @classmethod
    def of(
        cls, lab: JobStore, make_run: MakeRun, count: int, task: PartSettings | None = None
    ) -> "Exchange":
        """Train designs and test them, as their runs grow robots and score them."""
        runs = {home: [make_run(home, number) for number in range(count)] for home in ENVIRONMENTS}
        found = trained(lab, [run for home in ENVIRONMENTS for run in runs[home]])
        groups = {
            home: found[place * count : (place + 1) * count]
            for place, home in enumerate(ENVIRONMENTS)
        }
        designs = {home: [run["design"] for run in group] for home, group in groups.items()}
        training, unseen = {}, {}
        for home in ENVIRONMENTS:
            size = lab.size
            tests = [training_test(size, design, home) for design in designs[home]]
            training[home] = study_scores(lab, _as_run(tests, runs[home][0], task))
            for place in ENVIRONMENTS:
                tests = [unseen_test(size, design, place) for design in designs[home]]
                unseen[home, place] = study_scores(lab, _as_run(tests, runs[place][0], task))
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
