"""Maps from drawings of other programs: nested outlines, or united areas, enclosed and merged.

`shapely.build_area` does not replace the nesting: it takes every outline in an outline for a hole,
also one in the overlap of two or one that touches its parent, which cannot be told from a notch
and stays solid (and counted); and in one fill it joins overlapping islands by even-odd.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import scipy  # its parts load at their first use
import shapely
from numpy.typing import NDArray
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError, UnfitInputError
from vinefab.core.plain_text import counted
from vinefab.core.validation import LARGEST_MM, Floats, number, positive
from vinefab.maps.cleanup.drawn_shapes import (
    Changes,
    DrawnShape,
    Line,
    Role,
    as_areas,
    chained,
    closing_gap_mm,
    free_apart,
    join,
    open_places,
    polygons_of,
    refuse_open,
    ring_polygons,
    walls_along,
    without_repeats,
)
from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.poses import roomiest_start
from vinefab.model.map import Map, Pose, Start

_MOST_NAMED = 20


def repeats(outlines: list[Polygon], near_mm: float) -> NDArray[np.bool_]:
    """Return for every outline whether it repeats an earlier one."""
    every = shapely.get_exterior_ring(np.array(outlines, dtype=np.object_))
    # Thousands of equal ones are found at once, not pair by pair.
    first: dict[bytes, int] = {}
    for index, ring in enumerate(shapely.to_wkb(every)):
        first.setdefault(ring, index)
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
    items = np.array(outlines, dtype=np.object_)
    count = len(items)
    around, inside = shapely.STRtree(items).query(items, predicate="intersects")
    around, inside = around[around != inside], inside[around != inside]
    shapely.prepare(items)
    proper = shapely.contains_properly(items[around], items[inside])
    depth = np.bincount(inside[proper], minlength=count)  # number of outlines around each
    parent = np.full(count, -1, dtype=np.int64)  # the smallest outline around each
    order = np.argsort(-shapely.area(items)[around[proper]], kind="stable")
    # The last of several assignments stays: that of the smallest outline around.
    parent[inside[proper][order]] = around[proper][order]
    nested = around[proper] * count + inside[proper]
    rest = (around < inside) & ~np.isin(around * count + inside, nested)
    rest &= ~np.isin(inside * count + around, nested)
    mixed = np.zeros(count, dtype=np.bool_)
    # Also at a shared corner: the inner outline may be a hole or a notch.
    mixed[around[rest]] = mixed[inside[rest]] = True
    unclear = np.zeros(count, dtype=np.bool_)
    for index in np.argsort(depth, kind="stable").tolist():
        if depth[index]:
            outer = int(parent[index])
            broken = depth[outer] != depth[index] - 1
            unclear[index] = broken or unclear[outer] or (depth[index] % 2 == 1 and mixed[index])
    is_hole = (depth % 2 == 1) & ~unclear
    changes.add("nested_outlines_made_holes", int(is_hole.sum()))
    changes.add("nested_outlines_left_solid", int(unclear.sum()))
    inner: dict[int, list[Polygon]] = {}
    for hole in np.flatnonzero(is_hole).tolist():
        inner.setdefault(int(parent[hole]), []).append(outlines[hole])
    return [
        Polygon(outlines[index].exterior, [hole.exterior for hole in inner[index]])
        if index in inner
        else outlines[index]
        for index in np.flatnonzero(~is_hole & ~unclear).tolist()
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
    for pattern in ("T********", "F***1****"):  # they overlap, or share an edge
        joined |= shapely.relate_pattern(items[one], items[other], pattern)
    one, other, apart = one[joined], other[joined], apart[joined]
    graph = scipy.sparse.coo_array(
        (np.ones(len(one)), (one, other)), shape=(len(items), len(items))
    )
    count, group = scipy.sparse.csgraph.connected_components(graph, directed=False)
    result: list[Polygon] = []
    gaps = np.bincount(group[one[apart]], minlength=count)
    order = np.argsort(group, kind="stable")
    for group_index, members in enumerate(np.split(order, np.cumsum(np.bincount(group))[:-1])):
        if len(members) == 1:
            result.append(items[members[0]])
            continue
        whole = shapely.union_all(items[members])
        if gap_mm > 0.0 and gaps[group_index]:
            # Closing: growing and shrinking by the same amount fills gaps and keeps the rest.
            grown = shapely.buffer(whole, 0.55 * gap_mm, join_style="mitre")
            closed = shapely.buffer(grown, -0.55 * gap_mm, join_style="mitre")
            filling = polygons_of(shapely.difference(closed, whole), (0.01 * gap_mm) ** 2)
            whole = shapely.union_all([whole, *filling])
        result += polygons_of(whole)
        changes.add("overlapping_obstacles_merged", len(members))
    changes.add("gaps_between_obstacles_closed", int(gaps.sum()))
    return result


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
        problem = f"{counted(len(named), 'outline')} are called bounds, and a map has one"
        raise UnfitInputError("bounds", problem, "call the others obstacles, or nothing")
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
    elif (found := _first_outside(outer.shell, rest, join_mm)) is not None:
        part, beyond = found
        spot = shapely.get_coordinates(shapely.point_on_surface(beyond))[0]
        box = outer.shell.bounds
        low, high = (changes.frame.place(corner) for corner in (box[:2], box[2:]))
        raise UnfitInputError(
            f"{part.where} at {changes.frame.place(spot)}",
            f"lies outside of the largest outline ({low} to {high}), which must contain all others",
            f"{changes.layer_advice}--bounds largest cuts off all that is outside, --bounds box "
            f"puts a rectangle around{advice}",
        )
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
        problem = f"the source calls {named[0].where} bounds, so its areas are no free space"
        raise UnfitInputError("drawn", problem, "give --drawn obstacles")
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
        raise UnfitInputError("", "the drawing has no area", "fill one, or close an outline")
    patches = _patches(areas, join_mm) if join_mm > 0.0 else []
    changes.add("gaps_between_areas_closed", len(patches))
    union = shapely.union_all([*areas, *patches])
    if rocks or inner:
        union = shapely.difference(union, shapely.union_all([*rocks, *inner]))
    found = sorted(polygons_of(union), key=lambda part: -part.area)
    if not found:
        raise UnfitInputError(
            "", "obstacles leave no free space", "check which outlines are obstacles"
        )
    return FreeAreas(parts=found, united=len(areas))


def _nested(parts: list[SolidRegion], changes: Changes) -> list[Polygon]:
    """Return the areas inside unfilled outlines by the even-odd rule."""
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
    """Return the patches for the gaps between areas that are near, but apart."""
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
    # Of the union: an area that is more of it may as well be bounds, with obstacles half outside.
    most_single_share = 0.5
    if shapely.area(polygons).max() > most_single_share * whole.area:
        return False
    # Share of the area in its outline: a union with more holes may as well be walls around rooms.
    most_holes_share = 0.2
    if whole.area < (1.0 - most_holes_share) * Polygon(whole.exterior).area:
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
        largest = int(np.argmax([part is not kept for part in parts]))
        inner = shapely.point_on_surface(parts[largest])
        other = "--drawn obstacles reads the areas as obstacles, --join-mm closes gaps"
        left_mm2 = whole_mm2 - float(kept.area)
        changes.counts |= free_apart(left_mm2, (inner.x, inner.y), in_map=False, other=other)
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


BOUNDS = ("outline", "largest", "wall", "box")
DRAWN = ("obstacles", "free")
_GRID_MM = 1e-6
_MANY_OBSTACLES = 2000


@dataclass(frozen=True, slots=True, kw_only=True)
class AssembleOptions(ImportOptions):
    """The options of an import, with the sizes that follow from the drawing's own.

    Parameters
    ----------
    join_mm
        Ends of lines within this are joined, gaps between obstacles up to this are closed,
        outlines that are nowhere farther apart count as one.
    simplify_mm
        Largest distance by which walls move when corners are left out; 0 keeps every corner.
    margin_mm
        Between the drawing and the rectangle.
    sliver_mm2
        Obstacles and holes of less area are left out.
    most_join_mm
        The largest ``join_mm`` that a user may give: messages advise no more.
    """

    join_mm: float
    simplify_mm: float = 0.0
    margin_mm: float = 0.0
    sliver_mm2: float
    most_join_mm: float = LARGEST_MM

    def __post_init__(self) -> None:
        number("join_mm", self.join_mm, 0.0, LARGEST_MM, "mm")
        number("simplify_mm", self.simplify_mm, 0.0, LARGEST_MM, "mm")
        number("sliver_mm2", self.sliver_mm2, 0.0, LARGEST_MM**2, "mm2")
        number("margin_mm", self.margin_mm, 0.0, LARGEST_MM, "mm")
        if self.wall_mm is not None:
            positive("wall_mm", self.wall_mm)
        if self.bounds not in (None, *BOUNDS):
            raise BadInputError("bounds", self.bounds, ", ".join(BOUNDS))
        if self.drawn not in (None, *DRAWN):
            raise BadInputError("drawn", self.drawn, " or ".join(DRAWN))
        for name in ("bounds", "wall_mm") if self.drawn == "free" else ():
            if getattr(self, name) is not None:
                raise UnfitInputError(name, "means nothing with --drawn free", "leave it out")
        if self.open_lines not in (None, "refuse", "drop", "wall"):
            raise BadInputError("open", self.open_lines, "refuse, drop or wall")
        if self.open_lines == "wall" and self.wall_mm is None:
            raise UnfitInputError("open", "wall needs a thickness", "give --wall-mm")


def assemble(
    name: str,
    shapes: tuple[DrawnShape, ...],
    changes: Changes,
    options: AssembleOptions,
    facts: Mapping[str, object],
) -> Map:
    """Return the map that a drawing shows.

    Loose lines are joined into outlines, self-crossing outlines repaired and duplicates removed.
    The outline that contains all others becomes the bounds, outlines in it become obstacles and
    outlines in those holes; overlapping obstacles are merged. Where the areas are the free space,
    their union is. What is ambiguous is refused with its position in the coordinates of the
    source.

    Parameters
    ----------
    changes
        The frame of the drawing; counts of changes go in.
    """
    frame = changes.frame
    enclosed = _enclosed(shapes, options, changes)
    obstacles = _on_grid(list(enclosed.obstacles), options.sliver_mm2, changes)
    rounded = polygons_of(shapely.set_precision(enclosed.bounds, _GRID_MM))
    bounds = max(rounded, key=lambda part: part.area, default=enclosed.bounds)
    world = Map(name=name, bounds=bounds, obstacles=tuple(obstacles))
    start, free_facts = _start(world, options)
    return Map(
        name=name,
        bounds=bounds,
        obstacles=world.obstacles,
        starts=(start,),
        environment="import",
        facts={
            **facts,
            "join_mm": options.join_mm,
            "sliver_mm2": options.sliver_mm2,
            **({} if options.wall_mm is None else {"wall_mm": options.wall_mm}),
            "bounds_are": enclosed.how,
            **({"origin_at_source": [frame.x, frame.y]} if frame.x or frame.y else {}),
            **changes.counts,
            **free_facts,
        },
    )


def _enclosed(
    shapes: tuple[DrawnShape, ...], options: AssembleOptions, changes: Changes
) -> Enclosed:
    if options.drawn == "free":
        found = free_areas(_regions(as_areas(shapes), options, changes), options.join_mm, changes)
        changes.counts["drawn"] = "free (as asked for): the areas are the free space"
        return enclosed_by(found, options.start, options.sliver_mm2, changes)
    parts = _regions(shapes, options, changes)
    advice = "" if options.wall_mm is None else " (with --margin-mm 0 right at the walls)"
    # Whether reading areas as obstacles must fail, and as free space may not.
    may_be_free = (
        options.drawn is None
        and options.wall_mm is None
        and options.bounds is None
        and all(part.role is None for part in parts)
        and not contained(parts, options.join_mm)
    )
    # Of drawn areas: what is less connected is not called free space, even as advice.
    least_connected_share = 0.5
    if may_be_free:
        own = Changes(changes.frame)
        areas = different_parts(_regions(as_areas(shapes), options, own), options.join_mm, own)
        found = free_areas(areas, options.join_mm, own)
        if plainly_free(found, areas):
            own.counts["drawn"] = (
                "free (guessed: no outline contains the others, and together they are one area); "
                "--drawn obstacles if not"
            )
            changes.counts.clear()
            changes.counts |= own.counts
            return enclosed_by(found, options.start, options.sliver_mm2, changes)
        hangs_together = found.connected_share >= least_connected_share
        if hangs_together and len(found.parts) < found.united:
            advice = ", --drawn free if the areas are the free space"
    return enclose(
        parts, options.bounds or "outline", options.margin_mm, options.join_mm, changes, advice
    )


def _regions(
    shapes: tuple[DrawnShape, ...], options: AssembleOptions, changes: Changes
) -> list[SolidRegion]:
    wide = [shape for shape in shapes if shape.wide is not None]
    shapes = tuple(shape for shape in shapes if shape.wide is None)
    found = [
        *_filled(shapes, options, changes),
        *(_outlines(shapes, options, changes) if shapes or not wide else ()),
        *_drawn_walls(wide, changes),
    ]
    if not found:
        dropped = changes.counts.get("slivers_dropped")
        problem = "the drawing has no outlines"
        if dropped:
            problem += f" but {dropped} without area"
        raise UnfitInputError("", problem, "draw at least one closed outline")
    return found


def _filled(
    shapes: tuple[DrawnShape, ...], options: AssembleOptions, changes: Changes
) -> list[SolidRegion]:
    found = []
    for shape in shapes:
        if not shape.filled:
            continue
        rings, holes = (
            [
                polygon
                for ring in group
                for polygon in _ring(changes.frame.to_map(ring), shape, options, changes)
            ]
            for group in (shape.rings, shape.holes)
        )
        shells = _shells(rings)
        area = painted(shells)
        changes.add(
            "overlapping_rings_merged",
            len(shells) - len(shapely.get_rings(shapely.get_parts(area))),
        )
        if holes:
            area = shapely.difference(area, shapely.union_all(holes))
        found += [
            SolidRegion(polygon=polygon, where=shape.where, role=shape.role, filled=True)
            for polygon in polygons_of(area, options.sliver_mm2)
        ]
    return found


def _drawn_walls(shapes: list[DrawnShape], changes: Changes) -> list[SolidRegion]:
    """Return lines that have a width in their drawing as areas of that width."""
    found = []
    for shape in shapes:
        points = without_repeats(changes.frame.to_map(shape.rings[0]), changes)
        if len(points) < 2:
            changes.add("single_points_left_out")
            continue
        begin_mm, end_mm = (
            width * changes.frame.scale_mm_per_unit for width in shape.wide or (0.0, 0.0)
        )
        closed = shape.closed and len(points) > 2
        middle = shapely.LinearRing(points) if closed else shapely.LineString(points)
        area = shapely.buffer(middle, 0.5 * begin_mm, cap_style="flat", join_style="mitre")
        if begin_mm != end_mm:
            along = (points[-1] - points[0]) / max(math.dist(points[0], points[-1]), 1e-300)
            aside = 0.5 * np.array([-along[1], along[0]])
            sides = [points[0] - begin_mm * aside, points[-1] - end_mm * aside]
            sides += [points[-1] + end_mm * aside, points[0] + begin_mm * aside]
            area = Polygon(sides)
        found += [
            SolidRegion(polygon=part, where=shape.where, filled=True, wall=True)
            for part in polygons_of(area)
        ]
    changes.add("lines_with_a_width_made_walls", len(shapes))
    return found


def _shells(polygons: list[Polygon]) -> list[Polygon]:
    """Return every ring of some polygons as a polygon without holes."""
    holed = shapely.get_num_interior_rings(np.array(polygons, dtype=np.object_)) > 0
    return [
        shell
        for polygon, with_holes in zip(polygons, holed, strict=True)
        for shell in (map(Polygon, shapely.get_rings(polygon)) if with_holes else (polygon,))
    ]


def _outlines(
    shapes: tuple[DrawnShape, ...], options: AssembleOptions, changes: Changes
) -> list[SolidRegion]:
    loose: list[Line] = []
    rings: list[tuple[Line, DrawnShape]] = []
    for shape in shapes:
        if shape.filled:
            continue
        points = without_repeats(changes.frame.to_map(shape.rings[0]), changes)
        if len(points) < 2:
            changes.add("single_points_left_out")
            continue
        if shape.closed and (points[0] != points[-1]).any():
            points = np.vstack([points, points[:1]])
        line = Line(points_mm=points, where=shape.where)
        encloses = shape.closed or line.closed
        all_walls = options.wall_mm is not None and options.open_lines != "wall"
        if shape.role is None and (all_walls or not encloses):
            loose.append(line)
        else:
            rings.append((line, shape))
    if options.wall_mm is not None:
        if options.open_lines == "wall":
            joined_lines = chained(loose, options.join_mm, changes)
            rings += [
                (line, DrawnShape(rings=(), where=line.where))
                for line in joined_lines
                if line.closed
            ]
            loose = [line for line in joined_lines if not line.closed]
        walls = walls_along(loose, options.wall_mm, options.join_mm, changes)
        return [
            SolidRegion(polygon=wall, where="a wall", filled=True, wall=True) for wall in walls
        ] + [found for line, shape in rings for found in _solid(line, shape, options, changes)]
    joined = join(loose, options.join_mm, changes)
    if joined.open and options.open_lines != "drop":
        closing_mm = closing_gap_mm(loose, joined.open, options.most_join_mm, changes)
        size_mm = float(np.ptp(np.concatenate([one.points_mm for one in loose]), axis=0).max())
        raise refuse_open(joined.open, options.join_mm, changes, closing_mm, size_mm)
    if joined.open:
        changes.add("open_lines_left_out", len(joined.open))
        changes.counts["open_lines"] = open_places(joined.open[:_MOST_NAMED], changes)
    rings += [(line, DrawnShape(rings=(), where=line.where)) for line in joined.rings]
    return [found for line, shape in rings for found in _solid(line, shape, options, changes)]


def _solid(
    line: Line, shape: DrawnShape, options: AssembleOptions, changes: Changes
) -> list[SolidRegion]:
    polygons = _ring(line.points_mm, shape, options, changes)
    return [
        SolidRegion(polygon=polygon, where=shape.where, role=shape.role)
        for polygon in _shells(polygons)
    ]


def _ring(
    points_mm: Floats, shape: DrawnShape, options: AssembleOptions, changes: Changes
) -> list[Polygon]:
    """Return the area inside a ring, simplified if the options say so."""
    polygons = ring_polygons(
        points_mm,
        shape.where,
        options.sliver_mm2,
        changes,
        even_odd=shape.even_odd,
        may_be_line=not shape.filled and shape.role is None,
    )
    if options.simplify_mm == 0.0:
        return polygons
    plain = shapely.simplify(np.array(polygons, dtype=np.object_), options.simplify_mm)
    saved = shapely.get_num_coordinates(polygons).sum() - shapely.get_num_coordinates(plain).sum()
    changes.add("corners_left_out", int(saved))
    return [part for part in plain if isinstance(part, Polygon) and part.area > 0.0]


def _on_grid(polygons: list[Polygon], sliver_mm2: float, changes: Changes) -> list[Polygon]:
    """Return polygons rounded to the precision of files, without slivers and pinholes."""
    if not polygons:
        return []
    rounded = shapely.set_precision(polygons, _GRID_MM)
    parts = shapely.get_parts(rounded)
    large = shapely.area(parts) > sliver_mm2
    changes.add("slivers_dropped", int((~large).sum()))
    whole = shapely.get_num_interior_rings(parts) == 0
    kept = []
    for part, plain in zip(parts[large], whole[large], strict=True):
        if plain:
            kept.append(part)
            continue
        holes = [ring for ring in part.interiors if Polygon(ring).area > sliver_mm2]
        changes.add("pinholes_filled", len(part.interiors) - len(holes))
        kept.append(part if len(holes) == len(part.interiors) else Polygon(part.exterior, holes))
    return kept


def _free_regions(world: Map) -> list[Polygon]:
    # Ten times faster than Map.free_space for scattered obstacles.
    obstacles = np.array(world.obstacles, dtype=np.object_)
    if len(obstacles) > _MANY_OBSTACLES:
        shapely.prepare(world.bounds)
        if (
            not shapely.get_num_interior_rings(obstacles).any()
            and shapely.contains_properly(world.bounds, obstacles).all()
            and shapely.STRtree(obstacles).query(obstacles, predicate="intersects").shape[1]
            == len(obstacles)
        ):
            return [shapely.polygons(world.bounds.exterior, shapely.get_exterior_ring(obstacles))]
        # Corners lie on the grid already; geometries that remember it take six times as long.
        obstacles = shapely.set_precision(obstacles, 0.0)
    solid = shapely.disjoint_subset_union_all(obstacles)
    return polygons_of(shapely.difference(world.bounds, solid))


def _start(world: Map, options: AssembleOptions) -> tuple[Start, dict[str, object]]:
    regions = _free_regions(world)
    if not regions:
        raise UnfitInputError(
            "", "obstacles leave no free space", "check which outlines are obstacles"
        )
    areas = [region.area for region in regions]
    facts: dict[str, object] = {}
    if len(regions) > 1:
        facts = {
            "free_regions": len(regions),
            "largest_free_region_share": round(max(areas) / math.fsum(areas), 4),
        }
        kept = int(np.argmax(areas))
        if options.start is not None:
            spot = shapely.points(options.start.x_mm, options.start.y_mm)
            kept = int(np.argmax(shapely.intersects(regions, spot)))
        rest = [region for index, region in enumerate(regions) if index != kept]
        inner = shapely.point_on_surface(max(rest, key=lambda region: region.area))
        other = "--drawn free reads the areas as the free space"
        mm2 = math.fsum(areas) - areas[kept]
        facts |= free_apart(mm2, (inner.x, inner.y), in_map=True, other=other)
    least_clearance_mm = 2e-3
    if options.start is None:
        largest = regions[int(np.argmax(areas))]
        radius = shapely.maximum_inscribed_circle(largest, max(1e-3 * max(world.size_mm), 1e-3))
        if radius.length < least_clearance_mm:
            problem = f"the free space is {2.0 * radius.length:.2g} mm wide: no room for a start"
            raise UnfitInputError("", problem, "check the unit (--scale-mm-per-unit)")
        return roomiest_start(largest, radius), facts
    spot = shapely.points(options.start.x_mm, options.start.y_mm)
    if not shapely.intersects(regions, spot).any():
        place = f"({options.start.x_mm:g}, {options.start.y_mm:g}) mm"
        problem = f"{place} lies outside of the free space of the map"
        raise UnfitInputError("start", problem, "move it inside")
    return Start(pose=options.start), facts
