"""The penalty of one design, readably: the compiled kernel of the search must give the same."""

import math
from collections.abc import Iterable, Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from tests.oracles.fans import fans_of, level_lengths_mm, level_tapers_rad
from tests.oracles.quick_cuts import PieceLimits, pair_depths, quick_cuts, straight_begins_mm
from vinefab.fabrication.job.passes import bare_sheet_mm, seal_offset_mm, taken_mm
from vinefab.fabrication.rules.catalog import by_rule, changed_limits
from vinefab.fabrication.rules.clearance_rules import (
    check_angle,
    check_clearance,
    check_crotch,
    check_fillet,
    least_gap_mm,
)
from vinefab.fabrication.rules.laser_rules import check_paths
from vinefab.fabrication.rules.pressure_rules import (
    GrowthConstantsRange,
    check_bodies,
    check_window,
    contact_mm,
    most_growth_kpa,
)
from vinefab.fabrication.rules.rule import MOST_OF_ONE, LimitChanges, Rule, relative_excess
from vinefab.fabrication.rules.spacing import (
    capsules_of,
    excess_mm,
    spacing,
)
from vinefab.fabrication.rules.tree_rules import (
    check_least_width,
    check_packing,
    check_width_ratio,
    occupancies,
)
from vinefab.inflation.pattern import quick_pattern
from vinefab.model.design import Build, Design
from vinefab.model.laser import LaserProfile
from vinefab.outline.body_outline import flat_layout
from vinefab.outline.ends import pouch_takes_mm, usual_leaf
from vinefab.outline.joint import (
    LEAST_SEGMENT_MM,
    Point,
    crotch_reach_mm,
    largest_fillet_mm,
)
from vinefab.physics.growth_pressure import planned_growth_kpa
from vinefab.search.penalty_batch import MOST_CHECKED_BRANCHES

Pair = tuple[float, float]


def rooms_mm(design: Design) -> list[list[Pair]]:
    """Return, for the branches of a joint on each level, the straight sides left and the lengths.

    Fillets count with their designed radius. The outline draws them smaller where an angle allows
    no more, so that what it leaves is never less than this.
    """
    joints = [_joint(design, level) for level in range(1, design.depth)]
    begins_mm = [[0.0], *(children_mm for _, children_mm in joints)]
    tips_mm = [
        *(parent_mm for parent_mm, _ in joints),
        pouch_takes_mm(usual_leaf(design.build), design.build.pouch),
    ]
    lengths_mm = [[_trunk_mm(design)]]
    for number in range(2, design.depth + 1):
        leans, all_mm = level_tapers_rad(design, number), level_lengths_mm(design, number)
        lengths_mm.append([mm * math.cos(lean) for mm, lean in zip(all_mm, leans, strict=True)])
    return [
        [(length - begin - tip, length) for length, begin in zip(lengths, begins, strict=True)]
        for lengths, begins, tip in zip(lengths_mm, begins_mm, tips_mm, strict=True)
    ]


def _trunk_mm(design: Design) -> float:
    """Return the length of the trunk's side; that of an even one goes on along the tail."""
    lean = level_tapers_rad(design, 1)[0]
    if lean:
        return design.trunk_length_mm * math.cos(lean)
    collar = design.build.collar
    even_mm = design.build.tail_mm - (collar.reach_mm if collar else 0.0)
    return design.trunk_length_mm + even_mm


def _joint(design: Design, number: int) -> tuple[float, list[float]]:
    """Return how much of the parent, and of each child, the joint below level ``number`` takes."""
    wide = design.build.end_widths_mm[number - 1] / 2.0
    narrow = design.build.widths_mm[number] / 2.0
    radius = design.build.fillet_mm[number - 1]
    beside, *between = _gaps_rad(design, number)
    parent, child = straight_begins_mm(beside, (wide, narrow), radius)
    inner = [straight_begins_mm(gap, (narrow, narrow), radius, wide)[0] for gap in between]
    sides = [child, *inner, child]
    return parent, [max(pair) for pair in pairwise(sides)]


