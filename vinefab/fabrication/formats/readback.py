"""Is a written file what was meant? Compare what it says, read again, with the job."""

import math
from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from vinefab.core.validation import Floats
from vinefab.fabrication.formats import dxf_format as dxf
from vinefab.fabrication.formats import svg_format as svg
from vinefab.fabrication.formats.laser_drawing import (
    DEFAULT,
    Colours,
    DrawnPath,
    Format,
    ReadDrawing,
    StyledPath,
    styled_paths,
)
from vinefab.model.job import Job
from vinefab.model.outline import FLATTEN_MM, Contour

DXF_TOLERANCE_MM = 1e-6
SVG_TOLERANCE_MM = 2e-3
"""Three decimals: 0.0007 mm at a vertex, twice that in the middle of an arc."""

TOLERANCES_MM = {
    Format.DXF: DXF_TOLERANCE_MM,
    Format.SVG: SVG_TOLERANCE_MM,
    Format.LIGHTBURN: 1e-4,  # four decimals
}


def drawing_differences(
    job: Job,
    drawing: ReadDrawing,
    colours: Colours = DEFAULT,
    *,
    polyline: bool = False,
    tolerance_mm: float | None = None,
) -> tuple[str, ...]:
    """Return everything in which a file differs from the job, in words.

    Compared are the unit, the sheet, the layers and their order, colours, and path by path:
    closed or open, number of vertices and arcs, every vertex and the middle of every segment
    against the form that the format can hold; box, area and length against the job itself.
    """
    tolerance = _own_tolerance_mm(drawing) if tolerance_mm is None else tolerance_mm
    meant = styled_paths(job, colours)
    problems = [f"the file holds {oddity}" for oddity in drawing.oddities]
    problems.extend(_frame_problems(job, drawing, meant, tolerance))
    layers = list(dict.fromkeys(styled.style.layer for styled in meant))
    for layer in layers:
        mine = [styled for styled in meant if styled.style.layer == layer]
        theirs = [path for path in drawing.paths if path.layer == layer]
        if len(mine) != len(theirs):
            problems.append(f"layer {layer}: {len(theirs)} paths, not {len(mine)}")
            continue
        for number, (styled, path) in enumerate(zip(mine, theirs, strict=True), start=1):
            found = _path_problems(styled, path, drawing.format, polyline=polyline, tol=tolerance)
            problems.extend(f"layer {layer}, path {number}: {problem}" for problem in found)
    return tuple(problems)


def _own_tolerance_mm(drawing: ReadDrawing) -> float:
    return TOLERANCES_MM[drawing.format]


def _frame_problems(
    job: Job, drawing: ReadDrawing, meant: tuple[StyledPath, ...], tolerance_mm: float
) -> Iterator[str]:
    if drawing.unit != "mm":
        yield f"the unit is {drawing.unit}, not mm"
    sheet = job.sheet_width_mm, job.sheet_height_mm
    if drawing.sheet and not np.allclose(drawing.sheet, sheet, rtol=0.0, atol=tolerance_mm):
        yield f"the sheet is {_listed(drawing.sheet)}, not {_listed(sheet)}"
    if not meant:
        yield "there is nothing to draw: the job has no path that this preset writes"
    in_job = list(dict.fromkeys(styled.style.layer for styled in meant))
    in_file = [path.layer for path in drawing.paths]
    in_file = [layer for layer, after in pairwise([*in_file, None]) if layer and layer != after]
    if in_file != in_job:
        yield f"the layers are {', '.join(in_file)}, not {', '.join(in_job)}"
    for styled in {styled.style.layer: styled for styled in meant}.values():
        colour = drawing.layer_colours.get(styled.style.layer)
        if drawing.format is Format.DXF and colour != str(styled.style.aci):
            yield f"layer {styled.style.layer} has colour {colour}, not {styled.style.aci}"


def _path_problems(
    styled: StyledPath, path: DrawnPath, form: Format, *, polyline: bool, tol: float
) -> Iterator[str]:
    model, read = styled.path.contour, path.contour
    colour = str(styled.style.aci) if form is Format.DXF else styled.style.rgb
    if path.colour != colour:
        yield f"colour {path.colour}, not {colour}"
    if read.closed != model.closed:
        yield f"{_ends(read)}, not {_ends(model)}"
    yield from _vertex_problems(read, _written(model, form, polyline=polyline), tol)
    yield from _size_problems(read, model, tol, FLATTEN_MM if polyline else 0.0)


def _vertex_problems(read: Contour, written: Contour, tol: float) -> Iterator[str]:
    if read.arc_count != written.arc_count:
        yield f"{read.arc_count} arcs, not {written.arc_count}"
    if len(read.points_mm) != len(written.points_mm):
        yield f"{len(read.points_mm)} vertices, not {len(written.points_mm)}"
    elif read.closed == written.closed:
        away = float(np.abs(_probes_mm(read) - _probes_mm(written)).max())
        if away > tol:
            yield f"a point is {away:.4g} mm away from where it should be"


def _size_problems(read: Contour, model: Contour, tol: float, sagitta: float) -> Iterator[str]:
    """Compare box, area and length with the job's.

    A point that is off by the tolerance moves an area by at most the tolerance along the whole
    path, and a segment's length by at most twice the tolerance (vertices that split a long arc
    count too). Chords are shorter than their arc by a third of the sagitta per radian.
    """
    if not np.allclose(read.box_mm, model.box_mm, rtol=0.0, atol=tol + sagitta):
        yield f"the box is {_listed(read.box_mm)}, not {_listed(model.box_mm)}"
    area = read.signed_area_mm2, model.signed_area_mm2
    if abs(area[0] - area[1]) > (tol + sagitta) * model.length_mm:
        yield f"the area is {area[0]:.3f} mm2, not {area[1]:.3f} mm2"
    length = read.length_mm, model.length_mm
    turn = math.fsum(abs(segment.turn_rad) for segment in model.segments)
    if abs(length[0] - length[1]) > 2.0 * tol * (len(model) + turn) + 0.5 * sagitta * turn:
        yield f"the length is {length[0]:.4f} mm, not {length[1]:.4f} mm"


def _written(contour: Contour, form: Format, *, polyline: bool) -> Contour:
    if form is Format.SVG:
        return svg.svg_contour(contour)
    return dxf.dxf_contour(contour, polyline=polyline)


def _probes_mm(contour: Contour) -> Floats:
    """Return the vertices and the middle of every segment, on the arc where it is one."""
    start = contour.points_mm
    end = np.roll(start, -1, axis=0)
    if not contour.closed:
        start, end = start[:-1], end[:-1]
    chord = end - start
    right = np.column_stack([chord[:, 1], -chord[:, 0]])
    middle = (start + end) / 2 + right * contour.bulges[:, np.newaxis] / 2
    return np.concatenate([contour.points_mm, middle])


def _ends(contour: Contour) -> str:
    return "closed" if contour.closed else "open"


def _listed(values: tuple[float, ...]) -> str:
    return " x ".join(f"{value:.4f}" for value in values)
