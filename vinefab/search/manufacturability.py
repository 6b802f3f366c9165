"""Manufacturability in a search: penalty, full check, and refusal of infeasible spaces.

A space is refused only where every design in it violates a rule: each rule is checked at the most
favourable corner of the space. What depends on several variables at once is left to the search.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from vinefab.core.errors import BadInputError, values_hidden
from vinefab.fabrication.checking import check_design, subject_of
from vinefab.fabrication.job.passes import bare_sheet_mm
from vinefab.fabrication.outline.body_outline import flat_layout
from vinefab.fabrication.rules.catalog import by_rule, changed_limits, run_checks
from vinefab.fabrication.rules.clearance_rules import ANGLE, CROTCH, POUCH
from vinefab.fabrication.rules.laser_rules import BED, PLY
from vinefab.fabrication.rules.pressure_rules import (
    BURST,
    RATING,
    WINDOW,
    GrowthConstantsRange,
    most_growth_kpa,
)
from vinefab.fabrication.rules.rule import ROUNDING, LimitChanges, Rule
from vinefab.fabrication.rules.spacing import capsules_of, excess_mm
from vinefab.fabrication.rules.tree_rules import (
    CLAMP,
    LEAST_WIDTH,
    PACKING,
    TAIL,
    WIDTH_RATIO,
    occupancies,
)
from vinefab.inflation.pattern import pattern_of
from vinefab.model.design import MOST_BRANCHES, Design
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.finding import Finding
from vinefab.model.laser import LaserProfile, read_profile
from vinefab.model.tree import branch_tree
from vinefab.physics.growth_pressure import planned_growth_kpa
from vinefab.search.penalty_batch import BatchPenalty, PenaltyRules
from vinefab.search.settings import EvaluationSettings, RunSettings
from vinefab.search.space import Bounds, Space

MOST_TABLED = 400
"""Branches of the largest designs that are checked in full while a search runs."""

_VINE_MM = 200.0
"""Length of the vine for rules that do not depend on length."""


def run_profile(evaluation: EvaluationSettings) -> LaserProfile:
    """Return the recipe that the designs of a run are checked with."""
    with values_hidden():
        return read_profile(evaluation.recipe or DEFAULT_RECIPE)


@dataclass(frozen=True, slots=True, kw_only=True)
class ManufacturabilityPenalty:
    """How far designs are from manufacturable with a recipe."""

    profile: LaserProfile  # the recipe with its machine and material

    def __call__(self, design: Design) -> float:
        """Return the penalty of the cheap rules, under the recipe's limits: a batch of one.

        Rules about the sheet see the pattern of a compensated design, by `quick_pattern`.
        The flat robot must fit the recipe's bed with room for seam, kerf and the mouth's overcut,
        and grow along its planned paths at a pressure that its seams withstand.
        """
        return float(self._rules(design).penalties([design])[0])

    def pieces(self, design: Design) -> int | None:
        """Return in how many pieces the cheap rules cut a design; None where some conflict stays.

        None also for designs that must be one piece, or are too large to look for cuts.
        """
        found = self._rules(design).found([design])
        return None if found.left > 0.0 else 1 + int(found.joints[0])

    def _rules(self, design: Design) -> PenaltyRules:
        changed = by_rule(changed_limits(design, self.profile))
        return PenaltyRules.of(design.build, self.profile, changed, self.sheet_mm)

    def within(self, space: Space) -> BatchPenalty:
        """Return the same penalty for batches of a space's designs."""
        vine = Design(name="vine", trunk_length_mm=_VINE_MM, build=space.build_of(1))
        return self._rules(vine).of_space(space)

    @property
    def sheet_mm(self) -> tuple[float, float]:
        """Width and height that a flat robot must fit into."""
        return bare_sheet_mm(self.profile)

    def passes(self, design: Design) -> bool:
        """Return whether the full check passes, laser paths included."""
        return not check_design(design, self.profile).blocking

    def broken(self, design: Design) -> tuple[Finding, ...] | None:
        """Return the findings that forbid a design by the full check, with the shipped joints.

        Nothing is simulated, so that it takes some hundredths of a second. None for designs with a
        joint that the table does not have, and for very large ones.
        """
        pattern = pattern_of(design, self.profile, known_only=True)
        known = all(one.found and one.found.source == "table" for one in pattern.joints)
        if not known or design.branch_count > MOST_TABLED:
            return None
        return run_checks(subject_of(design, self.profile, pattern=pattern)).blocking

    def violations(self, design: Design) -> str:
        """Return the rules that block a design, with the message of the first; empty if none.

        The full check decides: a design with a penalty may still pass it, cut in tiles.
        """
        blocking = check_design(design, self.profile).blocking
        rules = ", ".join(dict.fromkeys(finding.rule for finding in blocking))
        return f"{rules} ({blocking[0].message})" if blocking else ""