def short_sides(design: Design, least_mm: float) -> float:
    """Return what the shortest sides lack, of the worst branch of each level."""
    return math.fsum(
        max(short_share(*room, least_mm) for room in rooms) for rooms in rooms_mm(design)
    )


def window_penalty(
    design: Design, profile: LaserProfile, limits: LimitChanges | None = None
) -> float:
    """Return how far a design is from an open pressure window; 0 where VF-P03 finds no error.

    A search keeps to limits that are only assumed, too: there the rule finds a warning.

    Returns
    -------
    float
        ``log(1 + excess)``: the relative excess, at most 10, of the pressure that growth to the
        worst tip takes over `most_growth_kpa`.
    """
    values = check_window.limits_under(limits)
    fit = GrowthConstantsRange.of(profile, values)
    build = design.build
    takes_kpa = planned_growth_kpa(design.tree, fit.loose, fit.diameter_mm).max()
    most_kpa = most_growth_kpa(build, profile, values)
    return math.log1p(min(MOST_OF_ONE, max(0.0, takes_kpa / most_kpa - 1.0)))


DEFAULT_FILM_MM = 0.075
"""Two plies of 0.0375 mm."""

DEFAULT_TAKEN_MM = 1.1
"""Half a kerf of 0.3 mm beyond it, and a melted rim of 0.4 mm to both sides of that."""


def fabrication_penalty(
    design: Design,
    limits: LimitChanges | None = None,
    *,
    profile: LaserProfile | None = None,
    sheet_mm: tuple[float, float] | None = None,
    pieces: PieceLimits | None = None,
) -> float:
    """Return how far a design is from passing the cheap geometric rules; 0 if it passes.

    These are the error limits of VF-W01, VF-W02, VF-W03, VF-C01, VF-C02, VF-C03 and, as negative
    clearance, VF-T03; with pouches also their clearance (VF-C07), VF-S01 if a sheet is given, and
    VF-J01 to VF-J04 and VF-J06 for robots in pieces.
    A design without penalty has no error from these rules. Fillets count with their designed
    radius, so that a few designs whose fillets the outline would reduce are penalized needlessly.

    Parameters
    ----------
    profile
        The recipe. A compensated design counts as its pattern by `quick_pattern`; fans narrower
        than any that was simulated, siblings that lie on each other when inflated (VF-I04, of which
        the check only warns: nothing that grows knows it), fillets that its flat crotches have no
        room for (VF-C04, VF-L02) and ends of parents too short to be run between two fillets
        (VF-L02) add to the penalty. Without a recipe every design counts as it
        is, cut of film of `DEFAULT_FILM_MM` by beams that take `DEFAULT_TAKEN_MM`.
    sheet_mm
        Width and height that the flat robot must fit after a rotation, or None for any size.
        Subtract a few millimetres for seam, kerf and the overcut at the mouth.
    pieces
        What pieces must keep, their sheet among it, or None for one flat outline.

    Returns
    -------
    float
        Sum over the kinds of rules of ``log(1 + sum of violation depths)``, each depth relative
        to its limit. It falls steadily as branches part, also while they still cross, so that a
        search can follow it; the logarithm keeps a hopeless tree below about 100.
    """
    changed, film_mm, beside_mm = limits or {}, DEFAULT_FILM_MM, DEFAULT_TAKEN_MM
    passages, beyond = (1.0,) * (design.depth - 1), 0.0
    if profile is not None:
        film_mm, beside_mm = profile.material.film_mm, taken_mm(profile)
        pattern = quick_pattern(design, profile.material)
        beyond = pattern.beyond + _over(
            _contacts(design), _limit(check_bodies, changed, "sibling_share")
        )
        sizes_mm = FilletSizes.of(changed, profile)
        beyond += math.fsum(
            relative_excess(_least_mm(sizes_mm, radius_mm, turn), radius_mm)
            + _short_end(sizes_mm, end_rad, core_mm)
            for radius_mm, turn, end_rad, core_mm in _fillets(pattern.flat)
        )
        design, passages = pattern.flat, pattern.passages
    gaps = bare_gaps(design)
    angles_deg = (math.degrees(angle_rad) for angle_rad, _ in gaps)
    narrow = _short_of(angles_deg, _limit(check_angle, changed))
    webbed = _over((share for _, share in gaps), _limit(check_crotch, changed))
    # What rides in a child comes through the passage of its joint.
    filled, level = (
        occupancies(design, film_mm, _limit(check_packing, changed, "packing")),
        design.tree.level,
    )
    shares = [
        float(filled[level == number].max()) / passage
        for number, passage in enumerate((1.0, *passages), start=1)
    ]
    kinds = (
        width_violations(design.build, changed),
        beyond + narrow + webbed + short_sides(design, LEAST_SEGMENT_MM),
        _over((100.0 * share for share in shares), _limit(check_packing, changed)),
        _on_sheet(design, changed, sheet_mm, beside_mm)
        if pieces is None
        else quick.left
        if (quick := quick_cuts(design, pieces, passages))
        else _on_sheet(design, changed, pieces.sheet_mm, beside_mm),
    )
    return math.fsum(math.log1p(depth) for depth in kinds)


