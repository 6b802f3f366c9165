"""The cache of compiled code notices edits to one file only."""

import ast
import importlib
import math
import pickle
import platform
import re
import sys
from pathlib import Path

import numba
import numpy as np
import pytest

import vinefab
from vinefab.core import compiling

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
    assert len(KERNELS) == 7
    others = set(Path(vinefab.__file__).parent.rglob("*.py")) - set(KERNELS)
    texts = {path: path.read_text() for path in others}
    users = [path for path, text in texts.items() if "from vinefab.core.compiling" in text]
    plain = [path for path in users if re.search(r"\b(interpreted|rebindable)\(", texts[path])]
    assert sorted(path.name for path in plain) == [
        "batch.py",
        "benchmark.py",
        "beside_prediction.py",
    ]
    assert not [path for path in users if re.search(r"\b(compiled|inlined)\(", texts[path])]


@pytest.mark.parametrize(
    "index",
    [pickle.dumps(numba.__version__) + b"cvinefab.growth.kernel\n_Gone\n.", b"", b"\0 no pickle"],
    ids=["a type of an earlier version", "empty", "damaged"],
)
def test_an_index_that_cannot_be_read_is_made_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, index: bytes
) -> None:
    """Here, numba raised what pickle did, at the first call of a user who had upgraded."""
    path = tmp_path / "toy_kernel.py"
    path.write_text("def doubled(x):\n    return 2.0 * x\n")

    monkeypatch.syspath_prepend(tmp_path)

    def called() -> tuple[float, int]:
        doubled = compiling.compiled(importlib.import_module("toy_kernel").doubled)
        return doubled(4.0), sum(doubled.stats.cache_hits.values())

    assert called() == (8.0, 0)
    assert called() == (8.0, 1)
    (kept,) = tmp_path.rglob("*.nbi")
    kept.write_bytes(index)
    assert called() == (8.0, 0)
    assert called() == (8.0, 1)
    del sys.modules["toy_kernel"]


def test_where_numba_is_told_to_compile_nothing_functions_stay(monkeypatch) -> None:
    monkeypatch.setattr(numba.config, "DISABLE_JIT", 1)
    assert compiling.compiled(_kept) is _kept


def _kept(points, ends):
    count = 0
    for k in range(len(points)):
        x, y = points[k, 0], points[k, 1]
        if (x * y > 3.0) | (x < y) | (x + y > 9.0) | (y * y < 0.5):
            continue
        ends[count] = math.sqrt(x) / math.sqrt(y + ends[0])
        count += 1
    return count


def test_joined_conditions_take_one_jump():
    """Seven jumps on x86; sixteen where LLVM takes the conditions apart (twice: unrolled)."""
    function = compiling._jit(_kept)
    assert function(np.ones((4, 2)), np.ones(4)) == _kept(np.ones((4, 2)), np.ones(4)) == 4
    (code,) = function.inspect_asm().values()
    if platform.machine() not in {"x86_64", "AMD64"}:
        pytest.skip("jumps are counted in x86 code")
    assert len(re.findall(r"\n\tj(?!mp)\w+", code.split(".size")[0])) < 12
