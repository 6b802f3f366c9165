"""All design rules by id, their limits as changed, and the report of a run of all rules.

Recipe, design and command line change limits.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TypeVar

from vinefab.core.errors import UnknownNameError, located
from vinefab.core.hashing import fingerprint
from vinefab.core.plain_text import json_text
from vinefab.core.progress import each
from vinefab.core.registry import Registry
from vinefab.core.view import Block, Data, Remark, Result, Rows, Text, document
from vinefab.fabrication.rules import (
    as_built,
    clearance_rules,
    laser_rules,
    pressure_rules,
    seam_rules,
    tree_rules,
)
from vinefab.fabrication.rules.rule import (
    LimitChanges,
    Limits,
    RigSubject,
    Rule,
    RuleApplied,
    RuleNotApplicable,
    Scope,
    Subject,
)
from vinefab.model.design import Design
from vinefab.model.finding import ChangedLimit, CheckReport, Finding, RuleRun, RuleSkipped
from vinefab.model.laser import LaserProfile

RULE_GROUPS: Mapping[str, str] = {
    "T": "tree and outline",
    "W": "widths",
    "C": "clearance and joints",
    "P": "pressure and seams",
    "I": "shape under pressure",
    "B": "base and reach",
    "J": "pieces and laps",
    "S": "sheet",
    "L": "paths and machine",
    "X": "files",
    "R": "test rig",
}
"""What rules are about, by the letter in ids of vinefab's own, in the order of reports; those of
other packages stand last under their own names."""

_MODULES = (tree_rules, clearance_rules, pressure_rules, as_built, laser_rules, seam_rules)
_BUILTIN = sorted(
    (one for module in _MODULES for one in vars(module).values() if isinstance(one, Rule)),
    key=lambda rule: ([*RULE_GROUPS].index(rule.id[3]), rule.id),
)


def _problem(name: str, part: object) -> str:
    """Return the reason that another package's rule cannot be used; empty if it can."""
    if not isinstance(part, Rule):
        return "is not a vinefab.fabrication.rules.rule.Rule"
    return "" if part.id == name else f"its id is {part.id}, not the name of its entry point"


RULES: Registry[Rule] = Registry(
    "rule", {rule.id: rule for rule in _BUILTIN}, group="vinefab.rules", problem=_problem
)


def rules_on(scope: Scope) -> frozenset[str]:
    """Return the ids of all rules that are about something."""
    return frozenset(rule.id for rule in all_rules() if scope in rule.on)


def flat_rules() -> frozenset[str]:
    """Return vinefab's own rules that need no paths of the laser; those of others may ask for some.

    >>> "VF-T01" in flat_rules(), "VF-L02" in flat_rules()
    (True, False)
    """
    return frozenset(rule.id for rule in _BUILTIN if Scope.PATHS not in rule.on)


SLEEVE_RULES = frozenset(rule.id for rule in _BUILTIN if rule.id.startswith("VF-J"))
"""Rules about pieces and their sleeves."""

COMMAND_LINE = "--limit"


def concerns(rule: str, design: Design) -> bool:
    """Return whether reports on a design name a rule: those about pieces if it may be cut in some.

    So a design of one flat outline has the report that it always had.
    """
    return design.build.pieces is not None or rule not in SLEEVE_RULES


def changed_limits(
    design: Design, profile: LaserProfile | None = None, given: LimitChanges | None = None
) -> tuple[ChangedLimit, ...]:
    """Return every limit that differs from its default, with the source of its value.

    The command line overrides the design, and the design overrides the recipe.
    """
    sources: list[tuple[str, LimitChanges]] = [
        (f"design {design.name}", design.limits),
        (COMMAND_LINE, given or {}),
    ]
    if profile is not None:
        sources.insert(0, (f"recipe {profile.recipe.name}", profile.recipe.limits))
    found: dict[tuple[str, str], ChangedLimit] = {}
    for source, changes in sources:
        with located(source):
            for rule, named in ((RULES[rule_id], named) for rule_id, named in changes.items()):
                limits = rule.limits_with(named)
                for name in named:
                    found[rule.id, name] = ChangedLimit(
                        rule=rule.id,
                        name=name,
                        value=limits[name],
                        default=rule.limits[name],
                        source=source,
                    )
    return tuple(limit for limit in found.values() if limit.value != limit.default)


def by_rule(changed: Iterable[ChangedLimit]) -> dict[str, dict[str, float]]:
    """Return the values of changed limits, by rule and name."""
    values: dict[str, dict[str, float]] = {}
    for limit in changed:
        values.setdefault(limit.rule, {})[limit.name] = limit.value
    return values


def all_rules() -> list[Rule]:
    """Return the rules of vinefab and of other packages that load."""
    RULES.load_plugins()
    return list(RULES.values())


def rules_named(words: str) -> list[Rule]:
    """Return the rule with an id, else those with the words in their id, titles or group.

    Upper and lower case are the same.
    """
    known = {rule.id.upper(): rule for rule in all_rules()}
    if words.upper() in known:
        return [known[words.upper()]]
    sought = words.casefold().strip()
    found = [
        rule
        for group, rules in grouped_rules().items()
        for rule in rules
        if sought and sought in f"{rule.id} {rule.title} {rule.broken} {group}".casefold()
    ]
    if not found:
        raise UnknownNameError("rule", words, known)
    return found