def width_violations(build: Build, changed: LimitChanges) -> float:
    """Return the summed depths of violations by the widths of the levels, whatever they hold."""
    widths_mm, ends_mm = build.widths_mm, build.end_widths_mm
    least_mm, least = (
        rule.limits_under(changed)["error"] for rule in (check_least_width, check_width_ratio)
    )
    ratios = (wide / narrow for wide, narrow in zip(ends_mm, widths_mm[1:], strict=False))
    narrow = math.fsum((least_mm - mm) / least_mm for mm in ends_mm if mm < least_mm)
    return narrow + math.fsum((least - ratio) / least for ratio in ratios if ratio < least)


def _contacts(design: Design) -> Iterator[float]:
    """Yield the share of the shortest sibling that lies on another, of each deployed fan."""
    if design.build.compensation == "none":
        return
    for width_mm, level in zip(design.build.widths_mm[1:], fans_of(design), strict=True):
        if level.branches > 1:
            gap_deg = math.degrees(level.least_gap_rad)
            share = contact_mm(gap_deg, width_mm, width_mm) / float(level.lengths_mm.min())
            yield share


class FilletSizes(NamedTuple):
    """Which fillets can be made, and which ends of parents between them."""

    error_mm: float  # least radius that VF-C04 allows
    seal_mm: float  # how far outside the lumen's edge the seam runs: smaller fillets are corners
    run_mm: float  # least radius whose arc on the seam's path is large enough to be run (VF-L02)
    end_mm: float  # least length of a parent's end on that path, with a tenth for the law's error

    @classmethod
    def of(cls, changed: LimitChanges, profile: LaserProfile) -> "FilletSizes":
        """Return the sizes for a recipe and limits that are changed."""
        seal_mm, paths = seal_offset_mm(profile), check_paths.limits_under(changed)
        return cls(
            error_mm=_limit(check_fillet, changed),
            seal_mm=seal_mm,
            run_mm=1.001 * (paths["radius_error"] + seal_mm),
            end_mm=1.1 * paths["segment_error"],
        )


def _least_mm(sizes: FilletSizes, radius_mm: float, turn_rad: float) -> float:
    """Return the least radius in a gap where a fillet of some radius turns so far.

    On the seam's path a fillet smaller than the seam's offset is a corner, as is one whose arc
    would be too short to draw.
    """
    arc_mm = (radius_mm - sizes.seal_mm) * turn_rad
    runs = radius_mm >= sizes.run_mm or arc_mm < LEAST_SEGMENT_MM
    return sizes.error_mm if runs else max(sizes.error_mm, sizes.run_mm)


def _short_end(sizes: FilletSizes, shown_rad: float, core_mm: float) -> float:
    """Return how much is missing where a parent's end shows too little to be run, 0 to 1.

    What would be shorter than the shortest segment is not drawn.
    """
    end_mm = (core_mm + sizes.seal_mm) * shown_rad
    return max(0.0, 1.0 - end_mm / sizes.end_mm) if end_mm >= LEAST_SEGMENT_MM else 0.0


