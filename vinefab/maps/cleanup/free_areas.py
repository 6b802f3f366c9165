"""Drawings whose areas are the free space: united, and the holes of the union are obstacles."""

import math
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.maps.cleanup.drawn_shapes import Changes, polygons_of
from vinefab.maps.cleanup.nesting import Enclosed, SolidRegion, different_parts, solids
from vinefab.model.map import Pose

_MOST_NAMED = 20
_MOST_HOLES_SHARE = 0.2
"""Of what its outline encloses: a union with more holes may as well be walls around rooms."""
_MOST_SINGLE_SHARE = 0.5
"""Of the union: an area that is more of it may as well be bounds, with obstacles half outside."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FreeAreas:
    """The union of drawn areas."""

    parts: list[Polygon]  # separate ones, the largest first
    united: int  # number of areas that it was made of

    @property
    def connected_share(self) -> float:
        """Area of the largest part over that of all."""
        return float(self.parts[0].area / math.fsum(part.area for part in self.parts))


def free_areas(parts: list[SolidRegion], join_mm: float, changes: Changes) -> FreeAreas:
    """Return the union of drawn areas, without what the drawing calls obstacles.

    Filled areas are free wherever they lie, outlines by the even-odd rule among themselves; but
    an outline in the inside of one filled area is an obstacle. Gaps up to ``join_mm`` between two
    areas are closed.
    """
    named = [part for part in parts if part.role == "bounds"]
    if named:
        raise BadInputError(
            "drawn", "free", f"obstacles, as the source calls {named[0].where} bounds"
        )
    fills = [part.polygon for part in parts if part.filled and part.role is None]
    rocks = [part.polygon for part in parts if part.role == "obstacle"]
    outlines = _nested(parts, changes)
    tree = shapely.STRtree(outlines)
    in_fill = set(tree.query(fills, predicate="contains_properly")[1].tolist()) if fills else set()
    # Outlines that lie inside of a filled area, and the others.
    inner = [item for index, item in enumerate(outlines) if index in in_fill]
    outer = [item for index, item in enumerate(outlines) if index not in in_fill]
    changes.add("outlines_in_areas_made_obstacles", len(inner))
    areas = np.array([*fills, *outer], dtype=np.object_)
    if len(areas) == 0:
        raise BadInputError("drawing", "no areas", "at least one filled area or closed outline")
    patches = _patches(areas, join_mm) if join_mm > 0.0 else []
    changes.add("gaps_between_areas_closed", len(patches))
    union = shapely.union_all([*areas, *patches])
    if rocks or inner:
        union = shapely.difference(union, shapely.union_all([*rocks, *inner]))
    found = sorted(polygons_of(union), key=lambda part: -part.area)
    if not found:
        raise BadInputError("drawing", "no free space", "free space between the obstacles")
    return FreeAreas(parts=found, united=len(areas))


def _nested(parts: list[SolidRegion], changes: Changes) -> list[Polygon]:
    """Return what unfilled outlines enclose by the even-odd rule."""
    outlines = [part for part in parts if not part.filled and part.role is None]
    if not outlines:
        return []
    outlines = different_parts(outlines, 0.0, changes)
    own = Changes(changes.frame)
    found = solids([part.polygon for part in outlines], own)
    changes.add("nested_outlines_made_holes", _count(own, "nested_outlines_made_holes"))
    changes.add("nested_outlines_left_free", _count(own, "nested_outlines_left_solid"))
    return found


def _count(changes: Changes, name: str) -> int:
    number = changes.counts.get(name, 0)
    return number if isinstance(number, int) else 0


def _patches(areas: NDArray[np.object_], join_mm: float) -> list[BaseGeometry]:
    """Return what fills the gaps between areas that are near, but apart."""
    shapely.prepare(areas)
    tree = shapely.STRtree(areas)
    one, other = tree.query(areas, predicate="dwithin", distance=join_mm)
    one, other = one[one < other], other[one < other]
    apart = ~shapely.intersects(areas[one], areas[other])
    patches = []
    for first, second in zip(areas[one[apart]], areas[other[apart]], strict=True):
        # Of each the part around the other's box is enough.
        reach_mm = np.array([-2.0, -2.0, 2.0, 2.0]) * join_mm
        near = [
            shapely.intersection(item, shapely.box(*(np.array(beside.bounds) + reach_mm)))
            for item, beside in ((first, second), (second, first))
        ]
        patches.append(shapely.intersection(*shapely.buffer(near, 0.55 * join_mm)))
    return patches


def plainly_free(found: FreeAreas, areas: list[SolidRegion]) -> bool:
    """Return whether areas that no outline contains can only be free space.

    All are filled and hang together, none lies in another one, none is most of the whole (as
    bounds with an obstacle half outside would be), and the union has few holes (walls around
    rooms have many).
    """
    whole = found.parts[0]
    if len(found.parts) > 1 or not all(area.filled for area in areas):
        return False
    polygons = np.array([area.polygon for area in areas], dtype=np.object_)
    if shapely.area(polygons).max() > _MOST_SINGLE_SHARE * whole.area:
        return False
    if whole.area < (1.0 - _MOST_HOLES_SHARE) * Polygon(whole.exterior).area:
        return False
    inside = shapely.STRtree(polygons).query(polygons, predicate="covers")
    return bool(inside.shape[1] == len(polygons))


def enclosed_by(
    found: FreeAreas, start: Pose | None, sliver_mm2: float, changes: Changes
) -> Enclosed:
    """Return the geometry of a map of one part: that with the start, or the largest."""
    parts = found.parts
    kept = parts[0]
    if start is not None:
        spot = shapely.points(start.x_mm, start.y_mm)
        kept = next((part for part in parts if part.intersects(spot)), kept)
    changes.add("areas_united", found.united)
    if len(parts) > 1:
        whole_mm2 = math.fsum(part.area for part in parts)
        others = [part for part in parts if part is not kept][:_MOST_NAMED]
        spots = shapely.get_coordinates(shapely.point_on_surface(others))
        gaps_mm = shapely.distance(kept, others)
        changes.counts["separate_parts"] = len(parts)
        changes.counts["connected_share"] = round(kept.area / whole_mm2, 4)
        changes.counts["parts_left_out"] = [
            f"{part.area:.4g} mm2 at {changes.frame.place(spot)}, {gap:.4g} mm away"
            for part, spot, gap in zip(others, spots, gaps_mm, strict=True)
        ]
    holes = [Polygon(ring) for ring in kept.interiors]
    large = [hole for hole in holes if hole.area > sliver_mm2]
    changes.add("pinholes_left_free", len(holes) - len(large))
    which = "" if len(parts) == 1 else ", its largest part" if kept is parts[0] else ", one part"
    areas = f"{found.united} united area{'s' * (found.united != 1)}"
    return Enclosed(
        bounds=Polygon(kept.exterior), obstacles=large, how=f"the outline of {areas}{which}"
    )
