"""Poses of a generation, evaluations, fitness, units of work, and times."""

import math
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.search.conftest import optimize
from vinefab.core.errors import BadInputError
from vinefab.growth.options import GrowthOptions
from vinefab.maps.generators.grid import grid_map
from vinefab.model.design import PieceSettings
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.laser import read_profile
from vinefab.search.evaluator import (
    INVALID_FITNESS,
    Evaluations,
    Evaluator,
    EvaluatorSpec,
    Executor,
    Ledger,
    TimeSplit,
    Work,
    WorkUnit,
    block_sizes,
    penalized_fitness,
)
from vinefab.search.manufacturability import ManufacturabilityPenalty
from vinefab.search.run import Search
from vinefab.search.settings import PartSettings
from vinefab.search.space import Bounds, BuildSettings, SpaceSettings
from vinefab.tasks.evaluate import Conditions, composite, map_weights, score_designs


def with_evaluation(small, **changes):
    return small.changed(evaluation=small.evaluation.changed(**changes))


def test_poses_are_redrawn_every_generation_unless_redraw_is_off(small, maps):
    drawn = [
        Evaluator.of(EvaluatorSpec(settings=small, maps=maps)).training_conditions(3, number)
        for number in (0, 0, 1)
    ]
    assert drawn[0] == drawn[1] != drawn[2]
    still = Evaluator.of(EvaluatorSpec(settings=with_evaluation(small, redraw=False), maps=maps))
    assert still.training_conditions(3, 0) == still.training_conditions(3, 7) == drawn[0]
    assert still.final_conditions(3) not in drawn


def test_the_range_of_poses_can_be_narrowed_to_the_starts_themselves(small, maps):
    several = with_evaluation(small, poses_per_map=20)
    start = maps[0].starts[0]
    assert start.spread_heading_rad > 0.0
    found = {}
    for share in (0.0, 0.1, 1.0):
        evaluator = Evaluator.of(
            EvaluatorSpec(settings=with_evaluation(several, pose_range=share), maps=maps)
        )
        headings = [pose.heading_rad for pose in evaluator.training_conditions(3, 0).poses[0]]
        found[share] = np.abs(np.array(headings) - start.pose.heading_rad).max()
        assert found[share] <= share * start.spread_heading_rad
    assert 0.0 == found[0.0] < found[0.1] < found[1.0]


def test_a_generation_may_use_some_of_the_maps(small, maps):
    several = (*maps, grid_map(3), grid_map(4))
    evaluator = Evaluator.of(
        EvaluatorSpec(settings=with_evaluation(small, maps_per_generation=2), maps=several)
    )
    counts = np.array(
        [[len(p) for p in evaluator.training_conditions(3, n).poses] for n in range(40)]
    )
    assert (counts.sum(axis=1) == 2).all()
    assert (counts.sum(axis=0) > 8).all()
    assert len(optimize(with_evaluation(small, maps_per_generation=1), maps).history) == 5
    with pytest.raises(BadInputError, match="at most the 2 maps"):
        Evaluator.of(
            EvaluatorSpec(settings=with_evaluation(small, maps_per_generation=3), maps=maps)
        )


def test_single_uses_one_evaluation_and_ranks_finalists_by_their_mean(small, maps):
    single = with_evaluation(small, composite="single")
    evaluator = Evaluator.of(EvaluatorSpec(settings=single, maps=maps))
    assert sum(len(places) for places in evaluator.training_conditions(3, 1).poses) == 1
    result = optimize(single, maps)
    assert len(result.score.evaluations) == 4
    assert result.finalists[0].fitness == result.score.composite["mean"]


def test_min_deviation_uses_the_runs_reference_deviation(small, maps):
    steady = with_evaluation(small, composite="min_deviation", reference_deviation=0.1)
    result = optimize(steady, maps)
    expected = composite(result.score.scores, 0.1)["min_deviation"]
    assert result.finalists[0].fitness == expected
    assert result.score.composite["min_deviation"] != expected


