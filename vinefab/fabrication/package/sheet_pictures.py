"""Pictures of a laser job: the sheet, findings at their places, the laser's path in motion."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial
from html import escape

import numpy as np
import shapely

from vinefab.core.plain_text import GENERATOR, counted
from vinefab.core.validation import Floats
from vinefab.fabrication.job.placement import SheetPlaces, box_around_mm, fact_rows, piece_name
from vinefab.fabrication.job.timing import PathPass, schedule
from vinefab.fabrication.rules.pressure_rules import deployed_capsules
from vinefab.inflation.pattern import Pattern
from vinefab.inflation.robot import with_short_tail
from vinefab.model.finding import Finding, Severity
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile
from vinefab.outline.body_outline import FlatLayout, body_outline, flat_layout
from vinefab.pages.panel import (
    ALERT,
    INK,
    ROCK,
    ROCK_EDGE,
    SOFT,
    TICK_PT,
    Ink,
    Marks,
    Page,
    Panel,
    Primitive,
    Shape,
    level_colour,
    page_of,
    page_of_rows,
    plan_panel,
)
from vinefab.pages.plan import Box, longer_mm
from vinefab.pages.plan_svg import contour_path

OPERATION_COLOURS = {
    Operation.MARK: "#000000",
    Operation.WELD: "#0000FF",
    Operation.WELDCUT: "#FF00FF",
    Operation.CUT: "#FF0000",
    Operation.REG: "#F36926",
    Operation.DOC: "#0C96D9",
}

MOST_NUMBERS = 60
"""Most numbers in a picture: with more paths none is numbered, of more findings the first."""

_CROPPED = 0.6
_RIM_MM = 15.0


SHEETS_IN_ROW = 3


def job_plan(job: Job, findings: tuple[Finding, ...] = (), *, named: bool = False) -> Page:
    """Return a plan of the sheet: every path in its operation's colour, with arrows and order.

    ``named`` writes what each seam is of: for films that no machine can write on.

    Several sheets have a plan each, with its own axes and order: each is a run of the machine.
    Where the paths take a small part of the bed, that part is shown and the title says so. Marks
    come first and have neither arrows nor numbers: their order does not matter.
    """
    if len(job.sheets) < 2:
        panel = _sheet_panel(job, lambda cropped: _title(job, findings, cropped), 648.0)
        for name, paths in _seams_by_name(job).items() if named else ():
            x0, y0, x1, y1 = box_around_mm(path.contour for path in paths)
            # Under a single line, in the middle of a body.
            shift_pt = (0.0, -8.0 if y0 == y1 else 0.0)
            place = ((x0 + x1) / 2.0, (y0 + y1) / 2.0)
            panel.words(place, name, TICK_PT, halo=True, anchor="middle", shift_pt=shift_pt)
        return page_of(panel)
    count, longest_pt = len(job.sheets), 648.0 / min(SHEETS_IN_ROW, len(job.sheets))
    panels = [
        _sheet_panel(sheet, partial(_sheet_title, number, count), max(longest_pt, 288.0))
        for number, sheet in enumerate(job.sheets, 1)
    ]
    # In short lines: a long one would push the other columns away.
    head = _title(job, findings, cropped=False).replace("; ", ";\n").replace("order, ", "order,\n")
    panels[0].title = f"{head}\n{panels[0].title}"
    legend = dict[str, Primitive]()
    for operation in Operation:
        for panel, sheet in zip(panels, job.sheets, strict=True):
            if (entry := panel.legend.get(_label(sheet, operation))) is not None:
                legend.setdefault(_label(job, operation), entry)
            panel.legend_shown = False
    rows = [panels[k : k + SHEETS_IN_ROW] for k in range(0, count, SHEETS_IN_ROW)]
    return page_of_rows(rows, legend)


def _seams_by_name(job: Job) -> dict[str, list[LaserPath]]:
    """Return the seams of each robot; those of none by their labels."""
    found: dict[str, list[LaserPath]] = {}
    for path in job.along(Operation.WELD):
        found.setdefault(path.of or path.label, []).append(path)
    return found


def _sheet_panel(job: Job, title: Callable[[bool], str], longest_pt: float) -> Panel:
    """Return the plan of one bed, or of film in tiles."""
    box: Box = (0.0, 0.0, job.sheet_width_mm, job.sheet_height_mm)
    cropped = False
    if job.paths:
        x0, y0, x1, y1 = box_around_mm(path.contour for path in job.paths)
        used = x0 - _RIM_MM, y0 - _RIM_MM, x1 + _RIM_MM, y1 + _RIM_MM
        cropped = (used[2] - used[0]) * (used[3] - used[1]) <= _CROPPED * box[2] * box[3]
        whole = min(used[0], 0.0), min(used[1], 0.0), max(used[2], box[2]), max(used[3], box[3])
        box = used if cropped else whole
    panel = plan_panel(box, longest_pt)
    bed = shapely.box(0.0, 0.0, job.sheet_width_mm, job.sheet_height_mm)
    panel.polygons([bed.intersection(shapely.box(*box))], Ink(fill="#fbfcfd", line=SOFT))
    for operation in Operation:
        _draw_operation(panel, job, operation, longer_mm(box) / 16.0)
    _draw_tiles(panel, job)
    paths = run_paths(job)
    for number, path in enumerate(paths if len(paths) <= MOST_NUMBERS else (), start=1):
        x, y = path.contour.points_mm[0].tolist()
        colour = OPERATION_COLOURS[path.operation]
        panel.words((x, y), str(number), TICK_PT, colour=colour, shift_pt=(4.0, 6.0))
    panel.title = title(cropped)
    return panel


_WINDOW = Ink(line=SOFT, width_pt=0.6, dash_pt=(4.0, 3.0))


def _draw_tiles(panel: Panel, job: Job) -> None:
    """Draw the windows of tiles with their numbers, and the crosses by which they are aligned."""
    windows: dict[Box, list[str]] = {}
    crosses, on_robot = list[Floats](), list[Floats]()
    for number, tile in enumerate(job.tiles, start=1):
        x, y = _window_mm(tile)
        box = x, y, x + tile.sheet_width_mm, y + tile.sheet_height_mm
        windows.setdefault(box, []).append(str(number))
        for key, found in (("targets_made_mm", crosses), ("robot_targets_made_mm", on_robot)):
            found += [np.array([(x, y)]) + point for point in fact_rows(tile, key)]
    for box, numbers in windows.items():
        x0, y0, x1, y1 = box
        panel.line([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)], _WINDOW)
        shown = max(x0, panel.box[0]), min(y1, panel.box[3])
        words = f"tile {', '.join(numbers)}"
        panel.words(shown, words, TICK_PT, colour=SOFT, shift_pt=(4.0, -8.0))
    for places, size_pt in ((crosses, 8.0), (on_robot, 5.0)):
        if places:
            panel.marks(np.concatenate(places), "+", size_pt, Ink(line=INK, width_pt=0.7))


def run_paths(job: Job) -> tuple[LaserPath, ...]:
    """Return the paths that a machine runs and that are not marks, in process order."""
    return tuple(
        path
        for operation in Operation
        if operation.is_machined and operation is not Operation.MARK
        for path in job.along(operation)
    )


def path_points_mm(path: LaserPath, tolerance_mm: float = 0.05) -> Floats:
    """Return a path as a polyline that ends where it ends, shape (n, 2)."""
    points = path.contour.flattened_mm(tolerance_mm)
    return np.vstack([points, points[:1]]) if path.contour.closed else points


def _label(job: Job, operation: Operation) -> str:
    return f"{operation.layer} ({len(job.along(operation))})"


def _draw_operation(panel: Panel, job: Job, operation: Operation, spacing_mm: float) -> None:
    lines = [path_points_mm(path) for path in job.along(operation)]
    if not lines:
        return
    colour, thin = OPERATION_COLOURS[operation], operation is Operation.MARK
    ink = Ink(line=colour, width_pt=0.6 if thin else 1.0)
    panel.lines(lines, ink, label=_label(job, operation))
    if thin or not operation.is_machined:
        return
    panel.marks(np.array([line[0] for line in lines]), "o", 3.5, Ink(fill=colour))
    at, along = _arrows(lines, spacing_mm)
    mm_per_pt = (panel.box[2] - panel.box[0]) / panel.width_pt
    # The head of an arrow, its middle on the path.
    shape = np.array([(3.5, 0.0), (-3.5, 2.6), (-2.0, 0.0), (-3.5, -2.6)]) * mm_per_pt
    across = np.column_stack([-along[:, 1], along[:, 0]])
    heads = at[:, None] + shape[:, :1] * along[:, None] + shape[:, 1:] * across[:, None]
    panel.add(Shape(list(heads), Ink(fill=colour), closed=True), 2.5)


def _arrows(lines: Sequence[Floats], spacing_mm: float) -> tuple[Floats, Floats]:
    """Return places along polylines and the directions of travel there, each shape (k, 2)."""
    places, directions = [], []
    for line in lines:
        string = shapely.LineString(line)
        count = max(1, int(string.length / spacing_mm))
        for k in range(count):
            middle = string.length * (k + 0.5) / count
            ends = shapely.line_interpolate_point(string, [middle - 0.05, middle + 0.05])
            before, after = shapely.get_coordinates(ends)
            length = max(float(np.hypot(*(after - before))), 1e-12)
            places.append((before + after) / 2)
            directions.append((after - before) / length)
    return np.array(places), np.array(directions)


def _sheet_title(number: int, count: int, cropped: bool) -> str:  # noqa: FBT001  as a callback
    return f"sheet {number} of {count}{', its lower left' if cropped else ''}"


def _title(job: Job, findings: tuple[Finding, ...], cropped: bool) -> str:  # noqa: FBT001
    order = "numbers give the order, dots the start, arrows the direction"
    if any(len(run_paths(sheet)) > MOST_NUMBERS for sheet in job.sheets or (job,)):
        order = "dots give the start of each path, arrows its direction"
    sheet = "film, in tiles," if job.tiles else "bed"
    bed = f"{sheet} {job.sheet_width_mm:g} x {job.sheet_height_mm:g} mm"
    if len(job.sheets) > 1:
        one = job.sheets[0]
        size = f"{one.sheet_width_mm:g} x {one.sheet_height_mm:g} mm"
        bed = f"{counted(len(job.sheets), 'sheet')}, each on a bed of {size}"
    where = f"lower left of the {bed}" if cropped else bed
    # A separate line: with the name of a design, one line is too long.
    parts = [job.name, f"{order};\n{where}"] if job.sheets else [job.name, order, where]
    blocking = sum(finding.blocks for finding in findings)
    return "; ".join([*parts, f"{blocking} blocking findings"] if blocking else parts)


WEIGHT_COLOURS = {Severity.ERROR: ALERT, Severity.WARNING: "#c46a00", Severity.INFO: "#0b6e8a"}


def findings_plan(outline_mm: Floats, findings: Sequence[Finding]) -> Page:
    """Return the outline with markers, numbered as the findings are.

    Parameters
    ----------
    outline_mm
        Points of the body's outline in the flat layout, shape (n, 2).
    """
    marks = [(f, shapely.from_wkt(f.marker_wkt)) for f in findings if f.marker_wkt]
    everything = np.concatenate([outline_mm, *(shapely.get_coordinates(m) for _, m in marks)])
    low, high = everything.min(axis=0).tolist(), everything.max(axis=0).tolist()
    panel = plan_panel((*low, *high), 504.0)
    body = Ink(fill="#eef2f4", line=ROCK_EDGE, width_pt=0.8)
    panel.add(Shape([outline_mm], body, closed=True), 0.5)
    for finding, mark in marks:
        colour = WEIGHT_COLOURS[finding.severity]
        dot = Ink(fill=colour, fill_alpha=0.6)
        for part in shapely.get_parts(mark).tolist():
            points = shapely.get_coordinates(part)
            if len(points) == 1:
                panel.marks(points, "o", 6.0, dot, rank=4.0)
            else:
                panel.line(points, Ink(line=colour, width_pt=2.2, line_alpha=0.6), rank=4.0)
        panel.explain(finding.severity.value, Marks(np.empty((0, 2)), "o", 6.0, dot))
    # Numbers at one place stand together.
    together: dict[tuple[float, float], list[int]] = {}
    for number, finding in enumerate(findings[:MOST_NUMBERS], start=1):
        if finding.x_mm is not None and finding.y_mm is not None:
            place = (round(finding.x_mm, 0), round(finding.y_mm, 0))
            together.setdefault(place, []).append(number)
    for place, numbers in together.items():
        panel.marks([place], "o", 4.0, Ink(fill=INK), rank=5.0)
        words = ", ".join(map(str, numbers))
        panel.words(place, words, 9.0, bold=True, halo=True, shift_pt=(5.0, 8.0))
    if len(findings) > MOST_NUMBERS:
        panel.title, panel.title_colour = f"the first {MOST_NUMBERS} are numbered", SOFT
    return page_of(panel)


_CUT = Ink(fill=ROCK, fill_alpha=0.45, line=ROCK_EDGE, width_pt=0.7)


def pattern_plan(pattern: Pattern) -> Page:
    """Return the flat outline as cut, next to the shape that it deploys as (simulated).

    The deployed shape is put together from the joints, each of which was simulated alone.
    """
    outline = body_outline(with_short_tail(pattern.flat)).contour.flattened_mm()
    bodies = deployed_capsules(replace(pattern, deployed=with_short_tail(pattern.deployed)))
    begins, ends = (
        shapely.buffer(shapely.points(at_mm), half_mm)
        for at_mm, half_mm in (
            (bodies.start_mm, bodies.half_mm),
            (bodies.end_mm, bodies.end_half_mm),
        )
    )
    tubes = np.asarray(shapely.convex_hull(shapely.union(begins, ends)))
    designed = flat_layout(pattern.design)
    axes = np.stack([designed.start_mm, designed.end_mm], axis=1)
    corners = np.concatenate([outline, axes.reshape(-1, 2), shapely.get_coordinates(tubes)])
    (x0, y0), (x1, y1) = corners.min(axis=0).tolist(), corners.max(axis=0).tolist()
    flat, deployed = (plan_panel((x0, y0, x1, y1), 340.0) for _ in range(2))
    flat.title, deployed.title = "flat, as cut", "deployed (simulated, unverified)"
    flat.add(Shape([outline], _CUT, closed=True))
    levels = designed.tree.level[bodies.branch]
    for level in range(int(levels.max()), 0, -1):
        colour = level_colour(level)
        body = shapely.union_all(tubes[levels == level])
        ink = Ink(fill=colour, fill_alpha=0.3, line=colour)
        deployed.polygons([body], ink, rank=3.0, label=f"level {level}, inflated")
    deployed.lines(list(axes), Ink(line=INK, width_pt=0.9, dash_pt=(4.0, 3.0)), rank=4.0,
                   label="as designed")  # fmt: skip
    # A plan that is wider than high stands above the other one.
    is_wide = x1 - x0 > 1.3 * (y1 - y0)
    return page_of_rows([[flat], [deployed]] if is_wide else [[flat, deployed]])


LONGEST_S = 20.0
"""Longest animation; a longer job is shown faster."""


@dataclass(frozen=True, slots=True, kw_only=True)
class _Bed:
    """A sheet of a job in its animation: the machine runs one after the other."""

    runs: tuple[PathPass, ...]  # in seconds of the whole job
    begins_s: float
    height_mm: float
    left_mm: float  # upper left corner in the picture, y down
    top_mm: float
    title: str  # empty for a job on one sheet

    @property
    def ends_s(self) -> float:
        return self.runs[-1].ends_s if self.runs else self.begins_s

    def placed(self, points: Floats) -> Floats:
        """Return places on the bed, y up, as places in the picture."""
        return np.column_stack(
            [self.left_mm + points[:, 0], self.top_mm + self.height_mm - points[:, 1]]
        )


def _beds_in_rows(job: Job, profile: LaserProfile) -> tuple[_Bed, ...]:
    sheets = job.sheets or (job,)
    room_mm = _title_room_mm(sheets[0])
    beds, now = list[_Bed](), 0.0
    for place, sheet in enumerate(sheets):
        row, column = divmod(place, SHEETS_IN_ROW)
        several = len(sheets) > 1
        beds.append(
            _Bed(
                runs=tuple(
                    replace(run, begins_s=now + run.begins_s) for run in schedule(sheet, profile)
                ),
                begins_s=now,
                height_mm=sheet.sheet_height_mm,
                left_mm=column * (sheet.sheet_width_mm + room_mm),
                top_mm=row * sheet.sheet_height_mm + (row + 1) * room_mm * several,
                title=f"sheet {place + 1} of {len(sheets)}" if several else "",
            )
        )
        now = beds[-1].ends_s
    return tuple(beds)


def _title_room_mm(sheet: Job) -> float:
    """Return the room above a bed and between two."""
    return 0.06 * max(sheet.sheet_width_mm, sheet.sheet_height_mm)


def job_animation(job: Job, profile: LaserProfile) -> bytes:
    """Return an animation, SVG: every path is drawn as the beam runs along it, in true proportion.

    Several sheets lie in rows, and run one after the other. Viewers without animation show them
    finished.
    """
    beds = _beds_in_rows(job, profile)
    total_s = beds[-1].ends_s or 1.0
    film_s = min(LONGEST_S, max(total_s, 1.0))
    pause = 0.06
    scale = (1.0 - pause) / total_s
    one = (job.sheets or (job,))[0]
    wide, high, room_mm = one.sheet_width_mm, one.sheet_height_mm, _title_room_mm(one)
    width, height = max(bed.left_mm for bed in beds) + wide, beds[-1].top_mm + high
    size = max(width, height)
    how = ", as if all tiles lay on one bed" if job.tiles else ""
    how = f", {len(beds)} sheets one after the other" if len(beds) > 1 else how
    title = (
        f"{job.name}: {total_s:.0f} s on the machine, shown {total_s / film_s:.1f} times as fast"
        f"{how}; {GENERATOR}"
    )
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width:g} {height:g}"'
        f' width="{1000 * width / size:.0f}" height="{1000 * height / size:.0f}">',
        f"<title>{escape(title)}</title>",
    ]
    for bed in beds:
        place = f' x="{bed.left_mm:g}" y="{bed.top_mm:g}"' if bed.title else ""
        lines.append(
            f'<rect{place} width="{wide:g}" height="{high:g}" fill="#fbfcfd" stroke="#5c6b73"'
            f' stroke-width="{size / 800:.3g}"/>'
        )
        if bed.title:
            lines.append(
                f'<text x="{bed.left_mm:g}" y="{bed.top_mm - 0.3 * room_mm:.2f}" font-size='
                f'"{0.6 * room_mm:.3g}" font-family="sans-serif" fill="#1d2a30">{bed.title}</text>'
            )
        lines += [_path(run, bed, film_s, scale) for run in bed.runs]
    lines += [_head(beds, film_s, scale), "</svg>"]
    return "\n".join(lines).encode() + b"\n"


def _path(run: PathPass, bed: _Bed, film_s: float, scale: float) -> str:
    points, seconds = _samples(run)
    steps = np.hypot(*np.diff(points, axis=0).T)
    length = float(steps.sum())
    left = length - np.concatenate([[0.0], np.cumsum(steps)])
    # Hidden until its time, then drawn as fast as the head goes, then there until the end.
    times = np.concatenate([[0.0], scale * (run.begins_s + seconds), [1.0]])
    values = np.concatenate([[length], left, [0.0]])
    corners = " ".join(f"{x:.2f},{y:.2f}" for x, y in bed.placed(points).tolist())
    colour = OPERATION_COLOURS[run.path.operation]
    return (
        f'<polyline points="{corners}" fill="none" stroke="{colour}" stroke-width="1.2"'
        f' stroke-dasharray="{length:.2f} {length + 1:.2f}">'
        f"{_animate('stroke-dashoffset', film_s, times, values)}</polyline>"
    )


def _head(beds: Sequence[_Bed], film_s: float, scale: float) -> str:
    if not any(bed.runs for bed in beds):
        return ""
    places, seconds = list[Floats](), list[Floats]()
    for bed in beds:  # from the lower left corner of each
        places.append(bed.placed(np.zeros((1, 2))))
        seconds.append(np.array([bed.begins_s]))
        for run in bed.runs:
            points, times = _samples(run)
            places.append(bed.placed(points))
            seconds.append(run.begins_s + times)
    points, times = np.concatenate(places), scale * np.concatenate(seconds)
    points, times = np.vstack([points, points[-1]]), np.append(times, 1.0)
    moves = "".join(
        _animate(name, film_s, times, values)
        for name, values in (("cx", points[:, 0]), ("cy", points[:, 1]))
    )
    x, y = points[-1]
    return f'<circle cx="{x:.2f}" cy="{y:.2f}" r="4" fill="#1d2a30">{moves}</circle>'


def _samples(run: PathPass) -> tuple[Floats, Floats]:
    """Return points along a path and when the head is there, from the path's start."""
    places, seconds, now = [], [], 0.0
    flatten_mm = 0.1
    for segment, time_s in zip(run.path.contour.segments, run.times_s, strict=True):
        points = segment.flattened_mm(flatten_mm)[:-1]
        places.append(points)
        seconds.append(now + time_s * np.arange(len(points)) / len(points))
        now += time_s
    places.append(np.array([segment.end_mm]))
    seconds.append(np.array([now]))
    return np.concatenate(places), np.concatenate(seconds)


