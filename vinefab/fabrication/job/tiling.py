"""Where paths around a robot may be parted, and into which pieces.

A robot that is larger than the bed is parted across the straight stretches of its branches: both
sides at the same place of a branch's axis, away from joints, tips and pouches.
"""

import math
from bisect import bisect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce
from itertools import pairwise

import numpy as np
import shapely

from vinefab.core.validation import Floats
from vinefab.fabrication.job.marks import CLEAR_MM, region
from vinefab.model.job import LaserPath
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


TARGET_MM = 8.0
"""Size of a registration target, a cross."""

MOST_TILES = 64
"""Nobody puts more sheets together than that; a robot of a kilometre is refused at once."""

LEAST_APART_MM = 50.0
"""Two targets of a tile are at least so far apart."""

APART_ENOUGH_MM = 150.0
"""Targets this far apart need no more film than that (assumed)."""

_BESIDE_MM = (15.0, 30.0, 60.0, 120.0, 180.0, 240.0)
"""How far beyond the robot's box targets are looked for, before the whole window is."""

_RIM_MM = 15.0
"""Kept free around a tile's paths, so that windows overlap enough to share targets."""

_GRID_MM = 5.0
Point = tuple[float, float]
Piece = tuple[int, int]


@dataclass(slots=True)
class FilmTile:
    """One window onto the film."""

    pieces: set[Piece]  # what of the robot belongs to it
    box_mm: Box  # box around its paths
    # its paths, in the coordinates of the whole robot
    paths: list[LaserPath] = field(default_factory=list)
    low_mm: Point = (0.0, 0.0)  # lower left corner of its window
    after: int | None = None  # number of an earlier tile that it is aligned to; None for the first
    # found_mm, made_mm: middles of the targets that it is aligned to, and of those that it makes
    # for later tiles
    found_mm: list[Point] = field(default_factory=list)
    made_mm: list[Point] = field(default_factory=list)


class NoTilesError(Exception):
    """A robot cannot be parted; the text says why. Never leaves this room."""


