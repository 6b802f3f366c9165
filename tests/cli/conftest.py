"""Commands run as a user runs them, in this process."""

import json
import tomllib

import pytest
import tomlkit

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
SMALL_GRID = {"size_mm": 250.0, "columns": 3, "rows": 3}
QUICK = {"fabricable": False, "finalists": 1, "finalists_by": "training"}
"""Of a run whose winner does not matter."""


def run_with(**tables):
    """Return the text of the small run with other values in its tables."""
    content = tomllib.loads(RUN)
    for name, values in tables.items():
        content[name] = content.get(name, {}) | values
    return tomlkit.dumps(content)


@pytest.fixture(autouse=True)
def no_lines_of_progress(monkeypatch):
    """A slow machine must not add lines to what commands say."""
    monkeypatch.setattr("vinefab.core.progress.FIRST_S", 1e6)


@pytest.fixture(autouse=True, scope="module")
def few_unseen_maps():
    """A run's winner is chosen and tried on few maps: seventy take longer than a run here."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("vinefab.prediction.run_winner.UNSEEN_DEPLOYMENTS", 3)
        patch.setattr("vinefab.search.run.FRESH_MAPS", 2)
        yield


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


@pytest.fixture(scope="session")
def seen():
    """What `vinefab observe --json` writes of two photos."""
    documents = []
    for number, angles in enumerate(((2.0, 4.0, 20.0), (3.0, 15.0, 30.0))):
        contacts = [
            {
                "x_mm": 1.0,
                "y_mm": 2.0,
                "wall": f"obstacle {place}",
                "angle_from_normal_deg": angle,
                "angle_error_deg": 1.0,
                "outcome": "stopped" if angle < 10.0 else "slid",
                "distance_mm": None if place == 2 else 13.0,
            }
            for place, angle in enumerate(angles)
        ]
        trunk = {"id": "1", "level": 1, "points_mm": [[0.0, 0.0], [0.0, 9.5]], "contacts": contacts}
        documents.append(
            {
                "schema": "vinefab/observation-1",
                "photo": f"photo_{number}.jpg",
                "map": "elsewhere.geojson",
                "design": "gone.toml",
                "pose": {"x_mm": 0.0, "y_mm": 0.0, "heading_deg": 90.0},
                "film": {"how": "by colour", "width_mm": None},
                "branches": [{**trunk, "width_mm": {"measured": 26.0, "nominal": 25.0}}],
            }
        )
    return documents
