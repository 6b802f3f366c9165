from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import shapely
from shapely import Polygon

from vinefab.core.errors import BadInputError
from vinefab.core.rng import child
from vinefab.maps.generators.rubble import Pile, PileRules, RubbleOptions, rubble_map
from vinefab.model.map import Map

NOWHERE = shapely.points(-1e6, -1e6)


def test_leaning_slabs_touch_one_host_and_keep_the_passage_to_all_else() -> None:
    rules = PileRules(size_mm=400.0, passage_mm=12.0, keep_out=NOWHERE, keep_out_mm=0.0)
    pile, rng = Pile(rules), child(3)
    bar = np.array([(-30.0, -8.0), (30.0, -8.0), (30.0, 8.0), (-30.0, 8.0)])
    for size in np.linspace(1.0, 0.3, 40):
        pile.add(rng, bar * size, leaning=True)
    slabs = pile.polygons
    assert len(slabs) > 30
    gaps = shapely.distance(slabs[:, None], slabs)[np.triu_indices(len(slabs), 1)]
    assert ((gaps == 0.0) | (gaps >= 12.0 - 1e-9)).all()
    sides = [shapely.LineString(side) for side in pairwise(_CORNERS)]
    to_sides = shapely.distance(slabs[:, None], np.array(sides))
    assert ((to_sides == 0.0) | (to_sides >= 12.0 - 1e-9)).all()
    # A forest: one contact per slab at most, and every slab with a host has exactly one.
    assert (gaps == 0.0).sum() + (to_sides == 0.0).sum() <= len(slabs)
    assert (gaps == 0.0).sum() > 10


_CORNERS = [(0, 0), (400, 0), (400, 400), (0, 400), (0, 0)]


def test_slabs_lie_one_way_and_in_many_sizes() -> None:
    options = RubbleOptions(leaning=0.0, direction_deg=40.0, direction_spread_deg=10.0)
    slabs = [slab for seed in range(4) for slab in rubble_map(seed, options).obstacles]
    assert shapely.area(slabs) == pytest.approx(shapely.area(shapely.convex_hull(slabs)))
    boxes = [_long_side(slab) for slab in slabs]
    off = [(angle - 40.0 + 90.0) % 180.0 - 90.0 for angle, ratio in boxes if ratio > 2.0]
    assert np.abs(off).max() < 25.0
    assert np.mean(off) == pytest.approx(0.0, abs=3.0)
    areas = shapely.area(slabs)
    assert areas.max() > 50 * np.median(areas) / 4 > areas.min()


def _long_side(slab: Polygon) -> tuple[float, float]:
    """Return direction in degrees of the longer side of the box around, and side ratio."""
    corners = np.array(shapely.minimum_rotated_rectangle(slab).exterior.coords)
    one, other = corners[1] - corners[0], corners[2] - corners[1]
    if np.hypot(*one) < np.hypot(*other):
        one, other = other, one
    angle = float(np.degrees(np.arctan2(one[1], one[0])))
    return angle, float(np.hypot(*one) / np.hypot(*other))


@pytest.mark.parametrize("cover", [0.08, 0.17, 0.25])
def test_the_cover_is_reached(cover: float) -> None:
    for seed in range(3):
        world = rubble_map(seed, RubbleOptions(cover=cover, slab_max_mm=90.0))
        assert world.facts["covered"] == pytest.approx(cover, rel=0.15)
        share = 1.0 - world.free_space.area / 250_000
        assert share == pytest.approx(world.facts["covered"], abs=1e-3)


def test_options_do_what_they_say() -> None:
    def mean(measure: Any, **values: Any) -> float:
        worlds = [rubble_map(seed, RubbleOptions(cover=0.18, **values)) for seed in range(4)]
        return float(np.mean([measure(world) for world in worlds]))

    def heaps(world: Map) -> float:
        return len(world.obstacles) / float(str(world.facts["slabs"]))

    def count(world: Map) -> float:
        return len(world.obstacles)

    assert mean(heaps, leaning=0.0) == 1.0 > mean(heaps) > mean(heaps, leaning=0.9)
    assert mean(count, exponent=2.5) > 1.3 * mean(count, exponent=1.0)
    few = mean(lambda world: world.wall_count / len(world.obstacles), raggedness=0.0, leaning=0.0)
    assert few < 4.5


def test_too_dense_rubble_is_refused_soon() -> None:
    with pytest.raises(BadInputError, match=r"cover is 0.7; allowed: at most about 0\.[34]"):
        rubble_map(0, RubbleOptions(cover=0.7))
    with pytest.raises(BadInputError, match="slab_min_mm"):
        rubble_map(0, RubbleOptions(cover=0.7, slab_min_mm=1.0, slab_max_mm=2.0))


@pytest.mark.parametrize(
    ("key", "values"),
    [
        ("cover", {"cover": 0.9}),
        ("slab_max_mm", {"slab_max_mm": 10.0}),
        ("slab_max_mm", {"slab_max_mm": 300.0}),
        ("thickness_max", {"thickness_max": 0.1}),
        ("direction_spread_deg", {"direction_spread_deg": 91.0}),
        ("passage_mm", {"passage_mm": 0.0}),
    ],
)
def test_bad_options_name_the_option(key: str, values: dict[str, Any]) -> None:
    with pytest.raises(BadInputError) as caught:
        RubbleOptions(**values)
    assert caught.value.key == key
