import dataclasses
import math

import numpy as np
import pytest
import shapely
from shapely import LineString, Polygon

from vinefab.core.errors import BadInputError
from vinefab.fabrication.job.laser_job import laser_job
from vinefab.fabrication.job.passes import (
    WEB_MM,
    body_paths,
    closed_cut,
    closes,
    cut_offset_mm,
    in_order,
    weld_offset_mm,
)
from vinefab.fabrication.job.placement import SheetOptions
from vinefab.model.design import Collar, Pouch
from vinefab.model.job import LaserPath, Operation
from vinefab.model.outline import Contour, Part
from vinefab.outline.body_outline import body_outline


@pytest.fixture
def tree(make_plan, make_fan):
    return make_plan((40.0, 20.0), levels=[make_fan(3, 110, 120)], tail=200.0)


@pytest.fixture
def sealing(profile):
    """The profile with a weld of 3 mm, and marks."""
    cut = profile.settings("cut")
    wide = cut.seam_width_mm.changed(value=3.0)
    operations = {
        **profile.recipe.by_operation,
        "weld": cut.changed(seam_width_mm=wide, kerf_mm=wide.changed(value=0.0)),
        "mark": cut,
    }
    return dataclasses.replace(profile, recipe=profile.recipe.changed(operations=operations))


def test_weld_runs_in_the_middle_of_the_seam_and_the_cut_around_it(tree, sealing):
    weld, cut = body_paths(tree, sealing, separate=True).paths
    assert weld_offset_mm(sealing) == 1.5
    assert weld.contour.length_mm == pytest.approx(body_outline(tree, 1.5).contour.length_mm)
    assert not weld.contour.closed
    seam = LineString(weld.contour.flattened_mm(1e-4))
    around = LineString(cut.contour.flattened_mm(1e-4))
    # Half the seam, the web and half the kerf, but for the mouth, where both reach the edge.
    probes = shapely.points(shapely.get_coordinates(shapely.segmentize(around, 1.0)))
    probes = probes[shapely.get_x(probes) > -200.0 + 5.0]
    away = shapely.distance(probes, seam)
    assert np.abs(away - (1.5 + WEB_MM + 0.1)).max() < 1e-3


@pytest.mark.parametrize("pouch", [None, Pouch(shape="round", radius_mm=16.0)])
@pytest.mark.parametrize(("left_mm", "rounded"), [(0.3, False), (0.0, False), (0.6, True)])
def test_concave_cuts_too_sharp_for_an_arc_are_corners(
    make_plan, make_fan, sealing, pouch, left_mm, rounded
):
    fillet = cut_offset_mm(sealing) + left_mm
    levels = [make_fan(3, 110, 120)]
    design = make_plan((40.0, 20.0), (fillet,), levels, tail=200.0, pouch=pouch)
    paths = body_paths(design, sealing, separate=True)
    weld, cut = paths.paths
    assert paths.outline.problems == ()
    assert (Part.FILLET in [part.part for part in cut.contour.segments]) is rounded
    assert min(part.radius_mm for part in cut.contour.segments) >= 0.5
    # The seam keeps its fillets, and the web all but what a corner takes of it.
    seam = [part.radius_mm for part in weld.contour.segments if part.part is Part.FILLET]
    assert seam == pytest.approx([fillet - 1.5] * len(seam))
    assert seam
    probes = shapely.points(cut.contour.flattened_mm(1e-3))
    probes = probes[shapely.get_x(probes) > -200.0 + 5.0]
    away = shapely.distance(probes, LineString(weld.contour.flattened_mm(1e-3))).min()
    assert away >= 1.5 + WEB_MM + 0.1 - 0.3 - 1e-3


def test_cut_around_is_closed_starts_on_the_tail_and_runs_past_its_start(tree, sealing):
    cut = body_paths(tree, sealing, separate=True).paths[1].contour
    assert closes(cut)
    assert not closes(body_outline(tree).contour)
    start, end = cut.points_mm[0], cut.points_mm[-1]
    assert math.dist(start, end) == pytest.approx(2.0)
    # 10 mm and more from the mouth, from crotches and from tips.
    assert -190.0 < start[0] < -10.0
    assert cut.parts[0] is cut.parts[-1] is Part.TAIL
    assert cut.parts.count(Part.MOUTH) == 1
    pieces = Polygon(cut.flattened_mm()[:-1])
    assert cut.signed_area_mm2 == pytest.approx(pieces.area, rel=1e-4)


def test_overcut_never_leaves_the_straight_that_it_starts_on(make_plan, sealing):
    outline = body_outline(make_plan((40.0,), tail=6.0)).contour
    cut = closed_cut(outline, 500.0)
    assert closes(cut)
    bare = closed_cut(outline, 0.0).points_mm
    assert bare[-1] == pytest.approx(bare[0])
    # A collar takes all of the tail and more: found by VF-B02, and drawn all the same.
    wide = Collar(clamp_diameter_mm=100.0, length_mm=0.0, flare_mm=100.0)
    vine = make_plan((20.0,), trunk=100.0, tail=0.0, collar=wide)
    assert closes(body_paths(vine, sealing, separate=True).paths[1].contour)


def test_the_process_is_the_recipes_by_default(tree, profile, sealing):
    def operations(job):
        return [op for op in (Operation.WELD, Operation.WELDCUT, Operation.CUT) if job.along(op)]

    assert operations(laser_job(tree, sealing)) == [Operation.WELDCUT, Operation.CUT]
    apart = laser_job(tree, sealing, SheetOptions(process="weld+cut"))
    assert operations(apart) == [Operation.WELD, Operation.CUT]
    assert (apart.facts["weld_offset_mm"], apart.facts["web_mm"]) == (1.5, WEB_MM)
    with pytest.raises(BadInputError, match="weld"):
        laser_job(tree, profile, SheetOptions(process="weld+cut"))
    with pytest.raises(BadInputError, match="auto or weldcut"):
        SheetOptions(process="burn")


def test_fold_line_lies_where_the_trunk_begins(make_plan, sealing):
    job = laser_job(make_plan((40.0,), trunk=200.0, tail=200.0), sealing)
    ticks = [path.contour for path in job.paths if path.label.startswith("fold")]
    (weldcut,) = job.along(Operation.WELDCUT)
    mouth = weldcut.contour.points_mm[[0, -1]].mean(axis=0)
    line = LineString([ticks[0].points_mm[1], ticks[1].points_mm[1]])
    assert line.distance(shapely.Point(mouth)) == pytest.approx(200.0)


def square(low, high, operation=Operation.CUT):
    corners = np.array([[low, low], [high, low], [high, high], [low, high]], dtype=float)
    return LaserPath(operation=operation, contour=Contour.polyline(corners, closed=True))


def test_what_lies_inside_is_cut_first():
    paths = [square(0, 90), square(20, 30), square(10, 80), square(0, 1, Operation.MARK)]
    found = in_order(paths)
    assert [path.contour.box_mm[2] for path in found] == [1.0, 30.0, 80.0, 90.0]
