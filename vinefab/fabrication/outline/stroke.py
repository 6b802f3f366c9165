"""Runs of lines and arcs in their own frame, and the pen that places them on the sheet."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from vinefab.model.outline import Contour, Part

LEAST_SEGMENT_MM = 0.05
"""Length of the shortest segment of an outline."""

LEAST_CUT_MM = 0.2
"""Length of the shortest segment that a laser draws well: rule VF-L02 refuses shorter ones."""

LEAST_ARC_RADIUS_MM = 0.5
"""Radius of the smallest arc that a laser draws well: rule VF-L02 refuses smaller ones."""

WORST_ERROR_MM = 0.002
"""An arc too short to draw may become a corner that is this far from the exact shape."""

MOST_TURN_RAD = math.radians(174.9)
"""Largest turn of an arc, longer ones are split: readers fail near half a circle."""

Point = tuple[float, float]


@dataclass(frozen=True, slots=True)
class StrokeSegment:
    """One line or arc that begins at the end of the previous one."""

    end_mm: Point  # in the frame of its run
    bulge: float  # tangent of a quarter of its turn, as in `Segment`
    part: Part
    owner: int = 0  # which of the run's branches it belongs to


@dataclass(frozen=True, slots=True)
class StrokeRun:
    """Connected lines and arcs, in a frame of their own."""

    start_mm: Point  # where the first piece begins
    pieces: tuple[StrokeSegment, ...] = ()  # none for a bare corner


@dataclass(frozen=True, slots=True)
class LocalFrame:
    """A frame of a run, placed on the sheet."""

    origin_mm: Point
    heading_rad: float  # direction of its x axis


def polar(radius_mm: float, angle_rad: float) -> Point:
    """Return the point at a distance and direction from the origin."""
    return radius_mm * math.cos(angle_rad), radius_mm * math.sin(angle_rad)


def turned(point: Point, angle_rad: float) -> Point:
    """Return a point turned counter-clockwise about the origin."""
    cos, sin = math.cos(angle_rad), math.sin(angle_rad)
    return cos * point[0] - sin * point[1], sin * point[0] + cos * point[1]


def arc(
    center_mm: Point, start_mm: Point, turn_rad: float, part: Part, owner: int = 0
) -> list[StrokeSegment]:
    """Return an arc from its start, split into equal pieces below 175 degrees."""
    count = max(1, math.ceil(abs(turn_rad) / MOST_TURN_RAD))
    bulge = math.tan(turn_rad / count / 4.0)
    spoke = start_mm[0] - center_mm[0], start_mm[1] - center_mm[1]
    pieces = []
    for step in range(1, count + 1):
        x, y = turned(spoke, turn_rad * step / count)
        pieces.append(StrokeSegment((center_mm[0] + x, center_mm[1] + y), bulge, part, owner))
    return pieces


@dataclass(slots=True)
class Pen:
    """Collects the vertices of a contour; the fields are those of `Contour`."""

    points: list[Point]
    bulges: list[float] = field(default_factory=list)
    parts: list[Part] = field(default_factory=list)
    branches: list[str] = field(default_factory=list)

    def go_to(self, point: Point, part: Part, branch: str, bulge: float = 0.0) -> None:
        """Draw to a point, unless the pen is there already; an arc that turns too far as two."""
        if math.dist(self.points[-1], point) < 1e-9:
            return
        if abs(bulge) > math.tan(MOST_TURN_RAD / 4.0):
            (x0, y0), (x1, y1) = self.points[-1], point
            middle = (x0 + x1 + bulge * (y1 - y0)) / 2.0, (y0 + y1 - bulge * (x1 - x0)) / 2.0
            bulge = math.tan(math.atan(bulge) / 2.0)
            self.go_to(middle, part, branch, bulge)
        self.points.append(point)
        self.bulges.append(bulge)
        self.parts.append(part)
        self.branches.append(branch)

    def pieces(self, run: StrokeRun, frame: LocalFrame, owners: Sequence[str]) -> None:
        """Draw a run's pieces; the pen stands at the run's start."""
        for piece in run.pieces:
            point = placed(piece.end_mm, frame)
            self.go_to(point, piece.part, owners[piece.owner], piece.bulge)

    def contour(self) -> Contour:
        """Return the open contour drawn so far."""
        return Contour(
            points_mm=np.array(self.points),
            bulges=np.array(self.bulges),
            parts=tuple(self.parts),
            branches=tuple(self.branches),
            closed=False,
        )


def placed(point: Point, frame: LocalFrame) -> Point:
    """Return where a frame's point lies on the sheet."""
    x, y = turned(point, frame.heading_rad)
    return frame.origin_mm[0] + x, frame.origin_mm[1] + y
