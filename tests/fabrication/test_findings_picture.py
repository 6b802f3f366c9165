from dataclasses import replace
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
import shapely

from tests.fabrication.rules.conftest import make_design
from tests.pages.drawn import placed_texts, texts_of
from vinefab.fabrication.findings_picture import (
    MOST_LISTED,
    MOST_MARKED,
    SEVERITY_COLOURS,
    FindingsPage,
    annotated_job,
    findings_picture,
    listed,
)
from vinefab.fabrication.job.placement import LayoutPlacement
from vinefab.fabrication.rules.catalog import run_checks
from vinefab.fabrication.rules.rule import Subject
from vinefab.model.finding import CheckReport, Finding, Severity
from vinefab.model.job import Operation
from vinefab.model.laser import read_profile
from vinefab.pages.page_files import page_png, page_svg
from vinefab.pages.panel import rgb

CALM = CheckReport(design="any", recipe="any", run=(), skipped=(), findings=())

HOSTILE = "cost $\\foo$ <script>&amp; %s\x07 \u202e 樹 " * 40


DESIGNS = {
    "plain": make_design(),
    "tapered": make_design((3, 200.0, 120.0), taper=(0.7, 0.8)),
    "forty": make_design((3, 220.0, 150.0), (3, 160.0, 70.0), (3, 90.0, 40.0)),
    "overlaps": make_design((3, 60.0, 30.0), (3, 60.0, 200.0), tail_mm=100.0),
    "short tail": make_design((2, 200.0, 60.0), tail_mm=100.0),
    "heap": make_design((5, 200.0, 300.0), (5, 200.0, 300.0), (3, 200.0, 200.0)),
    # It has to be turned to fit the bed, so that a forgotten placement shows.
    "turned": make_design((2, 300.0, 100.0), (2, 250.0, 90.0), trunk_mm=350.0),
}


@pytest.fixture(scope="module")
def recipe():
    return read_profile("co2_60w__stretchlon_200")


@cache
def checked(name):
    """A design with its job, and what the rules find."""
    subject = Subject.of(DESIGNS[name], read_profile("co2_60w__stretchlon_200"))
    return subject, run_checks(subject)


