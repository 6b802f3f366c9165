"""Angles of joint coupons on rendered photos of inflated sheets with a known closing gain."""

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))

from rendered_coupon import gained_coupon, looks, misread, photo_of, true_deg

import vinefab as vf
from vinefab.core.errors import BadInputError, UnknownNameError
from vinefab.fabrication.calibration.coupons import (
    JointReading,
    joint_coupon,
    joint_tables,
    read_results,
)
from vinefab.inflation.pattern import standing_of
from vinefab.model.laser import read_profile
from vinefab.observation.observe_photo import joint_angle_deg

GAIN = 0.6
NAMES = ("PAIR-120-W20", "ELBOW-60-W20")


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """A table of results with the angle of each coupon, read by the verb, and true angles."""
    folder, true = tmp_path_factory.mktemp("coupons"), {}
    joint_tables()["joints_W20"].write(folder / "joints_W20.geojson")
    results = folder / "results.csv"
    for name, look in zip(NAMES, looks(8)[6:], strict=True):
        robot = gained_coupon(joint_coupon(name), GAIN)
        true[name] = true_deg(robot)
        photo = folder / f"{name}.jpg"
        small = replace(look, pixels=(1000, 750))
        photo.write_bytes(photo_of(robot, 20.0, small, off=(1.0, -1.0, 2.0)))
        seen = vf.observe(photo, folder / "joints_W20.geojson", name, results=results)
        assert seen.numbers["joint_angle_deg"] == pytest.approx(seen.reading.angle_deg, abs=0.01)
    return results, true


@pytest.mark.thorough
def test_angles_are_read_within_a_degree(table):
    results, true = table
    read = {one.setting: np.degrees(one.value) for one in read_results(results).of("joint_angle")}
    assert read == pytest.approx({f"{name} 20": angle for name, angle in true.items()}, abs=1.0)


def test_photographed_angles_become_a_recipe_that_compensates_as_measured(table, tmp_path):
    results, _ = table
    before = read_results(results).of("joint_angle")
    found = vf.calibrate(results, out=tmp_path / "mine.toml")
    gain = found.fitted["measured.closing_gain"]
    assert gain.readings == len(before)
    assert abs(gain.value - GAIN) < gain.half_width()
    assert gain.value == pytest.approx(GAIN, abs=0.1)
    film = read_profile(found.path).material
    assert film.closing_gain.standing == "measured"
    assert standing_of(film) == "simulated; modulus assumed, closing gain measured"
    assert standing_of(read_profile("co2_60w__stretchlon_200").material) == "simulated, unverified"


def test_a_photo_that_shows_another_coupon_enters_nothing(table):
    results, _ = table
    before = results.read_text()
    photo, world = results.parent / "PAIR-120-W20.jpg", results.parent / "joints_W20.geojson"
    with pytest.raises(BadInputError, match="ELBOW-60-W20"):
        vf.observe(photo, world, "ELBOW-60-W20", results=results)
    with pytest.raises(UnknownNameError, match="PAIR-40-W20"):
        vf.observe(photo, world, "plain_vine", results=results)
    assert results.read_text() == before


def test_the_same_photo_is_entered_once():
    one = JointReading(coupon="PAIR-80-W20", kpa=20.0, angle_deg=77.0, source="a, b.jpg")
    again = JointReading(coupon="PAIR-80-W20", kpa=20.0, angle_deg=78.0, source="a, b.jpg")
    other = JointReading(coupon="PAIR-80-W20", kpa=20.0, angle_deg=79.0, source="c.jpg")
    text = other.entered(again.entered(one.entered("measure,value,setting,unit,note\n")))
    assert text.splitlines()[1:] == [
        'joint_angle,78.00,PAIR-80-W20 20,deg,"read off a, b.jpg"',
        "joint_angle,79.00,PAIR-80-W20 20,deg,read off c.jpg",
    ]


@pytest.mark.thorough
def test_twenty_photos_of_all_coupons_are_read_within_a_degree():
    off = np.abs([read - true for _, true, read in misread(20)])
    assert off.max() < 1.0
    assert off.mean() < 0.3


def test_a_tree_is_refused():
    class Tree:
        branches = (None,) * 5

    with pytest.raises(BadInputError, match="one or two children"):
        joint_angle_deg(Tree, None)
