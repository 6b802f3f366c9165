import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon

from vinefab.core.atomic import is_ours, write_text
from vinefab.core.errors import BadInputError, UnreadableFileError
from vinefab.maps.generators.grid import grid_map
from vinefab.model.map import Map, Pose, Start, map_text

BOX = [[0, 0], [100, 0], [100, 100], [0, 100], [0, 0]]
BLOCK = [[40, 40], [60, 40], [60, 60], [40, 60], [40, 40]]


def feature(kind: str, coordinates: Any, **properties: Any) -> dict[str, Any]:
    geometry = {"type": kind, "coordinates": coordinates}
    return {"type": "Feature", "properties": properties, "geometry": geometry}


def collection(*features: dict[str, Any], **members: Any) -> dict[str, Any]:
    return {"type": "FeatureCollection", **members, "features": list(features)}


BOUNDS = feature("Polygon", [BOX], role="bounds")
OBSTACLE = feature("Polygon", [BLOCK], role="obstacle")


def start(x: Any, y: Any, **properties: Any) -> dict[str, Any]:
    return feature("Point", [x, y], **{"role": "start", "heading_deg": 90, **properties})


@pytest.fixture
def reading(tmp_path: Path) -> Any:
    def read(document: Any) -> Map:
        path = tmp_path / "world.geojson"
        text = document if isinstance(document, str) else json.dumps(document)
        path.write_text(text, encoding="utf-8")
        return Map.read(path)

    return read


def assert_same_map(first: Map, second: Map) -> None:
    assert first.bounds.normalize() == second.bounds.normalize()
    assert [p.normalize() for p in first.obstacles] == [p.normalize() for p in second.obstacles]
    for one, two in zip(first.starts, second.starts, strict=True):
        assert two.pose.x_mm == pytest.approx(one.pose.x_mm, abs=1e-6)
        assert two.pose.heading_rad == pytest.approx(one.pose.heading_rad, abs=1e-10)
        assert two.spread_heading_rad == pytest.approx(one.spread_heading_rad, abs=1e-10)
        assert (two.spread_x_mm, two.spread_y_mm) == (one.spread_x_mm, one.spread_y_mm)
    assert (first.name, first.environment, first.seed) == (
        second.name,
        second.environment,
        second.seed,
    )
    assert dict(first.facts) == dict(second.facts)


def test_a_generated_map_comes_back_exactly(reading: Any) -> None:
    world = grid_map(5)
    again = reading(map_text(world))
    assert_same_map(world, again)
    assert map_text(again) == map_text(world)


def test_holes_and_facts_survive(reading: Any) -> None:
    ring = Polygon(BLOCK, [[(45, 45), (45, 55), (55, 55), (55, 45)]])
    bounds = Polygon(BOX, [[(5, 5), (5, 10), (10, 10), (10, 5)]])
    world = Map(
        name="ring",
        bounds=bounds,
        obstacles=(ring,),
        starts=(Start(pose=Pose(x_mm=50, y_mm=50, heading_rad=-1.2), spread_x_mm=2.5),),
        environment="ros",
        facts={"resolution_m": np.float64(0.05), "lost": {"islands": 2}},
    )
    again = reading(map_text(world))
    assert_same_map(world, again)
    assert again.seed is None
    assert len(again.obstacles[0].interiors) == len(again.bounds.interiors) == 1


def test_the_text_is_the_contract(tmp_path: Path) -> None:
    document = json.loads(map_text(grid_map(2)))
    assert document["type"] == "FeatureCollection"
    about = document["vinefab"]
    assert (about["schema"], about["environment"], about["seed"]) == ("vinefab/map-1", "grid", 2)
    roles = [item["properties"]["role"] for item in document["features"]]
    assert roles == ["bounds"] + ["obstacle"] * 36 + ["start"]
    assert document["features"][-1]["properties"]["heading_deg"] == 90.0
    for item in document["features"][:-1]:
        (ring,) = item["geometry"]["coordinates"]
        assert ring[0] == ring[-1]
        assert shapely.is_ccw(shapely.LinearRing(ring))
    assert is_ours(write_text(tmp_path / "m.geojson", map_text(grid_map(2))))


@settings(max_examples=25, deadline=None)
@given(st.floats(1e-2, 1e6), st.floats(-9e5, 9e5), st.integers(3, 12))
def test_any_scale_comes_back_to_a_nanometre(scale: float, shift: float, corners: int) -> None:
    angles = np.arange(corners) * 2 * np.pi / corners
    points = shift + scale * np.column_stack([np.cos(angles), np.sin(angles)])
    world = Map(name="any", bounds=Polygon(points))
    lines = json.loads(map_text(world))["features"]
    again = np.array(lines[0]["geometry"]["coordinates"][0])
    distance = np.abs(again[:-1, None] - points).max(axis=2).min(axis=1)
    assert distance.max() <= 5.1e-7


