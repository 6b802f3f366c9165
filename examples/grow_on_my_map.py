"""Grow a robot on a map of your own.

Run it as ``python examples/grow_on_my_map.py OUT.svg``. A map is bounds and obstacles, in
millimetres; obstacles may touch and overlap. A pose is x and y in millimetres and the heading in
degrees.
"""

import sys

from shapely import box
from shapely.geometry import Point

import vinefab as vf


def main(target: str) -> None:
    world = vf.Map(
        name="my_bench",
        bounds=box(0.0, 0.0, 400.0, 500.0),
        obstacles=(
            box(60.0, 180.0, 170.0, 230.0),
            box(240.0, 260.0, 340.0, 300.0),
            Point(200.0, 400.0).buffer(40.0),
        ),
    )
    design = vf.Design.read("grid_explorer")
    deployment = design.grow(world, pose=(200, 20, 90), body="inflated")
    print(f"{int(deployment.deployed.sum())} of {len(deployment.tree)} branches came out")
    print(f"{deployment.grown_mm.sum():.0f} mm of {deployment.tree.total_length_mm:.0f} mm grown")
    deployment.write(target)


if __name__ == "__main__":
    main(sys.argv[1])
