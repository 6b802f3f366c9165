"""Findings of design rules, and the report of a whole check."""

import reprlib
from dataclasses import dataclass
from enum import StrEnum

from vinefab.core.front_door import front_door
from vinefab.core.plain_text import counted


class Severity(StrEnum):
    """How much a finding matters: an error blocks the export unless waived."""

    ERROR = "error"
    WARNING = "warning"
    INFO = "info"


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One broken rule at one place.

    Parameters
    ----------
    rule
        Id of the rule (``VF-C01``).
    severity
        How much it matters.
    message
        One sentence: what is wrong and how to fix it.
    measured, limit
        The measured and the allowed value, in ``unit``; None if the rule has no number.
    unit
        Unit of both (``mm``, ``deg``, ``kPa``, empty for ratios).
    branches
        Ids of the branches concerned.
    x_mm, y_mm
        The place, in coordinates of the flat layout; None without one.
    marker_wkt
        Geometry that marks the place, as well-known text, or empty.
    fingerprint
        Stable id of rule and branches, independent of the measured value.
    waived
        Whether the design waives it.
    reason
        The waiver's reason, or empty.
    """

    rule: str
    severity: Severity
    message: str
    measured: float | None = None
    limit: float | None = None
    unit: str = ""
    branches: tuple[str, ...] = ()
    x_mm: float | None = None
    y_mm: float | None = None
    marker_wkt: str = ""
    fingerprint: str = ""
    waived: bool = False
    reason: str = ""

    def __repr__(self) -> str:
        severity = "waived" if self.waived else self.severity.value
        where = f" at {', '.join(self.branches)}" if self.branches else ""
        return f"<Finding {self.rule} {severity}{where}: {self.message}>"

    def _repr_html_(self) -> str:
        """Show the finding in a notebook."""
        shown: str = front_door().html_of(self)
        return shown

    @property
    def blocks(self) -> bool:
        """Whether the finding stands in the way of an export."""
        return self.severity is Severity.ERROR and not self.waived


@dataclass(frozen=True, slots=True, kw_only=True)
class RuleRun:
    """A rule that was applied.

    Parameters
    ----------
    rule
        Its id.
    checked
        Number of items checked (branches, joints, files).
    findings
        Number of findings.
    note
        What else to know: what the rule could not check, what the design gets; or empty.
    """

    rule: str
    checked: int
    findings: int
    note: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class RuleSkipped:
    """A rule that could not be applied, and why.

    Parameters
    ----------
    rule
        Its id.
    reason
        What was missing.
    """

    rule: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangedLimit:
    """A limit that was not the rule's default.

    Parameters
    ----------
    rule, name
        Which limit of which rule.
    value, default
        Its value in this check, and its default.
    source
        Who changed it: the recipe, the design or the command line.
    """

    rule: str
    name: str
    value: float
    default: float
    source: str


@dataclass(frozen=True, slots=True, kw_only=True)
class CheckReport:
    """Every rule, applied or skipped, and all findings.

    Parameters
    ----------
    design, recipe
        Names of what was checked.
    run, skipped
        Together, every rule that exists.
    findings
        In the order of the rules.
    stale_waivers
        Waived fingerprints without a finding.
    limits
        Limits that differ from their defaults.
    notes
        What was deployed for it, and by which rules, a line each.
    """

    design: str
    recipe: str
    run: tuple[RuleRun, ...]
    skipped: tuple[RuleSkipped, ...]
    findings: tuple[Finding, ...]
    stale_waivers: tuple[str, ...] = ()
    limits: tuple[ChangedLimit, ...] = ()
    notes: tuple[str, ...] = ()

    def __repr__(self) -> str:
        names = " with ".join(reprlib.repr(name) for name in (self.design, self.recipe) if name)
        counts = ", ".join(self._counted(severity) for severity in Severity)
        rules = f"{counted(len(self.run), 'rule')} applied, {len(self.skipped)} skipped"
        return f"<{' '.join(('CheckReport', names)).rstrip()}: {counts}; {rules}>"

    def _repr_html_(self) -> str:
        """Show the findings in a notebook."""
        shown: str = front_door().html_of(self)
        return shown

    @property
    def summary(self) -> tuple[str, ...]:
        """Findings by rule, what was not looked at, and the verdict, a line each."""
        lines: tuple[str, ...] = front_door().check_summary(self)
        return lines

    @property
    def all_lines(self) -> tuple[str, ...]:
        """The same with every rule that was applied."""
        lines: tuple[str, ...] = front_door().check_summary(self, verbose=True)
        return lines

    @property
    def exit_code(self) -> int:
        """The exit code of a command: 1 where something stands in the way of an export."""
        return int(bool(self.blocking))

    def json_text(self) -> str:
        """Return the check as JSON: ``vinefab/checks-1``."""
        text: str = front_door().check_json(self)
        return text

    def _counted(self, severity: Severity) -> str:
        count = self.count(severity)
        plural = "s" if count != 1 and severity is not Severity.INFO else ""
        return f"{count} {severity}{plural}"

    @property
    def blocking(self) -> tuple[Finding, ...]:
        """The findings that stand in the way of an export."""
        return tuple(finding for finding in self.findings if finding.blocks)

    def count(self, severity: Severity) -> int:
        """Return the number of findings of one severity that are not waived."""
        return sum(f.severity is severity and not f.waived for f in self.findings)
