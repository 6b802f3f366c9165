"""All design rules by id, as a user reads them, and their limits as changed.

Recipe, design and command line change limits.
"""

from collections.abc import Iterable, Iterator, Mapping

from vinefab.core.errors import UnknownNameError, located
from vinefab.core.registry import Registry
from vinefab.core.view import Block, Data, Remark, Result, Rows, Text
from vinefab.fabrication.rules import (
    as_built,
    clearance,
    inflation_rules,
    joints,
    laser_rules,
    piece_rules,
    pressure_limits,
    rig_rules,
    tree_and_base,
    widths,
)
from vinefab.fabrication.rules.rule import LimitChanges, Rule
from vinefab.model.design import Design
from vinefab.model.finding import ChangedLimit
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
    "L": "laser",
    "X": "files",
    "R": "test rig",
}
"""What rules are about, by the letter in ids of vinefab's own, in the order of reports; those of
other packages stand last under their own names."""

_MODULES = (
    *(tree_and_base, widths, clearance, joints, pressure_limits, inflation_rules),
    *(as_built, piece_rules, laser_rules, rig_rules),
)
_BUILTIN = sorted(
    (one for module in _MODULES for one in vars(module).values() if isinstance(one, Rule)),
    key=lambda rule: ([*RULE_GROUPS].index(rule.id[3]), rule.id),
)


def _problem(name: str, part: object) -> str:
    """Return why a rule of another package cannot be used; empty if it can."""
    if not isinstance(part, Rule):
        return "is no vinefab.fabrication.rules.rule.Rule"
    return "" if part.id == name else f"its id is {part.id}, not the name of its entry point"


RULES: Registry[Rule] = Registry(
    "rule", {rule.id: rule for rule in _BUILTIN}, group="vinefab.rules", problem=_problem
)


def _ids(*rules: Rule) -> frozenset[str]:
    return frozenset(rule.id for rule in rules)


_OF_LASER = (
    *(laser_rules.BED, laser_rules.MARKS, laser_rules.PATHS, laser_rules.ORDER),
    *(laser_rules.MACHINE, piece_rules.PIECE_LABELS),
)

SHEET_RULES = _ids(*_OF_LASER, laser_rules.PLY, laser_rules.STATUS, as_built.READBACK)
"""Rules about a sheet, its recipe and its files: they run once on a sheet of several robots."""

ROOM_RULES = _ids(tree_and_base.POLYGON, tree_and_base.MOUTH, clearance.OVERLAP)
ROOM_RULES |= _ids(clearance.CLEARANCE, clearance.FOREIGN_FILLET, clearance.POUCH)
"""Rules about what lies side by side on one sheet: a robot that breaks them may go in pieces."""

PIECE_RULES = ROOM_RULES | _ids(as_built.BUILT_WIDTH, as_built.SEAM_WIDTH, laser_rules.FILM)
"""Rules that every piece of a robot passes by itself."""

JOB_RULES = _ids(*_OF_LASER, as_built.BUILT_WIDTH, as_built.SEAM_WIDTH)
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
    """Return all rules by what they are about, in the order of the catalogue."""
    groups = {title: list[Rule]() for title in RULE_GROUPS.values()}
    for rule in all_rules():
        title = RULE_GROUPS.get(rule.id[3:4], rule.id) if rule.is_own else "of other packages"
        groups.setdefault(title, []).append(rule)
    return {title: rules for title, rules in groups.items() if rules}


class RuleBook(Result, dict[str, Rule]):
    """Rules by id; an unknown one is an error that names the nearest."""

    schema = "vinefab/rules-1"

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
