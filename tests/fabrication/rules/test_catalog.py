import re
from collections.abc import Callable
from dataclasses import replace

import pytest

from vinefab.core.errors import BadInputError, UnknownNameError
from vinefab.fabrication.rules.catalog import RULES, changed_limits, run_checks
from vinefab.fabrication.rules.rule import Subject
from vinefab.model.design import Design

Make = Callable[..., Design]


def with_limits(profile, **rules):
    limits = {rule.replace("_", "-"): named for rule, named in rules.items()}
    return replace(profile, recipe=profile.recipe.changed(limits=limits))


def test_the_command_line_overrides_the_design_and_the_design_the_recipe(make, profile):
    recipe = with_limits(
        profile, VF_B01={"warning": 1.0, "error": 2.0}, VF_W01={"error": 3.0, "warning": 8.0}
    )
    design = make().changed(limits={"VF-B01": {"warning": 4.0, "error": 5.0}})
    found = changed_limits(design, recipe, {"VF-B01": {"error": 6.0}})
    sources = {
        (limit.rule, limit.name): (limit.value, limit.default, limit.source) for limit in found
    }
    assert sources == {
        ("VF-B01", "error"): (6.0, 150.0, "--limit"),
        ("VF-B01", "warning"): (4.0, 200.0, "design case"),
        ("VF-W01", "error"): (3.0, 5.0, "recipe co2_60w__stretchlon_200"),
    }


@pytest.mark.parametrize("where", ["recipe", "design", "given"])
def test_a_limit_of_any_source_counts_and_is_reported(make, profile, where):
    limits = {"VF-B01": {"error": 190.0}}
    design = make(tail_mm=180.0)
    if where == "design":
        design = design.changed(limits=limits)
    recipe = with_limits(profile, VF_B01={"error": 190.0}) if where == "recipe" else profile
    report = run_checks(Subject.of(design, recipe), limits if where == "given" else None)
    assert {finding.rule for finding in report.blocking} == {"VF-B01"}
    assert [(limit.value, limit.default) for limit in report.limits] == [(190.0, 150.0)]


def test_an_unchanged_limit_is_not_reported(make, profile):
    assert run_checks(Subject.of(make(), profile)).limits == ()
    assert changed_limits(make(), profile, {"VF-B01": {"error": 150.0}}) == ()


def test_wrong_limits_are_named_with_where_they_stand(make, profile):
    misnamed = make().changed(limits={"VF-B01": {"eror": 1.0}})
    with pytest.raises(BadInputError, match=r"design case: limits.VF-B01.eror"):
        changed_limits(misnamed)
    with pytest.raises(UnknownNameError, match="recipe co2_60w__stretchlon_200"):
        changed_limits(make(), with_limits(profile, VF_B99={"error": 1.0}))
    with pytest.raises(BadInputError, match="--limit"):
        changed_limits(make(), None, {"VF-X01": {"error": 1.0}})


FAULT = re.compile(
    r"\b(not|no|too|missing|wrong|cannot|differs?|overlap|exceeds|crosses|lie on each other"
    r"|reaches a|multiplies|narrower|more .* than)\b"
)
"""Words that only a title of something wrong holds."""


@pytest.mark.parametrize("rule", RULES.values(), ids=lambda rule: rule.id)
def test_no_title_can_be_read_as_its_contrary(rule):
    assert FAULT.search(rule.broken), f"{rule.broken!r} names nothing that is wrong"
    assert not FAULT.search(rule.title), f"{rule.title!r} reads as something wrong"
    for title in (rule.broken, rule.title):
        assert title == title.strip(". ")
        assert len(title) <= 64
    assert rule.remedy


def test_a_rule_of_another_package_needs_no_second_title():
    mine = replace(RULES["VF-B01"], id="MY-1", title="few branches", broken="")
    assert mine.broken == "not kept: few branches"
