"""All design rules by id, and their limits as changed by recipe, design and command line."""

from collections.abc import Iterable

from vinefab.core.errors import located
from vinefab.core.registry import Registry
from vinefab.fabrication.rules.as_built import BUILT_WIDTH, READBACK, SEAM_WIDTH
from vinefab.fabrication.rules.clearance import CLEARANCE, FOREIGN_FILLET, OVERLAP, POUCH
from vinefab.fabrication.rules.joints import ANGLE, CROTCH, FILLET, TURN
from vinefab.fabrication.rules.laser_rules import (
    BED,
    FILM,
    MACHINE,
    MARKS,
    ORDER,
    PATHS,
    PLY,
    STATUS,
)
from vinefab.fabrication.rules.piece_rules import (
    EASE,
    LAP,
    LAP_PACKING,
    PIECE_COUNT,
    PIECE_LABELS,
    SLEEVE_ROOM,
)
from vinefab.fabrication.rules.pressure_limits import BURST, RATING, STRAIN, WINDOW
from vinefab.fabrication.rules.rig_rules import CORRIDORS, OBSTACLE_HEIGHT, RIG_SIZE, RIG_SOLIDS
from vinefab.fabrication.rules.rule import LimitChanges, Rule
from vinefab.fabrication.rules.tree_and_base import (
    CLAMP,
    DEPLOYED_LENGTH,
    MOUTH,
    POLYGON,
    TAIL,
    TREE,
)
from vinefab.fabrication.rules.widths import LEAST_WIDTH, PACKING, WIDTH_RATIO
from vinefab.model.design import Design
from vinefab.model.finding import ChangedLimit
from vinefab.model.laser import LaserProfile

_BUILTIN = (
    *(TREE, POLYGON, OVERLAP, MOUTH),
    *(LEAST_WIDTH, WIDTH_RATIO, PACKING, BUILT_WIDTH),
    *(CLEARANCE, ANGLE, CROTCH, FILLET, FOREIGN_FILLET, TURN, POUCH),
    *(BURST, RATING, WINDOW, STRAIN, SEAM_WIDTH),
    *(TAIL, CLAMP, DEPLOYED_LENGTH),
    *(SLEEVE_ROOM, PIECE_COUNT, LAP, LAP_PACKING, PIECE_LABELS, EASE),
    *(BED, FILM),
    *(MARKS, PATHS, ORDER, PLY, MACHINE, STATUS),
    READBACK,
    *(RIG_SOLIDS, RIG_SIZE, CORRIDORS, OBSTACLE_HEIGHT),
)


def _problem(name: str, part: object) -> str:
    """Return why a rule of another package cannot be used; empty if it can."""
    if not isinstance(part, Rule):
        return "is no vinefab.fabrication.rules.rule.Rule"
    return "" if part.id == name else f"its id is {part.id}, not the name of its entry point"


RULES: Registry[Rule] = Registry(
    "rule", {rule.id: rule for rule in _BUILTIN}, group="vinefab.rules", problem=_problem
)

SHEET_RULES = frozenset(
    rule.id for rule in (BED, MARKS, PATHS, ORDER, PLY, MACHINE, STATUS, READBACK, PIECE_LABELS)
)
"""Rules about a sheet, its recipe and its files: they run once on a sheet of several robots."""

ROOM_RULES = frozenset(
    rule.id for rule in (POLYGON, OVERLAP, MOUTH, CLEARANCE, FOREIGN_FILLET, POUCH)
)
"""Rules about what lies side by side on one sheet: a robot that breaks them may go in pieces."""

PIECE_RULES = ROOM_RULES | {BUILT_WIDTH.id, SEAM_WIDTH.id, FILM.id}
"""Rules that every piece of a robot passes by itself."""

JOB_RULES = frozenset(
    rule.id for rule in (BUILT_WIDTH, SEAM_WIDTH, BED, MARKS, PATHS, ORDER, MACHINE, PIECE_LABELS)
)
"""Rules about the paths of the laser; a rule of another package may ask for them too."""

FLAT_RULES = frozenset(rule.id for rule in _BUILTIN) - JOB_RULES
"""Rules that need no paths of the laser."""

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
