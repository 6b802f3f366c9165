import numpy as np
import pytest

from vinefab.core.errors import BadInputError
from vinefab.optimize.axes import Axes
from vinefab.optimize.cma import Cma, CmaRecipe, _centred, _whole_numbers

MIXED = Axes(choices=(4, 0, 2, 0, 0, 0), levels=(0, 0, 0, 3, 3, 3), depth=0, least_depth=1)


def started(seed: int) -> Cma:
    search = CmaRecipe().start(MIXED, population=12, seed=seed)
    assert isinstance(search, Cma)
    return search


def test_only_the_order_of_fitness_counts() -> None:
    plain, bent = started(3), started(3)
    for _ in range(15):
        x = plain.ask()
        np.testing.assert_array_equal(bent.ask(), x)
        fitness = -np.abs(x[:, 1] - 0.8) - x[:, 0]
        plain.tell(x, fitness)
        bent.tell(x, np.where(fitness < np.median(fitness), 1e5 * fitness, fitness))


def test_whole_numbers_keep_moving_after_the_rest_has_converged() -> None:
    search = started(1)
    for generation in range(150):
        x = search.ask()
        target = 0.125 if generation < 75 else 0.875
        search.tell(x, -np.abs(x[:, 0] - target) - np.abs(x[:, 1] - 0.3))
    assert search.ask()[:, 1].std() < 0.02
    assert np.median(search.ask()[:, 0]) == 0.875


def test_what_never_matters_is_not_pulled_anywhere() -> None:
    means = []
    for seed in range(12):
        search = started(seed)
        for _ in range(20):
            x = search.ask()
            search.tell(x, -(x[:, 0] ** 2) - np.abs(x[:, 1] - 0.9))
        # Levels have gone to 1, so that the coordinates of level 3 have no say.
        means.append(search.ask()[:, 3:].mean(axis=0))
    error = np.std(means) / np.sqrt(np.size(means))
    assert abs(np.mean(means) - 0.5) < 3.5 * error
    assert error < 0.06


def test_too_few_points_are_refused() -> None:
    with pytest.raises(BadInputError, match=r"optimizer\.population is 3; allowed: at least 4"):
        CmaRecipe().start(MIXED, population=3, seed=1)
    with pytest.raises(BadInputError, match="spread"):
        CmaRecipe(spread=0.0)


def test_whole_numbers_are_found_as_the_package_finds_them() -> None:
    axes = Axes(choices=(4, 3, 7), levels=(0, 0, 0))
    search = CmaRecipe().start(axes, population=8, seed=1)
    assert isinstance(search, Cma)
    values, limits = search._search._z_space, search._search._z_lim
    rng = np.random.default_rng(1)
    drawn = rng.uniform(-1.0, 8.0, (300, 3))
    for v in [*drawn, *np.round(2.0 * drawn) / 2.0]:
        expected = type(search._search)._discretization(search._search, v)
        np.testing.assert_array_equal(_whole_numbers(v, values, limits), expected)


def test_whole_numbers_are_centred_as_the_package_centres_them() -> None:
    axes = Axes(choices=(4, 3, 7, 0), levels=(0, 0, 0, 0))
    search = CmaRecipe(spread=0.5).start(axes, population=30, seed=1)
    assert isinstance(search, Cma)
    rng = np.random.default_rng(2)
    inner = search._search
    for _ in range(40):
        v = np.column_stack([rng.random(30), rng.uniform(-1.0, 7.0, (30, 3))])
        expected = type(inner)._integer_centering(inner, v.copy())
        mutated = inner._int_succ.copy()
        np.testing.assert_allclose(_centred(inner, v.copy()), expected, rtol=0.0, atol=1e-12)
        np.testing.assert_array_equal(inner._int_succ, mutated)
        inner._mean[1:] = rng.uniform(0.0, 3.0, 3)


def test_points_are_drawn_from_the_packages_distribution() -> None:
    axes = Axes(choices=(0, 5, 0), levels=(0, 0, 0))
    many = {}
    for drawn in (False, True):
        search = CmaRecipe().start(axes, population=4000, seed=3)
        assert isinstance(search, Cma)
        search._search._mean[:] = (0.3, 0.9, 1.2)  # two continuous ones, then the whole number
        search._search._C[0, 1] = search._search._C[1, 0] = 0.02
        if not drawn:
            search._asked = [search._search.ask() for _ in range(4000)]
        many[drawn] = search.ask()
    for one, other in ((many[True], many[False]),):
        np.testing.assert_allclose(one.mean(axis=0), other.mean(axis=0), atol=0.03)
        np.testing.assert_allclose(np.cov(one.T), np.cov(other.T), atol=0.01)
        assert np.corrcoef(one[:, 0], one[:, 2])[0, 1] > 0.3
