"""The design rules as a user reads them: a list, and one rule explained."""

from collections.abc import Iterator, Mapping

from vinefab.core.errors import UnknownNameError
from vinefab.core.view import Block, Data, Remark, Result, Rows, Text
from vinefab.fabrication.rules.catalog import RULES
from vinefab.fabrication.rules.rule import Rule

RULE_GROUPS: Mapping[str, str] = {
    "T": "tree and outline",
    "W": "widths",
    "C": "clearance and joints",
    "P": "pressure and seams",
    "B": "base and reach",
    "J": "pieces and laps",
    "S": "sheet",
    "L": "laser",
    "X": "files",
    "R": "test rig",
}
"""What rules are about, by the letter in ids of vinefab's own; those of other packages stand last
under their own names."""


def all_rules() -> list[Rule]:
    """Return the rules of vinefab and of other packages that load."""
    RULES.load_plugins()
    return list(RULES.values())


def rules_named(words: str) -> list[Rule]:
    """Return the rule with an id, else those with the words in their id, title or group.

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
        if sought and sought in f"{rule.id} {rule.title} {group}".casefold()
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
