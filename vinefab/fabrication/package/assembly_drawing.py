"""The assembly drawing: which face ends outside and, for a robot in pieces, how it is joined.

The page is laid out in points. Lengths of the robot are in millimetres of its flat layout.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from textwrap import wrap
from typing import TYPE_CHECKING

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.front_door import imported_later
from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats
from vinefab.fabrication.package.piece_joining import (
    MINUTES_PER_JOINT,
    JoiningStep,
    face_words,
    joining_order,
    needs_strips,
    order_reasons,
    widest_socket_mm,
)
from vinefab.fabrication.pieces.exploded import ExplodedView, exploded_view
from vinefab.model.design import Design
from vinefab.model.laser import LaserProfile
from vinefab.model.outline import Contour
from vinefab.model.tree import Partition, Sleeve
from vinefab.outline.body_outline import FlatLayout, body_outline, flat_layout
from vinefab.pages.page_files import page_svg
from vinefab.pages.panel import (
    ALERT,
    INK,
    LEVEL_COLOURS,
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

if TYPE_CHECKING:
    from vinefab.pages import page_pdf
else:  # loads reportlab
    page_pdf = imported_later("vinefab.pages.page_pdf")

ASSEMBLY_NAME = "assembly"
"""Name of the drawing's files, without ending."""

MOST_JOINTS_LISTED = 80
"""More joints than this are left to README.txt, which lists all."""

_WIDE_PT, _EDGE_PT = 792.0, 20.0
_HEAD_PT, _TITLE_PT, _LOW_PT, _LINE_PT = 50.0, 22.0, 300.0, 12.0
_MOST_PT, _LEAST_PT = 620.0, 200.0
_TEXT_PT, _LABEL_PT, _JOINT_PT, _NUMBER_PT = 8.25, 12.0, 8.5, 8.25

SIZES = (
    "At each branch: length x width as cut, in mm, lay-flat between the seams (computed). "
    "Lengths go from joint to joint, at a tip to the middle of its round end"
)

_SIZE_PT = 6.5

_BESIDE_PT = (9.0, 12.0, 16.0, 21.0, 28.0)
"""Gaps tried between an end of a joint and its label."""

_RIM_PT = 16.0
_FLATTEN_PT = 0.1
_PT_PER_MM = 72.0 / 25.4

_STUB, _OUTER = LEVEL_COLOURS[:2]
_PLUG, _SOCKET = Ink(line=INK, width_pt=1.6), Ink(line=ALERT, width_pt=1.6)
_DEPTH = Ink(line=INK, width_pt=1.0, dash_pt=(1.0, 1.6))
_JOINT = Ink(line=ALERT, width_pt=2.4, butt=True)
_STRIP = Ink(line=INK, width_pt=1.6, dash_pt=(1.6, 2.6))

Box = tuple[float, float, float, float]


def assembly_files(
    design: Design,
    partition: Partition | None,
    outlines: Mapping[str, Contour],
    profile: LaserProfile,
) -> dict[str, bytes]:
    """Return the assembly drawing as SVG and PDF, by file name.

    Parameters
    ----------
    partition
        The pieces that it is cut in; None for one flat outline.
    outlines
        Outline of every piece (lumen or film), by its label, in the coordinates of the whole
        robot's flat layout.
    """
    if partition is None:
        page = mounting_drawing(design)
    else:
        page = assembly_drawing(design, partition, outlines, profile)
    return {f"{ASSEMBLY_NAME}.svg": page_svg(page), f"{ASSEMBLY_NAME}.pdf": page_pdf.page_pdf(page)}


def assembly_drawing(
    design: Design,
    partition: Partition,
    outlines: Mapping[str, Contour],
    profile: LaserProfile,
) -> Page:
    """Return the whole page: exploded view, robot put together, one lap, order, faces."""
    robot = _Robot.of(design, partition, outlines, profile)
    exploded = _Exploded.of(robot)
    notes = _notes(robot)
    list_pt = _LINE_PT * (max(map(len, notes)) + 1) + 8.0
    list_pt += _FACES_PT
    low_pt = list_pt + _LOW_PT
    high_pt = low_pt + exploded.high_pt + _HEAD_PT
    middle = _WIDE_PT / 2.0
    panel = paper(_WIDE_PT, high_pt)
    pieces = counted(len(robot.partition.pieces), "piece")
    words = f"assembly: {pieces}, {counted(len(robot.steps), 'joint')}"
    assumed = f"All lengths in millimetres, lay-flat. Lap of {robot.lap_mm:g} mm and ease: assumed."
    _write_head(panel, high_pt, design, words, f"{assumed} Else: computed from the design.")
    _draw_exploded(panel, exploded, low_pt)
    _draw_together(panel, robot, (_EDGE_PT, list_pt, middle - 8.0, low_pt))
    title = "from above, and in section (thickness not to scale)"
    _draw_title(panel, (middle + 8.0, low_pt - 14.0), "One lap", title)
    sketch = _LapSketch(panel, (middle + 8.0, _WIDE_PT - _EDGE_PT), robot)
    sketch.plan(low_pt - 88.0)
    sketch.sections(list_pt + 132.0)
    for column, x in zip(notes, (_EDGE_PT, middle + 8.0), strict=True):
        for row, words in enumerate(column):
            panel.written((x, list_pt - (row + 1) * _LINE_PT), words, _TEXT_PT, bold=row == 0)
    _draw_faces(panel, design)
    return page_of_paper(panel)


