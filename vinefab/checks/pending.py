"""Rules that this version knows of and cannot apply: reported as skipped, never left out."""

from vinefab.checks.rule import Limits, NotLooked, Rule
from vinefab.checks.subject import Subject

_LATER = "not implemented in this version"


def _pending(rule_id: str, title: str, reason: str, why_not: str) -> Rule:
    def look(_: Subject, __: Limits) -> NotLooked:
        return NotLooked(reason=why_not)

    return Rule(id=rule_id, title=title, reason=reason, look=look)


FOREIGN_FILLET = _pending(
    "VF-C05",
    "a fillet joins nothing but its own joint",
    "a fillet that swallows another branch's side changes the robot",
    f"{_LATER}; where a fillet and another branch cross, VF-T02 reports it",
)
