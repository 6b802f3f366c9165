"""Starts in words, and where they lie on a map."""

import math

import pytest
import shapely
from shapely import LineString, Polygon

from vinefab.core.errors import BadInputError
from vinefab.maps.generators.cave import cave_map
from vinefab.model.map import Map, Pose, Start
from vinefab.model.start import (
    StartPlace,
    area_notes,
    share_around,
    start_from,
    start_of_record,
    start_record,
    start_text,
    with_starts,
)

BOX = shapely.box(0, 0, 400, 300)
WALL = shapely.box(0, 100, 60, 200)


def room(*obstacles: Polygon) -> Map:
    return Map(name="room", bounds=BOX, obstacles=obstacles)


POSES = [
    ("250,15,90", (250, 15, 90), (0, 0, 0)),
    ("250 15 90", (250, 15, 90), (0, 0, 0)),
    ("250,15,90+-10", (250, 15, 90), (0, 0, 10)),
    ("250, 15, -90 ± 10", (250, 15, -90), (0, 0, 10)),
    ("250,15,90+/-10, spread 20,5", (250, 15, 90), (20, 5, 10)),
    ("1e2,+15,.5", (100, 15, 0.5), (0, 0, 0)),
]


@pytest.mark.parametrize(("words", "pose", "spread"), POSES)
def test_a_pose_in_words(words: str, pose: tuple[float, ...], spread: tuple[float, ...]) -> None:
    start = start_from(words)
    assert isinstance(start, Start)
    found = start.pose
    assert (found.x_mm, found.y_mm, found.heading_deg) == pytest.approx(pose)
    ranges = (start.spread_x_mm, start.spread_y_mm, math.degrees(start.spread_heading_rad))
    assert ranges == pytest.approx(spread)


PLACES = [
    ("left side", {"side": "left"}),
    ("Anywhere on the LEFT side", {"side": "left"}),
    ("top", {"side": "top"}),
    (
        "right, inset 30, heading 170+-20",
        {"side": "right", "inset_mm": 30.0, "heading": 170, "spread": 20},
    ),
    ("bottom side, heading +-20, clear 4", {"side": "bottom", "spread": 20, "clearance_mm": 4.0}),
    ("line 0,20 0,80 5,90", {"area": LineString([(0, 20), (0, 80), (5, 90)])}),
    ("area 50,480 0,0", {"area": shapely.box(0, 0, 50, 480)}),
    ("area 0,0 9,0 0,9, heading 45", {"area": Polygon([(0, 0), (9, 0), (0, 9)]), "heading": 45}),
]


@pytest.mark.parametrize(("words", "expected"), PLACES)
def test_a_place_in_words(words: str, expected: dict[str, object]) -> None:
    place = start_from(words)
    assert isinstance(place, StartPlace)
    for name in ("side", "inset_mm", "clearance_mm"):
        assert getattr(place, name) == expected.get(name)
    if "area" in expected:
        assert place.area.equals(expected["area"])
    heading = None if place.heading_rad is None else math.degrees(place.heading_rad)
    assert heading == pytest.approx(expected.get("heading"))
    assert math.degrees(place.spread_heading_rad) == pytest.approx(expected.get("spread", 0.0))


@pytest.mark.parametrize("words", [words for words, _ in PLACES])
def test_a_place_says_itself_again(words: str) -> None:
    place = start_from(words)
    again = start_from(place.text)
    assert again.text == place.text
    assert start_of_record(start_record(place)) == place


WRONG = [
    ("", "one place: X,Y,DEG, or left"),
    ("leftt side", "did you mean 'left'"),
    ("left side, head 20", "did you mean 'heading'"),
    ("left right", "one place"),
    ("left 20", "left side without numbers"),
    ("left, heading", "heading DEG, heading DEG"),
    ("left, heading 1,2", "heading DEG, heading DEG"),
    ("left, heading 1, heading 2", "heading once"),
    ("left +-3", "behind heading only"),
    ("left, heading +-400", "+-SPREAD 0 to 360 deg"),
    ("left, heading 3+-", "a number behind +-"),
    ("left, heading 3+-4 5", "+-SPREAD last"),
    ("left, inset -3", "inset_mm 0 to"),
    ("left, inset", "inset MM"),
    ("left, clear -3", "clearance_mm 0 to"),
    ("left, spread 3,4", "no spread together with left"),
    ("area 0,0 9,9, inset 3", "belongs to a side"),
    ("1,2", "three numbers, mm and degrees"),
    ("1,2,3,4", "three numbers, mm and degrees"),
    ("1,2,3, heading 3", "no heading together with pose"),
    ("1,2,3, spread 3", "spread X,Y"),
    ("1,2,1e9", "heading_deg -1e"),
    ("1,2,nan", "X,Y,DEG"),
    ("line 1,1", "two or more points"),
    ("line 1,1 3", "two or more points"),
    ("line 1,1 1,1", "the line has no length"),
    ("line 1e9,0 3,3", "x -1e"),
    ("area 0,0 0,5", "no opposite corners"),
    ("area 0,0 9,9 9,0 0,9", "the polygon is not valid"),
    ("left; $(rm)", "X,Y,DEG"),
    ("9" * 20_000, "X,Y,DEG"),
]


@pytest.mark.parametrize(("words", "allowed"), WRONG)
def test_wrong_words_are_one_line_with_what_is_allowed(words: str, allowed: str) -> None:
    with pytest.raises(BadInputError) as caught:
        start_from(words, "--start")
    message = str(caught.value)
    assert caught.value.key == "--start"
    assert allowed in message
    assert "\n" not in message
    assert len(message) < 500


