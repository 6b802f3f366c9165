"""The rig as a job: what it refuses, and what the rules report of it."""

import json
import math
from xml.etree import ElementTree as Tree

import numpy as np
import pytest
from shapely import MultiPolygon, Polygon, box
from shapely.affinity import translate

from vinefab.core.errors import BadInputError
from vinefab.model.design import Design
from vinefab.model.map import Map, Pose, Start
from vinefab.pages.panel import Shape
from vinefab.rig import build
from vinefab.rig import make as module
from vinefab.rig.fixtures import with_fixtures
from vinefab.rig.make import RigRequest, make_rig
from vinefab.rig.part import Printer, RigOptions
from vinefab.rig.rig_plan import plan_of

PRINTER = Printer(name="bench", bed_width_mm=220, bed_depth_mm=220, height_mm=100)
START = Start(pose=Pose(x_mm=90.0, y_mm=10.0, heading_rad=math.pi / 2))
BARE = RigRequest(pictures=False)
PLATE = RigOptions(style="plate")


def _map(*obstacles, bounds=None):
    return Map(
        name="table", bounds=bounds or box(0, 0, 180, 150), obstacles=obstacles, starts=(START,)
    )


def test_a_map_without_obstacles_is_refused_unless_wanted():
    with pytest.raises(BadInputError, match=r"no obstacle is in its bounds.*--allow-empty"):
        make_rig(_map(), PRINTER, PLATE, BARE)
    with pytest.raises(BadInputError, match="no obstacle is in its bounds"):
        make_rig(_map(box(500, 0, 510, 10)), PRINTER, PLATE, BARE)
    assert make_rig(_map(), PRINTER, PLATE, RigRequest(allow_empty=True, pictures=False)).files


def test_bounds_with_a_corner_to_go_around_are_enough():
    hall = box(0, 0, 180, 150) - box(60, 60, 180, 150)
    assert make_rig(_map(bounds=hall), PRINTER, PLATE, BARE).files


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (RigOptions(scale=13.0), r"a plate of .* needs \d+ parts, and 100 are allowed"),
        (RigOptions(height_mm=98.0), "height_mm is 98"),
    ],
)
def test_what_cannot_be_printed_is_refused_before_anything_is_built(monkeypatch, options, words):
    for user in (module, build):
        monkeypatch.setattr(user, "plan_of", lambda *_: pytest.fail("a plan was made"))
    monkeypatch.setattr(module, "part_files", lambda *_: pytest.fail("files were made"))
    with pytest.raises(BadInputError, match=words):
        make_rig(_map(box(30, 60, 60, 90)), PRINTER, options, BARE)


def test_a_rig_is_fitted_to_a_size():
    world = _map(box(30, 60, 60, 90))
    options = RigOptions(style="plate", border_mm=5.0).fitted(world, 100.0)
    made = make_rig(world, PRINTER, options, BARE)
    assert options.scale == 0.5
    assert made.rig.parts[0].size_mm == pytest.approx((100.0, 85.0, 33.0))
    with pytest.raises(BadInputError, match="--fit-mm is 10"):
        RigOptions(border_mm=5.0).fitted(world, 10.0)


def test_corridors_and_heights_are_compared_with_the_robot():
    # 20 mm between the blocks; the trunk of plain_vine inflates to 25.5 mm, 30.6 mm with 1.2.
    world = _map(box(30, 60, 80, 100), box(100, 60, 150, 100))
    design = Design.read("plain_vine")
    made = make_rig(world, PRINTER, PLATE, RigRequest(design=design, pictures=False))
    checks = json.loads(made.files["rig.json"])["checks"]
    assert [run["id"] for run in checks["rules_run"]] == ["VF-R01", "VF-R02", "VF-R03", "VF-R04"]
    found = {finding["id"]: finding for finding in checks["findings"]}
    assert found["VF-R03"]["measured"] == pytest.approx(20.0)
    assert found["VF-R04"]["measured"] == 30.0
    assert any("VF-R03" in line for line in made.summary)
    large = make_rig(
        world,
        PRINTER,
        PLATE.changed(height_mm=40.0, scale=1.3),
        RigRequest(design=design, pictures=False),
    )
    assert large.report.findings == ()


def test_both_styles_are_made_of_one_plan(monkeypatch):
    made = []
    for user in (module, build):
        monkeypatch.setattr(
            user, "plan_of", lambda *given: made.append(plan_of(*given)) or made[-1]
        )
    make_rig(_map(box(30, 60, 60, 90)), PRINTER, RigOptions(), BARE)
    assert len(made) == 1


