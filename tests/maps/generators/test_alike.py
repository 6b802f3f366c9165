"""Maps of one environment look related and maps of two do not: measured, not only looked at."""

import numpy as np
import pytest
import shapely
from scipy import ndimage

from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.model.map import Map

SEEDS = range(8)
PIXEL_MM = 4.0


def looks(world: Map) -> list[float]:
    """Return free share, number, convexity and spread of sizes of obstacles, widths of ways."""
    free, obstacles = world.free_space, list(world.obstacles)
    convexity = shapely.area(obstacles) / shapely.area(shapely.convex_hull(obstacles))
    widths = np.quantile(widths_mm(world), [0.25, 0.75])
    share = free.area / world.bounds.area
    sizes = float(np.std(np.log(shapely.area(obstacles))))
    return [share, np.log(len(obstacles)), float(convexity.mean()), sizes, *np.log(widths)]


def widths_mm(world: Map) -> np.ndarray:
    """Return the width of the free space at the pixels of its middle lines."""
    free = world.free_space
    shapely.prepare(free)
    axes = [np.arange(0.5 * PIXEL_MM, size, PIXEL_MM) for size in world.size_mm]
    inside = shapely.contains_xy(free, *np.meshgrid(*axes))
    far = ndimage.distance_transform_edt(np.pad(inside, 1))[1:-1, 1:-1] * PIXEL_MM
    return 2.0 * far[inside & (far >= ndimage.maximum_filter(far, 3))]


@pytest.fixture(scope="module")
def table() -> dict[str, np.ndarray]:
    return {
        name: np.array([looks(one.make(seed, one.options())) for seed in SEEDS])
        for name, one in ENVIRONMENTS.items()
    }


def test_every_map_is_most_like_one_of_its_own_environment(table: dict[str, np.ndarray]) -> None:
    every = np.concatenate(list(table.values()))
    whose = np.repeat(np.arange(len(table)), len(SEEDS))
    scaled = (every - every.mean(axis=0)) / every.std(axis=0)
    away = np.linalg.norm(scaled[:, None] - scaled, axis=2) + 1e9 * np.eye(len(every))
    assert (whose[away.argmin(axis=1)] == whose).all()
    same = whose[:, None] == whose
    within = np.median(away[same & (away < 1e8)])
    assert np.median(away[~same]) > 4.0 * within


def test_environments_are_what_their_names_say(table: dict[str, np.ndarray]) -> None:
    mean = {name: rows.mean(axis=0) for name, rows in table.items()}
    assert mean["grid"][2] == mean["pegs"][2] == pytest.approx(1.0)
    assert mean["cave"][0] < 0.4 < mean["rubble"][0] < mean["grid"][0] + 0.05 < 0.85
    assert mean["cave"][1] < mean["corridors"][1] < mean["grid"][1] < mean["pegs"][1]