def mounting_drawing(design: Design) -> Page:
    """Return the page of a robot in one piece: its sizes, and which face ends outside."""
    contour, layout = body_outline(design).contour, flat_layout(design)
    x0, y0, x1, y1 = contour.box_mm
    scale = min((_WIDE_PT - 2.0 * _EDGE_PT) / (x1 - x0), _MOST_PT / (y1 - y0), 2.0 * _PT_PER_MM)
    plan_pt = (y1 - y0) * scale + 2.0 * _RIM_PT
    high_pt = _FACES_PT + plan_pt + _HEAD_PT + _TITLE_PT
    panel = paper(_WIDE_PT, high_pt)
    _write_head(panel, high_pt, design, "sizes and mounting", f"{SIZES}.")
    low_pt, top_pt = _FACES_PT + _TITLE_PT, high_pt - _HEAD_PT
    right_pt = _WIDE_PT - _EDGE_PT
    page = PageView.into(contour.box_mm, (_EDGE_PT, low_pt + _RIM_PT, right_pt, top_pt - _RIM_PT))
    points = page.points(contour.flattened_mm(_FLATTEN_PT / page.pt_per_mm))
    colour = LEVEL_COLOURS[0]
    ink = Ink(fill=colour, fill_alpha=0.3, line=colour, width_pt=0.8)
    panel.add(Shape([points], ink, closed=True), 3.0)
    labels = Labels(page_pt=(_EDGE_PT, low_pt, right_pt, top_pt), lines_pt=[_coarse(points)])
    _write_sizes(panel, layout, np.zeros((len(layout.tree), 2)), page, labels)
    panel.scale_bar((_EDGE_PT, _FACES_PT + 4.0), page.pt_per_mm, 90.0)
    _draw_faces(panel, design)
    return page_of_paper(panel)


def exploded_picture(
    design: Design,
    partition: Partition,
    outlines: Mapping[str, Contour],
    profile: LaserProfile,
) -> Page:
    """Return the exploded view alone."""
    robot = _Robot.of(design, partition, outlines, profile)
    exploded = _Exploded.of(robot)
    panel = paper(_WIDE_PT, exploded.high_pt)
    _draw_exploded(panel, exploded, 0.0)
    return page_of_paper(panel)


# --- what is drawn


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Robot:
    """A robot in pieces, with all that the drawing says of it."""

    design: Design
    partition: Partition
    outlines: Mapping[str, Contour]
    profile: LaserProfile
    layout: FlatLayout
    steps: tuple[JoiningStep, ...]
    colours: Mapping[str, str]  # by label of the piece

    @property
    def lap_mm(self) -> float:
        """How deep each plug goes into its socket."""
        return self.partition.sleeves[0].lap_mm

    @classmethod
    def of(
        cls,
        design: Design,
        partition: Partition,
        outlines: Mapping[str, Contour],
        profile: LaserProfile,
    ) -> "_Robot":
        """Return the robot to be drawn."""
        return cls(
            design=design,
            partition=partition,
            outlines={piece.label: outlines[piece.label] for piece in partition.pieces},
            profile=profile,
            layout=flat_layout(design),
            steps=joining_order(design, partition),
            colours=piece_colours(partition),
        )


