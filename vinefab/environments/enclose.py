"""Which outline of a drawing is the bounds, and what lies in it."""

from dataclasses import dataclass

import numpy as np
import shapely
from shapely import Polygon

from vinefab.core.errors import BadInputError
from vinefab.environments.nesting import merged, repeats, solids
from vinefab.environments.repair import polygons_of
from vinefab.environments.shapes import Changes, Role


@dataclass(frozen=True, slots=True, kw_only=True)
class Solid:
    """A closed part of a drawing.

    Parameters
    ----------
    polygon
        Without holes unless filled.
    where
        What messages call it.
    role
        What the source says that it is.
    filled
        Whether its inside is solid, whatever it lies in.
    wall
        Whether it was made of a line.
    """

    polygon: Polygon
    where: str
    role: Role | None = None
    filled: bool = False
    wall: bool = False

    @property
    def shell(self) -> Polygon:
        """What its outer ring encloses."""
        return Polygon(self.polygon.exterior)


@dataclass(frozen=True, slots=True, kw_only=True)
class Enclosed:
    """The geometry of a map.

    Parameters
    ----------
    bounds
        Without holes.
    obstacles
        None overlaps another.
    how
        In words, which bounds were chosen.
    """

    bounds: Polygon
    obstacles: list[Polygon]
    how: str


def enclose(
    parts: list[Solid], mode: str, margin_mm: float, join_mm: float, changes: Changes
) -> Enclosed:
    """Choose the bounds of a drawing and make the rest obstacles.

    Parameters
    ----------
    parts
        Everything closed.
    mode
        ``outline``, ``largest``, ``wall`` or ``box``: see `AssembleOptions`. Bounds that have
        their role from the source, and walls made of lines, go their own way.
    margin_mm
        Around the drawing when ``box``.
    join_mm
        Outlines so near to each other all along repeat each other; gaps up to this are closed.
    changes
        Where everything is counted.

    Raises
    ------
    BadInputError
        If parts lie outside of the bounds, or the source names several bounds.
    """
    parts = _without_repeats(parts, join_mm, changes)
    named = [part for part in parts if part.role == "bounds"]
    if len(named) > 1:
        raise BadInputError("bounds", f"{len(named)} outlines", "exactly one")
    if mode == "box" and not named:
        return _in_box(parts, margin_mm, join_mm, changes)
    outer = named[0] if named else max(parts, key=lambda part: float(part.shell.area))
    wall = not named and (mode == "wall" or outer.wall)
    rest = [part for part in parts if part is not outer]
    if named or mode == "largest":
        rest = _cut_off(outer.shell, rest, changes)
    else:
        rest = _inside(outer.shell, rest, join_mm, changes)
    rest += [outer] if wall else _holes_of(outer)
    obstacles = merged(_solid_polygons(rest, changes), join_mm, changes)
    return Enclosed(
        bounds=outer.shell,
        obstacles=_cut(obstacles, outer.shell, changes),
        how=_how(outer, wall=wall),
    )


def _how(outer: Solid, *, wall: bool) -> str:
    if outer.role == "bounds":
        return f"{outer.where}, which the source calls bounds"
    return f"{'the outer face of a wall' if wall else 'the largest outline'}, {outer.where}"


def _in_box(parts: list[Solid], margin_mm: float, join_mm: float, changes: Changes) -> Enclosed:
    x_min, y_min, x_max, y_max = shapely.total_bounds([part.polygon for part in parts])
    box = shapely.box(x_min - margin_mm, y_min - margin_mm, x_max + margin_mm, y_max + margin_mm)
    return Enclosed(
        bounds=box,
        obstacles=merged(_solid_polygons(parts, changes), join_mm, changes),
        how=f"a rectangle around everything, {margin_mm:.6g} mm beyond it",
    )


