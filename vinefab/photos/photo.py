"""Photos and scans: read from files, where their camera was, and seen from straight above.

A plane at the height of points with known places is seen through a homography, which needs no
camera data. Planes at other heights need the camera's focal length too: from the EXIF data, from
the perspective, or both, weighed by how well each knows it.

OpenCV would fit the same homography (within 3e-5 mm on photos of markers), but in single precision
(0.5 mm off at map coordinates of 1e7 mm), without an error for points on a line, and it is an
extra: points that a person picks do without.
"""

import io
import math
import struct
import warnings
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy  # its parts load at their first use
from numpy.typing import NDArray
from PIL import Image, ImageOps, UnidentifiedImageError

from vinefab.core.errors import UnfitInputError, UnreadableFileError
from vinefab.core.foreign import reading
from vinefab.core.plain_text import visible
from vinefab.core.validation import Floats, frozen_floats, number, positive
from vinefab.model.files.shipped import read_bytes

MOST_MEGAPIXELS = 100
"""Larger pictures are refused before they are unpacked: one may be gigabytes in a file of kB."""

_MOST_BYTES = 1 << 29
_DEEP_TO_BYTE = 1.0 / 257.0
_FILM_DIAGONAL_MM = math.hypot(36.0, 24.0)
_EXIF, _WIDTH, _HEIGHT, _FOCAL_35 = 0x8769, 0xA002, 0xA003, 0xA405