def test_branches_that_stop_head_on_reduce_the_score_by_the_weight(small, maps):
    priced = optimize(with_evaluation(small, head_on_weight=0.5), maps)
    assert "head_on" in priced.history[0].terms
    free = optimize(small, maps)
    paid = 0.5 * priced.history[0].terms["head_on"]
    assert paid.max() > 0.0
    assert priced.history[0].composite == pytest.approx(free.history[0].composite - paid)


CROSSING = SpaceSettings(
    levels=Bounds(low=3, high=4),
    branches=Bounds(low=2, high=3),
    length_mm=Bounds(low=40, high=140),
    angle_deg=Bounds(low=40, high=240),
)


def in_pieces(small, **evaluation):
    """A run for robots of bench size in up to three pieces."""
    build = BuildSettings(trunk_width_mm=24.0, width_ratio=0.65, pieces=PieceSettings(most=3))
    islands = PartSettings(name="islands")
    run = small.changed(space=CROSSING, build=build, optimizer=islands)
    return with_evaluation(run, fabricable=True, **evaluation)


def test_every_joint_costs_fitness_and_none_makes_a_design_worse_than_a_broken_one(small, maps):
    penalty = ManufacturabilityPenalty(profile=read_profile(DEFAULT_RECIPE))
    dear = in_pieces(small, joint_weight=10.0, finalists_by="training")
    result = Search.of(dear, maps, penalty).run()
    evaluator = Evaluator.of(EvaluatorSpec(settings=dear, maps=maps, penalty=penalty))
    paid = 0
    for generation in result.history:
        costs, made = evaluator.joint_costs(generation.x), generation.penalty == 0.0
        wanted = generation.composite[made] - costs[made]
        assert generation.fitness[made].tolist() == wanted.tolist()
        assert (generation.fitness[~made] < evaluator.lowest).all()
        paid += (costs[made] > 0.0).sum()
    assert paid > 0
    best = result.finalists[0]
    cost = evaluator.joint_costs(best.x[None])[0]
    assert best.fitness == pytest.approx(best.score.composite["mean"] - cost, abs=1e-12)


def test_joints_are_charged_only_where_they_are_counted(small, maps):
    whole = with_evaluation(small, fabricable=True, joint_weight=0.1)
    free = whole.changed(build=BuildSettings(pieces=PieceSettings()))
    free = with_evaluation(free, fabricable=False)
    penalty = ManufacturabilityPenalty(profile=read_profile(DEFAULT_RECIPE))
    for settings, other in ((whole, penalty), (free, penalty), (in_pieces(free), Picky())):
        with pytest.raises(BadInputError, match="joint_weight"):
            Evaluator.of(EvaluatorSpec(settings=settings, maps=maps, penalty=other))


class Picky:
    """A penalty that refuses some designs."""

    def __call__(self, design):
        if design.trunk_length_mm > 100.0:
            raise BadInputError("trunk", design.trunk_length_mm, "shorter")
        return 0.0 if design.trunk_length_mm > 50.0 else 1.0


def test_points_that_the_penalty_refuses_have_no_valid_design(fabricable, maps):
    evaluator = Evaluator.of(EvaluatorSpec(settings=fabricable, maps=maps, penalty=Picky()))
    x = np.random.default_rng(2).random((30, len(evaluator.space)))
    found, _ = evaluator.evaluate(x, evaluator.training_conditions(1, 0))
    trunks = np.array([evaluator.space.design(row).trunk_length_mm for row in x])
    gone = trunks > 100.0
    assert (np.isnan(found.score).all(axis=1) == gone).all()
    assert (np.isnan(found.terms["area"]).all(axis=1) == gone).all()
    assert found.penalty.tolist() == [float(trunk <= 50.0) for trunk in trunks]
    fitness = evaluator.fitness(evaluator.composites(found.score), found.penalty)
    assert (fitness[gone] == INVALID_FITNESS).all()


