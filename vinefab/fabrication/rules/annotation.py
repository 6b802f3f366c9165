"""A drawing of the findings: the outline on the sheet, with a marker and a label for each.

Everything lies on layers that are never cut: the outline among the registration marks, markers and
text among the documentation. A design that breaks a rule must not become a file that can be run.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import Any

import numpy as np
import shapely

from vinefab.core.validation import Floats
from vinefab.fabrication.job.marks import lettered, text_width_mm
from vinefab.fabrication.outline.layout import FlatLayout
from vinefab.model.finding import Finding, Severity
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.outline import Contour, Part

MOST_MARKED = 60
"""Most findings drawn, errors first; the legend counts the rest."""

_TEXT_MM = 5.0
_SIGN_MM = 4.0
_LINE_MM = 9.0
_LEADER_MM = (12.0, 20.0, 30.0, 42.0, 56.0, 72.0, 90.0, 110.0)
_CORNERS = {Severity.ERROR: 0, Severity.WARNING: 3, Severity.INFO: 4}
"""An error's marker is a circle, a warning's a triangle, a note's a square."""


@dataclass(frozen=True, slots=True, kw_only=True)
class LayoutPlacement:
    """Where the flat layout lies on the sheet: a rotation about the origin, then a shift."""

    angle_rad: float
    dx_mm: float
    dy_mm: float

    @classmethod
    def of(cls, job: Job) -> "LayoutPlacement":
        """Return the placement recorded in a job's facts."""
        turn_deg, dx, dy = (
            float(str(job.facts[name])) for name in ("rotation_deg", "shift_x_mm", "shift_y_mm")
        )
        return cls(angle_rad=math.radians(turn_deg), dx_mm=dx, dy_mm=dy)

    def on_sheet(self, points_mm: Floats) -> Floats:
        """Return points of the flat layout as they lie on the sheet, shape (k, 2)."""
        cos, sin = math.cos(self.angle_rad), math.sin(self.angle_rad)
        turned = points_mm @ np.array([[cos, sin], [-sin, cos]])
        return np.asarray(turned + np.array([self.dx_mm, self.dy_mm]))


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
        pieces = fact_rows(job, "pieces")
        if not job.sheets:
            return cls(layout=layout, whole=LayoutPlacement.of(job), uncut={}, cut={}, axes={})
        row = {name: number for number, name in enumerate(layout.tree.ids)}
        first = [piece for piece in pieces if piece["copy"] == 1]
        # The sheets stand side by side.
        wide_mm = job.sheets[0].sheet_width_mm
        placed = {
            piece["label"]: LayoutPlacement(
                angle_rad=math.radians(piece["transform"]["rotation_deg"]),
                dx_mm=piece["transform"]["shift_x_mm"] + (int(piece["sheet"]) - 1) * wide_mm,
                dy_mm=piece["transform"]["shift_y_mm"],
            )
            for piece in first
        }
        home = {row[name]: placed[one["label"]] for one in first for name in one["branches"]}
        cut = {
            row[joint["branch"]]: _CutBranch(
                inner=placed[joint["inner"]],
                outer=placed[joint["label"]],
                at_mm=(joint["socket_rim_mm"] + joint["plug_rim_mm"]) / 2.0,
            )
            for joint in fact_rows(job, "joints")
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
        at = np.array([at_mm])
        return self._placement(at[0], branches).on_sheet(at).ravel()

    def lines(self, marker_wkt: str, branches: Sequence[int] = ()) -> list[Floats]:
        """Return the lines of a marker's geometry on the sheet, shape (k, 2) each."""
        found = []
        for line in _lines(marker_wkt):
            for ends in pairwise(line):
                found += self._segment(np.array(ends), branches)
        return found

    def _segment(self, ends_mm: Floats, branches: Sequence[int]) -> list[Floats]:
        """Return a straight line on the sheet: in two parts if it runs along a branch that is cut.

        A line that is the axis of no branch is drawn on the piece of its middle.
        """
        if self.whole:
            return [self.whole.on_sheet(ends_mm)]
        row = self.axes.get(_rounded(ends_mm))
        if row is None:
            row = self._branch(ends_mm.mean(axis=0), branches)
        cut = self.cut.get(row)
        if cut is None:
            return [self.uncut[row].on_sheet(ends_mm)]
        first, last = (self._along_mm(row, end) - cut.at_mm for end in ends_mm)
        if first * last >= 0.0:
            return [(cut.inner if first + last < 0.0 else cut.outer).on_sheet(ends_mm)]
        between = ends_mm[0] + first / (first - last) * (ends_mm[1] - ends_mm[0])
        halves = (np.array([ends_mm[0], between]), np.array([between, ends_mm[1]]))
        sides = (cut.inner, cut.outer) if first < 0.0 else (cut.outer, cut.inner)
        return [side.on_sheet(half) for side, half in zip(sides, halves, strict=True)]

    def _placement(self, at_mm: Floats, branches: Sequence[int]) -> LayoutPlacement:
        if self.whole:
            return self.whole
        row = self._branch(at_mm, branches)
        cut = self.cut.get(row)
        if cut is None:
            return self.uncut[row]
        return cut.inner if self._along_mm(row, at_mm) < cut.at_mm else cut.outer

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


def annotated_job(job: Job, findings: Sequence[Finding]) -> Job:
    """Return a drawing of a job with its findings: numbered markers, and a legend above the bed."""
    ranks = list(Severity)
    open_ = [finding for finding in findings if not finding.waived]
    chosen = sorted(open_, key=lambda finding: ranks.index(finding.severity))[:MOST_MARKED]
    outline = [replace(path, operation=Operation.REG) for path in job.paths]
    legend = numbered(chosen) or ["no findings"]
    if len(open_) > len(chosen):
        legend.append(f"and {len(open_) - len(chosen)} more that are not drawn")
    height_mm = job.sheet_height_mm + _LINE_MM * (len(legend) + 1)
    doc = [*_markers(job, chosen), *_written(legend, job, height_mm)]
    paths = [LaserPath(operation=Operation.DOC, contour=one, label=label) for label, one in doc]
    widest_mm = max((text_width_mm(line, _TEXT_MM) for line in legend), default=0.0)
    return replace(
        job,
        sheet_width_mm=max(job.sheet_width_mm, widest_mm + 2.0 * _LINE_MM),
        sheet_height_mm=height_mm,
        paths=(*outline, *paths),
    )


def numbered(findings: Sequence[Finding]) -> list[str]:
    """Return the legend's lines: number, severity, rule, branches and values of each finding."""
    lines = []
    for number, one in enumerate(findings, start=1):
        line = f"{number} {one.severity} {one.rule} {' '.join(one.branches[:4])}"
        if one.measures:
            line += f": {one.measures.replace(',', '')}"
        lines.append(line)
    return lines


def _written(legend: Sequence[str], job: Job, height_mm: float) -> Iterator[tuple[str, Contour]]:
    """Yield the legend's strokes, line by line from the top, above the bed's frame."""
    frame = np.array([[0.0, 0.0], [job.sheet_width_mm, 0.0]])
    top = np.array([0.0, job.sheet_height_mm])
    corners = np.concatenate([frame, frame[::-1] + top])
    yield "bed", Contour.polyline(corners, closed=True)
    for number, line in enumerate(legend, start=1):
        for stroke in lettered(line, (_LINE_MM, height_mm - number * _LINE_MM), _TEXT_MM):
            yield f"legend: {line}", stroke


def _markers(job: Job, chosen: Sequence[Finding]) -> Iterator[tuple[str, Contour]]:
    """Yield every finding's marker geometry, sign, leader and number."""
    placed = LayoutPlacement.of(job)
    taken: list[shapely.Geometry] = [
        shapely.LineString(path.contour.flattened_mm(0.5))
        for path in job.paths
        if path.operation in (Operation.WELD, Operation.WELDCUT)
    ]
    for number, finding in enumerate(chosen, start=1):
        if finding.x_mm is None or finding.y_mm is None:
            continue
        label = f"{number} {finding.rule.removeprefix('VF-')}"
        for points in _lines(finding.marker_wkt):
            yield label, Contour.polyline(placed.on_sheet(points), closed=False)
        at = placed.on_sheet(np.array([[finding.x_mm, finding.y_mm]]))[0]
        yield label, _sign(at, finding.severity)
        corner, leader, box = _free_place(at, label, taken)
        taken.append(box)
        yield label, Contour.polyline(leader, closed=False)
        for stroke in lettered(label, corner, _TEXT_MM):
            yield label, stroke


def _lines(marker_wkt: str) -> list[Floats]:
    """Return the lines of a marker's geometry, shape (k, 2) each; a point has none."""
    if not marker_wkt:
        return []
    parts = shapely.get_parts(shapely.from_wkt(marker_wkt))
    return [shapely.get_coordinates(part) for part in parts if part.length > 0.0]


def _sign(at: Floats, severity: Severity) -> Contour:
    corners = _CORNERS[severity]
    if not corners:
        ends = at + np.array([[_SIGN_MM, 0.0], [-_SIGN_MM, 0.0]])
        parts, branches = (Part.OTHER,) * 2, ("",) * 2
        return Contour(
            points_mm=ends, bulges=np.ones(2), parts=parts, branches=branches, closed=True
        )
    angles = np.pi / 2 + np.arange(corners) * 2.0 * np.pi / corners
    around = np.column_stack([np.cos(angles), np.sin(angles)])
    return Contour.polyline(at + _SIGN_MM * around, closed=True)


def _free_place(
    at: Floats, label: str, taken: Sequence[shapely.Geometry]
) -> tuple[tuple[float, float], Floats, shapely.Geometry]:
    """Return the corner, leader and box of the least obstructed place for a label."""

    def hidden(place: tuple[tuple[float, float], Floats, shapely.Geometry]) -> int:
        # Text on a line can still be read, text on text cannot.
        met = [one for one in taken if shapely.intersects(place[2], one)]
        return sum(1 if shapely.get_dimensions(one) == 1 else 10 for one in met)

    places, wide_mm = [], text_width_mm(label, _TEXT_MM)
    for far_mm, turn in product(_LEADER_MM, range(12)):  # the nearest ones first
        angle = math.pi / 6 * (turn + 0.5)
        along = np.array([math.cos(angle), math.sin(angle)])
        x, y = (at + far_mm * along).tolist()
        left = x if along[0] > 0.0 else x - wide_mm
        box = shapely.box(left - 1.0, y - 1.0, left + wide_mm, y + _TEXT_MM + 1.0)
        places.append(((left, y), np.array([at + _SIGN_MM * along, (x, y)]), box))
    return min(places, key=hidden)
