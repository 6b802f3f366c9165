"""The pressure window: what growth needs beside what seams stand."""

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from vinefab.model.window import Need, PressureWindow
from vinefab.report.charts import frame
from vinefab.report.colours import ALERT, INK, LEVEL_COLOURS, SOFT, level_colour
from vinefab.report.figure import blank, house_style

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
