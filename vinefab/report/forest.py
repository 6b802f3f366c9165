"""Differences with intervals under many variants, one panel for each conclusion."""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from vinefab.report.colours import INK, LEVEL_COLOURS, SOFT
from vinefab.report.figure import house_style
from vinefab.report.paper_charts import Known


class Judged(Known, Protocol):
    """A difference with an interval."""

    @property
    def held(self) -> bool:
        """Whether all of it is above 0."""


def forest(
    panels: Mapping[str, Mapping[str, Judged]], variants: Sequence[str], label: str
) -> Figure:
    """Return a forest plot: filled where a difference is above 0 with its whole interval.

    Parameters
    ----------
    panels
        Results by variant, by the title of their panel; a variant may be missing in a panel.
    variants
        All variants, from top to bottom.
    label
        What the differences are.
    """
    with house_style():
        size = (2.6 + 1.6 * len(panels), 1.3 + 0.28 * len(variants))
        figure = Figure(figsize=size, layout="constrained")
        places = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
        for axes, (title, results) in zip(places, panels.items(), strict=True):
            _draw(axes, results, variants)
            axes.set_title(title, fontsize=9, color=INK)
        places[0].set_yticks(range(len(variants)), variants, fontsize=8)
        places[0].set_ylim(len(variants) - 0.5, -0.5)
        figure.supxlabel(label, fontsize=9, color=INK)
        figure.legend(
            handles=_keys(), loc="outside upper center", ncols=2, fontsize=8, frameon=False
        )
    return figure


def _mark(*, held: bool) -> dict[str, Any]:
    colour = LEVEL_COLOURS[0]
    face = colour if held else "white"
    return {"marker": "o", "color": colour, "markerfacecolor": face, "linestyle": "none"}


def _keys() -> list[Line2D]:
    words = {True: "all of the 95 % interval above 0: held", False: "not held"}
    return [Line2D([], [], label=text, **_mark(held=held)) for held, text in words.items()]


def _draw(axes: Axes, results: Mapping[str, Judged], variants: Sequence[str]) -> None:
    for row, variant in enumerate(variants):
        if variant not in results:
            across = axes.get_yaxis_transform()
            axes.text(0.5, row, "not asked", transform=across, color=SOFT, fontsize=7, va="center")
            continue
        found = results[variant]
        axes.plot([found.low, found.high], [row, row], color=INK, linewidth=1.2)
        axes.plot([found.value], [row], **_mark(held=found.held))
    axes.axvline(0.0, color=SOFT, linewidth=1.0)
    axes.tick_params(axis="x", labelsize=8)
    axes.tick_params(axis="y", length=0)
    axes.spines[["top", "right", "left"]].set_visible(False)
