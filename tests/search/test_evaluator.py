"""What the designs of a generation meet, and how their scores are weighed."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from vinefab.core.errors import BadInputError
from vinefab.maps.generators.grid import grid_map
from vinefab.model.design import Design
from vinefab.model.map import Map
from vinefab.search.evaluation import INVALID_FITNESS, Evaluations
from vinefab.search.evaluator import Evaluator, block_sizes
from vinefab.search.loop import optimize
from vinefab.search.parallel.executor import SerialExecutor, ThreadExecutor
from vinefab.search.settings import EvaluationSettings, RunSettings
from vinefab.tasks.evaluate import composite

Maps = tuple[Map, ...]


def with_evaluation(small: RunSettings, **changes: object) -> RunSettings:
    return replace(small, evaluation=replace(small.evaluation, **changes))


def test_poses_are_redrawn_every_generation_unless_the_run_says_not(
    small: RunSettings, maps: Maps
) -> None:
    drawn = [Evaluator.of(small, maps, None).training_poses(3, number) for number in (0, 0, 1)]
    assert drawn[0] == drawn[1] != drawn[2]
    still = Evaluator.of(with_evaluation(small, redraw=False), maps, None)
    assert still.training_poses(3, 0) == still.training_poses(3, 7) == drawn[0]


def test_the_range_of_poses_can_be_narrowed_to_the_starts_themselves(
    small: RunSettings, maps: Maps
) -> None:
    several = with_evaluation(small, poses_per_map=20)
    start = maps[0].starts[0]
    assert start.spread_heading_rad > 0.0
    found = {}
    for share in (0.0, 0.1, 1.0):
        trial = Evaluator.of(with_evaluation(several, pose_range=share), maps, None)
        headings = [pose.heading_rad for pose in trial.training_poses(3, 0)[0]]
        found[share] = np.abs(np.array(headings) - start.pose.heading_rad).max()
        assert found[share] <= share * start.spread_heading_rad
    assert 0.0 == found[0.0] < found[0.1] < found[1.0]


def test_a_generation_may_meet_some_of_the_maps(small: RunSettings, maps: Maps) -> None:
    several = (*maps, grid_map(3), grid_map(4))
    trial = Evaluator.of(with_evaluation(small, maps_per_generation=2), several, None)
    counts = np.array([[len(p) for p in trial.training_poses(3, n)] for n in range(40)])
    assert (counts.sum(axis=1) == 2).all()
    assert (counts.sum(axis=0) > 8).all()
    assert len(optimize(with_evaluation(small, maps_per_generation=1), maps).history) == 5
    with pytest.raises(BadInputError, match="at most the 2 maps"):
        Evaluator.of(with_evaluation(small, maps_per_generation=3), maps, None)


def test_single_takes_one_evaluation_and_judges_finalists_by_their_mean(
    small: RunSettings, maps: Maps
) -> None:
    single = with_evaluation(small, composite="single")
    trial = Evaluator.of(single, maps, None)
    assert sum(len(places) for places in trial.training_poses(3, 1)) == 1
    result = optimize(single, maps)
    assert len(result.score.evaluations) == 4
    assert result.finalists[0].fitness == result.score.composite["mean"]


@pytest.mark.parametrize(
    "contradiction", [{"poses_per_map": 2}, {"maps_per_generation": 2}], ids=lambda c: next(iter(c))
)
def test_single_contradicts_several_evaluations(contradiction: dict[str, int]) -> None:
    with pytest.raises(BadInputError, match="one evaluation"):
        EvaluationSettings(composite="single", **contradiction)


def test_steadiness_is_measured_against_the_runs_reference(small: RunSettings, maps: Maps) -> None:
    steady = with_evaluation(small, composite="min_deviation", reference_deviation=0.1)
    result = optimize(steady, maps)
    expected = composite(result.score.scores, 0.1)["min_deviation"]
    assert result.finalists[0].fitness == expected
    assert result.score.composite["min_deviation"] != expected


def test_branches_that_stop_head_on_cost_what_the_run_says(small: RunSettings, maps: Maps) -> None:
    priced = optimize(with_evaluation(small, head_on_weight=0.5), maps)
    assert "head_on" in priced.history[0].terms
    free = optimize(small, maps)
    paid = 0.5 * priced.history[0].terms["head_on"]
    assert paid.max() > 0.0
    assert priced.history[0].composite == pytest.approx(free.history[0].composite - paid)


class Picky:
    """A penalty that knows of designs that it cannot judge."""

    def __call__(self, design: Design) -> float:
        if design.trunk_length_mm > 100.0:
            raise BadInputError("trunk", design.trunk_length_mm, "shorter")
        return 0.0 if design.trunk_length_mm > 50.0 else 1.0


def test_points_that_are_no_designs_to_the_penalty_are_worth_nothing(
    fabricable: RunSettings, maps: Maps
) -> None:
    trial = Evaluator.of(fabricable, maps, Picky())
    x = np.random.default_rng(2).random((30, len(trial.space)))
    found, _ = trial.evaluate(x, trial.training_poses(1, 0))
    trunks = np.array([trial.space.design(row).trunk_length_mm for row in x])
    gone = trunks > 100.0
    assert (np.isnan(found.score).all(axis=1) == gone).all()
    assert (np.isnan(found.terms["area"]).all(axis=1) == gone).all()
    assert found.penalty.tolist() == [float(trunk <= 50.0) for trunk in trunks]
    fitness = trial.fitness(trial.composites(found.score), found.penalty)
    assert (fitness[gone] == INVALID_FITNESS).all()


def test_any_crew_and_any_parts_find_the_same(fabricable: RunSettings, maps: Maps) -> None:
    trial = Evaluator.of(fabricable, maps, Picky())
    x = np.random.default_rng(3).random((25, len(trial.space)))
    poses = trial.training_poses(1, 0)
    whole, _ = trial.evaluate(x, poses)
    parts = Evaluations.joined([trial.evaluate(part, poses)[0] for part in np.array_split(x, 7)])
    with ThreadPoolExecutor(2) as threads:
        shared, spent = trial.begin(x, poses, ThreadExecutor(threads, 3))()
    for found in (parts, shared, trial.begin(x, poses, SerialExecutor())()[0]):
        np.testing.assert_array_equal(found.score, whole.score)
        np.testing.assert_array_equal(found.penalty, whole.penalty)
        for name, values in whole.terms.items():
            np.testing.assert_array_equal(found.terms[name], values)
    assert min(spent) > 0.0


def test_everybody_gets_a_block() -> None:
    for growths in (1, 7, 64, 500, 10_000):
        for workers in (1, 2, 16, 300):
            sizes = block_sizes(growths, workers)
            assert sum(sizes) == growths
            assert min(sizes) >= 1
            assert max(sizes) <= 128
            assert sizes == sorted(sizes, reverse=True)
            assert len(sizes) >= min(workers, growths) // 2