def test_results_do_not_depend_on_executor_or_division(fabricable, maps):
    evaluator = Evaluator.of(EvaluatorSpec(settings=fabricable, maps=maps, penalty=Picky()))
    x = np.random.default_rng(3).random((25, len(evaluator.space)))
    poses = evaluator.training_conditions(1, 0)
    whole, _ = evaluator.evaluate(x, poses)
    parts = Evaluations.concatenated(
        [evaluator.evaluate(part, poses)[0] for part in np.array_split(x, 7)]
    )
    with ThreadPoolExecutor(2) as threads:
        shared, spent = evaluator.begin(x, poses, Executor(threads, 3))()
    for found in (parts, shared, evaluator.begin(x, poses, Executor())()[0]):
        np.testing.assert_array_equal(found.score, whole.score)
        np.testing.assert_array_equal(found.penalty, whole.penalty)
        for name, values in whole.terms.items():
            np.testing.assert_array_equal(found.terms[name], values)
    assert min(spent.making_s, spent.growth_s, spent.scoring_s) > 0.0


def test_every_worker_gets_a_block():
    for growths in (1, 7, 64, 500, 10_000):
        for workers in (1, 2, 16, 300):
            sizes = block_sizes(growths, workers)
            assert sum(sizes) == growths
            assert min(sizes) >= 1
            assert max(sizes) <= 128
            assert sizes == sorted(sizes, reverse=True)
            assert len(sizes) >= min(workers, growths) // 2


SCORES = st.floats(-1.0, 1e4)
PENALTIES = st.floats(1e-12, 1e3)


def fitness_of(score, penalty, lowest, weight):
    (fitness,) = penalized_fitness(np.array([score]), np.array([penalty]), lowest, weight)
    return float(fitness)


@given(SCORES, SCORES, PENALTIES)
def test_a_penalized_design_ranks_below_every_manufacturable_one(score, penalized, penalty):
    manufacturable = fitness_of(score, 0.0, lowest=-1.0, weight=1.0)
    assert manufacturable == score
    assert (
        INVALID_FITNESS < fitness_of(penalized, penalty, lowest=-1.0, weight=1.0) < manufacturable
    )


def test_lower_penalty_and_higher_score_both_raise_the_fitness_of_penalized_designs():
    fitness = fitness_of(0.5, 0.3, lowest=-1.0, weight=2.0)
    assert fitness_of(0.5, 0.2, lowest=-1.0, weight=2.0) > fitness
    assert fitness_of(0.6, 0.3, lowest=-1.0, weight=2.0) > fitness


def test_scores_and_penalties_that_are_not_finite_give_the_lowest_fitness():
    assert fitness_of(math.nan, 0.0, lowest=0.0, weight=1.0) == INVALID_FITNESS
    assert fitness_of(0.5, math.inf, lowest=0.0, weight=1.0) == INVALID_FITNESS
    assert fitness_of(0.5, math.nan, lowest=0.0, weight=1.0) == INVALID_FITNESS


def test_half_angles_of_a_range_are_drawn_for_each_evaluation_and_stand_with_the_terms(small, maps):
    wide = GrowthOptions.published(head_on_half_angle_rad=(math.radians(1.0), math.radians(15.0)))
    evaluator = Evaluator.of(EvaluatorSpec(settings=small.changed(growth=wide), maps=maps))
    draws = [evaluator.training_conditions(3, number) for number in range(3)]
    assert draws[0] == evaluator.training_conditions(3, 0)
    angles_deg = [np.degrees(draw.half_angles_rad).tolist() for draw in draws]
    assert len({angle for row in angles_deg for angle in row}) == 3 * len(maps)
    assert all(1.0 <= angle <= 15.0 for row in angles_deg for angle in row)
    x = np.random.default_rng(1).random((4, len(evaluator.space)))
    found, _ = evaluator.evaluate(x, draws[0])
    known = np.isfinite(found.score).all(axis=1)
    for row in found.terms["head_on_half_angle_deg"][known]:
        np.testing.assert_allclose(row, angles_deg[0])
    # Each evaluation is that of a growth with its own angle.
    for launch, angle_rad in enumerate(draws[0].half_angles_rad):
        narrow = small.changed(growth=GrowthOptions.published(head_on_half_angle_rad=angle_rad))
        alone = Evaluator.of(EvaluatorSpec(settings=narrow, maps=maps))
        same, _ = alone.evaluate(x, Conditions(poses=draws[0].poses))
        np.testing.assert_array_equal(same.score[:, launch], found.score[:, launch])
    some = small.evaluation.changed(maps_per_generation=1)
    part = Evaluator.of(
        EvaluatorSpec(settings=small.changed(growth=wide, evaluation=some), maps=maps)
    ).training_conditions(3, 0)
    (taken,) = [index for index, places in enumerate(part.poses) if places]
    assert part.half_angles_rad == (draws[0].half_angles_rad[taken],)