_OTHERWISE = "or evaluation.fabricable = false"


@dataclass(frozen=True, slots=True, kw_only=True)
class SpaceQuery:
    """The settings of a run, and the limits for its designs."""

    settings: RunSettings
    profile: LaserProfile  # the recipe
    changed: LimitChanges  # limits that the recipe changes
    sheet_mm: tuple[float, float]  # width and height that a flat robot must fit into

    @classmethod
    def of(
        cls, settings: RunSettings, profile: LaserProfile, sheet_mm: tuple[float, float]
    ) -> "SpaceQuery":
        """Return the query for a run and its recipe."""
        vine = Design(name="vine", trunk_length_mm=_VINE_MM, build=settings.build.build(1))
        changed = by_rule(changed_limits(vine, profile))
        return cls(settings=settings, profile=profile, changed=changed, sheet_mm=sheet_mm)

    def limit(self, rule: Rule, name: str = "error") -> float:
        """Return a rule's limit."""
        return rule.limits_with(self.changed.get(rule.id, {}))[name]

    def bounds(self, level: int, name: str) -> tuple[str, Bounds]:
        """Return the key and the range of a level's variable."""
        space = self.settings.space
        own = name in space.by_level.get(level, {})
        return f"space.level {level}.{name}" if own else f"space.{name}", space.bounds(level, name)

    @property
    def fewest(self) -> int:
        """Smallest number of levels."""
        return int(self.settings.space.levels.low)

    @property
    def film_mm(self) -> float:
        """Thickness of all plies."""
        return self.profile.material.plies * self.profile.material.ply_mm.value


def refuse_infeasible_space(query: SpaceQuery) -> None:
    """Raise `BadInputError` for a space in which every design violates some rule."""
    for check in (_build, _widths, _pouch, _angles, _crotches, _bed, _least):
        for violation in check(query):
            raise violation


def _no(rule: Rule, key: str, value: object, allowed: str) -> BadInputError:
    return BadInputError(key, value, f"{allowed} ({rule.id}), {_OTHERWISE}")


def _ends(bounds: Bounds) -> list[float]:
    return [bounds.low, bounds.high]


def _build(query: SpaceQuery) -> Iterator[BadInputError]:
    """Yield violations by trunk, tail, pressure and film, which are the same for all designs."""
    build = query.settings.build
    checked = (
        (PLY, "evaluation.recipe", query.profile.recipe.name, ""),
        (TAIL, "build.tail_mm", build.tail_mm, "at least {:g} mm"),
        (CLAMP, build.widths_key, build.widths_value, "at most {:g} mm, for the clamp"),
        (RATING, "build.pressure_kpa", build.pressure_kpa, ""),
        (BURST, "build.pressure_kpa", build.pressure_kpa, ""),
    )
    vine = Design(name="vine", trunk_length_mm=_VINE_MM, build=build.build(1))
    report = run_checks(subject_of(vine, query.profile), only={rule.id for rule, *_ in checked})
    for rule, key, value, words in checked:
        for finding in report.blocking:
            if finding.rule == rule.id:
                yield _no(rule, key, value, words.format(finding.limit) or finding.message)


