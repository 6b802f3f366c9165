"""Sections of a page that sets designs side by side."""

from collections.abc import Mapping, Sequence

from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.duel import Duel
from vinefab.model.map import Map
from vinefab.model.measure import MEASURES, Measure, Outcomes
from vinefab.report.content import Picture, Section, Table
from vinefab.report.figure import svg_bytes
from vinefab.report.plans import deployment_plan
from vinefab.report.spread_charts import duel_chart, spread_chart


def side_by_side_section(outcomes: Mapping[str, Outcomes]) -> Section:
    """Return every measure of every design, as numbers and charts.

    Parameters
    ----------
    outcomes
        By the designs' names.
    """
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


def duel_section(measure: Measure, duels: Sequence[Duel]) -> Section:
    """Return every pair in every measure, the main measure drawn.

    Parameters
    ----------
    measure
        The main measure.
    duels
        All of them.
    """
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
        image=svg_bytes(duel_chart(measure, [d for d in duels if d.measure is measure])),
        caption=f"Paired differences in {measure.title}, with 95 % intervals (simulated).",
        wide=True,
    )
    return Section(
        title="Paired differences", paragraphs=(words,), pictures=(picture,), tables=(table,)
    )


def same_map_section(
    world: Map, robots: Sequence[tuple[str, Design, Deployment]], words: str
) -> Section:
    """Return all designs deployed on the same map from the same pose.

    Parameters
    ----------
    world
        The map.
    robots
        Name, design and deployment of each.
    words
        The growth model's choices.
    """
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


def _cell(outcomes: Outcomes, measure: Measure) -> str:
    spread = outcomes.spread(measure)
    if spread is None:
        return "-"
    mean, low, high = (measure.number(v) for v in (spread.mean, spread.low, spread.high))
    return f"{mean} [{low}, {high}]"
