"""What a user gets wrong: always one clear line, exit code 2, and nothing written or lost."""

import json
import os

import pytest

from vinefab.cli.main import main

DESIGN = """schema = "vinefab/design-1"
name = "d"
[trunk]
length = 120.0
[[level]]
branches = 2
length = 60.0
angle_deg = 60.0
[build]
widths_mm = [20.0, 12.0]
"""
NAN = float("nan")


def complaint(vinefab, *arguments):
    """Run a command that must be refused, and return its one line."""
    code, output, words = vinefab(*arguments)
    assert code == 2, (output, words)
    assert words.startswith("error: ")
    assert words.count("\n") == 1
    assert "Traceback" not in words
    return words


DESIGNS = {
    "not TOML": ("schema", "schema schema", "is not TOML"),
    "unknown key": ("branches", "brunches", "did you mean 'branches'"),
    "wrong unit": ("widths_mm", "widths_cm", "did you mean 'widths_mm'"),
    "nan": ("60.0\nangle", "nan\nangle", "is nan"),
    "negative width": ("12.0", "-12.0", "is -12.0"),
    "huge": ("120.0", "1e300", "1e+300"),
    "million branches": ("branches = 2", "branches = 1000000", "1000000"),
    "text for number": ("120.0", '"long"', "'long'"),
    "missing table": ("[trunk]\nlength = 120.0", "", "trunk is missing"),
    "other schema": ("design-1", "map-1", "vinefab/design-1"),
}


@pytest.mark.parametrize(("old", "new", "words"), DESIGNS.values(), ids=DESIGNS)
@pytest.mark.parametrize("command", ["grow", "check", "score"])
def test_bad_designs(vinefab, grid, tmp_path, command, old, new, words):
    path = tmp_path / "bad.toml"
    path.write_text(DESIGN.replace(old, new, 1))
    options = {"grow": ["--map", grid], "score": ["--maps", grid], "check": []}[command]
    assert words in (line := complaint(vinefab, command, path, *options))
    assert str(path) in line


def square(low, high):
    return [[[low, low], [high, low], [high, high], [low, high], [low, low]]]


def bow_tie(document):
    document["features"][1]["geometry"]["coordinates"] = [
        [[10, 10], [60, 60], [60, 10], [10, 60], [10, 10]]
    ]


def nan_point(document):
    document["features"][1]["geometry"]["coordinates"][0][0] = [NAN, 1.0]


def huge(document):
    document["features"][0]["geometry"]["coordinates"] = square(0, 1e300)


def blocked_start(document):
    obstacle = {"type": "Feature", "properties": {"role": "obstacle"}}
    obstacle["geometry"] = {"type": "Polygon", "coordinates": square(0.0, 299.0)}
    document["features"].append(obstacle)


def empty(document):
    document["features"] = []


def two_bounds(document):
    document["features"].append(document["features"][0])


MAPS = {
    "self-crossing polygon": (bow_tie, "35"),
    "nan coordinate": (nan_point, "nan"),
    "huge coordinate": (huge, "1e+300"),
    "start in an obstacle": (blocked_start, "start"),
    "empty map": (empty, "polygon"),
    "two bounds": (two_bounds, "bounds"),
    "no collection": (lambda document: document.update(type="Polygon"), "FeatureCollection"),
}


@pytest.mark.parametrize(("change", "words"), MAPS.values(), ids=MAPS)
def test_bad_maps(vinefab, grid, edited, change, words):
    path = edited(grid, change)
    line = complaint(vinefab, "grow", "plain_vine", "--map", path)
    assert words in line
    assert str(path) in line


def test_map_that_is_no_json(vinefab, tmp_path):
    path = tmp_path / "map.geojson"
    path.write_text("{ not json")
    assert "JSON" in complaint(vinefab, "grow", "plain_vine", "--map", path)


def test_a_map_is_not_imported_onto_itself(vinefab, grid):
    before = grid.read_bytes()
    line = complaint(vinefab, "map", "import", grid, "--out", grid, "--force")
    assert "another file" in line
    assert grid.read_bytes() == before


@pytest.mark.parametrize("pose", ["1,2", "1,2,3,4", "a,b,c", "nan,1,2", "1e99,0,0", ""])
def test_bad_poses(vinefab, grid, pose):
    assert "pose" in complaint(vinefab, "grow", "plain_vine", "--map", grid, "--pose", pose)


MISSING = {
    "design": ["grow", "no/such.toml", "--map", "GRID"],
    "design by name": ["grow", "three_levle_tree", "--map", "GRID"],
    "map": ["grow", "plain_vine", "--map", "no_such.geojson"],
    "recipe": ["check", "plain_vine", "--recipe", "no_such_recipe"],
    "printer": ["rig", "GRID", "--printer", "no_such_printer", "--out", "OUT"],
    "run file": ["optimize", "no_such_run.toml", "--out", "OUT"],
    "ROS map": ["map", "import", "no_such.yaml", "--out", "OUT"],
    "task": ["score", "plain_vine", "--maps", "GRID", "--task", "covrage"],
    "importer": ["map", "import", "drawing.docx", "--out", "OUT"],
}


@pytest.mark.parametrize("arguments", MISSING.values(), ids=MISSING)
def test_things_that_do_not_exist(vinefab, grid, tmp_path, arguments):
    places = {"GRID": grid, "OUT": tmp_path / "out"}
    line = complaint(vinefab, *[places.get(argument, argument) for argument in arguments])
    assert any(word in line for word in ("no such file", "there are:", "allowed:"))
    assert not (tmp_path / "out").exists()


