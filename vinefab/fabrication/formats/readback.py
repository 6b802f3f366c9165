"""Compare a written laser file, read back, with its job: the same way for every format.

A point that is off by more than the format's tolerance, a missing or added path, a wrong layer,
order, colour, unit, sheet or machine setting is a problem.
"""

import math
from collections.abc import Iterator, Mapping
from functools import lru_cache
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from vinefab.core.errors import VinefabError
from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats
from vinefab.fabrication.formats.laser_drawing import (
    DrawnPath,
    LaserFileSpec,
    LaserFormat,
    ReadDrawing,
    StyledPath,
)
from vinefab.model.outline import Contour, following


def file_problems(
    laser_format: LaserFormat, data: bytes | None, spec: LaserFileSpec
) -> tuple[str, ...]:
    """Read a file back and return what is wrong with it.

    Parameters
    ----------
    data
        Content of the file; None for a file that is missing.

    Returns
    -------
    tuple of str
        One sentence per difference; empty for a file that agrees with its spec.
    """
    if data is None:
        return ("the file is missing",)
    try:
        drawing = laser_format.read(data.decode("utf-8"))
    except (VinefabError, UnicodeDecodeError) as error:
        return (str(error),)
    return drawing_differences(laser_format, drawing, spec)


def drawing_differences(
    laser_format: LaserFormat, drawing: ReadDrawing, spec: LaserFileSpec
) -> tuple[str, ...]:
    """Return every difference between a file as read and its spec.

    Compared are the unit, the sheet, the layers and their order, colours, machine settings, and
    path by path: closed or open, number of vertices and arcs, every vertex and the middle of every
    segment against the form that the format can hold; box, area and length against the job itself.
    """
    problems = [f"the file holds {oddity}" for oddity in drawing.oddities]
    problems.extend(_setting_problems(drawing.settings, laser_format.settings(spec)))
    expected = laser_format.paths(spec)
    problems.extend(_frame_problems(laser_format, drawing, spec, expected))
    for layer in dict.fromkeys(styled.style.layer for styled in expected):
        in_job = [styled for styled in expected if styled.style.layer == layer]
        in_file = [path for path in drawing.paths if path.layer == layer]
        if len(in_job) != len(in_file):
            problems.append(f"layer {layer}: {counted(len(in_file), 'path')}, not {len(in_job)}")
            continue
        for number, (styled, path) in enumerate(zip(in_job, in_file, strict=True), start=1):
            found = _path_problems(laser_format, styled, path)
            problems.extend(f"layer {layer}, path {number}: {problem}" for problem in found)
    return tuple(problems)


def _setting_problems(
    found: Mapping[str, Mapping[str, str]], expected: Mapping[str, Mapping[str, str]]
) -> Iterator[str]:
    if list(found) != list(expected):
        yield f"the settings are for {', '.join(found)}, not {', '.join(expected)}"
    for layer, values in expected.items():
        for name, value in values.items():
            read = found.get(layer, {}).get(name)
            if read != value:
                yield f"layer {layer}: {name} is {read}, not {value}"


def _frame_problems(
    laser_format: LaserFormat,
    drawing: ReadDrawing,
    spec: LaserFileSpec,
    expected: tuple[StyledPath, ...],
) -> Iterator[str]:
    if drawing.unit != "mm":
        yield f"the unit is {drawing.unit}, not mm"
    sheet, near_mm = (spec.job.sheet_width_mm, spec.job.sheet_height_mm), laser_format.tolerance_mm
    if drawing.sheet and not np.allclose(drawing.sheet, sheet, rtol=0.0, atol=near_mm):
        yield f"the sheet is {_listed(drawing.sheet)}, not {_listed(sheet)}"
    if not expected:
        yield "there is nothing to draw: the job has no path that this preset writes"
    in_job = list(dict.fromkeys(styled.style.layer for styled in expected))
    in_file = [path.layer for path in drawing.paths]
    in_file = [layer for layer, after in pairwise([*in_file, None]) if layer and layer != after]
    if in_file != in_job:
        yield f"the layers are {', '.join(in_file)}, not {', '.join(in_job)}"
    if drawing.layer_colours is None:
        return
    for styled in {styled.style.layer: styled for styled in expected}.values():
        layer, colour = styled.style.layer, laser_format.colour(styled.style)
        if drawing.layer_colours.get(layer) != colour:
            yield f"layer {layer} has colour {drawing.layer_colours.get(layer)}, not {colour}"


def _path_problems(laser_format: LaserFormat, styled: StyledPath, path: DrawnPath) -> Iterator[str]:
    model, read, tolerance_mm = styled.path.contour, path.contour, laser_format.tolerance_mm
    colour = laser_format.colour(styled.style)
    if path.colour != colour:
        yield f"colour {path.colour}, not {colour}"
    if read.closed != model.closed:
        yield f"{_ends(read)}, not {_ends(model)}"
    expected = laser_format.contour(model)
    if read.arc_count != expected.arc_count:
        yield f"{counted(read.arc_count, 'arc')}, not {expected.arc_count}"
    if len(read.points_mm) != len(expected.points_mm):
        yield f"{len(read.points_mm)} vertices, not {len(expected.points_mm)}"
    elif read.closed == expected.closed:
        away_mm = float(np.abs(_probes_mm(read) - _probes_mm(expected)).max())
        if away_mm > tolerance_mm:
            yield f"a point is {away_mm:.4g} mm away from where it should be"
    yield from _size_problems(read, model, tolerance_mm, laser_format.sagitta_mm)


def _size_problems(
    read: Contour, model: Contour, tolerance_mm: float, sagitta_mm: float
) -> Iterator[str]:
    """Compare box, area and length with the job's.

    A point that is off by the tolerance moves an area by at most the tolerance along the whole
    path, and a segment's length by at most twice the tolerance (vertices that split a long arc
    count too). Chords are shorter than their arc by a third of the sagitta per radian.
    """
    near_mm, wanted, box_mm = tolerance_mm + sagitta_mm, _sizes(model), read.box_mm
    # NaN is near no number.
    if not all(abs(a - b) <= near_mm for a, b in zip(box_mm, wanted.box_mm, strict=True)):
        yield f"the box is {_listed(box_mm)}, not {_listed(wanted.box_mm)}"
    area_mm2, length_mm = read.signed_area_mm2, read.length_mm
    if abs(area_mm2 - wanted.area_mm2) > near_mm * wanted.length_mm:
        yield f"the area is {area_mm2:.3f} mm2, not {wanted.area_mm2:.3f} mm2"
    slack_mm = 2.0 * tolerance_mm * (len(model) + wanted.turn_rad)
    slack_mm += 0.5 * sagitta_mm * wanted.turn_rad
    if abs(length_mm - wanted.length_mm) > slack_mm:
        yield f"the length is {length_mm:.4f} mm, not {wanted.length_mm:.4f} mm"


class _Sizes(NamedTuple):
    """What the files of a contour are compared with."""

    box_mm: tuple[float, float, float, float]
    area_mm2: float
    length_mm: float
    turn_rad: float  # of all its arcs together


@lru_cache(maxsize=4096)
def _sizes(contour: Contour) -> _Sizes:
    """Return the sizes of one contour of a job, which every format asks for."""
    return _Sizes(
        box_mm=contour.box_mm,
        area_mm2=contour.signed_area_mm2,
        length_mm=contour.length_mm,
        turn_rad=math.fsum(abs(segment.turn_rad) for segment in contour.segments),
    )


def _probes_mm(contour: Contour) -> Floats:
    """Return the vertices and the middle of every segment, on the arc where it is one."""
    start = contour.points_mm
    end = following(start)
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
