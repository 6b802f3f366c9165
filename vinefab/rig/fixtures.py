"""What stands around a rig: its corner markers, and the holder of the robot's base."""

from dataclasses import dataclass, field, replace

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.model.corner_marker import CornerMarker
from vinefab.model.design import Design
from vinefab.model.map import Map
from vinefab.rig.base_holder import BaseHolder, base_holder, table_to_map
from vinefab.rig.corner_tiles import (
    ARM_MM,
    BoardMarkers,
    MarkerPad,
    board_markers,
    marker_notes,
    marker_pads,
    marker_tiles,
)
from vinefab.rig.part import Rig, RigPart


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fixtures:
    """Markers and base holder of a rig."""

    pads: tuple[MarkerPad, ...] = ()
    base: BaseHolder | None = None
    board: BoardMarkers = field(default_factory=BoardMarkers)

    @property
    def markers(self) -> tuple[CornerMarker, ...]:
        """The corner markers, in map coordinates."""
        return tuple(pad.marker for pad in self.pads)


def with_fixtures(rig: Rig, world: Map, design: Design | None) -> tuple[Rig, Fixtures]:
    """Return a rig with markers and base holder among its extras and notes, and what they are."""
    plate = rig.on_plan(rig.plate)
    pads = marker_pads(world, plate, rig.printer, rig.options)
    taken = shapely.union_all([pad.outline for pad in pads])
    base, notes = base_holder(world, rig, design, taken)
    tiles = marker_tiles(pads, rig.printer, rig.options, table_to_map(world, rig))
    board = board_markers(pads, rig.options)
    fixtures = Fixtures(pads=pads, base=base, board=board)
    beside = tuple(_lowered(part, rig) for part in rig.extras) if pads else rig.extras
    whole = replace(
        rig,
        extras=(*beside, *tiles, *(base.parts if base else ())),
        notes=(*rig.notes, *marker_notes(pads, rig.printer, rig.options), *notes),
    )
    return whole, fixtures


def _lowered(part: RigPart, rig: Rig) -> RigPart:
    """Return what stands beside the rig's upper right corner moved down, below the tile there."""
    to_map = np.array(part.to_map)
    to_map[1, 3] -= (ARM_MM + 10.0) / rig.options.scale
    return replace(part, to_map=to_map)


def outside_of(fixtures: Fixtures) -> BaseGeometry:
    """Return everything that lies around the rig, in the plan."""
    dial = fixtures.base.outline if fixtures.base else Polygon()
    return shapely.union_all([dial, *(pad.outline for pad in fixtures.pads)])
