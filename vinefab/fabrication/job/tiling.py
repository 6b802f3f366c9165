"""Tiles of a robot larger than the bed, and the registration of film that moves.

Paths are parted across straight stretches of branches: both sides at the same place of the axis,
away from joints, tips and pouches. The tree of the resulting pieces is divided into tiles from its
tips on: a piece joins the tile of its parent as long as that still fits. Each tile is a window of
the size of the bed onto the same film. Two targets are marked with one tile and found for the next.

A sheet that leaves the bed to be sealed by hand comes back onto pins. Three holes fit one way only;
two crosses, marked and drawn on the layer that is never cut, show by the pointer whether it lies
right.
"""

import math
from bisect import bisect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import shapely

from vinefab.core.validation import Floats
from vinefab.fabrication.job.marks import CLEAR_MM, Box, mark, region
from vinefab.fabrication.job.passes import BodyPaths, in_order, sealed_by_hand
from vinefab.fabrication.job.placement import (
    BedPlacement,
    LayoutPlacement,
    box_around_mm,
    place_contours,
    placed_at,
)
from vinefab.fabrication.job.tile_order import in_making_order
from vinefab.fabrication.job.tile_window import BranchRun, FilmTile
from vinefab.model.design import Design
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.machine import Sealer
from vinefab.model.outline import Contour, Part, Segment
from vinefab.outline.body_outline import flat_layout
from vinefab.outline.joint import Point

OVERLAP_MM = 12.0
"""Least overlap of paths where they are parted, half of it on each side."""


def overlap_mm(profile: LaserProfile) -> float:
    """Return the overlap of paths where they are parted: that of closed seams, if it is larger."""
    return max(OVERLAP_MM, profile.settings(profile.recipe.seals).overcut_mm.value)


_MEETS_MM = 1e-6

Range = tuple[float, float]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BranchAxes:
    """The axes of the branches on the sheet, n of them; the trunk's begins at the mouth."""

    names: tuple[str, ...]  # ids of the branches
    parent: tuple[int, ...]  # index of each branch's parent, -1 for the trunk
    start_mm: Floats  # starts of the axes, shape (n, 2)
    along: Floats  # unit vectors, shape (n, 2)

    @classmethod
    def of(cls, design: Design, placement: LayoutPlacement) -> "BranchAxes":
        """Return the axes of a design whose flat layout lies somewhere on the sheet."""
        layout, turn = flat_layout(design), replace(placement, dx_mm=0.0, dy_mm=0.0)
        start = layout.start_mm.copy()
        start[0, 0] -= layout.tail_mm
        along = np.column_stack([np.cos(layout.heading_rad), np.sin(layout.heading_rad)])
        return cls(
            names=layout.tree.ids,
            parent=tuple(layout.tree.parent.tolist()),
            start_mm=placement.on_sheet(start),
            along=turn.on_sheet(along),
        )

    def station_mm(self, branch: int, point_mm: Sequence[float]) -> float:
        """Return the station of a point along a branch's axis."""
        return float(np.dot(np.subtract(point_mm, self.start_mm[branch]), self.along[branch]))

    def is_left(self, branch: int, point_mm: Sequence[float]) -> bool:
        """Whether a point lies left of a branch."""
        x, y = np.subtract(point_mm, self.start_mm[branch])
        return bool(self.along[branch][0] * y - self.along[branch][1] * x > 0.0)


