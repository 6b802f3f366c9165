import numpy as np
import pytest
import shapely

from vinefab.core.errors import BadInputError
from vinefab.core.rng import child
from vinefab.maps.generators.corridors import (
    CorridorsOptions,
    Region,
    corridors_map,
    doorways,
    floor_plan,
)

FLOOR = CorridorsOptions(
    height_mm=400.0,
    hall_width_mm=40.0,
    room_min_mm=80.0,
    room_max_mm=170.0,
    door_mm=25.0,
    loops=0.0,
)


def plan(seed: int, halls: int) -> list[Region]:
    return floor_plan(child(seed), FLOOR.changed(halls=halls))


@pytest.mark.parametrize("seed", range(10))
def test_a_floor_is_halls_rooms_and_nothing_but_walls_between(seed: int) -> None:
    regions = plan(seed, 3)
    rooms = [region for region in regions if not region.hall]
    assert len(regions) - len(rooms) == 3
    for region in rooms:
        assert all(80.0 - 1e-3 <= region.length(axis) <= 170.0 for axis in (0, 1))
    for region in regions:
        if region.hall:
            assert min(region.length(0), region.length(1)) == pytest.approx(40.0, abs=1e-3)
    boxes = shapely.box(*np.array([region[:4] for region in regions]).T)
    apart = shapely.distance(boxes[:, None], boxes) + 1e9 * np.eye(len(boxes))
    # Grown by half a wall they cover the floor without overlap, but for what is by the sides.
    assert apart.min() == pytest.approx(6.0, abs=1e-3)
    grown = shapely.union_all(shapely.buffer(boxes, 3.001, join_style="mitre"))
    assert shapely.box(3, 3, 497, 397).difference(grown).area < 1.0


def test_no_wall_stands_in_the_area_that_is_kept_out() -> None:
    rules = FLOOR.changed(halls=0)
    area = Region(210.0, 120.0, 260.0, 170.0)
    inner = shapely.box(*area[:4]).buffer(-1e-3)
    for seed in range(40):
        rooms = [shapely.box(*room[:4]) for room in floor_plan(child(seed), rules, area)]
        assert inner.difference(shapely.union_all(rooms)).is_empty, seed


def test_every_room_by_a_hall_opens_on_it_and_halls_open_on_each_other() -> None:
    rules = FLOOR.changed(door_mm=20.0)
    for seed in range(10):
        regions = plan(seed, 3)
        doors = doorways(child(seed, 1), regions, rules)
        assert len(doors) == len(regions) - 1
        boxes = [shapely.box(*region[:4]) for region in regions]
        for region, own in zip(regions, boxes, strict=True):
            near = [o for r, o in zip(regions, boxes, strict=True) if r.hall and r != region]
            beside = max(shapely.length(shapely.intersection(own.buffer(6.1), near)), default=0.0)
            opened = [shapely.box(*door[:4]).buffer(0.01) for door in doors]
            to_hall = [
                d for d in opened if d.intersects(own) and any(d.intersects(h) for h in near)
            ]
            # A strip 0.1 wide along the common wall: twice its length around.
            assert to_hall or beside < 2.0 * 30.0


def test_doors_have_their_width_and_keep_off_the_corners() -> None:
    regions = plan(4, 2)
    doors = doorways(child(4, 1), regions, FLOOR.changed(loops=1.0))
    sizes = [sorted((door.length(0), door.length(1))) for door in doors]
    assert sizes == [pytest.approx([6.0, size[1]], abs=1e-3) for size in sizes]
    widths = {round(size[1], 2) for size in sizes}
    assert widths == {25.0, 40.0}
    fewer = doorways(child(4, 1), regions, FLOOR)
    assert len(fewer) == len(regions) - 1 < len(doors)


@pytest.mark.parametrize("seed", range(6))
def test_a_body_as_wide_as_a_door_gets_into_every_room(seed: int) -> None:
    options = CorridorsOptions(loops=0.0)
    free = corridors_map(seed, options).free_space
    assert free.buffer(-0.5 * options.door_mm + 0.01).geom_type == "Polygon"
    assert free.buffer(-0.5 * options.door_mm - 0.01).geom_type == "MultiPolygon"


def test_robots_start_in_the_first_hall() -> None:
    for seed in range(8):
        world = corridors_map(seed)
        (start,) = world.starts
        hall = shapely.box(start.pose.x_mm - 21.9, 0.1, start.pose.x_mm + 21.9, 499.9)
        assert world.free_space.contains(hall)
    (start,) = corridors_map(0, CorridorsOptions(halls=0)).starts
    assert start.pose.x_mm == 250.0


def test_options_do_what_they_say() -> None:
    small = corridors_map(1, CorridorsOptions(room_max_mm=180.0))
    large = corridors_map(1, CorridorsOptions(room_max_mm=400.0))
    assert small.facts["rooms"] > large.facts["rooms"]
    wide = corridors_map(1, CorridorsOptions(width_mm=900.0, height_mm=300.0))
    assert wide.size_mm == (900.0, 300.0)


def test_too_many_halls_are_refused() -> None:
    with pytest.raises(BadInputError, match="halls is 40"):
        corridors_map(0, CorridorsOptions(halls=40))
