"""Photos of a grown robot on a rig, rendered by a small ray caster, with the truth known.

Tubes are cylinders that lie on the floor, obstacles are prisms; a pinhole camera looks at them from
anywhere above. Light, shadows, gloss, grain, blur, noise and JPEG are rough but of a phone's size.
"""

import io
import itertools
import math
from dataclasses import dataclass

import numpy as np
import shapely
from PIL import Image
from scipy import ndimage

from vinefab.model.map import MARKER_CELLS, MARKER_SIDE_CELLS, corner_markers
from vinefab.physics.tube import inflated_radius_mm

CELL_MM = 0.5
RIM_MM = 60.0


@dataclass(frozen=True)
class Look:
    """How a photo is taken and what the things in it look like."""

    tilt_deg: float = 0.0  # of the camera from straight down
    turn_deg: float = 0.0  # from which side the camera looks
    roll_deg: float = 0.0
    distance_mm: float = 900.0
    pixels: tuple = (1632, 1224)
    film: tuple = (214, 88, 40)
    board: tuple = (186, 188, 184)
    block: tuple = (90, 110, 140)
    height_mm: float = 30.0  # of the obstacles
    light_deg: tuple = (50.0, 35.0)  # azimuth, height of the lamp above the floor
    shade: float = 0.55  # how bright the floor is in the shadow
    gloss: float = 0.35
    noise: float = 3.0
    blur_px: float = 0.7
    jpeg: int = 88
    seed: int = 1
    markers: bool = True
    marker_gap_mm: float = 12.0  # from the box of the bounds


@dataclass
class Camera:
    place_mm: np.ndarray
    axes: np.ndarray  # rows: right, down, forward
    focal_px: float
    pixels: tuple

    @classmethod
    def of(cls, look, box_mm):
        """Return a camera that sees a whole box, as somebody who takes care would hold it."""
        left, low, right, top = box_mm
        middle = np.array([(left + right) / 2, (low + top) / 2, 0.0])
        tilt, turn = math.radians(look.tilt_deg), math.radians(look.turn_deg)
        away = np.array([math.cos(turn), math.sin(turn), 0.0])
        place = middle + look.distance_mm * (
            math.sin(tilt) * away + np.array([0, 0, math.cos(tilt)])
        )
        corners = np.array([(x, y, 0.0) for x in (left, right) for y in (low, top)]) - place
        goal = middle - place
        for _ in range(5):
            axes = axes_of(goal / np.linalg.norm(goal), -away, math.radians(look.roll_deg))
            seen = (corners @ axes.T)[:, :2] / (corners @ axes.T)[:, 2:]
            shift = (seen.max(axis=0) + seen.min(axis=0)) / 2
            goal = axes[2] + shift[0] * axes[0] + shift[1] * axes[1]
        half = np.abs(seen).max(axis=0)
        focal = 0.97 / 2 * (np.array(look.pixels) / half).min()
        return cls(place, axes, focal, look.pixels)

    def rays(self):
        width, height = self.pixels
        u, v = np.meshgrid(np.arange(width) + 0.5 - width / 2, np.arange(height) + 0.5 - height / 2)
        local = np.stack([u / self.focal_px, v / self.focal_px, np.ones_like(u)], axis=-1)
        return local.reshape(-1, 3) @ self.axes

    def seen_at(self, points_mm):
        local = (np.atleast_2d(points_mm) - self.place_mm) @ self.axes.T
        return local[:, :2] / local[:, 2:] * self.focal_px + np.array(self.pixels) / 2


def axes_of(forward, up, roll):
    """Return right, down and forward of a camera, shape (3, 3)."""
    right = np.cross(forward, up)
    right /= np.linalg.norm(right)
    down = np.cross(forward, right)
    turned = math.cos(roll) * right + math.sin(roll) * down
    return np.array([turned, np.cross(forward, turned), forward])


class Raster:
    """A table around a map in small cells, with the obstacles on it."""

    def __init__(self, world, rim_mm):
        left, low, right, top = world.bounds.bounds
        self.low_mm = np.array([left - rim_mm, low - rim_mm])
        self.shape = tuple(int((s + 2 * rim_mm) / CELL_MM) for s in (top - low, right - left))
        self.x = self.low_mm[0] + (np.arange(self.shape[1]) + 0.5) * CELL_MM
        self.y = self.low_mm[1] + (np.arange(self.shape[0]) + 0.5) * CELL_MM
        solid = shapely.union_all(list(world.obstacles))
        self.block = shapely.contains_xy(solid, *np.meshgrid(self.x, self.y))

    def cells(self, at):
        """Return the cells in which points lie, by number."""
        place = ((at - self.low_mm) / CELL_MM).astype(int)
        column, row = place[:, 0].clip(0, self.shape[1] - 1), place[:, 1].clip(0, self.shape[0] - 1)
        return row * self.shape[1] + column


