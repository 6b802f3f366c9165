"""Compiled code: what it is made from, the cache of it, and compiling it beforehand."""

import ast
import importlib
import math
import os
import platform
import re
import shutil
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numba
import numpy as np
import pytest

import vinefab
from vinefab.core import compiling
from vinefab.core.user_cache import KeptFiles

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


DAMAGE = {
    "empty": lambda _: b"",
    "cut": lambda data: data[: len(data) // 2],
    "flipped": lambda data: data[:-9] + bytes([data[-9] ^ 1]) + data[-8:],
}


@pytest.fixture
def toy(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], Any]]:
    """A module of one kernel with some text, loaded anew, and a cache of its own."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("VINEFAB_CACHE_DIR", str(tmp_path / "cache"))
    path = tmp_path / "toy_kernel.py"

    def doubled(text: str = "def doubled(x):\n    return 2.0 * x\n") -> Any:
        path.write_text(text)
        compiling._source.cache_clear()
        sys.modules.pop("toy_kernel", None)
        importlib.invalidate_caches()
        shutil.rmtree(tmp_path / "__pycache__", ignore_errors=True)
        return compiling.compiled(importlib.import_module("toy_kernel").doubled)

    yield doubled
    sys.modules.pop("toy_kernel", None)
    compiling._source.cache_clear()


def called(doubled: Any) -> tuple[float, int]:
    return doubled(4.0), sum(doubled.stats.cache_hits.values())


@pytest.mark.parametrize("damaged", DAMAGE.values(), ids=DAMAGE)
def test_a_damaged_file_of_code_is_replaced(toy, tmp_path: Path, damaged) -> None:
    assert [called(toy()), called(toy())] == [(8.0, 0), (8.0, 1)]
    (kept,) = (tmp_path / "cache" / "code").iterdir()
    whole = kept.read_bytes()
    kept.write_bytes(damaged(whole))
    assert [called(toy()), called(toy())] == [(8.0, 0), (8.0, 1)]
    assert [path.name for path in kept.parent.iterdir()] == [kept.name]
    assert len(kept.read_bytes()) == len(whole)


def test_code_that_names_a_type_of_an_earlier_version_is_compiled_anew(toy, tmp_path: Path) -> None:
    called(toy())
    (kept,) = (tmp_path / "cache" / "code").iterdir()
    gone = b"cvinefab.growth.kernel\n_Gone\n."
    KeptFiles(kept.parent, ".code", 1 << 20).write(kept.name.removesuffix(".code"), gone)
    assert [called(toy()), called(toy())] == [(8.0, 0), (8.0, 1)]


@pytest.mark.thorough
def test_code_that_a_wheel_brought_is_compiled_for_the_own_processor_meanwhile(
    tmp_path: Path,
) -> None:
    """A child process finds brought code where the package has it: a copy of the package."""
    site, name = tmp_path / "site", "tasks.tips_kernel.gaps"
    shutil.copytree(Path(vinefab.__file__).parent, site / "vinefab")
    brought, own = site / "vinefab" / "_shipped" / "code", tmp_path / "own" / "code"
    generic = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
    script = (
        f"import time, vinefab.core.compiling as c; names = [{name!r}]\n"
        "with c.tuned_meanwhile(names, 0.01):\n"
        "    c.precompile(names)\n"
        "    ends_s = time.monotonic() + 120\n"
        "    while not c._own_code().folder.is_dir() and time.monotonic() < ends_s:\n"
        "        time.sleep(0.05)\n"
        "    while not list(c._own_code().folder.glob('*.code')) and time.monotonic() < ends_s:\n"
        "        time.sleep(0.05)\n"
    )

    def run(text: str, **environment: str) -> None:
        settings = {**os.environ, "PYTHONPATH": str(site), **environment}
        subprocess.run([sys.executable, "-P", "-c", text], env=settings, cwd=tmp_path, check=True)

    making = f"import vinefab.core.compiling as c; c.precompile([{name!r}])"
    run(making, VINEFAB_CACHE_DIR=str(brought.parent), **generic)
    assert list(brought.glob("*.code"))
    run(making, VINEFAB_CACHE_DIR=str(own.parent))
    assert not own.exists()  # brought code is enough
    run(script, VINEFAB_CACHE_DIR=str(own.parent))
    assert len(list(own.glob("*.code"))) == 1
    run(script.replace("0.01", "0"), VINEFAB_CACHE_DIR=str(own.parent))
    assert len(list(own.glob("*.code"))) == 1


def test_code_is_found_by_the_content_of_its_source(toy, tmp_path: Path) -> None:
    other = "def doubled(x):\n    return 3.0 * x\n"
    assert [called(toy()), called(toy(other))] == [(8.0, 0), (12.0, 0)]
    assert [called(toy()), called(toy(other))] == [(8.0, 1), (12.0, 1)]
    assert not [path for path in tmp_path.rglob("*.nb?") if path.is_file()]


def test_the_files_that_were_used_longest_ago_are_pruned(tmp_path: Path) -> None:
    kept = KeptFiles(tmp_path / "code", ".code", 1200)
    for age, name in ((3, "old"), (2, "older"), (1, "new")):
        kept.write(name, b"x" * 300)
        os.utime(kept.folder / f"{name}.code", (1e9 - 1e6 * age,) * 2)
    (kept.folder / "killed.unfinished").touch()
    os.utime(kept.folder / "killed.unfinished", (1e9, 1e9))
    assert kept.read("old") == b"x" * 300  # which counts as used now
    kept.write("newest", b"y" * 300)
    names = sorted(path.stem for path in kept.folder.iterdir())
    assert names == ["new", "newest", "old"]


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


# --- Compiling beforehand: in fresh processes, where nothing is compiled yet ----------------------

SMALL = ("growth.batch_kernel.plan_trees", "growth.batch_kernel.gather_tips")

PRECOMPILE = f"""
import sys
from vinefab.core import compiling, helpers
heard = []
compiling._WORTH_S = 0.0
compiling._processors = lambda: 2
exec(sys.argv[1])
with compiling.listening(heard.append):
    compiling.precompile({SMALL!r})
