"""Apply every rule to a subject."""

from dataclasses import replace

from vinefab.checks.rule import Hit, LimitChanges, Looked, Rule
from vinefab.checks.rules import RULES
from vinefab.checks.subject import Subject
from vinefab.core.hashing import fingerprint
from vinefab.model.design import Waiver
from vinefab.model.finding import CheckReport, Finding, RuleRun, RuleSkipped


def run_checks(subject: Subject, limits: LimitChanges | None = None) -> CheckReport:
    """Return what every registered rule found, and why any of them could not look.

    Parameters
    ----------
    subject
        The design with all that was derived from it.
    limits
        Limits that replace the defaults.

    Raises
    ------
    UnknownNameError, BadInputError
        If ``limits`` names a rule or a limit that does not exist.
    """
    changed = {RULES[rule_id].id: values for rule_id, values in (limits or {}).items()}
    run: list[RuleRun] = []
    skipped: list[RuleSkipped] = []
    findings: list[Finding] = []
    for rule in RULES.values():
        outcome = rule.look(subject, rule.limits_with(changed.get(rule.id, {})))
        if isinstance(outcome, Looked):
            run.append(RuleRun(rule=rule.id, checked=outcome.checked, findings=len(outcome.hits)))
            findings.extend(_finding(rule, hit) for hit in outcome.hits)
        else:
            skipped.append(RuleSkipped(rule=rule.id, reason=outcome.reason))
    waivers = subject.design.waivers
    return CheckReport(
        design=subject.design.name,
        recipe=subject.profile.recipe.name if subject.profile else "",
        run=tuple(run),
        skipped=tuple(skipped),
        findings=_waived(findings, waivers),
        stale_waivers=_stale(findings, waivers),
    )


def _finding(rule: Rule, hit: Hit) -> Finding:
    x_mm, y_mm = hit.at_mm if hit.at_mm else (None, None)
    return Finding(
        rule=rule.id,
        severity=hit.severity,
        message=hit.message,
        measured=hit.measured,
        limit=hit.limit,
        unit=rule.unit,
        branches=hit.branches,
        x_mm=x_mm,
        y_mm=y_mm,
        marker_wkt=hit.marker,
        # Without the measured value: a waiver must survive a change that is not about the place.
        fingerprint=fingerprint(rule.id, hit.aspect, *hit.branches),
    )


def _waived(findings: list[Finding], waivers: tuple[Waiver, ...]) -> tuple[Finding, ...]:
    reasons = {waiver.fingerprint: waiver.reason for waiver in waivers}
    return tuple(
        replace(finding, waived=True, reason=reasons[finding.fingerprint])
        if finding.fingerprint in reasons
        else finding
        for finding in findings
    )


def _stale(findings: list[Finding], waivers: tuple[Waiver, ...]) -> tuple[str, ...]:
    found = {finding.fingerprint for finding in findings}
    return tuple(w.fingerprint for w in waivers if w.fingerprint not in found)
