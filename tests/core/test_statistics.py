import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.stats import ttest_1samp

from vinefab.core.statistics import LEVEL, degrees_of, group_means, holm, mean_interval, mean_p

VALUES = np.random.default_rng(3).normal(0.4, 1.0, 25)


def test_group_means_leave_out_what_is_no_number():
    values = [1.0, np.nan, 5.0, np.nan]
    assert group_means(values, ["b", "b", "a", "c"]).tolist() == [1.0, 5.0]


def test_without_tails_interval_and_p_are_students():
    theirs = ttest_1samp(VALUES, 0.0)
    ends = theirs.confidence_interval(LEVEL)
    assert mean_interval(VALUES, tails=0.0) == pytest.approx((ends.low, ends.high))
    assert mean_p(VALUES, tails=0.0) == pytest.approx(theirs.pvalue)


def test_degrees_of_freedom_are_those_of_the_spread_of_a_variance():
    # For the sample's variance, as many degrees as make chi-square spread as it does.
    rng = np.random.default_rng(8)
    drawn = rng.standard_t(6.0, (200_000, 12))  # excess kurtosis 6 / (6 - 4) = 3
    variances = drawn.var(axis=1, ddof=1)
    assert degrees_of(12, 3.0) == pytest.approx(
        2.0 * variances.mean() ** 2 / variances.var(), rel=0.12
    )


@pytest.mark.parametrize("count", [5, 10, 20, 50])
def test_intervals_hold_the_mean_of_scores_of_which_a_few_are_far_below(count):
    """A robot that does well on most maps, and on one in 25 badly (percentile bootstrap: 80 %)."""
    rng = np.random.default_rng(11)
    hits, truth = 0, 0.04 * 0.25 + 0.96 * 0.5
    for _ in range(1000):
        bad = rng.random(count) < 0.04
        low, high = mean_interval(np.where(bad, 0.25, 0.5) + rng.normal(0.0, 0.06, count))
        hits += low <= truth <= high
    assert 0.92 <= hits / 1000 < 0.995


def test_few_values_that_are_alike_have_no_interval():
    assert np.isnan(mean_interval([0.3] * 5)).all()
    assert mean_interval([0.3] * 6) == (0.3, 0.3)
    assert mean_p([0.3] * 5) == 2.0**-4
    assert np.isnan(mean_interval([0.1 + 0.2, 0.3])).all()  # alike but for rounding


def test_one_value_has_neither_interval_nor_p() -> None:
    assert np.isnan(mean_interval([0.3])).all()
    assert np.isnan(mean_p([0.3]))
    adjusted = holm([0.01, math.nan, 0.04])
    assert adjusted[::2] == (0.02, 0.04)
    assert math.isnan(adjusted[1])


@given(
    st.lists(st.integers(-9, 9), min_size=2, max_size=30),
    st.sampled_from([0.5, 0.9, 0.95, 0.999]),
)
def test_an_interval_leaves_out_0_exactly_where_p_is_small(values, level):
    (low, high), p = mean_interval(values, level), mean_p(values)
    assume(abs(p - (1.0 - level)) > 1e-9)
    assert (low > 0.0 or high < 0.0) == (p < 1.0 - level)


def test_no_difference_is_no_evidence():
    assert mean_p(np.zeros(5)) == 1.0
    assert mean_p([-1.0, 1.0]) == 1.0


def test_holm_keeps_the_order_and_never_lowers_a_p_value():
    found = [0.2, 0.001, 0.04, 0.04, 0.9]
    adjusted = holm(found)
    assert adjusted == pytest.approx((0.4, 0.005, 0.16, 0.16, 0.9))
    assert all(a >= p for a, p in zip(adjusted, found, strict=True))
    assert holm([0.03]) == (0.03,)
