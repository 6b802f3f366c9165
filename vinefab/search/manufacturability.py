"""Manufacturability in a search: penalty, full check, refused spaces and starts, and advice.

Before: a space is refused only where every design in it violates a rule. Each rule is checked at
the most favourable corner of the space; the search finds the rest. Starts that no trunk can leave
are refused. Rules about trunk and targets give notes only: a robot with fewer branches, or one that
misses a target, may serve.

Meanwhile: the penalty knows the rules that thousands of designs a second can be asked for. The few
that would be the best so far are asked for all rules before the optimizer learns of them, with
joints from the table: a design that fails is never the best. Where none passes, single changes of
the settings are tried.
"""

import math
import time
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import shapely

from vinefab.core.errors import BadInputError, UnfitInputError, values_hidden
from vinefab.core.plain_text import counted
from vinefab.core.rng import child
from vinefab.core.validation import Floats
from vinefab.fabrication.checking import check_design, subject_of
from vinefab.fabrication.job.passes import bare_sheet_mm
from vinefab.fabrication.rules.catalog import by_rule, changed_limits, run_checks
from vinefab.fabrication.rules.clearance_rules import check_angle, check_crotch, check_pouch
from vinefab.fabrication.rules.laser_rules import check_bed, check_ply
from vinefab.fabrication.rules.pressure_rules import (
    GrowthConstantsRange,
    check_burst,
    check_rating,
    check_strain,
    check_window,
    most_growth_kpa,
)
from vinefab.fabrication.rules.rule import ROUNDING, LimitChanges, Rule
from vinefab.fabrication.rules.spacing import RotatedSpan, capsules_of, excess_mm
from vinefab.fabrication.rules.tree_rules import (
    check_clamp,
    check_least_width,
    check_packing,
    check_tail,
    check_width_ratio,
    occupancies,
)
from vinefab.growth.batch import grow_on
from vinefab.inflation.pattern import pattern_of
from vinefab.model.design import DEFAULT_TRUNK_WIDTH_MM, MOST_BRANCHES, Design, Level, PieceSettings
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.finding import Finding
from vinefab.model.laser import LaserProfile, profile_files, read_profile
from vinefab.model.map import Pose
from vinefab.outline.body_outline import flat_layout
from vinefab.physics.growth_pressure import planned_growth_kpa
from vinefab.physics.tube import burst_pressure_kpa, hoop_strain, seam_load_n_mm
from vinefab.search.evaluator import Evaluator
from vinefab.search.penalty_batch import BatchPenalty, PenaltyRules
from vinefab.search.record.generations import Finalist, Generation, SearchProgress
from vinefab.search.settings import EvaluationSettings, RunSettings
from vinefab.search.space import Bounds, DesignSpace, Space
from vinefab.tasks.evaluate import Conditions, PreparedMap
from vinefab.tasks.reach import task_targets

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

    def within(self, space: DesignSpace) -> BatchPenalty:
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

        Nothing is simulated, so that it takes some hundredths of a second: joints are those of the
        table and the law. None for designs with a joint that neither has, and for very large ones.
        """
        pattern = pattern_of(design, self.profile, known_only=True)
        shipped = "table", "law"
        known = all(one.found and one.found.source in shipped for one in pattern.joints)
        # Branches of the largest designs that are checked in full while a search runs.
        most_tabled = 400
        if not known or design.branch_count > most_tabled:
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
        return rule.limits_under(self.changed)[name]

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


def _unfit(rule: Rule, key: str, problem: str, remedy: str) -> UnfitInputError:
    return UnfitInputError(key, f"{problem} ({rule.id})", f"{remedy}, {_OTHERWISE}")


def _no(rule: Rule, key: str, value: object, allowed: str) -> BadInputError:
    return BadInputError(key, value, f"{allowed} ({rule.id}), {_OTHERWISE}")


def _ends(bounds: Bounds) -> list[float]:
    return [bounds.low, bounds.high]


def _build(query: SpaceQuery) -> Iterator[BadInputError]:
    """Yield violations by trunk, tail, pressure and film, which are the same for all designs."""
    build = query.settings.build
    checked = (
        (check_ply, "evaluation.recipe", query.profile.recipe.name, ""),
        (check_tail, "build.tail_mm", build.tail_mm, "at least {:g} mm"),
        (check_clamp, build.widths_key, build.widths_value, "at most {:g} mm, for the clamp"),
        (check_rating, "build.pressure_kpa", build.pressure_kpa, ""),
        (check_burst, "build.pressure_kpa", build.pressure_kpa, ""),
    )
    vine = Design(name="vine", trunk_length_mm=_VINE_MM, build=build.build(1))
    report = run_checks(subject_of(vine, query.profile), only={rule.id for rule, *_ in checked})
    for rule, key, value, words in checked:
        for finding in report.blocking:
            if finding.rule == rule.id:
                problem, _, remedy = finding.message.rpartition(": ")
                yield (
                    _no(rule, key, value, words.format(finding.limit))
                    if words
                    else _unfit(rule, key, problem, remedy)
                )


def _widths(query: SpaceQuery) -> Iterator[BadInputError]:
    """Yield violations by levels that are too narrow, or too wide for their parents."""
    build, fewest = query.settings.build, query.fewest
    least_mm, ratio = query.limit(check_least_width), query.limit(check_width_ratio)
    key, value, given = build.widths_key, build.widths_value, max(1, len(build.widths_mm))
    for level, width_mm in enumerate(build.build(fewest).widths_mm, start=1):
        if width_mm < least_mm * (1.0 - ROUNDING):
            narrowed = max(0, level - given)
            wide_mm = math.ceil(10.0 * least_mm / build.width_ratio**narrowed) / 10.0
            why = f", as width_ratio narrows it to level {level}" if narrowed else ""
            where = f" on level {min(level, given)}" if build.widths_mm else ""
            yield _no(check_least_width, key, value, f"at least {wide_mm:g} mm{where}{why}")
    pairs = pairwise(build.build(fewest).widths_mm)
    for level, (wide, narrow) in enumerate(pairs, start=2):
        if wide / narrow >= ratio * (1.0 - ROUNDING):
            continue
        if level <= given:
            allowed = f"on level {level} at most {wide / ratio:g} mm: parents must be wider"
            yield _no(check_width_ratio, key, value, allowed)
        most = math.floor(1000.0 / ratio) / 1000.0
        allowed = f"at most {most:g}: parents must be wider than children"
        yield _no(check_width_ratio, "build.width_ratio", build.width_ratio, allowed)


def _pouch(query: SpaceQuery) -> Iterator[BadInputError]:
    """Yield violations by the pouch on the narrowest leaves, those of designs with most levels."""
    pouch, most = query.settings.build.pouch, int(query.settings.space.levels.high)
    if pouch is None:
        return
    build = query.settings.build
    leaf_mm = build.build(most).widths_mm[-1]
    least_mm = max(leaf_mm, query.limit(check_least_width))
    if pouch.length_mm is not None and pouch.length_mm < least_mm * (1.0 - ROUNDING):
        yield _no(
            check_pouch, "build.pouch.length_mm", pouch.length_mm, f"at least {least_mm:g} mm"
        )
    if pouch.flat_width_mm <= leaf_mm:
        problem = f"{pouch.flat_width_mm:g} mm are no wider than the narrowest leaf, {leaf_mm:g} mm"
        yield _unfit(check_pouch, "build.pouch", problem, "widen the pouch")
    alone = build.changed(widths_mm=(leaf_mm,)).build(1)
    vine = Design(name="vine", trunk_length_mm=_VINE_MM, build=alone)
    full = 100.0 * float(
        occupancies(vine, query.film_mm, query.limit(check_packing, "packing")).max()
    )
    if full > query.limit(check_packing) * (1.0 + ROUNDING):
        problem = f"its film would fill {full:.0f} % of the narrowest leaf"
        yield _unfit(check_packing, "build.pouch", problem, "narrow the pouch, widen the leaves")


def _angles(query: SpaceQuery) -> Iterator[BadInputError]:
    """Yield violations by children that are almost parallel, or folded onto their parent."""
    least_deg = query.limit(check_angle)
    for level in range(2, query.fewest + 1):
        name, branches = query.bounds(level, "branches")
        key, fan = query.bounds(level, "angle_deg")
        widest = 2.0 * (180.0 - least_deg)
        most = math.floor(min(fan.high, widest) / least_deg + 1e-9) + 1
        if branches.low == 1 or (branches.low <= most and fan.low <= widest + 1e-6):
            continue
        if fan.low > widest + 1e-6 or most < 2:
            allowed = f"some fan from {least_deg:g} to {widest:g} deg"
            yield _no(check_angle, key, _ends(fan), allowed)
        allowed = f"{most} children or fewer, {least_deg:g} deg apart in {key}"
        yield _no(check_angle, name, _ends(branches), allowed)


def _crotches(query: SpaceQuery) -> Iterator[BadInputError]:
    """Yield violations by children that end within the joint."""
    widths_mm = query.settings.build.build(query.fewest).widths_mm
    share = query.limit(check_crotch)
    for level in range(2, query.fewest + 1):
        key, length = query.bounds(level, "length_mm")
        least_mm = widths_mm[level - 2] / 2.0 / share
        if length.high < least_mm * (1.0 - ROUNDING):
            allowed = f"lengths from {least_mm:g} mm: at least the width of the parent"
            yield _no(check_crotch, key, _ends(length), allowed)


def _bed(query: SpaceQuery) -> Iterator[BadInputError]:
    """Yield violations by a tail that does not fit the bed with the shortest trunk."""
    build = query.settings.build.changed(pouch=None).build(1)
    key, length = query.bounds(1, "length_mm")
    vine = Design(name="vine", trunk_length_mm=length.low, build=build)
    if excess_mm(capsules_of(flat_layout(vine), build), query.sheet_mm) > 0.0:
        wide_mm, high_mm = query.sheet_mm
        problem = f"the shortest trunk and its tail do not fit {wide_mm:g} x {high_mm:g} mm"
        if build.tail_mm > length.low:
            yield _unfit(check_bed, "build.tail_mm", problem, "shorten the tail")
        yield _unfit(check_bed, key, problem, "allow shorter trunks")


def film_in_trunk(query: SpaceQuery, design: Design) -> tuple[float, float]:
    """Return the share of a lumen that folded film fills, percent, and the trunk that holds it, mm.

    Wider by a factor, every level holds so many times as much.
    """
    shares = occupancies(design, query.film_mm, query.limit(check_packing, "packing"))
    full = 100.0 * float(shares[~design.tree.is_leaf].max(initial=0.0))
    return full, design.build.widths_mm[0] * full / query.limit(check_packing)


def _grows(query: SpaceQuery, design: Design) -> bool:
    """Return whether growth to the worst tip takes no more than the seams stand, by VF-P03.

    A search keeps to limits that are only assumed, too: there the rule finds a warning.
    """
    limits = check_window.limits_under(query.changed)
    fit = GrowthConstantsRange.of(query.profile, limits)
    takes_kpa = planned_growth_kpa(design.tree, fit.loose, fit.diameter_mm)
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
    if full > (most := query.limit(check_packing)) * (1.0 + ROUNDING):
        branches = [level.branches for level in design.levels]
        wide_mm = [math.ceil(10.0 * mm * full / most) / 10.0 for mm in design.build.widths_mm]
        values = wide_mm[: len(settings.build.widths_mm)] or wide_mm[0]
        problem = f"the film of {branches} branches by level would fill {full:.0f} % of the trunk"
        remedy = f"allow fewer, or set {settings.build.widths_key} = {values}"
        yield _unfit(check_packing, "space.branches", problem, remedy)
    if not _grows(query, design):
        pressed = design.changed(build=design.build.changed(pressure_kpa=10_000.0))
        if _grows(query, pressed):
            problem = f"no leaf of the space grows to its tip at {design.build.pressure_kpa:g} kPa"
            yield _unfit(check_window, "build.pressure_kpa", problem, "raise it")
            return
        build = settings.build
        key = build.widths_key if build.widths_mm else "build.width_ratio"
        problem = "growth through the leaves needs more pressure than the trunk stands"
        yield _unfit(check_window, key, problem, "narrow the trunk, or widen the leaves")


_WIDTHS = {"trunk_width_mm", "widths_mm"}


def middle_tree(query: SpaceQuery) -> Design | None:
    """Return a design of middle depth, with the middle number of branches on each level."""
    settings = query.settings
    depth = int(settings.space.levels.low + settings.space.levels.high) // 2
    below = [query.bounds(level, "branches")[1] for level in range(2, depth + 1)]
    branches = [math.ceil((bounds.low + bounds.high) / 2.0) for bounds in below]
    # Children of a fan above which nothing is said of the film that rides in a trunk.
    most_branched = 20
    if max(branches, default=0) > most_branched:
        return None
    levels = tuple(Level.of(branches=count, length_mm=100.0, angle_deg=90.0) for count in branches)
    build = settings.build.build(depth)
    return Design(name="middle", trunk_length_mm=100.0, levels=levels, build=build)


def with_build_for_film(settings: RunSettings) -> RunSettings:
    """Return the settings of a run; its film decides on trunk width and pressure it does not name.

    The width is the usual one, or the narrowest that the film of the middle tree of the space rides
    through. The pressure is the most that the widest part may take, the top of its window.
    """
    if not settings.evaluation.fabricable:
        return settings
    # A name that is unknown is told; what stands in its files is not.
    profile_files(settings.evaluation.recipe or DEFAULT_RECIPE)
    given = settings.build.model_fields_set
    settings = settings if _WIDTHS & given else _with_trunk(settings)
    return settings if "pressure_kpa" in given else _with_pressure(settings)


def _with_trunk(settings: RunSettings) -> RunSettings:
    """Return the settings with a trunk that the film of the middle tree rides through."""
    query = SpaceQuery.of(settings, run_profile(settings.evaluation), (math.inf, math.inf))
    tree = middle_tree(query)
    wide_mm = DEFAULT_TRUNK_WIDTH_MM
    if tree is not None and tree.levels:
        holds_mm = math.ceil(film_in_trunk(query, tree)[1])
        wide_mm = max(wide_mm, min(float(holds_mm), query.limit(check_clamp)))
    return settings.changed(build=settings.build.changed(trunk_width_mm=wide_mm))


def _with_pressure(settings: RunSettings) -> RunSettings:
    """Return the settings with the pressure that the widest part may take, to 0.1 kPa below it.

    It is at most that of the seam's test, and at most one that stretches the film no more than
    VF-P04 allows.
    """
    query = SpaceQuery.of(settings, run_profile(settings.evaluation), (math.inf, math.inf))
    film, width_mm = query.profile.material, settings.build.build(1).widest_mm
    strain_of_1_kpa = hoop_strain(1.0, width_mm, film.ply_mm.value, film.modulus_mpa.value)
    most_kpa = min(
        burst_pressure_kpa(width_mm, seam_load_n_mm(film.seam))
        / query.limit(check_burst, "safety_factor"),
        film.seam.pressure_kpa.value,
        query.limit(check_strain, "warning") / 100.0 / strain_of_1_kpa,
    )
    kpa = max(0.1, math.floor(10.0 * most_kpa) / 10.0)
    return settings.changed(build=settings.build.changed(pressure_kpa=kpa))


def said_before(evaluator: Evaluator) -> str:
    """Return the notes for a user on a run's trunk and targets; empty if none."""
    penalty, settings = evaluator.penalty, evaluator.spec.settings
    if not isinstance(penalty, ManufacturabilityPenalty):
        return ""
    query, build = SpaceQuery.of(settings, penalty.profile, penalty.sheet_mm), settings.build
    tree, said = middle_tree(query), list[str]()
    if tree is not None and tree.levels:  # whether film fills the trunk, or widens it
        percent, holds_mm = film_in_trunk(query, tree)
        shape = " x ".join(str(level.branches) for level in tree.levels)
        ply_mm = query.profile.material.ply_mm.value
        what = f"{counted(tree.depth, 'level')} (branches {shape}) of {ply_mm:g} mm film"
        wide_mm, most = build.build(1).widths_mm[0], query.limit(check_packing)
        if percent > most:
            said.append(
                f"a trunk of {wide_mm:g} mm is narrow for this film: {what} fill {percent:.0f} % "
                f"of a lumen, and {most:g} % is allowed ({check_packing.id}); one of "
                f"{math.ceil(holds_mm):g} mm holds them ({build.widths_key})"
            )
        elif wide_mm > DEFAULT_TRUNK_WIDTH_MM and wide_mm == math.ceil(holds_mm):
            said.append(
                f"trunk {wide_mm:g} mm: the narrowest that {what} ride through ({check_packing.id})"
            )
    sheet_mm, excess_mm = query.sheet_mm, max(_excesses_mm(evaluator, query), default=0.0)
    # Excess over the sheet from which on it is named: fans are cut at other angles than deployed.
    least_excess_mm = 20.0
    if (build.pieces is None or build.pieces.most == 1) and excess_mm > least_excess_mm:
        said.append(
            f"one flat outline that touches all targets is about {excess_mm:.0f} mm too large "
            f"for the sheet of {sheet_mm[0]:.0f} x {sheet_mm[1]:.0f} mm ({check_bed.id}), its tail "
            f"of {build.tail_mm:g} mm included, unless walls bend it: allow pieces "
            "([build.pieces] most = 6)"
        )
    return "; ".join(said)