CAMERA_GAMMA = 2.2
"""Lenses mix light, and cameras store about this root of it, in which white spreads over black."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Photo:
    """A photo or a scan as a person looks at it."""

    name: str  # of its file, for messages
    # red, green and blue, uint8, shape (rows, columns, 3); turned upright, transparent parts
    # white. Places in it are (column, row) with the middle of the first pixel at (0.5, 0.5)
    pixels: NDArray[np.uint8]
    # focal length by the file's EXIF data; None where it has none, or where its picture was
    # cropped later
    focal_px: float | None = None

    @property
    def width_px(self) -> int:
        """Columns of pixels."""
        return int(self.pixels.shape[1])

    @property
    def height_px(self) -> int:
        """Rows of pixels."""
        return int(self.pixels.shape[0])


def read_photo(path: Path) -> Photo:
    """Return the photo in a PNG or JPEG file.

    Raises
    ------
    UnreadableFileError
        If it is missing, damaged, another kind of file, an animation or too large.
    """
    data = read_bytes(path, _MOST_BYTES)
    if data[4:8] == b"ftyp":
        raise UnreadableFileError(path, "is a HEIC photo or a film; save it as JPEG or PNG")
    with reading(path):
        pixels, focal_35mm_mm = _decoded(path, data)
    pixels.setflags(write=False)
    diagonal_px = math.hypot(*pixels.shape[:2])
    focal_px = focal_35mm_mm and focal_35mm_mm / _FILM_DIAGONAL_MM * diagonal_px
    return Photo(name=visible(path.name), pixels=pixels, focal_px=focal_px)


def _decoded(path: Path, data: bytes) -> tuple[NDArray[np.uint8], float | None]:
    """Return the upright pixels of a picture, and the focal length by its EXIF data."""
    try:
        with warnings.catch_warnings():
            # We have a limit of our own; what else Pillow warns of does not stop it from reading.
            warnings.simplefilter("ignore")
            image: Image.Image = Image.open(io.BytesIO(data), formats=("PNG", "JPEG"))
            _ensure_one_picture(path, image)
            image.load()
            focal_35mm_mm = _focal_35mm_mm(image)
            upright: Image.Image = image  # as it is where the EXIF data are damaged
            with suppress(OSError, ValueError, SyntaxError, LookupError, TypeError, struct.error):
                upright = ImageOps.exif_transpose(image)
            pixels = _rgb(upright)
    except UnidentifiedImageError:
        raise UnreadableFileError(path, "is not a PNG or JPEG picture, or is damaged") from None
    except Image.DecompressionBombError:
        raise UnreadableFileError(path, f"has more than {MOST_MEGAPIXELS} megapixels") from None
    except UnreadableFileError:
        raise
    except (OSError, ValueError, SyntaxError, EOFError, struct.error) as error:
        raise UnreadableFileError(path, f"is damaged: {error}") from None
    return pixels, focal_35mm_mm


def _ensure_one_picture(path: Path, image: Image.Image) -> None:
    width, height = image.size
    if width * height > MOST_MEGAPIXELS * 1_000_000:
        problem = f"has {width} x {height} pixels; allowed: {MOST_MEGAPIXELS} megapixels"
        raise UnreadableFileError(path, problem)
    # A phone's JPEG may hold a preview behind its picture (MPO); the first is the picture.
    frames = int(getattr(image, "n_frames", 1))
    if image.format == "PNG" and frames > 1:
        raise UnreadableFileError(path, f"is an animation of {frames} pictures; allowed: one")


def _focal_35mm_mm(image: Image.Image) -> float | None:
    """Return the focal length for film of 36 x 24 mm by the EXIF data, if it is to be believed."""
    try:
        exif = image.getexif().get_ifd(_EXIF)
        taken = (float(exif.get(_WIDTH, 0)), float(exif.get(_HEIGHT, 0)))
        focal_35mm_mm = float(exif.get(_FOCAL_35, 0))
    except (OSError, ValueError, SyntaxError, LookupError, TypeError, struct.error):
        return None
    lenses_35mm_mm = (8.0, 800.0)
    if not lenses_35mm_mm[0] <= focal_35mm_mm <= lenses_35mm_mm[1]:
        return None
    # Cropped pictures have another shape than the camera took.
    shape, taken_shape = sorted(image.size), sorted(taken)
    cropped = taken_shape[0] > 0 and not math.isclose(
        shape[1] * taken_shape[0], shape[0] * taken_shape[1], rel_tol=0.01
    )
    return None if cropped else focal_35mm_mm


def _rgb(image: Image.Image) -> NDArray[np.uint8]:
    """Return red, green and blue of each pixel of an image of any mode."""
    if image.mode.startswith(("I", "F")):
        grey = np.asarray(image, dtype=np.float64) * _DEEP_TO_BYTE
        levels = np.clip(np.round(grey), 0, 255).astype(np.uint8)
        return np.repeat(levels[..., None], 3, axis=2)
    if image.has_transparency_data:
        image = image.convert("RGBA")
        paper = Image.new("RGBA", image.size, "white")
        image = Image.alpha_composite(paper, image)
    return np.array(image.convert("RGB"))


LEAST_NOISE_PX = 0.1
"""How well a marker's corner is found at best (assumed)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ControlPoints:
    """Points of a photo whose places in the map are known; at least two."""

    # where they are seen, (column, row), shape (n, 2); middles of pixels end in .5
    points_px: Floats
    points_mm: Floats  # where they are in the map, shape (n, 2)
    z_mm: float = 0.0  # their height above the floor
    # how far their places in the photo may be off (standard deviation; assumed)
    noise_px: float = LEAST_NOISE_PX

    def __post_init__(self) -> None:
        object.__setattr__(self, "points_px", frozen_floats("points_px", self.points_px, 2))
        object.__setattr__(self, "points_mm", frozen_floats("points_mm", self.points_mm, 2))
        number("z_mm", self.z_mm, -1e6, 1e6, "mm")
        if len(self.points_px) != len(self.points_mm) or len(self.points_px) < 2:
            counts = f"{len(self.points_px)} are in the photo, {len(self.points_mm)} in the map"
            raise UnfitInputError("points", counts, "give the same number, at least two")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PhotoCamera:
    """How a photo sees planes at any height."""

    homography: Floats  # shape (3, 3): map coordinates (x, y, 1) at height ``z_mm`` to the photo
    # shape (3,): what is added to its last column per mm of height; zero where the focal
    # length is unknown, as if the camera were far away
    rise: Floats
    z_mm: float  # height of the control points
    # root mean square distance, in the map, between the control points and where the photo
    # shows them; 0 where they are just enough to fit
    residual_mm: float
    focal_px: float | None  # focal length; None where it is unknown
    # how far it may be off, as a share (standard deviation); infinite where it is unknown
    focal_share: float
    # worst error of the places of points one millimetre above or below the control points
    # (within the control points): 95 % of the focal length's error; where that is unknown,
    # all of the parallax of a lens of 13 mm (assumed)
    parallax_mm_per_mm: float

    def at(self, plane_mm: float) -> Floats:
        """Return the homography of a plane at a height above the floor."""
        moved = self.homography.copy()
        moved[:, 2] += (plane_mm - self.z_mm) * self.rise
        return moved

    def to_photo(self, points_mm: Floats, plane_mm: float | None = None) -> Floats:
        """Return where points of the map, shape (n, 2), are in the photo."""
        return projected(self.at(self.z_mm if plane_mm is None else plane_mm), points_mm)

    def to_map(self, points_px: Floats, plane_mm: float | None = None) -> Floats:
        """Return where points of the photo, shape (n, 2), are on a plane of the map."""
        matrix = self.at(self.z_mm if plane_mm is None else plane_mm)
        return projected(inverse(matrix), points_px)


