"""A design rule: no more film than the shelf holds."""

from dataclasses import replace

from vinefab.fabrication.rules.rule import Limits, RuleApplied, Subject, design_rule


@design_rule(
    "MYLAB-01",
    broken="more film than is in stock",
    unit="m",
    warning=1.0,
    error=5.0,
    reason="the shelf of my lab (an example)",
    remedy="shorten or leave out branches, or order film",
)
def film_in_stock(subject: Subject, limits: Limits) -> RuleApplied:
    """All branches together take no more film than is in stock."""
    broken = limits.most(subject.design.tree.total_length_mm / 1000.0)
    message = "more film than is in stock: shorten or leave out branches"
    return RuleApplied.of_one(broken and replace(broken, message=message))