def _excesses_mm(evaluator: Evaluator, query: SpaceQuery) -> Iterator[float]:
    """Yield by how much mouth, base and targets exceed the sheet, on maps with targets at points.

    Of several starts the best counts. Tolerances and ranges of starts make robots smaller.
    """
    tail_mm = query.settings.build.tail_mm
    for prepared in evaluator.maps:
        found = []
        targets = task_targets(evaluator.spec.tasks[0], prepared.world)
        points = [target for target in targets if target.point_mm is not None]
        for start in prepared.world.starts:
            pose = start.pose
            heading = np.array([math.cos(pose.heading_rad), math.sin(pose.heading_rad)])
            base = np.array([pose.x_mm, pose.y_mm])
            slack_mm = math.hypot(start.spread_x_mm, start.spread_y_mm)
            slack_mm += tail_mm * start.spread_heading_rad
            span = RotatedSpan()
            span.add(np.stack([base - tail_mm * heading, base]), np.zeros(2))
            for target in points:
                away_mm = np.array([target.tolerance_mm + slack_mm])
                span.add(np.array([target.point_mm]), -away_mm)
            found.append(span.excess_mm(query.sheet_mm) if start.area is None else 0.0)
        if points and found:
            yield min(found)


def refuse_starts_without_room(evaluator: Evaluator, conditions: Conditions) -> None:
    """Raise `BadInputError` where no robot of a run can leave the starts of its maps.

    The run's own start needs room for the trunk on every map; of the maps' own starts one must have
    it. From one of all poses, those of the first generation among them, the shortest trunk must
    grow by its own width.
    """
    given = evaluator.spec.settings.maps.start is not None
    starts = [(one, one.world.starts[0].pose) for one in evaluator.maps] if given else []
    radius_mm = evaluator.space.radii_mm(evaluator.growth)[0]
    for prepared, pose in starts:
        if radius_mm > 0.0 and not _has_room(prepared, pose, radius_mm):
            raise _narrow(evaluator, prepared, pose, "maps.start")
    poses = [
        (prepared, pose)
        for prepared, places in zip(evaluator.maps, conditions.poses, strict=True)
        for pose in (*(start.pose for start in prepared.world.starts), *places)
    ]
    roomy = [pair for pair in poses if radius_mm == 0.0 or _has_room(*pair, radius_mm)]
    if poses and not roomy:
        prepared, pose = max(poses, key=lambda pair: _away_mm(*pair))
        raise _narrow(evaluator, prepared, pose, f"start of map {prepared.world.name!r}")
    growth, space, grown_mm = evaluator.growth.at_one_angle, evaluator.space, 0.0
    length_mm, build = space.design(np.zeros(len(space))).trunk_length_mm, space.build_of(1)
    trunk = Design(name="trunk", trunk_length_mm=length_mm, build=build)
    most_trials = 40  # most poses that a trunk is grown from
    for prepared, pose in roomy[:most_trials]:
        grown = float(grow_on(trunk, prepared.terrain, pose, growth).grown_mm.sum())
        leaves = grown >= min(length_mm - 1.0, build.widths_mm[0])
        if growth.children_of_stuck == "deploy" or leaves:
            return
        if grown >= grown_mm:
            grown_mm, stuck = grown, (prepared, pose)
    if roomy:
        prepared, pose = stuck
        key = "maps.start" if given else f"start of map {prepared.world.name!r}"
        where = f"({pose.x_mm:g}, {pose.y_mm:g}), heading {np.degrees(pose.heading_rad):.0f} deg"
        problem = (
            f"from {where} the trunk stops after {grown_mm:.0f} mm (simulated), less than its own "
            "width"
        )
        raise UnfitInputError(key, problem, "turn or move the start")