def _widths(query: SpaceQuery) -> Iterator[BadInputError]:
    """Yield violations by levels that are too narrow, or too wide for their parents."""
    build, fewest = query.settings.build, query.fewest
    least_mm, ratio = query.limit(LEAST_WIDTH), query.limit(WIDTH_RATIO)
    key, value, given = build.widths_key, build.widths_value, max(1, len(build.widths_mm))
    for level, width_mm in enumerate(build.build(fewest).widths_mm, start=1):
        if width_mm < least_mm * (1.0 - ROUNDING):
            narrowed = max(0, level - given)
            wide_mm = math.ceil(10.0 * least_mm / build.width_ratio**narrowed) / 10.0
            why = f", as width_ratio narrows it to level {level}" if narrowed else ""
            where = f" on level {min(level, given)}" if build.widths_mm else ""
            yield _no(LEAST_WIDTH, key, value, f"at least {wide_mm:g} mm{where}{why}")
    pairs = pairwise(build.build(fewest).widths_mm)
    for level, (wide, narrow) in enumerate(pairs, start=2):
        if wide / narrow >= ratio * (1.0 - ROUNDING):
            continue
        if level <= given:
            allowed = f"on level {level} at most {wide / ratio:g} mm: parents must be wider"
            yield _no(WIDTH_RATIO, key, value, allowed)
        most = math.floor(1000.0 / ratio) / 1000.0
        allowed = f"at most {most:g}: parents must be wider than children"
        yield _no(WIDTH_RATIO, "build.width_ratio", build.width_ratio, allowed)


def _pouch(query: SpaceQuery) -> Iterator[BadInputError]:
    """Yield violations by the pouch on the narrowest leaves, those of designs with most levels."""
    pouch, most = query.settings.build.pouch, int(query.settings.space.levels.high)
    if pouch is None:
        return
    build = query.settings.build
    leaf_mm = build.build(most).widths_mm[-1]
    least_mm = max(leaf_mm, query.limit(LEAST_WIDTH))
    if pouch.length_mm is not None and pouch.length_mm < least_mm * (1.0 - ROUNDING):
        yield _no(POUCH, "build.pouch.length_mm", pouch.length_mm, f"at least {least_mm:g} mm")
    if pouch.flat_width_mm <= leaf_mm:
        words = f"{pouch.flat_width_mm:g} mm wide"
        yield _no(POUCH, "build.pouch", words, f"wider than the narrowest leaf, {leaf_mm:g} mm")
    alone = build.changed(widths_mm=(leaf_mm,)).build(1)
    vine = Design(name="vine", trunk_length_mm=_VINE_MM, build=alone)
    full = 100.0 * max(
        occupancies(vine, query.film_mm, query.limit(PACKING, "packing")), default=0.0
    )
    if full > query.limit(PACKING) * (1.0 + ROUNDING):
        words = f"{pouch.flat_width_mm:g} mm wide"
        allowed = f"narrower, or wider leaves: its film would fill {full:.0f} % of the narrowest"
        yield _no(PACKING, "build.pouch", words, allowed)


def _angles(query: SpaceQuery) -> Iterator[BadInputError]:
    """Yield violations by children that are almost parallel, or folded onto their parent."""
    least_deg = query.limit(ANGLE)
    for level in range(2, query.fewest + 1):
        name, branches = query.bounds(level, "branches")
        key, fan = query.bounds(level, "angle_deg")
        widest = 2.0 * (180.0 - least_deg)
        most = math.floor(min(fan.high, widest) / least_deg + 1e-9) + 1
        if branches.low == 1 or (branches.low <= most and fan.low <= widest + 1e-6):
            continue
        if fan.low > widest + 1e-6 or most < 2:
            allowed = f"some fan from {least_deg:g} to {widest:g} deg"
            yield _no(ANGLE, key, _ends(fan), allowed)
        allowed = f"{most} children or fewer, {least_deg:g} deg apart in {key}"
        yield _no(ANGLE, name, _ends(branches), allowed)


