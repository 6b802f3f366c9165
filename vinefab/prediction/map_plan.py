"""A plan of a map with its narrow passages and the room for a body."""

from collections.abc import Sequence

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from shapely.geometry.base import BaseGeometry

from vinefab.maps.passages import Passage
from vinefab.model.map import Map
from vinefab.pages.colours import ALERT, INK, level_colour
from vinefab.pages.drawing import draw_legend, draw_map, draw_pose, fill_geometry
from vinefab.pages.figure import house_style, plan_axes
from vinefab.pages.label_places import write_labels
from vinefab.pages.map_view import UNSEEN_DETAIL

ROOM = level_colour(3)
_MOST_NAMED = 30


def passage_plan(
    world: Map,
    passages: Sequence[Passage],
    clearances_mm: Sequence[float],
    body: tuple[float, BaseGeometry] | None = None,
) -> Figure:
    """Return a plan of a map with its narrow passages, numbered from the narrowest."""
    with house_style():
        figure, axes = plan_axes(world.bounds.bounds)
        if body is not None:
            region = shapely.simplify(body[1], UNSEEN_DETAIL * max(world.size_mm))
            fill_geometry(axes, [region], face=ROOM, edge="none", alpha=0.25, rank=0.5)
            label = f"room for a body of {body[0]:g} mm lay-flat width"
            axes.fill([], [], color=ROOM, alpha=0.25, label=label)
        draw_map(axes, world)
        for start, clearance_mm in zip(world.starts, clearances_mm, strict=True):
            draw_pose(axes, start.pose, max(world.size_mm))
            place = (start.pose.x_mm, start.pose.y_mm)
            axes.add_patch(Circle(place, clearance_mm, fill=False, ec=INK, ls=":", lw=1.0))
        for passage in passages:
            _draw_passage(axes, passage)
        _once(axes)
        _write_numbers(axes, world, passages[:_MOST_NAMED])
    return figure


def _draw_passage(axes: Axes, passage: Passage) -> None:
    (x_1, y_1), (x_2, y_2) = passage.ends_mm
    axes.plot([x_1, x_2], [y_1, y_2], color=ALERT, lw=2.0, solid_capstyle="butt", zorder=6)
    # Many a passage is too short to be seen on paper: the ring shows where it is.
    axes.plot(*passage.middle_mm, "o", ms=11, mfc="none", mec=ALERT, mew=1.0, zorder=6)


def _write_numbers(axes: Axes, world: Map, passages: Sequence[Passage]) -> None:
    """Write number and width of passages, and the numbers of starts where there are several."""
    words = [f"{number}: {one.width_mm:.1f} mm" for number, one in enumerate(passages, start=1)]
    starts = world.starts if 1 < len(world.starts) <= _MOST_NAMED else ()
    places = [one.middle_mm for one in passages] + [(s.pose.x_mm, s.pose.y_mm) for s in starts]
    colours = [ALERT] * len(words) + [INK] * len(starts)
    words += [f"start {number}" for number in range(1, len(starts) + 1)]
    write_labels(axes, np.array(places), words, colours, size_pt=8.0, mark_pt=5.5)


def _once(axes: Axes) -> None:
    """Explain what is drawn, each kind once."""
    axes.plot([], [], color=INK, ls=":", lw=1.0, label="clearance of the start")
    axes.plot(
        [], [], "o-", color=ALERT, mfc="none", ms=9, lw=2.0, label="narrow passage (computed)"
    )
    draw_legend(axes)
