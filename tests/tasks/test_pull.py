import math

import numpy as np
import pytest

from vinefab.tasks.anchoring_force import Pull


@pytest.fixture
def pull() -> Pull:
    """Three leaves of one robot, none of the next, and one of the third, which has no limit."""
    return Pull(
        growths=3,
        growth=np.array([0, 0, 0, 2]),
        turns_rad=np.array([0.0, 1.0, 2.0, 3.0]),
        press_n=np.array([2.0, 2.0, 0.0, 2.0]),
        limit_n=np.array([0.9, 0.9, 0.9, np.inf]),
    )


def test_a_leaf_holds_e_to_the_turn_or_what_film_and_seam_stand(pull: Pull) -> None:
    # Where the pouch's press is not known, nothing says how near the limit is.
    assert pull.amplifications(0.3) == pytest.approx([math.exp(0.3 * t) for t in range(4)])
    assert pull.amplifications(0.8) == pytest.approx(
        [0.9 / 1.6, 0.9 / 1.6, math.exp(1.6), math.exp(2.4)]
    )
    assert pull.amplifications(0.0).tolist() == [1.0] * 4


def test_sums_and_largest_turns_are_per_robot(pull: Pull) -> None:
    assert pull.summed(pull.turns_rad).tolist() == [3.0, 0.0, 3.0]
    assert pull.largest_turns_rad().tolist() == [2.0, 0.0, 3.0]


def test_the_share_that_turned_least_is_rounded_up(pull: Pull) -> None:
    assert pull.are_among_first(2.0 / 3.0).tolist() == [True, True, False, True]
    assert pull.are_among_first(0.5).tolist() == [True, True, False, True]
    assert pull.are_among_first(1.0 / 3.0).tolist() == [True, False, False, True]


def test_robots_without_an_engaged_leaf_hold_nothing() -> None:
    nothing = np.zeros(0)
    pull = Pull(
        growths=2,
        growth=np.zeros(0, dtype=np.int64),
        turns_rad=nothing,
        press_n=nothing,
        limit_n=nothing,
    )
    sums = pull.summed(pull.amplifications(0.3))
    assert sums.dtype == np.float64
    assert sums.tolist() == pull.largest_turns_rad().tolist() == [0.0, 0.0]
    assert len(pull.are_among_first(0.5)) == 0
