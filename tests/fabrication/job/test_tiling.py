"""Robots larger than the bed: put together again, their tiles are the robot."""

import itertools
import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import shapely
from shapely import LineString, Point, Polygon

from tests.fabrication.conftest import fan, plan
from vinefab.fabrication.job.laser_job import laser_job
from vinefab.fabrication.job.passes import weldcut_offset_mm
from vinefab.fabrication.job.placement import SheetOptions
from vinefab.fabrication.job.tiling import TARGET, VERIFICATION, VERIFY
from vinefab.model.job import Operation
from vinefab.model.laser import read_profile
from vinefab.model.outline import Part
from vinefab.outline.body_outline import body_outline

FORMING = (Operation.WELD, Operation.WELDCUT)
FANS = [fan(3, 170, 120), fan(2, 110, 60, 0.8)]
ROBOTS = {
    "tree": plan((36.0, 20.0, 12.0), levels=FANS, trunk=200.0, tail=200.0),
    "tapered": plan((36.0, 18.0, 9.0), levels=FANS, trunk=200.0, tail=200.0, taper=(0.9, 0.8, 0.8)),
    "vine": plan((40.0,), trunk=600.0, tail=200.0),
}


def bed_of(width_mm, height_mm, *, without=""):
    """The shipped recipe on a bed with 5 mm margins, perhaps without an operation."""
    profile = read_profile("co2_60w__stretchlon_200")
    sizes = {"bed_width_mm": width_mm, "bed_height_mm": height_mm, "margin_mm": 5.0}
    machine = profile.machine.changed(
        **{name: getattr(profile.machine, name).changed(value=v) for name, v in sizes.items()}
    )
    operations = {k: v for k, v in profile.recipe.by_operation.items() if k != without}
    recipe = profile.recipe.changed(operations=operations)
    return replace(profile, machine=machine, recipe=recipe)


SMALL, UNMARKED = bed_of(250.0, 200.0), bed_of(250.0, 200.0, without="mark")


@cache
def job_of(name, process="weldcut"):
    return laser_job(ROBOTS[name], SMALL, SheetOptions(process=process))


def back(tile, contour):
    return contour.moved(0.0, tile.facts["window_x_mm"], tile.facts["window_y_mm"])


def formed(tile):
    return [back(tile, path.contour) for path in tile.paths if path.operation in FORMING]


@pytest.mark.parametrize("process", ["weldcut", "weld+cut"])
@pytest.mark.parametrize("name", ROBOTS)
def test_tiles_put_together_are_the_robot(name, process):
    job = job_of(name, process)
    assert len(job.tiles) > 1
    (whole,) = (path.contour for path in job.paths if path.operation in FORMING)
    corners = whole.points_mm[[0, -1]]
    runs = [contour for tile in job.tiles for contour in formed(tile)]
    # Snapped, for a line that runs over another one is not quite the same after it was moved.
    lines = [*(LineString(run.flattened_mm()) for run in runs), LineString(corners)]
    film = shapely.union_all(lines, grid_size=1e-6)
    again = shapely.union_all(shapely.get_parts(shapely.polygonize([*shapely.get_parts(film)])))
    robot = Polygon(whole.flattened_mm())
    assert again.symmetric_difference(robot).area < 1e-3 * robot.area
    for operation in (Operation.WELD, Operation.WELDCUT, Operation.CUT):
        given = sum(path.contour.length_mm for path in job.along(operation))
        got = sum(tile.length_mm(operation) for tile in job.tiles)
        assert got >= given - 1e-6
    # Paths are parted on straights, and every place is run twice over 12 mm.
    joints = shapely.union_all([LineString(s.flattened_mm()) for s in whole.segments if s.bulge])
    ends = [run.points_mm[row] for run in runs for row in (0, -1)]
    parted = [end for end in ends if np.hypot(*(corners - end).T).min() > 1e-6]
    assert len(parted) == 2 * len(runs) - 2
    assert min(Point(end).distance(joints) for end in parted) >= 10.0
    extra = sum(run.length_mm for run in runs) - whole.length_mm
    assert extra == pytest.approx(12.0 * (len(runs) - 1))


