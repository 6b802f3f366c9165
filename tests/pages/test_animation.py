import io
import math
import xml.etree.ElementTree as ET

import numpy as np
import pytest
import shapely
from PIL import Image

from vinefab.growth.options import GrowthOptions
from vinefab.model.design import Build, Design, Level
from vinefab.model.map import Map, Pose
from vinefab.pages.animation import Stage, frozen_since, gif_animation, svg_animation
from vinefab.pages.panel import round_length_mm
from vinefab.prediction.deploy import deploy

SVG = "{http://www.w3.org/2000/svg}"
WIDTHS_MM = np.array([6.0, 3.0, 3.0, 3.0])


@pytest.fixture(scope="module")
def world():
    ring = shapely.box(60, 60, 90, 90) - shapely.box(65, 65, 85, 85)
    return Map(
        name="w", bounds=shapely.box(0, 0, 100, 80), obstacles=(ring & shapely.box(0, 0, 100, 80),)
    )


@pytest.fixture(scope="module")
def frames(world):
    fork = Level(branches=3, length_mm=30.0, fan_rad=2.0, growth=0.5)
    design = Design(name="y", trunk_length_mm=40.0, levels=(fork,), build=Build.standard(2))
    pose = Pose(x_mm=50.0, y_mm=5.0, heading_rad=math.pi / 2)
    return deploy(design, world, pose, GrowthOptions.published().content).history.even_steps(8)


def seen_at(group, share):
    """Tell whether a group is seen at a share of the animation's length."""
    moves = group.find(f"{SVG}animate")
    if moves is None:
        return True
    times = [float(text) for text in moves.get("keyTimes").split(";")]
    values = moves.get("values").split(";")
    assert len(times) == len(values)
    assert times[0] == 0.0
    assert sorted(times) == times
    return values[np.searchsorted(times, share, side="right") - 1] == "visible"


def test_svg_shows_one_text_at_a_time_in_order(world, frames):
    root = ET.fromstring(svg_animation(world, frames, WIDTHS_MM))  # noqa: S314  our own text
    words = [group for group in root.iter(f"{SVG}g") if group.find(f"{SVG}text") is not None]
    assert len(words) == 8
    shown = []
    for share in (np.arange(8) + 0.5) * 0.09 / (8 * 0.09 + 1.8):
        now = [group.find(f"{SVG}text").text for group in words if seen_at(group, share)]
        assert len(now) == 1
        shown += now
    assert [float(text.split()[1]) for text in shown] == [
        pytest.approx(round(frame.front_mm), abs=0.51) for frame in frames
    ]


def test_svg_that_stands_still_shows_the_last_frame(world, frames):
    root = ET.fromstring(svg_animation(world, frames, WIDTHS_MM))  # noqa: S314
    still = [
        group
        for group in root.iter(f"{SVG}g")
        if group.get("visibility") != "hidden" and group.find(f"{SVG}text") is not None
    ]
    assert len(still) == 1
    assert f"front {frames[-1].front_mm:.0f} mm" in still[0].find(f"{SVG}text").text


@pytest.mark.parametrize("first", [0, 5], ids=["from the base", "from where some are at rest"])
def test_svg_draws_in_each_frame_every_branch_that_has_emerged(world, frames, first):
    frames = frames[first:]
    root = ET.fromstring(svg_animation(world, frames, WIDTHS_MM))  # noqa: S314
    groups = [
        (group, path)
        for group in root.iter(f"{SVG}g")
        for path in group.findall(f"{SVG}path")
        if path.get("class", "").startswith("c")
    ]
    for number, frame in enumerate(frames):
        share = (number + 0.5) * 0.09 / (len(frames) * 0.09 + 1.8)
        strokes = sum(path.get("d").count("M") for group, path in groups if seen_at(group, share))
        assert strokes == np.count_nonzero(frame.deployment.deployed)


def test_both_kinds_are_the_same_bytes_every_time_and_carry_the_mark(world, frames):
    for animation in (svg_animation, gif_animation):
        first = animation(world, frames, WIDTHS_MM)
        assert first == animation(world, frames, WIDTHS_MM)
        assert b"written by vinefab" in first[:8192]


def test_gif_has_a_picture_per_frame_and_holds_the_last(world, frames):
    picture = Image.open(io.BytesIO(gif_animation(world, frames, WIDTHS_MM)))
    assert picture.n_frames == 8
    assert picture.info["loop"] == 0
    durations, colours = [], []
    for number in range(8):
        picture.seek(number)
        durations.append(picture.info["duration"])
        colours.append(np.asarray(picture.convert("RGB")))
    assert durations == [90] * 7 + [1800]
    assert (colours[0][2, 2] == 255).all()
    assert not np.array_equal(colours[3], colours[6])
    # The trunk grows upwards on the picture: its shade is at half of its length only later.
    row, column = Stage.of(world.bounds.bounds).place(np.array([[51.0, 35.0]]))[0].astype(int)[::-1]
    assert (colours[0][row, column] == 255).all()
    assert (colours[7][row, column] < 255).any()


def test_branches_freeze_once_and_in_the_order_of_their_lengths(frames):
    since = frozen_since(frames)
    assert set(since) == {"0", "0.0", "0.1", "0.2"}
    assert since["0"] < since["0.2"] < since["0.1"] <= since["0.0"] == 7


@pytest.mark.parametrize(("most", "length"), [(1.0, 1.0), (9.9, 5.0), (2000.0, 2000.0), (0.3, 0.2)])
def test_scale_bars_are_round(most, length):
    assert round_length_mm(most) == pytest.approx(length)