def grouped_rules() -> dict[str, list[Rule]]:
    """Return all rules by their subject, in the order of the catalogue."""
    groups = {title: list[Rule]() for title in RULE_GROUPS.values()}
    for rule in all_rules():
        title = RULE_GROUPS.get(rule.id[3:4], rule.id) if rule.is_own else "of other packages"
        groups.setdefault(title, []).append(rule)
    return {title: rules for title, rules in groups.items() if rules}


class RuleBook(Result, dict[str, Rule]):
    """Rules by id; an unknown one is an error that names the nearest."""

    schema = "vinefab/rules-1"
    __iter__ = dict.__iter__  # type: ignore[assignment]  # over the ids, as of every dict

    @classmethod
    def of(cls, words: str | None = None) -> "RuleBook":
        """Return all rules, or those that words stand for.

        Raises
        ------
        UnknownNameError
            If there is no such rule.
        """
        rules = all_rules() if words is None else rules_named(words)
        return cls((rule.id, rule) for rule in rules)

    def __missing__(self, rule_id: str) -> Rule:
        raise UnknownNameError("rule", str(rule_id), self)

    def view(self) -> Iterator[Block]:
        """Yield one rule explained, or several under what they are about."""
        if len(self) == 1:
            yield from next(iter(self.values())).view()
            return
        for title, rules in grouped_rules().items():
            yield Rows(
                caption=title,
                headings=("rule", "what must hold", "limits"),
                rows=tuple(rule.cells for rule in rules if rule.id in self),
            )
        for name, why in RULES.broken.items():
            yield Remark(f"{name} does not load ({why})", "warning")
        yield Text("vinefab rules VF-C01 explains one of them")
        yield Data({"rules": [rule.content for rule in self.values()]})


_Entry = TypeVar("_Entry", bound=RuleRun | RuleSkipped | Finding)


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
    rules = [
        rule
        for rule in RULES.values()
        if (only is None or rule.id in only) and concerns(rule.id, subject.design)
    ]
    outcomes = [
        (rule, _outcome(rule, subject, rule.limits_under(values)))
        for rule in each("rules", rules, lambda rule: rule.title)
    ]
    recipe = subject.profile.recipe.name if subject.profile else ""
    report = _report(subject.design, outcomes)
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
    """Return the outcome of a rule; rules about one flat outline look at every piece of a robot."""
    if not subject.pieces or Scope.PIECES not in rule.on:
        return rule.apply(subject, limits)
    found = [rule.apply(piece, limits) for piece in subject.pieces]
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
    entries.sort(key=lambda entry: place.get(entry.rule, len(place)))
    return tuple(entries)


def run_rig_checks(subject: RigSubject) -> CheckReport:
    """Return the report of the rules about test rigs, the only ones that need no design."""
    design = subject.design
    rules = [rule for rule in _BUILTIN if Scope.RIG in rule.on]
    ids = {rule.id for rule in rules}
    own = tuple(limit for limit in (changed_limits(design) if design else ()) if limit.rule in ids)
    values = by_rule(own)
    outcomes = [(rule, rule.apply(subject, rule.limits_under(values))) for rule in rules]
    return replace(_report(design, outcomes), limits=own)


def _report(
    design: Design | None, outcomes: list[tuple[Rule, RuleApplied | RuleNotApplicable]]
) -> CheckReport:
    name, waivers = (design.name, design.waivers) if design else ("", ())
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
            for violation in outcome.violations:
                x_mm, y_mm = violation.at_mm or (None, None)
                # Without the measured value: a waiver must survive changes elsewhere in the design.
                known_as = fingerprint(rule.id, violation.aspect, *violation.branches)
                findings.append(
                    Finding(
                        rule=rule.id,
                        severity=violation.severity,
                        message=violation.message,
                        measured=violation.measured,
                        limit=violation.limit,
                        unit=rule.unit,
                        branches=violation.branches,
                        names=design.called(violation.branches) if design and design.names else (),
                        x_mm=x_mm,
                        y_mm=y_mm,
                        marker_wkt=violation.marker,
                        fingerprint=known_as,
                        title=violation.title or rule.broken,
                        waived=known_as in reasons,
                        reason=reasons.get(known_as, ""),
                    )
                )
        else:
            skipped.append(RuleSkipped(rule=rule.id, reason=outcome.reason))
    return CheckReport(
        design=name,
        recipe="",
        run=tuple(run),
        skipped=tuple(skipped),
        findings=tuple(findings),
    )


def checks_text(report: CheckReport, beside: Sequence[CheckReport] = ()) -> str:
    """Return the reports of a sheet as JSON, the first with those of the other designs."""
    others = [{"design": other.design, **other.content} for other in beside]
    more = {"beside": others} if others else {}
    return json_text(report.schema, {**document(report.view()), **more})
