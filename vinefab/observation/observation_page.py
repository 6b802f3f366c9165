"""The pictures of an observation: the photo from straight above, lines seen and predicted."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patheffects import Normal, Stroke

from vinefab.core.validation import Floats
from vinefab.observation.beside_prediction import ComparedBranch
from vinefab.observation.observe_photo import Observation
from vinefab.pages.colours import ALERT, level_colour
from vinefab.pages.figure import house_style, plan_axes, png_bytes

SEEN, PREDICTED = "#ffe600", "#00e5ff"


def overlay_picture(seen: Observation) -> bytes:
    """Return the photo from straight above, with the lines seen and predicted."""
    view = seen.film.view
    with house_style():
        figure, axes = plan_axes(seen.world.bounds.bounds, 8.0)
        rows, columns = view.pixels.shape[:2]
        right = view.left_mm + columns * view.mm_per_pixel
        low = view.top_mm - rows * view.mm_per_pixel
        axes.imshow(view.pixels, extent=(view.left_mm, right, low, view.top_mm), zorder=0)
        for branch in seen.compared.branches:
            _draw_branch(axes, seen, branch)
        axes.set_xlim(view.left_mm, right)
        axes.set_ylim(low, view.top_mm)
    return png_bytes(figure, dpi=130)


def _draw_branch(axes: Axes, seen: Observation, branch: ComparedBranch) -> None:
    z_mm = branch.nominal_width_mm / 2.0

    def shown(points: Floats) -> Floats:
        return seen.film.moved(points, z_mm, seen.film.sight.plane_mm)

    if len(branch.predicted_points_mm) > 1:
        places = shown(branch.predicted_points_mm)
        axes.plot(*places.T, "--", color=PREDICTED, lw=1.3, dashes=(4, 3), zorder=4)
    if not branch.deployed_observed:
        return
    places = shown(branch.points_mm)
    dark = [Stroke(linewidth=2.6, foreground=level_colour(branch.level)), Normal()]
    axes.plot(*places.T, "-", color=SEEN, lw=1.1, zorder=3, path_effects=dark)
    name = [Stroke(linewidth=2.0, foreground="white"), Normal()]
    middle = places[len(places) // 2]
    axes.annotate(
        branch.id, middle, xytext=(3, 3), textcoords="offset points", fontsize=6.5, zorder=6,
        path_effects=name,
    )  # fmt: skip
    contacts = [(c.x_mm, c.y_mm) for c in branch.contacts if c.outcome != "unclear"]
    if contacts:
        axes.plot(*shown(np.array(contacts)).T, "x", color=ALERT, ms=5, mew=1.4, zorder=5)


def film_picture(seen: Observation) -> bytes:
    """Return where film was found."""
    view = seen.film.view
    with house_style():
        figure, axes = plan_axes(seen.world.bounds.bounds, 4.5)
        rows, columns = view.pixels.shape[:2]
        extent = (
            view.left_mm,
            view.left_mm + columns * view.mm_per_pixel,
            view.top_mm - rows * view.mm_per_pixel,
            view.top_mm,
        )
        axes.imshow(seen.film.share, extent=extent, cmap="gray", vmin=0.0, vmax=1.0)
    return png_bytes(figure, dpi=100)
