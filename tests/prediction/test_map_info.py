import math
import xml.etree.ElementTree as ET
from dataclasses import replace

import pytest
import shapely

from vinefab.core.errors import BadInputError
from vinefab.maps.generators.grid import grid_map
from vinefab.model.map import Map, Pose, Start
from vinefab.prediction.map_info import map_info


def start_at(x_mm, y_mm):
    return Start(pose=Pose(x_mm=x_mm, y_mm=y_mm, heading_rad=0.0))


def two_rooms(door_mm):
    """Two rooms of 50 x 60 mm with a door between them, the start in the left one."""
    walls = (shapely.box(50, 0, 54, 30 - door_mm / 2), shapely.box(50, 30 + door_mm / 2, 54, 60))
    return Map(
        name="rooms",
        bounds=shapely.box(0, 0, 104, 60),
        obstacles=walls,
        starts=(start_at(25.0, 25.0),),
    )


def test_largest_body_in_a_corridor_of_known_width():
    corridor = Map(name="c", bounds=shapely.box(0, 0, 300, 12), starts=(start_at(20.0, 6.0),))
    info = map_info(corridor)
    assert [gate.passage.width_mm for gate in info.passages] == pytest.approx([12.0])
    assert info.passages[0].between == ("bounds", "bounds")
    assert info.starts[0].clearance_mm == pytest.approx(6.0)
    assert info.starts[0].body_mm == pytest.approx(math.pi * 6.0)
    # Only the corners of the corridor are out of reach of a body that just fits.
    assert info.widest_mm[0.9] == pytest.approx(math.pi * 6.0, rel=0.01)
    assert map_info(corridor, width_mm=math.pi * 5.999).body.share == pytest.approx(
        1.0 - (4.0 - math.pi) * 36.0 / 3600.0, abs=2e-3
    )
    assert map_info(corridor, width_mm=math.pi * 6.001).body.share == 0.0


def test_a_door_decides_how_wide_a_body_has_room_in_both_rooms():
    info = map_info(two_rooms(8.0))
    assert info.passages[0].passage.width_mm == pytest.approx(8.0)
    assert set(info.passages[0].between) == {"obstacle 1", "obstacle 2"}
    assert info.passages[0].body_mm == pytest.approx(math.pi * 4.0)
    # 90 % takes both rooms, so the body has to go through the door; 45 % is one room.
    assert info.widest_mm[0.9] == pytest.approx(math.pi * 4.0, rel=0.07)
    assert info.widest_mm[0.9] < math.pi * 4.05
    for width_mm, share in ((math.pi * 3.9, 0.99), (math.pi * 4.1, 0.49)):
        assert map_info(two_rooms(8.0), width_mm=width_mm).body.share == pytest.approx(
            share, abs=0.02
        )


def test_a_notch_is_told_from_a_door():
    world = two_rooms(8.0)
    (left, *others) = world.obstacles
    notch = shapely.box(50, 10, 52, 12)  # 2 mm deep; behind its middle 2 mm2
    info = map_info(replace(world, obstacles=(left - notch, *others)))
    lines = [line.split() for line in info.summary if " and obstacle " in line]
    assert lines[0][:4] == ["2.00", "mm", "51.0", "11.0"]
    assert lines[0][-2:] == ["1.6", "mm"]
    assert lines[1][:2] == ["8.00", "mm"]
    assert lines[1][-1] == "-"
    notch, door = info.numbers["passages"][:2]
    assert notch["dead_end_mm"] == pytest.approx(math.sqrt(8.0 / math.pi))
    assert door["dead_end_mm"] is None


def test_regions_and_areas():
    world = two_rooms(8.0)
    shut = Map(
        name="shut",
        bounds=world.bounds,
        obstacles=(shapely.box(50, 0, 60, 60), shapely.box(70, 10, 80, 20)),
        starts=world.starts,
    )
    info = map_info(shut)
    assert info.regions_mm2 == pytest.approx((3000.0, 44.0 * 60 - 100))
    assert info.free_share == pytest.approx(5540.0 / 6240.0)
    assert info.widest_mm[0.9] is None
    assert info.widest_mm[0.5] > 20.0


def test_starts_without_room_and_maps_without_starts():
    walls = two_rooms(8.0).obstacles
    on_wall = Map(
        name="w", bounds=shapely.box(0, 0, 104, 60), obstacles=walls, starts=(start_at(0.0, 30.0),)
    )
    info = map_info(on_wall, width_mm=5.0)
    assert info.starts[0].clearance_mm == 0.0
    assert info.widest_mm == {0.9: None, 0.5: None}
    assert info.body.share == 0.0
    bare = map_info(Map(name="b", bounds=shapely.box(0, 0, 10, 10)), width_mm=5.0)
    assert any("no start" in line for line in bare.summary)
    assert bare.numbers["starts"] == []


