"""Drawings of a check: a page with the robot and its findings, and a job for DXF files.

The page is laid out in points before anything is drawn, so that no number, marker or leader lies on
another. Findings that stand too close together share one number tag. In the job everything lies on
layers that are never cut: a design that breaks a rule must not become a file that can be run.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats
from vinefab.fabrication.job.marks import lettered, text_width_mm
from vinefab.fabrication.job.passes import body_paths
from vinefab.fabrication.job.placement import LayoutPlacement, marker_lines
from vinefab.model.design import Design
from vinefab.model.finding import CheckReport, Finding, Severity
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile, RecipeStatus
from vinefab.model.outline import Contour
from vinefab.outline.body_outline import body_outline
from vinefab.pages.panel import (
    INK,
    SOFT,
    Ink,
    Labels,
    Page,
    PageView,
    Panel,
    Shape,
    boxes_around,
    fitted,
    page_of_paper,
    paper,
    spots_around,
    text_width,
)

SEVERITY_COLOURS = {
    Severity.ERROR: "#b3002d",
    Severity.WARNING: "#d98200",
    Severity.INFO: "#0b6e8a",
}
"""They differ in lightness as well as in hue; markers differ in shape too."""

_SHAPES = {Severity.ERROR: "X", Severity.WARNING: "^", Severity.INFO: "o"}
_WORDS = {
    Severity.ERROR: ("error", "errors"),
    Severity.WARNING: ("warning", "warnings"),
    Severity.INFO: ("advice", "advice"),
}

MOST_LISTED = 30
"""More findings than this are listed by rule, each rule with its worst place."""

MOST_RULES = 60
"""Most lines of the list; the last one counts what is left."""

_WIDE_PT, _EDGE_PT = 792.0, 20.0
_HEAD_PT, _KEY_PT, _ROW_PT, _FOOT_PT = 50.0, 34.0, 14.0, 12.0
_RIM_PT = 42.0
_LEAST_PT, _MOST_PT = 190.0, 560.0
_SIGN_PT = 11.0
_REACH_PT = 1.1 * _SIGN_PT
_TAG_PT = 8.0
_LIST_PT = 8.25
_NEAR_PT = (14.0, 20.0, 28.0, 40.0, 58.0, 84.0, 120.0, 240.0, 2.0 * _WIDE_PT)
"""Distances within which findings share a tag: the first one that leaves room for all tags."""

_LEADERS_PT = (9.0, 14.0, 20.0, 28.0, 38.0, 50.0, 66.0, 86.0, 110.0, 140.0)
_DIRECTIONS = 24
_SEAM, _LUMEN = "#b9cbe6", "#e9eff3"
_LINES = {
    Operation.WELD: ("#3f66a6", "weld line, in its seam"),
    Operation.WELDCUT: ("#7a3fa8", "weld and cut in one pass"),
    Operation.CUT: (INK, "cut"),
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Listed:
    """One line of the list: a finding, or all findings of a rule."""

    number: int
    severity: Severity
    rule: str
    branches: tuple[str, ...]
    words: str
    findings: tuple[Finding, ...]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tag:
    """A marker with its number tag, in points of the page."""

    at_pt: tuple[float, float]  # middle of the marker
    severity: Severity  # the worst of its findings
    text: str  # their numbers
    box_pt: tuple[float, float, float, float]  # around the text


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _View(PageView):
    """From millimetres of the flat layout to points of the page."""

    box_pt: tuple[float, float, float, float]  # where markers and tags may lie

    @classmethod
    def of(cls, robot: "_Robot", lines: Sequence[Listed], below_pt: float) -> tuple["_View", float]:
        """Return where the robot lies on the page, and the page's height."""
        shown: list[BaseGeometry] = [robot.lumen, *(_line_of(path) for path in robot.paths)]
        shown += [mark for line in lines for finding in line.findings for mark in _marks(finding)]
        places = np.concatenate([shapely.get_coordinates(shape) for shape in shown])
        low, size = places.min(axis=0), np.maximum(np.ptp(places, axis=0), 1.0)
        inner = _WIDE_PT - 2.0 * (_EDGE_PT + _RIM_PT)
        scale = min(inner / size[0], (_MOST_PT - 2.0 * _RIM_PT) / size[1])
        panel = max(_LEAST_PT, size[1] * scale + 2.0 * _RIM_PT)
        free = np.array([_WIDE_PT, panel]) - size * scale
        view = cls(
            low_mm=low,
            pt_per_mm=float(scale),
            corner_pt=free / 2.0 + np.array([0.0, below_pt]),
            box_pt=(_EDGE_PT, below_pt + 4.0, _WIDE_PT - _EDGE_PT, below_pt + panel),
        )
        return view, below_pt + panel + _HEAD_PT

    def geometry(self, shape: BaseGeometry) -> BaseGeometry:
        """Return a shape on the page."""
        return shapely.transform(shape, self.points)


