"""Whole runs: their maps, results, stops, refusals, and poses drawn ahead."""

import gc
import json
import math
import tracemalloc
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest
import shapely

from tests.search.conftest import made_generation, optimize, progress_of
from vinefab.core.errors import BadInputError
from vinefab.growth.options import GrowthOptions
from vinefab.maps.generators.grid import grid_map
from vinefab.model.deployment import Deployment
from vinefab.model.files.run_context import map_fingerprint
from vinefab.model.map import Map, Pose, Start
from vinefab.search.evaluator import (
    INVALID_FITNESS,
    TRAINING,
    Evaluator,
    EvaluatorSpec,
    with_pose_range,
)
from vinefab.search.optimizers.optimizer import OPTIMIZERS, RandomSearch
from vinefab.search.record.generations import SearchProgress
from vinefab.search.record.result import RunArchive, map_from_text, map_to_text
from vinefab.search.run import (
    AHEAD,
    Schedule,
    Search,
    generated_maps,
    run_search,
    training_maps,
    why_stop,
)
from vinefab.search.settings import (
    EvaluationSettings,
    MapSettings,
    PartSettings,
    RunSettings,
    SearchSettings,
)
from vinefab.search.space import Bounds, BuildSettings, SpaceSettings
from vinefab.tasks.coverage import Coverage
from vinefab.tasks.evaluate import score_design
from vinefab.tasks.map_context import MapContext
from vinefab.tasks.reach import Reach
from vinefab.tasks.task import Outcome


@pytest.mark.filterwarnings("error")
def test_a_generation_without_any_design_has_no_mean_in_the_result():
    """Grown, so with terms, but nothing of it can be laid out."""
    calls = list[str]()

    def penalty(design):
        calls.append(design.name)
        # The first call is the warm-up, the next six are the first generation.
        if len(calls) <= 7:
            raise BadInputError("outline", design.name, "a design that can be laid out")
        return 0.0

    settings = RunSettings(name="few", search=SearchSettings(population=6, generations=2))
    evaluation = EvaluationSettings(fabricable=True, finalists=1)
    run = optimize(settings.changed(evaluation=evaluation), (grid_map(1),), penalty=penalty)
    assert not run.history[0].has_designs
    assert run.history[0].terms
    first, second = json.loads(run.json_text())["generations"]
    assert (first["mean"], first["spread"], first["fabricable_share"]) == (None, None, 0.0)
    assert isinstance(second["mean"], float)
    assert second["fabricable_share"] == 1.0


def test_maps_have_seeds_in_a_row_and_the_options_asked_for():
    maps = generated_maps(MapSettings(count=3, seed=7, options={"size_mm": 300, "columns": 3}))
    assert [world.seed for world in maps] == [7, 8, 9]
    assert maps[0].size_mm == (300.0, 600.0)
    assert maps[0].obstacles != maps[1].obstacles


def start(x_mm, y_mm, **spread):
    return Start(pose=Pose.of((x_mm, y_mm, 90)), **spread)


def test_a_start_of_the_run_replaces_those_of_its_maps(small, tmp_path):
    bare = replace(grid_map(5), starts=())
    bare.write(tmp_path / "bare.geojson")
    place = start(250.0, 30.0, spread_x_mm=20.0, spread_heading_rad=0.1)
    for maps in (
        MapSettings(files=(tmp_path / "bare.geojson",), start=place),
        MapSettings(count=1, seed=5, start=place),
    ):
        settings = small.changed(maps=maps)
        (world,) = training_maps(settings)
        assert world.starts == (place,)
        result = run_search(settings, tmp_path / f"run{len(maps.files)}")
        poses = [evaluation.pose for evaluation in result.score.evaluations]
        assert len({pose.x_mm for pose in poses}) == 2
        assert all(abs(pose.x_mm - 250.0) <= 20.0 and pose.y_mm == 30.0 for pose in poses)
        assert "x_mm = 250, y_mm = 30, heading_deg = 90" in result.best.origin["start"]
        record = tmp_path / f"run{len(maps.files)}" / "run.sqlite"
        assert RunArchive.read(record).settings.maps == maps
    other = small.changed(maps=MapSettings(count=1, seed=5, start=start(250.0, 31.0)))
    with pytest.raises(BadInputError, match=r"maps.start: 'x_mm = 250, y_mm = 31, .* began with"):
        run_search(other, tmp_path / "run0", resume=True)


