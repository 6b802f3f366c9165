"""The rules as users meet them: found by words, explained, and by another package's code."""

import json
import math
from dataclasses import replace

import pytest

from vinefab.core.errors import BrokenPluginError, UnknownNameError
from vinefab.fabrication.rules.catalog import (
    RULES,
    RuleBook,
    checks_text,
    rules_on,
    run_checks,
    run_rig_checks,
)
from vinefab.fabrication.rules.rule import (
    RigSubject,
    RuleApplied,
    RuleNotApplicable,
    Scope,
    Subject,
    Violation,
    design_rule,
)
from vinefab.model.finding import Severity


@pytest.mark.parametrize(
    ("words", "found"),
    [
        ("vf-b01", {"VF-B01"}),
        ("  Clamp ", {"VF-B01", "VF-B02"}),
        ("VF-J", None),
        ("THE film", None),
    ],
)
def test_rules_are_found_by_id_or_by_words(words, found):
    book = RuleBook.of(words)
    if found is None:
        assert len(book) > 1
        assert all(words.casefold() in str(rule.content).casefold() for rule in book.values())
    else:
        assert found <= set(book)


@pytest.mark.parametrize("words", ["VF-Z99", "  ", "no such words"])
def test_unknown_rules_are_an_error(words):
    with pytest.raises(UnknownNameError, match="no rule is called"):
        RuleBook.of(words)


def test_the_book_has_every_rule_under_its_subject():
    book = RuleBook.of()
    assert set(book) == set(RULES)
    lines = "\n".join(book.summary)
    assert all(rule_id in lines for rule_id in book)
    assert json.loads(book.json_text())["rules"][0]["id"] == next(iter(book))
    with pytest.raises(UnknownNameError, match="VF-B02"):
        book["VF-B92"]


def test_one_rule_is_explained_with_its_limits_and_how_to_change_them():
    lines = "\n".join(RuleBook.of("VF-B01").summary)
    rule = RULES["VF-B01"]
    assert rule.cells[2] == "error 150, warning 200 mm"
    for part in (rule.title, rule.reason, rule.remedy, "limit error: 150 mm", "[limits.VF-B01]"):
        assert part in lines
    assert repr(rule).startswith("<Rule VF-B01: ")
    # Limits that are no error and no warning have their unit in the name; some rules have none.
    assert RULES["VF-L06"].limit_text("kerf_warning") == "kerf_warning: 1"
    bare = next(rule for rule in RULES.values() if not rule.limits)
    assert bare.cells[2] == ""
    assert "to change a limit" not in "\n".join(RuleBook.of(bare.id).summary)


def test_a_rig_is_checked_by_the_rules_about_rigs_alone(make):
    design = make((2, 200.0, 60.0)).changed(
        limits={"VF-R04": {"warning": 1.5}, "VF-B01": {"error": 100.0}}
    )
    report = run_rig_checks(RigSubject(design=design))
    looked_at = {one.rule for one in (*report.run, *report.skipped)}
    assert looked_at == set(rules_on(Scope.RIG))
    assert [(one.rule, one.name) for one in report.limits] == [("VF-R04", "warning")]
    assert run_rig_checks(RigSubject()).limits == ()


def test_reports_of_a_sheet_are_one_document(make):
    first = run_checks(Subject.of(make()))
    second = run_checks(Subject.of(make(trunk_mm=30.0)))
    alone, both = (json.loads(checks_text(first, more)) for more in ((), (second,)))
    assert "beside" not in alone
    assert [one["design"] for one in both["beside"]] == ["case"]
    assert both["beside"][0]["findings"] != both["findings"]


GOOD = Violation(message="too long", severity=Severity.WARNING, measured=2.0, limit=1.0)


@pytest.mark.parametrize(
    ("outcome", "problem"),
    [
        (RuleApplied(checked=1, violations=(GOOD,)), ""),
        (RuleNotApplicable(reason="needs a map"), ""),
        (RuleNotApplicable(reason=None), "reason is not a text"),
        (None, "NoneType, not RuleApplied"),
        (RuleApplied(checked=1.5), "checked is not a whole number"),
        (RuleApplied(checked=1, note=3), "note not a text"),
        (RuleApplied(checked=1, violations=("long",)), "of type str"),
        (RuleApplied.of_one(replace(GOOD, measured=math.nan)), "not a finite number"),
        (RuleApplied.of_one(replace(GOOD, at_mm=("a", 0.0))), "not a finite number"),
        (RuleApplied.of_one(replace(GOOD, branches=(1,))), "is not a text"),
        (RuleApplied.of_one(replace(GOOD, severity="error")), "is not a Severity"),
    ],
)
def test_outcomes_of_another_package_are_looked_at(make, outcome, problem):
    @design_rule("MY-B01", reason="a test")
    def check_mine(_subject, _limits):
        """Mine is kept."""
        return outcome

    subject = Subject.of(make())
    if not problem:
        assert check_mine.apply(subject, check_mine.limits_under(None)) is outcome
        return
    with pytest.raises(BrokenPluginError, match=problem):
        check_mine.apply(subject, check_mine.limits_under(None))
