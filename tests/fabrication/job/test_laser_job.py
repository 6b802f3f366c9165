import math

import numpy as np
import pytest
from shapely import LineString, Polygon

from vinefab.fabrication.job.laser_job import laser_job
from vinefab.fabrication.job.passes import weldcut_offset_mm
from vinefab.model.job import Operation
from vinefab.model.outline import Part
from vinefab.outline.body_outline import body_outline


@pytest.fixture
def tree(make_plan, make_fan):
    return make_plan((40.0, 20.0), levels=[make_fan(3, 110, 120)], tail=200.0)


def test_a_job_is_the_offset_outline_then_the_mouth_cut(tree, profile):
    assert weldcut_offset_mm(profile) == pytest.approx(0.4 + 0.3 / 2)
    job = laser_job(tree, profile)
    weldcut, cut = job.paths
    assert (weldcut.operation, cut.operation) == (Operation.WELDCUT, Operation.CUT)
    outline = body_outline(tree, 0.55).contour
    assert weldcut.contour.length_mm == pytest.approx(outline.length_mm)
    assert np.array_equal(weldcut.contour.bulges, outline.bulges)
    assert cut.contour.parts == (Part.MOUTH,)
    assert (job.sheet_width_mm, job.sheet_height_mm) == (600.0, 400.0)
    boxes = np.array([path.contour.box_mm for path in job.paths])
    assert boxes[:, :2].min(axis=0) == pytest.approx([10.0, 10.0])
    assert (boxes[:, 2:] <= [590.0, 390.0]).all()
    # The cut crosses both ends of the outline by the overcut.
    assert cut.contour.length_mm == pytest.approx(41.1 + 2 * 2.0)
    for end in weldcut.contour.points_mm[[0, -1]]:
        reached = [math.dist(end, point) for point in cut.contour.points_mm]
        assert min(reached) == pytest.approx(2.0)
        assert sum(reached) == pytest.approx(cut.contour.length_mm)


def test_two_cuts_free_the_part_and_leave_the_sheet_in_one_piece(tree, profile):
    weldcut, cut = (path.contour for path in laser_job(tree, profile).paths)
    beam = LineString(weldcut.flattened_mm()).union(LineString(cut.points_mm)).buffer(0.1)
    sheet = Polygon([(0, 0), (600, 0), (600, 400), (0, 400)])
    pieces = sorted(piece.area for piece in sheet.difference(beam).geoms)
    assert len(pieces) == 2
    assert pieces[0] == pytest.approx(weldcut.signed_area_mm2, rel=0.01)


def test_a_long_vine_is_rotated_and_one_too_long_is_reported(make_plan, profile):
    turned = laser_job(make_plan((40.0,), trunk=360.0, tail=240.0), profile)
    assert turned.facts["fits_bed"] is True
    assert 0.0 < abs(turned.facts["rotation_deg"]) < 40.0
    long = laser_job(make_plan((40.0,), trunk=2000.0), profile)
    assert long.facts["fits_bed"] is False
    assert long.facts["box_width_mm"] > long.facts["usable_width_mm"]


def test_facts_record_offsets_recipe_mouth_and_problems(tree, make_plan, make_fan, profile):
    facts = laser_job(tree, profile).facts
    assert facts["weldcut_offset_mm"] == pytest.approx(0.55)
    assert (facts["weldcut_seam_mm"], facts["weldcut_kerf_mm"]) == (0.4, 0.3)
    assert (facts["recipe"], facts["recipe_status"]) == ("bed__film", "unverified")
    assert (facts["mouth_lumen_mm"], facts["mouth_gap_mm"]) == (40.0, pytest.approx(41.1))
    assert facts["outline_problems"] == []
    wide = make_plan((40.0, 40.0), levels=[make_fan(2, 150, 80)])
    assert len(laser_job(wide, profile).facts["outline_problems"]) == 1
