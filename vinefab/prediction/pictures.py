"""Pictures of predictions: distributions, ranges, effects, differences, heat maps, passages."""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from vinefab.core.validation import Floats
from vinefab.maps.passages import Passage
from vinefab.model.map import Map
from vinefab.pages.charts import curve, ends_of, jitter, series_colour, upright
from vinefab.pages.map_view import UNSEEN_DETAIL
from vinefab.pages.panel import (
    ALERT,
    HEAT_COLOURS,
    INK,
    LEVEL_COLOURS,
    SOFT,
    TICK_PT,
    Ink,
    Page,
    Panel,
    Raster,
    blended,
    level_colour,
    page_of,
    page_of_rows,
    plan_panel,
)
from vinefab.pages.plan import draw_map, draw_pose
from vinefab.prediction.measures import Measure

if TYPE_CHECKING:
    from vinefab.prediction.comparison import PairedDifference
    from vinefab.prediction.heat_map import HeatMap
    from vinefab.prediction.prediction_width import ContactRange
    from vinefab.prediction.pressure_window import PressureWindow
    from vinefab.prediction.sensitivity import Effect

ENOUGH_FOR_BARS = 20
"""Fewer values are shown one by one."""

_BINS = 24
_PITCH, _TALLEST = 1.3, 0.62
"""From row to row, and the tallest bar of a row: what is left holds its name."""


def spread_chart(measure: Measure, values: Mapping[str, Floats]) -> Page:
    """Return the distribution of a measure over deployments, a row for each family."""
    known = {name: column[np.isfinite(column)] for name, column in values.items()}
    everything = np.concatenate(list(known.values()))
    low, high = float(everything.min()), float(everything.max())
    pad = 0.04 * (high - low) or 0.04 * abs(high) or 1.0
    panel = Panel(
        box=(low - pad, (len(known) - 1) * _PITCH + 0.2, high + pad, -1.0),
        width_pt=205.0,
        height_pt=16.0 + 88.0 * len(known),
        x_name=measure.label,
        frame=True,
        y_grid=False,
    )
    ticks: dict[float, str] = {}
    for row, (name, column) in enumerate(known.items()):
        base, colour, most = row * _PITCH, series_colour(row), 0
        if len(column) >= ENOUGH_FOR_BARS and high > low:
            counts, edges = np.histogram(column, bins=_BINS, range=(low, high))
            most = int(counts.max())
            tops = base - _TALLEST * counts / most
            sides = zip(edges[:-1].tolist(), edges[1:].tolist(), tops.tolist(), strict=True)
            panel.bars([(x0, base, x1, top) for x0, x1, top in sides], colour, 0.35)
            ticks |= {base: "0", base - _TALLEST: str(most)}
        else:
            dots = np.column_stack([column, base - 0.3 - 0.18 * jitter(len(column))])
            panel.marks(dots, "o", 4.0, Ink(fill=colour, fill_alpha=0.55))
        p05, p95 = np.percentile(column, [5.0, 95.0]).tolist()
        thick = Ink(line=colour, width_pt=4.0, butt=True)
        panel.line([(p05, base + 0.08), (p95, base + 0.08)], thick)
        upright(panel, float(column.mean()), (base - 0.66, base + 0.13), INK, 1.6)
        panel.words((low - pad, base - 0.84), name, TICK_PT, colour=SOFT)
    panel.y_ticks = list(ticks.items())
    panel.y_name = "deployments" if ticks else ""
    return page_of(panel)


_OPEN = "#1b7f4d"


def window_chart(window: "PressureWindow") -> Page:
    """Return what growth needs, what each width may take, and the room between the two."""
    rows = 2 + len(window.levels)
    low, high = window.needed_kpa, window.allowed_kpa
    panel = Panel(
        box=(0.0, rows - 0.5, 1.06 * window.highest_kpa, -1.2),
        width_pt=300.0,
        height_pt=27.0 * (rows + 0.7),
        x_name="pressure (kPa)",
        frame=True,
        y_grid=False,
    )
    if window.is_open:
        panel.title, panel.title_colour = f"window {low:.1f} to {high:.1f} kPa", _OPEN
    else:
        panel.title, panel.title_colour = f"no window: {low - high:.1f} kPa missing", ALERT
    panel.title_bold = True
    room = (min(low, high), rows - 0.5, max(low, high), -1.2)
    panel.bars([room], panel.title_colour, 0.16 if window.is_open else 0.10)
    upright(panel, high, (rows - 0.5, -1.2), SOFT, 1.0)
    names = []
    for row, need in enumerate((window.loose, window.tight)):
        colour = LEVEL_COLOURS[1]
        panel.bars([(need.p05_kpa, row + 0.25, need.p95_kpa, row - 0.25)], colour, 0.45)
        for value, weight in ((need.median_kpa, 1.2), (need.p95_kpa, 2.5)):
            upright(panel, value, (row - 0.3, row + 0.3), colour, weight)
        names.append(f"growth needs, film stored {need.storage}")
    for row, level in enumerate(window.levels, start=2):
        colour = level_colour(level.level)
        panel.bars([(0.0, row + 0.25, level.allowed_kpa, row - 0.25)], colour, 0.5)
        upright(panel, level.burst_kpa, (row - 0.3, row + 0.3), colour, 2.0)
        names.append(f"{level.name} may take, {level.width_mm:.1f} mm")
    dashed = Ink(line=INK, width_pt=1.4, dash_pt=(5.0, 2.5))
    working = window.working_kpa
    panel.line([(working, rows - 0.5), (working, -1.2)], dashed)
    words = f"working pressure {working:g} kPa"
    panel.words((working, -0.86), words, TICK_PT, shift_pt=(4.0, 0.0))
    panel.y_ticks = list(enumerate(names))
    return page_of(panel)


