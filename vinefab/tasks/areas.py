"""Areas that sensors and bodies reach: exact, fast, and as cells that several robots cover.

The fast ones are on strips, cells and lines of free space. Their errors are bounded, and measured
by `tests/tasks/measure_area_errors.py`.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple, Protocol

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.core.front_door import imported_later
from vinefab.core.validation import Floats, Ints
from vinefab.growth.batch import GrowthBlock
from vinefab.model.deployment import Deployment

if TYPE_CHECKING:
    from vinefab.tasks import areas_kernel
else:
    areas_kernel = imported_later("vinefab.tasks.areas_kernel")

# --- Exact areas -------------------------------------------------------------------------------

TOUCHING_MM = 1e-6
"""A wall this close to a tip or sensor is one that it lies on; tips are right to about 1e-9 mm."""

NUDGE_MM = 1e-5
"""A sensor on a wall is moved this far off it."""

_ARC_STEP_RAD = math.pi / 32.0
_SLACK = 1e-9


def disc_union(centres_mm: Floats, radius_mm: float) -> BaseGeometry:
    """Return the union of equal discs as polygons.

    Every disc is a regular polygon of the same area, so that discs that do not meet give their
    exact area.
    """
    return shapely.union_all(disc_polygons(centres_mm, radius_mm))


def disc_polygons(centres_mm: Floats, radius_mm: float) -> NDArray[np.object_]:
    """Return equal discs as regular polygons of the same area."""
    # Sides of the polygon that stands for a quarter of a disc in a union. At 16 a disc and its
    # polygon, equal in area, differ on less than 0.07 % of the disc's area, so the union is off by
    # less than 0.07 % of the discs' summed area; errors of either sign make it about a thousand
    # times less.
    quarter_segments = 16
    step = math.pi / (2 * quarter_segments)
    circumradius_mm = radius_mm * math.sqrt(step / math.sin(step))
    discs = shapely.buffer(shapely.points(centres_mm), circumradius_mm, quad_segs=quarter_segments)
    return np.asarray(discs)


def free_disc_areas_mm2(centres_mm: Floats, radius_mm: float, edges_mm: Floats) -> Floats:
    """Return the exact area of each disc within a free space, shape (n,).

    The area of a disc within a polygon is the sum over the polygon's edges of the signed area
    that the disc shares with the triangle from its centre to the edge: chords where the edge is
    inside the disc, sectors where it is outside.

    Parameters
    ----------
    edges_mm
        Directed edges with the free space on their left, shape (e, 2, 2).
    """
    # Some at once: tables of all centres by all edges may be larger than memory.
    most = max(1, _MOST_PAIRS // max(1, len(edges_mm)))
    parts = [
        _free_disc_areas_mm2(centres_mm[one : one + most], radius_mm, edges_mm)
        for one in range(0, len(centres_mm), most)
    ]
    return np.concatenate(parts) if parts else np.zeros(0)


_MOST_PAIRS = 50_000
"""Most discs times edges whose areas are taken at once."""


def _free_disc_areas_mm2(centres_mm: Floats, radius_mm: float, edges_mm: Floats) -> Floats:
    start = edges_mm[None, :, 0] - centres_mm[:, None]
    along = (edges_mm[:, 1] - edges_mm[:, 0])[None]
    enter, leave = _within(start, along, radius_mm)
    sectors = _turn(start, start + along)
    chords = np.zeros_like(sectors)
    near = leave > enter
    if near.any():
        base, step = start[near], np.broadcast_to(along, start.shape)[near]
        first = base + enter[near][:, None] * step
        last = base + leave[near][:, None] * step
        sectors[near] = _turn(base, first) + _turn(last, base + step)
        chords[near] = _cross(first, last)
    areas: Floats = 0.5 * (radius_mm**2 * sectors + chords).sum(axis=1)
    return areas


def _within(start: Floats, along: Floats, radius_mm: float) -> tuple[Floats, Floats]:
    """Return the share of each edge at which it enters and leaves the disc about the origin."""
    square = (along * along).sum(axis=-1)
    half = (start * along).sum(axis=-1)
    rest = (start * start).sum(axis=-1) - radius_mm**2
    root = np.sqrt(np.maximum(half * half - square * rest, 0.0))
    return np.clip((-half - root) / square, 0.0, 1.0), np.clip((-half + root) / square, 0.0, 1.0)


def _turn(first: Floats, last: Floats) -> Floats:
    """Return the angle from one vector to another, -pi to pi, 0 when either has no length."""
    turn: Floats = np.arctan2(_cross(first, last), (first * last).sum(axis=-1))
    return turn


def seen_areas(
    centres_mm: Floats, radius_mm: float, edges_mm: Floats
) -> tuple[Floats, BaseGeometry]:
    """Return the area that each sensor sees, shape (n,), and the union of these areas.

    A point is seen when it lies within the radius and no wall is between. The areas are exact;
    in the union, arcs are polygons of the same area as their sectors. A sensor on a wall sees
    what a sensor 1e-5 mm off it would, in the widest wedge of free space that it lies at.

    Parameters
    ----------
    centres_mm
        Sensors in free space or on its border, shape (n, 2).
    edges_mm
        Directed edges with the free space on their left, shape (e, 2, 2).
    """
    regions = [_region(centre, radius_mm, edges_mm) for centre in centres_mm]
    areas_mm2 = np.array([area for area, _ in regions], dtype=np.float64)
    polygons = [shapely.Polygon(ring) for _, ring in regions]
    union = shapely.union_all([p if p.is_valid else shapely.make_valid(p) for p in polygons])
    return areas_mm2, union


def _region(centre_mm: Floats, radius_mm: float, edges_mm: Floats) -> tuple[float, Floats]:
    """Return the area that one sensor sees and the ring around it, shape (k, 2).

    Between two neighbouring ends of walls, as seen from the sensor, one and the same wall is the
    nearest, or none is: what is seen there is a triangle or a sector.
    """
    # Walls that can hide something within the disc: those that face the sensor, which is on their
    # free side.
    near = edges_mm[_distances(edges_mm - centre_mm) < radius_mm]
    touched = near[_distances(near - centre_mm) < TOUCHING_MM]
    centre = centre_mm + NUDGE_MM * _off(touched - centre_mm)
    first, last = near[:, 0] - centre, near[:, 1] - centre
    faces = _cross(first, last) > 0.0
    first, along = first[faces], (last - first)[faces]
    begin, end = _within(first, along, radius_mm)
    some = end > begin
    first, along, begin, end = first[some], along[some], begin[some, None], end[some, None]
    first, last = first + begin * along, first + end * along
    along = last - first
    ends = np.concatenate([first, last])
    angles = np.unique(np.concatenate([np.arctan2(ends[:, 1], ends[:, 0]), [-math.pi, math.pi]]))
    middle = 0.5 * (angles[1:] + angles[:-1])
    wall, depth = _nearest(np.column_stack([np.cos(middle), np.sin(middle)]), first, along)
    area, ring = 0.0, list[Floats]()
    for index, (one, two) in enumerate(zip(angles[:-1].tolist(), angles[1:].tolist(), strict=True)):
        if depth[index] < radius_mm:
            hits = [_hit(angle, first[wall[index]], along[wall[index]]) for angle in (one, two)]
            area += 0.5 * float(_cross(hits[0], hits[1]))
            ring += hits
        else:
            area += 0.5 * radius_mm**2 * (two - one)
            # Points of the arc, moved out so that the polygon has the sector's area.
            count = max(1, math.ceil((two - one) / _ARC_STEP_RAD))
            step = (two - one) / count
            scale = math.sqrt(step / math.sin(step)) if step > 0.0 else 1.0
            turned = np.linspace(one, two, count + 1)
            points = np.column_stack([np.cos(turned), np.sin(turned)])
            ring.append(radius_mm * scale * points)
    return area, centre + np.vstack(ring)


def _off(touched: Floats) -> Floats:
    """Return the direction off some walls at the origin: the middle of the widest wedge there."""
    runs = touched[:, 1] - touched[:, 0]
    runs /= np.hypot(runs[:, 0], runs[:, 1])[:, None]
    leaving, arriving = (
        np.hypot(touched[:, end, 0], touched[:, end, 1]) > TOUCHING_MM for end in (1, 0)
    )
    if not (leaving.any() and arriving.any()):
        return np.zeros(2)
    one, two = runs[leaving, None], -runs[None, arriving]
    wedges = np.arctan2(_cross(one, two), (one * two).sum(axis=-1)) % math.tau
    wedges = np.where(wedges > 0.0, wedges, math.tau).min(axis=1)
    widest = int(wedges.argmax())
    (x, y), half = runs[leaving][widest].tolist(), 0.5 * float(wedges[widest])
    cosine, sine = math.cos(half), math.sin(half)
    return np.array([cosine * x - sine * y, cosine * y + sine * x])


def _nearest(rays: Floats, first: Floats, along: Floats) -> tuple[Ints, Floats]:
    """Return the nearest wall on each ray and how far it is, infinite where there is none."""
    if len(first) == 0:
        return np.zeros(len(rays), dtype=np.int64), np.full(len(rays), np.inf)
    ahead = _cross(rays[:, None], along[None])
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = _cross(first, along)[None] / ahead
        share = _cross(first[None], rays[:, None]) / ahead
    hits = (ahead > 0.0) & (share >= -_SLACK) & (share <= 1.0 + _SLACK)
    depth = np.where(hits, depth, np.inf)
    wall: Ints = depth.argmin(axis=1)
    nearest: Floats = depth.min(axis=1)
    return wall, nearest


def _hit(angle_rad: float, first: Floats, along: Floats) -> Floats:
    """Return where a ray meets a wall, at its end if that rounds to beyond it.

    A wall on whose line the sensor lies is seen edge-on, and a ray along it meets it anywhere.
    """
    ray = np.array([math.cos(angle_rad), math.sin(angle_rad)])
    ahead = float(_cross(ray, along))
    share = float(_cross(first, ray)) / ahead if ahead != 0.0 else 0.0
    return np.asarray(first + min(max(share, 0.0), 1.0) * along)


def _distances(edges: Floats) -> Floats:
    """Return the distance of edges from the origin, shape (e,)."""
    first, along = edges[:, 0], edges[:, 1] - edges[:, 0]
    share = np.clip(-(first * along).sum(axis=1) / (along * along).sum(axis=1), 0.0, 1.0)
    nearest = first + share[:, None] * along
    return np.asarray(np.hypot(nearest[:, 0], nearest[:, 1]))


def _cross(first: Floats, last: Floats) -> Floats:
    cross: Floats = first[..., 0] * last[..., 1] - first[..., 1] * last[..., 0]
    return cross


# --- Strips of free space: discs and bodies -----------------------------------------------------

STRIPS_PER_RADIUS = 10
"""Strips, and cells along them, per radius of the discs."""

MOST_RASTER_CELLS = 4_000_000
"""Limit of a raster's size: 32 MB; polygons are used beyond it."""


