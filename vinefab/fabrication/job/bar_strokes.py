r"""What a straight sealing bar can do of a seam: straight stretches, and chords in place of arcs.

Chords lie on the side of an arc that is away from the lumen, so that none of it is sealed shut::

      around a tip          in a crotch
        /------\             \  film  /
      / ( lumen )\            \ ____ /         chords: straight; arcs: the seam's middle
      \ (       )/            ( ---- )
        \------/               lumen

Around the lumen they touch the arc in their middles, in a crotch they end on it. The largest
distance from chord to arc is the gap: the lumen is wider there by as much, and the web narrower.

A bar seals all of its length. Where it is longer than a stretch, it lies on film beyond one end, or
both. On waste film that does no harm. On a lumen it does: there a shield between the plies keeps
them apart. Chords in a crotch always point into lumens.
"""

import csv
import io
import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from vinefab.core.plain_text import GENERATOR
from vinefab.core.validation import Floats
from vinefab.fabrication.job.passes import bodies_of_paths
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.machine import SealerMachine, Tool
from vinefab.model.outline import Contour, Segment

SEAMS_CSV = "seams.csv"
"""The seam list of a sheet."""


def seams_name(stem: str) -> str:
    """Return the file of a sheet's seam list, by how the names of its laser files begin.

    >>> seams_name("outline"), seams_name("sheet_2/outline"), seams_name("coupons_1")
    ('seams.csv', 'sheet_2/seams.csv', 'coupons_1_seams.csv')
    """
    folder, _, name = stem.rpartition("outline")
    return f"{folder}{SEAMS_CSV}" if folder or not name else f"{stem}_{SEAMS_CSV}"


GAP_SHARE = 0.25
"""Largest gap over the seam's width; as much again is left to the hand (assumed)."""

FOLLOW_MM = 5.0
"""By which a press of the bar overlaps the one before on the same stretch (assumed)."""

_LEAST_GAP_MM = 0.05  # no hand places a bar finer, however thin its seam
_OPEN_MM = 2.0  # in front of a mouth that no bar seals, beyond the cut
_TOUCH_MM = 0.1  # by which a band may touch a lumen: gaps of chords, rounding
_SAME_RAD = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True)
class BarStroke:
    """One straight stretch of a seam, along the middle of the bar's band."""

    segment: Segment
    label: str  # of the seam that it is part of
    gap_mm: float = 0.0  # largest distance from the seam's middle
    before_mm: float = 0.0  # how far the bar may reach beyond its first end; at most the bar
    after_mm: float = 0.0
    bar_mm: float

    @property
    def length_mm(self) -> float:
        """Distance between its ends."""
        return self.segment.chord_mm

    @property
    def angle_deg(self) -> float:
        """Its direction, counter-clockwise from x, below 180: a bar has no head."""
        return math.degrees(self.segment.direction_rad()) % 180.0

    @property
    def presses(self) -> int:
        """How often the bar is pressed along it."""
        more_mm = max(0.0, self.length_mm - self.bar_mm)
        return 1 + math.ceil(more_mm / max(self.bar_mm - FOLLOW_MM, self.bar_mm / 2.0))

    @property
    def needs_shield(self) -> bool:
        """Whether the bar, wherever it lies along the stretch, reaches over a lumen."""
        return self.before_mm + self.length_mm + self.after_mm < self.bar_mm


def bar_strokes(job: Job, profile: LaserProfile) -> tuple[BarStroke, ...]:
    """Return the straight stretches of a sheet's seams, those that need a shield first.

    Nothing where no bar of known length seals.
    """
    machine, seams = profile.machine_of(Tool.IMPULSE_SEALER), job.along(Operation.WELD)
    if not isinstance(machine, SealerMachine) or not seams:
        return ()
    width_mm, bar_mm = (
        seams[0].settings_in(profile).seam_width_mm.value,
        machine.bar_mm.value,
    )
    bodies = [SealedBody(runs=runs) for runs in bodies_of_paths(seams)]
    most_mm = max(GAP_SHARE * width_mm, _LEAST_GAP_MM)
    strokes = [
        BarStroke(segment=chord, label=path.label, gap_mm=gap, bar_mm=bar_mm)
        for body in bodies
        for path in body.runs
        for chord, gap in _merged(_chords(path.contour, body.sense, most_mm))
    ]
    lumens = shapely.union_all([body.lumen(width_mm, _OPEN_MM) for body in bodies])
    lumens = lumens.buffer(-_TOUCH_MM)
    found = _with_ways(strokes, lumens, width_mm)
    return tuple(sorted(found, key=lambda stroke: not stroke.needs_shield))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SealedBody:
    """The seams of one robot or piece."""

    runs: tuple[LaserPath, ...]

    @property
    def area(self) -> shapely.Polygon:
        """The area within the middle of the seams."""
        return shapely.Polygon(np.concatenate([run.contour.flattened_mm() for run in self.runs]))

    @property
    def sense(self) -> int:
        """1 where the lumen lies to the left of the seams, else -1."""
        return 1 if self.area.exterior.is_ccw else -1

    def lumen(self, width_mm: float, beyond_mm: float) -> BaseGeometry:
        """Return the lumen between seams of a width, and as much beyond its open ends."""
        half = width_mm / 2.0
        ends = [run.contour.points_mm[[0, -1]] for run in self.runs]
        mouths = [
            # To one side alone: that of the waste.
            shapely.LineString([one[1], two[0]]).buffer(
                -self.sense * (beyond_mm + half), cap_style="flat", single_sided=True
            )
            for one, two in zip(ends, [*ends[1:], ends[0]], strict=True)
            if math.dist(one[1], two[0]) > width_mm
        ]
        return shapely.union_all([self.area.buffer(0.0), *mouths]).buffer(-half)