def _by_severity(findings: Sequence[Finding]) -> list[Finding]:
    """Return the findings that are not waived, errors first."""
    ranks = list(Severity)
    open_ = (finding for finding in findings if not finding.waived)
    return sorted(open_, key=lambda finding: ranks.index(finding.severity))


def listed(findings: Sequence[Finding]) -> tuple[Listed, ...]:
    """Return the lines of the list, errors first; many findings of a rule become one line."""
    open_, groups = _by_severity(findings), dict[tuple[object, ...], list[Finding]]()
    for place, finding in enumerate(open_):
        key = (finding.severity, finding.rule, place if len(open_) <= MOST_LISTED else 0)
        groups.setdefault(key, []).append(finding)

    def excess(finding: Finding) -> float:
        """Return the distance of a finding's value from its limit, as a share of the limit."""
        if finding.measured is None or finding.limit is None:
            return 0.0
        return abs(finding.measured - finding.limit) / max(abs(finding.limit), 1e-9)

    lines = []
    for number, group in enumerate(groups.values(), start=1):
        worst = max(group, key=excess)
        count = f"{counted(len(group), 'finding')}, the worst: " if len(group) > 1 else ""
        lines.append(
            Listed(
                number=number,
                severity=worst.severity,
                rule=worst.rule,
                branches=worst.places,
                words=f"{count}{worst.measures}{'; ' if worst.measures else ''}{worst.message}",
                findings=tuple(group),
            )
        )
    return tuple(lines)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FindingsPage:
    """Where everything lies on the page, in points from its lower left corner."""

    lines: tuple[Listed, ...]
    robot: "_Robot"
    view: "_View"
    below_pt: float  # height of key and list
    high_pt: float  # height of the page
    marked: dict[Severity, BaseGeometry]  # highlighted areas
    tags: tuple[Tag, ...]

    @classmethod
    def of(cls, design: Design, profile: LaserProfile, report: CheckReport) -> "FindingsPage":
        """Return the page of a check."""
        lines, robot = listed(report.findings), _Robot.of(design, profile)
        rows = max(1, min(len(lines), MOST_RULES))
        below_pt = _KEY_PT + _ROW_PT * rows + _FOOT_PT
        view, high_pt = _View.of(robot, lines, below_pt)
        marked = _marked(lines, robot, view)
        inked = shapely.union_all([shapely.boundary(view.geometry(robot.lumen)), *marked.values()])
        tags: tuple[Tag, ...] = ()
        for near_pt in _NEAR_PT:
            spots = _spots(lines, view, near_pt)
            tags = tuple(_laid_out(spots, view.box_pt, inked))
            if len(tags) == len(spots):
                break
        return cls(
            lines=lines,
            robot=robot,
            view=view,
            below_pt=below_pt,
            high_pt=high_pt,
            marked=marked,
            tags=tags,
        )


