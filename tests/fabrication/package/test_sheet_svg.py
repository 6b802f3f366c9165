"""The sheet as SVG: every path by operation and piece, findings where they are on the sheet."""

from xml.etree import ElementTree

import numpy as np
import pytest
import shapely

from tests.fabrication.pieces.test_partition import CROSSED, PROFILE
from tests.fabrication.rules.conftest import make_design
from vinefab.fabrication.checking import checked_design
from vinefab.fabrication.job.placement import SheetPlaces
from vinefab.fabrication.package.sheet_pictures import (
    SEVERITY_SIGNS,
    placed_findings,
    sheet_box_mm,
    sheet_svg,
)
from vinefab.fabrication.rules.rule import mark_branches
from vinefab.model.finding import Finding, Severity
from vinefab.model.job import Operation


@pytest.fixture(scope="module")
def in_pieces():
    return checked_design(CROSSED, PROFILE)


def drawn(job, *of):
    return ElementTree.fromstring(f"<svg>{sheet_svg(job, *of)}</svg>")  # noqa: S314  our own


def body_on_sheet(job, label):
    """What the sealed paths of a piece enclose."""
    paths = [path for path in job.along(Operation.WELDCUT) if path.of.endswith(f"piece {label}")]
    return shapely.Polygon(np.concatenate([path.contour.flattened_mm() for path in paths]))


def test_there_is_one_path_for_each_operation_and_piece(in_pieces):
    job = in_pieces[0].job
    found = [(p.get("class").split()[0], p.get("data-piece")) for p in drawn(job).iter("path")]
    wanted = {(str(path.operation), path.of.rpartition("piece ")[2]) for path in job.paths}
    assert len(found) == len(set(found))
    # The label of the tail is the robot's.
    assert set(found) == {(op, "" if of == job.name else of) for op, of in wanted}
    labels = {piece.label for piece in in_pieces[0].partition.pieces}
    assert {label for _, label in found if label} == labels


def test_a_place_on_a_branch_lies_on_the_piece_that_the_branch_is_on(in_pieces):
    subject, _ = in_pieces
    layout, job = subject.layout, subject.job
    places = SheetPlaces.of(job, layout)
    for piece in subject.partition.pieces:
        body = body_on_sheet(job, piece.label).buffer(1.0)
        for branch in piece.branches:
            # Beyond the middle of a branch that is cut is its outer piece.
            at = 0.1 * layout.start_mm[branch] + 0.9 * layout.end_mm[branch]
            assert body.contains(shapely.Point(places.point(tuple(at), [branch])))


def test_a_marked_branch_lies_on_its_piece_whatever_branches_the_finding_names(in_pieces):
    subject, _ = in_pieces
    places = SheetPlaces.of(subject.job, subject.layout)
    for piece in subject.partition.pieces:
        body = body_on_sheet(subject.job, piece.label).buffer(1.0)
        for branch in set(piece.branches) - {piece.root}:
            (line,) = places.lines(mark_branches(subject.layout, [branch]), [0])
            assert body.contains(shapely.LineString(line))


def test_a_branch_that_is_cut_is_marked_on_both_of_its_pieces(in_pieces):
    subject, _ = in_pieces
    (sleeve, *_) = subject.partition.sleeves
    marker = mark_branches(subject.layout, [sleeve.branch])
    inner, outer = SheetPlaces.of(subject.job, subject.layout).lines(marker, [sleeve.branch])
    for line, label in ((inner, sleeve.inner), (outer, sleeve.label)):
        assert body_on_sheet(subject.job, label).buffer(1.0).contains(shapely.LineString(line))
    whole_mm = float(subject.layout.tree.length_mm[sleeve.branch])
    lengths = [float(shapely.LineString(line).length) for line in (inner, outer)]
    assert sum(lengths) == pytest.approx(whole_mm, abs=0.01)


def test_a_finding_stands_on_the_outline_of_a_robot_that_is_turned_on_its_bed():
    turned = make_design((2, 300.0, 100.0), (2, 250.0, 90.0), trunk_mm=350.0)
    subject, _ = checked_design(turned, PROFILE)
    assert abs(float(subject.job.facts["rotation_deg"])) > 1.0
    end = subject.layout.end_mm[-1].tolist()
    finding = Finding(
        rule="VF-W01", severity=Severity.ERROR, message="a < b", x_mm=end[0], y_mm=end[1],
        branches=(subject.names[-1],), waived=True,
    )  # fmt: skip
    placed = placed_findings(subject.job, subject.layout, [finding])
    (outline,) = subject.job.along(Operation.WELDCUT)
    x, y = placed[0].at_mm
    assert shapely.Polygon(outline.contour.flattened_mm()).contains(shapely.Point(x, y))
    (group,) = (g for g in drawn(subject.job, [finding], placed).iter("g") if g.get("data-finding"))
    assert group.get("class") == "finding error waived"
    assert group.get("aria-label") == "error, VF-W01: a < b"
    assert group.find("g").get("transform") == f"translate({x:g} {-y:g})"
    x0, y0, x1, y1 = sheet_box_mm(subject.job)
    assert x0 < x < x1
    assert y0 < y < y1


def test_signs_tell_severities_apart_without_colour():
    assert len({SEVERITY_SIGNS[severity].split("Z")[0] for severity in Severity}) == len(Severity)
