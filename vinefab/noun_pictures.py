"""Pictures of nouns in notebooks; `vinefab.bindings` brings a noun here."""

from typing import TYPE_CHECKING, Any

import numpy as np

from vinefab.core.errors import BadInputError, UnfitInputError
from vinefab.core.extras import ensure_extra
from vinefab.core.front_door import imported_later
from vinefab.core.plain_text import counted
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.map import Map
from vinefab.model.outline import Contour
from vinefab.model.score import Score
from vinefab.outline.body_outline import body_outline
from vinefab.pages.page_files import page_svg
from vinefab.pages.panel import SOFT, Ink, Page, Panel, ends_of, level_colour, page_of
from vinefab.pages.plan import deployment_plan, map_plan, outline_plan

if TYPE_CHECKING:
    from vinefab.pages import axes
else:
    axes = imported_later("vinefab.pages.axes")

Noun = Design | Map | Deployment | Contour


def svg_of(noun: Noun, *, longest_pt: float = 468.0) -> str | None:
    """Return a noun as an SVG document for notebooks; None for a noun that cannot be drawn.

    Parameters
    ----------
    longest_pt
        Longer side of the plan, without the parts around it.
    """
    page = page_of_noun(noun, longest_pt)
    # A notebook puts the picture into its page, where no XML declaration may stand.
    return None if page is None else page_svg(page).decode().partition("\n")[2]


def plotted(drawn: Noun | Page, ax: Any, *, legend: bool) -> Any:  # noqa: ANN401  of Matplotlib
    """Draw a noun, or the first panel of a page, on axes of Matplotlib, and return them."""
    ensure_extra("studies", "plot")
    page = drawn if isinstance(drawn, Page) else page_of_noun(drawn)
    if page is None:
        raise UnfitInputError("design", "has no outline that can be drawn", "check it first")
    return axes.plot_panel(page.panels[0], ax, legend=legend)


def page_of_noun(noun: Noun, longest_pt: float = 468.0) -> Page | None:
    """Return the plan of a noun; None for a noun that cannot be drawn."""
    if isinstance(noun, Map):
        size = " x ".join(f"{side:g}" for side in noun.size_mm)
        return map_plan(noun, title=f"{noun.name}: {size} mm", longest_pt=longest_pt)
    if isinstance(noun, Contour):
        return outline_plan(noun, filled=noun.closed, longest_pt=longest_pt)
    if isinstance(noun, Design):
        try:
            outline = body_outline(noun).contour
        except BadInputError:  # a tree that no sheet could hold is shown as text
            return None
        x0, y0, x1, y1 = outline.box_mm
        size = f"{x1 - x0:.0f} x {y1 - y0:.0f} mm flat"
        title = f"{noun.name}: {counted(noun.branch_count, 'branch')}, {size}"
        return outline_plan(outline, title=title, longest_pt=longest_pt)
    world, design = noun.world, noun.design
    # Without a design the widths are not known, and the published model has none.
    is_wide = design is not None and noun.growth.get("body") != "centerline"
    widths_mm = noun.tree.width_mm if is_wide else np.zeros(len(noun.tree))
    names = [design.name if design else "robot", f"on {world.name}" if world else ""]
    title = " ".join(filter(None, [*names, "(simulated)"]))
    return deployment_plan(world, noun, widths_mm, title=title, longest_pt=longest_pt)


def score_page(score: Score) -> Page:
    """Return a chart of the score of every deployment by map, the best map first, and the mean."""
    by_map = dict[str, list[float]]()
    for one in score.evaluations:
        by_map.setdefault(one.map_name, []).append(one.score)
    order = sorted(by_map, key=lambda name: -float(np.mean(by_map[name])))
    points = [(place, found) for place, name in enumerate(order) for found in by_map[name]]
    y0, y1 = ends_of([0.0], [found for _, found in points])
    most_named = 4  # names of maps are long
    names = [(float(place), name) for place, name in enumerate(order)]
    panel = Panel(
        box=(-0.6, y0, len(order) - 0.4, y1),
        width_pt=340.0,
        height_pt=190.0,
        x_name="map" if len(order) <= most_named else "maps, by their mean",
        y_name=f"{score.task} (simulated)",
        x_ticks=names if len(order) <= most_named else None,
        frame=True,
    )
    mean = score.composite["mean"]
    panel.line([(-0.6, mean), (len(order) - 0.4, mean)], Ink(line=SOFT, width_pt=1.2), label="mean")
    panel.marks(points, "o", 5.0, Ink(fill=level_colour(1), fill_alpha=0.8))
    return page_of(panel)
