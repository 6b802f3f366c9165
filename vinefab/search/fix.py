"""``vinefab fix``: the smallest change of a design that clears its errors.

The search is deterministic and follows the order of a maker's attempts: smaller fillets alone; then
widths, lengths and angles, alone and together; then fewer branches. What comes later is tried only
if all before it found nothing. At first one value, or a group of them, is moved at a time: what
lowers the penalty most for its cost, in steps that grow and shrink, until no penalty is left. Where
that gets stuck and no branch is to go, CMA-ES moves all values together. Then every value moves
back towards the original as far as the rules allow. The cheapest result counts. It is the best that
this search finds, not proven to be the smallest there is.
"""

import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, product
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from vinefab.core.errors import BadInputError
from vinefab.core.front_door import imported_later
from vinefab.core.frozen import FrozenMapping
from vinefab.core.limits import deg
from vinefab.core.progress import each
from vinefab.core.validation import Floats
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
from vinefab.model.design import Build, Design, Level, check_levels
from vinefab.model.laser import LaserProfile
from vinefab.model.tree import child_lengths_mm, widest_turn_rad
from vinefab.physics.growth_pressure import GrowthPath
from vinefab.physics.tube import inflated_diameter_mm
from vinefab.search.penalty_batch import PenaltyRules

if TYPE_CHECKING:
    import cmaes
else:  # it takes long to load, and most fixes do without
    cmaes = imported_later("cmaes")

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
    unchanged = 1e-9
    return tuple(change for change in _changes(before, after) if change.cost > unchanged)


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
            length_mm=level.length_mm
            * (1.0 if count > 1 or level.branches == 1 else (1.0 + level.growth) / 2.0),
        )
        for level, count in zip(before.levels, branches, strict=False)
    )
    whole = planned_length_mm(before.trunk_length_mm, before.levels)
    left = planned_length_mm(before.trunk_length_mm, kept)
    return WEIGHTS["branches"] * max(0.0, math.log(whole / left))


def _changes(before: Design, after: Design) -> Iterator[DesignChange]:
    """Yield the change of every value: where the robot goes, then how it is made."""
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
    one, two = before.build, after.build
    for number, pair in enumerate(zip(one.widths_mm, two.widths_mm, strict=False), start=1):
        yield _relative("width", f"level {number}", *pair)
    count = len(two.widths_mm)
    old_new = (build.taper[:count] or count * (1.0,) for build in (one, two))
    for number, pair in enumerate(zip(*old_new, strict=True), start=1):
        yield _relative("taper", f"level {number}", *pair, "%", 100.0)
    for number, pair in enumerate(zip(one.fillet_mm, two.fillet_mm, strict=False), start=2):
        yield _relative("fillet", f"level {number}", *pair)
    yield _relative("tail", "the", one.tail_mm, two.tail_mm)
    yield _relative("pressure", "the", one.pressure_kpa, two.pressure_kpa, "kPa")
    for name in ("radius_mm", "length_mm", "width_mm"):
        old_mm, new_mm = getattr(one.pouch, name, None), getattr(two.pouch, name, None)
        if old_mm is not None and new_mm is not None:
            size = name.removesuffix("_mm")
            yield _relative("pouch", f"{size} of the", old_mm, new_mm)


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
        found, excess = self.rules.with_path_excess(designs)
        return found + np.log1p(excess + [self._excess(one) for one in designs])

    def _excess(self, design: Design) -> float:
        """Return the excess of mouth, pouch and the pressure for growth over their limits."""
        build, window = design.build, self.of_rule(check_window)
        allowed_kpa = growth_limit_kpa(build.widest_mm, self.profile.material, window)
        wide = relative_excess(build.mouth_width_mm, self.of_rule(check_clamp)["error"])
        pouch_mm = build.pouch.flat_width_mm if build.pouch else 0.0
        least_mm = 1.01 * build.widths_mm[-1] if build.pouch else 0.0
        return (
            (0.0 if build.collar else wide)  # a collar fits its own clamp
            + relative_excess(self.of_rule(check_mouth)["error"], build.mouth_width_mm)
            + relative_excess(least_mm, pouch_mm)
            + relative_excess(self._growth_kpa(design), self.window_share * allowed_kpa)
        )

    def settled(self, design: Design) -> Design:
        """Return a design whose fillets, tail and pressure keep the limits at its widths."""
        build, fillet = design.build, self.of_rule(check_fillet)
        fillets_mm = tuple(
            max(self.least_fillet_mm(), min(radius, fillet["most_error_share"] * width))
            for radius, width in zip(build.fillet_mm, build.widths_mm[1:], strict=True)
        )
        # What growth takes, where that was measured.
        takes_kpa = self._growth_kpa(design) if self.fit.measured else 0.0
        least_kpa = math.ceil(1000.0 * takes_kpa / self.window_share) / 1000.0
        settled = build.changed(
            fillet_mm=fillets_mm,
            tail_mm=max(build.tail_mm, self.of_rule(check_tail)["error"]),
            pressure_kpa=min(max(build.pressure_kpa, least_kpa), self.most_kpa(build)),
        )
        return design.changed(build=settled)

    def most_kpa(self, build: Build) -> float:
        """Return the largest working pressure that the seams stand at a build's widths."""
        material = self.profile.material
        safe = safe_pressure_kpa(build.widest_mm, material, self.of_rule(check_burst))
        return math.floor(1000.0 * min(safe, material.seam.pressure_kpa.value)) / 1000.0

    def least_fillet_mm(self) -> float:
        """Return the least fillet radius that the rules allow and the laser can run."""
        return self.rules.limits.drawn_mm

    def _growth_kpa(self, design: Design) -> float:
        """Return the pressure that growth of the worst branch takes in free space.

        The path to a level is as long as its longest and as winding as its most winding.
        """
        fit, levels, worst = self.fit, design.levels, 0.0
        widths_mm = design.build.widths_mm
        for depth, end_mm in enumerate(design.build.end_widths_mm):
            longest_mm = (float(child_lengths_mm(level).max()) for level in levels[:depth])
            path = GrowthPath(
                lengths_mm=(design.trunk_length_mm, *longest_mm),
                turns_rad=tuple(map(widest_turn_rad, levels[:depth])),
            )
            film_mm2 = 0.0  # that each branch of the level carries
            for below in range(depth, len(levels)):
                above_mm = planned_length_mm(0.0, levels[depth:below])
                length_mm = planned_length_mm(0.0, levels[depth : below + 1]) - above_mm
                film_mm2 += widths_mm[below + 1] * length_mm
            constants = fit.loose.at_diameter(inflated_diameter_mm(end_mm), fit.diameter_mm)
            worst = max(worst, path.pressure_kpa(constants, film_mm2 / widths_mm[depth]))
        return worst


