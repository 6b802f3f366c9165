import itertools
import math

import numpy as np
import pytest
from scipy.stats import bootstrap, permutation_test

from vinefab.core.statistics import group_means, holm, mean_interval, sign_flip_p

VALUES = np.random.default_rng(3).normal(0.4, 1.0, 25)


def test_group_means_leave_out_what_is_no_number():
    values = [1.0, np.nan, 5.0, np.nan]
    assert group_means(values, ["b", "b", "a", "c"]).tolist() == [1.0, 5.0]


def test_interval_agrees_with_scipys_percentile_bootstrap():
    theirs = bootstrap(
        (VALUES,), np.mean, n_resamples=20_000, method="percentile", rng=np.random.default_rng(5)
    ).confidence_interval
    assert mean_interval(VALUES) == pytest.approx((theirs.low, theirs.high), abs=0.03)


def test_interval_covers_the_true_mean_about_as_often_as_it_says():
    rng = np.random.default_rng(11)
    hits = 0
    for trial in range(300):
        low, high = mean_interval(rng.exponential(1.0, 40), level=0.9, seed=trial)
        hits += low <= 1.0 <= high
    assert 0.82 < hits / 300 < 0.95


def test_one_value_gives_itself():
    assert mean_interval([0.3, 0.3]) == (0.3, 0.3)


def test_one_value_has_neither_interval_nor_p() -> None:
    assert np.isnan(mean_interval([0.3])).all()
    assert np.isnan(sign_flip_p([0.3]))
    adjusted = holm([0.01, math.nan, 0.04])
    assert adjusted[::2] == (0.02, 0.04)
    assert math.isnan(adjusted[1])


@pytest.mark.parametrize("count", [6, 25])
def test_sign_flips_agree_with_scipys_permutations(count):
    values = VALUES[:count]
    theirs = permutation_test(
        (values,), np.mean, permutation_type="samples", n_resamples=20_000,
        rng=np.random.default_rng(7),
    ).pvalue  # fmt: skip
    assert sign_flip_p(values) == pytest.approx(theirs, abs=0.015)


def test_sign_flips_of_few_differences_are_all_counted():
    values = np.array([0.5, -0.2, 0.9, 0.4])
    means = [abs(np.dot(signs, values)) for signs in itertools.product((-1, 1), repeat=4)]
    assert sign_flip_p(values) == np.mean(np.array(means) >= abs(values.sum()) - 1e-12)


def test_no_difference_is_no_evidence():
    assert sign_flip_p(np.zeros(5)) == 1.0


def test_holm_keeps_the_order_and_never_lowers_a_p_value():
    found = [0.2, 0.001, 0.04, 0.04, 0.9]
    adjusted = holm(found)
    assert adjusted == pytest.approx((0.4, 0.005, 0.16, 0.16, 0.9))
    assert all(a >= p for a, p in zip(adjusted, found, strict=True))
    assert holm([0.03]) == (0.03,)
