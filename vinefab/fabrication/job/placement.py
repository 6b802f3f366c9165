"""What a sheet is to hold, and how contours and robots lie on the bed."""

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from shapely import MultiPoint, get_coordinates

from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats, whole
from vinefab.fabrication.job.passes import BodyPaths
from vinefab.model.design import Design
from vinefab.model.job import LaserPath
from vinefab.model.outline import Contour

PROCESSES = ("auto", "weldcut", "weld+cut")


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetOptions:
    """What a sheet is to hold, beside the design itself.

    Parameters
    ----------
    copies
        How many of the design.
    beside
        Further designs, one of each.
    process
        ``weldcut`` seals and cuts in one pass, ``weld+cut`` does it apart; ``auto`` takes what the
        recipe has, one pass if it has both.
    pass_through
        Whether the film may be fed through the machine along the bed's width, and may be longer
        than the bed.
    """

    copies: int = 1
    beside: tuple[Design, ...] = ()
    process: str = "auto"
    pass_through: bool = False

    def __post_init__(self) -> None:
        whole("copies", self.copies, 1, 200)
        if self.process not in PROCESSES:
            raise BadInputError("process", self.process, " or ".join(PROCESSES))


ONE = SheetOptions()
"""One robot, as the recipe makes it."""


STEP_RAD = math.radians(0.25)
"""Turns are tried this far apart, and wherever an edge of the convex hull lies along an axis."""

FIT_TOLERANCE_MM = 1e-6
MOST_TRIES = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class BedPlacement:
    """Where contours lie on the bed."""

    # turn about the origin, counter-clockwise, within -pi/2 to pi/2; applied before the shift
    angle_rad: float
    # dx_mm, dy_mm: shift
    dx_mm: float
    dy_mm: float
    # width_mm, height_mm: size of the box around everything, after the turn
    width_mm: float
    height_mm: float
    fits: bool  # whether the box fits inside the room allowed

    def moved(self, contour: Contour) -> Contour:
        """Return a contour where it lies on the bed."""
        return contour.moved(self.angle_rad, self.dx_mm, self.dy_mm)

    def shifted(self, dx_mm: float, dy_mm: float) -> "BedPlacement":
        """Return the same, lying elsewhere."""
        return replace(self, dx_mm=self.dx_mm + dx_mm, dy_mm=self.dy_mm + dy_mm)


def box_around_mm(contours: Iterable[Contour]) -> tuple[float, float, float, float]:
    """Return least x and y, greatest x and y of several contours; exact for arcs."""
    boxes = np.array([contour.box_mm for contour in contours])
    (x0, y0), (x1, y1) = boxes[:, :2].min(axis=0).tolist(), boxes[:, 2:].max(axis=0).tolist()
    return x0, y0, x1, y1


def place_contours(
    contours: Sequence[Contour], room_mm: tuple[float, float], corner_mm: float
) -> BedPlacement:
    """Return the smallest turn that fits contours into a room, or else the one that fits best."""
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
) -> BedPlacement:
    """Return the placement after one turn, measured on the exact arcs."""
    x0, y0, x1, y1 = box_around_mm(contour.moved(turn_rad, 0.0, 0.0) for contour in contours)
    width, height = x1 - x0, y1 - y0
    return BedPlacement(
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


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SheetRobot:
    """One robot on a sheet."""

    design: Design  # what it is
    body: BodyPaths  # its paths in the flat layout
    placement: BedPlacement | None  # where it lies, or None where there was no room for it
    # number, count: which of how many robots that found room; the label beside it says so too
    number: int = 1
    count: int = 1

    @property
    def title(self) -> str:
        """Its name and, where it is not alone, its number."""
        alone = self.count == 1
        return self.design.name + ("" if alone else f", part {self.number} of {self.count}")

    @property
    def paths(self) -> tuple[LaserPath, ...]:
        """Its paths on the sheet; none without a place."""
        return tuple(self.moved(path) for path in self.body.paths if self.placement)

    def moved(self, path: LaserPath) -> LaserPath:
        """Return one of its paths where it lies, called by the robot's title."""
        label = path.label.removesuffix(self.design.name) + self.title
        return replace(path, contour=self.on_sheet(path.contour), label=label)

    def on_sheet(self, contour: Contour) -> Contour:
        """Return a contour of the flat layout where it lies."""
        return contour if self.placement is None else self.placement.moved(contour)
