"""Drawings to print at 100 %: each unit is a millimetre of paper, and a ruler tells whether it is.

A user measures the ruler of 100 mm: a printer that fitted the page to its paper shows there.
"""

import numpy as np

from vinefab.core.validation import Floats
from vinefab.pages.panel import INK, Box, Ink, Panel

A4_MM = (210.0, 297.0)
MARGIN_MM = 15.0
RULER_MM = 100.0
PT_PER_MM = 72.0 / 25.4


def true_scale(box_mm: Box) -> Panel:
    """Return a panel of which each unit is a millimetre of paper."""
    wide_mm, high_mm = box_mm[2] - box_mm[0], box_mm[3] - box_mm[1]
    return Panel(box=box_mm, width_pt=PT_PER_MM * wide_mm, height_pt=PT_PER_MM * high_mm)


def draw_ruler(panel: Panel, x_mm: float, y_mm: float) -> None:
    """Draw a ruler of 100 mm with a tick every 10 mm."""
    ticks = [
        np.array([(at, 0.0), (at, 4.0 if at % 50.0 == 0.0 else 2.5)])
        for at in np.arange(0.0, RULER_MM + 1.0, 10.0).tolist()
    ]
    lines: list[Floats] = [np.array([(0.0, 0.0), (RULER_MM, 0.0)]), *ticks]
    panel.lines(
        [line + np.array([x_mm, y_mm]) for line in lines], Ink(line=INK, width_pt=0.5), rank=6
    )
    panel.words((x_mm + RULER_MM + 2.0, y_mm + 1.0), "100 mm", 8.0)
