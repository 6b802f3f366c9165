"""A rule that finds nothing, or less than it should, must fail its fixtures: all of them, here."""

import importlib.util
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from vinefab.fabrication.rules.catalog import RULES
from vinefab.model.design import Design

path = Path(__file__).with_name("mutate.py")
spec = importlib.util.spec_from_file_location("mutate", path)
mutate = importlib.util.module_from_spec(spec)
sys.modules["mutate"] = mutate
spec.loader.exec_module(mutate)


@pytest.mark.parametrize("rule", mutate.fixtures().CASES)
def test_no_mutant_of_a_rule_survives(rule: str, make: Callable[..., Design]) -> None:
    row = mutate.mutate(rule, make)
    assert row.survivors == ()
    assert row.fires >= 1
    assert row.quiet >= 1
    alike = sum(name == rule for name, _ in mutate.ALIKE)
    assert row.mutants == 1 + len(RULES[rule].limits) - alike


def test_a_limit_that_no_fixture_is_near_is_noticed(
    make: Callable[..., Design], monkeypatch: pytest.MonkeyPatch
) -> None:
    blind = replace(RULES["VF-B01"], limits={"error": 10.0, "warning": 200.0})
    monkeypatch.setattr(mutate, "RULES", {"VF-B01": blind})
    assert mutate.mutate("VF-B01", make).survivors == ("lax error",)