def _has_room(prepared: PreparedMap, pose: Pose, radius_mm: float) -> bool:
    terrain = prepared.terrain
    return bool(terrain.have_room(terrain.starts_mm([pose]), radius_mm).all())


def _away_mm(prepared: PreparedMap, pose: Pose) -> float:
    """Return the distance of a start from the nearest wall."""
    walls = shapely.boundary(prepared.terrain.free_space())
    return float(shapely.distance(walls, shapely.Point(pose.x_mm, pose.y_mm)))


def _narrow(evaluator: Evaluator, prepared: PreparedMap, pose: Pose, key: str) -> BadInputError:
    """Return the error of a start that is too near a wall."""
    radius_mm, build = evaluator.space.radii_mm(evaluator.growth)[0], evaluator.space.build
    away_mm, width_mm = _away_mm(prepared, pose), build.build(1).widths_mm[0]
    most_mm = np.floor(10.0 * width_mm * away_mm / radius_mm) / 10.0
    helps = f", or set {build.widths_key} to at most {most_mm:g}" if most_mm >= 1.0 else ""
    problem = (
        f"({pose.x_mm:g}, {pose.y_mm:g}) is {away_mm:.3g} mm from a wall of map "
        f"{prepared.world.name!r}, and a trunk of {width_mm:g} mm needs {radius_mm:.1f} mm"
    )
    return UnfitInputError(key, problem, f"move it to a place with room{helps}")


