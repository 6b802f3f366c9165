"""What can be said of a map before anything grows on it: size, passages, room for bodies.

Everything here is computed from the map alone. A body that fits is one that would fit if it were
led; whether growth leads it there is for `vinefab grow`.
"""

import math
from dataclasses import dataclass

import shapely
from shapely import Point, STRtree
from shapely.geometry.base import BaseGeometry

from vinefab.environments.passages import Passage, narrow_passages
from vinefab.growth.terrain import Terrain
from vinefab.model.checked import positive, whole
from vinefab.model.map import Map
from vinefab.pipeline.mapinfo_room import Body, StartRoom, body_room, start_room, widest_bodies


@dataclass(frozen=True, slots=True, kw_only=True)
class Gate:
    """A narrow passage of a map.

    Parameters
    ----------
    passage
        Where it is and how wide.
    between
        What stands on either side: ``bounds`` or ``obstacle N``, counted from 1 as in the file.
    """

    passage: Passage
    between: tuple[str, str]

    @property
    def body_mm(self) -> float:
        """Lay-flat width of the widest body that fits through, pi/2 times the passage's width."""
        return 0.5 * math.pi * self.passage.width_mm


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MapInfo:
    """Numbers about a map, all computed.

    Parameters
    ----------
    world
        The map.
    free
        Its free space, as growth sees it.
    gates
        The narrowest passages, the narrowest first.
    starts
        Its starts and the room there.
    widest_mm
        Lay-flat width of the widest body that can sweep each share of the free area from the
        first start, to about 1 %; None where no body can.
    body
        How far a body of the width asked for could get; None when none was asked for.
    """

    world: Map
    free: BaseGeometry
    gates: tuple[Gate, ...]
    starts: tuple[StartRoom, ...]
    widest_mm: dict[float, float | None]
    body: Body | None

    @property
    def regions_mm2(self) -> tuple[float, ...]:
        """Areas of the parts of the free space, the largest first."""
        areas = (part.area for part in shapely.get_parts(self.free) if not part.is_empty)
        return tuple(sorted(areas, reverse=True))

    @property
    def free_share(self) -> float:
        """Free area over that of the bounds."""
        return float(self.free.area / self.world.bounds.area)

    def picture(self, suffix: str) -> bytes:
        """Return a plan with the passages, as SVG, or PNG for the suffix ``.png``."""
        # matplotlib takes longer to load than all of this to compute.
        from vinefab.report.figure import png_bytes, svg_bytes  # noqa: PLC0415
        from vinefab.report.mapinfo_plan import passage_plan  # noqa: PLC0415

        figure = passage_plan(
            self.world,
            [gate.passage for gate in self.gates],
            [room.clearance_mm for room in self.starts],
            None if self.body is None else (self.body.width_mm, self.body.region),
        )
        return png_bytes(figure) if suffix.lower() == ".png" else svg_bytes(figure)


def map_info(world: Map, *, width_mm: float | None = None, passages: int = 5) -> MapInfo:
    """Return numbers about a map.

    Parameters
    ----------
    world
        The map.
    width_mm
        Lay-flat width of a body to look at more closely.
    passages
        How many of the narrowest passages to find.

    Raises
    ------
    BadInputError
        If a number is out of range.
    """
    if width_mm is not None:
        positive("--width-mm", width_mm)
    whole("--passages", passages, 0, 1000)
    free = Terrain.of(world).free_space()
    starts = tuple(start_room(free, start.pose) for start in world.starts)
    return MapInfo(
        world=world,
        free=free,
        gates=_gates(world, narrow_passages(free, passages)),
        starts=starts,
        widest_mm=widest_bodies(free, starts),
        body=None if width_mm is None else body_room(free, starts, width_mm),
    )


def _gates(world: Map, passages: tuple[Passage, ...]) -> tuple[Gate, ...]:
    walls = STRtree([world.bounds.boundary, *world.obstacles])
    names = ["bounds", *(f"obstacle {number + 1}" for number in range(len(world.obstacles)))]
    gates = []
    for passage in passages:
        # Where obstacles touch, the one that stands first in the file is named.
        first, last = (min(walls.query_nearest(Point(end))) for end in passage.ends_mm)
        gates.append(Gate(passage=passage, between=(names[first], names[last])))
    return tuple(gates)
