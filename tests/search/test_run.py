"""Training maps of a run, and its result for the user."""

import json
from dataclasses import replace

import pytest
import shapely

from tests.search.conftest import optimize
from vinefab.core.errors import BadInputError, UnknownNameError
from vinefab.growth.options import GrowthOptions
from vinefab.maps.generators.grid import grid_map
from vinefab.model.map import Map, Pose, Start
from vinefab.search.evaluator import with_pose_range
from vinefab.search.record.generations import Progress
from vinefab.search.record.identity import map_fingerprint
from vinefab.search.record.result import RunArchive, map_from_text, map_to_text
from vinefab.search.run import (
    generated_maps,
    progress_line,
    run_search,
    training_maps,
)
from vinefab.search.settings import EvaluationSettings, MapSettings, RunSettings, SearchSettings


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
    with pytest.raises(BadInputError, match=r"maps.start is 'x_mm = 250, y_mm = 31, .* with which"):
        run_search(other, tmp_path / "run0", resume=True)


@pytest.mark.parametrize(
    ("place", "words"),
    [
        (start(-5.0, 30.0), r"maps\.start is '\(-5, 30\) mm'; .*outside the bounds of map 'wall'"),
        (start(150.0, 150.0), "inside an obstacle of map 'wall'"),
        (
            start(95.0, 150.0),
            r"it is 5 mm from a wall of map 'wall', and a trunk of 40 mm needs 12\.7 mm, or "
            r"build\.trunk_width_mm of at most 15\.7",
        ),
        (start(0.0, 150.0), "it is 0 mm from a wall of map 'wall', and a trunk of 40 mm needs"),
        (
            start(150.0, 285.0),
            r"heading 90 deg'; allowed: a pose that a robot can leave: the trunk stops after 2 mm",
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


def test_unknown_environments_and_options_are_refused():
    with pytest.raises(UnknownNameError, match="environment"):
        generated_maps(MapSettings(environment="forest"))
    with pytest.raises(BadInputError, match=r"maps\.options\.colums"):
        generated_maps(MapSettings(options={"colums": 3}))


def test_progress_says_whether_the_best_is_manufacturable_where_it_is_checked():
    progress = Progress(
        generation=3,
        generations=6,
        best=0.5,
        mean=0.25,
        spread=0.125,
        fabricable_share=0.75,
        elapsed_s=1.0,
        left_s=1.0,
    )
    start = "generation 3/6  best 0.5000  mean 0.2500 +- 0.1250"
    assert progress_line(progress, checked=False) == start
    words = {True: "yes", False: "not yet", None: "by the quick rules"}
    for passes, made in words.items():
        line = progress_line(replace(progress, passes=passes), checked=True)
        assert line == f"{start}  manufacturable: {made}"
    assert progress_line(replace(progress, stage="checking"), checked=True) == "checking"


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
    with pytest.raises(BadInputError, match=r"maps.start is 'left side, heading .* with which"):
        run_search(other, tmp_path / "run", resume=True)


def test_a_share_of_the_pose_range_is_one_of_the_line():
    world = grid_map(5).with_start("left side")
    (half,), (none,) = with_pose_range(world, 0.5).starts, with_pose_range(world, 0.0).starts
    assert half.area.length == pytest.approx(250.0)
    assert (none.area, none.pose) == (None, world.starts[0].pose)
    assert map_from_text(map_to_text(world)).starts == world.starts
    assert map_fingerprint(world) != map_fingerprint(with_pose_range(world, 0.5))
