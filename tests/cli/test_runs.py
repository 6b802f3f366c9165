"""Runs: what they say, what their folders hold, and what stops them."""

import json
import os
import shlex
import shutil
import sqlite3
import subprocess
import sys

import numpy as np
import pytest

from vinefab.search.optimizers.optimizer import RandomSearch
from vinefab.search.record.store import RunStore


@pytest.fixture
def ended(vinefab, run_file, tmp_path):
    """A run's folder."""
    out = tmp_path / "runs" / "first"
    code, _, complaint = vinefab("optimize", run_file, "--out", out, "--no-page", "-q")
    assert (code, complaint) == (0, "")
    return out


PARTS = ("loading", "evaluating", "optimizer", "store", "other")


def test_the_end_of_a_run_says_where_the_time_went(vinefab, run_file, tmp_path):
    code, output, words = vinefab(
        "optimize", run_file, "--out", tmp_path / "run", "--workers", 2, "--json", "-", "-v"
    )
    document = json.loads(output)
    assert code == 0
    assert document["schema"] == "vinefab/run-result-1"
    assert document["evaluations"] == 8
    times = document["times"]
    whole = sum(times["shares"][key] for key in PARTS)
    assert whole == pytest.approx(1.0)
    assert times["workers"] == 2
    assert 0.0 < times["growth_s"] + times["scoring_s"] <= times["processor_s"]
    assert "use of 2 workers while evaluating: growth" in words


def test_a_run_that_touches_nothing_says_why_at_its_end(vinefab, run_file, grid, tmp_path):
    document = json.loads(grid.read_text())
    corner = {"type": "Point", "coordinates": [5.0, 295.0]}
    target = {"role": "target", "name": "far", "tolerance_mm": 1}
    document["features"].append({"type": "Feature", "properties": target, "geometry": corner})
    grid.write_text(json.dumps(document))
    text = run_file.read_text().replace("count = 1", f"files = ['{grid}']")
    run_file.write_text(f'{text}[task]\nname = "reach"\n')
    code, output, words = vinefab("optimize", run_file, "--out", tmp_path / "run", "--json", "-")
    document = json.loads(output)
    lines = words.splitlines()
    assert code in {0, 1}
    assert document["composite"]["min_deviation"] == pytest.approx(0.75)
    (steady,) = [line for line in lines if line.startswith("min_deviation")]
    assert "0.75" not in steady.partition(",")[0]
    assert "so that to be steady is worth nothing" in steady
    (note,) = document["notes"]
    at = next(number for number, line in enumerate(lines) if note in line)
    assert lines[at].startswith("0 of 1 touched")  # the verdict again, and why
    assert at > lines.index(steady)


@pytest.mark.skipif(sys.platform == "win32", reason="Windows limits no file")
def test_a_limit_of_the_size_of_files_is_no_damage(run_file, tmp_path):
    command = [
        sys.executable,
        "-m",
        "vinefab",
        "optimize",
        run_file,
        "--out",
        tmp_path / "run",
        "-q",
    ]
    done = subprocess.run(
        ["sh", "-c", 'ulimit -f 8; exec "$@"', "sh", *command],
        capture_output=True, text=True, encoding="utf-8", errors="replace", check=False,
    )  # fmt: skip
    assert done.returncode == 2, done.stderr
    assert "the disk is full, or a file may not become so large (ulimit -f)" in done.stderr
    assert "damaged" not in done.stderr


def test_runs_are_listed_with_those_that_cannot_be_read(vinefab, ended, tmp_path):
    other = tmp_path / "runs" / "foreign"
    other.mkdir()
    connection = sqlite3.connect(other / "run.sqlite")
    connection.execute("CREATE TABLE theirs (a)")
    connection.close()
    code, output, words = vinefab("runs", tmp_path / "runs", "--json", "-")
    document = json.loads(output)
    assert code == 0
    assert document["schema"] == "vinefab/runs-1"
    (row,) = document["runs"]
    assert (row["name"], row["generations"], row["stopped"]) == ("tiny", 2, "generations")
    assert "not the record of a run" in document["broken"][0]
    assert f"{ended}  tiny (islands, seed 1, run {row['run']})  2/2 " in words
    assert "stopped by generations" in words