class Chains(NamedTuple):
    """The bodies of several growths, one after the other, j of them."""

    points_mm: Floats  # chain points, shape (p, 2)
    # index of each branch's first chain point within its growth, with the total at the end of every
    # growth: one entry more per growth than it has branches
    first_point: Ints
    # where the branches of each growth begin, with the total at the end, shape (j + 1,)
    branch: Ints
    room: Ints  # where the chain points of each growth begin, shape (j + 1,) or (j,)
    at_bend: NDArray[np.bool_]  # whether each chain point is a preformed bend, shape (p,)

    @classmethod
    def of(cls, deployment: Deployment) -> "Chains":
        """Return the body of one deployment."""
        points, branches = len(deployment.points_mm), len(deployment.tree)
        ends = np.array([0, branches]), np.array([0, points])
        at_bend = np.zeros(points, dtype=np.bool_)
        at_bend[deployment.bend_points] = True
        return cls(deployment.points_mm, deployment.first_point, *ends, at_bend)

    @classmethod
    def of_block(cls, block: GrowthBlock) -> "Chains":
        """Return the bodies of a block's growths."""
        growth = block.growth
        return cls(growth.points, growth.first_point, block.branch, block.room, block.at_bend)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FreeArea:
    """The free area of each strip to the left of each abscissa."""

    box: Floats  # lower left corner and the side of the cells, mm; shape (3,)
    # free area of each strip to the left of each cell's sides, shape (rows, columns + 1)
    free_mm2: Floats
    radius_mm: float  # radius of the discs
    segments: Floats  # area of the unit disc below heights evenly spaced from -1 to 1

    @classmethod
    def of(cls, edges_mm: Floats, radius_mm: float) -> "FreeArea | None":
        """Return the raster of a free space, None above `MOST_RASTER_CELLS`.

        Parameters
        ----------
        edges_mm
            Directed edges with the free space on their left, shape (e, 2, 2).
        """
        low = edges_mm.min(axis=(0, 1))
        size = edges_mm.max(axis=(0, 1)) - low
        side_mm = radius_mm / STRIPS_PER_RADIUS
        columns, rows = (max(1, math.ceil(float(length) / side_mm)) for length in size)
        if columns * rows > MOST_RASTER_CELLS:
            return None
        free = np.zeros((rows, columns + 1))
        box = np.array([*low, side_mm])
        areas_kernel.fill_strips(edges_mm, box, free, np.zeros_like(free))
        return cls(box=box, free_mm2=free, radius_mm=radius_mm, segments=segment_table())

    def covered_mm2(self, tips_mm: Floats, first: Ints) -> tuple[Floats, Floats]:
        """Return the free area that discs cover together, and the sum of each disc's free area.

        In each strip a rectangle of the same area stands for a disc. The two differ on less than
        4 % of the disc, and free area between two sides of a cell is taken as evenly spread, which
        moves less than 4 %: the error is below 8 % of the sum, whatever the map. In practice it is
        far smaller, because whole discs are exact and errors arise, with either sign, only where an
        outline meets a wall or another disc: over 1000 random deployments in four environments the
        area is within 0.6 % (0.05 to 0.09 % RMS) of the exact one.

        Parameters
        ----------
        tips_mm
            Centres of all discs, set after set, shape (m, 2).
        first
            Where each set begins, with the total at the end, shape (j + 1,).
        """
        largest = int(np.diff(first).max(initial=1))
        seen, summed = np.zeros((2, len(first) - 1))
        rows, most = len(self.free_mm2) + 2, 2 * STRIPS_PER_RADIUS + 3
        areas_kernel.cover_areas(
            tips_mm,
            first,
            self.radius_mm,
            self.segments,
            self.free_mm2,
            self.box,
            np.empty((2, largest), dtype=np.int64),
            np.empty((3, rows), dtype=np.int64),
            np.empty((4, rows)),
            np.empty((4, most * largest)),
            seen,
            summed,
        )
        return seen, summed

    def reached_mm2(self, chains: Chains) -> Floats:
        """Return the free area within the radius of each body, shape (j,).

        A cell's free area counts as if it lay at the cell's centre: a cell whose centre lies half
        a diagonal inside the edge of the reached area counts in full, one half a diagonal outside
        not at all, and only cells in between can be wrong, with either sign. The error is
        therefore below the free area of that band, 0.14 radii wide along the edge, whatever the
        map, and far smaller in practice.
        """
        weight = np.diff(self.free_mm2, axis=1)
        out = np.zeros(len(chains.branch) - 1)
        level, mark = np.empty(weight.shape), np.zeros(weight.shape, dtype=np.int64)
        areas_kernel.reach_areas(*chains[:4], self.radius_mm, weight, self.box, level, mark, out)
        return out