def contact_chart(shown: "Mapping[str, ContactRange]", measure: Measure) -> Page:
    """Return a measure over the range of half-angles, a line with its interval for each name."""
    (first, *_) = shown.values()
    angles = first.angles_deg
    every = [v for found in shown.values() for v in found.values[measure.key]]
    x0, x1 = ends_of(angles)
    y0, y1 = ends_of([v.low for v in every], [v.high for v in every], [v.mean for v in every])
    standing = first.standing.partition(":")[0]
    panel = Panel(
        box=(x0, y0, x1, y1),
        width_pt=370.0,
        height_pt=150.0,
        x_name=f"head-on half-angle (degrees, {standing})",
        y_name=measure.label,
        x_ticks=[(angle, f"{angle:g}") for angle in angles],
        frame=True,
        legend_shown=len(shown) > 1,
    )
    for index, (name, found) in enumerate(shown.items()):
        values = found.values[measure.key]
        colour = series_colour(index)
        low, high = [v.low for v in values], [v.high for v in values]
        panel.band(found.angles_deg, low, high, colour, 0.16)
        curve(panel, found.angles_deg, [v.mean for v in values], colour, name)
    return page_of(panel)


def cost_chart(
    name: str, predicted: Sequence[float], changed: Sequence[tuple[str, Sequence[float]]]
) -> Page:
    """Return what assumptions move a mean by, a bar for each of them, as wide as a column.

    Parameters
    ----------
    name
        What the mean is of, with its unit.
    predicted
        The mean as predicted, and the ends of its 95 % interval over maps, if it has one.
    changed
        By words, the mean under each choice of one assumption.
    """
    every = [float(mean) for _, means in changed for mean in means]
    _, right = ends_of([0.0, *every], predicted)
    rows = len(changed)
    panel = Panel(
        box=(min(0.0, *every, *predicted), rows, right, 0.0), width_pt=232.0, height_pt=27.0 * rows,
        x_name=name, y_ticks=[], frame=True, y_grid=False,
    )  # fmt: skip
    mean, *ends = predicted
    if ends and np.isfinite(ends).all():
        panel.bars([(ends[0], rows, ends[1], 0.0)], SOFT, 0.18)
    upright(panel, mean, (rows, 0.0), INK, 1.6)
    for row, (words, means) in enumerate(changed):
        colour = series_colour(row)
        panel.words((panel.box[0], row + 0.26), words, TICK_PT, shift_pt=(3.0, 0.0), halo=True)
        panel.bars([(min(means), row + 0.88, max(means), row + 0.55)], colour, 0.45)
        for value in means:
            upright(panel, value, (row + 0.5, row + 0.93), colour, 2.0)
    return page_of(panel)


def effect_panels(effects: "Sequence[Effect]", measures: Sequence[Measure]) -> Page:
    """Return what every change does: a column per knob, a row per measure."""
    knobs = list(dict.fromkeys(effect.knob for effect in effects))
    rows = []
    for measure in measures:
        shown = [[e for e in effects if e.knob == k and measure.key in e.changes] for k in knobs]
        changes = [e.changes[measure.key] for some in shown for e in some]
        y0, y1 = ends_of([0.0], [c.low for c in changes], [c.high for c in changes])
        panels = list[Panel]()
        for knob, some in zip(knobs, shown, strict=True):
            x0, x1 = ends_of([0.0], [e.step for e in some])
            panel = Panel(
                box=(x0, y0, x1, y1), width_pt=430.0 / len(knobs), height_pt=122.0, frame=True,
            )  # fmt: skip
            points = [
                (e.step, c.mean, c.low, c.high) for e in some for c in [e.changes[measure.key]]
            ]
            step, mean, low, high = np.array(sorted([*points, (0.0, 0.0, 0.0, 0.0)])).T
            panel.band(step, low, high, LEVEL_COLOURS[2], 0.22)
            panel.line([(x0, 0.0), (x1, 0.0)], Ink(line=SOFT, width_pt=0.8))
            line = np.column_stack([step, mean])
            panel.line(line, Ink(line=LEVEL_COLOURS[0], width_pt=1.3))
            panel.marks(line, "o", 3.5, Ink(fill=LEVEL_COLOURS[0]))
            if panels:
                panel.y_ticks = [(value, "") for value, _ in panel.ticks(1)]
            else:
                panel.y_name = f"change of\n{measure.title}\n({measure.unit})"
            if measure is measures[-1]:
                unit = next(effect.unit for effect in effects if effect.knob == knob)
                panel.x_name = f"{knob} ({unit})"
            panels.append(panel)
        rows.append(panels)
    return page_of_rows(rows)