def _crotches(query: SpaceQuery) -> Iterator[BadInputError]:
    """Yield violations by children that end within the joint."""
    widths_mm = query.settings.build.build(query.fewest).widths_mm
    share = query.limit(CROTCH)
    for level in range(2, query.fewest + 1):
        key, length = query.bounds(level, "length_mm")
        least_mm = widths_mm[level - 2] / 2.0 / share
        if length.high < least_mm * (1.0 - ROUNDING):
            allowed = f"lengths from {least_mm:g} mm: at least the width of the parent"
            yield _no(CROTCH, key, _ends(length), allowed)


def _bed(query: SpaceQuery) -> Iterator[BadInputError]:
    """Yield violations by a tail that does not fit the bed with the shortest trunk."""
    build = query.settings.build.changed(pouch=None).build(1)
    key, length = query.bounds(1, "length_mm")
    vine = Design(name="vine", trunk_length_mm=length.low, build=build)
    if excess_mm(capsules_of(flat_layout(vine), build), query.sheet_mm) > 0.0:
        wide_mm, high_mm = query.sheet_mm
        allowed = f"a trunk that fits {wide_mm:g} x {high_mm:g} mm with its tail"
        if build.tail_mm > length.low:
            yield _no(BED, "build.tail_mm", build.tail_mm, allowed)
        yield _no(BED, key, _ends(length), allowed)


def film_in_trunk(query: SpaceQuery, design: Design) -> tuple[float, float]:
    """Return the share of a lumen that folded film fills, percent, and the trunk that holds it, mm.

    Wider by a factor, every level holds so many times as much.
    """
    shares = occupancies(design, query.film_mm, query.limit(PACKING, "packing"))
    full = 100.0 * max(shares[: len(design.levels)], default=0.0)
    return full, design.build.widths_mm[0] * full / query.limit(PACKING)


def _grows(query: SpaceQuery, design: Design) -> bool:
    """Return whether growth to the worst tip takes no more than the seams stand, by VF-P03.

    A search keeps to limits that are only assumed, too: there the rule finds a warning.
    """
    limits = WINDOW.limits_with(query.changed.get(WINDOW.id, {}))
    fit = GrowthConstantsRange.of(query.profile, limits)
    takes_kpa = planned_growth_kpa(
        branch_tree(design), design.build.widths_mm, fit.loose, fit.diameter_mm
    )
    return float(takes_kpa.max()) <= most_growth_kpa(design.build, query.profile, limits)


def _least(query: SpaceQuery) -> Iterator[BadInputError]:
    """Yield violations by the smallest design: film packing and pressure for growth."""
    settings = query.settings
    space = Space(settings.space, settings.build)
    corner = np.zeros(len(space))
    if int(space.batch(corner[None]).sizes[0]) > MOST_BRANCHES:
        return  # refused elsewhere, with another message
    design = space.design(corner)
    full, _ = film_in_trunk(query, design)
    if full > (most := query.limit(PACKING)) * (1.0 + ROUNDING):
        branches = [level.branches for level in design.levels]
        wide_mm = [math.ceil(10.0 * mm * full / most) / 10.0 for mm in design.build.widths_mm]
        values = wide_mm[: len(settings.build.widths_mm)] or wide_mm[0]
        allowed = (
            f"fewer, or {settings.build.widths_key} = {values}: their film would fill {full:.0f} % "
            "of the trunk"
        )
        yield _no(PACKING, "space.branches", f"at least {branches} by level", allowed)
    if not _grows(query, design):
        pressed = design.changed(build=design.build.changed(pressure_kpa=10_000.0))
        if _grows(query, pressed):
            allowed = "more: no leaf of the space grows to its tip with it"
            yield _no(WINDOW, "build.pressure_kpa", design.build.pressure_kpa, allowed)
            return
        allowed = (
            "another trunk or ratio: growth through the leaves needs the trunk's burst pressure"
        )
        build, key = settings.build, "build.width_ratio"
        given = (
            (build.widths_key, build.widths_value) if build.widths_mm else (key, build.width_ratio)
        )
        yield _no(WINDOW, *given, allowed)
