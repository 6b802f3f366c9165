"""A design rule: no more film than the shelf holds."""

from vinefab.fabrication.rules.rule import Limits, Rule, RuleApplied, Subject, Violation
from vinefab.model.tree import branch_tree


def check_film(subject: Subject, limits: Limits) -> RuleApplied:
    """MYLAB-01: all branches together take no more film than there is."""
    film_m = branch_tree(subject.design).total_length_mm / 1000.0
    broken = limits.most(film_m)
    if broken is None:
        return RuleApplied(checked=1)
    violation = Violation(
        message="more film than is in stock: shorten or leave out branches",
        severity=broken.severity,
        measured=film_m,
        limit=broken.limit,
    )
    return RuleApplied(checked=1, violations=(violation,))


FILM_IN_STOCK = Rule(
    id="MYLAB-01",
    title="no more film than is in stock",
    unit="m",
    limits={"warning": 1.0, "error": 5.0},
    reason="the shelf of my lab (an example)",
    remedy="shorten or leave out branches, or order film",
    check=check_film,
)
