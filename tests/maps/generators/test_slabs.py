import math

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import Polygon
from shapely.affinity import translate

from vinefab.maps.generators.rubble import SlabKind, power_law, slab, way_to_contact

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
def test_slabs_are_strictly_convex_and_as_long_as_asked(
    seed: int, thin: float, share: float, raggedness: float
) -> None:
    kind = SlabKind(
        thickness=(thin, thin + share * (0.8 - thin)),
        direction_rad=1.0,
        direction_spread_rad=0.5,
        raggedness=raggedness,
    )
    corners = slab(np.random.default_rng(seed), 50.0, kind)
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
    kind = SlabKind(
        thickness=(0.2, 0.6), direction_rad=0.0, direction_spread_rad=3.0, raggedness=0.5
    )
    host, mover = slab(rng, 40.0, kind), slab(rng, 20.0, kind)
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
