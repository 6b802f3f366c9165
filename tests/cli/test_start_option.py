"""``--start`` and ``vinefab map start``."""

import json

import pytest

from vinefab.model.map import Map


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


def test_maps_are_made_and_drawn_with_a_start(vinefab, grid, tmp_path):
    made, picture = tmp_path / "made.geojson", tmp_path / "grown.svg"
    size = ("--columns", 3, "--rows", 3, "--size", 300)
    code, said, _ = vinefab("map", "grid", *size, "--start", "top side", "--out", made)
    assert code == 0
    assert "start: line 0,285 300,285, heading -90" in said
    code, said, _ = vinefab("grow", "plain_vine", "--map", grid, "--start", "20,15,90+-5",
                            "--svg", picture)  # fmt: skip
    assert code == 0
    assert "from 20.00,15.00,90.00" in said
    assert vinefab("map", "info", grid, "--start", "right side", "-q") == (0, "", "")


def test_a_drawing_is_imported_with_a_place_to_start(vinefab, tmp_path):
    drawing, out = tmp_path / "room.svg", tmp_path / "room.geojson"
    drawing.write_text(
        '<svg xmlns="http://www.w3.org/2000/svg"><rect width="400" height="300"/></svg>'
    )
    given = ("--scale-mm-per-unit", 1, "--out", out, "-q")
    assert vinefab("map", "import", drawing, "--start", "left side", *given)[0] == 0
    assert Map.read(out).starts[0].area.length == pytest.approx(300.0)
    x, y = Map.read(out).bounds.centroid.coords[0]
    assert vinefab("map", "import", drawing, "--start", f"{x},{y},30", *given)[0] == 0
    assert Map.read(out).starts[0].pose.heading_deg == pytest.approx(30.0)
