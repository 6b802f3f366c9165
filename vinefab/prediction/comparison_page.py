"""A comparison of designs as lines, JSON (``vinefab/design-comparison-1``) and a page."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict

from vinefab.core.errors import UnknownNameError
from vinefab.core.jsontext import json_text
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.map import Map
from vinefab.pages.drawing import deployment_plan
from vinefab.pages.figure import svg_bytes
from vinefab.pages.html import Picture, Report, Section, Table, page_html
from vinefab.prediction.comparison import DesignComparison, PairedDifference
from vinefab.prediction.deployments import PredictionPlan
from vinefab.prediction.measures import MEASURES, Measure, MeasureTable
from vinefab.prediction.predict import rules_text
from vinefab.prediction.prediction_json import spreads_content
from vinefab.prediction.provenance import Origin, repeat_section
from vinefab.prediction.spread_charts import paired_difference_chart, spread_chart


def side_by_side_section(outcomes: Mapping[str, MeasureTable]) -> Section:
    """Return every measure of every design, as numbers and charts."""
    shown = [m for m in MEASURES if any(found.spread(m) for found in outcomes.values())]
    rows = tuple(
        (measure.label, *(_cell(found, measure) for found in outcomes.values()))
        for measure in shown
    )
    some = next(iter(outcomes.values()))
    table = Table(
        caption=f"Means over {some.label} with 95 % bootstrap intervals over maps, "
        f"{len(some)} deployments of each design (simulated)",
        headings=("measure", *outcomes),
        rows=rows,
    )
    pictures = tuple(
        Picture(
            image=svg_bytes(
                spread_chart(m, {n: o.values[m.key] for n, o in outcomes.items() if o.spread(m)})
            ),
            caption=f"{m.title[:1].upper()}{m.title[1:]}: {m.meaning} (simulated).",
        )
        for m in shown
    )
    return Section(title="Side by side", tables=(table,), pictures=pictures)


def paired_difference_section(measure: Measure, duels: Sequence[PairedDifference]) -> Section:
    """Return every pair in every measure, the main measure drawn."""
    words = (
        "Each design met the same maps from the same poses, so that differences are paired: "
        "first less second, averaged on each map. Intervals are bootstraps over maps. The p-value "
        "is the share of the ways of flipping the signs of the maps' differences that give a mean "
        "as far from 0; with more than two designs it is adjusted for the number of pairs (Holm), "
        "within each measure. Clear means below 0.05."
    )
    rows = tuple(
        (
            duel.measure.label,
            f"{duel.first} less {duel.second}",
            "{} [{}, {}]".format(*map(duel.measure.number, (duel.mean, duel.low, duel.high))),
            f"{duel.p:.5f}",
            f"{duel.p_adjusted:.5f}",
            f"{duel.won_percent:.0f} %",
            duel.winner if duel.is_clear else "not clear",
        )
        for duel in duels
    )
    table = Table(
        caption="Paired differences (simulated)",
        headings=(
            "measure", "pair", "mean [95 % interval]", "p", "adjusted p", "first wins on", "better",
        ),
        rows=rows,
    )  # fmt: skip
    picture = Picture(
        image=svg_bytes(
            paired_difference_chart(measure, [d for d in duels if d.measure is measure])
        ),
        caption=f"Paired differences in {measure.title}, with 95 % intervals (simulated).",
        wide=True,
    )
    return Section(
        title="Paired differences", paragraphs=(words,), pictures=(picture,), tables=(table,)
    )


def same_map_section(
    world: Map, robots: Sequence[tuple[str, Design, Deployment]], words: str
) -> Section:
    """Return all designs deployed on the same map from the same pose."""
    pictures = tuple(
        Picture(
            image=svg_bytes(
                deployment_plan(
                    world, deployment, design.build.widths_mm, longest_in=4.6, whole=True
                )
            ),
            caption=f"{name} on {world.name} (simulated).",
        )
        for name, design, deployment in robots
    )
    return Section(
        title="On the same map", paragraphs=(f"Growth model: {words}.",), pictures=pictures
    )


def _cell(outcomes: MeasureTable, measure: Measure) -> str:
    spread = outcomes.spread(measure)
    if spread is None:
        return "-"
    mean, low, high = (measure.number(v) for v in (spread.mean, spread.low, spread.high))
    return f"{mean} [{low}, {high}]"


SCHEMA = "vinefab/design-comparison-1"


def measure_named(key: str) -> Measure:
    """Return a measure by its key, the unit at its end left out if one likes."""
    known = {measure.key: measure for measure in MEASURES}
    meant = [name for name in known if name == key or name.startswith(f"{key}_")]
    if len(meant) != 1:
        raise UnknownNameError("measure", key, known)
    return known[meant[0]]


def comparison_lines(found: DesignComparison, measure: Measure) -> list[str]:
    """Return a comparison as lines for the user, the main measure first."""
    outcomes = found.trips[0].outcomes
    lines = [
        f"{len(outcomes)} deployments of each design on {outcomes.label} (simulated)",
        *(f"  {name:<24} {measure.text(mean)}" for name, mean in found.ranked(measure)),
    ]
    others = [duel.words for duel in found.duels if duel.measure is not measure and duel.is_clear]
    return [*lines, *(duel.words for duel in found.in_measure(measure)), *others]


def comparison_text(found: DesignComparison, measure: Measure, origin: Origin) -> str:
    """Return a comparison as JSON."""
    outcomes = found.outcomes()
    some = found.trips[0].outcomes
    return json_text(
        SCHEMA,
        {
            "standing": "simulated",
            "measure": measure.key,
            "label": some.label,
            "maps": some.map_count,
            "deployments": len(some),
            "designs": {name: spreads_content(found) for name, found in outcomes.items()},
            "duels": [_duel(duel) for duel in found.duels],
            "reproduce": asdict(origin),
        },
    )


def comparison_page(
    found: DesignComparison, measure: Measure, trials: PredictionPlan, origin: Origin
) -> str:
    """Return a comparison as a page."""
    index = found.usual(measure)
    robots = [
        (name, design, trip.deployments[index])
        for name, design, trip in zip(found.names, found.designs, found.trips, strict=True)
    ]
    world = found.trips[0].site(index).world
    ranked = found.ranked(measure)
    duels = [d for d in found.in_measure(measure) if ranked[0][0] in (d.first, d.second)]
    clear = all(duel.is_clear for duel in duels)
    best = f"{ranked[0][0]} has the best mean {measure.title}, {measure.text(ranked[0][1])}"
    rest = "clearly ahead of every other" if clear else "not clearly ahead of every other"
    return page_html(
        Report(
            title=f"Comparison of {', '.join(found.names)}",
            verdict=f"{best}, {rest} (simulated).",
            tone="good" if clear else "caution",
            facts=tuple(
                (name, f"{design.branch_count} branches on {design.depth} levels")
                for name, design, _ in robots
            ),
            sections=(
                paired_difference_section(measure, found.duels),
                side_by_side_section(found.outcomes()),
                same_map_section(world, robots, rules_text(trials.options)),
                repeat_section(origin.command, origin.inputs, origin.versions),
            ),
        )
    )


def _duel(duel: PairedDifference) -> dict[str, object]:
    numbers = {"mean": duel.mean, "low": duel.low, "high": duel.high}
    return {
        "measure": duel.measure.key,
        "first": duel.first,
        "second": duel.second,
        **{name: duel.measure.rounded(value) for name, value in numbers.items()},
        "p": round(duel.p, 5),
        "p_adjusted": round(duel.p_adjusted, 5),
        "first_wins_percent": round(duel.won_percent),
        "pairs": duel.pairs,
        "better": duel.winner if duel.is_clear else None,
    }