MOST_SECONDS, MOST_CHANGES = 4.0, 3
"""Processor time that the changes of a run are tried for, and how many are named."""

_POINTS, _ROUNDS, _KEPT, _CHECKED = 256, 4, 24, 4
"""Points of the changed space that are tried, rounds of changes of those with the least penalties,
how many of them are changed, and how many without penalty are asked for all rules."""


def without_rules(settings: RunSettings) -> RunSettings:
    """Return the settings of a short search that no rule stops."""
    free_generations = 10  # of the search that tells whether rules keep a robot from its targets
    generations = min(settings.search.generations, free_generations)
    return settings.changed(
        evaluation=settings.evaluation.changed(fabricable=False, joint_weight=0.0),
        search=settings.search.changed(generations=generations, evaluations=0, wall_time_s=0.0),
        start_from=(),
        space=settings.space.changed(only=()),
    )


@dataclass(frozen=True, slots=True, kw_only=True)
class Change:
    """Settings that differ from those of a run in one key."""

    key: str
    before: float | Bounds
    after: float | Bounds
    settings: RunSettings

    @property
    def text(self) -> str:
        """The change for the user."""
        return f"{self.key} = {_written(self.after)} in place of {_written(self.before)}"


def _written(value: float | Bounds) -> str:
    """Return a value as run files have it."""
    if isinstance(value, Bounds):
        return f"[{value.low:g}, {value.high:g}]"
    return f"{value:g}"


