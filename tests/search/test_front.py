"""Several objectives at once: fronts, NSGA-II, and runs that end with a front."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.search.conftest import optimize
from vinefab.core.errors import BadInputError
from vinefab.model.tree import branch_tree
from vinefab.search.dask_cluster import deserialized, serialized
from vinefab.search.evaluator import Evaluator
from vinefab.search.finalists import (
    knee,
    non_dominated,
    spread_out,
)
from vinefab.search.optimizers.evolution import NsgaConfig, ranking
from vinefab.search.optimizers.optimizer import FrontOptimizer, SearchAxes
from vinefab.search.record.generations import RunIdentity
from vinefab.search.record.store import RunStore
from vinefab.search.run import Search
from vinefab.search.settings import PartSettings, check_objectives
from vinefab.tasks.evaluate import composites, score_design
from vinefab.tasks.reach import Reach

VALUES = st.lists(st.tuples(st.integers(0, 6), st.integers(0, 6)), min_size=1, max_size=15)


@given(VALUES)
def test_a_front_holds_exactly_the_non_dominated_points(values):
    worth, cost = np.array(values, dtype=float).T
    kept = non_dominated(worth, cost[:, None])
    for row, (w, c) in enumerate(values):
        dominated = any(v >= w and d <= c and (v, d) != (w, c) for v, d in values)
        first = values.index((w, c)) == row
        assert kept[row] == (first and not dominated)


def test_the_knee_and_points_along_a_front():
    worth, cost = np.array([0.0, 0.5, 0.9, 1.0]), np.array([1.0, 2.0, 3.0, 10.0])
    assert knee(worth, cost) == 2
    assert spread_out(cost[::-1, None], 2) == [3, 0]
    assert spread_out(cost[:, None], 9) == [0, 1, 2, 3]


def test_a_front_that_does_not_bend_has_no_knee():
    cost = np.linspace(3.0, 9.0, 7)
    share = (cost - 3.0) / 6.0
    assert knee(share**2, cost) is None  # sags
    assert knee(5.0 + share, 100.0 * cost) is None  # straight
    assert knee(share + 0.01 * np.sin(9.0 * share), cost) is None  # as good as straight
    assert knee(np.sqrt(share), cost) is not None
    assert knee(np.array([0.0, 1.0]), np.array([1.0, 2.0])) is None
    assert knee(np.array([0.3]), np.array([1.0])) is None


@given(VALUES, st.integers(1, 9), st.integers(-5, 5))
def test_a_knee_is_above_the_line_between_the_ends_in_any_units(values, scale, shift):
    worth, cost = np.array(values, dtype=float).T
    found = knee(worth, cost)
    assert knee(scale * worth + shift, 2.0 * scale * cost) == found
    front = sorted(_non_dominated(values))
    if found is None:
        heights = [_height(front, point) for point in front[1:-1]]
        assert max(heights, default=0.0) < 0.05 + 1e-9
    else:
        here = float(cost[found]), float(worth[found])
        assert here in front[1:-1]
        assert _height(front, here) == pytest.approx(max(_height(front, p) for p in front))


def _non_dominated(values):
    return {
        (c, w)
        for w, c in values
        if not any(v >= w and d <= c and (v, d) != (w, c) for v, d in values)
    }


def _height(front, point):
    """The vertical way from the line between the ends to a point, over the front's height."""
    (c0, w0), (c1, w1) = front[0], front[-1]
    on_line = w0 + (w1 - w0) * (point[0] - c0) / (c1 - c0)
    return (point[1] - on_line) / (w1 - w0)


def test_ranking_goes_front_by_front_ends_first_and_infeasible_points_last():
    worth = np.array([1.0, 2.0, 3.0, 0.5, -9.0, -5.0, 1.9])
    cost = np.array([[1.0], [2.0], [3.0], [1.5], [0.1], [0.1], [2.5]])
    order = ranking(worth, cost, lowest=0.0).tolist()
    assert set(order[:3]) == {0, 1, 2}
    assert order[2] == 1  # between the ends of its front
    assert set(order[3:5]) == {3, 6}
    assert order[5:] == [5, 4]


