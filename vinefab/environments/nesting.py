"""Outlines in outlines: which enclose solid matter and which are holes in it."""

from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.environments.repair import polygons_of
from vinefab.environments.shapes import Changes
from vinefab.model.checked import Ints

Geometries = NDArray[np.object_]

_OVERLAP = "T********"
_SHARED_EDGE = "F***1****"


def repeats(outlines: list[Polygon], near_mm: float) -> NDArray[np.bool_]:
    """Tell of every outline whether it repeats an earlier one.

    Parameters
    ----------
    outlines
        Polygons; only their outer rings count.
    near_mm
        An outline that is nowhere farther than this from another one repeats it.
    """
    rings = shapely.get_exterior_ring(np.array(outlines, dtype=np.object_))
    boxes = shapely.bounds(rings).reshape(-1, 4)
    low = np.asarray(shapely.points(boxes[:, :2]), dtype=np.object_)
    later, earlier = shapely.STRtree(low).query(low, predicate="dwithin", distance=2 * near_mm)
    alike = (earlier < later) & (np.abs(boxes[later] - boxes[earlier]) <= near_mm).all(axis=1)
    later, earlier = later[alike], earlier[alike]
    alike = shapely.hausdorff_distance(rings[later], rings[earlier]) <= near_mm
    repeated = np.zeros(len(rings), dtype=np.bool_)
    repeated[later[alike]] = True
    return repeated


def solids(outlines: list[Polygon], changes: Changes) -> list[Polygon]:
    """Return the solid polygons that nested outlines mean by the even-odd rule.

    An outline in none or two or four others encloses solid matter. One in an odd number of others
    is a hole, but only if it touches none and those around it lie in one another; any other one
    says nothing and counts as solid.

    Parameters
    ----------
    outlines
        Polygons without holes, none repeated.
    changes
        Where holes are counted, and what was left solid.
    """
    nest = _Nest.of(np.array(outlines, dtype=np.object_))
    holes = np.flatnonzero(nest.is_hole)
    changes.add("nested_outlines_made_holes", len(holes))
    changes.add("nested_outlines_left_solid", int(nest.unclear.sum()))
    inner: dict[int, list[Polygon]] = {}
    for hole in holes:
        inner.setdefault(int(nest.parent[hole]), []).append(outlines[hole])
    return [
        Polygon(outlines[index].exterior, [hole.exterior for hole in inner.get(index, [])])
        for index in np.flatnonzero(~nest.is_hole & ~nest.unclear).tolist()
    ]


def painted(rings: list[Polygon]) -> BaseGeometry:
    """Return the area that the rings of one fill mean: solid, hole, island, from the outside in.

    Unlike the outlines of `solids`, rings of one fill were drawn to be holes and islands, so those
    that touch or overlap on the same level count together.

    Parameters
    ----------
    rings
        Polygons without holes.
    """
    if len(rings) == 1:
        return rings[0]
    rings = [ring for ring, again in zip(rings, repeats(rings, 0.0), strict=True) if not again]
    items = np.array(rings, dtype=np.object_)
    around, inside = shapely.STRtree(items).query(items, predicate="covers")
    depth = np.bincount(inside[around != inside], minlength=len(items))
    area = shapely.union_all(items[depth == 0])
    for level in range(1, int(depth.max(initial=0)) + 1):
        layer = shapely.union_all(items[depth == level])
        area = area.difference(layer) if level % 2 else area.union(layer)
    return area


