"""Exact contours of straight lines and circular arcs."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.front_door import Pictured
from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats, frozen_floats

FLATTEN_MM = 0.01
"""Default distance between an arc and its chords."""


class Part(StrEnum):
    """The part of the body that a segment of a contour belongs to."""

    SIDE = "side"
    TIP = "tip"
    POUCH = "pouch"
    FILLET = "fillet"
    JOINT = "joint"
    TAIL = "tail"
    COLLAR = "collar"
    SOCKET = "socket"
    MOUTH = "mouth"
    OTHER = "other"


@dataclass(frozen=True, slots=True, kw_only=True)
class Segment:
    """One line or arc of a contour.

    Parameters
    ----------
    start_mm, end_mm
        Its ends.
    bulge
        Tangent of a quarter of the arc's angle; positive when the arc turns counter-clockwise
        from start to end, 0 for a line (the convention of DXF).
    part
        Part of the body that it belongs to.
    branch
        Id of its branch, or empty.
    """

    start_mm: tuple[float, float]
    end_mm: tuple[float, float]
    bulge: float = 0.0
    part: Part = Part.OTHER
    branch: str = ""

    @property
    def chord_mm(self) -> float:
        """Distance between the ends."""
        return math.dist(self.start_mm, self.end_mm)

    @property
    def turn_rad(self) -> float:
        """Angle of the arc, positive counter-clockwise; 0 for a line."""
        return 4.0 * math.atan(self.bulge)

    @property
    def radius_mm(self) -> float:
        """Radius of the arc; infinite for a line."""
        if self.bulge == 0.0:
            return math.inf
        return self.chord_mm * (1.0 + self.bulge**2) / (4.0 * abs(self.bulge))

    @property
    def center_mm(self) -> tuple[float, float]:
        """Centre of the arc.

        Raises
        ------
        BadInputError
            If the segment is a line.
        """
        if self.bulge == 0.0:
            raise BadInputError("segment", "a line", "an arc, which has a centre")
        (x0, y0), (x1, y1) = self.start_mm, self.end_mm
        along = (1.0 - self.bulge**2) / (4.0 * self.bulge)
        return (x0 + x1) / 2 - along * (y1 - y0), (y0 + y1) / 2 + along * (x1 - x0)

    @property
    def length_mm(self) -> float:
        """Length along the segment."""
        if self.bulge == 0.0:
            return self.chord_mm
        return self.radius_mm * abs(self.turn_rad)

    @property
    def cap_mm2(self) -> float:
        """Area between the arc and its chord, positive when it turns counter-clockwise."""
        turn = self.turn_rad
        if abs(turn) < 1e-3:
            # The closed form subtracts nearly equal numbers; this is its series.
            return self.chord_mm**2 * turn / 12.0 * (1.0 + turn**2 / 30.0)
        return self.chord_mm**2 * (turn - math.sin(turn)) / (8.0 * math.sin(turn / 2.0) ** 2)

    @property
    def box_mm(self) -> tuple[float, float, float, float]:
        """Bounding box: least x, least y, greatest x, greatest y; exact for arcs."""
        ends = [self.start_mm, self.end_mm]
        points = [*ends, *_extremes_mm(self)] if self.bulge else ends
        x, y = zip(*points, strict=True)
        return min(x), min(y), max(x), max(y)

    def direction_rad(self, *, at_end: bool = False) -> float:
        """Return the direction of travel at the start or the end, -pi to pi."""
        (x0, y0), (x1, y1) = self.start_mm, self.end_mm
        half = self.turn_rad / 2
        angle = math.atan2(y1 - y0, x1 - x0) + (half if at_end else -half)
        return math.remainder(angle, math.tau)

    def corner_rad(self, after: "Segment") -> float:
        """Return by how much the direction of travel jumps from here to what follows, -pi to pi."""
        return math.remainder(after.direction_rad() - self.direction_rad(at_end=True), math.tau)

    def flattened_mm(self, tolerance_mm: float = FLATTEN_MM) -> Floats:
        """Return points on the segment, both ends included, shape (k, 2), k at least 2.

        Parameters
        ----------
        tolerance_mm
            Largest distance between the arc and its chords.
        """
        if self.bulge == 0.0:
            return np.array([self.start_mm, self.end_mm])
        radius, turn = self.radius_mm, self.turn_rad
        step = 2.0 * math.acos(max(0.0, 1.0 - tolerance_mm / radius))
        count = max(1, math.ceil(abs(turn) / step))
        x, y = self.center_mm
        first = math.atan2(self.start_mm[1] - y, self.start_mm[0] - x)
        angles = first + turn * np.arange(count + 1) / count
        points = np.column_stack([x + radius * np.cos(angles), y + radius * np.sin(angles)])
        points[0], points[-1] = self.start_mm, self.end_mm
        return points


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Contour(Pictured):
    """A chain of lines and arcs, each starting where the one before ends.

    Parameters
    ----------
    points_mm
        Vertices, shape (n, 2).
    bulges
        One per segment: n for a closed contour (the last goes back to the first vertex), n - 1
        for an open one.
    parts
        Part of the body that each segment belongs to.
    branches
        Branch id of each segment.
    closed
        Whether the last vertex joins the first.
    """

    points_mm: Floats
    bulges: Floats
    parts: tuple[Part, ...]
    branches: tuple[str, ...]
    closed: bool

    def __post_init__(self) -> None:
        points = frozen_floats("points_mm", self.points_mm, 2)
        bulges = frozen_floats("bulges", self.bulges)
        count = len(points) if self.closed else len(points) - 1
        if len(points) < 2 or not len(bulges) == len(self.parts) == len(self.branches) == count:
            raise BadInputError("contour", (len(points), len(bulges)), counted(count, "segment"))
        object.__setattr__(self, "points_mm", points)
        object.__setattr__(self, "bulges", bulges)

    def __repr__(self) -> str:
        x0, y0, x1, y1 = self.box_mm
        kind = "closed" if self.closed else "open"
        return (
            f"<Contour: {kind}, {counted(len(self), 'segment')} "
            f"({counted(self.arc_count, 'arc')}), "
            f"{self.length_mm:.5g} mm long, {x1 - x0:.5g} x {y1 - y0:.5g} mm>"
        )

    @classmethod
    def from_segments(cls, segments: list[Segment], *, closed: bool) -> "Contour":
        """Return the contour that runs through segments in order (each from the last's end)."""
        points = [segment.start_mm for segment in segments]
        if not closed:
            points.append(segments[-1].end_mm)
        return cls(
            points_mm=np.array(points),
            bulges=np.array([segment.bulge for segment in segments]),
            parts=tuple(segment.part for segment in segments),
            branches=tuple(segment.branch for segment in segments),
            closed=closed,
        )

    @classmethod
    def polyline(cls, points_mm: Floats, *, closed: bool, branch: str = "") -> "Contour":
        """Return a contour of straight lines through points, shape (n, 2)."""
        count = len(points_mm) if closed else len(points_mm) - 1
        return cls(
            points_mm=points_mm,
            bulges=np.zeros(count),
            parts=(Part.OTHER,) * count,
            branches=(branch,) * count,
            closed=closed,
        )

    def __len__(self) -> int:
        return len(self.bulges)

    @property
    def segments(self) -> Iterator[Segment]:
        """The lines and arcs in order."""
        points = _pairs(self.points_mm)
        ends = points[1:] + points[:1]
        for start, end, bulge, part, branch in zip(
            points, ends, self.bulges.tolist(), self.parts, self.branches, strict=False
        ):
            yield Segment(start_mm=start, end_mm=end, bulge=bulge, part=part, branch=branch)

    def _arcs(self) -> Iterator[tuple[int, Segment]]:
        """Yield the arcs in order, each with its place among the segments."""
        places = np.flatnonzero(self.bulges)
        if not len(places):
            return
        bulges = self.bulges.tolist()
        following = (places + 1) % len(self.points_mm)
        ends = zip(_pairs(self.points_mm[places]), _pairs(self.points_mm[following]), strict=True)
        for place, (start, end) in zip(places.tolist(), ends, strict=True):
            yield place, Segment(start_mm=start, end_mm=end, bulge=bulges[place])

    @property
    def length_mm(self) -> float:
        """Length of the path, exact for arcs."""
        points = _pairs(self.points_mm)
        ends = zip(points, points[1:] + points[:1], self.bulges, strict=False)
        lengths = [math.dist(start, end) for start, end, _ in ends]
        for place, arc in self._arcs():
            lengths[place] = arc.length_mm
        return math.fsum(lengths)

    @property
    def signed_area_mm2(self) -> float:
        """Area within, exact for arcs, positive when it runs counter-clockwise.

        An open contour is closed with a straight line for this.
        """
        x, y = self.points_mm.T
        ends = following(self.points_mm)
        straight = float(np.sum(x * ends[:, 1] - ends[:, 0] * y)) / 2
        return straight + math.fsum(arc.cap_mm2 for _, arc in self._arcs())

    @property
    def arc_count(self) -> int:
        """Number of arcs."""
        return int(np.count_nonzero(self.bulges))

    def flattened_mm(self, tolerance_mm: float = FLATTEN_MM) -> Floats:
        """Return the contour as a polyline, shape (k, 2); a closed one does not repeat its start.

        Parameters
        ----------
        tolerance_mm
            Largest distance between an arc and its chords.
        """
        runs, done = [], 0
        for place, arc in self._arcs():
            runs += [self.points_mm[done:place], arc.flattened_mm(tolerance_mm)[:-1]]
            done = place + 1
        # The lines after the last arc; the points of an open contour include its end.
        return np.concatenate([*runs, self.points_mm[done:]])

    @property
    def box_mm(self) -> tuple[float, float, float, float]:
        """Bounding box: least x, least y, greatest x, greatest y; exact for arcs."""
        extremes = [point for _, arc in self._arcs() for point in _extremes_mm(arc)]
        points = np.concatenate([self.points_mm, np.array(extremes).reshape(-1, 2)])
        (x0, y0), (x1, y1) = points.min(axis=0), points.max(axis=0)
        return float(x0), float(y0), float(x1), float(y1)

    def moved(self, angle_rad: float, dx_mm: float, dy_mm: float) -> "Contour":
        """Return the contour turned about the origin and then shifted."""
        cos, sin = math.cos(angle_rad), math.sin(angle_rad)
        turned = self.points_mm @ np.array([[cos, sin], [-sin, cos]])
        return Contour(
            points_mm=turned + np.array([dx_mm, dy_mm]),
            bulges=self.bulges,
            parts=self.parts,
            branches=self.branches,
            closed=self.closed,
        )


def following(points_mm: Floats) -> Floats:
    """Return the next point of each, the first after the last, sooner than `numpy.roll`.

    >>> following(np.array([[0.0, 1.0], [2.0, 3.0]])).tolist()
    [[2.0, 3.0], [0.0, 1.0]]
    """
    return np.concatenate([points_mm[1:], points_mm[:1]])


def _pairs(points_mm: Floats) -> list[tuple[float, float]]:
    return [(x, y) for x, y in points_mm.tolist()]


def _extremes_mm(arc: Segment) -> list[tuple[float, float]]:
    """Return the points where an arc is farthest along an axis, at most 4."""
    (x, y), turn, radius = arc.center_mm, arc.turn_rad, arc.radius_mm
    first = math.atan2(arc.start_mm[1] - y, arc.start_mm[0] - x)
    found = []
    for quarter in range(4):
        angle = quarter * math.pi / 2
        travelled = (angle - first) % math.tau if turn > 0 else (first - angle) % math.tau
        if travelled < abs(turn):
            found.append((x + radius * math.cos(angle), y + radius * math.sin(angle)))
    return found
