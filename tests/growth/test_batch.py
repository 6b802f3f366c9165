"""Batches give what single growths give, however they are cut and worked off."""

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from shapely import box

from vinefab.core.errors import BadInputError, UnknownNameError
from vinefab.growth import batch as batch_module
from vinefab.growth.batch import MOST_KEPT, Batch, Launches, TerrainSet, grow_on
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plans
from vinefab.growth.terrain import Terrain
from vinefab.model.map import Map, Pose

KINDS = ("convex", "star", "needles", "lattice")
NAMES = ("points_mm", "first_point", "stop", "grown_mm", "contact_turn_rad")


def same(one, other):
    return all(np.array_equal(getattr(one, name), getattr(other, name)) for name in NAMES)


@pytest.fixture(params=["centerline", "inflated"])
def case(request, random_map, random_pose, random_tree):
    rng = np.random.default_rng(31)
    options = GrowthOptions.published(body=request.param, children_of_stuck="deploy")
    terrains = [Terrain.of(random_map(rng, kind)) for kind in KINDS]
    poses = [[random_pose(rng, ground) for _ in range(5)] for ground in terrains]
    designs = [random_tree(rng) for _ in range(9)]
    angles_deg = np.linspace(1.0, 20.0, 20)
    launches = Launches.of(TerrainSet(terrains), poses, np.radians(angles_deg))
    batch = Batch(Plans.of(designs, options), launches, options)
    places = [(ground, pose) for ground, row in zip(terrains, poses, strict=True) for pose in row]
    alone = [
        grow_on(design, ground, pose, options.changed(head_on_half_angle_deg=angle_deg))
        for (ground, pose), angle_deg in zip(places, angles_deg, strict=True)
        for design in designs
    ]
    return batch, alone


def test_a_batch_is_the_same_as_its_growths_one_by_one(case):
    batch, alone = case
    together = batch.deployments()
    assert len(together) == len(batch) == len(alone) == 180
    assert all(same(one, other) for one, other in zip(together, alone, strict=True))
    assert len({grown.deployed.sum() for grown in alone}) > 2


def test_neither_threads_nor_blocks_change_anything(case):
    batch, alone = case
    with ThreadPoolExecutor(max_workers=4) as pool:
        for size in (1, 7, 64, 1000):
            parts = batch.each(lambda b: [b.deployment(k) for k in range(len(b))], pool.map, size)
            found = [grown for part in parts for grown in part]
            assert all(same(one, other) for one, other in zip(found, alone, strict=True))


def test_tips_and_maps_of_a_block_are_those_of_its_growths(case):
    batch, alone = case

    def parts(block):
        tips, first = block.tips_mm()
        return tips.copy(), first, block.by_terrain(), block.planned_mm()

    done = 0
    for tips, first, by_terrain, planned in batch.each(parts, size=50):
        grown = alone[done : done + len(planned)]
        for index, one in enumerate(grown):
            assert np.array_equal(tips[first[index] : first[index + 1]], one.tips_mm)
            assert planned[index] == one.tree.total_length_mm
        spans = [(done + one) // 45 == terrain for terrain, one, _ in by_terrain]
        assert all(spans)
        assert by_terrain[0][1] == 0
        assert by_terrain[-1][2] == len(planned)
        done += len(planned)


def test_trees_with_more_contacts_than_expected_get_more_room(case, monkeypatch):
    batch, alone = case
    monkeypatch.setattr(batch_module, "POINTS_PER_BRANCH", 1)
    monkeypatch.setattr(batch_module, "SPARE_POINTS", 0)
    found = batch.deployments()
    assert all(same(one, other) for one, other in zip(found, alone, strict=True))


def test_a_launch_in_solid_is_refused_and_one_a_trifle_outside_is_put_on_the_wall():
    ground = Terrain.of(Map(name="room", bounds=box(0.0, 0.0, 100.0, 100.0)))
    trifle = Pose(x_mm=100.0 + 5e-8, y_mm=50.0, heading_rad=0.0)
    assert Launches.of(TerrainSet([ground]), [[trifle]]).start[0, 0] == 100.0
    with pytest.raises(BadInputError, match="outside the bounds"):
        Launches.of(TerrainSet([ground]), [[trifle, Pose(x_mm=101.0, y_mm=50.0, heading_rad=0.0)]])


def test_an_atlas_keeps_what_it_has_put_together_but_not_for_ever():
    atlas = TerrainSet([Terrain.of(Map(name="room", bounds=box(0.0, 0.0, 100.0, 100.0)))])
    bare = atlas.arrays((0.0,))
    assert atlas.arrays((0.0,)) is bare
    for step in range(2 * MOST_KEPT):
        atlas.arrays((1.0 + step,))
    assert atlas.arrays((0.0,)) is not bare
    assert len(atlas._kept) <= MOST_KEPT


def test_half_angles_of_a_range_are_spread_evenly_over_a_batch():
    options = GrowthOptions.published(head_on_half_angle_rad=(0.1, 0.3))
    angles = options.half_angles_rad(400)
    assert ((angles >= 0.1) & (angles <= 0.3)).all()
    counts, _ = np.histogram(angles, bins=10, range=(0.1, 0.3))
    assert counts.min() >= 39
    assert options.half_angle_text == "5.72958 to 17.1887 deg"
    with pytest.raises(BadInputError, match="one number"):
        options.only_half_angle_rad  # noqa: B018  the property raises
    with pytest.raises(BadInputError, match="head_on_half_angle_deg"):
        GrowthOptions.published(head_on_half_angle_rad=(0.3, 0.1))


def test_options_are_read_back_from_their_content():
    wide = GrowthOptions.published(
        head_on_half_angle_rad=(math.radians(1.0), math.radians(15.0)),
        children_of_stuck="deploy",
        body="inflated",
        pressure_stop=True,
        storage_kpa=2.0,
    )
    for options in (GrowthOptions.published(), GrowthOptions.published(), wide):
        again = GrowthOptions.of(options.content)
        assert again.content == options.content
    changed = GrowthOptions.of({"storage_kpa": 1.0}, wide)
    assert (changed.storage_kpa, changed.body) == (1.0, "inflated")
    for name, value in (
        ("head_on_half_angle_deg", [1.0, 2.0, 3.0]),
        ("head_on_half_angle_deg", 91.0),
        ("head_on_half_angle_deg", "x"),
        ("body", "wide"),
        ("pressure_stop", 1),
        ("storage_kpa", -1.0),
    ):
        with pytest.raises(BadInputError, match=name):
            GrowthOptions.of({name: value})
    with pytest.raises(UnknownNameError, match="growth option"):
        GrowthOptions.of({"bodi": "inflated"})