def stations_mm(
    axes: BranchAxes, contours: Sequence[Contour], overlap_mm: float = OVERLAP_MM
) -> list[list[float]]:
    """Return the places along each branch's axis where all paths may be parted."""
    rows = {name: row for row, name in enumerate(axes.names)}
    allowed: dict[tuple[int, Part], list[Range]] = {}
    around = [contour for contour in contours if len(contour) > 1]
    for contour in around:
        # The longest straight stretch of each side of a branch, along the branch's axis.
        sides: dict[tuple[int, Part, bool], Range] = {}
        for segment in contour.segments:
            if segment.bulge or segment.part not in (Part.SIDE, Part.TAIL):
                continue
            row = rows[segment.branch]
            low, high = sorted(axes.station_mm(row, p) for p in (segment.start_mm, segment.end_mm))
            key = row, segment.part, axes.is_left(row, segment.start_mm)
            had = sides.get(key, (0.0, -1.0))
            # A cut that starts in the middle of a side has two segments there.
            if had[1] >= had[0] and low <= had[1] + 1e-6 and high >= had[0] - 1e-6:
                low, high = min(low, had[0]), max(high, had[1])
            if high - low >= had[1] - had[0]:
                sides[key] = low, high
        for row, part, left in sides:
            if left and (row, part, False) in sides:
                both = sides[row, part, True], sides[row, part, False]
                allowed.setdefault((row, part), []).extend(both)
    found: list[list[float]] = [[] for _ in axes.names]
    from_bend_mm = 10.0  # least distance between a parting and a joint, tip, pouch or collar
    clear = from_bend_mm + overlap_mm / 2.0
    step_mm = 25.0
    for (row, _), ranges in allowed.items():
        low, high = max(one for one, _ in ranges) + clear, min(two for _, two in ranges) - clear
        if high >= low and len(ranges) == 2 * len(around):
            count = math.floor((high - low) / step_mm)
            step = (high - low) / (count + 1)
            found[row] += [low + step * (k + 0.5) for k in range(count + 1)]
    return [sorted(places) for places in found]


def stretches(
    axes: BranchAxes, contour: Contour, places_mm: list[list[float]]
) -> list[tuple[Segment, BranchRun]]:
    """Return the segments of a path parted at all places allowed, each with where it lies."""
    rows = {name: row for row, name in enumerate(axes.names)}
    found = []
    for segment in contour.segments:
        row, ends = rows[segment.branch], [segment.start_mm, segment.end_mm]
        if not segment.bulge and segment.part is not Part.MOUTH:
            first, last = (axes.station_mm(row, end) for end in ends)
            # A place where the segment ends anyway, but for rounding, would leave a piece of no
            # length.
            low, high = min(first, last) + _MEETS_MM, max(first, last) - _MEETS_MM
            between = [place for place in places_mm[row] if low < place < high]
            start, run = np.array(ends[0]), np.subtract(ends[1], ends[0])
            shares = sorted((place - first) / (last - first) for place in between)
            ends[1:1] = [_point(start + share * run) for share in shares]
        for one, two in pairwise(ends):
            middle = (one[0] + two[0]) / 2.0, (one[1] + two[1]) / 2.0
            piece = row, bisect(places_mm[row], axes.station_mm(row, middle))
            found.append((replace(segment, start_mm=one, end_mm=two), piece))
    return found


def lengthened(
    run: list[Segment], overlap_mm: float, *, at_start: bool, at_end: bool
) -> list[Segment]:
    """Return a run of segments extended by half the overlap at its parted ends."""
    longer = list(run)
    for row, wanted, sign in ((0, at_start, -1.0), (-1, at_end, 1.0)):
        if wanted:
            segment = longer[row]
            start, end = np.array(segment.start_mm), np.array(segment.end_mm)
            beyond = sign * overlap_mm / 2.0 * (end - start) / segment.length_mm
            if sign < 0.0:
                longer[row] = replace(segment, start_mm=_point(start + beyond))
            else:
                longer[row] = replace(segment, end_mm=_point(end + beyond))
    return longer


def _point(point: Floats) -> tuple[float, float]:
    return float(point[0]), float(point[1])


TARGET_MM = 8.0
"""Width and height of a registration target, a cross."""

STRIP_TARGET_MM = 5.0
"""Width and height of a target on the robot, a smaller cross."""

