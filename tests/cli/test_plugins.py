"""Parts of somebody else's package, installed beside vinefab."""

import os
import subprocess
import sys

import pytest

from vinefab.fabrication.rules.catalog import RULES
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.search.optimizers.optimizer import OPTIMIZERS
from vinefab.tasks import TASKS

MODULE = """
from dataclasses import dataclass
from typing import ClassVar

from vinefab.fabrication.rules.rule import Rule, RuleApplied, Violation
from vinefab.maps.generators.grid import GridOptions, grid_map
from vinefab.maps.generators.environments import Environment
from vinefab.search.optimizers.optimizer import RandomConfig as Dice

YARD = Environment(description="their yard", options=GridOptions, make=grid_map)


def count(subject, limits):
    found = float(subject.design.branch_count)
    broken = limits.most(found)
    if broken is None:
        return RuleApplied(checked=1)
    violation = Violation(
        message="too many", severity=broken.severity, measured=found, limit=broken.limit
    )
    return RuleApplied(checked=1, violations=(violation,))


FEW = Rule(id="MY-F01", title="few branches", limits={"error": 4.0}, reason="ours", check=count)


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
dice = their_depth:Dice
[vinefab.environments]
yard = their_depth:YARD
[vinefab.rules]
MY-F01 = their_depth:FEW
MY-F02 = their_depth:FEW
MY-F03 = their_depth:YARD
MY-F04 = their_missing:RULE
"""
RUN = """schema = "vinefab/run-1"
[maps]
environment = "yard"
count = 1
options = { size_mm = 250.0, columns = 3, rows = 3 }
[task]
name = "depth"
[space]
levels = [2, 2]
branches = [2, 4]
[build]
trunk_width_mm = 20.0
[optimizer]
name = "dice"
population = 6
generations = 2
[evaluation]
finalists = 2
final_poses_per_map = 1
"""


@pytest.fixture
def their_package(tmp_path, monkeypatch):
    folder = tmp_path / "site"
    facts = folder / "theirs-1.0.dist-info"
    facts.mkdir(parents=True)
    (facts / "METADATA").write_text("Metadata-Version: 2.1\nName: theirs\nVersion: 1.0\n")
    (facts / "entry_points.txt").write_text(POINTS)
    (folder / "their_depth.py").write_text(MODULE)
    sys.modules.pop("their_depth", None)
    monkeypatch.syspath_prepend(folder)
    for registry in (TASKS, OPTIMIZERS, ENVIRONMENTS, RULES):
        group = f"vinefab.{registry.kind}s"
        monkeypatch.setattr(registry, "_group", group)
        monkeypatch.setattr(registry, "_parts", dict(registry))
        monkeypatch.setattr(registry, "broken", {})
        monkeypatch.setattr(registry, "packages", {})
    return folder


@pytest.mark.parametrize(
    "broken", ["0 / 0", "count(subject, limits)", "raise SystemExit(0)", "raise B"]
)
def test_a_rule_that_breaks_down_when_it_is_called_is_named(vinefab, their_package, broken):
    module = their_package / "their_depth.py"
    ends = MODULE.replace("    found = float", f"    {broken}\n    found = float")
    module.write_text(f"class B(BaseException):\n    pass\n{ends}")
    code, _, complaint = vinefab("check", "grid_explorer")
    assert (code, complaint.count("\n")) == (2, 1)
    assert "rule 'MY-F01' of package theirs" in complaint


@pytest.mark.usefixtures("their_package")
def test_a_run_is_optimized_for_a_task_of_another_package(vinefab, run_file, grid, tmp_path):
    text = run_file.read_text()
    run_file.write_text(f'{text}[task]\nname = "depth"\nunit_mm = 50\n')
    code, _, complaint = vinefab("optimize", run_file, "--out", tmp_path / "run", "-q")
    assert (code, complaint) == (0, "")
    code, words, _ = vinefab("score", tmp_path / "run/best.toml", "--task", "depth", "--maps", grid)
    assert code == 0
    assert "depth" in words
    assert "theirs 1.0" in (tmp_path / "run/best.toml").read_text()


