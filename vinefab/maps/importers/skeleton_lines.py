"""Skeletons as comma-separated lines: ``x1,y1,x2,y2`` in mm and perhaps ``width``, a line each.

Commas, semicolons or tabs separate; ``#`` begins a comment; a header may come first.
"""

import math
from pathlib import Path

import numpy as np

from vinefab.core.errors import BadInputError, located
from vinefab.core.validation import Floats
from vinefab.model.files.shipped import read_text
from vinefab.model.skeleton import MOST_SEGMENTS

_LARGEST_BYTES = 64 << 20
_COLUMNS = ("x1", "y1", "x2", "y2", "width")


def read_skeleton(path: Path) -> tuple[Floats, Floats]:
    """Return the segments in a file, mm, shape (n, 4), and their widths, shape (n,), NaN for none.

    Raises
    ------
    BadInputError
        If a line cannot be read; it is named.
    UnreadableFileError
        If there is no such file, or it is not text.
    """
    if path.suffix.lower() != ".csv":
        raise BadInputError("skeleton", str(path), "a file ending in .csv: x1,y1,x2,y2[,width]")
    rows: list[list[float]] = []
    with located(path):
        for number, raw in enumerate(read_text(path, _LARGEST_BYTES).splitlines(), start=1):
            line = raw.partition("#")[0].strip()
            mark = next((one for one in ";\t," if one in line), ",")
            cells = [cell.strip().strip('"').lower() for cell in line.split(mark)]
            names = tuple(cell.removesuffix("_mm") for cell in cells)
            if not line or (not rows and names in (_COLUMNS, _COLUMNS[:4])):
                continue
            if len(rows) == MOST_SEGMENTS:
                raise BadInputError(f"line {number}", "one too many", f"{MOST_SEGMENTS} lines")
            rows.append(_row(number, line, cells))
        if not rows:
            raise BadInputError("lines", None, "x1,y1,x2,y2[,width], one for each line drawn")
    table = np.array(rows)
    return table[:, :4], table[:, 4]


def _row(number: int, line: str, cells: list[str]) -> list[float]:
    """Return the four coordinates and the width of a line, NaN where it has none."""
    try:
        values = [float(cell) for cell in cells[:4]]
        width = float(cells[4]) if len(cells) == 5 and cells[4] else math.nan
    except ValueError:
        values, width = [], math.nan
    has_width = len(cells) == 5 and bool(cells[4])
    if len(cells) not in (4, 5) or not all(map(math.isfinite, values)) or len(values) != 4:
        raise BadInputError(f"line {number}", line, "x1,y1,x2,y2[,width], finite numbers")
    if has_width and not (math.isfinite(width) and width > 0.0):
        raise BadInputError(f"line {number}: width", cells[4], "a width above 0, or nothing")
    return [*values, width]
