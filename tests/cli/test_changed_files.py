"""What a person changed in a file that a command wrote is never lost without ``--force``."""

from pathlib import Path

import pytest

from tests.cli.conftest import PLAIN

COMMANDS = {
    "map": ("map grid --columns 3 --rows 3 --size 300 --out", "out.geojson"),
    "svg": ("grow plain.toml --map grid.geojson --svg", "out.svg"),
    "gif": ("grow plain.toml --map grid.geojson --frames 2 --animate", "out.gif"),
    "json": ("grow plain.toml --map grid.geojson --json", "out.json"),
    "report": ("report plain.toml --maps grid.geojson --poses 1 --out", "out.html"),
    "fix": ("fix short.toml --out", "out.toml"),
    "zip": ("fabricate plain.toml --allow-uncalibrated --zip --out", "out"),
    "resume": ("optimize tiny.toml --no-page --resume --out", "run"),
    "best": ("runs run --best", "out.toml"),
}
WRITTEN = {"zip": "out.zip", "resume": "run/best.toml"}


@pytest.fixture
def work(request, tmp_path, monkeypatch, vinefab, grid, plain, run_file):  # noqa: ARG001  make files
    monkeypatch.chdir(tmp_path)
    Path("short.toml").write_text(PLAIN + "[build]\ntail_mm = 100.0\n")
    if any(word in request.node.name for word in ("resume", "best", "runs_write")):
        assert vinefab("optimize", "tiny.toml", "--no-page", "--out", "run", "-q")[0] == 0


@pytest.mark.usefixtures("work")
@pytest.mark.parametrize("case", COMMANDS)
def test_a_changed_file_is_kept(vinefab, case):
    words, out = COMMANDS[case]
    path = Path(WRITTEN.get(case, out))
    command = [*words.split(), out]
    assert vinefab(*command)[0] in (0, 1)
    whole = path.read_bytes()
    assert vinefab(*command)[0] in (0, 1)
    assert path.read_bytes() == whole
    changed = whole + b"\n"
    path.write_bytes(changed)
    code, _, complaint = vinefab(*command)
    assert (code, complaint.count("\n")) == (2, 1)
    assert f"{path}: was changed since vinefab wrote it; --force overwrites it" in complaint
    assert path.read_bytes() == changed
    assert vinefab(*command, "--force")[0] in (0, 1)
    assert path.read_bytes() == whole


LOOPS = [
    *(f"{words} loop{Path(out).suffix}" for words, out in COMMANDS.values()),
    "aim plain.toml --map grid.geojson --out loop.svg",
    "compare plain.toml narrow.toml --maps grid.geojson --out loop.html",
    "coupon --out loop",
    "demo --out loop",
    "examples --out loop",
    "map info grid.geojson --svg loop.svg",
    "map start grid.geojson --start left --out loop.geojson",
    "new design loop.toml",
    "study reproduce convergence --out loop",
    "rig grid.geojson --out loop",
    "runs run --rebuild loop",
    "score plain.toml --maps grid.geojson --json loop.json",
    "studio plain.toml --map grid.geojson --snapshot loop.html",
]


@pytest.mark.usefixtures("work")
def test_a_loop_of_links_is_refused_in_one_line_by_all_that_runs_write_in(vinefab):
    for words in LOOPS:
        loop = Path(words.split()[-1])
        if not loop.is_symlink():
            loop.symlink_to(loop)
        code, _, complaint = vinefab(*words.split())
        assert (code, complaint.count("\n")) == (2, 1), (words, complaint)
        assert str(loop) in complaint
        assert loop.is_symlink()