STRIP_CLEAR_MM = 2.0
"""Lumen between a target on the robot and its seam."""

_TARGET_RIM_MM = TARGET_MM / 2.0 + 0.5


class NoTilesError(Exception):
    """A robot cannot be parted into tiles, for the reason given; `tiled` catches it."""


def film_tiles(
    axes: BranchAxes,
    paths: Sequence[LaserPath],
    room_mm: Point,
    overlap_mm: float = OVERLAP_MM,
    *,
    pass_through: bool = False,
) -> list[FilmTile]:
    """Return the tiles of a robot in the order of cutting, the mouth's first; see `register`."""
    contours = [path.contour for path in paths]
    x0, y0, x1, y1 = box_around_mm(contours)
    wide, high = (x1 - x0) / room_mm[0], (y1 - y0) / room_mm[1]
    _refuse_many(wide if pass_through else max(wide, high))
    places = stations_mm(axes, contours, overlap_mm)
    parted = [stretches(axes, contour, places) for contour in contours]
    boxes: dict[BranchRun, Box] = {}
    for segment, piece in (stretch for found in parted for stretch in found):
        whole = _joined(axes, places, piece)
        box = segment.box_mm
        boxes[whole] = union_box(boxes[whole], box) if whole in boxes else box
    if pass_through and y1 - y0 > room_mm[1]:
        raise NoTilesError("it is wider than the bed, across the way the film is fed")

    def fits(box: Box) -> bool:
        """Whether a box and the overlaps around it fit a window."""
        across, up = box[2] - box[0], box[3] - box[1]
        # Margin around a tile's paths, so that windows overlap enough to share targets.
        rim_mm = 15.0
        spare = 2.0 * rim_mm
        return across <= room_mm[0] - spare and (pass_through or up <= room_mm[1] - spare)

    grown = _grown(axes, places, boxes, fits)
    # Trying all pairs of very many tiles takes too long; merging rarely leaves a quarter of them.
    _refuse_many(len(grown) // 4)
    tiles = _merged(grown, fits)
    _refuse_many(len(tiles))
    number = {piece: row for row, tile in enumerate(tiles) for piece in tile.pieces}
    for path, found in zip(paths, parted, strict=True):
        owners = [number[_joined(axes, places, piece)] for _, piece in found]
        for owner, run in _runs(
            path.contour, [segment for segment, _ in found], owners, overlap_mm
        ):
            part = Contour.from_segments(_simple(run), closed=False)
            tiles[owner].paths.append(
                LaserPath(operation=path.operation, contour=part, label=path.label, of=path.of)
            )
    ordered = _ordered(axes, places, tiles)
    _place_windows(ordered, room_mm, boxes, overlap_mm, pass_through=pass_through)
    _mark_partings(ordered, axes, places, room_mm)
    return ordered


def _refuse_many(count: float) -> None:
    most_tiles = 64  # most tiles of a robot; a robot of a kilometre is refused at once
    if count > most_tiles:
        raise NoTilesError(f"it would take more than {most_tiles} tiles")


def _joined(axes: BranchAxes, places: list[list[float]], piece: BranchRun) -> BranchRun:
    """Return the piece that another one is part of: a branch's base belongs to its parent's end."""
    branch, part = piece
    while part == 0 and axes.parent[branch] >= 0:
        branch = axes.parent[branch]
        part = len(places[branch])
    return branch, part


def _grown(
    axes: BranchAxes,
    places: list[list[float]],
    boxes: dict[BranchRun, Box],
    fits: Callable[[Box], bool],
) -> list[FilmTile]:
    """Grow tiles from the tips towards the mouth."""
    below: dict[BranchRun, list[BranchRun]] = {piece: [] for piece in boxes}
    for piece in boxes:
        branch, part = piece
        if part > 0:
            below[_joined(axes, places, (branch, part - 1))].append(piece)
    done: list[FilmTile] = []
    open_tiles: dict[BranchRun, FilmTile] = {}
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
            both = union_box(tile.box_mm, other.box_mm)
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
            if fits(both := union_box(tiles[one].box_mm, tiles[two].box_mm))
        ]
        if not pairs:
            return tiles
        _, one, two = min(pairs)
        last = tiles.pop(two)
        tiles[one].pieces |= last.pieces
        tiles[one].box_mm = union_box(tiles[one].box_mm, last.box_mm)


