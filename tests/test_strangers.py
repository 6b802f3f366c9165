"""What strangers meet first: workflow, hooks, forms, container. They repeat nothing of the gate."""

import json
import re
import shlex
import tomllib
from pathlib import Path

import pytest
import yaml

from vinefab.core import __version__

ROOT = Path(__file__).parents[1]
TARGETS = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))


def is_of_the_gate(command):
    """Whether a command line is `.ci/run` or a target of the Makefile, and nothing else."""
    match shlex.split(command):
        case [".ci/run"]:
            return (ROOT / ".ci/run").stat().st_mode & 0o100
        case ["make", target]:
            return target in TARGETS
    return False


def test_the_workflow_calls_what_anybody_calls():
    workflow = yaml.safe_load((ROOT / ".github/workflows/gate.yml").read_text())
    (job,) = workflow["jobs"].values()
    lines = [step["run"] for step in job["steps"] if "run" in step]
    assert lines == [".ci/run"]
    assert is_of_the_gate(*lines)


def test_hooks_are_targets_of_the_makefile():
    (repo,) = yaml.safe_load((ROOT / ".pre-commit-config.yaml").read_text())["repos"]
    assert repo["repo"] == "local", "the gate's own versions"
    for hook in repo["hooks"]:
        assert is_of_the_gate(hook["entry"]), hook["entry"]


def test_the_container_runs_both_commands_of_the_readme():
    container = json.loads((ROOT / ".devcontainer/devcontainer.json").read_text())
    commands = [value for key, value in container.items() if key.endswith("Command")]
    assert commands == ["make demo", ".ci/run"]
    assert all(map(is_of_the_gate, commands))
    assert "\nmake test" in (ROOT / ".ci/run").read_text()


@pytest.mark.parametrize("name", ["fault", "measurement"])
def test_forms_ask_for_what_an_answer_needs(name):
    form = yaml.safe_load((ROOT / f".github/ISSUE_TEMPLATE/{name}.yml").read_text())
    asked = {part["id"] for part in form["body"] if part["type"] != "markdown"}
    wanted = {
        "fault": {"command", "log", "wanted", "versions"},
        "measurement": {"photo", "design", "contacts", "how"},
    }
    assert wanted[name] <= asked
    assert any(part.get("validations", {}).get("required") for part in form["body"])


def test_the_recipe_is_what_the_package_declares():
    recipe = yaml.safe_load((ROOT / ".conda/recipe.yaml").read_text())
    declared = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    assert recipe["context"]["version"] == __version__
    python, *needed = recipe["requirements"]["run"]
    assert python == f"python {declared['requires-python']}"
    assert [one.replace(" ", "") for one in needed] == declared["dependencies"]
    programs = [f"{name} = {place}" for name, place in declared["scripts"].items()]
    assert recipe["build"]["python"]["entry_points"] == programs
    assert recipe["about"]["license"] == declared["license"]


def test_what_is_cited_is_this_version():
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    dated = re.search(r"^## (\S+) \((\S+)\)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert dated is not None
    assert (cited["version"], str(cited["date-released"])) == dated.groups()
    assert cited["version"] == __version__
    words = (ROOT / "paper.md").read_text().split("---\n", 2)[2].split()
    assert 750 <= len(words) <= 1750, "what the journal takes"
