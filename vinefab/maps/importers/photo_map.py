"""Photos and scans of arenas: scale, perspective, tones, and the map that they show."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np
import scipy  # its parts load at their first use
from numpy.typing import NDArray
from PIL import Image, ImageDraw

from vinefab.core.errors import BadInputError, UnfitInputError, located
from vinefab.core.plain_text import visible
from vinefab.core.rng import child
from vinefab.core.validation import Floats
from vinefab.maps.cleanup.raster import GridPlacement, Mask, raster_map
from vinefab.maps.importers.import_options import ImportOptions, PhotoOptions
from vinefab.maps.importers.source_unit import SourceUnit
from vinefab.model.map import MARKER_SIDE_CELLS, Map
from vinefab.photos.found_markers import FoundMarker, measured_markers, square_points
from vinefab.photos.photo import (
    CAMERA_GAMMA,
    AreaMm,
    ControlPoints,
    Photo,
    PhotoCamera,
    PlanView,
    fit_camera,
    inverse,
    most_pixels_per_mm,
    plane_homography,
    projected,
    read_photo,
    rectified,
    shown_in,
)

_ONLY_OTHERS = (
    "join_mm",
    "layers",
    "drawn",
    "bounds",
    "margin_mm",
    "wall_mm",
    "open_lines",
    "unknown",
)


_SMOOTHING_PX = 0.7
"""Evens out noise; less than a width that cuts the corners of cells."""

_POINT_NOISE_PX = 1.0
"""How far points that a person picks may be off (assumed)."""

_HEIGHTS = 5

_TILE, _NEAR_CELLS = 128, 8
"""Side of the parts of a plan that are looked at alone, in cells, and the surroundings
that set the tones of a cell: more than the reach of the two filters together."""


Pixels = NDArray[np.uint8]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PhotoMap:
    """A map and the photo that it was read from."""

    world: Map
    view: PlanView  # the photo, rectified to the height of the obstacles
    height_mm: float  # of the obstacles
    markers_mm: Floats  # corners of the markers where the view shows them, shape (n, 4, 2)


def import_photo(path: Path, options: ImportOptions) -> Map:
    """Return the map in a photo or scan.

    The bounds are the outer boundary of the largest free region, or of the one with the start; the
    islands in it are obstacles: see `raster_map`.
    """
    return read_photo_map(path, options).world


def read_photo_map(path: Path, options: ImportOptions) -> PhotoMap:
    """Return the map in a photo or scan, and the photo as a plan."""
    options.refuse(_ONLY_OTHERS, "a photo", path)
    chosen = options.photo or PhotoOptions()
    photo = read_photo(path)
    with located(path):
        chosen.ensure_one_scale(options.scale_mm_per_unit)
        scene = _Scene.of(photo, chosen, options.scale_mm_per_unit)
        heights = np.linspace(0.0, chosen.height_mm, _HEIGHTS if chosen.height_mm else 1).tolist()
        views = [scene.view(height) for height in heights]
        shown = [scene.shown(view, height) for view, height in zip(views, heights, strict=True)]
        tones = _Tones.of(views[0], chosen, shown[0], scene.mixing)
        # What stands upright is seen at its place at every height; its sides are seen next to it
        # on the floor or at the top. (In between: where one's side and another's top would meet.)
        solid = tones.solid(views[0].pixels)
        for view in views[1:]:
            solid = tones.still_solid(view.pixels, solid)
        quiet = Image.new("L", solid.shape[::-1], 0)
        for corners in scene.quiet_squares():
            places = (views[0].to_pixels(corners) - 0.5).ravel().tolist()
            ImageDraw.Draw(quiet).polygon(places, fill=255)
        free = np.logical_and.reduce(shown) & (~solid | (np.asarray(quiet) > 0))
        world = _world(path, scene, views[0], free, options, tones)
    return PhotoMap(
        world=world,
        view=views[-1],
        height_mm=chosen.height_mm,
        markers_mm=scene.markers_at(chosen.height_mm),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Scene:
    """A photo whose camera is known, and the part of it that becomes the map."""

    photo: Photo
    camera: PhotoCamera
    area_mm: AreaMm
    mm_per_cell: float
    mm_per_pixel: float  # of the photo, where it is finest; no less than a cell
    markers_mm: Floats
    mixing: float  # exponent by which mixed light is stored: where an edge's middle is
    within_mm: float  # how far walls may be off, but for straightening them
    facts: dict[str, object]

    @classmethod
    def of(cls, photo: Photo, chosen: PhotoOptions, mm_per_pixel: float | None) -> "_Scene":
        seen = measured_markers(photo) if chosen.marker_mm is not None else {}
        if chosen.marker_mm is not None:
            _ensure_trusted(seen, chosen)
        found = {number: one.corners_px for number, one in seen.items()}
        noise_px = max((one.noise_px for one in seen.values()), default=_POINT_NOISE_PX)
        blur_px = max((one.blur_px for one in seen.values()), default=0.0)
        control = _control(photo, chosen, found, mm_per_pixel)
        camera = fit_camera(photo, control)
        if chosen.height_mm > 0.0 and camera.focal_px is None:
            raise UnfitInputError(
                "height_mm",
                "needs a photo that tells its focal length (35 mm), in its EXIF data or by an "
                "oblique view, and four points or markers",
                "give them (--points)",
            )
        area = _area_mm(photo, camera, control, chosen)
        left, low, right, top = area
        # Larger maps, in sides of a marker, are not told by it: 3 m by markers of 30 mm.
        most_sides = 100.0
        if chosen.marker_mm is not None and chosen.distance_mm is None:
            size, most = max(right - left, top - low), most_sides * chosen.marker_mm
            if size > most:
                problem = (
                    f"it is {size:.0f} mm wide, and markers of {chosen.marker_mm:g} mm measure "
                    f"{most:g} mm at most"
                )
                remedy = "lay larger ones, or give --crop or their distance (--distance-mm)"
                raise UnfitInputError("map", problem, remedy)
        # Edges in a photo are known better than to a pixel; a scan keeps its own pixels.
        share = 1.0 if len(control.points_px) == 2 else 0.5
        pixel = 1.0 / most_pixels_per_mm(camera.homography, area)
        # Cells of a plan: 0.25 mm in 600 x 600 mm. A finer photo gives better walls than it says.
        most_cells = 6e6
        coarsest = float(np.sqrt((right - left) * (top - low) / most_cells))
        step = float(f"{max(share * pixel, coarsest):.4g}")
        pixel = max(step, float(f"{pixel:.4g}"))
        facts: dict[str, object] = {
            "markers": sorted(found),
            "points_off_mm": round(camera.residual_mm, 4),
            "mm_per_cell": step,
            **_parallax(camera, area, chosen),
        }
        placed_mm = 0.0
        if mm_per_pixel is None:
            placed_mm = _placing_mm(photo, chosen, found, noise_px, area)
            facts["if_points_within_px"] = f"{noise_px:.2g} (assumed, standard deviation)"
        if seen:
            facts["blur_px"] = round(blur_px, 2)
            facts["scale_by"] = (
                f"{len(seen)} markers' sides"
                if chosen.distance_mm is None
                else "the distance of two markers"
            )
        # Blur of standard deviation one rounds a square corner by about so much (computed).
        corner_blur = 0.8
        within_mm = placed_mm + corner_blur * blur_px * pixel
        mixing = float(np.median([one.mixing for one in seen.values()])) if seen else 0.0
        squares = control.points_mm.reshape(-1, 4, 2) if found else np.empty((0, 4, 2))
        return cls(
            photo,
            camera,
            area,
            step,
            pixel,
            squares,
            mixing or 1.0 / CAMERA_GAMMA,
            within_mm,
            facts,
        )

    def view(self, height_mm: float) -> PlanView:
        """Return the plan at a height."""
        return rectified(
            self.photo,
            self.camera,
            self.area_mm,
            plane_mm=height_mm,
            mm_per_pixel=self.mm_per_cell,
        )

    def shown(self, view: PlanView, height_mm: float) -> Mask:
        """Return the mask of the cells of a plan that the photo shows."""
        return shown_in(self.photo, self.camera, view, height_mm)

    def markers_at(self, height_mm: float) -> Floats:
        """Return where a plan at a height shows the markers."""
        corners = self.camera.to_photo(self.markers_mm.reshape(-1, 2))
        return self.camera.to_map(corners, height_mm).reshape(-1, 4, 2)

    def quiet_squares(self) -> list[Floats]:
        """Return the markers with the white around them."""
        middles = self.markers_mm.mean(axis=1, keepdims=True)
        return list(middles + (1.0 + 2.0 / MARKER_SIDE_CELLS) * (self.markers_mm - middles))


def _control(
    photo: Photo, chosen: PhotoOptions, found: dict[int, Floats], mm_per_pixel: float | None
) -> ControlPoints:
    """Return the points that give a photo its scale."""
    if chosen.marker_mm is not None:
        control = square_points(found, chosen.marker_mm)
        if chosen.distance_mm is None:
            return control
        middles = control.points_mm.reshape(-1, 4, 2).mean(axis=1)
        apart = float(np.hypot(*(middles[1] - middles[0])))
        return replace(control, points_mm=control.points_mm * (chosen.distance_mm / apart))
    points = np.array(chosen.points_px, dtype=np.float64)
    if chosen.rectangle_mm is not None:
        width, height = chosen.rectangle_mm
        corners = np.array([(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)])
        sides = np.roll(points, -1, axis=0) - points
        ahead = np.roll(sides, -1, axis=0)
        turns = sides[:, 0] * ahead[:, 1] - sides[:, 1] * ahead[:, 0]
        if not (turns < 0.0).all():  # rows run down
            given = "; ".join(f"{x:g},{y:g}" for x, y in points)
            problem = f"{given} do not run counter-clockwise from the lower left corner"
            raise UnfitInputError("points", problem, "give them in that order")
        return ControlPoints(points_px=points, points_mm=corners, noise_px=_POINT_NOISE_PX)
    if mm_per_pixel is None:
        apart = float(np.hypot(*(points[1] - points[0])))
        if apart < 2.0 or chosen.distance_mm is None:
            raise UnfitInputError(
                "points", "they lie less than 2 pixels apart", "give two farther apart"
            )
        scale = chosen.distance_mm / apart
    else:
        points = np.array([(0.0, 0.0), (photo.width_px, photo.height_px)])
        scale = mm_per_pixel
    upwards = np.array([0.0, photo.height_px]) + points * (1.0, -1.0)
    return ControlPoints(points_px=points, points_mm=scale * upwards, noise_px=_POINT_NOISE_PX)


def _area_mm(
    photo: Photo, camera: PhotoCamera, control: ControlPoints, chosen: PhotoOptions
) -> AreaMm:
    """Return the area of the map: the crop, the rectangle, the area inside markers, or all."""
    if chosen.crop_mm is not None:
        left, low, right, top = chosen.crop_mm
        if right <= left or top <= low:
            raise BadInputError("crop", chosen.crop_mm, "LEFT,LOW,RIGHT,TOP in mm of the map")
        return chosen.crop_mm
    if chosen.rectangle_mm is not None:
        return (0.0, 0.0, *chosen.rectangle_mm)
    if len(control.points_mm) >= 12:
        return (*control.points_mm.min(axis=0).tolist(), *control.points_mm.max(axis=0).tolist())
    width, height = photo.width_px, photo.height_px
    corners = np.array([(0.0, 0.0), (width, 0.0), (width, height), (0.0, height)])
    back = inverse(camera.homography)
    depth = np.column_stack([np.vstack([corners, control.points_px[:1]]), np.ones(5)]) @ back[2]
    if (depth * depth[-1] <= 0.0).any():
        remedy = "give --crop LEFT,LOW,RIGHT,TOP in mm of the map"
        raise UnfitInputError("", "the photo shows the horizon", remedy)
    seen = projected(back, corners)
    return (*seen.min(axis=0).tolist(), *seen.max(axis=0).tolist())


def _ensure_trusted(seen: Mapping[int, FoundMarker], chosen: PhotoOptions) -> None:
    """Refuse markers that are too few, too blurred or too unlike a marker to give a scale."""
    key, kind = "markers in the photo", "ArUco markers (DICT_4X4_50)"
    if not seen:
        remedy = f"show one or more {kind}, whole and sharp, white around them"
        raise UnfitInputError(key, "there are none", remedy)
    wanted = chosen.marker_count or (1 if chosen.distance_mm is None else 2)
    if len(seen) < wanted:
        numbers = ", ".join(map(str, sorted(seen)))
        problem = f"there {'is' if len(seen) == 1 else 'are'} {len(seen)} (number {numbers})"
        remedy = f"show {wanted} {kind}, whole and sharp, white around them"
        raise UnfitInputError(key, problem, remedy)
    # What the fit of a marker may leave, as a share of its contrast: glare, folds and shadows make
    # more.
    most_misfit = 0.12
    # A marker whose cells are spread by more than this share of their width has no clear size.
    most_blur_cells = 0.4
    for name, one in sorted(seen.items()):
        cell_px = one.side_px / MARKER_SIDE_CELLS
        if one.blur_px > most_blur_cells * cell_px:
            problem = (
                f"its edges are spread by {one.blur_px:.1f} px (measured), and a cell of "
                f"{cell_px:.1f} px allows {most_blur_cells * cell_px:.1f}"
            )
            raise UnfitInputError(f"marker {name}", problem, "take a sharper or nearer photo")
        if one.misfit > most_misfit:
            problem = (
                f"{100.0 * one.misfit:.0f} % of it are unlike its picture (measured), and "
                f"{100.0 * most_misfit:.0f} % are allowed"
            )
            remedy = "lay it flat and evenly lit, without glare"
            raise UnfitInputError(f"marker {name}", problem, remedy)


def _placing_mm(
    photo: Photo,
    chosen: PhotoOptions,
    found: dict[int, Floats],
    noise_px: float,
    area_mm: AreaMm,
) -> float:
    """Return the error of places due to that of the points: simulated, 95 %."""
    control = _control(photo, chosen, found, None)
    left, low, right, top = area_mm
    places = np.array([(left, low), (right, low), (right, top), (left, top)])
    places_px = projected(plane_homography(control), places)
    points = np.array(chosen.points_px, dtype=np.float64).reshape(-1, 2)
    rng, worst = child(0), []
    trials = 40
    for _ in range(trials):
        moved = {key: value + rng.normal(0.0, noise_px, (4, 2)) for key, value in found.items()}
        picked = points + rng.normal(0.0, noise_px, points.shape)
        trial = replace(chosen, points_px=tuple(map(tuple, picked.tolist())))
        fitted = plane_homography(_control(photo, trial, moved, None))
        again = projected(inverse(fitted), places_px)
        # Off after the best turn and shift: those do not matter.
        one, two = again - again.mean(axis=0), places - places.mean(axis=0)
        turn = np.vdot(one @ (1.0, 1.0j), two @ (1.0, 1.0j))
        turned = (one @ (1.0, 1.0j)) * turn / abs(turn)
        off = np.column_stack([turned.real, turned.imag]) - two
        worst.append(float(np.hypot(*off.T).max()))
    # Walls that may be off by more than this share of the map's size have no scale.
    most_off_share = 0.08
    within_mm, most = (
        float(np.quantile(worst, 0.95)),
        most_off_share * max(right - left, top - low),
    )
    if found and within_mm > most:
        most_percent = 100.0 * most_off_share
        problem = f"walls may be {within_mm:.0f} mm off, more than {most_percent:g} % of the map"
        remedy = (
            "lay more or larger markers around it, take a sharper or nearer photo, or give --crop "
            "or the distance of two markers (--distance-mm)"
        )
        raise UnfitInputError("scale of the photo", problem, remedy)
    return within_mm


def _parallax(camera: PhotoCamera, area_mm: AreaMm, chosen: PhotoOptions) -> dict[str, object]:
    """Return the shift from its place at which a higher, or lower, point is seen."""
    left, low, right, top = area_mm
    places = np.array([(left, low), (right, low), (right, top), (left, top)])
    if camera.focal_px is None:
        words = f"up to {camera.parallax_mm_per_mm:.2f} (assumed: a lens of at least 13 mm); "
        words += "a scan has none"
        return {"parallax_mm_per_mm_of_height": words}
    slope = camera.to_map(camera.to_photo(places, 1.0), 0.0) - places
    words = f"up to {float(np.hypot(*slope.T).max()):.2f} (computed)"
    taken = "taken out" if chosen.height_mm else "not taken out; --height-mm does"
    return {
        "focal_px": round(camera.focal_px, 1),
        "parallax_mm_per_mm_of_height": f"{words}, {taken}",
    }


@dataclass(frozen=True, slots=True)
class _Tones:
    """What tells obstacles from the floor."""

    chosen: PhotoOptions
    threshold: float | None  # brightness; None where a colour tells
    contrast: float = (
        np.inf
    )  # between floor and obstacles; infinite where a person set the threshold
    mixing: float = 1.0 / CAMERA_GAMMA  # exponent by which mixed light is stored

    @classmethod
    def of(cls, view: PlanView, chosen: PhotoOptions, shown: Mask, mixing: float) -> "_Tones":
        if chosen.colour is not None:
            return cls(chosen, None)
        if chosen.threshold is not None:
            return cls(chosen, chosen.threshold)
        low, high = _two_tones(_brightness(view.pixels)[shown])
        return cls(chosen, (low + high) / 2.0, high - low, mixing)

    def still_solid(self, pixels: Pixels, before: Mask) -> Mask:
        """Return the mask of one plan's obstacle cells that are so in another: no others count."""
        after = np.zeros_like(before)
        rows, columns = before.shape
        for row, column in product(range(0, rows, _TILE), range(0, columns, _TILE)):
            tile = np.s_[row : row + _TILE, column : column + _TILE]
            if not before[tile].any():
                continue
            top, left = max(0, row - _NEAR_CELLS), max(0, column - _NEAR_CELLS)
            around = pixels[top : row + _TILE + _NEAR_CELLS, left : column + _TILE + _NEAR_CELLS]
            found = self.solid(around)[row - top :, column - left :][:_TILE, :_TILE]
            after[tile] = found & before[tile]
        return after

    def solid(self, pixels: Pixels) -> Mask:
        """Return the mask of the obstacle cells in a plan, or in a part of it."""
        if self.threshold is None:
            *colour, tolerance = self.chosen.colour or ()
            smooth = scipy.ndimage.gaussian_filter(
                pixels.astype(np.float32), (_SMOOTHING_PX, _SMOOTHING_PX, 0)
            )
            off = smooth - np.array(colour, dtype=np.float32)
            return np.asarray(np.linalg.norm(off, axis=2) <= tolerance)
        bright = _brightness(pixels)
        edge_cells = 9
        # Half the light at an edge where one is near, else the threshold: in a shadow, and where
        # the light is weaker, an edge lies at another brightness.
        high = scipy.ndimage.maximum_filter(bright, edge_cells)
        low = scipy.ndimage.minimum_filter(bright, edge_cells)
        # A step of less than half of the contrast is a shadow's edge, not an obstacle's.
        edge_share = 0.5
        edge = high - low > edge_share * self.contrast
        light = (high ** (1.0 / self.mixing) + low ** (1.0 / self.mixing)) / 2.0
        between = np.where(edge, light**self.mixing, np.float32(self.threshold or 0.0))
        return np.asarray(bright < between if self.chosen.obstacles == "dark" else bright > between)


