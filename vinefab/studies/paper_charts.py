"""Charts by matplotlib: in the forms of the paper's figures, and of differences in variants."""

import io
import re
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, cast

import matplotlib as mpl
import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.text import Text
from numpy.typing import ArrayLike
from scipy.stats import gaussian_kde

from vinefab.core.errors import shortened
from vinefab.core.plain_text import GENERATOR
from vinefab.model.deployment import Deployment
from vinefab.model.map import Map
from vinefab.pages.panel import (
    INK,
    LEVEL_COLOURS,
    MOST_LETTERS,
    MOST_LINES,
    SOFT,
    Ink,
    Page,
    Panel,
    ends_of,
    level_colour,
    page_of_rows,
    plan_panel,
    series_colour,
)
from vinefab.pages.plan import draw_map, draw_pose
from vinefab.studies.claims import ConfidenceInterval

_STYLE: dict[Any, Any] = {
    "svg.hashsalt": "vinefab",
    "svg.fonttype": "path",
    "font.size": 9.0,
    "axes.edgecolor": SOFT,
    "axes.labelcolor": INK,
    "xtick.color": SOFT,
    "ytick.color": SOFT,
    "legend.frameon": False,
    "text.parse_math": False,  # names of maps and designs may hold dollars
}


@contextmanager
def house_style() -> Iterator[None]:
    """Draw and save in the house's style, without changing global settings."""
    with mpl.rc_context(_STYLE), warnings.catch_warnings():
        # A name with a letter that no font has is drawn with boxes; a user knows that already.
        warnings.filterwarnings("ignore", message=r"Glyph \d+")
        # Nor that texts of the most letters leave a small figure no room to arrange itself.
        warnings.filterwarnings("ignore", message="constrained_layout not applied")
        yield


def blank(width_in: float = 6.0, height_in: float = 6.0) -> tuple[Figure, Axes]:
    """Return an empty figure with one set of axes."""
    figure = Figure(figsize=(width_in, height_in), layout="constrained")
    return figure, figure.add_subplot()


def frame(axes: Axes) -> None:
    """Leave of the box around a chart only what is read off, and add a faint grid."""
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.grid(visible=True, color=SOFT, alpha=0.15)


def svg_bytes(figure: Figure) -> bytes:
    """Return a figure as SVG; the same figure gives the same bytes."""
    stream = io.BytesIO()
    for text in cast("list[Text]", figure.findobj(Text)):  # names may have any length
        lines = text.get_text().split("\n")[:MOST_LINES]
        text.set_text("\n".join(shortened(line, MOST_LETTERS) for line in lines))
    with house_style():
        figure.savefig(
            stream,
            format="svg",
            bbox_inches="tight",
            metadata={"Date": None, "Creator": GENERATOR},
        )
    # matplotlib repeats every text in a comment, with characters that XML forbids.
    valid = _NOT_XML.sub(b"?", stream.getvalue())
    # It writes six decimals: a hundredth of a point is enough.
    return re.sub(rb' d="[^"]*"', lambda path: re.sub(rb"(\.\d\d)\d+", rb"\1", path.group()), valid)


_NOT_XML = re.compile(rb"[\x00-\x08\x0b\x0c\x0e-\x1f]|\xef\xbf[\xbe\xbf]")


@dataclass(frozen=True, slots=True, kw_only=True)
class Bar:
    """One bar of a group."""

    label: str  # what the legend calls it; bars with the same label have the same colour
    found: ConfidenceInterval  # its height, with its interval


def grouped_bars(
    groups: Mapping[str, Sequence[Bar]], lines: Mapping[str, float], label: str
) -> Figure:
    """Return bars with intervals in groups, and a dashed line across some groups."""
    with house_style():
        figure, axes = blank(6.5, 3.6)
        names = list(dict.fromkeys(bar.label for bars in groups.values() for bar in bars))
        for place, (group, bars) in enumerate(groups.items()):
            width = 0.8 / len(bars)
            for rank, bar in enumerate(bars):
                x = place + (rank - (len(bars) - 1) / 2) * width
                colour = series_colour(names.index(bar.label))
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
    """Return means over runs with one standard error; each line is of shape (runs, steps)."""
    with house_style():
        figure, axes = blank(6.5, 3.4)
        for rank, (name, given) in enumerate(lines.items()):
            values = np.asarray(given, dtype=float)
            steps = np.arange(1, values.shape[1] + 1)
            middle = values.mean(axis=0)
            error = values.std(axis=0, ddof=1) / np.sqrt(len(values))
            colour = series_colour(rank)
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
    """Return the probability density of each group's scores, with its mean as a tick."""
    with house_style():
        figure, axes = blank(6.5, 3.6)
        x = np.linspace(*ends_of(*groups.values(), rim=0.15), 300)
        for rank, (name, given) in enumerate(groups.items()):
            values = np.asarray(given, dtype=float)
            colour = series_colour(rank)
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


