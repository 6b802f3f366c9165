"""Charts: how a search went, and how scores are spread."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import ArrayLike

from vinefab.core.validation import Floats
from vinefab.pages.panel import LEVEL_COLOURS, Ink, Page, Panel, page_of, page_of_rows


def series_colour(index: int) -> str:
    """Return the colour of a series, counted from 0; they repeat."""
    return LEVEL_COLOURS[index % len(LEVEL_COLOURS)]


def ends_of(*values: ArrayLike, rim: float = 0.05) -> tuple[float, float]:
    """Return the ends of an axis that shows some values, with a rim; what is not finite is out."""
    every = np.concatenate([np.asarray(some, dtype=float).ravel() for some in values])
    every = every[np.isfinite(every)]
    if not len(every):
        return 0.0, 1.0
    low, high = float(every.min()), float(every.max())
    room = rim * (high - low) or 0.05 * abs(high) or 1.0
    return low - room, high + room


def curve(panel: Panel, x: ArrayLike, y: ArrayLike, colour: str, label: str = "") -> None:
    """Draw a line with a dot at every value; gaps where values are not finite."""
    points = np.column_stack([np.asarray(x, dtype=float), np.asarray(y, dtype=float)])
    points = points[np.isfinite(points).all(axis=1)]
    panel.line(points, Ink(line=colour, width_pt=1.5), label=label)
    panel.marks(points, "o", 5.0, Ink(fill=colour))


MOST_POINTS = 400
"""Longer curves are thinned out."""


def fitness_curve(best: ArrayLike, mean: ArrayLike, spread: ArrayLike) -> Page:
    """Return the fitness per generation of a search.

    The axis shows the scores; a best fitness below them, of designs with a penalty, lies on its
    lower end.

    Parameters
    ----------
    best
        Best fitness found so far, shape (g,).
    mean, spread
        Mean and standard deviation over each generation's candidates, shape (g,).
    """
    rows = np.array([np.asarray(values, dtype=float) for values in (best, mean, spread)])
    count = rows.shape[1]
    kept = np.unique(np.linspace(0, max(0, count - 1), min(count, MOST_POINTS)).astype(int))
    top, middle, wide = rows[:, kept]
    low, high = middle - wide, middle + wide
    known = middle[np.isfinite(middle)]
    y0, y1 = ends_of(low, high, top[top >= known.min()] if len(known) else [])
    x0, x1 = ends_of(kept + 1)
    panel = Panel(
        box=(x0, y0, x1, y1), width_pt=400.0, height_pt=200.0, frame=True,
        x_name="generation", y_name="fitness (simulated)",
    )  # fmt: skip
    panel.band(kept + 1, low, high, LEVEL_COLOURS[0], 0.15)
    words = "mean of the generation, shaded: one standard deviation"
    for values, colour, label in (
        (middle, LEVEL_COLOURS[0], words),
        (np.clip(top, y0, y1), LEVEL_COLOURS[1], "best so far"),
    ):
        points = np.column_stack([kept + 1, values])[np.isfinite(values)]
        panel.line(points, Ink(line=colour, width_pt=1.5), label=label)
        if len(points) == 1:
            panel.marks(points, "o", 5.0, Ink(fill=colour))
    return page_of(panel)


def panels_of_strips(panels: Mapping[str, Mapping[str, ArrayLike]], label: str) -> Page:
    """Return every score of every group as a dot, with the group's mean; a panel per problem.

    Parameters
    ----------
    panels
        By problem, scores by group, each shape (n,).
    """
    rows = []
    for title, scores in panels.items():
        columns = [np.asarray(group, dtype=float) for group in scores.values()]
        x0, x1 = ends_of(*columns)
        panel = Panel(
            box=(x0, len(columns) - 0.4, x1, -0.6),
            width_pt=360.0,
            height_pt=23.0 * max(2, len(columns)),
            title=title,
            frame=True,
            y_ticks=[(row, name) for row, name in enumerate(scores)],
        )
        for row, values in enumerate(columns):
            colour = series_colour(row)
            dots = np.column_stack([values, row + 0.18 * jitter(len(values))])
            panel.marks(dots, "o", 4.0, Ink(fill=colour, fill_alpha=0.55))
            mean = values.mean()
            panel.line([(mean, row - 0.32), (mean, row + 0.32)], Ink(line=colour, width_pt=2.0))
        rows.append([panel])
    rows[-1][0].x_name = f"{label}; bars: means"
    return page_of_rows(rows)


def jitter(count: int) -> Floats:
    """Return a fixed, even jitter from -1 to 1: dots on top of each other cannot be counted."""
    return ((np.arange(count) % 5) - 2) / 2.0


def upright(panel: Panel, x: float, ends: Sequence[float], colour: str, width_pt: float) -> None:
    """Draw a short line across a row at a value."""
    panel.line([(x, ends[0]), (x, ends[1])], Ink(line=colour, width_pt=width_pt, butt=True))