def _runs(
    contour: Contour, segments: list[Segment], owners: list[int], overlap_mm: float
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
        (
            owner,
            lengthened(run, overlap_mm, at_start=around or row > 0, at_end=around or row < last),
        )
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
    tiles: list[FilmTile],
    room_mm: Point,
    boxes: dict[BranchRun, Box],
    overlap_mm: float,
    *,
    pass_through: bool,
) -> None:
    """Put each window around its tile, as near as possible to that of the tile before."""
    floor = min(box[1] for box in boxes.values())
    for tile in tiles:
        reach = overlap_mm / 2.0
        x0, y0, x1, y1 = tile.box_mm
        lows = x1 + reach - room_mm[0], y1 + reach - room_mm[1]
        highs = x0 - reach, y0 - reach
        if tile.after is None:
            near = (lows[0] + highs[0]) / 2.0, (lows[1] + highs[1]) / 2.0
        else:
            near = tiles[tile.after].low_mm
        x, y = (min(max(n, low), high) for n, low, high in zip(near, lows, highs, strict=True))
        tile.low_mm = (x, floor) if pass_through else (x, y)


def _mark_partings(
    tiles: list[FilmTile], axes: BranchAxes, places: list[list[float]], room_mm: Point
) -> None:
    """Put a target on the robot wherever two tiles part a branch that is wide enough for it.

    Only film that is not cut yet holds the robot: targets outside of it do not tell whether it has
    moved.
    """
    number = {piece: row for row, tile in enumerate(tiles) for piece in tile.pieces}
    sides = shapely.union_all(
        [shapely.LineString(path.contour.points_mm) for tile in tiles for path in tile.paths]
    )
    half = STRIP_TARGET_MM / 2.0
    for (branch, part), row in number.items():
        other = row if part == 0 else number[_joined(axes, places, (branch, part - 1))]
        if other == row:
            continue
        at = axes.start_mm[branch] + places[branch][part - 1] * axes.along[branch]
        point = _point(at)
        in_both = all(
            tiles[one].low_mm[axis] + half <= point[axis] <= tiles[one].low_mm[axis] + room - half
            for one in (row, other)
            for axis, room in enumerate(room_mm)
        )
        if in_both and sides.distance(shapely.Point(point)) >= half + STRIP_CLEAR_MM:
            tiles[min(row, other)].strip_made_mm.append(point)
            tiles[max(row, other)].strip_found_mm.append(point)


def union_box(one: Box, two: Box) -> Box:
    """Return the box around two boxes."""
    return min(one[0], two[0]), min(one[1], two[1]), max(one[2], two[2]), max(one[3], two[3])


def _area(box: Box) -> float:
    return (box[2] - box[0]) * (box[3] - box[1])


LEAST_APART_MM = 50.0
"""Least distance between the two targets of a tile."""


_BESIDE_MM = (15.0, 30.0, 60.0, 120.0, 180.0, 240.0)
"""Distances from the robot's box within which targets are placed, before all of the window is."""

TARGET = "registration target"
"""Label of the lines of a registration target."""

STRIP_TARGET = "registration target on the robot"
"""Label of the lines of a target on the robot, which is drawn by hand."""

VERIFICATION = "verification mark"
"""Label of the first marks of a tile, over the targets that it is aligned by."""

VERIFY = "verify"
"""Variant of verification marks, which gives them a separate layer."""

