"""No text says ``1 branches``: counts in texts go through `counted`."""

import ast
import re
from pathlib import Path

import vinefab

WORDS = """arcs branches cells corners deployments designs edges elements entities evaluations files
findings folders gaps generations headings joints labels laps layers levels lines maps
obstacles outlines pairs parts passages paths pieces places plies points polygons poses
robots rules runs seeds segments sheets starts tiles tips trees triangles turns values
walls warnings widths workers
"""
PLURALS = frozenset(WORDS.split())

SOUND = {
    ("many", "pieces"),  # a text: at least 7
    ("than", "paths"),  # shorter or longer
    ("count", "pegs"),  # a key of rig.json
    ("operation", "paths"),  # a name
    ("operation", "runs"),
    ("most", "pairs"),  # a constant, as those in capitals
    ("shares", "starts"),  # of several maps
    ("poses", "poses"),  # of several robots
    ("poses", "robots"),
    ("wanted", "robots"),
    ("given", "deployments"),
    ("tags", "values"),  # over a limit
    ("name", "layers"),
    ("name", "maps"),
    ("count", "robots"),  # several
    ("verifying", "lines"),
    ("row", "generations"),  # 3/20
    ("given", "maps"),  # said where there are several
    ("rows", "cells"),
    ("cell", "edges"),
    ("deepest_nesting", "levels"),  # constants
    ("most_tiles", "tiles"),
    ("most", "branches"),
    ("beds", "sheets"),  # several
    ("count", "lines"),
    ("at", "lines"),
    ("wall_count", "corners"),  # too many
    ("columns", "parts"),
    ("branches", "branches"),  # numbers by level
    ("words", "poses"),  # from the same poses
}
"""Name before a plural and the plural: what is no count, or never one."""


def _name(value: ast.expr) -> str:
    """Return the last name in an expression."""
    names = [n.attr if isinstance(n, ast.Attribute) else n.id for n in ast.walk(value)
             if isinstance(n, ast.Attribute | ast.Name)]  # fmt: skip
    return next((name for name in names if name != "len"), "")


def counts_with_plurals(source: str) -> list[tuple[int, str, str]]:
    """Return line, name and plural of every count in an f-string that is followed by a plural."""
    if not re.search(r"\} (" + "|".join(PLURALS) + r")\b", source):  # most need no parser
        return []
    found = []
    for text in ast.walk(ast.parse(source)):
        if not isinstance(text, ast.JoinedStr):
            continue
        for count, words in zip(text.values, text.values[1:], strict=False):
            if not isinstance(count, ast.FormattedValue) or not isinstance(words, ast.Constant):
                continue
            word = words.value[1:].split(" ")[0].strip(".,;:)>'") if words.value[:1] == " " else ""
            name = _name(count.value)
            if word in PLURALS and not name.isupper() and count.format_spec is None:
                found.append((count.lineno, name, word))
    return found


def test_the_search_sees_a_count_with_a_plural_and_no_other():
    assert counts_with_plurals('f"{len(a.maps)} maps"') == [(1, "maps", "maps")]
    assert counts_with_plurals("""f"{counted(n, 'map')}, {MOST} maps, {n} mm" """) == []


def test_every_count_in_a_text_agrees_with_its_noun():
    root = Path(vinefab.__file__).parent
    studies = root / "studies"  # their counts are those of the sizes that they come in
    found = [
        f"{path.relative_to(root)}:{line}: {name} {word}"
        for path in sorted(root.rglob("*.py"))
        if not path.is_relative_to(studies)
        for line, name, word in counts_with_plurals(path.read_text())
        if (name, word) not in SOUND
    ]
    assert found == [], "counted(count, noun) of core/plain_text.py"
