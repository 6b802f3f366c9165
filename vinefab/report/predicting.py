"""Sections on what a design is expected to do: how measures are spread, where robots end."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from vinefab.core.units import deg
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Design
from vinefab.model.heat import Heat
from vinefab.model.map import Map
from vinefab.model.measure import MEASURES, Measure, Outcomes, Spread
from vinefab.report.content import Picture, Section, Table
from vinefab.report.figure import png_bytes, svg_bytes
from vinefab.report.heat_plan import heat_plan
from vinefab.report.plans import deployment_plan
from vinefab.report.spread_charts import spread_chart

TOO_FINE = 400
"""Robots of more branches are drawn as pixels: as lines they would take megabytes."""

_NUMBER_HEADINGS = (
    "mean [95 % interval]", "deviation", "5 %", "median", "95 %", "least", "greatest",
)  # fmt: skip


def spread_section(fields: Sequence[Outcomes]) -> Section:
    """Return how every measure is spread over deployments, as charts and numbers.

    Parameters
    ----------
    fields
        Outcomes in each field.
    """
    shown = [measure for measure in MEASURES if any(f.spread(measure) for f in fields)]
    pictures = tuple(
        Picture(
            image=svg_bytes(
                spread_chart(m, {f.label: f.values[m.key] for f in fields if f.spread(m)})
            ),
            caption=f"{_capital(m.title)}: {m.meaning} (simulated).",
        )
        for m in shown
    )
    tables = [_spread_table(outcomes, shown) for outcomes in fields]
    words = (
        "Line: mean. Bar below: from the 5th to the 95th percentile of the deployments. A mean's "
        "95 % interval is a bootstrap over maps, because deployments on one map are alike (over "
        "poses where there is one map); the table has it. With fewer than ten maps it is too "
        "narrow."
    )
    counts = "; ".join(f"{outcomes.label}: {len(outcomes)} deployments" for outcomes in fields)
    return Section(
        title="Predictions",
        paragraphs=(f"{_capital(counts)} (simulated). {words}",),
        pictures=pictures,
        tables=(*tables, *(_every_deployment(outcomes, shown) for outcomes in fields)),
    )


def deployment_section(
    design: Design,
    deployed: Sequence[tuple[str, Map, Deployment]],
    ended: Sequence[tuple[str, Sequence[Deployment]]],
    rules: str,
) -> Section:
    """Return pictures of deployments, and how all branches ended.

    Parameters
    ----------
    design
        The robot.
    deployed
        What to draw, each with what it shows.
    ended
        All deployments of each field.
    rules
        The growth model's choices, in words.
    """
    fine = design.branch_count > TOO_FINE
    pictures = []
    for words, world, deployment in deployed:
        figure = deployment_plan(world, deployment, design.build.widths_mm, longest_in=4.6)
        image = png_bytes(figure, dpi=130) if fine else svg_bytes(figure)
        pictures.append(Picture(image=image, caption=f"{words} (simulated)."))
    return Section(
        title="Deployments",
        paragraphs=(
            f"Growth model: {rules}. Planar and supported; branches do not push on each other. "
            "Bodies are drawn as wide as they inflate.",
        ),
        pictures=tuple(pictures),
        tables=tuple(_stop_table(label, deployments) for label, deployments in ended),
    )


def heat_section(heat: Heat) -> Section:
    """Return where robots go on one map, and where they get stuck."""
    often, ever = heat.percent_passed(0.5), heat.percent_passed()
    words = (
        f"{heat.deployments} deployments on {heat.world.name}, poses drawn {heat.spread} (uniform; "
        f"simulated). Some body covers {ever:.1f} % of the free space; more than half of the "
        f"deployments cover {often:.1f} %. The raster's cells are {heat.cell_mm:.2f} mm."
    )
    rows = tuple(
        (str(number), f"{spot.x_mm:.1f}", f"{spot.y_mm:.1f}", f"{spot.percent:.1f}")
        for number, spot in enumerate(heat.spots, start=1)
    )
    table = Table(
        caption="Where branches stop head-on or in a corner most often (simulated)",
        headings=("place", "x mm", "y mm", "% of deployments"),
        rows=rows,
    )
    nowhere = "No branch got stuck on this map." if not rows else ""
    return Section(
        title="Where it goes and where it gets stuck",
        paragraphs=(words, nowhere) if nowhere else (words,),
        pictures=(
            Picture(
                image=svg_bytes(heat_plan(heat)),
                caption=f"{heat.world.name}: share of the deployments whose body passes each "
                "place, and rings where branches get stuck, numbered as in the table (simulated).",
                wide=True,
            ),
        ),
        tables=(table,) if rows else (),
    )


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _spread_table(outcomes: Outcomes, measures: Sequence[Measure]) -> Table:
    rows = []
    for measure in measures:
        spread = outcomes.spread(measure)
        if spread is not None:
            mean, low, high, *numbers = (
                measure.number(getattr(spread, name)) for name in Spread.NUMBERS
            )
            mean = f"{mean} [{low}, {high}]"
            rows.append((measure.label, mean, *numbers, str(spread.count)))
    return Table(
        caption=f"{_capital(outcomes.label)} (simulated)",
        headings=("measure", *_NUMBER_HEADINGS, "count"),
        rows=tuple(rows),
    )


def _every_deployment(outcomes: Outcomes, measures: Sequence[Measure]) -> Table:
    rows = tuple(
        (
            name,
            f"{pose.x_mm:.2f}",
            f"{pose.y_mm:.2f}",
            f"{deg(pose.heading_rad):.2f}",
            *(measure.number(outcomes.values[measure.key][index]) for measure in measures),
        )
        for index, (name, pose) in enumerate(zip(outcomes.maps, outcomes.poses, strict=True))
    )
    return Table(
        caption=f"Every deployment on {outcomes.label}",
        headings=("map", "x mm", "y mm", "heading deg", *(m.label for m in measures)),
        rows=rows,
        folded=True,
    )


def _stop_table(label: str, deployments: Sequence[Deployment]) -> Table:
    levels: dict[int, Counter[int]] = {}
    shares: dict[int, list[float]] = {}
    for deployment in deployments:
        tree = deployment.tree
        part = 100.0 * deployment.grown_mm / tree.length_mm
        for level, stop, grown in zip(
            tree.level.tolist(), deployment.stop.tolist(), part.tolist(), strict=True
        ):
            levels.setdefault(level, Counter())[stop] += 1
            if stop in (Stop.HEAD_ON, Stop.CORNER):
                shares.setdefault(level, []).append(grown)
    rows = tuple(
        (
            str(level),
            *(f"{100 * counts[stop] / counts.total():.1f} %" for stop in Stop),
            f"{np.median(shares[level]):.0f} %" if level in shares else "-",
        )
        for level, counts in sorted(levels.items())
    )
    total = sum(len(deployment.tree) for deployment in deployments)
    return Table(
        caption=f"{_capital(label)}: how {total} branches of {len(deployments)} deployments ended "
        "(simulated)",
        headings=(
            "level", "grown in full", "head-on", "in a corner", "never emerged",
            "grown when stuck (median)",
        ),
        rows=rows,
    )  # fmt: skip
