"""Disable and weaken every design rule in turn, and check that its fixtures notice.

For the whole table run ``python tests/fabrication/rules/mutate.py``. A mutant survives where no
fixture of its rule changes: then a test is missing.
"""

import sys
from dataclasses import dataclass, replace
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[3]))

from tests.fabrication.rules.test_rules import FIXTURES
from vinefab.fabrication.rules.catalog import RULES
from vinefab.fabrication.rules.rule import RuleApplied
from vinefab.model.finding import Severity

FACTORS = (0.9, 1.1)
"""A limit is lax at one of these; which one, its fixtures show."""

ZERO_BECOMES = (-0.5, 0.5)
ALIKE = {
    ("VF-C03", "lax error"): "the outline itself has no exact form beyond one half",
    ("VF-P03", "lax tight_kpa"): "a note alone says what a tight spool would take",
}
"""Mutants that cannot be told from the rule, with the reason."""

_WEIGHTS = {Severity.ERROR: 3, Severity.WARNING: 2, Severity.INFO: 1}

Outcome = tuple[int, ...]
"""Weights of the findings of one fixture, most severe first."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """One rule: its fixtures, its mutants, and those that no fixture noticed."""

    rule: str
    fires: int
    quiet: int
    mutants: int
    survivors: tuple[str, ...]


def subjects(rule_id):
    """Return every fixture of a rule, built once."""
    return [build() for rule, build, _ in FIXTURES if rule == rule_id]


def outcome(rule, subject):
    """Return what a rule finds in a fixture."""
    applied = rule.apply(subject, rule.limits_with({}))
    violations = applied.violations if isinstance(applied, RuleApplied) else ()
    return tuple(sorted((_WEIGHTS[violation.severity] for violation in violations), reverse=True))


def mutants(rule):
    """Yield every mutant by name; a limit's is one of two, as only one of them is lax."""
    yield "switched off", (replace(rule, check=lambda *_: RuleApplied(checked=1)),)
    for name, value in rule.limits.items():
        values = [value * factor for factor in FACTORS] if value else ZERO_BECOMES
        yield f"lax {name}", tuple(replace(rule, limits={**rule.limits, name: v}) for v in values)


def weaker(found, before):
    """Return whether some fixture yields less than it should."""
    return any(now < then for now, then in zip(found, before, strict=True))


def mutate(rule_id):
    """Return how the fixtures of one rule stand up to its mutants."""
    rule, cases = RULES[rule_id], subjects(rule_id)
    before = [outcome(rule, subject) for subject in cases]
    count, survivors = 0, []
    for name, variants in mutants(rule):
        if (rule_id, name) in ALIKE:
            continue
        count += 1
        found = ([outcome(variant, subject) for subject in cases] for variant in variants)
        if not any(weaker(one, before) for one in found):
            survivors.append(name)
    fires = sum(bool(one) for one in before)
    return Row(
        rule=rule_id,
        fires=fires,
        quiet=len(before) - fires,
        mutants=count,
        survivors=tuple(survivors),
    )


def main():
    rows = [mutate(rule_id) for rule_id in RULES]
    report("rule    fire quiet mutants  survived")
    for row in rows:
        survived = ", ".join(row.survivors) or "-"
        report(f"{row.rule}  {row.fires:4d} {row.quiet:5d} {row.mutants:7d}  {survived}")
    total, left = sum(row.mutants for row in rows), sum(len(row.survivors) for row in rows)
    report(f"{len(rows)} rules, {total} mutants, {left} survived")
    return 1 if left else 0


def report(line):
    sys.stdout.write(f"{line}\n")


if __name__ == "__main__":
    sys.exit(main())
