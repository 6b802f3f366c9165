"""Commands run as a user runs them, in this process."""

import json

import pytest

from vinefab.cli.main import main

PLAIN = 'schema = "vinefab/design-1"\nname = "plain"\n[trunk]\nlength = 120.0\n'
RUN = """schema = "vinefab/run-1"
name = "tiny"
[maps]
count = 1
[space]
levels = [2, 2]
branches = [2, 2]
[build]
trunk_width_mm = 20.0
[optimizer]
population = 4
generations = 2
[evaluation]
finalists = 2
final_poses_per_map = 1
"""


@pytest.fixture(autouse=True)
def no_lines_of_progress(monkeypatch):
    """A slow machine must not add lines to what commands say."""
    monkeypatch.setattr("vinefab.core.progress_lines.FIRST_S", 1e6)


@pytest.fixture(autouse=True)
def few_unseen_maps(monkeypatch):
    """A run's winner is chosen and tried on few maps: seventy take longer than a run here."""
    monkeypatch.setattr("vinefab.prediction.run_winner.UNSEEN_DEPLOYMENTS", 3)
    monkeypatch.setattr("vinefab.search.run.FRESH_MAPS", 2)


@pytest.fixture
def vinefab(capsys):
    """Return a function that runs a command line: (exit code, output, complaints)."""

    def run(*arguments):
        code = main([str(argument) for argument in arguments])
        captured = capsys.readouterr()
        return code, captured.out, captured.err

    return run


@pytest.fixture
def grid(tmp_path, vinefab):
    """A small Grid map in a file."""
    path = tmp_path / "grid.geojson"
    code, _, complaint = vinefab(
        "map", "grid", "--columns", 3, "--rows", 3, "--size", 300, "--out", path, "-q"
    )
    assert (code, complaint) == (0, "")
    return path


@pytest.fixture
def plain(tmp_path):
    """A plain vine in a file."""
    path = tmp_path / "plain.toml"
    path.write_text(PLAIN)
    return path


@pytest.fixture
def run_file(tmp_path):
    """A run of the optimizer that takes a second."""
    path = tmp_path / "tiny.toml"
    path.write_text(RUN)
    return path


@pytest.fixture
def edited(tmp_path):
    """Return a function that changes a map file by a function of its document."""

    def edit(path, change):
        document = json.loads(path.read_text())
        change(document)
        target = tmp_path / "edited.geojson"
        target.write_text(json.dumps(document))
        return target

    return edit
