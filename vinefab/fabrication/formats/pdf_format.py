"""The pattern on paper: a job at true scale as PDF, on sheets of A4 or letter to put together.

The whole job stands in the file once; every page is a window onto it. Paths are marked with their
layers (marked content of PDF), so that a reader finds them among crosses, rulers and words. What
people do with a straight bar is drawn too: every stretch between its ends, with its row in the
seam list.
"""

import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import shapely

from vinefab.core.errors import UnreadableFileError
from vinefab.core.foreign import reading
from vinefab.core.front_door import imported_later
from vinefab.core.plain_text import counted
from vinefab.fabrication.formats.laser_drawing import (
    DrawnPath,
    LaserFileSpec,
    LaserFormat,
    ReadDrawing,
    flattened_contour,
)
from vinefab.fabrication.job.bar_strokes import BarStroke, bar_strokes
from vinefab.fabrication.job.placement import box_around_mm
from vinefab.model.outline import FLATTEN_MM, Contour
from vinefab.pages.panel import (
    INK,
    Ink,
    Layer,
    Page,
    Panel,
    Shape,
    label_middles,
    page_of_paper,
    text_width,
)
from vinefab.pages.paper_tiles import PAPER_TITLES, PAPERS, paper_sheets
from vinefab.pages.true_scale import PT_PER_MM, true_scale

if TYPE_CHECKING:
    import pypdf
    from pypdf.generic import DictionaryObject, StreamObject

    from vinefab.pages import page_pdf
else:  # take long to load
    pypdf = imported_later("pypdf")
    page_pdf = imported_later("vinefab.pages.page_pdf")

PAPER_FORMATS = {paper: f"pdf_{paper}" for paper in PAPERS}
"""Name of the format of each paper."""

_TOLERANCE_MM = 1e-3
_PATH_PT = 0.5
_STROKE, _TICK = Ink(line=INK, width_pt=0.9), Ink(line=INK, width_pt=0.5)
_SHIELDED = Ink(line=INK, width_pt=0.9, dash_pt=(3.0, 1.5))
_TICK_MM, _NUMBER_PT = 1.6, 6.0
_RIM_MM = 4.0  # around the paths, for ticks and numbers


def pattern_page(spec: LaserFileSpec, strokes: Sequence[BarStroke] = ()) -> Page:
    """Return the whole sheet at true scale: a layer for each layer of the job, then the strokes."""
    job = spec.job
    sheet = true_scale((0.0, 0.0, job.sheet_width_mm, job.sheet_height_mm))
    layers = []
    for styled in spec.paths:
        contour = flattened_contour(styled.path.contour)
        points = sheet.placed(contour.points_mm)
        ink = Ink(line=styled.style.rgb, width_pt=_PATH_PT)
        shape = Shape([points], ink, closed=contour.closed)
        layers.append(Layer(primitives=[shape], name=styled.style.layer))
    _draw_strokes(sheet, strokes)
    return Page(
        width_pt=sheet.width_pt,
        height_pt=sheet.height_pt,
        layers=[*layers, *page_of_paper(sheet).layers],
    )


def _draw_strokes(sheet: Panel, strokes: Sequence[BarStroke]) -> None:
    """Draw stretches, each between two ticks, and next to them their rows in the seam list."""
    if not strokes:
        return
    ends = np.array([(one.segment.start_mm, one.segment.end_mm) for one in strokes])
    along = (ends[:, 1] - ends[:, 0]) / np.array([one.length_mm for one in strokes])[:, None]
    half = 0.5 * _TICK_MM * along[:, ::-1] * (-1.0, 1.0)
    for shielded, ink in ((False, _STROKE), (True, _SHIELDED)):
        lines = [
            two for one, two in zip(strokes, ends, strict=True) if one.needs_shield is shielded
        ]
        sheet.lines(lines, ink)
    for side in (0, 1):
        sheet.lines([*np.stack([ends[:, side] - half, ends[:, side] + half], axis=1)], _TICK)
    rows = [str(row) for row in range(1, len(strokes) + 1)]
    sizes = np.array([(text_width(row, _NUMBER_PT), _NUMBER_PT) for row in rows])
    lines_pt = [sheet.placed(two) for two in ends]
    middles = label_middles(sheet.placed(ends.mean(axis=1)), sizes, mark_pt=1.5, lines_pt=lines_pt)
    for row, (x, y) in zip(rows, middles / PT_PER_MM * (1.0, -1.0), strict=True):
        at = (float(x), float(y) + sheet.box[3])
        sheet.words(at, row, _NUMBER_PT, anchor="middle")


def pdf_bytes(spec: LaserFileSpec, paper: str) -> bytes:
    """Return a job at true scale on sheets of a paper."""
    job = spec.job
    x0, y0, x1, y1 = box_around_mm(styled.path.contour for styled in spec.paths)
    box = x0 - _RIM_MM, y0 - _RIM_MM, x1 + _RIM_MM, y1 + _RIM_MM
    strokes = () if spec.profile is None else bar_strokes(job, spec.profile)
    drawing, notes = pattern_page(spec, strokes), tuple(_notes(spec, strokes))
    sheets = paper_sheets(drawing, box, paper, f"{job.name}: pattern", notes)
    return page_pdf.sheets_pdf(drawing, sheets)


