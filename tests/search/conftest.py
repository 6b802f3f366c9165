"""Runs small enough to be repeated many times."""

from collections.abc import Callable

import pytest

from tests.fabrication.rules.conftest import (  # noqa: F401  fixtures
    burst_profile,
    grown_profile,
    make,
    profile,
    random_design,
)
from vinefab.growth.options import GrowthOptions
from vinefab.maps.generators.grid import grid_map
from vinefab.model.design import Design
from vinefab.model.map import Map
from vinefab.model.tree import branch_tree
from vinefab.search.settings import EvaluationSettings, PartSettings, RunSettings, SearchSettings
from vinefab.search.space import Bounds, SpaceSettings


@pytest.fixture(scope="session")
def maps() -> tuple[Map, ...]:
    """Two Grid maps."""
    return (grid_map(1), grid_map(2))


@pytest.fixture
def small() -> RunSettings:
    """Six particles, five generations, at most three levels, the published growth model."""
    return RunSettings(
        name="small",
        growth=GrowthOptions.published(),
        optimizer=PartSettings(name="pso"),
        space=SpaceSettings(levels=Bounds(low=1, high=3)),
        search=SearchSettings(population=6, generations=5, seed=3),
        evaluation=EvaluationSettings(fabricable=False, finalists=3, final_poses_per_map=2),
    )


@pytest.fixture
def fabricable(small: RunSettings) -> RunSettings:
    """The same with designs that can be made ranked first."""
    return small.changed(evaluation=small.evaluation.changed(fabricable=True))


@pytest.fixture
def film_penalty() -> Callable[[Design], float]:
    """A stand-in for fabrication rules: film beyond 600 mm, in metres."""

    def penalty(design: Design) -> float:
        return max(0.0, branch_tree(design).total_length_mm - 600.0) / 1000.0

    return penalty
