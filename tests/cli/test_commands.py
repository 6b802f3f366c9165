import json
import re
import shlex
import subprocess
import sys
import zipfile

import pytest

from vinefab import __version__
from vinefab.app.verbs import VERBS
from vinefab.cli.main import main
from vinefab.search.run import training_maps
from vinefab.search.settings import read_run


@pytest.mark.parametrize(
    "command", [[], *[name.split() for name in ("map", "study", *VERBS, "map grid")]]
)
def test_every_command_has_help_with_an_example(vinefab, command):
    code, output, _ = vinefab(*command, "--help")
    assert code == 0
    assert "Usage: vinefab" in output
    assert not command or f"vinefab {command[0]}" in output.split("Example:")[1]


def test_version(vinefab):
    assert vinefab("--version") == (0, f"vinefab {__version__}\n", "")


def test_quiet_says_nothing(vinefab, grid):
    assert vinefab("grow", "plain_vine", "--map", grid, "-q") == (0, "", "")


def test_score_takes_parameters(vinefab, grid):
    small = vinefab("score", "plain_vine", "--maps", grid, "--set", "radius_mm=5", "--json", "-")
    large = vinefab("score", "plain_vine", "--maps", grid, "--set", "radius_mm=90", "--json", "-")
    scores = [json.loads(text)["evaluations"][0]["score"] for _, text, _ in (small, large)]
    assert scores[0] < scores[1]


def test_fabricate_refuses_an_unconfirmed_recipe_unless_told(vinefab, tmp_path):
    out = tmp_path / "package"
    code, _, complaint = vinefab("fabricate", "three_level_tree", "--out", out)
    assert (code, "--allow-uncalibrated" in complaint) == (1, True)
    assert not out.exists()
    code, *_ = vinefab("fabricate", "plain_vine", "--out", out, "--allow-uncalibrated", "--zip")
    names = {path.name for path in out.iterdir()}
    assert (code, len(zipfile.ZipFile(tmp_path / "package.zip").namelist())) == (0, len(names))
    check = subprocess.run(
        ["sha256sum", "-c", "MANIFEST.sha256"], cwd=out, capture_output=True, check=False
    )
    assert check.returncode == 0


def test_optimize_leaves_a_record_and_a_design_that_grows(vinefab, run_file, grid, tmp_path):
    out = tmp_path / "run"
    code, words, complaint = vinefab("optimize", run_file, "--out", out)
    assert (code, complaint) == (0, "")
    assert "winner: tiny (" in words
    assert "\nfound tiny: coverage " in words
    assert f"wrote {out / 'index.html'}" in words
    assert "time: " not in words
    assert "the best design found" in (out / "index.html").read_text()
    assert vinefab("grow", out / "best.toml", "--map", grid, "-q")[0] == 0
    first = (out / "best.toml").read_bytes()
    code, words, complaint = vinefab("optimize", run_file, "--out", out)
    assert (code, complaint) == (0, "")
    assert words.startswith(f"{out} holds a run: if it is this one, it is continued")
    assert vinefab("optimize", run_file, "--out", out, "--resume", "-q") == (0, "", "")
    assert (out / "best.toml").read_bytes() == first
    code, _, complaint = vinefab("optimize", run_file, "--out", out, "--seed", 5)
    assert (code, complaint.count("\n")) == (2, 1)
    assert "optimizer.seed: 5 is asked for, and the run began with 1; give another run" in complaint
    assert (out / "best.toml").read_bytes() == first


