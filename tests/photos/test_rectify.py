import io

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage

from tests.photos.conftest import TrueCamera
from vinefab.core.errors import BadInputError
from vinefab.photos.found_markers import marker_points
from vinefab.photos.photo import Photo, fit_camera, rectified

DOTS = np.array([(x, y) for x in (20.0, 250.0, 480.0) for y in (20.0, 200.0, 380.0)])
AREA = (0.0, 0.0, 500.0, 400.0)


def compressed(photo, quality=85):
    file = io.BytesIO()
    Image.fromarray(photo.pixels).save(file, "JPEG", quality=quality)
    return Photo(name="p.jpg", pixels=np.asarray(Image.open(file)), focal_px=photo.focal_px)


def dots_of(plan):
    """Return the middles of the dots of a plan, in map mm, nearest first to each of `DOTS`."""
    dark = np.clip(150.0 - plan.pixels.mean(axis=2), 0.0, None)
    labels, count = ndimage.label(dark > 0)
    rows, columns = np.array(ndimage.center_of_mass(dark, labels, range(1, count + 1))).T
    middles = plan.to_map(np.column_stack([columns, rows]) + 0.5)
    return np.array([middles[np.hypot(*(middles - dot).T).argmin()] for dot in DOTS])


@pytest.mark.parametrize(("tilt_deg", "mm_per_pixel"), [(4.0, None), (18.0, 1.2)])
def test_a_photo_of_two_megapixels_is_rectified_within_half_a_millimetre(
    floor, markers, tilt_deg, mm_per_pixel
):
    for dot in DOTS:
        floor.fill(dot - 4.0, (8.0, 8.0), 20.0)
    tilted = TrueCamera(tilt_deg=tilt_deg)
    photo = compressed(floor.photographed(tilted, noise=4.0, blur_px=0.7))
    fitted = fit_camera(photo, marker_points(photo, markers))
    assert fitted.residual_mm < 0.05
    plan = rectified(photo, fitted, AREA, mm_per_pixel=mm_per_pixel)
    assert np.hypot(*(dots_of(plan) - DOTS).T).max() < 0.15
    assert plan.mm_per_pixel == mm_per_pixel or 0.3 < plan.mm_per_pixel < 0.7


def test_two_of_four_markers_suffice(floor, markers, camera):
    photo = floor.photographed(camera, noise=4.0, blur_px=0.7)
    fitted = fit_camera(photo, marker_points(photo, (markers[0], markers[2])))
    off = fitted.to_map(fit_truth(camera, DOTS)) - DOTS
    assert np.hypot(*off.T).max() < 1.0


def fit_truth(camera, points_mm):
    seen = np.column_stack([points_mm, np.ones(len(points_mm))]) @ camera.homography().T
    return seen[:, :2] / seen[:, 2:]


def test_what_the_photo_does_not_show_is_white(floor, markers, camera):
    photo = floor.photographed(camera)
    fitted = fit_camera(photo, marker_points(photo, markers))
    plan = rectified(photo, fitted, (-900.0, 0.0, 500.0, 400.0), mm_per_pixel=2.0)
    assert plan.pixels.shape == (200, 700, 3)
    assert (plan.pixels[:, :100] == 255).all()


def test_a_plan_too_large_or_behind_the_camera_is_refused(floor, markers, camera):
    photo = floor.photographed(camera)
    fitted = fit_camera(photo, marker_points(photo, markers))
    with pytest.raises(BadInputError, match="at most 100 megapixels"):
        rectified(photo, fitted, AREA, mm_per_pixel=0.01)
    with pytest.raises(BadInputError, match="camera sees all corners"):
        rectified(photo, fitted, (-9000.0, -9000.0, 9000.0, 9000.0))
