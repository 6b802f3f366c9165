import json
import math
from pathlib import Path

import numpy as np
import pytest

from vinefab.core.errors import (
    BadInputError,
    UnknownNameError,
    UnreadableFileError,
    VinefabError,
)
from vinefab.maps.generators.grid import grid_map
from vinefab.model.design import PieceSettings, Pouch
from vinefab.model.map import Pose
from vinefab.search.optimizers.optimizer import make_optimizer_config
from vinefab.search.run import Search
from vinefab.search.settings import (
    MapSettings,
    PartSettings,
    RunSettings,
    plain_settings,
    read_run,
    settings_from_plain,
)
from vinefab.search.space import Bounds, BuildSettings, Space
from vinefab.tasks import make_task

EXAMPLE = Path(__file__).parents[2] / "examples" / "grid_coverage.toml"


def written(folder, text):
    path = folder / "trial.toml"
    path.write_text(f'schema = "vinefab/run-1"\n{text}')
    return path


def test_the_example_spells_out_the_defaults(tmp_path):
    example = read_run(EXAMPLE)
    bare = read_run(written(tmp_path, 'name = "grid_coverage"'))
    assert bare == RunSettings(name="grid_coverage")
    for part in ("maps", "space", "build", "growth", "search", "evaluation"):
        assert getattr(example, part) == getattr(bare, part)
    assert make_task("coverage", example.task.parameters) == make_task("coverage")
    assert make_optimizer_config("islands", example.optimizer.parameters) == make_optimizer_config(
        "islands"
    )


def test_a_run_is_called_after_its_file(tmp_path):
    assert read_run(written(tmp_path, "")).name == "trial"


def test_ranges_fixed_values_and_single_levels(tmp_path):
    text = """
    [space]
    levels = 3
    angle_deg = [30, 90.5]
    [[space.level]]
    number = 1
    length_mm = 120
    [[space.level]]
    number = 3
    branches = [2, 3]
    """
    space = read_run(written(tmp_path, text)).space
    assert space.levels == Bounds(low=3, high=3)
    assert space.bounds(2, "angle_deg") == Bounds(low=30, high=90.5)
    assert space.bounds(1, "length_mm") == Bounds(low=120, high=120)
    assert space.bounds(2, "branches") == Bounds(low=2, high=4)
    assert space.bounds(3, "branches") == Bounds(low=2, high=3)


def test_other_tasks_have_tables_of_their_own(tmp_path):
    text = """
    [task]
    name = "coverage"
    objectives = ["coverage", "reach", "film_length", "anchoring"]
    radius_mm = 30
    [task.reach]
    targets = [[1, 2], [3, 4.5]]
    """
    settings = read_run(written(tmp_path, text))
    assert settings.task.parameters == {"radius_mm": 30}
    assert settings.further_objectives == ("reach", "film_length", "anchoring")
    assert settings.front_axis == "film_length"
    assert settings.other_tasks == (
        PartSettings(name="reach", parameters={"targets": [[1, 2], [3, 4.5]]}),
        PartSettings(name="anchoring"),
    )
    assert settings_from_plain(plain_settings(settings)) == settings


def test_every_design_has_the_build_of_the_run(tmp_path):
    text = """
    [build]
    pouch = {shape = "rectangle", length_mm = 25, width_mm = 40}
    pieces = { most = 4, ease_mm = 2 }
    mounting = "turned"
    tail_mm = 170
    pressure_kpa = 12
    compensation = "none"
    """
    build = read_run(written(tmp_path, text)).build
    assert build.pouch == Pouch(shape="rectangle", length_mm=25.0, width_mm=40.0)
    assert build.pieces == PieceSettings(most=4, ease_mm=2.0)
    made = build.build(3)
    for name in ("pouch", "pieces", "mounting", "tail_mm", "pressure_kpa", "compensation"):
        assert getattr(made, name) == getattr(build, name) != getattr(BuildSettings(), name)


def test_widths_are_given_by_level_or_by_the_trunk(tmp_path):
    build = read_run(written(tmp_path, "[build]\nwidths_mm = [30, 17.5]")).build
    assert build.build(3).widths_mm == (30.0, 17.5, 10.5)
    assert read_run(written(tmp_path, "[build]\ntrunk_width_mm = 30")).build.widths_mm == ()


