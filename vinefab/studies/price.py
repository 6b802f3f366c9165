"""What it costs to ask for a manufacturable robot."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from vinefab.core.hashing import fingerprint
from vinefab.core.validation import Floats
from vinefab.core.version import __version__
from vinefab.core.view import Picture
from vinefab.model.design import PieceSettings, Pouch
from vinefab.model.files.profile_toml import read_profile
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.pages.figure import svg_bytes
from vinefab.search.manufacturability import ManufacturabilityPenalty
from vinefab.search.settings import RunSettings, plain_settings
from vinefab.search.space import BuildSettings
from vinefab.studies.anchor_holding import ANCHORING_TASK, SPACE
from vinefab.studies.claims import PaperNumber, StudyResult, difference, interval, interval_text
from vinefab.studies.paper_charts import Bar, grouped_bars
from vinefab.studies.redeployment import REACH_TASK, reach_run
from vinefab.studies.study_jobs import JobStore, StudySize, design_from
from vinefab.studies.study_runs import (
    COVERAGE_TASK,
    NAMES,
    STUDIED_ENVIRONMENTS,
    coverage_run,
    measured_fast,
    study_scores,
    trained,
    unseen_test,
    with_evaluation,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class FullCheckJob:
    """The whole check of a design, as `vinefab check` makes it, without a map."""

    design: Mapping[str, Any]  # as `plain_design` gives it

    @property
    def key(self) -> str:
        """Fingerprint of everything that it depends on."""
        return f"check_{fingerprint(plain_settings(self), __version__)}"

    def run(self) -> dict[str, Any]:
        """Return ``passes``; what breaks the cheap rules is not checked further."""
        design, making = (
            design_from(self.design),
            ManufacturabilityPenalty(profile=read_profile(DEFAULT_RECIPE)),
        )
        return {"passes": making(design) == 0.0 and making.passes(design)}


_TASKS = {"coverage": COVERAGE_TASK, "reach": REACH_TASK, "anchoring": ANCHORING_TASK}
POUCHED = BuildSettings(pouch=Pouch(shape="rectangle", length_mm=25.0, width_mm=40.0))


_WAYS = {"free": "free", "pieces": "pieces", "fabricable": "one outline"}
"""What winners must be, as data and pages call it: nothing, or manufacturable, either in pieces or
in one flat outline."""

FREE_SEARCH, PIECES, OUTLINE = _WAYS

_MOST_PIECES = 6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ThreeWays:
    """One task in one environment, searched in three ways."""

    scores: Mapping[str, Floats]  # of the winners by way, shape (runs, maps, poses) each
    passes: Mapping[str, int]  # how many winners of a way pass the whole check


def making_run(size: StudySize, environment: str, task: str, number: int) -> RunSettings:
    """Return a run on a task that need not be made; anchors have a pouch on each leaf."""
    if task == "reach":
        return reach_run(size, environment, number)
    run = coverage_run(size, environment, number)
    if task == "coverage":
        return run
    return run.changed(
        name=f"{task}_{environment}", task=ANCHORING_TASK, space=SPACE, build=POUCHED
    )


def run_of_way(free: RunSettings, way: str) -> RunSettings:
    """Return a run that asks of its winner what a way asks."""
    if way == FREE_SEARCH:
        return free
    run = with_evaluation(free, fabricable=True)
    if way == OUTLINE:
        return run
    return run.changed(build=run.build.changed(pieces=PieceSettings(most=_MOST_PIECES)))


def price(store: JobStore) -> StudyResult:
    """Search without asking for a manufacturable robot and with it, in pieces and in one outline.

    All seed by seed.
    """
    size = store.size
    designs = size.population * size.generations
    found = {
        f"{NAMES[home]}, {task}": _three_ways(store, home, task)
        for task in _TASKS
        for home in STUDIED_ENVIRONMENTS
    }
    return StudyResult(
        name="price",
        title="The price of fabricability (beyond the paper)",
        protocol=(
            f"The same search ({designs} designs in {size.generations} generations; "
            f"{size.making_seeds} seeds, each on training maps of its own) three times: free, and "
            "with `fabricable = true` either cut in pieces that sleeves join (at most "
            f"{_MOST_PIECES}) or as one flat outline: "
            "designs that break the rules of the shipped recipe rank below all others. Three runs "
            "have the same seed, training maps and poses; seeds and maps are drawn together. "
            f"{size.unseen_maps} unseen maps, {size.poses} poses. Widths, clearances, laps and "
            "limits are the recipe's, most of them assumed.",
            "Anchors are a trunk and one fan with a rectangular pouch of 25 x 40 mm on each leaf; "
            "only pouches that are wider than the gap they end in hold.",
        ),
        rows=tuple(row for name, ways in found.items() for row in _rows(name, ways, size)),
        remarks=(
            "A flat sheet has two dimensions: trees of many branches cross themselves on it, which "
            "is the rule that free winners break nearly always. Branches on different pieces may "
            "cross; all other rules hold for pieces too.",
        ),
        pictures=(
            _picture(
                {name: ways for name, ways in found.items() if "anchoring" not in name}, "score"
            ),
            _picture(
                {name: ways for name, ways in found.items() if "anchoring" in name}, "pouches"
            ),
        ),
        data={
            name: {
                **{way: ways.scores[way].tolist() for way in _WAYS},
                "passes": dict(ways.passes),
            }
            for name, ways in found.items()
        },
    )


def _three_ways(store: JobStore, home: str, task: str) -> ThreeWays:
    size = store.size
    free = [making_run(size, home, task, number) for number in range(size.making_seeds)]
    found = trained(store, [run_of_way(run, way) for way in _WAYS for run in free])
    scores = study_scores(
        store,
        [unseen_test(size, run["design"], home, measured_fast(_TASKS[task])) for run in found],
    )
    checked = store.do([FullCheckJob(design=run["design"]) for run in found], "checking")
    passing = np.array([part["passes"] for part in checked]).reshape(len(_WAYS), -1)
    by_way = scores.reshape(len(_WAYS), -1, *scores.shape[1:])
    return ThreeWays(
        scores=dict(zip(_WAYS, by_way, strict=True)),
        passes=dict(zip(_WAYS, passing.sum(axis=1).tolist(), strict=True)),
    )


def _rows(name: str, ways: ThreeWays, size: StudySize) -> list[PaperNumber]:
    digits = 2 if "anchoring" in name else 3
    scores = ways.scores
    cost = difference(scores[FREE_SEARCH], scores[OUTLINE], same_runs=True)
    back = difference(scores[PIECES], scores[OUTLINE], same_runs=True)
    return [
        PaperNumber(
            what=f"{name}: {'; '.join(_WAYS.values())}",
            ours="; ".join(interval_text(interval(scores[way]), digits) for way in _WAYS),
        ),
        PaperNumber(
            what=f"{name}: price of one outline, paired by seed and map",
            ours=interval_text(cost, digits),
        ),
        PaperNumber(
            what=f"{name}: what pieces bring back, paired by seed and map",
            ours=interval_text(back, digits),
        ),
        PaperNumber(
            what=f"{name}: winners that pass the whole check, {'; '.join(_WAYS.values())}",
            ours="; ".join(f"{ways.passes[way]} of {size.making_seeds}" for way in _WAYS),
        ),
    ]


def _picture(found: dict[str, ThreeWays], label: str) -> Picture:
    groups = {
        name.replace(", ", ",\n"): [
            Bar(label=label, found=interval(ways.scores[way])) for way, label in _WAYS.items()
        ]
        for name, ways in found.items()
    }
    return Picture(
        image=svg_bytes(grouped_bars(groups, {}, f"{label} (simulated)")),
        caption="Winners on unseen maps (simulated), with 95 % intervals over seeds and maps. "
        f"Pieces: at most {_MOST_PIECES}.",
    )
