"""Photos made into plans."""

import numpy as np
from PIL import Image

from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats, positive
from vinefab.photos.photo import MOST_MEGAPIXELS, Photo
from vinefab.photos.photo_camera import PhotoCamera, projected
from vinefab.photos.plan_view import PlanView


def rectified(
    photo: Photo,
    camera: PhotoCamera,
    area_mm: tuple[float, float, float, float],
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
    plane = camera.z_mm if plane_mm is None else plane_mm
    homography = camera.at(plane)
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
    pixels = np.asarray(plan)
    return PlanView(pixels=pixels, mm_per_pixel=step, left_mm=left, top_mm=top)


def most_pixels_per_mm(homography: Floats, area_mm: tuple[float, float, float, float]) -> float:
    """Return how many pixels of a photo a millimetre of the plane has where it has most."""
    left, low, right, top = area_mm
    corners = np.array([(left, low), (right, low), (right, top), (left, top)])
    if not _in_front(homography, corners):
        raise BadInputError("area_mm", area_mm, "an area of which the camera sees all corners")
    step = 1e-3 * min(right - left, top - low)
    here = projected(homography, corners)
    along = projected(homography, corners + np.array([step, 0.0])) - here
    up = projected(homography, corners + np.array([0.0, step])) - here
    areas = np.abs(along[:, 0] * up[:, 1] - along[:, 1] * up[:, 0])
    return float(np.sqrt(areas.max()) / step)


def _in_front(homography: Floats, points: Floats) -> bool:
    depth = np.column_stack([points, np.ones(len(points))]) @ homography[2]
    return bool((depth > 0.0).all() or (depth < 0.0).all())
