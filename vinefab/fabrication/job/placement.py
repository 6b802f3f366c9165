"""Placement on the bed: rotation of one robot, nesting of several, and places on the sheet.

Nesting works on a grid: a robot covers the cells that it comes near, and a place is free where none
of its cells is taken. The correlation of the two grids gives all free places at once. Robots may
interlock, which boxes around them would not allow.
"""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Self

import numpy as np
import scipy  # its parts load at their first use
import shapely
from numpy.typing import NDArray

from vinefab.core.errors import BadInputError
from vinefab.core.limits import deg, rad
from vinefab.core.validation import Floats, whole
from vinefab.fabrication.job.passes import BodyPaths
from vinefab.model.design import Design
from vinefab.model.job import Job, LaserPath, SheetTransform
from vinefab.model.outline import Contour
from vinefab.outline.body_outline import FlatLayout

PROCESSES = ("auto", "weldcut", "weld+cut")


@dataclass(frozen=True, slots=True, kw_only=True)
class SheetOptions:
    """What a sheet holds, and how it is made.

    Parameters
    ----------
    copies
        Number of copies of the design.
    beside
        Further designs, one copy each.
    process
        ``weldcut`` seals and cuts in one pass, ``weld+cut`` in two; ``auto`` takes what the recipe
        has, one pass if it has both.
    pass_through
        Whether the film is fed through the machine along the bed's width, so that it may be longer
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

    @property
    def separate(self) -> bool:
        """Whether robots are welded and cut in two passes, whatever else the recipe has."""
        return self.process == "weld+cut"


ONE = SheetOptions()
"""One copy, by the process of the recipe."""


STEP_RAD = math.radians(0.25)
"""Step of the rotations tried, besides those that align an edge of the convex hull to an axis."""

FIT_TOLERANCE_MM = 1e-6
MOST_TRIES = 20


@dataclass(frozen=True, slots=True, kw_only=True)
class LayoutPlacement:
    """Where the flat layout lies on the sheet: a rotation about the origin, then a shift."""

    angle_rad: float  # counter-clockwise
    dx_mm: float
    dy_mm: float

    @classmethod
    def of(cls, transform: SheetTransform) -> "LayoutPlacement":
        """Return the placement that a job, or one of its pieces, records."""
        return LayoutPlacement(
            angle_rad=rad(transform.rotation_deg),
            dx_mm=transform.shift_x_mm,
            dy_mm=transform.shift_y_mm,
        )

    @property
    def transform(self) -> SheetTransform:
        """The placement as jobs record it."""
        return SheetTransform(
            rotation_deg=deg(self.angle_rad), shift_x_mm=self.dx_mm, shift_y_mm=self.dy_mm
        )

    def shifted(self, dx_mm: float, dy_mm: float) -> Self:
        """Return this placement, shifted further."""
        return replace(self, dx_mm=self.dx_mm + dx_mm, dy_mm=self.dy_mm + dy_mm)

    def moved(self, contour: Contour) -> Contour:
        """Return a contour of the flat layout as it lies on the sheet."""
        return contour.moved(self.angle_rad, self.dx_mm, self.dy_mm)

    def on_sheet(self, points_mm: Floats) -> Floats:
        """Return points of the flat layout as they lie on the sheet, shape (k, 2)."""
        cos, sin = math.cos(self.angle_rad), math.sin(self.angle_rad)
        turned = points_mm @ np.array([[cos, sin], [-sin, cos]])
        return np.asarray(turned + np.array([self.dx_mm, self.dy_mm]))


@dataclass(frozen=True, slots=True, kw_only=True)
class BedPlacement(LayoutPlacement):
    """Where contours lie on the bed, turned by a right angle at most."""

    width_mm: float  # of the box around everything, after the rotation
    height_mm: float
    fits: bool  # whether the box fits the room


def box_around_mm(contours: Iterable[Contour]) -> tuple[float, float, float, float]:
    """Return least x and y, greatest x and y of contours; exact for arcs."""
    boxes = np.array([contour.box_mm for contour in contours])
    (x0, y0), (x1, y1) = boxes[:, :2].min(axis=0).tolist(), boxes[:, 2:].max(axis=0).tolist()
    return x0, y0, x1, y1


def place_contours(
    contours: Sequence[Contour], room_mm: tuple[float, float], corner_mm: float
) -> BedPlacement:
    """Return the smallest rotation that fits contours into a room, else the one that fits best.

    Parameters
    ----------
    room_mm
        Width and height of the room.
    corner_mm
        Both coordinates of the room's lower left corner.
    """
    points = np.concatenate([contour.flattened_mm() for contour in contours])
    hull = shapely.get_coordinates(shapely.MultiPoint(points).convex_hull)
    # Turns by round steps, and those that lay an edge of the hull along a side of the room.
    count = round(math.pi / 2 / STEP_RAD)
    steps = np.arange(-count, count + 1, dtype=np.float64) * STEP_RAD
    edges = np.diff(hull, axis=0)
    flush = -np.arctan2(edges[:, 1], edges[:, 0])
    flush = np.remainder(flush[:, None] + np.arange(4) * math.pi / 2, math.tau) - math.pi
    turns = np.concatenate([steps, flush[np.abs(flush) <= math.pi / 2]])
    cos, sin = np.cos(turns)[:, None], np.sin(turns)[:, None]
    x, y = hull[:, 0], hull[:, 1]
    wide, high = np.ptp(cos * x - sin * y, axis=1), np.ptp(sin * x + cos * y, axis=1)
    excess = np.maximum(wide - room_mm[0], high - room_mm[1])
    # A rotation that fits counts as 0, however much room it leaves: then the smallest round one
    # wins, and those of single edges count only where nothing else fits.
    badness = np.where(excess <= FIT_TOLERANCE_MM, 0.0, excess)
    order = np.lexsort((-turns, np.abs(turns), np.arange(len(turns)) >= len(steps), badness))
    # The hull's corners lie on chords, a little inside the arcs: the exact box decides.
    candidates = [row for row in order[:MOST_TRIES].tolist() if badness[row] == 0.0]
    for turn in turns[candidates].tolist():
        placement = placed_at(contours, turn, room_mm, corner_mm)
        if placement.fits:
            return placement
    return placed_at(contours, float(turns[order[0]]), room_mm, corner_mm)


def placed_at(
    contours: Sequence[Contour], turn_rad: float, room_mm: tuple[float, float], corner_mm: float
) -> BedPlacement:
    """Return the placement of contours after one rotation, measured on the exact arcs."""
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


def piece_name(design: str, piece: str) -> str:
    """Return the name that a piece's paths belong to; the design's name if not in pieces.

    >>> piece_name("tree", "B")
    'tree, piece B'
    """
    return f"{design}, piece {piece}" if piece else design


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SheetRobot:
    """One robot on a sheet, or one piece of a robot."""

    design: Design
    body: BodyPaths  # its paths in the flat layout
    placement: BedPlacement | None  # None if there was no room for it
    number: int = 1  # among the robots placed, from 1
    count: int = 1  # robots placed
    piece: str = ""  # label of the piece that this is of a robot in pieces

    @property
    def title(self) -> str:
        """Its name and, among several, its number."""
        single = self.count == 1
        name = self.of if self.piece else self.design.name
        return name + ("" if single else f", part {self.number} of {self.count}")

    @property
    def of(self) -> str:
        """What its paths belong to: the design, or one piece of it."""
        return piece_name(self.design.name, self.piece)

    @property
    def outline(self) -> Contour:
        """The outline that forms its body, as it lies on the sheet."""
        return self.on_sheet(self.body.outline.contour)

    @property
    def paths(self) -> tuple[LaserPath, ...]:
        """Its paths on the sheet; none if it was not placed."""
        return tuple(self.moved(path) for path in self.body.paths if self.placement)

    def moved(self, path: LaserPath) -> LaserPath:
        """Return one of its paths as it lies on the sheet, labelled with the robot's title."""
        label = path.label.removesuffix(self.design.name) + self.title
        return replace(path, contour=self.on_sheet(path.contour), label=label, of=self.of)

    def on_sheet(self, contour: Contour) -> Contour:
        """Return a contour of the flat layout as it lies on the sheet."""
        return contour if self.placement is None else self.placement.moved(contour)


