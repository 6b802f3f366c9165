"""Where an outline crosses itself on the sheet, and which branches do."""

from dataclasses import dataclass

import numpy as np
import shapely

from vinefab.model.outline import Contour

_FINE_MM = 0.05  # arcs become chords that lie this close to them


@dataclass(frozen=True, slots=True, kw_only=True)
class Crossing:
    """Two branches whose edges cross."""

    branches: tuple[str, str]  # their ids; twice the same where a branch crosses itself
    at_mm: tuple[float, float]


def crossings(contour: Contour) -> tuple[Crossing, ...]:
    """Return where segments of an outline that are no neighbours cross or touch, a pair once.

    The mouth of an open outline counts as its last segment.
    """
    segments = list(contour.segments)
    lines = [shapely.LineString(one.flattened_mm(_FINE_MM)) for one in segments]
    names = [one.branch for one in segments]
    if not contour.closed:
        lines.append(shapely.LineString([segments[-1].end_mm, segments[0].start_mm]))
        names.append(names[0])
    one, two = shapely.STRtree(lines).query(lines, predicate="intersects")
    apart = (one < two) & (two - one > 1) & ~((one == 0) & (two == len(lines) - 1))
    found: dict[tuple[str, str], Crossing] = {}
    for first, second in np.column_stack([one, two])[apart].tolist():
        low, high = sorted((names[first], names[second]))
        if (low, high) not in found:
            place = shapely.intersection(lines[first], lines[second]).representative_point()
            found[low, high] = Crossing(branches=(low, high), at_mm=(place.x, place.y))
    return tuple(found.values())
