"""Without numba few branches are grown, and all rules run; what needs it says so in one line."""

import subprocess
import sys

import pytest

from vinefab.maps.generators.grid import GridOptions, grid_map
from vinefab.model.files.shipped import shipped_root
from vinefab.model.map import map_text

BLOCKED = (
    "import sys; sys.modules['numba'] = None; "
    "from vinefab.cli.main import main; sys.exit(main(sys.argv[1:]))"
)
TARGETS = shipped_root() / "examples" / "grid_targets.toml"


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ("grow three_level_tree --map grid.geojson -q", 0),
        ("score plain_vine --maps grid.geojson -q", 0),
        ("check plain_vine -q", 0),
        ("fabricate plain_vine --out package --allow-uncalibrated -q", 0),
        ("report three_level_tree --maps grid.geojson --out report.html -q", 2),
        ("aim three_level_tree --map grid.geojson --task coverage -q", 2),
        (f"optimize {TARGETS} --out run -q", 2),
    ],
)
def test_a_command_works_or_names_the_package(tmp_path, words, code):
    (tmp_path / "grid.geojson").write_text(map_text(grid_map(1, GridOptions())), encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-c", BLOCKED, *words.split()],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        errors="replace",
        check=False,
    )
    assert done.returncode == code, done.stderr
    needed = "error: this command grows many branches, which needs numba: pip install numba\n"
    assert done.stderr == (needed if code else "")
    assert not list(tmp_path.glob("run")) or not any((tmp_path / "run").iterdir())
