"""A picture of a laser job: operations, directions, order, and how much of the bed it takes."""

from collections.abc import Sequence

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure

from vinefab.model.checked import Floats
from vinefab.model.finding import Finding
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.report.colours import SOFT
from vinefab.report.drawing import fill
from vinefab.report.figure import house_style, plan_axes
from vinefab.report.view import Box

OPERATION_COLOURS = {
    Operation.MARK: "#000000",
    Operation.WELD: "#0000FF",
    Operation.WELDCUT: "#FF00FF",
    Operation.CUT: "#FF0000",
    Operation.REG: "#F36926",
    Operation.DOC: "#0C96D9",
}

MOST_NUMBERS = 60
"""Where more paths than this would be numbered, none is."""

_CROPPED = 0.6
_RIM_MM = 15.0


def job_plan(job: Job, findings: tuple[Finding, ...] = ()) -> Figure:
    """Return a plan of the sheet: every path in its operation's colour, with arrows and order.

    Where the paths take a small part of the bed, that part is shown and the title says so. Marks
    have neither arrows nor numbers: they come first, and how they are drawn matters to nobody.

    Parameters
    ----------
    job
        The sheet.
    findings
        Not used for placing anything; listed in the title when some block the export.
    """
    with house_style():
        box, cropped = _view(job)
        figure, axes = plan_axes(box, 9.0)
        bed = shapely.box(0.0, 0.0, job.sheet_width_mm, job.sheet_height_mm)
        fill(axes, [bed.intersection(shapely.box(*box))], face="#fbfcfd", edge=SOFT)
        for operation in Operation:
            _draw_operation(axes, job.along(operation), _length_mm(box) / 16.0)
        _draw_order(axes, job)
        axes.set_title(_title(job, findings, cropped=cropped), fontsize=9)
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=8)
    return figure


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


def _view(job: Job) -> tuple[Box, bool]:
    """Return the part of the bed to show, and whether it is only a part."""
    bed = (0.0, 0.0, job.sheet_width_mm, job.sheet_height_mm)
    if not job.paths:
        return bed, False
    boxes = np.array([path.contour.box_mm for path in job.paths])
    low, high = boxes[:, :2].min(axis=0) - _RIM_MM, boxes[:, 2:].max(axis=0) + _RIM_MM
    used = (float(low[0]), float(low[1]), float(high[0]), float(high[1]))
    if (used[2] - used[0]) * (used[3] - used[1]) > _CROPPED * bed[2] * bed[3]:
        return (min(used[0], 0.0), min(used[1], 0.0), max(used[2], bed[2]), max(used[3], bed[3])), (
            False
        )
    return used, True


def _length_mm(box: Box) -> float:
    return max(box[2] - box[0], box[3] - box[1])


def _draw_operation(axes: Axes, paths: Sequence[LaserPath], spacing_mm: float) -> None:
    if not paths:
        return
    operation, lines = paths[0].operation, [path_points_mm(path) for path in paths]
    colour, thin = OPERATION_COLOURS[operation], operation is Operation.MARK
    label = f"{operation.layer} ({len(paths)})"
    width = 0.6 if thin else 1.0
    axes.add_collection(LineCollection(lines, colors=colour, linewidths=width, label=label))
    if thin or not operation.is_machined:
        return
    starts = np.array([line[0] for line in lines])
    axes.plot(starts[:, 0], starts[:, 1], "o", color=colour, markersize=3.5)
    at, along = _arrows(lines, spacing_mm)
    axes.quiver(
        *(*at.T, *along.T),
        color=colour,
        pivot="mid",
        angles="xy",
        scale=60.0,
        width=0.0018,
        headwidth=6.0,
        headlength=7.0,
        headaxislength=6.0,
        minlength=0.0,
    )


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


def _draw_order(axes: Axes, job: Job) -> None:
    paths = run_paths(job)
    if len(paths) > MOST_NUMBERS:
        return
    for number, path in enumerate(paths, start=1):
        axes.annotate(
            str(number),
            path.contour.points_mm[0].tolist(),
            fontsize=7.5,
            color=OPERATION_COLOURS[path.operation],
            xytext=(4, 3),
            textcoords="offset points",
        )


def _title(job: Job, findings: tuple[Finding, ...], *, cropped: bool) -> str:
    order = "numbers give the order, dots the start, arrows the direction"
    if len(run_paths(job)) > MOST_NUMBERS:
        order = "dots give the start of each path, arrows its direction"
    sheet = "film, in tiles," if job.tiles else "bed"
    bed = f"{sheet} {job.sheet_width_mm:g} x {job.sheet_height_mm:g} mm"
    parts = [job.name, order, f"lower left of the {bed}" if cropped else bed]
    blocking = sum(finding.blocks for finding in findings)
    return "; ".join([*parts, f"{blocking} blocking findings"] if blocking else parts)
