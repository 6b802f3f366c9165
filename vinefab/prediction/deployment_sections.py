"""Sections on deployments: how measures are spread, some of them drawn, how branches ended."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from vinefab.core.plain_text import counted
from vinefab.core.units import deg
from vinefab.core.validation import Floats
from vinefab.core.view import Data, Number, Picture, Rows, Section, document
from vinefab.growth.options import GrowthOptions, growth_text
from vinefab.model.deployment import STUCK_STOPS, Deployment, Stop
from vinefab.model.design import Design
from vinefab.model.map import Map
from vinefab.model.target import TargetsResult
from vinefab.pages.map_view import STOP_WORDS
from vinefab.pages.page_files import page_svg
from vinefab.pages.panel import COLUMN_PT
from vinefab.pages.plan import BODY_IS_LINE, deployment_plan, page_bytes
from vinefab.prediction.measures import (
    MEASURES,
    Measure,
    MeasureTable,
    spreads_content,
)
from vinefab.prediction.pictures import spread_chart

TOO_FINE = 400
"""Robots of more branches are drawn as pixels: as lines they would take megabytes."""

_NUMBER_HEADINGS = (
    "mean [95 % interval]", "deviation", "5 %", "median", "95 %", "least", "greatest",
)  # fmt: skip


def spread_pictures(named: Mapping[str, MeasureTable]) -> tuple[Picture, ...]:
    """Return the distribution of every measure that any of some tables has."""

    def chart(measure: Measure, shown: Mapping[str, Floats]) -> Picture:
        return Picture(
            image=lambda: page_svg(spread_chart(measure, shown)),
            caption=f"{_capital(measure.title)}: {measure.meaning} (simulated).",
        )

    every = (
        (m, {name: found.values[m.key] for name, found in named.items() if found.spread(m)})
        for m in MEASURES
    )
    return tuple(chart(measure, shown) for measure, shown in every if shown)


def spread_blocks(families: Sequence[MeasureTable]) -> Iterator[Data | Section]:
    """Yield how every measure is spread over deployments, as charts and numbers."""
    every = [_every_deployment(outcomes) for outcomes in families]
    yield Data(
        lambda: {
            "fields": [
                {
                    "label": outcomes.label,
                    "maps": outcomes.map_count,
                    "spread": spreads_content(outcomes),
                    **document([table]),
                }
                for outcomes, table in zip(families, every, strict=True)
            ]
        }
    )
    tables = [
        Rows(
            caption=f"{_capital(outcomes.label)} (simulated)",
            headings=("measure", *_NUMBER_HEADINGS, "count"),
            rows=tuple(
                (measure.label, spread.shown(measure),
                 *(measure.of(getattr(spread, name)) for name in spread.NUMBERS[3:]), spread.count)
                for measure in MEASURES
                if (spread := outcomes.spread(measure)) is not None
            ),
        )
        for outcomes in families
    ]  # fmt: skip
    words = (
        "Line: mean. Bar below: from the 5th to the 95th percentile of the deployments. A mean's "
        "95 % interval is Student's over maps, because deployments on one map are alike (over "
        "poses where there is one map), with the degrees of freedom of scores, whose tails are "
        "long; the table has it."
    )
    counts = "; ".join(
        f"{outcomes.label}: {counted(len(outcomes), 'deployment')}" for outcomes in families
    )
    yield Section(
        title="Predictions",
        paragraphs=(f"{_capital(counts)} (simulated). {words}",),
        pictures=spread_pictures({outcomes.label: outcomes for outcomes in families}),
        tables=(*tables, *(replace(table, key="") for table in every)),
        folded=True,
    )


def _every_deployment(outcomes: MeasureTable) -> Rows:
    """Return the measures of every deployment, a row each."""
    place = partial(Number, form=".2f", decimals=2)
    # A robot that never emerged needs no pressure: there is no number then.
    return Rows(
        caption=f"Every deployment on {outcomes.label}",
        headings=("map", "x mm", "y mm", "heading deg", *(m.label for m in MEASURES)),
        rows=tuple(
            (name, place(pose.x_mm), place(pose.y_mm), place(deg(pose.heading_rad)),
             *(m.of(outcomes.values[m.key][index]) for m in MEASURES))
            for index, (name, pose) in enumerate(zip(outcomes.maps, outcomes.poses, strict=True))
        ),
        folded=True,
        key="deployments",
        keys=("map", "pose.x_mm", "pose.y_mm", "pose.heading_deg", *(m.key for m in MEASURES)),
    )  # fmt: skip


def deployment_picture(
    design: Design,
    world: Map,
    deployment: Deployment,
    options: GrowthOptions,
    *,
    whole: bool = False,
    touched: TargetsResult | None = None,
) -> bytes:
    """Return a deployment on its map, as pixels where lines would take megabytes.

    Parameters
    ----------
    whole
        Whether to show the whole map even where the robot takes a part of it. A robot that hardly
        grew is shown with the map that stopped it anyway.
    touched
        As in `deployment_plan`.
    """
    widths_mm = options.drawn_widths_mm(design.build.widths_mm)
    whole = whole or bool(deployment.grown_mm.sum() < 0.2 * deployment.tree.total_length_mm)
    plan = deployment_plan(
        world, deployment, widths_mm, longest_pt=COLUMN_PT, whole=whole, touched=touched
    )
    return page_bytes(plan, ".png" if design.branch_count > TOO_FINE else ".svg", dpi=130)


def deployment_section(
    design: Design,
    deployed: Sequence[tuple[str, Map, Deployment]],
    ended: Sequence[tuple[str, Sequence[Deployment]]],
    options: GrowthOptions,
) -> Section:
    """Return pictures of deployments, and how all branches ended."""
    widths_mm = options.drawn_widths_mm(design.build.widths_mm)
    drawn = "Bodies are drawn as wide as they inflate." if any(widths_mm) else f"{BODY_IS_LINE}."
    return Section(
        title="Deployments",
        paragraphs=(
            f"Growth model: {growth_text(options, [design])}. Planar and supported; branches do "
            f"not push on each other. {drawn}",
        ),
        pictures=tuple(
            Picture(
                image=partial(deployment_picture, design, world, deployment, options),
                caption=f"{words} (simulated).",
            )
            for words, world, deployment in deployed
        ),
        tables=tuple(stop_table(label, deployments) for label, deployments in ended),
        folded=True,
    )


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def stop_table(label: str, deployments: Sequence[Deployment]) -> Rows:
    """Return how the branches of some deployments ended, a row for each level."""
    found = [(one.tree.level, one.stop, one.grown_mm / one.tree.length_mm) for one in deployments]
    levels, stops, shares = (np.concatenate(column) for column in zip(*found, strict=True))
    # Stops that only some rules of growth have are shown where they occur.
    met = [stop for stop in Stop if stop <= Stop.PRESSURE or (stops == stop).any()]
    rows = list[tuple[str, ...]]()
    for level in range(1, int(levels.max()) + 1):
        ended, grown = stops[levels == level], shares[levels == level]
        stuck = grown[np.isin(ended, STUCK_STOPS)]
        rows.append(
            (
                str(level),
                *(f"{100 * np.mean(ended == stop):.1f} %" for stop in met),
                f"{100 * np.median(stuck):.0f} %" if len(stuck) else "-",
            )
        )
    return Rows(
        caption=f"{_capital(label)}: how {counted(len(stops), 'branch')} of "
        f"{counted(len(deployments), 'deployment')} ended "
        "(simulated)",
        headings=("level", *(STOP_WORDS[stop] for stop in met), "grown when stuck (median)"),
        rows=tuple(rows),
    )
