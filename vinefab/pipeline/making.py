"""What the optimizer is told about making robots: the cheap rules, and the full check."""

from dataclasses import dataclass

from vinefab.checks.growable import window_penalty
from vinefab.checks.limits import by_rule, changed_limits
from vinefab.checks.penalty import fabrication_penalty
from vinefab.model.design import Design
from vinefab.model.laser import LaserProfile
from vinefab.pipeline.check import check

BED_RESERVE_MM = 10.0
"""What seam, kerf and the overcut at the mouth may add to the size of a flat robot."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Making:
    """How far designs are from being made with a recipe.

    Parameters
    ----------
    profile
        The recipe with its machine and material.
    """

    profile: LaserProfile

    def __call__(self, design: Design) -> float:
        """Return the penalty of the cheap rules, under the recipe's limits.

        The flat robot must fit the recipe's bed with room for seam, kerf and the mouth's overcut,
        and grow along its planned paths at a pressure that its seams stand.
        """
        material = self.profile.material
        limits = by_rule(changed_limits(design, self.profile))
        return window_penalty(design, self.profile, limits) + fabrication_penalty(
            design,
            limits,
            film_mm=material.plies * material.ply_mm.value,
            sheet_mm=self.sheet_mm,
        )

    @property
    def sheet_mm(self) -> tuple[float, float]:
        """What a flat robot must fit into."""
        width_mm, height_mm = self.profile.machine.usable_mm
        return width_mm - BED_RESERVE_MM, height_mm - BED_RESERVE_MM

    def passes(self, design: Design) -> bool:
        """Return whether no design rule forbids to make it, laser paths included."""
        return not check(design, self.profile).blocking

    def complaint(self, design: Design) -> str:
        """Return which design rules forbid to make a design, and the first reason; empty if none.

        The full check decides: a design with a penalty may pass it all the same, cut in tiles.
        """
        blocking = check(design, self.profile).blocking
        rules = ", ".join(dict.fromkeys(finding.rule for finding in blocking))
        return f"{rules} ({blocking[0].message})" if blocking else ""
