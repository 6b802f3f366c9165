"""A mask for a heat press, in place of a bar: the lumen, cut out of paper that nothing sticks to.

It lies between the plies while a press fuses all that it does not cover, and is drawn out through
the mouth by its tab.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import shapely
from shapely.geometry.base import BaseGeometry

from vinefab.core.front_door import imported_later
from vinefab.fabrication.formats.laser_formats import drawn_jobs
from vinefab.fabrication.job.bar_strokes import SealedBody
from vinefab.fabrication.job.passes import bodies_of_paths, draws_by_hand
from vinefab.model.job import Job, Operation
from vinefab.model.laser import LaserProfile
from vinefab.pages.page_files import page_svg
from vinefab.pages.panel import INK, Ink, page_of_paper
from vinefab.pages.paper_tiles import paper_sheets
from vinefab.pages.true_scale import true_scale

if TYPE_CHECKING:
    from vinefab.pages import page_pdf
else:  # loads reportlab
    page_pdf = imported_later("vinefab.pages.page_pdf")

TAB_MM = 30.0
"""Length of the mask beyond a mouth, to draw it out by (assumed)."""

_EDGE, _RIM_MM = Ink(line=INK, width_pt=0.6), 6.0
_NOTE = (
    "Cut along the line, out of baking paper or PTFE film. README.txt has the steps. The mask is "
    f"the lumen, with a tab of {TAB_MM:g} mm at every open end."
)


def mask_names(stem: str) -> tuple[str, str]:
    """Return the files of a sheet's mask, by how the names of its laser files begin.

    >>> mask_names("sheet_2/outline")
    ('sheet_2/mask.svg', 'sheet_2/mask.pdf')
    """
    folder = stem.rpartition("outline")[0]
    return f"{folder}mask.svg", f"{folder}mask.pdf"


def mask_files(job: Job, profile: LaserProfile, paper: str) -> dict[str, bytes]:
    """Return the masks of a job's sheets as SVG and, on sheets of paper, as PDF, by file name.

    None where a machine marks the film: there is no need for one.

    Raises
    ------
    UnknownNameError
        If there is no such paper.
    """
    return dict(_files(job, profile, paper)) if draws_by_hand(profile) else {}


def _files(job: Job, profile: LaserProfile, paper: str) -> Iterator[tuple[str, bytes]]:
    for stem, sheet in drawn_jobs(job).items():
        masks = masks_of(sheet, profile)
        x0, y0, x1, y1 = masks.bounds
        panel = true_scale((x0 - _RIM_MM, y0 - _RIM_MM, x1 + _RIM_MM, y1 + _RIM_MM))
        panel.lines([shapely.get_coordinates(ring) for ring in _rings(masks)], _EDGE)
        drawing, (svg, pdf) = page_of_paper(panel), mask_names(stem)
        yield svg, page_svg(drawing)
        box_mm = 0.0, 0.0, x1 - x0 + 2.0 * _RIM_MM, y1 - y0 + 2.0 * _RIM_MM
        sheets = paper_sheets(drawing, box_mm, paper, f"{sheet.name}: mask", (_NOTE,))
        yield pdf, page_pdf.sheets_pdf(drawing, sheets)


def masks_of(sheet: Job, profile: LaserProfile) -> BaseGeometry:
    """Return the masks of all robots and pieces on a sheet, tabs included."""
    seams = sheet.along(Operation.WELD)
    width_mm = seams[0].settings_in(profile).seam_width_mm.value
    bodies = [SealedBody(runs=runs) for runs in bodies_of_paths(seams)]
    # A tab may reach over the seam of a neighbour, which must be fused all the same.
    lines = [shapely.LineString(path.contour.flattened_mm()) for path in seams]
    fused = shapely.union_all(lines).buffer(width_mm / 2.0, cap_style="flat")
    return shapely.union_all([body.lumen(width_mm, TAB_MM) for body in bodies]) - fused


def _rings(masks: BaseGeometry) -> Iterator[BaseGeometry]:
    for part in shapely.get_parts(masks).tolist():
        yield part.exterior
        yield from part.interiors
