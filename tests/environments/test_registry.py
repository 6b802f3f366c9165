from typing import Any

import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from vinefab.environments.ground import start_zone
from vinefab.environments.registry import ENVIRONMENTS
from vinefab.model.map import Map

NAMES = sorted(ENVIRONMENTS)
SLACK_MM = 1e-3


def made(name: str, seed: int, options: Any) -> Map:
    """Return a map; options that ask for too much are refused, which is right, and not drawn."""
    return ENVIRONMENTS[name].make(seed, options)


def assert_valid_and_apart(world: Map) -> None:
    polygons = list(world.obstacles)
    assert shapely.is_valid(polygons).all()
    assert shapely.area(polygons).min(initial=1.0) > 0.0
    assert shapely.contains(world.bounds.buffer(SLACK_MM), polygons).all()
    overlap = shapely.area(polygons).sum() - shapely.union_all(polygons).area
    assert overlap == pytest.approx(0.0, abs=1e-3)
    assert world.free_space.geom_type == "Polygon"


def assert_starts_clear(world: Map, clearance_mm: float) -> None:
    assert world.starts
    solid = shapely.union_all([*world.obstacles, world.bounds.exterior])
    for start in world.starts:
        assert world.free_space.covers(start_zone(start))
        assert start_zone(start).distance(solid) >= clearance_mm - SLACK_MM


def way_for(world: Map, width_mm: float) -> Any:
    """Return where the middle of a round body of a width can be."""
    solid = shapely.union_all([*world.obstacles, world.bounds.exterior])
    # The polygon around an arc stays inside it: finer than the slack at these widths.
    return world.bounds.difference(shapely.buffer(solid, 0.5 * width_mm - SLACK_MM, quad_segs=64))


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=30)
@given(data=st.data(), seed=st.integers(0, 2**62))
def test_promises_hold_for_any_options_and_seed(
    name: str, any_options: dict[str, Any], data: st.DataObject, seed: int
) -> None:
    options = data.draw(any_options[name])
    world = made(name, seed, options)
    assert_valid_and_apart(world)
    assert_starts_clear(world, options.start_clearance_mm)
    again = made(name, seed, options)
    assert [p.wkb for p in (again.bounds, *again.obstacles)] == [
        p.wkb for p in (world.bounds, *world.obstacles)
    ]
    way = way_for(world, options.passage_mm)
    assert way.geom_type == "Polygon"
    if options.start_clearance_mm >= 0.5 * options.passage_mm:
        assert all(way.buffer(SLACK_MM).contains(start_zone(start)) for start in world.starts)
