"""Rules about the lay-flat widths of the levels."""

from collections.abc import Iterable

import numpy as np

from vinefab.fabrication.outline.exactness import ProblemKind
from vinefab.fabrication.rules.rule import (
    BrokenLimit,
    Limits,
    Rule,
    RuleApplied,
    RuleNotApplicable,
    Violation,
    branch_violation,
    outline_violations,
)
from vinefab.fabrication.rules.subject import Subject
from vinefab.inflation.pattern import Pattern
from vinefab.model.design import Design
from vinefab.model.pieces import Sleeve
from vinefab.model.tree import branch_tree
from vinefab.physics.tube import lumen_area_mm2

PACKING_SHARE = 0.1
"""Share of solid film in a bundle of crumpled thin film (assumed, uncalibrated)."""


def occupancies(
    design: Design, film_mm: float, packing: float = PACKING_SHARE
) -> tuple[float, ...]:
    """Return, for each level that film rides in, how much of its lumen that film fills.

    While a branch grows, all its undeployed descendants are drawn through it one level after
    the other, the branches of one level side by side. A branch of width w has a solid cross-section
    of w x film, which crumpling expands to w x film / packing. The fullest cross-section below
    level i is that of the level with the most width in it:

        occupancy_i = max over j > i of  n_ij w_j film / packing / (w_i^2 / pi)

    with n_ij descendants of level j per branch of level i. Where a level tapers, w_i is its width
    at the end and w_j at the beginning; leaves are as wide as their pouches. A pouch wider than its
    own branch rides in that too, so that the leaves are the last level then. The branch's own
    inverted wall is not counted. The formula is vinefab's and uncalibrated; it neglects that levels
    of uneven branch lengths overlap.
    """
    widths_mm, ends_mm = list(design.build.widths_mm), design.build.end_widths_mm
    pouch = design.build.pouch
    pouch_mm = pouch.flat_width_mm if pouch else 0.0
    widths_mm[-1] = max(widths_mm[-1], pouch_mm)
    shares = []
    for above in range(len(design.levels)):
        count, most_mm = 1, 0.0
        for below in range(above, len(design.levels)):
            count *= design.levels[below].branches
            most_mm = max(most_mm, count * widths_mm[below + 1])
        shares.append(most_mm * film_mm / packing / lumen_area_mm2(ends_mm[above]))
    if pouch_mm > ends_mm[-1]:
        shares.append(pouch_mm * film_mm / packing / lumen_area_mm2(ends_mm[-1]))
    return tuple(shares)


def lap_occupancies(
    design: Design,
    sleeves: Iterable[Sleeve],
    film_mm: float,
    packing: float = PACKING_SHARE,
) -> dict[int, float]:
    """Return, for each branch that laps ride in, how much of its lumen the film there fills.

    As `occupancies`, but with the film doubled where the plug of a sleeve lies in the socket: a
    cross-section of 2 w + 2 rise in place of w, with the rise of the socket's edge over the
    branch's. The descendants k of one level of branch b lie side by side, each at its widest:

        occupancy_b = max over j of  sum over k of level j of c_k film / packing / (w_b^2 / pi)

    with c_k = max(w_j, 2 w_k + 2 rise) where a sleeve of width w_k is on k, else w_j. The formula
    is vinefab's and uncalibrated; it neglects where along their branches the laps lie.
    """
    tree, pouch = branch_tree(design), design.build.pouch
    widths_mm = np.array(design.build.widths_mm)
    widths_mm[-1] = max(widths_mm[-1], pouch.flat_width_mm if pouch else 0.0)
    across_mm = widths_mm[tree.level - 1]
    has_lap = np.zeros(len(tree), dtype=bool)
    for sleeve in sleeves:
        lap_mm = 2.0 * (sleeve.width_mm + sleeve.rise_mm)
        across_mm[sleeve.branch] = max(across_mm[sleeve.branch], lap_mm)
        has_lap[sleeve.branch] = True
    # Below each branch: the cross-section by level, and whether a lap is in it.
    below_mm = np.zeros((len(tree), len(widths_mm)))
    holds_lap = np.zeros(len(tree), dtype=bool)
    for branch in range(len(tree) - 1, 0, -1):
        parent = tree.parent[branch]
        below_mm[parent] += below_mm[branch]
        below_mm[parent, tree.level[branch] - 1] += across_mm[branch]
        holds_lap[parent] |= holds_lap[branch] or has_lap[branch]
    ends_mm = design.build.end_widths_mm
    return {
        branch: float(below_mm[branch].max())
        * film_mm
        / packing
        / lumen_area_mm2(ends_mm[int(tree.level[branch]) - 1])
        for branch in np.flatnonzero(holds_lap).tolist()
    }


