"""A photo as a plan: what a camera straight above would have seen, in map coordinates."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from vinefab.core.validation import Floats


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
