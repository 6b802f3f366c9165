"""Findings of design rules, and the report of a whole check."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import StrEnum

from vinefab.core.codec import Record, exact
from vinefab.core.plain_text import counted
from vinefab.core.view import Answer, Block, Data, Notes, Remark, Result, Rows, lines


class Severity(StrEnum):
    """How much a finding matters: an error blocks the export unless waived."""

    ERROR = "error"
    WARNING = "warning"
    INFO = "info"


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding(Result, Record):
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
    names
        What the design's file calls these; empty where it has levels.
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
    title
        What is wrong; empty for a rule that is not installed here.
    """

    __pydantic_config__ = exact(infinite_as_null=True, rule="id")

    rule: str
    severity: Severity
    title: str = ""
    message: str
    measured: float | None = None
    limit: float | None = None
    unit: str = ""
    branches: tuple[str, ...] = ()
    names: tuple[str, ...] = ()
    x_mm: float | None = None
    y_mm: float | None = None
    marker_wkt: str = ""
    fingerprint: str = ""
    waived: bool = False
    reason: str = ""

    def __repr__(self) -> str:
        where = f" at {', '.join(self.places)}" if self.branches else ""
        return f"<Finding {self.rule} {self.weight}{where}: {self.message}>"

    def view(self) -> Iterator[Block]:
        """Yield the fault, its place, the measured value and the limits."""
        yield Remark(f"{self.rule}  {self.title}".rstrip(), self.weight, (self.words,))
        yield Data(self.content)

    @property
    def weight(self) -> str:
        """How much it matters: its severity, or that it is waived."""
        return "waived" if self.waived else self.severity.value

    @property
    def places(self) -> tuple[str, ...]:
        """The branches concerned, as people call them: by name, else by id."""
        return self.names or self.branches

    @property
    def words(self) -> str:
        """Branches, message, numbers and fingerprint in one line."""
        who = f"[{', '.join(self.places[:4])}] " if self.branches else ""
        numbers = f" ({self.measures})" if self.measures else ""
        why = f" (waived: {self.reason})" if self.waived else ""
        return f"{who}{self.message}{numbers}{why}  #{self.fingerprint}"

    @property
    def measures(self) -> str:
        """The measured value and its limit; empty if the rule has no number."""
        if self.measured is None or self.limit is None:
            return ""
        unit, side = f" {self.unit}".rstrip(), "least" if self.measured < self.limit else "most"
        return f"{self.measured:.4g}{unit}, at {side} {self.limit:.4g}{unit}"

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
    title
        What the rule asks for.
    """

    rule: str
    checked: int
    findings: int
    note: str = ""
    title: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class RuleSkipped(Record):
    """A rule that could not be applied, and why.

    Parameters
    ----------
    rule
        Its id.
    reason
        What was missing.
    """

    __pydantic_config__ = exact(rule="id")

    rule: str
    reason: str


@dataclass(frozen=True, slots=True, kw_only=True)
class ChangedLimit(Record):
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

    __pydantic_config__ = exact(rule="id")

    rule: str
    name: str
    value: float
    default: float
    source: str


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class CheckReport(Result):
    """Every rule, applied or skipped, and all findings.

    Parameters
    ----------
    design, recipe
        Names of the checked design and its recipe.
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

    schema = "vinefab/checks-1"

    @property
    def verdict(self) -> str:
        """The outcome in one line."""
        rules = f"{counted(len(self.run), 'rule')} run, {len(self.skipped)} skipped"
        errors, warnings = self.count(Severity.ERROR), self.count(Severity.WARNING)
        found = f"{counted(errors, 'error')}, {counted(warnings, 'warning')}; {rules}"
        return f"{self.design}: {'not ' if self.blocking else ''}manufacturable: {found}"

    def view(self) -> Iterator[Block]:
        """Yield findings by rule, what was not looked at, limits that were changed, the verdict."""
        yield Notes(self.notes)
        groups = dict[tuple[str, str, str], list[str]]()
        for one in self.findings:
            groups.setdefault((one.weight, one.rule, one.title), []).append(one.words)
        for (weight, rule, title), found in groups.items():
            yield Remark(f"{rule}  {title}".rstrip(), weight, tuple(found))
        for run in self.run:
            if run.note:
                yield Remark(f"{run.rule}  {run.note}", "note")
        for limit in self.limits:
            yield Remark(
                f"{limit.rule}.{limit.name} is {limit.value:g} (else {limit.default:g}), from "
                f"{limit.source}",
                "limit",
            )
        for why in dict.fromkeys(skipped.reason for skipped in self.skipped):
            rules = ", ".join(skipped.rule for skipped in self.skipped if skipped.reason == why)
            yield Remark(f"{rules}  {why}", "skipped")
        for name in self.stale_waivers:
            yield Remark(
                f"stale waiver {name}: no finding has that name; remove it from the design",
                "warning",
            )
        yield Answer(self.verdict, "bad" if self.blocking else "good")
        yield self.applied
        yield Data(lambda: {"design": self.design, "recipe": self.recipe, "units": "mm"})
        yield Data(lambda: self.content)

    @property
    def details(self) -> tuple[str, ...]:
        """The summary and every rule that was applied."""
        return (*lines([replace(self.applied, folded=False)]), *self.summary)

    @property
    def exit_code(self) -> int:
        """The exit code of a command: 1 where something stands in the way of an export."""
        return int(bool(self.blocking))

    @property
    def applied(self) -> Rows:
        """The rules that were applied."""
        return Rows(
            caption="Rules applied, with the number of items that each checked",
            headings=("rule", "what must hold", "checked"),
            rows=tuple((run.rule, run.title, run.checked) for run in self.run),
            folded=True,
        )

    @property
    def content(self) -> dict[str, object]:
        """The report without its names, as part of a JSON document."""
        return {
            "rules_run": [
                {"id": run.rule, "checked": run.checked, "findings": run.findings}
                for run in self.run
            ],
            "notes": [{"id": run.rule, "note": run.note} for run in self.run if run.note],
            "rules_skipped": [skip.content for skip in self.skipped],
            "findings": [finding.content for finding in self.findings],
            "stale_waivers": list(self.stale_waivers),
            "limits_changed": [limit.content for limit in self.limits],
        }

    @property
    def blocking(self) -> tuple[Finding, ...]:
        """The findings that stand in the way of an export."""
        return tuple(finding for finding in self.findings if finding.blocks)

    def count(self, severity: Severity) -> int:
        """Return the number of findings of one severity that are not waived."""
        return sum(f.severity is severity and not f.waived for f in self.findings)
