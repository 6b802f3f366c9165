"""`vinefab observe` on robots with preformed bends and widths of their own."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest
import shapely

sys.path.insert(0, str(Path(__file__).parent))

from rendered_photo import Look, Scene, render

from vinefab.growth.batch import grow_on
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Stop
from vinefab.model.design import Branch, Build, Design
from vinefab.model.map import Map, Pose, Start
from vinefab.observation.beside_prediction import Replays, distance_mm
from vinefab.observation.observe_photo import PhotoSetup, observe_photo
from vinefab.photos.photo import read_photo

POSE = Pose(x_mm=60.0, y_mm=12.0, heading_rad=np.pi / 2)
WORLD = Map(
    name="table",
    bounds=shapely.box(0, 0, 180, 150),
    obstacles=(shapely.box(14, 112, 60, 124), shapely.Polygon([(132, 60), (160, 52), (150, 90)])),
    starts=(Start(pose=POSE),),
)
DESIGN = Design.of_branches(
    [
        Branch(name="left", angle_deg=38.0, length_mm=70.0, width_mm=11.0, bends=((30.0, 40.0),)),
        Branch(name="right", angle_deg=-46.0, length_mm=75.0, width_mm=8.0,
               bends=((26.0, -50.0), (50.0, 45.0))),
    ],
    trunk_length_mm=55.0,
    trunk_bends=((28.0, -25.0),),
    build=Build(trunk_width_mm=14.0, tail_mm=20.0, pressure_kpa=0.0, compensation="none"),
    name="bent",
)  # fmt: skip
LOOK = Look(
    tilt_deg=20.0, turn_deg=250.0, distance_mm=500.0, pixels=(800, 640), height_mm=12.0,
    light_deg=(40.0, 35.0), shade=0.4,
)  # fmt: skip


@pytest.fixture(scope="module")
def truth():
    return grow_on(DESIGN, Terrain.of(WORLD), POSE)


@pytest.fixture(scope="module")
def seen(truth, tmp_path_factory):
    path = tmp_path_factory.mktemp("photo") / "table.jpg"
    path.write_bytes(render(Scene(WORLD, truth, DESIGN.build, LOOK))[2])
    return observe_photo(read_photo(path), WORLD, DESIGN, POSE, PhotoSetup(obstacle_mm=12.0))


def test_lines_with_bends_are_recovered(truth, seen):
    assert sum(len(truth.bends_mm(row)) for row in range(3)) == 4
    for row, branch in enumerate(seen.traced.branches):
        mean, most = distance_mm(branch.points_mm, truth.chain_mm(row))
        assert mean < 1.5
        assert most < 3.0
    assert seen.fits
    assert [one.stop_observed for one in seen.compared.branches] == [
        Stop(stop).label for stop in truth.stop.tolist()
    ]


def test_a_bend_is_no_contact_and_what_was_met_is_as_predicted(seen):
    for one in seen.compared.branches:
        assert one.order_observed == one.order_predicted
    assert any(one.order_observed for one in seen.compared.branches)
    assert seen.verdict.startswith("as predicted")


def test_nominal_widths_are_those_of_the_branches(seen):
    found = [one.nominal_width_mm * math.pi / 2.0 for one in seen.compared.branches]
    assert found == pytest.approx([14.0, 8.0, 11.0])
    for one in seen.compared.branches:
        if one.traced.seen > 0.5:
            assert one.width_mm == pytest.approx(one.nominal_width_mm, abs=1.0)


def test_a_branch_is_replayed_with_its_bends(truth):
    """The replay of each branch alone is its part of the growth of the whole."""
    replays, tree = Replays(WORLD), truth.tree
    for row in range(3):
        chain, heading = truth.chain_mm(row), POSE.heading_rad
        if row:
            last = truth.chain_mm(0)[-1] - truth.chain_mm(0)[-2]
            heading = math.atan2(last[1], last[0]) + tree.offset_rad[row]
        radius = float(tree.width_mm[row]) / math.pi
        length = float(tree.length_mm[row])
        half = math.radians(1.0)
        replay = replays.grown(chain[0], heading, length, radius, half, tree.bends_of(row))
        assert replay.chain_mm == pytest.approx(chain, abs=1e-6)
        fronts = [one.front_mm for one in replay.meetings]
        assert fronts == sorted(fronts)