Cells = NDArray[np.bool_]

APART_MM = 8.0
"""Film left between two robots: for their heat, and for marks (assumed)."""

_SAMPLES, _SAMPLES_AT_ONCE = 160, 10
_SPREAD = np.arange(_SAMPLES) * 61 % _SAMPLES  # 61 and 160 have no common factor
_TURNS = 24
"""Rotations tried of each robot."""


class _Stamp:
    """A robot in one rotation, and the cells that it takes, found when they are first needed."""

    def __init__(self, shape: shapely.Polygon, turn_rad: float) -> None:
        self.turn_rad = turn_rad
        self.turned = shapely.affinity.rotate(shape, turn_rad, origin=(0, 0), use_radians=True)
        x0, y0, x1, y1 = self.turned.bounds
        self.low_mm = x0, y0  # lower left corner of the rotated robot's box
        self.size_mm = x1 - x0, y1 - y0  # width and height of the box
        self._cells: Cells | None = None

    def cells(self, bed: "_Bed") -> Cells:
        """Return the cells nearer to the robot than half the distance kept.

        The box's corner lies ``bed.rim`` cells from the array's corner.
        """
        if self._cells is None:
            near = shapely.buffer(self.turned, bed.near_mm, quad_segs=4)
            across, up = (
                low + (np.arange(bed.counted(side), dtype=np.float64) - bed.rim + 0.5) * bed.cell_mm
                for low, side in zip(self.low_mm, self.size_mm, strict=True)
            )
            self._cells = _within(near, across, up)
        return self._cells

    def edge_cells(self, bed: "_Bed") -> list[list[int]]:
        """Return column and row of some of the `cells`, spread along the robot's edge."""
        edge = max(shapely.get_parts(self.turned).tolist(), key=shapely.area).exterior
        corners = shapely.get_coordinates(edge)
        way_mm = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(corners, axis=0).T))])
        # In an order that is spread too: neighbours are taken at the same places.
        along_mm = way_mm[-1] / _SAMPLES * _SPREAD
        points = np.column_stack([np.interp(along_mm, way_mm, side) for side in corners.T])
        inner = (points - self.low_mm) / bed.cell_mm
        # The middle of a point's own cell is nearer than the distance kept.
        found: list[list[int]] = (np.floor(inner).astype(np.int64) + bed.rim).tolist()
        return found