def findings_picture(design: Design, profile: LaserProfile, report: CheckReport) -> Page:
    """Return the picture of a check: the robot with its lines, findings, scale and list."""
    page = FindingsPage.of(design, profile, report)
    panel = paper(_WIDE_PT, page.high_pt)
    page.robot.draw(panel, page.view)
    for severity, band in page.marked.items():
        ink = Ink(fill=SEVERITY_COLOURS[severity], fill_alpha=0.45)
        panel.polygons([band], ink, rank=3.0)
    for tag in page.tags:
        (x0, y0, x1, y1), colour = tag.box_pt, SEVERITY_COLOURS[tag.severity]
        box = shapely.box(*tag.box_pt)
        nearest = shapely.shortest_line(shapely.Point(tag.at_pt), box)
        panel.line(shapely.get_coordinates(nearest), Ink(line=colour, width_pt=0.8), rank=5.0)
        panel.polygons([box], Ink(fill="#ffffff", line=colour, width_pt=0.9), rank=6.0)
        _draw_sign(panel, tag.at_pt, tag.severity)
        panel.words(((x0 + x1) / 2, (y0 + y1) / 2), tag.text, _TAG_PT, anchor="middle")
    _draw_head(panel, page.high_pt, design, profile, report)
    _draw_key(panel, page)
    _draw_list(panel, page)
    return page_of_paper(panel)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Robot:
    """What of the robot is drawn, in the flat layout."""

    lumen: shapely.Polygon  # its inside, which may be invalid
    paths: tuple[LaserPath, ...]
    seam_mm: float

    @classmethod
    def of(cls, design: Design, profile: LaserProfile) -> "_Robot":
        body = body_paths(design, profile)
        seams = [
            profile.settings(operation).seam_width_mm.value
            for operation in (Operation.WELD, Operation.WELDCUT)
            if any(path.operation is operation for path in body.paths)
        ]
        lumen = shapely.Polygon(body_outline(design).contour.flattened_mm(0.05))
        return cls(lumen=lumen, paths=body.paths, seam_mm=max(seams, default=0.0))

    def draw(self, panel: Panel, view: _View) -> None:
        """Draw the film, the seam at its true width, and the beam's lines."""
        for path in self.paths:
            if path.operation in (Operation.WELD, Operation.WELDCUT):
                half = self.seam_mm if path.operation is Operation.WELDCUT else self.seam_mm / 2.0
                band: BaseGeometry = _line_of(path).buffer(
                    half, join_style="mitre", cap_style="flat"
                )
                around = shapely.Polygon(path.contour.flattened_mm(0.05))
                # Only inward of the beam is seam; a body that lies on itself has no one inside.
                if path.operation is Operation.WELDCUT and around.is_valid:
                    band = band.intersection(around)
                ring = view.points(np.array(self.lumen.exterior.coords))
                panel.add(Shape([ring], Ink(fill=_LUMEN), closed=True))
                panel.polygons([view.geometry(band)], Ink(fill=_SEAM), rank=1.5)
        for path in self.paths:
            colour, _ = _LINES.get(path.operation, (SOFT, ""))
            points = view.points(shapely.get_coordinates(_line_of(path)))
            panel.line(points, Ink(line=colour, width_pt=0.9))


def _line_of(path: LaserPath) -> shapely.LineString:
    points = path.contour.flattened_mm(0.05)
    return shapely.LineString(np.vstack([points, points[:1]]) if path.contour.closed else points)


def _marks(finding: Finding) -> list[BaseGeometry]:
    """Return the parts of a finding's marked geometry and its place."""
    parts = []
    if finding.marker_wkt:
        parts = shapely.get_parts(shapely.from_wkt(finding.marker_wkt)).tolist()
    if finding.x_mm is not None and finding.y_mm is not None:
        parts.append(shapely.Point(finding.x_mm, finding.y_mm))
    return parts


def _place(finding: Finding) -> tuple[float, float] | None:
    """Return the place of a finding or of its marks; None for one about the whole robot."""
    if finding.x_mm is not None and finding.y_mm is not None:
        return finding.x_mm, finding.y_mm
    marks = _marks(finding)
    return (marks[0].centroid.x, marks[0].centroid.y) if marks else None


def _spots(
    lines: Sequence[Listed], view: _View, near_pt: float
) -> list[tuple[tuple[float, float], Severity, str]]:
    """Return place, severity and numbers of the findings that stand close together."""
    middles, members = np.empty((0, 2)), list[list[Listed]]()
    for line in lines:
        for place in (_place(finding) for finding in line.findings):
            if place is None:
                continue
            at = view.points(np.array([place]))
            away = np.hypot(*(middles - at).T)
            if len(away) and away.min() < near_pt:
                members[int(away.argmin())].append(line)
            else:
                middles = np.vstack([middles, at])
                members.append([line])
    return [
        ((float(x), float(y)), inside[0].severity, _numbers(inside))
        for (x, y), inside in zip(middles, members, strict=True)
    ]


def _numbers(inside: Sequence[Listed]) -> str:
    """Return numbers in short: ``1-3, 7``, or ``2 (5x)`` for five findings of one line."""
    numbers = sorted({line.number for line in inside})
    if len(numbers) == 1:
        return f"{numbers[0]} ({len(inside)}x)" if len(inside) > 1 else f"{numbers[0]}"
    runs: list[list[int]] = []
    for number in numbers:
        if runs and number == runs[-1][-1] + 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    return ", ".join(
        f"{run[0]}-{run[-1]}" if len(run) > 2 else ", ".join(map(str, run)) for run in runs
    )


