"""Write the fabrication package and the report of shipped designs.

Run it as ``python examples/make_shipped_designs.py OUT [DESIGN ...]``; without designs it takes the
optimized ones. Every package is checked and read back; the report deploys the design on two maps.
"""

import sys
from pathlib import Path

import vinefab as vf

OPTIMIZED = {
    "grid_explorer": "grid",
    "grid_explorer_pieces": "grid",
    "cave_explorer": "cave",
    "cave_explorer_pieces": "cave",
    "six_branch_anchor": "cave",
}
"""Each with the environment that it was made for."""


def make(name: str, folder: Path) -> None:
    worlds = [vf.maps.generate(OPTIMIZED.get(name, "grid"), seed) for seed in (501, 502)]
    maps = [world.write(folder / f"{world.name}.geojson") for world in worlds]
    vf.fabricate(name, out=folder / name, allow_uncalibrated=True)
    vf.report(name, maps=maps, out=folder / f"{name}.html")


if __name__ == "__main__":
    target = Path(sys.argv[1])
    for design in sys.argv[2:] or OPTIMIZED:
        try:
            make(design, target)
        except vf.VinefabError as error:
            sys.exit(str(error))
        print(f"{design}: made, see {target / design}")
