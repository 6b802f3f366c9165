"""Every optimizer keeps the contract; the coordinates that they search."""

import logging
import os
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vinefab.core.errors import BadInputError
from vinefab.search.optimizers.optimizer import (
    OPTIMIZERS,
    SearchAxes,
    make_optimizer_config,
)
from vinefab.search.record.result import state_from_text, state_to_text
from vinefab.search.space import Bounds, BuildSettings, Space, SpaceSettings

SPACES = [
    Space(SpaceSettings(), BuildSettings()),
    Space(SpaceSettings(levels=Bounds(low=3, high=3)), BuildSettings()),
    Space(
        SpaceSettings(levels=Bounds(low=1, high=4), branches=Bounds(low=2, high=2)), BuildSettings()
    ),
]


@pytest.mark.parametrize("space", SPACES)
@given(seed=st.integers(0, 10_000))
def test_points_settle_without_changing_their_design(space, seed):
    x = np.random.default_rng(seed).random((4, len(space)))
    settled = space.axes.canonical(x)
    assert [space.design(row) for row in settled] == [space.design(row) for row in x]
    np.testing.assert_array_equal(space.axes.canonical(settled), settled)


@pytest.mark.parametrize("space", SPACES)
def test_what_is_called_inactive_changes_no_design_and_what_is_active_does(space):
    rng = np.random.default_rng(3)
    for x in rng.random((60, len(space))):
        active = space.axes.active(x[None])[0]
        for axis in range(len(space)):
            moved = x.copy()
            moved[axis] = (x[axis] + 0.5) % 1.0
            assert (space.design(moved) != space.design(x)) == active[axis]


def test_whole_numbers_have_equal_shares():
    axes = SearchAxes(choices=(3, 0), levels=(0, 0))
    x = np.array([[0.0, 0.3], [0.34, 0.3], [0.67, 0.3], [1.0, 0.3]])
    assert axes.indices(x)[:, 0].tolist() == [0, 1, 2, 2]
    np.testing.assert_allclose(axes.canonical(x)[:, 0], [1 / 6, 1 / 2, 5 / 6, 5 / 6])


def test_axes_must_agree():
    with pytest.raises(BadInputError, match="axes"):
        SearchAxes(choices=(), levels=())
    with pytest.raises(BadInputError, match="axes"):
        SearchAxes(choices=(0, 0), levels=(0,))


TARGET = np.linspace(0.2, 0.8, 6)
MIXED = SearchAxes(choices=(3, 0, 2, 4, 0, 0), levels=(0, 0, 2, 2, 3, 3), depth=0, least_depth=1)
PARTS: list[tuple[str, dict[str, object]]] = [
    *[(name, {}) for name in OPTIMIZERS],
    ("pso", {"neighbours": 0}),
    ("pso", {"ignore_inactive": True}),
    ("particleswarm", {"adapt_always": False}),
    ("particleswarm", {"reevaluate": True}),
]


def worth(x):
    return -((x - TARGET) ** 2).sum(axis=1)


def steps(optimizer, count):
    asked = []
    for _ in range(count):
        x = optimizer.ask()
        optimizer.tell(x, worth(x))
        asked.append(x)
    return asked


def same(one, other):
    return len(one) == len(other) and all(map(np.array_equal, one, other))


@pytest.fixture(params=PARTS, ids=str)
def part(request):
    return request.param


def started(part, seed=4):
    return make_optimizer_config(*part).start(MIXED, population=9, seed=seed)


def test_points_stay_in_the_cube_and_asking_twice_changes_nothing(part):
    optimizer = started(part)
    for _ in range(30):
        x = optimizer.ask()
        assert x.shape[1] == 6
        assert len(x) == 9 if "reevaluate" not in part[1] else len(x) in (5, 10)
        assert ((x >= 0.0) & (x <= 1.0)).all()
        np.testing.assert_array_equal(optimizer.ask(), x)
        optimizer.tell(x, worth(x))


def test_the_seed_decides_everything(part):
    assert same(steps(started(part), 8), steps(started(part), 8))
    assert not same(steps(started(part), 1), steps(started(part, seed=5), 1))


def test_a_restored_state_continues_bit_for_bit(part):
    undisturbed = steps(started(part), 12)
    for stop in (0, 1, 5, 11):
        first = started(part)
        steps(first, stop)
        kept = state_from_text(state_to_text(first.state()))
        second = started(part)
        second.restore(kept)
        assert same(steps(second, 12 - stop), undisturbed[stop:])


def test_the_global_generator_is_neither_read_nor_moved(part):
    np.random.seed(1)  # noqa: NPY002
    before = np.random.get_state()  # noqa: NPY002
    asked = steps(started(part), 3)
    after = np.random.get_state()  # noqa: NPY002
    np.testing.assert_array_equal(before[1], after[1])
    assert before[2:] == after[2:]
    np.random.seed(2)  # noqa: NPY002
    assert same(steps(started(part), 3), asked)


@pytest.mark.parametrize("name", [name for name in OPTIMIZERS if name != "random"])
def test_every_optimizer_finds_what_random_search_misses(name):
    found = {}
    for each in (name, "random"):
        optimizer = make_optimizer_config(each).start(
            SearchAxes.continuous(6), population=12, seed=1
        )
        found[each] = max(worth(x).max() for x in steps(optimizer, 60))
    assert found[name] > -5e-3
    assert found["random"] < -1e-2


@pytest.mark.parametrize("name", list(OPTIMIZERS))
def test_one_variable_of_any_kind_is_enough(name):
    for choices in (0, 2, 5):
        axes = SearchAxes(choices=(choices,), levels=(0,))
        optimizer = make_optimizer_config(name).start(axes, population=6, seed=1)
        asked = []
        for _ in range(10):
            x = optimizer.ask()
            optimizer.tell(x, -np.abs(x[:, 0] - 0.9))
            asked.append(x)
        found = np.concatenate(asked)
        assert np.abs(found - 0.9).min() < 0.16
        assert ((found >= 0.0) & (found <= 1.0)).all()


@pytest.mark.parametrize("name", list(OPTIMIZERS))
def test_equal_fitness_everywhere_stops_no_optimizer(name):
    optimizer = make_optimizer_config(name).start(MIXED, population=8, seed=2)
    for _ in range(25):
        x = optimizer.ask()
        optimizer.tell(x, np.full(len(x), -1e6))
    assert np.isfinite(optimizer.ask()).all()


def test_importing_pyswarms_leaves_logging_environment_and_folder_alone(tmp_path):
    program = """
import logging, os
handlers, level = list(logging.getLogger().handlers), logging.getLogger().level
from vinefab.search.optimizers import swarms
assert swarms.topology.Star  # whoever looks at the module first
from vinefab.search.optimizers.optimizer import SearchAxes
from vinefab.search.optimizers.optimizer import make_optimizer_config
make_optimizer_config("pso").start(SearchAxes.continuous(3), population=4, seed=1).ask()
assert logging.getLogger().handlers == handlers and logging.getLogger().level == level
assert os.environ.get("LOG_CFG") == "mine"
"""
    environment = {**os.environ, "LOG_CFG": "mine"}
    subprocess.run([sys.executable, "-c", program], cwd=tmp_path, env=environment, check=True)
    assert list(tmp_path.iterdir()) == []
    assert logging.getLogger("pyswarms").handlers == []
