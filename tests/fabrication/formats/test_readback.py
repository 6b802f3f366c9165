import math
import re
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from vinefab.core.errors import UnreadableFileError
from vinefab.fabrication.formats.dxf_format import DXF, DXF_POLYLINE, dxf_text, read_dxf
from vinefab.fabrication.formats.laser_drawing import (
    LaserFileSpec,
    LaserFormat,
    drawing_differences,
    file_problems,
)
from vinefab.fabrication.formats.svg_format import (
    SVG,
    SVG_TOLERANCE_MM,
    read_commands,
    read_svg,
    svg_contour,
    svg_text,
)
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.outline import Contour, Part

RIGHT = ()


def problems_of(laser_format: LaserFormat, text: str, job: Job) -> tuple[str, ...]:
    return file_problems(laser_format, text.encode(), LaserFileSpec(job=job))


@st.composite
def contours(draw: st.DrawFn) -> Contour:
    """Lines and arcs of 0.001 to 340 degrees, these between points at least 0.2 mm apart."""
    count = draw(st.integers(2, 12))
    x = draw(st.lists(st.floats(-50, 1500), min_size=count, max_size=count))
    y = draw(st.lists(st.floats(-50, 1500), min_size=count, max_size=count))
    spread = np.column_stack([x, y]) + 0.2 * np.arange(count)[:, np.newaxis]
    arcs = st.one_of(st.floats(-340, -1e-3), st.floats(1e-3, 340), st.floats(170, 185))
    turns = st.one_of(st.just(0.0), arcs)
    closed = draw(st.booleans())
    segments = count if closed else count - 1
    bulges = [math.tan(math.radians(draw(turns)) / 4) for _ in range(segments)]
    ends = np.roll(spread, -1, axis=0)
    far = np.hypot(*(ends - spread).T)[:segments] > 0.2
    bulges = np.where(far, bulges, 0.0)
    return Contour(
        points_mm=spread,
        bulges=bulges,
        parts=(Part.OTHER,) * segments,
        branches=("",) * segments,
        closed=closed,
    )


def sheet_of(contour: Contour) -> Job:
    path = LaserPath(operation=Operation.WELDCUT, contour=contour)
    return Job(name="random", sheet_width_mm=1600, sheet_height_mm=1234.5678, paths=(path,))


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(contours())
def test_dxf_holds_any_contour_exactly(contour: Contour) -> None:
    job = sheet_of(contour)
    drawing = read_dxf(dxf_text(job))
    (path,) = drawing.paths
    assert np.array_equal(path.contour.points_mm, contour.points_mm)
    assert np.array_equal(path.contour.bulges, contour.bulges)
    assert path.contour.closed is contour.closed
    exact = replace(DXF, tolerance_mm=1e-9)
    assert drawing_differences(exact, drawing, LaserFileSpec(job=job)) == RIGHT
    assert problems_of(DXF_POLYLINE, dxf_text(job, polyline=True), job) == RIGHT


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(contours())
def test_svg_holds_any_contour_to_two_thousandths_of_a_millimetre(contour: Contour) -> None:
    job = sheet_of(contour)
    drawing, drawn = read_svg(svg_text(job)), svg_contour(contour)
    (path,) = drawing.paths
    assert drawing_differences(SVG, drawing, LaserFileSpec(job=job)) == RIGHT
    # Arcs are split, and no shape is changed by that.
    assert np.allclose(drawn.box_mm, contour.box_mm, atol=1e-3)
    assert drawn.length_mm == pytest.approx(contour.length_mm, rel=1e-6)
    assert np.abs(drawn.bulges).max() <= math.tan(math.pi / 8) + 1e-9
    # Every point of an arc as read, not only its middle, lies on the circle of the model.
    for read, meant in zip(path.contour.segments, drawn.segments, strict=True):
        if meant.bulge:
            away = np.linalg.norm(read.flattened_mm(0.001) - meant.center_mm, axis=1)
            assert np.abs(away - meant.radius_mm).max() <= SVG_TOLERANCE_MM


def swapped(old: str, new: str) -> Callable[[str], str]:
    def change(text: str) -> str:
        assert old in text
        return text.replace(old, new)

    return change


def first_path_gone(text: str) -> str:
    return re.sub(r"<path[^>]*/>", "", text, count=1)


SVG_DAMAGE = [
    (swapped('width="150.000mm"', 'width="150.000"'), "unit"),
    (swapped('width="150.000mm"', 'width="150.000in"'), "unit"),
    (swapped("0 0 150.000 80.000", "0 0 150.000 81.000"), "unit"),
    (swapped("0 0 150.000 80.000", "0 0 300.000 160.000"), "unit"),
    (swapped("80.000", "81.000"), "sheet"),
    (first_path_gone, "VF_10_MARK: 0 paths, not 1"),
    (swapped('label="VF_20_WELD"', 'label="VF_21_WELD"'), "layers"),
    (swapped("#FF00FF", "#FF00FE"), "colour #FF00FE, not #FF00FF"),
    (swapped('stroke="#FF00FF"', 'stroke="#FF0000"'), "style"),
    (swapped('fill="none"', 'fill="#FFFFFF"'), "filled"),
    (swapped(" Z", ""), "open, not closed"),
    (swapped("20.000 20.000 0 0 0", "20.000 20.000 0 0 1"), "area"),
    (swapped("20.000 20.000 0 0 0", "20.000 20.000 0 1 0"), "point"),
    (swapped("20.000 20.000 0 0 0", "20.010 20.010 0 0 0"), "point"),
    (swapped("A 20.000 20.000 0 0 0", "L"), "0 arcs, not 2"),
    (swapped("10.000 60.000 L", "10.000 60.004 L"), "point"),
    (swapped("L 145.000 5.000 L 5.000 5.000", "L 5.000 5.000 L 145.000 5.000"), "area"),
    (swapped('<g id="layer_VF_40_CUT"', '<g transform="scale(2)" id="x"'), "transform"),
    (swapped("</defs>", "</defs><text>x</text>"), "text outside"),
]


