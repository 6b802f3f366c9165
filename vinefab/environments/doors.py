"""Doors that make every room of a floor plan reachable, and the walls that are left."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import shapely
from shapely import Polygon

from vinefab.environments.floor import Region
from vinefab.environments.ground import DECIMALS, canonical

_SLACK_MM = 1e-3
"""Coordinates are rounded; a wall that is meant to be long enough is."""


@dataclass(frozen=True, slots=True)
class DoorRules:
    """How doors are made.

    Parameters
    ----------
    wall_mm
        Thickness of walls, and what a door keeps to the corners of a room.
    door_mm
        Width.
    loops
        Share, 0 to 1, of the doors that are not needed but open.
    """

    wall_mm: float
    door_mm: float
    loops: float


class _Border(NamedTuple):
    """The wall between two regions: ``axis`` leads through it, ``low .. high`` along it."""

    one: int
    other: int
    axis: int
    low: float
    high: float
    halls: int


def doorways(rng: np.random.Generator, regions: Sequence[Region], rules: DoorRules) -> list[Region]:
    """Return the openings in the walls: where halls meet, and doors.

    Halls that meet are open to each other. Doors connect all the rest, to halls where there is
    one and to other rooms where there is none, and then a share of the other neighbours. Between
    the two sides of any wall of a floor plan there is room for a door: a room's side is at least
    twice the length that a door needs, plus a wall, and at most one wall ends in its middle, or
    a whole hall or room lies against it.
    """
    borders = _borders(regions, rules.wall_mm)
    open_wide = [border for border in borders if border.halls == 2]
    least_mm = rules.door_mm + 2.0 * rules.wall_mm - _SLACK_MM
    possible = [b for b in borders if b.halls < 2 and b.high - b.low >= least_mm]
    possible = [possible[index] for index in rng.permutation(len(possible))]
    possible.sort(key=lambda border: -border.halls)
    needed = _spanning(len(regions), open_wide, possible)
    taken = needed | (rng.random(len(possible)) < rules.loops)
    doors = [border for border, take in zip(possible, taken, strict=True) if take]
    return [_opening(regions, border, border.low, border.high) for border in open_wide] + [
        _door(rng, regions, border, rules) for border in doors
    ]


def _borders(regions: Sequence[Region], wall_mm: float) -> list[_Border]:
    """Return the borders of all neighbours: regions that face each other a wall apart."""
    sides = np.array([region[:4] for region in regions])
    halls = [region.hall for region in regions]
    borders = []
    for axis in (0, 1):
        low, high = sides[:, axis], sides[:, axis + 2]
        along_low = np.maximum(sides[:, None, 1 - axis], sides[None, :, 1 - axis])
        along_high = np.minimum(sides[:, None, 3 - axis], sides[None, :, 3 - axis])
        facing = (np.abs(low[None, :] - high[:, None] - wall_mm) < _SLACK_MM) & (
            along_high > along_low
        )
        for one, other in np.argwhere(facing).tolist():
            between = float(along_low[one, other]), float(along_high[one, other])
            borders.append(_Border(one, other, axis, *between, halls[one] + halls[other]))
    return borders


def _spanning(
    count: int, joined: Sequence[_Border], borders: Sequence[_Border]
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return which borders to open, the earliest that will do, so that all are connected."""
    group = list(range(count))

    def root(index: int) -> int:
        while group[index] != index:
            group[index] = group[group[index]]
            index = group[index]
        return index

    for border in joined:
        group[root(border.one)] = root(border.other)
    needed = np.zeros(len(borders), dtype=np.bool_)
    for index, border in enumerate(borders):
        one, other = root(border.one), root(border.other)
        needed[index] = one != other
        group[one] = other
    return needed


def _door(
    rng: np.random.Generator, regions: Sequence[Region], border: _Border, rules: DoorRules
) -> Region:
    low, high = border.low + rules.wall_mm, border.high - rules.wall_mm - rules.door_mm
    begin = round(low + rng.random() * max(0.0, high - low), DECIMALS)
    return _opening(regions, border, begin, round(begin + rules.door_mm, DECIMALS))


def _opening(regions: Sequence[Region], border: _Border, low: float, high: float) -> Region:
    through = regions[border.one].span(border.axis)[1], regions[border.other].span(border.axis)[0]
    if border.axis == 0:
        return Region(through[0], low, through[1], high)
    return Region(low, through[0], high, through[1])


def walls_between(bounds: Polygon, free: Sequence[Region]) -> tuple[Polygon, ...]:
    """Return what is left of the bounds without some free regions.

    All coordinates are on the grid of `DECIMALS`, where the result is exact.
    """
    boxes = shapely.box(*np.array([region[:4] for region in free]).T)
    grid_mm = 10.0**-DECIMALS
    open_floor = shapely.union_all(boxes, grid_size=grid_mm)
    return canonical(shapely.difference(bounds, open_floor, grid_size=grid_mm))
