"""A plate that is larger than the bed: cut lines, dovetails and tiles."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import shapely
from numpy.typing import NDArray
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats
from vinefab.rig.rig_options import GRID_MM, Printer, RigOptions
from vinefab.rig.rig_plan import (
    Polygons,
    RigPlan,
    bridged,
    polygon_parts,
    snapped_union,
    without_slivers,
)

TAB_DEPTH_MM = 8.0
_NECK_HALF_MM = 4.0
_END_HALF_MM = 6.5
_FREE_MM = 2.0
_SPAN_PER_TAB_MM = 90.0
_STEP_MM = 1.0

Cell = tuple[int, int]
"""Row and column of a tile, from 0."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TileSeam:
    """The straight cut between two neighbouring tiles."""

    # whether it runs along y; the tile that gets the tabs is then the left one, else the lower
    upright: bool
    at_mm: float  # its x when upright, else its y
    # ends along its direction
    low_mm: float
    high_mm: float

    @property
    def line(self) -> shapely.LineString:
        """The cut."""
        ends = [(self.at_mm, self.low_mm), (self.at_mm, self.high_mm)]
        return shapely.LineString(ends if self.upright else [(y, x) for x, y in ends])


def tabs_of(seam: TileSeam, plate: BaseGeometry, solids: shapely.STRtree) -> list[Polygon]:
    """Return the tabs of a seam: dovetails that reach over it to the right or upwards.

    A tab stands only where the plate is whole around it and nothing stands on it: a socket under
    an obstacle would have to be bridged in the air by the printer. Where there is no such place,
    there is no tab.
    """
    margin_mm = TAB_DEPTH_MM + _END_HALF_MM + _FREE_MM  # clear of the joints of crossing seams
    low, high = seam.low_mm + margin_mm, seam.high_mm - margin_mm
    if high < low:
        return []
    count = max(1, round((high - low) / _SPAN_PER_TAB_MM))
    ends = np.linspace(low, high, count + 1)
    chosen = []
    for left, right in pairwise(ends):
        gap = _END_HALF_MM + _FREE_MM if count > 1 else 0.0
        places = np.arange(np.ceil(left + gap), right - gap + 1e-9, _STEP_MM)
        places = places[np.argsort(np.abs(places - 0.5 * (left + right)), kind="stable")]
        free = places[_is_free(seam, places, plate, solids)]
        for at_mm in free[:1].tolist():
            near, end = seam.at_mm, seam.at_mm + TAB_DEPTH_MM
            corners = [
                (near, at_mm - _NECK_HALF_MM),
                (end, at_mm - _END_HALF_MM),
                (end, at_mm + _END_HALF_MM),
                (near, at_mm + _NECK_HALF_MM),
            ]
            chosen.append(Polygon(corners if seam.upright else [(y, x) for x, y in corners]))
    return chosen


def _is_free(
    seam: TileSeam, places: Floats, plate: BaseGeometry, solids: shapely.STRtree
) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    half = _END_HALF_MM + _FREE_MM
    low, high = places - half, places + half
    near = np.full_like(places, seam.at_mm - TAB_DEPTH_MM)
    far = np.full_like(places, seam.at_mm + TAB_DEPTH_MM + _FREE_MM)
    corners = (near, low, far, high) if seam.upright else (low, near, high, far)
    boxes = shapely.box(*corners)
    free = np.asarray(shapely.contains_properly(plate, boxes), dtype=bool)
    free[np.unique(solids.query(boxes, predicate="intersects")[0])] = False
    return free


_GUARD_MM = 2.0
_CORNER_COST_MM = 20.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Edges:
    """Edges of polygons, solid on their left."""

    # end points, one edge per row
    start_mm: Floats
    end_mm: Floats

    @classmethod
    def of(cls, solids: Polygons) -> "Edges":
        """Return the edges of all rings of polygons that do not overlap."""
        rings = shapely.get_rings(shapely.orient_polygons(solids))
        points, ring = shapely.get_coordinates(rings, return_index=True)
        same = ring[1:] == ring[:-1]
        return cls(start_mm=points[:-1][same], end_mm=points[1:][same])

    def turned(self) -> "Edges":
        """Swap x and y; reversing the edges keeps the solid on their left."""
        return Edges(start_mm=self.end_mm[:, ::-1], end_mm=self.start_mm[:, ::-1])

    def costs_mm(self, lines_mm: Floats, even_mm: float) -> Floats:
        """Return what it costs to cut along upright lines, in millimetres of cut obstacle.

        A corner within 2 mm of the line counts like 20 mm of obstacle, because a thin tip would
        be cut off; between equals the more even cut is cheaper.

        Parameters
        ----------
        lines_mm
            Their x, shape (m,).
        """
        near = np.sort(self.start_mm[:, 0])
        corners = np.searchsorted(near, lines_mm + _GUARD_MM, side="right")
        corners = corners - np.searchsorted(near, lines_mm - _GUARD_MM)
        crossed_mm = np.array([self.length_mm(x_mm) for x_mm in lines_mm])
        uneven_mm = 1e-3 * np.abs(lines_mm - even_mm)
        return np.asarray(crossed_mm + _CORNER_COST_MM * corners + uneven_mm, dtype=np.float64)

    def length_mm(self, x_mm: float) -> float:
        """Return the length of the upright line x = x_mm in the solids.

        Along the line, an edge that runs to the right has the solid above it, one that runs to
        the left has it below: the lengths add up as signed heights, without any sorting.
        """
        start_x, end_x = self.start_mm[:, 0], self.end_mm[:, 0]
        crossing: NDArray[np.bool_] = (start_x <= x_mm) != (end_x <= x_mm)
        start, end = self.start_mm[crossing], self.end_mm[crossing]
        share = (x_mm - start[:, 0]) / (end[:, 0] - start[:, 0])
        y_mm = start[:, 1] + share * (end[:, 1] - start[:, 1])
        return float(-(np.sign(end[:, 0] - start[:, 0]) * y_mm).sum())


