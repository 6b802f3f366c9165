"""Sections on deployments: how measures are spread, some of them drawn, how branches ended."""

from collections import Counter
from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vinefab.core.plain_text import counted
from vinefab.core.units import deg
from vinefab.core.validation import Floats
from vinefab.growth.options import GrowthOptions, growth_text
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Design
from vinefab.model.map import Map
from vinefab.pages.charts import frame
from vinefab.pages.colours import INK, LEVEL_COLOURS, SOFT
from vinefab.pages.drawing import BODY_IS_LINE, deployment_plan
from vinefab.pages.figure import blank, house_style, png_bytes, svg_bytes
from vinefab.pages.html import Picture, Section, Table
from vinefab.prediction.measures import MEASURES, STUCK_STOPS, Measure, MeasureTable, Spread

ENOUGH_FOR_BARS = 20
"""Fewer values are shown one by one."""

_BINS = 24


def spread_chart(measure: Measure, values: Mapping[str, Floats]) -> Figure:
    """Return the distribution of a measure over deployments, a row for each family."""
    known = {name: column[np.isfinite(column)] for name, column in values.items()}
    everything = np.concatenate(list(known.values()))
    low, high = float(everything.min()), float(everything.max())
    pad = 0.04 * (high - low) or 0.04 * abs(high) or 1.0
    with house_style():
        figure, axes = blank(3.4, 0.6 + 1.3 * len(known))
        ticks: dict[float, str] = {}
        for row, (name, column) in enumerate(known.items()):
            base = row * _PITCH
            most = _draw_spread(axes, base, column, (low, high), _colour(row))
            axes.text(0.0, base - 0.8, name, fontsize=7.5, color=SOFT, transform=_at(axes))
            ticks |= {base: "0", base - _TALLEST: str(most)} if most else {}
        axes.set_xlim(low - pad, high + pad)
        axes.set_ylim((len(known) - 1) * _PITCH + 0.2, -1.0)
        axes.set_yticks(list(ticks), ticks.values(), fontsize=6.5)
        axes.spines["left"].set_visible(False)
        axes.set_xlabel(measure.label)
        if ticks:
            axes.set_ylabel("deployments", fontsize=7.0, color=SOFT)
        frame(axes)
        axes.grid(visible=False, axis="y")
    return figure


_PITCH, _TALLEST = 1.3, 0.62
"""From row to row, and the tallest bar of a row: what is left holds its name."""


def _colour(row: int) -> str:
    return LEVEL_COLOURS[row % len(LEVEL_COLOURS)]


def _at(axes: Axes):  # type: ignore[no-untyped-def]  # noqa: ANN202 - matplotlib's own type
    """Return the transform with x across the axes and y in data."""
    return axes.get_yaxis_transform()


def _draw_spread(
    axes: Axes, base: float, values: Floats, span: tuple[float, float], colour: str
) -> int:
    """Draw values above a line; return how many the tallest bar has, 0 where each is a dot."""
    most = 0
    if len(values) >= ENOUGH_FOR_BARS and span[1] > span[0]:
        counts, edges = np.histogram(values, bins=_BINS, range=span)
        most = int(counts.max())
        heights = _TALLEST * counts / most
        axes.bar(
            edges[:-1], -heights, np.diff(edges), bottom=base, align="edge",
            color=colour, alpha=0.35, linewidth=0,
        )  # fmt: skip
    else:
        # A fixed, even jitter: dots on top of each other cannot be counted.
        offsets = -0.3 - 0.09 * ((np.arange(len(values)) % 5) - 2)
        axes.plot(values, base + offsets, "o", color=colour, alpha=0.55, markersize=4, mew=0)
    p05, p95 = np.percentile(values, [5.0, 95.0])
    axes.plot([p05, p95], [base + 0.08] * 2, color=colour, linewidth=4, solid_capstyle="butt")
    axes.plot([values.mean()] * 2, [base - 0.66, base + 0.13], color=INK, linewidth=1.6)
    return most


TOO_FINE = 400
"""Robots of more branches are drawn as pixels: as lines they would take megabytes."""

_NUMBER_HEADINGS = (
    "mean [95 % interval]", "deviation", "5 %", "median", "95 %", "least", "greatest",
)  # fmt: skip


