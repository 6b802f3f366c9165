"""What a fixed design must meet, and the cost of its changes."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from vinefab.core.units import deg
from vinefab.core.validation import Floats
from vinefab.fabrication.job.passes import bare_sheet_mm, taken_mm
from vinefab.fabrication.rules.catalog import RULES, by_rule, changed_limits
from vinefab.fabrication.rules.clearance_rules import (
    ANGLE,
    CLEARANCE,
    CROTCH,
    FILLET,
    POUCH,
    least_gap_mm,
)
from vinefab.fabrication.rules.pressure_rules import (
    BURST,
    WINDOW,
    GrowthConstantsRange,
    growth_limit_kpa,
    safe_pressure_kpa,
)
from vinefab.fabrication.rules.rule import LimitChanges, Limits, Rule, relative_excess
from vinefab.fabrication.rules.tree_rules import (
    CLAMP,
    LEAST_WIDTH,
    MOUTH,
    PACKING,
    TAIL,
    WIDTH_RATIO,
)
from vinefab.model.design import Build, Design, Level
from vinefab.model.laser import LaserProfile
from vinefab.model.tree import child_lengths_mm, widest_turn_rad
from vinefab.physics.growth_pressure import GrowthPath
from vinefab.physics.tube import inflated_diameter_mm
from vinefab.search.penalty_batch import PenaltyRules

WEIGHTS = {
    "branches": 2.0,
    "length": 1.0,
    "angle": 1.0,
    "growth": 0.5,
    "width": 0.5,
    "taper": 0.25,
    "pouch": 0.5,
    "fillet": 0.1,
    "tail": 0.1,
    "pressure": 0.1,
}
"""Cost of a change by its kind: of a length or width by the absolute logarithm of its ratio, of an
angle by its change in radians, of pruned branches by the logarithm of the planned length left.
Where the robot goes counts most, how it is made least; the numbers are vinefab's own."""

_UNCHANGED = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignChange:
    """One value of a design that was changed."""

    what: str  # which value (``level 2 length``)
    before: float  # in `unit`
    after: float  # in `unit`
    unit: str  # empty for counts
    cost: float  # its share of the cost of all changes

    @property
    def text(self) -> str:
        """The change as a line for the user."""
        unit = f" {self.unit}" if self.unit else ""
        percent = 100.0 * (self.after / self.before - 1.0) if self.before else 0.0
        relative = f" ({percent:+.1f} %)" if self.unit not in ("", "deg") and percent else ""
        return f"{self.what}: {self.before:.4g} -> {self.after:.4g}{unit}{relative}"


def design_changes(before: Design, after: Design) -> tuple[DesignChange, ...]:
    """Return every value that differs between a design and its fixed version."""
    found = [*_where_it_goes(before, after), *_built(before.build, after.build)]
    return tuple(change for change in found if change.cost > _UNCHANGED)


def change_cost(before: Design, after: Design) -> float:
    """Return the weighted sum of all changes, 0 for the same design."""
    return math.fsum(change.cost for change in design_changes(before, after))


def planned_length_mm(trunk_mm: float, levels: tuple[Level, ...]) -> float:
    """Return the planned length of all branches together."""
    total, count = trunk_mm, 1
    for level in levels:
        count *= level.branches
        mean = (1.0 + level.growth) / 2.0 if level.branches > 1 else 1.0
        total += count * level.length_mm * mean
    return total


def pruning_cost(before: Design, branches: tuple[int, ...]) -> float:
    """Return the cost of keeping only some branches, by the planned length that is left."""
    kept = tuple(
        level.changed(
            branches=count,
            length_mm=level.length_mm * (1.0 if count > 1 else _mean_share(level)),
        )
        for level, count in zip(before.levels, branches, strict=False)
    )
    whole = planned_length_mm(before.trunk_length_mm, before.levels)
    left = planned_length_mm(before.trunk_length_mm, kept)
    return WEIGHTS["branches"] * max(0.0, math.log(whole / left))


def _mean_share(level: Level) -> float:
    """Return the mean length of a level's branches over that of the first."""
    return (1.0 + level.growth) / 2.0 if level.branches > 1 else 1.0


