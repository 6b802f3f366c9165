"""Angles of joint coupons on rendered photos of shapes with a known closing gain."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest
import shapely

sys.path.insert(0, str(Path(__file__).parent))

from rendered_photo import Look, Scene, render

from vinefab.core.errors import BadInputError
from vinefab.fabrication.calibration.coupon_results import read_results
from vinefab.fabrication.calibration.coupons import joint_designs
from vinefab.fabrication.calibration.fit_joints import fit_closing
from vinefab.growth.simulator import grow_on
from vinefab.growth.terrain import Terrain
from vinefab.inflation.robot import inflated_robot
from vinefab.model.design import UnevenLevel
from vinefab.model.files.profile_toml import read_profile
from vinefab.model.map import Map, Pose
from vinefab.observation.joint_angles import joint_angle_deg
from vinefab.observation.observe_photo import observe_photo
from vinefab.photos.photo import read_photo

GAIN = 0.6
WORLD = Map(name="table", bounds=shapely.box(0, 0, 130, 130))
POSE = Pose(x_mm=65.0, y_mm=8.0, heading_rad=math.pi / 2)
LOOK = Look(tilt_deg=8.0, turn_deg=250.0, distance_mm=500.0, pixels=(1000, 800), shade=0.6)
COUPONS = {design.name: design for design in joint_designs() if design.name.endswith("W20")}


def gained_deg(design):
    """Return the angle of each child, with the gain, at 20 kPa in film of 30 MPa."""
    width = design.build.widths_mm[0]
    strain = 20e-3 * width / (math.pi * 0.0375 * 30.0)
    flat = np.array(design.levels[0].angles_deg)
    simulated = np.degrees(inflated_robot(design, hoop_strain=strain).deployed_offsets_rad)[1:]
    return flat + GAIN * (simulated - flat)


@pytest.fixture(scope="module")
def readings(tmp_path_factory):
    """Angle of each coupon in truth, and as read from its photo."""
    found = {}
    for name, design in COUPONS.items():
        angles = gained_deg(design)
        children = UnevenLevel.of_children(angles, design.levels[0].lengths_mm)
        deployment = grow_on(design.changed(levels=(children,)), Terrain.of(WORLD), POSE)
        path = tmp_path_factory.mktemp("photo") / "coupon.jpg"
        path.write_bytes(render(Scene(WORLD, deployment, design.build, LOOK))[2])
        seen = observe_photo(read_photo(path), WORLD, design, POSE)
        true = float(np.ptp(angles) if len(angles) > 1 else angles[0])
        found[name] = true, joint_angle_deg(seen.traced)
    return found


def test_angles_are_read_within_two_degrees(readings):
    for name, (true, read) in readings.items():
        assert read == pytest.approx(true, abs=2.0), name


def test_photographed_angles_give_the_gain(readings, tmp_path):
    rows = "".join(f"joint_angle,{name} 20,{read},deg\n" for name, (_, read) in readings.items())
    path = tmp_path / "results.csv"
    path.write_text("measure,setting,value,unit\n" + rows)
    profile = read_profile("co2_60w__stretchlon_200")
    gain = fit_closing(read_results(path), profile, None)[0]["measured.closing_gain"]
    assert abs(gain.value - GAIN) < gain.half_width()
    assert gain.value == pytest.approx(GAIN, abs=0.1)


def test_a_tree_is_refused():
    class Tree:
        branches = (None,) * 5

    with pytest.raises(BadInputError, match="one or two children"):
        joint_angle_deg(Tree)
