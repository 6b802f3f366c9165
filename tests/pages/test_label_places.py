"""Labels: none on another, near their places."""

import numpy as np
import pytest
import shapely

from vinefab.core.rng import child
from vinefab.pages.panel import label_middles


@pytest.mark.parametrize("spread_pt", [8.0, 40.0, 400.0])
def test_labels_of_crowded_places_do_not_lie_on_each_other(spread_pt):
    generator = child(1)
    places = generator.uniform(0.0, spread_pt, (12, 2))
    sizes = np.column_stack([generator.uniform(10.0, 40.0, 12), np.full(12, 8.0)])
    middles = label_middles(places, sizes)
    boxes = shapely.box(*(middles - sizes / 2).T, *(middles + sizes / 2).T)
    first, second = shapely.STRtree(boxes).query(boxes, "overlaps")
    shared = shapely.area(shapely.intersection(boxes[first], boxes[second]))
    assert shared.max(initial=0.0) < 0.05 * sizes.prod(axis=1).min()
    away = shapely.distance(boxes, shapely.points(places))
    assert away.min() >= 2.9
    assert away.max() < 8.0 if spread_pt == 400.0 else away.max() < 90.0


def test_a_label_keeps_off_lines_and_on_the_page():
    place, size = np.array([[50.0, 50.0]]), np.array([[20.0, 8.0]])
    line = np.array([[0.0, 50.0], [60.0, 110.0]]) - 0.5
    (x, y), = label_middles(place, size, lines_pt=[line, line - (0.0, 50.0)])  # fmt: skip
    box = shapely.box(x - 10, y - 4, x + 10, y + 4)
    assert not box.intersects(shapely.LineString(line))
    (x, y), = label_middles(place, size, page_pt=(0.0, 0.0, 55.0, 52.0))  # fmt: skip
    assert x + 10 <= 55.0
    assert y + 4 <= 52.0
