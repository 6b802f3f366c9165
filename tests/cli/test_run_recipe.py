"""The recipe of a run: named by its winner, kept beside it, used by later commands."""

import json
import shutil
import tomllib

import pytest

import vinefab as vf
from vinefab.model.files.shipped import shipped_root

SHIPPED = "co2_60w__stretchlon_200"


@pytest.fixture
def lab(tmp_path):
    """A folder with a recipe for a small bed and thicker film."""
    folder = tmp_path / "lab"
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
    return folder


@pytest.fixture
def best(vinefab, lab, run_file, tmp_path):
    """The winner of a run whose file names the recipe beside it; the lab is gone since."""
    run = lab / "run.toml"
    run.write_text(run_file.read_text() + 'recipe = "mine.toml"\n')
    code, _, complaint = vinefab("optimize", run, "--out", tmp_path / "run", "--no-page", "-q")
    assert (code, complaint) == (0, "")
    shutil.rmtree(lab)
    return tmp_path / "run" / "best.toml"


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
    assert (name, line) == ("mine", f"recipe mine of the design's run ({best.parent / COPY})")
    assert used(vinefab, best, "--recipe", SHIPPED)[0] == SHIPPED
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


def test_a_changed_or_missing_recipe_is_said(vinefab, best, tmp_path):
    copy = best.parent / "recipe_of_run" / "materials" / "thick.toml"
    copy.write_text(f"# a comment\n{copy.read_text()}")
    assert used(vinefab, best)[1].endswith(f"run ({best.parent / COPY})")
    copy.write_text(copy.read_text().replace("value = 0.045", "value = 0.046"))
    name, line = used(vinefab, best)
    assert name == "mine"
    assert "has changed since" in line
    alone = tmp_path / "elsewhere.toml"
    shutil.copy(best, alone)
    name, line = used(vinefab, alone)
    assert name == SHIPPED
    assert "is missing" in line
    with pytest.warns(UserWarning, match="is missing"):
        vf.check(alone)


@pytest.mark.parametrize("file", ["../lab/mine.toml", "/etc/mine.toml", "link/mine.toml"])
def test_the_recipe_of_a_run_lies_in_its_folder(vinefab, best, tmp_path, file):
    (best.parent / "link").symlink_to(tmp_path)
    best.write_text(best.read_text().replace(COPY, file))
    code, _, complaint = vinefab("check", best)
    assert (code, complaint.count("\n")) == (2, 1)
    assert "origin.recipe.file" in complaint


@pytest.mark.parametrize("text", ['recipe = "mine"', "recipe = { name = 3 }", "recipe = {}"])
def test_an_origin_without_name_file_and_digest_is_refused(vinefab, tmp_path, text):
    design = tmp_path / "plain.toml"
    design.write_text(
        f'schema = "vinefab/design-1"\nname = "plain"\n[trunk]\nlength = 300.0\n[origin]\n{text}\n'
    )
    code, _, complaint = vinefab("check", design)
    assert (code, complaint.count("\n")) == (2, 1)
    assert "origin.recipe" in complaint


def test_a_winner_written_from_the_record_has_its_recipe_too(vinefab, best, tmp_path):
    vinefab("runs", best.parent, "--best", tmp_path / "again" / "best.toml")
    assert used(vinefab, tmp_path / "again" / "best.toml")[0] == "mine"
    assert (tmp_path / "again" / "best.toml").read_text() == best.read_text()


def test_a_mended_winner_keeps_its_recipe(vinefab, best):
    weak = best.with_name("weak.toml")
    weak.write_text(best.read_text().replace("tail_mm = 200.0", "tail_mm = 100.0"))
    vinefab("check", weak, "--fix", best.with_name("fixed.toml"))
    assert used(vinefab, best.with_name("fixed.toml"))[0] == "mine"