def _laid_out(
    spots: Sequence[tuple[tuple[float, float], Severity, str]],
    box_pt: tuple[float, float, float, float],
    inked: BaseGeometry,
) -> Iterator[Tag]:
    """Yield every spot with the best free place for its tag; a spot without one is left out."""
    signs = boxes_around(np.array([at for at, _, _ in spots]).reshape(-1, 2), (_SIGN_PT, _SIGN_PT))
    labels, around = Labels(page_pt=box_pt, taken=list(signs)), shapely.convex_hull(inked)
    for shape in (inked, around):  # the first of the two in a predicate may be prepared
        shapely.prepare(shape)
    angles = np.arange(_DIRECTIONS) * 2.0 * np.pi / _DIRECTIONS
    far, along = spots_around(_LEADERS_PT, angles)
    for row, (at_pt, severity, text) in enumerate(spots):
        size = np.array([text_width(text, _TAG_PT) + 6.0, _TAG_PT + 4.0])
        ends = np.array(at_pt) + far[:, None] * along
        middles = ends + along * size / 2.0
        starts = np.array(at_pt) + 0.5 * _SIGN_PT * along
        leaders = np.asarray(shapely.linestrings(np.stack([starts, ends], axis=1)))
        # On the robot a tag hides lines; outside, at the end of a short leader, it hides nothing.
        boxes = boxes_around(middles, size)
        cost = far + 12.0 * shapely.intersects(around, boxes)
        cost += 60.0 * shapely.intersects(inked, boxes)
        best = labels.place_with_way(middles, cost, size, leaders, row)
        if best is not None:
            x0, y0, x1, y1 = shapely.bounds(boxes[best]).tolist()
            yield Tag(at_pt=at_pt, severity=severity, text=text, box_pt=(x0, y0, x1, y1))


def _marked(lines: Sequence[Listed], robot: "_Robot", view: _View) -> dict[Severity, BaseGeometry]:
    """Return the highlighted shapes: marked branches and gaps, and the outline around a point."""
    outlines = [view.geometry(_line_of(path)) for path in robot.paths]
    bands = {}
    for severity in reversed(Severity):
        found = [f for line in lines if line.severity is severity for f in line.findings]
        marks = [mark for finding in found for mark in _marks(finding) if mark.length > 0.0]
        strokes = [view.points(shapely.get_coordinates(mark)) for mark in marks]
        for place in {place for finding in found if (place := _place(finding)) is not None}:
            # The stretches of the lines close to it.
            x, y = view.points(np.array([place]))[0].tolist()
            box = x - _REACH_PT, y - _REACH_PT, x + _REACH_PT, y + _REACH_PT
            near = shapely.get_parts(shapely.clip_by_rect(outlines, *box)).tolist()
            strokes += [shapely.get_coordinates(part) for part in near if part.length > 0.0]
        # One shape: where many lines cross, each of them would darken the others.
        bands[severity] = shapely.union_all(
            shapely.buffer([shapely.LineString(s) for s in strokes], 1.8, quad_segs=4)
        )
    return bands


def _draw_sign(panel: Panel, at_pt: tuple[float, float], severity: Severity) -> None:
    ink = Ink(fill=SEVERITY_COLOURS[severity], line="#ffffff", width_pt=0.9)
    panel.marks([at_pt], _SHAPES[severity], 8.0, ink, rank=8.0)


def _draw_head(
    panel: Panel, top_pt: float, design: Design, profile: LaserProfile, report: CheckReport
) -> None:
    name = fitted(design.name, 0.55 * _WIDE_PT, 14.0, bold=True)
    panel.written((_EDGE_PT, top_pt - 24.0), name, 14.0, bold=True)
    words, severity = "manufacturable", Severity.INFO
    if report.blocking:
        words, severity = "not manufacturable", Severity.ERROR
    elif profile.recipe.status is RecipeStatus.UNVERIFIED:
        words, severity = "no rule forbids it; recipe unverified", Severity.WARNING
    colour, right = SEVERITY_COLOURS[severity], _WIDE_PT - _EDGE_PT
    panel.written((right, top_pt - 24.0), words, 11.0, colour=colour, anchor="end", bold=True)
    recipe = fitted(f"recipe {profile.recipe.name}", 0.55 * _WIDE_PT, 8.5)
    panel.written((_EDGE_PT, top_pt - 38.0), recipe, 8.5, colour=SOFT)
    counts = [f"{(n := report.count(s))} {_WORDS[s][n != 1]}" for s in Severity]
    if waived := sum(finding.waived for finding in report.findings):
        counts.append(f"{waived} waived")
    words = ", ".join([*counts, f"{counted(len(report.skipped), 'rule')} skipped"])
    panel.written((right, top_pt - 38.0), words, 8.5, colour=SOFT, anchor="end")