def forest(
    panels: Mapping[str, Mapping[str, ConfidenceInterval]], variants: Sequence[str], label: str
) -> Figure:
    """Return a forest plot: filled where a difference is above 0 with its whole interval."""
    with house_style():
        size = (2.6 + 1.6 * len(panels), 1.3 + 0.28 * len(variants))
        figure = Figure(figsize=size, layout="constrained")
        places = figure.subplots(1, len(panels), sharey=True, squeeze=False)[0]
        for axes, (title, results) in zip(places, panels.items(), strict=True):
            for row, variant in enumerate(variants):
                if variant not in results:
                    across = axes.get_yaxis_transform()
                    axes.text(
                        0.5, row, "not tested", transform=across, color=SOFT, fontsize=7,
                        va="center",
                    )  # fmt: skip
                    continue
                found = results[variant]
                axes.plot([found.low, found.high], [row, row], color=INK, linewidth=1.2)
                axes.plot([found.value], [row], **_mark(held=found.held))
            axes.axvline(0.0, color=SOFT, linewidth=1.0)
            axes.tick_params(axis="x", labelsize=8)
            axes.tick_params(axis="y", length=0)
            axes.spines[["top", "right", "left"]].set_visible(False)
            axes.set_title(title, fontsize=9, color=INK)
        places[0].set_yticks(range(len(variants)), variants, fontsize=8)
        places[0].set_ylim(len(variants) - 0.5, -0.5)
        figure.supxlabel(label, fontsize=9, color=INK)
        words = {True: "all of the 95 % interval above 0: held", False: "not held"}
        figure.legend(
            handles=[
                Line2D([], [], label=text, **_mark(held=held)) for held, text in words.items()
            ],
            loc="outside upper center",
            ncols=2,
            fontsize=8,
            frameon=False,
        )
    return figure


def _mark(*, held: bool) -> dict[str, Any]:
    colour = LEVEL_COLOURS[0]
    face = colour if held else "white"
    return {"marker": "o", "color": colour, "markerfacecolor": face, "linestyle": "none"}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlanPanel:
    """One plan."""

    title: str  # what it shows
    world: Map  # the map
    deployments: tuple[Deployment, ...]  # robots on it, drawn together
    buffer_mm: float = 0.0  # distance from their bodies that is shaded; 0: none


def reach_plan(panels: Sequence[PlanPanel], columns: int = 2) -> Page:
    """Return plans in rows."""
    drawn = [_plan(panel) for panel in panels]
    return page_of_rows([drawn[at : at + columns] for at in range(0, len(drawn), columns)])


def _plan(shown: PlanPanel) -> Panel:
    panel = plan_panel(shown.world.bounds.bounds, 270.0)
    panel.title, panel.x_name, panel.y_name = shown.title, "", ""
    panel.x_ticks = panel.y_ticks = ()
    panel.legend_shown = False
    chains = [
        robot.chain_mm(branch)
        for robot in shown.deployments
        for branch in np.flatnonzero(robot.deployed).tolist()
    ]
    if shown.buffer_mm > 0.0:
        lines = [shapely.LineString(chain) for chain in chains]
        near = shapely.union_all(shapely.buffer(lines, shown.buffer_mm))
        reached = shapely.intersection(near, shown.world.free_space)
        panel.polygons([reached], Ink(fill=LEVEL_COLOURS[5], fill_alpha=0.45), rank=0.5)
    draw_map(panel, shown.world)
    for robot in shown.deployments:
        for level in range(int(robot.tree.level.max()), 0, -1):
            members = np.flatnonzero((robot.tree.level == level) & robot.deployed).tolist()
            ink = Ink(line=level_colour(level), width_pt=max(0.6, 2.2 - 0.4 * level))
            panel.lines([robot.chain_mm(branch) for branch in members], ink, rank=4.2 - 0.1 * level)
    draw_pose(panel, shown.deployments[0].pose, max(shown.world.size_mm))
    return panel
