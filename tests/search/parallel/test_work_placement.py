"""Where generations are evaluated, and the work units of a cluster."""

import math
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from vinefab.search.dask_cluster import (
    HandingOut,
    Pace,
    PlacedRun,
    least_unit_s,
    unit_rows,
)
from vinefab.search.evaluator import TRAINING, Evaluations, Evaluator, EvaluatorSpec, Ledger
from vinefab.search.workers import ThreadEvaluator

COSTS = HandingOut(round_trip_s=0.01, per_unit_s=0.001)


@pytest.mark.parametrize("workers", [1, 2, 7, 256])
@pytest.mark.parametrize("count", [1, 3, 1000])
def test_work_units_have_every_point_once_and_heavy_ones_first(workers, count):
    weights = np.random.default_rng(1).lognormal(size=count)
    units = unit_rows(weights, workers, least=0.0)
    assert sorted(np.concatenate(units).tolist()) == list(range(count))
    assert min(count, workers) <= len(units) <= count
    done = weights[np.concatenate(units)]
    assert (np.diff(done) <= 0.0).all()


def test_only_points_that_are_units_by_themselves_are_sorted():
    weights = np.array([1.0, 5.0, 2.0, 9.0, 1.5, 2.5])
    units = unit_rows(weights, 2, least=4.0)
    assert np.concatenate(units).tolist() == [3, 1, 0, 2, 4, 5]
    assert units[0].tolist() == [3]


def test_no_unit_holds_up_the_end():
    weights = np.random.default_rng(1).lognormal(size=1000)
    work = [float(weights[rows].sum()) for rows in unit_rows(weights, 4, least=10.0)]
    assert max(work[-4:]) <= max(10.0 + weights.max(), 0.02 * weights.sum())


def test_work_units_get_smaller_but_not_below_the_least():
    units = unit_rows(np.ones(1000), 2, least=20.0)
    sizes = [len(rows) for rows in units]
    assert sizes == sorted(sizes, reverse=True)
    assert sizes[0] == 333
    assert min(sizes[:-1]) == 20
    assert [len(rows) for rows in unit_rows(np.ones(10), 4, least=1e9)] == [10]
    # As long as nothing is known of the work, every worker gets the same.
    unknown = Pace(threads=0, workers=4, costs=COSTS, work_s=0.0)
    assert [len(rows) for rows in unknown.units(np.ones(100))] == [25, 25, 25, 25]


def test_the_least_unit_is_worth_its_cost() -> None:
    # Few workers: handing out takes a twentieth of the work.
    assert least_unit_s(40.0, 2, COSTS) == pytest.approx(0.02)
    # More: while each does one unit, a unit can be handed out to all.
    assert least_unit_s(40.0, 100, COSTS) == pytest.approx(0.1)
    # Too many: handing out all units takes as long as one of them, with 200 of 10,000 workers.
    assert least_unit_s(40.0, 10_000, COSTS) == pytest.approx(0.2)
    few = Pace(threads=1, workers=10_000, costs=COSTS, work_s=0.04)
    assert len(few.units(np.ones(1000))) == 200


def test_a_generation_goes_where_it_is_done_sooner():
    pace = Pace(threads=1, workers=8, costs=COSTS, work_s=0.001)
    assert not pace.goes_there(np.ones(5), 100)  # 6 ms here, more than a round trip
    assert pace.goes_there(np.ones(1000), 1)
    assert replace(pace, threads=0).goes_there(np.ones(5), 1)
    assert not replace(pace, workers=0).goes_there(np.ones(1000), 1)
    # What was measured counts: eight slow workers, or very fast threads.
    assert not replace(pace, there_s=0.01).goes_there(np.ones(1000), 1)
    assert not replace(pace, here_s=0.0001).goes_there(np.ones(1000), 1)
    # A start must be paid back by the generations to come.
    unstarted = replace(pace, costs=replace(COSTS, start_s=10.0))
    assert not unstarted.goes_there(np.ones(1000), 5)
    assert unstarted.goes_there(np.ones(1000), 50)


