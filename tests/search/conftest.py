"""Runs small enough to be repeated many times."""

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
from vinefab.model.tree import branch_tree
from vinefab.search.run import Search
from vinefab.search.settings import EvaluationSettings, PartSettings, RunSettings, SearchSettings
from vinefab.search.space import Bounds, SpaceSettings


@pytest.fixture(scope="session")
def maps():
    """Two Grid maps."""
    return (grid_map(1), grid_map(2))


@pytest.fixture
def small():
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
def fabricable(small):
    """The same with designs that can be made ranked first."""
    return small.changed(evaluation=small.evaluation.changed(fabricable=True))


@pytest.fixture
def film_penalty():
    """A stand-in for fabrication rules: film beyond 600 mm, in metres."""

    def penalty(design):
        return max(0.0, branch_tree(design).total_length_mm - 600.0) / 1000.0

    return penalty


def optimize(settings, maps, penalty=None, **options):
    """Return the result of a run without a record, but with a store among the options."""
    return Search.of(settings, maps, penalty).run(**options)