def test_map_files_are_found_from_the_run_file(tmp_path):
    (tmp_path / "deep").mkdir()
    (tmp_path / "a.geojson").touch()
    path = written(tmp_path, '[maps]\nfiles = ["a.geojson", "deep/b.geojson"]')
    with pytest.raises(
        BadInputError, match=r"trial.toml: maps.files\[2\]: there is no file .*b.geojson"
    ):
        read_run(path)
    (tmp_path / "deep" / "b.geojson").touch()
    maps = read_run(path).maps
    assert maps.files == (tmp_path / "a.geojson", tmp_path / "deep" / "b.geojson")
    assert maps.count == 2


def test_a_start_for_all_maps_and_its_spread(tmp_path):
    (tmp_path / "a.geojson").touch()
    start = "start = {x_mm = 250, y_mm = 30, heading_deg = 90, spread_heading_deg = 10}"
    for others in ("seed = 4", 'files = ["a.geojson"]'):
        maps = read_run(written(tmp_path, f"[maps]\n{others}\n{start}")).maps
        assert maps.start.pose == Pose.of((250, 30, 90))
        assert maps.start.spread_heading_rad == pytest.approx(math.radians(10.0))
        assert maps.start.spread_x_mm == 0.0
    assert maps.files == (tmp_path / "a.geojson",)


def test_limits_and_symmetry_of_a_space(tmp_path):
    text = """
    [space]
    symmetric = true
    most_film_length_mm = 1200
    most_branches = 12
    [[space.level]]
    number = 2
    growth_percent = 100
    """
    space = read_run(written(tmp_path, text)).space
    assert space.most == {"film_length": 1200.0, "branches": 12}
    assert space.bounds(3, "growth_percent") == Bounds(low=100, high=100)
    assert settings_from_plain(plain_settings(RunSettings(space=space))).space == space


