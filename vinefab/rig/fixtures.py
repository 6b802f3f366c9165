"""What stands around a rig: the holder and base of the robot, and corner markers.

Markers are printed tiles with black cells, or pads of the board that carry them.

All lengths are millimetres of the rig in the coordinates of its plan: (0, 0) is the lower left
corner of the bounds' box, z = 0 the table under tiles as printed.
"""

import math
from dataclasses import dataclass, field, replace

import numpy as np
import shapely
from shapely import LineString, Point, Polygon, box
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import UnfitInputError
from vinefab.core.validation import Floats
from vinefab.model.design import Design
from vinefab.model.map import (
    DEFAULT_MARKER_GAP_MM,
    MARKER_CELLS,
    MARKER_SIDE_CELLS,
    CornerMarker,
    Map,
    corner_markers,
)
from vinefab.rig.holder import BaseHolder, base_holder
from vinefab.rig.part import Printer, Rig, RigOptions, RigPart
from vinefab.rig.printed_base import PrintedBase, printed_base
from vinefab.rig.rig_plan import Polygons, bridged, polygon_parts, snapped_union
from vinefab.rig.solid import Course, centred, engraved_marks, stacked, strokes

RAISED_LAYERS = 3
"""Layers of the second filament: black that lets no white through (assumed)."""


ARM_MM = 25.0
"""Length of a tile's arms along the two sides of the rig's corner."""

_RELIEF_MM, _BOARD_RIM_MM, _PAPER_GAP_MM = 1.0, 1.0, 0.25


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MarkerPad:
    """What carries one marker: a tile, or a part of the board."""

    marker: CornerMarker  # in map coordinates
    square: Polygon  # the marker, its black frame included
    paper: Polygon  # with the quiet zone around it
    cells: Polygons  # black cells, joined where they touch in a point
    outline: Polygon  # tile, with arms along the rig's sides if it has a corner there
    corner: Point | None  # of the rig, which its arms lie against


def marker_gap_mm(options: RigOptions) -> float:
    """Return the distance of the markers from the bounds' box, so that no border hides them."""
    # How far a border hides the ground behind it, over its height: a camera above the middle, as
    # high as the rig is long, looks over the middle of a side at this slope.
    hiding_slope = 0.5
    hidden_mm = options.border_mm + hiding_slope * options.height_mm
    quiet_mm = options.border_mm + options.marker_mm / MARKER_SIDE_CELLS
    return max(DEFAULT_MARKER_GAP_MM, quiet_mm, hidden_mm)


def base_layers(printer: Printer, options: RigOptions) -> int:
    """Return the number of a printed tile's white layers; its black top is level with the floor."""
    above = 0 if options.marker_kind == "paper" else RAISED_LAYERS
    least_base_layers = 6  # layers of a tile below its cells, at least
    return max(round(options.plate_mm / printer.layer_mm) - above, least_base_layers)


def marker_face_mm(printer: Printer, options: RigOptions) -> float:
    """Return the height of the markers' faces above the floor that the robot lies on."""
    if options.style != "plate" and options.marker_kind != "print":
        return 0.0  # on the board
    above = 0 if options.marker_kind == "paper" else RAISED_LAYERS
    high_mm = (base_layers(printer, options) + above) * printer.layer_mm
    return round(high_mm - options.plate_mm, 6)


def marker_pads(
    world: Map, plate: BaseGeometry, printer: Printer, options: RigOptions
) -> tuple[MarkerPad, ...]:
    """Return the four pads of a rig, none for markers ``none``.

    Parameters
    ----------
    plate
        Outline of the rig's plate or board, in the coordinates of the plan.
    """
    if options.marker_kind == "none":
        return ()
    scale = options.scale
    markers = corner_markers(
        world,
        side_mm=options.marker_mm / scale,
        gap_mm=marker_gap_mm(options) / scale,
        z_mm=marker_face_mm(printer, options) / scale,
    )
    rig = shapely.union_all([Polygon(piece.exterior) for piece in polygon_parts(plate)])
    low_mm = np.array(world.bounds.bounds[:2])
    return tuple(
        _pad(marker, (marker.corners_mm - low_mm) * scale, rig, printer) for marker in markers
    )


