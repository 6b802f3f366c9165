"""Add a design rule of your own: how much film may be used.

Run it as ``python examples/add_a_rule.py``. A rule is an id, what must hold, limits, a reason, and
a function that checks a subject and returns the violations. A rule of vinefab's own is one such
object in `vinefab/fabrication/rules/` and a line in its `catalog.py`.
"""

from vinefab.fabrication.checking import subject_of
from vinefab.fabrication.rules.rule import Limits, Rule, RuleApplied, Subject, Violation
from vinefab.model.design import Design
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.laser import read_profile
from vinefab.model.tree import branch_tree


def check_film_length(subject: Subject, limits: Limits) -> RuleApplied:
    """MY-F01: all branches together take no more film than the limits."""
    film_m = branch_tree(subject.design).total_length_mm / 1000.0
    broken = limits.most(film_m)
    if broken is None:
        return RuleApplied(checked=1)
    violation = Violation(
        message="so much film is slow to evert: shorten or leave out branches",
        severity=broken.severity,
        measured=film_m,
        limit=broken.limit,
    )
    return RuleApplied(checked=1, violations=(violation,))


RULE = Rule(
    id="MY-F01",
    title="film in all branches",
    unit="m",
    limits={"warning": 1.0, "error": 3.0},
    reason="our bench deploys no more than this in a minute [measured]",
    check=check_film_length,
)


def main() -> None:
    profile = read_profile(DEFAULT_RECIPE)
    for name in ("plain_vine", "three_level_tree", "grid_explorer"):
        subject = subject_of(Design.read(name), profile)
        applied = RULE.check(subject, RULE.limits_with({}))
        found = [
            f"{v.severity}: {v.measured:.2f} {RULE.unit}, {v.message}" for v in applied.violations
        ]
        print(f"{name}: {'; '.join(found) or 'keeps the rule'}")


if __name__ == "__main__":
    main()