@pytest.mark.parametrize(
    ("text", "key", "words"),
    [
        ("[maps]\ncuont = 3", "maps.cuont", "did you mean 'count'"),
        ("[maps.options]\nsize = 5", "maps.options.size", "size_mm"),
        ('[maps]\nseed = 3\nfiles = ["a"]', "maps.seed", "given together with maps.files"),
        ("[maps]\nfiles = []", "maps.files", "at least one"),
        (f'name = "{"x" * 91}"', "name", "at most 90 characters"),
        ('[task]\nname = "coverage"\nradius = 3', "task.radius", "radius_mm"),
        ('[task]\nname = "coverage"\nradius_mm = nan', "task.radius_mm", "a finite number"),
        ("[task]\nradius = 3", "task.radius", "radius_mm"),
        ('[task]\nname = "reach"\nobjectives = ["reach", "x"]', "task.objectives", "film_length"),
        ('[task]\nname = "reach"\nobjectives = ["reach"]', "task.objectives", "a cost"),
        (
            '[task]\nname = "reach"\nobjectives = ["reach", "branches"]\n[optimizer]\nname = "pso"',
            "optimizer.name",
            "nsga2",
        ),
        ("[build]\nwidths_mm = []", "build.widths_mm", "at least the trunk's"),
        (
            "[build]\nwidths_mm = [9]\ntrunk_width_mm = 9",
            "build.trunk_width_mm",
            "given together with build.widths_mm",
        ),
        ("[space]\nlength_mm = [200, 100]", "space.length_mm", "in order"),
        ("[space]\nlength_mm = [1, 2, 3]", "space.length_mm", "range"),
        ("[space]\nlength_mm = true", "space.length_mm", "range"),
        ("[space]\nlength_mm = [nan, 2]", "space.length_mm[1]", "finite"),
        ("[space]\nbranches = [2, 3.5]", "space.branches", "whole"),
        ("[space]\nlevels = [2, 50]", "space.levels", "1 to 10"),
        (
            "[[space.level]]\nnumber = 6\nlength_mm = 5",
            "space.level.number",
            "1 \\(the trunk\\) to 5",
        ),
        ("[[space.level]]\nnumber = 1\nbranches = 3", "space.level 1.branches", "length_mm"),
        (
            "[[space.level]]\nnumber = 2\n[[space.level]]\nnumber = 2",
            "space.level[2].number",
            "once",
        ),
        ("[task]\n[task.reach]\nbuffer_mm = 3", "task.reach", "among task.objectives"),
        ("[task]\n[task.coverage]\nradius_mm = 3", "task.coverage", "among task.objectives"),
        ("[task]\n[task.rech]\nbuffer_mm = 3", "task.rech", "radius_mm"),
        (
            '[task]\nobjectives = ["coverage", "reach"]\n[task.reach]\nradius_mm = 3',
            "task.reach.radius_mm",
            "buffer_mm",
        ),
        (
            '[task]\nname = "reach"\ntargets = [[1, 2], [3]]',
            "task.targets[2].point_mm[2]",
            "is missing; give it",
        ),
        ("[space]\nmost_branches = 2.5", "space.most_branches", "integer"),
        (
            "[space]\nsymmetric = true\ngrowth_percent = [50, 150]",
            "space.growth_percent",
            "children of a fan are all as long",
        ),
        (
            "[space]\nsymmetric = true\n[[space.level]]\nnumber = 2\ngrowth_percent = 90",
            "space.level 2.growth_percent",
            "100, or left out",
        ),
        ("[maps]\nstart = {x_mm = 3, y_mm = 4}", "maps.start.heading_deg", "missing"),
        (
            "[maps]\nstart = {x_mm = nan, y_mm = 4, heading_deg = 9}",
            "maps.start.x_mm",
            "a finite number",
        ),
        ("[growth]\nhead_on_half_angle_deg = 91", "growth.head_on_half_angle_deg", "0 to 90"),
        ('[optimizer]\nname = "pso"\nneighbours = 1', "optimizer.neighbours", "at least 2"),
        ('[optimizer]\nname = "pso"\ninertai = 1', "optimizer.inertai", "did you mean 'inertia'"),
        (
            '[evaluation]\ncomposite = "single"\nposes_per_map = 2',
            "evaluation.poses_per_map",
            "1 with composite = 'single', which has one evaluation",
        ),
        (
            '[evaluation]\ncomposite = "single"\nmaps_per_generation = 2',
            "evaluation.maps_per_generation",
            "0 or 1",
        ),
        ("[space]\nangle_deg = [0, 361]", "space.angle_deg", "0 to 360"),
        ('[build]\npouch = {shape = "round"}', "build.pouch.radius_mm", "a length"),
        (f"[build]\nwidths_mm = {[9] * 11}", "build.widths_mm", "at most 10"),
        ("[build]\nwidths_mm = [9, 0]", "build.widths_mm[2]", "greater than or equal to 0.000001"),
        ('[evaluation]\nfinalists_by = "range"', "evaluation.finalists_by", "'contact_range'"),
        ("[evaluation]\nfabricable = 1", "evaluation.fabricable", "boolean"),
        ('name = "a b"', "name", "letters"),
        ('schema2 = "x"', "schema2", "did you mean 'schema'"),
    ],
)
def test_one_line_says_what_is_wrong(tmp_path, text, key, words):
    path = written(tmp_path, text)
    with pytest.raises(BadInputError, match=words) as caught:
        read_run(path)
    assert caught.value.key == key
    assert caught.value.source == str(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text", ['[task]\nname = "x"', '[optimizer]\nname = "x"', '[maps]\nenvironment = "x"']
)
def test_unknown_parts_are_named(tmp_path, text):
    with pytest.raises(UnknownNameError, match=r"trial\.toml: no .* is called 'x'; there are:"):
        read_run(written(tmp_path, text))


def test_files_that_are_no_run_are_refused(tmp_path):
    with pytest.raises(UnreadableFileError):
        read_run(tmp_path / "missing.toml")
    other = tmp_path / "other.toml"
    other.write_text('schema = "vinefab/design-1"')
    with pytest.raises(BadInputError, match="vinefab/run-1"):
        read_run(other)


def test_designs_to_begin_at_are_points_of_the_space(tmp_path):
    (tmp_path / "mine.toml").write_text(
        'schema = "vinefab/design-1"\nname = "mine"\n[trunk]\nlength = 100.0\n'
        "[[level]]\nbranches = 3\nlength = 60.0\nangle_deg = 90.0\n"
    )
    settings = read_run(
        written(tmp_path, '[optimizer]\nstart_from = ["mine.toml", "grid_explorer_levels"]')
    )
    space = Space(settings.space, settings.build)
    mine, shipped = (space.design(np.array(point)) for point in settings.start_from)
    assert (mine.trunk_length_mm, mine.depth, mine.levels[0].branches) == (100.0, 2, 3)
    assert mine.levels[0].length_mm == 60.0
    assert [level.branches for level in shipped.levels] == [3, 3, 2]
    assert settings_from_plain(json.loads(json.dumps(plain_settings(settings)))) == settings


