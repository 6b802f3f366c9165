"""The film of a robot on a rectified photo: found by colour, or outlined by hand.

Colours are compared by hue and saturation in OKLab, as a / L and b / L: both stay the same when
the light on a surface changes, so that shadows of the floor remain floor. Film of the floor's hue
is told by lightness, which shadows may imitate; that is said.
"""

from dataclasses import dataclass, field

import numpy as np
import scipy  # its parts load at their first use
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import UnfitInputError
from vinefab.core.validation import Floats
from vinefab.model.map import Map, Pose
from vinefab.photos.photo import PhotoCamera, PlanView

FilmColour = tuple[int, int, int]


LEAST_FILM_SHARE = 0.0005
"""Least share of the free space that film covers, or none was found."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sight:
    """From where and how a plan's photo sees things that are not flat."""

    plane_mm: float = 0.0  # height above the floor that the plan is true for
    camera: PhotoCamera | None = None  # None: things at other heights are not moved
    obstacle_mm: float = 0.0  # height of the obstacles, which hide things; 0 if unknown


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SeenFilm:
    """Where film is seen on a plan."""

    share: Floats  # how much of each pixel is film, 0 to 1, shape (rows, columns)
    view: PlanView  # the plan that it was found on
    sight: Sight  # how the photo sees things that are not flat
    # whether each pixel lies in an obstacle or outside the bounds, on the floor
    solid: NDArray[np.bool_]
    colour: FilmColour | None  # red, green and blue of the film
    how: str  # how it was found
    cautions: tuple[str, ...] = ()  # what makes it uncertain, a sentence each
    _hidden: dict[float, NDArray[np.bool_]] = field(default_factory=dict)  # by height

    def moved(self, points_mm: Floats, from_mm: float, to_mm: float) -> Floats:
        """Return where points at one height appear on a plane at another, shape (n, 2)."""
        if self.sight.camera is None or len(points_mm) == 0:
            return np.asarray(points_mm, dtype=np.float64)
        away = np.linalg.inv(self.sight.camera.at(to_mm)) @ self.sight.camera.at(from_mm)
        x, y = points_mm[:, 0], points_mm[:, 1]
        across, up, depth = (row[0] * x + row[1] * y + row[2] for row in away)
        return np.column_stack([across / depth, up / depth])

    def at(self, points_mm: Floats, z_mm: float) -> Floats:
        """Return the amount of film seen at points at a height above the floor, shape (n,)."""
        seen = self.view.to_pixels(self.moved(points_mm, z_mm, self.sight.plane_mm)) - 0.5
        places = [seen[:, 1], seen[:, 0]]
        return np.asarray(
            scipy.ndimage.map_coordinates(self.share, places, order=1, mode="nearest")
        )

    def is_solid(self, points_mm: Floats) -> NDArray[np.bool_]:
        """Return the mask of floor points in obstacles or outside the bounds, shape (n,)."""
        cells = np.floor(self.view.to_pixels(points_mm)).astype(np.int64)
        rows, columns = self.solid.shape
        row, column = cells[:, 1].clip(0, rows - 1), cells[:, 0].clip(0, columns - 1)
        return np.asarray(self.solid[row, column])

    def hidden(self, points_mm: Floats, z_mm: float) -> NDArray[np.bool_]:
        """Return the mask of points at a height that obstacles hide from the camera, (n,)."""
        if self.sight.camera is None or self.sight.obstacle_mm <= z_mm:
            return np.zeros(len(points_mm), dtype=np.bool_)
        hidden_cell_mm = 1.0
        times = max(1, round(hidden_cell_mm / self.view.mm_per_pixel))
        if z_mm not in self._hidden:  # cells of about 1 mm
            rows, columns = (size // times + 1 for size in self.solid.shape)
            x, y = np.meshgrid(np.arange(columns) + 0.5, np.arange(rows) + 0.5)
            points = self.view.to_map(times * np.column_stack([x.ravel(), y.ravel()]))
            top = self.moved(points, z_mm, self.sight.obstacle_mm)
            steps = int(np.hypot(*(top - points).T).max() / hidden_cell_mm) + 1
            hidden = np.zeros(len(points), dtype=np.bool_)
            for share in np.arange(1, steps + 1) / steps:  # sight lines are straight
                hidden |= self.is_solid(points + share * (top - points))
            self._hidden[z_mm] = hidden.reshape(rows, columns)
        raster = self._hidden[z_mm]
        cells = np.floor(self.view.to_pixels(points_mm) / times).astype(np.int64)
        row, column = cells[:, 1].clip(0, len(raster) - 1), cells[:, 0].clip(0, raster.shape[1] - 1)
        return np.asarray(raster[row, column])


def solid_raster(world: Map, view: PlanView) -> NDArray[np.bool_]:
    """Return the mask of the pixels of a plan outside the free space, shape (rows, columns)."""
    return ~_inside(world.free_space, view)


def found_film(
    view: PlanView,
    world: Map,
    pose: Pose,
    widths_mm: tuple[float, float],
    sight: Sight,
    *,
    colour: FilmColour | None = None,
) -> SeenFilm:
    """Return the film on a plan, by its colour or by its difference from the floor.

    Parameters
    ----------
    pose
        Where the trunk begins: what lies there, ahead of it, shows the film's colour.
    widths_mm
        Inflated diameters of the widest and the narrowest branch.
    colour
        The film's colour where it is known.

    Raises
    ------
    BadInputError
        If no film is found.
    """
    solid = solid_raster(world, view)
    light, hue = _light_and_hue(view.pixels)
    inner = scipy.ndimage.binary_erosion(~solid, iterations=max(1, round(2.0 / view.mm_per_pixel)))
    if not inner.any():
        problem = "none of the map's free space is on it"
        raise UnfitInputError("photo", problem, "take one of the rig, or check the map")
    floor = _mode(hue[inner])
    core = scipy.ndimage.binary_erosion(solid, iterations=max(1, round(6.0 / view.mm_per_pixel)))
    block = np.median(hue[core], axis=0) if core.any() else None
    film, how = _film_hue(hue, floor, inner, block, _strip(view, pose, widths_mm[0]), colour)
    cautions: tuple[str, ...] = ()
    # Film of the floor's hue is lighter or darker than the floor by at least this share.
    least_light_share = 0.12
    if film is not None:
        # The place of each pixel between the floor's hue and the film's.
        way = film - floor
        share = np.clip(((hue - floor) @ way) / float(way @ way), 0.0, 1.0)
        if block is not None:
            to_block = np.hypot(*np.moveaxis(hue - block, -1, 0))
            to_mixed = np.hypot(*np.moveaxis(hue - floor - share[..., None] * way, -1, 0))
            share = np.where(to_block < to_mixed, 0.0, share)
    else:
        # By lightness against the floor around it, lighter or darker as at the base.
        strip, how = _strip(view, pose, widths_mm[0]), "by lightness at the base"
        ratio = light / float(np.median(light[inner])) - 1.0
        at_base = float(np.median(ratio[strip])) if strip.any() else 0.0
        if abs(at_base) < least_light_share:
            problem = "nothing at the base differs from the floor"
            remedy = (
                "take a photo with a robot on it, or give its film's colour (--film-colour R,G,B)"
            )
            raise UnfitInputError("photo", problem, remedy)
        share = np.clip(ratio / at_base, 0.0, 1.0)
        cautions = ("film and floor have the same hue: shadows may have been taken for film",)
    share = scipy.ndimage.gaussian_filter(np.asarray(share, dtype=np.float64), 0.5)
    inside = scipy.ndimage.binary_erosion(solid, iterations=max(1, round(1.0 / view.mm_per_pixel)))
    share[inside] = 0.0
    share = _without_gloss(share, view.mm_per_pixel)
    is_film = share > 0.5
    if is_film[~solid].mean() < LEAST_FILM_SHARE:
        problem = "no film is found between the obstacles"
        remedy = "take a photo with a robot on it, or give its film's colour (--film-colour R,G,B)"
        raise UnfitInputError("photo", problem, remedy)
    seen = np.median(view.pixels[is_film], axis=0).astype(int).tolist()
    return SeenFilm(
        share=share,
        view=view,
        sight=sight,
        solid=solid,
        colour=(seen[0], seen[1], seen[2]),
        how=how,
        cautions=cautions,
    )


def outlined_film(
    view: PlanView,
    world: Map,
    outline: BaseGeometry,
    sight: Sight,
) -> SeenFilm:
    """Return the film on a plan as somebody has outlined it, in map millimetres."""
    inside = _inside(outline, view)
    if not inside.any():
        problem = "no area of it lies on the map"
        raise UnfitInputError("--outline", problem, "draw areas in the map's millimetres")
    return SeenFilm(
        share=scipy.ndimage.gaussian_filter(inside.astype(np.float64), 0.5),
        view=view,
        sight=sight,
        solid=solid_raster(world, view),
        colour=None,
        how="outlined by hand",
    )


# --- Colours --------------------------------------------------------------------------------------

_TO_CONES = np.array(
    [
        [0.4122214708, 0.5363325363, 0.0514459929],
        [0.2119034982, 0.6806995451, 0.1073969566],
        [0.0883024619, 0.2817188376, 0.6299787005],
    ]
)
_TO_LAB = np.array(
    [
        [0.2104542553, 0.7936177850, -0.0040720468],
        [1.9779984951, -2.4285922050, 0.4505937099],
        [0.0259040371, 0.7827717662, -0.8086757660],
    ]
)
"""OKLab (Ottosson 2020): linear sRGB to cones, cube roots of cones to L, a, b."""


def _light_and_hue(pixels: NDArray[np.uint8]) -> tuple[Floats, Floats]:
    """Return L of OKLab, shape (rows, columns), and a / L and b / L, (rows, columns, 2)."""
    level = np.arange(256) / 255.0
    linear = np.where(level <= 0.04045, level / 12.92, ((level + 0.055) / 1.055) ** 2.4)
    light = linear[pixels].astype(np.float32)
    black = 0.004  # added to light: below it a camera's colours are noise
    light = scipy.ndimage.gaussian_filter(light, (0.7, 0.7, 0.0)) + np.float32(black)
    lab = np.cbrt(light @ _TO_CONES.T.astype(np.float32)) @ _TO_LAB.T.astype(np.float32)
    return lab[..., 0], lab[..., 1:] / lab[..., :1]


def _mode(hues: Floats, step: float = 0.012) -> Floats:
    """Return the most frequent hue among many, shape (n, 2)."""
    cells = np.round(hues / step).astype(np.int64)
    least = cells.min(axis=0)
    rows, columns = (cells.max(axis=0) - least + 1).tolist()
    counts = np.bincount((cells - least) @ (columns, 1), minlength=rows * columns)
    best = least + divmod(int(np.argmax(counts)), columns)
    near = np.abs(cells - best).max(axis=1) <= 1
    return np.asarray(np.median(hues[near], axis=0))


def _strip(view: PlanView, pose: Pose, width_mm: float) -> NDArray[np.bool_]:
    """Return the mask of the pixels that show the trunk just ahead of its base."""
    ahead = np.array([np.cos(pose.heading_rad), np.sin(pose.heading_rad)])
    base = np.array([pose.x_mm, pose.y_mm])
    line = shapely.LineString([base, base + 1.5 * width_mm * ahead])
    return _inside(line.buffer(0.3 * width_mm), view)


def _film_hue(
    hue: Floats,
    floor: Floats,
    inner: NDArray[np.bool_],
    block: Floats | None,
    strip: NDArray[np.bool_],
    colour: FilmColour | None,
) -> tuple[Floats | None, str]:
    """Return the film's hue and how it is known; None where film has the floor's hue."""
    # Film and floor differ in hue if they are so far apart (grain and JPEG make about 0.01).
    least_hue_step = 0.05
    if colour is not None:
        given = _light_and_hue(np.full((1, 1, 3), colour, dtype=np.uint8))[1][0, 0]
        if np.hypot(*(given - floor)) < least_hue_step:
            return None, "by lightness"
        near = inner & (np.hypot(*np.moveaxis(hue - given, -1, 0)) < np.hypot(*(given - floor)) / 2)
        return (np.median(hue[near], axis=0) if near.any() else given), "by the colour given"
    if strip.any():
        at_base = np.median(hue[strip], axis=0)
        if np.hypot(*(at_base - floor)) >= least_hue_step:
            return at_base, "by the colour at the base"
    other = inner & (np.hypot(*np.moveaxis(hue - floor, -1, 0)) >= least_hue_step)
    if block is not None and np.hypot(*(block - floor)) >= least_hue_step:
        off_floor = np.hypot(*np.moveaxis(hue - floor, -1, 0))
        other &= np.hypot(*np.moveaxis(hue - block, -1, 0)) > 0.5 * off_floor
    if other.mean() < LEAST_FILM_SHARE:
        return None, "by lightness"
    return _mode(hue[other]), "by its difference from floor and obstacles"


def _without_gloss(share: Floats, mm_per_pixel: float) -> Floats:
    """Return the share of film with small holes closed, where gloss hides its colour."""
    is_film = share > 0.5
    holes, count = scipy.ndimage.label(scipy.ndimage.binary_fill_holes(is_film) & ~is_film)
    if count == 0:
        return share
    areas = scipy.ndimage.sum_labels(np.ones_like(share), holes, np.arange(1, count + 1))
    highlight_mm2 = 60.0  # largest hole in film that is taken for gloss
    small = np.flatnonzero(areas * mm_per_pixel**2 <= highlight_mm2) + 1
    return np.where(np.isin(holes, small), 1.0, share)


def _inside(area: BaseGeometry, view: PlanView) -> NDArray[np.bool_]:
    """Return the mask of the pixels with middles in an area, shape (rows, columns)."""
    rows, columns = view.pixels.shape[:2]
    inside = np.zeros((rows, columns), dtype=np.bool_)
    if area.is_empty:
        return inside
    left, low, right, top = area.bounds
    ends = view.to_pixels(np.array([(left, top), (right, low)]))
    first, last = np.floor(ends[0]).astype(int), np.ceil(ends[1]).astype(int)
    c0, c1 = np.clip([first[0], last[0]], 0, columns)
    r0, r1 = np.clip([first[1], last[1]], 0, rows)
    x, y = np.meshgrid(np.arange(c0, c1) + 0.5, np.arange(r0, r1) + 0.5)
    if x.size:
        places = view.to_map(np.column_stack([x.ravel(), y.ravel()]))
        shapely.prepare(area)
        inside[r0:r1, c0:c1] = shapely.contains_xy(area, places).reshape(x.shape)
    return inside