def segment_table() -> Floats:
    """Return the area of the unit disc below heights evenly spaced from -1 to 1."""
    # Entries of the table of circular segments: linear in between, within 1e-5 of the disc's area.
    table_steps = 1024
    y = np.linspace(-1.0, 1.0, table_steps + 1)
    table: Floats = 0.5 * math.pi + y * np.sqrt(1.0 - y * y) + np.arcsin(y)
    return table


# --- Walls by grid cells ------------------------------------------------------------------------

MOST_ENTRIES = 20_000_000
"""Limits of an index's size: 160 MB. One cell with all the walls is never too large."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class WallCells:
    """A uniform grid over walls that lists the walls near each cell."""

    walls_mm: Floats  # both ends of each wall, shape (e, 4)
    # lower left corner and side of the cells, mm, then columns and rows; shape (5,)
    grid: Floats
    # where the walls of each cell begin in ``item``, row by row, with the total at the end
    first: Ints
    # walls within reach of each cell, and perhaps some a little further off, in rising order
    item: Ints

    @classmethod
    def of(cls, walls_mm: Floats, side_mm: float, reach_mm: float) -> "WallCells | None":
        """Return the index of some walls, None if it would take too much memory.

        Parameters
        ----------
        walls_mm
            Both ends of each wall, at least one, shape (e, 4).
        side_mm
            Side of the cells.
        reach_mm
            Walls within this distance of a cell are listed in it.
        """
        ends = walls_mm.reshape(-1, 2)
        low, size = ends.min(axis=0), np.ptp(ends, axis=0)
        columns, rows = (max(1, math.ceil(float(length) / side_mm)) for length in size)
        most_wall_cells = 1_000_000
        if columns * rows > most_wall_cells:
            return None
        grid = np.array([*low, side_mm, columns, rows])
        number = np.zeros(columns * rows, dtype=np.int64)
        areas_kernel.count_walls(walls_mm, grid, reach_mm, number)
        first = np.concatenate([[0], np.cumsum(number)])
        if first[-1] > max(MOST_ENTRIES, len(walls_mm)):
            return None
        item = np.empty(first[-1], dtype=np.int64)
        areas_kernel.place_walls(walls_mm, grid, reach_mm, first[:-1].copy(), item)
        return cls(walls_mm=walls_mm, grid=grid, first=first, item=item)

    def numbers_at(self, places_mm: Floats) -> Ints:
        """Return the number of walls that the cells of some places list, shape (m,).

        Places outside the grid belong to the nearest cell.
        """
        low, side_mm, shape = self.grid[:2], self.grid[2], self.grid[3:].astype(np.int64)
        column, row = np.clip(((places_mm - low) / side_mm).astype(np.int64), 0, shape - 1).T
        cell = row * shape[0] + column
        return np.asarray(self.first[cell + 1] - self.first[cell])


# --- Lines of sight -----------------------------------------------------------------------------

LINES_PER_RADIUS = 40
"""Lines per radius of the discs of sight."""

LEAST_LINES = 160
"""Lines across a square map that is smaller than the discs."""


MOST_LINES = 1_000_000
"""Limit of their number: every growth visits all of them."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SightLines:
    """Parallel lines across a free space, and the walls that can hide something from each cell.

    All coordinates are rotated so that the lines run along x.
    """

    radius_mm: float  # how far sensors see
    # cosine and sine of the angle between x and the lines on the map
    direction: tuple[float, float]
    # walls within the radius of each cell, with free space on their left, rotated
    cells: WallCells
    line: Floats  # lower side of the lowest strip and how high each is, mm; shape (2,)
    lines: int  # how many there are, each in the middle of its strip

    @classmethod
    def of(cls, edges_mm: Floats, radius_mm: float) -> "SightLines | None":
        """Return the lines across a free space, None if they would be too many.

        Parameters
        ----------
        edges_mm
            Directed edges with the free space on their left, shape (e, 2, 2).
        """
        # Shadows of walls are as fine as the map, however far sensors see.
        side_mm = math.sqrt(np.ptp(edges_mm.reshape(-1, 2), axis=0).prod())
        step_mm = min(radius_mm / LINES_PER_RADIUS, side_mm / LEAST_LINES)
        direction = _direction(edges_mm, step_mm)
        walls_mm = _rotated(edges_mm, direction)
        low_mm, high_mm = float(walls_mm[..., 1].min()), float(walls_mm[..., 1].max())
        lines = max(1, math.ceil((high_mm - low_mm) / step_mm))
        if lines > MOST_LINES:
            return None
        # Sensors outside by rounding use the walls of the nearest cell.
        reach_mm = radius_mm + 2.0 * TOUCHING_MM
        cells = WallCells.of(walls_mm.reshape(-1, 4), radius_mm, reach_mm)
        if cells is None:
            return None
        return cls(
            radius_mm=radius_mm,
            direction=direction,
            cells=cells,
            line=np.array([low_mm, step_mm]),
            lines=lines,
        )

    def covered_mm2(self, tips_mm: Floats, first: Ints) -> tuple[Floats, Floats]:
        """Return the area that sensors see together, and the sum of the areas that each sees.

        The seen length on every line is exact, and stands for the strip about the line. Within a
        strip, the seen length changes by no more than the outline of the seen area runs along the
        lines there. The error is therefore below half a strip, at most an eightieth of the radius,
        times the length of the outline. It is far smaller in practice, because errors have either
        sign and arise only where the outline runs along the lines, whose direction is the one
        least followed by walls.

        Parameters
        ----------
        tips_mm
            All sensors, in free space or on its border, set after set, shape (m, 2).
        first
            Where each set begins, with the total at the end, shape (j + 1,).
        """
        tips_mm = _rotated(tips_mm, self.direction)
        sensors = int(np.diff(first).max(initial=0))
        number = np.concatenate([[0], np.cumsum(self.cells.numbers_at(tips_mm))])
        walls = int(np.diff(number[first]).max(initial=0))
        seen, summed = np.zeros((2, len(first) - 1))
        areas_kernel.seen_areas_by_lines(
            tips_mm,
            first,
            np.array([self.radius_mm, TOUCHING_MM, NUDGE_MM]),
            self.cells.walls_mm,
            self.cells.grid,
            self.cells.first,
            self.cells.item,
            self.line,
            np.empty((walls, 4)),
            np.empty((4, sensors + 1), dtype=np.int64),
            np.empty(self.lines, dtype=np.int64),
            np.empty((2, walls + sensors)),
            seen,
            summed,
        )
        return seen, summed


