"""The record of a check as JSON: ``vinefab/checks-1``."""

import math
from collections.abc import Sequence

from vinefab.core.jsontext import json_text
from vinefab.model.finding import CheckReport, Finding

SCHEMA = "vinefab/checks-1"


def checks_text(report: CheckReport, beside: Sequence[CheckReport] = ()) -> str:
    """Return every rule that was run or skipped, and all findings, waived ones included.

    Parameters
    ----------
    report
        The check of the design that the document is about.
    beside
        Those of other designs on its sheet, which follow under ``beside``.
    """
    names = {"design": report.design, "recipe": report.recipe, "units": "mm"}
    others = [{"design": other.design, **checks_content(other)} for other in beside]
    more = {"beside": others} if others else {}
    return json_text(SCHEMA, {**names, **checks_content(report), **more})


def checks_content(report: CheckReport) -> dict[str, object]:
    """Return the same without the names, to be part of another document."""
    return {
        "rules_run": [
            {"id": run.rule, "checked": run.checked, "findings": run.findings} for run in report.run
        ],
        "notes": [{"id": run.rule, "note": run.note} for run in report.run if run.note],
        "rules_skipped": [{"id": skip.rule, "reason": skip.reason} for skip in report.skipped],
        "findings": [_finding(finding) for finding in report.findings],
        "stale_waivers": list(report.stale_waivers),
        "limits_changed": [
            {
                "id": limit.rule,
                "name": limit.name,
                "value": limit.value,
                "default": limit.default,
                "source": limit.source,
            }
            for limit in report.limits
        ],
    }


def _finding(finding: Finding) -> dict[str, object]:
    return {
        "id": finding.rule,
        "severity": str(finding.severity),
        "message": finding.message,
        "measured": _number(finding.measured),
        "limit": _number(finding.limit),
        "unit": finding.unit,
        "branches": list(finding.branches),
        "x_mm": _number(finding.x_mm),
        "y_mm": _number(finding.y_mm),
        "marker_wkt": finding.marker_wkt,
        "fingerprint": finding.fingerprint,
        "waived": finding.waived,
        "reason": finding.reason,
    }


def _number(value: float | None) -> float | None:
    """Return a number, or None where JSON has none: a rule may measure something infinite."""
    return None if value is None or not math.isfinite(value) else float(value)
