"""Corner markers: squares that a rig and a drawing carry, and by which a photo is rectified.

They are ArUco markers of the dictionary 4x4_50, the first four, one outside each corner of the
box of a map's bounds. This module has their places and their look; ``rig`` makes
them, ``photos`` finds them.
"""

from dataclasses import dataclass

import numpy as np

from vinefab.core.limits import DEFAULT_MARKER_MM
from vinefab.core.validation import Floats, number, positive
from vinefab.model.map import Map

MARKER_CELLS: tuple[tuple[str, str, str, str], ...] = (
    ("#.##", ".#.#", "..##", "..#."),
    ("....", "####", "#..#", "#.#."),
    ("..##", "..##", "..#.", "##.#"),
    ("#..#", "#..#", ".#..", ".##."),
)
"""Inner cells of each marker by its number, rows from the top; ``#`` is white, ``.`` is black. A
frame of black cells, one cell wide, lies around them, and white paper around that."""

MARKER_SIDE_CELLS = 6
"""Cells along the side of a marker, frame included."""

DEFAULT_MARKER_GAP_MM = 12.0
"""From the box of the bounds to a marker along both axes: border and quiet zone, as printed."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CornerMarker:
    """One marker in map coordinates.

    Parameters
    ----------
    number
        0 at the lower left corner, then counter-clockwise: lower right, upper right, upper left.
    corners_mm
        Outer corners of its black frame, shape (4, 2): upper left first, then clockwise, as the
        marker is seen upright from above with y upwards.
    z_mm
        Height of its face above the floor.
    """

    number: int
    corners_mm: Floats
    z_mm: float = 0.0


def corner_markers(
    world: Map,
    *,
    side_mm: float = DEFAULT_MARKER_MM,
    gap_mm: float = DEFAULT_MARKER_GAP_MM,
    z_mm: float = 0.0,
) -> tuple[CornerMarker, ...]:
    """Return the four markers of a map, upright, each outside its corner of the bounds' box.

    Parameters
    ----------
    side_mm, gap_mm, z_mm
        In millimetres of the map: of a rig at another scale, the printed sizes divided by it.

    Raises
    ------
    BadInputError
        If a size is out of range.
    """
    positive("marker.side_mm", side_mm, 1e6)
    number("marker.gap_mm", gap_mm, 0.0, 1e6, "mm")
    number("marker.z_mm", z_mm, -1e6, 1e6, "mm")
    left, low, right, top = world.bounds.bounds
    near, far = gap_mm, gap_mm + side_mm
    places = (
        (left - far, low - far),
        (right + near, low - far),
        (right + near, top + near),
        (left - far, top + near),
    )
    square = side_mm * np.array([(0.0, 1.0), (1.0, 1.0), (1.0, 0.0), (0.0, 0.0)])
    return tuple(
        CornerMarker(number=index, corners_mm=square + place, z_mm=z_mm)
        for index, place in enumerate(places)
    )
