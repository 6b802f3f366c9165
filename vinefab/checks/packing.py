"""How much of a branch's lumen the folded film of its descendants fills."""

from vinefab.model.design import Design
from vinefab.physics.lumen import lumen_area_mm2

PACKING = 0.1
"""Share of solid film in a bundle of crumpled thin film (assumed, uncalibrated)."""


def occupancies(design: Design, film_mm: float, packing: float = PACKING) -> tuple[float, ...]:
    """Return, for each level that has children, how much of its lumen its descendants fill.

    While a branch grows, all its undeployed descendants are drawn through it one level after
    the other, the branches of one level side by side. A branch of width w is w x (film) of solid
    cross-section, which crumpling blows up to w x (film) / packing. The fullest cross-section
    below level i is that of the level with the most width in it:

        occupancy_i = max over j > i of  n_ij w_j film / packing / (w_i^2 / pi)

    with n_ij descendants of level j per branch of level i. Where a level tapers, w_i is its width
    at the end and w_j at the beginning. The branch's own inverted wall is not
    counted. The formula is vinefab's and uncalibrated; it neglects that levels of uneven branch
    lengths overlap.

    Parameters
    ----------
    design
        The design.
    film_mm
        Thickness of all plies together.
    packing
        Share of solid film in crumpled film.

    Returns
    -------
    tuple of float
        Ratios, trunk first; one entry fewer than there are levels.
    """
    widths_mm, ends_mm = design.build.widths_mm, design.build.end_widths_mm
    shares = []
    for above in range(len(design.levels)):
        count, most_mm = 1, 0.0
        for below in range(above, len(design.levels)):
            count *= design.levels[below].branches
            most_mm = max(most_mm, count * widths_mm[below + 1])
        shares.append(most_mm * film_mm / packing / lumen_area_mm2(ends_mm[above]))
    return tuple(shares)
