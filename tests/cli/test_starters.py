"""`new`, `examples`, `rules`, `study`, completion: how a user gets going."""

import json
from pathlib import Path

import pytest

from vinefab.app.files import _NEXT_STEPS as NEXT_STEPS
from vinefab.app.verbs import SHORT, VERBS
from vinefab.cli.commands import Command, UsageError
from vinefab.cli.main import main
from vinefab.fabrication.rules.catalog import RULES
from vinefab.model.design import Design
from vinefab.model.files.starters import shipped_examples, starter_map
from vinefab.model.laser import read_machine, read_material, read_profile
from vinefab.model.map import Map
from vinefab.search.settings import read_run


@pytest.fixture(autouse=True)
def in_an_empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


READERS = {
    "design": Design.read,
    "run": read_run,
    "recipe": read_profile,
    "machine": read_machine,
    "material": read_material,
    "map": Map.read,
}


@pytest.mark.parametrize("kind", NEXT_STEPS)
def test_a_new_file_is_read_and_has_the_name_of_its_file(kind, tmp_path, capsys):
    path = tmp_path / ("mine.geojson" if kind == "map" else "mine.toml")
    assert main(["new", kind, str(path)]) == 0
    made = READERS[kind](path)
    assert (made.recipe if kind == "recipe" else made).name == "mine"
    assert "next: " in capsys.readouterr().out
    path.write_text(path.read_text() + "\n")
    before = path.read_text()
    assert main(["new", kind, str(path)]) == 0
    assert path.read_text() == before
    assert f"{path} is there already and left as it is" in capsys.readouterr().out
    path.write_text(f"\n\n\n{before}")
    assert main(["new", kind, str(path)]) == 2
    assert path.read_text() == f"\n\n\n{before}"
    assert "exists; --force overwrites it" in capsys.readouterr().err


@pytest.mark.parametrize("kind", ["design", "run", "map"])
@pytest.mark.parametrize("stem", ["my robot", "a\nb", "\x1b[1m", "\udcff", 'a"b\\'])
def test_a_new_file_is_read_whatever_its_name(kind, stem, tmp_path):
    path = tmp_path / f"{stem}{'.geojson' if kind == 'map' else '.toml'}"
    assert main(["new", kind, str(path), "-q"]) == 0
    READERS[kind](path)


def test_a_laser_of_ones_own_lies_beside_its_recipe(tmp_path, monkeypatch, capsys):
    assert main(["new", "machine", "small.toml", "-q"]) == 0
    small = tmp_path / "small.toml"
    small.write_text(small.read_text().replace("value = 1000.0", "value = 300.0", 1))
    assert main(["new", "recipe", "film.toml", "--from", "co2_60w__stretchlon_800"]) == 0
    film = tmp_path / "film.toml"
    film.write_text(film.read_text().replace('machine = "co2_60w"', 'machine = "small"'))
    (tmp_path / "elsewhere").mkdir()
    monkeypatch.chdir(tmp_path / "elsewhere")
    assert read_profile(film).machine.bed_width_mm.value == 300.0
    capsys.readouterr()
    assert main(["profiles", str(film)]) == 0
    assert "machine: small: " in capsys.readouterr().out
    assert main(["profiles", str(small)]) == 0
    assert capsys.readouterr().out.startswith("machine ")


def test_a_copy_of_a_run_file_keeps_the_names_of_its_parts(tmp_path):
    assert main(["new", "run", "mine.toml", "--from", "contest/bench_reach.toml"]) == 2
    source = shipped_examples()["contest/bench_reach.toml"]
    assert main(["new", "run", "mine.toml", "--from", str(source)]) == 0
    made = read_run(tmp_path / "mine.toml")
    assert (made.name, made.task.name) == ("mine", "reach")


def test_a_folder_of_examples_is_copied_by_its_name(tmp_path):
    assert main(["examples", "notebooks", "survey", "--out", "mine", "-q"]) == 0
    kept = {path.relative_to(tmp_path / "mine").as_posix() for path in tmp_path.rglob("mine/*/*")}
    wanted = {place for place in shipped_examples() if place.startswith("notebooks/")}
    assert len(wanted) > 5
    assert kept == {*wanted, "imports/survey.gpkg"}


@pytest.mark.parametrize("name", ["grid_explorer_levels", "plain_vine"])
def test_a_design_of_levels_is_written_branch_by_branch(name, capsys):
    assert main(["new", "design", "free.toml", "--from", name, "--branches"]) == 0
    free, levels = Design.read("free.toml"), Design.read(name)
    assert (free.name, free.levels, free.origin) == ("free", (), levels.origin)
    assert free.tree.key == levels.tree.key
    assert main(["new", "design", "free.toml", "--from", name, "--branches"]) == 0
    assert "left as it is" in capsys.readouterr().out


