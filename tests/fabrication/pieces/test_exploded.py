import itertools
import math

import numpy as np
import pytest
import shapely

from vinefab.fabrication.pieces.exploded import exploded_view
from vinefab.model.design import Build, Design, Level
from vinefab.outline.body_outline import flat_layout


def robot_of(rng):
    depth = int(rng.integers(1, 4))
    levels = tuple(
        Level.of(
            branches=int(rng.integers(1, 5)),
            length_mm=float(rng.uniform(60.0, 250.0)),
            angle_deg=float(rng.uniform(0.0, 330.0)),
            growth_percent=float(rng.uniform(60.0, 140.0)),
        )
        for _ in range(depth)
    )
    build = Build.standard(1 + depth, float(rng.uniform(15.0, 50.0)))
    return Design(name="any", trunk_length_mm=200.0, levels=levels, build=build)


def moved(outlines, view):
    """Return the pieces as they lie in the exploded view."""
    return {
        label: shapely.Polygon(contour.flattened_mm() + view.moves_mm[label]).buffer(0.0)
        for label, contour in outlines.items()
    }


@pytest.mark.parametrize("seed", range(15))
def test_no_piece_lies_on_another(cut_at, seed):
    """Random trees, cut anywhere: pieces are moved apart, by shifts alone."""
    rng = np.random.default_rng(seed)
    design = robot_of(rng)
    most = min(design.branch_count - 1, 29)
    count = int(rng.integers(1, most + 1))
    cuts = 1 + rng.choice(design.branch_count - 1, count, replace=False)
    partition, outlines = cut_at(design, tuple(cuts.tolist()))
    lead_mm = 40.0
    view = exploded_view(partition, flat_layout(design), outlines, lead_mm)
    shapes = moved(outlines, view)
    assert shapes.keys() == {piece.label for piece in partition.pieces}
    for one, two in itertools.combinations(shapes.values(), 2):
        assert one.distance(two) > 0.15 * lead_mm
    assert view.moves_mm["A"].tolist() == [0.0, 0.0]
    for sleeve in partition.sleeves:
        stub, base = view.stubs_mm[sleeve.label], view.bases_mm[sleeve.label]
        assert math.dist(stub, base) > 0.999 * lead_mm
        # The rims are on their pieces.
        assert shapes[sleeve.inner].distance(shapely.Point(stub)) < 1e-6
        assert shapes[sleeve.label].distance(shapely.Point(base)) < 1e-6


def test_a_piece_with_room_is_drawn_off_along_its_branch(cut_at, make_plan, make_fan):
    design = make_plan((30.0, 16.0), levels=[make_fan(2, 150.0, 90.0)])
    partition, outlines = cut_at(design, (1, 2))
    layout = flat_layout(design)
    view = exploded_view(partition, layout, outlines, 50.0)
    for sleeve in partition.sleeves:
        away = view.bases_mm[sleeve.label] - view.stubs_mm[sleeve.label]
        heading = layout.heading_rad[sleeve.branch]
        assert np.allclose(away, 50.0 * np.array([math.cos(heading), math.sin(heading)]))


def test_an_outline_that_crosses_itself_is_kept_apart_too(cut_at, make_plan, make_fan):
    design = make_plan((30.0, 16.0), levels=[make_fan(2, 150.0, 60.0)])
    partition, outlines = cut_at(design, (1,))
    contour = outlines["B"]
    points = contour.points_mm.copy()
    points[[0, 1]] = points[[1, 0]]
    bent = type(contour).polyline(points, closed=False)
    view = exploded_view(partition, flat_layout(design), {**outlines, "B": bent}, 30.0)
    shapes = moved({"A": outlines["A"]}, view)
    around = shapely.MultiPoint(bent.points_mm + view.moves_mm["B"]).convex_hull
    assert shapes["A"].distance(around) > 0.0
