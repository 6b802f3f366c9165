"""Rings out of lines that cross, overshoot or stop just short of each other."""

from dataclasses import dataclass

import numpy as np
import shapely
from scipy.spatial import cKDTree
from shapely import LineString, Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.environments.chains import Line, chained, loose_ends
from vinefab.environments.repair import polygons_of
from vinefab.environments.shapes import Changes
from vinefab.model.checked import Floats

_BEYOND = 1e-3
_MOST_NAMED = 5


@dataclass(frozen=True, slots=True, kw_only=True)
class Joined:
    """What became of loose lines.

    Parameters
    ----------
    rings
        Closed lines.
    open
        Lines that enclose nothing.
    """

    rings: list[Line]
    open: list[Line]


def join(lines: list[Line], join_mm: float, changes: Changes) -> Joined:
    """Join loose lines into rings.

    Lines are chained end to end (see `chained`). What is still open then is cut at its crossings:
    ends that stop just short of a line are led onto it, pieces that reach beyond a crossing are
    trimmed, and what is enclosed gives the rings.

    Parameters
    ----------
    lines
        In any order and direction.
    join_mm
        The widest gap that is closed and the longest overshoot that is trimmed.
    changes
        Where they are counted.
    """
    chains = chained(lines, join_mm, changes)
    rings = [line for line in chains if line.closed]
    rest = [line for line in chains if not line.closed]
    if len(rest) == 0:
        return Joined(rings=rings, open=[])
    more, left = _cut_at_crossings(rest, join_mm, changes)
    return Joined(rings=rings + more, open=left)


def _cut_at_crossings(
    lines: list[Line], join_mm: float, changes: Changes
) -> tuple[list[Line], list[Line]]:
    reached = _led_onto_lines(lines, join_mm, changes)
    noded = shapely.union_all([LineString(line.points_mm) for line in reached])
    faces, cuts, dangles, _ = shapely.polygonize_full(shapely.get_parts(noded))
    parts = shapely.get_parts(shapely.line_merge(shapely.union_all(np.array([cuts, dangles]))))
    long = shapely.length(parts) > join_mm * (1.0 + 2.0 * _BEYOND)
    trimmed = [part for part in parts[~long] if part.length > 2.0 * _BEYOND * join_mm]
    changes.add("overshoots_trimmed", len(trimmed))
    tree = shapely.STRtree([LineString(line.points_mm) for line in lines])

    def named(points: Floats) -> Line:
        nearest = tree.nearest(shapely.points(points[:2].mean(axis=0)))
        return Line(points_mm=points, where=lines[int(nearest)].where)

    rings = [
        named(shapely.get_coordinates(ring))
        for face in shapely.get_parts(faces)
        for ring in shapely.get_rings(face)
    ]
    return rings, [named(shapely.get_coordinates(part)) for part in parts[long]]


def _led_onto_lines(lines: list[Line], join_mm: float, changes: Changes) -> list[Line]:
    """Return lines whose loose ends were led onto the nearest line, and a hair beyond it."""
    strings = np.array([LineString(line.points_mm) for line in lines])
    tree = shapely.STRtree(strings)
    points = [line.points_mm for line in lines]
    for end in loose_ends(lines):
        own, last = end // 2, end % 2 == 1
        spot = lines[own].points_mm[-1 if last else 0]
        near = tree.query(shapely.points(spot), predicate="dwithin", distance=join_mm)
        near = near[near != own]
        if len(near) == 0:
            continue
        target = strings[near[np.argmin(shapely.distance(strings[near], shapely.points(spot)))]]
        onto = shapely.get_coordinates(shapely.shortest_line(shapely.points(spot), target))[1]
        gap_mm = float(np.hypot(*(onto - spot)))
        # A point computed on a line is beside it in the last bit; going on crosses it for sure.
        ahead = (onto - spot) / gap_mm if gap_mm else _direction(lines[own].points_mm, last=last)
        beyond = onto + _BEYOND * join_mm * ahead
        points[own] = np.insert(points[own], len(points[own]) if last else 0, beyond, axis=0)
        changes.add("ends_led_onto_lines")
        changes.most("largest_gap_joined_mm", gap_mm)
    return [Line(points_mm=new, where=line.where) for new, line in zip(points, lines, strict=True)]


def _direction(points: Floats, *, last: bool) -> Floats:
    along = points[-1] - points[-2] if last else points[0] - points[1]
    return np.asarray(along / max(float(np.hypot(*along)), 1e-300))


def refuse_open(lines: list[Line], join_mm: float, changes: Changes) -> BadInputError:
    """Return the error that says which lines are open, where, and what can be done."""
    count = len(lines)
    named = "; ".join(open_places(lines[:_MOST_NAMED], changes))
    more = f"; and {count - _MOST_NAMED} more" if count > _MOST_NAMED else ""
    gap_mm = widest_gap(lines)
    return BadInputError(
        f"{'an open line' if count == 1 else f'{count} open lines'}: {named}{more}",
        "not closed",
        f"outlines whose ends meet within --join-mm ({join_mm:.4g}; here {gap_mm:.4g} would do); "
        "or --wall-mm W to make lines walls, or --open drop to leave them out",
    )


def widest_gap(lines: list[Line]) -> float:
    """Return the largest distance from an end to the nearest other one, mm."""
    ends = np.array([line.points_mm[[0, -1]] for line in lines]).reshape(-1, 2)
    return float(np.max(cKDTree(ends).query(ends, k=[2])[0]))


def open_places(lines: list[Line], changes: Changes) -> list[str]:
    """Return for each line what it is and where its ends are."""
    return [
        f"{line.where} from {changes.frame.place(line.points_mm[0])} "
        f"to {changes.frame.place(line.points_mm[-1])}"
        for line in lines
    ]


def walls_along(
    lines: list[Line], wall_mm: float, join_mm: float, changes: Changes
) -> list[Polygon]:
    """Return lines as walls of some thickness; walls that meet are one polygon.

    Walls end flat where a line ends; where three or more meet they fill the corner.

    Parameters
    ----------
    lines
        The middle lines of the walls.
    wall_mm
        Thickness.
    join_mm
        The widest gap between ends that is closed.
    changes
        Where it is counted.
    """
    chains = chained(lines, join_mm, changes)
    meeting = _ends_at_corners(chains)
    walls: list[BaseGeometry] = []
    for index, line in enumerate(chains):
        points = _lengthened(line.points_mm, 0.5 * wall_mm, meeting[2 * index : 2 * index + 2])
        middle = shapely.LinearRing(points) if line.closed else LineString(points)
        wall = shapely.buffer(middle, 0.5 * wall_mm, cap_style="flat", join_style="mitre")
        walls.append(wall)
    changes.add("lines_made_walls", len(chains))
    return polygons_of(shapely.union_all(walls))


def _ends_at_corners(chains: list[Line]) -> list[bool]:
    loose = set(loose_ends(chains))
    return [end not in loose and not chains[end // 2].closed for end in range(2 * len(chains))]


def _lengthened(points: Floats, by_mm: float, ends: list[bool]) -> Floats:
    points = points.copy()
    if ends[0]:
        points[0] = points[0] + by_mm * _direction(points, last=False)
    if ends[1]:
        points[-1] = points[-1] + by_mm * _direction(points, last=True)
    return points