def piece_colours(partition: Partition) -> dict[str, str]:
    """Return a colour for every piece, by its label; pieces that are joined differ."""
    inner = {sleeve.label: sleeve.inner for sleeve in partition.sleeves}
    colours: dict[str, str] = {}
    for number, piece in enumerate(partition.pieces):
        colour = LEVEL_COLOURS[number % len(LEVEL_COLOURS)]
        if colour == colours.get(inner.get(piece.label, "")):
            colour = LEVEL_COLOURS[(number + 1) % len(LEVEL_COLOURS)]
        colours[piece.label] = colour
    return colours


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Exploded:
    """The exploded view with its place on the page."""

    robot: _Robot
    view: ExplodedView
    box_mm: Box
    pt_per_mm: float

    @classmethod
    def of(cls, robot: _Robot) -> "_Exploded":
        """Return the view; the pieces are as far apart as their labels on paper need."""
        x0, y0, x1, y1 = _box(robot.outlines, None)
        lead_mm = 0.05 * max(x1 - x0, y1 - y0)
        # Least distance on paper from a plug to its socket: room for the number of the joint.
        lead_pt = 34.0
        for _ in range(3):
            view = exploded_view(robot.partition, robot.layout, robot.outlines, lead_mm)
            box = _box(robot.outlines, view.moves_mm)
            inner = _WIDE_PT - 2.0 * (_EDGE_PT + _RIM_PT)
            scale = min(
                inner / max(box[2] - box[0], 1e-3),
                _MOST_PT / max(box[3] - box[1], 1e-3),
                2.0 * _PT_PER_MM,
            )
            if lead_mm * scale >= 0.9 * lead_pt:
                break
            lead_mm = lead_pt / scale
        return cls(robot=robot, view=view, box_mm=box, pt_per_mm=scale)

    @property
    def high_pt(self) -> float:
        """Height of the panel with its title and key."""
        high = (self.box_mm[3] - self.box_mm[1]) * self.pt_per_mm
        return max(_LEAST_PT, high + 2.0 * _RIM_PT) + 2.0 * _TITLE_PT


def _box(outlines: Mapping[str, Contour], moves_mm: Mapping[str, Floats] | None) -> Box:
    """Return the box around all pieces, each moved."""
    boxes = []
    for label, contour in outlines.items():
        move = np.zeros(2) if moves_mm is None else moves_mm[label]
        boxes.append(np.array(contour.box_mm) + np.tile(move, 2))
    low, high = np.min(boxes, axis=0)[:2], np.max(boxes, axis=0)[2:]
    return float(low[0]), float(low[1]), float(high[0]), float(high[1])


# --- pieces, plugs, sockets


def _draw_exploded(panel: Panel, exploded: _Exploded, below_pt: float) -> None:
    robot, view = exploded.robot, exploded.view
    top = below_pt + exploded.high_pt
    _draw_title(
        panel,
        (_EDGE_PT, top - 14.0),
        "Exploded view",
        "each piece as it lies in the robot, lettered face up; lines lead from plug to socket; "
        "at each branch length x width as cut",
    )
    box = (
        _EDGE_PT + _RIM_PT,
        below_pt + _TITLE_PT + _RIM_PT,
        _WIDE_PT - _EDGE_PT - _RIM_PT,
        top - _TITLE_PT - _RIM_PT,
    )
    page = PageView.into(exploded.box_mm, box)
    for piece in robot.partition.pieces:
        _draw_piece(panel, robot, piece.label, page, view.moves_mm[piece.label])
    labels = Labels(
        page_pt=(_EDGE_PT, below_pt + _TITLE_PT, _WIDE_PT - _EDGE_PT, top - _TITLE_PT),
        lines_pt=[
            _coarse(page.points(_points(robot, piece.label, page) + view.moves_mm[piece.label]))
            for piece in robot.partition.pieces
        ],
    )
    for step in robot.steps:
        _draw_lead(panel, robot, step, page, view, labels)
    for piece in robot.partition.pieces:
        _write_piece(panel, robot, piece.label, page, view.moves_mm[piece.label], labels)
    far, towards = spots_around(_BESIDE_PT, np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False))
    for sleeve in (step.sleeve for step in robot.steps):
        # The joint's label next to its plug and next to its socket.
        name = sleeve.label
        for place, colour in zip(_rims_mm(view, sleeve), (INK, ALERT), strict=True):
            spots = page.points(place) + far[:, None] * towards
            x, y = spots[labels.place(spots, far, _label_size(name, _JOINT_PT))].tolist()
            panel.words(
                (x, y), name, _JOINT_PT, colour=colour, anchor="middle", bold=True, halo=True
            )
    moves_mm = np.zeros((len(robot.layout.tree), 2))
    for piece in robot.partition.pieces:
        moves_mm[list(piece.branches)] = view.moves_mm[piece.label]
    _write_sizes(panel, robot.layout, moves_mm, page, labels)
    _draw_key(panel, robot, (_EDGE_PT, below_pt + 8.0), page.pt_per_mm)


