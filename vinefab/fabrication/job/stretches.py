"""Where paths around a robot may be parted, and into which pieces.

A robot that is larger than the bed is parted across the straight stretches of its branches: both
sides at the same place of a branch's axis, away from joints, tips and pouches.
"""

import math
from bisect import bisect
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from vinefab.core.validation import Floats
from vinefab.model.outline import Contour, Part, Segment

FROM_BEND_MM = 10.0
"""No place to part is nearer to a joint, tip, pouch or collar."""

OVERLAP_MM = 12.0
"""Paths overlap this much where they are parted; half of it on each side."""

_STEP_MM = 25.0

Box = tuple[float, float, float, float]
Range = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BranchAxes:
    """The axes of the branches on the sheet; the trunk's begins at the mouth."""

    names: tuple[str, ...]  # ids of the branches
    parent: tuple[int, ...]  # index of each branch's parent, -1 for the trunk
    start_mm: Floats  # where each axis begins, shape (n, 2)
    along: Floats  # unit vectors, shape (n, 2)

    def station_mm(self, branch: int, point_mm: Sequence[float]) -> float:
        """Return how far along a branch's axis a point is."""
        return float(np.dot(np.subtract(point_mm, self.start_mm[branch]), self.along[branch]))

    def is_left(self, branch: int, point_mm: Sequence[float]) -> bool:
        """Whether a point lies left of a branch."""
        x, y = np.subtract(point_mm, self.start_mm[branch])
        return bool(self.along[branch][0] * y - self.along[branch][1] * x > 0.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Stretch:
    """Part of a segment of a path, in one piece of one branch."""

    segment: Segment  # that part
    origin: int  # which segment of the path it is of
    piece: tuple[int, int]  # branch, and which of its pieces counted from its base


def stations_mm(axes: BranchAxes, contours: Sequence[Contour]) -> list[list[float]]:
    """Return, for each branch, the places along its axis where all paths may be parted."""
    allowed: dict[tuple[int, Part], list[Range]] = {}
    around = [contour for contour in contours if len(contour) > 1]
    for contour in around:
        sides = _sides(axes, contour)
        for row, part, left in sides:
            if left and (row, part, False) in sides:
                both = sides[row, part, True], sides[row, part, False]
                allowed.setdefault((row, part), []).extend(both)
    found: list[list[float]] = [[] for _ in axes.names]
    clear = FROM_BEND_MM + OVERLAP_MM / 2.0
    for (row, _), ranges in allowed.items():
        low, high = max(one for one, _ in ranges) + clear, min(two for _, two in ranges) - clear
        if high >= low and len(ranges) == 2 * len(around):
            count = math.floor((high - low) / _STEP_MM)
            step = (high - low) / (count + 1)
            found[row] += [low + step * (k + 0.5) for k in range(count + 1)]
    return [sorted(places) for places in found]


def _sides(axes: BranchAxes, contour: Contour) -> dict[tuple[int, Part, bool], Range]:
    """Return where along its axis each side of a branch is straight: its longest such stretch."""
    rows = {name: row for row, name in enumerate(axes.names)}
    sides: dict[tuple[int, Part, bool], Range] = {}
    for segment in contour.segments:
        if segment.bulge or segment.part not in (Part.SIDE, Part.TAIL):
            continue
        row = rows[segment.branch]
        low, high = sorted(axes.station_mm(row, p) for p in (segment.start_mm, segment.end_mm))
        key = row, segment.part, axes.is_left(row, segment.start_mm)
        had = sides.get(key, (0.0, -1.0))
        # A cut that starts halfway along a side has two segments there.
        if had[1] >= had[0] and low <= had[1] + 1e-6 and high >= had[0] - 1e-6:
            low, high = min(low, had[0]), max(high, had[1])
        if high - low >= had[1] - had[0]:
            sides[key] = low, high
    return sides


def stretches(axes: BranchAxes, contour: Contour, places_mm: list[list[float]]) -> list[Stretch]:
    """Return a path parted at every place where that is allowed."""
    rows = {name: row for row, name in enumerate(axes.names)}
    found = []
    for origin, segment in enumerate(contour.segments):
        row = rows[segment.branch]
        for part in _parted(axes, row, segment, places_mm[row]):
            middle = part.flattened_mm()
            station = axes.station_mm(row, (middle[0] + middle[-1]) / 2.0)
            piece = row, bisect(places_mm[row], station)
            found.append(Stretch(segment=part, origin=origin, piece=piece))
    return found


def _parted(axes: BranchAxes, row: int, segment: Segment, places_mm: list[float]) -> list[Segment]:
    if segment.bulge or segment.part is Part.MOUTH:
        return [segment]
    first, last = (axes.station_mm(row, p) for p in (segment.start_mm, segment.end_mm))
    between = [place for place in places_mm if min(first, last) < place < max(first, last)]
    shares = sorted((place - first) / (last - first) for place in between)
    start, run = np.array(segment.start_mm), np.subtract(segment.end_mm, segment.start_mm)
    ends = [segment.start_mm, *(_point(start + share * run) for share in shares), segment.end_mm]
    return [replace(segment, start_mm=one, end_mm=two) for one, two in pairwise(ends)]


def lengthened(run: list[Segment], *, at_start: bool, at_end: bool) -> list[Segment]:
    """Return a run of segments that reaches half the overlap beyond its parted ends."""
    longer = list(run)
    for row, wanted, sign in ((0, at_start, -1.0), (-1, at_end, 1.0)):
        if wanted:
            segment = longer[row]
            start, end = np.array(segment.start_mm), np.array(segment.end_mm)
            beyond = sign * OVERLAP_MM / 2.0 * (end - start) / segment.length_mm
            if sign < 0.0:
                longer[row] = replace(segment, start_mm=_point(start + beyond))
            else:
                longer[row] = replace(segment, end_mm=_point(end + beyond))
    return longer


def _point(point: Floats) -> tuple[float, float]:
    return float(point[0]), float(point[1])
