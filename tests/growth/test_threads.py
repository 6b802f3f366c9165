"""Many threads look at one terrain at the same time, from the very first look on."""

import subprocess
import sys

import pytest

PROGRAM = """
import sys
from concurrent.futures import ThreadPoolExecutor
from threading import Barrier

import numpy as np
import shapely

from vinefab.growth.terrain import Terrain
from vinefab.model.map import Map

sys.setswitchinterval(1e-6)
rng = np.random.default_rng(7)
for _ in range(60):
    discs = shapely.buffer(shapely.points(rng.uniform(20.0, 480.0, (40, 2))), 8.0, quad_segs=32)
    world = Map(name="discs", bounds=shapely.box(0, 0, 500, 500), obstacles=tuple(discs))
    terrain, barrier = Terrain.of(world), Barrier(2)
    points_mm = rng.uniform(0.0, 500.0, (50, 2))

    def look(radius_mm):
        barrier.wait()
        return terrain.have_room(points_mm, 0.0).tolist(), len(terrain.walls(radius_mm).wall)

    with ThreadPoolExecutor(2) as pool:
        one, other = pool.map(look, (3.0, 3.0))
    assert one == other
print("done")
"""


@pytest.mark.thorough
def test_threads_may_look_first_at_the_same_time():
    # In a process of its own: without care this ends in broken memory, not in an exception.
    ran = subprocess.run(
        [sys.executable, "-c", PROGRAM],
        check=False,
        capture_output=True,
        text=True,
        errors="replace",
    )
    assert (ran.returncode, ran.stdout) == (0, "done\n"), ran.stderr
