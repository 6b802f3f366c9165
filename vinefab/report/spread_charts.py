"""Charts of how predictions are spread, how much pressure is needed, what changes do."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vinefab.model.checked import Floats
from vinefab.model.duel import Duel
from vinefab.model.effect import Effect
from vinefab.model.measure import Measure
from vinefab.report.charts import frame
from vinefab.report.colours import INK, LEVEL_COLOURS, SOFT
from vinefab.report.figure import blank, house_style

ENOUGH_FOR_BARS = 20
"""Fewer values are shown one by one."""

_BINS = 24


def spread_chart(measure: Measure, values: Mapping[str, Floats]) -> Figure:
    """Return the distribution of a measure over deployments, a row for each field.

    Parameters
    ----------
    measure
        What is shown.
    values
        By field; NaN where a deployment has none.
    """
    known = {name: column[np.isfinite(column)] for name, column in values.items()}
    everything = np.concatenate(list(known.values()))
    low, high = float(everything.min()), float(everything.max())
    pad = 0.04 * (high - low) or 0.04 * abs(high) or 1.0
    with house_style():
        figure, axes = blank(3.4, 0.55 + 1.25 * len(known))
        for row, (name, column) in enumerate(known.items()):
            _draw_spread(axes, row, column, (low, high))
            axes.text(0.0, row - 0.9, name, fontsize=7.5, color=SOFT, transform=_at(axes))
        axes.set_xlim(low - pad, high + pad)
        axes.set_ylim(len(known) - 0.85, -1.1)
        axes.set_yticks([])
        axes.spines["left"].set_visible(False)
        axes.set_xlabel(measure.label)
        frame(axes)
    return figure


def _at(axes: Axes):  # type: ignore[no-untyped-def]  # noqa: ANN202 - matplotlib's own type
    """Return the transform with x across the axes and y in data."""
    return axes.get_yaxis_transform()


def _draw_spread(axes: Axes, row: int, values: Floats, span: tuple[float, float]) -> None:
    colour = LEVEL_COLOURS[row % len(LEVEL_COLOURS)]
    if len(values) >= ENOUGH_FOR_BARS and span[1] > span[0]:
        counts, edges = np.histogram(values, bins=_BINS, range=span)
        heights = 0.62 * counts / counts.max()
        axes.bar(
            edges[:-1], -heights, np.diff(edges), bottom=row - 0.02, align="edge",
            color=colour, alpha=0.35, linewidth=0,
        )  # fmt: skip
    else:
        # A fixed, even jitter: dots on top of each other cannot be counted.
        offsets = -0.3 - 0.09 * ((np.arange(len(values)) % 5) - 2)
        axes.plot(values, row + offsets, "o", color=colour, alpha=0.55, markersize=4, mew=0)
    p05, p95 = np.percentile(values, [5.0, 95.0])
    axes.plot([p05, p95], [row + 0.05] * 2, color=colour, linewidth=4, solid_capstyle="butt")
    axes.plot([values.mean()] * 2, [row - 0.66, row + 0.1], color=INK, linewidth=1.6)


def effect_panels(effects: Sequence[Effect], measures: Sequence[Measure]) -> Figure:
    """Return what every change does: a column per knob, a row per measure.

    Parameters
    ----------
    effects
        In the order of their steps.
    measures
        What is shown.
    """
    knobs = list(dict.fromkeys(effect.knob for effect in effects))
    with house_style():
        figure = Figure(figsize=(6.8, 0.5 + 1.75 * len(measures)), layout="constrained")
        grid = figure.subplots(len(measures), len(knobs), sharey="row", squeeze=False)
        for row, measure in enumerate(measures):
            for column, knob in enumerate(knobs):
                _draw_effect(grid[row][column], [e for e in effects if e.knob == knob], measure)
            grid[row][0].set_ylabel(f"change of\n{measure.title}\n({measure.unit})", fontsize=8)
        for column, knob in enumerate(knobs):
            unit = next(effect.unit for effect in effects if effect.knob == knob)
            grid[-1][column].set_xlabel(f"{knob} ({unit})", fontsize=8)
    return figure


def _draw_effect(axes: Axes, effects: Sequence[Effect], measure: Measure) -> None:
    shown = [(e.step, e.changes[measure.key]) for e in effects if measure.key in e.changes]
    points = sorted([(step, c.mean, c.low, c.high) for step, c in shown] + [(0.0, 0.0, 0.0, 0.0)])
    step, mean, low, high = np.array(points).T
    axes.fill_between(step, low, high, color=LEVEL_COLOURS[2], alpha=0.22, linewidth=0)
    axes.plot(step, mean, "o-", color=LEVEL_COLOURS[0], markersize=3.5, linewidth=1.3)
    axes.axhline(0.0, color=SOFT, linewidth=0.8)
    axes.tick_params(labelsize=7.5)
    frame(axes)


def duel_chart(measure: Measure, duels: Sequence[Duel]) -> Figure:
    """Return paired differences with their intervals, a row per pair; clear ones are solid."""
    with house_style():
        figure, axes = blank(7.0, 0.8 + 0.38 * max(2, len(duels)))
        for row, duel in enumerate(duels):
            colour = LEVEL_COLOURS[0] if duel.is_clear else SOFT
            axes.plot([duel.low, duel.high], [row, row], color=colour, linewidth=2.2)
            face = colour if duel.is_clear else "white"
            axes.plot(duel.mean, row, "o", color=colour, mfc=face, markersize=7)
        axes.axvline(0.0, color=INK, linewidth=1.0)
        axes.set_yticks(range(len(duels)), [f"{duel.first} less {duel.second}" for duel in duels])
        axes.set_ylim(max(2, len(duels)) - 0.4, -0.6)
        axes.set_xlabel(f"difference in {measure.label}; {measure.better} is better")
        frame(axes)
    return figure