Variable = tuple[str, int]
"""What is changed, one of `KINDS`, and on which level, from 0."""

FIX_KINDS = frozenset({"length", "growth", "fan", "width", "taper", "pouch", "fillet"})
"""What a fix can change, besides the number of branches."""

BRANCHES = "branches"
KEEPS: Mapping[str, frozenset[str]] = FrozenMapping(
    {
        BRANCHES: frozenset(),
        "length": frozenset({"length", "growth"}),
        "angle": frozenset({"fan"}),
        "width": frozenset({"width", "taper", "pouch"}),
    }
)
"""What a user may tell a fix to keep, and the kinds of changes that this rules out."""

_DECIMALS = 3


def parsed_keeps(texts: Iterable[str]) -> frozenset[str]:
    """Return the names of values to keep, from texts like ``branches,length``.

    >>> sorted(parsed_keeps(["branches, length", "angle"]))
    ['angle', 'branches', 'length']
    """
    words = [word.strip() for text in texts for word in text.split(",")]
    for word in words:
        if word not in KEEPS:
            allowed = f"{', '.join(KEEPS)}, one or more with commas between them"
            raise BadInputError("--keep", word, allowed)
    return frozenset(words)


@dataclass(frozen=True, slots=True, kw_only=True)
class FixStage:
    """One step of a fix: what may change in it."""

    kinds: frozenset[str]  # of `KINDS`
    prunes: bool = False  # whether branches may be removed

    @property
    def groups(self) -> tuple[str, ...]:
        """Words of `KEEPS` whose values may change."""
        return tuple(word for word, kinds in KEEPS.items() if kinds and kinds <= self.kinds)


FILLETS = FixStage(kinds=frozenset({"fillet"}))


