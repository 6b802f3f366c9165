"""Maps from drawings of other programs: close, repair, nest and enclose outlines."""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon

from vinefab.core.errors import BadInputError
from vinefab.core.validation import LARGEST_MM, Floats, number, positive
from vinefab.maps.cleanup.drawn_shapes import (
    Changes,
    DrawnShape,
    SourceFrame,
    as_areas,
    polygons_of,
    ring_polygons,
    without_repeats,
)
from vinefab.maps.cleanup.free_areas import enclosed_by, free_areas, plainly_free
from vinefab.maps.cleanup.joining import (
    Line,
    closing_gap_mm,
    join,
    open_places,
    refuse_open,
    walls_along,
)
from vinefab.maps.cleanup.nesting import (
    Enclosed,
    SolidRegion,
    contained,
    different_parts,
    enclose,
    painted,
)
from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.poses import roomiest_start
from vinefab.model.map import Map, Start

BOUNDS = ("outline", "largest", "wall", "box")
DRAWN = ("obstacles", "free")
_GRID_MM = 1e-6
_LEAST_CLEARANCE_MM = 2e-3
_MOST_NAMED = 20
_MANY_OBSTACLES = 2000
_LEAST_CONNECTED_SHARE = 0.5
"""Of drawn areas: what is less connected is not called free space, even as advice."""


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
                raise BadInputError(name, getattr(self, name), "nothing with --drawn free")
        if self.open_lines not in (None, "refuse", "drop"):
            raise BadInputError("open", self.open_lines, "refuse or drop")


def assemble(
    name: str,
    shapes: tuple[DrawnShape, ...],
    frame: SourceFrame,
    options: AssembleOptions,
    facts: Mapping[str, object],
    *,
    layered: bool = False,
) -> Map:
    """Return the map that a drawing shows.

    Loose lines are joined into outlines, self-crossing outlines repaired and duplicates removed.
    The outline that contains all others becomes the bounds, outlines in it become obstacles and
    outlines in those holes; overlapping obstacles are merged. Where the areas are the free space,
    their union is. What is ambiguous is refused with its position in the coordinates of the
    source.

    Parameters
    ----------
    layered
        Whether the source has layers to choose from.
    """
    changes = Changes(frame, layered=layered)
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
    advice = ""
    # Whether reading areas as obstacles must fail, and as free space may not.
    may_be_free = (
        options.drawn is None
        and options.wall_mm is None
        and options.bounds is None
        and all(part.role is None for part in parts)
        and not contained(parts, options.join_mm)
    )
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
        hangs_together = found.connected_share >= _LEAST_CONNECTED_SHARE
        if hangs_together and len(found.parts) < found.united:
            advice = ", --drawn free if the areas are the free space"
    return enclose(
        parts, options.bounds or "outline", options.margin_mm, options.join_mm, changes, advice
    )


def _regions(
    shapes: tuple[DrawnShape, ...], options: AssembleOptions, changes: Changes
) -> list[SolidRegion]:
    found = [*_filled(shapes, options, changes), *_outlines(shapes, options, changes)]
    if not found:
        dropped = changes.counts.get("slivers_dropped")
        value = f"no outlines but {dropped} without area" if dropped else "no outlines"
        raise BadInputError("drawing", value, "at least one closed outline")
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
        if shape.role is None and (options.wall_mm is not None or not encloses):
            loose.append(line)
        else:
            rings.append((line, shape))
    if options.wall_mm is not None:
        walls = walls_along(loose, options.wall_mm, options.join_mm, changes)
        return [
            SolidRegion(polygon=wall, where="a wall", filled=True, wall=True) for wall in walls
        ] + [found for line, shape in rings for found in _solid(line, shape, options, changes)]
    joined = join(loose, options.join_mm, changes)
    if joined.open and options.open_lines != "drop":
        closing_mm = closing_gap_mm(loose, joined.open, options.most_join_mm, changes)
        raise refuse_open(joined.open, options.join_mm, changes, closing_mm)
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
    """Return what a ring encloses, simplified if the options say so."""
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
        if _scattered(world.bounds, obstacles):
            return [shapely.polygons(world.bounds.exterior, shapely.get_exterior_ring(obstacles))]
        # Corners lie on the grid already; geometries that remember it take six times as long.
        obstacles = shapely.set_precision(obstacles, 0.0)
    solid = shapely.disjoint_subset_union_all(obstacles)
    return polygons_of(shapely.difference(world.bounds, solid))


def _scattered(bounds: Polygon, obstacles: NDArray[np.object_]) -> bool:
    """Return whether obstacles have no holes and touch neither each other nor the bounds."""
    if shapely.get_num_interior_rings(obstacles).any():
        return False
    shapely.prepare(bounds)
    if not shapely.contains_properly(bounds, obstacles).all():
        return False
    met = shapely.STRtree(obstacles).query(obstacles, predicate="intersects")
    return bool(met.shape[1] == len(obstacles))


def _start(world: Map, options: AssembleOptions) -> tuple[Start, dict[str, object]]:
    regions = _free_regions(world)
    if not regions:
        raise BadInputError("drawing", "no free space", "free space between the obstacles")
    areas = [region.area for region in regions]
    facts: dict[str, object] = {}
    if len(regions) > 1:
        facts = {
            "free_regions": len(regions),
            "largest_free_region_share": round(max(areas) / math.fsum(areas), 4),
        }
    if options.start is None:
        largest = regions[int(np.argmax(areas))]
        radius = shapely.maximum_inscribed_circle(largest, max(1e-3 * max(world.size_mm), 1e-3))
        if radius.length < _LEAST_CLEARANCE_MM:
            raise BadInputError(
                "drawing", f"free space {2.0 * radius.length:.2g} mm wide", "room for a start"
            )
        return roomiest_start(largest, radius), facts
    spot = shapely.points(options.start.x_mm, options.start.y_mm)
    if not shapely.intersects(regions, spot).any():
        place = f"({options.start.x_mm:g}, {options.start.y_mm:g}) mm"
        raise BadInputError("start", place, "a place in the free space of the map")
    return Start(pose=options.start), facts