def _where_it_goes(before: Design, after: Design) -> Iterator[DesignChange]:
    counts = tuple(level.branches for level in after.levels)
    if counts != tuple(level.branches for level in before.levels):
        yield DesignChange(
            what="branches",
            before=float(before.branch_count),
            after=float(after.branch_count),
            unit="",
            cost=max(1e-6, pruning_cost(before, counts)),
        )
    yield _relative("length", "trunk", before.trunk_length_mm, after.trunk_length_mm)
    for number, (old, new) in enumerate(zip(before.levels, after.levels, strict=False), start=2):
        yield _relative("length", f"level {number}", old.length_mm, new.length_mm)
        if new.branches == 1:
            continue
        yield DesignChange(
            what=f"level {number} fan",
            before=deg(old.fan_rad),
            after=deg(new.fan_rad),
            unit="deg",
            cost=WEIGHTS["angle"] * abs(new.fan_rad - old.fan_rad),
        )
        yield _relative("growth", f"level {number}", old.growth, new.growth, "%", 100.0)


def _built(before: Build, after: Build) -> Iterator[DesignChange]:
    for number, pair in enumerate(zip(before.widths_mm, after.widths_mm, strict=False), start=1):
        yield _relative("width", f"level {number}", *pair)
    count = len(after.widths_mm)
    old_new = (build.taper[:count] or count * (1.0,) for build in (before, after))
    for number, pair in enumerate(zip(*old_new, strict=True), start=1):
        yield _relative("taper", f"level {number}", *pair, "%", 100.0)
    for number, pair in enumerate(zip(before.fillet_mm, after.fillet_mm, strict=False), start=2):
        yield _relative("fillet", f"level {number}", *pair)
    yield _relative("tail", "the", before.tail_mm, after.tail_mm)
    yield _relative("pressure", "the", before.pressure_kpa, after.pressure_kpa, "kPa")
    for name in ("radius_mm", "length_mm", "width_mm"):
        old, new = getattr(before.pouch, name, None), getattr(after.pouch, name, None)
        if old is not None and new is not None:
            yield _relative("pouch", name.removesuffix("_mm").join(("", " of the")), old, new)


def _relative(
    kind: str, where: str, before: float, after: float, unit: str = "mm", scale: float = 1.0
) -> DesignChange:
    """Return a change with a logarithmic cost; from or to zero it costs as much as doubling."""
    same = before == after
    size = 0.0 if same else math.log(2.0)
    if not same and before > 0.0 and after > 0.0:
        size = abs(math.log(after / before))
    return DesignChange(
        what=f"{where} {kind}",
        before=before * scale,
        after=after * scale,
        unit=unit,
        cost=WEIGHTS[kind] * size,
    )