def _pad(
    marker: CornerMarker, corners_mm: Floats, rig: BaseGeometry, printer: Printer
) -> MarkerPad:
    low, high = corners_mm.min(axis=0), corners_mm.max(axis=0)
    square = box(*low, *high)
    cell_mm = (high[0] - low[0]) / MARKER_SIDE_CELLS
    paper = square.buffer(cell_mm, join_style="mitre")
    # The corner of the rig's box that it belongs to, and the signs that lead inward.
    x_min, y_min, x_max, y_max = rig.bounds
    right, top = marker.number in (1, 2), marker.number in (2, 3)
    corner = np.array([x_max if right else x_min, y_max if top else y_min])
    inward = np.array([-1.0 if right else 1.0, -1.0 if top else 1.0])
    # Two arms along the sides of the rig's corner; none where it has no such corner.
    long_mm = np.minimum(ARM_MM, 0.3 * np.array([x_max - x_min, y_max - y_min]))
    pad_touch_mm = 0.01
    edge, arms = rig.boundary.buffer(pad_touch_mm), list[Polygon]()
    board_screw_mm = 4.2
    arm_wide_mm = 12.0
    for axis in (0, 1):
        along, across = np.zeros(2), np.zeros(2)
        along[axis] = long_mm[axis] * inward[axis]
        across[1 - axis] = -arm_wide_mm * inward[1 - axis]
        if not edge.covers(LineString([corner, corner + along])):
            arms = []
            break
        hole = Point(*(corner + along + 0.5 * across - 0.3 * arm_wide_mm * np.sign(along)))
        arm = box(*np.sort([corner, corner + along + across], axis=0).ravel())
        arms.append(arm.difference(hole.buffer(0.5 * board_screw_mm, quad_segs=6)))
    outline = paper
    if arms:
        foot = box(*np.sort([corner, corner - arm_wide_mm * inward], axis=0).ravel())
        hull = shapely.convex_hull(shapely.union(paper, foot))
        outline = shapely.union_all([hull, *arms]).difference(rig)
    (whole,) = snapped_union(outline)
    return MarkerPad(
        marker=marker,
        square=square,
        paper=paper,
        cells=bridged(black_cells(marker.number, square), square, 0.5 * printer.nozzle_mm)[0],
        outline=whole,
        corner=Point(corner) if arms else None,
    )


def black_cells(number: int, square: Polygon) -> Polygons:
    """Return the black cells of a marker in its square, frame included, joined along edges."""
    x_mm, y_mm, right_mm, _ = square.bounds
    cell_mm, edge = (right_mm - x_mm) / MARKER_SIDE_CELLS, "." * MARKER_SIDE_CELLS
    rows = [edge, *(f".{row}." for row in MARKER_CELLS[number]), edge]
    cells = [
        box(
            x_mm + column * cell_mm,
            y_mm + (MARKER_SIDE_CELLS - 1 - row) * cell_mm,
            x_mm + (column + 1) * cell_mm,
            y_mm + (MARKER_SIDE_CELLS - row) * cell_mm,
        )
        for row, signs in enumerate(rows)
        for column, sign in enumerate(signs)
        if sign == "."
    ]
    return snapped_union(*cells)


def marker_tiles(
    pads: tuple[MarkerPad, ...], printer: Printer, options: RigOptions, plan_to_map: Floats
) -> tuple[RigPart, ...]:
    """Return the printed tiles of pads; none where the board carries the markers.

    Parameters
    ----------
    plan_to_map
        Transform, shape (4, 4), from the plan into map coordinates, z = 0 being the table.
    """
    if options.style != "plate" and options.marker_kind != "print":
        return ()
    return tuple(_tile(pad, printer, options, plan_to_map) for pad in pads)


