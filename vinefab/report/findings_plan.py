"""The flat outline with every finding of the design rules at its place."""

from collections.abc import Sequence

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patheffects import Normal, Stroke

from vinefab.model.checked import Floats
from vinefab.model.finding import Finding, Severity
from vinefab.report.colours import ALERT, INK, ROCK_EDGE, SOFT
from vinefab.report.figure import house_style, plan_axes

WEIGHT_COLOURS = {Severity.ERROR: ALERT, Severity.WARNING: "#c46a00", Severity.INFO: "#0b6e8a"}

MOST_NUMBERED = 60


def findings_plan(outline_mm: Floats, findings: Sequence[Finding]) -> Figure:
    """Return the outline with markers, numbered as the findings are.

    Parameters
    ----------
    outline_mm
        Points of the body's outline in the flat layout, shape (n, 2).
    findings
        In the order of their numbers, the first is 1; those without a place are left out.
    """
    marks = [(f, shapely.from_wkt(f.marker_wkt)) for f in findings if f.marker_wkt]
    everything = np.concatenate([outline_mm, *(shapely.get_coordinates(m) for _, m in marks)])
    low, high = everything.min(axis=0), everything.max(axis=0)
    with house_style():
        figure, axes = plan_axes((low[0], low[1], high[0], high[1]), 7.0)
        axes.fill(*outline_mm.T, facecolor="#eef2f4", edgecolor=ROCK_EDGE, linewidth=0.8)
        for finding, mark in marks:
            _draw_mark(axes, mark, WEIGHT_COLOURS[finding.severity])
        _write_numbers(axes, findings)
        for severity, colour in WEIGHT_COLOURS.items():
            if any(finding.severity is severity for finding, _ in marks):
                axes.plot([], [], "o", color=colour, label=severity.value)
        if marks:
            axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)
    return figure


def _draw_mark(axes: Axes, mark: shapely.Geometry, colour: str) -> None:
    for part in shapely.get_parts(mark).tolist():
        points = shapely.get_coordinates(part)
        style = "o" if len(points) == 1 else "-"
        axes.plot(*points.T, style, color=colour, lw=2.2, ms=6, alpha=0.6, zorder=4)


def _write_numbers(axes: Axes, findings: Sequence[Finding]) -> None:
    """Write every number beside its place; those at one place stand together."""
    together: dict[tuple[float, float], list[int]] = {}
    for number, finding in enumerate(findings[:MOST_NUMBERED], start=1):
        if finding.x_mm is not None and finding.y_mm is not None:
            place = (round(finding.x_mm, 0), round(finding.y_mm, 0))
            together.setdefault(place, []).append(number)
    for place, numbers in together.items():
        axes.plot(*place, "o", ms=4, color=INK, zorder=5)
        axes.annotate(
            ", ".join(map(str, numbers)),
            place,
            xytext=(5, 5),
            textcoords="offset points",
            fontsize=9,
            fontweight="bold",
            color=INK,
            path_effects=[Stroke(linewidth=2.5, foreground="white"), Normal()],
            zorder=6,
        )
    if len(findings) > MOST_NUMBERED:
        axes.set_title(f"the first {MOST_NUMBERED} are numbered", fontsize=8, color=SOFT)
