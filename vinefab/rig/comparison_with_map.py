"""The assembled rig against the map that it stands for."""

from dataclasses import dataclass

import numpy as np
import shapely
from manifold3d import Manifold
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.model.map import Map
from vinefab.rig.part import Rig, RigPart
from vinefab.rig.rig_plan import polygon_parts
from vinefab.rig.solid import manifold_of, outlines_at

_HEIGHTS = (0.5, 0.02, 0.98)
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
    options, rim = rig.options, _RIM_MM / rig.options.scale
    bodies = [_body(part) for part in rig.parts]
    inside = shapely.Polygon(world.bounds.exterior)
    thickened = _areas(rig.thickened)
    # Where a robot can be, less a rim for rounding.
    free = shapely.difference(world.free_space, _widened(thickened, rim))
    free = shapely.buffer(free, -rim, join_style="mitre")
    shapely.prepare(free)
    cuts = [_cut(rig, bodies, share * options.height_mm / options.scale) for share in _HEIGHTS]
    outsides = [[_filled(shape, free) for shape in cut] for cut in cuts]
    built, outside = (shapely.union_all(shapes) for shapes in (cuts[0], outsides[0]))
    areas = [np.array([shape.area for shape in shapes]) for shapes in outsides]
    leaning_mm2 = float(sum(np.abs(area - areas[0]).sum() for area in areas[1:]))
    floor_missing_mm2 = 0.0
    if rig.style == "plate":
        floor = shapely.union_all(_cut(rig, bodies, -0.25 * options.plate_mm / options.scale))
        floor_missing_mm2 = inside.difference(floor).area

    walls = _areas(shapely.difference(inside, world.free_space))
    seen = _areas(shapely.intersection(_areas(outside), inside))
    thickened = _areas(shapely.difference(thickened, walls))
    excess = _areas(shapely.difference(seen, walls))
    excess_mm2 = shapely.difference(excess, _widened(thickened, rim)).area
    missing_mm2 = shapely.difference(walls, seen).area
    counted_mm2 = max(walls.area, _LEAST_WALL_SHARE * inside.area)
    return RigComparison(
        wall_mm2=walls.area,
        excess_mm2=excess_mm2,
        missing_mm2=missing_mm2,
        thickened_mm2=thickened.intersection(inside).area,
        leaning_mm2=leaning_mm2,
        floor_missing_mm2=floor_missing_mm2,
        hollow_mm2=outside.intersection(inside).area - built.intersection(inside).area,
        share=(excess_mm2 + missing_mm2) / counted_mm2 + leaning_mm2 / counted_mm2,
    )


def footprints(rig: Rig) -> dict[int, BaseGeometry]:
    """Return every tile's outline where it lies, by number, in map coordinates."""
    below_mm = -0.25 * rig.options.plate_mm / rig.options.scale
    shapes = _cut(rig, [_body(part) for part in rig.parts], below_mm)
    return {part.number: shape for part, shape in zip(rig.parts, shapes, strict=True)}


def _widened(geometry: BaseGeometry, rim: float) -> BaseGeometry:
    """Grow by less than anything that matters, so that rounding leaves no rims around it."""
    return shapely.buffer(geometry, rim, join_style="mitre")


def _areas(geometry: BaseGeometry) -> BaseGeometry:
    """Drop the lines and points of an overlay; further overlays cannot take the mixture."""
    # What an overlay returns does not overlap: no need to join it once more.
    return shapely.MultiPolygon(list(polygon_parts(geometry)))


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
    found = []
    for part, body in zip(rig.parts, bodies, strict=True):
        turn, shift = part.to_map[:2, :2].T, part.to_map[:2, 3]
        flat = outlines_at(body, float((z_mm - part.to_map[2, 3]) / part.to_map[2, 2]))
        points = shapely.get_coordinates(flat) @ turn + shift
        found.append(shapely.set_coordinates(flat, points))
    return found


def _body(part: RigPart) -> Manifold:
    body = manifold_of(part.vertices_mm, part.faces)
    if body.is_empty():
        raise BadInputError(f"part {part.name}", body.status().name, "triangles that bound a solid")
    return body