@pytest.mark.parametrize(
    ("place", "words"),
    [
        (start(-5.0, 30.0), r"maps\.start: \(-5, 30\) mm is outside the bounds of map 'wall'"),
        (start(150.0, 150.0), "inside an obstacle of map 'wall'"),
        (
            start(95.0, 150.0),
            r"is 5 mm from a wall of map 'wall', and a trunk of 40 mm needs 12\.7 mm; .*or set "
            r"build\.trunk_width_mm to at most 15\.7",
        ),
        (start(0.0, 150.0), "is 0 mm from a wall of map 'wall', and a trunk of 40 mm needs"),
        (
            start(150.0, 285.0),
            r"heading 90 deg the trunk stops after 2 mm",
        ),
    ],
)
def test_a_start_without_room_is_refused_by_name(small, tmp_path, place, words):
    Map(
        name="wall",
        bounds=shapely.box(0.0, 0.0, 300.0, 300.0),
        obstacles=(shapely.box(100.0, 100.0, 200.0, 200.0),),
    ).write(tmp_path / "wall.geojson")
    maps = MapSettings(files=(tmp_path / "wall.geojson",), start=place)
    settings = small.changed(maps=maps, growth=GrowthOptions())
    with pytest.raises(BadInputError, match=words) as caught:
        run_search(settings, tmp_path / "run")
    assert caught.value.key == "maps.start"
    assert not (tmp_path / "run" / "run.sqlite").exists()


def test_progress_says_whether_the_best_is_manufacturable_where_it_is_checked():
    progress = progress_of(3, 6)
    start = "generations 3 of 6: best 0.5000, mean 0.2500 +- 0.1250"
    assert str(progress.told(checked=False)) == start
    words = {True: "yes", False: "not yet", None: "by the quick rules"}
    for passes, made in words.items():
        line = str(replace(progress, passes=passes).told(checked=True))
        assert line == f"{start}, manufacturable: {made}"


def test_the_result_says_whether_the_winner_is_manufacturable(small, maps):
    result = optimize(small, maps)
    assert "by the rules: not checked (`fabricable = false`)" in result.summary
    checked = replace(result, checked=True)
    assert "by the rules: manufacturable" in checked.summary
    assert not any(line.startswith("time: ") for line in checked.summary)
    assert (checked.exit_code, checked.details[-1][:6]) == (0, "time: ")
    refused = replace(checked, violations="VF-T02 (crossing)")
    assert refused.exit_code == 1
    words = "found no manufacturable robot: the winner violates VF-T02 (crossing)"
    assert refused.summary[0] == words
    assert "by the rules: not manufacturable: VF-T02 (crossing)" in refused.summary


def test_a_side_is_found_on_every_map_kept_in_the_record_and_taken_up_again(small, tmp_path):
    settings = small.changed(maps=MapSettings(count=2, seed=5, start="left side, heading +-20"))
    worlds = training_maps(settings)
    assert {world.starts[0].area.bounds for world in worlds} == {(15.0, 0.0, 15.0, 500.0)}
    result = run_search(settings, tmp_path / "run")
    poses = [evaluation.pose for evaluation in result.score.evaluations]
    assert {pose.x_mm for pose in poses} == {15.0}
    assert len({pose.y_mm for pose in poses}) > 2
    assert result.best.origin["start"] == "left side, heading +-20"
    assert RunArchive.read(tmp_path / "run" / "run.sqlite").settings.maps == settings.maps
    again = run_search(settings, tmp_path / "run", resume=True)
    assert again.score == result.score
    other = small.changed(maps=MapSettings(count=2, seed=5, start="left side, heading +-21"))
    with pytest.raises(BadInputError, match=r"maps.start: 'left side, heading .* began with"):
        run_search(other, tmp_path / "run", resume=True)