_LEAST = (LEAST_WIDTH, WIDTH_RATIO, ANGLE, FILLET, MOUTH)
_LEFT = (CLEARANCE, POUCH)
_MOST = (PACKING, CROTCH, CLAMP)


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
        """
        limits = by_rule(changed_limits(design, profile, given))
        for rules, factor in ((_LEAST, 1.0 + margin), (_MOST, 1.0 - margin)):
            for rule in rules:
                named = limits.setdefault(rule.id, {})
                named["error"] = factor * named.get("error", rule.limits["error"])
        for rule in _LEFT:  # film that is left: 0 at least, which no factor makes stricter
            stricter_mm = margin * least_gap_mm(rule, limits, taken_mm(profile))
            named = limits.setdefault(rule.id, {})
            named["error"] = named.get("error", rule.limits["error"]) + stricter_mm
        sheet_mm = bare_sheet_mm(profile)
        penalized = PenaltyRules.of(design.build, profile, limits, sheet_mm, grows=False)
        fit = GrowthConstantsRange.of(profile, WINDOW.limits_with(limits.get(WINDOW.id, {})))
        return cls(
            profile=profile,
            limits=limits,
            rules=penalized,
            fit=fit,
            window_share=window_share,
        )

    def of_rule(self, rule: Rule) -> Limits:
        """Return a rule's limits."""
        return RULES[rule.id].limits_with(self.limits.get(rule.id, {}))

    def penalties(self, designs: Sequence[Design]) -> Floats:
        """Return how far designs are from keeping the error limits, 0 if they keep them; (m,).

        Of the rules about the laser's paths only those that go by the joints are included.
        """
        found, excess = self.rules.with_path_excess(designs)
        return found + np.log1p(excess + [self._making_excess(one) for one in designs])

    def _making_excess(self, design: Design) -> float:
        """Return how far mouth, pouch and the pressure for growth are from their limits."""
        build = design.build
        wide = relative_excess(build.mouth_width_mm, self.of_rule(CLAMP)["error"])
        pouch_mm = build.pouch.flat_width_mm if build.pouch else 0.0
        return (
            (0.0 if build.collar else wide)  # a collar fits its own clamp
            + relative_excess(self.of_rule(MOUTH)["error"], build.mouth_width_mm)
            + relative_excess(self.least_pouch_mm(build), pouch_mm)
            + self._window(design)
        )

    def least_pouch_mm(self, build: Build) -> float:
        """Return the least flat width of a design's pouches, 0 where it has none."""
        return 1.01 * build.widths_mm[-1] if build.pouch else 0.0

    def settled(self, design: Design) -> Design:
        """Return a design whose fillets, tail and pressure keep the limits at its widths."""
        build, fillet = design.build, self.of_rule(FILLET)
        fillets_mm = tuple(
            max(self.least_fillet_mm(), min(radius, fillet["most_error_share"] * width))
            for radius, width in zip(build.fillet_mm, build.widths_mm[1:], strict=True)
        )
        settled = build.changed(
            fillet_mm=fillets_mm,
            tail_mm=max(build.tail_mm, self.of_rule(TAIL)["error"]),
            pressure_kpa=min(
                max(build.pressure_kpa, self._least_kpa(design)), self.most_kpa(build)
            ),
        )
        return design.changed(build=settled)

    def most_kpa(self, build: Build) -> float:
        """Return the largest working pressure that the seams stand at a build's widths."""
        material = self.profile.material
        safe = safe_pressure_kpa(build.widest_mm, material, self.of_rule(BURST))
        return math.floor(1000.0 * min(safe, material.seam.pressure_kpa.value)) / 1000.0

    def least_fillet_mm(self) -> float:
        """Return the least fillet radius that the rules allow and the laser can run."""
        return self.rules.limits.drawn_mm

    def _window(self, design: Design) -> float:
        """Return the relative excess of the pressure that growth in free space takes."""
        limits = self.of_rule(WINDOW)
        allowed = growth_limit_kpa(design.build.widest_mm, self.profile.material, limits)
        return relative_excess(self._growth_kpa(design), self.window_share * allowed)

    def _least_kpa(self, design: Design) -> float:
        """Return the working pressure that growth takes where that was measured, else 0."""
        if not self.fit.measured:
            return 0.0
        return math.ceil(1000.0 * self._growth_kpa(design) / self.window_share) / 1000.0

    def _growth_kpa(self, design: Design) -> float:
        """Return the pressure that growth of the worst branch takes in free space."""
        fit = self.fit
        worst = 0.0
        for depth, end_mm in enumerate(design.build.end_widths_mm):
            constants = fit.loose.at_diameter(inflated_diameter_mm(end_mm), fit.diameter_mm)
            path = _worst_path(design, depth)
            worst = max(worst, path.pressure_kpa(constants, _riding_mm(design, depth)))
        return worst


def _worst_path(design: Design, depth: int) -> GrowthPath:
    """Return a path to a level as long as its longest and as winding as its most winding."""
    lengths, turns = [design.trunk_length_mm], []
    for level in design.levels[:depth]:
        lengths.append(float(child_lengths_mm(level).max()))
        turns.append(widest_turn_rad(level))
    return GrowthPath(lengths_mm=tuple(lengths), turns_rad=tuple(turns))


def _riding_mm(design: Design, depth: int) -> float:
    """Return the film carried by each branch of a level, as a length of the branch's own width."""
    widths_mm = design.build.widths_mm
    film_mm2 = 0.0
    for below in range(depth, len(design.levels)):
        above = planned_length_mm(0.0, design.levels[depth:below])
        film_mm2 += widths_mm[below + 1] * (
            planned_length_mm(0.0, design.levels[depth : below + 1]) - above
        )
    return film_mm2 / widths_mm[depth]
