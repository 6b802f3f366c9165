from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from vinefab.maps.generators.grid import GridOptions, grid_map
from vinefab.model.map import Map


def assert_guarantees(world: Map, options: GridOptions) -> None:
    # Rounding to 1e-4 mm may cost half of that at each corner.
    slack = 2e-4
    assert all(polygon.is_valid for polygon in (world.bounds, *world.obstacles))
    for polygon in world.obstacles:
        corners = np.array(polygon.exterior.coords)
        edges = np.diff(corners, axis=0)
        nxt = np.roll(edges, -1, axis=0)
        turns = edges[:, 0] * nxt[:, 1] - edges[:, 1] * nxt[:, 0]
        assert options.concavity > 0.0 or (turns > 0).all()
        assert options.corners_min <= len(edges) <= options.corners_max
    grown = shapely.buffer(list(world.obstacles), 0.5 * options.gap_mm - slack, quad_segs=32)
    tree = shapely.STRtree(grown)
    touching = tree.query(grown, predicate="intersects")
    assert (touching[0] == touching[1]).all()
    for polygon in world.obstacles:
        assert polygon.distance(world.bounds.exterior) >= 0.5 * options.gap_mm - slack
        assert world.bounds.contains(polygon)
    assert world.free_space.geom_type == "Polygon"


@settings(max_examples=40, deadline=None)
@given(data=st.data(), seed=st.integers(0, 2**62))
def test_guarantees_hold_for_any_options(
    any_options: dict[str, Any], data: st.DataObject, seed: int
) -> None:
    options: GridOptions = data.draw(any_options["grid"])
    world = grid_map(seed, options)
    assert_guarantees(world, options)
    if options.filled == 1.0:
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
