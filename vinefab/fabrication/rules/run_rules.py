"""Run all rules on a subject, and report what was checked, skipped and found."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Protocol, TypeVar

from vinefab.core.hashing import fingerprint
from vinefab.core.jsontext import json_text
from vinefab.core.view import document
from vinefab.fabrication.rules.catalog import (
    PIECE_RULES,
    RULES,
    by_rule,
    changed_limits,
    concerns,
)
from vinefab.fabrication.rules.rig_rules import RIG_CHECKS, RigSubject
from vinefab.fabrication.rules.rule import (
    LimitChanges,
    Limits,
    Rule,
    RuleApplied,
    RuleNotApplicable,
    Violation,
)
from vinefab.fabrication.rules.subject import Subject
from vinefab.model.design import Waiver
from vinefab.model.finding import CheckReport, Finding, RuleRun, RuleSkipped


class _OfRule(Protocol):
    """An entry of a report that belongs to one rule."""

    @property
    def rule(self) -> str:
        """The rule's id."""
        ...


_Entry = TypeVar("_Entry", bound=_OfRule)


def run_checks(
    subject: Subject,
    limits: LimitChanges | None = None,
    *,
    only: Collection[str] | None = None,
) -> CheckReport:
    """Return the report of all registered rules: their findings, and why any was skipped.

    Rules about pieces are in it only where the design may be cut in some (`concerns`).

    Parameters
    ----------
    limits
        Limits that override those of recipe and design.
    only
        Ids of the rules to run; all by default.

    Raises
    ------
    UnknownNameError, BadInputError
        If a changed limit names no rule or limit, or its value is out of range.
    """
    RULES.load_plugins()
    changed = changed_limits(subject.design, subject.profile, limits)
    values = by_rule(changed)
    outcomes = [
        (rule, _outcome(rule, subject, rule.limits_with(values.get(rule.id, {}))))
        for rule in RULES.values()
        if (only is None or rule.id in only) and concerns(rule.id, subject.design)
    ]
    recipe = subject.profile.recipe.name if subject.profile else ""
    report = _report(subject.design.name, outcomes, subject.design.waivers)
    names = {finding.fingerprint for finding in report.findings}
    stale = tuple(w.fingerprint for w in subject.design.waivers if w.fingerprint not in names)
    broken = tuple(
        RuleSkipped(rule=name, reason=f"does not load ({why})")
        for name, why in RULES.broken.items()
        if only is None or name in only
    )
    skipped = (*report.skipped, *broken)
    return replace(report, recipe=recipe, limits=changed, stale_waivers=stale, skipped=skipped)


def _outcome(rule: Rule, subject: Subject, limits: Limits) -> RuleApplied | RuleNotApplicable:
    """Return what a rule finds; rules about one flat outline look at every piece of a robot."""
    if not subject.pieces or rule.id not in PIECE_RULES:
        with RULES.calling(rule.id):
            return rule.check(subject, limits)
    found = [rule.check(piece, limits) for piece in subject.pieces]
    for outcome in found:
        if isinstance(outcome, RuleNotApplicable):
            return outcome
    applied = [outcome for outcome in found if isinstance(outcome, RuleApplied)]
    # What concerns the design is found on every piece: it is said once.
    violations = {
        (one.aspect, one.branches, one.message): one for each in applied for one in each.violations
    }
    return RuleApplied(
        checked=sum(each.checked for each in applied),
        violations=tuple(violations.values()),
        note="; ".join(dict.fromkeys(each.note for each in applied if each.note)),
    )


def merged_reports(report: CheckReport, more: CheckReport) -> CheckReport:
    """Return a report in which the entries of some rules are replaced by those of a later run."""
    later = {run.rule for run in more.run} | {skipped.rule for skipped in more.skipped}
    return replace(
        report,
        run=_replaced(report.run, more.run, later),
        skipped=_replaced(report.skipped, more.skipped, later),
        findings=_replaced(report.findings, more.findings, later),
        stale_waivers=tuple(name for name in report.stale_waivers if name in more.stale_waivers),
    )


def _replaced(old: Sequence[_Entry], new: Sequence[_Entry], rules: set[str]) -> tuple[_Entry, ...]:
    """Return the old entries with those of some rules replaced, in the rules' order."""
    place = {rule: number for number, rule in enumerate(RULES)}
    entries = [*(entry for entry in old if entry.rule not in rules), *new]
    # A rule of another package that does not load has no place.
    return tuple(sorted(entries, key=lambda entry: place.get(entry.rule, len(place))))


def run_rig_checks(subject: RigSubject) -> CheckReport:
    """Return the report of the rules about test rigs, the only ones that need no design."""
    changed = changed_limits(subject.design, None, None) if subject.design else ()
    own = tuple(limit for limit in changed if limit.rule in RIG_CHECKS)
    values = by_rule(own)
    outcomes = [
        (rule, check(subject, rule.limits_with(values.get(rule.id, {}))))
        for rule, check in RIG_CHECKS.values()
    ]
    name, waivers = (subject.design.name, subject.design.waivers) if subject.design else ("", ())
    return replace(_report(name, outcomes, waivers), limits=own)


def _report(
    name: str,
    outcomes: list[tuple[Rule, RuleApplied | RuleNotApplicable]],
    waivers: tuple[Waiver, ...],
) -> CheckReport:
    run: list[RuleRun] = []
    skipped: list[RuleSkipped] = []
    findings: list[Finding] = []
    reasons = {waiver.fingerprint: waiver.reason for waiver in waivers}
    for rule, outcome in outcomes:
        if isinstance(outcome, RuleApplied):
            run.append(
                RuleRun(
                    rule=rule.id,
                    checked=outcome.checked,
                    findings=len(outcome.violations),
                    note=outcome.note,
                    title=rule.title,
                )
            )
            findings.extend(_finding(rule, one, reasons) for one in outcome.violations)
        else:
            skipped.append(RuleSkipped(rule=rule.id, reason=outcome.reason))
    return CheckReport(
        design=name,
        recipe="",
        run=tuple(run),
        skipped=tuple(skipped),
        findings=tuple(findings),
    )


def _finding(rule: Rule, violation: Violation, waived: Mapping[str, str]) -> Finding:
    """Return a violation as a finding; ``waived`` are the reasons of waivers by fingerprint."""
    x_mm, y_mm = violation.at_mm if violation.at_mm else (None, None)
    # Without the measured value: a waiver must survive changes elsewhere in the design.
    name = fingerprint(rule.id, violation.aspect, *violation.branches)
    return Finding(
        rule=rule.id,
        severity=violation.severity,
        message=violation.message,
        measured=violation.measured,
        limit=violation.limit,
        unit=rule.unit,
        branches=violation.branches,
        x_mm=x_mm,
        y_mm=y_mm,
        marker_wkt=violation.marker,
        fingerprint=name,
        title=violation.title or rule.broken,
        waived=name in waived,
        reason=waived.get(name, ""),
    )


def checks_text(report: CheckReport, beside: Sequence[CheckReport] = ()) -> str:
    """Return the reports of a sheet as JSON, the first with those of the other designs beside."""
    others = [{"design": other.design, **other.content} for other in beside]
    more = {"beside": others} if others else {}
    return json_text(report.schema, {**document(report.view()), **more})