def test_a_start_without_spread_gives_one_evaluation_and_maps_count_alike(small, maps):
    start = replace(maps[0].starts[0], spread_x_mm=0.0, spread_y_mm=0.0, spread_heading_rad=0.0)
    mixed = (replace(maps[0], starts=(start,)), maps[1])
    settings = with_evaluation(small, poses_per_map=3)
    result = optimize(settings, mixed)
    evaluator = Evaluator.of(EvaluatorSpec(settings=settings, maps=mixed))
    conditions = evaluator.training_conditions(3, 4)
    assert [len(places) for places in conditions.poses] == [1, 3]
    last = result.history[4]
    found, _ = evaluator.evaluate(last.x, conditions)
    means = 0.5 * (found.score[:, 0] + found.score[:, 1:].mean(axis=1))
    np.testing.assert_allclose(last.composite, means, rtol=1e-12)
    (note,) = result.notes
    assert note.startswith("starts of 1 of 2 maps have no spread: 1 deployment per map")
    assert optimize(small, maps).notes == ()
    fixed = Evaluator.of(EvaluatorSpec(settings=with_evaluation(small, pose_range=0.0), maps=maps))
    assert fixed.notes == ()


def test_weights_make_maps_count_alike_in_every_composite():
    weights = map_weights([1, 0, 2])
    assert weights is not None
    np.testing.assert_allclose(weights, [0.5, 0.25, 0.25])
    assert map_weights([2, 2, 0]) is None
    weighed = composite([0.2, 0.5, 0.7], weights=weights)
    plain = composite([0.2, 0.2, 0.5, 0.7])
    assert weighed == pytest.approx(plain)


@pytest.mark.parametrize(
    "rule", [{"branch_contact": "stop"}, {"emergence": 0.7}, {"body_width_ratio": 1.3}, {}]
)
def test_a_search_grows_designs_as_scores_do(small, maps, rule):
    growth = GrowthOptions(pressure_stop=False, **rule)
    evaluator = Evaluator.of(EvaluatorSpec(settings=small.changed(growth=growth), maps=maps))
    conditions = evaluator.training_conditions(3, 0)
    assert evaluator.training_conditions(3, 0) == conditions
    seeds = conditions.draw_seeds
    assert len(set(seeds)) == (len(maps) if "emergence" in rule else 0)
    assert set(seeds).isdisjoint(evaluator.training_conditions(3, 1).draw_seeds)
    x = np.random.default_rng(1).random((12, len(evaluator.space)))
    found, _ = evaluator.evaluate(x, conditions)
    known = np.flatnonzero(np.isfinite(found.score).all(axis=1)).tolist()
    designs = [evaluator.space.design(x[row]) for row in known]
    launches = conditions.launches(evaluator.terrains)
    scores = score_designs(designs, evaluator.maps, launches, evaluator.task, growth)
    for row, score in zip(known, scores, strict=True):
        np.testing.assert_allclose(found.score[row], score.scores, rtol=1e-12)
    if rule:
        plain = Evaluator.of(
            EvaluatorSpec(
                settings=small.changed(growth=GrowthOptions(pressure_stop=False)), maps=maps
            )
        )
        usual, _ = plain.evaluate(x, conditions)
        assert (usual.score[known] != found.score[known]).any()