def projected(homography: Floats, points: Floats) -> Floats:
    """Return points, shape (n, 2), after a homography."""
    moved = np.column_stack([points, np.ones(len(points))]) @ homography.T
    return np.asarray(moved[:, :2] / moved[:, 2:])


def inverse(homography: Floats) -> Floats:
    """Return the homography the other way."""
    return np.asarray(np.linalg.inv(homography), dtype=np.float64)


def fit_camera(photo: Photo, control: ControlPoints) -> PhotoCamera:
    """Return the camera of a photo by its control points.

    Two or three points give scale and turn only, for scans and photos from straight above; four
    and more give the perspective.

    Raises
    ------
    BadInputError
        If the points lie on a line or on each other, or the photo would be a mirror image.
    """
    homography = plane_homography(control)
    depth = np.column_stack([control.points_mm, np.ones(len(control.points_mm))]) @ homography[2]
    if not (depth > 0.0).all() and not (depth < 0.0).all():
        remedy = "give four corners in the same order in photo and map"
        raise UnfitInputError("points", "they are no view of a plane", remedy)
    # Rows run down, y runs up: seen from above the determinant is negative.
    if np.linalg.det(homography) * np.sign(depth[0]) > 0.0:
        remedy = "give corners in the same order in photo and map, seen from above"
        raise UnfitInputError("points", "they are a mirror image", remedy)
    residual = projected(inverse(homography), control.points_px) - control.points_mm
    perspective = len(control.points_px) >= _FEWEST_OF_PERSPECTIVE
    pose = _Pose.of(photo, control, homography) if perspective else None
    most_focal_share = 0.1  # A focal length less well known than this is not used
    if pose is not None and pose.focal_share > most_focal_share:
        pose = None
    return PhotoCamera(
        homography=homography,
        rise=np.zeros(3) if pose is None else pose.rise(homography),
        z_mm=control.z_mm,
        residual_mm=float(np.sqrt(np.mean(np.hypot(*residual.T) ** 2))),
        focal_px=None if pose is None else pose.focal_px,
        focal_share=float("inf") if pose is None else pose.focal_share,
        parallax_mm_per_mm=_unknown_slope(photo, control, homography)
        if pose is None
        else 2.0 * pose.focal_share * pose.slope(control),
    )


_FEWEST_OF_PERSPECTIVE = 4


def plane_homography(control: ControlPoints) -> Floats:
    """Return the homography from the map to the photo, for the plane of the control points.

    Of two or three points it is a scale and a turn, seen from above: rows run down.
    """
    if len(control.points_px) >= _FEWEST_OF_PERSPECTIVE:
        return fitted_homography(control)
    ours = control.points_mm @ (1.0, 1.0j)
    theirs = (control.points_px * (1.0, -1.0)) @ (1.0, 1.0j)
    spread = ours - ours.mean()
    if np.abs(spread).max() == 0.0 or np.abs(theirs - theirs.mean()).max() == 0.0:
        raise UnfitInputError("points", "they lie at the same place", "give points apart")
    turn = np.vdot(spread, theirs - theirs.mean()) / np.vdot(spread, spread)
    offset = theirs.mean() - turn * ours.mean()
    across, down = [turn.real, -turn.imag, offset.real], [-turn.imag, -turn.real, -offset.imag]
    return np.array([across, down, [0.0, 0.0, 1.0]])


