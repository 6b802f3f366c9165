"""Markers in rendered photos, and the photos rectified by them."""

import io
import math
import sys

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage
from shapely import box

from tests.photos.conftest import Floor, TrueCamera
from vinefab.core.errors import BadInputError, MissingPackageError
from vinefab.model.map import Map, corner_markers
from vinefab.photos.found_markers import marker_points, marker_spread, measured_markers
from vinefab.photos.photo import ControlPoints, Photo, fit_camera, projected, rectified

DOTS = np.array([(x, y) for x in (20.0, 250.0, 480.0) for y in (20.0, 200.0, 380.0)])
AREA = (0.0, 0.0, 500.0, 400.0)


@pytest.fixture(scope="module")
def fitted(photo, markers):
    return fit_camera(photo, marker_points(photo, markers))


def test_corners_are_found_to_a_fraction_of_a_pixel(markers, photo, camera):
    found = measured_markers(photo)
    assert sorted(found) == [0, 1, 2, 3]
    for marker in markers:
        off = found[marker.number].corners_px - projected(camera.homography(), marker.corners_mm)
        assert np.abs(off).max() < 0.08


def test_missing_markers_are_named(markers, photo, camera):
    pixels = photo.pixels.copy()
    for marker in markers[:3]:
        column, row = projected(camera.homography(), marker.corners_mm).mean(axis=0).astype(int)
        pixels[row - 20 : row + 20, column - 20 : column + 20] = 255
    with pytest.raises(BadInputError, match=r"1 of 4 are seen \(not 0, 1, 2\); show 2 or more"):
        marker_points(Photo(name="p.png", pixels=pixels), markers)


def test_a_number_seen_twice_is_refused(photo):
    twice = Photo(name="twice.png", pixels=np.hstack([photo.pixels, photo.pixels]))
    with pytest.raises(BadInputError, match=r"twice\.png: marker \d stands twice in the photo"):
        measured_markers(twice)


def test_without_opencv_the_extra_is_named(monkeypatch, photo):
    monkeypatch.setitem(sys.modules, "cv2", None)
    with pytest.raises(MissingPackageError, match=r"pip install 'vinefab\[vision\]'"):
        measured_markers(photo)


@pytest.mark.parametrize(("out_mm", "seen"), [(7.0, 4), (-4.0, 2), (0.0, 4)])
def test_how_far_out_markers_lie_is_measured_by_their_size(markers, photo, camera, out_mm, seen):
    if out_mm:
        world = Map(name="table", bounds=box(*AREA), obstacles=())
        laid = Floor.plain((-100.0, -100.0, 600.0, 500.0), 0.5)
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


# --- Seen from straight above


def dots_of(plan):
    """Return the middles of the dots of a plan, in map mm, nearest first to each of `DOTS`."""
    dark = np.clip(150.0 - plan.pixels.mean(axis=2), 0.0, None)
    labels, count = ndimage.label(dark > 0)
    rows, columns = np.array(ndimage.center_of_mass(dark, labels, range(1, count + 1))).T
    middles = plan.to_map(np.column_stack([columns, rows]) + 0.5)
    return np.array([middles[np.hypot(*(middles - dot).T).argmin()] for dot in DOTS])


def test_a_photo_of_two_megapixels_is_rectified_within_half_a_millimetre(floor, markers):
    for dot in DOTS:
        floor.fill(dot - 4.0, (8.0, 8.0), 20.0)
    seen = floor.photographed(TrueCamera(tilt_deg=18.0), noise=4.0, blur_px=0.7, supersampling=2)
    file = io.BytesIO()
    Image.fromarray(seen.pixels).save(file, "JPEG", quality=85)
    photo = Photo(name="p.jpg", pixels=np.asarray(Image.open(file)))
    fitted = fit_camera(photo, marker_points(photo, markers))
    assert fitted.residual_mm < 0.05
    for mm_per_pixel in (None, 1.2):
        plan = rectified(photo, fitted, AREA, mm_per_pixel=mm_per_pixel)
        assert np.hypot(*(dots_of(plan) - DOTS).T).max() < 0.15
        assert plan.mm_per_pixel == mm_per_pixel or 0.3 < plan.mm_per_pixel < 0.7


def test_two_of_four_markers_suffice(photo, markers, camera):
    fitted = fit_camera(photo, marker_points(photo, (markers[0], markers[2])))
    off = fitted.to_map(projected(camera.homography(), DOTS)) - DOTS
    assert np.hypot(*off.T).max() < 1.0


def test_what_the_photo_does_not_show_is_white(photo, fitted):
    plan = rectified(photo, fitted, (-900.0, 0.0, 500.0, 400.0), mm_per_pixel=2.0)
    assert plan.pixels.shape == (200, 700, 3)
    assert (plan.pixels[:, :100] == 255).all()


def test_a_plan_too_large_or_behind_the_camera_is_refused(photo, fitted):
    with pytest.raises(BadInputError, match="more than 100 megapixels"):
        rectified(photo, fitted, AREA, mm_per_pixel=0.01)
    with pytest.raises(BadInputError, match="camera does not see all"):
        rectified(photo, fitted, (-9000.0, -9000.0, 9000.0, 9000.0))
