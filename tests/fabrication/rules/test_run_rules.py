import pickle
import re
from dataclasses import replace

import numpy as np
import pytest

from vinefab.core.errors import BadInputError, UnknownNameError
from vinefab.fabrication import checking
from vinefab.fabrication.checking import check_design
from vinefab.fabrication.job.laser_job import laser_job
from vinefab.fabrication.job.placement import SheetOptions
from vinefab.fabrication.rules.catalog import (
    RULES,
    SLEEVE_RULES,
    changed_limits,
    merged_reports,
    rules_on,
    run_checks,
)
from vinefab.fabrication.rules.rule import (
    RigSubject,
    RuleApplied,
    RuleNotApplicable,
    Scope,
    Subject,
)
from vinefab.model.design import Design, PieceSettings, Waiver
from vinefab.model.files.shipped import names
from vinefab.model.finding import Severity
from vinefab.model.job import LaserPath, Operation
from vinefab.model.laser import read_profile
from vinefab.model.outline import Contour
from vinefab.model.tree import Partition, Piece


def narrow(make, width_mm=4.0):
    return make((2, 200.0, 60.0), widths_mm=(30.0, width_mm))


def fingerprint(design, rule):
    findings = run_checks(Subject.of(design)).findings
    return next(finding.fingerprint for finding in findings if finding.rule == rule)


@pytest.mark.parametrize("recipe", ["with", "without"])
def test_every_rule_is_either_run_or_skipped_with_a_reason(make, profile, recipe):
    report = run_checks(Subject.of(make(), profile if recipe == "with" else None))
    reported = [*(run.rule for run in report.run), *(skipped.rule for skipped in report.skipped)]
    assert sorted(reported) == sorted(RULES.keys() - SLEEVE_RULES)
    assert all(skipped.reason for skipped in report.skipped)


def test_rules_about_pieces_run_or_say_why_where_a_design_may_be_cut(make, profile):
    assert {"VF-J01", "VF-J02", "VF-J03", "VF-J04", "VF-J05", "VF-J06"} == SLEEVE_RULES
    uncut = Subject.of(make(pieces=PieceSettings()), profile)
    skipped = {skip.rule: skip.reason for skip in run_checks(uncut).skipped}
    assert all(skipped[rule] for rule in SLEEVE_RULES)
    whole = Partition(pieces=(Piece(label="A", root=0, branches=(0,)),))
    run = run_checks(replace(uncut, partition=whole)).run
    # One piece has no sleeve.
    assert [one.checked for one in run if one.rule in ("VF-J03", "VF-J04", "VF-J06")] == [0] * 3


def test_a_waiver_names_a_finding_and_lets_it_pass(make):
    design = narrow(make)
    waiver = Waiver(fingerprint=fingerprint(design, "VF-W01"), reason="tested in the lab")
    report = run_checks(Subject.of(design.changed(waivers=(waiver,))))
    waived = [finding for finding in report.findings if finding.rule == "VF-W01"]
    assert [(f.waived, f.reason, f.blocks) for f in waived] == [(True, "tested in the lab", False)]
    assert all(not finding.waived for finding in report.findings if finding.rule != "VF-W01")
    assert report.stale_waivers == ()


def test_a_waiver_outlives_a_change_of_the_number_but_not_of_the_place(make):
    assert fingerprint(narrow(make, 4.0), "VF-W01") == fingerprint(narrow(make, 4.5), "VF-W01")
    trunk = make(widths_mm=(4.0,))
    assert fingerprint(narrow(make), "VF-W01") != fingerprint(trunk, "VF-W01")


def test_fingerprints_are_different_within_a_report(make, profile):
    bad = make((3, 60.0, 30.0), (3, 60.0, 200.0), widths_mm=(20.0, 18.0, 4.0), tail_mm=100.0)
    findings = run_checks(Subject.of(bad, profile)).findings
    assert len(findings) > 10
    assert len({finding.fingerprint for finding in findings}) == len(findings)


def test_more_than_a_hundred_overlaps_are_counted_in_one_finding(make):
    heap = make((5, 200.0, 300.0), (5, 200.0, 300.0), (3, 200.0, 200.0))
    findings = [f for f in run_checks(Subject.of(heap)).findings if f.rule == "VF-T03"]
    assert len(findings) == 101
    assert findings[-1].severity is Severity.INFO
    assert "more pairs" in findings[-1].message


@pytest.mark.parametrize(("name", "spool"), [("plain_vine", ""), ("three_level_tree", "40 kPa")])
def test_hand_made_designs_pass_but_for_the_recipe(name, spool, profile):
    report = run_checks(Subject.of(Design.read(name), profile))
    assert [(one.rule, one.title) for one in report.findings] == [
        ("VF-L06", "recipe not calibrated")
    ]
    (note,) = [run.note for run in report.run if run.rule == "VF-P03"]
    assert spool in note
    assert ("spool" in note) == bool(spool)
    assert report.blocking == ()


SLOW = "grid_explorer", "grid_explorer_pieces", "cave_explorer_pieces"
"""Robots with many joints of their own; `cave_explorer` is one, too."""


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.thorough] if name in SLOW else [])
        for name in names("design")
    ],
)
def test_shipped_designs_have_no_errors(name, profile):
    assert check_design(Design.read(name), profile).blocking == ()


@pytest.mark.parametrize(
    ("name", "problems"), [("three_level_tree", ()), ("plain_vine", ("an arc is missing",))]
)
def test_merged_reports_equal_one_report_of_all_rules(name, problems, profile):
    design = Design.read(name).changed(waivers=(Waiver(fingerprint="gone", reason="old"),))
    before = Subject.of(design, profile)
    after = replace(before, readback={"outline.dxf": problems})
    assert merged_reports(run_checks(before), run_checks(after, only=("VF-X01",))) == run_checks(
        after
    )