def changes(settings: RunSettings) -> Iterator[list[Change]]:
    """Yield, for each key that may stop all designs, its changes from the least on."""
    build, space = settings.build, settings.space

    def built(key: str, values: Sequence[float]) -> list[Change]:
        before = getattr(build, key)
        return [
            Change(
                key=f"build.{key}",
                before=before,
                after=after,
                settings=settings.changed(build=build.changed(**{key: after})),
            )
            for after in values
            if after != before
        ]

    def ranged(key: str, ends: list[tuple[float, float]]) -> list[Change]:
        bounds = getattr(space, key)
        return [
            Change(
                key=f"space.{key}",
                before=bounds,
                after=Bounds(low=low, high=high),
                settings=settings.changed(space=space.changed(**{key: Bounds(low=low, high=high)})),
            )
            for low, high in ends
            if (low, high) != (bounds.low, bounds.high)
        ]

    width, ratio, kpa = build.trunk_width_mm, build.width_ratio, build.pressure_kpa
    if not build.widths_mm:
        yield built("trunk_width_mm", [float(round(width * by)) for by in (1.15, 1.3, 1.6, 2.0)])
        yield built("trunk_width_mm", [float(round(width * by)) for by in (0.85, 0.7, 0.5)])
    yield built("width_ratio", [round(by, 2) for by in (0.8, 0.7, 0.6, 0.5) if by < ratio])
    yield built("width_ratio", [round(by, 2) for by in (0.65, 0.75, 0.8) if by > ratio])
    yield built("pressure_kpa", [round(kpa * by, 1) for by in (0.8, 0.6, 0.4)])
    yield built("pressure_kpa", [round(kpa * by, 1) for by in (1.25, 1.5, 2.0)])
    pieces = build.pieces or PieceSettings(most=1)
    more = [pieces.changed(most=most) for most in (2, 4, 6, 9) if most > pieces.most]
    yield [
        Change(
            key="build.pieces.most",
            before=pieces.most,
            after=one.most,
            settings=settings.changed(build=build.changed(pieces=one)),
        )
        for one in more
    ]
    few, deep = space.branches, space.levels
    yield ranged("branches", [(float(low), few.high) for low in range(int(few.low) - 1, 0, -1)])
    yield ranged("levels", [(float(low), deep.high) for low in range(int(deep.low) - 1, 0, -1)])
    length, fan = space.length_mm, space.angle_deg
    yield ranged("length_mm", [(length.low, round(length.high * by, 1)) for by in (1.3, 1.6, 2.0)])
    yield ranged("length_mm", [(round(length.low * by, 1), length.high) for by in (0.7, 0.5, 0.3)])
    yield ranged("angle_deg", [(fan.low, min(330.0, fan.high + by)) for by in (30, 60, 120)])
    yield ranged("angle_deg", [(max(0.0, fan.low - by), fan.high) for by in (20, 40, 80)])