def _tile(pad: MarkerPad, printer: Printer, options: RigOptions, plan_to_map: Floats) -> RigPart:
    base_mm = base_layers(printer, options) * printer.layer_mm
    outline = pad.outline
    if pad.corner is not None:  # a round relief where the rig's sharp corner lies
        relief = pad.corner.buffer(_RELIEF_MM, quad_segs=4)
        outline = snapped_union(outline.difference(relief))[0]
    low_mm = np.array(outline.bounds[:2])
    depth_mm = min(options.mark_depth_mm, 0.25 * base_mm)
    # On the underside of the marker's middle: the arms have no room.
    marks = engraved_marks(pad.marker.number, pad.square) if depth_mm else polygon_parts(Polygon())
    cells, recess = polygon_parts(Polygon()), polygon_parts(Polygon())
    raised_mm = recess_mm = 0.0
    recess_layers = 2  # depth of the recess for a paper marker
    if options.marker_kind == "print":
        cells, raised_mm = pad.cells, RAISED_LAYERS * printer.layer_mm
    else:
        recess_mm = recess_layers * printer.layer_mm
        recess = polygon_parts(_recess(pad))
    thick_mm = base_mm + recess_mm

    def moved(pieces: Polygons) -> Polygons:
        return np.asarray(shapely.transform(pieces, lambda points: points - low_mm), dtype=object)

    pockets = [
        Course(pieces=moved(marks), low_mm=-1.0, high_mm=depth_mm),
        Course(pieces=moved(recess), low_mm=base_mm, high_mm=thick_mm + 1.0),
    ]
    vertices, faces = stacked(
        moved(polygon_parts(outline)), moved(cells), thick_mm, raised_mm, pockets
    )
    shift = np.eye(4)
    shift[:2, 3] = low_mm
    return RigPart(
        name=f"marker_{pad.marker.number}",
        vertices_mm=vertices,
        faces=faces,
        to_map=plan_to_map @ shift,
        volume_mm3=float(
            outline.area * thick_mm
            + shapely.area(cells).sum() * raised_mm
            - shapely.area(marks).sum() * depth_mm
            - shapely.area(recess).sum() * recess_mm
        ),
        colour_change_mm=base_mm if options.marker_kind == "print" else 0.0,
    )


def _recess(pad: MarkerPad) -> Polygon:
    """Return the recess for a paper marker; the tile keeps a rim around it."""
    return pad.paper.buffer(-_BOARD_RIM_MM, join_style="mitre")


def paper_crop_mm(pad: MarkerPad) -> float:
    """Return the side of a paper marker with its quiet zone, as it is cut out."""
    x_min, _, x_max, _ = _recess(pad).bounds
    return float(x_max - x_min) - 2.0 * _PAPER_GAP_MM


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BoardMarkers:
    """What a board gets for its markers."""

    pads: BaseGeometry = field(default_factory=Polygon)  # what is added to the board
    squares: Polygons = field(default_factory=lambda: polygon_parts(Polygon()))  # not to be divided
    marks: tuple[LineString, ...] = ()  # engraved


def board_markers(pads: tuple[MarkerPad, ...], options: RigOptions) -> BoardMarkers:
    """Return pads and engraved lines of a board: hatched cells, or where a paper marker goes."""
    if options.style == "plate" or options.marker_kind not in ("engrave", "paper"):
        return BoardMarkers()
    if options.marker_kind == "engrave":
        marks = []
        beam_mm = max(options.kerf_mm, 0.1)
        for pad in pads:  # level lines that fill the black cells, one beam's width apart
            x_min, y_min, x_max, y_max = pad.square.bounds
            count = math.ceil((y_max - y_min) / beam_mm)
            heights = y_min + (np.arange(count) + 0.5) * (y_max - y_min) / count
            ends = [[(x_min - 1.0, y), (x_max + 1.0, y)] for y in heights.tolist()]
            rows = shapely.linestrings(ends)
            cut = shapely.get_parts(shapely.intersection(rows, shapely.union_all(pad.cells)))
            # The beam is round: half of it reaches beyond the ends.
            marks += [
                LineString([(left + 0.5 * beam_mm, low), (right - 0.5 * beam_mm, high)])
                for left, low, right, high in (line.bounds for line in cut)
                if right - left > 1.5 * beam_mm
            ]
    else:  # the square of a paper marker, with its number in it
        marks = [LineString(_recess(pad).exterior.coords) for pad in pads]
        for pad in pads:
            middle = pad.paper.centroid
            marks += centred(strokes(str(pad.marker.number), 8.0), middle.x, middle.y)
    return BoardMarkers(
        pads=shapely.union_all([pad.outline for pad in pads]),
        squares=polygon_parts(*(pad.paper for pad in pads)),
        marks=tuple(marks),
    )


