"""A rule that finds nothing, or less than it should, must fail its fixtures: all of them, here."""

from dataclasses import replace

import pytest

from tests.fabrication.rules import mutate
from vinefab.fabrication.rules.catalog import RULES


@pytest.mark.parametrize("rule", list(RULES))
def test_no_mutant_of_a_rule_survives(rule):
    row = mutate.mutate(rule)
    assert row.survivors == ()
    assert row.fires >= 1
    assert row.quiet >= 1
    alike = sum(name == rule for name, _ in mutate.ALIKE)
    assert row.mutants == 1 + len(RULES[rule].limits) - alike


def test_a_limit_that_no_fixture_is_near_is_noticed(monkeypatch):
    blind = replace(RULES["VF-B01"], limits={"error": 10.0, "warning": 200.0})
    monkeypatch.setattr(mutate, "RULES", {"VF-B01": blind})
    assert mutate.mutate("VF-B01").survivors == ("lax error",)