_TURNS_RAD = (0.0, math.pi / 2, math.pi / 4, -math.pi / 4)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tiled:
    """A robot in tiles, in the coordinates of its film."""

    placement: BedPlacement  # of the whole robot
    tiles: tuple[FilmTile, ...]
    film_mm: Point = (0.0, 0.0)  # lower left corner of the film


def tiled(
    design: Design, body: BodyPaths, profile: LaserProfile, *, pass_through: bool = False
) -> Tiled | str:
    """Return a robot in as few tiles as the rotations tried allow, or why it cannot be tiled."""
    room, margin = profile.machine.usable_mm, profile.machine.margin_mm.value
    contours = [path.contour for path in body.paths]
    best = place_contours(contours, (1e9, room[1]) if pass_through else room, margin)
    found: list[tuple[int, Tiled, list[LaserPath]]] = []
    reasons: dict[int, str] = {}
    for row, turn in enumerate(
        dict.fromkeys((best.angle_rad, *(() if pass_through else _TURNS_RAD)))
    ):
        placement = replace(placed_at(contours, turn, room, margin), fits=False)
        paths = [replace(path, contour=placement.moved(path.contour)) for path in body.paths]
        try:
            tiles = film_tiles(
                BranchAxes.of(design, placement),
                paths,
                room,
                overlap_mm(profile),
                pass_through=pass_through,
            )
        except NoTilesError as error:
            reasons[row] = str(error)
        else:
            found.append((row, Tiled(placement=placement, tiles=tuple(tiles)), paths))
    # Targets take longest to place, so the fewest tiles come first.
    for row, one, paths in sorted(found, key=lambda option: len(option[1].tiles)):
        try:
            register(one.tiles, room, [path.contour for path in paths])
        except NoTilesError as error:
            reasons[row] = str(error)
        else:
            return replace(one, tiles=tuple(in_making_order(one.tiles, profile, room)))
    return reasons[min(reasons)]


def register(tiles: Sequence[FilmTile], room_mm: Point, contours: Sequence[Contour]) -> None:
    """Place two targets for each tile after the first, which an earlier tile makes."""
    taken = shapely.union_all([region(contour) for contour in contours])
    robot = box_around_mm(contours)
    for row, tile in enumerate(tiles):
        if tile.after is None:
            continue
        others = [tile.after, *(other for other in range(row) if other != tile.after)]
        for other in others:
            # The overlap of the two windows, reduced by the size of a target.
            windows = list(zip(tile.low_mm, tiles[other].low_mm, room_mm, strict=True))
            x0, y0 = (max(a, b) + _TARGET_RIM_MM for a, b, _ in windows)
            x1, y1 = (min(a, b) + room - _TARGET_RIM_MM for a, b, room in windows)
            pair = near_pair((x0, y0, x1, y1), robot, taken)
            if pair:
                tile.after, tile.found_mm = other, pair
                tiles[other].made_mm += pair
                crosses = [shapely.Point(point).buffer(TARGET_MM) for point in pair]
                taken = shapely.union_all([taken, *crosses])
                break
        else:
            raise NoTilesError(f"tile {row + 1} has no room for two registration targets")


def near_pair(box: Box, robot: Box, taken: shapely.Geometry) -> list[Point]:
    """Return two free points of a box that are far enough apart, or else as far as possible.

    Points near the robot's own box are preferred: film that holds only a target is wasted.
    """
    # Distance between targets beyond which no more film is spent on them (assumed).
    apart_enough_mm = 150.0
    for beside_mm in _BESIDE_MM:
        low = [max(a, b - beside_mm) for a, b in zip(box[:2], robot[:2], strict=True)]
        high = [min(a, b + beside_mm) for a, b in zip(box[2:], robot[2:], strict=True)]
        pair = _pair((low[0], low[1], high[0], high[1]), taken)
        if pair and math.dist(*pair) >= apart_enough_mm:
            return pair
    return _pair(box, taken)


