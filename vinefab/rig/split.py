"""Where straight cuts divide a plan into tiles that fit the bed."""

from dataclasses import dataclass

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.model.printer import Printer
from vinefab.rig.clean import Pieces
from vinefab.rig.edges import Edges
from vinefab.rig.joints import TAB_DEPTH_MM
from vinefab.rig.options import RigOptions

_STEP_MM = 1.0
_LEAST_TILE_MM = 5.0 * TAB_DEPTH_MM


@dataclass(frozen=True, slots=True, kw_only=True)
class Cuts:
    """The lines of a grid of tiles, the plate's box included.

    Parameters
    ----------
    x_mm, y_mm
        Ascending; tile (row, column) lies between neighbouring values.
    turned
        Whether the tiles are turned by a quarter on the bed.
    """

    x_mm: tuple[float, ...]
    y_mm: tuple[float, ...]
    turned: bool

    @property
    def tiles(self) -> int:
        """Number of rectangles in the grid."""
        return (len(self.x_mm) - 1) * (len(self.y_mm) - 1)


def cuts_of(
    box_mm: tuple[float, float, float, float],
    solids: Pieces,
    printer: Printer,
    options: RigOptions,
) -> Cuts:
    """Choose the cut lines.

    As few tiles as the bed allows, in the better of the two ways to lay them on it. Each line may
    wander within what the tile size allows, to cross as little obstacle as possible and to stay
    away from obstacles' corners, so that no thin tip is cut off.

    Parameters
    ----------
    box_mm
        The plate's box: x_min, y_min, x_max, y_max.
    solids
        What stands on the plate.
    printer, options
        Bed and margin; ``options.most_parts`` limits the number of tiles.

    Raises
    ------
    BadInputError
        If the bed is too small for tiles, or too many would be needed.
    """
    size_mm = box_mm[2] - box_mm[0], box_mm[3] - box_mm[1]
    columns, rows, turn = grid_of(size_mm, printer, options)
    bed_mm = usable_mm(printer, options)
    if turn:
        bed_mm = bed_mm[1], bed_mm[0]
    edges = Edges.of(solids)
    return Cuts(
        x_mm=_lines((box_mm[0], box_mm[2]), columns, bed_mm[0], edges),
        y_mm=_lines((box_mm[1], box_mm[3]), rows, bed_mm[1], edges.turned()),
        turned=turn,
    )


def grid_of(
    size_mm: tuple[float, float], printer: Printer, options: RigOptions
) -> tuple[int, int, bool]:
    """Return how many columns and rows of tiles a plate takes, and whether they lie turned.

    Raises
    ------
    BadInputError
        If the bed is too small for tiles, or too many would be needed.
    """
    (width_mm, depth_mm), bed_mm = size_mm, usable_mm(printer, options)
    straight = _count(width_mm, bed_mm[0]), _count(depth_mm, bed_mm[1])
    turned = _count(width_mm, bed_mm[1]), _count(depth_mm, bed_mm[0])
    turn = turned[0] * turned[1] < straight[0] * straight[1]
    columns, rows = turned if turn else straight
    if columns * rows > options.most_parts:
        plate = f"a plate of {width_mm:.0f} x {depth_mm:.0f} mm on {printer.name}"
        allowed = f"at most {options.most_parts} for {plate}: a larger bed, or a smaller scale"
        raise BadInputError("rig.parts", columns * rows, allowed)
    return columns, rows, turn


def usable_mm(printer: Printer, options: RigOptions) -> tuple[float, float]:
    """Return width and depth of the bed inside its margin."""
    margin_mm = 2.0 * options.bed_margin_mm
    return printer.bed_width_mm - margin_mm, printer.bed_depth_mm - margin_mm


def _count(length_mm: float, bed_mm: float) -> int:
    """Return how many tiles cover a length; all but the last carry joints that stick out."""
    if length_mm <= bed_mm:
        return 1
    tile_mm = bed_mm - TAB_DEPTH_MM
    if tile_mm < _LEAST_TILE_MM:
        least_mm = _LEAST_TILE_MM + TAB_DEPTH_MM
        raise BadInputError("printer.bed", bed_mm, f"at least {least_mm:g} mm without its margin")
    return int(np.ceil((length_mm - 1e-9) / tile_mm))


def _lines(
    span_mm: tuple[float, float], count: int, bed_mm: float, edges: Edges
) -> tuple[float, ...]:
    """Place the cuts one after another, each where it costs least."""
    tile_mm = bed_mm - TAB_DEPTH_MM
    lines = [span_mm[0]]
    for index in range(1, count):
        even_mm = span_mm[0] + (span_mm[1] - span_mm[0]) * index / count
        # Even tiles have this much to spare; half of it to either side keeps every tile on the bed.
        spare_mm = max(0.0, tile_mm - (span_mm[1] - span_mm[0]) / count)
        low, high = even_mm - 0.5 * spare_mm, even_mm + 0.5 * spare_mm
        choices = np.arange(np.ceil(low / _STEP_MM), np.floor(high / _STEP_MM) + 1.0) * _STEP_MM
        if len(choices) == 0:
            choices = np.array([round(even_mm, 3)])
        lines.append(float(choices[np.argmin(edges.costs_mm(choices, even_mm))]))
    return (*lines, span_mm[1])