@dataclass(frozen=True, slots=True)
class _Nest:
    """Which outline lies in which.

    Parameters
    ----------
    parent
        Shape (n,), the smallest outline around each, -1 for none.
    depth
        Shape (n,), number of outlines around each.
    unclear
        Shape (n,), whether it may as well be a hole as not.
    """

    parent: Ints
    depth: Ints
    unclear: NDArray[np.bool_]

    @property
    def is_hole(self) -> NDArray[np.bool_]:
        return np.asarray((self.depth % 2 == 1) & ~self.unclear)

    @classmethod
    def of(cls, outlines: Geometries) -> "_Nest":
        count = len(outlines)
        around, inside = shapely.STRtree(outlines).query(outlines, predicate="intersects")
        around, inside = around[around != inside], inside[around != inside]
        shapely.prepare(outlines)
        proper = shapely.contains_properly(outlines[around], outlines[inside])
        depth = np.bincount(inside[proper], minlength=count)
        areas = shapely.area(outlines)
        parent = np.full(count, -1, dtype=np.int64)
        order = np.argsort(-areas[around[proper]], kind="stable")
        # Of several assignments the last one stays: that of the smallest outline around.
        parent[inside[proper][order]] = around[proper][order]
        nested = set(zip(around[proper].tolist(), inside[proper].tolist(), strict=True))
        rest = [
            (i, j)
            for i, j in zip(around.tolist(), inside.tolist(), strict=True)
            if i < j and (i, j) not in nested and (j, i) not in nested
        ]
        first, second = np.array(rest, dtype=np.int64).reshape(-1, 2).T
        mixed = np.zeros(count, dtype=np.bool_)
        # Also a shared corner: whether the inner outline is a hole or a notch cannot be told.
        mixed[first] = mixed[second] = True
        return cls(parent, depth, _unclear(parent, depth, mixed))


def _unclear(parent: Ints, depth: Ints, mixed: NDArray[np.bool_]) -> NDArray[np.bool_]:
    unclear = np.zeros(len(parent), dtype=np.bool_)
    for index in np.argsort(depth, kind="stable").tolist():
        if depth[index] == 0:
            continue
        outer = int(parent[index])
        broken = depth[outer] != depth[index] - 1
        unclear[index] = broken or unclear[outer] or (depth[index] % 2 == 1 and mixed[index])
    return unclear


def merged(polygons: list[Polygon], gap_mm: float, changes: Changes) -> list[Polygon]:
    """Return polygons of which no two overlap, share an edge, or leave a narrower gap.

    Those that no other one is near to come back as they were.

    Parameters
    ----------
    polygons
        Valid polygons, holes allowed.
    gap_mm
        Gaps up to this width are closed, at least 0.
    changes
        Where it is counted.
    """
    if not polygons:
        return []
    items = np.array(polygons, dtype=np.object_)
    one, other = shapely.STRtree(items).query(items, predicate="dwithin", distance=gap_mm)
    one, other = one[one < other], other[one < other]
    apart = shapely.distance(items[one], items[other]) > 0.0
    joined = apart | _meet(items[one], items[other])
    one, other, apart = one[joined], other[joined], apart[joined]
    graph = coo_array((np.ones(len(one)), (one, other)), shape=(len(items), len(items)))
    count, group = connected_components(graph, directed=False)
    result: list[Polygon] = []
    gaps = np.bincount(group[one[apart]], minlength=count)
    order = np.argsort(group, kind="stable")
    for number, members in enumerate(np.split(order, np.cumsum(np.bincount(group))[:-1])):
        if len(members) == 1:
            result.append(items[members[0]])
            continue
        result += _together(items[members], gap_mm if gaps[number] else 0.0)
        changes.add("overlapping_obstacles_merged", len(members))
    changes.add("gaps_between_obstacles_closed", int(gaps.sum()))
    return result


def _meet(one: Geometries, other: Geometries) -> NDArray[np.bool_]:
    """Tell which pairs overlap or share a piece of an edge."""
    overlap = shapely.relate_pattern(one, other, _OVERLAP)
    return np.asarray(overlap | shapely.relate_pattern(one, other, _SHARED_EDGE))


def _together(items: Geometries, gap_mm: float) -> list[Polygon]:
    whole = shapely.union_all(items)
    if gap_mm > 0.0:
        # Grown and shrunk again by the same amount: gaps fill, everything else stays.
        grown = shapely.buffer(whole, 0.55 * gap_mm, join_style="mitre")
        closed = shapely.buffer(grown, -0.55 * gap_mm, join_style="mitre")
        filling = polygons_of(shapely.difference(closed, whole), (0.01 * gap_mm) ** 2)
        whole = shapely.union_all([whole, *filling])
    return polygons_of(whole)
