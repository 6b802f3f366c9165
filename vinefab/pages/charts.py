"""Charts: how a search went, and how scores are spread."""

from collections.abc import Mapping

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import ArrayLike

from vinefab.pages.colours import LEVEL_COLOURS, SOFT
from vinefab.pages.figure import blank, house_style


def fitness_curve(best: ArrayLike, mean: ArrayLike, spread: ArrayLike) -> Figure:
    """Return the fitness per generation of a search.

    Parameters
    ----------
    best
        Best fitness found so far, shape (g,).
    mean, spread
        Mean and standard deviation over each generation's candidates, shape (g,).
    """
    best, mean, spread = (np.asarray(values, dtype=float) for values in (best, mean, spread))
    with house_style():
        figure, axes = blank(6.5, 3.4)
        generations = np.arange(1, len(best) + 1)
        axes.fill_between(
            generations,
            mean - spread,
            mean + spread,
            color=LEVEL_COLOURS[0],
            alpha=0.15,
            linewidth=0,
            label="one standard deviation",
        )
        axes.plot(generations, mean, color=LEVEL_COLOURS[0], label="mean of the generation")
        axes.plot(generations, best, color=LEVEL_COLOURS[1], label="best so far")
        axes.set_xlabel("generation")
        axes.set_ylabel("fitness (simulated)")
        axes.legend(fontsize=8)
        frame(axes)
    return figure


def panels_of_strips(panels: Mapping[str, Mapping[str, ArrayLike]], label: str) -> Figure:
    """Return every score of every group as a dot, with the group's mean; a panel per problem.

    Parameters
    ----------
    panels
        By problem, scores by group, each shape (n,).
    """
    groups = max(len(scores) for scores in panels.values())
    with house_style():
        height_in = (0.6 + 0.32 * max(2, groups)) * len(panels) + 0.3
        figure = Figure(figsize=(6.5, height_in), layout="constrained")
        rows = figure.subplots(len(panels), 1, squeeze=False)[:, 0]
        for axes, (title, scores) in zip(rows, panels.items(), strict=True):
            _strips(axes, scores)
            axes.set_title(title, loc="left", fontsize=9)
        rows[-1].set_xlabel(f"{label}; bars: means")
    return figure


def _strips(axes: Axes, scores: Mapping[str, ArrayLike]) -> None:
    for row, group in enumerate(scores.values()):
        values = np.asarray(group, dtype=float)
        # A fixed, even jitter: dots on top of each other cannot be counted.
        offset = 0.18 * ((np.arange(len(values)) % 5) - 2) / 2
        colour = LEVEL_COLOURS[row % len(LEVEL_COLOURS)]
        axes.plot(values, row + offset, "o", color=colour, alpha=0.55, markersize=4)
        axes.plot([values.mean()] * 2, [row - 0.32, row + 0.32], color=colour, linewidth=2)
    axes.set_yticks(range(len(scores)), list(scores))
    axes.invert_yaxis()
    frame(axes)


def frame(axes: Axes) -> None:
    """Leave of the box around a chart only what is read off, and add a faint grid."""
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.grid(visible=True, color=SOFT, alpha=0.15)
