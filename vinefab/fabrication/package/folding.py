r"""Folds in lay-flat tubing: the same robot without a seam, for tubes that only bend.

A fold takes a wedge out of the flat tube. Its point lies on the outer edge, its base on the inner
edge, and it is as wide as the turn, t. Closing it turns what follows by t about the point. In the
width w it takes 2 w tan(t/2) of the inner edge, nothing of the outer edge, and w tan(t/2) of the
centre line, by which all later folds move on::

    ------- first --- middle --- last -------   inner edge: w tan(t/2) from line to line
               \         |        /
                 \       |      /
    ---------------------*-------------------   outer edge: stays as long as it was

As a film, a tube folded so is the flat pattern of a bend with sharp corners. So its turns and
lengths are those of the pattern that is cut. Sharp bends deploy as rounded ones, within a degree
(simulated); that tape joins the two lines as a seam would is assumed.
"""

import csv
import io
import math
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
from shapely import Polygon, box
from shapely.affinity import translate

from vinefab.core.front_door import imported_later
from vinefab.core.plain_text import GENERATOR, counted, one_line
from vinefab.core.validation import Floats
from vinefab.core.view import Rows, Section
from vinefab.inflation.pattern import Pattern
from vinefab.pages.page_files import page_svg
from vinefab.pages.panel import INK, LEVEL_COLOURS, SOFT, Box, Ink, Page, Panel, page_of_paper
from vinefab.pages.paper_tiles import PAPERS, paper_sheets
from vinefab.pages.true_scale import A4_MM, MARGIN_MM, PT_PER_MM, draw_ruler, true_scale

if TYPE_CHECKING:
    from vinefab.pages import page_pdf
else:  # loads reportlab
    page_pdf = imported_later("vinefab.pages.page_pdf")

FOLDS_CSV = "folds.csv"
"""The fold table."""

TAPE_OVERLAP_MM = 10.0
"""By which the tape around a fold overlaps itself (assumed)."""

_CLOSE_MM = 1e-6  # widths that differ by less are equal


@dataclass(frozen=True, slots=True, kw_only=True)
class Fold:
    """One fold, along a tube that lies flat with its base at the left, seen from above."""

    number: int  # from 1
    turn_deg: float  # of the folded tube, lay-flat; positive to the left
    designed_deg: float  # under pressure
    middle_mm: float  # of its middle line from the base
    half_mm: float  # from there to its first and to its last line, along the inner edge

    @property
    def side(self) -> str:
        """The edge that is taken in."""
        return "left" if self.turn_deg > 0.0 else "right"

    @property
    def fold_mm(self) -> float:
        """How much of the inner edge it takes."""
        return 2.0 * self.half_mm

    @property
    def ends_mm(self) -> tuple[float, float]:
        """Its first and its last line at the inner edge, from the base."""
        return self.middle_mm - self.half_mm, self.middle_mm + self.half_mm

    def corners_mm(self, width_mm: float) -> Floats:
        """Return the wedge on the flat tube, point first; y is 0 along its middle, shape (3, 2)."""
        inner = math.copysign(0.5 * width_mm, self.turn_deg)
        first, last = self.ends_mm
        return np.array([(self.middle_mm, -inner), (first, inner), (last, inner)])


@dataclass(frozen=True, slots=True, kw_only=True)
class FoldedTube:
    """A lay-flat tube with the folds that make a robot of it."""

    name: str  # of the design
    width_mm: float  # lay-flat
    tail_mm: float  # before the base
    length_mm: float  # from the base to the tip, before it is folded
    folds: tuple[Fold, ...]

    @property
    def tape_mm(self) -> float:
        """Length of the tape that goes once around the tube."""
        return 2.0 * self.width_mm + TAPE_OVERLAP_MM