def paired_difference_chart(measure: Measure, differences: "Sequence[PairedDifference]") -> Page:
    """Return paired differences with their intervals, a row per pair; clear ones are solid."""
    rows = max(2, len(differences))
    x0, x1 = ends_of([0.0], [d.low for d in differences], [d.high for d in differences])
    panel = Panel(
        box=(x0, rows - 0.4, x1, -0.6),
        width_pt=340.0,
        height_pt=27.0 * rows,
        x_name=f"difference in {measure.label}; {measure.better} is better",
        y_ticks=[(row, difference.pair) for row, difference in enumerate(differences)],
        frame=True,
    )
    upright(panel, 0.0, (rows - 0.4, -0.6), INK, 1.0)
    for row, difference in enumerate(differences):
        colour = LEVEL_COLOURS[0] if difference.is_clear else SOFT
        ends = [(difference.low, row), (difference.high, row)]
        panel.line(ends, Ink(line=colour, width_pt=2.2))
        ink = Ink(fill=colour if difference.is_clear else "#ffffff", line=colour, width_pt=1.2)
        panel.marks([(difference.mean, row)], "o", 7.0, ink)
    return page_of(panel)


def heat_plan(heat: "HeatMap") -> Page:
    """Return a map with the share of the deployments that pass each place, and stuck tips."""
    panel = plan_panel(heat.world.bounds.bounds)
    rows, columns = heat.share.shape
    x, y = heat.low_mm
    most = 100.0 * float(heat.share.max()) or 1.0
    shares = np.where(heat.share > 0.0, 100.0 * heat.share / most, np.nan)
    extent = (x, y, x + columns * heat.cell_mm, y + rows * heat.cell_mm)
    panel.add(Raster(extent, blended(shares[::-1], HEAT_COLOURS)), 0.5)
    panel.bar = ("deployments whose body passes (%)", 0.0, most, HEAT_COLOURS)
    draw_map(panel, heat.world)
    for start in heat.world.starts:
        draw_pose(panel, start.pose, max(heat.world.size_mm))
    places = np.array([(spot.x_mm, spot.y_mm) for spot in heat.spots]).reshape(-1, 2)
    if len(places):
        label = "branches get stuck here, numbered as in the table"
        panel.marks(places, "o", 9.0, Ink(line=ALERT, width_pt=1.6), rank=8.0, label=label)
        numbers = [str(number) for number in range(1, len(places) + 1)]
        panel.write_labels(places, numbers, [ALERT] * len(places), size_pt=9.0, mark_pt=5.0)
    return page_of(panel)


_ROOM = level_colour(3)
_MOST_NAMED = 30


def passage_plan(
    world: Map,
    passages: Sequence[Passage],
    clearances_mm: Sequence[float],
    body: tuple[float, BaseGeometry] | None = None,
) -> Page:
    """Return a plan of a map with its narrow passages, numbered from the narrowest."""
    panel = plan_panel(world.bounds.bounds)
    if body is not None:
        region = shapely.simplify(body[1], UNSEEN_DETAIL * max(world.size_mm))
        words = f"room for a body of {body[0]:g} mm lay-flat width"
        panel.polygons([region], Ink(fill=_ROOM, fill_alpha=0.25), rank=0.5, label=words)
    draw_map(panel, world)
    clear = Ink(line=INK, width_pt=1.0, dash_pt=(1.0, 2.0))
    turns = np.linspace(0.0, 2.0 * np.pi, 97)
    around = np.column_stack([np.cos(turns), np.sin(turns)])
    for start, clearance_mm in zip(world.starts, clearances_mm, strict=True):
        draw_pose(panel, start.pose, max(world.size_mm))
        ring = around * clearance_mm + (start.pose.x_mm, start.pose.y_mm)
        panel.line(ring, clear, label="clearance of the start")
    ends = [np.array(passage.ends_mm) for passage in passages]
    if passages:
        panel.lines(ends, Ink(line=ALERT, width_pt=2.0, butt=True), rank=6.0)
        # Many a passage is too short to be seen on paper: the ring shows where it is.
        middles = np.array([passage.middle_mm for passage in passages])
        label = "narrow passage (computed)"
        panel.marks(middles, "o", 11.0, Ink(line=ALERT, width_pt=1.0), rank=6.0, label=label)
    named = passages[:_MOST_NAMED]
    words_of = [f"{number}: {one.width_mm:.1f} mm" for number, one in enumerate(named, start=1)]
    starts = world.starts if 1 < len(world.starts) <= _MOST_NAMED else ()
    places = [one.middle_mm for one in named] + [(s.pose.x_mm, s.pose.y_mm) for s in starts]
    colours = [ALERT] * len(named) + [INK] * len(starts)
    words_of += [f"start {number}" for number in range(1, len(starts) + 1)]
    panel.write_labels(np.array(places), words_of, colours, size_pt=8.0, mark_pt=5.5, lines=ends)
    return page_of(panel)