def test_a_share_of_the_pose_range_is_one_of_the_line():
    world = grid_map(5).with_start("left side")
    (half,), (none,) = with_pose_range(world, 0.5).starts, with_pose_range(world, 0.0).starts
    assert half.area.length == pytest.approx(250.0)
    assert (none.area, none.pose) == (None, world.starts[0].pose)
    assert map_from_text(map_to_text(world)).starts == world.starts
    assert map_fingerprint(world) != map_fingerprint(with_pose_range(world, 0.5))


Maps = tuple[Map, ...]


def same(one, other):
    """Whether two runs agree in every number but the times."""
    numbers = [
        np.concatenate([np.r_[g.x.ravel(), g.fitness, g.penalty] for g in result.history])
        for result in (one, other)
    ]
    return (
        one.best == other.best
        and np.array_equal(*numbers)
        and one.score == other.score
        and one.stopped == other.stopped
    )


def test_a_run_gives_a_named_design_and_its_whole_history(small, maps):
    seen: list[SearchProgress] = []
    result = optimize(small, maps, progress=seen.append)
    assert result.best.name == "small"
    assert result.best.origin["run"] == result.run_id
    assert result.best.origin["growth"] == small.growth.content
    assert result.best.origin["score_mean"] == result.score.composite["mean"]
    assert [g.number for g in result.history] == [0, 1, 2, 3, 4]
    assert result.evaluations == 30
    assert [p.done for p in seen] == [1, 2, 3, 4, 5]
    assert seen[-1].best == max(g.fitness.max() for g in result.history)
    assert seen[-1].left_s == 0.0
    assert set(result.history[0].terms) == {"area", "count", "length", "film", "eta"}


def test_fitness_can_be_computed_again_from_the_record(small, maps):
    evaluator = Evaluator.of(EvaluatorSpec(settings=small, maps=maps))
    for redraw in (True, False):
        settings = small.changed(evaluation=small.evaluation.changed(redraw=redraw))
        last = optimize(settings, maps).history[4]
        poses = evaluator.conditions(3, TRAINING, 4 if redraw else 0, 1).poses
        for x, fitness in zip(last.x, last.fitness, strict=True):
            design = evaluator.space.design(x)
            score = score_design(design, evaluator.maps, poses, evaluator.task, small.growth)
            assert score.composite["mean"] == fitness


def test_finalists_are_evaluated_on_fresh_poses_and_the_best_there_wins(small, maps):
    result = optimize(small, maps)
    fitness = [finalist.fitness for finalist in result.finalists]
    assert len(fitness) == 3
    assert fitness == sorted(fitness, reverse=True)
    evaluator = Evaluator.of(EvaluatorSpec(settings=small, maps=maps))
    fresh, winner = evaluator.final_conditions(3).poses, result.finalists[0].design
    # Exact areas, as in `vinefab score`; the search has fast ones.
    expected = score_design(winner, evaluator.maps, fresh, Coverage(), small.growth)
    assert result.score == expected
    assert len(result.score.evaluations) == 4


def test_the_winner_is_manufacturable_when_the_run_checks_it(fabricable, small, maps, film_penalty):
    free = optimize(small, maps, penalty=film_penalty)
    bound = optimize(fabricable, maps, penalty=film_penalty)
    assert film_penalty(free.best) > 0.0
    assert film_penalty(bound.best) == 0.0
    assert bound.fabricable
    for generation in bound.history:
        manufacturable = generation.penalty == 0.0
        assert (generation.fitness[manufacturable] >= -0.5).all()
        assert (generation.fitness[~manufacturable] < -0.5).all()


