"""The assembled rig against the map that it stands for."""

from dataclasses import dataclass, replace

import numpy as np
import shapely
from manifold3d import Manifold
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats
from vinefab.model.map import Map
from vinefab.rig.part import Rig, RigPart
from vinefab.rig.rig_plan import polygon_parts
from vinefab.rig.solid import manifold_of, outlines_at

_HEIGHTS = (0.02, 0.98)
_LEAST_WALL_SHARE = 0.01
_RIM_MM = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class RigComparison:
    """How far the walls of an assembled rig differ from the map's obstacles."""

    wall_mm2: float  # area of the map's obstacles within the bounds, in map units
    # area of rig where the map is free, and of map where the rig is, within the bounds
    excess_mm2: float
    missing_mm2: float
    # area that was added on purpose where walls were too thin to print; it is not part of the
    # excess
    thickened_mm2: float
    # by how much the walls' area differs between mid-height and just below or above it
    leaning_mm2: float
    # area within the bounds without plate below: gaps of joints, holes of entries
    floor_missing_mm2: float
    # area within walls that is left empty: cavities, which no robot can touch. Excess and missing
    # are those of the walls' outside, cavities filled
    hollow_mm2: float
    # excess, missing and leaning together, over ``wall_mm2`` (but at least over 1 % of the bounds'
    # area, so that an almost empty map is not judged by the rounding of its border)
    share: float


def compare_with_map(rig: Rig, world: Map) -> RigComparison:
    """Move all parts to their places, cut them at half their height and compare with the map.

    What is compared is the outside that a robot can touch: a hole of a part in which the map has
    no free space is a cavity and counts as filled. Works on the parts' triangles and transforms
    only, not on the plan that they were made from. Walls are upright, which two more cuts confirm;
    so a share of areas is one of volumes.
    """
    options = rig.options
    bodies = [_body(part) for part in rig.parts]
    inside = shapely.Polygon(world.bounds.exterior)
    free = _free_space(rig, world)
    cuts = [
        _cut(rig, bodies, share * options.height_mm / options.scale) for share in (0.5, *_HEIGHTS)
    ]
    outsides = [[_filled(shape, free) for shape in cut] for cut in cuts]
    built, outside = (shapely.union_all(shapes) for shapes in (cuts[0], outsides[0]))
    middle = compare_walls(rig, world, outside)
    areas = [np.array([shape.area for shape in shapes]) for shapes in outsides]
    leaning_mm2 = float(sum(np.abs(area - areas[0]).sum() for area in areas[1:]))
    missing_mm2 = 0.0
    if rig.style == "plate":
        floor = shapely.union_all(_cut(rig, bodies, -0.25 * options.plate_mm / options.scale))
        missing_mm2 = inside.difference(floor).area
    return replace(
        middle,
        leaning_mm2=leaning_mm2,
        floor_missing_mm2=missing_mm2,
        hollow_mm2=outside.intersection(inside).area - built.intersection(inside).area,
        share=middle.share + leaning_mm2 / max(middle.wall_mm2, _LEAST_WALL_SHARE * inside.area),
    )


def compare_walls(rig: Rig, world: Map, built: BaseGeometry) -> RigComparison:
    """Compare the cross-section of walls that were built, in map coordinates, with the map."""
    inside = shapely.Polygon(world.bounds.exterior)
    walls = _areas(shapely.difference(inside, world.free_space))
    built = _areas(shapely.intersection(_areas(built), inside))
    thickened = _areas(shapely.difference(_areas(rig.thickened), walls))
    excess = _areas(shapely.difference(built, walls))
    excess_mm2 = shapely.difference(excess, _widened(thickened, _RIM_MM / rig.options.scale)).area
    missing_mm2 = shapely.difference(walls, built).area
    off_mm2 = excess_mm2 + missing_mm2
    return RigComparison(
        wall_mm2=walls.area,
        excess_mm2=excess_mm2,
        missing_mm2=missing_mm2,
        thickened_mm2=thickened.intersection(inside).area,
        leaning_mm2=0.0,
        floor_missing_mm2=0.0,
        hollow_mm2=0.0,
        share=off_mm2 / max(walls.area, _LEAST_WALL_SHARE * inside.area),
    )


def footprints(rig: Rig) -> dict[str, BaseGeometry]:
    """Return every tile's outline where it lies, by name, in map coordinates."""
    z_mm = -0.25 * rig.options.plate_mm / rig.options.scale
    return {
        part.name: _moved(part, outlines_at(_body(part), _height_in(part, z_mm)))
        for part in rig.parts
    }


def _widened(geometry: BaseGeometry, rim: float) -> BaseGeometry:
    """Grow by less than anything that matters, so that rounding leaves no rims around it."""
    return shapely.buffer(geometry, rim, join_style="mitre")


def _areas(geometry: BaseGeometry) -> BaseGeometry:
    """Drop the lines and points of an overlay; further overlays cannot take the mixture."""
    # What an overlay returns does not overlap: no need to join it once more.
    return shapely.MultiPolygon(list(polygon_parts(geometry)))


def _free_space(rig: Rig, world: Map) -> BaseGeometry:
    """Return where a robot can be, less a rim for rounding and what was thickened."""
    rim = _RIM_MM / rig.options.scale
    free = shapely.difference(world.free_space, _widened(_areas(rig.thickened), rim))
    free = shapely.buffer(free, -rim, join_style="mitre")
    shapely.prepare(free)
    return free


def _filled(shape: BaseGeometry, free: BaseGeometry) -> BaseGeometry:
    """Return a cross-section without its cavities: the holes that no free space reaches."""
    pieces = polygon_parts(shape, shapely.Polygon())
    for index in np.flatnonzero(shapely.get_num_interior_rings(pieces) > 0):
        rings = np.asarray(pieces[index].interiors, dtype=object)
        open_there = shapely.intersects(free, shapely.polygons(rings))
        pieces[index] = shapely.Polygon(pieces[index].exterior, list(rings[open_there]))
    return shapely.MultiPolygon(list(pieces))


def _cut(rig: Rig, bodies: list[Manifold], z_mm: float) -> list[BaseGeometry]:
    """Return each part's cross-section at a height of the map, where it stands."""
    return [
        _moved(part, outlines_at(body, _height_in(part, z_mm)))
        for part, body in zip(rig.parts, bodies, strict=True)
    ]


def _height_in(part: RigPart, z_mm: float) -> float:
    """Return a height above the floor, in map units, as a height of the part as printed."""
    return float((z_mm - part.to_map[2, 3]) / part.to_map[2, 2])


def _body(part: RigPart) -> Manifold:
    body = manifold_of(part.vertices_mm, part.faces)
    if body.is_empty():
        raise BadInputError(f"part {part.name}", body.status().name, "triangles that bound a solid")
    return body


def _moved(part: RigPart, flat: BaseGeometry) -> BaseGeometry:
    def move(points: Floats) -> Floats:
        return np.asarray(points @ part.to_map[:2, :2].T + part.to_map[:2, 3], dtype=np.float64)

    return shapely.transform(flat, move)
