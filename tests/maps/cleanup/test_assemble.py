import math
from itertools import pairwise

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import Polygon

from vinefab.core.errors import BadInputError
from vinefab.maps.cleanup.assemble import AssembleOptions, assemble
from vinefab.maps.cleanup.drawn_shapes import Changes, DrawnShape, SourceFrame, framed
from vinefab.maps.generators.grid import grid_map

OPTIONS = AssembleOptions(join_mm=0.1, sliver_mm2=0.01)


def outline(*points, **more):
    return DrawnShape(rings=(np.array(points, dtype=float),), where="outline", **more)


def square(x, y, size, **more):
    return outline((x, y), (x + size, y), (x + size, y + size), (x, y + size), **more)


def made(*shapes, frame=None, options=OPTIONS):
    return assemble("made", shapes, Changes(frame or SourceFrame()), options, {"source": "test"})


def test_outlines_become_bounds_obstacles_and_holes():
    world = made(square(20, 20, 10), square(10, 10, 40), square(0, 0, 100), square(70, 70, 5))
    assert world.bounds.area == 10_000
    assert sorted(p.area for p in world.obstacles) == [25, 1500]
    assert world.facts["nested_outlines_made_holes"] == 1
    assert world.facts["free_regions"] == 2
    assert world.facts["source"] == "test"
    assert world.starts[0].pose.x_mm > 50


def test_a_fill_in_a_fill_is_solid_and_an_outline_in_an_outline_is_not():
    filled = made(square(0, 0, 99), square(9, 9, 40, filled=True), square(20, 20, 9, filled=True))
    assert [p.area for p in filled.obstacles] == [1600]
    drawn = made(square(0, 0, 99), square(9, 9, 40), square(20, 20, 9))
    assert [p.area for p in drawn.obstacles] == [1600 - 81]


def test_simplify_keeps_within_its_distance():
    angles = np.linspace(0, math.tau, 1000, endpoint=False)
    disc = 50 + 20 * np.column_stack([np.cos(angles), np.sin(angles)])
    options = AssembleOptions(join_mm=0.1, sliver_mm2=0.01, simplify_mm=0.2)
    (found,) = made(square(0, 0, 100), outline(*disc), options=options).obstacles
    assert 10 < shapely.get_num_coordinates(found) < 60
    assert shapely.hausdorff_distance(found.exterior, Polygon(disc).exterior) <= 0.2


def test_far_coordinates_are_moved_and_named_as_they_were():
    corners = np.array([[5e8, 3e9], [5e8 + 400, 3e9 + 300]])
    frame, size_mm = framed(corners, SourceFrame())
    assert size_mm == 400
    assert frame.to_map(corners).tolist() == [[0, 0], [400, 300]]
    assert frame.place((400.0, 300.0)) == "(500000400, 3000000300)"
    near, _ = framed(np.array([[-50.0, 0.0], [20.0, 9.0]]), SourceFrame())
    assert near == SourceFrame()


@pytest.mark.parametrize(
    "points", [[[0, 0], [1e8, 1]], [[0, 0], [1e-3, 1e-3]], [[-1e308, 0], [1e308, 1]]]
)
def test_sizes_that_come_from_a_wrong_unit_are_refused(points):
    with pytest.raises(BadInputError, match=r"drawing is .* mm wide"):
        framed(np.array(points, dtype=float), SourceFrame())


@settings(max_examples=25)
@given(st.integers(0, 10**6), st.booleans(), st.floats(0.0, 0.05))
def test_a_grid_in_pieces_comes_back(seed, down, gap_mm):
    rng = np.random.default_rng(seed)
    world = grid_map(seed % 50)
    frame = SourceFrame(scale_mm_per_unit=10.0, x=7.0, y=-3.0, down=down)
    pieces = []
    for polygon in (world.bounds, *world.obstacles):
        points = shapely.get_coordinates(polygon.exterior)
        cuts = np.unique(np.append(rng.integers(1, len(points) - 1, 2), [0, len(points) - 1]))
        for first, last in pairwise(cuts):
            part = points[first : last + 1] + rng.uniform(-0.35, 0.35, 2) * gap_mm
            source = part / 10.0 * [1.0, -1.0 if down else 1.0] + [7.0, -3.0]
            turned = source[::-1] if rng.random() < 0.5 else source
            pieces.append(outline(*turned, closed=False))
    again = made(*(pieces[k] for k in rng.permutation(len(pieces))), frame=frame)
    assert len(again.obstacles) == len(world.obstacles)
    slack = 1e-3 + gap_mm * sum(p.length for p in (world.bounds, *world.obstacles))
    assert (again.free_space ^ world.free_space).area <= slack
