"""A run compiles beforehand all that it needs, and no more."""

import subprocess
import sys

import pytest

from vinefab.model.files.shipped import shipped_root

RUN = """
import sys
from vinefab.app.searching import optimize
from vinefab.core import compiling
from vinefab.search.settings import read_run
asked = set()
def note(functions):
    asked.update(functions)
import vinefab.search.run as run
run.precompile = note
settings = read_run(sys.argv[1])
settings = settings.changed(search=settings.search.changed(population=16, generations=2))
optimize(settings, out="run", progress=False, page=False)
used = {
    f"{module}.{name}".removeprefix("vinefab.")
    for module, content in sys.modules.items() if module.endswith("kernel")
    for name, function in vars(content).items()
    if hasattr(function, "overloads") and hasattr(function._cache, "places") and function.overloads
}
print(*sorted(used - {"growth.kernel.grow_branches"}))
print(*sorted(asked))
"""


@pytest.mark.parametrize(
    "name",
    [
        "grid_targets",
        pytest.param("grid_pieces", marks=pytest.mark.thorough),
        pytest.param("grid_coverage", marks=pytest.mark.thorough),
        pytest.param("six_branch_anchor", marks=pytest.mark.thorough),
    ],
)
def test_functions_compiled_before_a_run_are_those_that_it_uses(name, tmp_path):
    file = shipped_root() / "examples" / f"{name}.toml"
    done = subprocess.run(
        [sys.executable, "-c", RUN, str(file)],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    used, asked = done.stdout.splitlines()[-2:]
    assert used == asked
