"""The examples and the library snippet of the README, run as a user would run them."""

import re
import runpy
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest
from PIL import Image

from vinefab.cli.main import main
from vinefab.core.hashing import marked
from vinefab.fabrication.checking import check_design
from vinefab.fabrication.pieces.partition import partition_of
from vinefab.inflation.pattern import cut_design
from vinefab.model.design import Design, PieceSettings
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.laser import read_profile
from vinefab.model.map import Map
from vinefab.pages.page_files import page_svg
from vinefab.pages.plan import map_plan
from vinefab.search.front import write_front
from vinefab.search.record.result import RunArchive
from vinefab.search.run import run_search, training_maps
from vinefab.search.run_pages import rebuild
from vinefab.search.settings import PartSettings, read_run, run_task
from vinefab.search.space import Space

ROOT = Path(__file__).parents[1]


@pytest.fixture(autouse=True)
def few_unseen_maps(monkeypatch):
    """A run's winner is chosen and tried on few maps: seventy take longer than a run here."""
    monkeypatch.setattr("vinefab.prediction.run_winner.UNSEEN_DEPLOYMENTS", 3)
    monkeypatch.setattr("vinefab.search.run.FRESH_MAPS", 2)


@pytest.fixture
def run_script(monkeypatch, tmp_path, capsys):
    """Return a function that runs a script of the folder in this process and returns its words."""

    def run(name, *arguments):
        script = ROOT / "examples" / f"{name}.py"
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", [str(script), *map(str, arguments)])
        runpy.run_path(str(script), run_name="__main__")
        return capsys.readouterr().out

    return run


SCRIPTS = {
    "draw_environments": ("cave",),
    "draw_result": (),
}


TALKING = {
    "add_a_rule": "three_level_tree: warning: 1.52 m",
    "optimize_my_task": "climber",
    "read_a_run": "winner",
    "make_a_rig": "parts of pegs_4",
    "grow_on_my_map": "branches came out",
    "make_shipped_designs": "plain_vine: made",
}
"""What each script says when it has done its work."""

NEEDS = {
    "read_a_run": ("run",),
    "make_a_rig": ("rig",),
    "grow_on_my_map": ("grown.svg",),
    "make_shipped_designs": ("made", "plain_vine"),
}
"""What each is given; the first is what it writes."""


ALONE = ("add_a_rule",)
"""Run in a process of its own, as a user does; the others here, where nothing is loaded again."""


@pytest.mark.parametrize(("name", "arguments"), SCRIPTS.items(), ids=SCRIPTS)
@pytest.mark.thorough
def test_an_example_draws_its_picture(run_script, name, arguments, tmp_path):
    picture = tmp_path / "picture.png"
    run_script(name, *arguments, picture)
    with Image.open(picture) as image:
        darkness = image.convert("L").histogram()
        # An empty page is nearly all white.
        assert sum(darkness[:250]) > 0.02 * image.width * image.height


@pytest.mark.parametrize("name", [name for name in TALKING if name not in ALONE])
def test_an_example_does_what_it_says(run_script, name, tmp_path):
    given = NEEDS.get(name, ())
    assert TALKING[name] in run_script(name, *given)
    assert all((tmp_path / written).exists() for written in given[:1])


@pytest.mark.parametrize("name", ALONE)
def test_an_example_runs_as_a_program(name, tmp_path):
    ran = subprocess.run(
        [sys.executable, ROOT / "examples" / f"{name}.py"],
        check=True,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        errors="replace",
    )
    assert TALKING[name] in ran.stdout


def fronts_of_two_tasks(settings, result, folder):
    assert settings.other_tasks == (PartSettings(name="reach", parameters={"buffer_mm": 30.0}),)
    assert all(0.0 < f.score.composite["reach"] < 1.0 for f in result.finalists)
    assert len(write_front(result, settings, folder)) >= 1


def keeps_its_limits(settings, result, _):
    space, best = Space(settings.space, settings.build), result.best
    assert len(settings.space.most) == 4
    assert space.exceeded_limits(best) == []
    assert all(level.growth == 1.0 for level in best.levels)


def starts_where_it_is_told(settings, result, folder):
    poses = [evaluation.pose for evaluation in result.score.evaluations]
    assert {pose.y_mm for pose in poses} == {15.0}
    assert all(240.0 <= pose.x_mm <= 260.0 for pose in poses)
    assert [one.name for one in run_task(settings).targets] == ["A", "B", "valve"]
    assert all("targets_reached" in evaluation.terms for evaluation in result.score.evaluations)
    rebuild(folder, folder / "again")
    (world,) = training_maps(settings)
    drawn = (folder / "again" / "map_grid_3.svg").read_bytes()
    assert drawn == marked(page_svg(map_plan(world, targets=run_task(settings).targets)))
    assert drawn != marked(page_svg(map_plan(world)))


def is_cut_in_pieces(settings, result, _):
    profile = read_profile(DEFAULT_RECIPE)
    assert result.best.build.pieces == settings.build.pieces == PieceSettings(most=6)
    assert settings.evaluation.joint_weight > 0.0
    assert not partition_of(result.best, profile).unparted
    assert not check_design(result.best, profile).blocking


