import json
import sqlite3

import pytest


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