def test_a_map_without_free_space_is_a_result_too():
    full = shapely.box(0, 0, 10, 10)
    info = map_info(
        Map(name="f", bounds=full, obstacles=(full,), starts=(start_at(5.0, 5.0),)), width_mm=1.0
    )
    assert (info.passages, info.regions_mm2, info.body.share) == ((), (), 0.0)
    assert info.numbers["free_share"] == 0.0


def test_picture_is_the_same_every_time_and_shows_every_passage():
    info = map_info(grid_map(4), width_mm=12.0, passages=4)
    picture = info.picture(".svg")
    assert picture == info.picture(".svg")
    assert ET.fromstring(picture).tag.endswith("svg")  # noqa: S314  our own text
    assert info.picture(".png").startswith(b"\x89PNG")


@pytest.mark.parametrize("wrong", [{"width_mm": 0.0}, {"width_mm": math.nan}, {"passages": -1}])
def test_numbers_out_of_range_are_named(wrong):
    with pytest.raises(BadInputError, match=r"width_mm|passages"):
        map_info(two_rooms(8.0), **wrong)


def test_lines_and_json_show_the_numbers_of_a_corridor():
    world = Map(name="c", bounds=shapely.box(0, 0, 300, 12), starts=(start_at(20.0, 6.0),))
    info = map_info(world, width_mm=10.0)
    lines = info.summary
    assert lines[:2] == ("map: c", "size: 300 x 12 mm")
    assert "free area: 0.0036 m2 (computed)" in lines
    assert "of the bounds: 100.0 %" in lines
    rows = [line.split() for line in lines]
    assert ["12.00", "mm"] in [row[:2] for row in rows]
    assert ["20.00,6.00,0.00", "6.00", "mm", "18.85", "mm"] in rows
    assert ["90", "%", "18.7", "mm"] in rows
    assert ["50", "%", "18.7", "mm"] in rows
    # The search for the widest body stops within 1 % of 18.85 mm.
    # All but the corners: (4 - pi) r^2 with r the inflated radius, 10 / pi.
    share = 1.0 - (4.0 - math.pi) * (10.0 / math.pi) ** 2 / 3600.0
    assert f"has room in: {100 * share:.1f} %" in lines
    assert lines[-1] == "passages too narrow for it: 0 of 1 above"
    narrow = map_info(world, width_mm=19.0).summary
    assert narrow[-2:] == ("has room in: 0.0 %", "passages too narrow for it: 1 of 1 above")
    document = info.numbers
    assert (document["schema"], document["standing"]) == ("vinefab/map-info-1", "computed")
    assert document["body"]["fits"] is True
    assert document["size_mm"] == [300.0, 12.0]
    assert (document["walls"], document["vertices"], document["obstacles"]) == (4, 4, 0)
    assert document["free_area_mm2"] == pytest.approx(3600.0)
    assert document["regions_mm2"] == pytest.approx([3600.0])
    assert document["passages"][0]["width_mm"] == pytest.approx(12.0)
    assert document["passages"][0]["widest_body_mm"] == pytest.approx(6.0 * math.pi)
    assert document["starts"][0]["clearance_mm"] == pytest.approx(6.0)
    assert document["starts"][0]["widest_body_mm"] == pytest.approx(6.0 * math.pi)
    assert [entry["free_share"] for entry in document["widest_body"]] == [0.9, 0.5]
    assert document["body"]["free_share"] == pytest.approx(share, abs=1e-3)


def test_free_share_is_of_the_bounds():
    half = Map(name="h", bounds=shapely.box(0, 0, 100, 40), obstacles=(shapely.box(0, 0, 30, 40),))
    assert "of the bounds: 70.0 %" in map_info(half).summary


def test_obstacles_that_reach_over_the_bounds_are_named_with_their_share():
    obstacles = [shapely.box(40 * k, 50, 40 * k + 20, 50 + high) for k, high in ((0, 9), (1, 40))]
    world = Map(name="room", bounds=shapely.box(0, 0, 100, 60), obstacles=tuple(obstacles))
    info = map_info(world, passages=0)
    assert info.outside == {2: pytest.approx(0.75)}
    assert ["2", "75", "%"] in [line.split() for line in info.summary]
    assert info.numbers["obstacles_outside"] == [{"obstacle": 2, "share": 0.75}]
    assert map_info(two_rooms(8.0), passages=0).outside == {}
