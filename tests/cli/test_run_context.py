"""A run's recipe, task and growth options: remembered by its winner, used by later commands."""

import json
import shutil
import tomllib

import pytest

import vinefab as vf
from tests.cli.conftest import RUN
from vinefab.cli.main import main
from vinefab.model.files.shipped import shipped_root
from vinefab.tasks.reach import Reach

SHIPPED = "co2_60w__stretchlon_200"


def lab_in(folder):
    """Fill a folder with a recipe for a small bed and thicker film, and a run that names it."""
    folder.mkdir()
    for kind, source, name, old, new in (
        ("recipes", SHIPPED, "mine", 'machine = "co2_60w"', 'machine = "small"'),
        ("machines", "co2_60w", "small", "value = 1000.0", "value = 700.0"),
        ("materials", "stretchlon_200", "thick", "value = 0.0375", "value = 0.045"),
    ):
        text = (shipped_root() / f"laser_profiles/{kind}/{source}.toml").read_text()
        text = text.replace(f'name = "{source}"', f'name = "{name}"').replace(old, new)
        text = text.replace('material = "stretchlon_200"', 'material = "thick"')
        (folder / f"{name}.toml").write_text(text)
    run = folder / "run.toml"
    run.write_text(RUN + 'recipe = "mine.toml"\n')
    return run


@pytest.fixture(scope="module")
def recipe_run(tmp_path_factory):
    """The folder of a run whose file names the recipe next to it; the lab is gone since."""
    folder = tmp_path_factory.mktemp("recipe")
    run = lab_in(folder / "lab")
    assert main(["optimize", str(run), "--out", str(folder / "run"), "--no-page", "-q"]) == 0
    shutil.rmtree(folder / "lab")
    return folder / "run"


@pytest.fixture
def best(recipe_run, tmp_path):
    """The winner of that run, in a folder that a test may change."""
    return shutil.copytree(recipe_run, tmp_path / "run") / "best.toml"


COPY = "recipe_of_run/recipes/mine.toml"


def used(vinefab, design, *more):
    """Return the recipe that a check uses, and what it says first."""
    _, out, complaint = vinefab("check", design, *more)
    assert complaint == ""
    out_json = vinefab("check", design, *more, "--json", "-", "-q")[1]
    return json.loads(out_json)["recipe"], out.splitlines()[0]


def test_the_origin_names_the_recipe_and_its_copy_lies_beside(best):
    recipe = tomllib.loads(best.read_text())["origin"]["recipe"]
    assert (recipe["name"], recipe["file"]) == ("mine", COPY)
    names = {path.name for path in best.parent.rglob("recipe_of_run/*/*")}
    assert names == {"mine.toml", "small.toml", "thick.toml"}


def test_commands_use_the_recipe_of_the_run_and_say_so(vinefab, best, tmp_path):
    name, line = used(vinefab, best)
    assert name == "mine"
    assert line.startswith(f"recipe mine ({best.parent / COPY}) of run tiny (")
    other = used(vinefab, best, "--recipe", SHIPPED)
    assert other[0] == SHIPPED
    assert other[1].endswith(f"; recipe {SHIPPED} in place of mine")
    line = line.partition(" of run")[0]
    for command, out in (("fabricate", "made"), ("report", "page.html")):
        more = ("--allow-uncalibrated",) if command == "fabricate" else ("--poses", "1")
        more += () if command == "fabricate" else ("--environment", "grid", "--count", "1")
        _, said, complaint = vinefab(command, best, "--out", tmp_path / out, *more)
        assert (complaint, line in said) == ("", True)
    job = json.loads((tmp_path / "made" / "job.json").read_text())
    assert "mine" in json.dumps(job["recipe"])
    page = (tmp_path / "page.html").read_text()
    assert f"vinefab report {best} " in page  # the design leads to the recipe of its run
    assert "mine: unverified" in page
    assert vf.check(best).recipe == "mine"
    assert vf.check(vf.Design.read(best)).recipe == "mine"


def test_a_changed_or_missing_recipe_is_said(vinefab, best, tmp_path, monkeypatch):
    copy = best.parent / "recipe_of_run" / "materials" / "thick.toml"
    copy.write_text(f"# a comment\n{copy.read_text()}")
    assert used(vinefab, best)[1].startswith(f"recipe mine ({best.parent / COPY}) of run")
    copy.write_text(copy.read_text().replace("value = 0.045", "value = 0.046"))
    name, line = used(vinefab, best)
    assert name == "mine"
    assert "has changed since" in line
    alone = tmp_path / "elsewhere.toml"
    shutil.copy(best, alone)
    monkeypatch.chdir(tmp_path)
    name, line = used(vinefab, alone)
    assert name == SHIPPED
    assert "is missing" in line
    with pytest.warns(UserWarning, match="is missing"):
        vf.check(alone)