def _draw_key(panel: Panel, page: FindingsPage) -> None:
    """Draw the scale bar and the meaning of lines and signs, in one row."""
    robot, y = page.robot, page.below_pt - 18.0
    x = panel.scale_bar((_EDGE_PT, y), page.view.pt_per_mm, 130.0) + 16.0
    entries = [(Ink(line=_SEAM, width_pt=6.0, butt=True), f"seam, {robot.seam_mm:g} mm to scale")]
    for operation in dict.fromkeys(path.operation for path in robot.paths):
        if operation in _LINES:
            colour, words = _LINES[operation]
            entries.append((Ink(line=colour, width_pt=1.4), words))
    for ink, words in entries:
        panel.line([(x, y + 3.0), (x + 16.0, y + 3.0)], ink)
        x += 36.0 + panel.written((x + 20.0, y), words, _LIST_PT, colour=SOFT)
    for severity in dict.fromkeys(line.severity for line in page.lines):
        _draw_sign(panel, (x + 4.0, y + 3.0), severity)
        x += 28.0 + panel.written((x + 12.0, y), _WORDS[severity][0], _LIST_PT, colour=SOFT)


def _draw_list(panel: Panel, page: FindingsPage) -> None:
    lines, top_pt = page.lines, page.below_pt - _KEY_PT
    rows = lines if len(lines) <= MOST_RULES else lines[: MOST_RULES - 1]
    ends = [(_EDGE_PT, top_pt + 6.0), (_WIDE_PT - _EDGE_PT, top_pt + 6.0)]
    panel.line(ends, Ink(line=SOFT, width_pt=0.5, line_alpha=0.6))
    y = top_pt - _ROW_PT + 6.0
    if not rows:
        panel.written((_EDGE_PT, y), "No findings: nothing to mark.", 9.5)
    for row in rows:
        x = _EDGE_PT
        _draw_sign(panel, (x + 4.0, y + 3.0), row.severity)
        placed = any(_place(finding) is not None for finding in row.findings)
        more = f" +{len(row.branches) - 3}" if len(row.branches) > 3 else ""
        who = ", ".join(row.branches[:3]) + more if placed else "whole robot"
        for wide, words in ((20.0, str(row.number)), (44.0, row.rule), (92.0, who)):
            cell = fitted(words, wide - 4.0, _LIST_PT)
            panel.written((x + 14.0, y), cell, _LIST_PT, bold=wide == 20.0)
            x += wide
        words = fitted(row.words, _WIDE_PT - _EDGE_PT - x - 14.0, _LIST_PT)
        panel.written((x + 14.0, y), words, _LIST_PT)
        y -= _ROW_PT
    if len(lines) > len(rows):
        more = f"and {len(lines) - len(rows)} more"
        panel.written((_EDGE_PT + 14.0, y), more, _LIST_PT, colour=SOFT)


MOST_MARKED = 60
"""Most findings drawn, errors first; the legend counts the rest."""

_TEXT_MM = 5.0
_SIGN_MM = 4.0
_LEADER_MM = (12.0, 20.0, 30.0, 42.0, 56.0, 72.0, 90.0, 110.0)
_CORNERS = {Severity.ERROR: 0, Severity.WARNING: 3, Severity.INFO: 4}
"""An error's marker is a circle, a warning's a triangle, a note's a square."""


