"""CMA-ES as a search, and its array code against the package's own scalar code."""

import numpy as np
import pytest
from cmaes import CatCMAwM

from vinefab.core.errors import BadInputError
from vinefab.search.optimizers.cmaes import Cma, CmaConfig, Distribution
from vinefab.search.optimizers.optimizer import SearchAxes

MIXED = SearchAxes(choices=(4, 0, 2, 0, 0, 0), levels=(0, 0, 0, 3, 3, 3), depth=0, least_depth=1)


def started(seed):
    search = CmaConfig().start(MIXED, population=12, seed=seed)
    assert isinstance(search, Cma)
    return search


def test_whole_numbers_keep_moving_after_the_rest_has_converged():
    search = started(1)
    for generation in range(150):
        x = search.ask()
        target = 0.125 if generation < 75 else 0.875
        search.tell(x, -np.abs(x[:, 0] - target) - np.abs(x[:, 1] - 0.3))
    assert search.ask()[:, 1].std() < 0.02
    assert np.median(search.ask()[:, 0]) == 0.875


def test_what_never_matters_is_not_pulled_anywhere():
    """It is learned as it was sampled, whatever stands there in the point that was evaluated."""
    search, other = started(3), started(3)
    for _ in range(5):
        x = search.ask()
        np.testing.assert_array_equal(other.ask(), x)
        fitness = -np.abs(x[:, 1] - 0.8) - x[:, 0]
        search.tell(x, fitness)
        x[:, 3:] = 0.5
        other.tell(x, fitness)


def test_too_few_points_are_refused():
    with pytest.raises(BadInputError, match=r"optimizer\.population is 3; allowed: at least 4"):
        CmaConfig().start(MIXED, population=3, seed=1)
    with pytest.raises(BadInputError, match="spread"):
        CmaConfig(spread=0.0)


def distribution(axes, population, spread=0.2):
    search = CmaConfig(spread=spread).start(axes, population=population, seed=1)
    assert isinstance(search, Cma)
    return search._search


def reference(axes, population, spread=0.2):
    """Return the package's own distribution, set up as the search is."""
    mine, counts = distribution(axes, population, spread), [n for n in axes.choices if n]
    package = CatCMAwM(
        x_space=[[0.0, 1.0]] * (len(axes) - len(counts)) or None,
        z_space=[list(range(count)) for count in counts] or None,
        population_size=population,
        mean=mine._mean,
        cov=mine._C,
        seed=4,
    )
    for name in CONSTANTS:
        assert getattr(mine, name) == pytest.approx(getattr(package, name), rel=0.0, abs=0.0)
    return package


CONSTANTS = ("_weights", "_mu_eff", "_c1", "_cmu", "_c_sigma", "_d_sigma", "_cc", "_chi_n")
KEPT = ("_mean", "_sigma", "_C", "_p_sigma", "_pc", "_A", "_pmut", "_int_succ")
CASES = {
    "mixed": SearchAxes(choices=(4, 0, 0, 3, 0, 2), levels=(0,) * 6),
    "real numbers": SearchAxes.continuous(4),
    "whole numbers": SearchAxes(choices=(2, 7, 5), levels=(0,) * 3),
}


@pytest.mark.parametrize("axes", CASES.values(), ids=CASES)
def test_the_distribution_learns_what_the_package_learns(axes):
    """To the last bit at every step, if both centre whole numbers alike."""
    mine, package = distribution(axes, 16), reference(axes, 16)
    if any(axes.choices):  # tested below; the last digit differs, which would grow
        package._discretization = mine._discretization
        package._integer_centering = lambda v: Distribution._integer_centering(package, v)
    rng, target = np.random.RandomState(3), np.array([0.2, 0.9, 0.5, 1.0, 3.0, 1.0])[: len(axes)]
    for generation in range(120):
        v = mine.sample(rng, 16)
        reals, numbers = mine.within(v)
        worth = ((v - target) ** 2).sum(axis=1)
        if generation > 60:  # noisy, with equals
            worth = np.round(worth + rng.rand(16), 1)
        order = np.argsort(worth, kind="stable")
        rows = zip(reals, numbers, [None] * 16, v.copy(), strict=True)
        solutions = [CatCMAwM.Solution(*row) for row in rows]
        package.tell([(solutions[i], float(rank)) for rank, i in enumerate(order)])
        mine.learn(v[order])
        for name in KEPT:
            if hasattr(package, name):
                np.testing.assert_array_equal(getattr(mine, name), getattr(package, name))


def test_whole_numbers_are_found_as_the_package_finds_them():
    axes = SearchAxes(choices=(4, 3, 7), levels=(0, 0, 0))
    search, package = distribution(axes, 8), reference(axes, 8)
    drawn = np.random.default_rng(1).uniform(-1.0, 8.0, (300, 3))
    for v in [*drawn, *np.round(2.0 * drawn) / 2.0]:
        expected = package._discretization(v)
        np.testing.assert_array_equal(search._discretization(v), expected)


def test_whole_numbers_are_centred_as_the_package_centres_them():
    axes = SearchAxes(choices=(4, 3, 7, 0), levels=(0, 0, 0, 0))
    search, package = distribution(axes, 30, spread=0.5), reference(axes, 30, spread=0.5)
    rng = np.random.default_rng(2)
    for _ in range(40):
        v = np.column_stack([rng.random(30), rng.uniform(-1.0, 7.0, (30, 3))])
        expected = package._integer_centering(v.copy())
        found = search._integer_centering(v.copy())
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-12)
        np.testing.assert_array_equal(search._int_succ, package._int_succ)
        search._mean[1:] = package._mean[1:] = rng.uniform(0.0, 3.0, 3)


def test_points_are_drawn_from_the_packages_distribution():
    axes = SearchAxes(choices=(0, 5, 0), levels=(0, 0, 0))
    search, package = distribution(axes, 4000), reference(axes, 4000)
    for one in (search, package):
        one._mean[:] = (0.3, 0.9, 1.2)  # two continuous ones, then the whole number
        one._C[0, 1] = one._C[1, 0] = 0.02
    one = search.sample(np.random.RandomState(3), 4000)
    other = np.array([package.ask()._v_raw for _ in range(4000)])
    spread = np.sqrt(np.diag(np.cov(other.T)))
    error = np.sqrt(2.0 / 4000)  # of a mean's difference, over the spread
    assert (np.abs(one.mean(axis=0) - other.mean(axis=0)) < 4.0 * error * spread).all()
    scale = np.outer(spread, spread)
    assert (np.abs(np.cov(one.T) - np.cov(other.T)) < 6.0 * error * scale).all()
    assert np.corrcoef(one[:, 0], one[:, 1])[0, 1] > 0.3


def test_a_distribution_that_noise_has_blown_up_begins_again_and_its_state_comes_back():
    search, resumed = started(1), started(1)
    search.tell(search.ask(), np.arange(12.0))
    search._search._sigma = 1e9
    search.tell(search.ask(), np.arange(12.0))
    np.testing.assert_array_equal(search._search.spread, started(2)._search.spread)
    resumed.restore(search.state())
    for _ in range(3):
        x = search.ask()
        np.testing.assert_array_equal(resumed.ask(), x)
        assert len(np.unique(x[:, 1])) > 6
        search.tell(x, -x[:, 1])
        resumed.tell(x, -x[:, 1])
