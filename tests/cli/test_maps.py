"""Commands on maps: import, figures, starts, targets."""

import json
import re

import pytest

import vinefab as vf
from vinefab import maps
from vinefab.maps.summary import size_notes
from vinefab.model.map import Map

PASSAGES = [[[x, 0], [x + 100, 0], [x + 100, 20], [x, 20], [x, 0]] for x in (0, 90, 180, 400)]


def write_passages(path, count):
    polygons = [[ring] for ring in PASSAGES[:count]]
    path.write_text(json.dumps({"type": "MultiPolygon", "coordinates": polygons}))
    return path


def test_the_reading_of_areas_is_said_whether_asked_for_or_guessed(vinefab, tmp_path):
    source = write_passages(tmp_path / "cave.geojson", 3)
    code, words, _ = vinefab("map", "import", source, "--out", tmp_path / "a.geojson")
    assert code == 0
    assert "drawn: free (guessed: no outline contains the others" in words
    code, words, _ = vinefab(
        "map", "import", source, "--drawn", "free", "--out", tmp_path / "b.geojson"
    )
    assert code == 0
    assert "drawn: free (as asked for)" in words
    assert "areas_united: 3" in words


def test_parts_that_do_not_hang_together_are_printed(vinefab, tmp_path):
    source = write_passages(tmp_path / "cave.geojson", 4)
    code, words, _ = vinefab(
        "map", "import", source, "--drawn", "free", "--out", tmp_path / "a.geojson"
    )
    assert code == 0
    for said in ("separate_parts: 2", "connected_share: 0.7368", "120 mm away"):
        assert said in words


def test_a_map_says_how_it_was_made_once_and_in_few_digits(vinefab, tmp_path):
    source = write_passages(tmp_path / "cave.geojson", 4)
    made, scaled = tmp_path / "a.geojson", ("--scale-mm-per-unit", "1.23456789")
    code, words, _ = vinefab("map", "import", source, *scaled, "--drawn", "free", "--out", made)
    lines = [line for line in words.splitlines() if line.startswith("  ")]
    assert (code, bool(lines)) == (0, True)
    assert not [line for line in lines if line.endswith(": None")]
    assert not re.search(r"^  \w+: -?\d+\.\d{7}", words, re.MULTILINE)
    started = ["map", "start", made, "--start", "110,12,0", "--out", tmp_path / "b.geojson"]
    code, words, _ = vinefab(*started)
    assert (code, [line for line in words.splitlines() if line.startswith("  ")]) == (0, [])
    assert "0 obstacles" in words


# --- Figures of a map -----------------------------------------------------------------------------


def write_room(path, width, height):
    rectangle = [[0, 0], [width, 0], [width, height], [0, height], [0, 0]]
    shape = {"type": "Polygon", "coordinates": [rectangle]}
    feature = {"type": "Feature", "properties": {}, "geometry": shape}
    path.write_text(json.dumps({"type": "FeatureCollection", "features": [feature]}))
    return path


@pytest.mark.parametrize(
    ("size", "options", "note"),
    [
        ((0.5, 0.4), (), "0.5 x 0.4 mm: vinefab map import --scale-mm-per-unit 1000 if its "),
        ((24, 16), (), "25.4 if its unit is inches (609.6 x 406.4 mm), 10 if its unit is cent"),
        ((50_000, 9), (), "50000 x 9 mm: vinefab map import --scale-mm-per-unit 0.1 if its "),
        (
            (0.5, 0.4),
            (10,),
            "5 x 4 mm, drawn as 0.5 x 0.4: vinefab map import --scale-mm-per-unit 1000 if its ",
        ),
        ((0.01, 0.02), (), "0.01 x 0.02 mm: is that its unit? vinefab map import has "),
        ((60, 9), (), ""),
        ((20_000, 9_000), (), ""),
    ],
)
def test_a_map_of_another_unit_is_noted_once_and_taken(vinefab, tmp_path, size, options, note):
    room, out = write_room(tmp_path / "room.geojson", *size), tmp_path / "out.geojson"
    scale = ("--scale-mm-per-unit", *options) if options else ()
    told = [vinefab("map", "import", room, *scale, "--out", out)]
    if not options:
        told.append(vinefab("map", "info", room, "--passages", 1))
    for code, output, complaint in told:
        assert (code, complaint) == (0, "")
        notes = [line for line in output.splitlines() if line.startswith("note: this map")]
        assert len(notes) == bool(note)
        assert note in output


def test_a_small_map_of_a_generator_is_no_mistake():
    assert size_notes(maps.pegs(columns=1, rows=1, pitch_mm=8.0, diameter_mm=2.0)) == []


# --- ``--start`` and ``vinefab map start`` --------------------------------------------------------


def test_map_start_writes_the_starts_into_a_file(vinefab, grid, tmp_path):
    out = tmp_path / "left.geojson"
    words = ("--start", "left side, heading 0+-20", "--start", "150,15,90+-5")
    code, said, complaint = vinefab("map", "start", grid, *words, "--out", out)
    assert (code, complaint) == (0, "")
    assert "start: line 15,0 15,300, heading 0+-20 (one growth: 15.0," in said
    assert "start: 150.0,15.0,90.0" in said
    assert "% of the start's line that is free, at least 15 mm from walls" in said
    before, after = Map.read(grid), Map.read(out)
    assert [one.area is None for one in after.starts] == [False, True]
    assert after.obstacles == before.obstacles
    assert vinefab("map", "start", grid, *words, "--out", grid)[0] == 0


