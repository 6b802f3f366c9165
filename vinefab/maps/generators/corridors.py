"""The Corridors environment: a floor plan of halls, rooms and doors."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Annotated, NamedTuple

import numpy as np
import shapely
from annotated_types import Ge, Le, Unit
from pydantic import model_validator
from typing_extensions import Doc

from vinefab.core.errors import BadInputError
from vinefab.core.rng import child
from vinefab.core.validation import SMALLEST, number, positive
from vinefab.maps.generators.generated_map import (
    COORDINATE_DECIMALS,
    COORDINATE_GRID_MM,
    Length,
    Share,
    StartOptions,
    StartSpread,
    box,
    canonical,
    check_seed,
    generated_map,
)
from vinefab.model.map import Map, Start

_STREAM = 1601


class CorridorsOptions(StartOptions):
    """Options that instances of one Corridors environment share.

    The start is at the lower end of the first hall; without halls, in the middle of the lower side.
    """

    width_mm: Annotated[Length, Doc("width of the floor")] = 500.0
    height_mm: Annotated[Length, Doc("height of the floor")] = 500.0
    halls: Annotated[
        int,
        Ge(0),
        Le(100),
        Doc(
            "corridors: the first runs up from the lower side and begins at the start; each "
            "further one divides the largest part of the floor that is left; those that meet are "
            "open to each other"
        ),
    ] = 3
    hall_width_mm: Annotated[Length, Doc("width of the halls")] = 44.0
    room_min_mm: Annotated[Length, Doc("least width and depth of a room")] = 84.0
    room_max_mm: Annotated[
        float,
        Ge(SMALLEST),
        Le(2e6),
        Unit("mm"),
        Doc("wider or deeper rooms are divided, unless the start stands where the wall would be"),
    ] = 180.0
    wall_mm: Annotated[Length, Doc("thickness of the walls")] = 6.0
    door_mm: Annotated[
        Length, Doc("width of the doors, which keep `wall_mm` to the corners of the room")
    ] = 26.0
    loops: Annotated[
        Share,
        Doc(
            "share of the possible further doors that are open; without any, every room has just "
            "the doors that make all reachable: one to a hall where there is one next to it"
        ),
    ] = 0.15
    start_spread_x_mm: StartSpread = 5.0

    @model_validator(mode="after")
    def _fits(self) -> "CorridorsOptions":
        positive("wall_mm", self.wall_mm, self.width_mm)
        positive("door_mm", self.door_mm, self.width_mm)
        number("hall_width_mm", self.hall_width_mm, self.door_wall_mm, self.width_mm, "mm")
        # Half of any room's wall then has room for a door, see `doorways`.
        least_mm = 2.0 * self.door_wall_mm + self.wall_mm
        shorter_mm = min(self.width_mm, self.height_mm)
        number("room_min_mm", self.room_min_mm, least_mm, shorter_mm, "mm")
        least_mm = 2.0 * self.room_min_mm + self.wall_mm
        number("room_max_mm", self.room_max_mm, least_mm, 2e6, "mm")
        most_rooms = 2000
        if self.width_mm * self.height_mm > most_rooms * self.room_min_mm**2:
            least_mm = (self.width_mm * self.height_mm / most_rooms) ** 0.5
            raise BadInputError("room_min_mm", self.room_min_mm, f"at least {least_mm:.4g} mm")
        # Walls avoid the start, but a hall must be wide enough for it.
        wide_mm = self.hall_width_mm if self.halls > 0 else self.width_mm
        self.check_starts((wide_mm, self.height_mm), 0.5 * self.door_mm)
        return self

    @property
    def passage_mm(self) -> float:
        """Diameter of a round body that reaches every room: the width of doors, to 1e-4 mm."""
        return self.door_mm

    @property
    def door_wall_mm(self) -> float:
        """Length of wall that a door needs, with its distance to the corners."""
        return self.door_mm + 2.0 * self.wall_mm


class Region(NamedTuple):
    """An axis-parallel rectangle of the floor, without the walls around it.

    A hall through a region ends on the hall before it and does not run alongside it, so ``way``
    changes with every division.
    """

    x_min_mm: float
    y_min_mm: float
    x_max_mm: float
    y_max_mm: float
    hall: bool = False  # whether it is one
    way: int = 0  # axis along which a hall through it would run, 0: x, 1: y

    def span(self, axis: int) -> tuple[float, float]:
        """Return the smallest and the largest coordinate along an axis."""
        return self[axis], self[axis + 2]

    def length(self, axis: int) -> float:
        """Return the size along an axis, in mm."""
        low, high = self.span(axis)
        return high - low

    @property
    def area_mm2(self) -> float:
        """Width times height."""
        return self.length(0) * self.length(1)

    def part(self, axis: int, low: float, high: float) -> "Region":
        """Return the part between two coordinates along an axis."""
        if axis == 0:
            return self._replace(x_min_mm=low, x_max_mm=high)
        return self._replace(y_min_mm=low, y_max_mm=high)


def floor_plan(
    rng: np.random.Generator, options: CorridorsOptions, keep_out: Region | None = None
) -> list[Region]:
    """Return the halls and rooms of a floor; no wall stands in ``keep_out`` if it has no halls.

    Neighbours are exactly a wall apart; no two overlap. The first hall runs along y from side to
    side, every other one ends on an earlier one or at a side.
    """
    floor = Region(0.0, 0.0, options.width_mm, options.height_mm, way=1)
    plans = 50  # attempts at a plan in which the halls fit
    for _ in range(plans):
        parts = _with_halls(rng, floor, options)
        if parts is not None:
            return [room for part in parts for room in _rooms(rng, part, options, keep_out)]
    raise BadInputError("halls", options.halls, "fewer, so that rooms fit next to them")


def _with_halls(
    rng: np.random.Generator, floor: Region, options: CorridorsOptions
) -> list[Region] | None:
    parts = [floor]
    for _ in range(options.halls):
        parts.sort(key=lambda part: (part.hall, -part.area_mm2))
        for index, part in enumerate(parts):
            pieces = None if part.hall else _crossed(rng, part, options)
            if pieces is not None:
                parts[index : index + 1] = pieces
                break
        else:
            return None
    return parts


def _crossed(
    rng: np.random.Generator, part: Region, options: CorridorsOptions
) -> list[Region] | None:
    """Return the two parts next to a hall, and the hall; None if there is no room for it."""
    axis, wall_mm = 1 - part.way, options.wall_mm
    inner_mm = wall_mm + options.hall_width_mm
    at = _wall_place(rng, part, axis, options, inner_mm)
    if at is None:
        return None
    low, high = part.span(axis)
    turned = part._replace(way=axis)
    second = round(at + inner_mm, COORDINATE_DECIMALS)
    return [
        turned.part(axis, low, at),
        part.part(axis, round(at + wall_mm, COORDINATE_DECIMALS), second)._replace(hall=True),
        turned.part(axis, round(second + wall_mm, COORDINATE_DECIMALS), high),
    ]


def _rooms(
    rng: np.random.Generator, part: Region, options: CorridorsOptions, keep_out: Region | None
) -> list[Region]:
    if part.hall:
        return [part]
    for axis in sorted((0, 1), key=part.length, reverse=True):
        if part.length(axis) <= options.room_max_mm:
            continue
        at = _wall_place(rng, part, axis, options, keep_out=keep_out)
        if at is not None:
            low, high = part.span(axis)
            after = round(at + options.wall_mm, COORDINATE_DECIMALS)
            halves = (part.part(axis, low, at), part.part(axis, after, high))
            return [room for half in halves for room in _rooms(rng, half, options, keep_out)]
    return [part]


def _wall_place(
    rng: np.random.Generator,
    part: Region,
    axis: int,
    options: CorridorsOptions,
    second_mm: float = 0.0,
    keep_out: Region | None = None,
) -> float | None:
    """Draw where a wall across a part begins, or the first of two; None if there is no room."""
    low, high = part.span(axis)
    first = low + options.room_min_mm
    last = high - options.room_min_mm - options.wall_mm - second_mm
    pieces = [(first, last)]
    across = 1 - axis
    if keep_out is not None and min(part[across + 2], keep_out[across + 2]) > max(
        part[across], keep_out[across]
    ):
        # Without the open interval in which the wall would stand in the area.
        near, far = keep_out.span(axis)
        pieces = [(first, min(last, near - options.wall_mm)), (max(first, far), last)]
    pieces = [(start, end) for start, end in pieces if end >= start]
    lengths = np.array([end - start for start, end in pieces])
    if not pieces:
        return None
    place = rng.random() * lengths.sum()
    index = min(int(np.searchsorted(np.cumsum(lengths), place)), len(pieces) - 1)
    return round(pieces[index][0] + float(place - lengths[:index].sum()), COORDINATE_DECIMALS)


_SLACK_MM = 1e-3
"""Slack for rounded coordinates."""


class _Border(NamedTuple):
    """The wall between two regions: ``axis`` leads through it, ``low .. high`` along it."""

    one: int
    other: int
    axis: int
    low: float
    high: float
    halls: int


def doorways(
    rng: np.random.Generator, regions: Sequence[Region], options: CorridorsOptions
) -> list[Region]:
    """Return the openings in the walls: where halls meet, and doors.

    Halls that meet are open to each other. Doors connect all the rest, to halls where there is
    one and to other rooms where there is none, and then a share of the other neighbours. Between
    the two sides of any wall of a floor plan there is room for a door: a room's side is at least
    twice the length that a door needs, plus a wall, and at most one wall ends in its middle, or
    a whole hall or room lies against it.
    """
    borders = _borders(regions, options.wall_mm)
    open_wide = [border for border in borders if border.halls == 2]
    least_mm = options.door_mm + 2.0 * options.wall_mm - _SLACK_MM
    possible = [b for b in borders if b.halls < 2 and b.high - b.low >= least_mm]
    possible = [possible[index] for index in rng.permutation(len(possible))]
    possible.sort(key=lambda border: -border.halls)
    needed = _spanning(len(regions), open_wide, possible)
    taken = needed | (rng.random(len(possible)) < options.loops)
    doors = [border for border, take in zip(possible, taken, strict=True) if take]
    openings = [_opening(regions, border, border.low, border.high) for border in open_wide]
    for border in doors:
        low, high = border.low + options.wall_mm, border.high - options.wall_mm - options.door_mm
        begin = round(low + rng.random() * max(0.0, high - low), COORDINATE_DECIMALS)
        end = round(begin + options.door_mm, COORDINATE_DECIMALS)
        openings.append(_opening(regions, border, begin, end))
    return openings


def _borders(regions: Sequence[Region], wall_mm: float) -> list[_Border]:
    """Return the borders between regions that face each other a wall apart."""
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
    """Return the mask of the borders to open, the earliest first, to connect all regions."""
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


def _opening(regions: Sequence[Region], border: _Border, low: float, high: float) -> Region:
    through = regions[border.one].span(border.axis)[1], regions[border.other].span(border.axis)[0]
    if border.axis == 0:
        return Region(through[0], low, through[1], high)
    return Region(low, through[0], high, through[1])


def corridors_map(seed: int, options: CorridorsOptions | None = None) -> Map:
    """Generate one instance of a Corridors environment.

    The floor is divided into halls and rooms by straight walls; doors make all of them
    reachable. No connection between two rooms is narrower than a door. Every possible starting
    position has ``start_clearance_mm``, and at least half a door's width, to all walls.

    Examples
    --------
    >>> corridors_map(1).free_space.geom_type
    'Polygon'
    """
    options = options or CorridorsOptions()
    check_seed(seed)
    rng = child(seed, _STREAM)
    floor = entrance = Region(0.0, 0.0, options.width_mm, options.height_mm)
    keep_out = None
    if options.halls == 0:
        start, clear_mm = (
            _start(floor, options),
            max(options.start_clearance_mm, options.door_mm / 2),
        )
        x_mm, y_mm = start.spread_x_mm + clear_mm, start.spread_y_mm + clear_mm
        x, y = start.pose.x_mm, start.pose.y_mm
        keep_out = Region(x - x_mm, y - y_mm, x + x_mm, y + y_mm)
    regions = floor_plan(rng, options, keep_out)
    if options.halls > 0:
        # Robots start in the first hall: no other reaches from side to side along y; a room may.
        entrance = next(r for r in regions if r.hall and r.length(1) == options.height_mm)
    doors = doorways(rng, regions, options)
    bounds = box(options.width_mm, options.height_mm)
    boxes = shapely.box(*np.array([region[:4] for region in [*regions, *doors]]).T)
    # All coordinates are on this grid, where the difference is exact.
    open_floor = shapely.union_all(boxes, grid_size=COORDINATE_GRID_MM)
    return generated_map(
        "corridors",
        seed,
        options,
        bounds=bounds,
        obstacles=canonical(shapely.difference(bounds, open_floor, grid_size=COORDINATE_GRID_MM)),
        starts=(_start(entrance, options),),
        rooms=sum(not region.hall for region in regions),
    )


def _start(region: Region, options: CorridorsOptions) -> Start:
    (start,) = options.lower_starts(region.length(0), 0.5 * options.door_mm)
    x_mm = round(start.pose.x_mm + region.x_min_mm, COORDINATE_DECIMALS)
    return replace(start, pose=replace(start.pose, x_mm=x_mm))