def test_without_roles_the_largest_is_the_bounds(reading: Any) -> None:
    other = [[[10, 10], [20, 10], [10, 20]]]
    parts = feature("MultiPolygon", [other, [[[70, 70], [80, 70], [70, 80], [70, 70]]]])
    world = reading(collection(feature("Polygon", [BLOCK]), feature("Polygon", [BOX]), parts))
    assert world.bounds.area == 10_000
    assert [p.area for p in world.obstacles] == [400, 50, 50]
    assert world.starts == ()
    assert (world.name, world.environment, world.seed) == ("world", "geojson", None)


def test_bounds_with_a_large_hole_are_still_the_bounds(reading: Any) -> None:
    hole = [[1, 1], [1, 99], [99, 99], [99, 1], [1, 1]]
    world = reading(collection(feature("Polygon", [BLOCK]), feature("Polygon", [BOX, hole])))
    assert world.bounds.area == 10_000 - 98 * 98


def test_a_z_coordinate_and_an_open_ring_do_no_harm(reading: Any) -> None:
    ring = [[x, y, 7.0] for x, y in BOX[:-1]]
    assert reading(collection(feature("Polygon", [ring]))).bounds.area == 10_000


def test_a_start_on_the_wall_is_in_free_space(reading: Any) -> None:
    world = reading(collection(BOUNDS, OBSTACLE, start(50, 0), start(40, 50)))
    assert len(world.starts) == 2


BOW_TIE = [[10, 10], [30, 30], [30, 10], [10, 30], [10, 10]]
BAD_CONTENT = [
    ("no features", collection(), r"features is 'no polygons'; allowed: at least one polygon"),
    ("a list", [], r"type is 'list'; allowed: FeatureCollection"),
    ("a geometry", {"type": "Polygon", "coordinates": [BOX]}, r"type is 'Polygon'"),
    ("features not a list", {"type": "FeatureCollection", "features": 3}, r"features is 3"),
    ("no bounds", collection(OBSTACLE), r"bounds is '0 polygons'; allowed: exactly one"),
    ("two bounds", collection(BOUNDS, BOUNDS), r"bounds is '2 polygons'"),
    (
        "crossing",
        collection(BOUNDS, feature("Polygon", [BOW_TIE], role="obstacle")),
        r"features\[2\] is 'Self-intersection at \(20, 20\)'",
    ),
    (
        "hole outside",
        collection(BOUNDS, feature("Polygon", [BLOCK, BOW_TIE[:3]], role="obstacle")),
        r"features\[2\] is 'Hole lies outside shell at",
    ),
    ("two points", collection(feature("Polygon", [[[0, 0], [1, 1], [0, 0]]])), r"2 different"),
    ("no ring", collection(feature("Polygon", [])), r"an outer ring, then holes"),
    ("NaN", collection(feature("Polygon", [[[float("nan"), 0], [1, 0], [0, 1]]])), r"\[nan, 0\]"),
    ("huge", collection(feature("Polygon", [[[0, 0], [1e9, 0], [0, 1]]])), r"1000000000"),
    ("huge integer", collection(feature("Polygon", [[[0, 0], [10**400, 0], [0, 1]]])), r"1e\+07"),
    ("words", collection(feature("Polygon", [[["a", "b"], [1, 0], [0, 1]]])), r"\['a', 'b'\]"),
    ("truth", collection(feature("Polygon", [[[True, 0], [1, 0], [0, 1]]])), r"\[True, 0\]"),
    ("a line", collection(feature("LineString", BOX)), r"'LineString'; allowed: Polygon or Mult"),
    ("no geometry", collection({"type": "Feature", "geometry": None}), r"geometry is missing"),
    ("role", collection(BOUNDS, feature("Polygon", [BLOCK], role="wall")), r"role is 'wall'"),
    ("role missing", collection(BOUNDS, feature("Polygon", [BLOCK])), r"\[2\]\.\S+role is missing"),
    (
        "in obstacle",
        collection(BOUNDS, OBSTACLE, start(50, 45)),
        r"\(50, 45\) mm is inside an obst",
    ),
    ("outside", collection(BOUNDS, OBSTACLE, start(150, 45)), r"\(150, 45\) mm is outside the bou"),
    ("no heading", collection(BOUNDS, start(5, 5, heading_deg=None)), r"heading_deg is missing"),
    ("heading", collection(BOUNDS, start(5, 5, heading_deg="up")), r"heading_deg is 'up'"),
    ("spread", collection(BOUNDS, start(5, 5, spread_x_mm=-1)), r"spread_x_mm is -1"),
    (
        "start is no shape",
        collection(BOUNDS, feature("MultiPoint", [[5, 5]], role="start")),
        r"features\[2\].geometry.type is 'MultiPoint'; allowed: Point, LineString, Polygon",
    ),
    ("schema", collection(BOUNDS, vinefab={"schema": "vinefab/map-9"}), r"vinefab.schema is 'vin"),
    ("no schema", collection(BOUNDS, vinefab={}), r"vinefab.schema is missing"),
    ("member", collection(BOUNDS, vinefab=[1]), r"vinefab is \[1\]"),
    (
        "seed",
        collection(BOUNDS, vinefab={"schema": "vinefab/map-1", "seed": "x"}),
        r"vinefab.seed is 'x'; allowed: a valid integer",
    ),
    (
        "not contained",
        collection(feature("Polygon", [BOX]), feature("Polygon", [[[90, 5], [150, 5], [90, 9]]])),
        r"features\[2\]: position \(.*outside the largest polygon, features\[1\]",
    ),
]


