"""The cache of compiled code notices edits to one file only."""

import ast
import re
from pathlib import Path

import pytest

import vinefab

KERNELS = sorted(Path(vinefab.__file__).parent.rglob("*kernel.py"))
ALLOWED = {"math", "collections", "typing", "numpy", "vinefab.core.compiling"}


def imports(path: Path) -> set[str]:
    found = set[str]()
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            found |= {name.name for name in node.names}
        elif isinstance(node, ast.ImportFrom):
            found.add(node.module or "")
    return found


@pytest.mark.parametrize("path", KERNELS, ids=lambda path: path.name)
def test_compiled_files_import_nothing_of_ours(path: Path) -> None:
    assert imports(path) <= ALLOWED
    assert "vinefab.core.compiling" in imports(path)


def test_all_that_is_compiled_stands_in_such_files() -> None:
    assert len(KERNELS) == 5
    others = set(Path(vinefab.__file__).parent.rglob("*.py")) - set(KERNELS)
    users = [path for path in others if "vinefab.core.compiling" in imports(path)]
    # They take `interpreted` of it.
    assert sorted(path.name for path in users) == ["benchmark_growths.py", "simulator.py"]
    assert not [path for path in users if re.search(r"\b(compiled|inlined)\(", path.read_text())]