def film_tiles(
    axes: BranchAxes, paths: Sequence[LaserPath], room_mm: Point, *, pass_through: bool = False
) -> list[FilmTile]:
    """Return the tiles of a robot, in the order in which they are cut, the mouth's first.

    They have no targets yet: see `register`.
    """
    contours = [path.contour for path in paths]
    _refuse_many(_least_tiles(contours, room_mm, pass_through=pass_through))
    places = stations_mm(axes, contours)
    parted = [stretches(axes, contour, places) for contour in contours]
    boxes: dict[Piece, Box] = {}
    for stretch in (stretch for found in parted for stretch in found):
        piece = _joined(axes, places, stretch.piece)
        box = Contour.from_segments([stretch.segment], closed=False).box_mm
        boxes[piece] = _around(boxes[piece], box) if piece in boxes else box
    fits = _fit(boxes, room_mm, pass_through=pass_through)
    grown = _grown(axes, places, boxes, fits)
    # Trying all pairs of very many takes too long; merging rarely leaves a quarter of them.
    _refuse_many(len(grown) // 4)
    tiles = _merged(grown, fits)
    _refuse_many(len(tiles))
    number = {piece: row for row, tile in enumerate(tiles) for piece in tile.pieces}
    for path, found in zip(paths, parted, strict=True):
        owners = [number[_joined(axes, places, stretch.piece)] for stretch in found]
        for owner, run in _runs(path.contour, [s.segment for s in found], owners):
            part = Contour.from_segments(_simple(run), closed=False)
            tiles[owner].paths.append(
                LaserPath(operation=path.operation, contour=part, label=path.label, of=path.of)
            )
    ordered = _ordered(axes, places, tiles)
    _place_windows(ordered, room_mm, boxes, pass_through=pass_through)
    return ordered


def _least_tiles(contours: Sequence[Contour], room_mm: Point, *, pass_through: bool) -> float:
    """Return a number of windows without which the robot cannot be covered."""
    whole = reduce(_around, (contour.box_mm for contour in contours))
    wide, high = (whole[2] - whole[0]) / room_mm[0], (whole[3] - whole[1]) / room_mm[1]
    return wide if pass_through else max(wide, high)


def _refuse_many(count: float) -> None:
    if count > MOST_TILES:
        raise NoTilesError(f"it would take more than {MOST_TILES} tiles")


def _joined(axes: BranchAxes, places: list[list[float]], piece: Piece) -> Piece:
    """Return the piece that stands for one: a branch's base belongs to its parent's end."""
    branch, part = piece
    while part == 0 and axes.parent[branch] >= 0:
        branch = axes.parent[branch]
        part = len(places[branch])
    return branch, part


def _fit(boxes: dict[Piece, Box], room_mm: Point, *, pass_through: bool) -> Callable[[Box], bool]:
    """Return how to tell whether a box, and the overlaps around it, fit a window."""
    spare = 2.0 * _RIM_MM
    wide, high = room_mm[0] - spare, room_mm[1] - spare
    if pass_through:
        whole = reduce(_around, boxes.values())
        if whole[3] - whole[1] > room_mm[1]:
            raise NoTilesError("it is wider than the bed, across the way the film is fed")
        high = math.inf

    def fits(box: Box) -> bool:
        return box[2] - box[0] <= wide and box[3] - box[1] <= high

    return fits


def _grown(
    axes: BranchAxes,
    places: list[list[float]],
    boxes: dict[Piece, Box],
    fits: Callable[[Box], bool],
) -> list[FilmTile]:
    """Grow tiles from the tips towards the mouth."""
    below: dict[Piece, list[Piece]] = {piece: [] for piece in boxes}
    for piece in boxes:
        branch, part = piece
        if part > 0:
            below[_joined(axes, places, (branch, part - 1))].append(piece)
    done: list[FilmTile] = []
    open_tiles: dict[Piece, FilmTile] = {}
    order = [(0, 0)]
    for piece in order:
        order += below[piece]
    for piece in reversed(order):
        tile = FilmTile(pieces={piece}, box_mm=boxes[piece])
        if not fits(tile.box_mm):
            name = axes.names[piece[0]]
            raise NoTilesError(f"branch {name} has a joint or tip with no room to part around it")
        for child in sorted(below[piece], key=lambda child: _area(open_tiles[child].box_mm)):
            other = open_tiles.pop(child)
            both = _around(tile.box_mm, other.box_mm)
            if fits(both):
                tile.pieces |= other.pieces
                tile.box_mm = both
            else:
                done.append(other)
        open_tiles[piece] = tile
    return [*done, *open_tiles.values()]


def _merged(tiles: list[FilmTile], fits: Callable[[Box], bool]) -> list[FilmTile]:
    """Join tiles that fit one window together, the closest first."""
    tiles = list(tiles)
    while True:
        pairs = [
            (_area(both), one, two)
            for one in range(len(tiles))
            for two in range(one + 1, len(tiles))
            if fits(both := _around(tiles[one].box_mm, tiles[two].box_mm))
        ]
        if not pairs:
            return tiles
        _, one, two = min(pairs)
        last = tiles.pop(two)
        tiles[one].pieces |= last.pieces
        tiles[one].box_mm = _around(tiles[one].box_mm, last.box_mm)


def _runs(
    contour: Contour, segments: list[Segment], owners: list[int]
) -> list[tuple[int, list[Segment]]]:
    """Return a path's runs through one tile each, reaching over where they are parted."""
    runs: list[tuple[int, list[Segment]]] = []
    for segment, owner in zip(segments, owners, strict=True):
        if runs and runs[-1][0] == owner:
            runs[-1][1].append(segment)
        else:
            runs.append((owner, [segment]))
    around = contour.closed and len(runs) > 1
    if around and runs[0][0] == runs[-1][0]:
        runs[0] = runs[0][0], [*runs.pop()[1], *runs[0][1]]
    last = len(runs) - 1
    return [
        (owner, lengthened(run, at_start=around or row > 0, at_end=around or row < last))
        for row, (owner, run) in enumerate(runs)
    ]


def _simple(run: list[Segment]) -> list[Segment]:
    """Return a run with straight stretches that go on in the same direction made one."""
    simple: list[Segment] = []
    for segment in run:
        before = simple[-1] if simple else None
        if (
            before is not None
            and before.bulge == segment.bulge == 0.0
            and before.part is segment.part
            and before.branch == segment.branch
            and abs(before.direction_rad() - segment.direction_rad()) < 1e-9
        ):
            simple[-1] = Segment(
                start_mm=before.start_mm,
                end_mm=segment.end_mm,
                part=segment.part,
                branch=segment.branch,
            )
        else:
            simple.append(segment)
    return simple


def _ordered(axes: BranchAxes, places: list[list[float]], tiles: list[FilmTile]) -> list[FilmTile]:
    """Return the tiles from the mouth on, each after one that it shares a branch with."""
    number = {piece: row for row, tile in enumerate(tiles) for piece in tile.pieces}
    links: dict[int, set[int]] = {row: set() for row in range(len(tiles))}
    for (branch, part), row in number.items():
        if part > 0:
            other = number[_joined(axes, places, (branch, part - 1))]
            links[row].add(other)
            links[other].add(row)
    order, before = [number[0, 0]], {number[0, 0]: -1}
    for row in order:
        for other in sorted(links[row] - before.keys()):
            before[other] = row
            order.append(other)
    for row in order[1:]:
        tiles[row].after = order.index(before[row])
    return [tiles[row] for row in order]


def _place_windows(
    tiles: list[FilmTile], room_mm: Point, boxes: dict[Piece, Box], *, pass_through: bool
) -> None:
    """Put each window around its tile, as near as possible to that of the tile before."""
    floor = min(box[1] for box in boxes.values())
    for tile in tiles:
        reach = OVERLAP_MM / 2.0
        x0, y0, x1, y1 = tile.box_mm
        lows = x1 + reach - room_mm[0], y1 + reach - room_mm[1]
        highs = x0 - reach, y0 - reach
        if tile.after is None:
            near = (lows[0] + highs[0]) / 2.0, (lows[1] + highs[1]) / 2.0
        else:
            near = tiles[tile.after].low_mm
        x, y = (min(max(n, low), high) for n, low, high in zip(near, lows, highs, strict=True))
        tile.low_mm = (x, floor) if pass_through else (x, y)


def register(tiles: Sequence[FilmTile], room_mm: Point, contours: Sequence[Contour]) -> None:
    """Find two targets for each tile after the first that an earlier tile can make."""
    taken = shapely.union_all([region(contour) for contour in contours])
    robot = reduce(_around, (contour.box_mm for contour in contours))
    for row, tile in enumerate(tiles):
        if tile.after is None:
            continue
        others = [tile.after, *(other for other in range(row) if other != tile.after)]
        for other in others:
            pair = _near_pair(_shared(tile.low_mm, tiles[other].low_mm, room_mm), robot, taken)
            if pair:
                tile.after, tile.found_mm = other, pair
                tiles[other].made_mm += pair
                crosses = [shapely.Point(point).buffer(TARGET_MM) for point in pair]
                taken = shapely.union_all([taken, *crosses])
                break
        else:
            raise NoTilesError(f"tile {row + 1} has no room for two registration targets")


def _shared(one: Point, two: Point, room_mm: Point) -> Box:
    """Return where two windows overlap, less the reach of a target."""
    rim = TARGET_MM / 2.0 + 0.5
    low = [max(a, b) + rim for a, b in zip(one, two, strict=True)]
    high = [min(a, b) + room - rim for a, b, room in zip(one, two, room_mm, strict=True)]
    return low[0], low[1], high[0], high[1]


def _near_pair(box: Box, robot: Box, taken: shapely.Geometry) -> list[Point]:
    """Return two free places of a box that are far enough apart, or else as far as possible.

    Places near the robot's own box go first: film that holds nothing but a target is lost.
    """
    for beside_mm in _BESIDE_MM:
        low = [max(a, b - beside_mm) for a, b in zip(box[:2], robot[:2], strict=True)]
        high = [min(a, b + beside_mm) for a, b in zip(box[2:], robot[2:], strict=True)]
        pair = _pair((low[0], low[1], high[0], high[1]), taken)
        if pair and math.dist(*pair) >= APART_ENOUGH_MM:
            return pair
    return _pair(box, taken)


def _pair(box: Box, taken: shapely.Geometry) -> list[Point]:
    """Return the two free places of a box that are farthest apart, or nothing."""
    if box[2] < box[0] or box[3] < box[1]:
        return []
    across, up = (
        np.linspace(low, high, max(2, math.ceil((high - low) / _GRID_MM) + 1))
        for low, high in ((box[0], box[2]), (box[1], box[3]))
    )
    grid: Floats = np.stack(np.meshgrid(across, up), axis=-1).reshape(-1, 2)
    shapely.prepare(taken)
    clear = CLEAR_MM + TARGET_MM * math.sqrt(0.5)
    free = grid[~shapely.dwithin(taken, shapely.points(grid), clear)]
    if len(free) < 2:
        return []
    corners = shapely.get_coordinates(shapely.MultiPoint(free).convex_hull)
    apart = np.hypot(*(corners[:, None] - corners[None]).transpose(2, 0, 1))
    one, two = np.unravel_index(int(apart.argmax()), apart.shape)
    if apart[one, two] < LEAST_APART_MM:
        return []
    return [(float(x), float(y)) for x, y in (corners[one], corners[two])]


def _around(one: Box, two: Box) -> Box:
    return min(one[0], two[0]), min(one[1], two[1]), max(one[2], two[2]), max(one[3], two[3])


def _area(box: Box) -> float:
    return (box[2] - box[0]) * (box[3] - box[1])
