import math
import sys

import numpy as np
import pytest
from shapely import box

from vinefab.core.errors import BadInputError
from vinefab.model.map import CornerMarker, Map, corner_markers
from vinefab.photos.found_markers import marker_points, marker_spread, measured_markers
from vinefab.photos.photo import ControlPoints, Photo, projected


def test_corners_are_found_to_a_fraction_of_a_pixel(markers, floor, camera):
    photo = floor.photographed(camera, noise=4.0, blur_px=0.7)
    found = measured_markers(photo)
    assert sorted(found) == [0, 1, 2, 3]
    for marker in markers:
        off = found[marker.number].corners_px - projected(camera.homography(), marker.corners_mm)
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
        measured_markers(floor.photographed(camera))


def test_without_opencv_the_extra_is_named(monkeypatch, floor, camera):
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(BadInputError, match=r"pip install 'vinefab\[vision\]'"):
        measured_markers(floor.photographed(camera))


@pytest.mark.parametrize("out_mm", [-4.0, 0.0, 2.5, 7.0])
@pytest.mark.parametrize("seen", [4, 2])
def test_how_far_out_markers_lie_is_measured_by_their_size(markers, camera, floor, out_mm, seen):
    world = Map(name="table", bounds=box(0.0, 0.0, 500.0, 400.0), obstacles=())
    laid = floor.plain((-100.0, -100.0, 600.0, 500.0), 0.5)
    laid.paint(corner_markers(world, gap_mm=12.0 + out_mm)[:seen])
    photo = laid.photographed(camera, noise=2.0, blur_px=0.7)
    spread = marker_spread(marker_points(photo, markers))
    expected = (out_mm, out_mm if seen > 2 else math.nan)
    assert spread.out_mm == pytest.approx(expected, abs=0.4, nan_ok=True)
    assert abs(spread.most_mm - abs(out_mm)) < spread.noise_mm
    assert spread.is_wrong_layout is (out_mm != 0.0)


@pytest.mark.parametrize(
    ("bend", "out_mm", "words"),
    [
        (0.0, 0.0, "as said"),
        (-0.04, 0.0, "bent"),
        (0.04, 0.0, "bent"),
        (0.0, 7.0, "wrong"),
        (-0.01, 7.0, "wrong"),
        (0.01, 7.0, "wrong"),
    ],
)
def test_a_lens_that_bends_lines_is_told_from_another_layout(markers, camera, bend, out_mm, words):
    """Barrel and cushion, as a share of the way to the photo's corner."""
    camera = type(camera)()
    world = Map(name="table", bounds=box(0.0, 0.0, 500.0, 400.0), obstacles=())
    true_mm = np.vstack([m.corners_mm for m in corner_markers(world, gap_mm=12.0 + out_mm)])
    middle = np.array(camera.size_px) / 2
    seen = projected(camera.homography(), true_mm) - middle
    seen *= 1.0 + bend * (seen**2).sum(axis=1, keepdims=True) / (middle**2).sum()
    noise = np.random.default_rng(3).normal(0.0, 0.03, seen.shape)
    said_mm = np.vstack([marker.corners_mm for marker in markers])
    spread = marker_spread(ControlPoints(points_px=seen + middle + noise, points_mm=said_mm))
    assert (spread.is_clear, spread.is_wrong_layout) == {
        "as said": (False, False),
        "bent": (True, False),
        "wrong": (True, True),
    }[words]