def fitted_homography(control: ControlPoints) -> Floats:
    """Return the homography with the least sum of squared distances in the photo."""
    to_unit_mm, to_unit_px = _normalizing(control.points_mm), _normalizing(control.points_px)
    ours = projected(to_unit_mm, control.points_mm)
    theirs = projected(to_unit_px, control.points_px)
    # Begin with the least algebraic error (direct linear transform).
    plane, zero = np.column_stack([ours, np.ones(len(ours))]), np.zeros((len(ours), 3))
    rows = [
        np.column_stack([plane, zero, -theirs[:, :1] * plane]),
        np.column_stack([zero, plane, -theirs[:, 1:] * plane]),
    ]
    rough = np.linalg.svd(np.vstack(rows))[2][-1].reshape(3, 3)

    def off(values: Floats) -> Floats:
        return (projected(np.append(values, 1.0).reshape(3, 3), ours) - theirs).ravel()

    if abs(rough[2, 2]) < 1e-9:
        raise UnfitInputError("points", "they lie on a line", _NOT_ON_A_LINE)
    fit = scipy.optimize.least_squares(off, (rough / rough[2, 2]).ravel()[:8], method="lm")
    unit = np.append(fit.x, 1.0).reshape(3, 3)
    if abs(np.linalg.det(unit)) < 1e-6:
        raise UnfitInputError("points", "they lie on a line", _NOT_ON_A_LINE)
    matrix = inverse(to_unit_px) @ unit @ to_unit_mm
    return np.asarray(matrix / matrix[2, 2])


_NOT_ON_A_LINE = "give four points of which no three lie on a line"


def _normalizing(points: Floats) -> Floats:
    """Return the homography that moves points' middle to the origin and makes them of size one."""
    middle, size = points.mean(axis=0), float(np.ptp(points, axis=0).max())
    if size == 0.0:
        raise UnfitInputError("points", "they lie at the same place", "give points apart")
    return np.array([[1, 0, -middle[0]], [0, 1, -middle[1]], [0, 0, size]]) / size


@dataclass(frozen=True, slots=True, eq=False)
class _Pose:
    """A camera with square pixels whose axis goes through the middle of its photo."""

    focal_px: float
    focal_share: float
    turn: Floats  # shape (3, 3): map axes to camera axes (right, down, ahead)
    shift_mm: Floats  # the map's origin at the control points' height, in camera axes
    middle_px: Floats

    @classmethod
    def of(cls, photo: Photo, control: ControlPoints, homography: Floats) -> "_Pose | None":
        """Return the camera that fits the control points and the EXIF focal length best."""
        rotation = scipy.spatial.transform.Rotation
        middle = np.array([photo.width_px, photo.height_px]) / 2.0
        centred = np.array([[1, 0, -middle[0]], [0, 1, -middle[1]], [0, 0, 1]]) @ homography
        focal = photo.focal_px
        if focal is None:  # the one that makes the homography's axes square and alike
            one, two = centred[:, 0], centred[:, 1]
            # Both are of the form a + f^2 b = 0, with f in pixels and the first two rows over f.
            sides = np.array([one[:2] @ two[:2], (one[:2] @ one[:2] - two[:2] @ two[:2]) / 2.0])
            depths = np.array([one[2] * two[2], (one[2] ** 2 - two[2] ** 2) / 2.0])
            square = -float(sides @ depths / (depths @ depths)) if depths.any() else 0.0
            if square <= 0.0:
                return None
            focal = float(np.sqrt(square))
        axes = centred / np.array([[focal], [focal], [1.0]])
        axes = axes * 2.0 / (np.linalg.norm(axes[:, 0]) + np.linalg.norm(axes[:, 1]))
        if axes[2, 2] < 0.0:
            axes = -axes
        rough = np.column_stack([axes[:, 0], axes[:, 1], np.cross(axes[:, 0], axes[:, 1])])
        left, _, right = np.linalg.svd(rough)
        nearest = left @ np.diag([1.0, 1.0, np.linalg.det(left @ right)]) @ right
        turn = rotation.from_matrix(nearest).as_rotvec()
        begin = np.concatenate([[np.log(focal)], turn, axes[:, 2]])
        freedom, noise = 2 * len(control.points_px) - 8, control.noise_px
        if freedom > 0:  # what the fit of the homography leaves
            residual = projected(homography, control.points_mm) - control.points_px
            noise = max(noise, float(np.sqrt((residual**2).sum() / freedom)))

        # How far, as a share, an EXIF focal length is from the true one (assumed): it is rounded to
        # millimetres, and focusing near lengthens it.
        exif_focal_share = 0.03

        def off(values: Floats) -> Floats:
            axes = rotation.from_rotvec(values[1:4]).as_matrix()
            inside = control.points_mm @ axes[:, :2].T + values[4:7]
            seen = np.exp(values[0]) * inside[:, :2] / inside[:, 2:] + middle
            apart = (seen - control.points_px).ravel() / noise
            if photo.focal_px is None:
                return np.asarray(apart)
            return np.append(apart, (values[0] - np.log(photo.focal_px)) / exif_focal_share)

        fit = scipy.optimize.least_squares(off, begin, x_scale="jac", method="lm", max_nfev=300)
        # Residuals have a standard deviation of one: that of the focal length's logarithm is one
        # over its slope, without what the other values could explain of it.
        slopes = np.asarray(fit.jac)
        first, others = slopes[:, 0], slopes[:, 1:]
        along, *_ = np.linalg.lstsq(others, first, rcond=None)
        alone = float(np.linalg.norm(first - others @ along))
        share = 1.0 / alone if alone > 0.0 else float("inf")
        turn = rotation.from_rotvec(fit.x[1:4]).as_matrix()
        return cls(float(np.exp(fit.x[0])), share, turn, fit.x[4:7], middle)

    def rise(self, homography: Floats) -> Floats:
        """Return the gain of a homography's last column per mm of height."""
        inner = np.diag([self.focal_px, self.focal_px, 1.0])
        inner[:2, 2] = self.middle_px
        own = inner @ np.column_stack([self.turn[:, :2], self.shift_mm])
        scale = float((homography * own).sum() / (own * own).sum())
        return np.asarray(scale * inner @ self.turn[:, 2])

    def slope(self, control: ControlPoints) -> float:
        """Return the largest parallax within the control points, in mm per mm of height."""
        place = -self.turn.T @ self.shift_mm
        apart = np.hypot(*(control.points_mm - place[:2]).T)
        return float(apart.max() / abs(place[2]))


