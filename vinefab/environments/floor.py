"""A floor divided into halls and rooms: rectangles with straight walls between them."""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.environments.ground import DECIMALS

_PLANS = 50
"""How often a plan is begun anew when the halls did not fit."""


class Region(NamedTuple):
    """An axis-parallel rectangle of the floor, without the walls around it.

    ``hall`` says that it is one; ``way`` is the axis (0: x, 1: y) along which a hall through it
    would run, so that halls end on the one before and do not run beside it.
    """

    x_min_mm: float
    y_min_mm: float
    x_max_mm: float
    y_max_mm: float
    hall: bool = False
    way: int = 0

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


@dataclass(frozen=True, slots=True, kw_only=True)
class FloorLimits:
    """What walls have to respect.

    Parameters
    ----------
    hall_mm
        Width of halls.
    room_min_mm
        Least width and depth of rooms.
    room_max_mm
        Longer rooms are divided where that is possible; at least twice ``room_min_mm`` and a wall.
    wall_mm
        Thickness of walls.
    keep_out
        No wall may stand in it, if there is one.
    """

    hall_mm: float
    room_min_mm: float
    room_max_mm: float
    wall_mm: float
    keep_out: Region | None = None


def floor_plan(
    rng: np.random.Generator, floor: Region, halls: int, limits: FloorLimits
) -> list[Region]:
    """Return the halls and rooms of a floor.

    Neighbours are exactly a wall apart; no two overlap. The first hall runs along y from side to
    side, every other one ends on an earlier one or at a side.

    Raises
    ------
    BadInputError
        If the halls do not fit.
    """
    for _ in range(_PLANS):
        parts = _with_halls(rng, floor._replace(way=1), halls, limits)
        if parts is not None:
            return [room for part in parts for room in _rooms(rng, part, limits)]
    raise BadInputError("halls", halls, "so few that rooms fit beside them")


def _with_halls(
    rng: np.random.Generator, floor: Region, halls: int, limits: FloorLimits
) -> list[Region] | None:
    parts = [floor]
    for _ in range(halls):
        parts.sort(key=lambda part: (part.hall, -part.area_mm2))
        for index, part in enumerate(parts):
            pieces = None if part.hall else _crossed(rng, part, limits)
            if pieces is not None:
                parts[index : index + 1] = pieces
                break
        else:
            return None
    return parts


def _crossed(rng: np.random.Generator, part: Region, limits: FloorLimits) -> list[Region] | None:
    """Return a part divided by a hall into two, and the hall; None where there is no room."""
    axis, wall_mm = 1 - part.way, limits.wall_mm
    inner_mm = wall_mm + limits.hall_mm
    # Two walls may stand where there is no keep-out for either.
    at = _wall_place(rng, part, axis, (0.0, inner_mm), limits)
    if at is None:
        return None
    low, high = part.span(axis)
    turned = part._replace(way=axis)
    second = round(at + inner_mm, DECIMALS)
    return [
        turned.part(axis, low, at),
        part.part(axis, round(at + wall_mm, DECIMALS), second)._replace(hall=True),
        turned.part(axis, round(second + wall_mm, DECIMALS), high),
    ]


def _rooms(rng: np.random.Generator, part: Region, limits: FloorLimits) -> list[Region]:
    if part.hall:
        return [part]
    for axis in sorted((0, 1), key=part.length, reverse=True):
        if part.length(axis) <= limits.room_max_mm:
            continue
        at = _wall_place(rng, part, axis, (0.0,), limits)
        if at is not None:
            low, high = part.span(axis)
            after = round(at + limits.wall_mm, DECIMALS)
            halves = (part.part(axis, low, at), part.part(axis, after, high))
            return [room for half in halves for room in _rooms(rng, half, limits)]
    return [part]


def _wall_place(
    rng: np.random.Generator,
    part: Region,
    axis: int,
    walls_at_mm: tuple[float, ...],
    limits: FloorLimits,
) -> float | None:
    """Draw where the first of some walls across a part begins; None if nowhere is room.

    Parameters
    ----------
    rng
        Draws the place, evenly over all that are possible.
    part
        What the walls divide.
    axis
        The axis that they cross.
    walls_at_mm
        Where each wall begins, from the first.
    limits
        Thickness, keep-out and the least room at both ends.
    """
    low, high = part.span(axis)
    first = low + limits.room_min_mm
    last = high - limits.room_min_mm - limits.wall_mm - walls_at_mm[-1]
    pieces = [(first, last)]
    across = 1 - axis
    area = limits.keep_out
    if area is not None and _overlap(part.span(across), area.span(across)) > 0.0:
        near, far = area.span(axis)
        for begin in walls_at_mm:
            pieces = _without(pieces, near - begin - limits.wall_mm, far - begin)
    pieces = [(start, end) for start, end in pieces if end >= start]
    lengths = np.array([end - start for start, end in pieces])
    if not pieces:
        return None
    place = rng.random() * lengths.sum()
    index = min(int(np.searchsorted(np.cumsum(lengths), place)), len(pieces) - 1)
    return round(pieces[index][0] + float(place - lengths[:index].sum()), DECIMALS)


def _without(
    pieces: list[tuple[float, float]], low: float, high: float
) -> list[tuple[float, float]]:
    """Return pieces of a line without what lies strictly between two places."""
    before = [(start, min(end, low)) for start, end in pieces]
    after = [(max(start, high), end) for start, end in pieces]
    return [piece for piece in (*before, *after) if piece[1] >= piece[0]]


def _overlap(one: tuple[float, float], other: tuple[float, float]) -> float:
    return min(one[1], other[1]) - max(one[0], other[0])