def _pair(box: Box, taken: shapely.Geometry) -> list[Point]:
    """Return the two free points of a box that are farthest apart, or nothing."""
    free = free_grid(box, taken)
    if len(free) < 2:
        return []
    corners = shapely.get_coordinates(shapely.MultiPoint(free).convex_hull)
    apart = np.hypot(*(corners[:, None] - corners[None]).transpose(2, 0, 1))
    one, two = np.unravel_index(int(apart.argmax()), apart.shape)
    if apart[one, two] < LEAST_APART_MM:
        return []
    return [(float(x), float(y)) for x, y in (corners[one], corners[two])]


def free_grid(box: Box, taken: shapely.Geometry) -> Floats:
    """Return points of a grid over a box where a target is clear of all that is taken, (n, 2)."""
    if box[2] < box[0] or box[3] < box[1]:
        return np.empty((0, 2))
    grid_mm = 5.0
    across, up = (
        np.linspace(low, high, max(2, math.ceil((high - low) / grid_mm) + 1))
        for low, high in ((box[0], box[2]), (box[1], box[3]))
    )
    grid: Floats = np.stack(np.meshgrid(across, up), axis=-1).reshape(-1, 2)
    shapely.prepare(taken)
    clear = CLEAR_MM + TARGET_MM * math.sqrt(0.5)
    return grid[~shapely.dwithin(taken, shapely.points(grid), clear)]


def target_paths(tile: FilmTile, profile: LaserProfile) -> list[LaserPath]:
    """Return a tile's registration targets: those that it makes, then those that it finds.

    Where the laser can mark, a diagonal cross on each target found comes before both: if the film
    lies right, its middle is that of the cross that an earlier tile marked.
    """
    made = [mark(line, TARGET, "") for line in cross_lines(tile.made_mm)]
    verifying: list[LaserPath] = []
    if Operation.MARK in profile.recipe.by_operation:
        settings = profile.settings(Operation.MARK)
        verifying = [
            replace(mark(line, VERIFICATION, ""), variant=VERIFY, settings=settings)
            for line in cross_lines(tile.found_mm, turn_rad=math.pi / 4)
            if tile.verified
        ]
    else:
        made = [reg(path.contour) for path in made]
    found = [reg(line) for line in cross_lines(tile.found_mm)]
    on_robot = cross_lines([*tile.strip_found_mm, *tile.strip_made_mm], wide_mm=STRIP_TARGET_MM)
    # A beam does not mark what has to hold air.
    return [*verifying, *made, *found, *(reg(line, STRIP_TARGET) for line in on_robot)]


def tile_jobs(
    name: str,
    profile: LaserProfile,
    parted: Tiled,
    marks: Sequence[LaserPath],
    facts: dict[str, object],
) -> tuple[Job, ...]:
    """Return one job per tile, in the order of cutting."""
    machine, tiles, jobs = profile.machine, parted.tiles, []
    corner = machine.margin_mm.value
    for number, tile in enumerate(tiles, start=1):
        shift = corner - tile.low_mm[0], corner - tile.low_mm[1]
        own = [*(marks if number == 1 else ()), *target_paths(tile, profile), *tile.paths]
        jobs.append(
            Job(
                name=f"{name}_tile_{number}",
                sheet_width_mm=machine.bed_width_mm.value,
                sheet_height_mm=machine.bed_height_mm.value,
                paths=in_order(
                    replace(path, contour=path.contour.moved(0.0, *shift)) for path in own
                ),
                facts={
                    **facts,
                    "tile": number,
                    "tiles": len(tiles),
                    "window_x_mm": -shift[0] - parted.film_mm[0],
                    "window_y_mm": -shift[1] - parted.film_mm[1],
                    "overlap_mm": overlap_mm(profile),
                    "aligned_to_tile": None if tile.after is None else tile.after + 1,
                    "targets_found_mm": _seen(tile.found_mm, shift),
                    "targets_made_mm": _seen(tile.made_mm, shift),
                    "robot_targets_found_mm": _seen(tile.strip_found_mm, shift),
                    "robot_targets_made_mm": _seen(tile.strip_made_mm, shift),
                },
            )
        )
    return tuple(jobs)