FAN = (4, 100.0, 170.0)


def without_paths(*_):
    raise AssertionError("the paths of a design that is blocked were made")


def test_the_paths_of_a_large_design_that_is_blocked_are_not_made_and_no_rule_is_lost(
    make, profile, monkeypatch
):
    monkeypatch.setattr(checking, "MANY_BRANCHES", 3)
    monkeypatch.setattr(checking, "laser_job", without_paths)
    report = checking.check_design(make(FAN, (4, 200.0, 170.0)), profile)
    assert "VF-T03" in {finding.rule for finding in report.blocking}
    reported = [*(run.rule for run in report.run), *(skipped.rule for skipped in report.skipped)]
    assert sorted(reported) == sorted(RULES.keys() - SLEEVE_RULES)
    reasons = {skipped.rule: skipped.reason for skipped in report.skipped}
    assert {"VF-S01", "VF-L02"} <= {rule for rule, why in reasons.items() if "not looked at" in why}
    assert "21 branches" in reasons["VF-S01"]


def test_a_large_design_that_nothing_blocks_is_checked_in_full(make, profile, monkeypatch):
    whole = checking.check_design(make(FAN), profile)
    monkeypatch.setattr(checking, "MANY_BRANCHES", 3)
    assert checking.check_design(make(FAN), profile) == whole


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
    assert changed_limits(design, profile, {"VF-B01": {"error": 150.0, "warning": 200.0}}) == ()
    assert sources == {
        ("VF-B01", "error"): (6.0, 150.0, "--limit"),
        ("VF-B01", "warning"): (4.0, 200.0, "design case"),
        ("VF-W01", "error"): (3.0, 5.0, "recipe co2_60w__stretchlon_200"),
    }


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


def along(points_mm, *, closed=False):
    return Contour.polyline(np.array(points_mm, dtype=float), closed=closed)


def bare_jobs(design, profile):
    """Yield jobs with as little on them as can be: nothing, one contour, or no room for copies."""
    job = laser_job(design, profile)
    yield "nothing", replace(job, paths=())
    yield "empty sheets", replace(job, paths=(), sheets=(replace(job, paths=()), job))
    yield "empty tiles", replace(job, paths=(), tiles=(replace(job, paths=()),))
    yield "facts alone", replace(job, paths=(), facts={})
    stroke, square = (
        along([(9, 9), (60, 9)]),
        along([(9, 9), (60, 9), (60, 60), (9, 60)], closed=True),
    )
    for operation in Operation:
        for kind, contour in (("stroke", stroke), ("square", square)):
            for of in ("", design.name):
                path = LaserPath(operation=operation, contour=contour, label="alone", of=of)
                yield f"{kind} to {operation}, of {of or 'none'}", replace(job, paths=(path,))
    small = profile.machine.bed_width_mm.changed(value=60.0)
    machine = profile.machine.changed(bed_width_mm=small, bed_height_mm=small)
    for copies in (1, 2):
        crowded = laser_job(design, replace(profile, machine=machine), SheetOptions(copies=copies))
        yield f"{copies} on a bed of 60 mm", crowded


@pytest.mark.parametrize("fans", [[], [(2, 150.0, 70.0)]], ids=["vine", "fork"])
def test_every_rule_has_an_outcome_on_next_to_nothing(make, profile, fans):
    """Without a recipe, without paths, with one, and where nothing finds room."""
    design = make(*fans)
    assert run_checks(Subject.of(design)).run
    for case, job in bare_jobs(design, profile):
        subject = Subject.on_sheet(design, profile, job)
        for rule in RULES.values():
            try:
                outcome = rule.apply(subject, rule.limits_with({}))
            except Exception as error:
                error.add_note(f"{rule.id} on {case}")
                raise
            assert isinstance(outcome, RuleApplied | RuleNotApplicable), (rule.id, case)
    for rule in map(RULES.get, rules_on(Scope.RIG)):
        rule.apply(RigSubject(), rule.limits_with({}))


@pytest.mark.parametrize(("ply_mm", "needs"), [(0.0375, 0), (0.0377, 0), (0.045, 28), (0.05, 31)])
def test_settings_derived_for_another_film_are_stale(make, ply_mm, needs):
    """Energies go with the thickness: 23 J/cm2 for two plies of 0.0375 mm."""
    known = read_profile("co2_40w__stretchlon_200")
    ply = known.material.ply_mm.changed(value=ply_mm)
    copied = replace(known, material=known.material.changed(ply_mm=ply))
    found = [
        one.message
        for one in run_checks(Subject.of(make(), copied), only=("VF-L06",)).findings
        if "derived for" in one.message
    ]
    assert len(found) == bool(needs)
    assert ("known of plies of 0.0375 mm only" in copied.material.lamination_words) == bool(needs)
    if needs:
        assert f"takes about {needs} J/cm^2" in found[0]
        assert f"{2 * ply_mm:g} mm" in found[0]
        assert "weldcut delivers 27, less than that" in found[0]


def test_a_declared_rule_is_its_check():
    """Title from the docstring, limits from the keywords; it goes to another process."""
    rule = RULES["VF-B01"]
    assert rule.title == "the tail is long enough to invert and clamp"
    assert dict(rule.limits) == {"error": 150.0, "warning": 200.0}
    assert pickle.loads(pickle.dumps(rule)) == rule  # noqa: S301  made here