_LEAST_TILE_MM = 5.0 * TAB_DEPTH_MM


@dataclass(frozen=True, slots=True, kw_only=True)
class Cuts:
    """The lines of a grid of tiles, the plate's box included."""

    # ascending; tile (row, column) lies between neighbouring values
    x_mm: tuple[float, ...]
    y_mm: tuple[float, ...]
    turned: bool  # whether the tiles are turned by a quarter on the bed

    def cells(self) -> Iterator[tuple[Cell, Polygon]]:
        """Yield row and column of each tile with its rectangle, row by row."""
        for row, (y_low, y_high) in enumerate(pairwise(self.y_mm)):
            for column, (x_low, x_high) in enumerate(pairwise(self.x_mm)):
                yield (row, column), shapely.box(x_low, y_low, x_high, y_high)


def cuts_of(
    box_mm: tuple[float, float, float, float],
    solids: Polygons,
    printer: Printer,
    options: RigOptions,
) -> Cuts:
    """Choose the cut lines.

    As few tiles as the bed allows, in the better of the two ways to lay them on it. Each line may
    wander within what the tile size allows, to cross as little obstacle as possible and to stay
    away from obstacles' corners, so that no thin tip is cut off.
    """
    size_mm = box_mm[2] - box_mm[0], box_mm[3] - box_mm[1]
    columns, rows, turn = grid_of(size_mm, printer, options)
    bed_mm = usable_mm(printer, options)
    if turn:
        bed_mm = bed_mm[1], bed_mm[0]
    edges = Edges.of(solids)
    return Cuts(
        x_mm=_lines((box_mm[0], box_mm[2]), columns, bed_mm[0], edges),
        y_mm=_lines((box_mm[1], box_mm[3]), rows, bed_mm[1], edges.turned()),
        turned=turn,
    )


def grid_of(
    size_mm: tuple[float, float], printer: Printer, options: RigOptions
) -> tuple[int, int, bool]:
    """Return how many columns and rows of tiles a plate takes, and whether they lie turned."""
    (width_mm, depth_mm), bed_mm = size_mm, usable_mm(printer, options)
    straight = _count(width_mm, bed_mm[0]), _count(depth_mm, bed_mm[1])
    turned = _count(width_mm, bed_mm[1]), _count(depth_mm, bed_mm[0])
    turn = turned[0] * turned[1] < straight[0] * straight[1]
    columns, rows = turned if turn else straight
    if columns * rows > options.most_parts:
        plate = f"a plate of {width_mm:.0f} x {depth_mm:.0f} mm on {printer.name}"
        allowed = f"at most {options.most_parts} for {plate}: a larger bed, a smaller scale, or "
        allowed += "more --most-parts"
        raise BadInputError("parts", columns * rows, allowed)
    return columns, rows, turn


def usable_mm(printer: Printer, options: RigOptions) -> tuple[float, float]:
    """Return width and depth of the bed inside its margin."""
    margin_mm = 2.0 * options.bed_margin_mm
    return printer.bed_width_mm - margin_mm, printer.bed_depth_mm - margin_mm


def _count(length_mm: float, bed_mm: float) -> int:
    """Return how many tiles cover a length; all but the last carry joints that stick out."""
    if length_mm <= bed_mm:
        return 1
    tile_mm = bed_mm - TAB_DEPTH_MM
    if tile_mm < _LEAST_TILE_MM:
        least_mm = _LEAST_TILE_MM + TAB_DEPTH_MM
        raise BadInputError("printer.bed", bed_mm, f"at least {least_mm:g} mm without its margin")
    return int(np.ceil((length_mm - 1e-9) / tile_mm))