def reg(contour: Contour, label: str = TARGET) -> LaserPath:
    """Return a line of a registration target as a path that is never cut."""
    return LaserPath(operation=Operation.REG, contour=contour, label=label)


def cross_lines(
    middles_mm: Sequence[Point], turn_rad: float = 0.0, wide_mm: float = TARGET_MM
) -> list[Contour]:
    """Return the two lines of a cross on each of some points, turned."""
    lines = []
    dx0, dy0 = wide_mm / 2.0 * math.cos(turn_rad), wide_mm / 2.0 * math.sin(turn_rad)
    for x, y in middles_mm:
        for dx, dy in ((dx0, dy0), (-dy0, dx0)):
            ends = np.array([[x - dx, y - dy], [x + dx, y + dy]])
            lines.append(Contour.polyline(ends, closed=False))
    return lines


def _seen(points_mm: Sequence[Point], shift_mm: Point) -> list[list[float]]:
    return [[x + shift_mm[0], y + shift_mm[1]] for x, y in points_mm]


PIN_HOLE = "pin hole"
"""Label of the holes by which a sheet is put back."""

HOLES = "holes"
"""Variant of pin holes, which gives them a layer of their own and the settings of the cut."""

LEAST_PINS = 2


def registration(
    paths: Sequence[LaserPath], profile: LaserProfile, within: Box, *, separate: bool = False
) -> tuple[LaserPath, ...]:
    """Return pin holes and crosses for a sheet that is sealed by hand; none for any other.

    Fewer than `LEAST_PINS` holes where there is no room; rule VF-L01 says so.
    """
    weld = profile.recipe.by_operation.get(Operation.WELD)
    if not isinstance(weld, Sealer) or not sealed_by_hand(profile, separate=separate):
        return ()
    rim = _TARGET_RIM_MM
    room = within[0] + rim, within[1] + rim, within[2] - rim, within[3] - rim
    robots = box_around_mm(path.contour for path in paths)
    taken = shapely.union_all([region(path.contour) for path in paths])
    holes = near_pair(room, robots, taken)
    if holes:
        grid = free_grid(room, shapely.union_all([taken, *map(_around, holes)]))
        line = shapely.LineString(holes)
        apart = np.asarray(shapely.distance(shapely.points(grid), line))
        near = np.asarray(shapely.dwithin(shapely.box(*robots), shapely.points(grid), 2.0 * rim))
        if len(grid) and (score := np.where(near, apart, 0.0)).max() > TARGET_MM:
            x, y = grid[int(score.argmax())].tolist()
            holes = [*holes, (x, y)]
    crosses = near_pair(room, robots, shapely.union_all([taken, *map(_around, holes)]))
    can_mark = Operation.MARK in profile.recipe.by_operation
    lines = cross_lines(crosses) if holes else []
    cut = profile.settings(Operation.CUT)
    radius_mm = weld.pin_mm.value / 2.0 - cut.kerf_mm.value / 2.0
    # A circle of four arcs, which every format holds exactly.
    quarters = radius_mm * np.array([(1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0)])
    circle = replace(
        Contour.polyline(quarters, closed=True), bulges=np.full(4, math.tan(math.pi / 8.0))
    )
    return (
        *(mark(line, TARGET, "") for line in lines if can_mark),
        *(
            replace(mark(circle.moved(0.0, *at), PIN_HOLE, ""), variant=HOLES, settings=cut)
            for at in holes
        ),
        *(reg(line) for line in lines),
    )


def _around(point: Point) -> shapely.Geometry:
    return shapely.Point(point).buffer(TARGET_MM)
