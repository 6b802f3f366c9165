"""What the optimizer is told about making robots: the cheap rules, and the full check."""

from dataclasses import dataclass

from vinefab.checks.growable import window_penalty
from vinefab.checks.limits import by_rule, changed_limits
from vinefab.checks.penalty import fabrication_penalty
from vinefab.core.errors import BadInputError
from vinefab.model.design import Build, Design
from vinefab.model.laser import LaserProfile
from vinefab.pipeline.check import check

BED_RESERVE_MM = 10.0
"""What seam, kerf and the overcut at the mouth may add to the size of a flat robot."""

PRESSURE_RULES = ("VF-P01", "VF-P02")


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
        width_mm, height_mm = self.profile.machine.usable_mm
        limits = by_rule(changed_limits(design, self.profile))
        return window_penalty(design, self.profile, limits) + fabrication_penalty(
            design,
            limits,
            film_mm=material.plies * material.ply_mm.value,
            sheet_mm=(width_mm - BED_RESERVE_MM, height_mm - BED_RESERVE_MM),
        )

    def check_build(self, build: Build) -> None:
        """Complain of a build whose pressure no design can work at.

        Parameters
        ----------
        build
            That of the smallest designs.

        Raises
        ------
        BadInputError
            If the rules forbid the working pressure for the widest part.
        """
        vine = Design(name="vine", trunk_length_mm=200.0, build=build)
        for finding in check(vine, self.profile).blocking:
            if finding.rule in PRESSURE_RULES:
                raise BadInputError("build.pressure_kpa", build.pressure_kpa, finding.message)

    def passes(self, design: Design) -> bool:
        """Return whether no design rule forbids to make it, laser paths included."""
        return not check(design, self.profile).blocking
