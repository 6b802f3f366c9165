import dataclasses
import itertools
import math

import numpy as np
import pytest
import shapely
from shapely import LineString, Point, Polygon

from vinefab.fabrication.job.laser_job import laser_job
from vinefab.fabrication.job.passes import weldcut_offset_mm
from vinefab.fabrication.job.placement import SheetOptions
from vinefab.fabrication.job.tiling import VERIFICATION, VERIFY
from vinefab.fabrication.outline.body_outline import body_outline
from vinefab.model.job import Operation
from vinefab.model.outline import Part

FORMING = (Operation.WELD, Operation.WELDCUT)


@pytest.fixture
def small_bed(profile):
    """A bed of 240 x 190 mm within 5 mm margins; the recipe can mark and weld too."""

    def number(name, value):
        return getattr(profile.machine, name).changed(value=value)

    sizes = {"bed_width_mm": 250.0, "bed_height_mm": 200.0, "margin_mm": 5.0}
    machine = {name: number(name, value) for name, value in sizes.items()}
    cut = profile.settings("cut")
    wide = cut.seam_width_mm.changed(value=3.0)
    weld = cut.changed(seam_width_mm=wide, kerf_mm=wide.changed(value=0.0))
    operations = {**profile.recipe.by_operation, "mark": cut, "weld": weld}
    return dataclasses.replace(
        profile,
        machine=profile.machine.changed(**machine),
        recipe=profile.recipe.changed(operations=operations),
    )


@pytest.fixture
def trees(make_plan, make_fan):
    fans = [make_fan(3, 170, 120), make_fan(2, 110, 60, 0.8)]
    return {
        "tree": make_plan((36.0, 20.0, 12.0), levels=fans, trunk=200.0, tail=200.0),
        "tapered": make_plan(
            (36.0, 18.0, 9.0), levels=fans, trunk=200.0, tail=200.0, taper=(0.9, 0.8, 0.8)
        ),
        "vine": make_plan((40.0,), trunk=600.0, tail=200.0),
    }


def back(tile, contour):
    return contour.moved(0.0, tile.facts["window_x_mm"], tile.facts["window_y_mm"])


def formed(tile):
    return [back(tile, path.contour) for path in tile.paths if path.operation in FORMING]


@pytest.mark.parametrize("process", ["weldcut", "weld+cut"])
@pytest.mark.parametrize("name", ["tree", "tapered", "vine"])
def test_tiles_put_together_are_the_robot(trees, small_bed, name, process):
    job = laser_job(trees[name], small_bed, SheetOptions(process=process))
    assert len(job.tiles) > 1
    (whole,) = (path.contour for path in job.paths if path.operation in FORMING)
    mouth = LineString(whole.points_mm[[0, -1]])
    lines = [LineString(c.flattened_mm()) for tile in job.tiles for c in formed(tile)]
    # Snapped, for a line that runs over another one is not quite the same after it was moved.
    film = shapely.union_all([*lines, mouth], grid_size=1e-6)
    again = shapely.union_all(shapely.get_parts(shapely.polygonize([*shapely.get_parts(film)])))
    robot = Polygon(whole.flattened_mm())
    assert again.symmetric_difference(robot).area < 1e-3 * robot.area
    for operation in (Operation.WELD, Operation.WELDCUT, Operation.CUT):
        given = sum(path.contour.length_mm for path in job.along(operation))
        got = sum(tile.length_mm(operation) for tile in job.tiles)
        assert got >= given - 1e-6


