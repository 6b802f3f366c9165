"""Photos of flat scenes by a known camera."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pytest
from PIL import Image
from scipy import ndimage
from scipy.spatial.transform import Rotation
from shapely import box

from vinefab.core.validation import Floats
from vinefab.model.map import (
    MARKER_CELLS,
    MARKER_SIDE_CELLS,
    CornerMarker,
    Map,
    corner_markers,
)
from vinefab.photos.photo import Photo


@dataclass(frozen=True)
class TrueCamera:
    """A pinhole camera that looks at a point of the floor, turned about its axis, then tilted."""

    target_mm: tuple[float, float] = (250.0, 200.0)
    distance_mm: float = 900.0
    tilt_deg: float = 12.0
    towards_deg: float = 30.0
    turn_deg: float = 5.0
    focal_px: float = 1400.0
    size_px: tuple[int, int] = (1640, 1230)

    def homography(self, plane_mm: float = 0.0) -> Floats:
        """Return the homography of a plane: map mm to (column, row)."""
        straight_down = np.diag([1.0, -1.0, -1.0])
        aside = Rotation.from_euler("z", -self.towards_deg, degrees=True)
        tilt = aside.inv() * Rotation.from_euler("y", self.tilt_deg, degrees=True) * aside
        roll = Rotation.from_euler("z", self.turn_deg, degrees=True)
        turn = roll.as_matrix() @ straight_down @ tilt.as_matrix()
        shift = np.array([0, 0, self.distance_mm]) - turn @ np.array([*self.target_mm, 0.0])
        middle = np.array(self.size_px) / 2
        inner = np.diag([self.focal_px, self.focal_px, 1.0])
        inner[:2, 2] = middle
        return inner @ np.column_stack([turn[:, :2], shift + plane_mm * turn[:, 2]])


BEYOND = (150, 130, 110)
"""Colour of what lies beyond the floor."""


def light_of(values):
    return (np.asarray(values, dtype=np.float32) / np.float32(255.0)) ** np.float32(2.2)


@dataclass
class Floor:
    """A painted floor: pixels (rows, columns, 3), 0 to 255, from its upper left corner on."""

    pixels: Floats
    mm_per_pixel: float
    left_mm: float
    top_mm: float

    @classmethod
    def plain(cls, area_mm: tuple[float, float, float, float], mm_per_pixel: float) -> "Floor":
        left, low, right, top = area_mm
        shape = round((top - low) / mm_per_pixel), round((right - left) / mm_per_pixel), 3
        return cls(np.full(shape, 205.0), mm_per_pixel, left, top)

    def matrix(self) -> Floats:
        """Return the homography from map mm to pixels of the floor."""
        step = 1.0 / self.mm_per_pixel
        return np.array(
            [[step, 0, -step * self.left_mm], [0, -step, step * self.top_mm], [0, 0, 1.0]]
        )

    def fill(self, low: Floats, size: tuple[float, float], value: float) -> None:
        """Paint a rectangle."""
        ends = np.array([low, np.add(low, size)]) @ self.matrix()[:2, :2].T + self.matrix()[:2, 2]
        columns, rows = np.round(np.sort(ends, axis=0)).astype(int).T
        self.pixels[rows[0] : rows[1], columns[0] : columns[1]] = value

    def paint(self, markers: Sequence[CornerMarker]) -> None:
        """Paint upright markers with white around them."""
        for marker in markers:
            low, side = marker.corners_mm.min(axis=0), float(np.ptp(marker.corners_mm[:, 0]))
            cell = side / MARKER_SIDE_CELLS
            self.fill(low - cell, (side + 2 * cell, side + 2 * cell), 250.0)
            self.fill(low, (side, side), 15.0)
            for row, cells in enumerate(MARKER_CELLS[marker.number]):
                for column, letter in enumerate(cells):
                    if letter == "#":
                        place = low + cell * np.array([1 + column, 4 - row])
                        self.fill(place, (cell, cell), 250.0)

    def photographed(
        self,
        camera: TrueCamera,
        *,
        noise: float = 0.0,
        blur_px: float = 0.0,
        seed: int = 0,
        supersampling: int = 3,
    ) -> Photo:
        """Return what a camera sees of the floor."""
        columns, rows = camera.size_px
        large = np.diag([supersampling, supersampling, 1.0])
        matrix = self.matrix() @ np.linalg.inv(large @ camera.homography())
        # A lens mixes light, and the camera stores its 2.2th root.
        seen_from = (matrix / matrix[2, 2]).ravel()[:8].tolist()
        large_px = (columns * supersampling, rows * supersampling)
        channels = [
            Image.fromarray(light_of(self.pixels[..., channel])).transform(
                large_px,
                Image.Transform.PERSPECTIVE,
                seen_from,
                Image.Resampling.BILINEAR,
                fillcolor=float(light_of(beyond)),
            )
            for channel, beyond in enumerate(BEYOND)
        ]
        light = np.stack([np.asarray(one.reduce(supersampling)) for one in channels], axis=-1)
        light = ndimage.gaussian_filter(light, (blur_px, blur_px, 0)) if blur_px else light
        seen = 255.0 * light.astype(np.float64) ** (1.0 / 2.2)
        seen = seen + np.random.default_rng(seed).normal(0.0, noise, seen.shape)
        return Photo(name="rendered", pixels=np.clip(np.round(seen), 0, 255).astype(np.uint8))


@pytest.fixture(scope="session")
def camera() -> TrueCamera:
    """Return a camera of half a megapixel; those of phones have twenty times as many."""
    return TrueCamera(focal_px=700.0, size_px=(820, 615))


@pytest.fixture(scope="session")
def markers() -> tuple[CornerMarker, ...]:
    world = Map(name="table", bounds=box(0.0, 0.0, 500.0, 400.0), obstacles=())
    return corner_markers(world)


@pytest.fixture
def floor(markers: tuple[CornerMarker, ...]) -> Floor:
    """Return a floor with four markers around 500 x 400 mm."""
    painted = Floor.plain((-100.0, -100.0, 600.0, 500.0), 0.5)
    painted.paint(markers)
    return painted


@pytest.fixture(scope="session")
def photo(markers: tuple[CornerMarker, ...], camera: TrueCamera) -> Photo:
    """Return a photo of such a floor, rendered once."""
    painted = Floor.plain((-100.0, -100.0, 600.0, 500.0), 0.5)
    painted.paint(markers)
    return painted.photographed(camera, noise=4.0, blur_px=0.7)