def relaxations(
    settings: RunSettings, penalty: ManufacturabilityPenalty, near: Floats | None = None
) -> list[Change]:
    """Return changes of which each lets a design pass, the least of a key; perhaps none.

    Points of the changed space are drawn, those with the least penalties changed, and those without
    penalty asked for all rules; ``near``, shape (m, d), are points of the run with small penalties.
    A key that is not returned may help too, with other changes.
    """
    until_s, found = time.process_time() + MOST_SECONDS, list[Change]()
    for several in changes(settings):
        for change in several:
            if time.process_time() > until_s or len(found) == MOST_CHANGES:
                return found
            if change.key in {one.key for one in found}:
                break
            if has_design(change.settings, penalty, near):
                found.append(change)
                break
    return found


def has_design(
    settings: RunSettings, penalty: ManufacturabilityPenalty, near: Floats | None = None
) -> bool:
    """Return whether a design of a run's space that passes all rules is soon found."""
    try:
        refuse_infeasible_space(SpaceQuery.of(settings, penalty.profile, penalty.sheet_mm))
    except BadInputError:
        return False
    stream = 1418
    space, rng = Space(settings.space, settings.build), child(0, stream)
    if len(space) == 0:
        return False
    quick, x = penalty.within(space), rng.random((_POINTS, len(space)))
    if near is not None and near.shape[1] == len(space):
        x = np.concatenate([near, x])
    for _ in range(_ROUNDS):
        penalties = np.nan_to_num(quick(space.batch(x)), nan=np.inf)
        order = np.argsort(penalties, kind="stable")
        free = order[penalties[order] == 0.0]
        if any(penalty.broken(space.design(x[row])) == () for row in free[:_CHECKED]):
            return True
        least = x[order[:_KEPT]]
        moved = np.repeat(least, 6, axis=0)
        moved += 0.2 * rng.standard_normal(moved.shape) * (rng.random(moved.shape) < 0.4)
        x = np.concatenate([least, np.clip(moved, 0.0, 1.0)])
    return False