def sphere_front(seed, generations):
    """What NSGA-II finds for -|x - a| against |x - b|: the way from a to b."""
    a, b = np.full(4, 0.3), np.full(4, 0.7)
    search = NsgaConfig().start(SearchAxes.continuous(4), 24, seed)
    assert isinstance(search, FrontOptimizer)
    search.set_lowest(-10.0)
    for _ in range(generations):
        x = search.ask()
        costs = np.linalg.norm(x - b, axis=1)[:, None]
        search.tell_costs(x, -np.linalg.norm(x - a, axis=1), costs)
    return np.asarray(search.state()["parents"])


def test_the_algorithm_finds_a_front_that_is_known():
    x = sphere_front(1, 60)
    ways = np.linalg.norm(x - 0.3, axis=1) + np.linalg.norm(x - 0.7, axis=1)
    assert np.median(ways) < 1.03 * 0.8  # the straight way from a to b
    assert x.mean(axis=1).min() < 0.36
    assert x.mean(axis=1).max() > 0.64
    assert np.array_equal(x, sphere_front(1, 60))
    assert not np.array_equal(x, sphere_front(2, 60))


def with_front(settings):
    return settings.changed(
        objectives=("coverage", "film_length"), optimizer=PartSettings(name="nsga2")
    )


def test_finalists_of_a_run_are_its_front(small, maps):
    result = optimize(with_front(small), maps)
    x = np.concatenate([g.x for g in result.history])
    assert len(x) == 30
    assert 2 <= len(result.finalists) <= 3
    lengths = [branch_tree(finalist.design).total_length_mm for finalist in result.finalists]
    assert max(lengths) > 1.5 * min(lengths)
    assert result.fabricable


def test_a_front_is_the_same_after_an_interrupt(small, maps, tmp_path):
    settings = with_front(small)
    whole = optimize(settings, maps)

    def stop(progress):
        if progress.generation == 2:
            raise KeyboardInterrupt

    identity = RunIdentity.of(settings, maps)
    with RunStore.open(tmp_path, identity, maps=maps) as store, pytest.raises(KeyboardInterrupt):
        optimize(settings, maps, store=store, progress=stop)
    with RunStore.open(tmp_path, identity, maps=maps, resume=True) as store:
        resumed = optimize(settings, maps, store=store)
    assert resumed.best == whole.best
    assert [f.fitness for f in resumed.finalists] == [f.fitness for f in whole.finalists]
    assert len(resumed.history) == 5


def with_two_tasks(settings, composite="mean"):
    return settings.changed(
        objectives=("reach", "coverage", "branches"),
        other_parameters={"reach": {"buffer_mm": 25.0}},
        optimizer=PartSettings(name="nsga2"),
        evaluation=settings.evaluation.changed(composite=composite, finalists=6),
    )


@pytest.mark.parametrize("composite", ["mean", "min_deviation"])
def test_other_tasks_are_scored_from_the_same_growths(small, maps, composite):
    settings = with_two_tasks(small, composite)
    result = optimize(settings, maps, workers=2)
    alone = small.changed(task=PartSettings(name="reach", parameters={"buffer_mm": 25.0}))
    evaluator = Search.of(alone, maps).evaluator
    for generation in result.history:
        conditions = evaluator.training_conditions(settings.search.seed, generation.number)
        scores = evaluator.evaluate(generation.x, conditions)[0].score
        wanted = composites(scores, composite)
        assert generation.terms["reach"].tolist() == wanted.tolist()
    final = evaluator.final_conditions(settings.search.seed)
    exact = Reach(buffer_mm=25.0)
    for finalist in result.finalists:
        score = score_design(finalist.design, evaluator.maps, final.poses, exact, settings.growth)
        assert finalist.score.composite["reach"] == pytest.approx(score.composite[composite])
        assert finalist.score.task == "coverage"
    # On the poses of the search none dominates another.
    x = np.concatenate([g.x for g in result.history])
    fitness = np.concatenate([g.fitness for g in result.history])
    reach = np.concatenate([g.terms["reach"] for g in result.history])
    rows = [int(np.flatnonzero((x == f.x).all(axis=1))[0]) for f in result.finalists]
    branch_numbers = np.array([float(f.design.branch_count) for f in result.finalists])
    costs = np.column_stack([-reach[rows], branch_numbers])
    assert non_dominated(fitness[rows], costs).all()
    assert len(rows) >= 3