@pytest.mark.parametrize(
    ("document", "message"), [case[1:] for case in BAD_CONTENT], ids=[c[0] for c in BAD_CONTENT]
)
def test_bad_content_is_one_clear_line(reading: Any, document: Any, message: str) -> None:
    with pytest.raises(BadInputError, match=message) as caught:
        reading(document)
    text = str(caught.value)
    assert "world.geojson" in text
    assert "\n" not in text


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("schema = 1", "is not JSON"),
        ("", "is not JSON"),
        ('{"type": "FeatureCollection", "features": [', "is not JSON"),
        ("[" * 200_000, "is not JSON"),
        ("9" * 5000, "is not JSON"),
    ],
)
def test_what_is_not_json_is_unreadable(reading: Any, text: str, message: str) -> None:
    with pytest.raises(UnreadableFileError, match=message):
        reading(text)


LINE = [[5, 5], [5, 95]]
SQUARE = [[[5, 5], [30, 5], [30, 30], [5, 30], [5, 5]]]


@pytest.mark.parametrize(
    ("words", "kind"),
    [
        ("left side, heading 0+-20", "LineString"),
        ("line 20,20 20,80 30,90, clear 3", "LineString"),
        ("area 5,5 30,30, heading 45+-10", "Polygon"),
        ("area 5,5 30,5 5,40", "Polygon"),
    ],
)
def test_starts_of_lines_and_areas_come_back(reading: Any, words: str, kind: str) -> None:
    world = Map(name="m", bounds=shapely.box(0, 0, 100, 100)).with_start(words)
    text = map_text(world)
    assert json.loads(text)["features"][-1]["geometry"]["type"] == kind
    again = reading(text)
    (one,), (two,) = world.starts, again.starts
    assert two.area.normalize() == one.area.normalize()
    assert two.pose.heading_rad == pytest.approx(one.pose.heading_rad, abs=1e-9)
    assert (two.pose.x_mm, two.pose.y_mm) == (one.pose.x_mm, one.pose.y_mm)
    assert two.clearance_mm == one.clearance_mm
    assert two.spread_heading_rad == pytest.approx(one.spread_heading_rad)
    assert map_text(again) == text


def test_a_line_or_side_of_another_program_needs_no_more_than_its_role(reading: Any) -> None:
    line = feature("LineString", LINE, role="start", clearance_mm=4)
    side = {
        "type": "Feature",
        "geometry": None,
        "properties": {"role": "start", "side": "right", "inset_mm": 10, "spread_heading_deg": 9},
    }
    area = feature("Polygon", SQUARE, role="start", heading_deg=45)
    world = reading(collection(BOUNDS, OBSTACLE, line, side, area, start(50, 10)))
    assert [one.pose.heading_deg for one in world.starts] == pytest.approx([0, 180, 45, 90])
    assert [(one.pose.x_mm, one.pose.y_mm) for one in world.starts[:2]] == [(5, 50), (90, 50)]
    assert [one.clearance_mm for one in world.starts[:3]] == [4.0, 10.0, 15.0]
    assert world.starts[1].area.bounds == (90, 0, 90, 100)
    assert [one.area is None for one in world.starts] == [False, False, False, True]


