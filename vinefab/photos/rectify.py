"""Photos made into plans: what a camera straight above would have seen, in map coordinates."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats, positive
from vinefab.photos.photo import MOST_MEGAPIXELS, Photo
from vinefab.photos.photo_camera import PhotoCamera, projected


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlanView:
    """A rectified photo.

    Parameters
    ----------
    pixels
        Red, green and blue, uint8, shape (rows, columns, 3); the first row is the topmost.
    mm_per_pixel
        Side of a pixel on the plane that the photo was rectified to.
    left_mm, top_mm
        Map coordinates of the upper left corner of the upper left pixel.
    """

    pixels: NDArray[np.uint8]
    mm_per_pixel: float
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
        Left, low, right and top of what to show, in map coordinates.
    plane_mm
        Height above the floor of what is looked at; that of the control points when None.
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
        allowed = f"so large that the plan has at most {MOST_MEGAPIXELS} megapixels"
        raise BadInputError("mm_per_pixel", step, allowed, photo.name)
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
    """Return which pixels of a plan its photo shows, shape (rows, columns)."""
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
    """Return how many pixels of a photo a millimetre of the plane has where it has most."""
    left, low, right, top = area_mm
    corners = np.array([(left, low), (right, low), (right, top), (left, top)])
    depth = np.column_stack([corners, np.ones(4)]) @ homography[2]
    if not ((depth > 0.0).all() or (depth < 0.0).all()):
        raise BadInputError("area_mm", area_mm, "an area of which the camera sees all corners")
    step = 1e-3 * min(right - left, top - low)
    here = projected(homography, corners)
    along = projected(homography, corners + np.array([step, 0.0])) - here
    up = projected(homography, corners + np.array([0.0, step])) - here
    areas = np.abs(along[:, 0] * up[:, 1] - along[:, 1] * up[:, 0])
    return float(np.sqrt(areas.max()) / step)
