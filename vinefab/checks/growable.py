"""How far a design is from growing at a pressure that its seams stand, for an optimizer."""

import math

from vinefab.checks.pressure import allowed_n_mm
from vinefab.checks.rule import LimitChanges
from vinefab.checks.window import WINDOW, Fit
from vinefab.model.design import Design
from vinefab.model.laser import LaserProfile
from vinefab.model.tree import branch_tree
from vinefab.physics.growth_tree import planned_growth_kpa
from vinefab.physics.pressure import burst_pressure_kpa

_MOST = 10.0


def window_penalty(
    design: Design, profile: LaserProfile, limits: LimitChanges | None = None
) -> float:
    """Return how far a design is from an open pressure window; 0 where VF-P03 finds no error.

    Parameters
    ----------
    design
        The design. Its paths are taken as planned, as the rule does without maps.
    profile
        The recipe, for seam and growth.
    limits
        Limits that replace the rule's defaults.

    Returns
    -------
    float
        ``log(1 + excess)``, the excess of what growth to the worst tip takes over what the widest
        tube stands with safety and margin, relative to that and at most 10.
    """
    values = WINDOW.limits_with((limits or {}).get(WINDOW.id, {}))
    fit = Fit.of(profile, values)
    build = design.build
    takes_kpa = planned_growth_kpa(
        branch_tree(design), build.widths_mm, fit.loose, fit.diameter_mm
    ).max()
    burst_kpa = burst_pressure_kpa(build.widest_mm, allowed_n_mm(profile.material))
    most_kpa = burst_kpa / values["safety_factor"] / (1.0 + values["margin_percent"] / 100.0)
    return math.log1p(min(_MOST, max(0.0, takes_kpa / most_kpa - 1.0)))