def passages_of(pattern: Pattern | None) -> dict[int, float]:
    """Return the passage into the branches of each level, as far as their joint was simulated."""
    joints = pattern.joints if pattern else ()
    return {joint.level: joint.found.passage for joint in joints if joint.found is not None}


def check_least_width(subject: Subject, limits: Limits) -> RuleApplied:
    """VF-W01: no level is too narrow to be inflated and turned inside out."""
    build = subject.design.build
    widths_mm = build.end_widths_mm
    violations = [
        _level_violation(
            subject,
            level,
            f"tubes of level {level} may burst before they grow: widen them, or the whole robot",
            broken,
        )
        for level, width_mm in enumerate(widths_mm, start=1)
        if (broken := limits.least(width_mm))
    ]
    more = outline_violations(subject, ProblemKind.VANISHED, known=tuple(violations))
    if build.pouch and build.pouch.length_mm and (broken := limits.least(build.pouch.length_mm)):
        message = "the pouch is too short along its branch to be inflated: lengthen it"
        short = _level_violation(subject, subject.design.depth, message, broken, aspect="pouch")
        more = (*more, short)
    return RuleApplied(checked=len(widths_mm), violations=(*violations, *more))


def check_width_ratio(subject: Subject, limits: Limits) -> RuleApplied:
    """VF-W02: a parent is much wider than its children."""
    widths_mm = subject.design.build.widths_mm
    ends_mm = subject.design.build.end_widths_mm
    ratios = [wide / narrow for wide, narrow in zip(ends_mm, widths_mm[1:], strict=False)]
    violations = [
        _level_violation(
            subject,
            level,
            f"level {level} is nearly as wide as the level before it: narrow it, or widen that one",
            broken,
        )
        for level, ratio in enumerate(ratios, start=2)
        if (broken := limits.least(ratio))
    ]
    more = outline_violations(subject, ProblemKind.CHILD_WIDTH, known=tuple(violations))
    return RuleApplied(checked=len(ratios), violations=(*violations, *more))


def check_packing(subject: Subject, limits: Limits) -> RuleApplied | RuleNotApplicable:
    """VF-W03: folded descendants and pouches leave room in the lumen that they ride in.

    What rides in a child comes through its joint. Where the joint was simulated, the cross-section
    there counts: that of the child's tube times the joint's passage.
    """
    if subject.profile is None:
        return RuleNotApplicable(reason="needs a recipe, for the film's thickness")
    film_mm = subject.profile.material.film_mm
    found = [*occupancies(subject.design, film_mm, limits["packing"])]
    for level, passage in passages_of(subject.pattern).items():
        if level <= len(found):
            found[level - 1] /= passage
    violations = [
        _level_violation(
            subject,
            level,
            f"folded pouches may jam in level {level}: narrow them, or widen the level"
            if level == subject.design.depth
            else f"folded film may jam in level {level}: fewer or narrower children, or widen it",
            broken,
        )
        for level, share in enumerate(found, start=1)
        if (broken := limits.most(100.0 * share))
    ]
    return RuleApplied(checked=len(found), violations=tuple(violations))


def _level_violation(
    subject: Subject, level: int, message: str, broken: BrokenLimit, aspect: str = ""
) -> Violation:
    """Return a violation by a level: its first branch is named, all of them are marked."""
    rows = np.flatnonzero(subject.layout.tree.level == level).tolist()
    return branch_violation(subject, rows[:1], message, broken, marked=rows, aspect=aspect)


LEAST_WIDTH = Rule(
    id="VF-W01",
    title="every level is wide enough to inflate",
    broken="a level or pouch is too narrow to inflate",
    unit="mm",
    limits={"error": 5.0, "warning": 8.0},
    reason="narrow tubes burst before they grow: 3 mm tubes did, 4 to 7 mm worked (published)",
    remedy="widen the level; with a width ratio, raise it or the trunk's width",
    check=check_least_width,
)
WIDTH_RATIO = Rule(
    id="VF-W02",
    title="every parent is much wider than its children",
    broken="a child is too wide for its parent",
    limits={"error": 1.2, "warning": 1.5},
    reason="each level should be much wider than the next one, or it does not deploy (paper)",
    remedy="narrow the child's level or widen its parent's",
    check=check_width_ratio,
)
PACKING = Rule(
    id="VF-W03",
    title="folded film leaves room in every branch",
    broken="too much folded film rides in a branch",
    unit="%",
    limits={"error": 60.0, "warning": 30.0, "packing": 0.1},
    reason="undeployed film rides inside the body and jams when it is packed (uncalibrated)",
    remedy="fewer, shorter or narrower descendants, smaller pouches, or a wider parent",
    check=check_packing,
)
