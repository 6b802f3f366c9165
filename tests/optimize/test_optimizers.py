import json
import logging
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from vinefab.core.errors import BadInputError, UnknownNameError
from vinefab.optimize.optimizer import Optimizer
from vinefab.optimize.registry import OPTIMIZERS, make_recipe

TARGET = np.linspace(0.2, 0.8, 6)


def worth(x: np.ndarray) -> np.ndarray:
    return -((x - TARGET) ** 2).sum(axis=1)


def steps(optimizer: Optimizer, count: int) -> list[np.ndarray]:
    asked = []
    for _ in range(count):
        x = optimizer.ask()
        optimizer.tell(x, worth(x))
        asked.append(x)
    return asked


@pytest.fixture(params=[(name, {}) for name in OPTIMIZERS] + [("pso", {"neighbours": 0})], ids=str)
def part(request: pytest.FixtureRequest) -> tuple[str, dict[str, object]]:
    return request.param


def started(part: tuple[str, dict[str, object]], seed: int = 4) -> Optimizer:
    return make_recipe(*part).start(dimensions=6, population=9, seed=seed)


def test_points_stay_in_the_cube_and_asking_twice_changes_nothing(
    part: tuple[str, dict[str, object]],
) -> None:
    optimizer = started(part)
    for _ in range(30):
        x = optimizer.ask()
        assert x.shape == (9, 6)
        assert ((x >= 0.0) & (x <= 1.0)).all()
        np.testing.assert_array_equal(optimizer.ask(), x)
        optimizer.tell(x, worth(x))


def test_the_seed_decides_everything(part: tuple[str, dict[str, object]]) -> None:
    np.testing.assert_array_equal(steps(started(part), 8), steps(started(part), 8))
    assert not np.array_equal(steps(started(part), 1), steps(started(part, seed=5), 1))


def test_a_restored_state_goes_on_bit_for_bit(part: tuple[str, dict[str, object]]) -> None:
    undisturbed = steps(started(part), 12)
    for stop in (0, 1, 5, 11):
        first = started(part)
        steps(first, stop)
        kept = json.loads(json.dumps(first.state(), allow_nan=False))
        second = started(part)
        second.restore(kept)
        np.testing.assert_array_equal(steps(second, 12 - stop), undisturbed[stop:])


def test_the_global_generator_is_neither_read_nor_moved(
    part: tuple[str, dict[str, object]],
) -> None:
    np.random.seed(1)  # noqa: NPY002
    before = np.random.get_state()  # noqa: NPY002
    asked = steps(started(part), 3)
    after = np.random.get_state()  # noqa: NPY002
    np.testing.assert_array_equal(before[1], after[1])
    assert before[2:] == after[2:]
    np.random.seed(2)  # noqa: NPY002
    np.testing.assert_array_equal(steps(started(part), 3), asked)


def test_the_swarm_finds_what_random_search_misses() -> None:
    found = {}
    for name in ("pso", "random"):
        optimizer = make_recipe(name).start(dimensions=6, population=12, seed=1)
        found[name] = max(worth(x).max() for x in steps(optimizer, 60))
    assert found["pso"] > -1e-3
    assert found["random"] < -1e-2


def test_importing_pyswarms_leaves_logging_environment_and_folder_alone(tmp_path: Path) -> None:
    program = """
import logging, os
handlers, level = list(logging.getLogger().handlers), logging.getLogger().level
from vinefab.optimize.registry import make_recipe
make_recipe("pso").start(dimensions=3, population=4, seed=1).ask()
assert logging.getLogger().handlers == handlers and logging.getLogger().level == level
assert os.environ.get("LOG_CFG") == "mine"
"""
    environment = {**os.environ, "LOG_CFG": "mine"}
    subprocess.run([sys.executable, "-c", program], cwd=tmp_path, env=environment, check=True)
    assert list(tmp_path.iterdir()) == []
    assert logging.getLogger("pyswarms").handlers == []


def test_wrong_parameters_are_refused() -> None:
    with pytest.raises(BadInputError, match="inertia"):
        make_recipe("pso", {"inertia": -1.0})
    with pytest.raises(UnknownNameError, match="optimizer"):
        make_recipe("swarm")