def fix_stages(keep: frozenset[str] = frozenset()) -> tuple[tuple[FixStage, ...], ...]:
    """Return the stages of a fix: those of one step compete, a later step is a last resort.

    A step has a stage for all kinds that may change, and one for every choice of them. So what is
    found while more is kept is found while less is kept, too.
    """
    free = [kinds for word, kinds in KEEPS.items() if kinds and word not in keep]
    chosen = [
        FILLETS.kinds.union(*some)
        for size in range(1 + len(free))
        for some in combinations(free, size)
    ]
    steps = [(FILLETS,), tuple(FixStage(kinds=kinds) for kinds in chosen[1:])]
    if BRANCHES not in keep:
        steps.append(tuple(FixStage(kinds=kinds, prunes=True) for kinds in chosen))
    return tuple(filter(None, steps))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FixSpace:
    """All changes of one design with some of its branches kept, as vectors: 0 for no change."""

    design: Design  # the original
    branches: tuple[int, ...]  # children per parent on each level after the trunk that is kept
    # What each entry of a vector changes: angles in radians, all else by its logarithm.
    variables: tuple[Variable, ...]
    targets: FixTargets  # settle fillets, tail and pressure

    @classmethod
    def of(
        cls,
        design: Design,
        branches: tuple[int, ...],
        targets: FixTargets,
        kinds: frozenset[str] = FIX_KINDS,
    ) -> "FixSpace":
        """Return the space of some kinds of changes of a design with some of its branches kept."""
        depth = 1 + len(branches)
        wide = [level for level, count in enumerate(branches, start=1) if count > 1]
        variables: list[Variable] = [("length", level) for level in range(depth)]
        variables += [("fan", level) for level in wide]
        variables += [("growth", level) for level in wide if design.levels[level - 1].growth != 1.0]
        variables += [("width", level) for level in range(depth)]
        variables += [("taper", level) for level in range(depth - 1)]
        variables += [("fillet", level) for level in range(1, depth)]
        variables += [("pouch", 0)] if design.build.pouch else []
        used = tuple(variable for variable in variables if variable[0] in kinds)
        return cls(design=design, branches=branches, variables=used, targets=targets)

    def __len__(self) -> int:
        return len(self.variables)

    def at(self, x: Floats) -> Design:
        """Return the design at a vector, settled by the targets, numbers rounded to 0.001 mm."""
        by_kind: dict[str, dict[int, float]] = {}
        for (kind, level), value in zip(self.variables, x.tolist(), strict=True):
            by_kind.setdefault(kind, {})[level] = value
        scale = {
            kind: {level: math.exp(value) for level, value in values.items()}
            for kind, values in by_kind.items()
        }
        depth = 1 + len(self.branches)
        levels = tuple(
            self._level(number, scale, by_kind.get("fan", {})) for number in range(1, depth)
        )
        build = self._build(depth, scale)
        trunk_mm = _scaled_mm(self.design.trunk_length_mm, scale.get("length", {}).get(0, 1.0))
        changed = self.design.changed(trunk_length_mm=trunk_mm, levels=levels, build=build)
        return self.targets.settled(changed)

    def penalty(self, x: Floats) -> float:
        """Return the distance of the design at a vector from its targets; 0 if it meets them."""
        return float(self.targets.penalties([self.at(x)])[0])

    def assessed(self, points: Iterable[Floats]) -> list[tuple[Floats, float, float]]:
        """Return vectors with their penalties, all evaluated at once, and costs."""
        designs = [(x, self.at(x)) for x in points]
        penalties = self.targets.penalties([design for _, design in designs]).tolist()
        return [
            (x, penalty, change_cost(self.design, design))
            for (x, design), penalty in zip(designs, penalties, strict=True)
        ]

    def cost(self, x: Floats) -> float:
        """Return the cost of the change to a vector, pruned branches included."""
        return change_cost(self.design, self.at(x))

    def directions(self) -> Floats:
        """Return the search directions, shape (k, n): single values and groups of them."""
        rows = [*np.eye(len(self))]
        for kind in ("length", "fan", "width"):
            group = np.array([float(name == kind) for name, _ in self.variables])
            below = group * np.array([float(level > 0) for _, level in self.variables])
            rows += [one for one in (group, below) if np.count_nonzero(one) > 1]
        # All that narrows at one joint: the parent's end and the children's beginnings.
        for level in range(len(self.branches)):
            around = {("taper", level), ("width", level + 1)}
            row = np.array([float(variable in around) for variable in self.variables])
            rows += [row] if np.count_nonzero(row) > 1 else []
        unique = np.unique(np.array(rows), axis=0)[::-1]
        return np.concatenate([unique, -unique])

    def _level(
        self, number: int, scale: dict[str, dict[int, float]], turned: dict[int, float]
    ) -> Level:
        old = self.design.levels[number - 1]
        growth = scale.get("growth", {}).get(number, 1.0)
        turn_rad = turned.get(number, 0.0)
        angle_deg = min(360.0, max(0.0, round(deg(old.fan_rad + turn_rad), _DECIMALS)))
        percent = min(10_000.0, max(0.1, round(old.growth_percent * growth, _DECIMALS)))
        return Level(
            branches=self.branches[number - 1],
            length_mm=_scaled_mm(old.length_mm, scale.get("length", {}).get(number, 1.0)),
            angle_deg=angle_deg if turn_rad else old.angle_deg,
            growth_percent=old.growth_percent if growth == 1.0 else percent,
        )

    def _build(self, depth: int, scale: dict[str, dict[int, float]]) -> Build:
        old = self.design.build

        def scaled(kind: str, values_mm: tuple[float, ...], first: int = 0) -> tuple[float, ...]:
            factors = scale.get(kind, {})
            numbered = enumerate(values_mm, start=first)
            return tuple(_scaled_mm(value, factors.get(level, 1.0)) for level, value in numbered)

        factors, tapers = scale.get("taper", {}), old.taper[:depth] or depth * (1.0,)
        least_taper = 0.05
        changed = tuple(
            ratio
            if (factor := factors.get(level, 1.0)) == 1.0
            else min(1.0, max(least_taper, round(ratio * factor, _DECIMALS)))
            for level, ratio in enumerate(tapers)
        )
        pouch, factor = old.pouch, scale.get("pouch", {}).get(0, 1.0)
        if pouch and factor != 1.0:
            sizes_mm = {name: mm for name, mm in pouch if name != "shape" and mm is not None}
            pouch = pouch.changed(**{name: _scaled_mm(mm, factor) for name, mm in sizes_mm.items()})
        return old.changed(
            widths_mm=scaled("width", old.widths_mm[:depth]),
            fillet_mm=scaled("fillet", old.fillet_mm[: depth - 1], first=1),
            taper=changed if old.taper[:depth] or min(changed) < 1.0 else (),
            pouch=pouch,
        )


