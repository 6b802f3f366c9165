"""Which parts are printed together, and where on the bed."""

from collections.abc import Sequence
from dataclasses import dataclass

from vinefab.model.printer import Printer
from vinefab.rig.options import RigOptions
from vinefab.rig.part import RigPart
from vinefab.rig.split import usable_mm

GAP_MM = 5.0
"""Least distance between two parts on a bed."""

_SLACK_MM = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Placed:
    """A part on a bed, or a piece on a sheet.

    Parameters
    ----------
    index
        Which one, counted from 0.
    x_mm, y_mm
        Where the lower left corner of its box lies.
    """

    index: int
    x_mm: float
    y_mm: float


def packed(
    sizes_mm: Sequence[tuple[float, float]], room_mm: tuple[float, float], gap_mm: float
) -> list[list[Placed]]:
    """Put boxes on as few beds as shelves allow, without turning them.

    Boxes are taken by falling depth and set side by side on shelves; a box goes onto the first
    shelf, on the first bed, that has room.

    Parameters
    ----------
    sizes_mm
        Width and depth of each box.
    room_mm
        Width and depth of the usable bed; a larger box is put down all the same.
    gap_mm
        Distance between boxes.

    Returns
    -------
    list of list of Placed
        Bed by bed, in the order in which beds were opened.
    """
    beds: list[list[Placed]] = []
    shelves: list[list[float]] = []  # bed, y, depth, next free x
    tops: list[float] = []  # next free y of each bed
    order = sorted(range(len(sizes_mm)), key=lambda index: (-sizes_mm[index][1], index))
    for index in order:
        wide_mm, deep_mm = sizes_mm[index]
        for shelf in shelves:
            bed, y_mm, depth_mm, x_mm = shelf
            if deep_mm <= depth_mm + _SLACK_MM and x_mm + wide_mm <= room_mm[0] + _SLACK_MM:
                break
        else:
            bed = next(
                (bed for bed, top in enumerate(tops) if top + deep_mm <= room_mm[1] + _SLACK_MM),
                len(beds),
            )
            if bed == len(beds):
                beds.append([])
                tops.append(0.0)
            y_mm, x_mm = tops[int(bed)], 0.0
            shelf = [bed, y_mm, deep_mm, x_mm]
            shelves.append(shelf)
            tops[int(bed)] += deep_mm + gap_mm
        beds[int(bed)].append(Placed(index=index, x_mm=x_mm, y_mm=y_mm))
        shelf[3] = x_mm + wide_mm + gap_mm
    return beds


def beds_of(
    parts: Sequence[RigPart], printer: Printer, options: RigOptions
) -> tuple[tuple[Placed, ...], ...]:
    """Return the beds on which parts are printed, each part where it lies on its bed.

    Parameters
    ----------
    parts
        What is printed.
    printer, options
        Bed and its margin.
    """
    margin_mm = options.bed_margin_mm
    sizes = [(part.size_mm[0], part.size_mm[1]) for part in parts]
    beds = packed(sizes, usable_mm(printer, options), GAP_MM)
    return tuple(
        tuple(
            Placed(index=at.index, x_mm=at.x_mm + margin_mm, y_mm=at.y_mm + margin_mm)
            for at in sorted(bed, key=lambda at: at.index)
        )
        for bed in sorted(beds, key=lambda bed: min(at.index for at in bed))
    )