LINES = "x1,y1,x2,y2,width\n0,0,0,100,30\n0,100,40,180,\n# left\n-60,160,0,100,15\n"


def test_a_skeleton_of_comma_separated_lines_is_a_design(tmp_path):
    (tmp_path / "lines.csv").write_text(LINES)
    assert main(["new", "design", "drawn.toml", "--skeleton", "lines.csv"]) == 0
    drawn = Design.read("drawn.toml")
    assert (drawn.name, drawn.names) == ("drawn", ("trunk", "0", "1"))
    assert drawn.tree.width_mm.tolist() == [30.0, 18.0, 15.0]
    tip = ["--skeleton", "lines.csv", "--base=-60,160", "--trunk-width-mm", "20"]
    assert main(["new", "design", "tip.toml", *tip]) == 0
    assert Design.read("tip.toml").origin["drawn_at"] == [-60.0, 160.0, -45.0]
    assert Design.read("tip.toml").tree.width_mm[0] == 20.0


@pytest.mark.parametrize(
    ("text", "options", "message"),
    [
        (LINES, ["--base", "0,100"], "lines.csv: base: (0, 100) lies in the middle"),
        (LINES + "9,9,8,x\n", [], "lines.csv: line 6: '9,9,8,x' is not four finite numbers"),
        (LINES + "9,9,8,20,-1\n", [], "lines.csv: line 6: width is '-1'"),
        (LINES + "40,180,-60,160\n", [], "lines close a loop"),
        ("", [], "lines.csv: the table has no lines"),
        (LINES, ["--from", "plain_vine"], "--skeleton: a drawing makes a new design alone"),
        (LINES, ["--snap-mm", "0"], "snap"),
    ],
)
def test_a_skeleton_that_cannot_be_used_is_refused_in_one_line(
    text, options, message, tmp_path, capsys
):
    (tmp_path / "lines.csv").write_text(text)
    assert main(["new", "design", "drawn.toml", "--skeleton", "lines.csv", *options]) == 2
    said = capsys.readouterr().err
    assert message in said
    assert said.count("\n") == 1
    assert not (tmp_path / "drawn.toml").exists()


def test_the_starter_map_has_room_for_the_starter_design(capsys):
    assert main(["new", "map", "table.geojson", "-q"]) == 0
    assert main(["grow", "three_level_tree", "--map", "table.geojson"]) == 0
    assert "grown" in capsys.readouterr().out
    assert len(starter_map("table").obstacles) == 3


def test_the_program_says_how_to_cite_it(capsys):
    assert main(["-h"]) == 0
    assert "10.3389/frobt.2022.838913" in capsys.readouterr().out


def test_examples_are_listed_and_copied_and_never_overwrite_changes(tmp_path, capsys):
    assert main(["examples"]) == 0
    listed = capsys.readouterr().out
    assert "grid_coverage.toml: A run of" in listed
    assert "a robot of bench size that can be cut\n" in listed  # whole, from two lines of its file
    assert main(["examples", "grid_coverage", "--out", "mine"]) == 0
    copied = tmp_path / "mine" / "grid_coverage.toml"
    assert read_run(copied).name == "grid_coverage"
    copied.write_text(copied.read_text() + "# mine\n")
    assert main(["examples", "--out", "mine"]) == 2
    assert copied.read_text().endswith("# mine\n")
    assert len(list((tmp_path / "mine").iterdir())) == 1
    assert main(["examples", "no_such", "--out", "mine"]) == 2


def test_every_rule_is_explained_with_a_remedy(capsys):
    assert main(["rules", "--json", "-"]) == 0
    listed = json.loads(capsys.readouterr().out)["rules"]
    assert [rule["id"] for rule in listed] == list(RULES)
    assert all(rule["remedy"] and rule["reason"] for rule in listed)
    assert main(["rules"]) == 0
    text = capsys.readouterr().out
    assert all(text.count(f"  {rule}  ") == 1 for rule in RULES)
    assert main(["rules", "vf-c01"]) == 0
    explained = capsys.readouterr().out
    for words in (
        "VF-C01: enough film",
        "broken: too little",
        "remedy: ",
        "limit error: 0 mm",
        "VF-C01.error=",
        "waive",
    ):
        assert words in explained
    page = Path(__file__).parents[2] / explained.partition("picture: ")[2].split()[0]
    assert "### VF-C01" in page.read_text(encoding="utf-8")
    assert main(["rules", "VF-C99"]) == 2
    assert main(["rules", "P03"]) == 0
    assert capsys.readouterr().out.startswith("VF-P03: ")
    assert main(["rules", "Pressure"]) == 0
    about = capsys.readouterr().out
    assert about.count("\n  VF-") > 2
    assert "pressure" in about