def _scattered(count):
    """Return a report with findings of three rules all over the place, some of them on a point."""
    rng = np.random.default_rng(5)
    places = rng.uniform((-150.0, -60.0), (400.0, 60.0), (count, 2)).round(1)
    places[: count // 4] = places[:1]
    found = tuple(
        Finding(
            rule=f"VF-X{row % 3:02d}",
            severity=list(Severity)[row % 3],
            message="too close: move it away " * 20,
            measured=1.0 + row,
            limit=3.0,
            unit="mm",
            branches=("0.0.1", "0.0.2", "0.1", "0.2"),
            x_mm=float(x),
            y_mm=float(y),
        )
        for row, (x, y) in enumerate(places.tolist())
    )
    return replace(CALM, findings=found)


def _signs(tag):
    (x, y) = tag.at_pt
    return shapely.box(x - 4.0, y - 4.0, x + 4.0, y + 4.0)


def _assert_apart(page):
    """Check that no tag, marker or leader lies on another, and all lie in the panel."""
    boxes = [shapely.box(*tag.box_pt) for tag in page.tags]
    signs = [_signs(tag) for tag in page.tags]
    ways = [
        shapely.shortest_line(shapely.Point(tag.at_pt), box)
        for tag, box in zip(page.tags, boxes, strict=True)
    ]
    panel = shapely.box(*page.view.box_pt)
    assert all(panel.covers(box) for box in boxes)
    for a in range(len(boxes)):
        for b in range(len(boxes)):
            assert not boxes[a].intersects(signs[b])
            if a != b:
                assert not boxes[a].intersects(boxes[b])
                assert not signs[a].intersects(signs[b])
                assert not ways[a].intersects(boxes[b])
                assert not ways[a].intersects(signs[b])


def _numbers(page):
    """Return all numbers that stand at a place in the picture."""
    found: set[int] = set()
    for text in (tag.text.split(" (")[0] for tag in page.tags):
        for run in text.split(", "):
            first, _, last = run.partition("-")
            found |= set(range(int(first), int(last or first) + 1))
    return found


@pytest.mark.parametrize("name", ["plain", "tapered", "forty", "overlaps"])
def test_every_finding_with_a_place_is_numbered_there(name, recipe):
    _, report = checked(name)
    page = FindingsPage.of(DESIGNS[name], recipe, report)
    _assert_apart(page)
    placed = {line.number for line in page.lines if any(f.x_mm is not None for f in line.findings)}
    assert _numbers(page) == placed


@pytest.mark.parametrize("count", [1, MOST_LISTED, 250])
def test_many_findings_are_grouped_and_none_is_lost(count, recipe):
    report = _scattered(count)
    page = FindingsPage.of(DESIGNS["plain"], recipe, report)
    _assert_apart(page)
    assert sum(len(line.findings) for line in page.lines) == count
    assert _numbers(page) == {line.number for line in page.lines}
    assert len(page.lines) == (count if count <= MOST_LISTED else 3)


@pytest.mark.parametrize(("count", "hostile"), [(0, False), (12, True), (200, True)])
def test_no_text_lies_on_another_or_beyond_the_page(count, hostile, recipe):
    design, report = DESIGNS["forty"], _scattered(count)
    if hostile:
        design = design.changed(name="W" * 100)
        found = tuple(
            replace(f, message=HOSTILE, branches=(HOSTILE,) * 3, rule="MINE-" + "X" * 90)
            for f in report.findings
        )
        report = replace(report, findings=found)
    drawn = findings_picture(design, recipe, report)
    texts = placed_texts(drawn)
    page = shapely.box(0.0, 0.0, drawn.width_pt, drawn.height_pt)
    boxes = [box for _, box in texts]
    assert all(page.contains(box) for box in boxes)
    tree = shapely.STRtree(boxes)
    pairs = [(texts[a][0], texts[b][0]) for a, b in tree.query(boxes, "intersects").T if a < b]
    assert pairs == []
    assert page_svg(drawn).count(b"<script") == 0


def test_errors_come_first_and_waived_findings_are_only_counted(recipe):
    report = _scattered(9)
    waived = tuple(
        replace(f, waived=f.severity is Severity.ERROR, reason="known") for f in report.findings
    )
    assert [line.severity for line in listed(report.findings)][:4] == [Severity.ERROR] * 3 + [
        Severity.WARNING
    ]
    assert len(listed(waived)) == 6
    picture = findings_picture(DESIGNS["plain"], recipe, replace(report, findings=waived))
    assert any("3 waived" in text for text in texts_of(picture))


def test_the_robot_is_large_and_true_to_scale(recipe):
    design = DESIGNS["plain"]
    page = FindingsPage.of(design, recipe, CALM)
    x0, y0, x1, y1 = page.view.geometry(page.robot.lumen).bounds
    assert x1 - x0 > 0.8 * 792.0
    assert y1 - y0 == pytest.approx(design.build.widths_mm[0] * page.view.pt_per_mm)


def test_severities_differ_in_lightness():
    # Rec. 709 luminance of linear light, which every kind of colour vision sees.
    shades = sorted(
        float(np.array([0.2126, 0.7152, 0.0722]) @ (np.array(rgb(colour)) / 255.0) ** 2.2)
        for colour in SEVERITY_COLOURS.values()
    )
    assert all(dark * 1.3 < light for dark, light in pairwise(shades))


def test_a_clean_design_says_so(recipe):
    drawn = findings_picture(DESIGNS["plain"], recipe, CALM)
    words = texts_of(drawn)
    assert "No findings: nothing to mark." in words
    # No rule speaks against it, and yet nobody has burst a seam of this recipe.
    assert "no rule forbids it; recipe unverified" in words
    assert page_png(drawn).startswith(b"\x89PNG")
    (subject, report) = checked("short tail")
    waived = [replace(finding, waived=True, reason="known") for finding in report.findings]
    drawing = annotated_job(subject.job, waived)
    assert "legend: no findings" in {path.label for path in drawing.paths}


def test_a_drawing_for_dxf_lies_where_the_outline_lies():
    subject, _ = checked("turned")
    placed = LayoutPlacement.of(subject.job.transform)
    assert placed.angle_rad != 0.0
    (outline,) = subject.job.along(Operation.WELDCUT)
    drawn = shapely.LineString(outline.contour.flattened_mm())
    bare = shapely.LineString(placed.on_sheet(subject.outline.contour.flattened_mm()))
    assert shapely.hausdorff_distance(drawn, bare) == pytest.approx(0.55, abs=0.1)


def test_an_error_is_circled_where_it_is_in_a_drawing_for_dxf():
    subject, report = checked("short tail")
    (error,) = report.blocking
    at = LayoutPlacement.of(subject.job.transform).on_sheet(np.array([[error.x_mm, error.y_mm]]))[0]
    drawing = annotated_job(subject.job, report.findings).along(Operation.DOC)
    (circle,) = (path.contour for path in drawing if (path.contour.bulges == 1.0).all())
    assert circle.points_mm.mean(axis=0) == pytest.approx(at)
    labels = {path.label for path in drawing}
    assert {"1 B01", "legend: 1 error VF-B01 0: 100 mm at least 150 mm"} <= labels


@pytest.mark.parametrize("name", ["overlaps", pytest.param("heap", marks=pytest.mark.thorough)])
def test_a_drawing_for_dxf_is_never_cut_and_lies_on_its_sheet(name):
    subject, report = checked(name)
    drawing = annotated_job(subject.job, report.findings)
    assert {path.operation for path in drawing.paths} == {Operation.REG, Operation.DOC}
    more = f"legend: and {len(report.findings) - MOST_MARKED} more that are not drawn"
    assert (more in {path.label for path in drawing.paths}) == (len(report.findings) > MOST_MARKED)
    boxes = np.array([path.contour.box_mm for path in drawing.paths])
    assert (boxes[:, :2] >= -1e-9).all()
    assert boxes[:, 2].max() <= drawing.sheet_width_mm
    assert boxes[:, 3].max() <= drawing.sheet_height_mm


def test_labels_of_a_drawing_for_dxf_lie_apart():
    subject, report = checked("overlaps")
    by_label, boxes = {}, []
    for path in annotated_job(subject.job, report.findings).along(Operation.DOC):
        if path.label[0].isdigit():
            by_label.setdefault(path.label, []).append(path.contour)
    for contours in by_label.values():
        (sign,) = (index for index, one in enumerate(contours) if one.closed)
        strokes = np.array([one.box_mm for one in contours[sign + 2 :]])  # after a leader
        boxes.append(shapely.box(*strokes[:, :2].min(axis=0), *strokes[:, 2:].max(axis=0)))
    assert len(boxes) > 8
    pairs = shapely.STRtree(boxes).query(boxes, "intersects").T
    assert sum(a < b for a, b in pairs) <= len(boxes) // 10