def test_the_call_that_a_run_prints_gives_its_score_again(vinefab, run_file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    found = tmp_path / "found.json"
    code, words, _ = vinefab("optimize", run_file, "--out", "run", "--no-page", "--json", found)
    (line,) = [one for one in words.splitlines() if one.startswith("the score again: vinefab ")]
    assert code == 0
    for world in training_maps(read_run(run_file)):
        world.write(tmp_path / f"{world.name}.geojson")
    _, output, _ = vinefab(*shlex.split(line.partition(": vinefab ")[2]), "--json", "-")
    composite = json.loads(found.read_text())["composite"]
    assert json.loads(output)["composite"] == pytest.approx(composite, abs=2e-3)


def test_limits_of_a_run_are_raised_when_it_is_resumed(vinefab, run_file, tmp_path):
    out = tmp_path / "run"
    arguments = ("optimize", run_file, "--out", out, "--no-page")
    code, _, complaint = vinefab(*arguments, "--generations", 3)
    assert code == 2
    assert "--generations changes a run that is resumed" in complaint
    assert not out.exists()
    assert vinefab(*arguments, "-q") == (0, "", "")
    code, words, complaint = vinefab(*arguments, "--resume", "--generations", 3)
    assert (code, complaint) == (0, "")
    assert "evaluated: 12 designs in 3 generations" in words
    assert "generations 2 -> 3" in words
    assert not (out / "index.html").exists()
    code, _, complaint = vinefab(*arguments, "--resume", "--generations", 1)
    assert (code, complaint.count("\n")) == (2, 1)
    assert "at least the 3 that the run has" in complaint


@pytest.mark.thorough
def test_demo_at_its_smallest_writes_the_whole_chain(vinefab, tmp_path):
    out = tmp_path / "demo"
    code, words, complaint = vinefab("demo", "--out", out, "--generations", 6, "--population", 12)
    assert (code, complaint) == (0, "")
    for name in ("report.html", "run/best.toml", "package/README.txt", "rig/rig.json"):
        assert (out / name).stat().st_size > 0
        assert name.split("/")[0] in words
    drawn = [path.stat().st_size for path in (out / "package").rglob("outline.dxf")]
    assert min(drawn, default=0) > 0, "one for each sheet"
    assert "unseen maps" in words


LIGHT = {
    "--help": "",
    "check three_level_tree -q": "numba trimesh vinefab.growth.batch",
    "fabricate plain_vine --out o --allow-uncalibrated -q": "numba trimesh",
    "map import room.svg --scale-mm-per-unit 1 --out o.geojson -q": "numba vinefab.growth.terrain",
    # A few growths are over before compiled code would be loaded.
    "grow three_level_tree --map grid.geojson -q": "numba trimesh",
    "score three_level_tree --maps grid.geojson -q": "numba trimesh",
}
"""Lines, and modules that are not loaded for one of them, or for one before."""


@pytest.mark.usefixtures("grid")
def test_commands_load_what_they_need(tmp_path):
    svg = '<svg xmlns="http://www.w3.org/2000/svg"><rect width="400" height="300"/></svg>'
    (tmp_path / "room.svg").write_text(svg)
    script = (
        "import json, sys\n"
        "from vinefab.cli.main import main\n"
        "for line, unwanted in json.loads(sys.stdin.read()).items():\n"
        "    code = main(line.split())\n"
        "    found = sys.modules.keys() & {*unwanted.split()}\n"
        "    print(code, *found, file=sys.stderr)\n"
        "import vinefab.app.searching, vinefab.prediction.run_winner, vinefab.search.run\n"
        "print('matplotlib' in sys.modules, file=sys.stderr)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", script],
        input=json.dumps(LIGHT),
        cwd=tmp_path,
        capture_output=True,
        text=True,
        errors="replace",
        check=True,
    )
    assert done.stderr.splitlines() == ["0"] * len(LIGHT) + ["False"]


def test_interruption_leaves_what_was_there(monkeypatch, vinefab, tmp_path):
    out = tmp_path / "package"
    assert vinefab("fabricate", "plain_vine", "--out", out, "--allow-uncalibrated", "-q")[0] == 0
    before = {path.name: path.read_bytes() for path in out.iterdir()}

    def interrupted(*_args, **_kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr("vinefab.core.atomic._put", interrupted)
    code = main(["fabricate", "plain_vine", "--out", str(out), "--allow-uncalibrated", "-q"])
    assert code == 130
    assert {path.name: path.read_bytes() for path in out.iterdir()} == before
    assert [path.name for path in tmp_path.iterdir()] == ["package"]


@pytest.mark.thorough
def test_fabricate_nests_copies_and_other_designs_or_says_how_many_fit(vinefab, tmp_path):
    out = tmp_path / "sheet"
    code, _, _ = vinefab(
        "fabricate", "plain_vine", "--copies", "2", "--with", "six_branch_anchor",
        "--out", out, "--allow-uncalibrated",
    )  # fmt: skip
    assert code == 0
    facts = json.loads((out / "job.json").read_text())["facts"]
    assert [robot["design"] for robot in facts["robots"]].count("plain_vine") == 2
    code, text, _ = vinefab("fabricate", "plain_vine", "--copies", "13", "--out", tmp_path / "no")
    assert code == 1
    assert "of 13 robots find room" in text
    assert not (tmp_path / "no").exists()


def test_a_snapshot_of_the_studio_is_written_without_a_server(vinefab, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    command = ("studio", "plain_vine", "--environment", "pegs", "--snapshot")
    assert vinefab(*command, "one.html") == (0, "wrote one.html\n", "")
    one = (tmp_path / "one.html").read_bytes()
    stored = json.loads(re.search(rb'id="stored">(.*?)</script>', one, re.DOTALL)[1])
    assert set(stored["answers"]) == {"live", "cut", "rules"}
    assert stored["hello"]["state"]["map"]["source"] == {"environment": "pegs", "seed": 3}
