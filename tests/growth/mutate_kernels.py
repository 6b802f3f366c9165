"""Change the compiled kernels one place at a time, and check that a test fails.

For the whole table run ``python tests/growth/mutate_kernels.py``, for some rows add a part of
their module's name, such as ``tips``. Kernels run as plain Python, so that nothing is compiled. A
mutant survives where no test fails: then a test is missing.
"""

import os
import resource
import signal
import sys
import tempfile
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path
from typing import NamedTuple

import pytest

ROOT = Path(__file__).resolve().parents[2]
SECONDS = 200
"""A mutant that never ends is noticed after so much processor time."""

TESTS = {
    "growth.kernel": (
        "growth/test_analytic.py",
        "growth/test_degenerate.py",
        "growth/test_tree_growth.py",
        "growth/test_pressure_stop.py",
        "growth/test_engine_parts.py",
        "growth/test_metamorphic.py",
        "growth/test_batch.py",
        "growth/test_twins.py",
    ),
    "growth.contact_kernel": ("growth/test_branch_contact.py", "growth/test_emergence.py"),
    "growth.batch_kernel": (
        "search/test_design_batch.py",
        "tasks/test_fast_areas.py",
        "growth/test_bends.py",
    ),
    "tasks.areas_kernel": ("tasks/test_fast_areas.py", "tasks/test_reach.py"),
    "tasks.union_kernel": ("tasks/test_union_areas.py",),
    "tasks.tips_kernel": ("tasks/test_anchoring_force.py",),
}
"""Files of tests that hold each kernel, those that fail soonest first."""


class Mutant(NamedTuple):
    """One change: a text that stands once in a module, and what takes its place."""

    module: str
    old: str
    new: str


def mutants() -> Iterator[Mutant]:
    """Yield the rows of `kernel_mutants.txt`: ``# module``, then ``text => other text``."""
    module = ""
    for line in Path(__file__).with_name("kernel_mutants.txt").read_text().splitlines():
        if line.startswith("# "):
            module = line.removeprefix("# ")
        elif line:
            old, new = line.replace("\\n", "\n").split(" => ")
            yield Mutant(module, old, new)


def is_noticed(mutant: Mutant) -> bool:
    """Tell whether a test fails in a process where a kernel is changed."""
    room, name = mutant.module.split(".")
    with tempfile.TemporaryDirectory() as folder:
        source = (ROOT / "vinefab" / room / f"{name}.py").read_text()
        if source.count(mutant.old) != 1:
            raise SystemExit(f"{mutant.module}: this stands not once in it: {mutant.old!r}")
        changed = source.replace(mutant.old, mutant.new)
        compile(changed, name, "exec")  # an error of syntax is not a mutant
        Path(folder, f"{name}.py").write_text(changed)
        process = os.fork()
        if process == 0:
            resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS + 5))
            silence = os.open(os.devnull, os.O_WRONLY)
            os.dup2(silence, 1)
            os.dup2(silence, 2)
            import_module(f"vinefab.{room}").__path__.insert(0, folder)
            files = [str(ROOT / "tests" / file) for file in TESTS[mutant.module]]
            # What is said of compiled code alone cannot be seen here.
            options = ["-x", "-q", "-p", "no:cacheprovider", "-k", "not compiled"]
            os._exit(int(pytest.main([*options, *files])))
        _, status = os.waitpid(process, 0)
    ended = os.waitstatus_to_exitcode(status)
    if ended not in {pytest.ExitCode.OK, pytest.ExitCode.TESTS_FAILED, -signal.SIGXCPU}:
        raise SystemExit(f"{mutant.module}: the tests ended with {ended}")
    return ended != pytest.ExitCode.OK


def main() -> int:
    """Print every mutant that survived, and how many there are."""
    os.environ["NUMBA_DISABLE_JIT"] = "1"
    sys.path.insert(0, str(ROOT))
    import_module("vinefab.tasks.evaluate")  # once, not in every process
    some = [mutant for mutant in mutants() if all(word in mutant.module for word in sys.argv[1:])]
    for module in dict.fromkeys(mutant.module for mutant in some):
        if is_noticed(Mutant(module, "from vinefab.core", "from vinefab.core")):
            raise SystemExit(f"{module}: tests fail, or take too long, without any change")
    left = [mutant for mutant in some if not is_noticed(mutant)]
    for mutant in left:
        sys.stdout.write(f"survived: {mutant.module}: {mutant.old} -> {mutant.new}\n")
    sys.stdout.write(f"{len(some)} mutants of kernels, {len(left)} survived\n")
    return 1 if left or not some else 0


if __name__ == "__main__":
    sys.exit(main())
