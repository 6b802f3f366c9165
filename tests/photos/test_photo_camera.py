import dataclasses

import numpy as np
import pytest

from vinefab.core.errors import BadInputError
from vinefab.photos.photo import ControlPoints, Photo, fit_camera, projected

CORNERS = np.array([(0.0, 0.0), (500.0, 0.0), (500.0, 400.0), (0.0, 400.0)])
PLACES = np.array([(x, y) for x in (0, 130, 390, 500) for y in (0, 170, 400)], dtype=float)


def blank(camera, focal_px=None):
    columns, rows = camera.size_px
    return Photo(name="p.png", pixels=np.zeros((rows, columns, 3), np.uint8), focal_px=focal_px)


def seen(camera, points_mm, z_mm=0.0, **more):
    points_px = projected(camera.homography(z_mm), points_mm)
    return ControlPoints(points_px=points_px, points_mm=points_mm, z_mm=z_mm, **more)


def worst_mm(fitted, camera, plane_mm):
    again = fitted.to_map(projected(camera.homography(plane_mm), PLACES), plane_mm)
    return np.hypot(*(again - PLACES).T).max()


@pytest.mark.parametrize("tilt_deg", [0.0, 3.0, 20.0, 50.0])
def test_four_points_hold_their_plane_exactly(camera, tilt_deg):
    tilted = dataclasses.replace(camera, tilt_deg=tilt_deg)
    fitted = fit_camera(blank(camera), seen(tilted, CORNERS, z_mm=25.0))
    assert worst_mm(fitted, tilted, 25.0) < 1e-6
    assert fitted.residual_mm < 1e-6
    again = fitted.to_photo(PLACES)
    assert np.allclose(again, projected(tilted.homography(25.0), PLACES), atol=1e-6)


@pytest.mark.parametrize("plane_mm", [-30.0, 60.0])
def test_perspective_gives_the_focal_length_and_other_planes(camera, plane_mm):
    tilted = dataclasses.replace(camera, tilt_deg=25.0, turn_deg=140.0)
    fitted = fit_camera(blank(camera), seen(tilted, CORNERS))
    assert fitted.focal_px == pytest.approx(camera.focal_px, rel=1e-4)
    assert worst_mm(fitted, tilted, plane_mm) < 0.01
    assert worst_mm(fitted, tilted, 0.0) < 1e-6


def test_exif_data_give_the_focal_length_from_straight_above(camera):
    above = dataclasses.replace(camera, tilt_deg=0.0)
    control = seen(above, CORNERS)
    fitted = fit_camera(blank(camera, focal_px=camera.focal_px), control)
    assert fitted.focal_px == pytest.approx(camera.focal_px, rel=1e-3)
    assert fitted.focal_share == pytest.approx(0.03, rel=0.05)
    assert worst_mm(fitted, above, 20.0) < 0.01


def test_a_wrong_focal_length_stays_within_the_parallax_that_is_said(camera):
    above = dataclasses.replace(camera, tilt_deg=0.0)
    fitted = fit_camera(blank(camera, focal_px=1.05 * camera.focal_px), seen(above, CORNERS))
    off = worst_mm(fitted, above, 20.0)
    assert 0.1 < off < 20.0 * fitted.parallax_mm_per_mm


def test_an_unknown_focal_length_is_said_with_its_greatest_parallax(camera):
    above = dataclasses.replace(camera, tilt_deg=0.0)
    fitted = fit_camera(blank(camera), seen(above, CORNERS))
    assert fitted.focal_px is None
    assert worst_mm(fitted, above, 0.0) < 1e-6
    assert 1.0 < worst_mm(fitted, above, 20.0) < 20.0 * fitted.parallax_mm_per_mm


@pytest.mark.parametrize("exif", [None, 1400.0])
def test_the_error_of_the_focal_length_is_as_large_as_said(camera, exif):
    tilted = dataclasses.replace(camera, tilt_deg=15.0)
    points = np.concatenate([CORNERS + np.array([x, y]) for x in (0, 30) for y in (0, 30)])
    truth = seen(tilted, points).points_px
    rng, apart = np.random.default_rng(1), []
    for _ in range(40):
        noisy = truth + rng.normal(0.0, 0.3, truth.shape)
        control = ControlPoints(points_px=noisy, points_mm=points, noise_px=0.3)
        fitted = fit_camera(blank(camera, focal_px=exif), control)
        apart.append((fitted.focal_px / camera.focal_px - 1.0) / fitted.focal_share)
    assert 0.5 < np.std(apart) < 1.3


def test_two_points_give_scale_and_turn(camera):
    control = ControlPoints(
        points_px=np.array([(100.5, 300.5), (100.5, 100.5)]),
        points_mm=np.array([(0.0, 0.0), (50.0, 0.0)]),
    )
    fitted = fit_camera(blank(camera), control)
    assert np.allclose(fitted.to_map(np.array([(60.5, 300.5)])), [(0.0, 10.0)])


@pytest.mark.parametrize(
    ("order", "words"),
    [
        ([3, 2, 1, 0], "a mirror image"),
        ([0, 2, 1, 3], "no view of a plane"),
        ([0, 0, 0, 0], "at the same place"),
    ],
)
def test_points_in_a_wrong_order_are_refused(camera, order, words):
    truth = seen(camera, CORNERS)
    with pytest.raises(BadInputError, match=words):
        fit_camera(
            blank(camera), ControlPoints(points_px=truth.points_px[order], points_mm=CORNERS)
        )


def test_points_on_a_line_are_refused(camera):
    line = np.array([(0.0, 0.0), (100.0, 50.0), (200.0, 100.0), (400.0, 200.0)])
    with pytest.raises(BadInputError, match="on a line"):
        fit_camera(blank(camera), seen(camera, line))


def test_two_points_at_one_place_are_refused(camera):
    with pytest.raises(BadInputError, match="apart"):
        fit_camera(blank(camera), seen(camera, CORNERS[[0, 0]]))
