"""What it costs to ask for a manufacturable robot."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from vinefab.core.hashing import fingerprint
from vinefab.core.validation import Floats
from vinefab.core.version import __version__
from vinefab.model.design import Pouch
from vinefab.model.files.profile_toml import read_profile
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.pages.figure import svg_bytes
from vinefab.pages.html import Picture
from vinefab.search.manufacturability import ManufacturabilityPenalty
from vinefab.search.settings import RunSettings, plain_settings
from vinefab.search.space import BuildSettings
from vinefab.studies.anchor_holding import ANCHORING, SPACE
from vinefab.studies.claims import PaperNumber, StudyResult, difference, interval, interval_text
from vinefab.studies.paper_charts import Bar, grouped_bars
from vinefab.studies.redeployment import REACH, reach_run
from vinefab.studies.study_jobs import JobStore, StudySize, design_from
from vinefab.studies.study_runs import (
    COVERAGE,
    ENVIRONMENTS,
    NAMES,
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


TASKS = {"coverage": COVERAGE, "reach": REACH, "anchoring": ANCHORING}
POUCHED = BuildSettings(pouch=Pouch(shape="rectangle", length_mm=25.0, width_mm=40.0))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pair:
    """One task in one environment, both ways."""

    # free, made: scores of the winners that need not and that must be made, shape (runs, maps,
    # poses)
    free: Floats
    made: Floats
    passes: tuple[int, int]  # how many winners of each pass the whole check


def making_run(size: StudySize, environment: str, task: str, number: int) -> RunSettings:
    """Return a run on a task that need not be made; anchors have a pouch on each leaf."""
    if task == "reach":
        return reach_run(size, environment, number)
    run = coverage_run(size, environment, number)
    if task == "coverage":
        return run
    return replace(run, name=f"{task}_{environment}", task=ANCHORING, space=SPACE, build=POUCHED)


def price(store: JobStore) -> StudyResult:
    """Search with and without asking for a manufacturable robot, seed by seed."""
    size = store.size
    designs = size.population * size.generations
    pairs = {
        f"{NAMES[home]}, {task}": _pair(store, home, task)
        for task in TASKS
        for home in ENVIRONMENTS
    }
    return StudyResult(
        name="price",
        title="The price of fabricability (beyond the paper)",
        protocol=(
            f"The same search ({designs} designs in {size.generations} generations; "
            f"{size.making_seeds} seeds, each on training maps of its own) with and without "
            "`fabricable = true`: with it, "
            "designs that break the rules of the shipped recipe rank below all others. A pair has "
            "the same seed, training maps and poses; seeds and maps are drawn together for both. "
            f"{size.unseen_maps} unseen maps, {size.poses} poses. Widths, clearances and limits "
            "are the recipe's, most of them assumed.",
            "Anchors are a trunk and one fan with a rectangular pouch of 25 x 40 mm on each leaf; "
            "only pouches that are wider than the gap they end in hold.",
        ),
        rows=tuple(row for name, pair in pairs.items() for row in _rows(name, pair, size)),
        remarks=(
            "A flat sheet has two dimensions: trees of many branches cross themselves on it, which "
            "is the rule that free winners break nearly always.",
        ),
        pictures=(
            _picture(
                {name: pair for name, pair in pairs.items() if "anchoring" not in name}, "score"
            ),
            _picture(
                {name: pair for name, pair in pairs.items() if "anchoring" in name}, "pouches"
            ),
        ),
        data={
            name: {
                "free": pair.free.tolist(),
                "fabricable": pair.made.tolist(),
                "passes": {"free": pair.passes[0], "fabricable": pair.passes[1]},
            }
            for name, pair in pairs.items()
        },
    )


def _pair(store: JobStore, home: str, task: str) -> Pair:
    size = store.size
    free_runs = [making_run(size, home, task, number) for number in range(size.making_seeds)]
    made_runs = [with_evaluation(run, fabricable=True) for run in free_runs]
    found = trained(store, [*free_runs, *made_runs])
    scores = study_scores(
        store, [unseen_test(size, run["design"], home, measured_fast(TASKS[task])) for run in found]
    )
    checked = store.do([FullCheckJob(design=run["design"]) for run in found], "checking")
    passing = [part["passes"] for part in checked]
    return Pair(
        free=scores[: size.making_seeds],
        made=scores[size.making_seeds :],
        passes=(sum(passing[: size.making_seeds]), sum(passing[size.making_seeds :])),
    )


def _rows(name: str, pair: Pair, size: StudySize) -> list[PaperNumber]:
    digits = 2 if "anchoring" in name else 3
    cost = difference(pair.free, pair.made, same_runs=True)
    return [
        PaperNumber(
            what=f"{name}: free; fabricable",
            ours=f"{interval_text(interval(pair.free), digits)}; "
            f"{interval_text(interval(pair.made), digits)}",
        ),
        PaperNumber(
            what=f"{name}: price, paired by seed and map",
            ours=interval_text(cost, digits),
        ),
        PaperNumber(
            what=f"{name}: winners that pass the whole check, free; fabricable",
            ours="; ".join(f"{passing} of {size.making_seeds}" for passing in pair.passes),
        ),
    ]


def _picture(pairs: dict[str, Pair], label: str) -> Picture:
    groups = {
        name.replace(", ", ",\n"): [
            Bar(label="free", found=interval(pair.free)),
            Bar(label="fabricable", found=interval(pair.made)),
        ]
        for name, pair in pairs.items()
    }
    return Picture(
        image=svg_bytes(grouped_bars(groups, {}, f"{label} (simulated)")),
        caption="Winners on unseen maps (simulated), with 95 % intervals over seeds and maps.",
        wide=True,
    )
