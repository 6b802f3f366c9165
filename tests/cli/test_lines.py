"""One table of command lines that work, run in this process: what they write, say and return."""

import json
import re
import shlex
from pathlib import Path

import pytest

from tests.cli.conftest import PLAIN
from vinefab.model.design import Design
from vinefab.model.map import Map

BEGINS = {
    ".svg": (b"<?xml", b"<svg"),
    ".png": b"\x89png",
    ".gif": b"gif89a",
    ".html": b"<!doctype html>",
    ".zip": b"pk",
}
KINDS = {"map": "FeatureCollection"}
SMALL = "--environment grid --count 2 --set columns=3 --set rows=3 --set size_mm=300 --poses 1"
FILES = {
    "plain.toml": PLAIN,
    "tail.toml": PLAIN + "[build]\ntail_mm = 100.0\npressure_kpa = 30.0\n",
    "thin.toml": PLAIN + "[build]\nwidths_mm = [3.0]\n",
    "free.toml": PLAIN + '[build]\ncompensation = "none"\n',
    "room.svg": '<svg xmlns="http://www.w3.org/2000/svg"><rect width="400" height="300"/></svg>',
}
LINES = [
    # The line, its exit code, the schema of its document, and words. What it writes begins with o;
    # with "nothing" among the words it writes nothing.
    ("grow three_level_tree --map grid.geojson --svg o.svg", 0, "deployment-1", "simulated"),
    ("grow plain_vine --map grid.geojson --svg o.PNG --animate o.GIF --frames 5", 0,
     "deployment-1", "plain_vine on grid"),
    ("grow plain_vine --map grid.geojson --start 20,15,90+-5 --animate o.svg --frames 5", 0,
     "deployment-1", "from 20.00,15.00,90.00"),
    ("grow plain_vine --map grid.geojson --growth body=centerline --svg o.svg --label", 0,
     "deployment-1", "centerline body, head-on half-angle 1 deg (assumed), stops at 20 kPa"),
    ("score three_level_tree --maps grid.geojson --poses 3", 0, "score-1", "inflated body"),
    ("aim plain_vine --map grid.geojson --deployments 5000 --alone --out o.html", 0, "aim-1",
     "put the base of plain_vine at "),
    (f"compare three_level_tree plain_vine {SMALL} --measure seen --out o.html", 0,
     "design-comparison-1", "three_level_tree minus plain_vine"),
    (f"report plain_vine {SMALL} --out o.html", 0, "prediction-1", "fails completely: "),
    ("check three_level_tree", 0, "checks-1", "no map"),
    ("check thin.toml", 1, "checks-1", "VF-W01"),
    ("check plain.toml --map grid.geojson --growth body=centerline", 0, "checks-1",
     "growth: centerline body, head-on half-angle 1 deg (assumed), no pressure"),
    ("check tail.toml --svg o.svg --png o.png --dxf o.dxf", 1, "checks-1", "wrote o.dxf"),
    ("fix tail.toml --out o.toml", 0, "checks-1", "the tail: 100 -> 150 mm"),
    ("fix tail.toml --out o.toml --map grid.geojson", 0, "checks-1", "coverage, mean over 1 map:"),
    ("fix three_level_tree --out o.toml", 0, "checks-1", "nothing to fix"),
    ("fix plain.toml --out o.toml --limit VF-L04.error=0.01", 1, "checks-1",
     "clears VF-L04; nothing written"),
    ("fabricate plain_vine --out o --allow-uncalibrated --zip", 0, "written-1", "README.txt"),
    ("inflate free.toml --across 4 --out o.html --mesh o.stl", 0, "inflation-1",
     "cut with its designed angles"),
    ("rig grid.geojson --printer generic_256 --out o --fit-mm 100 --no-pictures", 0,
     "written-1", "wrote o/"),
    ("map grid --columns 3 --rows 3 --size 300 --start 'top side' --out o.geojson", 0, "map",
     "start: line 0,285 300,285, heading -90"),
    ("map start grid.geojson --start 'left side, heading 0+-20' --start 150,15,90 --out o.geojson",
     0, "map", "% of the start's line that is free, at least 15 mm from walls"),
    ("map import room.svg --scale-mm-per-unit 1 --start 'left side' --out o.geojson", 0, "map",
     "start: line"),
    ("map info grid.geojson --width-mm 20 --passages 2 --svg o.svg", 0, "map-info-1",
     "body asked about: 20 mm"),
    ("studio plain_vine --environment pegs --snapshot o.html", 0, "written-1", "wrote o.html"),
    ("rules", 0, "rules-1", "VF-C01"),
    ("rules vf-c01", 0, "rules-1", "broken: too little"),
    ("profiles", 0, "profiles-1", "co2_60w__stretchlon_200"),
    ("designs", 0, "names-1", "grid_explorer_levels"),
    ("examples", 0, "names-1", "grid_coverage.toml: A run of"),
]  # fmt: skip


def written():
    """Return what a line wrote, by its path."""
    return {
        path.as_posix(): path.read_bytes()
        for path in sorted(Path().rglob("*"))
        if path.is_file() and path.parts[0].split(".")[0] == "o"
    }


@pytest.mark.usefixtures("grid")
@pytest.mark.parametrize(("line", "code", "schema", "words"), LINES)
def test_a_line_writes_says_and_returns_the_same_each_time(
    vinefab, monkeypatch, tmp_path, line, code, schema, words
):
    monkeypatch.chdir(tmp_path)
    for name, text in FILES.items():
        Path(name).write_text(text)
    typed = shlex.split(line)
    found, said, complaint = vinefab(*typed)
    assert (found, complaint) == (code, "")
    assert words in said
    first = written()
    asked = {word for word in typed if re.fullmatch(r"o(\.\w+)?", word)}
    assert {name.split("/")[0] for name in first} >= (set() if "nothing" in words else asked)
    assert not ("nothing" in words and first)
    assert all(Path(name).read_text() == text for name, text in FILES.items())
    for name, data in first.items():
        assert data.lower().startswith(BEGINS.get(Path(name).suffix.lower(), b"")), name
        assert b'src="http' not in data
    for name, noun in (("o.toml", Design), ("o.geojson", Map)):
        if name in first:
            assert noun.read(name).name
    # Once more: the document stands alone, words are on the other stream, files are the same.
    found, document, again = vinefab(*typed, "--json", "-")
    assert (found, again) == (code, said)
    content = json.loads(document)
    assert (content["type"] if schema == "map" else content["schema"]) == KINDS.get(
        schema, f"vinefab/{schema}"
    )
    for name, data in written().items():
        # Handles stand in DXF files, whose content is compared elsewhere.
        if Path(name).suffix not in (".dxf", ".sha256", ".zip"):
            assert data == first[name], name
    if "o.toml" in first:  # what a fix writes can be made
        assert vinefab("check", "o.toml")[0] == 0
    if ".svg" in str(asked) and "check" in typed:  # findings are no job for a laser
        assert b"VF_" not in first["o.svg"]


@pytest.mark.usefixtures("grid")
def test_a_design_that_cannot_be_made_is_not_written(vinefab, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    Path("thin.toml").write_text(FILES["thin.toml"])
    code, said, complaint = vinefab("fabricate", "thin.toml", "--out", "o", "--allow-uncalibrated")
    assert (code, written()) == (1, {})
    assert "VF-W01" in said
    assert "nothing written" in complaint