def _points(robot: _Robot, label: str, page: PageView) -> Floats:
    """Return the outline of a piece as points of the flat layout, fine enough for the page."""
    return robot.outlines[label].flattened_mm(_FLATTEN_PT / page.pt_per_mm)


def _draw_piece(
    panel: Panel, robot: _Robot, label: str, page: PageView, move_mm: Floats, alpha: float = 0.3
) -> None:
    colour = robot.colours[label]
    points = page.points(_points(robot, label, page) + move_mm)
    ink = Ink(fill=colour, fill_alpha=alpha, line=colour, width_pt=0.8)
    panel.add(Shape([points], ink, closed=True), 3.0)


def _draw_lead(
    panel: Panel,
    robot: _Robot,
    step: JoiningStep,
    page: PageView,
    view: ExplodedView,
    labels: Labels,
) -> None:
    """Draw the line from a plug to its socket, both rims, the depth mark, and the step's number."""
    sleeve = step.sleeve
    heading = float(robot.layout.heading_rad[sleeve.branch])
    along = np.array([math.cos(heading), math.sin(heading)])
    across = np.array([-along[1], along[0]])
    plug, socket = _rims_mm(view, sleeve)
    deep = sleeve.socket_mm - sleeve.plug_mm
    half = sleeve.width_mm / 2.0
    for place, reach, ink in (
        (plug, half, _PLUG),
        (plug + deep * along, half, _DEPTH),
        (socket, half + sleeve.rise_mm, _SOCKET),
    ):
        ends = page.points(np.array([place - reach * across, place + reach * across]))
        panel.line(ends, ink, rank=5.0)
        labels.taken.append(shapely.buffer(shapely.LineString(ends), 1.5))
    ends = page.points(np.array([plug, socket]))
    panel.line(ends, Ink(line=INK, width_pt=0.6), rank=4.0)
    labels.taken.append(shapely.buffer(shapely.LineString(ends), 0.1))
    middle = ends.mean(axis=0)
    _draw_number(panel, middle, step.number)
    size = _label_size(f"{step.number}", _JOINT_PT)
    labels.taken.append(boxes_around(middle[None], size)[0])


def _rims_mm(view: ExplodedView, sleeve: Sleeve) -> tuple[Floats, Floats]:
    """Return where the rims of a joint's plug and of its socket lie."""
    stub, base = view.stubs_mm[sleeve.label], view.bases_mm[sleeve.label]
    return (base, stub) if sleeve.socket_on_stub else (stub, base)


def _draw_number(panel: Panel, at_pt: Floats, number: int) -> None:
    """Draw the number of a step, white on dark."""
    x, y = at_pt.tolist()
    panel.boxed((x, y), str(number), _NUMBER_PT + 0.5, Ink(fill=INK), colour="#ffffff", bold=True)


