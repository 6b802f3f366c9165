import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from vinefab.maps.importers.source_drawing import Arc, Bezier, Straight, run_flat


def distance_to_chords(points, chords):
    first, along = chords[:-1], np.diff(chords, axis=0)
    lengths = np.maximum((along**2).sum(axis=1), 1e-300)
    share = (((points[:, None] - first) * along).sum(axis=2) / lengths).clip(0.0, 1.0)
    return np.hypot(*np.moveaxis(points[:, None] - first - share[..., None] * along, 2, 0)).min(1)


@given(st.floats(0.0, 6.0), st.floats(-6.28, 6.28), st.floats(0.1, 3.0), st.floats(1e-4, 0.1))
def test_an_arc_stays_within_the_tolerance(start, turn, ratio, tolerance):
    arc = Arc(
        middle=np.array([5.0, 1.0]),
        first=np.array([3.0, 1.0]),
        second=ratio * np.array([-0.5, 2.0]),
        start_rad=start,
        turn_rad=turn,
    )
    true = arc.at(np.linspace(start, start + turn, 400))
    assert distance_to_chords(true, arc.flat(tolerance)).max() <= tolerance * 1.0001
    low, high = arc.hull().min(axis=0), arc.hull().max(axis=0)
    assert (true >= low - 1e-9).all()
    assert (true <= high + 1e-9).all()


@given(st.lists(st.floats(-100, 100), min_size=8, max_size=8), st.floats(1e-3, 1.0))
def test_a_bezier_stays_within_the_tolerance(values, tolerance):
    curve = Bezier(np.array(values).reshape(4, 2))
    share = np.linspace(0.0, 1.0, 300)[:, None]
    weights = ((1 - share) ** 3, 3 * (1 - share) ** 2 * share, 3 * (1 - share) * share**2, share**3)
    true = sum(w * c for w, c in zip(weights, curve.controls, strict=True))
    assert distance_to_chords(true, curve.flat(tolerance)).max() <= tolerance * 1.0001


def test_a_whole_circle_is_closed_to_the_bit():
    circle = Arc(middle=np.array([0.3, 0.7]), first=np.array([2.0, 0]), second=np.array([0, 2.0]))
    points = circle.flat(0.01)
    assert (points[0] == points[-1]).all()


def test_pieces_are_turned_to_follow_one_another():
    corners = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], dtype=float)
    sides = [Straight(corners[[k, (k + 1) % 4]]) for k in range(4)]
    turned = [Straight(side.points[::-1]) if k in (0, 2) else side for k, side in enumerate(sides)]
    points = run_flat(tuple(turned), 0.1)
    assert np.abs(np.diff(points, axis=0)).max() == 1.0
    assert {tuple(point) for point in points.tolist()} == {tuple(c) for c in corners.tolist()}
