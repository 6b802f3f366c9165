"""Capsules and their distances, against Shapely."""

import numpy as np
import pytest
import shapely

from vinefab.core.rng import child
from vinefab.fabrication.rules.spacing import (
    Capsules,
    Hulls,
    RotatedSpan,
    capsules_of,
    closest,
    excess_mm,
    hull_gap_mm,
    spacing,
)
from vinefab.model.design import Pouch
from vinefab.outline.body_outline import body_outline, flat_layout


def lines(capsules):
    return shapely.linestrings(np.stack([capsules.start_mm, capsules.end_mm], axis=1))


def flat_capsules(design):
    return capsules_of(flat_layout(design), design.build)


def by_pair(found, values):
    pairs = zip(found.first.tolist(), found.second.tolist(), strict=True)
    return dict(zip(pairs, values.tolist(), strict=True))


def test_closest_agrees_with_shapely_also_for_points_parallels_and_touches():
    rng = child(5)
    ends = [rng.uniform(-50.0, 50.0, (4000, 2)) for _ in range(4)]
    ends[1][:500] = ends[0][:500]
    ends[3][250:750] = ends[2][250:750]
    ends[3][1000:1500] = ends[2][1000:1500] + 0.7 * (ends[1] - ends[0])[1000:1500]
    ends[2][2000:2500] = ends[0][2000:2500] + 0.3 * (ends[1] - ends[0])[2000:2500]
    found = closest(*ends)
    a = shapely.linestrings(np.stack(ends[:2], axis=1))
    b = shapely.linestrings(np.stack(ends[2:], axis=1))
    assert found.distance_mm == pytest.approx(shapely.distance(a, b), abs=1e-9)
    on_a = ends[0] + found.along_a[:, None] * (ends[1] - ends[0])
    on_b = ends[2] + found.along_b[:, None] * (ends[3] - ends[2])
    assert np.hypot(*(on_a - on_b).T) == pytest.approx(found.distance_mm, abs=1e-9)


def test_all_near_pairs_are_found_and_no_joined_ones(make):
    flat = flat_capsules(make((4, 120.0, 150.0), (3, 100.0, 120.0), (2, 60.0, 90.0)))
    found = spacing(flat, 5.0)
    gaps = by_pair(found, found.gap_mm)
    drawn = lines(flat)
    parent = flat.parent.tolist()
    near = 0
    for a in range(len(flat)):
        for b in range(a + 1, len(flat)):
            if parent[b] == a or parent[a] == parent[b]:
                assert (a, b) not in gaps
                continue
            gap = shapely.distance(drawn[a], drawn[b]) - flat.half_mm[a] - flat.half_mm[b]
            near += gap < 5.0
            if gap < 5.0 or (a, b) in gaps:
                assert gaps[a, b] == pytest.approx(gap, abs=1e-9)
    assert near > 20


def test_the_crossing_is_how_far_the_nearest_end_runs_past():
    cross = Capsules(
        start_mm=np.array([[0.0, 0.0], [70.0, -40.0], [0.0, 5.0]]),
        end_mm=np.array([[100.0, 0.0], [70.0, 60.0], [60.0, 5.0]]),
        half_mm=np.full(3, 10.0),
        end_half_mm=np.full(3, 10.0),
        branch=np.arange(3),
        pouch=np.zeros(3, dtype=bool),
        parent=np.array([-1, 5, 6]),
    )
    found = spacing(cross, 0.0)
    crossing = by_pair(found, found.crossing_mm)
    assert crossing[0, 1] == pytest.approx(30.0)
    assert crossing[0, 2] == 0.0


@pytest.mark.parametrize(
    "pouch",
    [
        None,
        Pouch(shape="round", radius_mm=20.0),
        Pouch(shape="rectangle", length_mm=50.0, width_mm=34.0),
        Pouch(shape="rectangle", length_mm=30.0, width_mm=50.0),
    ],
)
def test_capsules_cover_the_drawn_outline_except_fillets(make, pouch):
    design = make((3, 200.0, 120.0), (2, 120.0, 50.0), pouch=pouch, fillet_mm=(2.0, 2.0))
    flat = flat_capsules(design)
    capsules = shapely.buffer(lines(flat), flat.half_mm, quad_segs=64)
    covered = shapely.union_all(capsules)
    body = shapely.Polygon(body_outline(design).contour.flattened_mm())
    missed = shapely.difference(body, shapely.buffer(covered, 0.01))
    largest = max((part.area for part in shapely.get_parts(missed)), default=0.0)
    # What is left are fillets: nothing larger than the corner of a square around one.
    assert largest < 2.0**2
    # The other way round only the trunk's round end reaches past the straight mouth.
    beyond = shapely.difference(covered, shapely.buffer(body, 0.05))
    mouth = [part for part in shapely.get_parts(beyond) if part.area > 1.0]
    inside_pouch = 0 if pouch is None else 12
    assert 1 <= len(mouth) <= 1 + inside_pouch
    assert mouth[0].bounds[0] == pytest.approx(-220.0, abs=0.1)


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

    one, two = some(80), some(80)
    found = hull_gap_mm(one, two)
    for row, gap in enumerate(found.tolist()):
        first, second = (
            shape(h.start_mm[row], h.run_mm[row], h.half_mm[row], h.growth_mm[row])
            for h in (one, two)
        )
        assert max(gap, 0.0) == pytest.approx(first.distance(second), abs=1e-3)
        assert (gap < -1e-3) <= first.intersects(second)
    assert 10 < np.count_nonzero(found > 0.0) < 70


def test_discs_reach_across_a_sheet_in_their_best_rotation():
    """Two discs of radius 10, 100 apart, are 120 long and 20 wide however they lie."""
    for turn_deg in (0.0, 30.0, 45.0, 90.0, 135.0):
        turn = np.radians(turn_deg)
        span = RotatedSpan()
        span.add(np.array([[0.0, 0.0]]), np.array([10.0]))
        span.add(100.0 * np.array([[np.cos(turn), np.sin(turn)]]), np.array([10.0]))
        assert span.excess_mm((120.0, 20.0)) == pytest.approx(0.0, abs=1e-9)
        assert span.excess_mm((20.0, 120.0)) == pytest.approx(0.0, abs=1e-9)
        # 300 is room for every rotation with the discs one behind the other.
        assert span.excess_mm((300.0, 5.0)) == pytest.approx(15.0, abs=1e-9)
        # On the diagonal of a square: 100 cos 45 + 20 to either side.
        assert span.excess_mm((100.0, 100.0)) == pytest.approx(100.0 / np.sqrt(2.0) - 80.0)


def test_a_flat_robot_exceeds_a_sheet_by_its_length(make):
    """A trunk of 300 with a tail of 200, whose round end reaches half its width of 40 further."""
    capsules = flat_capsules(make(trunk_mm=300.0, widths_mm=(40.0,), tail_mm=200.0))
    assert excess_mm(capsules, (520.0, 40.0)) == pytest.approx(0.0, abs=1e-9)
    assert excess_mm(capsules, (519.0, 40.0)) == pytest.approx(1.0, abs=1e-9)
    assert excess_mm(capsules, (10.0, 700.0)) == pytest.approx(30.0)