def test_points_without_valid_designs_have_the_lowest_fitness_and_do_not_stop_the_run(
    small: RunSettings, maps: Maps
) -> None:
    # 40 to 300 branches per parent on up to four levels: too many for some points.
    wild = SpaceSettings(
        levels=Bounds(low=1, high=4),
        branches=Bounds(low=2, high=300),
        length_mm=Bounds(low=1, high=2),
    )
    result = optimize(
        small.changed(space=wild, search=SearchSettings(population=6, generations=1, seed=3)), maps
    )
    fitness = result.history[0].fitness
    assert (fitness == INVALID_FITNESS).any()
    assert np.isnan(result.history[0].composite[fitness == INVALID_FITNESS]).all()
    assert result.score.composite["mean"] > -0.5


def test_a_penalty_that_refuses_a_design_makes_it_invalid(fabricable, maps):
    def refusing(design):
        raise BadInputError("outline", design.name, "a design that can be laid out")

    with pytest.raises(BadInputError, match="give other bounds"):
        optimize(fabricable, maps, penalty=refusing)
    result = optimize(fabricable, maps, penalty=lambda d: math.nan if d.levels else 0.0)
    assert result.best.levels == ()


@dataclass(frozen=True, kw_only=True)
class StrayConfig:
    """The config of an optimizer that proposes points outside the space."""

    value: float = math.nan

    def start(self, axes, population, seed):
        dimensions, value = len(axes), self.value

        class Stray(RandomSearch):
            def ask(self):
                return np.full((population, dimensions), value)

        return Stray(dimensions, population, seed)


@pytest.mark.parametrize("value", [math.nan, 1.5])
def test_an_optimizer_that_leaves_the_space_is_named(small, maps, monkeypatch, value):
    parts: Mapping[str, object] = {**OPTIMIZERS._parts, "stray": StrayConfig}
    monkeypatch.setattr(OPTIMIZERS, "_parts", parts)
    stray = small.changed(optimizer=PartSettings(name="stray", parameters={"value": value}))
    with pytest.raises(BadInputError, match="optimizer stray"):
        optimize(stray, maps)


@dataclass(frozen=True, kw_only=True)
class InPlaceConfig:
    """The config of an optimizer that reuses the arrays that it returns and is given."""

    def start(self, axes, population, seed):
        class InPlace(RandomSearch):
            x = np.empty((population, len(axes)))

            def ask(self):
                self.x[:] = super().ask()
                return self.x

            def tell(self, x, fitness):
                super().tell(x, fitness)
                x[:] = 0.0
                fitness.sort()

        return InPlace(len(axes), population, seed)


def test_an_optimizer_may_reuse_the_arrays_that_it_returns_and_is_given(small, maps, monkeypatch):
    parts: Mapping[str, object] = {**OPTIMIZERS._parts, "in_place": InPlaceConfig}
    monkeypatch.setattr(OPTIMIZERS, "_parts", parts)
    usual = small.changed(optimizer=PartSettings(name="random"))
    in_place = small.changed(optimizer=PartSettings(name="in_place"))
    one, other = optimize(usual, maps), optimize(in_place, maps)
    for known, found in zip(one.history, other.history, strict=True):
        assert np.array_equal(known.x, found.x)
        assert np.array_equal(known.fitness, found.fitness)
    assert one.score == other.score


@pytest.mark.parametrize("generations", [5, AHEAD])
def test_poses_that_no_generation_needs_cannot_end_a_run(small, maps, monkeypatch, generations):
    """Those of another seed, and those after the last generation."""
    settings = small.changed(search=small.search.changed(generations=generations))
    draw, whole = Evaluator.training_conditions, optimize(settings, maps)

    def rare(evaluator, seed, generation):
        if seed != settings.search.seed or generation >= generations:
            raise BadInputError("starts", generation, "a start with free space in its range")
        return draw(evaluator, seed, generation)

    monkeypatch.setattr(Evaluator, "training_conditions", rare)
    assert same(whole, optimize(settings, maps))


