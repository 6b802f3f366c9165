"""Whatever foreign code does, a command ends with one line that names its package."""

import os
import subprocess
import sys

import pytest

from tests.cli.conftest import QUICK, SMALL_GRID, run_with
from vinefab.fabrication.formats.laser_formats import LASER_FORMATS
from vinefab.fabrication.rules.catalog import RULES
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.search.optimizers.optimizer import OPTIMIZERS
from vinefab.tasks import TASKS

PACKAGE = """
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from vinefab.fabrication.formats.laser_drawing import LaserFormat
from vinefab.fabrication.formats.svg_format import SVG
from vinefab.fabrication.rules.rule import Rule, RuleApplied, Violation
from vinefab.maps.generators.environments import Environment
from vinefab.maps.generators.grid import GridOptions, grid_map
from vinefab.search.optimizers.optimizer import RandomConfig, RandomSearch


@dataclass(frozen=True, slots=True, kw_only=True)
class Depth:
    name: ClassVar[str] = "depth"
    lowest: ClassVar[float] = 0.0

    def evaluate(self, deployment, context):
        print("printed")
        TASK
        return float(deployment.grown_mm.max()), {"branches": 1.0}


def make(seed, options):
    ENVIRONMENT
    return grid_map(seed, options)


def check(subject, limits):
    RULE
    return RuleApplied(checked=1)


class Search(RandomSearch):
    def ask(self):
        OPTIMIZER
        return super().ask()


class Dice(RandomConfig):
    def start(self, axes, population, seed):
        return Search(len(axes), population, seed)


YARD = Environment(description="their yard", options=GridOptions, make=make)
FEW = Rule(id="MY-F01", title="few", reason="ours", check=check)


def write(spec):
    FORMAT
    return SVG.write(spec)


THEIRS = LaserFormat(
    title="theirs", suffix=".theirs", write=write, read=SVG.read, tolerance_mm=0.001,
    paths=SVG.paths, contour=SVG.contour,
)
"""
POINTS = """[vinefab.tasks]
depth = their_parts:Depth
[vinefab.optimizers]
dice = their_parts:Dice
[vinefab.environments]
yard = their_parts:YARD
[vinefab.rules]
MY-F01 = their_parts:FEW
[vinefab.laser_formats]
theirs = their_parts:THEIRS
"""
RUN = run_with(
    maps={"environment": "yard", "options": SMALL_GRID},
    task={"name": "depth"},
    optimizer={"name": "dice"},
    evaluation=QUICK,
)
RAISES = (
    "1 / 0",
    "raise SystemExit(0)",
    "raise StopIteration",
    "raise GeneratorExit",
    "raise BaseException",
    "raise StopAsyncIteration",
    "raise MemoryError",
    "raise UnicodeDecodeError('utf-8', b'x', 0, 1, 'no')",
    "raise __import__('vinefab').ExportRefusedError('a', 'b')",
    "raise type('Odd', (Exception,), {'__str__': lambda self: 1 / 0})",
    "def f(): return f()\n        f()",
)
OPTIMIZE = ("optimize", "run.toml", "--out", "out", "-q", "--no-page")
PARTS = {
    "TASK": (
        "task 'depth'",
        OPTIMIZE,
        (
            "return float('nan'), {}",
            "return float('inf'), {}",
            "return None",
            "return 'text', {}",
            "return np.ones(2), {}",
            "return 1.0, None",
            "return 1.0, {'a': 'text'}",
            "return 1.0, {'a': float('nan')}",
            "return 1.0, {1: 1.0}",
            "return 1.0",
            "deployment.grown_mm[0] = 3.0",
            "deployment.points_mm[:] = 3.0",
            "context.edges_mm[0] = 3.0",
            "deployment.tree.level[0] = 3",
        ),
    ),
    "ENVIRONMENT": ("environment 'their yard'", OPTIMIZE, ("return None", "return 'map'")),
    "RULE": (
        "rule 'MY-F01'",
        ("check", "plain_vine"),
        (
            "return None",
            "return [Violation(message='a')]",
            "return RuleApplied(checked=1, violations=('text',))",
            "return RuleApplied(checked=1, violations=(Violation(measured=float('nan')),))",
            "return RuleApplied(checked=1, violations=(Violation(message=3),))",
            "return RuleApplied(checked=1, violations=(Violation(severity='error'),))",
        ),
    ),
    "OPTIMIZER": (
        "optimizer 'dice'",
        OPTIMIZE,
        ("return None", "return [[0.5]]", "return 'text'", "return {}"),
    ),
    "FORMAT": (
        "laser format 'theirs'",
        ("fabricate", "plain_vine", "--out", "out", "--allow-uncalibrated"),
        ("return None", "return b'bytes'", r"return '\ud800'"),
    ),
}
CASES = [(part, case) for part, (_, _, returned) in PARTS.items() for case in (*RAISES, *returned)]