def _unknown_slope(photo: Photo, control: ControlPoints, homography: Floats) -> float:
    """Return the largest parallax of the widest lens, from straight above the photo's middle."""
    middle = np.array([[photo.width_px, photo.height_px]]) / 2.0
    below = projected(inverse(homography), middle)
    apart = np.hypot(*(control.points_mm - below).T).max()
    near = projected(homography, below + np.eye(3, 2, -1))
    scale = np.linalg.norm(np.diff(near[:2], axis=0)) + np.linalg.norm(near[2] - near[0])
    diagonal_px = np.hypot(photo.width_px, photo.height_px)
    # Widest lens of usual phones (assumed), for the parallax where the focal length is unknown.
    widest_35mm_mm = 13.0
    height_mm = widest_35mm_mm / _FILM_DIAGONAL_MM * diagonal_px / (scale / 2.0)
    return float(apart / height_mm)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlanView:
    """A rectified photo."""

    # red, green and blue, uint8, shape (rows, columns, 3); the first row is the topmost
    pixels: NDArray[np.uint8]
    mm_per_pixel: float  # side of a pixel on the plane that the photo was rectified to
    # map coordinates of the upper left corner of the upper left pixel
    left_mm: float
    top_mm: float

    def to_map(self, points_px: Floats) -> Floats:
        """Return map coordinates of points (column, row), shape (n, 2); pixel middles end in .5."""
        points = np.asarray(points_px, dtype=np.float64)
        return np.array([self.left_mm, self.top_mm]) + points * (
            self.mm_per_pixel,
            -self.mm_per_pixel,
        )

    def to_pixels(self, points_mm: Floats) -> Floats:
        """Return points (column, row), shape (n, 2), of map coordinates."""
        away = np.asarray(points_mm, dtype=np.float64) - (self.left_mm, self.top_mm)
        return np.asarray(away / (self.mm_per_pixel, -self.mm_per_pixel))


AreaMm = tuple[float, float, float, float]
"""Left, low, right and top in map coordinates."""


