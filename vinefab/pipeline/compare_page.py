"""A comparison of designs as lines, JSON (``vinefab/design-comparison-1``) and a page."""

from dataclasses import asdict

from vinefab.core.errors import UnknownNameError
from vinefab.core.jsontext import json_text
from vinefab.model.duel import Duel
from vinefab.model.measure import MEASURES, Measure
from vinefab.pipeline.compare import Comparison
from vinefab.pipeline.predict import Trials
from vinefab.pipeline.report import rules_text
from vinefab.pipeline.report_json import spreads_content
from vinefab.pipeline.report_origin import Origin
from vinefab.report.comparing import duel_section, same_map_section, side_by_side_section
from vinefab.report.content import Report
from vinefab.report.page import page_html
from vinefab.report.repeating import repeat_section

SCHEMA = "vinefab/design-comparison-1"


def measure_named(key: str) -> Measure:
    """Return a measure by its key, the unit at its end left out if one likes.

    Raises
    ------
    UnknownNameError
        If there is none.
    """
    known = {measure.key: measure for measure in MEASURES}
    meant = [name for name in known if name == key or name.startswith(f"{key}_")]
    if len(meant) != 1:
        raise UnknownNameError("measure", key, known)
    return known[meant[0]]


def comparison_lines(found: Comparison, measure: Measure) -> list[str]:
    """Return a comparison as lines for the user, the main measure first.

    Parameters
    ----------
    found
        The comparison.
    measure
        The main measure.
    """
    outcomes = found.trips[0].outcomes
    lines = [
        f"{len(outcomes)} deployments of each design on {outcomes.label} (simulated)",
        *(f"  {name:<24} {measure.text(mean)}" for name, mean in found.ranked(measure)),
    ]
    others = [duel.words for duel in found.duels if duel.measure is not measure and duel.is_clear]
    return [*lines, *(duel.words for duel in found.in_measure(measure)), *others]


def comparison_text(found: Comparison, measure: Measure, origin: Origin) -> str:
    """Return a comparison as JSON.

    Parameters
    ----------
    found, measure
        The comparison and its main measure.
    origin
        How it came about.
    """
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


def comparison_page(found: Comparison, measure: Measure, trials: Trials, origin: Origin) -> str:
    """Return a comparison as a page.

    Parameters
    ----------
    found, measure
        The comparison and its main measure.
    trials
        How the designs were deployed.
    origin
        How it came about.
    """
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
                duel_section(measure, found.duels),
                side_by_side_section(found.outcomes()),
                same_map_section(world, robots, rules_text(trials.options)),
                repeat_section(origin.command, origin.inputs, origin.versions),
            ),
        )
    )


def _duel(duel: Duel) -> dict[str, object]:
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