def test_a_winner_taken_out_of_its_folder_finds_its_recipe_by_name(
    vinefab, best, tmp_path, monkeypatch
):
    shutil.copytree(best.parent / "recipe_of_run", tmp_path / "lab" / "recipe_of_run")
    folder = tmp_path / "lab" / "recipe_of_run" / "recipes"
    shutil.copy(best, folder / "robot.toml")
    monkeypatch.chdir(folder)
    name, line = used(vinefab, "robot")
    assert name == "mine"
    assert line.startswith("recipe mine (mine.toml) of run tiny (")


def test_the_winner_of_a_run_in_memory_finds_its_recipe_where_the_run_did(tmp_path):
    best = vf.optimize(lab_in(tmp_path / "lab"), progress=False).best
    assert vf.check(best).recipe == "mine"


REACH = """[task]
name = "reach"
targets = [
  { point_mm = [12.0, 12.0], tolerance_mm = 12.0 },
  { point_mm = [288.0, 288.0], tolerance_mm = 12.0 },
]
falloff_mm = 0.0
[growth]
storage_kpa = 2.0
"""


@pytest.fixture(scope="module")
def reach_run(tmp_path_factory):
    """The folder of a run that reaches two points of the map `grid`."""
    folder = tmp_path_factory.mktemp("reach")
    vf.maps.grid(columns=3, rows=3, size_mm=300.0).write(folder / "grid.geojson")
    run = folder / "run.toml"
    text = RUN.replace("count = 1", 'files = ["grid.geojson"]')
    run.write_text(f"{text}fabricable = false\n{REACH}")
    assert main(["optimize", str(run), "--out", str(folder / "r"), "--no-page", "-q"]) == 0
    return folder / "r"


@pytest.fixture
def reacher(reach_run):
    """The winner of that run."""
    return reach_run / "best.toml"


def scored(vinefab, *words):
    """Return the score of a command line, and the line on what it goes by."""
    _, said, complaint = vinefab("score", *words)
    assert complaint == ""
    return json.loads(vinefab("score", *words, "--json", "-", "-q")[1]), said.splitlines()[0]


def test_a_score_is_of_the_task_of_the_run(vinefab, reacher, grid):
    found, line = scored(vinefab, reacher, "--map", grid)
    assert found["task"] == "reach"
    assert {one["terms"]["farthest_mm"] > 0.0 for one in found["evaluations"]} == {True}
    assert line.startswith("targets, task reach, growth options of run tiny (")
    assert found["growth"]["storage_kpa"] == 2.0
    assert "trained on this map" in found["notes"][-1]
    wide, line = scored(vinefab, reacher, "--map", grid, "--set", "falloff_mm=1e5")
    assert all(one["score"] > 0.99 for one in wide["evaluations"])
    other, line = scored(vinefab, reacher, "--map", grid, "--task", "coverage")
    assert other["task"] == "coverage"
    assert line.endswith("; task coverage in place of reach")
    line = scored(vinefab, reacher, "--map", grid, "--growth", "storage_kpa=0")[1]
    assert line.endswith("; storage_kpa as given")
    assert vf.score(reacher, maps=grid).task == "reach"
    assert vf.score("plain_vine", maps=grid).task == "coverage"


def test_targets_of_a_run_are_left_out_on_maps_that_it_did_not_train_on(
    vinefab, reacher, grid, tmp_path
):
    other = tmp_path / "other.geojson"
    vinefab("map", "pegs", "--seed", 3, "--out", other, "-q")
    found, line = scored(vinefab, reacher, "--maps", other)
    assert "reached_mm2" in found["evaluations"][0]["terms"]
    assert line.endswith("; without its targets, which are places on other maps")
    assert "trained on other maps" in found["notes"][-1]
    found, line = scored(vinefab, reacher, "--maps", other, grid)
    assert "trained on 1 of these 2 maps" in found["notes"][-1]


