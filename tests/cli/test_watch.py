import os
import signal
import subprocess
import sys
import time

import pytest

import vinefab as vf
from vinefab.cli import watch
from vinefab.cli.main import main

SHORT = """\
schema = "vinefab/design-1"
name = "mine"
[trunk]
length = 120.0  # mm
[[level]]
branches = 2
length = 60.0
angle_deg = 90.0
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text(SHORT)
    vf.maps.grid(seed=3, columns=3, rows=3).write("grid.geojson")
    return tmp_path


def watched(monkeypatch, *edits) -> int:
    """Run the command; whenever it would wait for a change, the next edit is made."""
    left = list(edits)

    def pause(seconds):
        if seconds < watch.LOOK_EVERY_S:
            return
        if not left:
            raise KeyboardInterrupt
        left.pop(0)()

    monkeypatch.setattr(watch.time, "sleep", pause)
    return main(["watch", "mine.toml", "--map", "grid.geojson", "--out", "pictures"])


def test_once_says_what_grow_score_and_check_say(folder, capsys):
    assert main(["watch", "mine.toml", "--map", "grid.geojson", "--once"]) == 0
    said = capsys.readouterr().out
    design = vf.Design.read("mine.toml")
    score = vf.score(design, "coverage", maps=["grid.geojson"], poses=3)
    assert f"{score.composite['mean']:.4f} mean of 3 evaluations (simulated)" in said
    grown_mm = design.grow("grid.geojson").grown_mm.sum()
    assert f"{grown_mm:.1f} of 240.0 mm, 3 branches" in said
    report = vf.check(design, maps=["grid.geojson"])
    assert all(finding.message in said for finding in report.findings)
    assert all(skipped.rule in said for skipped in report.skipped)
    assert {path.name for path in (folder / "mine_watch").iterdir()} == {"grown.svg", "sheet.svg"}


def test_once_ends_with_1_where_an_error_forbids_cutting(folder):
    text = SHORT.replace("branches = 2", "branches = 9")
    (folder / "mine.toml").write_text(text)
    assert main(["watch", "mine.toml", "--map", "grid.geojson", "--once", "-q"]) == 1


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["no.toml"], "no.toml: there is no such file"),
        (["mine.toml", "--map", "no.geojson"], "no.geojson: there is no such file"),
        (["mine.toml", "--task", "covrage"], "did you mean 'coverage'"),
        (["mine.toml", "--growth", "bodi=inflated"], "bodi"),
        (["mine.toml", "--recipe", "nothing"], "nothing"),
    ],
)
def test_what_no_save_could_mend_ends_at_once(folder, capsys, arguments, says):
    given = ["--map", "grid.geojson", *arguments]
    assert main(["watch", *given]) == 2
    assert says in capsys.readouterr().err
    assert not list(folder.glob("*_watch"))


def test_every_save_says_what_changed(folder, monkeypatch, capsys):
    path = folder / "mine.toml"
    longer = SHORT.replace("length = 60.0", "length = 90.0").replace("branches = 2", "branches = 9")
    pictures: list[bytes] = []

    def save(text):
        pictures.append((folder / "pictures" / "grown.svg").read_bytes())
        path.write_text(text)

    def by_rename():
        (folder / "new.toml").write_text(SHORT)
        (folder / "new.toml").replace(path)

    edits = (
        lambda: save(longer),
        lambda: save("half a fi"),
        path.unlink,
        lambda: save(longer + "# a comment"),
        by_rename,
        lambda: vf.maps.grid(seed=4, columns=3, rows=3).write("grid.geojson"),
    )
    assert watched(monkeypatch, *edits) == 0
    said, errors = capsys.readouterr()
    assert errors == ""
    versions = said.split(" pictures in pictures (")
    assert len(versions) == 6
    first, grown, after_errors, back, on_other_map = (
        text.rpartition("\n")[0] for text in versions[1:]
    )
    assert "\n  + " not in first
    assert " was " not in first.replace("file was written", "")
    assert "was 240.0 of 240.0 mm, 3 branches" in grown
    assert "  + ERROR" in grown
    assert "mean of 3 evaluations (simulated): +" in grown or ": -" in grown
    assert "mine.toml: is not TOML" in grown
    assert "mine.toml: there is no such file" in grown
    assert " was " not in after_errors
    assert "  - ERROR" in back
    assert "coverage" in on_other_map
    assert said.endswith("no longer watching mine.toml\n")
    assert pictures[0] != pictures[1] == pictures[2]


def test_a_foreign_picture_is_left_alone(folder, capsys):
    (folder / "pictures").mkdir()
    (folder / "pictures" / "sheet.svg").write_text("mine")
    arguments = ["watch", "mine.toml", "--map", "grid.geojson", "--out", "pictures", "--once"]
    assert main(arguments) == 2
    assert "--force" in capsys.readouterr().err
    assert (folder / "pictures" / "sheet.svg").read_text() == "mine"


def test_a_real_watch_follows_the_editor_and_ends_with_ctrl_c(folder):
    said = folder / "said.txt"

    def wait_for(words: str, count: int = 1):
        end = time.monotonic() + 60
        while said.read_text().count(words) < count:
            assert time.monotonic() < end, said.read_text()
            assert process.poll() is None, said.read_text()
            time.sleep(0.05)

    with said.open("w") as stream:
        process = subprocess.Popen(
            [sys.executable, "-m", "vinefab", "watch", "mine.toml", "--map", "grid.geojson"],
            stdout=stream,
            stderr=subprocess.STDOUT,
            env={**os.environ, "PYTHONUNBUFFERED": "1"},
        )
    try:
        wait_for("rules  ")
        (folder / "mine.toml").write_text("[[")
        wait_for("is not TOML")
        (folder / "mine.toml").write_text(SHORT.replace("60.0", "61.0"))
        wait_for("rules  ", 2)
        process.send_signal(signal.SIGINT)
        assert process.wait(20) == 0
    finally:
        process.kill()
    assert said.read_text().endswith("no longer watching mine.toml\n")
    assert "Traceback" not in said.read_text()