def _without_repeats(parts: list[Solid], join_mm: float, changes: Changes) -> list[Solid]:
    """Return parts without repeated ones; of an outline and a fill the fill stays."""
    filled = _different_fills([part for part in parts if part.filled], join_mm, changes)
    rings = [Polygon(ring) for part in filled for ring in shapely.get_rings(part.polygon)]
    outlines = [part for part in parts if not part.filled]
    all_rings = [*rings, *(part.polygon for part in outlines)]
    kept = repeats(all_rings, join_mm)[len(rings) :]
    changes.add("repeated_outlines_removed", int(kept.sum()))
    return filled + [part for part, again in zip(outlines, kept, strict=True) if not again]


def _different_fills(filled: list[Solid], join_mm: float, changes: Changes) -> list[Solid]:
    """Return fills without those that repeat another one, holes included."""
    again = repeats([part.shell for part in filled], join_mm)
    found: list[Solid] = []
    for part, alike in zip(filled, again, strict=True):
        if alike and any(_same(part.polygon, other.polygon, join_mm) for other in found):
            changes.add("repeated_outlines_removed")
        else:
            found.append(part)
    return found


def _same(one: Polygon, other: Polygon, join_mm: float) -> bool:
    return len(one.interiors) == len(other.interiors) and bool(
        shapely.hausdorff_distance(one.boundary, other.boundary) <= join_mm
    )


def _inside(shell: Polygon, rest: list[Solid], join_mm: float, changes: Changes) -> list[Solid]:
    """Return the parts that lie in the bounds.

    Raises
    ------
    BadInputError
        If one lies outside or reaches out by more than ``join_mm``.
    """
    shapely.prepare(shell)
    for part in rest:
        if shell.covers(part.polygon):
            continue
        beyond = shapely.difference(part.polygon, shell)
        corners = shapely.points(shapely.get_coordinates(beyond))
        if float(np.max(shapely.distance(corners, shell), initial=0.0)) <= join_mm:
            continue
        spot = shapely.get_coordinates(shapely.point_on_surface(beyond))[0]
        raise BadInputError(
            f"{part.where} at {changes.frame.place(spot)}",
            f"outside of the largest outline ({_box_text(shell, changes)})",
            "drawings whose largest outline contains all others; --layer to choose, "
            "--bounds largest to cut off what is outside, --bounds box to put a rectangle around",
        )
    return rest


def _cut_off(shell: Polygon, rest: list[Solid], changes: Changes) -> list[Solid]:
    """Return the parts that lie in the bounds or reach into them."""
    shapely.prepare(shell)
    inside = [part for part in rest if shapely.relate_pattern(shell, part.polygon, "T********")]
    changes.add("outlines_outside_left_out", len(rest) - len(inside))
    return inside


def _box_text(polygon: Polygon, changes: Changes) -> str:
    x_min, y_min, x_max, y_max = polygon.bounds
    return f"{changes.frame.place((x_min, y_min))} to {changes.frame.place((x_max, y_max))}"


def _holes_of(outer: Solid) -> list[Solid]:
    rings = outer.polygon.interiors
    return [Solid(polygon=Polygon(ring), where=outer.where) for ring in rings]


def _solid_polygons(parts: list[Solid], changes: Changes) -> list[Polygon]:
    """Return the solid matter of parts; it may still overlap."""
    given = [part.polygon for part in parts if part.filled or part.role == "obstacle"]
    nested = solids([part.polygon for part in parts if not (part.filled or part.role)], changes)
    return [*given, *nested]


def _cut(obstacles: list[Polygon], bounds: Polygon, changes: Changes) -> list[Polygon]:
    """Return obstacles without what reaches over the bounds."""
    if not obstacles:
        return []
    shapely.prepare(bounds)
    over = ~shapely.covers(bounds, obstacles)
    changes.add("obstacles_cut_at_bounds", int(over.sum()))
    result = [item for item, cut in zip(obstacles, over, strict=True) if not cut]
    for index in np.flatnonzero(over).tolist():
        result += polygons_of(shapely.intersection(obstacles[index], bounds))
    return result
