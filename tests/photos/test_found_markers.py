import sys

import numpy as np
import pytest

from vinefab.core.errors import BadInputError
from vinefab.model.corner_marker import CornerMarker
from vinefab.photos.found_markers import find_markers, marker_points
from vinefab.photos.photo import Photo
from vinefab.photos.photo_camera import projected


def test_corners_are_found_to_a_fraction_of_a_pixel(markers, floor, camera):
    photo = floor.photographed(camera, noise=4.0, blur_px=0.7)
    found = find_markers(photo)
    assert sorted(found) == [0, 1, 2, 3]
    for marker in markers:
        off = found[marker.number] - projected(camera.homography(), marker.corners_mm)
        assert np.abs(off).max() < 0.08


def test_missing_markers_are_named(markers, floor, camera):
    photo = floor.photographed(camera)
    pixels = photo.pixels.copy()
    for marker in markers[:3]:
        column, row = projected(camera.homography(), marker.corners_mm).mean(axis=0).astype(int)
        pixels[row - 20 : row + 20, column - 20 : column + 20] = 255
    with pytest.raises(BadInputError, match=r"1 of 4 \(not seen: 0, 1, 2\)'; allowed: at least 2"):
        marker_points(Photo(name="p.png", pixels=pixels), markers)


def test_a_number_seen_twice_is_refused(markers, floor, camera):
    again = CornerMarker(number=2, corners_mm=markers[2].corners_mm - (200.0, 200.0))
    floor.paint([again])
    with pytest.raises(BadInputError, match="rendered: marker is '2 twice in the photo'"):
        find_markers(floor.photographed(camera))


def test_without_opencv_the_extra_is_named(monkeypatch, floor, camera):
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(BadInputError, match=r"pip install 'vinefab\[vision\]'"):
        find_markers(floor.photographed(camera))