def test_the_work_of_all_workers_is_added_up():
    ledger = Ledger(1)
    ledger.add(Work(making_s=1.0, scoring_s=0.5))
    ledger.add(Work(growth_s=0.25))
    assert ledger.worked_s == 1.75


def test_every_part_counts_once():
    ledger = Ledger(2)
    with ledger.spending("evaluating"):
        with ledger.spending("loading"):
            time.sleep(0.03)
        time.sleep(0.02)
        with ledger.spending("store"):
            time.sleep(0.01)
    with ledger.spending("store"):
        time.sleep(0.01)
    ledger.add(Work(growth_s=0.01, scoring_s=0.02))
    split = ledger.split()
    assert split.loading_s >= 0.03
    assert 0.03 <= split.evaluating_s < split.total_s - split.loading_s
    assert 0.01 <= split.beside_s < split.evaluating_s
    assert split.store_s >= 0.01
    parts = ("loading", "evaluating", "optimizer", "store", "other")
    assert sum(split.shares[part] for part in parts) == pytest.approx(1.0)
    assert split.shares["busy"] == pytest.approx(0.03 / (2 * split.evaluating_s))
    assert TimeSplit.of_json(split.as_json) == split


@pytest.fixture
def helper():
    with ThreadPoolExecutor(1) as pool:
        yield pool


def test_helpers_work_while_the_caller_does_something_else(helper):
    began, go_on = threading.Event(), threading.Event()

    def slow():
        began.set()
        assert go_on.wait(10.0)
        return threading.get_ident()

    units = [WorkUnit(slow), *(WorkUnit(threading.get_ident) for _ in range(5))]
    finish = Executor(helper, 2).begin(units)
    assert began.wait(10.0)
    # The caller does the rest; only then the helper may end.
    threading.Timer(0.05, go_on.set).start()
    finish()
    assert units[0].result != threading.get_ident()
    assert {unit.result for unit in units[1:]} == {threading.get_ident()}


def test_a_serial_executor_works_in_order_when_finished():
    done: list[int] = []
    finish = Executor().begin([WorkUnit(lambda k=k: done.append(k)) for k in range(4)])
    assert done == []
    finish()
    assert done == [0, 1, 2, 3]


def test_an_executor_of_one_needs_no_helper(helper):
    units = [WorkUnit(threading.get_ident) for _ in range(3)]
    Executor(helper, 1).begin(units)()
    assert {unit.result for unit in units} == {threading.get_ident()}


@pytest.mark.parametrize("place", [0, 3])
def test_an_error_is_raised_and_stops_the_rest(helper, place):
    """In the helper's unit, which is the first, and in another one."""
    started, hold = threading.Event(), threading.Event()

    def first():
        started.set()
        assert hold.wait(10.0)
        fail(0)

    def fail(number):
        done.append(number)
        if number == place:
            raise KeyError(number)

    done: list[int] = []
    work = [first, *(lambda k=k: fail(k) for k in range(1, 1000))]
    finish = Executor(helper, 2).begin([WorkUnit(one) for one in work])
    assert started.wait(10.0)
    threading.Timer(0.05, hold.set).start()
    with pytest.raises(KeyError):
        finish()
    assert len(done) < 1000 or place == 0


def test_nothing_is_begun_after_a_stop(helper):
    started, hold = threading.Event(), threading.Event()

    def first():
        started.set()
        assert hold.wait(10.0)

    done: list[int] = []
    executor = Executor(helper, 2)
    finish = executor.begin(
        [WorkUnit(first), *(WorkUnit(lambda: done.append(1)) for _ in range(9))]
    )
    assert started.wait(10.0)
    executor.stop()
    hold.set()
    finish()
    assert done == []
