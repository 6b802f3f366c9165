"""Nested outlines: which enclose solid matter, which are holes, and which is the bounds.

`shapely.build_area` is no replacement: it takes every outline in an outline for a hole, also one
in the overlap of two or one that touches its parent, which cannot be told from a notch here and
stays solid (and counted); and in one fill it joins overlapping islands by even-odd.
"""

from dataclasses import dataclass

import numpy as np
import scipy  # its parts load at their first use
import shapely
from numpy.typing import NDArray
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import counted
from vinefab.core.validation import Ints
from vinefab.maps.cleanup.drawn_shapes import Changes, Role, polygons_of

_Geometries = NDArray[np.object_]

_MOST_NAMED = 20
_OVERLAP = "T********"
_SHARED_EDGE = "F***1****"


def repeats(outlines: list[Polygon], near_mm: float) -> NDArray[np.bool_]:
    """Return for every outline whether it repeats an earlier one."""
    every = shapely.get_exterior_ring(np.array(outlines, dtype=np.object_))
    # Thousands of equal ones are found at once, not pair by pair.
    first: dict[bytes, int] = {}
    for number, ring in enumerate(shapely.to_wkb(every)):
        first.setdefault(ring, number)
    again = np.ones(len(every), dtype=np.bool_)
    again[list(first.values())] = False
    rings = every[~again]
    boxes = shapely.bounds(rings).reshape(-1, 4)
    low = np.asarray(shapely.points(boxes[:, :2]), dtype=np.object_)
    later, earlier = shapely.STRtree(low).query(low, predicate="dwithin", distance=2 * near_mm)
    alike = (earlier < later) & (np.abs(boxes[later] - boxes[earlier]) <= near_mm).all(axis=1)
    later, earlier = later[alike], earlier[alike]
    alike = shapely.hausdorff_distance(rings[later], rings[earlier]) <= near_mm
    repeated = np.zeros(len(rings), dtype=np.bool_)
    repeated[later[alike]] = True
    again[~again] = repeated
    return again


def solids(outlines: list[Polygon], changes: Changes) -> list[Polygon]:
    """Return the solid polygons of nested outlines by the even-odd rule.

    An outline in an even number of others encloses solid matter. One in an odd number of others
    is a hole, but only if it touches none of them and they are nested; otherwise it is ambiguous
    and counts as solid.
    """
    nest = _Nest.of(np.array(outlines, dtype=np.object_))
    holes = np.flatnonzero(nest.is_hole)
    changes.add("nested_outlines_made_holes", len(holes))
    changes.add("nested_outlines_left_solid", int(nest.unclear.sum()))
    inner: dict[int, list[Polygon]] = {}
    for hole in holes:
        inner.setdefault(int(nest.parent[hole]), []).append(outlines[hole])
    return [
        Polygon(outlines[index].exterior, [hole.exterior for hole in inner[index]])
        if index in inner
        else outlines[index]
        for index in np.flatnonzero(~nest.is_hole & ~nest.unclear).tolist()
    ]


