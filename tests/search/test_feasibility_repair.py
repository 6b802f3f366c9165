"""Feasibility repair: near, reproducible, and within its budget."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.model.design import Design
from vinefab.search.finalists import (
    MOST_CHECKS,
    PATIENCE,
    STEPS,
    RepairBudget,
    RepairResults,
    repair_design,
)
from vinefab.search.space import BuildSettings, Space, SpaceSettings


def even(design):
    """A rule that no penalty covers: an even number of whole millimetres."""
    return int(design.trunk_length_mm) % 2 == 0


@dataclass(frozen=True)
class LongTrunk:
    """A penalty on trunks beyond a length, with a full check of something else."""

    longest_mm: float
    passing: Callable[[Design], bool] = even

    def __call__(self, design):
        return max(0.0, design.trunk_length_mm - self.longest_mm) / 100.0

    def passes(self, design):
        return self.passing(design)


def test_a_repair_stays_near_and_is_always_the_same():
    space = Space(SpaceSettings(), BuildSettings())
    x = np.full(len(space), 0.9)
    strict = LongTrunk(150.0)
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
