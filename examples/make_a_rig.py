"""Write printable obstacles of a generated map, as a test rig for the bench.

Run it as ``python examples/make_a_rig.py OUT``.
"""

import sys

import vinefab as vf


def main(folder: str) -> None:
    world = vf.maps.pegs(seed=4, columns=6, rows=6)
    made = vf.rig(world, printer="generic_220", out=folder, height_mm=30.0)
    parts = [name for name in made.files if name.endswith(".stl")]
    print(f"{len(parts)} parts of {world.name}, {len(made.files)} files in {made.path}")


if __name__ == "__main__":
    main(sys.argv[1])
