"""The sheet as plain SVG text: paths by operation and piece, beds, findings in place.

Coordinates are millimetres of the sheet with y turned over, as in `vinefab.pages.plan_svg`; how
things look is the page's, and so are the signs' sizes: it sets ``--mm-per-px``.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from html import escape

import numpy as np

from vinefab.core.validation import Floats
from vinefab.fabrication.job.placement import SheetPlaces, fact_rows, piece_name
from vinefab.fabrication.outline.layout import FlatLayout
from vinefab.model.finding import Finding, Severity
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.pages.plan_svg import contour_path

_RIM_MM = 12.0

SEVERITY_SIGNS = {
    Severity.ERROR: "M-6 0A6 6 0 0 1 6 0A6 6 0 0 1 -6 0ZM-2.5 -2.5L2.5 2.5M2.5 -2.5L-2.5 2.5",
    Severity.WARNING: "M0 -7L6.5 4.5H-6.5ZM0 -3V1M0 2.4V3",
    Severity.INFO: "M-5 -5H5V5H-5ZM0 -3V-2.4M0 -0.8V3",
}
"""Shapes that say how serious a finding is, in pixels: circle, triangle and square."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacedFinding:
    """A finding on the sheet."""

    at_mm: tuple[float, float] | None  # its place, y up; None for one about the whole robot
    marker: str  # SVG path of the lines that it marks; empty for none


def placed_findings(
    job: Job, layout: FlatLayout, findings: Sequence[Finding]
) -> tuple[PlacedFinding, ...]:
    """Return where findings lie on the sheet of a job."""
    places = SheetPlaces.of(job, layout)
    row = {name: number for number, name in enumerate(layout.tree.ids)}
    return tuple(_placed(places, row, finding) for finding in findings)


def _placed(places: SheetPlaces, row: Mapping[str, int], finding: Finding) -> PlacedFinding:
    branches = [row[name] for name in finding.branches if name in row]
    lines = places.lines(finding.marker_wkt, branches)
    at: tuple[float, float] | None = None
    if finding.x_mm is not None and finding.y_mm is not None:
        x, y = places.point((finding.x_mm, finding.y_mm), branches).tolist()
        at = round(x, 2), round(y, 2)
    return PlacedFinding(at_mm=at, marker="".join(map(_line_path, lines)))


def _line_path(points_mm: Floats) -> str:
    words = [f"{x:.2f} {-y:.2f}" for x, y in points_mm.tolist()]
    return f"M{'L'.join(words)}"


def sheet_box_mm(job: Job) -> tuple[float, float, float, float]:
    """Return what a picture of the sheet shows: least x and y, greatest x and y.

    Beds are shown whole, so that it can be seen how much film is left.
    """
    boxes = [path.contour.box_mm for path in job.paths]
    boxes.append((0.0, 0.0, job.sheet_width_mm, job.sheet_height_mm))
    for tile in job.tiles:
        x, y = _window_mm(tile)
        boxes.append((x, y, x + tile.sheet_width_mm, y + tile.sheet_height_mm))
    sides = np.array(boxes)
    (x0, y0), (x1, y1) = sides[:, :2].min(axis=0).tolist(), sides[:, 2:].max(axis=0).tolist()
    return x0 - _RIM_MM, y0 - _RIM_MM, x1 + _RIM_MM, y1 + _RIM_MM


def beds_svg(job: Job) -> str:
    """Return the beds alone, as `sheet_svg` draws them."""
    return "".join(_beds(job))


def sheet_svg(
    job: Job, findings: Sequence[Finding] = (), placed: Sequence[PlacedFinding] = ()
) -> str:
    """Return a sheet as the content of an SVG element.

    Parameters
    ----------
    findings, placed
        What is marked, and where. A marker is ``g.finding`` with its number as ``data-finding``.
    """
    signs = (
        _sign(number, finding, place)
        for number, (finding, place) in enumerate(zip(findings, placed, strict=True))
    )
    return "".join((*_beds(job), *_paths(job), *signs))


def _window_mm(tile: Job) -> tuple[float, float]:
    """Return where the bed lies on the film when a tile is cut."""
    return float(str(tile.facts["window_x_mm"])), float(str(tile.facts["window_y_mm"]))


def _beds(job: Job) -> Iterator[str]:
    """Yield every bed with its number; of a robot in tiles the film too."""
    if job.tiles:
        yield _bed("film", (0.0, 0.0), job)
        for number, tile in enumerate(job.tiles, start=1):
            yield _bed("bed", _window_mm(tile), tile, f"tile {number} of {len(job.tiles)}")
        return
    sheets = job.sheets or (job,)
    for number, sheet in enumerate(sheets, start=1):
        title = f"sheet {number} of {len(sheets)}" if len(sheets) > 1 else ""
        yield _bed("bed", ((number - 1) * sheet.sheet_width_mm, 0.0), sheet, title)


def _bed(kind: str, low_mm: tuple[float, float], sheet: Job, title: str = "") -> str:
    (x, y), wide, high = low_mm, sheet.sheet_width_mm, sheet.sheet_height_mm
    top = -y - high
    box = f'<rect class="{kind}" x="{x:.2f}" y="{top:.2f}" width="{wide:.2f}" height="{high:.2f}"/>'
    at = f"translate({x:.2f} {top:.2f})"
    return box + (f'<g transform="{at}"><text class="bed-title">{title}</text></g>' * bool(title))


def _paths(job: Job) -> Iterator[str]:
    """Yield one path for each operation and piece, in process order."""
    pieces = {piece_name(job.name, one["label"]): one["label"] for one in fact_rows(job, "pieces")}
    groups: dict[tuple[Operation, str], list[LaserPath]] = {}
    for operation in Operation:
        for path in job.along(operation):
            groups.setdefault((operation, pieces.get(path.of, "")), []).append(path)
    for (operation, piece), paths in groups.items():
        drawn = "".join(contour_path(path.contour) for path in paths)
        # What is open encloses nothing that could be filled.
        kind = operation if all(path.contour.closed for path in paths) else f"{operation} open"
        yield f'<path class="{kind}" data-piece="{piece}" d="{drawn}"/>'


def _sign(number: int, finding: Finding, placed: PlacedFinding) -> str:
    """Return the marker of a finding, empty for one without a place."""
    if placed.at_mm is None and not placed.marker:
        return ""
    words = escape(f"{finding.severity}, {finding.rule}: {finding.message}")
    kind = f"{finding.severity}{' waived' if finding.waived else ''}"
    parts = [
        f'<g class="finding {kind}" data-finding="{number}" tabindex="0" role="button"',
        f' aria-label="{words}">',
    ]
    if placed.marker:
        parts.append(f'<path class="marked" d="{placed.marker}"/>')
    if placed.at_mm is not None:
        x, y = placed.at_mm
        sign = f'<path class="sign" d="{SEVERITY_SIGNS[finding.severity]}"/>'
        parts.append(f'<g transform="translate({x:g} {-y:g})">{sign}</g>')
    return "".join((*parts, "</g>"))
