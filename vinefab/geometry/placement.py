"""How to lay contours on the bed: the smallest turn that fits."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from shapely import MultiPoint, get_coordinates

from vinefab.model.checked import Floats
from vinefab.model.outline import Contour

STEP_RAD = math.radians(0.25)
"""Turns are tried this far apart, and wherever an edge of the convex hull lies along an axis."""

FIT_TOLERANCE_MM = 1e-6
MOST_TRIES = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class Placement:
    """Where contours lie on the bed.

    Parameters
    ----------
    angle_rad
        Turn about the origin, counter-clockwise, within -pi/2 to pi/2; applied before the shift.
    dx_mm, dy_mm
        Shift.
    width_mm, height_mm
        Size of the box around everything, after the turn.
    fits
        Whether the box fits inside the room allowed.
    """

    angle_rad: float
    dx_mm: float
    dy_mm: float
    width_mm: float
    height_mm: float
    fits: bool

    def moved(self, contour: Contour) -> Contour:
        """Return a contour where it lies on the bed."""
        return contour.moved(self.angle_rad, self.dx_mm, self.dy_mm)

    def shifted(self, dx_mm: float, dy_mm: float) -> "Placement":
        """Return the same, lying elsewhere."""
        return replace(self, dx_mm=self.dx_mm + dx_mm, dy_mm=self.dy_mm + dy_mm)


def box_around_mm(contours: Iterable[Contour]) -> tuple[float, float, float, float]:
    """Return least x and y, greatest x and y of several contours; exact for arcs."""
    boxes = np.array([contour.box_mm for contour in contours])
    (x0, y0), (x1, y1) = boxes[:, :2].min(axis=0).tolist(), boxes[:, 2:].max(axis=0).tolist()
    return x0, y0, x1, y1


def place(contours: Sequence[Contour], room_mm: tuple[float, float], corner_mm: float) -> Placement:
    """Return the smallest turn that fits contours into a room, or else the one that fits best.

    Parameters
    ----------
    contours
        What is to lie on the bed, together.
    room_mm
        Width and height of the usable bed.
    corner_mm
        Where the lower left corner of everything comes to lie, in x and in y.
    """
    hull = _hull_mm(np.concatenate([contour.flattened_mm() for contour in contours]))
    steps, flush = _steps_rad(), _flush_rad(hull)
    turns = np.concatenate([steps, flush])
    excess = _excess_mm(hull, turns, room_mm)
    # A turn that fits counts as 0, however much room it leaves: then the smallest round turn wins,
    # and the turns of single edges count only where nothing else fits.
    badness = np.where(excess <= FIT_TOLERANCE_MM, 0.0, excess)
    order = np.lexsort((-turns, np.abs(turns), np.arange(len(turns)) >= len(steps), badness))
    # The hull's corners lie on chords, a little inside the arcs: the exact box has the last word.
    hopeful = [row for row in order[:MOST_TRIES].tolist() if badness[row] == 0.0]
    for turn in turns[hopeful].tolist():
        placement = _placed(contours, turn, room_mm, corner_mm)
        if placement.fits:
            return placement
    return _placed(contours, float(turns[order[0]]), room_mm, corner_mm)


def _placed(
    contours: Sequence[Contour], turn_rad: float, room_mm: tuple[float, float], corner_mm: float
) -> Placement:
    """Return the placement after one turn, measured on the exact arcs."""
    x0, y0, x1, y1 = box_around_mm(contour.moved(turn_rad, 0.0, 0.0) for contour in contours)
    width, height = x1 - x0, y1 - y0
    return Placement(
        angle_rad=turn_rad,
        dx_mm=corner_mm - x0,
        dy_mm=corner_mm - y0,
        width_mm=width,
        height_mm=height,
        fits=max(width - room_mm[0], height - room_mm[1]) <= FIT_TOLERANCE_MM,
    )


def _hull_mm(points_mm: Floats) -> Floats:
    """Return the convex hull's corners, shape (k, 2)."""
    corners: Floats = get_coordinates(MultiPoint(points_mm).convex_hull)
    return corners


def _steps_rad() -> Floats:
    """Return round turns from -pi/2 to pi/2, no turn at all among them."""
    count = round(math.pi / 2 / STEP_RAD)
    return np.arange(-count, count + 1, dtype=np.float64) * STEP_RAD


def _flush_rad(hull_mm: Floats) -> Floats:
    """Return the turns from -pi/2 to pi/2 that lay an edge of a hull along an axis."""
    edges = np.diff(hull_mm, axis=0)
    turns = -np.arctan2(edges[:, 1], edges[:, 0])
    turns = np.remainder(turns[:, None] + np.arange(4) * math.pi / 2, math.tau) - math.pi
    return turns[np.abs(turns) <= math.pi / 2]


def _excess_mm(hull_mm: Floats, turns_rad: Floats, room_mm: tuple[float, float]) -> Floats:
    """Return by how much the hull overshoots the room after each turn, shape (turns,)."""
    cos, sin = np.cos(turns_rad)[:, None], np.sin(turns_rad)[:, None]
    x, y = hull_mm[:, 0], hull_mm[:, 1]
    wide, high = np.ptp(cos * x - sin * y, axis=1), np.ptp(sin * x + cos * y, axis=1)
    excess: Floats = np.maximum(wide - room_mm[0], high - room_mm[1])
    return excess
