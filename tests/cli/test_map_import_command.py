import json
import re

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