def _brightness(pixels: Pixels) -> NDArray[np.float32]:
    grey = np.asarray(Image.fromarray(pixels).convert("L"), dtype=np.float32)
    return np.asarray(scipy.ndimage.gaussian_filter(grey, _SMOOTHING_PX))


def _two_tones(bright: NDArray[np.float32]) -> tuple[float, float]:
    """Return the means of the dark and of the light cells, told apart by Otsu's method."""
    counts = np.bincount(bright.astype(np.uint8), minlength=256).astype(np.float64)
    below, total = np.cumsum(counts), counts.sum()
    sums = np.cumsum(counts * np.arange(256.0))
    with np.errstate(invalid="ignore", divide="ignore"):
        low, high = sums / below, (sums[-1] - sums) / (total - below)
        between = np.nan_to_num(below * (total - below) * (high - low) ** 2)
    best = int(between.argmax())
    least_contrast = 20.0
    if not high[best] - low[best] >= least_contrast:
        problem = "no two tones are seen in the photo"
        raise UnfitInputError("", problem, "give --threshold 0 to 255, or --obstacles R,G,B")
    return float(low[best]), float(high[best])


def _world(
    path: Path, scene: _Scene, view: PlanView, free: Mask, options: ImportOptions, tones: _Tones
) -> Map:
    """Return the map of the free space in a plan."""
    rows, columns = free.shape
    least_mm2 = options.least_obstacle_mm2
    # Default of the smallest obstacle that is kept, by the plan's area: 4 x 4 mm in 600 x 500 mm.
    least_obstacle_share = 5e-5
    if least_mm2 is None:
        least_mm2 = float(f"{least_obstacle_share * free.size * view.mm_per_pixel**2:.2g}")
    facts: dict[str, object] = {
        "source": path.name,
        "pixels": [scene.photo.width_px, scene.photo.height_px],
        **scene.facts,
        "obstacles_are": tones.chosen.obstacles,
        "threshold": None if tones.threshold is None else round(tones.threshold, 1),
        "least_obstacle_mm2": least_mm2,
        "cells": [columns, rows],
    }
    placement = GridPlacement(
        cell_mm=view.mm_per_pixel,
        x_mm=view.left_mm,
        y_mm=view.top_mm - rows * view.mm_per_pixel,
    )
    simplify_mm = options.simplify_mm
    if simplify_mm is None:  # walls need no more corners than they are known by
        simplify_mm = float(f"{max(scene.mm_per_pixel, scene.within_mm):.3g}")
    if scene.within_mm:
        facts["shape_within_mm"] = round(math.hypot(scene.within_mm, simplify_mm), 3)
    chosen = replace(options, simplify_mm=simplify_mm, least_obstacle_mm2=least_mm2)
    world = raster_map(visible(path.stem), free[::-1], placement, chosen, facts)
    if not world.obstacles:
        remedy = (
            "give --obstacles dark, light or R,G,B, --threshold 0 to 255, or --least-obstacle-mm2 "
            f"below {least_mm2:g}"
        )
        raise UnfitInputError("", "no obstacles are seen in the photo", remedy)
    by = "--marker-mm" if scene.markers_mm.size else "--points"
    if options.scale_mm_per_unit is not None:
        by = "--scale-mm-per-unit"
    unit = SourceUnit(name="pixel of the plan", mm=view.mm_per_pixel, known="option", by=by)
    return unit.of(replace(world, environment="photo"))