def annotated_job(job: Job, findings: Sequence[Finding]) -> Job:
    """Return a drawing of a job with its findings: numbered markers, and a legend above the bed."""
    open_ = _by_severity(findings)
    chosen = open_[:MOST_MARKED]
    outline = [replace(path, operation=Operation.REG) for path in job.paths]
    legend = numbered(chosen) or ["no findings"]
    if len(open_) > len(chosen):
        legend.append(f"and {len(open_) - len(chosen)} more that are not drawn")
    wide, high = job.sheet_width_mm, job.sheet_height_mm
    bed = np.array([[0.0, 0.0], [wide, 0.0], [wide, high], [0.0, high]])
    line_mm = 9.0
    height_mm = job.sheet_height_mm + line_mm * (len(legend) + 1)
    doc = [*_markers(job, chosen)]
    doc.append(("bed", Contour.polyline(bed, closed=True)))
    for number, line in enumerate(legend, start=1):  # from the top, above the bed's frame
        corner = line_mm, height_mm - number * line_mm
        doc += [(f"legend: {line}", stroke) for stroke in lettered(line, corner, _TEXT_MM)]
    paths = [LaserPath(operation=Operation.DOC, contour=one, label=label) for label, one in doc]
    widest_mm = max((text_width_mm(line, _TEXT_MM) for line in legend), default=0.0)
    return replace(
        job,
        sheet_width_mm=max(job.sheet_width_mm, widest_mm + 2.0 * line_mm),
        sheet_height_mm=height_mm,
        paths=(*outline, *paths),
    )


def numbered(findings: Sequence[Finding]) -> list[str]:
    """Return the legend's lines: number, severity, rule, branches and values of each finding."""
    lines = []
    for number, one in enumerate(findings, start=1):
        line = f"{number} {one.severity} {one.rule} {' '.join(one.places[:4])}"
        if one.measures:
            line += f": {one.measures.replace(',', '')}"
        lines.append(line)
    return lines


def _markers(job: Job, chosen: Sequence[Finding]) -> Iterator[tuple[str, Contour]]:
    """Yield every finding's marker geometry, sign, leader and number."""
    assert job.transform is not None  # noqa: S101  a single robot in one piece is drawn
    placed = LayoutPlacement.of(job.transform)
    sheet = shapely.box(0.0, 0.0, job.sheet_width_mm, job.sheet_height_mm)
    taken: list[shapely.Geometry] = [
        shapely.LineString(path.contour.flattened_mm(0.5))
        for path in job.paths
        if path.operation in (Operation.WELD, Operation.WELDCUT)
    ]
    for number, finding in enumerate(chosen, start=1):
        if finding.x_mm is None or finding.y_mm is None:
            continue
        label = f"{number} {finding.rule.removeprefix('VF-')}"
        for points in marker_lines(finding.marker_wkt):
            yield label, Contour.polyline(placed.on_sheet(points), closed=False)
        at = placed.on_sheet(np.array([[finding.x_mm, finding.y_mm]]))[0]
        corners = _CORNERS[finding.severity]
        angles = np.pi / 2 + np.arange(corners or 2) * 2.0 * np.pi / (corners or 2)
        around = np.column_stack([np.cos(angles), np.sin(angles)])
        sign = Contour.polyline(at + _SIGN_MM * around, closed=True)
        yield label, sign if corners else replace(sign, bulges=np.ones(2))
        corner, leader, box = _free_place(at, label, taken, sheet)
        taken.append(box)
        yield label, Contour.polyline(leader, closed=False)
        for stroke in lettered(label, corner, _TEXT_MM):
            yield label, stroke


def _free_place(
    at: Floats, label: str, taken: Sequence[shapely.Geometry], sheet: shapely.Polygon
) -> tuple[tuple[float, float], Floats, shapely.Geometry]:
    """Return the corner, leader and box of the least obstructed place for a label."""

    def hidden(place: tuple[tuple[float, float], Floats, shapely.Geometry]) -> int:
        # Text on a line can still be read, text on text cannot.
        met = [one for one in taken if shapely.intersects(place[2], one)]
        beyond = 0 if sheet.covers(place[2]) else 1000  # many programs show the sheet alone
        return beyond + sum(1 if shapely.get_dimensions(one) == 1 else 10 for one in met)

    places, wide_mm = [], text_width_mm(label, _TEXT_MM)
    for far_mm, turn in product(_LEADER_MM, range(12)):  # the nearest ones first
        angle = math.pi / 6 * (turn + 0.5)
        along = np.array([math.cos(angle), math.sin(angle)])
        x, y = (at + far_mm * along).tolist()
        left = x if along[0] > 0.0 else x - wide_mm
        box = shapely.box(left - 1.0, y - 1.0, left + wide_mm, y + _TEXT_MM + 1.0)
        places.append(((left, y), np.array([at + _SIGN_MM * along, (x, y)]), box))
    return min(places, key=hidden)
