"""Each optional package, absent and present, by the program in a fresh process.

Within one process a test may have loaded before what a command has forgotten to load.
"""

import os
import subprocess
import sys
import tomllib
from itertools import chain
from pathlib import Path

import pytest

from tests.cli.conftest import QUICK, SMALL_GRID, run_with
from vinefab.core.extras import EXTRAS

ROOT = Path(__file__).parents[2]
EXAMPLES = ROOT / "examples"
RUN = run_with(
    maps={"options": SMALL_GRID},
    optimizer={"name": "cmaes", "generations": 1},
    evaluation=QUICK,
)
MARKED = {"--marker-mm": 30, "--height-mm": 30, "--obstacles": "50,84,176,75"}
COMMANDS = {
    "cluster": (
        ("distributed", "cryptography"),
        ["optimize", "run.toml", "--out", "run", "--cluster", "local:1", "--workers", "0"],
    ),
    "evolution": (("pymoo",), ["optimize", "front.toml", "--out", "run"]),
    "gis": (("pyogrio", "pyproj"), ["map", "import", EXAMPLES / "imports/survey.gpkg"]),
    "studies": (
        ("matplotlib",),
        ["study", "reproduce", "convergence", "--quick", "--out", "study"],
    ),
    "studio": (
        ("starlette", "tomlkit", "uvicorn", "watchfiles", "websockets"),
        ["studio", "plain_vine", "--snapshot", "page.html"],
    ),
    "vision": (("cv2",), ["map", "import", EXAMPLES / "arena/table.jpg", *chain(*MARKED.items())]),
}
"""By extra: the modules that it brings, and a command that needs them."""
OF_PYTHON = {"tables": ("pandas",)}
"""Extras that no command needs: `tests/pages/test_axes.py` asks for them."""
WITHOUT = """
import sys


class Without:
    def __init__(self, finder):
        self.finder = finder

    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {absent!r}:
            return None
        return self.finder.find_spec(name, path, target)

    def __getattr__(self, name):
        return getattr(self.finder, name)


sys.meta_path[:] = [Without(finder) for finder in sys.meta_path]
"""


def run_program(folder, arguments, absent=()):
    """Run the program in a folder, as if modules were not installed."""
    place = folder / "site"
    place.mkdir()
    (place / "sitecustomize.py").write_text(WITHOUT.replace("{absent!r}", repr(set(absent))))
    (folder / "run.toml").write_text(RUN)
    (folder / "front.toml").write_text(RUN.replace('"cmaes"', '"nsga2"'))
    out = ["--out", folder / "map.geojson"] if arguments[0] == "map" else []
    return subprocess.run(
        [sys.executable, "-m", "vinefab", *map(str, [*arguments, *out])],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(place)},
        capture_output=True,
        text=True,
        encoding="utf-8",
        timeout=300,
        check=False,
    )


def test_every_extra_for_users_is_declared_once_and_has_a_command_here():
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    extras = set(declared["optional-dependencies"]) - {"dev", "docs"}
    assert extras == set(COMMANDS) | set(OF_PYTHON) == set(EXTRAS)
    assert {extra: modules for extra, (modules, _) in COMMANDS.items()} | OF_PYTHON == EXTRAS


@pytest.mark.parametrize(
    "each", [False, pytest.param(True, marks=pytest.mark.thorough)], ids=["all", "each"]
)
@pytest.mark.parametrize("extra", COMMANDS)
def test_without_an_extra_the_command_names_it_in_one_line(extra, each, tmp_path):
    modules, arguments = COMMANDS[extra]
    for number, absent in enumerate([{one} for one in modules] if each else [{*modules}]):
        folder = tmp_path / str(number)
        folder.mkdir()
        ended = run_program(folder, arguments, absent)
        assert (ended.returncode, ended.stderr.count("\n")) == (2, 1), ended.stderr
        assert f"pip install 'vinefab[{extra}]'" in ended.stderr
        assert {path.name for path in folder.iterdir()} == {"site", "run.toml", "front.toml"}


@pytest.mark.parametrize("extra", COMMANDS)
def test_with_an_extra_its_command_works_in_a_fresh_process(extra, tmp_path):
    ended = run_program(tmp_path, COMMANDS[extra][1])
    assert ended.returncode == 0, ended.stderr
    if extra == "studies":
        page = (tmp_path / "study" / "reproduction.html").read_text("utf-8")
        assert "data:image/svg+xml" in page
    if extra == "cluster":
        assert "handed out 2 of 2 batches" in ended.stdout


def test_a_studio_is_served_by_a_fresh_process(tmp_path):
    place = {**os.environ, "HOME": str(tmp_path), "XDG_STATE_HOME": str(tmp_path)}
    with subprocess.Popen(
        [sys.executable, "-m", "vinefab", "studio", "plain_vine", "--no-browser"],
        cwd=tmp_path,
        env=place,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as program:
        line = program.stdout.readline()
        program.terminate()
    assert "http://127.0.0.1" in line