def test_the_map_with_its_start_and_the_option_give_the_same_scores(vinefab, grid, tmp_path):
    out, words = tmp_path / "left.geojson", ("--start", "left side, heading 0+-20")
    vinefab("map", "start", grid, *words, "--out", out, "-q")
    one = vinefab("score", "plain_vine", "--maps", out, "--json", "-")
    two = vinefab("score", "plain_vine", "--maps", grid, *words, "--json", "-")
    assert one[0] == 0
    assert json.loads(one[1]) == json.loads(two[1])
    poses = [entry["pose"] for entry in json.loads(one[1])["evaluations"]]
    assert {pose["x_mm"] for pose in poses} == {15.0}
    assert len({pose["y_mm"] for pose in poses}) == 3
    assert all(abs(pose["heading_deg"]) <= 20.0 for pose in poses)


# --- Commands on maps with targets: the natural task and measure, and tables of targets -----------


@pytest.fixture
def aimed(grid, tmp_path):
    """The map of `grid` with two targets in its file."""
    path = tmp_path / "aimed.geojson"
    vf.Map.read(grid).with_targets("valve=12,12+-9", "288,288").write(path)
    return path


@pytest.mark.parametrize(
    ("maps", "more", "task", "said_so"),
    [
        (("aimed",), (), "reach", True),
        (("aimed",), ("--task", "coverage"), "coverage", False),
        (("grid",), (), "coverage", False),
        (("grid", "aimed"), (), "coverage", False),
        (("grid",), ("--targets", "12,12", "150,12+-5"), "reach", True),
        (("grid", "aimed"), ("--target", "12,12"), "reach", True),
    ],
)
def test_the_task_of_aimed_maps_is_reach(vinefab, plain, aimed, grid, maps, more, task, said_so):
    files = [{"aimed": aimed, "grid": grid}[name] for name in maps]
    code, said, complaint = vinefab("score", plain, "--maps", *files, *more, "--json", "-")
    assert (code, complaint.count("error")) == (0, 0)
    assert json.loads(said)["task"] == task
    assert (
        "task reach: the maps have targets" in vinefab("score", plain, "--maps", *files, *more)[1]
    ) is said_so


@pytest.mark.parametrize(
    ("words", "names", "tolerance_mm"),
    [
        (("--targets", "12,12", "valve=150,12+-5"), ["A", "valve"], [None, 5.0]),
        (("--target", "12,12", "--target", "valve=150,12+-5"), ["A", "valve"], [None, 5.0]),
        (("--targets", "12,12", "150,12", "shelf=288,12"), ["A", "B", "shelf"], [None] * 3),
    ],
)
def test_one_option_takes_several_targets(vinefab, plain, grid, words, names, tolerance_mm):
    code, said, complaint = vinefab("score", plain, "--map", grid, *words, "--json", "-", "-q")
    assert (code, complaint) == (0, "")
    found = json.loads(said)["targets"]
    assert [one["name"] for one in found] == names
    for one, wanted in zip(found, tolerance_mm, strict=True):
        assert wanted in (None, one["tolerance_mm"])


def test_map_info_lists_targets_and_their_room(vinefab, aimed, grid):
    numbers = json.loads(vinefab("map", "info", aimed, "--json", "-", "-q")[1])
    world = vf.Map.read(aimed)
    assert [one["name"] for one in numbers["targets"]] == ["valve", "A"]
    for one, target in zip(numbers["targets"], world.targets, strict=True):
        away_mm = world.free_space.boundary.distance(target.shape)
        assert (one["tolerance_mm"], one["clearance_mm"]) == (target.tolerance_mm, away_mm)
    assert "valve" in vinefab("map", "info", aimed)[1]
    assert not json.loads(vinefab("map", "info", grid, "--json", "-", "-q")[1]).get("targets")


@pytest.mark.parametrize(
    ("maps", "more", "measure"),
    [
        (("aimed",), (), "targets_touched_percent"),
        (("grid",), (), "coverage_score"),
        (("aimed", "grid"), (), "coverage_score"),
        (("aimed",), ("--measure", "coverage_score"), "coverage_score"),
    ],
)
def test_comparisons_rank_by_targets_where_all_maps_have_them(
    vinefab, plain, aimed, grid, tmp_path, maps, more, measure
):
    files = [{"aimed": aimed, "grid": grid}[name] for name in maps]
    words = ("compare", plain, "plain_vine", "--maps", *files, "--poses", 1, *more)
    code, said, complaint = vinefab(*words, "--json", "-", "--out", tmp_path / "page.html")
    assert (code, "error" in complaint) == (0, False)
    document = json.loads(said)
    assert document["measure"] == measure
    rows = document.get("targets") or []
    assert {one["design"] for one in rows} == (
        {"plain", "plain_vine"} if "aimed" in maps else set()
    )
    assert all([each["name"] for each in one["of"]] == ["valve", "A"] for one in rows)
