"""What the paper leaves open, changed one thing at a time: which of its conclusions stand."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np

from vinefab.core.units import rad
from vinefab.experiments.exchange import Exchange
from vinefab.experiments.finding import Finding, Row, interval_text, percent_text
from vinefab.experiments.lab import Lab
from vinefab.experiments.reach import REACH, reach_run, reach_test, redeployments
from vinefab.experiments.setups import (
    ENVIRONMENTS,
    NAMES,
    coverage_run,
    kept,
    scores_of,
    trained,
)
from vinefab.experiments.size import Size
from vinefab.experiments.statistics import Interval, difference, interval
from vinefab.growth.options import GrowthOptions
from vinefab.model.checked import Floats
from vinefab.optimize.bounds import BuildSettings
from vinefab.optimize.settings import PartSettings, RunSettings

SLIM = BuildSettings(trunk_width_mm=24.0, width_ratio=0.65)
"""A robot whose inflated trunk, 15 mm, has room in passages of 22 mm."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Variant:
    """One assumption, changed.

    Parameters
    ----------
    name
        What it is called.
    growth
        How robots grow.
    task
        Parameters of coverage.
    """

    name: str
    growth: GrowthOptions = field(default_factory=GrowthOptions)
    task: Mapping[str, object] = field(default_factory=dict)

    def run(self, size: Size, environment: str, number: int) -> RunSettings:
        """Return a run of half the usual length under this assumption."""
        run = coverage_run(size, environment, number)
        return replace(
            run,
            build=SLIM,
            growth=self.growth,
            task=PartSettings(name="coverage", parameters={"area": "fast", **self.task}),
            search=replace(run.search, generations=max(1, size.generations // 2)),
        )


VARIANTS = (
    Variant(name="base (head-on 1 degree, centreline, stuck children stay)"),
    Variant(
        name="head-on half-angle 5 degrees", growth=GrowthOptions(head_on_half_angle_rad=rad(5.0))
    ),
    Variant(
        name="head-on half-angle 15 degrees",
        growth=GrowthOptions(head_on_half_angle_rad=rad(15.0)),
    ),
    Variant(name="stuck children deploy", growth=GrowthOptions(children_of_stuck="deploy")),
    Variant(name="inflated body, 24 mm trunk", growth=GrowthOptions(body="inflated")),
    Variant(name="sensor discs reach through walls", task={"clip": "none"}),
)


def ablation(lab: Lab) -> Finding:
    """Train and test under every variant."""
    size = lab.size
    rows: list[Row] = []
    data: dict[str, Any] = {}
    designs = _reach_designs(lab)
    for variant in VARIANTS:
        found = Exchange.of(lab, partial(variant.run, size), size.ablation_seeds)
        results = {
            f"{NAMES[home]} designs lead in the {NAMES[home]}": found.native_claim(home).tested
            for home in ENVIRONMENTS
        }
        if not variant.task:
            results |= _reach(lab, variant, designs)
            rows += _shares(lab, variant, designs)
        rows += [
            Row(what=f"{variant.name}: {what}", ours=_words(result))
            for what, result in results.items()
        ]
        data[variant.name] = {
            "scores": {home: float(found.unseen[home, home].mean()) for home in ENVIRONMENTS},
            "differences": {what: [r.value, r.low, r.high] for what, r in results.items()},
        }
    return Finding(
        name="ablation",
        title="Which conclusions stand when open assumptions change",
        protocol=(
            "Each variant changes one assumption, in training and in testing. Specialization: "
            f"{size.ablation_seeds} seeds in each environment, half as many generations as in "
            f"'transfer', tested on {size.unseen_maps} unseen maps, areas measured fast (0.3 % "
            "off). Reachability: the kept designs of 'reach', not trained again, against "
            f"{size.headings} redeployments of a plain vine under the same variant.",
            "Every robot here is 24 mm wide at the trunk, 0.65 of that at each next level, which "
            "matters to the inflated body only.",
        ),
        rows=tuple(rows),
        remarks=(
            "Differences are those of scores or of shares of free space; 'held' means that the "
            "95 % interval over seeds and maps is above 0.",
        ),
        data=data,
    )


def _words(result: Interval) -> str:
    return f"{interval_text(result)}, {result.verdict}"


def _reach_designs(lab: Lab) -> dict[str, dict[str, Any]]:
    """Return the kept designs of `reach`, as slim as all others here."""
    size, designs = lab.size, {}
    for environment in ENVIRONMENTS:
        runs = trained(lab, [reach_run(size, environment, n) for n in range(size.seeds)])
        designs[environment] = slim(runs[kept(runs)]["design"])
    return designs


def slim(design: Mapping[str, Any]) -> dict[str, Any]:
    """Return a design with the widths of this experiment."""
    build = SLIM.build(1 + len(design["levels"]))
    widths = {"widths_mm": list(build.widths_mm), "fillet_mm": list(build.fillet_mm)}
    return {**design, **widths}


def _shares(lab: Lab, variant: Variant, designs: Mapping[str, dict[str, Any]]) -> list[Row]:
    """Return what one branched deployment reaches."""
    return [
        Row(
            what=f"{variant.name}: reached by one branched, {NAMES[environment]}",
            ours=percent_text(interval(_one(lab, variant, designs, environment))),
        )
        for environment in ENVIRONMENTS
    ]


def _one(
    lab: Lab, variant: Variant, designs: Mapping[str, dict[str, Any]], environment: str
) -> Floats:
    test = reach_test(lab.size, designs[environment], environment)
    return scores_of(lab, [replace(test, task=REACH, growth=variant.growth)])


def _reach(
    lab: Lab, variant: Variant, designs: Mapping[str, dict[str, Any]]
) -> dict[str, Interval]:
    """Return by how much one branched deployment reaches more than all of a plain vine."""
    found = {}
    for environment in ENVIRONMENTS:
        jobs = [
            replace(job, design=slim(job.design), growth=variant.growth)
            for job in redeployments(lab.size, environment)
        ]
        many = np.array([part["share"] for part in lab.do(jobs, "redeploying")])
        one = _one(lab, variant, designs, environment)
        what = f"one branched above all plain, {NAMES[environment]}"
        found[what] = difference(one, many.reshape(1, -1, 1))
    return found