def kept_branches(design: Design) -> list[tuple[int, ...]]:
    """Return the ways to prune a design, as children kept per level, by the length lost.

    Whole levels are removed from the deepest on; on the others, all parents keep equally many
    children. The first way keeps all branches.
    """
    fewer: list[Sequence[int]] = []  # up to six numbers of children on each level, from all to one
    for count in (level.branches for level in design.levels):
        some = np.geomspace(1, count, 6).round().astype(int)
        fewer.append(np.unique(some)[::-1].tolist() if count > 6 else range(count, 0, -1))
    prunings = [
        pruning for depth in range(len(fewer), -1, -1) for pruning in product(*fewer[:depth])
    ]
    return sorted(
        prunings, key=lambda pruning: (pruning_cost(design, pruning), -len(pruning), pruning)
    )


def _scaled_mm(value_mm: float, factor: float) -> float:
    """Return a length times a factor, rounded; an unchanged one is not rounded."""
    return value_mm if factor == 1.0 else max(10.0**-_DECIMALS, round(value_mm * factor, _DECIMALS))


FIRST_STEPS = 20
"""Steps of single values and groups before CMA-ES has its turn."""


_FIRST_STEP, _LARGEST_STEP, _LEAST_STEP = 0.15, 0.4, 0.005
_SMALLEST = 7.0
"""Logarithm by which fillets shrink to the smallest that the limits allow, whatever they are."""