def _lines(
    span_mm: tuple[float, float], count: int, bed_mm: float, edges: Edges
) -> tuple[float, ...]:
    """Place the cuts one after another, each where it costs least."""
    tile_mm = bed_mm - TAB_DEPTH_MM
    lines = [span_mm[0]]
    for index in range(1, count):
        even_mm = span_mm[0] + (span_mm[1] - span_mm[0]) * index / count
        # Even tiles have this much to spare; half of it to either side keeps every tile on the bed.
        spare_mm = max(0.0, tile_mm - (span_mm[1] - span_mm[0]) / count)
        low, high = even_mm - 0.5 * spare_mm, even_mm + 0.5 * spare_mm
        choices = np.arange(np.ceil(low / _STEP_MM), np.floor(high / _STEP_MM) + 1.0) * _STEP_MM
        if len(choices) == 0:
            choices = np.array([round(even_mm, 3)])
        lines.append(float(choices[np.argmin(edges.costs_mm(choices, even_mm))]))
    return (*lines, span_mm[1])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RigTile:
    """The plan of one connected part."""

    cell: Cell  # where in the grid it lies
    # outline and what stands on it; both snapped, each corner of one on the other's edge being a
    # corner there too
    plate: Polygon
    solids: Polygons


@dataclass(frozen=True, slots=True, kw_only=True)
class Dovetail:
    """A dovetail between two tiles."""

    giver: Cell  # the tile with the tab
    taker: Cell  # the tile with the socket
    # outlines
    tab: Polygon
    socket: BaseGeometry

    @property
    def gap_mm2(self) -> float:
        """Area between tab and socket that stays empty."""
        return float(self.socket.difference(self.tab).area)


def dovetails_of(plan: RigPlan, cuts: Cuts, clearance_mm: float) -> tuple[list[Dovetail], int]:
    """Return the dovetails of all seams between neighbouring tiles, and how many seams have none.

    No room for a joint is no error: such tiles are glued.
    """
    plate = plan.plate
    shapely.prepare(plate)
    tree = shapely.STRtree(plan.solids)
    joints: list[Dovetail] = []
    bare = 0
    for seam, giver, taker in _seams(cuts):
        tabs = tabs_of(seam, plate, tree)
        bare += not tabs and seam.line.intersects(plate)
        joints += [
            Dovetail(giver=giver, taker=taker, tab=tab, socket=_socket(tab, seam, clearance_mm))
            for tab in tabs
        ]
    return joints, bare


def rig_tiles(
    plan: RigPlan, cuts: Cuts, joints: Sequence[Dovetail], least_mm: tuple[float, float]
) -> Iterator[RigTile]:
    """Yield the plans of all parts, row by row.

    Parameters
    ----------
    least_mm
        Width of slivers that are left out, and radius of bridges.
    """
    sliver_mm, bridge_mm = least_mm
    tree = shapely.STRtree(plan.solids)
    for cell, rectangle in cuts.cells():
        tabs = [joint.tab for joint in joints if joint.giver == cell]
        sockets = [joint.socket for joint in joints if joint.taker == cell]
        own = shapely.intersection(plan.plate, rectangle, grid_size=GRID_MM)
        own = shapely.union_all([own, *tabs], grid_size=GRID_MM)
        own = shapely.difference(own, shapely.union_all(sockets), grid_size=GRID_MM)
        for plate in without_slivers(polygon_parts(own), max(least_mm))[0]:
            near = plan.solids[np.sort(tree.query(plate))]
            solids = snapped_union(shapely.intersection(near, plate, grid_size=GRID_MM))
            solids, _ = bridged(without_slivers(solids, sliver_mm)[0], plate, bridge_mm)
            # Snapping moved corners on slanted edges by up to half a step: let the plate follow, so
            # that no solid hangs over its edge and no two edges nearly coincide.
            whole = max(snapped_union(solids, plate), key=shapely.area)
            yield RigTile(cell=cell, plate=whole, solids=solids)


def _seams(cuts: Cuts) -> Iterator[tuple[TileSeam, Cell, Cell]]:
    """Yield each seam with the tile that gives tabs and the one that takes them."""
    x, y = cuts.x_mm, cuts.y_mm
    rows, columns = len(y) - 1, len(x) - 1
    for row in range(rows):
        for column in range(1, columns):
            seam = TileSeam(upright=True, at_mm=x[column], low_mm=y[row], high_mm=y[row + 1])
            yield seam, (row, column - 1), (row, column)
    for row in range(1, rows):
        for column in range(columns):
            seam = TileSeam(upright=False, at_mm=y[row], low_mm=x[column], high_mm=x[column + 1])
            yield seam, (row - 1, column), (row, column)


def _socket(tab: Polygon, seam: TileSeam, clearance_mm: float) -> BaseGeometry:
    """Return the socket's share beyond the seam; what lies before it belongs to the giver."""
    socket = tab.buffer(clearance_mm, join_style="mitre")
    x_min, y_min, x_max, y_max = socket.bounds
    if seam.upright:
        x_min = seam.at_mm
    else:
        y_min = seam.at_mm
    return shapely.intersection(socket, shapely.box(x_min, y_min, x_max, y_max))
