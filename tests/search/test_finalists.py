"""The choice of a winner: full checks, repairs, and fronts of several objectives."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.search.conftest import made_generation, optimize
from vinefab.core.errors import BadInputError
from vinefab.core.limits import rad
from vinefab.growth.options import CONTACT_ANGLES_DEG
from vinefab.model.design import Design
from vinefab.model.map import Pose, Start
from vinefab.search.dask_cluster import deserialized, serialized
from vinefab.search.evaluator import FRESH, Evaluator
from vinefab.search.finalists import (
    FRESH_POSES,
    MOST_CHECKS,
    PATIENCE,
    STEPS,
    RepairBudget,
    RepairResults,
    choose_finalists,
    knee,
    non_dominated,
    repair_design,
    spread_out,
)
from vinefab.search.optimizers.evolution import ranking
from vinefab.search.optimizers.evolution_settings import NsgaConfig
from vinefab.search.optimizers.optimizer import FrontOptimizer, SearchAxes
from vinefab.search.record.generations import RunIdentity
from vinefab.search.record.store import RunStore
from vinefab.search.run import FRESH_MAPS, Search, fresh_maps, training_maps
from vinefab.search.settings import PartSettings, check_objectives
from vinefab.search.space import BuildSettings, Space, SpaceSettings
from vinefab.tasks import make_task
from vinefab.tasks.evaluate import PreparedMap, composites, score_design
from vinefab.tasks.reach import Reach


def even(design):
    """A rule that no penalty covers: an even number of whole millimetres."""
    return int(design.trunk_length_mm) % 2 == 0


@dataclass
class Strict:
    """A penalty on trunks beyond a length, and a full check of something else."""

    longest_mm: float
    passing: Callable[[Design], bool] = even

    def __call__(self, design):
        return max(0.0, design.trunk_length_mm - self.longest_mm) / 100.0

    def passes(self, design):
        return self.passing(design)


def test_only_designs_that_pass_the_full_check_are_finalists(fabricable, maps):
    result = optimize(fabricable, maps, penalty=Strict(150.0, even))
    assert result.fabricable
    assert len(result.finalists) == 3
    assert all(even(finalist.design) for finalist in result.finalists)
    blind = optimize(fabricable, maps, penalty=Strict(150.0, lambda _: True))
    assert not all(even(finalist.design) for finalist in blind.finalists)


def test_when_none_passes_the_best_are_repaired(fabricable, maps):
    """All trunks of the run are too long, so they are shortened."""
    first = optimize(fabricable, maps, penalty=Strict(0.0, even)).history
    shortest = min(100.0 * g.penalty.min() for g in first)
    strict = Strict(shortest - 1.0, lambda design: design.trunk_length_mm <= shortest - 1.0)
    result = optimize(fabricable, maps, penalty=strict)
    assert all((generation.penalty > 0.0).all() for generation in result.history)
    assert result.fabricable
    assert result.best.trunk_length_mm <= shortest - 1.0
    assert result.repair.startswith("the search found no manufacturable design; tried ")
    assert result.repair.endswith(" changes of the best 3: 3 of them are manufacturable now")
    assert result.best == optimize(fabricable, maps, penalty=strict).best


def test_a_winner_beyond_repair_is_penalized(fabricable, maps):
    result = optimize(fabricable, maps, penalty=Strict(500.0, lambda _: False))
    assert not result.fabricable
    assert result.finalists[0].penalty == 1.0
    assert result.finalists[0].fitness < -0.5
    assert "tried 100 changes of the best 2: none is manufacturable" in result.repair


def test_finalists_may_be_chosen_by_their_mean_over_the_range_of_contacts(small, maps):
    small = small.changed(search=small.search.changed(population=12, generations=6))
    by_range = small.evaluation.changed(finalists=8, finalists_by="contact_range")
    usual = optimize(small.changed(evaluation=by_range.changed(finalists_by="training")), maps)
    result = optimize(small.changed(evaluation=by_range), maps)
    search = Search.of(small.changed(evaluation=by_range), maps)
    poses = search.evaluator.final_conditions(small.search.seed).poses
    prepared = search.evaluator.maps
    for finalist in result.finalists:
        scores = [
            score_design(
                finalist.design, prepared, poses, search.evaluator.task,
                small.growth.changed(head_on_half_angle_rad=rad(angle)),
            ).composite["mean"]
            for angle in CONTACT_ANGLES_DEG
        ]  # fmt: skip
        assert finalist.fitness == pytest.approx(np.mean(scores))
    fitness = [finalist.fitness for finalist in result.finalists]
    assert fitness == sorted(fitness, reverse=True)
    # What is reported stays the score at the contacts of the run; the order is another one.
    assert {f.score.composite["mean"] for f in result.finalists} == {
        f.score.composite["mean"] for f in usual.finalists
    }
    assert [f.design for f in result.finalists] != [f.design for f in usual.finalists]


def test_a_winner_is_chosen_on_maps_that_the_search_has_not_seen(small):
    settings = small.changed(evaluation=small.evaluation.changed(finalists=8))
    fresh = fresh_maps(settings)
    assert len(fresh) == FRESH_MAPS
    known = training_maps(settings)
    assert not {world.seed for world in fresh} & {world.seed for world in known}
    result = Search.of(settings, known, fresh_maps=fresh).run()
    usual = Search.of(settings, known).run()
    fitness = [finalist.fitness for finalist in result.finalists]
    assert fitness == sorted(fitness, reverse=True)
    assert fitness != [finalist.fitness for finalist in usual.finalists]
    # What is reported stays the score on the training maps.
    assert {f.score.composite["mean"] for f in result.finalists} == {
        f.score.composite["mean"] for f in usual.finalists
    }
    sites = [PreparedMap.of(world) for world in fresh]
    conditions = Search.of(settings, fresh).evaluator.conditions(
        settings.search.seed, FRESH, 0, FRESH_POSES
    )
    task = make_task(settings.task.name, {**settings.task.parameters, "area": "fast"})
    best = score_design(result.best, sites, conditions.poses, task, settings.growth)
    assert fitness[0] == pytest.approx(best.composite["mean"])


def test_where_a_run_names_its_places_the_winner_is_chosen_there(small):
    start = Start(pose=Pose(x_mm=10.0, y_mm=10.0, heading_rad=0.0))
    aimed = PartSettings(name="reach", parameters={"targets": [[100.0, 100.0]]})
    for other in (
        small.changed(maps=small.maps.changed(start=start)),
        small.changed(maps=small.maps.changed(files=(Path("a.geojson"),))),
        small.changed(task=aimed),
        small.changed(evaluation=small.evaluation.changed(finalists_by="training")),
    ):
        assert fresh_maps(other) == ()


@pytest.mark.parametrize(("count", "most"), [(3, 60), (40, 80)])
def test_so_many_designs_are_checked_in_full(count, most):
    space = Space(SpaceSettings(), BuildSettings())
    x, checked = np.random.default_rng(1).random((300, len(space))), list[Design]()
    history = [made_generation(0, x[:, 0], x=x)]

    class Refusing:
        def __call__(self, _):
            return 1.5

        def passes(self, design):
            checked.append(design)
            return False

    evaluator: Any = SimpleNamespace(
        winner_penalty=Refusing(), penalty=None, space=space, has_table=False
    )
    assert not choose_finalists(history, evaluator, count).checked
    assert len(checked) == most
    assert checked[0] == space.design(x[x[:, 0].argmax()])


def test_a_repair_stays_near_and_is_always_the_same():
    space = Space(SpaceSettings(), BuildSettings())
    x = np.full(len(space), 0.9)
    strict = Strict(150.0)
    repaired = repair_design(x, space, strict, strict.passes)
    assert repaired.passed
    design = space.design(repaired.x)
    assert strict(design) == 0.0
    assert even(design)
    assert np.count_nonzero(repaired.x != x) < len(x)
    again = repair_design(x, space, strict, strict.passes)
    assert np.array_equal(repaired.x, again.x)
    assert not repair_design(x, space, replace(strict, longest_mm=0.0), strict.passes).passed


def test_a_repair_without_progress_is_given_up():
    space = Space(SpaceSettings(), BuildSettings())
    x, budget = np.full(len(space), 0.9), RepairBudget()
    checked = list[Design]()

    def flat(design):
        checked.append(design)
        return 1.5

    given_up = repair_design(x, space, flat, even, budget)
    assert not given_up.passed
    assert len(checked) == PATIENCE + 1
    assert budget.steps == STEPS - PATIENCE
    assert given_up.penalty == 1.5


def test_many_repairs_share_one_budget():
    space = Space(SpaceSettings(), BuildSettings())
    points = [np.full(len(space), share) for share in np.linspace(0.1, 0.9, 40)]
    repairs = RepairResults.of(points, space, lambda _: 1.5, even)
    assert repairs.repaired == []
    assert f"; tried {STEPS} changes of the best {-(-STEPS // PATIENCE)}:" in repairs.message
    assert repairs.message.endswith("none is manufacturable, lowest penalty 1.5")
    # A full check takes fifty times as long as a change.
    checks = list[Design]()
    RepairResults.of(points, space, lambda _: 0.0, lambda design: checks.append(design) is not None)
    assert len(checks) == 2 * MOST_CHECKS


def test_refusals_do_not_stop_a_repair():
    space = Space(SpaceSettings(), BuildSettings())

    def refusing(design):
        if design.depth > 2:
            raise BadInputError("depth", design.depth, "two levels")
        return 0.0

    repaired = repair_design(np.full(len(space), 0.9), space, refusing, even)
    assert repaired.passed
    assert space.design(repaired.x).depth == 2


VALUES = st.lists(st.tuples(st.integers(0, 6), st.integers(0, 6)), min_size=1, max_size=15)


@given(VALUES)
def test_a_front_holds_exactly_the_non_dominated_points(values):
    worth, cost = np.array(values, dtype=float).T
    kept = non_dominated(worth, cost[:, None])
    for row, (w, c) in enumerate(values):
        dominated = any(v >= w and d <= c and (v, d) != (w, c) for v, d in values)
        first = values.index((w, c)) == row
        assert kept[row] == (first and not dominated)


def test_points_along_a_front():
    cost = np.array([1.0, 2.0, 3.0, 10.0])
    assert spread_out(cost[::-1, None], 2) == [3, 0]
    assert spread_out(cost[:, None], 9) == [0, 1, 2, 3]


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
        assert _height(front, here) > 0.05 - 1e-9
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
    lengths = [finalist.design.tree.total_length_mm for finalist in result.finalists]
    assert max(lengths) > 1.5 * min(lengths)
    assert result.fabricable


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


@pytest.mark.parametrize("objectives", [with_front, with_two_tasks], ids=["cost", "two tasks"])
def test_a_front_is_the_same_after_an_interrupt(small, maps, tmp_path, objectives):
    settings = objectives(small)
    whole = optimize(settings, maps)

    def stop(progress):
        if progress.done == 3:
            raise KeyboardInterrupt

    identity = RunIdentity.of(settings, maps)
    with RunStore.open(tmp_path, identity, maps=maps) as store, pytest.raises(KeyboardInterrupt):
        optimize(settings, maps, store=store, progress=stop)
    with RunStore.open(tmp_path, identity, maps=maps, resume=True) as store:
        resumed = optimize(settings, maps, store=store)
    assert resumed.best == whole.best
    for one, other in zip(resumed.finalists, whole.finalists, strict=True):
        assert (one.score, one.fitness) == (other.score, other.fitness)
    assert len(resumed.history) == 5


def test_two_tasks_are_one_run_and_are_scored_alike_by_the_workers_of_a_cluster(small, maps):
    settings = with_two_tasks(small)
    wider = settings.changed(other_parameters={"reach": {"buffer_mm": 26.0}})
    assert RunIdentity.of(wider, maps).run_id != RunIdentity.of(settings, maps).run_id
    search = Search.of(settings, maps)
    sent = Evaluator.of(deserialized(serialized(search.evaluator.spec)))
    x = np.random.default_rng(1).random((6, len(sent.space)))
    conditions = sent.training_conditions(settings.search.seed, 0)
    there, here = (one.evaluate(x, conditions)[0] for one in (sent, search.evaluator))
    assert there.terms["reach"].tolist() == here.terms["reach"].tolist()


@pytest.mark.parametrize(("own", "key"), [("reach", "task."), ("coverage", "task.reach.")])
def test_a_target_in_an_obstacle_is_refused_by_the_name_of_its_table(small, maps, own, key):
    inside = maps[0].obstacles[3].representative_point()
    target = {"targets": [[250.0, 15.0], [inside.x, inside.y]]}
    settings = with_two_tasks(small).changed(other_parameters={"reach": target})
    if own == "reach":
        settings = small.changed(task=PartSettings(name="reach", parameters=target))
    with pytest.raises(BadInputError, match="inside an obstacle of map 'grid_1'") as caught:
        Search.of(settings, maps)
    assert caught.value.key == f"{key}targets[2]"


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
        return max(0.0, design.tree.total_length_mm - 700.0) / 1000.0

    def passes(self, design):
        return not 300.0 < design.tree.total_length_mm < 500.0


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
        (("coverage",), "nsga2", "or another task with the score"),
        (("coverage", "branches"), "pso", "use 'nsga2', or name one objective"),
    ],
)
def test_objectives_that_contradict_are_refused(objectives, optimizer, words):
    with pytest.raises(BadInputError, match=words):
        check_objectives(objectives, "coverage", optimizer)
