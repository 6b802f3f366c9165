import numpy as np

from vinefab.search.optimizers.evolution import Evolution
from vinefab.search.optimizers.evolution_settings import EvolutionConfig
from vinefab.search.optimizers.optimizer import SearchAxes

MIXED = SearchAxes(choices=(3, 0, 3, 0), levels=(0, 0, 2, 3), depth=0, least_depth=1)


def started(axes=MIXED, population=10):
    found = EvolutionConfig().start(axes, population=population, seed=2)
    assert isinstance(found, Evolution)
    return found


def test_no_child_repeats_a_design():
    search = started()
    parents = np.empty((0, 4))
    for _ in range(20):
        x = search.ask()
        together = np.concatenate([MIXED.canonical(x), MIXED.canonical(parents)])
        assert len(np.unique(together, axis=0)) == len(together)
        search.tell(x, -np.abs(x - 0.5).sum(axis=1))
        parents = search._parents


def test_the_best_of_all_survive():
    search, told = started(), []
    for _ in range(15):
        x = search.ask()
        fitness = -np.abs(x - 0.3).sum(axis=1)
        told += fitness.tolist()
        search.tell(x, fitness)
        assert sorted(search._fitness, reverse=True) == sorted(told, reverse=True)[:10]


def test_a_space_with_fewer_designs_than_the_population_is_no_trap():
    axes = SearchAxes(choices=(2, 2), levels=(0, 0))
    search = started(axes, population=10)
    for _ in range(5):
        x = search.ask()
        assert x.shape == (10, 2)
        search.tell(x, x.sum(axis=1))
    assert search._fitness.max() == 1.5
