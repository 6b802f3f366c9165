"""How a run is told to its user."""

import json
from dataclasses import replace

import pytest

from vinefab.core.errors import BadInputError
from vinefab.maps.generators.grid import grid_map
from vinefab.model.design import Design
from vinefab.search.loop import optimize
from vinefab.search.run import result_json
from vinefab.search.settings import EvaluationSettings, RunSettings, SearchSettings


@pytest.mark.filterwarnings("error")
def test_a_generation_without_any_design_has_no_mean_in_the_result() -> None:
    """Grown, so with terms, but nothing of it can be laid out."""
    calls = list[str]()

    def penalty(design: Design) -> float:
        calls.append(design.name)
        # The first call is the rehearsal, the next six are the first generation.
        if len(calls) <= 7:
            raise BadInputError("outline", design.name, "a design that can be laid out")
        return 0.0

    settings = RunSettings(name="few", search=SearchSettings(population=6, generations=2))
    evaluation = EvaluationSettings(fabricable=True, finalists=1)
    run = optimize(replace(settings, evaluation=evaluation), (grid_map(1),), penalty=penalty)
    assert not run.history[0].has_designs
    assert run.history[0].terms
    first, second = json.loads(result_json(run))["generations"]
    assert (first["mean"], first["spread"], first["fabricable_share"]) == (None, None, 0.0)
    assert isinstance(second["mean"], float)
    assert second["fabricable_share"] == 1.0
