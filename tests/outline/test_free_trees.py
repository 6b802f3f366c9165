"""Outlines of random trees of branches against the union of plain shapes."""

import numpy as np
import pytest
import shapely

from tests.oracles.body_outline import FreeTwin
from tests.outline.free_trees import random_free_tree
from tests.outline.property import farthest_mm
from vinefab.outline.body_outline import body_outline

FINE_MM = 1e-4


def worst_mm(design):
    """How far an outline is from the union."""
    points = body_outline(design).contour.flattened_mm(FINE_MM)
    body = FreeTwin(design, FINE_MM).body()
    walk, shape = shapely.LineString([*points, points[0]]), shapely.Polygon(points)
    worst = farthest_mm(body.boundary, walk)
    if shape.is_valid:  # else it crosses itself, and some of the walk lies inside the union
        worst = max(worst, farthest_mm(shape.exterior, body.boundary))
    return worst


@pytest.mark.parametrize(
    "seeds", [range(1, 7), pytest.param(range(7, 207), marks=pytest.mark.thorough)]
)
def test_random_trees_have_the_outline_of_the_union(seeds):
    exact = 0
    for seed in seeds:
        design = random_free_tree(np.random.default_rng([7, seed]), 14 if seed % 4 else 60)
        if body_outline(design).problems:
            continue
        exact += 1
        assert worst_mm(design) < 1e-3, seed
    assert exact > len(seeds) / 2