def test_a_record_alone_gives_the_files_again(vinefab, ended, tmp_path):
    best = (ended / "best.toml").read_bytes()
    again = tmp_path / "again"
    code, words, complaint = vinefab("runs", ended, "--rebuild", again)
    assert (code, complaint) == (0, "")
    assert (again / "best.toml").read_bytes() == best
    assert (again / "history.svg").read_bytes().startswith(b"<?xml")
    assert (again / "map_grid_1.svg").exists()
    assert "tiny: the best design found" in (again / "index.html").read_text()
    assert str(again / "best.toml") in words.replace("\n", "")


# --- Runs that cannot be or that find nothing: one line, an exit code, and nothing left or lost ---


HEAD = 'schema = "vinefab/run-1"\n'


def test_a_contest_leaves_an_unfinished_record_only_with_what_was_done(vinefab, tmp_path, run_file):
    bad = tmp_path / "bad.toml"
    bad.write_text(f"{HEAD}[build]\ntrunk_width_mm = 2.0\n")
    arguments = ["--optimizer", "random", "--seeds", 1, "--unseen", 1, "--poses", 1, "-q"]
    out = tmp_path / "out"
    code, _, complaint = vinefab("study", "contest", run_file, bad, *arguments, "--out", out)
    assert code == 2
    assert f"{bad}: build.trunk_width_mm is 2.0" in complaint
    assert not out.exists()  # found before the first of the good ones was run
    assert vinefab("study", "contest", run_file, *arguments, "--out", out)[0] == 0


@pytest.fixture
def hopeless(run_file):
    """A run whose four children are webbed together whatever a search does."""
    text = run_file.read_text().replace("branches = [2, 2]", "branches = [4, 4]")
    space = "angle_deg = [46, 60]\nlength_mm = [21, 30]\n[build]"
    run_file.write_text(text.replace("[build]", space))
    return run_file


def test_a_run_that_finds_no_robot_says_so_and_keeps_everything(vinefab, hopeless, tmp_path):
    out = tmp_path / "run"
    code, output, words = vinefab("optimize", hopeless, "--out", out, "--json", "-")
    assert code == 1
    (line,) = [line for line in words.split("\n") if "found no manufacturable robot" in line]
    assert "the winner violates VF-C03" in line
    assert "changes of the best 2: none is manufacturable" in words
    document = json.loads(output)
    assert document["fabricable"] is False
    assert "none is manufacturable" in document["repair"]
    assert vinefab("check", out / "best.toml")[0] == 1
    connection = sqlite3.connect(out / "run.sqlite")
    assert connection.execute("SELECT count(*) FROM generation").fetchone() == (2,)
    connection.close()
    best = (out / "best.toml").read_bytes()
    code, again, _ = vinefab("optimize", hopeless, "--out", out, "--resume", "--json", "-")
    assert code == 1
    assert json.loads(again)["repair"] == document["repair"]
    assert (out / "best.toml").read_bytes() == best


def test_a_full_disk_at_the_end_loses_nothing(vinefab, run_file, tmp_path, monkeypatch):
    out = tmp_path / "run"

    def full(_handle):
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(os, "fsync", full)
        code, _, complaint = vinefab("optimize", run_file, "--out", out)
    assert (code, complaint.count("\n")) == (2, 1)
    assert "best.toml: cannot be written: No space left on device; the run is complete" in complaint
    assert [path.name for path in out.iterdir()] == ["run.sqlite"]
    told = complaint.split("to write its files: ")[1]
    assert vinefab(*shlex.split(told)[1:])[0] == 0
    assert (out / "best.toml").exists()


def test_an_optimizer_that_proposes_nonsense_keeps_all_generations_before(
    vinefab, run_file, tmp_path, monkeypatch
):
    ask = RandomSearch.ask

    def stray(self):
        x = ask(self)
        return x if self.state()["generation"] < 2 else x * np.nan

    run_file.write_text(
        run_file.read_text()
        .replace("[optimizer]", '[optimizer]\nname = "random"')
        .replace("generations = 2", "generations = 4")
    )
    out = tmp_path / "run"
    with monkeypatch.context() as patch:
        patch.setattr(RandomSearch, "ask", stray)
        code, _, complaint = vinefab("optimize", run_file, "--out", out)
    assert (code, complaint.count("\n")) == (2, 1)
    assert "optimizer random: it asks for points outside the space" in complaint
    (row,) = json.loads(vinefab("runs", out, "--json", "-")[1])["runs"]
    assert row["generations"] == 2
    # Once it is fixed, the run continues.
    assert vinefab("optimize", run_file, "--out", out, "--resume", "-q")[0] == 0
    assert vinefab("optimize", run_file, "--out", tmp_path / "whole", "-q")[0] == 0
    assert (out / "best.toml").read_bytes() == (tmp_path / "whole" / "best.toml").read_bytes()