def write_package(folder, **broken):
    """Write a package with parts, of which some are broken."""
    facts = folder / "site" / "theirs-1.0.dist-info"
    facts.mkdir(parents=True, exist_ok=True)
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (facts / "entry_points.txt").write_text(POINTS)
    code = PACKAGE
    for part in PARTS:
        indent = "        " if part in ("TASK", "OPTIMIZER") else "    "
        lines = broken.get(part, "pass").split("\n        ")
        code = code.replace(f"{indent}{part}\n", indent + f"\n{indent}".join(lines) + "\n")
    (folder / "site" / "their_parts.py").write_text(code)
    (folder / "run.toml").write_text(RUN)
    return folder / "site"


@pytest.mark.parametrize(("part", "case"), CASES)
def test_everything_that_foreign_code_does_is_one_line_that_names_its_package(
    part, case, vinefab, tmp_path, monkeypatch
):
    monkeypatch.syspath_prepend(write_package(tmp_path, **{part: case}))
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "their_parts", raising=False)
    for registry in (TASKS, OPTIMIZERS, ENVIRONMENTS, RULES, LASER_FORMATS):
        monkeypatch.setattr(registry, "_group", f"vinefab.{registry.kind}s".replace(" ", "_"))
        monkeypatch.setattr(registry, "_parts", dict(registry))
        monkeypatch.setattr(registry, "broken", {})
        monkeypatch.setattr(registry, "packages", {})
    name, command, _ = PARTS[part]
    code, words, complaint = vinefab(*command)
    said = [line for line in complaint.splitlines() if line != "printed"]
    assert (code, words, len(said)) == (2, "", 1), complaint
    assert "package theirs breaks down" in said[0]
    assert name in said[0]
    assert not (tmp_path / "out" / "best.toml").exists()


def run(folder, *more):
    return subprocess.run(
        [sys.executable, "-m", "vinefab", *OPTIMIZE, *more],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(folder / "site")},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )


THREADS, CLUSTER = ("--workers", "2"), ("--cluster", "local:2", "--workers", "0")


@pytest.mark.parametrize(
    ("case", "more"),
    [
        ("1 / 0", THREADS),
        pytest.param("raise SystemExit(0)", THREADS, marks=pytest.mark.thorough),
        pytest.param("return float('nan'), {}", THREADS, marks=pytest.mark.thorough),
        pytest.param("1 / 0", CLUSTER, marks=pytest.mark.thorough),
        ("raise SystemExit(0)", CLUSTER),
        pytest.param("return float('nan'), {}", CLUSTER, marks=pytest.mark.thorough),
    ],
)
def test_a_task_breaks_down_in_threads_and_on_a_cluster_as_it_does_here(tmp_path, case, more):
    write_package(tmp_path, TASK=case)
    ended = run(tmp_path, *more)
    said = [line for line in ended.stderr.splitlines() if line != "printed"]
    assert (ended.returncode, len(said)) == (2, 1), ended.stderr
    assert "plug-in task 'depth' of package theirs breaks down" in said[0]
    assert not (tmp_path / "out" / "best.toml").exists()


def test_the_same_package_works_where_nothing_is_broken(tmp_path):
    write_package(tmp_path)
    ended = run(tmp_path)
    assert (ended.returncode, ended.stdout) == (0, "")
    assert (tmp_path / "out" / "best.toml").exists()