def test_unusable_inputs_are_refused(small, fabricable, maps):
    with pytest.raises(BadInputError, match="give at least one"):
        optimize(small, ())
    with pytest.raises(BadInputError, match="and there is no penalty"):
        optimize(fabricable, maps)
    with pytest.raises(BadInputError, match="it has no start"):
        optimize(small, (replace(maps[0], starts=()),))
    with pytest.raises(BadInputError, match="workers"):
        optimize(small, maps, workers=0)
    fixed = SpaceSettings(
        levels=Bounds(low=1, high=1), by_level={1: {"length_mm": Bounds(low=50, high=50)}}
    )
    with pytest.raises(BadInputError, match="fixes every variable"):
        optimize(small.changed(space=fixed), maps)


def test_spaces_that_no_search_could_use_are_refused(small, maps):
    wide = small.changed(
        build=BuildSettings(trunk_width_mm=400.0),
        growth=GrowthOptions.published(body="inflated"),
    )
    with pytest.raises(
        BadInputError, match=r"start of map .* mm from a wall of map .* a trunk of 400 mm needs 127"
    ):
        Search.of(wide, maps, None)
    huge = SpaceSettings(levels=Bounds(low=10, high=10), branches=Bounds(low=9, high=10))
    with pytest.raises(BadInputError, match="more than 100000 branches"):
        Search.of(small.changed(space=huge), maps, None)


def past(*best, seconds=1.0):
    return [made_generation(n, [value], seconds=seconds) for n, value in enumerate(best)]


def test_a_run_stops_for_each_of_its_reasons():
    search = SearchSettings(generations=5, stall_generations=2, wall_time_s=10.0)
    assert why_stop([], search) is None
    assert why_stop(past(0.1, 0.2, 0.3, 0.4, 0.5), search) == "generations"
    assert why_stop(past(0.1, 0.3, 0.2), search) is None
    assert why_stop(past(0.1, 0.3, 0.2, 0.3), search) == "stall"
    assert why_stop(past(0.1, 0.3, 0.2, 0.31), search) is None
    assert why_stop(past(0.1, seconds=11.0), search) == "wall_time"
    lenient = SearchSettings(generations=9, stall_generations=2, stall_tolerance=0.1)
    assert why_stop(past(-0.1, -0.3, -0.095), lenient) == "stall"
    assert why_stop(past(-0.1, -0.3, -0.08), lenient) is None
    assert why_stop(past(0.1, 0.2, 0.3), SearchSettings(evaluations=4)) is None
    assert why_stop(past(0.1, 0.2, 0.3), SearchSettings(evaluations=3)) == "evaluations"


def test_poses_drawn_ahead_are_those_drawn_one_by_one(small, maps):
    evaluator = Evaluator.of(EvaluatorSpec(settings=small, maps=maps))
    schedule = Schedule(evaluator, 3)
    for generation in (0, 1, AHEAD - 1, AHEAD, 3 * AHEAD + 2, 5):
        drawn = schedule.conditions(generation)
        assert drawn == evaluator.training_conditions(3, generation)
        ready, anew = evaluator.launches(drawn), evaluator.launches(replace(drawn))
        assert ready is evaluator.launches(drawn)
        assert ready is not anew
        np.testing.assert_array_equal(ready.start, anew.start)
        np.testing.assert_array_equal(ready.terrain, anew.terrain)
    still = small.changed(evaluation=small.evaluation.changed(redraw=False))
    once = Schedule(Evaluator.of(EvaluatorSpec(settings=still, maps=maps)), 3)
    assert once.conditions(0) is once.conditions(77)


