"""Designs, maps, recipes and run files typed without their endings."""

from pathlib import Path

import pytest

import vinefab as vf


@pytest.fixture
def here(tmp_path, monkeypatch, vinefab):
    """A folder with a design, a map and a run file."""
    monkeypatch.chdir(tmp_path)
    for kind, name in (("design", "mine.toml"), ("map", "table.geojson"), ("run", "search.toml")):
        assert vinefab("new", kind, name, "-q")[0] == 0
    return tmp_path


@pytest.mark.usefixtures("here")
def test_names_lead_to_files_of_the_current_folder(vinefab):
    code, said, complaint = vinefab("grow", "mine", "--map", "table")
    assert (code, complaint) == (0, "")
    assert said.startswith("mine on table")
    Path("deep").mkdir()
    Path("mine.toml").rename("deep/mine.toml")
    assert vf.Design.read("deep/mine").name == "mine"


@pytest.mark.usefixtures("here")
def test_a_shipped_name_means_the_shipped_file_and_a_line_names_the_other(vinefab):
    shipped = vf.Design.read("plain_vine")
    text = Path("mine.toml").read_text()
    Path("plain_vine.toml").write_text(text.replace('"mine"', '"plain_vine"'))
    said = vinefab("check", "plain_vine")[1]
    assert said.startswith("plain_vine is the design that ships")
    assert "plain_vine.toml" in said.splitlines()[0]
    assert vf.Design.read("plain_vine") == shipped
    assert vf.Design.read("plain_vine.toml") != shipped


@pytest.mark.usefixtures("here")
def test_the_machine_of_a_recipe_does_not_depend_on_the_current_folder(vinefab, tmp_path):
    lab = tmp_path / "lab"
    lab.mkdir()
    assert vinefab("new", "recipe", "lab/film.toml", "-q")[0] == 0
    assert vinefab("new", "machine", "small.toml", "-q")[0] == 0
    film = lab / "film.toml"
    film.write_text(film.read_text().replace('machine = "co2_60w"', 'machine = "small"'))
    code, _, complaint = vinefab("check", "mine", "--recipe", film)
    assert (code, complaint.count("\n")) == (2, 1)
    assert "no machine is called 'small'" in complaint
