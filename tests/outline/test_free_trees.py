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
    "seeds", [range(2, 5), pytest.param(range(5, 207), marks=pytest.mark.thorough)]
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


@pytest.mark.parametrize("offset_mm", [0.55, -1.0])
@pytest.mark.parametrize(
    "seeds", [range(10, 16), pytest.param(range(16, 207), marks=pytest.mark.thorough)]
)
def test_offsets_of_random_trees_are_as_far_as_asked(seeds, offset_mm):
    """Where bodies do not cross: there the edge of their union is nearer to some points."""
    compared = 0
    for seed in seeds:
        design = random_free_tree(np.random.default_rng([7, seed]), 14 if seed % 4 else 60)
        lumen, outline = body_outline(design), body_outline(design, offset_mm)
        shapes = [shapely.Polygon(one.contour.flattened_mm(FINE_MM)) for one in (lumen, outline)]
        if lumen.problems or outline.problems or not all(one.is_valid for one in shapes):
            continue
        compared += 1
        edge = FreeTwin(design, FINE_MM).body(beyond_mm=50.0).boundary
        points = shapely.get_coordinates(shapely.segmentize(shapes[1].exterior, 2.0))
        # The mouth's own line is nearer to the lumen drawn out than the offset.
        clear = shapely.points(points[points[:, 0] > 1e-6 - design.build.tail_mm])
        off_mm = np.abs(shapely.distance(clear, edge) - abs(offset_mm))
        assert off_mm.max() < 1e-3, seed
    assert compared > len(seeds) / 5