class _Bed:
    """The cells of the bed that are taken."""

    def __init__(self, room_mm: tuple[float, float]) -> None:
        self.room_mm = room_mm
        most_cells = 400_000
        cell_mm = 2.0
        self.cell_mm = max(cell_mm, math.sqrt(room_mm[0] * room_mm[1] / most_cells))
        self.near_mm = APART_MM / 2.0 + self.cell_mm * math.sqrt(0.5)
        self.rim = math.ceil(self.near_mm / self.cell_mm) + 1
        shape = [self.counted(side) for side in reversed(room_mm)]
        self.taken: Cells = np.zeros(shape, dtype=np.bool_)
        self.period = [scipy.fft.next_fast_len(length, real=True) for length in shape]
        self.used_mm = (0.0, 0.0)

    def counted(self, side_mm: float) -> int:
        """Return the number of cells along a side of a robot's box, with the rim on both ends."""
        return math.ceil(side_mm / self.cell_mm) + 2 * self.rim

    def places(self, stamp: _Stamp) -> tuple[int, int]:
        """Return the number of rows and columns for the corner of a robot's box; 0 if none."""
        wide, high = (
            max(0, math.floor((room - size) / self.cell_mm + 1e-9) + 1)
            for room, size in zip(self.room_mm, stamp.size_mm, strict=True)
        )
        return (high, wide) if high and wide else (0, 0)

    def least_use(self, stamp: _Stamp) -> float:
        """Return the use of the bed below which no place of a robot comes."""
        return math.prod(map(max, self.used_mm, stamp.size_mm))

    def _transform(self, cells: Cells) -> NDArray[np.complexfloating]:
        # Single precision: the counts of cells that it gives are off by some hundredths.
        return scipy.fft.rfft2(cells.astype(np.float32), s=self.period)

    def best(
        self, stamp: _Stamp, taken: NDArray[np.complexfloating], least: float = math.inf
    ) -> tuple[float, int, int] | None:
        """Return the least use of the bed with the robot in a free cell, and that cell; or None.

        Parameters
        ----------
        taken
            Transform of the bed's taken cells.
        least
            A use that is known to be possible: None may be returned where none is less.
        """
        rows, columns = self.places(stamp)
        if not rows:
            return None
        at_rows, at_columns = np.arange(rows), np.arange(columns)
        wide = np.maximum(self.used_mm[0], at_columns * self.cell_mm + stamp.size_mm[0])
        high = np.maximum(self.used_mm[1], at_rows * self.cell_mm + stamp.size_mm[1])
        if not any(self.used_mm):
            return float(wide[0] * high[0]), 0, 0
        # What a place uses grows with its row and its column: those that count fill a corner.
        rows = int(np.count_nonzero(wide[0] * high + 1e-3 * at_rows <= least))
        columns = int(np.count_nonzero(wide * high[0] + 1e-3 * at_columns <= least))
        if not rows or not columns or self._meets_everywhere(stamp, rows, columns):
            return None
        covered = self._transform(stamp.cells(self))
        collisions = scipy.fft.irfft2(taken * np.conj(covered), s=self.period)
        free_rows, free_columns = np.nonzero(collisions[:rows, :columns] < 0.5)
        if not len(free_rows):
            return None
        # The film used; ties go to the place nearest to the corner.
        used = wide[free_columns] * high[free_rows] + 1e-3 * (free_rows + free_columns)
        first = int(np.argmin(used))
        return float(used[first]), int(free_rows[first]), int(free_columns[first])

    def _meets_everywhere(self, stamp: _Stamp, rows: int, columns: int) -> bool:
        """Tell quickly whether a part of a robot's edge is taken at each of the first places."""
        left = np.ones((rows, columns), dtype=np.bool_)
        for count, (column, row) in enumerate(stamp.edge_cells(self)):
            left &= ~self.taken[row : row + rows, column : column + columns]
            if count % _SAMPLES_AT_ONCE == 0 and not left.any():
                return True
        return not left.any()

    def placement(self, stamps: Sequence[_Stamp], corner_mm: float) -> BedPlacement | None:
        """Put a robot where it needs the least film, in the best of some rotations, if it fits."""
        # Those that may need the least film first: once one is placed, most of the others cannot
        # need less. Of equals the first rotation counts, whatever the order of the tries.
        tries, taken = list[tuple[float, int, int, int]](), self._transform(self.taken)
        least = math.inf
        for number in sorted(range(len(stamps)), key=lambda number: self.least_use(stamps[number])):
            stamp = stamps[number]
            if self.least_use(stamp) <= least and (best := self.best(stamp, taken, least)):
                tries.append((best[0], number, *best[1:]))
                least = min(least, best[0])
        if not tries:
            return None
        _, number, row, column = min(tries)
        stamp = stamps[number]
        cells = stamp.cells(self)
        high, wide = cells.shape
        self.taken[row : row + high, column : column + wide] |= cells[
            : self.taken.shape[0] - row, : self.taken.shape[1] - column
        ]
        at_mm = column * self.cell_mm, row * self.cell_mm
        self.used_mm = (
            max(self.used_mm[0], at_mm[0] + stamp.size_mm[0]),
            max(self.used_mm[1], at_mm[1] + stamp.size_mm[1]),
        )
        return BedPlacement(
            angle_rad=math.remainder(stamp.turn_rad, math.tau),
            dx_mm=corner_mm + at_mm[0] - stamp.low_mm[0],
            dy_mm=corner_mm + at_mm[1] - stamp.low_mm[1],
            width_mm=stamp.size_mm[0],
            height_mm=stamp.size_mm[1],
            fits=True,
        )


