import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import Polygon
from shapely.affinity import translate

from vinefab.core.errors import BadInputError
from vinefab.core.rng import child
from vinefab.maps.generators.rubble import (
    Pile,
    RubbleOptions,
    power_law,
    rubble_map,
    slab,
    way_to_contact,
)
from vinefab.model.map import Map

NOWHERE = shapely.points(-1e6, -1e6)


def test_leaning_slabs_touch_one_host_and_keep_the_passage_to_all_else() -> None:
    pile, rng = Pile(RubbleOptions(size_mm=400.0, passage_mm=12.0), NOWHERE), child(3)
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
    slabs = [slab for seed in range(2) for slab in rubble_map(seed, options).obstacles]
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


@pytest.mark.parametrize("cover", [0.08, 0.25])
def test_the_cover_is_reached(cover: float) -> None:
    for seed in range(1):
        world = rubble_map(seed, RubbleOptions(cover=cover, slab_max_mm=90.0))
        assert world.facts["covered"] == pytest.approx(cover, rel=0.15)
        share = 1.0 - world.free_space.area / 250_000
        assert share == pytest.approx(world.facts["covered"], abs=1e-3)


def test_options_do_what_they_say() -> None:
    def mean(measure: Any, **values: Any) -> float:
        worlds = [rubble_map(seed, RubbleOptions(cover=0.18, **values)) for seed in range(2)]
        return float(np.mean([measure(world) for world in worlds]))

    def heaps(world: Map) -> float:
        return len(world.obstacles) / float(str(world.facts["slabs"]))

    def count(world: Map) -> float:
        return len(world.obstacles)

    assert mean(heaps, leaning=0.0) == 1.0 > mean(heaps) > mean(heaps, leaning=0.9)
    assert mean(count, exponent=2.5) > 1.3 * mean(count, exponent=1.0)
    few = mean(lambda world: world.wall_count / len(world.obstacles), raggedness=0.0, leaning=0.0)
    assert few < 4.5


@pytest.mark.thorough
def test_too_dense_rubble_is_refused_soon() -> None:
    with pytest.raises(BadInputError, match=r"cover is 0.7; allowed: at most about 0\.[34]"):
        rubble_map(0, RubbleOptions(cover=0.7))
    with pytest.raises(BadInputError, match="slab_min_mm"):
        rubble_map(0, RubbleOptions(cover=0.7, slab_min_mm=1.0, slab_max_mm=2.0))


SHARE = st.floats(0.0, 1.0)


def test_lengths_follow_the_power_law() -> None:
    rng = np.random.default_rng(1)
    for exponent in (0.0, 1.0, 2.0):
        lengths = np.array([power_law(rng, (10.0, 160.0), exponent) for _ in range(20000)])
        assert lengths.min() >= 10.0
        assert lengths.max() <= 160.0
        # Of lengths x to 2x there are 2 ** (1 - exponent) times as many from 2x to 4x.
        near, far = ((lengths >= x) & (lengths < 2 * x) for x in (20.0, 40.0))
        assert far.sum() / near.sum() == pytest.approx(2.0 ** (1.0 - exponent), rel=0.07)


@given(st.integers(0, 2**32), st.floats(0.05, 0.8), SHARE, st.just(0.0) | st.floats(0.01, 1.0))
def test_slabs_are_strictly_convex_and_as_long_as_requested(
    seed: int, thin: float, share: float, raggedness: float
) -> None:
    thick = min(0.8, thin + share * (0.8 - thin))
    options = RubbleOptions(thickness_min=thin, thickness_max=thick, raggedness=raggedness)
    corners = slab(np.random.default_rng(seed), 50.0, options)
    edges = np.roll(corners, -1, axis=0) - corners
    after = np.roll(edges, -1, axis=0)
    assert (edges[:, 0] * after[:, 1] - edges[:, 1] * after[:, 0] > 0.0).all()
    assert 50.0 <= np.hypot(*(corners[:, None] - corners).T).max() <= 50.0 * 1.3
    assert 0.3 * thin * 2500 < Polygon(corners).area <= 0.8 * 2500


def test_a_square_meets_a_square_where_it_should() -> None:
    square = np.array([(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)])
    right = np.array([1.0, 0.0])
    assert way_to_contact(square, square + np.array([10.0, 0.5]), right) == pytest.approx(8.0)
    assert way_to_contact(square, square + np.array([10.0, 2.5]), right) == math.inf
    assert way_to_contact(square, square + np.array([10.0, 0.5]), -right) == math.inf
    diamond = np.array([(0.0, -1.0), (1.0, 0.0), (0.0, 1.0), (-1.0, 0.0)])
    assert way_to_contact(square, diamond + np.array([10.0, 1.0]), right) == pytest.approx(7.0)


@given(st.integers(0, 2**32))
def test_after_the_way_to_contact_polygons_touch_and_not_before(seed: int) -> None:
    rng = np.random.default_rng(seed)
    options = RubbleOptions(direction_spread_deg=90.0)
    host, mover = slab(rng, 40.0, options), slab(rng, 20.0, options)
    turn = 2.0 * math.pi * rng.random()
    way = np.array([math.cos(turn), math.sin(turn)])
    mover = mover - 100.0 * way + 25.0 * (2.0 * rng.random() - 1.0) * np.array([-way[1], way[0]])
    far = way_to_contact(mover, host, way)
    path = shapely.convex_hull(shapely.multipoints(np.concatenate([mover, mover + 200.0 * way])))
    if far == math.inf:
        assert not path.intersects(Polygon(host).buffer(-1e-6))
        return
    at = translate(Polygon(mover), *(far * way))
    assert at.distance(Polygon(host)) == pytest.approx(0.0, abs=1e-9)
    assert at.intersection(Polygon(host)).area == pytest.approx(0.0, abs=1e-6)
