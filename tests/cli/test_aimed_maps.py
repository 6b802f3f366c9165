"""Commands on maps with targets: the natural task and measure, and tables of targets."""

import json

import pytest

import vinefab as vf


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
