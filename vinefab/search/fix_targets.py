"""The limits that a fix keeps to, and how far designs are from them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from vinefab.core.validation import Floats, Ints
from vinefab.fabrication.job.passes import bare_sheet_mm, taken_mm
from vinefab.fabrication.rules.catalog import RULES, by_rule, changed_limits
from vinefab.fabrication.rules.clearance_rules import (
    check_angle,
    check_clearance,
    check_crotch,
    check_fillet,
    check_pouch,
    least_gap_mm,
)
from vinefab.fabrication.rules.pressure_rules import (
    GrowthConstantsRange,
    check_burst,
    check_window,
    growth_limit_kpa,
    safe_pressure_kpa,
)
from vinefab.fabrication.rules.rule import LimitChanges, Limits, Rule, relative_excess
from vinefab.fabrication.rules.tree_rules import (
    check_clamp,
    check_least_width,
    check_mouth,
    check_packing,
    check_tail,
    check_width_ratio,
)
from vinefab.model.design import Build, Design
from vinefab.model.laser import LaserProfile
from vinefab.physics.tube import inflated_diameter_mm
from vinefab.search.penalty_batch import BatchPenalty, PenaltyRules
from vinefab.search.tree_batch import TreeBatch

_LEAST = (check_least_width, check_width_ratio, check_angle, check_fillet, check_mouth)
_LEFT = (check_clearance, check_pouch)
_MOST = (check_packing, check_crotch, check_clamp)


@dataclass(frozen=True, slots=True, kw_only=True)
class FixTargets:
    """The limits that a fixed design must keep."""

    profile: LaserProfile  # machine, material and recipe
    limits: LimitChanges  # that differ from the defaults, slightly stricter than those of the check
    rules: PenaltyRules  # that a penalty counts
    fit: GrowthConstantsRange
    # Share of the allowed pressure that growth in free space may take: below 1 where contacts on a
    # map add to it.
    window_share: float = 1.0

    @classmethod
    def of(
        cls,
        design: Design,
        profile: LaserProfile,
        given: LimitChanges | None = None,
        *,
        margin: float = 0.0,
        window_share: float = 1.0,
        film_mm: float = 0.0,
    ) -> "FixTargets":
        """Return the targets for a design.

        Parameters
        ----------
        given
            Limits that override those of recipe and design.
        margin
            How much stricter the targets are than the limits, relative to them.
        window_share
            See the field.
        film_mm
            How much more film is to be left between branches.
        """
        limits = by_rule(changed_limits(design, profile, given))
        for rules, factor in ((_LEAST, 1.0 + margin), (_MOST, 1.0 - margin)):
            for rule in rules:
                named = limits.setdefault(rule.id, {})
                named["error"] = factor * named.get("error", rule.limits["error"])
        for rule in _LEFT:  # film that is left: 0 at least, which no factor makes stricter
            stricter_mm = film_mm + margin * least_gap_mm(rule, limits, taken_mm(profile))
            named = limits.setdefault(rule.id, {})
            named["error"] = named.get("error", rule.limits["error"]) + stricter_mm
        sheet_mm = bare_sheet_mm(profile)
        penalized = PenaltyRules.of(
            design.build, profile, limits, sheet_mm,
            grows=False, each_place=design.branches is not None,
        )  # fmt: skip
        fit = GrowthConstantsRange.of(profile, check_window.limits_under(limits))
        return cls(
            profile=profile,
            limits=limits,
            rules=penalized,
            fit=fit,
            window_share=window_share,
        )

    def of_rule(self, rule: Rule) -> Limits:
        """Return a rule's limits."""
        return RULES[rule.id].limits_under(self.limits)

    def penalties(self, designs: Sequence[Design]) -> Floats:
        """Return the distances of designs from the error limits, 0 if they keep them; (m,).

        Of the rules about the laser's paths only those that go by the joints are included.
        """
        at_once, trees = self.rules.at_once(designs)
        sides = self.rules.known_sides(designs)
        return self.of_trees(at_once, trees, np.arange(len(designs)), sides)

    def of_trees(
        self,
        at_once: BatchPenalty,
        trees: TreeBatch,
        builds: Ints,
        sides: tuple[Floats, Floats] | None = None,
    ) -> Floats:
        """Return the distances of trees with some builds, as `BatchPenalty.found` takes them."""
        found, excess = at_once.with_path_excess(trees, builds, sides)
        build_of = [at_once.builds[row] for row in builds.tolist()]
        return found + np.log1p(excess + self._excess(trees, build_of))

    def _excess(self, trees: TreeBatch, builds: Sequence[Build]) -> Floats:
        """Return the excess of mouth, pouch and the pressure for growth over their limits; (m,)."""
        window, takes_kpa = self.of_rule(check_window), self.growth_kpa(trees)
        leaf_mm = np.where(trees.is_leaf, trees.base_width_mm, 0.0)
        leaf_mm, wide_mm = trees.largest(leaf_mm), trees.largest(trees.width_mm)
        widest_mm, narrowest_mm = (self.of_rule(one)["error"] for one in (check_clamp, check_mouth))
        found = []
        for build, leaf, wide, takes in zip(
            builds, leaf_mm.tolist(), wide_mm.tolist(), takes_kpa.tolist(), strict=True
        ):
            pouch_mm = build.pouch.flat_width_mm if build.pouch else 0.0
            least_mm = 1.01 * leaf if build.pouch else 0.0
            allowed_kpa = growth_limit_kpa(max(wide, pouch_mm), self.profile.material, window)
            mouth_mm = build.mouth_width_mm
            clamped = relative_excess(mouth_mm, widest_mm)
            found.append(
                (0.0 if build.collar else clamped)  # a collar fits its own clamp
                + relative_excess(narrowest_mm, mouth_mm)
                + relative_excess(least_mm, pouch_mm)
                + relative_excess(takes, self.window_share * allowed_kpa)
            )
        return np.array(found)

    def settled(self, design: Design) -> Design:
        """Return a design of levels whose fillets, tail and pressure keep the limits."""
        build = self.with_fitting_fillets(design.build, design.build.widths_mm[1:])
        # What growth takes, where that was measured.
        takes_kpa = self.needed_kpa(TreeBatch.of([design.tree]))[0]
        return design.changed(build=self.with_pressure(build, build.widest_mm, takes_kpa))

    def with_fitting_fillets(self, build: Build, widths_mm: Sequence[float]) -> Build:
        """Return a build whose tail and fillets keep the limits.

        Parameters
        ----------
        widths_mm
            Narrowest lay-flat width of the branches of each level from the second on.
        """
        most = self.of_rule(check_fillet)["most_error_share"]
        least_mm = self.least_fillet_mm()
        return build.changed(
            fillet_mm=tuple(
                max(least_mm, min(radius, most * width))
                for radius, width in zip(build.fillet_mm, widths_mm, strict=True)
            ),
            tail_mm=max(build.tail_mm, self.of_rule(check_tail)["error"]),
        )

    def with_pressure(self, build: Build, widest_mm: float, takes_kpa: float) -> Build:
        """Return a build with a pressure that growth takes and the seams stand.

        Parameters
        ----------
        widest_mm
            Largest lay-flat width of the robot.
        takes_kpa
            What growth takes, 0 where that is not known.
        """
        least_kpa = math.ceil(1000.0 * takes_kpa / self.window_share) / 1000.0
        pressure_kpa = min(max(build.pressure_kpa, least_kpa), self.most_kpa(widest_mm))
        is_same = pressure_kpa == build.pressure_kpa
        return build if is_same else build.changed(pressure_kpa=pressure_kpa)

    def needed_kpa(self, trees: TreeBatch) -> list[float]:
        """Return the pressure that growth takes, where that was measured; else 0."""
        return self.growth_kpa(trees).tolist() if self.fit.measured else [0.0] * len(trees)

    def most_kpa(self, widest_mm: float) -> float:
        """Return the largest working pressure that the seams stand at a lay-flat width."""
        material = self.profile.material
        safe = safe_pressure_kpa(widest_mm, material, self.of_rule(check_burst))
        return math.floor(1000.0 * min(safe, material.seam.pressure_kpa.value)) / 1000.0

    def least_fillet_mm(self) -> float:
        """Return the least fillet radius that the rules allow and the laser can run."""
        return self.rules.limits.drawn_mm

    def growth_kpa(self, trees: TreeBatch) -> Floats:
        """Return the pressure that growth of the worst branch takes in free space, shape (m,).

        As `vinefab.physics.growth_pressure.planned_growth_kpa`; a tapered branch counts with its
        width at the tip, where it needs most.
        """
        fit = self.fit.loose
        drag_kpa_mm = fit.drag_kpa_m.value / 1000.0
        bent, above, wide_mm = trees.is_bent, trees.row_before, trees.base_width_mm
        film_mm2, inside_mm2 = trees.length_mm * wide_mm, np.zeros(len(above))
        generations = trees.generations
        for rows in generations[:0:-1]:
            carried_mm2 = inside_mm2[rows] + np.where(bent[rows], 0.0, film_mm2[rows])
            np.add.at(inside_mm2, above[rows], carried_mm2)
            film_mm2[above[rows][bent[rows]]] += film_mm2[rows][bent[rows]]
        factor, before_kpa = np.ones(len(above)), np.zeros(len(above))
        own_kpa = drag_kpa_mm * trees.length_mm
        turned = np.exp(fit.friction.value * np.abs(trees.offset_rad))
        for rows in generations[1:]:
            up = above[rows]
            factor[rows] = factor[up] * turned[rows]
            before_kpa[rows] = (before_kpa[up] + own_kpa[up]) * turned[rows]
        store_kpa = fit.storage_kpa.value + drag_kpa_mm * inside_mm2 / wide_mm
        takes_kpa = fit.yield_kpa.value + store_kpa * factor + before_kpa + own_kpa
        diameter_mm = inflated_diameter_mm(1.0) * trees.end_width_mm
        is_last = np.ones(len(above), dtype=np.bool_)
        is_last[above[bent]] = False
        return trees.largest(np.where(is_last, takes_kpa * self.fit.diameter_mm / diameter_mm, 0.0))