assert compiling.lacking({SMALL!r}) == (), "lacking"
assert compiling.current() is None
here = [name for name in {SMALL!r} if compiling._function(name).overloads]
print(len(here), *[f"{{one.number}}/{{one.total}}{{'.' * one.is_done}}" for one in heard])
"""


def precompiled(cache: Path, before: str = "") -> list[str]:
    (done,) = run_together(cache, before)
    return done


def run_together(cache: Path, *each: str) -> list[list[str]]:
    started = [
        subprocess.Popen(
            [sys.executable, "-c", PRECOMPILE, before],
            env=os.environ | {"VINEFAB_CACHE_DIR": str(cache)},
            stdout=subprocess.PIPE,
            text=True,
        )
        for before in each
    ]
    words = [process.communicate()[0].split() for process in started]
    assert [process.returncode for process in started] == [0] * len(each)
    return words


def test_two_processes_compile_what_is_lacking_and_listeners_hear_of_it(tmp_path: Path) -> None:
    here, *heard = precompiled(tmp_path)
    assert (here, heard[-1], set(heard)) == ("1", "2/2.", {"1/2", "2/2", "1/2.", "2/2."})
    assert precompiled(tmp_path) == ["0"]
    for path in (tmp_path / "code").iterdir():
        path.write_bytes(path.read_bytes()[:-1])
    assert precompiled(tmp_path)[-1] == "2/2."


@pytest.mark.parametrize(
    "without",
    [
        pytest.param("sys.executable = ''", marks=pytest.mark.thorough),
        pytest.param("compiling._processors = lambda: 1", marks=pytest.mark.thorough),
        "helpers._PROGRAM = 'raise SystemExit(3)'",
        pytest.param("helpers._PROGRAM = 'input(); print(0)'", marks=pytest.mark.thorough),
    ],
    ids=["no interpreter", "one processor", "the helper ends", "the helper answers wrongly"],
)
def test_without_another_process_this_one_compiles_all(tmp_path: Path, without) -> None:
    assert precompiled(tmp_path, without)[0] == "2"
    assert precompiled(tmp_path) == ["0"]


@pytest.mark.thorough
def test_two_commands_that_compile_at_once_lose_nothing(tmp_path: Path) -> None:
    alone = "compiling._processors = lambda: 1"
    run_together(tmp_path, alone, alone)  # one may find some that the other has compiled
    assert precompiled(tmp_path) == ["0"]
    assert len(list((tmp_path / "code").iterdir())) == len(SMALL)