FAILED = 1.0
"""Penalty of a design that fails the full check alone."""

MOST_OF_GENERATION, MOST_FAILURES = 8, 200
"""Full checks of one generation, and failures of a run after which no more are asked for: counts,
not times, so that results are the same on every computer."""


NEAREST, MOST_NEAR = 5, 64
"""Designs with the least penalties whose broken rules are named, and that changes are tried on."""


class BestCheck:
    """What is known of the best design of a run so far.

    Attributes
    ----------
    passes
        Whether it passes all rules; None where that is not asked, or only a simulation tells.
    """

    def __init__(self, evaluator: Evaluator, history: Sequence[Generation]) -> None:
        self._evaluator = evaluator
        self._best = max((generation.best for generation in history), default=-np.inf)
        self._failures = sum(int((g.penalty == FAILED).sum()) for g in history)
        self.passes: bool | None = None
        if evaluator.penalty is not None:
            self.passes = self._best >= evaluator.lowest
        self._advice, self._outset = "", said_before(evaluator)

    def penalties(self, x: Floats, composite: Floats, penalty: Floats, costs: Floats) -> Floats:
        """Return penalties in which designs count that would be the best and fail the check."""
        fitness = self._evaluator.fitness(composite, penalty, costs)
        if self._evaluator.penalty is None:
            return penalty
        found, failures = penalty.copy(), self._failures
        for row in np.argsort(-fitness, kind="stable")[:MOST_OF_GENERATION].tolist():
            is_free = penalty[row] == 0.0 and np.isfinite(composite[row])
            if not is_free or fitness[row] <= self._best:
                break
            broken: tuple[Finding, ...] | None = None
            if failures < MOST_FAILURES:
                broken = self._evaluator.broken(self._evaluator.space.design(x[row]))
            if not broken:
                self.passes = None if broken is None else True
                break
            found[row] = FAILED
            failures += 1
        # From the record alone, so that a resumed run continues alike.
        self._failures += int((found == FAILED).sum())
        self._best = max(self._best, float(self._evaluator.fitness(composite, found, costs).max()))
        return found

    def judged(self, progress: SearchProgress) -> SearchProgress:
        """Return the progress of the run with the known facts of its best design, as words too."""
        # Share of a run without a manufacturable design after which its rules and their relaxations
        # are looked for.
        advice_at = 0.1
        if self.passes is False and progress.share >= advice_at:
            self._advice = self._advice or advice(self._evaluator, progress.history)
        shown = self._advice if self.passes is False else ""
        found = replace(progress, passes=self.passes, advice=shown or self._outset)
        return found.told(checked=self._evaluator.penalty is not None)

    def notes(self, finalists: Sequence[Finalist]) -> tuple[str, ...]:
        """Return the advice given, where no finalist may win or the winner misses targets."""
        beaten = all(finalist.penalty > 0.0 for finalist in finalists)
        targets = finalists[0].score.targets
        misses = targets is not None and not targets.all_touched
        asked = [(self._outset, beaten or misses), (self._advice, beaten)]
        return tuple(text for text, holds in asked if text and holds)