@pytest.mark.usefixtures("their_package")
def test_a_run_that_goes_on_with_another_version_of_a_plugin_says_so(
    vinefab, their_package, tmp_path
):
    run_file, out = tmp_path / "theirs.toml", tmp_path / "run"
    run_file.write_text(RUN)
    assert vinefab("optimize", run_file, "--out", out, "-q", "--no-page")[0] == 0
    assert vinefab("check", out / "best.toml", "-q")[0] == 0  # the run asks their rule too
    facts = their_package / "theirs-1.0.dist-info" / "METADATA"
    facts.write_text(facts.read_text().replace("Version: 1.0", "Version: 1.1"))
    code, words, _ = vinefab("optimize", run_file, "--out", out, "--resume")
    assert code == 0
    assert "resumed with other package versions" in words
    assert "theirs 1.0 then, 1.1 now" in words


@pytest.mark.usefixtures("their_package")
def test_a_plugin_that_does_not_load_is_named_with_the_reason(vinefab, run_file, tmp_path):
    text = run_file.read_text().replace("[optimizer]", '[optimizer]\nname = "annealing"')
    run_file.write_text(text)
    code, _, complaint = vinefab("optimize", run_file, "--out", tmp_path / "run")
    assert code == 2
    assert "'annealing' does not load (ModuleNotFoundError" in complaint
    assert complaint.count("\n") == 1


@pytest.mark.usefixtures("their_package")
def test_a_rule_of_another_package_is_checked_and_a_broken_one_is_named(vinefab):
    code, words, _ = vinefab("check", "three_level_tree")
    assert code == 1
    assert "MY-F01" in words
    assert "(10, at most 4)" in words
    assert "MY-F02  does not load (its id is MY-F01, not the name of its entry point)" in words
    assert "MY-F03  does not load (is not a vinefab.fabrication.rules.rule.Rule)" in words
    assert "MY-F04  does not load (ModuleNotFoundError" in words
    assert vinefab("check", "three_level_tree", "--limit", "MY-F01.error=10")[0] == 0


@pytest.mark.parametrize(
    ("broken", "name"),
    [("raise RuntimeError", "RuntimeError"), ("raise SystemExit(0)", "SystemExit")],
)
@pytest.mark.parametrize(
    "arguments",
    [("check", "three_level_tree"), ("rules",), ("score", "plain_vine", "--task", "x", "--maps")],
)
def test_a_plugin_that_breaks_down_ends_every_command_that_loads_it(
    vinefab, their_package, grid, broken, name, arguments
):
    facts = their_package / "theirs-1.0.dist-info" / "entry_points.txt"
    facts.write_text("[vinefab.rules]\nX-1 = their_wild:R\n[vinefab.tasks]\nx = their_wild:T\n")
    (their_package / "their_wild.py").write_text(broken)
    maps = [grid] if "--maps" in arguments else []
    code, words, complaint = vinefab(*arguments, *maps)
    assert (code, words) == (2, "")
    assert complaint.count("\n") == 1
    assert "of package theirs (vinefab." in complaint
    assert f"their_wild:{'T' if 'x' in arguments else 'R'}) breaks down ({name}" in complaint


@pytest.mark.thorough
def test_parts_of_another_package_work_on_the_workers_of_a_cluster(their_package, tmp_path):
    run_file, out = tmp_path / "theirs.toml", tmp_path / "cluster"
    run_file.write_text(RUN)
    place = {**os.environ, "PYTHONPATH": str(their_package)}
    command = [sys.executable, "-m", "vinefab", "optimize", run_file, "-q", "--no-page", "--out"]
    handed_out = ["--cluster", "local:1", "--workers", "0"]  # else so small a run would stay here
    for more in ([out, *handed_out], [tmp_path / "threads"]):
        subprocess.run([*command, *more], check=True, env=place, timeout=240)
    found = (out / "best.toml").read_bytes()
    assert found == (tmp_path / "threads" / "best.toml").read_bytes()
    assert b'task = "depth"' in found