def painted(rings: list[Polygon]) -> BaseGeometry:
    """Return the area of the rings of one fill: solid, hole, island, from the outside in.

    Unlike outlines in `solids`, rings of one fill are meant as holes and islands, so those that
    touch or overlap on the same level are united.
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
    """Which outline lies in which."""

    parent: Ints  # shape (n,), the smallest outline around each, -1 for none
    depth: Ints  # shape (n,), number of outlines around each
    unclear: NDArray[np.bool_]  # shape (n,), whether it is ambiguous: hole or solid

    @property
    def is_hole(self) -> NDArray[np.bool_]:
        return np.asarray((self.depth % 2 == 1) & ~self.unclear)

    @classmethod
    def of(cls, outlines: _Geometries) -> "_Nest":
        count = len(outlines)
        around, inside = shapely.STRtree(outlines).query(outlines, predicate="intersects")
        around, inside = around[around != inside], inside[around != inside]
        shapely.prepare(outlines)
        proper = shapely.contains_properly(outlines[around], outlines[inside])
        depth = np.bincount(inside[proper], minlength=count)
        areas = shapely.area(outlines)
        parent = np.full(count, -1, dtype=np.int64)
        order = np.argsort(-areas[around[proper]], kind="stable")
        # The last of several assignments stays: that of the smallest outline around.
        parent[inside[proper][order]] = around[proper][order]
        nested = around[proper] * count + inside[proper]
        rest = (around < inside) & ~np.isin(around * count + inside, nested)
        rest &= ~np.isin(inside * count + around, nested)
        first, second = around[rest], inside[rest]
        mixed = np.zeros(count, dtype=np.bool_)
        # Also at a shared corner: the inner outline may be a hole or a notch.
        mixed[first] = mixed[second] = True
        unclear = np.zeros(len(parent), dtype=np.bool_)
        for index in np.argsort(depth, kind="stable").tolist():
            if depth[index] == 0:
                continue
            outer = int(parent[index])
            broken = depth[outer] != depth[index] - 1
            unclear[index] = broken or unclear[outer] or (depth[index] % 2 == 1 and mixed[index])
        return cls(parent, depth, unclear)


def merged(polygons: list[Polygon], gap_mm: float, changes: Changes) -> list[Polygon]:
    """Return polygons of which no two overlap, share an edge or leave a narrower gap.

    Isolated polygons are returned unchanged.
    """
    if not polygons:
        return []
    items = np.array(polygons, dtype=np.object_)
    one, other = shapely.STRtree(items).query(items, predicate="dwithin", distance=gap_mm)
    one, other = one[one < other], other[one < other]
    apart = shapely.distance(items[one], items[other]) > 0.0
    joined = apart.copy()
    for pattern in (_OVERLAP, _SHARED_EDGE):
        joined |= shapely.relate_pattern(items[one], items[other], pattern)
    one, other, apart = one[joined], other[joined], apart[joined]
    graph = scipy.sparse.coo_array(
        (np.ones(len(one)), (one, other)), shape=(len(items), len(items))
    )
    count, group = scipy.sparse.csgraph.connected_components(graph, directed=False)
    result: list[Polygon] = []
    gaps = np.bincount(group[one[apart]], minlength=count)
    order = np.argsort(group, kind="stable")
    for number, members in enumerate(np.split(order, np.cumsum(np.bincount(group))[:-1])):
        if len(members) == 1:
            result.append(items[members[0]])
            continue
        result += _united(items[members], gap_mm if gaps[number] else 0.0)
        changes.add("overlapping_obstacles_merged", len(members))
    changes.add("gaps_between_obstacles_closed", int(gaps.sum()))
    return result


def _united(items: _Geometries, gap_mm: float) -> list[Polygon]:
    whole = shapely.union_all(items)
    if gap_mm > 0.0:
        # Closing: growing and shrinking by the same amount fills gaps and keeps the rest.
        grown = shapely.buffer(whole, 0.55 * gap_mm, join_style="mitre")
        closed = shapely.buffer(grown, -0.55 * gap_mm, join_style="mitre")
        filling = polygons_of(shapely.difference(closed, whole), (0.01 * gap_mm) ** 2)
        whole = shapely.union_all([whole, *filling])
    return polygons_of(whole)


@dataclass(frozen=True, slots=True, kw_only=True)
class SolidRegion:
    """A closed part of a drawing."""

    polygon: Polygon  # without holes unless filled
    where: str  # its name in messages
    role: Role | None = None  # as the source names it
    filled: bool = False  # whether its inside is solid wherever it lies
    wall: bool = False  # whether it was made from a line

    @property
    def shell(self) -> Polygon:
        """What its outer ring encloses."""
        holed = shapely.get_num_interior_rings(self.polygon) > 0
        return Polygon(self.polygon.exterior) if holed else self.polygon


@dataclass(frozen=True, slots=True, kw_only=True)
class Enclosed:
    """The geometry of a map."""

    bounds: Polygon  # without holes
    obstacles: list[Polygon]  # none overlaps another
    how: str  # which bounds were chosen, as text


def enclose(
    parts: list[SolidRegion],
    mode: str,
    margin_mm: float,
    join_mm: float,
    changes: Changes,
    advice: str = "",
) -> Enclosed:
    """Choose the bounds of a drawing and turn the rest into obstacles.

    Parameters
    ----------
    mode
        ``outline``, ``largest``, ``wall`` or ``box``, see `AssembleOptions`. Bounds named by the
        source and walls made from lines take precedence.
    advice
        What else helps where the largest outline does not contain all others.
    """
    parts = different_parts(parts, join_mm, changes)
    named = [part for part in parts if part.role == "bounds"]
    if len(named) > 1:
        raise BadInputError("bounds", counted(len(named), "outline"), "exactly one")
    if mode == "box" and not named:
        x_min, y_min, x_max, y_max = shapely.total_bounds([part.polygon for part in parts])
        box = shapely.box(
            x_min - margin_mm, y_min - margin_mm, x_max + margin_mm, y_max + margin_mm
        )
        return Enclosed(
            bounds=box,
            obstacles=merged(_solid_polygons(parts, changes), join_mm, changes),
            how=f"a rectangle around everything, {margin_mm:.6g} mm beyond it",
        )
    outer = named[0] if named else max(parts, key=lambda part: float(part.shell.area))
    wall = not named and (mode == "wall" or outer.wall)
    rest = [part for part in parts if part is not outer]
    if named or mode == "largest":
        shapely.prepare(outer.shell)
        inside = [
            part for part in rest if shapely.relate_pattern(outer.shell, part.polygon, "T********")
        ]
        changes.add("outlines_outside_left_out", len(rest) - len(inside))
        reaching = [part for part in inside if not shapely.covers(outer.shell, part.polygon)]
        if reaching:
            cut = np.array([part.polygon for part in reaching[:_MOST_NAMED]], dtype=np.object_)
            outside_mm2 = shapely.area(shapely.difference(cut, outer.shell))
            shares = outside_mm2 / np.maximum(shapely.area(cut), 1e-300)
            changes.counts["reaching_over_bounds"] = [
                f"{part.where}: {100.0 * share:.3g} % of it outside"
                for part, share in zip(reaching[:_MOST_NAMED], shares.tolist(), strict=True)
            ]
        rest = inside
    else:
        _refuse_outside(outer.shell, rest, join_mm, changes, advice)
    rest += (
        [outer]
        if wall
        else [
            SolidRegion(polygon=Polygon(ring), where=outer.where)
            for ring in outer.polygon.interiors
        ]
    )
    obstacles = merged(_solid_polygons(rest, changes), join_mm, changes)
    how = f"{'the outer face of a wall' if wall else 'the largest outline'}, {outer.where}"
    if named:
        how = f"{outer.where}, which the source calls bounds"
    return Enclosed(bounds=outer.shell, obstacles=_cut(obstacles, outer.shell, changes), how=how)


def different_parts(
    parts: list[SolidRegion], join_mm: float, changes: Changes
) -> list[SolidRegion]:
    """Return parts without duplicates; of an outline and an equal fill the fill stays."""
    filled = _different_fills([part for part in parts if part.filled], join_mm, changes)
    rings = [Polygon(ring) for part in filled for ring in shapely.get_rings(part.polygon)]
    outlines = [part for part in parts if not part.filled]
    all_rings = [*rings, *(part.polygon for part in outlines)]
    kept = repeats(all_rings, join_mm)[len(rings) :]
    changes.add("repeated_outlines_removed", int(kept.sum()))
    return filled + [part for part, again in zip(outlines, kept, strict=True) if not again]


def _different_fills(
    filled: list[SolidRegion], join_mm: float, changes: Changes
) -> list[SolidRegion]:
    """Return fills without duplicates, holes compared too."""
    again = repeats([part.shell for part in filled], join_mm)
    found: list[SolidRegion] = []
    for part, alike in zip(filled, again, strict=True):
        if alike and any(
            len(part.polygon.interiors) == len(other.polygon.interiors)
            and shapely.hausdorff_distance(part.polygon.boundary, other.polygon.boundary) <= join_mm
            for other in found
        ):
            changes.add("repeated_outlines_removed")
        else:
            found.append(part)
    return found


def contained(parts: list[SolidRegion], join_mm: float) -> bool:
    """Return whether the largest part contains all others."""
    outer = max(parts, key=lambda part: float(part.shell.area))
    rest = [part for part in parts if part is not outer]
    return _first_outside(outer.shell, rest, join_mm) is None


def _first_outside(
    shell: Polygon, rest: list[SolidRegion], join_mm: float
) -> tuple[SolidRegion, BaseGeometry] | None:
    """Return the first part that reaches out of the bounds by more than a gap, and how."""
    shapely.prepare(shell)
    polygons = np.array([part.polygon for part in rest], dtype=np.object_)
    for index in np.flatnonzero(~shapely.covers(shell, polygons)):
        beyond = shapely.difference(rest[index].polygon, shell)
        corners = shapely.points(shapely.get_coordinates(beyond))
        if float(np.max(shapely.distance(corners, shell), initial=0.0)) > join_mm:
            return rest[index], beyond
    return None


def _refuse_outside(
    shell: Polygon, rest: list[SolidRegion], join_mm: float, changes: Changes, advice: str
) -> None:
    """Raise BadInputError if a part lies outside the bounds."""
    found = _first_outside(shell, rest, join_mm)
    if found is None:
        return
    part, beyond = found
    spot = shapely.get_coordinates(shapely.point_on_surface(beyond))[0]
    low, high = (changes.frame.place(corner) for corner in (shell.bounds[:2], shell.bounds[2:]))
    raise BadInputError(
        f"{part.where} at {changes.frame.place(spot)}",
        f"outside of the largest outline ({low} to {high})",
        f"drawings whose largest outline contains all others; {changes.layer_advice}"
        "--bounds largest to cut off what is outside, --bounds box to put a rectangle around"
        f"{advice}",
    )


def _solid_polygons(parts: list[SolidRegion], changes: Changes) -> list[Polygon]:
    """Return the solid polygons of parts; they may overlap."""
    given = [part.polygon for part in parts if part.filled or part.role == "obstacle"]
    nested = solids([part.polygon for part in parts if not (part.filled or part.role)], changes)
    return [*given, *nested]


def _cut(obstacles: list[Polygon], bounds: Polygon, changes: Changes) -> list[Polygon]:
    """Return obstacles clipped to the bounds."""
    if not obstacles:
        return []
    shapely.prepare(bounds)
    over = ~shapely.covers(bounds, obstacles)
    changes.add("obstacles_cut_at_bounds", int(over.sum()))
    result = [item for item, cut in zip(obstacles, over, strict=True) if not cut]
    for index in np.flatnonzero(over).tolist():
        result += polygons_of(shapely.intersection(obstacles[index], bounds))
    return result
