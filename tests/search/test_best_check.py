"""Designs that would be the best are asked for all rules while a run goes on."""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from vinefab.model.design import Design
from vinefab.model.finding import Finding, Severity
from vinefab.search.advice import FAILED, BestCheck
from vinefab.search.record.generations import Progress
from vinefab.search.run import Search

FOUND = (Finding(rule="VF-X99", severity=Severity.ERROR, message="odd", fingerprint="1"),)


@dataclass
class Tabled:
    """A penalty of nothing, a check by the table, and one that simulates and counts its calls."""

    passing: Callable[[Design], bool]
    by_table: Callable[[Design], bool | None]
    simulated: list[Design] = field(default_factory=list)

    def __call__(self, _):
        return 0.0

    def broken(self, design):
        found = self.by_table(design)
        return None if found is None else () if found else FOUND

    def passes(self, design):
        self.simulated.append(design)
        return self.passing(design)


def even(design):
    return int(design.trunk_length_mm) % 2 == 0


def test_no_best_design_fails_a_rule_that_the_penalty_does_not_know(fabricable, maps):
    penalty, seen = Tabled(even, even), list[Progress]()
    search = Search.of(fabricable, maps, penalty)
    result = search.run(progress=seen.append)
    failed = [(g, row) for g in result.history for row in range(6) if g.penalty[row] == FAILED]
    assert failed
    for generation, row in failed:
        assert not even(search.evaluator.space.design(generation.x[row]))
    best = max(result.history, key=lambda generation: generation.best)
    assert even(search.evaluator.space.design(best.x[best.fitness.argmax()]))
    assert all(even(finalist.design) for finalist in result.finalists)
    # Only the winner's joints are simulated.
    assert penalty.simulated == [result.best.changed(name=penalty.simulated[0].name, origin={})]
    assert {one.passes for one in seen} <= {True, False}
    assert seen[-1].passes
    assert "checking finalist 1 of 3" in seen[-1].stage


def test_one_that_fails_when_simulated_makes_room_for_the_next(fabricable, maps):
    table = Tabled(even, lambda _: True)
    result = Search.of(fabricable, maps, table).run()
    assert even(result.finalists[0].design)
    assert result.fabricable
    assert not even(table.simulated[0])
    assert result.best.trunk_length_mm in [design.trunk_length_mm for design in table.simulated]


def test_where_only_a_simulation_tells_the_quick_rules_decide(fabricable, maps):
    seen = list[Progress]()
    result = Search.of(fabricable, maps, Tabled(even, lambda _: None)).run(progress=seen.append)
    assert even(result.finalists[0].design)
    assert not any((generation.penalty > 0.0).any() for generation in result.history)
    assert seen[-1].passes is None


def test_a_run_without_rules_asks_nothing(small, maps):
    seen = list[Progress]()
    penalty = Tabled(even, even)
    Search.of(small, maps, penalty).run(progress=seen.append)
    assert penalty.simulated == []
    assert seen[-1].passes is None


def test_the_number_of_workers_changes_no_check(fabricable, maps):
    search = Search.of(fabricable, maps, Tabled(even, even))
    history = search.run().history
    assert BestCheck(search.evaluator, history).passes
    assert not BestCheck(search.evaluator, ()).passes
    again = Search.of(fabricable, maps, Tabled(even, even)).run(workers=2).history
    assert [g.penalty.tolist() for g in history] == [g.penalty.tolist() for g in again]


def test_a_resumed_run_asks_as_one_that_was_not_stopped(fabricable, maps):
    search = Search.of(fabricable, maps, Tabled(even, even))
    history = search.run().history
    for number, generation in enumerate(history):
        check = BestCheck(search.evaluator, history[:number])
        none = np.zeros(len(generation.x))
        found = check.penalties(generation.x, generation.composite, none, none)
        assert found.tolist() == generation.penalty.tolist()
