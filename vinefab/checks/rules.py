"""All design rules by id, in the order in which reports list them."""

from vinefab.checks.base import CLAMP, REACH, TAIL
from vinefab.checks.built import BUILT_WIDTH, READBACK
from vinefab.checks.clearance import CLEARANCE, OVERLAP
from vinefab.checks.crotches import ANGLE, CROTCH, FILLET
from vinefab.checks.fillets import FOREIGN_FILLET
from vinefab.checks.paths import MARKS, ORDER, PATHS
from vinefab.checks.pouches import POUCH
from vinefab.checks.pressure import BURST, RATING, STRAIN
from vinefab.checks.recipe import MACHINE, PLY, STATUS
from vinefab.checks.rig import CORRIDORS, OBSTACLE_HEIGHT, RIG_SIZE, RIG_SOLIDS
from vinefab.checks.rule import Rule
from vinefab.checks.seams import SEAM_WIDTH
from vinefab.checks.sheet import BED, FILM
from vinefab.checks.tree import MOUTH, POLYGON, TREE
from vinefab.checks.turns import TURN
from vinefab.checks.widths import LEAST_WIDTH, PACKING, WIDTH_RATIO
from vinefab.checks.window import WINDOW
from vinefab.core.registry import Registry

_BUILTIN = (
    *(TREE, POLYGON, OVERLAP, MOUTH),
    *(LEAST_WIDTH, WIDTH_RATIO, PACKING, BUILT_WIDTH),
    *(CLEARANCE, ANGLE, CROTCH, FILLET, FOREIGN_FILLET, TURN, POUCH),
    *(BURST, RATING, WINDOW, STRAIN, SEAM_WIDTH),
    *(TAIL, CLAMP, REACH),
    *(BED, FILM),
    *(MARKS, PATHS, ORDER, PLY, MACHINE, STATUS),
    READBACK,
    *(RIG_SOLIDS, RIG_SIZE, CORRIDORS, OBSTACLE_HEIGHT),
)


def _problem(name: str, part: object) -> str:
    """Return why a rule of another package cannot be used; empty if it can."""
    if not isinstance(part, Rule):
        return "is no vinefab.checks.rule.Rule"
    return "" if part.id == name else f"its id is {part.id}, not the name of its entry point"


RULES: Registry[Rule] = Registry(
    "rule", {rule.id: rule for rule in _BUILTIN}, group="vinefab.rules", problem=_problem
)

SHEET_RULES = frozenset(
    rule.id for rule in (BED, MARKS, PATHS, ORDER, PLY, MACHINE, STATUS, READBACK)
)
"""Rules about a sheet, its recipe and its files; on a sheet of several robots they look once."""