@dataclass(frozen=True, slots=True, kw_only=True)
class Leaves:
    """A task of the user's own: the share of leaves that deployed, with a price."""

    name: ClassVar[str] = "leaves"
    lowest: ClassVar[float] = -1.0

    price: float = 0.25

    def evaluate(self, deployment: Deployment, ground: MapContext) -> Outcome:  # noqa: ARG002
        share = float(deployment.deployed.mean())
        return share - self.price, {"share": share}


def test_a_task_object_is_searched_and_named_in_the_result(small, maps):
    search = Search.of(small, maps, task=Leaves(price=0.5))
    assert search.settings.task == PartSettings(name="leaves", parameters={"price": 0.5})
    result = search.run()
    assert result.best.origin["task"] == "leaves"
    assert result.score.task == "leaves"
    assert set(result.history[0].terms) == {"share"}
    assert result.score.evaluations[0].score == result.score.evaluations[0].terms["share"] - 0.5
    assert same(result, search_again(small, maps, Leaves(price=0.5)))
    cheaper = search_again(small, maps, Leaves())
    assert cheaper.run_id != result.run_id
    assert cheaper.history[0].composite == pytest.approx(result.history[0].composite + 0.25)


def search_again(small, maps, task):
    return Search.of(small, maps, task=task).run(workers=2)


def test_a_task_object_pays_for_head_on_stops_and_may_be_weighed_against_costs(small, maps):
    priced = small.changed(evaluation=small.evaluation.changed(head_on_weight=0.5))
    assert "head_on" in Search.of(priced, maps, task=Leaves()).run().history[0].terms
    several = small.changed(
        objectives=("leaves", "film_length"), optimizer=PartSettings(name="nsga2")
    )
    assert len(Search.of(several, maps, task=Leaves()).run().finalists) >= 1
    without = several.changed(objectives=("branches", "film_length"))
    with pytest.raises(BadInputError, match="'leaves', among them"):
        Search.of(without, maps, task=Leaves())


@pytest.mark.parametrize("task", [Coverage(radius_mm=40.0), Reach(buffer_mm=30.0)])
def test_a_shipped_task_is_the_same_by_name_and_as_an_object(small, maps, task):
    key = "radius_mm" if isinstance(task, Coverage) else "buffer_mm"
    part = PartSettings(name=task.name, parameters={key: getattr(task, key)})
    named = optimize(small.changed(task=part), maps)
    given = Search.of(small, maps, task=task).run()
    assert given.score == named.score
    for one, other in zip(named.history, given.history, strict=True):
        assert np.array_equal(one.fitness, other.fitness)


def test_a_search_measures_areas_fast_unless_the_task_says_how(small, maps):
    def task_of(settings, task=None):
        return Search.of(settings, maps, task=task).evaluator.task

    assert task_of(small) == Coverage(area="fast")
    exact = PartSettings(name="coverage", parameters={"area": "exact"})
    assert task_of(small.changed(task=exact)) == Coverage(area="exact")
    assert task_of(small, Reach()) == Reach(area="fast")
    assert task_of(small, Reach(area="exact")) == Reach(area="exact")
    assert task_of(small, Leaves()) == Leaves()


def test_a_run_holds_no_more_than_its_history(small, maps):
    held: list[int] = []

    def watch(progress):
        if progress.done == 20:
            tracemalloc.start()
        elif progress.done == 80:
            gc.collect()
            held.append(tracemalloc.get_traced_memory()[0])
            tracemalloc.stop()

    settings = small.changed(search=SearchSettings(population=6, generations=81, seed=3))
    history = optimize(settings, maps[:1], progress=watch).history
    per_generation = sum(_array_bytes(generation) for generation in history) / len(history)
    # A generation is some arrays with a header each; whatever else grew would be a leak.
    assert held[0] / 60 < per_generation + 3000


def _array_bytes(generation):
    arrays = (generation.x, generation.fitness, generation.composite, generation.penalty)
    return sum(array.nbytes for array in (*arrays, *generation.terms.values()))
