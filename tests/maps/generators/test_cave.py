from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from vinefab.maps.generators.cave import CaveOptions, cave_map, links


@settings(max_examples=10)
@given(data=st.data(), seed=st.integers(0, 2**62))
def test_any_cave_is_one_with_rock_all_around(
    any_options: dict[str, Any], data: st.DataObject, seed: int
) -> None:
    options: CaveOptions = data.draw(any_options["cave"])
    world = cave_map(seed, options)
    assert world.bounds.equals(shapely.box(0, 0, 500, 500))
    free = world.free_space
    assert free.geom_type == "Polygon"
    areas = shapely.area(list(world.obstacles))
    assert areas.sum() + free.area == pytest.approx(250_000)
    assert free.distance(world.bounds.exterior) >= options.margin_mm - 1e-3
    assert areas[1:].min(initial=1e9) >= (0.5 * options.passage_width_min_mm) ** 2 - 0.1


def test_options_do_what_they_say() -> None:
    def mean(measure: Any, **values: Any) -> float:
        worlds = [cave_map(seed, CaveOptions(**values)) for seed in range(3)]
        return float(np.mean([measure(world) for world in worlds]))

    def islands(world: Any) -> int:
        return len(world.obstacles) - 1

    def area(world: Any) -> float:
        return float(world.free_space.area)

    def edge(world: Any) -> float:
        return float(world.free_space.length**2 / world.free_space.area)

    assert mean(islands, loops=0.0) < 1.0 < mean(islands, loops=1.0) - 3.0
    wide = {"passage_width_min_mm": 34.0, "passage_width_max_mm": 50.0}
    assert mean(area, **wide) > 1.15 * mean(area)
    straight = {"loops": 0.0, "roughness": 0.0, "wander": 0.0}
    assert mean(edge, **straight) < mean(edge, **{**straight, "roughness": 1.0, "wander": 1.0})


def test_links_connect_everything_by_the_shortest_ways() -> None:
    points = np.array([[0.0, 0.0], [10.0, 0.0], [20.0, 0.0], [11.0, 9.0], [0.0, 12.0]])
    rng = np.random.default_rng(0)
    assert links(rng, points, 0.0) == [(0, 1), (1, 2), (1, 3), (3, 4)]
    every = links(rng, points, 1.0)
    assert set(every) == {(0, 1), (1, 2), (1, 3), (3, 4), (0, 4), (2, 3)}
