"""Charts in the forms of the paper's figures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike
from scipy.stats import gaussian_kde

from vinefab.report.charts import frame
from vinefab.report.colours import INK, LEVEL_COLOURS, SOFT
from vinefab.report.figure import blank, house_style


class Known(Protocol):
    """A number with an interval."""

    @property
    def value(self) -> float:
        """The number."""

    @property
    def low(self) -> float:
        """Lower end."""

    @property
    def high(self) -> float:
        """Upper end."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Bar:
    """One bar of a group.

    Parameters
    ----------
    label
        What the legend calls it; bars with the same label have the same colour.
    found
        Its height, with its interval.
    """

    label: str
    found: Known


def grouped_bars(
    groups: Mapping[str, Sequence[Bar]], lines: Mapping[str, float], label: str
) -> Figure:
    """Return bars with intervals in groups, and a dashed line across some groups.

    Parameters
    ----------
    groups
        Bars by the name of their group.
    lines
        Heights of dashed lines, by group.
    label
        What the heights are.
    """
    with house_style():
        figure, axes = blank(6.5, 3.6)
        names = list(dict.fromkeys(bar.label for bars in groups.values() for bar in bars))
        for place, (group, bars) in enumerate(groups.items()):
            width = 0.8 / len(bars)
            for rank, bar in enumerate(bars):
                x = place + (rank - (len(bars) - 1) / 2) * width
                colour = LEVEL_COLOURS[names.index(bar.label) % len(LEVEL_COLOURS)]
                known = bar.label if place == 0 else None
                axes.bar(x, bar.found.value, 0.9 * width, color=colour, alpha=0.75, label=known)
                ends = [[bar.found.value - bar.found.low], [bar.found.high - bar.found.value]]
                axes.errorbar(x, bar.found.value, yerr=np.maximum(ends, 0.0), color=INK, capsize=4)
            if group in lines:
                across = [place - 0.42, place + 0.42]
                known = "on its training maps" if place == 0 else None
                axes.plot(across, [lines[group]] * 2, "--", color=INK, label=known)
        axes.set_xticks(range(len(groups)), list(groups))
        axes.set_ylabel(label)
        axes.legend(fontsize=8, loc="upper left", bbox_to_anchor=(1.0, 1.0))
        frame(axes)
    return figure


def curves(lines: Mapping[str, ArrayLike], across: str, label: str) -> Figure:
    """Return means over runs with one standard error.

    Parameters
    ----------
    lines
        Values by name, each of shape (runs, steps).
    across, label
        What the axes are.
    """
    with house_style():
        figure, axes = blank(6.5, 3.4)
        for rank, (name, given) in enumerate(lines.items()):
            values = np.asarray(given, dtype=float)
            steps = np.arange(1, values.shape[1] + 1)
            middle = values.mean(axis=0)
            error = values.std(axis=0, ddof=1) / np.sqrt(len(values))
            colour = LEVEL_COLOURS[rank % len(LEVEL_COLOURS)]
            axes.fill_between(
                steps, middle - error, middle + error, color=colour, alpha=0.2, linewidth=0
            )
            axes.plot(steps, middle, color=colour, label=name)
        axes.set_xlabel(across)
        axes.set_ylabel(f"{label} (simulated)")
        axes.legend(fontsize=8)
        frame(axes)
    return figure


def densities(groups: Mapping[str, ArrayLike], label: str) -> Figure:
    """Return the probability density of each group's scores, with its mean as a tick.

    Parameters
    ----------
    groups
        Scores by name, each of shape (n,).
    label
        What the scores are.
    """
    with house_style():
        figure, axes = blank(6.5, 3.6)
        every = np.concatenate([np.asarray(values, dtype=float) for values in groups.values()])
        room = 0.15 * (float(np.ptp(every)) or 1.0)
        x = np.linspace(every.min() - room, every.max() + room, 300)
        for rank, (name, given) in enumerate(groups.items()):
            values = np.asarray(given, dtype=float)
            colour = LEVEL_COLOURS[rank % len(LEVEL_COLOURS)]
            if np.ptp(values) > 0.0:
                density = gaussian_kde(values)(x)
                axes.plot(x, density, color=colour, label=name)
                axes.fill_between(x, density, color=colour, alpha=0.08, linewidth=0)
            axes.axvline(values.mean(), color=colour, linestyle=":", linewidth=1.2)
        axes.plot([], [], ":", color=SOFT, label="mean")
        axes.set_ylim(bottom=0.0)
        axes.set_xlabel(f"{label} (simulated)")
        axes.set_ylabel("probability density")
        axes.legend(fontsize=8)
        frame(axes)
    return figure
