"""Starting places along the lower side of a map, as every generator offers them."""

import math
from typing import Protocol

import shapely
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.environments.ground import start_zone, upward_start
from vinefab.model.checked import number
from vinefab.model.map import Start


class StartRange(Protocol):
    """The options that say where robots start; every environment has them."""

    @property
    def start_clearance_mm(self) -> float:
        """Least distance from every possible starting position to walls."""

    @property
    def start_spread_x_mm(self) -> float:
        """Half-width of the range of positions along x."""

    @property
    def start_spread_y_mm(self) -> float:
        """Half-width of the range of positions along y."""

    @property
    def start_spread_heading_deg(self) -> float:
        """Half-width of the range of headings around straight up."""


def check_starts(
    options: StartRange, room_mm: tuple[float, float], count: int = 1, least_mm: float = 0.0
) -> None:
    """Raise BadInputError unless the ranges of the starts and their clearance have room.

    Parameters
    ----------
    options
        What is asked for.
    room_mm
        Width and height of where starts with their clearance must fit.
    count
        Starts side by side.
    least_mm
        Clearance, where that is more than the one asked for.
    """
    width_mm, height_mm = room_mm
    number("start_clearance_mm", options.start_clearance_mm, 0.0, width_mm, "mm")
    number("start_spread_x_mm", options.start_spread_x_mm, 0.0, width_mm, "mm")
    number("start_spread_y_mm", options.start_spread_y_mm, 0.0, height_mm, "mm")
    number("start_spread_heading_deg", options.start_spread_heading_deg, 0.0, 180.0, "deg")
    clear_mm = max(options.start_clearance_mm, least_mm)
    wide_mm = 2.0 * (options.start_spread_x_mm + clear_mm)
    high_mm = 2.0 * (options.start_spread_y_mm + clear_mm)
    if wide_mm > width_mm / count or high_mm > height_mm:
        allowed = (
            f"less, or smaller spreads or fewer starts: {count} places of {wide_mm:g} x "
            f"{high_mm:g} mm have no room side by side in {width_mm:g} x {height_mm:g} mm"
        )
        raise BadInputError("start_clearance_mm", options.start_clearance_mm, allowed)


def lower_starts(
    options: StartRange, width_mm: float, count: int = 1, least_mm: float = 0.0
) -> tuple[Start, ...]:
    """Return starts evenly spread along the lower side, launching straight up.

    Parameters
    ----------
    options
        Clearance and spreads.
    width_mm
        Length of the lower side, from the origin along +x.
    count
        How many; one stands in the middle.
    least_mm
        Clearance, where that is more than the one asked for.
    """
    spreads = (
        options.start_spread_x_mm,
        options.start_spread_y_mm,
        math.radians(options.start_spread_heading_deg),
    )
    y_mm = max(options.start_clearance_mm, least_mm) + options.start_spread_y_mm
    pitch_mm = width_mm / count
    return tuple(upward_start((index + 0.5) * pitch_mm, y_mm, spreads) for index in range(count))


def all_zones(starts: tuple[Start, ...]) -> BaseGeometry:
    """Return the positions that any of the starts allows."""
    return shapely.union_all([start_zone(start) for start in starts])