_POPULATION, _SPREAD, _SEED = 16, 0.3, 1
_RISE, _STUCK, _STALLED = 0.99, 60, 20
"""CMA-ES ends when nothing was better by one percent for so many generations: before it has met
the targets, and after."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FixedDesign:
    """A design that meets its targets."""

    design: Design
    cost: float  # weighted sum of its changes


def fix_design(
    design: Design,
    targets: FixTargets,
    keep: frozenset[str] = frozenset(),
) -> FixedDesign | None:
    """Return the cheapest change found in the first step that finds any, or None.

    Parameters
    ----------
    keep
        Words of `KEEPS`: what must not change.
    """
    for step in fix_stages(keep):
        if found := fix_in_step(design, targets, step):
            return min(found.values(), key=lambda one: one.cost)
    return None


def fix_in_step(
    design: Design,
    targets: FixTargets,
    step: Sequence[FixStage],
) -> dict[FixStage, FixedDesign]:
    """Return the cheapest change found that meets the targets in each stage that finds one.

    CMA-ES moves all values of a stage together where single steps find nothing in it, nor in any
    stage with less to change, but do with everything to change. Fewer branches take its place.
    """
    check_levels(design, "values of levels are changed")
    found: dict[FixStage, FixedDesign] = {}
    for stage in each("combinations of changes", step):
        most_cost = min((one.cost for one in found.values()), default=np.inf)
        one = fix_in_stage(design, targets, stage, most_cost if stage.prunes else np.inf)
        found |= {stage: one} if one else {}
    if any(stage.prunes for stage in step):
        return found
    lacks = [
        stage
        for stage in step
        if len(stage.groups) > 1 and not any(one.kinds <= stage.kinds for one in found)
    ]
    if not lacks or not (found or _has_change(design, targets, known=step)):
        return found
    for stage in each("combinations of changes, all values together", lacks):
        one = _evolved_in_stage(design, targets, stage)
        found |= {stage: one} if one else {}
    return found


def _has_change(design: Design, targets: FixTargets, known: Sequence[FixStage]) -> bool:
    """Return whether any change is found with every branch, some stages being known to fail."""
    step = [stage for stage in fix_stages(frozenset({BRANCHES}))[-1] if stage not in known]
    tried = each("combinations that were not asked for", step)
    if any(fix_in_stage(design, targets, stage) for stage in tried):
        return True
    return _evolved_in_stage(design, targets, FixStage(kinds=FIX_KINDS)) is not None


def fix_in_stage(
    design: Design, targets: FixTargets, stage: FixStage, most_cost: float = np.inf
) -> FixedDesign | None:
    """Return the cheapest change that steps of values find in one stage, or None.

    Parameters
    ----------
    most_cost
        Of a change that is worth looking for.
    """
    best: FixedDesign | None = None
    most_steps = 60
    for space in _spaces(design, targets, stage):
        if pruning_cost(design, space.branches) >= most_cost:
            continue
        # Nothing clears more than the smallest fillets do; of no values there is one vector alone.
        if stage.kinds <= FILLETS.kinds or not len(space):
            x = np.zeros(len(space))
            if space.penalty(x) > 0.0 and space.penalty(x := x - _SMALLEST) > 0.0:
                continue
        else:
            descended = _descended(space, most_steps if stage.prunes else FIRST_STEPS, most_cost)
            if descended is None:
                continue
            x = descended
        changed = _settled(space, x)
        if changed.cost < most_cost:
            best, most_cost = changed, changed.cost
    return best


def _evolved_in_stage(design: Design, targets: FixTargets, stage: FixStage) -> FixedDesign | None:
    """Return the cheapest change that CMA-ES finds in a stage that keeps every branch, or None."""
    (space,) = _spaces(design, targets, stage)
    x = _evolved(space)
    return None if x is None else _settled(space, x)


def _settled(space: FixSpace, x: Floats) -> FixedDesign:
    """Return the design at a vector without penalty, with its values moved back towards zero."""
    changed = space.at(_retracted(space, x))
    return FixedDesign(design=changed, cost=change_cost(space.design, changed))


def _spaces(design: Design, targets: FixTargets, stage: FixStage) -> list[FixSpace]:
    """Return the spaces that a stage searches, the most promising first: little lost or left."""
    whole = tuple(level.branches for level in design.levels)
    if not stage.prunes:
        return [FixSpace.of(design, whole, targets, stage.kinds)]
    fewer = [pruning for pruning in kept_branches(design) if pruning != whole]

    penalty_cost = 0.4  # estimated cost of clearing a unit of penalty, to rank the ways to prune

    def estimated_cost(pruning: tuple[int, ...]) -> float:
        space = FixSpace.of(design, pruning, targets)
        penalty = space.penalty(np.zeros(len(space)))
        return pruning_cost(design, pruning) + penalty_cost * penalty

    most_prunings = 12  # most ways to prune that are searched in full, the most promising first
    prunings = sorted(fewer, key=estimated_cost)[:most_prunings]
    return [FixSpace.of(design, pruning, targets, stage.kinds) for pruning in prunings]


def _descended(
    space: FixSpace, steps: int, most_cost: float, x: Floats | None = None
) -> Floats | None:
    """Return a vector without penalty, by steps that lower it most for their cost, or None.

    From a vector ``x`` on, its zeros stay as they are.
    """
    directions = space.directions()
    if x is None:
        x = np.zeros(len(space))
    else:
        directions = directions[~directions[:, x == 0.0].any(axis=1)]
    left, cost, step = space.penalty(x), space.cost(x), _FIRST_STEP
    for _ in range(steps):
        if left == 0.0:
            return x
        if cost >= most_cost or step < _LEAST_STEP:
            return None
        best, best_worth = None, 0.0
        for there, penalty, total in space.assessed(x + step * directions):
            if penalty >= left - 1e-4 * left:
                continue
            worth = (left - penalty) / (0.02 + max(0.0, total - cost))
            if worth > best_worth:
                best, best_worth = (there, penalty, total), worth
        if best is None:
            step /= 2.0
            continue
        x, left, cost = best
        step = min(_LARGEST_STEP, 1.3 * step)
    return x if left == 0.0 else None


def _evolved(space: FixSpace) -> Floats | None:
    """Return the cheapest vector without penalty that CMA-ES meets from zero on, or None.

    It ends when the worth of the best vector hardly rises any more.
    """
    large = 160  # branches of a design from which on fewer generations are tried
    most_generations = 150
    # Large designs take longer: they get fewer generations.
    most = max(1, min(most_generations, most_generations * large // space.design.branch_count))
    search = cmaes.CMA(
        mean=np.zeros(len(space)), sigma=_SPREAD, seed=_SEED, population_size=_POPULATION
    )
    best, best_cost, least, since = None, math.inf, math.inf, 0
    penalty_worth = 10.0  # cost that CMA-ES accepts to clear a unit of penalty
    for _ in range(most):
        told = []
        for x, penalty, cost in space.assessed([search.ask() for _ in range(_POPULATION)]):
            told.append((x, penalty_worth * penalty + cost))
            if penalty == 0.0 and cost < best_cost:
                best, best_cost = x, cost
        search.tell(told)
        now = min(value for _, value in told)
        since, least = (0, now) if now < _RISE * least else (since + 1, least)
        if since > (_STUCK if best is None else _STALLED):
            break
    return best


def _retracted(space: FixSpace, x: Floats) -> Floats:
    """Return a vector with its values moved back towards zero as far as no penalty arises.

    Either all shrink together first, or those that matter least are left out first. Then each is
    left out while the others go farther. The cheapest counts.
    """
    ways = (_without_needless(space, x), x)
    best = min((_moved_back(space, way) for way in ways), key=space.cost)
    # A single large change often costs less than that and a second one.
    for entry in np.flatnonzero(best):
        if not best[entry] or np.count_nonzero(best) == 1:
            continue
        without = np.where(np.arange(len(best)) == entry, 0.0, best)
        farther = _descended(space, FIRST_STEPS, space.cost(best), without)
        if farther is not None:
            best = min(best, _moved_back(space, farther), key=space.cost)
    return best


def _without_needless(space: FixSpace, x: Floats) -> Floats:
    """Return a vector without the entries that it can do without, the smallest first."""
    for entry in np.argsort(np.abs(x), kind="stable"):
        trial = np.where(np.arange(len(x)) == entry, 0.0, x)
        if x[entry] and space.penalty(trial) == 0.0:
            x = trial
    return x


def _moved_back(space: FixSpace, x: Floats) -> Floats:
    """Return a vector with all values shrunk together, then each as far as the targets allow."""
    x = _shrunk(space, x, np.ones(len(x), dtype=np.bool_))
    for _ in range(3):
        before = space.cost(x)
        for entry in np.argsort(-np.abs(x), kind="stable"):
            only = np.zeros(len(x), dtype=np.bool_)
            only[entry] = True
            x = _shrunk(space, x, only)
        if space.cost(x) > 0.99 * before:
            break
    return x


def _shrunk(space: FixSpace, x: Floats, which: NDArray[np.bool_]) -> Floats:
    """Return a vector with some entries as near to zero as bisection finds without penalty."""
    low, high, good = 0.0, 1.0, x
    if not np.any(x[which]):
        return x
    backward = 12
    for turn in range(backward):
        share = low if turn == 0 else (low + high) / 2.0
        trial = np.where(which, share * x, x)
        if space.penalty(trial) == 0.0:
            good, high = trial, share
            if turn == 0:
                return good
        else:
            low = share
    return good
