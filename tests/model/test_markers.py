"""Markers against the dictionary of an independent library, and where they lie."""

import cv2
import numpy as np
import pytest
from shapely import Polygon, box

from vinefab.core.errors import BadInputError
from vinefab.model.map import MARKER_CELLS, MARKER_SIDE_CELLS, Map, corner_markers


def test_cells_are_those_of_the_dictionary():
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    for number, rows in enumerate(MARKER_CELLS):
        image = cv2.aruco.generateImageMarker(dictionary, number, MARKER_SIDE_CELLS)
        assert ((image[1:-1, 1:-1] == 255) == [[cell == "#" for cell in row] for row in rows]).all()
        assert not image[[0, -1]].any()
        assert not image[:, [0, -1]].any()


def test_markers_lie_outside_their_corners():
    world = Map(name="room", bounds=box(10.0, 20.0, 510.0, 320.0))
    markers = corner_markers(world, side_mm=30.0, gap_mm=12.0, z_mm=3.0)
    assert [m.number for m in markers] == [0, 1, 2, 3]
    assert markers[0].corners_mm.tolist() == [[-32, 8], [-2, 8], [-2, -22], [-32, -22]]
    assert markers[2].corners_mm.tolist() == [[522, 362], [552, 362], [552, 332], [522, 332]]
    for marker in markers:
        assert Polygon(marker.corners_mm).area == pytest.approx(900.0)
        assert Polygon(marker.corners_mm).distance(world.bounds) == pytest.approx(12 * np.sqrt(2))
        assert marker.z_mm == 3.0


@pytest.mark.parametrize(("name", "value"), [("side_mm", 0.0), ("gap_mm", -1.0)])
def test_impossible_sizes_are_refused(name, value):
    with pytest.raises(BadInputError, match=name):
        corner_markers(Map(name="room", bounds=box(0, 0, 9, 9)), **{name: value})