def lamp_of(look):
    """Return the way to the lamp."""
    azimuth, up = (math.radians(angle) for angle in look.light_deg)
    return np.array(
        [math.cos(azimuth) * math.cos(up), math.sin(azimuth) * math.cos(up), math.sin(up)]
    )


def halfway(lamp):
    """Return the normal that shines towards a camera above."""
    way = lamp + np.array([0.0, 0.0, 1.0])
    return way / np.linalg.norm(way)


def shadow_of(height, lamp, step_mm):
    """Return the cells that higher ones keep in the shadow."""
    shadow = np.zeros(height.shape, bool)
    for z in np.arange(step_mm, height.max(), step_mm):
        reach = z / lamp[2] * lamp[:2] / CELL_MM
        shadow |= np.roll(height, (-round(reach[1]), -round(reach[0])), axis=(0, 1)) > z
    return shadow


def marker_cells(marker, x, y):
    """Return column and row of points on a marker, and whether they are white there."""
    corner, side = marker.corners_mm[0], marker.corners_mm[1][0] - marker.corners_mm[0][0]
    column = np.floor((x - corner[0]) / side * MARKER_SIDE_CELLS).astype(int)
    row = np.floor((corner[1] - y) / side * MARKER_SIDE_CELLS).astype(int)
    inside = (column >= 0) & (column < 6) & (row >= 0) & (row < 6)
    white = np.zeros((6, 6), bool)
    white[1:5, 1:5] = [[sign == "#" for sign in line] for line in MARKER_CELLS[marker.number]]
    return column, row, ~inside | white[row.clip(0, 5), column.clip(0, 5)]


def linear(colour):
    return (np.array(colour) / 255.0) ** 2.2


def developed(image, look, rng):
    """Return light on pixels as a JPEG: out of focus, stored as its root, with noise."""
    image = ndimage.gaussian_filter(image, (look.blur_px, look.blur_px, 0))
    seen = 255.0 * np.clip(image, 0, 1) ** (1 / 2.2) + rng.normal(0.0, look.noise, image.shape)
    buffer = io.BytesIO()
    picture = Image.fromarray(np.clip(seen, 0, 255).astype(np.uint8))
    picture.save(buffer, "JPEG", quality=look.jpeg)
    return buffer.getvalue()


class Scene(Raster):
    """A map with a robot on it, as fields over a fine raster."""

    def __init__(self, world, deployment, build, look):
        super().__init__(world, RIM_MM)
        self.world, self.deployment, self.build, self.look = world, deployment, build, look
        tree = self.deployment.tree
        # Branches of one width, from the trunk outwards: what is drawn later lies above.
        kinds = sorted(set(zip(tree.level.tolist(), tree.width_mm.tolist(), strict=True)))
        self.tubes = [self._tube(level, width_mm) for level, width_mm in kinds]
        self.height = np.where(self.block, self.look.height_mm, 0.0)
        for radius, away, _ in self.tubes:
            inside = away < radius
            top = radius + np.sqrt(np.maximum(radius**2 - np.minimum(away, radius) ** 2, 0.0))
            self.height = np.where(inside & ~self.block, np.maximum(self.height, top), self.height)

    def _tube(self, level, width_mm):
        """Return the radius of branches, the distance from their lines and the way to them."""
        radius, tree = inflated_radius_mm(width_mm), self.deployment.tree
        away = np.full(self.shape, 1e6)
        to = np.zeros((*self.shape, 2))
        alike = (tree.level == level) & (tree.width_mm == width_mm)
        for branch in np.flatnonzero(alike & self.deployment.deployed):
            chain = self.deployment.chain_mm(branch)
            for a, b in itertools.pairwise(chain):
                self._draw(a, b, radius + 2.0, away, to)
        return radius, away, to

    def _draw(self, a, b, rim, away, to):
        lo, hi = np.minimum(a, b) - rim, np.maximum(a, b) + rim
        c0, c1 = (
            np.clip(
                [(lo[0] - self.low_mm[0]) / CELL_MM, (hi[0] - self.low_mm[0]) / CELL_MM + 1],
                0,
                self.shape[1],
            )
        ).astype(int)
        r0, r1 = (
            np.clip(
                [(lo[1] - self.low_mm[1]) / CELL_MM, (hi[1] - self.low_mm[1]) / CELL_MM + 1],
                0,
                self.shape[0],
            )
        ).astype(int)
        x, y = np.meshgrid(self.x[c0:c1], self.y[r0:r1])
        step = b - a
        long = float(step @ step)
        share = np.clip(((x - a[0]) * step[0] + (y - a[1]) * step[1]) / max(long, 1e-9), 0.0, 1.0)
        dx, dy = x - a[0] - share * step[0], y - a[1] - share * step[1]
        d = np.hypot(dx, dy)
        window = away[r0:r1, c0:c1]
        nearer = d < window
        window[nearer] = d[nearer]
        to[r0:r1, c0:c1][nearer] = np.stack([dx, dy], axis=-1)[nearer]


