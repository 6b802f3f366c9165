"""Add a design rule of your own: how much film may be used.

Run it as ``python examples/add_a_rule.py``. A rule is a check with its id, its limits and a reason;
the first sentence of the check says what must hold. A rule of vinefab's own is one such function in
a file of `vinefab/fabrication/rules/`.
"""

from dataclasses import replace

from vinefab.fabrication.checking import subject_of
from vinefab.fabrication.rules.rule import Limits, RuleApplied, Subject, design_rule
from vinefab.model.design import Design
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.laser import read_profile


@design_rule(
    "MY-F01",
    broken="too much film in all branches",
    unit="m",
    warning=1.0,
    error=3.0,
    reason="our bench deploys no more than this in a minute [measured]",
)
def film_in_all_branches(subject: Subject, limits: Limits) -> RuleApplied:
    """All branches together take little film."""
    broken = limits.most(subject.design.tree.total_length_mm / 1000.0)
    message = "so much film is slow to evert: shorten or leave out branches"
    return RuleApplied.of_one(broken and replace(broken, message=message))


def main() -> None:
    rule, profile = film_in_all_branches, read_profile(DEFAULT_RECIPE)
    for name in ("plain_vine", "three_level_tree", "grid_explorer"):
        subject = subject_of(Design.read(name), profile)
        applied = rule.check(subject, rule.limits_with({}))
        found = [
            f"{v.severity}: {v.measured:.2f} {rule.unit}, {v.message}" for v in applied.violations
        ]
        print(f"{name}: {'; '.join(found) or 'keeps the rule'}")


if __name__ == "__main__":
    main()
