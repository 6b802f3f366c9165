"""Errors of fast scores against exact ones: ``python tests/tasks/measure_area_errors.py 4000``.

Random designs are grown from random poses on maps of several environments, and every deployment is
scored both ways. Printed are the number of deployments, the mean, the root mean square and the
largest relative difference of the area, the largest difference of the score, and by how many times
fast is faster.
"""

import math
import sys
import time

import numpy as np

from vinefab.growth.batch import Batch, Launches, TerrainSet
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plans
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.search.space import BuildSettings, Space, SpaceSettings
from vinefab.tasks.coverage import Coverage
from vinefab.tasks.evaluate import PreparedMap, poses_on
from vinefab.tasks.reach import Reach
from vinefab.tasks.task import Task, concatenated_outcomes, outcomes

NAMES = ("grid", "cave", "rubble", "pegs")
DESIGNS_PER_MAP = 10
POSES_PER_MAP = 5
TASKS: dict[str, tuple[Task, str]] = {
    "coverage, free space": (Coverage(), "area"),
    "coverage, raw discs": (Coverage(clip="none"), "area"),
    "coverage, r = 20 mm": (Coverage(radius_mm=20.0), "area"),
    "coverage, sight": (Coverage(clip="sight"), "area"),
    "coverage, sight, r = 20 mm": (Coverage(clip="sight", radius_mm=20.0), "area"),
    "reach": (Reach(), "reached_mm2"),
    "reach, 15 mm": (Reach(buffer_mm=15.0), "reached_mm2"),
}


def pairs(number: int, task: Task, term: str) -> tuple[np.ndarray, float, float]:
    """Fast and exact area and score of the deployments on one map, and the time of each way."""
    name = NAMES[number % len(NAMES)]
    environment = ENVIRONMENTS[name]
    site = PreparedMap.of(environment.make(number, environment.options()))
    space = Space(SpaceSettings(), BuildSettings())
    rng = np.random.default_rng([7, number])
    designs = [space.design(x) for x in rng.random((DESIGNS_PER_MAP, len(space)))]
    options = GrowthOptions.published(children_of_stuck=rng.choice(["stop", "deploy"]))
    launches = Launches.of(TerrainSet([site.terrain]), poses_on([site], POSES_PER_MAP, [number]))
    batch = Batch(Plans.of(designs, options), launches, options)

    def scored(way: Task) -> tuple[np.ndarray, float]:
        began = time.process_time()
        blocks = list(batch.each(lambda block: outcomes(way, block, [site.context])))
        spent = time.process_time() - began
        found = concatenated_outcomes(blocks)
        return np.column_stack([found.terms[term], found.score]), spent

    fast = task.changed(area="fast")
    scored(fast)  # makes the raster
    (near, fast_s), (exact, exact_s) = scored(fast), scored(task)
    return np.stack([near, exact]), fast_s, exact_s


def errors(task: Task, term: str, count: int) -> tuple[np.ndarray, np.ndarray, float]:
    """Relative errors of the area, errors of the score, and by how much fast is faster."""
    found, fast_s, exact_s = [], 0.0, 0.0
    for number in range(math.ceil(count / (DESIGNS_PER_MAP * POSES_PER_MAP))):
        values, one, two = pairs(number, task, term)
        found.append(values)
        fast_s, exact_s = fast_s + one, exact_s + two
    near, exact = np.concatenate(found, axis=1)
    sees = exact[:, 0] > 0.0
    return near[sees, 0] / exact[sees, 0] - 1.0, near[:, 1] - exact[:, 1], exact_s / fast_s


def main() -> None:
    """Print the table."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 1000
    head = ("n", 7), ("mean %", 9), ("rms %", 9), ("most %", 9), ("score", 9), ("times", 7)
    sys.stdout.write(f"{'task':28}{''.join(f'{word:>{width}}' for word, width in head)}\n")
    for name, (task, term) in TASKS.items():
        share, score, faster = errors(task, term, count)
        percent = 100.0 * share
        rms, most = np.sqrt(np.mean(percent**2)), np.abs(percent).max()
        sys.stdout.write(
            f"{name:28}{len(share):7}{percent.mean():9.4f}{rms:9.4f}{most:9.4f}"
            f"{np.abs(score).max():9.5f}{faster:7.0f}\n"
        )


if __name__ == "__main__":
    main()
