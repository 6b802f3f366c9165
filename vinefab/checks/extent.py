"""How far a flat robot hangs over a sheet, over all the ways it may be turned."""

import numpy as np

from vinefab.checks.shapes import Shapes

_TURNS = 180


def excess_mm(shapes: Shapes, sheet_mm: tuple[float, float]) -> float:
    """Return by how much the robot overshoots a sheet in its best turn; 0 or less where it fits.

    Parameters
    ----------
    shapes
        The flat robot; its first capsule is the trunk with the tail, whose end is cut straight.
    sheet_mm
        Width and height.

    Notes
    -----
    Whole degrees are tried; placing the finished outline tries more turns, so that it never fits
    worse but for the width of seam and kerf and the overcut at the mouth.
    """
    turns = np.arange(_TURNS) * np.pi / _TURNS
    across = np.stack([np.cos(turns), np.sin(turns)])
    half, end_half = shapes.half_mm[:, None], shapes.end_half_mm[:, None]
    corners = shapes.start_mm[0] + np.array([[0.0, 1.0], [0.0, -1.0]]) * shapes.half_mm[0]
    ends, starts = shapes.end_mm @ across, shapes.start_mm[1:] @ across
    high = np.concatenate([ends + end_half, starts + half[1:], corners @ across]).max(axis=0)
    low = np.concatenate([ends - end_half, starts - half[1:], corners @ across]).min(axis=0)
    wide = high - low
    # Turning by a right angle swaps width and height.
    tall = np.roll(wide, -_TURNS // 2)
    over = np.maximum(wide - sheet_mm[0], tall - sheet_mm[1])
    return float(over.min())