@pytest.mark.parametrize(("damage", "word"), SVG_DAMAGE)
def test_a_damaged_svg_is_found_out(damage: Callable[[str], str], word: str, job: Job) -> None:
    assert word in "; ".join(problems_of(SVG, damage(svg_text(job)), job))


DXF_DAMAGE = [
    (swapped("$INSUNITS\n 70\n4", "$INSUNITS\n 70\n6"), "unit"),
    (swapped("$INSUNITS\n 70\n4", "$INSUNITS\n 70\n1"), "unit"),
    (swapped("$MEASUREMENT\n 70\n1", "$MEASUREMENT\n 70\n0"), "unit"),
    (swapped("130.0\n 20\n40.0", "130.0\n 20\n40.01"), "point"),
    (swapped(" 42\n0.41421356237309503", " 42\n0.0"), "arcs"),
    (swapped(" 42\n0.41421356237309503", " 42\n-0.41421356237309503"), "area"),
    (swapped(" 42\n0.41421356237309503", " 42\n0.4143"), "point"),
    (swapped("  8\nVF_40_CUT", "  8\nVF_50_CUT"), "layers"),
    (swapped("  8\nVF_40_CUT\n 62\n1", "  8\nVF_40_CUT\n 62\n5"), "colour 5, not 1"),
    (swapped("VF_40_CUT\n 70\n0\n 62\n1", "VF_40_CUT\n 70\n0\n 62\n3"), "has colour 3, not 1"),
    (swapped(" 90\n4\n 70\n1", " 90\n4\n 70\n0"), "open, not closed"),
]


@pytest.mark.parametrize(("damage", "word"), DXF_DAMAGE)
def test_a_damaged_dxf_is_found_out(damage: Callable[[str], str], word: str, job: Job) -> None:
    assert word in "; ".join(problems_of(DXF, damage(dxf_text(job)), job))


def test_another_entity_in_the_dxf_is_found_out(job: Job) -> None:
    text = "  0\nLINE\n  5\nFFFF\n  8\n0\n 10\n0.0\n 20\n0.0\n 11\n1.0\n 21\n1.0\n"
    head, tail = dxf_text(job).split("  2\nENTITIES\n")
    damaged = f"{head}  2\nENTITIES\n{text}{tail}"
    assert "1 entity of kind LINE" in "; ".join(problems_of(DXF, damaged, job))


def test_a_flattened_file_is_not_taken_for_the_exact_one(job: Job) -> None:
    problems = problems_of(DXF, dxf_text(job, polyline=True), job)
    assert any("arcs" in problem for problem in problems)
    assert any("vertices" in problem for problem in problems)


def test_a_job_with_nothing_to_draw_is_not_right() -> None:
    empty = Job(name="empty", sheet_width_mm=10, sheet_height_mm=10, paths=())
    assert "nothing to draw" in "; ".join(problems_of(SVG, svg_text(empty), empty))
    assert "nothing to draw" in "; ".join(problems_of(DXF, dxf_text(empty), empty))


@pytest.mark.parametrize(
    "text",
    [
        "",
        "no xml",
        "<svg",
        "<svg xmlns='http://www.w3.org/2000/svg'/>",
        "<!DOCTYPE svg [<!ENTITY a 'aaaa'>]><svg width='1mm' height='1mm'>&a;</svg>",
    ],
)
def test_what_is_no_svg_of_ours_is_refused(text: str) -> None:
    with pytest.raises(UnreadableFileError, match="not an SVG file of ours"):
        read_svg(text)


@pytest.mark.parametrize(
    "commands",
    [
        "",
        "M 1.0 2.0",
        "L 1.0 2.0",
        "M 1.0 2.0 l 1.0 1.0",
        "M 1.0 2.0 L 1.0",
        "M 1.0 2.0 L 1.0 nan",
        "M 1.0 2.0 L 1.0 1e3",
        "M 1.0 2.0 A 1.0 2.0 0 0 0 3.0 3.0",
        "M 1.0 2.0 A 1.0 1.0 0 0 2 3.0 3.0",
        "M 1.0 2.0 L 3.0 3.0 Z L 4.0 4.0",
        "M 1.0 2.0 L 3.0 3.0 M 4.0 4.0 L 5.0 5.0",
        "M 1.0 2.0 C 3.0 3.0 4.0 4.0 5.0 5.0",
    ],
)
def test_path_commands_that_are_never_written_are_refused(commands: str) -> None:
    with pytest.raises(ValueError, match="allowed"):
        read_commands(commands, 10.0)


def test_a_radius_too_small_is_read_as_the_standard_says() -> None:
    contour = read_commands("M 0.000 0.000 A 1.000 1.000 0 0 1 4.000 0.000", 0.0)
    assert contour.bulges.tolist() == pytest.approx([-1.0])


@pytest.mark.parametrize("text", ["", "no dxf", "0\nSECTION\n2\nENTITIES\n0\n"])
def test_what_is_no_dxf_is_refused(text: str) -> None:
    with pytest.raises(UnreadableFileError, match="not a DXF file of ours"):
        read_dxf(text)


def test_numbers_that_are_not_finite_are_refused(job: Job) -> None:
    with pytest.raises(UnreadableFileError, match="finite"):
        read_dxf(dxf_text(job).replace("130.0\n 20\n40.0", "130.0\n 20\nnan"))