def _rotated(points_mm: Floats, direction: tuple[float, float]) -> Floats:
    """Return points in a frame whose x axis has a direction, shape (..., 2)."""
    x, y = points_mm[..., 0], points_mm[..., 1]
    cosine, sine = direction
    return np.stack([x * cosine + y * sine, y * cosine - x * sine], axis=-1)


def _direction(edges_mm: Floats, step_mm: float) -> tuple[float, float]:
    """Return the direction of lines that walls follow the least.

    The length that walls run between two neighbouring lines bounds the error.
    """
    runs = edges_mm[:, 1] - edges_mm[:, 0]
    best, least = (1.0, 0.0), math.inf
    directions = 16  # candidate directions of the lines
    for k in range(directions):
        direction = math.cos(math.pi * k / directions), math.sin(math.pi * k / directions)
        along, across = np.abs(_rotated(runs, direction)).T
        flat = across <= step_mm
        cost = along[flat].sum() + (along[~flat] * step_mm / across[~flat]).sum()
        if cost < least:
            best, least = direction, float(cost)
    return best


# --- Covered cells: what several robots cover together is the union of sets ---------------------

USUAL_CELLS, MOST_COVER_CELLS = 20_000, 250_000
CELLS_PER_RADIUS, FEWEST_PER_RADIUS = 10.0, 4.0
"""Cells across the radius of the covered area: the first where `USUAL_CELLS` are enough for that,
at least the second."""


