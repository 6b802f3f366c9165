"""The contract tests that ship, run on all parts of vinefab and of the template."""

import sys
from dataclasses import dataclass
from pathlib import Path
from typing import ClassVar

import pytest

from vinefab import testing
from vinefab.core.errors import BrokenPluginError
from vinefab.fabrication.formats.laser_formats import LASER_FORMATS
from vinefab.fabrication.rules.catalog import RULES
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.search.optimizers.optimizer import OPTIMIZERS
from vinefab.tasks import TASKS, make_task

TEMPLATE = Path(__file__).parents[1] / "examples" / "plugin_template"


@pytest.mark.parametrize("name", TASKS)
def test_tasks_keep_their_contract(name):
    if name != "reach":  # its targets are the map's
        testing.check_task(make_task(name))


@pytest.mark.parametrize("name", ENVIRONMENTS)
def test_environments_keep_their_contract(name):
    testing.check_environment(ENVIRONMENTS[name])


@pytest.mark.parametrize("name", sorted(OPTIMIZERS.keys() - {"nsga2"}))
def test_optimizers_keep_their_contract(name):
    testing.check_optimizer(OPTIMIZERS[name]())


@pytest.mark.parametrize("name", sorted(name for name in RULES if not name.startswith("VF-R")))
def test_rules_keep_their_contract(name):
    testing.check_rule(RULES[name])


@pytest.mark.parametrize("name", LASER_FORMATS)
def test_formats_keep_their_contract(name):
    testing.check_laser_format(LASER_FORMATS[name])


def test_the_template_keeps_its_contracts(monkeypatch):
    monkeypatch.syspath_prepend(TEMPLATE)
    monkeypatch.syspath_prepend(TEMPLATE / "tests")
    for name in [name for name in sys.modules if name.startswith("vinefab_mylab")]:
        monkeypatch.delitem(sys.modules, name)
    import test_parts  # noqa: PLC0415  as its author runs it

    for name in dir(test_parts):
        if name.startswith("test_"):
            getattr(test_parts, name)()


@dataclass(frozen=True)
class Draws:
    """A task that is not repeatable, and one that goes below its lowest score."""

    name: ClassVar[str] = "draws"
    lowest: ClassVar[float] = 0.0
    scores: tuple = ()

    def evaluate(self, deployment, context):  # noqa: ARG002
        return self.scores[0], {}


def test_a_broken_contract_is_one_sentence():
    with pytest.raises(AssertionError, match="below lowest"):
        testing.check_task(Draws(scores=(-1.0,)))
    with pytest.raises(BrokenPluginError, match="its score is None"):
        testing.check_task(Draws(scores=(None,)))
