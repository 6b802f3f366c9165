"""Who may win: only designs that pass a full inspection, as long as there is one."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.model.design import Design
from vinefab.model.map import Map
from vinefab.search.feasibility_repair import (
    MOST_LOOKS,
    PATIENCE,
    STEPS,
    RepairBudget,
    RepairResults,
    repair_design,
)
from vinefab.search.loop import optimize
from vinefab.search.settings import RunSettings
from vinefab.search.space import BuildSettings, Space, SpaceSettings

Maps = tuple[Map, ...]


@dataclass
class Strict:
    """A penalty on trunks beyond a length, and an inspection that asks for something else."""

    longest_mm: float
    passing: Callable[[Design], bool]

    def __call__(self, design: Design) -> float:
        return max(0.0, design.trunk_length_mm - self.longest_mm) / 100.0

    def passes(self, design: Design) -> bool:
        return self.passing(design)


def even(design: Design) -> bool:
    """Something that no penalty knows of: an even number of whole millimetres."""
    return int(design.trunk_length_mm) % 2 == 0


def test_only_designs_that_pass_the_inspection_are_judged(
    fabricable: RunSettings, maps: Maps
) -> None:
    result = optimize(fabricable, maps, penalty=Strict(150.0, even))
    assert result.fabricable
    assert len(result.finalists) == 3
    assert all(even(finalist.design) for finalist in result.finalists)
    blind = optimize(fabricable, maps, penalty=Strict(150.0, lambda _: True))
    assert not all(even(finalist.design) for finalist in blind.finalists)


def test_when_none_passes_the_best_are_repaired(fabricable: RunSettings, maps: Maps) -> None:
    """No trunk of the run is as short as is asked for, so all of them are shortened."""
    first = optimize(fabricable, maps, penalty=Strict(0.0, even)).history
    shortest = min(100.0 * g.penalty.min() for g in first)
    strict = Strict(shortest - 1.0, lambda design: design.trunk_length_mm <= shortest - 1.0)
    result = optimize(fabricable, maps, penalty=strict)
    assert all((generation.penalty > 0.0).all() for generation in result.history)
    assert result.fabricable
    assert result.best.trunk_length_mm <= shortest - 1.0
    assert result.repair.startswith("no design that the search found can be made; ")
    assert result.repair.endswith("changes of the 3 best were tried, and 3 of them can be made now")
    assert result.best == optimize(fabricable, maps, penalty=strict).best


def test_a_winner_that_nothing_can_mend_is_marked(fabricable: RunSettings, maps: Maps) -> None:
    result = optimize(fabricable, maps, penalty=Strict(500.0, lambda _: False))
    assert not result.fabricable
    assert result.finalists[0].penalty == 1.0
    assert result.finalists[0].fitness < -0.5
    assert "100 changes of the 2 best were tried, and none can be made" in result.repair


def test_a_repair_stays_near_and_is_always_the_same() -> None:
    space = Space(SpaceSettings(), BuildSettings())
    x = np.full(len(space), 0.9)
    strict = Strict(150.0, even)
    mended = repair_design(x, space, strict, strict.passes)
    assert mended.passed
    design = space.design(mended.x)
    assert strict(design) == 0.0
    assert even(design)
    assert np.count_nonzero(mended.x != x) < len(x)
    again = repair_design(x, space, strict, strict.passes)
    assert np.array_equal(mended.x, again.x)
    assert not repair_design(x, space, replace(strict, longest_mm=0.0), strict.passes).passed


def test_a_hopeless_repair_is_given_up() -> None:
    space = Space(SpaceSettings(), BuildSettings())
    x, effort = np.full(len(space), 0.9), RepairBudget()
    looked = list[Design]()

    def flat(design: Design) -> float:
        looked.append(design)
        return 1.5

    given_up = repair_design(x, space, flat, even, effort)
    assert not given_up.passed
    assert len(looked) == PATIENCE + 1
    assert effort.steps == STEPS - PATIENCE
    assert given_up.penalty == 1.5


def test_many_repairs_share_one_effort() -> None:
    space = Space(SpaceSettings(), BuildSettings())
    points = [np.full(len(space), share) for share in np.linspace(0.1, 0.9, 40)]
    repairs = RepairResults.of(points, space, lambda _: 1.5, even)
    assert repairs.mended == []
    assert f"; {STEPS} changes of the {-(-STEPS // PATIENCE)} best were tried" in repairs.words
    assert repairs.words.endswith("none can be made, the least penalty left is 1.5")
    # A full look takes fifty times as long as a change.
    looks = list[Design]()
    RepairResults.of(points, space, lambda _: 0.0, lambda design: looks.append(design) is not None)
    assert len(looks) == 2 * MOST_LOOKS


def test_refusals_do_not_stop_a_repair() -> None:
    space = Space(SpaceSettings(), BuildSettings())

    def refusing(design: Design) -> float:
        if design.depth > 2:
            raise BadInputError("depth", design.depth, "two levels")
        return 0.0

    mended = repair_design(np.full(len(space), 0.9), space, refusing, even)
    assert mended.passed
    assert space.design(mended.x).depth == 2