@pytest.mark.parametrize("times", [12, pytest.param(120, marks=pytest.mark.thorough)])
def test_damaged_records_are_named_and_kept(vinefab, run_file, tmp_path, times):
    """Bytes changed at random: read, or one line; never a traceback, never written to."""
    whole, out = tmp_path / "whole", tmp_path / "damaged"
    assert vinefab("optimize", run_file, "--out", whole, "-q", "--no-page")[0] == 0
    content = (whole / "run.sqlite").read_bytes()
    out.mkdir()
    rng, codes = np.random.default_rng(6), []
    for _ in range(times):
        damaged = np.frombuffer(content, dtype=np.uint8).copy()
        places = rng.integers(0, len(damaged), rng.integers(1, 6))
        damaged[places] = rng.integers(0, 256, len(places))
        (out / "run.sqlite").write_bytes(damaged.tobytes())
        code, words, complaint = vinefab("runs", out)
        codes.append(code)
        assert code == 0 or (code == 1 and "unreadable: " in words)
        again = ("optimize", run_file, "--out", out, "--resume", "-q", "--no-page")
        code, _, complaint = vinefab(*again)
        assert code in (0, 2)
        assert complaint.count("\n") == (code == 2)
        shutil.rmtree(out)
        out.mkdir()
    assert 0.2 * times < sum(codes) < times


# --- Optimizers compared --------------------------------------------------------------------------


def test_a_comparison_makes_a_table_and_a_figure(vinefab, run_file, tmp_path):
    out = tmp_path / "contest"
    arguments = (
        "study", "contest", run_file, "--optimizer", "random", "--optimizer", "pso:inertia=0.5",
        "--seeds", 1, "--unseen", 1, "--poses", 1, "--out", out,
    )  # fmt: skip
    code, words, complaint = vinefab(*arguments)
    assert (code, complaint) == (0, "")
    document = json.loads((out / "comparison.json").read_text())
    assert document["schema"] == "vinefab/comparison-1"
    assert [entry["optimizer"] for entry in document["table"]] == ["random", "pso:inertia=0.5"]
    assert (out / "comparison.svg").exists()
    assert "pso:inertia=0.5" in words
    assert "difference to random" in words
    assert "paired by seed" in words
    assert "1 seed: no interval" in words


# --- Fronts of several objectives -----------------------------------------------------------------


def test_optimize_writes_a_front_for_two_objectives(vinefab, run_file, tmp_path):
    text = run_file.read_text().replace(
        "[space]", '[task]\nname = "coverage"\nobjectives = ["coverage", "film_length"]\n[space]'
    )
    run_file.write_text(text)
    out = tmp_path / "front_run"
    out.mkdir()
    (out / "front.svg").write_text("mine")
    code, _, complaint = vinefab("optimize", run_file, "--out", out)
    assert code == 2
    assert "front.svg" in complaint
    assert not (out / "run.sqlite").exists()
    (out / "front.svg").unlink()
    code, words, _ = vinefab("optimize", run_file, "--out", out)
    assert code == 0
    assert "front of" in words
    document = json.loads((out / "front.json").read_text())
    for entry in document["designs"]:
        path = out / "front" / f"{entry['design']}.toml"
        assert vinefab("check", path)[0] == 0
    assert (out / "front.png").read_bytes().startswith(b"\x89PNG")


# --- Interrupted runs -----------------------------------------------------------------------------


def test_an_interrupted_run_says_how_to_go_on_and_does(monkeypatch, vinefab, run_file, tmp_path):
    out = tmp_path / "a run"
    add = RunStore.add

    def interrupted(*given):
        add(*given)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(RunStore, "add", interrupted)
        code, words, complaint = vinefab("optimize", run_file, "--out", out, "--workers", 2)
    assert (code, words) == (130, "")
    assert complaint.count("\n") == 1
    told = complaint.split("to resume: ")[1]
    assert "--workers 2" in told
    code, words, complaint = vinefab(*shlex.split(told)[1:])
    assert (code, complaint) == (0, "")
    assert "2 generations" in words
