"""The pictures of an observation: the photo from straight above, lines seen and predicted."""

import numpy as np
from numpy.typing import NDArray

from vinefab.core.validation import Floats
from vinefab.observation.beside_prediction import ComparedBranch
from vinefab.observation.observe_photo import Observation
from vinefab.pages.colours import ALERT, level_colour
from vinefab.pages.page_png import page_png
from vinefab.pages.panel import Ink, Panel, page_of, photo, plan_panel

SEEN, PREDICTED = "#ffe600", "#00e5ff"


def _photo_panel(seen: Observation, pixels: NDArray[np.uint8], longest_pt: float) -> Panel:
    """Return a panel with pixels where the photo lies on the map."""
    view = seen.film.view
    rows, columns = view.pixels.shape[:2]
    right = view.left_mm + columns * view.mm_per_pixel
    box = (view.left_mm, view.top_mm - rows * view.mm_per_pixel, right, view.top_mm)
    panel = plan_panel(box, longest_pt)
    panel.add(photo(pixels, box), 0.0)
    return panel


def overlay_picture(seen: Observation) -> bytes:
    """Return the photo from straight above, with the lines seen and predicted."""
    panel = _photo_panel(seen, seen.film.view.pixels, 576.0)
    for branch in seen.compared.branches:
        _draw_branch(panel, seen, branch)
    return page_png(page_of(panel), dpi=130)


def _draw_branch(panel: Panel, seen: Observation, branch: ComparedBranch) -> None:
    z_mm = branch.nominal_width_mm / 2.0

    def shown(points: Floats) -> Floats:
        return seen.film.moved(points, z_mm, seen.film.sight.plane_mm)

    if len(branch.predicted_points_mm) > 1:
        dashed = Ink(line=PREDICTED, width_pt=1.3, dash_pt=(5.2, 3.9))
        panel.line(shown(branch.predicted_points_mm), dashed, rank=4.0)
    if not branch.deployed_observed:
        return
    places = shown(branch.points_mm)
    panel.line(places, Ink(line=level_colour(branch.level), width_pt=2.6), rank=3.0)
    panel.line(places, Ink(line=SEEN, width_pt=1.1), rank=3.0)
    x, y = places[len(places) // 2].tolist()
    panel.words((x, y), branch.id, 6.5, shift_pt=(3.0, 5.5), halo=True)
    contacts = [(c.x_mm, c.y_mm) for c in branch.contacts if c.outcome != "unclear"]
    if contacts:
        panel.marks(shown(np.array(contacts)), "x", 5.0, Ink(line=ALERT, width_pt=1.4), rank=5.0)


def film_picture(seen: Observation) -> bytes:
    """Return where film was found."""
    grey = np.clip(np.rint(255.0 * seen.film.share), 0, 255).astype(np.uint8)
    return page_png(page_of(_photo_panel(seen, grey, 324.0)), dpi=100)