RUNS = {
    "grid_pieces": is_cut_in_pieces,
    "grid_two_tasks": fronts_of_two_tasks,
    "grid_limits": keeps_its_limits,
    "grid_targets": starts_where_it_is_told,
}


@pytest.mark.parametrize(
    "name", [pytest.param("grid_pieces", marks=pytest.mark.thorough), *list(RUNS)[1:]]
)
def test_a_run_file_runs_and_resumes(name, tmp_path):
    settings = read_run(ROOT / "examples" / f"{name}.toml")
    short = settings.changed(
        search=settings.search.changed(population=8, generations=2),
        # Finding designs that can be made takes longer than a test may, except in pieces.
        evaluation=settings.evaluation.changed(
            fabricable=settings.build.pieces is not None, finalists=2
        ),
    )
    result = run_search(short, tmp_path / "run")
    RUNS[name](short, result, tmp_path / "run")
    assert RunArchive.read(tmp_path / "run" / "run.sqlite").settings == short
    again = run_search(short, tmp_path / "run", resume=True, workers=2)
    assert again.best == result.best


def test_every_script_in_the_folder_is_tried():
    scripts = {path.stem for path in (ROOT / "examples").glob("*.py")}
    assert scripts == {
        *SCRIPTS,
        *TALKING,
        "draw_cluster_scaling",
    }


OPTIMIZED = (
    "grid_explorer",
    "six_branch_anchor",
    *(
        pytest.param(name, marks=pytest.mark.thorough)
        for name in (
            "cave_explorer_pieces",
            "grid_explorer_pieces",
            "cave_explorer",
            "grid_explorer_levels",
            "grid_explorer_pieces_levels",
            "cave_explorer_levels",
            "cave_explorer_pieces_levels",
        )
    ),
)


PIECES = {
    "grid_explorer_pieces": 3,
    "cave_explorer_pieces": 2,
    "grid_explorer_pieces_levels": 3,
    "cave_explorer_pieces_levels": 2,
}
"""Of designs that are not cut as one: as their comments and the README say."""


@pytest.mark.parametrize("name", OPTIMIZED)
def test_a_shipped_winner_is_what_its_run_file_says_and_can_be_made(name):
    design, run = Design.read(name), read_run(ROOT / "examples" / f"{name}.toml")
    search = run.search
    made = (run.task.name, run.optimizer.name, search.seed, search.population, search.generations)
    origin = ("task", "optimizer", "seed", "population", "generations")
    assert tuple(design.origin[key] for key in origin) == made
    assert design.build == run.build.build(design.depth)
    profile = read_profile(DEFAULT_RECIPE)
    assert not check_design(design, profile).blocking
    assert len(partition_of(cut_design(design, profile), profile).pieces) == PIECES.get(name, 1)


def test_the_library_snippet_of_the_readme_runs(tmp_path):
    after = (ROOT / "README.md").read_text().split("## As a library")[1]
    (snippet,) = re.findall(r"```python\n(.*?)```", after, re.DOTALL)
    ran = subprocess.run(
        [sys.executable, "-c", snippet],
        check=True,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        errors="replace",
    )
    assert len(ran.stdout.splitlines()) > 10


IMPORTS = {
    "cave.dxf": ("--drawn", "free"),
    "survey.gpkg": ("--layer", "passages", "--drawn", "free", "--scale-mm-per-unit", "10"),
    "world.yaml": ("--scale-mm-per-unit", "100"),
    "scan.png": ("--points", "0,1240;1754,1240", "--distance-mm", "742.5"),
}
"""The drawings to import, with the words of the page of maps."""


@pytest.mark.parametrize("name", IMPORTS)
def test_a_drawing_shows_the_cave_that_it_was_made_from(name, tmp_path, monkeypatch):
    pytest.importorskip("pyogrio")
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    free = import_module("draw_imports").free_area()
    source, written = ROOT / "examples" / "imports" / name, tmp_path / "cave.geojson"
    assert main(["map", "import", str(source), *IMPORTS[name], "--out", str(written), "-q"]) == 0
    world = Map.read(written)
    assert len(world.obstacles) == len(free.interiors) == 1
    drawn = 0.03 if name == "world.yaml" else 0.005  # cells of 5 mm
    assert world.free_space.area == pytest.approx(free.area, rel=drawn)


def test_the_room_of_lines_is_the_space_between_its_walls(tmp_path):
    source, written = ROOT / "examples" / "imports" / "room.dxf", tmp_path / "room.geojson"
    walls = ["--wall-mm", "4", "--open", "wall", "--bounds", "box", "--margin-mm", "0"]
    assert main(["map", "import", str(source), *walls, "--out", str(written), "-q"]) == 0
    inner_walls, tables, door = 4.0 * (218 + 258), 90 * 60 + 120 * 80, 4.0 * 100
    area = 796 * 596 + door - inner_walls - tables
    assert Map.read(written).free_space.area == pytest.approx(area)


def test_every_drawing_is_tried():
    kept = {path.name for path in (ROOT / "examples" / "imports").iterdir()}
    assert kept == {*IMPORTS, "room.dxf", "world.png"}
