"""Which of the paper's conclusions stand when what it leaves open changes."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from vinefab.core.units import rad
from vinefab.core.validation import Floats
from vinefab.core.view import Picture
from vinefab.growth.options import GrowthOptions
from vinefab.pages.figure import svg_bytes
from vinefab.search.settings import PartSettings, RunSettings
from vinefab.search.space import Bounds, BuildSettings, SpaceSettings
from vinefab.studies.claims import (
    ConfidenceInterval,
    PaperNumber,
    StudyResult,
    difference,
    interval_text,
    percent_text,
    share_interval,
)
from vinefab.studies.paper_charts import forest
from vinefab.studies.redeployment import BUFFER_MM, reach_designs, reach_test, redeployments
from vinefab.studies.study_jobs import PAPER_GROWTH, JobStore, StudySize
from vinefab.studies.study_runs import (
    NAMES,
    STUDIED_ENVIRONMENTS,
    Exchange,
    coverage_run,
    study_scores,
)

SLIM = BuildSettings(trunk_width_mm=24.0, width_ratio=0.65)
"""A robot whose inflated trunk, 15 mm, has room in passages of 22 mm."""

SPECIALIZATION, REACHABILITY = "specialization", "reachability"


@dataclass(frozen=True, slots=True, kw_only=True)
class AblationVariant:
    """One assumption, changed."""

    name: str  # what it is called
    asks: tuple[str, ...] = (SPECIALIZATION, REACHABILITY)  # which conclusions it may touch
    growth: GrowthOptions = PAPER_GROWTH  # how robots grow
    clip: str = "free"  # what the sensors see
    space: SpaceSettings = field(default_factory=SpaceSettings)  # the design space
    loops: float = 1.0  # share of the Cave's short cuts that are open
    buffer_mm: float = BUFFER_MM  # distance from the body that counts as reached

    def run(self, size: StudySize, environment: str, number: int) -> RunSettings:
        """Return a run of half the usual length, under this assumption."""
        run = coverage_run(size, environment, number)
        return run.changed(
            maps=run.maps.changed(options=self.options(environment)),
            space=self.space,
            build=SLIM,
            growth=self.growth,
            task=self.seen,
            search=run.search.changed(generations=max(1, size.generations // 2)),
        )

    @property
    def seen(self) -> PartSettings:
        """What counts in training, and in the tests of specialization."""
        return PartSettings(name="coverage", parameters={"area": "fast", "clip": self.clip})

    @property
    def reached(self) -> PartSettings:
        """What counts in the tests of reach."""
        return PartSettings(name="reach", parameters={"buffer_mm": self.buffer_mm})

    def options(self, environment: str) -> Mapping[str, object]:
        """Return what the maps of an environment have in common."""
        return {"loops": self.loops} if environment == "cave" else {}


BASE = AblationVariant(name="base")
VARIANTS = (
    BASE,
    AblationVariant(
        name="head-on half-angle 5 degrees",
        growth=PAPER_GROWTH.changed(head_on_half_angle_rad=rad(5.0)),
    ),
    AblationVariant(
        name="head-on half-angle 15 degrees",
        growth=PAPER_GROWTH.changed(head_on_half_angle_rad=rad(15.0)),
    ),
    AblationVariant(
        name="stuck children deploy", growth=PAPER_GROWTH.changed(children_of_stuck="deploy")
    ),
    AblationVariant(
        name="inflated body, 24 mm trunk", growth=PAPER_GROWTH.changed(body="inflated")
    ),
    AblationVariant(
        name="fan: theta to either side",
        asks=(SPECIALIZATION,),
        space=SpaceSettings(angle_deg=Bounds(low=40.0, high=320.0)),
    ),
    AblationVariant(name="sensors see through walls", asks=(SPECIALIZATION,), clip="none"),
    AblationVariant(
        name="sensors see in line of sight",
        asks=(SPECIALIZATION,),
        clip="sight",
    ),
    AblationVariant(name="Cave with 0.4 of its short cuts", loops=0.4),
    AblationVariant(name="buffer 25 mm", asks=(REACHABILITY,), buffer_mm=25.0),
    AblationVariant(name="buffer 55 mm", asks=(REACHABILITY,), buffer_mm=55.0),
)


LEADS = {home: f"{NAMES[home]} designs lead\nin the {NAMES[home]}" for home in STUDIED_ENVIRONMENTS}
REACHES = {home: f"one branched above\nall plain, {NAMES[home]}" for home in STUDIED_ENVIRONMENTS}
CONCLUSIONS = (*LEADS.values(), *REACHES.values())


def ablation(store: JobStore) -> StudyResult:
    """Train and test under every variant."""
    size, designs = store.size, {}
    for environment in STUDIED_ENVIRONMENTS:
        # The kept designs of `reach`, as slim as all others here.
        reached, best = reach_designs(store, environment)
        designs[environment] = slim(reached[best])
    ones = {
        variant.name: {home: _one(store, variant, designs, home) for home in STUDIED_ENVIRONMENTS}
        for variant in VARIANTS
        if REACHABILITY in variant.asks
    }
    results: dict[str, dict[str, ConfidenceInterval]] = {}
    for variant in VARIANTS:
        found = _leads(store, variant) if SPECIALIZATION in variant.asks else {}
        if variant.name in ones:
            found |= _reaches(store, variant, ones[variant.name])
        results[variant.name] = found
    return StudyResult(
        name="ablation",
        title="Which conclusions stand when open assumptions change",
        protocol=(
            "The base is a head-on half-angle of 1 degree, centrelines, children of a stuck branch "
            "that stay inside, a fan of theta in all, sensors that see the free space within their "
            "radius, and a buffer of 40 mm. Each variant changes one of these, in training and in "
            "testing unless it says otherwise. Specialization: "
            f"{size.ablation_seeds} seeds in each environment, half as many generations as in "
            f"'transfer', tested on {size.unseen_maps} unseen maps, areas measured fast (0.1 % "
            "off in the mean square). Reachability: the kept designs of 'reach', not trained "
            f"again, against {size.headings} redeployments of a plain vine under the same variant.",
            "'Theta to either side' reads the paper's 'starting angle of new branches' as the "
            "angle of the outermost ones, so that fans are twice as wide. Every robot here is "
            "24 mm wide at the trunk, 0.65 of that at each next level, which matters to the "
            "inflated body only.",
        ),
        rows=tuple(_rows(results, ones)),
        remarks=(
            "Differences are those of scores or of shares of free space; 'held' means that the "
            "95 % interval over seeds and maps is above 0.",
        ),
        pictures=(_picture(results),),
        data={
            name: {
                "differences": {
                    what.replace("\n", " "): [r.value, r.low, r.high] for what, r in found.items()
                },
                "one_branched": {
                    home: float(share.mean()) for home, share in ones.get(name, {}).items()
                },
            }
            for name, found in results.items()
        },
    )


def _rows(
    results: Mapping[str, Mapping[str, ConfidenceInterval]],
    ones: Mapping[str, Mapping[str, Floats]],
) -> list[PaperNumber]:
    rows = []
    for name, found in results.items():
        rows += [
            PaperNumber(
                what=f"{name}: {what.replace(chr(10), ' ')}",
                ours=f"{interval_text(result)}, {result.verdict}",
            )
            for what, result in found.items()
        ]
        rows += [
            PaperNumber(
                what=f"{name}: reached by one branched, {NAMES[home]}",
                ours=percent_text(share_interval(share)),
            )
            for home, share in ones.get(name, {}).items()
        ]
    return rows


def _leads(store: JobStore, variant: AblationVariant) -> dict[str, ConfidenceInterval]:
    """Return by how much designs lead in the environment that they were trained in."""
    size = store.size
    found = Exchange.of(store, partial(variant.run, size), size.ablation_seeds, variant.seen)
    return {LEADS[home]: found.native_claim(home).tested for home in STUDIED_ENVIRONMENTS}


def _reaches(
    store: JobStore, variant: AblationVariant, ones: Mapping[str, Floats]
) -> dict[str, ConfidenceInterval]:
    """Return by how much one branched deployment reaches more than all of a plain vine."""
    found = {}
    for home in STUDIED_ENVIRONMENTS:
        jobs = [
            replace(
                job,
                design=slim(job.design),
                worlds=job.worlds.changed(options=variant.options(home)),
                buffer_mm=variant.buffer_mm,
                growth=variant.growth,
            )
            for job in redeployments(store.size, home)
        ]
        many = np.array([part["share"] for part in store.do(jobs, "redeploying")])
        found[REACHES[home]] = difference(ones[home], many.reshape(1, -1, 1))
    return found


def _one(
    store: JobStore, variant: AblationVariant, designs: Mapping[str, dict[str, Any]], home: str
) -> Floats:
    """Return what one branched deployment reaches, shape (1, maps, 1)."""
    test = reach_test(store.size, designs[home], home)
    worlds = test.worlds.changed(options=variant.options(home))
    return study_scores(
        store, [replace(test, worlds=worlds, task=variant.reached, growth=variant.growth)]
    )


def slim(design: Mapping[str, Any]) -> dict[str, Any]:
    """Return a design with the widths of this experiment."""
    build = SLIM.build(1 + len(design["levels"]))
    widths = {"widths_mm": list(build.widths_mm), "fillet_mm": list(build.fillet_mm)}
    return {**design, **widths}


def _picture(results: Mapping[str, Mapping[str, ConfidenceInterval]]) -> Picture:
    panels = {
        what: {name: found[what] for name, found in results.items() if what in found}
        for what in CONCLUSIONS
    }
    figure = forest(panels, list(results), "difference of scores or shares (simulated)")
    return Picture(
        image=svg_bytes(figure),
        caption="Four conclusions under every variant (simulated), with 95 % intervals over seeds "
        "and maps.",
    )
