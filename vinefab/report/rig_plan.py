"""The assembly drawing of a rig: which part goes where, seen from above."""

from collections.abc import Mapping

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patheffects import Normal, Stroke
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.model.checked import Floats
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.map import Map
from vinefab.report.colours import INK, ROCK, ROCK_EDGE, SOFT, level_colour
from vinefab.report.drawing import fill
from vinefab.report.figure import house_style, plan_axes
from vinefab.report.view import UNSEEN
from vinefab.rig.part import Rig

_SEAM = level_colour(2)
_CUT = "#d00000"
_THICKENED = level_colour(4)


def assembly_plan(rig: Rig, world: Map, outlines: Mapping[int, BaseGeometry]) -> Figure:
    """Return the numbered plan of a rig, in millimetres of the rig from its lower left corner.

    Parameters
    ----------
    rig, world
        The rig and its map.
    outlines
        Outline of every part where it stands, by number, in map coordinates.
    """
    x_mm, y_mm = rig.plate.bounds[:2]
    scale = rig.options.scale

    def on_rig(shape: BaseGeometry) -> BaseGeometry:
        return shapely.transform(shape, lambda points: scale * (points - (x_mm, y_mm)))

    plate = on_rig(rig.plate)
    _, _, wide_mm, deep_mm = plate.bounds
    with house_style():
        figure, axes = plan_axes((0.0, 0.0, wide_mm, deep_mm), 7.0)
        fill(axes, [plate], face="#fbfcfd", edge=SOFT)
        walls = shapely.simplify(on_rig(rig.walls), UNSEEN * max(wide_mm, deep_mm))
        fill(axes, [walls], face=ROCK, edge=ROCK_EDGE)
        fill(axes, [on_rig(rig.thickened)], face=_THICKENED, edge=_THICKENED, rank=2)
        for number, outline in outlines.items():
            size = 14 if len(outlines) < 30 else max(3.0, 90.0 / len(outlines) ** 0.5)
            _draw_part(axes, number, on_rig(outline), size)
        for start in world.starts:
            point = on_rig(shapely.Point(start.pose.x_mm, start.pose.y_mm))
            axes.plot(
                *shapely.get_coordinates(point)[0],
                "o",
                color=INK,
                markersize=4,
                mec="white",
                zorder=6,
            )
        _draw_north(axes)
        axes.set_title(_title(rig, len(outlines), (wide_mm, deep_mm)), fontsize=9, loc="left")
        axes.set_xlabel("mm of the rig")
        axes.set_ylabel("mm of the rig")
    return figure


def _draw_part(axes: Axes, number: int, outline: BaseGeometry, size: float) -> None:
    fill(axes, [outline], face="none", edge=_SEAM, rank=4)
    biggest = max(shapely.get_parts(outline), key=shapely.area, default=Polygon())
    if biggest.is_empty:
        return
    spot = biggest.centroid if biggest.covers(biggest.centroid) else biggest.representative_point()
    axes.annotate(
        str(number),
        (spot.x, spot.y),
        fontsize=size,
        weight="bold",
        color=INK,
        ha="center",
        va="center",
        path_effects=[Stroke(linewidth=0.2 * size, foreground="white"), Normal()],
        zorder=8,
    )


def _draw_north(axes: Axes) -> None:
    axes.annotate(
        "",
        (1.03, 0.96),
        (1.03, 0.86),
        xycoords="axes fraction",
        arrowprops={"arrowstyle": "-|>", "color": INK, "linewidth": 1.6},
        annotation_clip=False,
    )
    axes.text(1.03, 0.965, "N", transform=axes.transAxes, ha="center", va="bottom", color=INK)


def _title(rig: Rig, count: int, size_mm: tuple[float, float]) -> str:
    thickened = "; yellow: thickened to print" if rig.thickened.area else ""
    return (
        f"{rig.name}: {count} parts, {size_mm[0]:.0f} x {size_mm[1]:.0f} mm, obstacles "
        f"{rig.options.height_mm:g} mm high, scale {rig.options.scale:.4g}{thickened}"
    )


def sheet_plan(job: Job) -> Figure:
    """Return a plan of a sheet for the laser: cuts and marks, without numbers."""
    with house_style():
        figure, axes = plan_axes((0.0, 0.0, job.sheet_width_mm, job.sheet_height_mm), 7.0)
        fill(
            axes,
            [shapely.box(0.0, 0.0, job.sheet_width_mm, job.sheet_height_mm)],
            face="#fbfcfd",
            edge=SOFT,
        )
        for operation, colour in ((Operation.MARK, INK), (Operation.CUT, _CUT)):
            lines = [_drawn(path) for path in job.along(operation)]
            axes.add_collection(LineCollection(lines, colors=colour, linewidths=0.7, zorder=3))
        axes.set_title(f"{job.name}: red is cut, black is marked", fontsize=9, loc="left")
    return figure


def _drawn(path: LaserPath) -> Floats:
    points = path.contour.flattened_mm(0.05)
    return np.vstack([points, points[:1]]) if path.contour.closed else points
