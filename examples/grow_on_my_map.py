"""Grow a robot on a map of your own.

Run it as ``python examples/grow_on_my_map.py OUT.svg``. A map is bounds, obstacles and a start, in
millimetres; obstacles may touch and overlap.
"""

import math
import sys
from pathlib import Path

from shapely import box
from shapely.geometry import Point

from vinefab.growth.options import GrowthOptions
from vinefab.growth.simulator import grow
from vinefab.growth.terrain import Terrain
from vinefab.model.files.design_toml import read_design
from vinefab.model.map import Map, Pose, Start
from vinefab.pages.drawing import deployment_plan
from vinefab.pages.figure import svg_bytes


def main(target: Path) -> None:
    start = Pose(x_mm=200.0, y_mm=20.0, heading_rad=math.pi / 2)
    world = Map(
        name="my_bench",
        bounds=box(0.0, 0.0, 400.0, 500.0),
        obstacles=(
            box(60.0, 180.0, 170.0, 230.0),
            box(240.0, 260.0, 340.0, 300.0),
            Point(200.0, 400.0).buffer(40.0),
        ),
        starts=(Start(pose=start),),
    )
    design = read_design("grid_explorer")
    options = GrowthOptions(body="inflated")
    deployment = grow(design, Terrain.of(world), start, options)
    print(f"{int(deployment.deployed.sum())} of {len(deployment.tree)} branches came out")
    print(f"{deployment.grown_mm.sum():.0f} mm of {deployment.tree.total_length_mm:.0f} mm grown")
    target.write_bytes(svg_bytes(deployment_plan(world, deployment, design.build.widths_mm)))


if __name__ == "__main__":
    main(Path(sys.argv[1]))
