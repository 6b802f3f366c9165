"""What strangers meet first: workflow, hooks, forms, container. They repeat nothing of the gate."""

import json
import re
import shlex
from pathlib import Path

import pytest
import yaml

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