def test_without_a_robot_these_rules_are_skipped_with_the_reason():
    made = make_rig(_map(box(30, 60, 80, 100)), PRINTER, PLATE, BARE)
    assert [skip.rule for skip in made.report.skipped] == ["VF-R03", "VF-R04"]
    assert any("needs a" in line and "VF-R04" in line for line in made.summary)


def test_thickened_walls_narrow_the_corridors():
    # The wall of 0.4 mm becomes 0.8 to 1 mm; corridors are measured beside what is printed.
    world = _map(box(30, 60, 80, 60.4), box(30, 80, 80, 100))
    design = Design.read("plain_vine")
    made = make_rig(
        world, PRINTER, PLATE.changed(height_mm=40.0), RigRequest(design=design, pictures=False)
    )
    (finding,) = made.report.findings
    assert 19.25 <= finding.measured <= 19.4 + 1e-6
    assert made.comparison.thickened_mm2 > 15.0


def test_a_slanted_plate_is_no_empty_map():
    world = _map(Polygon([(20, 40), (40, 40), (20, 60)]))
    assert make_rig(world, PRINTER, PLATE, BARE).comparison.share < 1e-3


def test_pictures_drawing_and_page_come_with_the_files():
    world = _map(box(30, 60, 60, 90), box(90, 60, 150, 60.4))
    made = make_rig(world, PRINTER, RigOptions(style="plate", scale=1.5))
    names = {"report.html", "assembly.svg", "markers.svg", "plan.svg"}
    assert names < set(made.files)
    drawing = Tree.fromstring(made.files["assembly.svg"].decode())  # noqa: S314
    texts = [node.text for node in drawing.iter() if node.tag.endswith("text")]
    assert {"1", "N", "start"} < set(texts)
    assert any("yellow: thickened to print" in str(text) for text in texts)
    for name in names:
        assert b"written by vinefab" in made.files[name][:8192] + made.files[name][-8192:], name
    page = made.files["report.html"].decode()
    assert "Test rig" in page
    assert "Beds (estimate)" in page
    again = make_rig(world, PRINTER, RigOptions(style="plate", scale=1.5))
    assert again.files == made.files


def test_the_plan_shows_the_holder_and_the_markers_around_the_rig():
    world = _map(box(30, 60, 60, 90))
    rig = build.build_rig(world, PRINTER, RigOptions(style="plate", scale=1.5))
    rig, fixtures = with_fixtures(rig, world, Design.read("plain_vine"))
    assert len(fixtures.pads) == 4
    (panel,) = module.assembly_plan(rig, world, fixtures, {}).panels
    shift = -np.array(rig.on_plan(rig.plate).bounds[:2])

    def drawn(primitive):
        return MultiPolygon([Polygon(ring) for ring in primitive.chains])

    def wanted(shape):
        return translate(shape, *shift)

    holder = drawn(panel.legend["holder of the base"])
    assert holder.symmetric_difference(wanted(fixtures.base.outline)).area < 1e-6
    filled = [one for one in panel.primitives if isinstance(one, Shape) and one.ink.fill]
    black = [drawn(one) for one in filled if one.ink.fill == "#000000"]
    assert len(black) == len(fixtures.pads)
    for pad, cells in zip(fixtures.pads, black, strict=True):
        square = wanted(pad.outline)
        assert square.buffer(1e-6).contains(cells)
        assert cells.area > 0.3 * square.area  # black cells of a marker
        assert box(*panel.box).contains(square)
    assert box(*panel.box).contains(holder)


def test_loose_rigs_come_with_their_sheets():
    world = _map(box(30, 60, 60, 90), box(90, 60, 150, 100))
    options = RigOptions(style="board", height_mm=31.0)
    made = make_rig(world, PRINTER, options, RigRequest(lid=True, pictures=False))
    content = json.loads(made.files["rig.json"])
    sheets = {sheet["file"] for sheet in content["laser"]}
    assert {"board_01.dxf", "lid_01.dxf"} <= sheets <= set(made.files)
    assert made.comparison.share < 1e-4
    assert len(content["parts"]) >= 3
    for part in content["parts"]:
        assert part["file"] in made.files
        assert np.array(part["transform_to_map"]).shape == (4, 4)
        assert part["volume_mm3"] > 0
