"""Charts of how predictions are spread, of heat and of the pressure window."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.figure import Figure
from matplotlib.patheffects import Normal, Stroke

from vinefab.core.validation import Floats
from vinefab.pages.charts import frame
from vinefab.pages.drawing import draw_map, draw_pose
from vinefab.pages.figure import (
    ALERT,
    INK,
    LEVEL_COLOURS,
    SOFT,
    blank,
    house_style,
    level_colour,
    plan_axes,
)
from vinefab.prediction.comparison import PairedDifference
from vinefab.prediction.heat_map import HeatMap
from vinefab.prediction.measures import Measure
from vinefab.prediction.pressure_window import Need, PressureWindow
from vinefab.prediction.sensitivity import Effect

ENOUGH_FOR_BARS = 20
"""Fewer values are shown one by one."""

_BINS = 24


def spread_chart(measure: Measure, values: Mapping[str, Floats]) -> Figure:
    """Return the distribution of a measure over deployments, a row for each field."""
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
    """Return what every change does: a column per knob, a row per measure."""
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


def paired_difference_chart(measure: Measure, duels: Sequence[PairedDifference]) -> Figure:
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


_HEAT = LinearSegmentedColormap.from_list(
    "heat", ["#fdf1dc", "#f6b65c", "#d9622b", "#8c2155", LEVEL_COLOURS[0]]
)
"""From light to dark, so that a grey print shows the same order."""


def heat_plan(heat: HeatMap) -> Figure:
    """Return a map with the share of the deployments that pass each place, and stuck tips."""
    with house_style():
        box = heat.world.bounds.bounds
        figure, axes = plan_axes(box, 7.0)
        rows, columns = heat.share.shape
        x, y = heat.low_mm
        extent = (x, x + columns * heat.cell_mm, y, y + rows * heat.cell_mm)
        shown = np.ma.masked_equal(100.0 * heat.share, 0.0)
        image = axes.imshow(
            shown, origin="lower", extent=extent, cmap=_HEAT, vmin=0.0, zorder=1.5,
            interpolation="nearest",
        )  # fmt: skip
        draw_map(axes, heat.world)
        for start in heat.world.starts:
            draw_pose(axes, start.pose, max(heat.world.size_mm))
        for number, spot in enumerate(heat.spots, start=1):
            place = (spot.x_mm, spot.y_mm)
            axes.plot(*place, "o", ms=9, mfc="none", mec=ALERT, mew=1.6, zorder=8)
            axes.annotate(
                f"{number}", place, xytext=(6, 5), textcoords="offset points", fontsize=9,
                color=ALERT, path_effects=[Stroke(linewidth=2.2, foreground="white"), Normal()],
                zorder=9,
            )  # fmt: skip
        bar = figure.colorbar(image, ax=axes, shrink=0.8, pad=0.02)
        bar.set_label("deployments whose body passes (%)")
        bar.outline.set_visible(False)
    return figure


_OPEN = "#1b7f4d"


def window_chart(window: PressureWindow) -> Figure:
    """Return what growth needs, what each width may take, and the room between the two."""
    with house_style():
        figure, axes = blank(6.4, 1.7 + 0.36 * len(window.levels))
        _draw_room(axes, window)
        names = []
        for row, need in enumerate((window.loose, window.tight)):
            _draw_need(axes, row, need)
            names.append(f"growth needs, film stored {need.storage}")
        for row, level in enumerate(window.levels, start=2):
            colour = level_colour(level.level)
            axes.barh(row, level.allowed_kpa, height=0.5, color=colour, alpha=0.5)
            axes.plot([level.burst_kpa] * 2, [row - 0.3, row + 0.3], color=colour, linewidth=2)
            names.append(f"{level.name} may take, {level.width_mm:.1f} mm")
        axes.axvline(window.working_kpa, color=INK, linewidth=1.4, linestyle="--")
        axes.set_yticks(range(len(names)), names)
        axes.set_ylim(len(names) - 0.5, -1.2)
        axes.set_xlim(0.0, 1.06 * window.highest_kpa)
        axes.annotate(
            f"working pressure {window.working_kpa:g} kPa",
            (window.working_kpa, -0.86),
            xytext=(4, 0),
            textcoords="offset points",
            fontsize=8,
            va="center",
        )
        axes.set_xlabel("pressure (kPa)")
        frame(axes)
        axes.grid(visible=False, axis="y")
    return figure


def _draw_need(axes: Axes, row: int, need: Need) -> None:
    """Draw the range of 5 to 95 % of the deployments, and the median."""
    width_kpa = need.p95_kpa - need.p05_kpa
    colour = LEVEL_COLOURS[1]
    axes.barh(row, width_kpa, left=need.p05_kpa, height=0.5, color=colour, alpha=0.45)
    for value, weight in ((need.median_kpa, 1.2), (need.p95_kpa, 2.5)):
        axes.plot([value] * 2, [row - 0.3, row + 0.3], color=colour, linewidth=weight)


def _draw_room(axes: Axes, window: PressureWindow) -> None:
    low, high = window.needed_kpa, window.allowed_kpa
    if window.is_open:
        axes.axvspan(low, high, color=_OPEN, alpha=0.16, linewidth=0)
        words, colour = f"window {low:.1f} to {high:.1f} kPa", _OPEN
    else:
        axes.axvspan(high, low, color=ALERT, alpha=0.10, linewidth=0)
        words, colour = f"no window: {low - high:.1f} kPa missing", ALERT
    axes.axvline(high, color=SOFT, linewidth=1.0)
    axes.set_title(words, fontsize=9.5, color=colour, loc="left", fontweight="bold")
