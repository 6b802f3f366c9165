"""Photos read from files, and their cameras fitted to points."""

import dataclasses
import io
import struct
import zlib

import numpy as np
import pytest
from PIL import Image

from vinefab.core.errors import BadInputError, UnreadableFileError
from vinefab.photos.photo import ControlPoints, Photo, fit_camera, projected, read_photo


def saved(tmp_path, image, suffix=".png", **options):
    path = tmp_path / f"photo{suffix}"
    image.save(path, **options)
    return path


def ramp(mode, size=(40, 30)):
    return Image.linear_gradient("L").resize(size).convert(mode)


@pytest.mark.parametrize("mode", ["1", "L", "LA", "P", "RGB", "RGBA"])
def test_every_mode_of_png_becomes_red_green_and_blue(tmp_path, mode):
    image = ramp(mode)
    photo = read_photo(saved(tmp_path, image))
    assert (photo.pixels == np.asarray(image.convert("RGB"))).all()
    assert (photo.width_px, photo.height_px) == (40, 30)
    assert photo.focal_px is None


def test_sixteen_bits_keep_their_brightness(tmp_path):
    deep = np.linspace(0, 65535, 40 * 30).astype(np.uint16).reshape(30, 40)
    photo = read_photo(saved(tmp_path, Image.fromarray(deep)))
    assert np.abs(photo.pixels[..., 1] - deep / 257.0).max() <= 0.5


def test_inks_become_colours(tmp_path):
    image = Image.new("CMYK", (40, 30), (0, 255, 255, 0))
    red, green, blue = read_photo(saved(tmp_path, image, ".jpg")).pixels[10, 10]
    assert red > 200
    assert max(green, blue) < 60


def test_what_is_transparent_is_white(tmp_path):
    photo = read_photo(saved(tmp_path, Image.new("RGBA", (4, 4), (0, 0, 0, 0))))
    assert (photo.pixels == 255).all()


@pytest.mark.parametrize("orientation", range(1, 9))
def test_a_photo_is_turned_upright(tmp_path, orientation):
    upright = np.zeros((32, 48, 3), np.uint8)
    upright[:16, :16] = 255
    undo = {2: 0, 3: 3, 4: 1, 5: 5, 6: 2, 7: 6, 8: 4}
    image = Image.fromarray(upright)
    if orientation > 1:
        image = image.transpose(Image.Transpose(undo[orientation]))
    exif = Image.Exif()
    exif[0x0112] = orientation
    photo = read_photo(saved(tmp_path, image, ".jpg", exif=exif, quality=95))
    assert np.abs(photo.pixels.astype(int) - upright).mean() < 3


def exif_of(focal_35mm, size):
    exif = Image.Exif()
    exif.get_ifd(0x8769).update({0xA405: focal_35mm, 0xA002: size[0], 0xA003: size[1]})
    return exif


@pytest.mark.parametrize(
    ("focal", "taken", "focal_px"),
    [
        (26, (4000, 3000), pytest.approx(26 / 43.2666 * 500, rel=1e-4)),
        (0, (400, 300), None),
        (9000, (400, 300), None),
        (26, (16, 9), None),
    ],
)
def test_the_focal_length_of_the_exif_data_is_used_if_it_can_be(tmp_path, focal, taken, focal_px):
    path = saved(tmp_path, ramp("RGB", (400, 300)), ".jpg", exif=exif_of(focal, taken))
    assert read_photo(path).focal_px == focal_px


def test_damaged_exif_data_do_not_spoil_a_photo(tmp_path):
    exif = b"Exif\0\0II*\0\x08\0\0\0\xff\xff" + bytes(range(1, 200))
    path = saved(tmp_path, ramp("RGB"), ".jpg", exif=exif)
    assert read_photo(path).width_px == 40


def png_chunk(kind, data):
    body = kind + data
    return struct.pack(">I", len(data)) + body + struct.pack(">I", zlib.crc32(body))


def png_header(width, height):
    header = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + png_chunk(b"IHDR", header)


def jpeg():
    file = io.BytesIO()
    ramp("RGB", (400, 300)).save(file, "JPEG")
    return file.getvalue()


def png_animation():
    file = io.BytesIO()
    frames = [Image.new("RGB", (8, 8), colour) for colour in ("red", "blue")]
    frames[0].save(file, "PNG", save_all=True, append_images=frames[1:])
    return file.getvalue()


def gif():
    file = io.BytesIO()
    ramp("P").save(file, "GIF")
    return file.getvalue()


BOMB = png_header(40_000, 40_000) + png_chunk(b"IDAT", zlib.compress(bytes(1 << 20)))
HOSTILE = {
    "empty": (b"", "is not a PNG or JPEG picture"),
    "text": (b"width,height\n3,4\n", "is not a PNG or JPEG picture"),
    "gif": (gif(), "is not a PNG or JPEG picture"),
    "heic": (b"\0\0\0\x18ftypheic" + bytes(64), "is a HEIC photo or a film; save it as JPEG"),
    "truncated": (jpeg()[:2000], "is damaged"),
    "no pixels": (png_header(0, 0) + png_chunk(b"IEND", b""), "photo"),
    "header only": (png_header(40, 30), "or is damaged"),
    "large": (
        png_header(12_000, 9_000) + BOMB[33:],
        "has 12000 x 9000 pixels; allowed: 100 megapixels",
    ),
    "bomb": (BOMB, "megapixels"),
    "wide": (png_header(2_147_483_647, 2_147_483_647), "photo"),
    "animation": (png_animation(), "is an animation of 2 pictures"),
}


@pytest.mark.parametrize("case", HOSTILE)
def test_what_is_no_photo_is_refused_in_one_line(tmp_path, case):
    data, words = HOSTILE[case]
    path = tmp_path / "photo.png"
    path.write_bytes(data)
    with pytest.raises(UnreadableFileError, match=words) as caught:
        read_photo(path)
    message = str(caught.value)
    assert message.startswith(str(path))
    assert message.count("photo.png") == 1
    assert "\n" not in message
    assert len(message) < 300


def test_a_name_that_is_no_text_is_shown_without_halves_of_letters(tmp_path):
    path = saved(tmp_path, ramp("L"))
    assert read_photo(path.rename(tmp_path / "\udcff.png")).name == r"\xff.png"


# --- Cameras

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


ON_A_LINE = np.array([(0.0, 0.0), (100.0, 50.0), (200.0, 100.0), (400.0, 200.0)])


@pytest.mark.parametrize(
    ("order", "points_mm", "words"),
    [
        ([3, 2, 1, 0], CORNERS, "a mirror image"),
        ([0, 2, 1, 3], CORNERS, "no view of a plane"),
        ([0, 0, 0, 0], CORNERS, "at the same place"),
        ([0, 1, 2, 3], ON_A_LINE, "on a line"),
        ([0, 1], CORNERS[[0, 0]], "apart"),
    ],
)
def test_points_that_show_no_plane_are_refused(camera, order, points_mm, words):
    points_px = seen(camera, points_mm).points_px[order]
    with pytest.raises(BadInputError, match=words):
        fit_camera(blank(camera), ControlPoints(points_px=points_px, points_mm=points_mm))
