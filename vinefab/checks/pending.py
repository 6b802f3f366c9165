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
RIG_SOLIDS = _pending(
    "VF-R01",
    "every rig part is a closed, oriented solid with the right volume",
    "slicers guess what an open mesh means",
    "needs a test rig; making one checks its parts",
)
RIG_SIZE = _pending(
    "VF-R02",
    "every rig part fits the printer",
    "a part that does not fit cannot be printed",
    "needs a test rig; making one checks its parts",
)
CORRIDORS = _pending(
    "VF-R03",
    "corridors are at least the inflated diameter of the branches meant to pass",
    "an inflated body does not pass a narrower gap",
    f"needs a map; {_LATER}",
)
OBSTACLE_HEIGHT = _pending(
    "VF-R04",
    "obstacle height at least 1.2 times the trunk's diameter",
    "a tube climbs over an obstacle that is lower",
    f"needs a test rig; {_LATER}",
)