def rules_broken(evaluator: Evaluator, x: Iterable[Floats]) -> str:
    """Return the two rules that most of some designs break."""
    rules = Counter[str]()
    for point in x:
        found = evaluator.broken(evaluator.space.design(point)) or ()
        rules.update(sorted({f"{finding.rule} ({finding.title})" for finding in found}))
    named = ", ".join(rule for rule, _ in rules.most_common(2))
    return named or "limits that the penalty of the search has alone"


def advice(evaluator: Evaluator, history: Sequence[Generation]) -> str:
    """Return the rules that stop the designs of a run, and single changes that let some pass."""
    penalty, settings = evaluator.penalty, evaluator.spec.settings
    if not isinstance(penalty, ManufacturabilityPenalty):
        return ""
    x = np.concatenate([generation.x for generation in history])
    penalties = np.concatenate([generation.penalty for generation in history])
    valid = np.isfinite(np.concatenate([generation.composite for generation in history]))
    rows = np.flatnonzero(valid)[np.argsort(penalties[valid], kind="stable")]
    stops = rules_broken(evaluator, x[rows[:NEAREST]])
    helps = relaxations(settings, penalty, x[rows[:MOST_NEAR]])
    named = " or ".join(change.text for change in helps)
    helped = f"tried, and lets designs pass: {named}" if helps else "no single change tried helps"
    return f"no design passes all rules yet; the nearest break {stops}; {helped}"
