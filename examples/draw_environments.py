"""Draw a page of twenty maps of one environment, to see what its generator makes.

Run it as ``python examples/draw_environments.py ENVIRONMENT OUT.png``.
"""

import sys
from pathlib import Path

import vinefab as vf
from vinefab.pages.page_files import page_png
from vinefab.pages.panel import page_of_rows, plan_panel
from vinefab.pages.plan import draw_map

COLUMNS, ROWS = 5, 4


def main(name: str, target: Path) -> None:
    panels = []
    for seed in range(ROWS * COLUMNS):
        world = vf.maps.generate(name, seed)
        panel = plan_panel(world.bounds.bounds, 200.0)
        draw_map(panel, world)
        panel.title, panel.x_name, panel.y_name = f"{name} {seed}", "", ""
        panel.x_ticks = panel.y_ticks = ()
        panel.legend_shown = False
        panels.append(panel)
    rows = [panels[at : at + COLUMNS] for at in range(0, len(panels), COLUMNS)]
    target.write_bytes(page_png(page_of_rows(rows), dpi=60))


if __name__ == "__main__":
    main(sys.argv[1], Path(sys.argv[2]))
