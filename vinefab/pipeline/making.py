"""What the optimizer is told about making robots: the cheap rules, and the full check."""

from dataclasses import dataclass

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
        """Return the penalty of the cheap rules.

        The flat robot must fit the recipe's bed with room for seam, kerf and the mouth's overcut.
        """
        material = self.profile.material
        width_mm, height_mm = self.profile.machine.usable_mm
        return fabrication_penalty(
            design,
            film_mm=material.plies * material.ply_mm.value,
            sheet_mm=(width_mm - BED_RESERVE_MM, height_mm - BED_RESERVE_MM),
        )

    def passes(self, design: Design) -> bool:
        """Return whether no design rule forbids to make it, laser paths included."""
        return not check(design, self.profile).blocking