def _within(shape: shapely.Geometry, across: Floats, up: Floats) -> Cells:
    """Return the mask of a grid's points in a polygon, shape (len(up), len(across))."""
    ends = [
        np.stack([ring[:-1], ring[1:]], axis=1)
        for part in shapely.get_rings(shapely.get_parts(shape))
        for ring in [shapely.get_coordinates(part)]
    ]
    (x0, y0), (x1, y1) = np.concatenate(ends).transpose(1, 2, 0)
    # Every row of the grid crosses an edge or not; a point is inside after an odd number.
    first, last = np.searchsorted(up, np.stack([np.minimum(y0, y1), np.maximum(y0, y1)]))
    count = last - first
    edge = np.repeat(np.arange(len(x0)), count)
    row = np.arange(len(edge)) + np.repeat(first - (np.cumsum(count) - count), count)
    x = x0[edge] + (up[row] - y0[edge]) / (y1[edge] - y0[edge]) * (x1[edge] - x0[edge])
    width = len(across) + 1
    place = row * width + np.searchsorted(across, x)
    crossed = np.bincount(place, minlength=len(up) * width).reshape(len(up), width)
    inside: Cells = np.cumsum(crossed, axis=1)[:, :-1] % 2 == 1
    return inside


def nest(
    robots: Sequence[tuple[Contour, ...]],
    room_mm: tuple[float, float],
    corner_mm: float,
    *,
    once: bool = False,
) -> list[BedPlacement | None]:
    """Return the placement of each robot on the bed; None for those that find no room.

    Parameters
    ----------
    once
        Try one order only, where what finds no room has another bed.
    """
    if len(robots) == 1:
        return [place_contours(robots[0], room_mm, corner_mm)]
    shapes, longest_mm = list[shapely.Polygon](), list[float]()
    for contours in robots:
        # All paths as one shape, a little too large.
        lines = [shapely.LineString(contour.flattened_mm(0.05)) for contour in contours]
        body = shapely.Polygon(contours[0].flattened_mm(0.05))
        around = body if body.is_valid else body.convex_hull
        shapes.append(shapely.union_all([around, *lines]).buffer(0.06, quad_segs=4))
        x, y = shapely.get_coordinates(shapely.minimum_rotated_rectangle(shapes[-1]))[:3].T
        longest_mm.append(float(np.hypot(np.diff(x), np.diff(y)).max()))
    # The largest first: small ones find room between its branches. If that leaves some without a
    # place, the longest first: robots nearly as long as the bed have few places.
    rows = range(len(robots))
    orders = (
        sorted(rows, key=lambda row: (-shapes[row].area, row)),
        sorted(rows, key=lambda row: (-longest_mm[row], row)),
    )
    most: list[BedPlacement | None] = []
    for order in orders:
        bed, stamps = _Bed(room_mm), dict[bytes, list[_Stamp]]()
        found: list[BedPlacement | None] = [None] * len(robots)
        for row in order:
            key = shapes[row].wkb
            if key not in stamps:
                turns = np.arange(_TURNS) * math.tau / _TURNS
                stamps[key] = [_Stamp(shapes[row], turn) for turn in turns.tolist()]
            found[row] = bed.placement(stamps[key], corner_mm)
        if not most or found.count(None) < most.count(None):
            most = found
        if once or None not in most:
            break
    return most


