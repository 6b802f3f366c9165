"""A rig's folder, read again for the rules."""

import json

import pytest

from vinefab.cli.main import main
from vinefab.core.errors import BadInputError, UnreadableFileError
from vinefab.rig.part_files import read_rig


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A folder with a small rig."""
    folder = tmp_path_factory.mktemp("made")
    size = ("--columns", "3", "--rows", "3", "--size", "250")
    assert main(["map", "grid", *size, "--out", str(folder / "grid.geojson"), "-q"]) == 0
    arguments = ["rig", str(folder / "grid.geojson"), "--out", str(folder / "rig")]
    style = ("--style", "plate")
    assert main([*arguments, *style, "--no-pictures", "--height-mm", "40", "-q"]) == 0
    return folder / "rig"


@pytest.fixture
def copied(made, tmp_path):
    """A copy of it that may be spoilt."""
    for path in made.iterdir():
        (tmp_path / path.name).write_bytes(path.read_bytes())
    return tmp_path


def test_a_good_rig_has_no_problems(made):
    facts = read_rig(made)
    assert facts == read_rig(made / "rig.json")
    assert facts.height_mm == 40.0
    assert facts.room_mm == (210.0, 210.0, 250.0)
    assert len(facts.parts) == 4 + 2 + 4 + 3  # cube and arrow, markers, base holder
    assert [part.problems for part in facts.parts] == [()] * 13


def test_spoilt_parts_are_named(copied):
    parts = json.loads((copied / "rig.json").read_text())["parts"]
    first, second, third = (copied / part["file"] for part in parts[:3])
    first.write_bytes(first.read_bytes()[:-50])
    second.unlink()
    third.write_bytes((copied / parts[3]["file"]).read_bytes())
    problems = [part.problems for part in read_rig(copied).parts]
    assert "truncated" in problems[0][0]
    assert problems[1] == ("there is no such file",)
    assert any("volume" in problem for problem in problems[2])
    assert problems[3:] == [()] * 10


def test_a_rig_in_layers_of_an_earlier_version_is_read(copied):
    content = json.loads((copied / "rig.json").read_text())
    layered = {"name": "piece_01", "file": "layers_01.dxf", "volume_mm3": 9.0}
    content |= {"style": "sheet", "parts": [{**layered, "size_mm": [60.0, 40.0, 42.0]}]}
    (copied / "rig.json").write_text(json.dumps(content))
    assert read_rig(copied).height_mm == 42.0


def test_parts_elsewhere_are_not_read(copied, made):
    file = copied / json.loads((copied / "rig.json").read_text())["parts"][0]["file"]
    file.unlink()
    file.symlink_to(made / file.name)
    with pytest.raises(BadInputError, match="allowed: a path in"):
        read_rig(copied)


def test_folders_that_are_no_rig(tmp_path, copied):
    with pytest.raises(UnreadableFileError, match="no such file"):
        read_rig(tmp_path / "nowhere")
    (copied / "rig.json").write_text("{")
    with pytest.raises(UnreadableFileError, match="not JSON"):
        read_rig(copied)
    (copied / "rig.json").write_text("[]")
    with pytest.raises(UnreadableFileError, match="not a JSON object"):
        read_rig(copied)
    (copied / "rig.json").write_text('{"schema": "vinefab/rig-2"}')
    with pytest.raises(BadInputError, match="schema is 'vinefab/rig-2'"):
        read_rig(copied)


def test_a_rig_cannot_name_files_elsewhere(copied):
    content = json.loads((copied / "rig.json").read_text())
    content["parts"][0]["file"] = "../../secret.stl"
    (copied / "rig.json").write_text(json.dumps(content))
    with pytest.raises(BadInputError, match=r"parts\[1\].file"):
        read_rig(copied)


def test_check_applies_the_rules_to_it(made, copied, capsys):
    arguments = ["check", "plain_vine", "--json", "-"]
    assert main([*arguments, "--rig", str(made), "--map", str(made.parent / "grid.geojson")]) == 0
    ran = {run["id"] for run in json.loads(capsys.readouterr().out)["rules_run"]}
    assert {"VF-R01", "VF-R02", "VF-R03", "VF-R04"} <= ran
    (copied / "scale_cube_20mm.stl").write_bytes(b"nothing")
    assert main([*arguments, "--rig", str(copied)]) == 1
    found = json.loads(capsys.readouterr().out)["findings"]
    assert [finding["id"] for finding in found if finding["severity"] == "error"] == ["VF-R01"]
