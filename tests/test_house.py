"""Rules of the house that no linter knows: names that are bound once, and plain language."""

import ast
import io
import re
import sys
import tokenize
from collections import Counter, defaultdict
from functools import cache
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))

from written_lines import BANNED

TESTS = Path(__file__).parent
SOURCE = TESTS.parent / "vinefab"
MODULES = {path.relative_to(SOURCE).as_posix(): path for path in SOURCE.rglob("*.py")}


@cache
def parsed(text):
    """Return what stands at the top level of a module."""
    return ast.parse(text).body


def bound_names(text):
    """Yield the names that a module binds at its top level, imports excepted."""
    for node in parsed(text):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
            if not any(ast.unparse(one).endswith("overload") for one in node.decorator_list):
                yield node.name
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            bare = [one for one in targets if not isinstance(one, ast.Attribute)]
            named = [one for target in bare for one in ast.walk(target)]
            yield from (one.id for one in named if isinstance(one, ast.Name))


def written_in(text):
    """Return the docstrings, messages and comments of a module, one text."""
    tokens = tokenize.generate_tokens(io.StringIO(text).readline)
    kinds = (tokenize.STRING, tokenize.COMMENT)
    text = "\n".join(token.string for token in tokens if token.type in kinds)
    # The parameter of that name, and its values in texts.
    return re.sub(r"\{[^{}]*\}|[\"`]beside[\"`]", "", text)


def test_a_name_that_is_bound_twice_is_found():
    assert Counter(bound_names("_RIM_MM = 15.0\nX, _RIM_MM = 1, 12.0\n"))["_RIM_MM"] == 2


def test_no_module_binds_a_name_twice():
    """A constant of one name with two values: the first function means the second value."""
    counts = {name: Counter(bound_names(path.read_text("utf-8"))) for name, path in MODULES.items()}
    twice = {name: [one for one, n in found.items() if n > 1] for name, found in counts.items()}
    assert {name: found for name, found in twice.items() if found} == {}


def imported_names(path):
    """Yield the names that a program takes from vinefab's modules."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("vinefab"):
            yield from ((node.module, one.name) for one in node.names)


def test_programs_that_no_test_loads_import_names_that_exist():
    """Campaigns run before a release only: a name that moved must be noticed before."""
    paths = [path for path in TESTS.rglob("*.py") if "node_modules" not in path.parts]
    programs = [path for path in paths if not path.name.startswith("test_")]
    names = {name for path in programs for name in imported_names(path)}
    gone = [
        (module, name)
        for module, name in names
        if not hasattr(import_module(module), name) and find_spec(f"{module}.{name}") is None
    ]
    assert len(programs) > 50
    assert gone == []


def test_public_functions_and_classes_are_defined_once():
    places = defaultdict(list)
    for name, path in MODULES.items():
        for node in parsed(path.read_text("utf-8")):
            if isinstance(node, ast.FunctionDef | ast.ClassDef) and not node.name.startswith("_"):
                places[node.name].append(name)
    assert {name: found for name, found in places.items() if len(set(found)) > 1} == {}


def test_the_source_has_no_banned_turn():
    texts = {name: written_in(path.read_text("utf-8")) for name, path in MODULES.items()}
    found = {name: BANNED.findall(text) for name, text in texts.items()}
    assert {name: turns for name, turns in found.items() if turns} == {}