def test_the_pace_is_that_of_the_last_generation():
    pace = Pace(threads=2, workers=4, costs=COSTS, work_s=1.0)
    weights = np.full(10, 2.0)
    here = pace.after(weights, 5.0, 8.0, there=False)
    assert (here.work_s, here.seconds_here(20.0), here.there_s) == (0.4, 5.0, None)
    there = here.after(weights, 3.0, 8.0, there=True)
    assert there.seconds_there(weights) == pytest.approx(3.0)
    assert there.seconds_here(20.0) == 5.0
    # The first time, workers load code: that says nothing of the work.
    assert pace.after(weights, None, 8.0, there=True) == pace


@dataclass
class Neighbours:
    """Workers that evaluate in this process what they are handed out."""

    evaluator: Evaluator
    there: list[int]  # how many there are at each call; the last stays
    start_s: float = 0.0
    waited_s: list[float] = field(default_factory=list)
    units: list[int] = field(default_factory=list)

    def connect(self, *, wait_s):
        self.waited_s.append(wait_s)
        return self.there.pop(0) if len(self.there) > 1 else self.there[0]

    def costs(self):
        return replace(COSTS, per_unit_s=1e-6, round_trip_s=1e-6, start_s=self.start_s)

    def begin(self, x, conditions, units):
        self.units.append(len(units))
        parts = [self.evaluator.evaluate(x[rows], conditions)[0] for rows in units]
        back = np.argsort(np.concatenate(units))
        return lambda: Evaluations.concatenated(parts).reordered(back)


@pytest.mark.parametrize("threads", [0, 1])
def test_results_are_those_of_threads_wherever_points_go(small, maps, threads):
    evaluator = Evaluator.of(EvaluatorSpec(settings=small, maps=maps))
    ledger, remote = Ledger(1), Neighbours(evaluator, there=[0, 8])
    x = np.random.default_rng(1).random((400, len(evaluator.space)))
    conditions = [evaluator.conditions(3, TRAINING, generation, 4) for generation in range(3)]
    with ThreadEvaluator(1).started(evaluator, ledger) as here:
        workers = remote.connect(wait_s=0.0) if threads else remote.connect(wait_s=0.0) + 8
        run = PlacedRun(evaluator, ledger, remote, here=here, threads=threads, workers=workers)
        found = [run.begin(x, met)() for met in conditions]
    for one, met in zip(found, conditions, strict=True):
        usual, _ = evaluator.evaluate(x, met)
        assert one.score.tobytes() == usual.score.tobytes()
        assert list(one.terms) == list(usual.terms)
        assert all(one.terms[n].tobytes() == usual.terms[n].tobytes() for n in usual.terms)
    assert remote.units
    assert all(count >= 8 for count in remote.units)
    if threads:
        # Workers were looked for as long as the points take here, and found.
        assert all(0.0 <= seconds < 60.0 for seconds in remote.waited_s)
        assert f"handed out {len(remote.units)} of 3 batches" in run.decision
    else:
        assert remote.waited_s[1:] == [math.inf] * 3
        assert run.decision == "handed out 3 of 3 batches of designs; as --workers 0 asks"


def test_workers_are_used_only_when_the_run_to_come_pays_for_their_start(small, maps):
    long = small.changed(search=small.search.changed(generations=1000))
    x, workers = np.random.default_rng(1).random((200, 16)), 8
    for settings, start_s, used in ((small, 50.0, False), (long, 0.5, True)):
        evaluator = Evaluator.of(EvaluatorSpec(settings=settings, maps=maps))
        points = x[:, : len(evaluator.space)]
        conditions = [evaluator.conditions(3, TRAINING, number, 4) for number in range(3)]
        remote = Neighbours(evaluator, there=[workers], start_s=start_s)
        ledger = Ledger(1)
        with ThreadEvaluator(1).started(evaluator, ledger) as here:
            run = PlacedRun(evaluator, ledger, remote, here=here, threads=1, workers=workers)
            for met in conditions:
                run.begin(points, met)()
        assert (len(remote.units) > 0) is used
        assert (run.pace.costs.start_s == 0.0) is used
        assert ("once they have started" in run.decision) is not used
