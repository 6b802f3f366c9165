"""Many seeds as a job array: the recipe itself, its tasks as plain processes, and the merging."""

import json
import os
import sqlite3
import subprocess
import sys
import time
from contextlib import closing
from pathlib import Path

import pytest

from vinefab.maps.generators.grid import grid_map
from vinefab.model.map import map_text
from vinefab.prediction.run_winner import UNSEEN_DEPLOYMENTS

RECIPE = Path(__file__).parents[2] / "examples" / "seeds.sbatch"
RUN = """schema = "vinefab/run-1"
name = "array"
[maps]
files = ["map.geojson"] # its winners are predicted on it, which is quick
[optimizer]
population = 8
generations = 200
[evaluation]
fabricable = false
finalists_by = "training"
finalists = 2
final_poses_per_map = 1
"""


@pytest.fixture
def task(tmp_path):
    """Return a function that starts the recipe's task of a seed as SLURM would."""
    (tmp_path / "run.toml").write_text(RUN)
    (tmp_path / "map.geojson").write_text(map_text(grid_map(1)))
    program = tmp_path / "bin" / "vinefab"
    program.parent.mkdir()
    program.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m vinefab "$@"\n')
    program.chmod(0o755)

    def start(seed, **settings):
        place = {
            **os.environ,
            "PATH": f"{program.parent}{os.pathsep}{os.environ['PATH']}",
            "PYTHONPATH": os.pathsep.join([str(RECIPE.parents[1]), *sys.path]),
            "SLURM_ARRAY_TASK_ID": str(seed),
            **settings,
        }
        return subprocess.Popen(
            ["bash", RECIPE], cwd=tmp_path, env=place, stdout=subprocess.DEVNULL
        )

    return start


def generations(record):
    """Return how many generations a run has recorded so far."""
    try:
        with closing(sqlite3.connect(f"file:{record}?mode=ro", uri=True)) as connection:
            return int(connection.execute("SELECT COUNT(*) FROM generation").fetchone()[0])
    except sqlite3.OperationalError:  # not there yet
        return 0


@pytest.mark.thorough
def test_tasks_of_an_array_are_merged_and_a_killed_one_goes_on(
    vinefab, task, tmp_path, monkeypatch
):
    runs, later = tmp_path / "runs", tmp_path / "later"
    tasks = {1: task(1), 2: task(2, RUNS="later")}
    folders = {1: runs / "seed_1", 2: later / "seed_2"}
    while not generations(folders[2] / "run.sqlite"):
        assert tasks[2].poll() is None
        time.sleep(0.005)
    tasks[2].kill()
    assert (tasks[2].wait(60), tasks[1].wait(60)) == (-9, 0)
    assert 0 < generations(folders[2] / "run.sqlite") < 200

    best = tmp_path / "best.toml"
    code, words, _ = vinefab("runs", runs, later, "--best", best)
    assert code == 1
    assert "  1 of 2 " in words
    assert "of the runs that have ended" in words
    assert best.read_bytes() == (folders[1] / "best.toml").read_bytes()

    assert task(2, RUNS="later", SLURM_CPUS_PER_TASK="2").wait(60) == 0
    # The undisturbed one is run here, and tried from as many poses as those in their processes.
    monkeypatch.setattr("vinefab.prediction.run_winner.UNSEEN_DEPLOYMENTS", UNSEEN_DEPLOYMENTS)
    other = tmp_path / "other"
    code, _, complaint = vinefab(
        "optimize", tmp_path / "run.toml", "--seed", 2, "--out", other, "--no-page", "-q"
    )
    assert (code, complaint) == (0, "")
    found = (folders[2] / "best.toml").read_bytes()
    assert found == (other / "best.toml").read_bytes()
    code, output, _ = vinefab("runs", runs, later, "--best", best, "--json", "-")
    (seeds,) = json.loads(output)["seeds"]
    assert (code, seeds["seeds"], seeds["unended"]) == (0, [1, 2], [])
    assert best.read_bytes() == (folders[seeds["best_seed"]] / "best.toml").read_bytes()
    # The same run in another folder is no further seed.
    code, output, _ = vinefab("runs", runs, later, other, "--json", "-")
    (more,) = json.loads(output)["seeds"]
    assert (more["seeds"], more["mean"]) == (seeds["seeds"], seeds["mean"])


@pytest.mark.thorough
def test_mean_and_deviation_over_seeds(vinefab, run_file, tmp_path):
    for seed in (1, 2, 3):
        out = tmp_path / "runs" / f"seed_{seed}"
        assert vinefab("optimize", run_file, "--seed", seed, "--out", out, "-q")[0] == 0
    code, output, words = vinefab("runs", tmp_path / "runs", "--json", "-")
    document = json.loads(output)
    scores = {row["seed"]: row["winner_score"]["mean"] for row in document["runs"]}
    (seeds,) = document["seeds"]
    mean = sum(scores.values()) / 3
    spread = (sum((score - mean) ** 2 for score in scores.values()) / 2) ** 0.5
    assert code == 0
    assert seeds["mean"] == pytest.approx(mean)
    assert seeds["deviation"] == pytest.approx(spread)
    assert (seeds["lowest"], seeds["highest"]) == (min(scores.values()), max(scores.values()))
    fitness = {row["seed"]: row["winner_fitness"] for row in document["runs"]}
    assert fitness[seeds["best_seed"]] == max(fitness.values())
    assert seeds["manufacturable"] == sum(row["manufacturable"] for row in document["runs"])
    (line,) = [line for line in words.splitlines() if "  3 of 3 " in line]
    assert {f"{mean:.4f}", f"{spread:.4f}"} <= set(line.split())


def test_the_seed_of_the_command_line_is_that_of_the_record(vinefab, run_file, tmp_path):
    out = tmp_path / "run"
    assert vinefab("optimize", run_file, "--seed", 7, "--out", out, "-q")[0] == 0
    assert "seed = 7" in (out / "best.toml").read_text()
    code, _, complaint = vinefab("optimize", run_file, "--out", out, "--resume")
    assert (code, complaint.count("\n")) == (2, 1)
    assert "optimizer.seed: 1 is asked for, and the run began with 7" in complaint
    code, _, complaint = vinefab("optimize", run_file, "--seed", 2**63, "--out", out)
    assert (code, complaint.count("\n")) == (2, 1)
    assert "seed is 9223372036854775808" in complaint


def test_what_cannot_be_merged_is_refused(vinefab, run_file, tmp_path):
    one, two, best = tmp_path / "one", tmp_path / "two", tmp_path / "best.toml"
    other = tmp_path / "other.toml"
    other.write_text(run_file.read_text().replace("generations = 2", "generations = 3"))
    assert vinefab("optimize", run_file, "--out", one, "-q")[0] == 0
    assert vinefab("optimize", other, "--out", two, "-q")[0] == 0
    code, _, complaint = vinefab("runs", one, two, "--best", best)
    assert (code, complaint.count("\n")) == (2, 1)
    assert "--best: these are 2 kinds of runs; name folders whose runs differ" in complaint
    code, _, complaint = vinefab("runs", one, two, "--rebuild", tmp_path / "again")
    assert code == 2
    assert "--rebuild: 2 folders are given" in complaint
    best.write_text("mine")
    code, _, complaint = vinefab("runs", one, "--best", best)
    assert code == 2
    assert best.read_text() == "mine"
