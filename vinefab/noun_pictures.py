"""Pictures of nouns in notebooks; `vinefab.bindings` brings a noun here."""

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.plain_text import counted
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.map import Map
from vinefab.model.outline import Contour
from vinefab.outline.body_outline import body_outline
from vinefab.pages.page_files import page_svg
from vinefab.pages.plan import deployment_plan, map_plan, outline_plan


def svg_of(noun: Design | Map | Deployment | Contour, *, longest_pt: float = 468.0) -> str | None:
    """Return a noun as an SVG document for notebooks; None for a noun that cannot be drawn.

    Parameters
    ----------
    longest_pt
        Longer side of the plan, without the parts around it.
    """
    if isinstance(noun, Map):
        size = " x ".join(f"{side:g}" for side in noun.size_mm)
        page = map_plan(noun, title=f"{noun.name}: {size} mm", longest_pt=longest_pt)
    elif isinstance(noun, Contour):
        page = outline_plan(noun, filled=noun.closed, longest_pt=longest_pt)
    elif isinstance(noun, Design):
        try:
            outline = body_outline(noun).contour
        except BadInputError:  # a tree that no sheet could hold is shown as text
            return None
        x0, y0, x1, y1 = outline.box_mm
        size = f"{x1 - x0:.0f} x {y1 - y0:.0f} mm flat"
        title = f"{noun.name}: {counted(noun.branch_count, 'branch')}, {size}"
        page = outline_plan(outline, title=title, longest_pt=longest_pt)
    else:
        world, design = noun.world, noun.design
        # Without a design the widths are not known, and the published model has none.
        is_wide = design is not None and noun.growth.get("body") != "centerline"
        widths_mm = noun.tree.width_mm if is_wide else np.zeros(len(noun.tree))
        names = [design.name if design else "robot", f"on {world.name}" if world else ""]
        title = " ".join(filter(None, [*names, "(simulated)"]))
        page = deployment_plan(world, noun, widths_mm, title=title, longest_pt=longest_pt)
    # A notebook puts the picture into its page, where no XML declaration may stand.
    return page_svg(page).decode().partition("\n")[2]
