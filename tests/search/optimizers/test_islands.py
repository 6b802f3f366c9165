"""Islands: structures, rungs, and the screening by a penalty."""

import numpy as np
import pytest

from vinefab.core.errors import BadInputError
from vinefab.search.optimizers.cmaes import Cma
from vinefab.search.optimizers.islands import (
    UNRATED,
    Islands,
    IslandsConfig,
)
from vinefab.search.optimizers.optimizer import SearchAxes
from vinefab.search.record.result import state_from_text, state_to_text

AXES = SearchAxes(choices=(3, 0, 4, 0, 0), levels=(0, 0, 2, 2, 3), depth=0, least_depth=1)
"""Levels 1 to 3, a length, a number of branches on level 2, and a length each on levels 2 and 3."""

STRUCTURES = 9  # one vine, and 4 numbers of branches with or without a third level


def started(population=24, seed=1, **parameters):
    search = IslandsConfig(**parameters).start(AXES, population, seed)
    assert isinstance(search, Islands)
    return search


def ran(search, worth, generations):
    asked, told = [], []
    for _ in range(generations):
        x = search.ask()
        fitness = worth(x)  # type: ignore[operator]
        search.tell(x, fitness)
        asked.append(x)
        told.append(fitness)
    return np.concatenate(asked), np.concatenate(told)


def of_structure(x, depth, branches):
    index = AXES.indices(x)
    return (index[:, 0] == depth) & (index[:, 2] == branches)


def deceptive(x):
    """A slope for most structures; for one, a low plain with a high and narrow peak."""
    slope = 0.5 * x[:, 1]
    away = np.linalg.norm(x[:, [1, 3, 4]] - [0.3, 0.6, 0.2], axis=1)
    return np.where(of_structure(x, 2, 3), 0.2 + np.exp(-2.0 * away), slope)


def test_every_island_keeps_to_one_structure_and_all_are_tried():
    x, _ = ran(started(), lambda x: -x[:, 1], 200)
    index = AXES.canonical(x)[:, [0, 2]]
    assert len(np.unique(index, axis=0)) == STRUCTURES


def test_a_structure_that_is_good_only_once_adapted_is_found():
    for seed in range(2):
        search = started(seed=seed)
        x, fitness = ran(search, deceptive, 120)
        assert fitness.max() > 1.0
        assert of_structure(x[fitness.argmax()][None], 2, 3).all()


def test_the_better_structures_get_more_points():
    x, _ = ran(started(), deceptive, 120)
    share = of_structure(x, 2, 3).mean()
    assert share > 3.0 / STRUCTURES


def test_no_point_with_a_penalty_is_evaluated_where_there_are_others():
    search = started()

    def penalty(x):
        narrow = np.maximum(0.0, np.abs(x[:, 1] - 0.77) - 0.02) * 100.0
        return np.where(of_structure(x, 1, 2), 5.0, narrow)

    search.screen_by(penalty)
    x, _ = ran(search, lambda x: -x[:, 3], 60)
    assert (penalty(x) == 0.0).all()
    assert not of_structure(x, 1, 2).any()


def test_where_everything_has_a_penalty_the_least_is_evaluated():
    search = started()
    search.screen_by(lambda x: 1.0 + x[:, 1])
    x, _ = ran(search, lambda x: -1.0 - x[:, 1], 12)
    assert len(x) >= 12
    assert x[:, 1].mean() < 0.3


def test_an_island_that_never_hits_a_valid_point_can_be_recorded():
    search, given = started(), np.array([0.9, 0.31, 0.7, 0.62, 0.18])

    def penalty(x):
        away = np.abs(x - AXES.canonical(given[None])[0]).max(axis=1)
        return np.where(of_structure(x, 2, 2) & (away > 1e-9), 1.0, 0.0)

    search.screen_by(penalty)
    search.start_from([given])
    ran(search, lambda x: x[:, 1], 4)
    again = started()
    again.restore(state_from_text(state_to_text(search.state())))
    np.testing.assert_array_equal(again.state()["rungs"], search.state()["rungs"])
    assert min(min(ratings) for ratings in search.state()["ratings"]) == UNRATED


def test_where_few_points_are_valid_more_are_drawn():
    search = started()
    search.screen_by(lambda x: np.where(x[:, 1] * 100.0 % 1.0 < 0.1, 0.0, 1.0))
    x, _ = ran(search, lambda x: x[:, 1], 10)
    assert len(x) == 240


def test_points_without_a_design_are_no_trap():
    search = started()
    search.screen_by(lambda x: np.where(x[:, 0] > 0.5, np.nan, 0.0))
    x, _ = ran(search, lambda x: x[:, 1], 20)
    assert (x[:, 0] <= 0.5).all()


def test_islands_begin_at_the_points_given():
    search = started()
    given = np.array([0.9, 0.31, 0.7, 0.62, 0.18])
    search.start_from([given, given])
    x = search.ask()
    first = x[:12]  # of the first two of four islands
    index = AXES.indices(first)
    assert (index[:, 0] == 2).all()
    assert (index[:, 2] == 2).all()
    assert np.abs(first[:, [1, 3, 4]].mean(axis=0) - given[[1, 3, 4]]).max() < 0.12
    search.tell(x, -x[:, 1])
    ran(search, lambda x: -x[:, 1], 10)
    assert search.state()["begun"] > 2


def test_a_given_point_with_a_penalty_is_mended_first():
    search = started()
    search.screen_by(lambda x: np.maximum(0.0, x[:, 1] - 0.2))
    search.start_from([np.array([0.9, 0.6, 0.7, 0.62, 0.18])])
    x = search.ask()
    near = x[of_structure(x, 2, 2)]
    assert len(near) >= 6
    assert (near[:, 1] <= 0.2).all()


def test_the_population_is_divided_evenly():
    assert len(started(population=57).ask()) == 55
    assert len(started(population=20).ask()) == 18
    assert len(started(population=20, island=10).ask()) == 20
    assert len(started(population=5).ask()) == 5
    with pytest.raises(BadInputError, match="at least 4"):
        started(population=3)


def test_more_structures_than_can_be_counted_are_drawn():
    axes = SearchAxes(choices=(3, 900, 900, 0), levels=(0, 2, 3, 0), depth=0, least_depth=1)
    search = IslandsConfig().start(axes, 24, 1)
    seen = []
    for _ in range(30):
        x = search.ask()
        search.tell(x, x[:, 3])
        seen.append(x)
    assert len(np.unique(axes.canonical(np.concatenate(seen))[:, :3], axis=0)) > 5


def test_whole_numbers_alone_are_left_to_cmaes():
    axes = SearchAxes(choices=(3, 4), levels=(0, 0))
    assert isinstance(IslandsConfig().start(axes, 12, 1), Cma)