@pytest.mark.parametrize("name", ["tree", "vine"])
def test_tiles_share_targets_far_apart_and_verify_them_before_anything_else(name):
    job = job_of(name)
    (whole,) = (path.contour for path in job.along(Operation.WELDCUT))
    body, made = Polygon(whole.flattened_mm()), {}
    for number, tile in enumerate(job.tiles, start=1):
        window = np.array([tile.facts["window_x_mm"], tile.facts["window_y_mm"]])
        made[number] = np.array(tile.facts["targets_made_mm"]).reshape(-1, 2) + window
        found = [np.add(p, window) for p in tile.facts["targets_found_mm"]]
        lines = [path for path in tile.paths if path.label == VERIFICATION]
        regs = [path for path in tile.along(Operation.REG) if path.label == TARGET]
        assert (tile.facts["tile"], tile.facts["tiles"]) == (number, len(job.tiles))
        if number == 1:
            assert (found, lines, regs) == ([], [], [])
            continue
        assert math.dist(*found) >= 50.0
        others = made[tile.facts["aligned_to_tile"]]
        for point in found:
            assert body.distance(Point(point)) >= 3.0 + 4.0
            assert np.hypot(*(others - point).T).min() < 1e-6
        assert len(regs) == 4  # two crosses of two lines
        if number == len(job.tiles):
            assert lines == []  # the cut of the mouth alone: what it finds has been verified
            continue
        assert tile.paths[:4] == tuple(lines)
        assert {(path.operation, path.variant) for path in lines} == {(Operation.MARK, VERIFY)}
        for one in (back(tile, path.contour).points_mm for path in lines):
            # Diagonal lines of a target's length, whose middle is that of a cross of the other.
            assert np.abs(np.diff(one, axis=0)) == pytest.approx(8.0 / math.sqrt(2.0), abs=0.01)
            assert np.hypot(*(others - one.mean(axis=0)).T).min() < 1e-6
            assert body.distance(LineString(one)) >= 3.0


@pytest.mark.parametrize("profile", [SMALL, UNMARKED], ids=["marked", "unmarked"])
@pytest.mark.parametrize("name", ROBOTS)
def test_every_tile_lies_on_the_bed_and_the_film_holds_all_of_them(name, profile):
    job = job_of(name) if profile is SMALL else laser_job(ROBOTS[name], profile)
    drawn = [*job.paths]
    for tile in job.tiles:
        boxes = np.array([path.contour.box_mm for path in tile.paths])
        assert boxes[:, :2].min() >= 5.0 - 1e-6
        assert (boxes[:, 2:] <= np.array([245.0, 195.0]) + 1e-6).all()
        order = [path.operation for path in tile.paths]
        assert order == sorted(order, key=tuple(Operation).index)
        labels = [path for path in tile.paths if path.label.startswith("label")]
        assert bool(labels) <= (tile.facts["tile"] == 1)
        assert profile is SMALL or not any(path.label == VERIFICATION for path in tile.paths)
        drawn += [replace(path, contour=back(tile, path.contour)) for path in tile.paths]
    cuts = [
        (number, path)
        for number, tile in enumerate(job.tiles, start=1)
        for path in tile.paths
        if Part.MOUTH in path.contour.parts
    ]
    assert [number for number, _ in cuts] == [len(job.tiles)]  # the mouth comes last
    # The film is no larger than needed, with a rim of the machine's margin all around.
    boxes, far = np.array([path.contour.box_mm for path in drawn]), [job.sheet_width_mm - 5.0]
    assert boxes[:, :2].min(axis=0) == pytest.approx([5.0, 5.0])
    assert boxes[:, 2:].max(axis=0) == pytest.approx([*far, job.sheet_height_mm - 5.0])
    turn = math.radians(job.facts["rotation_deg"])
    placed = body_outline(ROBOTS[name], weldcut_offset_mm(profile)).contour.moved(
        turn, job.facts["shift_x_mm"], job.facts["shift_y_mm"]
    )
    assert placed.points_mm == pytest.approx(job.along(Operation.WELDCUT)[0].contour.points_mm)
    # By layer, as in every file.
    layers = [(path.operation, path.variant) for path in job.paths]
    assert len([*itertools.groupby(layers)]) == len(set(layers))


def test_film_that_is_fed_through_moves_along_the_bed_only():
    job = laser_job(ROBOTS["vine"], SMALL, SheetOptions(pass_through=True))
    assert len({tile.facts["window_y_mm"] for tile in job.tiles}) == 1
    *windows, mouth = [tile.facts["window_x_mm"] for tile in job.tiles]
    assert len(windows) > 2
    assert mouth == windows[0]  # back to the mouth, which is cut last
    assert windows == sorted(windows)
    wide = laser_job(ROBOTS["tree"], SMALL, SheetOptions(pass_through=True))
    assert wide.tiles == ()
    assert "wider than the bed" in wide.facts["tiling"]


def test_targets_take_little_more_film_than_the_robot():
    """Film of the bed's whole height (400 mm) is not needed for the crosses of a vine of 40 mm."""
    vine = plan((40.0,), trunk=1500.0, tail=200.0)
    job = laser_job(vine, bed_of(600.0, 400.0), SheetOptions(pass_through=True))
    assert len(job.tiles) > 2
    assert job.sheet_height_mm < 300.0
    for tile in job.tiles[1:]:
        assert math.dist(*tile.facts["targets_found_mm"]) >= 150.0


def test_a_robot_that_cannot_be_parted_gives_the_reason():
    job = laser_job(plan((300.0,), trunk=400.0, tail=200.0), SMALL)
    assert job.tiles == ()
    assert "no room to part" in job.facts["tiling"]