def _write_piece(  # noqa: PLR0913  where it is drawn
    panel: Panel,
    robot: _Robot,
    label: str,
    page: PageView,
    move_mm: Floats,
    labels: Labels,
    *,
    size_pt: float = _LABEL_PT,
) -> None:
    """Write the label of a piece into its widest part."""
    points = page.points(_points(robot, label, page) + move_mm)
    # In its widest part, if that is free; else on its outline.
    middles = list(_middles(points))
    spots = np.array([*middles, *points[:: max(1, len(points) // 40)]])
    costs = np.where(np.arange(len(spots)) < len(middles), np.arange(len(spots)), 30.0)
    x, y = spots[labels.place(spots, costs, _label_size(label, size_pt), line_cost=0.05)].tolist()
    panel.boxed(
        (x, y), label, size_pt,
        Ink(fill="#ffffff", line=robot.colours[label], width_pt=0.9), bold=True,
    )  # fmt: skip


def _write_sizes(
    panel: Panel, layout: FlatLayout, moves_mm: Floats, page: PageView, labels: Labels
) -> None:
    """Write length and width next to every branch, each moved with its piece."""
    count = len(layout.tree)
    # Branches whose sizes are written next to them; README.txt has the widths of all.
    most_sized = 60
    if count > most_sized:
        return
    starts_mm, ends_mm = layout.start_mm + moves_mm, layout.end_mm + moves_mm
    tail_mm = starts_mm[:1] - layout.tail_mm * np.array([1.0, 0.0])
    words = [f"tail {layout.tail_mm:g}"]
    words += [
        f"{length:.1f} x {wide:.3g}" + (f" to {narrow:.3g}" if narrow < wide - 0.05 else "")
        for length, wide, narrow in zip(
            layout.tree.length_mm.tolist(),
            layout.width_mm.tolist(),
            layout.end_width_mm.tolist(),
            strict=True,
        )
    ]
    half_pt = np.append(layout.width_mm[:1], layout.width_mm) / 2.0 * page.pt_per_mm
    shares = np.array([0.5, 0.6, 0.4, 0.7, 0.3])[:, None]
    for text, half, start, end in zip(
        words,
        half_pt.tolist(),
        np.concatenate([tail_mm, starts_mm]),
        np.concatenate([starts_mm[:1], ends_mm]),
        strict=True,
    ):
        size, (dx, dy) = _label_size(text, _SIZE_PT), end - start
        normal = np.array([-dy, dx]) / math.hypot(dx, dy)
        # Next to the branch: the label's own extent across it comes on top of half its width.
        away = half + 2.0 + float(np.abs(normal) @ size) / 2.0
        along = page.points(start + shares * (end - start))
        spots = np.concatenate([along + side * away * normal for side in (1.0, -1.0)])
        costs = np.tile(10.0 * np.abs(shares[:, 0] - 0.5), 2)
        x, y = spots[labels.place(spots, costs, size)].tolist()
        panel.words((x, y), text, _SIZE_PT, colour=INK, anchor="middle", halo=True)


def _label_size(words: str, size_pt: float) -> Floats:
    return np.array([text_width(words, size_pt, bold=True) + 3.0, size_pt + 1.0])


def _coarse(outline_pt: Floats) -> Floats:
    """Return an outline that labels keep off."""
    return shapely.get_coordinates(shapely.simplify(shapely.LineString(outline_pt), 1.0))


def _middles(outline_pt: Floats) -> Iterator[Floats]:
    """Yield the middle of the largest disc inside an outline, then of the rest without it."""
    shape: BaseGeometry = shapely.make_valid(shapely.Polygon(outline_pt))
    for _ in range(4):
        parts = [part for part in shapely.get_parts(shape) if isinstance(part, Polygon)]
        largest = max(parts, key=shapely.area, default=Polygon())
        if largest.is_empty:
            return
        disc = shapely.maximum_inscribed_circle(largest, tolerance=0.5)
        middle = shapely.get_coordinates(disc)[0]
        yield middle
        around = shapely.Point(middle).buffer(max(disc.length, 12.0), quad_segs=4)
        shape = shapely.difference(shape, around)


# --- key, title


def _draw_title(panel: Panel, at_pt: tuple[float, float], title: str, words: str) -> None:
    x, y = at_pt
    wide = panel.written((x, y), title, 10.0, bold=True)
    panel.written((x + wide + 8.0, y), words, _TEXT_PT, colour=SOFT)


def _write_head(panel: Panel, top_pt: float, design: Design, words: str, notes: str) -> None:
    name = fitted(design.name, 0.55 * _WIDE_PT, 14.0, bold=True)
    panel.written((_EDGE_PT, top_pt - 24.0), name, 14.0, bold=True)
    right = _WIDE_PT - _EDGE_PT
    panel.written((right, top_pt - 24.0), words, 11.0, anchor="end", bold=True)
    panel.written((_EDGE_PT, top_pt - 38.0), notes, 8.5, colour=SOFT)


def _draw_key(panel: Panel, robot: _Robot, at_pt: tuple[float, float], pt_per_mm: float) -> None:
    y = at_pt[1]
    x = panel.scale_bar(at_pt, pt_per_mm, 90.0) + 14.0
    for ink, words in (
        (_PLUG, "rim of a plug, with the joint's label"),
        (_DEPTH, f"how deep it goes into the socket, {robot.lap_mm:g} mm"),
        (_SOCKET, "rim of its socket"),
    ):
        panel.line([(x, y + 3.0), (x + 14.0, y + 3.0)], ink)
        x += 32.0 + panel.written((x + 18.0, y), words, _TEXT_PT, colour=SOFT)
    _draw_number(panel, np.array([x + 4.0, y + 3.0]), 1)
    panel.written((x + 13.0, y), "order of joining", _TEXT_PT, colour=SOFT)


# --- put together


def _draw_together(panel: Panel, robot: _Robot, box_pt: Box) -> None:
    """Draw the robot with its laps; outer pieces lie on inner ones and show them through."""
    x0, y0, x1, y1 = box_pt
    _draw_title(panel, (x0, y1 - 14.0), "Put together", "where pieces cross, it does not lie flat")
    page = PageView.into(
        _box(robot.outlines, None),
        (x0 + _RIM_PT, y0 + 2.0 * _RIM_PT, x1 - _RIM_PT, y1 - _TITLE_PT - _RIM_PT),
    )
    here = np.zeros(2)
    for piece in robot.partition.pieces:
        _draw_piece(panel, robot, piece.label, page, here, 0.35)
    labels = Labels(
        page_pt=(x0, y0 + _RIM_PT, x1, y1 - _TITLE_PT),
        lines_pt=[
            _coarse(page.points(_points(robot, piece.label, page)))
            for piece in robot.partition.pieces
        ],
    )
    for sleeve in (step.sleeve for step in robot.steps):
        # A line across its branch, in the middle of the lap.
        heading = float(robot.layout.heading_rad[sleeve.branch])
        along = np.array([math.cos(heading), math.sin(heading)])
        across = np.array([-along[1], along[0]])
        middle = robot.layout.start_mm[sleeve.branch]
        middle = middle + (sleeve.socket_mm + sleeve.plug_mm) / 2.0 * along
        reach = sleeve.width_mm / 2.0 + sleeve.rise_mm
        ends = page.points(np.array([middle - reach * across, middle + reach * across]))
        panel.line(ends, _JOINT, rank=6.0)
        labels.taken.append(shapely.buffer(shapely.LineString(ends), 2.5))
    for piece in robot.partition.pieces:
        _write_piece(panel, robot, piece.label, page, here, labels, size_pt=9.0)
    x = panel.scale_bar((x0, y0 + 10.0), page.pt_per_mm, 90.0) + 14.0
    panel.line([(x, y0 + 13.0), (x + 14.0, y0 + 13.0)], _JOINT)
    panel.written((x + 18.0, y0 + 10.0), "joint: plug in socket", _TEXT_PT, colour=SOFT)


# --- one lap


class _LapSketch:
    """A sketch of one lap: the base of the robot is to the left."""

    def __init__(self, panel: Panel, sides_pt: tuple[float, float], robot: _Robot) -> None:
        self.panel, self.strip = panel, needs_strips(robot.profile)
        self.on_stub = robot.partition.sleeves[0].socket_on_stub
        self.left, self.right = sides_pt
        wide = self.right - self.left
        self.base = self.left + 0.36 * wide  # where the outer piece begins
        self.end = self.left + 0.62 * wide  # where the stub ends
        self.lap_mm, lap = robot.lap_mm, robot.profile.recipe.lap
        width = "" if lap is None else f", {lap.band_mm.value:g} mm ({lap.band_mm.standing})"
        self.band_words = f"{'sealed' if self.strip else 'adhesive'} band, all around{width}"
        third = (self.end - self.base) / 3.0
        self.band = self.base + third, self.end - third

    def _ends(self, *, on_stub: bool) -> tuple[list[float], list[float]]:
        """Return the places along the narrow end and along the wide one, its rim last."""
        if on_stub:
            return [self.right, self.base], [
                self.left,
                self.base - 44.0,
                self.base - 16.0,
                self.end,
            ]
        return [self.left, self.end], [self.right, self.end + 44.0, self.end + 16.0, self.base]

    def plan(self, y: float) -> None:
        """Draw the lap from above as cut, its axis at a height."""
        plug, socket, panel = 26.0, 33.0, self.panel
        plug_x, socket_x = self._ends(on_stub=self.on_stub)
        stub, outer = _STUB, _OUTER
        colours = (outer, stub) if self.on_stub else (stub, outer)
        socket_y = np.array([plug, plug, socket, socket])
        sides = (plug_x, np.array([plug, plug]), colours[0]), (socket_x, socket_y, colours[1])
        for rank, (x, half, colour) in enumerate(sides, start=2):
            sides_pt = [np.column_stack([x, y + sign * half]) for sign in (-1.0, 1.0)]
            ring = np.vstack([sides_pt[0], sides_pt[1][::-1]])
            panel.add(Shape([ring], Ink(fill=colour, fill_alpha=0.25), closed=True), rank)
            panel.lines(sides_pt, Ink(line=colour, width_pt=1.2), rank=rank + 2.0)
        rims = plug_x[-1], socket_x[-1]
        dashed = Ink(line=colours[0], width_pt=1.4, dash_pt=(5.0, 2.5))
        panel.line([(rims[0], y - plug), (rims[0], y + plug)], dashed, rank=5.0)
        full = Ink(line=colours[1], width_pt=1.8)
        panel.line([(rims[1], y - socket), (rims[1], y + socket)], full, rank=5.0)
        self._frame((*self.band, y - socket, y + socket), ALERT, "hatched")
        if self.strip:
            ends = (self.left + 6.0, self.end + (8.0 if self.on_stub else -5.0))
            self._frame((*ends, y - 0.72 * plug, y + 0.72 * plug), INK, "dotted")
            self._words((self.left + 10.0, y - 2.5), "release strip, inside", INK)
        # The length of the lap between its rims.
        top, thin = y + socket + 13.0, Ink(line=INK, width_pt=0.8)
        middle = (self.base + self.end) / 2.0
        for end in (self.base, self.end):
            panel.arrow((middle, top), (end, top), thin, 5.0, 5.0)
            panel.line([(end, top - 12.0), (end, top + 4.0)], Ink(line=INK, width_pt=0.6))
        self._words((middle, top + 5.0), f"lap {self.lap_mm:g} mm (assumed)", INK, "middle")
        names = ("socket", "plug") if self.on_stub else ("plug", "socket")
        self._words((self.left, y + plug + 4.0), f"{names[0]}: inner piece", stub)
        self._words((self.right, y + plug + 4.0), f"{names[1]}: outer piece", outer, "end")
        self._words((self.band[0], y - socket - 12.0), self.band_words, ALERT)
        self._words((self.left, y - socket - 12.0), "to the base", SOFT)

    def sections(self, y: float) -> None:
        """Draw the lap cut lengthwise as it is sealed and, below, while the robot grows."""
        self._section(y, "sealed, as cut", on_stub=self.on_stub)
        if self.strip:
            ends = [self.left + 6.0, self.end + (8.0 if self.on_stub else -5.0)]
            self.panel.line([(ends[0], y), (ends[1], y)], _STRIP)
        below = y - 56.0
        growing = f"growing{', every face turned' if self.on_stub else ''}"
        self._section(below, growing, on_stub=False)
        head, foot = (self.right - 4.0, below + 2.0), (self.left + 90.0, below + 2.0)
        self.panel.arrow(foot, head, Ink(line=SOFT, width_pt=1.2), 6.0, 5.0)
        lines = [
            "Film that is still inside runs away from the base (arrow) and off the rim of",
            "the stub, which trails; the other way round it would catch.",
        ]
        if self.strip:
            lines.append("The strip leaves to the left, through the base of the stub's piece.")
        for row, words in enumerate(lines):
            self._words((self.left, below - 32.0 - 11.0 * row), words, SOFT)

    def _section(self, y: float, title: str, *, on_stub: bool) -> None:
        """Draw both ends cut lengthwise; the stub is the wide one or the narrow one."""
        narrow_x, wide_x = self._ends(on_stub=on_stub)
        colours = (_OUTER, _STUB) if on_stub else (_STUB, _OUTER)
        for sign in (-1.0, 1.0):
            heights = y + sign * np.array([10.0, 10.0, 16.0, 16.0])
            outer, inner = (Ink(line=one, width_pt=2.6, butt=True) for one in colours[::-1])
            self.panel.line(np.column_stack([wide_x, heights]), outer)
            self.panel.line([(x, y + sign * 10.0) for x in narrow_x], inner)
            middle = y + sign * 13.0
            self._frame((*self.band, middle - 2.2, middle + 2.2), ALERT)
        self._words((self.left, y + 20.0), title, SOFT)

    def _frame(self, sides_pt: Box, colour: str, look: str = "") -> None:
        """Draw a rectangle by its left, right, lower and upper sides: full, hatched or dotted."""
        left, right, low, high = sides_pt
        box = shapely.box(left, low, right, high)
        if look == "dotted":
            self.panel.polygons([box], _STRIP, rank=6.0)
            return
        fill = "" if look == "hatched" else colour
        self.panel.polygons([box], Ink(fill=fill, line=colour, width_pt=1.0), rank=6.0)
        if look == "hatched":
            tall = high - low
            starts = np.arange(left - tall, right, 4.5)
            slopes = [shapely.LineString([(x, low), (x + tall, high)]) for x in starts.tolist()]
            inside = shapely.get_parts(shapely.intersection(slopes, box)).tolist()
            hatch = Ink(line=colour, width_pt=0.8, butt=True)
            self.panel.lines([shapely.get_coordinates(one) for one in inside], hatch, rank=6.0)

    def _words(
        self, at_pt: tuple[float, float], words: str, colour: str, anchor: str = "start"
    ) -> None:
        self.panel.written(at_pt, words, _TEXT_PT, colour=colour, anchor=anchor)


# --- the order, as text


def _notes(robot: _Robot) -> tuple[list[str], list[str]]:
    """Return the two columns of text below the drawings, heading first."""
    steps = robot.steps
    order = [
        f"{step.number}.  {one.label} {'into' if one.socket_on_stub else 'over'} {one.inner}: plug"
        f" and socket {one.label}, branch {step.branch}, {one.width_mm:.1f} mm wide,"
        f" {one.lap_mm:g} mm deep"
        for step in steps[:MOST_JOINTS_LISTED]
        for one in [step.sleeve]
    ]
    if len(steps) > len(order):
        order.append(f"and {len(steps) - len(order)} more: README.txt lists them all.")
    widest = widest_socket_mm(robot.partition)
    minutes = MINUTES_PER_JOINT * len(steps)
    numbers = (
        f"The widest socket is {widest:.1f} mm wide (computed). Time to join: about {minutes:g}"
        f" minutes ({MINUTES_PER_JOINT:g} a joint, assumed). README.txt has every step."
    )
    reasons = [line for text in (order_reasons(robot.profile), numbers) for line in wrap(text, 82)]
    left = ["Order of joining: the base of the first piece, the stub of the second", *order]
    right = ["Why in this order", *reasons]
    room = len(right) + 3
    if len(left) > 2 * room:
        half = (len(left) + len(right)) // 2
        return left[:half], [*right, "", *left[half:]]
    return left, right


# --- faces of the film

_FACES_PT = 132.0
"""Height of the drawing."""


# A ply from one end of the mouth around the tip to the other, the tube's outer face to the left.
_AS_CUT = [(0.0, 18.0), (120.0, 18.0), (132.0, 9.0), (132.0, -9.0), (120.0, -18.0), (0.0, -18.0)]
_BELOW = [(92.0, -20.0), (126.0, -20.0), (126.0, -9.0)]
_MOUNTED = [*_BELOW, (20.0, -9.0), (12.0, 0.0), (20.0, 9.0), *((x, -y) for x, y in _BELOW[::-1])]
_TIP = [(92.0, -20.0), (176.0, -20.0), (186.0, -13.0), (176.0, -6.0)]
_GROWING = [*_TIP, (42.0, -6.0), (34.0, 0.0), (42.0, 6.0), *((x, -y) for x, y in _TIP[::-1])]


def _draw_faces(panel: Panel, design: Design) -> None:
    """Draw along the lower edge of a page a tube lengthwise, each face in its colour."""
    build, y, left = design.build, _FACES_PT - 78.0, _EDGE_PT
    title = f"{face_words(build)} (build.mounting = {build.mounting})"
    _draw_title(panel, (left, _FACES_PT - 22.0), "Faces", title)
    is_turned = build.mounting == "turned"
    as_cut, turned = (INK, ALERT), (ALERT, INK)  # outer face of the tube, inner face
    flat = ("as cut, mouth to the left", _AS_CUT, as_cut)
    inside_out = [("turned inside out", _AS_CUT, turned)] if is_turned else []
    mounted = turned if is_turned else as_cut
    stages = [
        flat,
        *inside_out,
        ("mounted, tail over the base", _MOUNTED, mounted),
        ("growing", _GROWING, mounted),
    ]
    wide = (_WIDE_PT - 2.0 * _EDGE_PT) / len(stages)
    ply_pt = 2.4  # distance of the two faces of a ply in the drawing
    face_text_pt = 8.0
    for number, (words, path, colours) in enumerate(stages):
        x = left + number * wide
        panel.written((x, y + 36.0), words, face_text_pt, colour=SOFT)
        if path is not _AS_CUT:
            for side in (-1.0, 1.0):  # the base: a pipe out of a vessel
                pipe = np.array([(0.0, 30.0), (0.0, 14.0), (40.0, 14.0)]) * (1.0, side)
                panel.line(pipe + np.array([x + 80.0, y]), Ink(line=SOFT, width_pt=2.2))
        # Both faces of the ply next to its middle: the left one, the right one.
        line = shapely.LineString(np.array(path) + np.array([x, y]))
        for side, colour in zip((1.0, -1.0), colours, strict=True):
            face = shapely.get_coordinates(line.offset_curve(side * ply_pt / 2.0))
            panel.line(face, Ink(line=colour, width_pt=1.6))
    for row, (words, colour) in enumerate(
        (("face outside as cut", INK), ("face inside as cut", ALERT))
    ):
        at = left + 190.0 * row
        panel.line([(at, y - 41.0), (at + 14.0, y - 41.0)], Ink(line=colour, width_pt=1.5))
        panel.written((at + 18.0, y - 44.0), words, face_text_pt, colour=colour)