def test_a_run_of_two_tasks_is_the_same_after_an_interrupt_and_in_other_processes(
    small, maps, tmp_path
):
    settings = with_two_tasks(small)
    whole = optimize(settings, maps)

    def stop(progress):
        if progress.generation == 3:
            raise KeyboardInterrupt

    identity = RunIdentity.of(settings, maps)
    with RunStore.open(tmp_path, identity, maps=maps) as store, pytest.raises(KeyboardInterrupt):
        optimize(settings, maps, store=store, progress=stop)
    with RunStore.open(tmp_path, identity, maps=maps, resume=True) as store:
        resumed = optimize(settings, maps, store=store)
    assert resumed.best == whole.best
    for one, other in zip(resumed.finalists, whole.finalists, strict=True):
        assert one.score == other.score
    assert len(resumed.history) == 5
    wider = settings.changed(other_parameters={"reach": {"buffer_mm": 26.0}})
    assert RunIdentity.of(wider, maps).run_id != identity.run_id
    # What a worker of a cluster gets evaluates as here.
    search = Search.of(settings, maps)
    sent = Evaluator.of(deserialized(serialized(search.evaluator.spec)))
    x, conditions = whole.history[0].x, sent.training_conditions(settings.search.seed, 0)
    there, _ = sent.evaluate(x, conditions)
    here, _ = search.evaluator.evaluate(x, conditions)
    assert there.terms["reach"].tolist() == here.terms["reach"].tolist()


@pytest.mark.parametrize(("own", "key"), [("reach", "task."), ("coverage", "task.reach.")])
def test_a_target_in_an_obstacle_is_refused_by_the_name_of_its_table(small, maps, own, key):
    inside = maps[0].obstacles[3].representative_point()
    target = {"target_mm": [[250.0, 15.0], [inside.x, inside.y]]}
    settings = with_two_tasks(small).changed(other_parameters={"reach": target})
    if own == "reach":
        settings = small.changed(task=PartSettings(name="reach", parameters=target))
    with pytest.raises(BadInputError, match="inside an obstacle of map 'grid_1'") as caught:
        Search.of(settings, maps)
    assert caught.value.key == f"{key}target_mm[2]"


def test_other_tasks_lose_for_head_on_stops_and_meet_the_same_contacts(small, maps):
    small = small.changed(
        growth=small.growth.changed(head_on_half_angle_rad=(0.02, 0.3)),
        evaluation=small.evaluation.changed(head_on_weight=0.3),
    )
    both = Search.of(with_two_tasks(small), maps).evaluator
    other = PartSettings(name="reach", parameters={"buffer_mm": 25.0})
    alone = Search.of(small.changed(task=other), maps).evaluator
    x = np.random.default_rng(4).random((8, len(both.space)))
    conditions = both.training_conditions(3, 0)
    one, _ = both.evaluate(x, conditions)
    assert one.terms["reach"].tolist() == alone.evaluate(x, conditions)[0].score.tolist()
    assert one.terms["reach"].min() < 0.0
    assert "head_on_half_angle_deg" in one.terms


class Short:
    """Designs over 700 mm of film are penalized; those of 300 to 500 mm fail the full check."""

    def __call__(self, design):
        return max(0.0, branch_tree(design).total_length_mm - 700.0) / 1000.0

    def passes(self, design):
        return not 300.0 < branch_tree(design).total_length_mm < 500.0


def test_every_design_of_a_front_is_manufacturable(fabricable, maps):
    settings = with_front(fabricable.changed(search=fabricable.search.changed(population=20)))
    result = optimize(settings, maps, penalty=Short())
    for finalist in result.finalists:
        assert Short()(finalist.design) == finalist.penalty == 0.0
        assert Short().passes(finalist.design)


@pytest.mark.parametrize(
    ("objectives", "optimizer", "words"),
    [
        (("coverage", "film_lenght"), "nsga2", "did you mean 'film_length'"),
        (("coverage", "paint"), "nsga2", "other tasks \\(reach, anchoring\\) and costs"),
        (("coverage", "film_length", "film_length"), "nsga2", "each objective once"),
        (("branches", "film_length"), "nsga2", "'coverage', among them"),
        (("coverage",), "nsga2", "or another task beside the score"),
        (("coverage", "branches"), "pso", "'nsga2' for several objectives"),
    ],
)
def test_objectives_that_contradict_are_refused(objectives, optimizer, words):
    with pytest.raises(BadInputError, match=words):
        check_objectives(objectives, "coverage", optimizer)
