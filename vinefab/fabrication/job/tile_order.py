r"""The order in which film in tiles is made, so that it moves from tile to tile in one piece.

All sealing comes before a second machine cuts. The mouth is cut last: until then the robot hangs on
the film by it. Where seam and cut are apart, bridges are left in the cut as well, for a scalpel::

    ------------- cut -------   ------- cut -------     gap: a bridge
    ============= seam ============================
                lumen

A seam that cuts as it seals cannot be left open: there tape holds the robot, as the steps say.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import groupby

import numpy as np

from vinefab.core.validation import Floats
from vinefab.fabrication.job.tile_window import FilmTile
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.outline import Contour, Part, Segment
from vinefab.outline.joint import Point

BRIDGE_MM = 3.0
"""Length of film that a cut leaves as a bridge (assumed)."""

_EVERY_MM = 120.0  # largest distance of bridges along a straight side (assumed)
_LEAST_MM = 50.0  # straight side that has a bridge: its cuts overlap where tiles meet
_SAME_MM = 1e-6
_BEYOND_MM = 1.0  # by which the cut across a mouth runs past the cuts at its ends, at least


def in_making_order(
    tiles: Sequence[FilmTile], profile: LaserProfile, room_mm: Point
) -> list[FilmTile]:
    """Return tiles as they are run one after the other; cuts by hand come after all of them."""
    cut = profile.settings(Operation.CUT)
    if cut.tool.by_hand:
        return list(tiles)
    one_pass = any(path.operation is Operation.WELDCUT for tile in tiles for path in tile.paths)
    mouths = list[LaserPath]()
    for tile in tiles:
        split = [piece for path in tile.paths for piece in _at_mouth(path)]
        tile.paths = [path for path, at_mouth in split if not at_mouth]
        mouths += [path for path, at_mouth in split if at_mouth]
    runs = list(tiles)
    sealing = profile.machine_of(profile.settings(profile.recipe.seals).tool)
    if sealing is not None and sealing is not profile.machine_of(cut.tool):
        runs += [_cut_of(row, tile) for row, tile in enumerate(tiles)]
        for tile in tiles:
            tile.paths = [path for path in tile.paths if path.operation is not Operation.CUT]
    last = runs[-1]
    # In one pass the mouth is a separate cut, which runs past its ends already.
    beyond_mm = max(_BEYOND_MM, cut.overcut_mm.value)
    across = mouths if one_pass else [_longer(path, beyond_mm) for path in mouths]
    goes_back = not all(_holds(last, path, room_mm) for path in across)
    if not one_pass:
        for run in runs if goes_back else runs[:-1]:
            run.paths = [part for path in run.paths for part in _bridged(path)]
    if not goes_back:
        last.paths += across
        return runs
    first = tiles[0]
    mouth = FilmTile(
        pieces=set(),
        box_mm=first.box_mm,
        paths=across,
        low_mm=first.low_mm,
        after=0,
        found_mm=first.made_mm[:2],
        verified=False,  # they have been; a mouth may lie half a millimetre aside
        strip_found_mm=list(first.strip_made_mm),
    )
    return [*runs, mouth]


def bridge_count(job: Job) -> int:
    """Return how many bridges the cuts of a job in tiles leave."""
    ends = [
        [tuple(place) for place in on_film_mm(tile, path.contour.points_mm[[0, -1]]).tolist()]
        for tile in job.tiles
        for path in tile.along(Operation.CUT)
    ]
    starts, stops = ([pair[side] for pair in ends] for side in (0, 1))
    return sum(
        abs(math.dist(start, stop) - BRIDGE_MM) < _SAME_MM for stop in stops for start in starts
    )


def on_film_mm(tile: Job, points_mm: Floats) -> Floats:
    """Return places on the film from places in a tile's window, shape (n, 2)."""
    return points_mm + [float(str(tile.facts[f"window_{axis}_mm"])) for axis in "xy"]


def _cut_of(row: int, tile: FilmTile) -> FilmTile:
    """Return the run that cuts what a tile has sealed, aligned by the same crosses."""
    return FilmTile(
        pieces=set(tile.pieces),
        box_mm=tile.box_mm,
        paths=[path for path in tile.paths if path.operation is Operation.CUT],
        low_mm=tile.low_mm,
        after=row,
        verified=False,
        found_mm=[*tile.found_mm, *tile.made_mm][:2],
        strip_found_mm=[*tile.strip_found_mm, *tile.strip_made_mm],
    )


def _at_mouth(path: LaserPath) -> Iterator[tuple[LaserPath, bool]]:
    """Yield the parts of a cut, each with whether it runs across the mouth; others as they are."""
    if path.operation is not Operation.CUT:
        yield path, False
        return
    for at_mouth, run in groupby(path.contour.segments, key=lambda one: one.part is Part.MOUTH):
        yield replace(path, contour=Contour.from_segments(list(run), closed=False)), at_mouth


def _longer(path: LaserPath, by_mm: float) -> LaserPath:
    """Return a straight path as far beyond both its ends."""
    first, last = path.contour.points_mm[0], path.contour.points_mm[-1]
    beyond = by_mm * (last - first) / math.dist(first, last)
    ends = np.array([first - beyond, last + beyond])
    line = Segment(
        start_mm=(float(ends[0, 0]), float(ends[0, 1])),
        end_mm=(float(ends[1, 0]), float(ends[1, 1])),
        part=Part.MOUTH,
        branch=path.contour.branches[0],
    )
    return replace(path, contour=Contour.from_segments([line], closed=False))


def _bridged(path: LaserPath) -> Iterator[LaserPath]:
    """Yield the parts of a cut between bridges; other paths as they are."""
    if path.operation is not Operation.CUT:
        yield path
        return
    run = list[Segment]()
    for segment in path.contour.segments:
        count = 0
        if not segment.bulge and segment.length_mm >= _LEAST_MM:
            count = math.ceil(segment.length_mm / _EVERY_MM)
        start, end = np.array(segment.start_mm), np.array(segment.end_mm)
        half = 0.5 * BRIDGE_MM * (end - start) / segment.length_mm
        begin = segment.start_mm
        for middle in (start + (k + 0.5) / count * (end - start) for k in range(count)):
            x, y = (middle - half).tolist()
            run.append(replace(segment, start_mm=begin, end_mm=(x, y)))
            yield replace(path, contour=Contour.from_segments(run, closed=False))
            x, y = (middle + half).tolist()
            run, begin = [], (x, y)
        run.append(replace(segment, start_mm=begin))
    yield replace(path, contour=Contour.from_segments(run, closed=False))


def _holds(tile: FilmTile, path: LaserPath, room_mm: Point) -> bool:
    """Whether a tile's window holds a path."""
    x0, y0, x1, y1 = path.contour.box_mm
    low, high = tile.low_mm, (tile.low_mm[0] + room_mm[0], tile.low_mm[1] + room_mm[1])
    return low[0] <= x0 and low[1] <= y0 and x1 <= high[0] and y1 <= high[1]
