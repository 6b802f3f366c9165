"""Runs small enough to be repeated many times."""

import numpy as np
import pytest

from tests.fabrication.rules.conftest import (  # noqa: F401  fixtures
    burst_profile,
    grown_profile,
    make,
    profile,
    random_design,
)
from vinefab.core.progress import heard_by
from vinefab.growth.options import GrowthOptions
from vinefab.maps.generators.grid import grid_map
from vinefab.search.record.generations import Generation, SearchProgress
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
        return max(0.0, design.tree.total_length_mm - 600.0) / 1000.0

    return penalty


def optimize(settings, maps, penalty=None, **options):
    """Return the result of a run without a record, but with a store among the options."""
    with followed(options.pop("progress", lambda _: None)):
        return Search.of(settings, maps, penalty).run(**options)


def followed(look):
    """Return a block whose search calls a function after every generation."""

    def hear(progress):
        if isinstance(progress, SearchProgress) and progress.within is None:
            look(progress)

    return heard_by(hear)


def made_generation(number, fitness=(0.1, 0.3, 0.2), *, x=None, composite=None, seconds=2.0):
    """Return a generation whose designs have no penalty, with their scores as fitness."""
    fitness = np.array(fitness, dtype=float)
    return Generation(
        number=number,
        x=np.zeros((len(fitness), 2)) if x is None else x,
        fitness=fitness,
        composite=fitness if composite is None else composite,
        penalty=np.zeros(len(fitness)),
        terms={},
        seconds=seconds,
    )


def progress_of(generation, generations, history=(), **changed):
    """Return the progress of a run."""
    numbers = {"best": 0.5, "mean": 0.25, "spread": 0.125, "fabricable_share": 0.75}
    times = {"elapsed_s": 1.0, "left_s": 9.0}
    values = {"done": generation, "total": generations, "history": history}
    return SearchProgress(**{**numbers, **times, **values, **changed})
