"""What newcomers type wrong: one line each, with what to type instead."""

import shlex

import pytest

GUESSES = {
    "grow": "DESIGN is missing; for example: vinefab grow three_level_tree --map",
    "grow plain_vine": "MAP is missing; for example: vinefab grow three_level_tree --map",
    "grow plain_vine --map m.geojson --pose 100 20 90": "for example: vinefab grow",
    "grow plain_vine --map m.geojson --dpi x": "no option --dpi; vinefab grow --help lists them",
    "grow plain_vine --hlep": "there is no option --hlep; did you mean --help?",
    "grow plain_vine --head-on-half-angl 5": "did you mean --head-on-half-angle-deg or",
    "map import a --scale 2 --out c.json": "did you mean --scale-mm-per-unit?",
    "map grid --size 300mm --out g.json": "--size-mm is '300mm'; allowed: a number, without a unit",
    "map grid --size=abc --out g.json": "--size-mm is 'abc'; allowed: a number",
    "map grid --seed -1 --out g.json": "--seed is -1; allowed: a whole number, 0 or more",
    "map grid --seed 1.5 --out g.json": "--seed is '1.5'; allowed: a whole number",
    "map grid --out g.svg": "--out is 'g.svg'; allowed: a file name ending in .geojson or .json",
    "map import a.svg --out g.png": "--out is 'g.png'; allowed: a file name ending in .geojson",
    "report plain_vine --out r.pdf": "--out is 'r.pdf'; allowed: a file name ending in .html",
    "--map m.geojson grow vine": "no option --map before a command; vinefab COMMAND --map ...",
    "simulate vine": "there is no command 'simulate'; there are: new, examples,",
    "fabricate plain_vine -o x": "no option -o; vinefab fabricate --help lists them",
    "optimise run.toml": "did you mean 'optimize'?",
    "map maze": "there is no command 'maze'; there are: grid, cave,",
    "map": "a command is missing; there are: grid, cave,",
    "new vine.toml": "for example: vinefab new design mine.toml",
    "rules VF-C01 VF-C02": "for example: vinefab rules VF-C01",
    "study contest run.toml": "--optimizer random --seeds 2",
    "check mine.json": "mine.json: is not TOML, but JSON, as maps are (--map):",
    "map info mine.toml": "mine.toml: is not JSON, but TOML, as designs are:",
    "fabricate plain_vine --out mine.toml --force": "mine.toml: cannot be written: it is a file",
    "rig mine.json --out mine.toml/rig": "mine.toml: cannot be written: it is a file",
    "examples --out mine.toml": "mine.toml: cannot be written: it is a file; name a folder",
}


@pytest.mark.parametrize(("line", "said"), GUESSES.items(), ids=GUESSES)
def test_a_wrong_guess_gets_one_line_that_helps(vinefab, tmp_path, monkeypatch, line, said):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.json").write_text('{"type": "FeatureCollection", "features": []}')
    (tmp_path / "mine.toml").write_text('schema = "vinefab/design-1"\n')
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    code, _, complaint = vinefab(*shlex.split(line))
    assert (code, complaint.count("\n")) == (2, 1)
    assert said in complaint
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before