def folded_tube(pattern: Pattern) -> FoldedTube | str:
    """Return the tube that folds into a pattern, or why there is none."""
    flat = pattern.flat
    parts = flat.tree.straight
    if any(pouch is not None for pouch in flat.pouches):
        return "its pouch has to be sealed"
    if len(parts) > 1 and (parts.parent[1:] != np.arange(len(parts) - 1)).any():
        return f"it branches ({counted(len(flat.tree), 'branch')}), and folds only bend one tube"
    width_mm = float(parts.width_mm[0])
    if np.ptp(np.concatenate([parts.width_mm, parts.end_width_mm])) > _CLOSE_MM:
        return "its width changes, and tubing has one width"
    if flat.build.collar is not None:
        return "its tail has a collar, and tubing has one width"
    turns_rad = parts.offset_rad[1:].tolist()
    if not any(turns_rad):
        return "it has no bends"
    designed_deg = np.degrees(pattern.design.tree.straight.offset_rad[1:]).tolist()
    shift_mm, folds = 0.0, list[Fold]()
    bends_mm = np.cumsum(parts.length_mm)[:-1].tolist()
    for at_mm, turn_rad, designed in zip(bends_mm, turns_rad, designed_deg, strict=True):
        half_mm = width_mm * math.tan(0.5 * abs(turn_rad))
        fold = Fold(
            number=len(folds) + 1,
            turn_deg=math.degrees(turn_rad),
            designed_deg=designed,
            middle_mm=at_mm + shift_mm + 0.5 * half_mm,
            half_mm=half_mm,
        )
        shift_mm += half_mm
        folds.append(fold)
    tube = FoldedTube(
        name=flat.name,
        width_mm=width_mm,
        tail_mm=flat.build.tail_mm,
        length_mm=float(parts.length_mm.sum()) + shift_mm,
        folds=tuple(folds),
    )
    return _overlap(tube) or tube


def _overlap(tube: FoldedTube) -> str:
    """Return which folds take the same film, or an empty string."""
    wedges = [Polygon(fold.corners_mm(tube.width_mm)) for fold in tube.folds]
    for (one, wedge), (other, following) in pairwise(zip(tube.folds, wedges, strict=True)):
        if wedge.intersects(following):
            return f"folds {one.number} and {other.number} would take the same film"
    if tube.folds[0].ends_mm[0] < 0.0 or tube.folds[-1].ends_mm[1] > tube.length_mm:
        return "a fold would reach over an end of the tube"
    return ""


def fold_files(tube: FoldedTube, paper: str = "a4") -> dict[str, bytes]:
    """Return the fold table as CSV and the tube at true scale as SVG and PDF, by file name.

    What one page does not hold comes on several sheets of the paper, to be put together.

    Raises
    ------
    UnknownNameError
        If there is no such paper.
    """
    drawing = fold_drawing(tube)
    if PAPERS.get(paper) == A4_MM and drawing.height_pt <= PT_PER_MM * A4_MM[0] + 1.0:
        pdf = page_pdf.page_pdf(drawing)
    else:
        strip, box_mm = fold_strip(tube)
        sheets = paper_sheets(strip, box_mm, paper, _title(tube), fold_steps(tube))
        pdf = page_pdf.sheets_pdf(strip, sheets)
    return {
        FOLDS_CSV: fold_text(tube).encode(),
        "folds.svg": page_svg(drawing),
        "folds.pdf": pdf,
    }


def fold_section(tube: FoldedTube) -> Section:
    """Return the folds and how they are made."""
    rows = tuple(
        (
            str(fold.number),
            f"{fold.middle_mm:.1f}",
            fold.side,
            f"{abs(fold.turn_deg):.1f}",
            f"{fold.fold_mm:.1f}",
        )
        for fold in tube.folds
    )
    table = Rows(
        caption=f"Folds in tubing {tube.width_mm:g} mm wide (computed; {FOLDS_CSV} has all lines)",
        headings=("fold", "middle from the base line, mm", "edge", "turn, flat, deg", "takes, mm"),
        rows=rows,
    )
    return Section(
        title="Folds instead of seams", paragraphs=fold_steps(tube), tables=(table,), folded=True
    )