@pytest.mark.parametrize("name", ["tree", "tapered", "vine"])
def test_paths_are_parted_on_straights_and_overlap(trees, small_bed, name):
    job = laser_job(trees[name], small_bed)
    (whole,) = (path.contour for path in job.along(Operation.WELDCUT))
    bends = [s for s in whole.segments if s.bulge]
    joints = shapely.union_all([LineString(s.flattened_mm()) for s in bends])
    runs = [contour for tile in job.tiles for contour in formed(tile)]
    ends = [run.points_mm[row] for run in runs for row in (0, -1)]
    corners = whole.points_mm[[0, -1]]
    parted = [end for end in ends if np.hypot(*(corners - end).T).min() > 1e-6]
    assert len(parted) == 2 * len(runs) - 2
    assert min(Point(end).distance(joints) for end in parted) >= 10.0
    # Every place where the outline is parted is run twice over 12 mm.
    extra = sum(run.length_mm for run in runs) - whole.length_mm
    assert extra == pytest.approx(12.0 * (len(runs) - 1))


@pytest.mark.parametrize("name", ["tree", "vine"])
def test_targets_are_shared_far_apart_and_off_the_body(trees, small_bed, name):
    job = laser_job(trees[name], small_bed)
    (whole,) = (path.contour for path in job.along(Operation.WELDCUT))
    body = Polygon(whole.flattened_mm())
    made = {}
    for tile in job.tiles:
        window = np.array([tile.facts["window_x_mm"], tile.facts["window_y_mm"]])
        made[tile.facts["tile"]] = [np.add(p, window) for p in tile.facts["targets_made_mm"]]
        found = [np.add(p, window) for p in tile.facts["targets_found_mm"]]
        regs = [back(tile, path.contour) for path in tile.along(Operation.REG)]
        if tile.facts["tile"] == 1:
            assert found == regs == []
            continue
        assert math.dist(*found) >= 50.0
        for point in found:
            assert body.distance(Point(point)) >= 3.0 + 4.0
            others = made[tile.facts["aligned_to_tile"]]
            assert min(math.dist(point, other) for other in others) < 1e-6
        assert len(regs) == 4  # two crosses of two lines
    assert tile.facts["tiles"] == len(job.tiles)


@pytest.mark.parametrize("name", ["tree", "vine"])
def test_a_tile_verifies_its_place_before_anything_else(trees, small_bed, name):
    job = laser_job(trees[name], small_bed)
    (whole,) = (path.contour for path in job.along(Operation.WELDCUT))
    body = Polygon(whole.flattened_mm())
    made = {}
    for tile in job.tiles:
        lines = [path for path in tile.paths if path.label == VERIFICATION]
        ends = [back(tile, path.contour).points_mm for path in lines]
        window = np.array([tile.facts["window_x_mm"], tile.facts["window_y_mm"]])
        made[tile.facts["tile"]] = np.array(tile.facts["targets_made_mm"]).reshape(-1, 2) + window
        if tile.facts["tile"] == 1:
            assert lines == []
            continue
        assert tile.paths[:4] == tuple(lines)
        assert {(path.operation, path.variant) for path in lines} == {(Operation.MARK, VERIFY)}
        others = made[tile.facts["aligned_to_tile"]]
        for one in ends:
            # Diagonal lines of a target's length, whose middle is that of a cross of the other.
            assert np.abs(np.diff(one, axis=0)) == pytest.approx(8.0 / math.sqrt(2.0), abs=0.01)
            assert np.hypot(*(others - one.mean(axis=0)).T).min() < 1e-6
            assert body.distance(LineString(one)) >= 3.0


def test_the_layers_of_all_tiles_together_do_not_alternate(trees, small_bed):
    job = laser_job(trees["vine"], small_bed)
    assert len(job.tiles) > 2
    layers = [(path.operation, path.variant) for path in job.paths]
    assert len([*itertools.groupby(layers)]) == len(set(layers))


def test_without_a_mark_nothing_is_marked_to_verify(trees, small_bed):
    operations = {k: v for k, v in small_bed.recipe.by_operation.items() if k != Operation.MARK}
    recipe = small_bed.recipe.changed(operations=operations)
    job = laser_job(trees["vine"], dataclasses.replace(small_bed, recipe=recipe))
    assert len(job.tiles) > 1
    assert not any(path.label == VERIFICATION for tile in job.tiles for path in tile.paths)


