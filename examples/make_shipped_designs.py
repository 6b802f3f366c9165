"""Write the fabrication package and the report of shipped designs.

Run it as ``python examples/make_shipped_designs.py OUT [DESIGN ...]``; without designs it takes the
optimized ones. Every package is checked and read back; the report deploys the design on two maps.
"""

import sys
from pathlib import Path

from vinefab.cli.main import main as vinefab

OPTIMIZED = {"grid_explorer": "grid", "cave_explorer": "cave", "six_branch_anchor": "cave"}
"""Each with the environment that it was made for."""


def make(name: str, folder: Path) -> int:
    """Return the worst exit code of making one design: 0 when all is well."""
    environment = OPTIMIZED.get(name, "grid")
    maps = [folder / f"{environment}_{seed}.geojson" for seed in (501, 502)]
    drawn = ["--maps", str(maps[0]), "--maps", str(maps[1])]
    commands = [
        *(["map", environment, "--seed", path.stem[-3:], "--out", str(path)] for path in maps),
        ["check", name],
        ["fabricate", name, "--allow-uncalibrated", "--out", str(folder / name)],
        ["report", name, *drawn, "--out", str(folder / f"{name}.html")],
    ]
    return max(vinefab([*command, "-q"]) for command in commands)


if __name__ == "__main__":
    target = Path(sys.argv[1])
    for design in sys.argv[2:] or OPTIMIZED:
        code = make(design, target)
        print(f"{design}: {'made' if code == 0 else f'exit code {code}'}, see {target / design}")
        if code:
            sys.exit(code)