SIDES = [
    ("left side", (15, 0, 15, 300), (15, 150, 0)),
    ("right side", (385, 0, 385, 300), (385, 150, 180)),
    ("bottom side", (0, 15, 400, 15), (200, 15, 90)),
    ("top side, inset 40", (0, 260, 400, 260), (200, 260, -90)),
    ("line 20,20 20,280", (20, 20, 20, 280), (20, 150, 0)),
    ("line 380,20 380,280", (380, 20, 380, 280), (380, 150, 180)),
    ("area 20,20 60,280", (20, 20, 60, 280), (40, 150, 0)),
    ("area 20,250 380,280, heading 5", (20, 250, 380, 280), (200, 265, 5)),
    ("area 20,250 380,280", (20, 250, 380, 280), (200, 265, -90)),
]


@pytest.mark.parametrize(("words", "box", "pose"), SIDES)
def test_a_place_on_a_map(words: str, box: tuple[float, ...], pose: tuple[float, ...]) -> None:
    start = room().with_start(words).starts[0]
    assert start.area.bounds == pytest.approx(box)
    found = start.pose
    assert (found.x_mm, found.y_mm, found.heading_deg) == pytest.approx(pose)


def test_an_obstacle_on_the_line_moves_the_pose_and_is_said() -> None:
    world = room(WALL).with_start("left side")
    start = world.starts[0]
    assert (start.pose.x_mm, start.pose.y_mm) in {(15.0, 50.0), (15.0, 250.0)}
    share = 100.0 * 2 * (100 - 15 - 15) / 300
    assert area_notes([world]) == [
        f"poses are drawn from the {share:.0f} % of the start's line that is free, at least 15 mm "
        "from walls"
    ]
    both = area_notes([world, room().with_start("area 20,20 90,90")])
    assert both == [
        "poses are drawn from the 47 to 100 % of 2 starts' areas that are free, at least 15 mm "
        "from walls"
    ]
    assert area_notes([room().with_start("area 20,20 90,90")]) == []


def test_a_side_that_is_solid_names_the_map_and_a_way_out() -> None:
    with pytest.raises(BadInputError) as caught:
        cave_map(3).with_start("left side")
    assert "inset MM" in caught.value.allowed
    assert "'left side' on map 'cave_3' meets no free space" in str(caught.value)


NOT_FREE = [
    ("area 500,0 600,50", "on map 'room' meets no free space"),
    ("area 10,110 50,190", "on map 'room' meets no free space"),
    ("line 0,0 0,90", "at least 15 mm from walls"),
    ("line 5,0 5,90", "a smaller clear MM"),
    ("left side, clear 200", "at least 200 mm from walls"),
    ("20,150,0", "inside an obstacle of map 'room'"),
    ("-20,150,0", "outside the bounds of map 'room'"),
]


@pytest.mark.parametrize(("words", "allowed"), NOT_FREE)
def test_a_place_without_room_is_one_line(words: str, allowed: str) -> None:
    with pytest.raises(BadInputError, match=r"^--start: ") as caught:
        with_starts(room(WALL), [start_from(words, "--start")], "--start")
    assert allowed in str(caught.value)


def test_starts_hold_a_line_or_an_area_and_nothing_beside_it() -> None:
    pose = Pose.of((5, 5, 0))
    line = LineString([(0, 0), (9, 0)])
    assert Start(pose=pose, area=line).has_spread
    assert not Start(pose=pose).has_spread
    bad = [
        {"area": shapely.Point(1, 1)},
        {"area": LineString()},
        {"area": LineString([(1, 1), (1, 1)])},
        {"area": Polygon([(0, 0), (9, 9), (9, 0), (0, 9)])},
        {"area": LineString([(0, 0), (1e9, 0)])},
        {"area": line, "spread_x_mm": 3.0},
        {"area": "left side"},
        {"clearance_mm": -1.0},
    ]
    for given in bad:
        with pytest.raises(BadInputError, match=r"start\."):
            Start(pose=pose, **given)
    with pytest.raises(BadInputError, match="needs a side or an area"):
        StartPlace(side="left", area=line)


def test_a_share_of_an_area_lies_in_it_around_the_pose() -> None:
    ring = Polygon([(0, 0), (90, 0), (90, 90), (0, 90)], [[(30, 30), (60, 30), (60, 60), (30, 60)]])
    start = Start(pose=Pose.of((10, 10, 0)), area=ring)
    half = share_around(start, 0.5)
    assert ring.buffer(1e-9).covers(half)
    assert half.contains(shapely.Point(12, 12))
    assert share_around(start, 0.0) is None
    line = Start(pose=Pose.of((0, 15, 0)), area=LineString([(0, 10), (0, 30)]))
    assert share_around(line, 0.5).bounds == (0.0, 12.5, 0.0, 22.5)


def test_records_keep_every_bit_and_older_ones_are_read() -> None:
    pose = Pose(x_mm=0.1, y_mm=1 / 3, heading_rad=0.7)
    old = {
        "pose": {"x_mm": 0.1, "y_mm": 1 / 3, "heading_rad": 0.7},
        "spread_x_mm": 2.0,
        "spread_y_mm": 0.0,
        "spread_heading_rad": 0.0,
    }
    start = Start(pose=pose, spread_x_mm=2.0)
    assert start_record(start) == old
    assert start_of_record(old) == start
    area = Start(pose=pose, area=LineString([(0, 1 / 3), (1, 2)]), clearance_mm=7.0)
    assert start_of_record(start_record(area)) == area
    assert "line 0,0.333" in start_text(area)
    assert "clearance_mm = 7" in start_text(area)
