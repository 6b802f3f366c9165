"""Draw the README's picture of a real result: deployment, sheet for the laser, rig.

Run it as ``python examples/draw_result.py OUT.png``.
"""

import io
import sys
from pathlib import Path

from matplotlib.figure import Figure
from mpl_toolkits.mplot3d import Axes3D
from mpl_toolkits.mplot3d.art3d import Poly3DCollection
from PIL import Image

import vinefab as vf
from vinefab.fabrication.package.prepare import prepare
from vinefab.fabrication.package.sheet_pictures import OPERATION_COLOURS
from vinefab.model.files.shipped import DEFAULT_PRINTER, DEFAULT_RECIPE
from vinefab.model.job import Operation
from vinefab.model.laser import read_profile
from vinefab.pages.page_files import page_png
from vinefab.pages.plan import deployment_plan
from vinefab.rig.build import build_rig
from vinefab.rig.part import Rig, read_printer
from vinefab.studies.paper_charts import house_style

UNSEEN_SEED = 100_003


def draw_rig(axes: Axes3D, rig: Rig) -> None:
    # The painter's order of large plate triangles is wrong, so the plate is drawn first and flat.
    axes.computed_zorder = False
    for part in rig.parts:
        placed = part.vertices_mm @ part.to_map[:3, :3].T + part.to_map[:3, 3]
        low, high = placed.min(axis=0), placed.max(axis=0)
        corners = [(low[0], low[1]), (high[0], low[1]), (high[0], high[1]), (low[0], high[1])]
        plate = [[(x, y, 0.0) for x, y in corners]]
        axes.add_collection3d(Poly3DCollection(plate, facecolors="#eef2f4", zorder=1))
        triangles = placed[part.faces]
        standing = triangles[triangles[:, :, 2].max(axis=1) > 1e-6]
        axes.add_collection3d(
            Poly3DCollection(standing, facecolors="#b7c4cb", shade=True, zorder=2)
        )
    axes.auto_scale_xyz([60, 440], [60, 440], [-120, 260])
    axes.view_init(elev=40, azim=-65)


def main(target: Path) -> None:
    design, world = vf.Design.read("grid_explorer"), vf.maps.grid(UNSEEN_SEED)
    with house_style():
        figure = Figure(figsize=(15.0, 5.2), layout="constrained")
        grown, sheet = figure.add_subplot(1, 3, 1), figure.add_subplot(1, 3, 2)
        solid = figure.add_subplot(1, 3, 3, projection="3d")
        deployment = design.grow(world, body="inflated")
        plan = page_png(deployment_plan(world, deployment, deployment.tree.width_mm))
        grown.imshow(Image.open(io.BytesIO(plan)))
        job = prepare(design, read_profile(DEFAULT_RECIPE)).job
        for path in job.along(Operation.WELDCUT) + job.along(Operation.CUT):
            sheet.plot(*path.contour.flattened_mm().T, color=OPERATION_COLOURS[path.operation])
        draw_rig(solid, build_rig(world, read_printer(DEFAULT_PRINTER)))
        solid.set_axis_off()
        for axes in (grown, sheet):
            axes.set_aspect("equal")
            axes.axis("off")
        figure.savefig(target, dpi=110)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
