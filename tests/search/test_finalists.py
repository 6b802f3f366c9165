"""Who may win: only designs that pass the full check, as long as there is one."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from tests.search.conftest import optimize
from vinefab.core.errors import BadInputError
from vinefab.core.units import rad
from vinefab.growth.options import CONTACT_ANGLES_DEG
from vinefab.model.design import Design
from vinefab.model.map import Pose, Start
from vinefab.search.evaluator import FRESH
from vinefab.search.finalists import FRESH_POSES, _passing
from vinefab.search.record.generations import Generation
from vinefab.search.run import FRESH_MAPS, Search, fresh_maps, training_maps
from vinefab.search.settings import PartSettings
from vinefab.search.space import BuildSettings, Space, SpaceSettings
from vinefab.tasks.evaluate import PreparedMap, score_design
from vinefab.tasks.shipped_tasks import make_task


@dataclass
class Strict:
    """A penalty on trunks beyond a length, and a full check of something else."""

    longest_mm: float
    passing: Callable[[Design], bool]

    def __call__(self, design):
        return max(0.0, design.trunk_length_mm - self.longest_mm) / 100.0

    def passes(self, design):
        return self.passing(design)


def even(design):
    """A rule that no penalty covers: an even number of whole millimetres."""
    return int(design.trunk_length_mm) % 2 == 0


def test_only_designs_that_pass_the_full_check_are_finalists(fabricable, maps):
    result = optimize(fabricable, maps, penalty=Strict(150.0, even))
    assert result.fabricable
    assert len(result.finalists) == 3
    assert all(even(finalist.design) for finalist in result.finalists)
    blind = optimize(fabricable, maps, penalty=Strict(150.0, lambda _: True))
    assert not all(even(finalist.design) for finalist in blind.finalists)


def test_when_none_passes_the_best_are_repaired(fabricable, maps):
    """All trunks of the run are too long, so they are shortened."""
    first = optimize(fabricable, maps, penalty=Strict(0.0, even)).history
    shortest = min(100.0 * g.penalty.min() for g in first)
    strict = Strict(shortest - 1.0, lambda design: design.trunk_length_mm <= shortest - 1.0)
    result = optimize(fabricable, maps, penalty=strict)
    assert all((generation.penalty > 0.0).all() for generation in result.history)
    assert result.fabricable
    assert result.best.trunk_length_mm <= shortest - 1.0
    assert result.repair.startswith("the search found no manufacturable design; tried ")
    assert result.repair.endswith(" changes of the best 3: 3 of them are manufacturable now")
    assert result.best == optimize(fabricable, maps, penalty=strict).best


def test_a_winner_beyond_repair_is_penalized(fabricable, maps):
    result = optimize(fabricable, maps, penalty=Strict(500.0, lambda _: False))
    assert not result.fabricable
    assert result.finalists[0].penalty == 1.0
    assert result.finalists[0].fitness < -0.5
    assert "tried 100 changes of the best 2: none is manufacturable" in result.repair


def test_finalists_may_be_chosen_by_their_mean_over_the_range_of_contacts(small, maps):
    small = small.changed(search=small.search.changed(population=12, generations=6))
    by_range = small.evaluation.changed(finalists=8, finalists_by="contact_range")
    usual = optimize(small.changed(evaluation=by_range.changed(finalists_by="training")), maps)
    result = optimize(small.changed(evaluation=by_range), maps)
    search = Search.of(small.changed(evaluation=by_range), maps)
    poses = search.evaluator.final_conditions(small.search.seed).poses
    prepared = search.evaluator.maps
    for finalist in result.finalists:
        scores = [
            score_design(
                finalist.design, prepared, poses, search.evaluator.task,
                small.growth.changed(head_on_half_angle_rad=rad(angle)),
            ).composite["mean"]
            for angle in CONTACT_ANGLES_DEG
        ]  # fmt: skip
        assert finalist.fitness == pytest.approx(np.mean(scores))
    fitness = [finalist.fitness for finalist in result.finalists]
    assert fitness == sorted(fitness, reverse=True)
    # What is reported stays the score at the contacts of the run; the order is another one.
    assert {f.score.composite["mean"] for f in result.finalists} == {
        f.score.composite["mean"] for f in usual.finalists
    }
    assert [f.design for f in result.finalists] != [f.design for f in usual.finalists]


def test_other_ways_to_choose_finalists_are_refused(small):
    with pytest.raises(BadInputError, match="allowed: 'fresh_maps', 'training' or 'contact_range'"):
        small.evaluation.changed(finalists_by="range")


def test_a_winner_is_chosen_on_maps_that_the_search_has_not_seen(small):
    settings = small.changed(evaluation=small.evaluation.changed(finalists=8))
    fresh = fresh_maps(settings)
    assert len(fresh) == FRESH_MAPS
    known = training_maps(settings)
    assert not {world.seed for world in fresh} & {world.seed for world in known}
    result = Search.of(settings, known, fresh_maps=fresh).run()
    usual = Search.of(settings, known).run()
    fitness = [finalist.fitness for finalist in result.finalists]
    assert fitness == sorted(fitness, reverse=True)
    assert fitness != [finalist.fitness for finalist in usual.finalists]
    # What is reported stays the score on the training maps.
    assert {f.score.composite["mean"] for f in result.finalists} == {
        f.score.composite["mean"] for f in usual.finalists
    }
    sites = [PreparedMap.of(world) for world in fresh]
    conditions = Search.of(settings, fresh).evaluator.conditions(
        settings.search.seed, FRESH, 0, FRESH_POSES
    )
    task = make_task(settings.task.name, {**settings.task.parameters, "area": "fast"})
    best = score_design(result.best, sites, conditions.poses, task, settings.growth)
    assert fitness[0] == pytest.approx(best.composite["mean"])


def test_where_a_run_names_its_places_the_winner_is_chosen_there(small):
    start = Start(pose=Pose(x_mm=10.0, y_mm=10.0, heading_rad=0.0))
    aimed = PartSettings(name="reach", parameters={"target_mm": [[100.0, 100.0]]})
    for other in (
        small.changed(maps=small.maps.changed(start=start)),
        small.changed(maps=small.maps.changed(files=(Path("a.geojson"),))),
        small.changed(task=aimed),
        small.changed(evaluation=small.evaluation.changed(finalists_by="training")),
    ):
        assert fresh_maps(other) == ()


@pytest.mark.parametrize(("count", "most"), [(3, 60), (40, 80)])
def test_so_many_designs_are_checked_in_full(count, most):
    space = Space(SpaceSettings(), BuildSettings())
    x, checked = np.random.default_rng(1).random((300, len(space))), list[Design]()
    history = [
        Generation(
            number=0,
            x=x,
            fitness=x[:, 0],
            composite=x[:, 0],
            penalty=np.zeros(len(x)),
            terms={},
            seconds=0.0,
        )
    ]

    def refuse(design):
        checked.append(design)
        return False

    assert _passing(history, space, count, refuse) == []
    assert len(checked) == most
    assert checked[0] == space.design(x[x[:, 0].argmax()])
