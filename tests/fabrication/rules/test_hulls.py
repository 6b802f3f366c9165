import math

import numpy as np
import pytest
import shapely

from vinefab.fabrication.rules.spacing import Hulls, hull_gap_mm


def shape(start, run, half, growth):
    """The hull of two finely drawn discs."""
    discs = [
        shapely.Point(start + along * run).buffer(half + along * growth, quad_segs=512)
        for along in (0.0, 1.0)
    ]
    return shapely.union_all(discs).convex_hull


def test_gaps_of_random_tapered_branches_are_those_of_their_shapes():
    random = np.random.default_rng(3)

    def some(count):
        return Hulls(
            start_mm=random.uniform(-60, 60, (count, 2)),
            run_mm=random.uniform(-80, 80, (count, 2)),
            half_mm=random.uniform(3, 20, count),
            growth_mm=random.uniform(-3, 0, count),
        )

    one, two = some(200), some(200)
    found = hull_gap_mm(one, two)
    for row, gap in enumerate(found.tolist()):
        first, second = (
            shape(h.start_mm[row], h.run_mm[row], h.half_mm[row], h.growth_mm[row])
            for h in (one, two)
        )
        assert max(gap, 0.0) == pytest.approx(first.distance(second), abs=1e-3)
        assert (gap < -1e-3) <= first.intersects(second)
    assert 20 < np.count_nonzero(found > 0.0) < 180


def test_side_by_side_tapered_branches_gain_room_along_their_length():
    # Both lean by asin(5 / 100): their sides part from where they begin.
    lean = math.asin(5.0 / 100.0)
    one = Hulls(
        start_mm=np.zeros((1, 2)),
        run_mm=np.array([[100.0, 0.0]]),
        half_mm=np.array([10.0]),
        growth_mm=np.array([-5.0]),
    )
    two = Hulls(
        start_mm=np.array([[0.0, 30.0]]),
        run_mm=one.run_mm,
        half_mm=one.half_mm,
        growth_mm=one.growth_mm,
    )
    assert hull_gap_mm(one, two)[0] == pytest.approx(10.0)
    point = Hulls(
        start_mm=np.array([[50.0, 30.0]]),
        run_mm=np.zeros((1, 2)),
        half_mm=np.zeros(1),
        growth_mm=np.zeros(1),
    )
    assert hull_gap_mm(point, one)[0] == pytest.approx(
        30.0 * math.cos(lean) + 50.0 * math.sin(lean) - 10.0
    )
