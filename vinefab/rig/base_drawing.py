"""The drawing of a printed base: a section through holder and base at true scale, and its lid."""

import numpy as np
import shapely
from shapely.affinity import translate
from shapely.geometry.base import BaseGeometry

from vinefab.core.plain_text import one_line
from vinefab.core.validation import Floats
from vinefab.pages.panel import INK, SOFT, Ink, Page, Panel, level_colour, page_of_paper
from vinefab.pages.true_scale import A4_MM, MARGIN_MM, draw_ruler, true_scale
from vinefab.rig.holder import CLAMP_MM, BaseHolder
from vinefab.rig.part import RigPart, manifold_of
from vinefab.rig.printed_base import CORD_MM, SEAT_DEEP_MM, SEAT_WIDE_MM, PrintedBase
from vinefab.rig.solid import outlines_at

_NAMES = {
    "base_body": "base: chamber, cone and tube",
    "base_lid": "lid with the port",
    "base_block": "block of the holder",
    "base_cap": "cap of the holder",
    "base_dial": "dial",
}
_TEXT_PT, _LINE_MM, _VIEW_MM = 7.5, 4.5, 22.0
_THIN = Ink(line=INK, width_pt=0.4)
_HIDDEN = Ink(line=SOFT, width_pt=0.4, dash_pt=(3.0, 2.0))


def base_drawing(name: str, holder: BaseHolder, base: PrintedBase) -> Page:
    """Return the page: section in the middle of the tube, lid from behind, sizes.

    Parameters
    ----------
    name
        Of the rig.
    """
    parts = (*base.parts, *holder.parts)
    cuts = {part.name: section_mm(part, holder) for part in parts}
    lid = lid_mm(base)
    x_min, z_min, x_max, z_max = shapely.total_bounds(list(cuts.values())).tolist()
    lid_wide, lid_high = (float(side) for side in np.ptp(np.reshape(lid.bounds, (2, 2)), axis=0))
    words = (*_sizes(holder, base), "Print at 100 % and measure the ruler. Sizes are computed.")
    wide_mm = max(A4_MM[0], x_max - x_min + lid_wide + _VIEW_MM + 2.0 * MARGIN_MM)
    views_mm = max(z_max - z_min, lid_high) + _VIEW_MM
    high_mm = views_mm + (len(words) + len(_NAMES)) * _LINE_MM + 2.0 * MARGIN_MM + 28.0
    panel = true_scale((0.0, 0.0, wide_mm, high_mm))
    top_mm = high_mm - MARGIN_MM
    panel.words((MARGIN_MM, top_mm), one_line(f"{name}: printed base"), 12.0, bold=True)
    at = np.array([MARGIN_MM - x_min, top_mm - 14.0 - max(z_max - z_min, lid_high) - z_min])
    text_mm = top_mm - views_mm - 10.0
    for number, (part, title) in enumerate(_NAMES.items()):
        colour = level_colour(number + 1)
        ink = Ink(fill=colour, fill_alpha=0.3, line=colour, width_pt=0.6)
        panel.polygons([translate(cuts[part], *at)], ink)
        row_mm = text_mm - number * _LINE_MM
        panel.bars([(MARGIN_MM, row_mm - 1.2, MARGIN_MM + 5.0, row_mm + 1.2)], colour, 0.4)
        panel.words((MARGIN_MM + 8.0, row_mm), title, _TEXT_PT)
    axis = np.array([(x_min - 3.0, holder.stand.axis_mm), (x_max + 3.0, holder.stand.axis_mm)])
    panel.line(axis + at, _HIDDEN, rank=5)
    _draw_lengths(panel, holder, base, at, z_min)
    lid_at = np.array([at[0] + x_max + _VIEW_MM, at[1] + z_min]) - lid.bounds[:2]
    panel.polygons([translate(lid, *lid_at)], _THIN)
    below = lid_at[0] + 0.5 * (lid.bounds[0] + lid.bounds[2]), lid_at[1] + lid.bounds[1] - 4.0
    panel.words(below, "lid from behind", _TEXT_PT, anchor="middle")
    for row, line in enumerate(words, len(_NAMES)):
        panel.words((MARGIN_MM, text_mm - row * _LINE_MM - 2.0), line, _TEXT_PT)
    draw_ruler(panel, MARGIN_MM, MARGIN_MM)
    return page_of_paper(panel)


def section_mm(part: RigPart, holder: BaseHolder) -> BaseGeometry:
    """Return a part's section along the tube's middle, as placed: x forward, z up."""
    to_frame = np.linalg.inv(holder.stand.to_map) @ part.to_map
    # (x, z, -y): the cut is then level.
    across = to_frame[[0, 2, 1]] * np.array([[1.0], [1.0], [-1.0]])
    points = part.vertices_mm @ across[:, :3].T + across[:, 3]
    return outlines_at(manifold_of(points, part.faces), 0.0)


def lid_mm(base: PrintedBase) -> BaseGeometry:
    """Return the lid as it is printed, which is how it looks from behind."""
    lid = base.lid
    return outlines_at(manifold_of(lid.vertices_mm, lid.faces), 1.0)


def _draw_lengths(
    panel: Panel, holder: BaseHolder, base: PrintedBase, at: Floats, z_min: float
) -> None:
    """Draw lengths along the tube below the section, from the mouth backwards."""
    long_mm = base.chamber_mm[0]
    rear_mm = base.rear_mm
    stops = [0.0, -holder.reach_mm, -holder.reach_mm - CLAMP_MM, base.neck_mm, rear_mm + long_mm]
    level = z_min - 5.0
    for right, left in zip(stops, [*stops[1:], rear_mm], strict=True):
        ends = np.array([(right, level), (left, level)])
        panel.line(ends + at, _THIN)
        for x in (right, left):
            panel.line(np.array([(x, level - 1.5), (x, level + 1.5)]) + at, _THIN)
        middle = ends.mean(axis=0) + at - (0.0, 3.5)
        panel.words((middle[0], middle[1]), f"{right - left:.1f}", _TEXT_PT, anchor="middle")


def _sizes(holder: BaseHolder, base: PrintedBase) -> tuple[str, ...]:
    long_mm, wide_mm, high_mm = base.chamber_mm
    return (
        f"Tube {base.tube_mm:.2f} mm outside ({holder.tube.standing}), {base.bore_mm:.2f} mm "
        f"inside; {holder.reach_mm:.1f} mm of it stand out of block and cap.",
        f"Chamber inside {long_mm:.1f} x {wide_mm:.1f} x {high_mm:.1f} mm; port "
        f"{base.port_mm:g} mm; lid on four M3 screws, {base.screw_mm:.0f} mm long.",
        f"Seats {SEAT_WIDE_MM:g} mm wide, {SEAT_DEEP_MM:g} mm deep, for {CORD_MM:g} mm cord: on "
        f"the tube, at most {base.ring_mm:.1f} mm inside; in the rim, {base.lid_cord_mm:.0f} mm.",
    )