def render(scene: Scene):
    """Return the photo as an array of uint8 RGB, and the camera."""
    look, rng = scene.look, np.random.default_rng(scene.look.seed)
    left, low, right, top = scene.world.bounds.bounds
    rim = 48.0 if look.markers else 5.0
    camera = Camera.of(look, (left - rim, low - rim, right + rim, top + rim))
    rays = camera.rays()
    flat = camera.place_mm[:2] - rays[:, :2] * (camera.place_mm[2] / rays[:, 2:])
    lean = rays[:, :2] / rays[:, 2:]  # way across for each mm of height
    lit = _floor(scene, rng)
    colour = lit.reshape(-1, 3)[scene.cells(flat)]
    outside = (
        (flat[:, 0] < scene.low_mm[0])
        | (flat[:, 1] < scene.low_mm[1])
        | (flat[:, 0] > scene.x[-1])
        | (flat[:, 1] > scene.y[-1])
    )
    colour[outside] = np.array(look.board) / 255.0 * 0.5
    if look.markers:
        _markers(scene, flat, colour)
    _things(scene, flat, lean, colour)
    image = colour.reshape(look.pixels[1], look.pixels[0], 3)
    u, v = np.meshgrid(np.linspace(-1, 1, look.pixels[0]), np.linspace(-1, 1, look.pixels[1]))
    image = image * (1.0 - 0.18 * (u**2 + v**2) / 2)[..., None]
    data = developed(image, look, rng)
    return np.array(Image.open(io.BytesIO(data))), camera, data


def _floor(scene, rng):
    """Return the floor's colour on the raster: grain, uneven light, shadows and markers."""
    look = scene.look
    rows, cols = scene.shape
    coarse = ndimage.zoom(rng.normal(0, 1, (6, 6)), (rows / 6, cols / 6), order=3)
    grain = rng.normal(0, 0.03, scene.shape)
    light = 1.0 + 0.08 * coarse[:rows, :cols] + grain
    soft = ndimage.gaussian_filter(shadow_of(scene.height, lamp_of(look), 0.5).astype(float), 1.5)
    light *= 1.0 - (1.0 - look.shade) * soft
    return light[..., None] * linear(look.board)


def _markers(scene, at, colour):
    x, y = at.T
    for marker in corner_markers(scene.world, gap_mm=scene.look.marker_gap_mm):
        a, b = marker.corners_mm[0], marker.corners_mm[2]
        pad = (x > a[0] - 8) & (x < b[0] + 8) & (y < a[1] + 8) & (y > b[1] - 8)
        _, _, white = marker_cells(marker, x[pad], y[pad])
        colour[pad] = np.where(white, 0.85, 0.02)[:, None]


def _things(scene, flat, lean, colour):
    """Paint obstacles and tubes over the floor, where rays meet them first."""
    look, lamp = scene.look, lamp_of(scene.look)
    top = max(scene.height.max(), 1.0)
    around = ndimage.maximum_filter(
        scene.height, size=int(2 * top * np.abs(lean).max() / CELL_MM) | 1
    )
    alive = np.flatnonzero(around.reshape(-1)[scene.cells(flat)] > 0)
    block = scene.block.reshape(-1)
    film = linear(look.film)
    before = np.full(len(flat), -1)
    for z in np.arange(top, 0.0, -0.35):
        at = flat[alive] + lean[alive] * z
        cell = scene.cells(at)
        hit = np.zeros(len(alive), bool)
        solid = block[cell] & (z <= look.height_mm)
        is_top = solid & (before[alive] == -1) & (z > look.height_mm - 0.5)
        bright = np.where(is_top, 0.95, 0.5)
        colour[alive[solid]] = bright[solid, None] * linear(look.block)
        hit |= solid
        for radius, away, to in scene.tubes:
            d = away.reshape(-1)[cell]
            on = ~hit & (d**2 + (z - radius) ** 2 <= radius**2)
            if on.any():
                normal = (
                    np.column_stack([to.reshape(-1, 2)[cell[on]], np.full(on.sum(), z - radius)])
                    / radius
                )
                face = np.clip(normal @ lamp, 0, 1)
                shine = look.gloss * np.clip(normal @ halfway(lamp), 0, 1) ** 40
                colour[alive[on]] = (0.45 + 0.6 * face)[:, None] * film + shine[:, None]
            hit |= on
        alive = alive[~hit]