def test_aim_and_report_go_by_the_run(vinefab, reacher, grid, tmp_path):
    _, said, complaint = vinefab("aim", reacher, "--map", grid, "--deployments", 5000, "--alone")
    assert complaint == ""
    assert said.startswith("targets, task reach, growth options of run tiny (")
    page = tmp_path / "page.html"
    _, said, complaint = vinefab("report", reacher, "--map", grid, "--poses", 1, "--out", page)
    assert complaint == ""
    assert said.startswith("targets, growth options of run tiny (")
    assert "trained on this map" in said


def test_the_targets_of_a_run_are_on_the_maps_that_it_trained_on(vinefab, reacher, grid):
    _, said, complaint = vinefab("grow", reacher, "--map", grid)
    assert complaint == ""
    assert said.startswith("targets, growth options of run tiny (")
    assert " of 2 touched" in said
    _, said, _ = vinefab("grow", reacher, "--map", grid, "--target", "150,20")
    assert "of run tiny" in said.splitlines()[0]
    assert "touched" in said
    assert " of 2 touched" not in said
    assert len(vf.Design.read(reacher).grow(grid).world.targets) == 2
    found = scored(vinefab, reacher, "--map", grid, "--target", "150,20")[0]
    assert found["task"] == "reach"
    assert len(found["targets"]) == 1


def test_targets_of_a_map_file_are_remembered_and_its_own_come_first(
    vinefab, grid, run_file, tmp_path
):
    bare = tmp_path / "bare.geojson"
    bare.write_text(grid.read_text())
    vf.Map.read(grid).with_targets("shelf=12,12+-9", "288,288").write(grid)
    text = run_file.read_text().replace("count = 1", f'files = ["{grid.name}"]')
    run_file.write_text(text + 'fabricable = false\n[task]\nname = "reach"\n')
    code, _, complaint = vinefab("optimize", run_file, "--out", tmp_path / "r", "--no-page", "-q")
    assert (code, complaint) == (0, "")
    best = tmp_path / "r" / "best.toml"
    found = scored(vinefab, best, "--map", bare)[0]
    assert [one["name"] for one in found["targets"]] == ["shelf", "A"]
    assert found["targets"][0]["tolerance_mm"] == 9.0
    assert found["targets"] == scored(vinefab, best, "--map", grid)[0]["targets"]
    vf.Map.read(bare).with_targets("other=20,20").write(bare)
    found = scored(vinefab, best, "--map", bare)[0]
    assert [one["name"] for one in found["targets"]] == ["other"]


def test_a_task_that_is_not_installed_is_said(vinefab, plain, grid):
    plain.write_text(plain.read_text() + '[origin]\nrun = "ab"\ntask = "my_task"\n')
    found, line = scored(vinefab, plain, "--map", grid)
    assert (found["task"], line) == (
        "coverage",
        "task my_task of run ab is not installed here: used is coverage",
    )


@pytest.mark.parametrize("file", ["../lab/mine.toml", "/etc/mine.toml", "link/mine.toml"])
def test_the_recipe_of_a_run_lies_in_its_folder(vinefab, best, tmp_path, file):
    (best.parent / "link").symlink_to(tmp_path)
    best.write_text(best.read_text().replace(COPY, file))
    code, _, complaint = vinefab("check", best)
    assert (code, complaint.count("\n")) == (2, 1)
    assert "origin.recipe.file" in complaint


def test_a_winner_written_from_the_record_has_its_recipe_too(vinefab, best, tmp_path):
    vinefab("runs", best.parent, "--best", tmp_path / "again" / "best.toml")
    assert used(vinefab, tmp_path / "again" / "best.toml")[0] == "mine"
    assert (tmp_path / "again" / "best.toml").read_text() == best.read_text()


def test_a_mended_winner_keeps_its_recipe(vinefab, best):
    weak = best.with_name("weak.toml")
    weak.write_text(best.read_text().replace("tail_mm = 200.0", "tail_mm = 100.0"))
    vinefab("fix", weak, "--out", best.with_name("fixed.toml"))
    assert used(vinefab, best.with_name("fixed.toml"))[0] == "mine"


def test_a_cell_with_a_task_of_ones_own_does_not_go_on_with_older_code(run_file, tmp_path):
    """Its code is no part of a run's identity: who changed it must not get the old result."""
    cell = {"out": tmp_path / "run", "task": Reach(), "page": False, "progress": False}
    best = vf.optimize(run_file, **cell).best
    with pytest.raises(vf.VinefabError, match="give another folder, or resume"):
        vf.optimize(run_file, **cell)
    assert vf.optimize(run_file, **cell, resume=True).best == best
