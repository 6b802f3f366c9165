import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
import shapely

from vinefab.fabrication.findings_picture import MOST_MARKED, annotated_job
from vinefab.fabrication.job.placement import LayoutPlacement
from vinefab.fabrication.rules.catalog import run_checks
from vinefab.fabrication.rules.rule import Subject
from vinefab.model.design import Design
from vinefab.model.job import Operation
from vinefab.model.outline import Contour

Make = Callable[..., Design]


def test_markers_lie_where_the_outline_lies(make, profile):
    # It has to be turned to fit the bed, so that a forgotten placement shows.
    subject = Subject.of(make((2, 300.0, 100.0), (2, 250.0, 90.0), trunk_mm=350.0), profile)
    assert subject.job is not None
    placed = LayoutPlacement.of(subject.job.facts)
    assert placed.angle_rad != 0.0
    (outline,) = subject.job.along(Operation.WELDCUT)
    drawn = shapely.LineString(outline.contour.flattened_mm())
    bare = shapely.LineString(placed.on_sheet(subject.outline.contour.flattened_mm()))
    assert shapely.hausdorff_distance(drawn, bare) == pytest.approx(0.55, abs=0.1)


def test_nothing_in_it_is_ever_cut(make, profile):
    subject = Subject.of(make((2, 100.0, 60.0), (2, 100.0, 120.0), tail_mm=100.0), profile)
    report = run_checks(subject)
    drawing = annotated_job(subject.job, report.findings)
    assert {path.operation for path in drawing.paths} == {Operation.REG, Operation.DOC}
    assert not any(path.operation.is_machined for path in drawing.paths)
    boxes = np.array([path.contour.box_mm for path in drawing.paths])
    assert (boxes[:, :2] >= -1e-9).all()
    assert boxes[:, 2].max() <= drawing.sheet_width_mm
    assert boxes[:, 3].max() <= drawing.sheet_height_mm


def test_an_error_is_circled_where_it_is(make, profile):
    subject = Subject.of(make((2, 200.0, 60.0), tail_mm=100.0), profile)
    report = run_checks(subject)
    (error,) = report.blocking
    at = LayoutPlacement.of(subject.job.facts).on_sheet(np.array([[error.x_mm, error.y_mm]]))[0]
    drawing = annotated_job(subject.job, report.findings)
    circles = [
        path.contour for path in drawing.along(Operation.DOC) if (path.contour.bulges == 1.0).all()
    ]
    (circle,) = circles
    assert circle.points_mm.mean(axis=0) == pytest.approx(at)
    labels = {path.label for path in drawing.along(Operation.DOC)}
    assert "1 B01" in labels
    assert "legend: 1 error VF-B01 0: 100 mm at least 150 mm" in labels


def test_labels_do_not_lie_on_each_other(make, profile):
    subject = Subject.of(make((3, 60.0, 30.0), (3, 60.0, 200.0), tail_mm=100.0), profile)
    drawing = annotated_job(subject.job, run_checks(subject).findings)
    by_label: dict[str, list[Contour]] = {}
    for path in drawing.along(Operation.DOC):
        if path.label[0].isdigit():
            by_label.setdefault(path.label, []).append(path.contour)
    boxes = []
    for contours in by_label.values():
        (sign,) = (index for index, one in enumerate(contours) if one.closed)
        strokes = np.array([one.box_mm for one in contours[sign + 2 :]])  # a leader comes between
        boxes.append([*strokes[:, :2].min(axis=0), *strokes[:, 2:].max(axis=0)])
    areas = shapely.box(*np.array(boxes).T)
    assert len(areas) > 8
    met = sum(areas[a].intersects(areas[b]) for a in range(len(areas)) for b in range(a))
    assert met <= len(areas) // 10


def test_only_the_most_severe_findings_are_drawn_and_the_rest_is_counted(make, profile):
    heap = Subject.of(make((5, 200.0, 300.0), (5, 200.0, 300.0), (3, 200.0, 200.0)), profile)
    findings = run_checks(heap).findings
    assert len(findings) > MOST_MARKED
    labels = {path.label for path in annotated_job(heap.job, findings).paths}
    assert f"legend: and {len(findings) - MOST_MARKED} more that are not drawn" in labels


def test_the_drawing_of_a_clean_design_says_so_and_omits_waived_findings(make, profile):
    subject = Subject.of(make((2, 200.0, 60.0), tail_mm=100.0), profile)
    waived = tuple(replace(f, waived=True, reason="known") for f in run_checks(subject).findings)
    labels = [path.label for path in annotated_job(subject.job, waived).along(Operation.DOC)]
    assert "legend: no findings" in labels
    assert math.isfinite(LayoutPlacement.of(subject.job.facts).dx_mm)