class Cover(Protocol):
    """Elements that deployments cover, with the share of the whole that each is."""

    @property
    def weight(self) -> Floats:
        """Share of the whole of each element, shape (e,)."""
        ...

    @property
    def words(self) -> str:
        """What is covered, for people."""
        ...

    def covered(self, block: GrowthBlock) -> NDArray[np.bool_]:
        """Return the mask of the elements that each growth of a block covers, shape (j, e)."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CellGrid:
    """Square cells of a free space."""

    box: Floats  # lower left corner and side of the cells, mm; shape (3,)
    free_mm2: Floats  # free area of each cell, shape (rows, columns)

    @classmethod
    def of(cls, edges_mm: Floats, radius_mm: float) -> "CellGrid":
        """Return the cells of a free space for areas within a radius of something."""
        low = edges_mm.min(axis=(0, 1))
        size = edges_mm.max(axis=(0, 1)) - low
        side_mm = max(radius_mm / CELLS_PER_RADIUS, math.sqrt(float(size.prod()) / USUAL_CELLS))
        side_mm = min(side_mm, radius_mm / FEWEST_PER_RADIUS)
        columns, rows = (max(1, math.ceil(float(length) / side_mm)) for length in size)
        if columns * rows > MOST_COVER_CELLS:
            allowed = (
                f"at most {MOST_COVER_CELLS} cells of a quarter of the radius {radius_mm:g} mm"
            )
            raise BadInputError("map for several robots", f"{columns} x {rows} cells", allowed)
        strips, box = np.zeros((rows, columns + 1)), np.array([*low, side_mm])
        areas_kernel.fill_strips(edges_mm, box, strips, np.zeros_like(strips))
        # Rounding leaves cells without any free area a little above or below none.
        free_mm2 = np.diff(strips, axis=1)
        return cls(box=box, free_mm2=np.where(free_mm2 > 1e-9 * side_mm**2, free_mm2, 0.0))

    @property
    def is_free(self) -> NDArray[np.bool_]:
        """Which cells have free area, shape (rows * columns,)."""
        return np.asarray((self.free_mm2 > 0.0).ravel())

    @property
    def weight(self) -> Floats:
        """Share of the free space of each cell that has some, shape (e,)."""
        free_mm2 = self.free_mm2.ravel()[self.is_free]
        return np.asarray(free_mm2 / free_mm2.sum())

    @property
    def centres_mm(self) -> Floats:
        """Centre of each cell that has free area, shape (e, 2)."""
        rows, columns = np.nonzero(self.free_mm2 > 0.0)
        return np.asarray(self.box[:2] + self.box[2] * (np.column_stack([columns, rows]) + 0.5))

    def near(self, chains: Chains, radius_mm: float) -> NDArray[np.bool_]:
        """Return the mask of cells with centres within a radius of each body, shape (j, e)."""
        count, is_free = len(chains.branch) - 1, self.is_free
        found = np.empty((count, int(is_free.sum())), dtype=np.bool_)
        level, mark = np.empty(self.free_mm2.shape), np.zeros(self.free_mm2.shape, dtype=np.int64)
        for index in range(count):
            first, last = chains.branch[index], chains.branch[index + 1]
            mark[:] = 0
            areas_kernel.reach_areas(
                chains.points_mm,
                chains.first_point[first + index : last + index + 1],
                np.array([0, last - first]),
                chains.room[index : index + 1],
                radius_mm,
                self.free_mm2,
                self.box,
                level,
                mark,
                np.zeros(1),
            )
            # A centre on the radius counts as a half.
            found[index] = ((mark == 1) & (level >= 0.5)).ravel()[is_free]
        return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BodyCover:
    """Free space within a distance of a body."""

    grid: CellGrid
    radius_mm: float

    @property
    def weight(self) -> Floats:
        """Share of the free space of each cell."""
        return self.grid.weight

    @property
    def words(self) -> str:
        """What is covered."""
        return f"free space within {self.radius_mm:g} mm of a body"

    def covered(self, block: GrowthBlock) -> NDArray[np.bool_]:
        """Return the mask of the cells that each growth comes near to."""
        return self.grid.near(Chains.of_block(block), self.radius_mm)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TipCover:
    """Free space that sensors at tips see."""

    grid: CellGrid
    radius_mm: float
    edges_mm: Floats | None  # walls that hide what is behind them; None: nothing is hidden

    @property
    def weight(self) -> Floats:
        """Share of the free space of each cell."""
        return self.grid.weight

    @property
    def words(self) -> str:
        """What is covered."""
        sight = "" if self.edges_mm is None else ", in sight"
        return f"free space within {self.radius_mm:g} mm of a tip{sight}"

    def covered(self, block: GrowthBlock) -> NDArray[np.bool_]:
        """Return the mask of the cells that each growth's sensors see."""
        tips_mm, first = block.tips_mm()
        if self.edges_mm is None:
            # A tip is a body of no length.
            points = np.repeat(tips_mm, 2, axis=0)
            steps = [2 * np.arange(n + 1) for n in np.diff(first).tolist()]
            straight = np.zeros(len(points), dtype=np.bool_)
            chains = Chains(points, np.concatenate(steps), first, 2 * first, straight)
            return self.grid.near(chains, self.radius_mm)
        centres = self.grid.centres_mm
        found = np.zeros((len(block), len(centres)), dtype=np.bool_)
        for index in range(len(block)):
            tips = tips_mm[first[index] : first[index + 1]]
            if len(tips):
                _, seen = seen_areas(tips, self.radius_mm, self.edges_mm)
                shapely.prepare(seen)
                found[index] = shapely.intersects_xy(seen, centres)
        return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TargetCover:
    """Targets that bodies or tips come to."""

    targets_mm: Floats  # shape (t, 2)
    away_mm: Callable[[Chains], Floats]  # how far bodies are from them, shape (j, t)
    tolerance_mm: Floats  # of each target, shape (t,)

    @property
    def weight(self) -> Floats:
        """Share of each target."""
        return np.full(len(self.targets_mm), 1.0 / len(self.targets_mm))

    @property
    def words(self) -> str:
        """What is covered."""
        low_mm, high_mm = self.tolerance_mm.min(), self.tolerance_mm.max()
        most = "" if low_mm == high_mm else f" to {high_mm:g}"
        return f"targets within {low_mm:g}{most} mm"

    def covered(self, block: GrowthBlock) -> NDArray[np.bool_]:
        """Return the mask of the targets that each growth reaches."""
        return np.asarray(self.away_mm(Chains.of_block(block)) <= self.tolerance_mm)
