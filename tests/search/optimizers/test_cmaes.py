import numpy as np
import pytest

from vinefab.core.errors import BadInputError
from vinefab.search.axes import SearchAxes
from vinefab.search.optimizers.cmaes import Cma, CmaConfig

MIXED = SearchAxes(choices=(4, 0, 2, 0, 0, 0), levels=(0, 0, 0, 3, 3, 3), depth=0, least_depth=1)


def started(seed: int) -> Cma:
    search = CmaConfig().start(MIXED, population=12, seed=seed)
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
        CmaConfig().start(MIXED, population=3, seed=1)
    with pytest.raises(BadInputError, match="spread"):
        CmaConfig(spread=0.0)