def test_short_names_of_studies_work_and_are_not_listed(capsys):
    assert main(["-h"]) == 0
    listed = capsys.readouterr().out
    for name, whole in SHORT.items():
        assert f"\n  {name} " not in listed
        assert main([name, "-h"]) == 0
        own = capsys.readouterr().out
        assert main([*whole.split(), "--help"]) == 0
        assert capsys.readouterr().out == own
    shown = [name.split()[0] for name, verb in VERBS.items() if verb.listed]
    assert all(f"\n  {name} " in listed for name in shown)


@pytest.mark.parametrize(
    ("command", "given", "named"),
    [
        ("score", "x --maps a.json b.geojson -q", "x --maps a.json --maps b.geojson -q"),
        ("score", "--maps a.json b.geojson robot.toml", "robot.toml --maps=a.json --map b.geojson"),
        (
            "score",
            "m.json --target 1,2 B=-3,4+-5 -q",
            "m.json --target 1,2 --target B=-3,4+-5 -q",
        ),
        ("score", "--target A=1,2 -3,4 m.json", "m.json --target A=1,2 --target=-3,4"),
        (
            "check",
            "a.toml --map b.json c.json d.json",
            "--map=b.json --map=c.json --map=d.json a.toml",
        ),
        ("studio", "--map a.json b.json", "b.json --map a.json"),
    ],
)
def test_maps_as_a_shell_expands_them(command, given, named):
    understood = Command.named(command).understood
    assert understood(given.split()) == understood(named.split())


@pytest.mark.parametrize(
    ("given", "complaint"),
    [
        ("x.toml --json --out y.svg", "--json is without a value; for example: vinefab check "),
        ("x.toml --out", "--out is without a value; "),
        ("x.toml --out -- y.svg", "--out is without a value; "),
        ("x.toml --out -", "--out is without a value; "),
        ("x.toml -q --quiet", "--quiet is given twice; allowed: once"),
        ("x.toml --force=maybe", "--force is 'maybe'; allowed: true or false; "),
        ("x.toml y.toml", "one argument too many: y.toml; "),
        ("x.toml -- --map", "one argument too many: --map; "),
        ("x.toml --recip y", "there is no option --recip; did you mean --recipe?"),
        ("x.toml -xq", "there is no option -xq; vinefab check --help lists them"),
        ("--out y.svg", "DESIGN is missing; for example: vinefab check "),
    ],
)
def test_a_command_line_that_is_not_understood_is_one_line(given, complaint):
    with pytest.raises(UsageError) as caught:
        Command.named("check").understood(given.split())
    assert str(caught.value).startswith(complaint)


@pytest.mark.parametrize(
    ("given", "understood"),
    [
        ("-- -odd.toml", {"design": "-odd.toml"}),
        ("x.toml -qv --force=false", {"design": "x.toml", "quiet": True, "verbose": True}),
        ("--json - --design x.toml", {"design": "x.toml", "json": "-"}),
    ],
)
def test_a_command_line_that_is_understood(given, understood):
    assert Command.named("check").understood(given.split()) == {"force": False, **understood}


@pytest.mark.parametrize(
    ("typed", "completed"),
    [
        ("vinefab fabr", "fabricate"),
        ("vinefab check six_", "six_branch_anchor"),
        ("vinefab score plain_vine --tas", "--task"),
        ("vinefab score plain_vine --task rea", "reach"),
        ("vinefab map cor", "corridors"),
        ("vinefab map grid --col", "--columns"),
        ("vinefab check plain_vine --recipe co2_40", "co2_40w__stretchlon_200"),
        ("vinefab optimize grid_cov", "grid_coverage"),
    ],
)
def test_a_shell_completes_commands_options_and_names(typed, completed, capsys, monkeypatch):
    monkeypatch.setenv("_VINEFAB_COMPLETE", "1")
    assert main(typed.split(" ")[1:]) == 0
    printed = capsys.readouterr()
    assert completed in printed.out.splitlines()
    assert printed.err == ""


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_the_script_of_a_shell_is_printed_and_installed(shell, capsys, monkeypatch, tmp_path):
    monkeypatch.setenv("HOME", str(tmp_path))
    assert main(["--show-completion", shell]) == 0
    shown = capsys.readouterr().out
    assert "_VINEFAB_COMPLETE=1" in shown
    for _ in range(2):
        assert main(["--install-completion", shell]) == 0
    (path,) = [one for one in tmp_path.rglob("*vinefab*") if one.is_file()]
    assert path.read_text() == shown.removesuffix("\n")
    starts = [one for one in tmp_path.iterdir() if one.name in (".bashrc", ".zshrc")]
    assert all(one.read_text().count("\n") == 2 for one in starts)