def test_designs_that_no_search_can_begin_at_are_refused(tmp_path):
    deep = '[space]\nlevels = [2, 3]\n[optimizer]\nstart_from = ["grid_explorer_levels"]'
    with pytest.raises(BadInputError, match=r"start_from\[1\].*4 levels.*2 to 3 levels"):
        read_run(written(tmp_path, deep))
    with pytest.raises(VinefabError, match="nowhere"):
        read_run(written(tmp_path, '[optimizer]\nstart_from = ["nowhere.toml"]'))
    swarm = '[evaluation]\nfabricable = false\n[optimizer]\nname = "pso"\n'
    swarm += 'start_from = ["grid_explorer_levels"]'
    with pytest.raises(BadInputError, match="or use the optimizer islands"):
        Search.of(read_run(written(tmp_path, swarm)), (grid_map(1),))


def test_a_search_begins_at_the_design_that_it_is_given(tmp_path):
    text = '[evaluation]\nfabricable = false\n[optimizer]\nname = "islands"\n'
    text += 'start_from = ["grid_explorer_levels"]'
    search = Search.of(read_run(written(tmp_path, text)), (grid_map(1),))
    first = search.evaluator.space.design(search.optimizer.ask()[0])
    assert [level.branches for level in first.levels] == [3, 3, 2]


def test_without_a_name_the_optimizer_is_the_one_that_does_best(tmp_path):
    for text, name in {
        "": "islands",
        "[evaluation]\nfabricable = false": "cmaes",
        '[task]\nobjectives = ["coverage", "film_length"]': "nsga2",
        '[evaluation]\nfabricable = false\n[optimizer]\nname = "islands"': "islands",
    }.items():
        assert read_run(written(tmp_path, text)).optimizer.name == name


@pytest.mark.parametrize(
    ("start", "text"),
    [
        ('"left side, heading 0+-20"', "left side, heading 0+-20"),
        (
            '{side = "top", inset_mm = 30, spread_heading_deg = 5}',
            "top side, inset 30, heading +-5",
        ),
        ("{line = [[20, 20], [20, 480]], clearance_mm = 4}", "line 20,20 20,480, clear 4"),
        ("{area = [[0, 0], [50, 480]], heading_deg = 90}", "area 0,0 50,480, heading 90"),
    ],
)
def test_a_start_may_be_a_place_and_is_recorded_whole(tmp_path, start, text):
    settings = read_run(written(tmp_path, f"[maps]\nstart = {start}"))
    assert settings.maps.start.text == text
    assert MapSettings(start=text).start == settings.maps.start
    record = json.loads(json.dumps(plain_settings(settings)))
    assert settings_from_plain(record).maps == settings.maps


def test_a_pose_in_words_is_recorded_as_its_table_is(tmp_path):
    words = read_run(written(tmp_path, '[maps]\nstart = "250,30,90+-10, spread 5,0"'))
    table = "{x_mm = 250, y_mm = 30, heading_deg = 90, spread_heading_deg = 10, spread_x_mm = 5}"
    assert words.maps == read_run(written(tmp_path, f"[maps]\nstart = {table}")).maps


@pytest.mark.parametrize(
    ("start", "key", "allowed"),
    [
        ('"leftt"', "maps.start", "did you mean 'left'"),
        ("5", "maps.start", "a table, (x_mm, y_mm, heading_deg), or words"),
        ('{side = "leftt"}', "maps.start.side", "did you mean 'left'"),
        ("{line = [[20, 20]]}", "maps.start.line", "two or more points"),
        ("{line = [[nan, 20], [3, 4]]}", "maps.start.line[1][1]", "a finite number"),
        ('{area = [[0, 0], [9, 9]], side = "left"}', "maps.start.area", "given together"),
        ("{area = [[0, 0], [9, 9], [9, 0], [0, 9]]}", "maps.start.area", "valid"),
        ('{side = "left", x_mm = 3}', "maps.start.x_mm", "given together with side"),
        ("{x_mm = 3, y_mm = 4, heading_deg = 9, inset_mm = 3}", "maps.start.inset_mm", "together"),
    ],
)
def test_a_place_that_is_none_is_one_line(tmp_path, start, key, allowed):
    with pytest.raises(BadInputError) as caught:
        read_run(written(tmp_path, f"[maps]\nstart = {start}"))
    assert caught.value.key == key
    assert allowed in str(caught.value)