def _chords(contour: Contour, sense: int, most_mm: float) -> Iterator[tuple[Segment, float]]:
    """Yield straight lines along a seam, arcs as chords within a gap of them, each with its gap."""
    for segment in contour.segments:
        if not segment.bulge:
            yield segment, 0.0
            continue
        radius, turn = segment.radius_mm, segment.turn_rad
        around = sense * turn > 0.0  # around the lumen
        share = radius / (radius + most_mm) if around else max(0.0, 1.0 - most_mm / radius)
        count = math.ceil(abs(turn) / (2.0 * math.acos(share)) - 1e-9)
        half = turn / (2.0 * count)
        cos = math.cos(half)
        # Corners of a polygon around the arc, or points of the arc; its ends are kept.
        steps, far = (np.arange(1, 2 * count, 2), radius / cos) if around else (
            np.arange(2, 2 * count, 2), radius)  # fmt: skip
        center, (x, y) = np.array(segment.center_mm), segment.start_mm
        first = math.atan2(y - center[1], x - center[0])
        corners = [
            (center + far * np.array([math.cos(angle), math.sin(angle)])).tolist()
            for angle in first + steps * half
        ]
        gap = far - radius if around else radius * (1.0 - cos)
        for start, end in pairwise([segment.start_mm, *corners, segment.end_mm]):
            yield replace(segment, start_mm=tuple(start), end_mm=tuple(end), bulge=0.0), gap


def _merged(chords: Iterable[tuple[Segment, float]]) -> list[tuple[Segment, float]]:
    """Return chords with those that go on in the same direction made one."""
    found: list[tuple[Segment, float]] = []
    for chord, gap in chords:
        if found and abs(found[-1][0].corner_rad(chord)) < _SAME_RAD:
            before, had = found.pop()
            longer = max(before, chord, key=lambda one: one.chord_mm)
            whole = replace(longer, start_mm=before.start_mm, end_mm=chord.end_mm)
            found.append((whole, max(gap, had)))
        else:
            found.append((chord, gap))
    return found


def _with_ways(
    strokes: Sequence[BarStroke], lumens: BaseGeometry, width_mm: float
) -> list[BarStroke]:
    """Return strokes with how far the bar may reach beyond their ends before it meets a lumen."""
    starts = np.array([stroke.segment.start_mm for stroke in strokes])
    ends = np.array([stroke.segment.end_mm for stroke in strokes])
    bars = np.array([stroke.bar_mm for stroke in strokes])
    along = (ends - starts) / np.hypot(*(ends - starts).T)[:, None]
    before = _free_mm(starts, -along, lumens, width_mm, bars)
    after = _free_mm(ends, along, lumens, width_mm, bars)
    return [
        replace(stroke, before_mm=one, after_mm=two)
        for stroke, one, two in zip(strokes, before.tolist(), after.tolist(), strict=True)
    ]


def _free_mm(
    places: Floats, along: Floats, lumens: BaseGeometry, width_mm: float, most_mm: Floats
) -> Floats:
    """Return how far a band may run from places, shape (n, 2), along unit vectors; shape (n,)."""
    aside = 0.5 * width_mm * along[:, ::-1] * (-1.0, 1.0)
    far = places + most_mm[:, None] * along
    rings = np.stack([places - aside, far - aside, far + aside, places + aside], axis=1)
    met = shapely.intersection(shapely.polygons(rings), lumens)
    points, row = shapely.get_coordinates(met, return_index=True)
    free = most_mm.copy()
    np.minimum.at(free, row, np.sum((points - places[row]) * along[row], axis=1))
    return np.maximum(free, 0.0)


_COLUMNS = (
    *("row", "seam", "part", "branch", "from_x_mm", "from_y_mm", "to_x_mm", "to_y_mm"),
    *("length_mm", "angle_deg", "gap_mm", "presses"),
    *("bar_beyond_first_mm", "bar_beyond_last_mm", "shield", "basis"),
)


def seams_text(strokes: Sequence[BarStroke]) -> str:
    """Return the seam list as CSV; its last row has the sums, the largest gap, and the program."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(_COLUMNS)
    for row, one in enumerate(strokes, start=1):
        ends = (*one.segment.start_mm, *one.segment.end_mm)
        numbers = (*ends, one.length_mm, one.angle_deg, one.gap_mm)
        words = (row, one.label, one.segment.part, one.segment.branch)
        ways = (one.before_mm, one.after_mm)
        writer.writerow(
            (
                *words,
                *(f"{number:.2f}" for number in numbers),
                one.presses,
                *(f"{way:.1f}" for way in ways),
                "yes" if one.needs_shield else "no",
                "computed",
            )
        )
    sums = (
        f"{math.fsum(one.length_mm for one in strokes):.2f}",
        "",
        f"{max(one.gap_mm for one in strokes):.2f}",
        sum(one.presses for one in strokes),
    )
    shields = sum(one.needs_shield for one in strokes)
    writer.writerow(("total", *[""] * 7, *sums, "", "", shields, GENERATOR))
    return stream.getvalue()
