"""Parts of somebody else's package, installed beside vinefab."""

import json
import os
import subprocess
import sys

import pytest

import vinefab as vf
from tests.cli.conftest import SMALL_GRID, run_with
from vinefab.fabrication.rules.catalog import RULES
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.model.design import design_content
from vinefab.search.optimizers.optimizer import OPTIMIZERS
from vinefab.studio.live_answers import live_answer
from vinefab.studio.run_request import run_proposal
from vinefab.studio.state import StudioState
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
RUN = run_with(
    maps={"environment": "yard", "options": SMALL_GRID},
    task={"name": "depth"},
    space={"branches": [2, 4]},
    optimizer={"name": "dice", "population": 6},
)


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
    code, _, complaint = vinefab("check", "grid_explorer_levels")
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


MIDDLE = 15.5
"""The half-angle of reports and comparisons, degrees; scores take the one of the training."""

VERBS = {
    "score": (("score", "plain_vine"), "task", "depth"),
    "compare": (("compare", "plain_vine", "three_level_tree"), "measure", "task_score"),
    "report": (("report", "plain_vine", "--out", "page.html"), "task", "depth"),
    "aim": (("aim", "plain_vine", "--deployments", "5000", "--alone"), "task", "depth"),
}


@pytest.mark.usefixtures("their_package")
@pytest.mark.parametrize("verb", VERBS)
def test_every_verb_that_scores_takes_a_task_of_another_package(
    verb, vinefab, grid, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    words, key, value = VERBS[verb]
    more = ("--map", grid, "--task", "depth", "--set", "unit_mm=50", "--json", "found.json")
    code, _, complaint = vinefab(*words, *more, "-q")
    assert (code, complaint) == (0, "")
    found = json.loads((tmp_path / "found.json").read_text())
    assert found[key] == value
    middle = {"head_on_half_angle_deg": MIDDLE}
    scored = vf.score("plain_vine", "depth", maps=grid, unit_mm=50.0, **middle).composite["mean"]
    if verb == "report":
        assert found["fields"][0]["spread"]["task_score"]["mean"] == round(scored, 4)
        assert "plain_vine scores" in (tmp_path / "page.html").read_text()
        assert "on task depth" in (tmp_path / "page.html").read_text()
    if verb == "compare":
        spread = found["designs"]["plain_vine"]["task_score"]
        assert spread["mean"] == round(scored, 4)


@pytest.mark.usefixtures("their_package")
def test_a_report_is_about_the_task_of_the_run_that_another_package_offers(
    vinefab, run_file, grid, tmp_path
):
    run_file.write_text(f'{run_file.read_text()}[task]\nname = "depth"\nunit_mm = 50\n')
    assert vinefab("optimize", run_file, "--out", tmp_path / "run", "-q", "--no-page")[0] == 0
    best = tmp_path / "run/best.toml"
    found = vf.report(best, out=tmp_path / "page.html", maps=grid, progress=False)
    assert found.asked.key == "task_score"
    assert vf.Design.read(best).origin["task"] == "depth"
    scored = vf.score(best, maps=grid, head_on_half_angle_deg=MIDDLE)
    assert scored.task == "depth"
    assert found.main.outcomes.spread(found.asked).mean == pytest.approx(scored.composite["mean"])


class Grown:
    """A task of the user's own: no dataclass, and made with an argument."""

    name, lowest = "grown", 0.0

    def __init__(self, unit_mm):
        self.unit_mm = unit_mm

    def evaluate(self, deployment, _ground):
        return float(deployment.grown_mm.sum()) / self.unit_mm, {
            "tips": float(len(deployment.tree))
        }


def test_every_verb_that_scores_takes_a_task_as_an_object(grid, tmp_path):
    task, quiet = Grown(100.0), {"progress": False}
    scored = vf.score("grid_explorer_levels", task, maps=grid, head_on_half_angle_deg=MIDDLE)
    mean = scored.composite["mean"]
    assert mean > 0.1
    page = tmp_path / "page.html"
    report = vf.report("grid_explorer_levels", out=page, maps=grid, task=task, **quiet)
    assert report.numbers["task"] == "grown"
    assert report.main.outcomes.spread(report.asked).mean == pytest.approx(mean)
    assert f"scores {mean:.4f} on task grown" in page.read_text()
    both = vf.compare(["plain_vine", "grid_explorer_levels"], grid, task=task, **quiet)
    assert both.means["grid_explorer_levels"] == pytest.approx(mean)
    assert both.measure.key == "task_score"
    by_name = vf.compare(both.designs, grid, task=task, measure="task_score", **quiet)
    assert by_name.means == both.means
    seen = vf.compare(both.designs, grid, task=task, measure="seen_percent", **quiet)
    assert seen.measure.key == "seen_percent"
    aimed = vf.aim("grid_explorer_levels", grid, task, deployments=5000, alone=True, **quiet)
    assert aimed.task is task
    assert aimed.mean > mean


@pytest.mark.parametrize("verb", ["score", "report", "compare", "aim"])
def test_a_task_that_is_no_number_is_refused_wherever_it_is_taken(verb, grid, tmp_path):
    class Broken(Grown):
        def evaluate(self, _deployment, _ground):
            return float("nan"), {}

    task, quiet = Broken(1.0), {"progress": False}
    asked = {
        "score": lambda: vf.score("plain_vine", task, maps=grid),
        "report": lambda: vf.report("plain_vine", out=tmp_path / "r.html", maps=grid, task=task),
        "compare": lambda: vf.compare(["plain_vine"] * 2, grid, task=task, **quiet),
        "aim": lambda: vf.aim("plain_vine", grid, task, deployments=5000, alone=True, **quiet),
    }
    with pytest.raises(
        vf.VinefabError,
        match=r"task 'grown' of module .*test_plugins breaks down \(its score is nan",
    ):
        asked[verb]()
    assert not (tmp_path / "r.html").exists()


@pytest.mark.usefixtures("their_package")
def test_a_score_over_unseen_maps_is_that_of_the_comparison(vinefab, tmp_path):
    unseen = ("--environment", "yard", "--count", "3", "--seed", "4", "--set", "columns=3")
    out = ("--json", tmp_path / "score.json")
    angle = ("--head-on-half-angle-deg", MIDDLE)
    code, _, complaint = vinefab("score", "plain_vine", "--task", "depth", *unseen, *out, *angle)
    assert (code, complaint) == (0, "")
    score = json.loads((tmp_path / "score.json").read_text())
    out = ("--task", "depth", "--json", tmp_path / "both.json")
    assert vinefab("compare", "plain_vine", "grid_explorer_levels", *unseen, *out)[0] == 0
    both = json.loads((tmp_path / "both.json").read_text())
    assert len(score["evaluations"]) == 9
    assert both["maps"] == len({one["map"] for one in score["evaluations"]}) == 3
    mean = both["designs"]["plain_vine"]["task_score"]["mean"]
    assert mean == round(score["composite"]["mean"], 4)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("score", "plain_vine"), "--maps"),
        (
            (
                "compare",
                "plain_vine",
                "grid_explorer_levels",
                "--environment",
                "grid",
                "--set",
                "a=1",
            ),
            "a",
        ),
        (("score", "plain_vine", "--environment", "grid", "--set", "a=1"), "task.a"),
    ],
)
def test_a_parameter_of_neither_task_nor_environment_is_refused(words, said, vinefab):
    code, _, complaint = vinefab(*words)
    assert (code, complaint.count("\n")) == (2, 1)
    assert said in complaint


@pytest.mark.usefixtures("their_package")
def test_the_studio_offers_parts_of_other_packages():
    given = {"design": design_content(vf.Design.read("plain_vine"))}
    state = StudioState.of({**given, "map": {"source": {"environment": "yard"}, "edits": []}})
    proposal = run_proposal(state)
    assert "depth" in proposal["tasks"]
    assert "yard" in proposal["environments"]
    assert "dice" in proposal["optimizers"]
    scores = live_answer(state, {})["scores"]
    assert scores["depth"] > 0.0


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
