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
REFUSED = {
    "trunk too narrow to be made": "[build]\ntrunk_width_mm = 2.0\n",
    "population": "[optimizer]\npopulation = 3\n",
    "more maps than there are": "[evaluation]\nmaps_per_generation = 9\n",
    "no room": "[growth]\nbody = 'inflated'\n[build]\ntrunk_width_mm = 99.0\npressure_kpa = 2.0\n",
    "unknown task": "[task]\nname = 'covrage'\n",
    "unknown recipe": "[evaluation]\nrecipe = 'co3'\n",
    "no such map": "[maps]\nfiles = ['none.geojson']\n",
    "everything fixed": "[space]\nlevels = 1\nlength_mm = 100\n",
}


@pytest.mark.parametrize("text", REFUSED.values(), ids=REFUSED)
@pytest.mark.parametrize("command", ["optimize", "contest"])
def test_a_refused_run_leaves_no_folder(vinefab, tmp_path, command, text):
    run_file, out = tmp_path / "bad.toml", tmp_path / "deep" / "out"
    run_file.write_text(HEAD + text)
    more = ["--optimizer", "cmaes", "--seeds", 1] if command == "contest" else []
    code, _, complaint = vinefab(command, run_file, *more, "--out", out)
    assert code == 2
    assert complaint.count("\n") == 1
    assert str(tmp_path) in complaint or "co3" in complaint
    assert sorted(tmp_path.iterdir()) == [run_file]


@pytest.mark.parametrize(
    "address", ["tcp://127.0.0.1:9", "local:2000", "none.json", "dead.json", "other.json"]
)
def test_a_cluster_that_is_not_there_leaves_no_folder(
    vinefab, run_file, tmp_path, monkeypatch, address
):
    monkeypatch.setattr("vinefab.search.dask_cluster.CONNECT_S", 0.2)
    monkeypatch.chdir(tmp_path)
    (tmp_path / "dead.json").write_text('{"address": "tcp://127.0.0.1:9"}')
    (tmp_path / "other.json").write_text('{"place": "here"}')
    before = sorted(tmp_path.iterdir())
    out = tmp_path / "deep" / "out"
    code, _, complaint = vinefab("optimize", run_file, "--out", out, "--cluster", address)
    assert (code, complaint.count("\n")) == (2, 1)
    assert "--cluster is" in complaint
    assert sorted(tmp_path.iterdir()) == before


def test_a_result_that_may_not_be_written_is_refused_before_the_search(vinefab, run_file, tmp_path):
    thesis = tmp_path / "thesis.json"
    thesis.write_text("five years of work")
    before = sorted(tmp_path.iterdir())
    arguments = ("--out", tmp_path / "out", "--json", thesis)
    code, _, complaint = vinefab("optimize", run_file, *arguments)
    assert (code, complaint.count("\n")) == (2, 1)
    assert f"{thesis}: exists and was not written by vinefab" in complaint
    assert sorted(tmp_path.iterdir()) == before


def test_a_refused_demo_leaves_no_folder(vinefab, tmp_path):
    out = tmp_path / "deep" / "demo"
    code, _, complaint = vinefab("demo", "--out", out, "--population", 2, "-q")
    assert (code, complaint.count("\n")) == (2, 1)
    assert list(tmp_path.iterdir()) == []


def test_a_contest_leaves_an_unfinished_record_only_with_what_was_done(vinefab, tmp_path, run_file):
    bad = tmp_path / "bad.toml"
    bad.write_text(HEAD + REFUSED["trunk too narrow to be made"])
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
