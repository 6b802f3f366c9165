"""The assembled rig against the map that it stands for."""

from dataclasses import dataclass

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.model.checked import Floats
from vinefab.model.map import Map
from vinefab.rig.clean import pieces_of
from vinefab.rig.part import Rig, RigPart
from vinefab.rig.solid import manifold_of, outlines_at

_HEIGHTS = (0.02, 0.5, 0.98)
_LEAST_WALL_SHARE = 0.01


@dataclass(frozen=True, slots=True, kw_only=True)
class Comparison:
    """How far the walls of an assembled rig differ from the map's obstacles.

    Parameters
    ----------
    wall_mm2
        Area of the map's obstacles within the bounds, in map units.
    excess_mm2, missing_mm2
        Area of rig where the map is free, and of map where the rig is, within the bounds; the
        largest over three heights.
    floor_missing_mm2
        Area within the bounds without plate below: gaps of joints, holes of entries.
    share
        Excess and missing together, over ``wall_mm2`` (but at least over 1 % of the bounds' area,
        so that an almost empty map is not judged by the rounding of its border).
    """

    wall_mm2: float
    excess_mm2: float
    missing_mm2: float
    floor_missing_mm2: float
    share: float


def compare_with_map(rig: Rig, world: Map) -> Comparison:
    """Move all parts to their places, cut them at three heights and compare with the map.

    Works on the parts' triangles and transforms only, not on the plan that they were made from.
    Since every wall is upright, areas in plan are volumes.

    Raises
    ------
    BadInputError
        If a part's triangles do not bound a solid.
    """
    options = rig.options
    inside = shapely.Polygon(world.bounds.exterior)
    walls = _areas(shapely.difference(inside, world.free_space))
    excess_mm2 = missing_mm2 = 0.0
    for share in _HEIGHTS:
        cut = _areas(_cut(rig, options.plate_mm + share * options.height_mm).intersection(inside))
        excess_mm2 = max(excess_mm2, cut.difference(walls).area)
        missing_mm2 = max(missing_mm2, walls.difference(cut).area)
    floor = _cut(rig, 0.5 * options.plate_mm)
    return Comparison(
        wall_mm2=walls.area,
        excess_mm2=excess_mm2,
        missing_mm2=missing_mm2,
        floor_missing_mm2=inside.difference(floor).area,
        share=(excess_mm2 + missing_mm2) / max(walls.area, _LEAST_WALL_SHARE * inside.area),
    )


def _areas(geometry: BaseGeometry) -> BaseGeometry:
    """Drop the lines and points of an overlay; further overlays cannot take the mixture."""
    return shapely.union_all(pieces_of(geometry))


def _cut(rig: Rig, z_mm: float) -> BaseGeometry:
    return shapely.union_all([_part_cut(part, z_mm) for part in rig.parts])


def _part_cut(part: RigPart, z_mm: float) -> BaseGeometry:
    body = manifold_of(part.vertices_mm, part.faces)
    if body.is_empty():
        raise BadInputError(f"part {part.name}", body.status().name, "triangles that bound a solid")

    def moved(points: Floats) -> Floats:
        flat = points @ part.to_map[:2, :2].T + part.to_map[:2, 3]
        return np.asarray(flat, dtype=np.float64)

    return shapely.transform(outlines_at(body, z_mm), moved)
