"""How many times faster the kernel is than the growth model as a user of Shapely would write it.

python tests/studies/against_shapely.py

On one core, for the tree and the smallest map of `vinefab study bench`.
"""

import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tests.oracles.shapely_reference import ReferenceWorld, grow_tree, tips_mm
from vinefab.growth.batch import grow_on
from vinefab.growth.terrain import Terrain
from vinefab.maps.poses import draw_poses
from vinefab.studies.benchmark import (
    BENCH_GROWTH,
    SIZES,
    batch_on,
    events,
    least_each_s,
    square_map,
    tree_of_40,
)

GROWTHS, SLOW_GROWTHS = 200, 25

if __name__ == "__main__":
    world = square_map(SIZES[0])
    terrain, design = Terrain.of(world), tree_of_40()
    poses = draw_poses(world, GROWTHS, 1)
    course, tree = ReferenceWorld(terrain.free_space()), design.tree

    def grow_slowly() -> list[np.ndarray]:
        few = poses[:SLOW_GROWTHS]
        return [tips_mm(grow_tree(course, tree, pose, BENCH_GROWTH)) for pose in few]

    batch = batch_on(terrain, poses)
    grown_s, reference_s = least_each_s((lambda: events(batch), grow_slowly))
    exact = [grow_on(design, terrain, pose, BENCH_GROWTH).tips_mm for pose in poses[:SLOW_GROWTHS]]
    error_mm = max(np.abs(a - b).max() for a, b in zip(grow_slowly(), exact, strict=True))
    ratio = (reference_s / SLOW_GROWTHS) / (grown_s / GROWTHS)
    said = f"Shapely reference: {ratio:,.0f} times slower, tips within {error_mm:.1e} mm\n"
    sys.stdout.write(said)