def spread_section(families: Sequence[MeasureTable]) -> Section:
    """Return how every measure is spread over deployments, as charts and numbers."""
    shown = [measure for measure in MEASURES if any(f.spread(measure) for f in families)]
    pictures = tuple(
        Picture(
            image=svg_bytes(
                spread_chart(m, {f.label: f.values[m.key] for f in families if f.spread(m)})
            ),
            caption=f"{_capital(m.title)}: {m.meaning} (simulated).",
        )
        for m in shown
    )
    tables = [_spread_table(outcomes, shown) for outcomes in families]
    words = (
        "Line: mean. Bar below: from the 5th to the 95th percentile of the deployments. A mean's "
        "95 % interval is a bootstrap over maps, because deployments on one map are alike (over "
        "poses where there is one map); the table has it. With fewer than ten maps it is too "
        "narrow."
    )
    counts = "; ".join(
        f"{outcomes.label}: {counted(len(outcomes), 'deployment')}" for outcomes in families
    )
    return Section(
        title="Predictions",
        paragraphs=(f"{_capital(counts)} (simulated). {words}",),
        pictures=pictures,
        tables=(*tables, *(_every_deployment(outcomes, shown) for outcomes in families)),
    )


def deployment_picture(
    design: Design, world: Map, deployment: Deployment, options: GrowthOptions
) -> bytes:
    """Return a deployment on its map, as pixels where lines would take megabytes."""
    widths_mm = options.drawn_widths_mm(design.build.widths_mm)
    figure = deployment_plan(world, deployment, widths_mm, longest_in=4.6)
    return png_bytes(figure, dpi=130) if design.branch_count > TOO_FINE else svg_bytes(figure)


def deployment_section(
    design: Design,
    deployed: Sequence[tuple[str, Map, Deployment]],
    ended: Sequence[tuple[str, Sequence[Deployment]]],
    options: GrowthOptions,
) -> Section:
    """Return pictures of deployments, and how all branches ended."""
    widths_mm = options.drawn_widths_mm(design.build.widths_mm)
    drawn = "Bodies are drawn as wide as they inflate." if any(widths_mm) else f"{BODY_IS_LINE}."
    pictures = [
        Picture(
            image=deployment_picture(design, world, deployment, options),
            caption=f"{words} (simulated).",
        )
        for words, world, deployment in deployed
    ]
    return Section(
        title="Deployments",
        paragraphs=(
            f"Growth model: {growth_text(options, [design])}. Planar and supported; branches do "
            f"not push on each other. {drawn}",
        ),
        pictures=tuple(pictures),
        tables=tuple(stop_table(label, deployments) for label, deployments in ended),
    )


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _spread_table(outcomes: MeasureTable, measures: Sequence[Measure]) -> Table:
    rows = []
    for measure in measures:
        spread = outcomes.spread(measure)
        if spread is not None:
            numbers = [measure.number(getattr(spread, name)) for name in Spread.NUMBERS[3:]]
            mean = measure.interval(spread.mean, spread.low, spread.high)
            rows.append((measure.label, mean, *numbers, str(spread.count)))
    return Table(
        caption=f"{_capital(outcomes.label)} (simulated)",
        headings=("measure", *_NUMBER_HEADINGS, "count"),
        rows=tuple(rows),
    )


def _every_deployment(outcomes: MeasureTable, measures: Sequence[Measure]) -> Table:
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


def stop_table(label: str, deployments: Sequence[Deployment]) -> Table:
    """Return how the branches of some deployments ended, a row for each level."""
    levels: dict[int, Counter[int]] = {}
    shares: dict[int, list[float]] = {}
    for deployment in deployments:
        tree = deployment.tree
        part = 100.0 * deployment.grown_mm / tree.length_mm
        for level, stop, grown in zip(
            tree.level.tolist(), deployment.stop.tolist(), part.tolist(), strict=True
        ):
            levels.setdefault(level, Counter())[stop] += 1
            if stop in STUCK_STOPS:
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
        caption=f"{_capital(label)}: how {counted(total, 'branch')} of "
        f"{counted(len(deployments), 'deployment')} ended "
        "(simulated)",
        headings=(
            "level", "grown in full", "head-on", "in a corner", "never emerged",
            "out of pressure", "grown when stuck (median)",
        ),
        rows=rows,
    )  # fmt: skip