def marker_notes(pads: tuple[MarkerPad, ...], printer: Printer, options: RigOptions) -> list[str]:
    """Return the notes for the person who prints or cuts the markers."""
    if not pads:
        return []
    layers = base_layers(printer, options)
    notes = [
        {
            "print": "markers: print the marker tiles in white and change to black at "
            f"{layers * printer.layer_mm:.2f} mm (layer {layers + 1}); push each into its corner "
            "of the rig",
            "paper": "markers: print markers.svg at 100 %, cut along its marks and glue in place",
            "engrave": "markers: engraved with the board; they have to come out dark on it "
            "(assumed)",
        }[options.marker_kind]
    ]
    loose = [str(pad.marker.number) for pad in pads if pad.corner is None]
    if loose:
        notes.append(
            f"markers {', '.join(loose)}: the rig has no corner there to push them against: lay "
            "the rig and them onto plan.svg, printed at 100 %"
        )
    return notes


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fixtures:
    """Markers, base holder and printed base of a rig."""

    pads: tuple[MarkerPad, ...] = ()
    base: BaseHolder | None = None
    printed: PrintedBase | None = None
    board: BoardMarkers = field(default_factory=BoardMarkers)

    @property
    def markers(self) -> tuple[CornerMarker, ...]:
        """The corner markers, in map coordinates."""
        return tuple(pad.marker for pad in self.pads)


def with_fixtures(
    rig: Rig, world: Map, design: Design | None, *, with_base: bool = False
) -> tuple[Rig, Fixtures]:
    """Return a rig with markers, holder and base in its extras and notes, and these fixtures.

    Raises
    ------
    BadInputError
        If a base is asked for and no holder stands at a start, or it has no room there.
    """
    plate = rig.on_plan(rig.plate)
    pads = marker_pads(world, plate, rig.printer, rig.options)
    taken = shapely.union_all([pad.outline for pad in pads])
    base, notes = base_holder(world, rig, design, taken)
    printed = None
    if with_base:
        if base is None:
            why = notes[0] if notes else "the map has no start, or base_start is 0"
            raise UnfitInputError("base", f"a base is clamped by a holder: {why}", "move the start")
        printed = printed_base(base, rig.printer, design)
    tiles = marker_tiles(pads, rig.printer, rig.options, rig.table_to_map)
    board = board_markers(pads, rig.options)
    fixtures = Fixtures(pads=pads, base=base, printed=printed, board=board)
    beside = rig.extras
    if pads:  # what lies at the rig's upper right corner moves down, below the tile there
        down = np.zeros((4, 4))
        down[1, 3] = (ARM_MM + 10.0) / rig.options.scale
        beside = tuple(replace(part, to_map=part.to_map - down) for part in beside)
    whole = replace(
        rig,
        extras=(
            *beside,
            *tiles,
            *(base.parts if base else ()),
            *(printed.parts if printed else ()),
        ),
        notes=(
            *rig.notes,
            *marker_notes(pads, rig.printer, rig.options),
            *notes,
            *(printed.notes if printed else ()),
        ),
    )
    return whole, fixtures


def outside_of(fixtures: Fixtures) -> BaseGeometry:
    """Return everything that lies around the rig, in the plan."""
    dial = fixtures.base.outline if fixtures.base else Polygon()
    base = fixtures.printed.outline if fixtures.printed else Polygon()
    return shapely.union_all([dial, base, *(pad.outline for pad in fixtures.pads)])
