"""Write printable obstacles of a generated map, as a test rig for the bench.

Run it as ``python examples/make_a_rig.py OUT``.
"""

import sys
from pathlib import Path

from vinefab.maps.generators.pegs import PegsOptions, pegs_map
from vinefab.model.files.shipped import DEFAULT_PRINTER
from vinefab.rig.make import make_rig
from vinefab.rig.options import RigOptions, read_printer


def main(folder: Path) -> None:
    world = pegs_map(seed=4, options=PegsOptions(columns=6, rows=6))
    made = make_rig(world, read_printer(DEFAULT_PRINTER), RigOptions(height_mm=30.0))
    folder.mkdir(parents=True, exist_ok=True)
    for name, data in made.files.items():
        (folder / name).write_bytes(data)
    print(f"{len(made.rig.parts)} parts of {world.name}, {len(made.files)} files in {folder}")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
