"""Sheets that leave the bed to be sealed by hand, and come back onto their pins."""

import math
from dataclasses import replace

import numpy as np
import pytest
import shapely

from vinefab.fabrication.job.laser_job import laser_job
from vinefab.fabrication.job.passes import GUIDE, WEB_MM
from vinefab.fabrication.job.tiling import HOLES, LEAST_APART_MM, PIN_HOLE, TARGET
from vinefab.fabrication.package.prepare import prepare
from vinefab.fabrication.rules.catalog import run_checks
from vinefab.fabrication.rules.rule import Subject
from vinefab.model.design import Build, Design
from vinefab.model.job import Operation
from vinefab.model.laser import read_profile

RECIPES = ("co2_60w__stretchlon_800", "co2_60w__tpu_nylon_70d")
LASER = "co2_60w__stretchlon_200"


def marks(job, label):
    found = [path for path in job.along(Operation.MARK) if path.label.startswith(label)]
    return [shapely.LineString(path.contour.flattened_mm(0.01)) for path in found]


@pytest.mark.parametrize("recipe", RECIPES)
def test_holes_and_crosses_put_a_sheet_back_one_way_only(recipe):
    profile = read_profile(recipe)
    job = laser_job(Design.read("three_level_tree"), profile)
    holes, crosses = marks(job, PIN_HOLE), marks(job, TARGET)
    assert (len(holes), len(crosses), len(job.along(Operation.REG))) == (3, 4, 4)
    diameter_mm = profile.settings(Operation.WELD).pin_mm.value
    kerf_mm = profile.settings(Operation.CUT).kerf_mm.value
    for hole in holes:
        x0, _, x1, _ = hole.bounds
        assert x1 - x0 == pytest.approx(diameter_mm - kerf_mm, abs=0.01)
    body = shapely.Polygon(job.along(Operation.CUT)[0].contour.flattened_mm())
    assert min(shapely.distance(body, one) for one in (*holes, *crosses)) > 3.0
    middles = [np.array(hole.centroid.coords[0]) for hole in holes]
    sides = [math.dist(middles[one], middles[one - 1]) for one in range(3)]
    assert min(sides) > LEAST_APART_MM
    # No two sides alike: neither turned nor turned over does the sheet go onto its pins.
    assert min(abs(sides[one] - sides[one - 1]) for one in range(3)) > 5.0
    layers = {path.variant: path.settings for path in job.paths if path.variant}
    assert layers == {HOLES: profile.settings(Operation.CUT)}


@pytest.mark.parametrize("recipe", RECIPES)
def test_the_guide_lies_on_the_cut_and_is_open_where_the_seam_is(recipe):
    profile = read_profile(recipe)
    job = laser_job(Design.read("three_level_tree"), profile)
    (guide,), (cut,) = marks(job, GUIDE), job.along(Operation.CUT)
    edge = shapely.LineString(cut.contour.flattened_mm(0.001)).buffer(0.02)
    assert edge.covers(guide)
    (seam,) = job.along(Operation.WELD)
    inside_mm = shapely.distance(shapely.LineString(seam.contour.flattened_mm(0.01)), guide)
    settings, kerf_mm = profile.settings(Operation.WELD), cut.settings_in(profile).kerf_mm.value
    assert inside_mm == pytest.approx(settings.seam_width_mm.value / 2 + WEB_MM + kerf_mm / 2, 1e-2)
    ends = math.dist(guide.coords[0], guide.coords[-1])
    assert ends == pytest.approx(40.0 + 2 * _reach(profile))


def _reach(profile):
    seam, kerf = profile.settings(Operation.WELD), profile.settings(Operation.CUT)
    return seam.seam_width_mm.value + WEB_MM + kerf.kerf_mm.value / 2.0


def test_every_file_of_a_sheet_sealed_by_hand_is_read_back_with_its_holes():
    prepared = prepare(Design.read("plain_vine"), read_profile(RECIPES[0]))
    assert not any(prepared.readback.values())
    assert prepared.report.blocking == ()
    for name, data in prepared.laser.items():
        has_holes = name.split(".")[0] in ("outline", "outline_polyline") or "_holes" in name
        assert (b"VF_10_MARK_holes" in data) == has_holes, name


def test_a_sheet_that_cannot_be_put_back_is_found():
    profile = read_profile(RECIPES[0])
    subject = Subject.of(Design.read("plain_vine"), profile)
    paths = [path for path in subject.job.paths if path.label != PIN_HOLE]
    without = replace(subject, job=replace(subject.job, paths=tuple(paths)))
    (finding,) = run_checks(without, only=("VF-L01",)).findings
    assert finding.title == "no pin holes to put the sheet back by"
    assert run_checks(subject, only=("VF-L01",)).findings == ()


def test_a_robot_in_tiles_is_aligned_by_its_crosses_and_keeps_its_guide():
    vine = Design(name="long", trunk_length_mm=1300.0, build=Build.standard(1))
    prepared = prepare(vine, read_profile(RECIPES[0]))
    assert prepared.report.blocking == ()
    *tiles, mouth = prepared.job.tiles
    assert len(tiles) == 2
    assert {path.operation for path in mouth.paths} == {Operation.CUT, Operation.REG}
    for tile in tiles:
        assert marks(tile, GUIDE)
        assert not marks(tile, PIN_HOLE)