NEAR = {
    "design": (["check", "three_levle_tree"], "did you mean 'three_level_tree'"),
    "task": (["score", "plain_vine", "--maps", "GRID", "--task", "covrage"], "'coverage'"),
    "command": (["chek"], "'check'"),
}


@pytest.mark.parametrize(("arguments", "hint"), NEAR.values(), ids=NEAR)
def test_near_misses_are_told_the_right_spelling(vinefab, grid, arguments, hint):
    given = [grid if argument == "GRID" else argument for argument in arguments]
    assert hint in complaint(vinefab, *given)


OPTIONS = {
    "unknown option": ["check", "plain_vine", "--colour", "red"],
    "missing option": ["grow", "plain_vine"],
    "wrong kind": ["map", "grid", "--seed", "one", "--out", "OUT"],
    "picture of no kind": ["grow", "plain_vine", "--map", "GRID", "--svg", "OUT"],
    "infinite size": ["map", "grid", "--size", "inf", "--out", "OUT"],
    "no room for starts": ["map", "grid", "--starts", "500", "--out", "OUT"],
    "start out of this world": ["map", "import", "GRID", "--start", "1e9,0,0", "--out", "OUT"],
    "negative seed": ["map", "grid", "--seed", "-1", "--out", "OUT"],
    "size of nothing": ["map", "grid", "--size", "0", "--out", "OUT"],
    "nan size": ["map", "grid", "--size", "nan", "--out", "OUT"],
    "obstacles too large": ["map", "grid", "--gap", "500", "--out", "OUT"],
    "body of no kind": ["grow", "plain_vine", "--map", "GRID", "--body", "round"],
    "half-angle beyond": ["grow", "plain_vine", "--map", "GRID", "--head-on-half-angle-deg", "91"],
    "parameter without value": ["score", "plain_vine", "--maps", "GRID", "--set", "radius_mm"],
    "unknown parameter": ["score", "plain_vine", "--maps", "GRID", "--set", "radius=3"],
    "no poses": ["score", "plain_vine", "--maps", "GRID", "--poses", "0"],
    "rig without height": ["rig", "GRID", "--out", "OUT", "--height-mm", "0"],
    "rig taller than the printer": ["rig", "GRID", "--out", "OUT", "--height-mm", "900"],
    "rig in a thousand parts": ["rig", "GRID", "--out", "OUT", "--scale", "100"],
}


@pytest.mark.parametrize("arguments", OPTIONS.values(), ids=OPTIONS)
def test_bad_options(vinefab, grid, tmp_path, arguments):
    places = {"GRID": grid, "OUT": tmp_path / "out"}
    complaint(vinefab, *[places.get(argument, argument) for argument in arguments])
    assert not (tmp_path / "out").exists()


def test_a_foreign_file_is_kept(vinefab, grid, tmp_path):
    thesis = tmp_path / "thesis.json"
    thesis.write_text("five years of work")
    arguments = ("grow", "plain_vine", "--map", grid, "--json", thesis)
    assert "--force" in complaint(vinefab, *arguments)
    assert thesis.read_text() == "five years of work"
    assert vinefab(*arguments, "--force", "-q")[0] == 0
    assert json.loads(thesis.read_text())["design"] == "plain_vine"


@pytest.mark.parametrize("command", ["fabricate", "rig", "demo"])
def test_a_foreign_folder_is_kept(vinefab, grid, tmp_path, command):
    folder = tmp_path / "photos"
    folder.mkdir()
    (folder / "robot.jpg").write_bytes(b"jpg")
    first = {"fabricate": ["plain_vine", "--allow-uncalibrated"], "rig": [grid], "demo": []}
    assert "--force" in complaint(vinefab, command, *first[command], "--out", folder)
    assert [path.name for path in folder.iterdir()] == ["robot.jpg"]


@pytest.mark.skipif(os.geteuid() == 0, reason="root may write into any folder")
def test_a_folder_without_permission(vinefab, grid, tmp_path):
    locked = tmp_path / "locked"
    locked.mkdir(mode=0o500)
    line = complaint(vinefab, "grow", "plain_vine", "--map", grid, "--json", locked / "a.json")
    assert "cannot be written" in line


def test_a_folder_that_the_system_refuses(vinefab, grid):
    line = complaint(vinefab, "grow", "plain_vine", "--map", grid, "--json", "/proc/nothing/a.json")
    assert "cannot be written" in line


def test_a_file_in_the_place_of_the_output_folder(vinefab, tmp_path):
    taken = tmp_path / "package"
    taken.write_text("a file")
    complaint(vinefab, "fabricate", "plain_vine", "--allow-uncalibrated", "--out", taken)
    assert taken.read_text() == "a file"


@pytest.mark.parametrize("command", [["check"], ["fabricate", "--out", "OUT"]])
def test_a_tree_that_no_sheet_could_hold(vinefab, tmp_path, command):
    path = tmp_path / "forest.toml"
    path.write_text(
        DESIGN.replace("branches = 2", "branches = 999").replace(
            "[build]\nwidths_mm = [20.0, 12.0]",
            "[[level]]\nbranches = 90\nlength = 5.0\nangle_deg = 10.0",
        )
    )
    name, *options = [tmp_path / "out" if part == "OUT" else part for part in command]
    assert "90910 branches" in complaint(vinefab, name, path, *options)


def test_errors_do_not_stop_at_the_first_command_line_only():
    # The same through the program's real entry point: an exit code, never a traceback.
    assert main(["grow"]) == 2
