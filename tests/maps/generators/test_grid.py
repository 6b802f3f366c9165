from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from vinefab.core.errors import BadInputError
from vinefab.maps.generators.generated_map import start_zone
from vinefab.maps.generators.grid import GridOptions, grid_map
from vinefab.model.map import Map

KNOWN_CORNER = (15.9867, 58.7968)
KNOWN_AREA = 64991.969551
SEEDS = st.integers(0, 2**62)


@st.composite
def grid_options(draw: st.DrawFn) -> GridOptions:
    low = draw(st.floats(0.05, 0.3))
    high = draw(st.floats(low, 0.42))
    corners = draw(st.integers(3, 9))
    return GridOptions(
        columns=draw(st.integers(1, 7)),
        rows=draw(st.integers(1, 7)),
        corners_min=corners,
        corners_max=draw(st.integers(corners, 12)),
        radius_min=low,
        radius_max=high,
        irregularity=draw(st.floats(0.0, 1.0)),
        jitter=draw(st.floats(0.0, 1.0)),
        gap_mm=draw(st.floats(0.0, 9.0)),
        starts=draw(st.integers(1, 3)),
        start_spread_y_mm=draw(st.floats(0.0, 10.0)),
    )


def assert_guarantees(world: Map, options: GridOptions) -> None:
    # Rounding to 1e-4 mm may cost half of that at each corner.
    slack = 2e-4
    assert all(polygon.is_valid for polygon in (world.bounds, *world.obstacles))
    for polygon in world.obstacles:
        corners = np.array(polygon.exterior.coords)
        edges = np.diff(corners, axis=0)
        nxt = np.roll(edges, -1, axis=0)
        turns = edges[:, 0] * nxt[:, 1] - edges[:, 1] * nxt[:, 0]
        assert (turns > 0).all()
        assert options.corners_min <= len(edges) <= options.corners_max
    grown = shapely.buffer(list(world.obstacles), 0.5 * options.gap_mm - slack, quad_segs=32)
    tree = shapely.STRtree(grown)
    touching = tree.query(grown, predicate="intersects")
    assert (touching[0] == touching[1]).all()
    for polygon in world.obstacles:
        assert polygon.distance(world.bounds.exterior) >= 0.5 * options.gap_mm - slack
        assert world.bounds.contains(polygon)
    assert world.free_space.geom_type == "Polygon"


def assert_starts_clear(world: Map, options: GridOptions) -> None:
    solid = shapely.union_all([*world.obstacles, world.bounds.exterior])
    for start in world.starts:
        zone = start_zone(start)
        assert world.bounds.contains(zone)
        assert zone.distance(solid) >= options.start_clearance_mm - 1e-9


@settings(max_examples=40, deadline=None)
@given(SEEDS, grid_options())
def test_guarantees_hold_for_any_options(seed: int, options: GridOptions) -> None:
    world = grid_map(seed, options)
    assert_guarantees(world, options)
    assert_starts_clear(world, options)
    cells = options.columns * options.rows
    assert len(world.obstacles) + world.facts["left_out"] == cells


def test_the_default_map_is_the_one_described() -> None:
    world = grid_map(3)
    assert world.environment == "grid"
    assert world.seed == 3
    assert world.size_mm == (500.0, 500.0)
    assert len(world.obstacles) == 36
    (start,) = world.starts
    assert start.pose.x_mm == 250.0
    assert start.pose.heading_rad == pytest.approx(np.pi / 2)
    assert start.spread_x_mm > 0
    assert start.spread_heading_rad > 0
    areas = shapely.area(list(world.obstacles))
    assert areas.max() < np.pi * (0.38 * 500 / 6) ** 2
    assert areas.min() > 200


def test_same_seed_same_map_bit_for_bit() -> None:
    first, second, other = grid_map(11), grid_map(11), grid_map(12)
    assert [p.wkb for p in first.obstacles] == [p.wkb for p in second.obstacles]
    assert [p.wkb for p in first.obstacles] != [p.wkb for p in other.obstacles]


def test_a_known_seed_gives_the_known_map_on_every_machine() -> None:
    corner = grid_map(0).obstacles[0].exterior.coords[0]
    assert corner == pytest.approx(KNOWN_CORNER, abs=1e-9)
    total = sum(polygon.area for polygon in grid_map(0).obstacles)
    assert total == pytest.approx(KNOWN_AREA, abs=1e-6)


def test_more_rows_keep_the_obstacles_that_were_there() -> None:
    low, high = grid_map(5, GridOptions(rows=3)), grid_map(5, GridOptions(rows=6))
    assert [p.wkb for p in low.obstacles] == [p.wkb for p in high.obstacles[:18]]


def test_an_obstacle_that_cannot_clear_the_start_is_left_out() -> None:
    options = GridOptions(
        columns=3, rows=3, radius_min=0.4, radius_max=0.4, start_clearance_mm=60.0
    )
    world = grid_map(1, options)
    assert world.facts["left_out"] == 1
    assert len(world.obstacles) == 8


def test_sizes_scale_and_cells_stay_square() -> None:
    world = grid_map(2, GridOptions(size_mm=1000.0, columns=5, rows=2))
    assert world.size_mm == (1000.0, 400.0)


@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("size_mm", {"size_mm": -5.0}),
        ("size_mm", {"size_mm": float("nan")}),
        ("columns", {"columns": 0}),
        ("corners_max", {"corners_min": 6, "corners_max": 5}),
        ("corners_min", {"corners_min": 2}),
        ("radius_max", {"radius_max": 0.6}),
        ("radius_max", {"radius_min": 0.4}),
        ("gap_mm", {"gap_mm": 21.0}),
        ("jitter", {"jitter": 1.5}),
        ("start_clearance_mm", {"start_clearance_mm": 260.0}),
        ("start_clearance_mm", {"starts": 20}),
        ("start_spread_heading_deg", {"start_spread_heading_deg": 181.0}),
    ],
)
def test_bad_options_name_the_option(key: str, values: dict[str, Any]) -> None:
    with pytest.raises(BadInputError) as caught:
        GridOptions(**values)
    assert caught.value.key == key


def test_a_negative_seed_is_refused() -> None:
    with pytest.raises(BadInputError, match="seed"):
        grid_map(-1)
