"""Runs that cannot be or that find nothing: one line, an exit code, and nothing left or lost."""

import json
import os
import shlex
import shutil
import sqlite3

import numpy as np
import pytest

from vinefab.search.optimizers.optimizer import RandomSearch

HEAD = 'schema = "vinefab/run-1"\n'


def test_a_contest_leaves_an_unfinished_record_only_with_what_was_done(vinefab, tmp_path, run_file):
    bad = tmp_path / "bad.toml"
    bad.write_text(f"{HEAD}[build]\ntrunk_width_mm = 2.0\n")
    arguments = ["--optimizer", "random", "--seeds", 1, "--unseen", 1, "--poses", 1, "-q"]
    out = tmp_path / "out"
    code, _, complaint = vinefab("contest", run_file, bad, *arguments, "--out", out)
    assert code == 2
    assert f"{bad}: build.trunk_width_mm is 2.0" in complaint
    assert not out.exists()  # found before the first of the good ones was run
    assert vinefab("contest", run_file, *arguments, "--out", out)[0] == 0


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
    assert "optimizer random is 'points outside the space'" in complaint
    (row,) = json.loads(vinefab("runs", out, "--json", "-")[1])["runs"]
    assert row["generations"] == 2
    # Once it is fixed, the run continues.
    assert vinefab("optimize", run_file, "--out", out, "--resume", "-q")[0] == 0
    assert vinefab("optimize", run_file, "--out", tmp_path / "whole", "-q")[0] == 0
    assert (out / "best.toml").read_bytes() == (tmp_path / "whole" / "best.toml").read_bytes()


def test_damaged_records_are_named_and_kept(vinefab, run_file, tmp_path):
    """Bytes changed at random: read, or one line; never a traceback, never written to."""
    whole, out = tmp_path / "whole", tmp_path / "damaged"
    assert vinefab("optimize", run_file, "--out", whole, "-q", "--no-page")[0] == 0
    content = (whole / "run.sqlite").read_bytes()
    out.mkdir()
    rng, codes = np.random.default_rng(6), []
    for _ in range(60):
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
    assert 10 < sum(codes) < 60