def fold_text(tube: FoldedTube) -> str:
    """Return the fold table as CSV; its last row names design and program."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(
        (
            "fold",
            "middle_from_base_mm",
            "middle_from_cut_end_mm",
            "inner_edge",
            "turn_flat_deg",
            "turn_designed_deg",
            "fold_mm",
            "first_line_from_base_mm",
            "last_line_from_base_mm",
            "tape_mm",
            "basis",
        )
    )
    basis = f"computed; overlap of the tape, {TAPE_OVERLAP_MM:g} mm: assumed"
    for fold in tube.folds:
        numbers = (fold.turn_deg, fold.designed_deg, fold.fold_mm, *fold.ends_mm, tube.tape_mm)
        places = (fold.middle_mm, fold.middle_mm + tube.tail_mm)
        row = (fold.number, *(f"{place:.2f}" for place in places), fold.side)
        writer.writerow((*row, *(f"{one:.2f}" for one in numbers), basis))
    words = f"tube {tube.width_mm:g} mm wide, {tube.length_mm + tube.tail_mm:.2f} mm long"
    writer.writerow(["fold table", *[""] * 9, f"{GENERATOR}: {tube.name}; {words}"])
    return stream.getvalue()


_ROW_MM, _GAP_MM, _HEAD_MM, _FOOT_MM = 260.0, 20.0, 38.0, 12.0
_WEDGE = Ink(fill=LEVEL_COLOURS[0], fill_alpha=0.3, line=LEVEL_COLOURS[0], width_pt=0.6)
_EDGE = Ink(line=INK, width_pt=0.6)
_BASE, _FAINT = Ink(line=INK, width_pt=1.6), Ink(line=SOFT, width_pt=0.4, dash_pt=(3.0, 2.0))
_TITLE_PT, _TEXT_PT, _LINE_MM = 12.0, 7.5, 4.0


def fold_drawing(tube: FoldedTube) -> Page:
    """Return the flat tube at true scale, in rows as long as a sheet of A4, with every fold."""
    starts_mm = np.arange(-tube.tail_mm, tube.length_mm, _ROW_MM).tolist()
    pitch_mm = tube.width_mm + _GAP_MM
    tall_mm = len(starts_mm) * pitch_mm + _HEAD_MM + _FOOT_MM + 2.0 * MARGIN_MM
    high_mm, wide_mm = A4_MM
    high_mm = max(high_mm, tall_mm)
    panel = true_scale((0.0, 0.0, wide_mm, high_mm))
    top_mm = high_mm - MARGIN_MM
    panel.words((MARGIN_MM, top_mm), _title(tube), _TITLE_PT, bold=True)
    for row, words in enumerate(fold_steps(tube), 2):
        panel.words((MARGIN_MM, top_mm - row * _LINE_MM), words, _TEXT_PT)
    for row, from_mm in enumerate(starts_mm):
        to_mm = min(from_mm + _ROW_MM, tube.length_mm)
        middle_mm = top_mm - _HEAD_MM - (row + 0.5) * pitch_mm
        _draw_row(panel, tube, (from_mm, to_mm), np.array([MARGIN_MM - from_mm, middle_mm]))
    draw_ruler(panel, MARGIN_MM, MARGIN_MM)
    panel.words((MARGIN_MM, MARGIN_MM - 4.0), "Print at 100 % and measure the ruler.", _TEXT_PT)
    return page_of_paper(panel)


def fold_strip(tube: FoldedTube) -> tuple[Page, Box]:
    """Return the flat tube at true scale in one row, and the box of it that is drawn on, in mm."""
    wide_mm = tube.tail_mm + tube.length_mm + 2.0 * _GAP_MM
    high_mm = tube.width_mm + 2.0 * _GAP_MM
    panel = true_scale((0.0, 0.0, wide_mm, high_mm))
    shift = np.array([_GAP_MM + tube.tail_mm, high_mm / 2.0])
    _draw_row(panel, tube, (-tube.tail_mm, tube.length_mm), shift)
    rim_mm = _GAP_MM / 2.0
    box_mm = rim_mm, rim_mm, wide_mm - rim_mm, high_mm - rim_mm
    return page_of_paper(panel), box_mm


def _title(tube: FoldedTube) -> str:
    folds = counted(len(tube.folds), "fold")
    return one_line(f"{tube.name}: {folds} in tubing {tube.width_mm:g} mm wide")


def fold_steps(tube: FoldedTube) -> tuple[str, ...]:
    """Return how the tube is folded, in lines."""
    last_mm, cut_mm = tube.length_mm, tube.length_mm + tube.tail_mm
    return (
        f"Cut {cut_mm:.1f} mm of tubing, plus the length that closing the tip takes. Lay it flat "
        "as it will lie deployed, seen from above, the base to your left.",
        f"The base line is {tube.tail_mm:g} mm from the cut end, the tip {last_mm:.1f} mm from the "
        "base line. Lengths in mm from the base line (computed).",
        "Fold from the base to the tip: bring the last line of a wedge onto its first line; the "
        "point on the other edge stays.",
        "The film between becomes a flap: lay it flat towards the base. Tape once around the tube "
        f"over it ({tube.tape_mm:g} mm of tape, overlap assumed).",
        "Close the tip, try one fold under pressure, then turn the tube inside out to pack it. "
        "That folds deploy as a cut pattern does is assumed.",
    )


def _draw_row(panel: Panel, tube: FoldedTube, ends_mm: tuple[float, float], shift: Floats) -> None:
    """Draw a stretch of the tube with its wedges; a row that continues ends dashed."""
    (from_mm, to_mm), half_mm = ends_mm, 0.5 * tube.width_mm

    def upright(x_mm: float, ink: Ink, words: str) -> None:
        panel.line(np.array([(x_mm, -half_mm), (x_mm, half_mm)]) + shift, ink)
        at = np.array([x_mm, -half_mm - 7.0]) + shift  # below the numbers of folds
        panel.words((at[0], at[1]), words, _TEXT_PT, anchor="middle")

    stretch = box(from_mm, -half_mm, to_mm, half_mm)
    for side_mm in (-half_mm, half_mm):
        panel.line(np.array([(from_mm, side_mm), (to_mm, side_mm)]) + shift, _EDGE)
    for x_mm, name in ((from_mm, "cut end"), (to_mm, "tip")):
        is_end = x_mm in (-tube.tail_mm, tube.length_mm)
        upright(x_mm, _EDGE if is_end else _FAINT, f"{name if is_end else ''} {x_mm:.1f}".strip())
    if from_mm < 0.0 < to_mm:
        upright(0.0, _BASE, "base line 0")
    for fold in tube.folds:
        seen = Polygon(fold.corners_mm(tube.width_mm)).intersection(stretch)
        panel.polygons([translate(seen, *shift)], _WEDGE)
        inner_mm = math.copysign(half_mm, fold.turn_deg)
        if from_mm <= fold.middle_mm < to_mm:
            crease = np.array([(fold.middle_mm, -inner_mm), (fold.middle_mm, inner_mm)])
            panel.line(crease + shift, _FAINT)
            at = np.array([fold.middle_mm, half_mm + 3.0]) + shift
            words = f"fold {fold.number}, {fold.side}: {fold.fold_mm:.1f} mm"
            panel.words((at[0], at[1]), words, _TEXT_PT, anchor="middle", bold=True)
            at = np.array([fold.middle_mm, -half_mm - 3.0]) + shift
            first_mm, last_mm = fold.ends_mm
            words = f"{first_mm:.1f}   {fold.middle_mm:.1f}   {last_mm:.1f}"
            panel.words((at[0], at[1]), words, _TEXT_PT, anchor="middle")
