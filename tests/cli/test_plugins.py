"""Parts of somebody else's package, installed beside vinefab."""

import pytest

from vinefab.optimize.registry import OPTIMIZERS
from vinefab.tasks.registry import TASKS

MODULE = """
from dataclasses import dataclass
from typing import ClassVar


@dataclass(frozen=True, slots=True, kw_only=True)
class Depth:
    name: ClassVar[str] = "depth"
    lowest: ClassVar[float] = 0.0

    unit_mm: float = 100.0

    def evaluate(self, deployment, ground):
        return float(deployment.grown_mm.max()) / self.unit_mm, {"branches": len(deployment.tree)}
"""
POINTS = """[vinefab.tasks]
depth = their_depth:Depth
[vinefab.optimizers]
annealing = their_annealing:Recipe
"""


@pytest.fixture
def their_package(tmp_path, monkeypatch):
    folder = tmp_path / "site"
    facts = folder / "theirs-1.0.dist-info"
    facts.mkdir(parents=True)
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (facts / "entry_points.txt").write_text(POINTS)
    (folder / "their_depth.py").write_text(MODULE)
    monkeypatch.syspath_prepend(folder)
    for registry, group in ((TASKS, "vinefab.tasks"), (OPTIMIZERS, "vinefab.optimizers")):
        monkeypatch.setattr(registry, "_group", group)
        monkeypatch.setattr(registry, "_parts", dict(registry))
        monkeypatch.setattr(registry, "broken", {})


@pytest.mark.usefixtures("their_package")
def test_a_run_is_optimized_for_a_task_of_another_package(vinefab, run_file, grid, tmp_path):
    text = run_file.read_text()
    run_file.write_text(f'{text}[task]\nname = "depth"\nunit_mm = 50\n')
    code, _, complaint = vinefab("optimize", run_file, "--out", tmp_path / "run", "-q")
    assert (code, complaint) == (0, "")
    code, words, _ = vinefab("score", tmp_path / "run/best.toml", "--task", "depth", "--maps", grid)
    assert code == 0
    assert "depth" in words


@pytest.mark.usefixtures("their_package")
def test_a_plugin_that_does_not_load_is_named_with_the_reason(vinefab, run_file, tmp_path):
    text = run_file.read_text().replace("[optimizer]", '[optimizer]\nname = "annealing"')
    run_file.write_text(text)
    code, _, complaint = vinefab("optimize", run_file, "--out", tmp_path / "run")
    assert code == 2
    assert "'annealing' does not load (ModuleNotFoundError" in complaint
    assert complaint.count("\n") == 1
