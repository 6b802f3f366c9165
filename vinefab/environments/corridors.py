"""The Corridors environment: a floor plan of halls, rooms and doors."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.rng import child
from vinefab.environments.doors import DoorRules, doorways, walls_between
from vinefab.environments.floor import FloorLimits, Region, floor_plan
from vinefab.environments.ground import DECIMALS, box
from vinefab.environments.starts import check_starts, lower_starts
from vinefab.model.checked import number, positive, whole
from vinefab.model.map import Map, Start

_STREAM = 1601
_MOST_ROOMS = 2000


@dataclass(frozen=True, slots=True, kw_only=True)
class CorridorsOptions:
    """What instances of one Corridors environment have in common.

    Parameters
    ----------
    width_mm, height_mm
        Size of the floor.
    halls
        Corridors. The first runs up from the lower side and begins at the start; each further one
        divides the largest part of the floor that is left. Halls that meet are open to each other.
    hall_width_mm
        Width of the halls.
    room_min_mm
        Least width and depth of a room.
    room_max_mm
        Wider or deeper rooms are divided, unless the start stands where the wall would be.
    wall_mm
        Thickness of the walls.
    door_mm
        Width of the doors. A door keeps ``wall_mm`` to the corners of the room.
    loops
        Share, 0 to 1, of the possible further doors that are open. Without any, every room has
        just the doors that make all reachable: one to a hall where there is one beside it.
    start_clearance_mm
        Least distance from every possible starting position to walls. The start is at the lower
        end of the first hall; without halls, in the middle of the lower side.
    start_spread_x_mm, start_spread_y_mm, start_spread_heading_deg
        Half-widths of the ranges from which poses are drawn; the middle heading is straight up.

    Raises
    ------
    BadInputError
        If a value is out of range, or doors do not fit in the rooms' walls.
    """

    width_mm: float = 500.0
    height_mm: float = 500.0
    halls: int = 3
    hall_width_mm: float = 44.0
    room_min_mm: float = 84.0
    room_max_mm: float = 180.0
    wall_mm: float = 6.0
    door_mm: float = 26.0
    loops: float = 0.15
    start_clearance_mm: float = 15.0
    start_spread_x_mm: float = 5.0
    start_spread_y_mm: float = 0.0
    start_spread_heading_deg: float = 30.0

    def __post_init__(self) -> None:
        positive("width_mm", self.width_mm, 1e6)
        positive("height_mm", self.height_mm, 1e6)
        whole("halls", self.halls, 0, 100)
        positive("wall_mm", self.wall_mm, self.width_mm)
        positive("door_mm", self.door_mm, self.width_mm)
        number("loops", self.loops, 0.0, 1.0)
        number("hall_width_mm", self.hall_width_mm, self.door_wall_mm, self.width_mm, "mm")
        # So that half of any room's wall has room for a door: see `doorways`.
        least_mm = 2.0 * self.door_wall_mm + self.wall_mm
        shorter_mm = min(self.width_mm, self.height_mm)
        number("room_min_mm", self.room_min_mm, least_mm, shorter_mm, "mm")
        least_mm = 2.0 * self.room_min_mm + self.wall_mm
        number("room_max_mm", self.room_max_mm, least_mm, 2e6, "mm")
        if self.width_mm * self.height_mm > _MOST_ROOMS * self.room_min_mm**2:
            least_mm = (self.width_mm * self.height_mm / _MOST_ROOMS) ** 0.5
            raise BadInputError("room_min_mm", self.room_min_mm, f"at least {least_mm:.4g} mm")
        # Walls may go where the start is not, but a hall has to be wide enough for it.
        wide_mm = self.hall_width_mm if self.halls > 0 else self.width_mm
        check_starts(self, (wide_mm, self.height_mm), 1, 0.5 * self.door_mm)

    @property
    def passage_mm(self) -> float:
        """Width of a round body that gets into every room: that of the doors, to 1e-4 mm."""
        return self.door_mm

    @property
    def door_wall_mm(self) -> float:
        """Length of wall that a door needs, with what it keeps to the corners."""
        return self.door_mm + 2.0 * self.wall_mm


def corridors_map(seed: int, options: CorridorsOptions | None = None) -> Map:
    """Make one instance of a Corridors environment.

    The floor is divided into halls and rooms by straight walls; doors make all of them
    reachable. No way between two rooms is narrower than a door. Every possible starting position
    has ``start_clearance_mm``, and at least half a door's width, to all walls.

    Parameters
    ----------
    seed
        At least 0; the same seed and options give the same map on any machine.
    options
        What to make; the defaults when None.

    Returns
    -------
    Map
        ``environment`` is ``corridors``; ``facts`` hold the options and the number of rooms.

    Raises
    ------
    BadInputError
        If the halls do not fit.

    Examples
    --------
    >>> corridors_map(1).free_space.geom_type
    'Polygon'
    """
    options = options or CorridorsOptions()
    whole("seed", seed, 0, 2**63 - 1)
    rng = child(seed, _STREAM)
    regions = _regions(rng, options)
    doors = doorways(rng, regions, DoorRules(options.wall_mm, options.door_mm, options.loops))
    bounds = box(options.width_mm, options.height_mm)
    return Map(
        name=f"corridors_{seed}",
        bounds=bounds,
        obstacles=walls_between(bounds, [*regions, *doors]),
        starts=(_start(_entrance(regions, options), options),),
        environment="corridors",
        seed=seed,
        facts={**asdict(options), "rooms": sum(not region.hall for region in regions)},
    )


def _regions(rng: np.random.Generator, options: CorridorsOptions) -> list[Region]:
    floor = Region(0.0, 0.0, options.width_mm, options.height_mm)
    limits = FloorLimits(
        hall_mm=options.hall_width_mm,
        room_min_mm=options.room_min_mm,
        room_max_mm=options.room_max_mm,
        wall_mm=options.wall_mm,
        keep_out=None if options.halls > 0 else _around(_start(floor, options), options),
    )
    return floor_plan(rng, floor, options.halls, limits)


def _entrance(regions: Sequence[Region], options: CorridorsOptions) -> Region:
    """Return the region at whose lower end robots start: the first hall, or the whole floor."""
    if options.halls == 0:
        return Region(0.0, 0.0, options.width_mm, options.height_mm)
    # No other hall reaches from side to side along y; a room may.
    return next(r for r in regions if r.hall and r.length(1) == options.height_mm)


def _start(region: Region, options: CorridorsOptions) -> Start:
    (start,) = lower_starts(options, region.length(0), 1, 0.5 * options.door_mm)
    x_mm = round(start.pose.x_mm + region.x_min_mm, DECIMALS)
    return replace(start, pose=replace(start.pose, x_mm=x_mm))


def _around(start: Start, options: CorridorsOptions) -> Region:
    clear_mm = max(options.start_clearance_mm, 0.5 * options.door_mm)
    half_x_mm, half_y_mm = start.spread_x_mm + clear_mm, start.spread_y_mm + clear_mm
    x_mm, y_mm = start.pose.x_mm, start.pose.y_mm
    return Region(x_mm - half_x_mm, y_mm - half_y_mm, x_mm + half_x_mm, y_mm + half_y_mm)