def _fillets(design: Design) -> Iterator[tuple[float, float, float, float]]:
    """Yield the gaps of each level's joint: of the fillet, its radius and turn; no tapers.

    Then the angle over which the parent's round end shows beside it, and that end's radius.

    Fans are their own mirror images: of two gaps alike the smaller radius counts.
    """
    build, above_mm = design.build, design.trunk_length_mm
    for number, level in enumerate(fans_of(design), start=1):
        wide, narrow = build.end_widths_mm[number - 1] / 2.0, build.widths_mm[number] / 2.0
        lengths_mm = level.lengths_mm.tolist()
        headings = [-math.pi, *level.angles_rad.tolist(), math.pi]
        sides = [(wide, above_mm), *((narrow, mm) for mm in lengths_mm), (wide, above_mm)]
        core_mm, drawn = max(wide, narrow), list[tuple[float, float, float]]()
        for (one, one_mm), (two, two_mm), (before, after) in zip(
            sides, sides[1:], pairwise(headings), strict=False
        ):
            reach_mm = max(0.5 * min(one_mm, two_mm), wide, narrow)
            most = largest_fillet_mm(after - before, (one, two), reach_mm)
            radius_mm = max(0.0, min(build.fillet_mm[number - 1], most))
            turn = largest_turn_rad(after - before, (one, two), radius_mm, core_mm)
            hidden = sum(math.asin((mm + radius_mm) / (core_mm + radius_mm)) for mm in (one, two))
            drawn.append((radius_mm, turn, after - before - hidden))
        for found in map(min, drawn[: (len(drawn) + 1) // 2], reversed(drawn)):
            yield (*found, core_mm)
        above_mm = min(lengths_mm)


def _limit(rule: Rule, changed: LimitChanges, name: str = "error") -> float:
    return rule.limits_under(changed)[name]


def _short_of(values: Iterable[float], limit: float) -> float:
    """Return the summed depths of values, none negative, that should be at least a limit."""
    return math.fsum((limit - value) / limit for value in values if value < limit)


def _over(values: Iterable[float], limit: float) -> float:
    """Return the summed excesses of values that should be at most a limit."""
    return math.fsum(relative_excess(value, limit) for value in values)


def short_share(room_mm: float, length_mm: float, least_mm: float) -> float:
    """Return how much of a branch is missing for its side to keep a least length, at most 10."""
    return min(MOST_OF_ONE, max(0.0, (least_mm - room_mm) / length_mm))


def _on_sheet(
    design: Design,
    changed: LimitChanges,
    sheet_mm: tuple[float, float] | None,
    beside_mm: float,
) -> float:
    if design.branch_count > MOST_CHECKED_BRANCHES:
        return float(design.branch_count) ** 2
    capsules = capsules_of(flat_layout(design), design.build)
    clearance_mm = least_gap_mm(check_clearance, changed, beside_mm)
    found = spacing(capsules, clearance_mm)
    near = float(pair_depths(capsules, found, clearance_mm).sum())
    if sheet_mm is None:
        return near
    return near + max(0.0, excess_mm(capsules, sheet_mm) / min(sheet_mm))


def whole_penalty(design: Design, profile: LaserProfile) -> float:
    """Return the penalty of a design in a search: growth and geometry by the recipe's limits."""
    changed, pieces = by_rule(changed_limits(design, profile)), None
    sheet_mm = bare_sheet_mm(profile)
    if design.build.pieces is not None and design.build.pieces.most > 1:
        pieces = PieceLimits.of(design.build, profile, changed, sheet_mm)
    flat = fabrication_penalty(design, changed, profile=profile, sheet_mm=sheet_mm, pieces=pieces)
    return window_penalty(design, profile, changed) + flat


def path_excess(design: Design, profile: LaserProfile, changed: LimitChanges) -> float:
    """Return by how much sides and drawn fillets of a flat tree are too small for the laser."""
    sizes = FilletSizes.of(changed, profile)
    least_mm = max(sizes.error_mm, sizes.run_mm)
    side_mm = 1.001 * _limit(check_paths, changed, "segment_error")
    found = math.fsum(relative_excess(least_mm, drawn) for drawn in _drawn_fillets_mm(design))
    return found + short_sides(design, side_mm)


def _drawn_fillets_mm(design: Design) -> list[float]:
    """Return the least fillet radii that the angles allow on each level.

    These are the least beside the parent and the least between two children.
    """
    found: list[float] = []
    build, above_mm = design.build, design.trunk_length_mm
    for number, level in enumerate(fans_of(design), start=1):
        wide, narrow = build.end_widths_mm[number - 1] / 2.0, build.widths_mm[number] / 2.0
        disc, designed = max(wide, narrow), build.fillet_mm[number - 1]
        lengths_mm = level.lengths_mm.tolist()
        beside, *between = _gaps_rad(design, number)

        def drawn(angle_rad: float, half: float, shorter_mm: float) -> float:
            reach_mm = max(0.5 * shorter_mm, disc)  # noqa: B023  called at once
            most = largest_fillet_mm(angle_rad, (half, narrow), reach_mm)  # noqa: B023
            return max(0.0, min(designed, most))  # noqa: B023

        outer_mm = min(above_mm, lengths_mm[0], lengths_mm[-1])
        found.append(drawn(beside, wide, outer_mm))
        pairs = zip(between, pairwise(lengths_mm), strict=True)
        inner = [drawn(angle, narrow, min(pair)) for angle, pair in pairs]
        found += [min(inner)] if inner else []
        above_mm = min(lengths_mm)
    return found


def _gaps_rad(design: Design, number: int) -> list[float]:
    """Return the least angle beside the parent, and that of each gap between children."""
    level, lean = fans_of(design)[number - 1], least_lean_rad(design, number + 1)
    beside = math.pi - level.widest_turn_rad - max(level_tapers_rad(design, number)) + lean
    between = np.diff(level.angles_rad).tolist()
    return [beside, *(angle + 2.0 * lean for angle in between)]


def bare_gaps(design: Design) -> list[tuple[float, float]]:
    """Return angle and share in the crotch of every kind of gap, in closed form, without fillets.

    For each level that is the gap beside the parent and, between children, the least angle and the
    largest share. Fillets are drawn no larger than the crotch allows, so these shares exceed one
    half exactly when those of `share_in_crotch` do.
    """
    found = []
    widths_mm, ends_mm = design.build.widths_mm, design.build.end_widths_mm
    above_mm = design.trunk_length_mm
    for number, level in enumerate(fans_of(design), start=1):
        wide, narrow = ends_mm[number - 1] / 2.0, widths_mm[number] / 2.0
        lengths_mm = level.lengths_mm.tolist()
        shortest_mm = min(lengths_mm)
        disc = max(wide, narrow)
        beside, *between = _gaps_rad(design, number)
        reach = _bare_reach_mm(beside, (wide, narrow), disc)
        length_mm = shortest_mm if reach <= disc else min(shortest_mm, above_mm)
        found.append((beside, reach / length_mm))
        shares = [
            _bare_reach_mm(angle, (narrow, narrow), disc) / min(pair)
            for angle, pair in zip(between, pairwise(lengths_mm), strict=True)
        ]
        if shares:
            found.append((min(between), max(shares)))
        above_mm = shortest_mm
    return found


def least_lean_rad(design: Design, level: int) -> float:
    """Return by how much the sides of every branch of a level lean towards its axis at least."""
    return min(level_tapers_rad(design, level)) if design.build.taper else 0.0


def _bare_reach_mm(angle_rad: float, halves_mm: tuple[float, float], disc_mm: float) -> float:
    """Return how far from the joint two sides part: where they cross, or at the joint's disc."""
    hidden = sum(math.asin(half / disc_mm) for half in halves_mm)
    return disc_mm if hidden <= angle_rad else crotch_reach_mm(angle_rad, *halves_mm)


def largest_turn_rad(angle_rad: float, halves_mm: Point, radius_mm: float, disc_mm: float) -> float:
    """Return the largest angle that a fillet between two even neighbours turns through."""
    hidden = [math.asin((half + radius_mm) / (disc_mm + radius_mm)) for half in halves_mm]
    return math.pi / 2.0 - min(hidden) if sum(hidden) <= angle_rad else math.pi - angle_rad
