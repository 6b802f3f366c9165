"""The design rules over a design."""

from vinefab.checks.run import run_checks
from vinefab.checks.subject import Subject
from vinefab.model.design import Design
from vinefab.model.finding import CheckReport, Finding, Severity
from vinefab.model.laser import LaserProfile

_SIGNS = {Severity.ERROR: "ERROR", Severity.WARNING: "warn ", Severity.INFO: "info "}


def check(design: Design, profile: LaserProfile) -> CheckReport:
    """Return what every rule says of a design."""
    return run_checks(Subject.of(design, profile))


def check_lines(report: CheckReport, *, verbose: bool = False) -> list[str]:
    """Return a check as lines for the user.

    Parameters
    ----------
    report
        The check.
    verbose
        List every rule that was run too.
    """
    lines = [_finding_line(finding) for finding in report.findings]
    if verbose:
        lines += [f"ran     {r.rule}  looked at {r.checked}" for r in report.run]
    lines += [f"skipped {skipped.rule}  {skipped.reason}" for skipped in report.skipped]
    lines += [
        f"stale waiver {name}: nothing of that name was found" for name in report.stale_waivers
    ]
    return [*lines, verdict(report)]


def verdict(report: CheckReport) -> str:
    """Return the outcome of a check in one sentence."""
    errors, warnings = report.count(Severity.ERROR), report.count(Severity.WARNING)
    rules = f"{len(report.run)} rules run, {len(report.skipped)} skipped"
    found = f"{errors} errors, {warnings} warnings; {rules}"
    if report.blocking:
        return f"{report.design}: cannot be made as it is: {found}"
    return f"{report.design}: can be made: {found}"


def _finding_line(finding: Finding) -> str:
    sign = "waived" if finding.waived else _SIGNS[finding.severity]
    who = f" [{', '.join(finding.branches[:4])}]" if finding.branches else ""
    why = f" (waived: {finding.reason})" if finding.waived else ""
    words = f"{finding.message}{_numbers(finding)}{why}"
    return f"{sign}  {finding.rule}{who}  {words}  #{finding.fingerprint}"


def _numbers(finding: Finding) -> str:
    if finding.measured is None or finding.limit is None:
        return ""
    unit = f" {finding.unit}" if finding.unit else ""
    return f" (is {finding.measured:.4g}, limit {finding.limit:.4g}{unit})"
