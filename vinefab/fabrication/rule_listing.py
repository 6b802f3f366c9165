"""The design rules as a user reads them: a list, and one rule explained."""

from collections.abc import Iterable, Mapping

from vinefab.core.errors import UnknownNameError
from vinefab.core.front_door import front_door
from vinefab.core.jsontext import json_text
from vinefab.fabrication.rules.catalog import RULES
from vinefab.fabrication.rules.rule import Rule

_SCHEMA = "vinefab/rules-1"

PICTURES_PAGE = "docs/reference/rules.md in vinefab's source (not in the installed package)"
"""Where every rule stands with its picture."""

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


def rule_list() -> list[str]:
    """Return one line for every rule, under what it is about."""
    lines = list[str]()
    for title, rules in grouped_rules().items():
        lines.append(title)
        lines += [f"  {_rule_line(rule)}" for rule in rules]
    lines += [f"  {name}  does not load ({why})" for name, why in RULES.broken.items()]
    lines.append("vinefab rules VF-C01 explains one of them")
    return lines


def _rule_line(rule: Rule) -> str:
    return f"{rule.id}  {rule.title}{limits_text(rule, ' ({})')}"


def explain_rule(words: str) -> list[str]:
    """Return a rule as lines: what must hold, limits, reason, remedy, change, picture.

    Of several rules that words stand for, return one line each.

    Raises
    ------
    UnknownNameError
        If there is no such rule.
    """
    rule, *others = rules_named(words)
    return [_rule_line(one) for one in (rule, *others)] if others else rule_lines(rule)


def rule_lines(rule: Rule) -> list[str]:
    """Return a rule as lines: what must hold, limits, reason, remedy, how to change it."""
    lines = [f"{rule.id}: {rule.title}", f"  why: {rule.reason}"]
    if rule.remedy:
        lines.append(f"  remedy: {rule.remedy}")
    lines += [f"  limit {limit_text(rule, name)}" for name in rule.limits]
    if rule.limits:
        first = next(iter(rule.limits))
        change = f"[limits.{rule.id}] {first} = ..., or check --limit {rule.id}.{first}=..."
        lines.append(f"  to change a limit for one design: {change}")
    lines.append("  to accept one finding: [[waive]] with its fingerprint and a reason")
    if _is_own(rule):
        lines.append(f"  picture: {PICTURES_PAGE}")
    return lines


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
        title = RULE_GROUPS[rule.id[3]] if _is_own(rule) else "of other packages"
        groups.setdefault(title, []).append(rule)
    return {title: rules for title, rules in groups.items() if rules}


def _is_own(rule: Rule) -> bool:
    return rule.id.startswith("VF-") and rule.id[3:4] in RULE_GROUPS


class RuleBook(dict[str, Rule]):
    """Rules by id; an unknown one is an error that names the nearest."""

    words: str | None = None  # that chose them

    @classmethod
    def of(cls, rules: Iterable[Rule], *, words: str | None = None) -> "RuleBook":
        """Return some rules, and the words that chose them."""
        book = cls((rule.id, rule) for rule in rules)
        book.words = words
        return book

    @property
    def summary(self) -> tuple[str, ...]:
        """The list in lines; one rule that was chosen explained."""
        return tuple(rule_list() if self.words is None else explain_rule(self.words))

    def json_text(self) -> str:
        """Return the rules as JSON: ``vinefab/rules-1``."""
        return rules_json(self.words)

    def __missing__(self, rule_id: str) -> Rule:
        raise UnknownNameError("rule", str(rule_id), self)

    def _repr_html_(self) -> str:
        """Show the list in a notebook."""
        shown: str = front_door().html_of(self)
        return shown


def rules_json(words: str | None = None) -> str:
    """Return all rules, or those that words stand for, as JSON."""
    rules = all_rules() if words is None else rules_named(words)
    content = [
        {
            "id": rule.id,
            "title": rule.title,
            "unit": rule.unit,
            "limits_in": rule.limit_unit,
            "limits": dict(rule.limits),
            "reason": rule.reason,
            "remedy": rule.remedy,
        }
        for rule in rules
    ]
    return json_text(_SCHEMA, {"rules": content})


def limit_text(rule: Rule, name: str) -> str:
    """Return a limit with its unit; those that are no error or warning have theirs in the name."""
    unit = rule.limit_unit if name.endswith(("error", "warning")) else ""
    return f"{name}: {rule.limits[name]:g} {unit}".rstrip()


def limits_text(rule: Rule, form: str) -> str:
    """Return error and warning limits in a form with one place; nothing where there are none."""
    parts = [
        f"{name} {rule.limits[name]:g}" for name in ("error", "warning") if name in rule.limits
    ]
    return form.format(f"{', '.join(parts)} {rule.limit_unit}".strip()) if parts else ""