def _animate(attribute: str, film_s: float, times: Floats, values: Floats) -> str:
    """Return an SVG animation; its key times rise from 0 to 1, also after rounding."""
    keys = ";".join(f"{time:.5f}" for time in np.maximum.accumulate(times).tolist())
    steps = ";".join(f"{value:.2f}" for value in values.tolist())
    return (
        f'<animate attributeName="{attribute}" dur="{film_s:.2f}s" repeatCount="indefinite"'
        f' keyTimes="{keys}" values="{steps}"/>'
    )


SEVERITY_SIGNS = {
    Severity.ERROR: "M-6 0A6 6 0 0 1 6 0A6 6 0 0 1 -6 0ZM-2.5 -2.5L2.5 2.5M2.5 -2.5L-2.5 2.5",
    Severity.WARNING: "M0 -7L6.5 4.5H-6.5ZM0 -3V1M0 2.4V3",
    Severity.INFO: "M-5 -5H5V5H-5ZM0 -3V-2.4M0 -0.8V3",
}
"""Shapes that say how serious a finding is, in pixels: circle, triangle and square."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedFinding:
    """A finding on the sheet."""

    at_mm: tuple[float, float] | None  # its place, y up; None for one about the whole robot
    marker: str  # SVG path of the lines that it marks; empty for none


def placed_findings(
    job: Job, layout: FlatLayout, findings: Sequence[Finding]
) -> tuple[PlacedFinding, ...]:
    """Return where findings lie on the sheet of a job."""
    places = SheetPlaces.of(job, layout)
    row = {name: number for number, name in enumerate(layout.tree.ids)}
    placed = []
    for finding in findings:
        branches = [row[name] for name in finding.branches if name in row]
        marker = ""
        for line_mm in places.lines(finding.marker_wkt, branches):
            marker += "M" + "L".join(f"{x:.2f} {-y:.2f}" for x, y in line_mm.tolist())
        at: tuple[float, float] | None = None
        if finding.x_mm is not None and finding.y_mm is not None:
            x, y = places.point((finding.x_mm, finding.y_mm), branches).tolist()
            at = round(x, 2), round(y, 2)
        placed.append(PlacedFinding(at_mm=at, marker=marker))
    return tuple(placed)


def sheet_box_mm(job: Job) -> tuple[float, float, float, float]:
    """Return the box that a picture of the sheet shows: least x and y, greatest x and y.

    Beds are shown whole, so that it can be seen how much film is left.
    """
    boxes = [path.contour.box_mm for path in job.paths]
    boxes.append((0.0, 0.0, job.sheet_width_mm, job.sheet_height_mm))
    for tile in job.tiles:
        x, y = _window_mm(tile)
        boxes.append((x, y, x + tile.sheet_width_mm, y + tile.sheet_height_mm))
    sides = np.array(boxes)
    (x0, y0), (x1, y1) = sides[:, :2].min(axis=0).tolist(), sides[:, 2:].max(axis=0).tolist()
    view_rim_mm = 12.0
    return x0 - view_rim_mm, y0 - view_rim_mm, x1 + view_rim_mm, y1 + view_rim_mm


def beds_svg(job: Job) -> str:
    """Return the beds alone, as `sheet_svg` draws them."""
    return "".join(_beds(job))


def sheet_svg(
    job: Job, findings: Sequence[Finding] = (), placed: Sequence[PlacedFinding] = ()
) -> str:
    """Return a sheet as the content of an SVG element.

    Parameters
    ----------
    findings, placed
        What is marked, and where. A marker is ``g.finding`` with its number as ``data-finding``.
    """
    signs = (
        _sign(number, finding, place)
        for number, (finding, place) in enumerate(zip(findings, placed, strict=True))
    )
    return "".join((*_beds(job), *_paths(job), *signs))


def _window_mm(tile: Job) -> tuple[float, float]:
    """Return where the bed lies on the film when a tile is cut."""
    return float(str(tile.facts["window_x_mm"])), float(str(tile.facts["window_y_mm"]))


def _beds(job: Job) -> Iterator[str]:
    """Yield every bed with its number; of a robot in tiles the film too."""
    if job.tiles:
        yield _bed("film", (0.0, 0.0), job)
        for number, tile in enumerate(job.tiles, start=1):
            yield _bed("bed", _window_mm(tile), tile, f"tile {number} of {len(job.tiles)}")
        return
    sheets = job.sheets or (job,)
    for number, sheet in enumerate(sheets, start=1):
        title = f"sheet {number} of {len(sheets)}" if len(sheets) > 1 else ""
        yield _bed("bed", ((number - 1) * sheet.sheet_width_mm, 0.0), sheet, title)


def _bed(kind: str, low_mm: tuple[float, float], sheet: Job, title: str = "") -> str:
    (x, y), wide, high = low_mm, sheet.sheet_width_mm, sheet.sheet_height_mm
    top = -y - high
    box = f'<rect class="{kind}" x="{x:.2f}" y="{top:.2f}" width="{wide:.2f}" height="{high:.2f}"/>'
    at = f"translate({x:.2f} {top:.2f})"
    return box + (f'<g transform="{at}"><text class="bed-title">{title}</text></g>' * bool(title))


def _paths(job: Job) -> Iterator[str]:
    """Yield one path for each operation and piece, in process order."""
    pieces = {piece_name(job.name, one.label): one.label for one in job.pieces}
    groups: dict[tuple[Operation, str], list[LaserPath]] = {}
    for operation in Operation:
        for path in job.along(operation):
            groups.setdefault((operation, pieces.get(path.of, "")), []).append(path)
    for (operation, piece), paths in groups.items():
        drawn = "".join(contour_path(path.contour) for path in paths)
        # What is open encloses nothing that could be filled.
        kind = operation if all(path.contour.closed for path in paths) else f"{operation} open"
        yield f'<path class="{kind}" data-piece="{piece}" d="{drawn}"/>'


def _sign(number: int, finding: Finding, placed: PlacedFinding) -> str:
    """Return the marker of a finding, empty for one without a place."""
    if placed.at_mm is None and not placed.marker:
        return ""
    words = escape(f"{finding.severity}, {finding.rule}: {finding.message}")
    kind = f"{finding.severity}{' waived' if finding.waived else ''}"
    parts = [
        f'<g class="finding {kind}" data-finding="{number}" tabindex="0" role="button"',
        f' aria-label="{words}">',
    ]
    if placed.marker:
        parts.append(f'<path class="marked" d="{placed.marker}"/>')
    if placed.at_mm is not None:
        x, y = placed.at_mm
        sign = f'<path class="sign" d="{SEVERITY_SIGNS[finding.severity]}"/>'
        parts.append(f'<g transform="translate({x:g} {-y:g})">{sign}</g>')
    return "".join((*parts, "</g>"))
