"""Draw a page of twenty maps of one environment, to see what its generator makes.

Run it as ``python examples/draw_environments.py ENVIRONMENT OUT.png``.
"""

import sys
from pathlib import Path

from matplotlib.figure import Figure

import vinefab as vf
from vinefab.pages.drawing import draw_map
from vinefab.pages.figure import house_style, png_bytes

COLUMNS, ROWS = 5, 4


def main(name: str, target: Path) -> None:
    with house_style():
        figure = Figure(figsize=(3.0 * COLUMNS, 3.0 * ROWS), layout="constrained")
        for seed, axes in enumerate(figure.subplots(ROWS, COLUMNS).flat):
            draw_map(axes, vf.maps.generate(name, seed))
            axes.set_axis_off()
            axes.set_aspect("equal")
            axes.set_title(f"{name} {seed}", fontsize=9)
        target.write_bytes(png_bytes(figure, dpi=60))


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