@pytest.mark.parametrize("name", ["tree", "tapered", "vine"])
def test_every_tile_lies_on_the_bed_and_marks_lie_on_the_first(trees, small_bed, name):
    job = laser_job(trees[name], small_bed)
    for tile in job.tiles:
        boxes = np.array([path.contour.box_mm for path in tile.paths])
        assert boxes[:, :2].min() >= 5.0 - 1e-6
        assert (boxes[:, 2:] <= np.array([245.0, 195.0]) + 1e-6).all()
        order = [path.operation for path in tile.paths]
        assert order == sorted(order, key=tuple(Operation).index)
        labels = [path for path in tile.paths if path.label.startswith("label")]
        assert bool(labels) <= (tile.facts["tile"] == 1)
    cuts = [p for p in job.tiles[0].along(Operation.CUT) if Part.MOUTH in p.contour.parts]
    assert len(cuts) == 1


@pytest.mark.parametrize("marked", [True, False])
@pytest.mark.parametrize("name", ["tree", "tapered", "vine"])
def test_the_film_holds_all_that_is_drawn_on_it(trees, small_bed, name, marked):
    profile = small_bed
    if not marked:
        operations = dict(profile.recipe.by_operation)
        operations.pop("mark", None)
        recipe = profile.recipe.changed(operations=operations)
        profile = dataclasses.replace(profile, recipe=recipe)
    job = laser_job(trees[name], profile)
    film = shapely.box(0.0, 0.0, job.sheet_width_mm, job.sheet_height_mm)
    rim = profile.machine.margin_mm.value
    drawn = [*job.paths]
    for tile in job.tiles:
        drawn += [dataclasses.replace(p, contour=back(tile, p.contour)) for p in tile.paths]
    boxes = np.array([path.contour.box_mm for path in drawn])
    # No larger than needed, and with a rim of the machine's margin all around.
    assert boxes[:, :2].min(axis=0) == pytest.approx([rim, rim])
    assert boxes[:, 2:].max(axis=0) == pytest.approx([film.bounds[2] - rim, film.bounds[3] - rim])
    turn = math.radians(job.facts["rotation_deg"])
    flat = body_outline(trees[name], weldcut_offset_mm(profile)).contour
    placed = flat.moved(turn, job.facts["shift_x_mm"], job.facts["shift_y_mm"])
    assert placed.points_mm == pytest.approx(job.along(Operation.WELDCUT)[0].contour.points_mm)


def test_film_that_is_fed_through_moves_along_the_bed_only(trees, small_bed):
    job = laser_job(trees["vine"], small_bed, SheetOptions(pass_through=True))
    heights = {tile.facts["window_y_mm"] for tile in job.tiles}
    assert len(job.tiles) > 2
    assert len(heights) == 1
    for one, two in itertools.pairwise(job.tiles):
        assert one.facts["window_x_mm"] < two.facts["window_x_mm"]
    wide = laser_job(trees["tree"], small_bed, SheetOptions(pass_through=True))
    assert wide.tiles == ()
    assert "wider than the bed" in wide.facts["tiling"]


def test_targets_take_little_more_film_than_the_robot(make_plan, profile):
    """Film of the bed's whole height (400 mm) is not needed for the crosses of a vine of 40 mm."""
    vine = make_plan((40.0,), trunk=1500.0, tail=200.0)
    job = laser_job(vine, profile, SheetOptions(pass_through=True))
    assert len(job.tiles) > 2
    assert job.sheet_height_mm < 300.0
    for tile in job.tiles[1:]:
        assert math.dist(*tile.facts["targets_found_mm"]) >= 150.0


def test_a_robot_that_cannot_be_parted_gives_the_reason(make_plan, small_bed):
    job = laser_job(make_plan((300.0,), trunk=400.0, tail=200.0), small_bed)
    assert job.tiles == ()
    assert "no room to part" in job.facts["tiling"]