def rectified(
    photo: Photo,
    camera: PhotoCamera,
    area_mm: AreaMm,
    *,
    plane_mm: float | None = None,
    mm_per_pixel: float | None = None,
) -> PlanView:
    """Return a photo as if taken from straight above; what it does not show is white.

    Parameters
    ----------
    area_mm
        Left, low, right and top of the area to show, in map coordinates.
    plane_mm
        Height above the floor of the plane to show; that of the control points when None.
    mm_per_pixel
        When None, as fine as the photo is where it is finest.
    """
    homography = camera.at(camera.z_mm if plane_mm is None else plane_mm)
    left, low, right, top = area_mm
    positive("area_mm", right - left)
    positive("area_mm", top - low)
    fine = 1.0 / most_pixels_per_mm(homography, area_mm)
    step = fine if mm_per_pixel is None else positive("mm_per_pixel", mm_per_pixel)
    columns, rows = (max(1, round(size / step)) for size in (right - left, top - low))
    if columns * rows > MOST_MEGAPIXELS * 1_000_000:
        problem = f"{step:g} make a plan of more than {MOST_MEGAPIXELS} megapixels"
        raise UnfitInputError("mm_per_pixel", problem, "give more", photo.name)
    to_map = np.array([[step, 0.0, left], [0.0, -step, top], [0.0, 0.0, 1.0]])
    # Coarser plans are taken from a smaller photo: single pixels of it would be noise.
    times = max(1, int(step / fine + 1e-6))
    source = Image.fromarray(photo.pixels)
    source = source.reduce(times) if times > 1 else source
    matrix = np.diag([1.0 / times, 1.0 / times, 1.0]) @ homography @ to_map
    plan = source.transform(
        (columns, rows),
        Image.Transform.PERSPECTIVE,
        (matrix / matrix[2, 2]).ravel()[:8].tolist(),
        Image.Resampling.BICUBIC,
        fillcolor="white",
    )
    return PlanView(
        pixels=np.asarray(plan),
        mm_per_pixel=step,
        left_mm=left,
        top_mm=top,
    )


def shown_in(
    photo: Photo, camera: PhotoCamera, view: PlanView, plane_mm: float
) -> NDArray[np.bool_]:
    """Return the mask of the pixels of a plan that its photo shows, shape (rows, columns)."""
    rows, columns = view.pixels.shape[:2]
    corners = view.to_map(np.array([(0.0, 0.0), (columns, 0.0), (0.0, rows)]))
    to_map = np.eye(3)
    to_map[:2, 0] = (corners[1] - corners[0]) / columns
    to_map[:2, 1] = (corners[2] - corners[0]) / rows
    to_map[:2, 2] = corners[0]
    matrix = camera.at(plane_mm) @ to_map
    across = np.arange(columns) + 0.5
    shown = np.empty((rows, columns), dtype=np.bool_)
    for row in range(rows):  # a row at a time: all of them would take ten times the photo
        depth = matrix[2, 0] * across + matrix[2, 1] * (row + 0.5) + matrix[2, 2]
        column_px = (matrix[0, 0] * across + matrix[0, 1] * (row + 0.5) + matrix[0, 2]) / depth
        row_px = (matrix[1, 0] * across + matrix[1, 1] * (row + 0.5) + matrix[1, 2]) / depth
        shown[row] = (column_px >= 0.0) & (column_px <= photo.width_px)
        shown[row] &= (row_px >= 0.0) & (row_px <= photo.height_px)
    return shown


def most_pixels_per_mm(homography: Floats, area_mm: AreaMm) -> float:
    """Return the largest number of photo pixels on a millimetre of the plane."""
    left, low, right, top = area_mm
    corners = np.array([(left, low), (right, low), (right, top), (left, top)])
    depth = np.column_stack([corners, np.ones(4)]) @ homography[2]
    if not ((depth > 0.0).all() or (depth < 0.0).all()):
        raise UnfitInputError(
            "area_mm", "the camera does not see all its corners", "give a smaller area"
        )
    step = 1e-3 * min(right - left, top - low)
    here = projected(homography, corners)
    along = projected(homography, corners + np.array([step, 0.0])) - here
    up = projected(homography, corners + np.array([0.0, step])) - here
    areas = np.abs(along[:, 0] * up[:, 1] - along[:, 1] * up[:, 0])
    return float(np.sqrt(areas.max()) / step)
