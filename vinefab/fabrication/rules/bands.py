"""Where the film that one path takes meets that of another, or of itself, on the written paths."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import shapely
from numpy.typing import NDArray

from vinefab.core.validation import Floats, Ints
from vinefab.fabrication.job.passes import closes
from vinefab.fabrication.rules.spacing import closest
from vinefab.model.job import LaserPath, Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.outline import Part

_CHORD_MM = 0.002
_CORNER = 10.0
"""Two places of one path are neighbours if the way between them is at most so many times the
distance that is asked for. Of a corner of 15 degrees, the least allowed, they are 7.7 times."""

_AROUND_END = 2.0
"""A cut across a mouth crosses the ends of the seam by design, within so many times that."""


@dataclass(frozen=True, slots=True, kw_only=True)
class BandOverlap:
    """Two bands that overlap."""

    one: LaserPath
    two: LaserPath  # the same path where it meets itself
    branches: tuple[str, ...]  # ids of the branches that the two places belong to
    left_mm: float  # film left between the bands, negative
    at_mm: tuple[float, float]  # middle of the closest points, on the sheet


@dataclass(frozen=True, slots=True, eq=False)
class _Pieces:
    """All paths as short straight pieces, k of them."""

    start_mm: Floats  # shape (k, 2)
    end_mm: Floats
    path: Ints  # number of its path
    way_mm: Floats  # from the path's start to the piece's
    half_mm: Floats  # half the width of its band
    is_mouth: NDArray[np.bool_]
    branch: NDArray[np.str_]  # id of its branch, or empty

    @classmethod
    def of(cls, paths: Sequence[LaserPath], profile: LaserProfile) -> "_Pieces":
        rows = [
            (number, segment, path.settings_in(profile), points)
            for number, path in enumerate(paths)
            for segment in path.contour.segments
            for points in [segment.flattened_mm(_CHORD_MM)]
        ]
        count = [len(points) - 1 for *_, points in rows]
        start = np.concatenate([points[:-1] for *_, points in rows])
        end = np.concatenate([points[1:] for *_, points in rows])
        path = np.repeat([number for number, *_ in rows], count)
        length = np.hypot(*(end - start).T)
        before = np.cumsum(length) - length
        first = np.searchsorted(path, np.arange(len(paths)))
        half = [
            (beam.seam_width_mm if paths[number].operation is Operation.WELD else beam.kerf_mm)
            for number, _, beam, _ in rows
        ]
        return cls(
            start_mm=start,
            end_mm=end,
            path=path,
            way_mm=before - before[first][path],
            half_mm=np.repeat([width.value / 2.0 for width in half], count),
            is_mouth=np.repeat([segment.part is Part.MOUTH for _, segment, *_ in rows], count),
            branch=np.repeat([segment.branch for _, segment, *_ in rows], count),
        )


def meetings(paths: Sequence[LaserPath], profile: LaserProfile) -> Iterator[BandOverlap]:
    """Yield where bands overlap: the tightest place of every two branches and two paths.

    A band is what the beam takes to both sides of its path: half the kerf of a cut, half the seam
    of a weld. The seam of a weld-cut lies inward of its kerf. A path's neighbouring places are left
    out, and so are a mouth's cut and the ends of the seam that it crosses.
    """
    if not paths:
        return
    pieces = _Pieces.of(paths, profile)
    ends_mm = np.stack([pieces.start_mm, pieces.end_mm], axis=1)
    lines = np.asarray(shapely.linestrings(ends_mm))
    reach = 2.0 * float(pieces.half_mm.max())
    one, two = shapely.STRtree(lines).query(lines, predicate="dwithin", distance=reach)
    one, two = (rows[one < two] for rows in (one, two))
    near = closest(
        *(ends[rows] for rows in (one, two) for ends in (pieces.start_mm, pieces.end_mm))
    )
    asked = pieces.half_mm[one] + pieces.half_mm[two]
    left = near.distance_mm - asked
    steps = [
        along[:, None] * (pieces.end_mm - pieces.start_mm)[rows]
        for rows, along in ((one, near.along_a), (two, near.along_b))
    ]
    places = [pieces.start_mm[rows] + step for rows, step in zip((one, two), steps, strict=True)]
    way_one, way_two = (
        pieces.way_mm[rows] + np.hypot(*step.T)
        for rows, step in zip((one, two), steps, strict=True)
    )
    same = pieces.path[one] == pieces.path[two]
    apart = np.abs(way_one - way_two)
    around = []  # once around each path; infinite for one that does not close
    for path in paths:
        ends_mm = path.contour.points_mm[[0, -1]]
        past_mm = 0.0 if path.contour.closed else math.dist(*ends_mm)
        around.append(path.contour.length_mm - past_mm if closes(path.contour) else math.inf)
    apart = np.minimum(apart, np.abs(np.array(around)[pieces.path[one]] - apart))
    beside = same & (apart <= _CORNER * asked)
    ends = _near_own_end(paths, pieces, (one, two), places, _AROUND_END * asked + 0.5)
    seen = set[tuple[int, int, tuple[str, ...]]]()
    rows = np.flatnonzero((left < 0.0) & ~beside & ~ends)
    for row in rows[np.argsort(left[rows], kind="stable")].tolist():
        low, high = sorted((int(pieces.path[one[row]]), int(pieces.path[two[row]])))
        names = tuple(sorted({str(pieces.branch[side[row]]) for side in (one, two)} - {""}))
        if (low, high, names) in seen:
            continue
        seen.add((low, high, names))
        x, y = ((places[0][row] + places[1][row]) / 2.0).tolist()
        yield BandOverlap(
            one=paths[low],
            two=paths[high],
            branches=names,
            left_mm=float(left[row]),
            at_mm=(x, y),
        )


def _near_own_end(
    paths: Sequence[LaserPath],
    pieces: _Pieces,
    pair: tuple[Ints, Ints],
    places_mm: Sequence[Floats],
    within_mm: Floats,
) -> NDArray[np.bool_]:
    """Return where a mouth's cut meets a path of its body within some distance of its ends."""
    found = np.zeros(len(within_mm), dtype=np.bool_)
    of = np.array([path.of for path in paths])
    ends = np.array([path.contour.points_mm[[0, -1]] for path in paths])
    along = pieces.end_mm - pieces.start_mm
    (x0, y0), (x1, y1) = (along[side].T for side in pair)
    across = np.abs(x0 * y1 - y0 * x1) > 0.5 * np.hypot(x0, y0) * np.hypot(x1, y1)
    both = pieces.is_mouth[pair[0]] & pieces.is_mouth[pair[1]]
    own = of[pieces.path[pair[0]]] == of[pieces.path[pair[1]]]
    for mouth, other, place in ((0, 1, places_mm[1]), (1, 0, places_mm[0])):
        path = pieces.path[pair[other]]
        to_end = np.linalg.norm(ends[path] - place[:, None], axis=2).min(axis=1)
        # Paths of no robot may end across a seam: the sides of a peel strip do.
        found |= own & (of[path] == "") & (to_end <= within_mm) & across
        found |= own & pieces.is_mouth[pair[mouth]] & (to_end <= within_mm) & ~both
    return found
