"""Which cells of a raster a deployed body covers; loads no plotting."""

from collections.abc import Sequence

import numpy as np
from PIL import Image, ImageDraw

from vinefab.core.validation import Floats
from vinefab.model.deployment import Deployment
from vinefab.physics.tube import inflated_diameter_mm


def body_cells(
    deployment: Deployment,
    widths_mm: Sequence[float],
    low_mm: tuple[float, float],
    cell_mm: float,
    shape: tuple[int, int],
) -> Floats:
    """Return 1 where a deployed body covers a cell's middle, else 0, within about a cell."""
    picture = Image.new("1", (shape[1], shape[0]))
    draw = ImageDraw.Draw(picture)
    for branch in np.flatnonzero(deployment.deployed).tolist():
        across = inflated_diameter_mm(widths_mm[int(deployment.tree.level[branch]) - 1]) / cell_mm
        chain = (deployment.chain_mm(branch) - np.array(low_mm)) / cell_mm - 0.5
        draw.line([(x, y) for x, y in chain.tolist()], fill=1, width=max(1, round(across)))
        for x, y in chain.tolist():
            half = across / 2.0
            draw.ellipse((x - half, y - half, x + half, y + half), fill=1)
    return np.asarray(picture, dtype=np.float64)
