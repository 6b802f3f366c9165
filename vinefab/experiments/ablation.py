"""Which of the paper's conclusions stand when what it leaves open changes."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from vinefab.experiments.exchange import Exchange
from vinefab.experiments.finding import Finding, Row, interval_text, percent_text
from vinefab.experiments.lab import Lab
from vinefab.experiments.reach import reach_run, reach_test, redeployments
from vinefab.experiments.setups import ENVIRONMENTS, NAMES, kept, scores_of, trained
from vinefab.experiments.statistics import Interval, difference, interval
from vinefab.experiments.variants import REACHABILITY, SLIM, SPECIALIZATION, VARIANTS, Variant
from vinefab.model.checked import Floats
from vinefab.report.content import Picture
from vinefab.report.figure import svg_bytes
from vinefab.report.forest import forest

LEADS = {home: f"{NAMES[home]} designs lead\nin the {NAMES[home]}" for home in ENVIRONMENTS}
REACHES = {home: f"one branched above\nall plain, {NAMES[home]}" for home in ENVIRONMENTS}
CONCLUSIONS = (*LEADS.values(), *REACHES.values())


def ablation(lab: Lab) -> Finding:
    """Train and test under every variant."""
    size, designs = lab.size, _reach_designs(lab)
    ones = {
        variant.name: {home: _one(lab, variant, designs, home) for home in ENVIRONMENTS}
        for variant in VARIANTS
        if REACHABILITY in variant.asks
    }
    results: dict[str, dict[str, Interval]] = {}
    for variant in VARIANTS:
        found = _leads(lab, variant) if SPECIALIZATION in variant.asks else {}
        if variant.name in ones:
            found |= _reaches(lab, variant, ones[variant.name])
        results[variant.name] = found
    return Finding(
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
    results: Mapping[str, Mapping[str, Interval]], ones: Mapping[str, Mapping[str, Floats]]
) -> list[Row]:
    rows = []
    for name, found in results.items():
        rows += [
            Row(
                what=f"{name}: {what.replace(chr(10), ' ')}",
                ours=f"{interval_text(result)}, {result.verdict}",
            )
            for what, result in found.items()
        ]
        rows += [
            Row(
                what=f"{name}: reached by one branched, {NAMES[home]}",
                ours=percent_text(interval(share)),
            )
            for home, share in ones.get(name, {}).items()
        ]
    return rows


def _leads(lab: Lab, variant: Variant) -> dict[str, Interval]:
    """Return by how much designs lead in the environment that they were trained in."""
    size = lab.size
    found = Exchange.of(lab, partial(variant.run, size), size.ablation_seeds, variant.seen)
    return {LEADS[home]: found.native_claim(home).tested for home in ENVIRONMENTS}


def _reaches(lab: Lab, variant: Variant, ones: Mapping[str, Floats]) -> dict[str, Interval]:
    """Return by how much one branched deployment reaches more than all of a plain vine."""
    found = {}
    for home in ENVIRONMENTS:
        jobs = [
            replace(
                job,
                design=slim(job.design),
                worlds=replace(job.worlds, options=variant.options(home)),
                buffer_mm=variant.buffer_mm,
                growth=variant.growth,
            )
            for job in redeployments(lab.size, home)
        ]
        many = np.array([part["share"] for part in lab.do(jobs, "redeploying")])
        found[REACHES[home]] = difference(ones[home], many.reshape(1, -1, 1))
    return found


def _one(lab: Lab, variant: Variant, designs: Mapping[str, dict[str, Any]], home: str) -> Floats:
    """Return what one branched deployment reaches, shape (1, maps, 1)."""
    test = reach_test(lab.size, designs[home], home)
    worlds = replace(test.worlds, options=variant.options(home))
    return scores_of(
        lab, [replace(test, worlds=worlds, task=variant.reached, growth=variant.growth)]
    )


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


def _picture(results: Mapping[str, Mapping[str, Interval]]) -> Picture:
    panels = {
        what: {name: found[what] for name, found in results.items() if what in found}
        for what in CONCLUSIONS
    }
    figure = forest(panels, list(results), "difference of scores or shares (simulated)")
    return Picture(
        image=svg_bytes(figure),
        caption="Four conclusions under every variant (simulated), with 95 % bootstrap intervals "
        "over seeds and maps.",
        wide=True,
    )
