import subprocess
import xml.etree.ElementTree as ET
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from PIL import Image

from vinefab.core.plain_text import OWN_MARK
from vinefab.fabrication.job.laser_job import laser_job
from vinefab.fabrication.job.timing import schedule
from vinefab.fabrication.package.bom import machine_time
from vinefab.fabrication.package.sheet_pictures import job_animation, job_plan, run_paths
from vinefab.model.design import Design
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import read_profile
from vinefab.model.outline import Contour
from vinefab.pages.panel import Words

SVG = "{http://www.w3.org/2000/svg}"


@pytest.fixture(scope="module")
def profile():
    return read_profile("co2_60w__stretchlon_200")


@pytest.fixture(scope="module")
def job(profile):
    return laser_job(Design.read("three_level_tree"), profile)


def test_the_schedule_takes_as_long_as_the_bill_says(job, profile):
    runs = schedule(job, profile)
    assert runs[-1].ends_s == pytest.approx(machine_time(job, profile).total_s)
    order = [run.path.operation for run in runs]
    assert order == sorted(order, key=list(type(order[0])).index)
    assert all(a.ends_s <= b.begins_s for a, b in pairwise(runs))


def test_every_animation_is_one_that_browsers_play(job, profile):
    root = ET.fromstring(job_animation(job, profile))  # noqa: S314
    animations = list(root.iter(f"{SVG}animate"))
    assert len(animations) == len(schedule(job, profile)) + 2
    for animation in animations:
        times = [float(word) for word in animation.get("keyTimes").split(";")]
        # The standard: from 0 to 1, never falling, as many as there are values.
        assert (times[0], times[-1]) == (0.0, 1.0)
        assert times == sorted(times)
        assert len(animation.get("values").split(";")) == len(times)
    assert len({animation.get("dur") for animation in animations}) == 1


def test_a_path_is_hidden_before_its_time_and_drawn_after_it(job, profile):
    root = ET.fromstring(job_animation(job, profile))  # noqa: S314
    for line in root.iter(f"{SVG}polyline"):
        values = [float(word) for word in line[0].get("values").split(";")]
        assert values[0] == pytest.approx(values[1])
        assert values[-1] == values[-2] == 0.0
        assert values == sorted(values, reverse=True)
        points = np.array([pair.split(",") for pair in line.get("points").split()], dtype=float)
        assert values[0] == pytest.approx(np.hypot(*np.diff(points, axis=0).T).sum(), abs=0.5)


def test_the_same_job_gives_the_same_bytes_and_stands_still_as_the_finished_sheet(
    job, profile, tmp_path, program
):
    data = job_animation(job, profile)
    assert data == job_animation(job, profile)
    assert OWN_MARK in data
    assert len(data) < 200_000
    (tmp_path / "a.svg").write_bytes(data)
    picture = tmp_path / "a.png"
    command = [program("rsvg-convert", "librsvg2-bin"), "-o", picture, tmp_path / "a.svg"]
    done = subprocess.run(
        command, capture_output=True, text=True, errors="replace", timeout=60, check=True
    )
    assert done.stderr == ""
    with Image.open(picture) as image:
        pixels = np.asarray(image.convert("RGB")).reshape(-1, 3).astype(int)
    magenta = (pixels[:, 0] > 200) & (pixels[:, 1] < 120) & (pixels[:, 2] > 200)
    assert magenta.sum() > 1000


def test_each_sheet_is_drawn_on_its_own_axes_in_its_own_order(job):
    other = replace(job, name="other", paths=job.paths[-3:])
    plan = job_plan(replace(job, sheet_width_mm=2 * job.sheet_width_mm, sheets=(job, other)))
    assert [panel.title.splitlines()[-1].partition(",")[0] for panel in plan.panels] == [
        "sheet 1 of 2",
        "sheet 2 of 2",
    ]
    for panel, sheet in zip(plan.panels, (job, other), strict=True):
        words = [one.text for one in panel.primitives if isinstance(one, Words)]
        assert words == [str(number) for number in range(1, len(run_paths(sheet)) + 1)]
        assert panel.box[2] < 1.2 * sheet.sheet_width_mm  # no bed beside another


def test_sheets_are_shown_beside_each_other_and_run_one_after_the_other(job, profile):
    several = replace(job, sheet_width_mm=4 * job.sheet_width_mm, sheets=(job,) * 4)
    root = ET.fromstring(job_animation(several, profile))  # noqa: S314
    beds = [{key: float(rect.get(key)) for key in ("x", "y", "width", "height")}
            for rect in root.iter(f"{SVG}rect")]  # fmt: skip
    corners = [(bed["x"], bed["y"]) for bed in beds]
    assert [len({place[axis] for place in corners}) for axis in (0, 1)] == [3, 2]  # rows of three
    assert len(set(corners)) == 4
    assert {(bed["width"], bed["height"]) for bed in beds} == {
        (job.sheet_width_mm, job.sheet_height_mm)
    }
    assert [text.text for text in root.iter(f"{SVG}text")] == [
        f"sheet {k} of 4" for k in (1, 2, 3, 4)
    ]
    lines = list(root.iter(f"{SVG}polyline"))
    each, last = len(lines) // 4, 0.0
    assert 4 * each == len(lines) == 4 * len(schedule(job, profile))
    for number, bed in enumerate(beds):
        for line in lines[number * each : (number + 1) * each]:
            x, y = np.array([pair.split(",") for pair in line.get("points").split()], float).T
            assert bed["x"] - 0.01 <= x.min() <= x.max() <= bed["x"] + bed["width"] + 0.01
            assert bed["y"] - 0.01 <= y.min() <= y.max() <= bed["y"] + bed["height"] + 0.01
            begins = float(line[0].get("keyTimes").split(";")[1])
            assert begins >= last
            last = begins
    total_s = machine_time(several, profile).total_s
    assert f"{total_s:.0f} s on the machine" in root.find(f"{SVG}title").text


def test_a_robot_in_tiles_lies_on_film_and_not_on_a_bed():
    line = Contour.polyline(np.array([[5.0, 5.0], [395.0, 5.0]]), closed=False)
    path = LaserPath(operation=Operation.WELDCUT, contour=line)
    job = Job(name="long", sheet_width_mm=400.0, sheet_height_mm=10.0, paths=(path,))
    assert "bed 400 x 10 mm" in job_plan(job).panels[0].title
    windows = [{"window_x_mm": x, "window_y_mm": 0.0} for x in (0.0, 200.0, 0.0)]
    crosses = {
        "targets_made_mm": [[10.0, 5.0], [20.0, 5.0]],
        "robot_targets_made_mm": [[30.0, 5.0]],
    }
    tiles = tuple(
        replace(job, sheet_width_mm=220.0, facts={**window, **crosses}) for window in windows
    )
    panel = job_plan(replace(job, tiles=tiles)).panels[0]
    words = [one.text for one in panel.primitives if isinstance(one, Words)]
    assert {"tile 1, 3", "tile 2"} <= set(words)  # the mouth is cut where the first tile lies
    signs = {one.size_pt: one.points for one in panel.primitives if getattr(one, "sign", "") == "+"}
    assert sorted(signs[8.0][:, 0].tolist()) == [10.0, 10.0, 20.0, 20.0, 210.0, 220.0]
    assert sorted(signs[5.0][:, 0].tolist()) == [30.0, 30.0, 230.0]
    title = panel.title
    assert "film, in tiles, 400 x 10 mm" in title
    assert "bed" not in title
