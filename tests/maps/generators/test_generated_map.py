import numpy as np
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely import Polygon

from vinefab.maps.generators.generated_map import canonical, start_zone
from vinefab.model.map import Pose, Start

HOLED = shapely.box(0, 0, 9, 9).difference(
    shapely.union_all([shapely.box(1, 1, 2, 2), shapely.box(4, 4, 6, 7)])
)
ELL = Polygon([(20, 0), (26, 0), (26, 2), (22, 2), (22, 6), (20, 6)])


@given(st.integers(0, 5), st.integers(0, 3), st.sampled_from([1, -1]))
def test_polygons_are_written_one_way_whatever_way_they_came(
    roll: int, hole_roll: int, way: int
) -> None:
    def ring(linear: shapely.LinearRing, by: int) -> np.ndarray:
        points = np.roll(np.array(linear.coords)[:-1], by, axis=0)
        # A corner on a straight piece and a repeated one say nothing.
        points = np.insert(points, 1, [points[0], 0.5 * (points[0] + points[1])], axis=0)
        return points[::way]

    holes = [ring(hole, hole_roll) for hole in HOLED.interiors]
    other = Polygon(ring(HOLED.exterior, roll), holes[::way])
    ell = Polygon(ring(ELL.exterior, roll))
    pieces = shapely.MultiPolygon([other, ell][::way])
    assert [p.wkb for p in canonical(pieces)] == [
        p.wkb for p in canonical(shapely.MultiPolygon([HOLED, ELL]))
    ]


def test_canonical_keeps_the_shape_and_turns_holes_the_other_way() -> None:
    (found,) = canonical(HOLED)
    assert found.equals(HOLED)
    assert found.exterior.is_ccw
    assert not any(hole.is_ccw for hole in found.interiors)
    assert found.exterior.coords[0] == (0.0, 0.0)
    assert canonical(Polygon()) == ()


def test_starting_zones_are_rectangles_lines_or_points() -> None:
    pose = Pose(x_mm=5.0, y_mm=5.0, heading_rad=0.0)
    kinds = [
        start_zone(Start(pose=pose, spread_x_mm=x, spread_y_mm=y)).geom_type
        for x, y in ((1.0, 2.0), (1.0, 0.0), (0.0, 0.0), (1.0, 1e-300))
    ]
    assert kinds == ["Polygon", "LineString", "Point", "LineString"]