def start_of(kind: str, coordinates: Any, **properties: Any) -> dict[str, Any]:
    return collection(BOUNDS, OBSTACLE, feature(kind, coordinates, role="start", **properties))


BAD_STARTS = [
    (start_of("LineString", [[5, 5]]), r"\[3\].geometry.coordinates .*two or more positions"),
    (start_of("LineString", [[5, 5], [5, 5]]), r"\[3\].geometry: the line has no length"),
    (start_of("LineString", [[5, 5], [5, "a"]]), r"features\[3\] is .*numbers"),
    (start_of("Polygon", [[[5, 5], [9, 9], [9, 5], [5, 9]]]), r"features\[3\] is 'Self-inter"),
    (
        start_of("LineString", LINE, side="left"),
        r"\[3\].properties.side is given together with a geometry",
    ),
    (start_of("LineString", LINE, spread_x_mm=3), r"spread_x_mm means nothing with a line"),
    (start_of("LineString", LINE, clearance_mm=-1), r"\[3\].properties.clearance_mm is -1"),
    (start_of("LineString", LINE, inset_mm=1), r"\[3\].properties.inset_mm belongs to a side"),
    (start_of("LineString", LINE), r"features\[3\]: 'line 5,5 5,95' on map .*15 mm from walls"),
    (start_of("Polygon", [BLOCK]), r"features\[3\]: 'area 40,40 60,60' .*meets no free space"),
    (start_of("LineString", [[-9, 0], [-9, 9]]), r"features\[3\]: .*meets no free space"),
    (
        start_of("LineString", LINE, heading_deg=0, x_mm=-5, y_mm=5),
        r"\(-5, 5\) mm is outside the b",
    ),
    (
        start_of("Point", [5, 5], heading_deg=0, inset_mm=5),
        r"inset_mm is given together with a",
    ),
    (
        start_of("Point", [5, 5], side="lefft"),
        r"side is 'lefft'; .*did you mean 'left'|no geometry",
    ),
]


@pytest.mark.parametrize(("document", "message"), BAD_STARTS)
def test_a_start_that_cannot_be_used_is_one_clear_line(
    reading: Any, document: Any, message: str
) -> None:
    with pytest.raises(BadInputError, match=message) as caught:
        reading(document)
    assert "world.geojson" in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_jagged_outline_is_tested_for_validity_once(monkeypatch, tmp_path):
    disc = shapely.Point(200, 150).buffer(80, quad_segs=500)
    path = tmp_path / "disc.geojson"
    path.write_text(
        map_text(Map(name="disc", bounds=shapely.box(0, 0, 400, 300), obstacles=(disc,)))
    )
    tested, is_valid = [], shapely.is_valid
    monkeypatch.setattr(shapely, "is_valid", lambda shape: tested.append(shape) or is_valid(shape))
    assert len(Map.read(path).obstacles[0].exterior.coords) == 2001
    assert sum(shapely.get_num_coordinates(shape).sum() > 1000 for shape in tested) == 1


def test_an_outline_of_too_many_long_teeth_is_refused_before_it_is_swept(monkeypatch):
    angle = np.arange(40_000) * 2.0 * np.pi / 40_000
    teeth = np.where(np.arange(40_000) % 2, 90.0, 130.0)[:, None]
    star = shapely.Polygon([200, 150] + teeth * np.column_stack([np.cos(angle), np.sin(angle)]))
    smooth = shapely.Point(200, 150).buffer(80, quad_segs=10_000)
    box = shapely.box(0, 0, 400, 300)
    assert Map(name="disc", bounds=box, obstacles=(smooth,)).wall_count == 40_004
    small, is_valid = 1000, shapely.is_valid
    monkeypatch.setattr(
        shapely, "is_valid", lambda one: shapely.get_num_coordinates(one) < small and is_valid(one)
    )
    with pytest.raises(BadInputError, match=r"obstacle 0 is '40001 corners, .*--simplify-mm"):
        Map(name="star", bounds=box, obstacles=(star,))


def test_outer_rings_are_written_counter_clockwise_and_holes_clockwise() -> None:
    hole = BLOCK[::-1]
    ring = Polygon(BLOCK[::-1], [[[45, 45], [55, 45], [55, 55], [45, 55]]])
    world = Map(name="turned", bounds=Polygon(BOX[::-1], [hole]), obstacles=(ring,))
    document = json.loads(map_text(world))
    for drawn in document["features"]:
        outer, *holes = (shapely.LinearRing(one) for one in drawn["geometry"]["coordinates"])
        assert outer.is_ccw
        assert not any(one.is_ccw for one in holes)