@dataclass(frozen=True, slots=True, kw_only=True)
class _CutBranch:
    """A branch that two pieces share."""

    inner: LayoutPlacement
    outer: LayoutPlacement
    at_mm: float  # the middle of the lap along the branch: what lies farther is on the outer piece


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SheetPlaces:
    """Where places of the flat layout lie on the sheet, also those of a robot in pieces."""

    layout: FlatLayout
    whole: LayoutPlacement | None  # of a robot in one piece
    uncut: Mapping[int, LayoutPlacement]  # of a robot in pieces: where each uncut branch lies
    cut: Mapping[int, _CutBranch]
    axes: Mapping[tuple[float, ...], int]  # branches by the ends of their axes

    @classmethod
    def of(cls, job: Job, layout: FlatLayout) -> "SheetPlaces":
        """Return the places that a job's facts record; of several copies those of the first."""
        if job.transform is not None:
            whole = LayoutPlacement.of(job.transform)
            return cls(layout=layout, whole=whole, uncut={}, cut={}, axes={})
        row = {name: number for number, name in enumerate(layout.tree.ids)}
        first = [piece for piece in job.pieces if piece.copy == 1]
        # The sheets stand side by side.
        wide_mm = job.sheets[0].sheet_width_mm
        placed = {
            piece.label: LayoutPlacement.of(piece.transform).shifted(
                (piece.sheet - 1) * wide_mm, 0.0
            )
            for piece in first
        }
        home = {row[name]: placed[one.label] for one in first for name in one.branches}
        cut = {
            row[joint.branch]: _CutBranch(
                inner=placed[joint.inner],
                outer=placed[joint.label],
                at_mm=(joint.socket_rim_mm + joint.plug_rim_mm) / 2.0,
            )
            for joint in job.joints
        }
        ends = np.stack([layout.start_mm, layout.end_mm], axis=1)
        axes = {_rounded(two): number for number, two in enumerate(ends)}
        return cls(layout=layout, whole=None, uncut=home, cut=cut, axes=axes)

    def point(self, at_mm: tuple[float, float], branches: Sequence[int] = ()) -> Floats:
        """Return where a place lies on the sheet, shape (2,).

        Parameters
        ----------
        branches
            Indices of the branches that it may lie on, where pieces lie apart; all by default.
        """
        at = np.array(at_mm)
        placement = self.whole
        if placement is None:
            row = self._branch(at, branches)
            cut = self.cut.get(row)
            if cut is None:
                placement = self.uncut[row]
            else:
                placement = cut.inner if self._along_mm(row, at) < cut.at_mm else cut.outer
        return placement.on_sheet(at[None]).ravel()

    def lines(self, marker_wkt: str, branches: Sequence[int] = ()) -> list[Floats]:
        """Return the lines of a marker's geometry on the sheet, shape (k, 2) each.

        A straight line along a branch that is cut comes in two parts. One that is the axis of no
        branch is drawn on the piece of its middle.
        """
        found = list[Floats]()
        straight = (np.array(two) for line in marker_lines(marker_wkt) for two in pairwise(line))
        for ends_mm in straight:
            if self.whole:
                found.append(self.whole.on_sheet(ends_mm))
                continue
            row = self.axes.get(_rounded(ends_mm))
            if row is None:
                row = self._branch(ends_mm.mean(axis=0), branches)
            cut = self.cut.get(row)
            if cut is None:
                found.append(self.uncut[row].on_sheet(ends_mm))
                continue
            first, last = (self._along_mm(row, end) - cut.at_mm for end in ends_mm)
            if first * last >= 0.0:
                found.append((cut.inner if first + last < 0.0 else cut.outer).on_sheet(ends_mm))
                continue
            between = ends_mm[0] + first / (first - last) * (ends_mm[1] - ends_mm[0])
            sides = (cut.inner, cut.outer) if first < 0.0 else (cut.outer, cut.inner)
            found.append(sides[0].on_sheet(np.array([ends_mm[0], between])))
            found.append(sides[1].on_sheet(np.array([between, ends_mm[1]])))
        return found

    def _along_mm(self, row: int, at_mm: Floats) -> float:
        heading = float(self.layout.heading_rad[row])
        away = at_mm - self.layout.start_mm[row]
        return float(away[0] * math.cos(heading) + away[1] * math.sin(heading))

    def _branch(self, at_mm: Floats, branches: Sequence[int]) -> int:
        """Return the branch whose axis is nearest to a place."""
        rows = np.array(branches or range(len(self.layout.start_mm)), dtype=np.int64)
        start, whole = self.layout.start_mm[rows], self.layout.end_mm[rows]
        run = whole - start
        share = np.sum((at_mm - start) * run, axis=1) / np.maximum(np.sum(run**2, axis=1), 1e-12)
        near = start + np.clip(share, 0.0, 1.0)[:, None] * run
        return int(rows[np.hypot(*(near - at_mm).T).argmin()])


def _rounded(ends_mm: Floats) -> tuple[float, ...]:
    """Return the ends of a line as markers write them."""
    return tuple(np.round(ends_mm, 3).ravel().tolist())


def fact_rows(job: Job, name: str) -> list[Any]:
    """Return a list in the facts of a job, empty if it has none."""
    rows = job.facts.get(name, ())
    return rows if isinstance(rows, list) else []


def marker_lines(marker_wkt: str) -> list[Floats]:
    """Return the lines of a marker's geometry, shape (k, 2) each; a point has none."""
    if not marker_wkt:
        return []
    parts = shapely.get_parts(shapely.from_wkt(marker_wkt))
    return [shapely.get_coordinates(part) for part in parts if part.length > 0.0]