def _notes(spec: LaserFileSpec, strokes: Sequence[BarStroke]) -> Iterator[str]:
    """Yield sentences about the lines."""
    styles = dict.fromkeys((one.style.layer, one.style.rgb) for one in spec.paths)
    colours = ", ".join(f"{layer} ({rgb})" for layer, rgb in styles)
    yield f"Lines: {colours}. README.txt has the steps along them."
    if not strokes:
        return
    shields = sum(stroke.needs_shield for stroke in strokes)
    words = f"; the dashed ones, 1 to {shields}, need a shield between the plies" if shields else ""
    yield (
        f"Black: {counted(len(strokes), 'stretch')} for the bar, from tick to tick, numbered as in "
        f"the seam list{words}."
    )


# --- Reading --------------------------------------------------------------------------------------


def read_pdf(text: str) -> ReadDrawing:
    """Read a pattern of ours: the drawing, and whether its windows show all of it.

    Parameters
    ----------
    text
        The file, a letter for each byte.

    Raises
    ------
    UnreadableFileError
        If it is not a pattern of ours.
    """
    with reading("PDF text"):
        pages = pypdf.PdfReader(io.BytesIO(text.encode("latin-1"))).pages
        views = [_view(page) for page in pages]
        forms = {name: form for view in views for name, form in view.forms.items()}
        if len(forms) != 1:
            raise UnreadableFileError("PDF text", "not a pattern of ours: no drawing on its pages")
        (form,) = forms.values()
        size = [float(side) / PT_PER_MM for side in form["/BBox"][2:]]  # type: ignore[index]
        paths = _marked_paths(form)
    shown = shapely.union_all([view.window for view in views if view.scale == 1.0])
    lost = [path for path in paths if not _line(path).within(shown.buffer(_TOLERANCE_MM))]
    odd = [f"{counted(len(lost), 'path')} that no page shows whole"] if lost else []
    return ReadDrawing(sheet=(size[0], size[1]), paths=tuple(paths), oddities=tuple(odd))


def _line(path: DrawnPath) -> shapely.LineString:
    points = path.contour.points_mm
    return shapely.LineString([*points, points[0]] if path.contour.closed else points)


@dataclass(frozen=True, slots=True, kw_only=True)
class _View:
    """What a page shows of the drawing."""

    forms: Mapping[str, "StreamObject"]
    scale: float
    window: shapely.Polygon  # on the drawing, in mm


def _view(page: "pypdf.PageObject") -> _View:
    """Return the first window of a page, with how the drawing is placed in it."""
    contents = page.get_contents()
    named: DictionaryObject = page["/Resources"].get("/XObject", {})  # type: ignore[attr-defined]
    forms = {name: one.get_object() for name, one in named.items()}
    placed, window = [1.0, 0.0, 0.0, 1.0, 0.0, 0.0], [math.nan] * 4
    for operands, operator in () if contents is None else contents.operations:
        if operator == b"re":
            window = [float(number) for number in operands]
        elif operator == b"cm":
            placed = [float(number) for number in operands]
        elif operator == b"Do":
            break
    scale, _, _, _, x, y = placed
    low = (np.array(window[:2]) - (x, y)) / scale / PT_PER_MM
    high = low + np.array(window[2:]) / scale / PT_PER_MM
    return _View(forms=forms, scale=scale, window=shapely.box(*low, *high))


def _marked_paths(form: "StreamObject") -> list[DrawnPath]:
    """Return the lines of the form that are marked with a layer, in their order."""
    paths, layer, colour = list[DrawnPath](), "", ""
    points, closed = list[list[float]](), False
    for operands, operator in pypdf.generic.ContentStream(form, None).operations:
        if operator == b"BMC":
            layer = str(operands[0]).removeprefix("/")
        elif operator == b"EMC":
            layer = ""
        elif operator == b"RG":
            colour = "#{:02X}{:02X}{:02X}".format(*(round(255.0 * float(one)) for one in operands))
        elif operator == b"m":
            points, closed = [], False
        if operator in (b"m", b"l"):
            points.append([float(number) / PT_PER_MM for number in operands])
        elif operator == b"h":
            closed = True
        elif operator == b"S" and layer:
            contour = Contour.polyline(np.array(points), closed=closed)
            paths.append(DrawnPath(layer=layer, colour=colour, contour=contour))
    return paths


def pdf_format(paper: str) -> LaserFormat:
    """Return the format of patterns on a paper."""

    def write(spec: LaserFileSpec) -> str:
        return pdf_bytes(spec, paper).decode("latin-1")

    title = PAPER_TITLES[paper]
    return LaserFormat(
        title=f"the pattern at 1:1 as PDF, on sheets of {title}",
        use="to be printed at 100 %, put together and drawn through",
        suffix=f"_{paper}.pdf",
        write=write,
        read=read_pdf,
        tolerance_mm=_TOLERANCE_MM,
        contour=flattened_contour,
        sagitta_mm=FLATTEN_MM,
        encoding="latin-1",
        paper=paper,
        on_request=True,
        each_operation=False,
    )
