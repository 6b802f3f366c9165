import math
from pathlib import Path

import pytest

from vinefab.core.errors import BadInputError, UnknownNameError, UnreadableFileError
from vinefab.model.design import Pouch
from vinefab.search.optimizers.shipped_optimizers import make_optimizer_config
from vinefab.search.run_file import read_run
from vinefab.search.settings import RunSettings
from vinefab.search.space import Bounds
from vinefab.tasks.shipped_tasks import make_task

EXAMPLE = Path(__file__).parents[2] / "examples" / "grid_coverage.toml"


def written(folder: Path, text: str) -> Path:
    path = folder / "trial.toml"
    path.write_text(f'schema = "vinefab/run-1"\n{text}')
    return path


def test_the_example_spells_out_the_defaults(tmp_path: Path) -> None:
    example = read_run(EXAMPLE)
    bare = read_run(written(tmp_path, 'name = "grid_coverage"'))
    assert bare == RunSettings(name="grid_coverage")
    for part in ("maps", "space", "build", "growth", "search", "evaluation"):
        assert getattr(example, part) == getattr(bare, part)
    assert make_task("coverage", example.task.parameters) == make_task("coverage")
    assert make_optimizer_config("islands", example.optimizer.parameters) == make_optimizer_config(
        "islands"
    )


def test_a_run_is_called_after_its_file(tmp_path: Path) -> None:
    assert read_run(written(tmp_path, "")).name == "trial"


def test_ranges_fixed_values_and_single_levels(tmp_path: Path) -> None:
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


def test_several_objectives_bring_their_optimizer(tmp_path: Path) -> None:
    text = '[task]\nname = "reach"\nobjectives = ["branches", "reach"]'
    settings = read_run(written(tmp_path, text))
    assert settings.objectives == ("branches", "reach")
    assert settings.costs == ("branches",)
    assert settings.optimizer.name == "nsga2"
    assert settings.task.parameters == {}


def test_a_pouch_is_part_of_the_build(tmp_path: Path) -> None:
    text = '[build]\npouch = {shape = "rectangle", length_mm = 25, width_mm = 40}'
    build = read_run(written(tmp_path, text)).build
    assert build.pouch == Pouch(shape="rectangle", length_mm=25.0, width_mm=40.0)
    assert build.build(3).pouch == build.pouch


def test_map_files_are_found_from_the_run_file(tmp_path: Path) -> None:
    (tmp_path / "deep").mkdir()
    (tmp_path / "a.geojson").touch()
    path = written(tmp_path, '[maps]\nfiles = ["a.geojson", "deep/b.geojson"]')
    with pytest.raises(BadInputError, match=r"trial.toml: maps.files\[2\] is 'deep/b.geojson'"):
        read_run(path)
    (tmp_path / "deep" / "b.geojson").touch()
    maps = read_run(path).maps
    assert maps.files == (tmp_path / "a.geojson", tmp_path / "deep" / "b.geojson")
    assert maps.count == 2


def test_tables_carry_the_parameters_of_their_parts(tmp_path: Path) -> None:
    text = """
    [task]
    name = "reach"
    buffer_mm = 30
    [optimizer]
    name = "random"
    generations = 7
    [growth]
    head_on_half_angle_deg = 5.0
    """
    settings = read_run(written(tmp_path, text))
    assert settings.task.parameters == {"buffer_mm": 30}
    assert settings.optimizer.name == "random"
    assert settings.optimizer.parameters == {}
    assert settings.search.generations == 7
    assert settings.growth.head_on_half_angle_rad == pytest.approx(math.radians(5.0))


@pytest.mark.parametrize(
    ("text", "key", "words"),
    [
        ("[maps]\ncuont = 3", "maps.cuont", "did you mean 'count'"),
        ("[maps]\ncount = 0", "maps.count", "1 to"),
        ("[maps.options]\nsize = 5", "maps.options.size", "size_mm"),
        ('[maps]\nseed = 3\nfiles = ["a"]', "maps.seed", "not together with maps.files"),
        ("[maps]\nfiles = []", "maps.files", "at least one"),
        (f'name = "{"x" * 91}"', "name", "at most 90 characters"),
        ('[task]\nname = "coverage"\nradius = 3', "task.radius", "radius_mm"),
        ('[task]\nname = "coverage"\nradius_mm = nan', "task.radius_mm", "above 0"),
        ("[task]\nradius = 3", "task.radius", "radius_mm"),
        ("[task]\nname = 3", "task.name", "string"),
        ('[task]\nname = "reach"\nobjectives = ["reach", "x"]', "task.objectives", "film_length"),
        ('[task]\nname = "reach"\nobjectives = ["reach"]', "task.objectives", "a cost"),
        ('[task]\nname = "reach"\nobjectives = 3', "task.objectives", "list"),
        (
            '[task]\nname = "reach"\nobjectives = ["reach", "branches"]\n[optimizer]\nname = "pso"',
            "optimizer.name",
            "nsga2",
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
        ("[build]\nwidth_ratio = 1.5", "build.width_ratio", "at most 1"),
        ("[growth]\nhead_on_half_angle_deg = 91", "head_on_half_angle_deg", "0 to 90"),
        ("[optimizer]\npopulation = 1", "optimizer.population", "2 to"),
        ('[optimizer]\nname = "pso"\nneighbours = 1', "optimizer.neighbours", "at least 2"),
        ('[optimizer]\nname = "pso"\ninertai = 1', "optimizer.inertai", "did you mean 'inertia'"),
        ('[evaluation]\ncomposite = "median"', "evaluation.composite", "mean"),
        ("[evaluation]\npose_range = -1", "evaluation.pose_range", "0 to 10"),
        ("[evaluation]\nhead_on_weight = -1", "evaluation.head_on_weight", "0 to"),
        ('[build]\npouch = {shape = "round"}', "pouch.radius_mm", "a length"),
        ("[evaluation]\nfabricable = 1", "evaluation.fabricable", "boolean"),
        ('name = "a b"', "name", "letters"),
        ('schema2 = "x"', "schema2", "did you mean 'schema'"),
    ],
)
def test_one_line_says_what_is_wrong(tmp_path: Path, text: str, key: str, words: str) -> None:
    path = written(tmp_path, text)
    with pytest.raises(BadInputError, match=words) as caught:
        read_run(path)
    assert caught.value.key == key
    assert caught.value.source == str(path)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    "text", ['[task]\nname = "x"', '[optimizer]\nname = "x"', '[maps]\nenvironment = "x"']
)
def test_unknown_parts_are_named(tmp_path: Path, text: str) -> None:
    with pytest.raises(UnknownNameError, match="there are:"):
        read_run(written(tmp_path, text))


def test_files_that_are_no_run_are_refused(tmp_path: Path) -> None:
    with pytest.raises(UnreadableFileError):
        read_run(tmp_path / "missing.toml")
    other = tmp_path / "other.toml"
    other.write_text('schema = "vinefab/design-1"')
    with pytest.raises(BadInputError, match="vinefab/run-1"):
        read_run(other)


def test_an_unknown_part_is_named_with_the_file(tmp_path):
    path = tmp_path / "typo.toml"
    path.write_text('schema = "vinefab/run-1"\n[task]\nname = "covrage"\n')
    with pytest.raises(UnknownNameError, match=r"typo\.toml: no task is called 'covrage'"):
        read_run(path)
