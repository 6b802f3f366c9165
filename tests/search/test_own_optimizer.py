"""An optimizer of one's own goes into `vf.optimize` as an object."""

from dataclasses import dataclass

import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

import vinefab as vf
from vinefab.search.run import Search, training_maps

SETTINGS = vf.RunSettings(
    maps=vf.MapSettings(count=1, options={"columns": 3, "rows": 3}),
    search=vf.SearchSettings(population=4, generations=2),
    evaluation=vf.EvaluationSettings(fabricable=False),
)


class Rolling:
    def __init__(self, axes, population, seed):
        self.shape, self.rng = (population, len(axes)), np.random.default_rng(seed)

    def ask(self):
        return self.rng.random(self.shape)

    def tell(self, x, fitness):
        pass

    def state(self):
        return self.rng.bit_generator.state  # tables within a table

    def restore(self, state):
        self.rng.bit_generator.state = state


@dataclass(frozen=True)
class Dice:
    faces: int = 6

    def start(self, axes, population, seed):
        return Rolling(axes, population, seed)


def optimize(optimizer, **options):
    return vf.optimize(SETTINGS, optimizer=optimizer, page=False, progress=False, **options)


def points(result):
    return [one.x.tolist() for one in result.history]


def test_it_is_asked_and_recorded_and_goes_on_where_it_stopped(tmp_path):
    drawn = points(optimize(Dice()))
    expected = np.random.default_rng(SETTINGS.search.seed).random((2, *np.shape(drawn[0])))
    assert drawn == expected.tolist()
    assert points(optimize(Dice(), out=tmp_path / "run")) == drawn
    longer = optimize(Dice(), out=tmp_path / "run", resume=True, generations=4)
    again = np.random.default_rng(SETTINGS.search.seed).random((4, *np.shape(drawn[0])))
    assert points(longer) == again.tolist()
    for other, key in ((Dice(8), "optimizer.parameters.faces"), ("random", "optimizer.name")):
        with pytest.raises(vf.BadInputError, match="and the run began with") as caught:
            optimize(other, out=tmp_path / "run", resume=True)
        assert caught.value.key == key


def test_a_name_is_taken_and_anything_else_is_refused():
    drawn = points(optimize("random"))
    named = SETTINGS.changed(optimizer={"name": "random"})
    assert points(vf.optimize(named, progress=False)) == drawn
    with pytest.raises(vf.VinefabError, match="did you mean 'random'"):
        optimize("randm")
    with pytest.raises(vf.BadInputError, match="start"):
        optimize(3)


@pytest.mark.parametrize(
    ("penalty", "words"),
    [(lambda _: 1 / 0, "ZeroDivisionError"), (lambda _: "much", "not a number")],
)
def test_a_penalty_that_breaks_down_is_named(penalty, words):
    settings = SETTINGS.changed(evaluation={"fabricable": True})
    search = Search.of(settings, training_maps(settings), penalty)
    with pytest.raises(vf.VinefabError, match=words) as caught:
        search.run()
    assert "penalty" in str(caught.value)


def blas_threads():
    return {one["num_threads"] for one in threadpool_info() if one["user_api"] == "blas"}


def test_linear_algebra_has_one_thread_so_that_no_result_depends_on_the_processors(monkeypatch):
    seen = []
    ask = Rolling.ask
    monkeypatch.setattr(Rolling, "ask", lambda self: seen.append(blas_threads()) or ask(self))
    with threadpool_limits(limits=2, user_api="blas"):
        optimize(Dice())
        assert blas_threads() == {2}
    assert seen == [{1}, {1}]
