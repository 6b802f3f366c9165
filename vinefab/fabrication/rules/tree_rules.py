"""Rules about the tree and its pieces: outline, widths, tail, clamp, reach, sleeves and laps."""

import math
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np
import shapely

from vinefab.core.plain_text import agreeing, counted
from vinefab.core.validation import Floats
from vinefab.fabrication.job.marks import PLUG, SOCKET, joint_mark, piece_mark
from vinefab.fabrication.job.placement import piece_name
from vinefab.fabrication.rules.rule import (
    ROUNDING,
    LimitChanges,
    Limits,
    RuleApplied,
    Scope,
    Subject,
    Violation,
    branch_point_mm,
    design_rule,
    mark_branches,
    mark_line,
    mark_point,
    needed,
    outline_violations,
)
from vinefab.inflation.pattern import Pattern
from vinefab.model.design import Build, Design, PieceSettings
from vinefab.model.finding import Severity
from vinefab.model.job import Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.outline import Part
from vinefab.model.tree import Partition, Sleeve
from vinefab.outline.body_outline import ProblemKind
from vinefab.physics.tube import lap_load_n_mm, lumen_area_mm2


@design_rule(
    "VF-T01",
    broken="a branch has no length or hangs on nothing",
    unit="mm",
    error=0.1,
    reason="a branch shorter than a laser spot cannot be drawn",
    remedy="lengthen the branch, or remove its level",
)
def check_tree(subject: Subject, limits: Limits) -> RuleApplied:
    """Every branch hangs on its parent and has a length."""
    layout, tree = subject.layout, subject.layout.tree
    violations = []
    for row, length_mm in enumerate(tree.length_mm.tolist()):
        if broken := limits.least(length_mm):
            message = "the branch is too short to be drawn: lengthen it or leave it out"
            violations.append(broken.on(subject, [row], message))
    away = np.abs(layout.start_mm[1:] - layout.end_mm[tree.parent[1:]]).max(axis=1, initial=0.0)
    for row in (1 + np.flatnonzero(~(away < 1e-6))).tolist():
        violations.append(  # noqa: PERF401  one shape of loop for both halves of the rule
            Violation(
                message="the branch does not begin at the tip of its parent: join them",
                measured=float(away[row - 1]),
                branches=subject.ids(row),
                aspect="joined",
            )
        )
    return RuleApplied(checked=len(tree), violations=tuple(violations))


@design_rule(
    "VF-T02",
    broken="the outline crosses itself",
    on={Scope.ROOM, Scope.PIECES},
    reason="two flat plies cannot lie on themselves; a crossing outline cuts the body open",
    remedy="widen angles, shorten or narrow branches until none crosses another, or pieces",
)
def check_outline_polygon(subject: Subject, _: Limits) -> RuleApplied:
    """The outline stays clear of itself.

    It encloses one valid polygon without holes.
    """
    body = subject.body
    if body.is_valid:
        return RuleApplied(checked=1)
    reason = shapely.is_valid_reason(body)
    found = re.search(r"\[(\S+) (\S+)\]", reason)  # the place
    if not found:
        return RuleApplied.of_one(Violation(message=f"the outline is not a polygon: {reason}"))
    at = float(found[1]), float(found[2])
    # Named are the (up to) two branches nearest to the place.
    capsules = subject.capsules
    lines = shapely.linestrings(np.stack([capsules.start_mm, capsules.end_mm], axis=1))
    far = shapely.distance(lines, shapely.Point(at)) - capsules.most_half_mm
    near = capsules.branch[np.argsort(far, kind="stable")]
    return RuleApplied.of_one(
        Violation(
            message="the outline crosses itself here, and a flat sheet cannot: widen the angle, or "
            "shorten or narrow the branches",
            branches=subject.ids(*sorted(list(dict.fromkeys(near.tolist()))[:2])),
            at_mm=at,
            marker=mark_point(at),
        )
    )


@design_rule(
    "VF-T04",
    broken="the mouth is missing or too narrow",
    unit="mm",
    error=5.0,
    on={Scope.ROOM, Scope.PIECES},
    reason="the robot is inflated and clamped through its mouth; everything else is sealed",
    remedy="widen the trunk",
)
def check_mouth(subject: Subject, limits: Limits) -> RuleApplied:
    """The mouth is open and wide enough."""
    contour = subject.outline.contour
    first, last = contour.points_mm[0].tolist(), contour.points_mm[-1].tolist()
    if contour.closed:
        return RuleApplied.of_one(
            Violation(message="the outline is closed: leave a mouth to inflate it by")
        )
    broken = limits.least(math.dist(first, last))
    return RuleApplied.of_one(
        broken
        and replace(
            broken,
            message="the mouth does not open over the base: widen the trunk",
            branches=subject.ids(0),
            at_mm=((first[0] + last[0]) / 2.0, (first[1] + last[1]) / 2.0),
            marker=mark_line(tuple(first), tuple(last)),
        )
    )


@design_rule(
    "VF-B01",
    broken="the tail is too short to invert and clamp",
    unit="mm",
    error=150.0,
    warning=200.0,
    reason="the last 200 mm are inverted over the base and clamped (paper)",
    remedy="a longer tail",
)
def check_tail(subject: Subject, limits: Limits) -> RuleApplied:
    """The tail is long enough to invert and clamp."""
    tail_mm = subject.design.build.tail_mm
    broken = limits.least(tail_mm)
    return RuleApplied.of_one(
        broken
        and replace(
            broken,
            message="too little tail to invert over the base: lengthen build.tail_mm",
            branches=subject.ids(0),
            at_mm=(-tail_mm, 0.0),
            marker=mark_line((-tail_mm, 0.0), (0.0, 0.0)),
        )
    )


@design_rule(
    "VF-B02",
    broken="the tail does not fit the clamp",
    unit="mm",
    error=100.0,
    fit_error=0.1,
    reason="a clamp seals a straight tube only; without a collar 100 mm is assumed",
    remedy="a collar that fits the clamp, or another trunk width",
)
def check_clamp(subject: Subject, limits: Limits) -> RuleApplied:
    """The tail is straight and fits the clamp.

    With a collar the outline's mouth must be as wide as a tube that fits the clamp; without one it
    must be no wider than a common clamp. The collar's transition is the only bend allowed.
    """
    contour = subject.outline.contour
    mouth_mm = math.dist(contour.points_mm[0], contour.points_mm[-1])
    violations = list(outline_violations(subject, ProblemKind.COLLAR, ProblemKind.COLLAR_FLARE))
    collar = subject.design.build.collar
    if collar is None:
        broken = limits.most(mouth_mm)
        message = (
            "the tail is wider than the clamp of the base: narrow the trunk or give it a collar"
        )
    else:
        broken = limits.most(abs(mouth_mm - collar.flat_width_mm), "fit")
        message = "the collar is not as wide as the clamp: set build.collar to the clamp's size"
    if broken:
        at_mm = branch_point_mm(subject.layout, 0, 0.0)
        violations.append(
            replace(broken, message=message, branches=subject.ids(0), at_mm=at_mm, aspect="clamp")
        )
    tail = [s for s in contour.segments if s.part is Part.TAIL]
    bent = [s for s in tail if s.bulge or abs(s.start_mm[1] - s.end_mm[1]) > 1e-6]
    if bent:
        violations.append(
            Violation(
                message="the tail bends, and a clamp seals straight tubes only: straighten it",
                branches=subject.ids(0),
                at_mm=bent[0].start_mm,
                marker=mark_line(bent[0].start_mm, bent[0].end_mm),
                aspect="straight",
            )
        )
    return RuleApplied(checked=1, violations=tuple(violations))


@design_rule(
    "VF-B03",
    broken="the longest path is too short or too long: untested",
    unit="mm",
    short_warning=250.0,
    long_warning=2000.0,
    reason="untested above 2 m and below 0.25 m (paper)",
    remedy="change the lengths, or accept that such a length was never tried",
)
def check_reach(subject: Subject, limits: Limits) -> RuleApplied:
    """The longest path has a length that was tested."""
    tree = subject.grown_tree
    path_mm = np.array(tree.length_mm)
    for row in range(1, len(tree)):
        path_mm[row] += path_mm[tree.parent[row]]
    far = int(path_mm.argmax())
    longest_mm = float(path_mm[far])
    short = limits.least(longest_mm, "short")
    broken = short or limits.most(longest_mm, "long")
    than = "shorter" if short else "longer"
    message = f"robots with {than} paths are untested: change the lengths or the scale"
    return RuleApplied.of_one(broken and broken.on(subject, [far], message, at=1.0))


def occupancies(
    design: Design,
    film_mm: float,
    packing: float = 0.1,
    across_mm: Mapping[int, float] | None = None,
) -> Floats:
    """Return how much of each branch's lumen the film fills that rides in it, shape (n,).

    While a branch grows, all its undeployed descendants are drawn through it one level after
    the other, the branches of one level side by side. A branch of width w has a solid cross-section
    of w x film, which crumpling expands to w x film / packing (the share of solid film in a bundle,
    assumed). The fullest cross-section below branch b is that of the level with the most width in
    it:

        occupancy_b = max over j of  sum over k of level j of w_k film / packing / (w_b^2 / pi)

    with the descendants k of b. Where a branch tapers, w_b is its width at the end and w_k at the
    beginning; leaves are as wide as their pouches. A pouch wider than its own branch rides in that
    too. The branch's own inverted wall is not counted. The formula is vinefab's and uncalibrated;
    it neglects that levels of uneven branch lengths overlap.

    Parameters
    ----------
    across_mm
        Cross-sections of some branches, in place of their widths where they are larger.
    """
    tree = design.tree
    pouch_mm = np.array([one.flat_width_mm if one else 0.0 for one in design.pouches])
    most_mm = np.maximum(tree.width_mm, pouch_mm)
    for branch, own_mm in (across_mm or {}).items():
        most_mm[branch] = max(most_mm[branch], own_mm)
    below_mm = np.zeros((len(tree), design.depth))  # the cross-section below each branch, by level
    for rows in reversed(tree.generations[1:]):
        parents = tree.parent[rows]
        np.add.at(below_mm, parents, below_mm[rows])
        np.add.at(below_mm, (parents, tree.level[rows] - 1), most_mm[rows])
    inside_mm = below_mm.max(axis=1)
    own_pouch = pouch_mm > tree.end_width_mm
    inside_mm[own_pouch] = np.maximum(inside_mm, pouch_mm)[own_pouch]
    lumen_mm2 = lumen_area_mm2(1.0) * tree.end_width_mm**2
    return np.asarray(inside_mm * film_mm / packing / lumen_mm2)


def lap_occupancies(
    design: Design,
    sleeves: Iterable[Sleeve],
    film_mm: float,
    packing: float = 0.1,
) -> dict[int, float]:
    """Return, for each branch that laps ride in, how much of its lumen the film there fills.

    As `occupancies`, but with the film doubled where the plug of a sleeve lies in the socket: a
    cross-section of 2 w + 2 rise in place of w, with the rise of the socket's edge over the
    branch's. It neglects where along their branches the laps lie.
    """
    tree, of_part = design.tree, design.tree.straight.branch
    across_mm = dict[int, float]()
    for sleeve in sleeves:
        branch = int(of_part[sleeve.branch])
        lap_mm = 2.0 * (sleeve.width_mm + sleeve.rise_mm)
        across_mm[branch] = max(lap_mm, across_mm.get(branch, 0.0))
    holds_lap = np.zeros(len(tree), dtype=bool)
    for branch in across_mm:
        while (branch := int(tree.parent[branch])) >= 0:
            holds_lap[branch] = True
    shares = occupancies(design, film_mm, packing, across_mm)
    return {branch: float(shares[branch]) for branch in np.flatnonzero(holds_lap).tolist()}


def passages_of(design: Design, pattern: Pattern | None) -> Floats:
    """Return the passage into each branch as its joint was simulated, else 1; shape (n,)."""
    parts, passages = design.tree.straight, np.ones(len(design.tree))
    for joint in pattern.joints if pattern else ():
        if joint.found is not None:
            children = parts.branch[np.isin(parts.parent, joint.rows)]
            np.minimum.at(passages, children, joint.found.passage)
    return passages


@design_rule(
    "VF-W01",
    broken="a level or pouch is too narrow to inflate",
    unit="mm",
    error=5.0,
    warning=8.0,
    reason="narrow tubes burst before they grow: 3 mm tubes did, 4 to 7 mm worked (published)",
    remedy="widen the level; with a width ratio, raise it or the trunk's width",
)
def check_least_width(subject: Subject, limits: Limits) -> RuleApplied:
    """Every branch is wide enough to inflate."""
    design, ends_mm = subject.design, subject.design.tree.end_width_mm
    kinds = subject.alike(ends_mm)
    violations = [
        broken.on_alike(
            subject,
            branches,
            f"tubes of {subject.words(branches)} may burst before they grow: widen them, or the "
            "whole robot",
        )
        for branches in kinds
        if (broken := limits.least(float(ends_mm[branches[0]])))
    ]
    more = outline_violations(subject, ProblemKind.VANISHED, known=tuple(violations))
    pouches: dict[float, list[int]] = {}
    for branch, pouch in enumerate(design.pouches):
        if pouch is not None and pouch.length_mm:
            pouches.setdefault(pouch.length_mm, []).append(branch)
    for length_mm, branches in pouches.items():
        if broken := limits.least(length_mm):
            message = "the pouch is too short along its branch to be inflated: lengthen it"
            more = (*more, broken.on_alike(subject, branches, message, aspect="pouch"))
    return RuleApplied(checked=len(kinds), violations=(*violations, *more))


@design_rule(
    "VF-W02",
    broken="a child is too wide for its parent",
    error=1.2,
    warning=1.5,
    reason="each level should be much wider than the next one, or it does not deploy (paper)",
    remedy="narrow the child's level or widen its parent's",
)
def check_width_ratio(subject: Subject, limits: Limits) -> RuleApplied:
    """Every parent is much wider than its children.

    An only child may be as wide: its tube continues.
    """
    tree = subject.design.tree
    ratios = tree.end_width_mm[tree.parent] / tree.width_mm
    alone = np.bincount(tree.parent[1:], minlength=len(tree))[tree.parent] == 1
    ratios[(tree.parent < 0) | (alone & (ratios == 1.0))] = np.inf
    kinds = [branches for branches in subject.alike(ratios) if branches != [0]]
    violations = [
        broken.on_alike(
            subject,
            branches,
            f"{subject.words(branches)} is nearly as wide as the level before it: narrow it, or "
            "widen that one"
            if subject.design.branches is None
            else f"too wide for the parent of {subject.words(branches)}: narrow it, or widen that",
        )
        for branches in kinds
        if (broken := limits.least(float(ratios[branches[0]])))
    ]
    more = outline_violations(subject, ProblemKind.CHILD_WIDTH, known=tuple(violations))
    return RuleApplied(checked=len(kinds), violations=(*violations, *more))


@design_rule(
    "VF-W03",
    broken="too much folded film rides in a branch",
    unit="%",
    error=60.0,
    warning=30.0,
    packing=0.1,
    reason="undeployed film rides inside the body and jams when it is packed (uncalibrated)",
    remedy="fewer, shorter or narrower descendants, smaller pouches, or a wider parent",
)
def check_packing(subject: Subject, limits: Limits) -> RuleApplied:
    """Folded film leaves room in every branch.

    What rides in a child comes through its joint. Where the joint was simulated, the cross-section
    there counts: that of the child's tube times the joint's passage.
    """
    profile = needed(subject.profile, "needs a recipe, for the film's thickness")
    film_mm = profile.material.film_mm
    tree, is_leaf = subject.design.tree, subject.design.tree.is_leaf
    shares = occupancies(subject.design, film_mm, limits["packing"])
    shares = 100.0 * shares / passages_of(subject.design, subject.pattern)
    filled, violations = 0, []
    for level in range(1, subject.design.depth + 1):
        rows = np.flatnonzero((tree.level == level) & (shares > 0.0))
        filled += len(rows) > 0
        fullest = float(shares[rows].max(initial=0.0))
        if broken := limits.most(fullest):
            # The fullest is named; marked are all that break the same limit.
            worst = rows[shares[rows] >= fullest * (1.0 - ROUNDING)].tolist()
            others = rows[(shares[rows] > broken.limit) & ~np.isin(rows, worst)].tolist()
            words = subject.words(worst)
            message = f"folded film may jam in {words}: fewer or narrower children, or widen it"
            if is_leaf[worst[0]]:
                it = "the level" if subject.design.branches is None else "the branch"
                message = f"folded pouches may jam in {words}: narrow them, or widen {it}"
            violations.append(broken.on_alike(subject, [*worst, *others], message))
    return RuleApplied(checked=filled, violations=tuple(violations))


def _cut(subject: Subject) -> tuple[Partition, LaserProfile, PieceSettings]:
    """Return the pieces of a robot, its recipe and the design's settings of pieces."""
    many = f"{counted(len(subject.names), 'branch')} are too many to look for the fewest pieces"
    settings = needed(
        subject.design.build.pieces, "one flat outline: the design has no build.pieces"
    )
    profile = needed(subject.profile, "needs a recipe, for the size of its sleeves")
    return needed(subject.partition, many), profile, settings


def _few(names: Sequence[str], most: int = 4) -> str:
    """Return the first of some names, with dots for the others."""
    return ", ".join(names[:most]) + (", ..." if len(names) > most else "")


@design_rule(
    "VF-J01",
    broken="no room for a sleeve where the robot must be cut",
    unit="mm",
    reason="plug and socket need a straight stretch, away from fillets, tips and pouches",
    remedy="lengthen the branch named, or shorten fillets, lap or pouch",
)
def check_sleeve_room(subject: Subject, _: Limits) -> RuleApplied:
    """Branches to be cut have room for a sleeve."""
    partition, violations = _cut(subject)[0], []
    for found in partition.unparted:
        names = _few(subject.called(*found.branches))
        message = f"{names} {found.why}, and cutting in pieces cannot help: "
        if found.between:
            between = _few(subject.called(*found.between))
            message += (
                f"no branch between them ({between}) has {found.needed_mm:.1f} mm of straight side "
                "for a sleeve: lengthen one, or shorten fillets, lap or pouch"
            )
        else:
            message += "no branch lies between them, or only ones whose stubs are in the way"
        violations.append(
            Violation(
                message=message,
                measured=found.room_mm,
                limit=found.needed_mm,
                branches=subject.ids(*found.branches)[:4],
                at_mm=branch_point_mm(subject.layout, found.branches[0], 0.5),
                marker=mark_branches(subject.layout, found.branches),
                aspect=found.why,
            )
        )
    checked = len(partition.sleeves) + len(violations)
    return RuleApplied(checked=checked, violations=tuple(violations))


@design_rule(
    "VF-J02",
    broken="the robot needs too many pieces",
    reason="each joint is one more place to leak and some minutes of work",
    remedy="allow more pieces, or change what makes branches overlap",
)
def check_piece_count(subject: Subject, _: Limits) -> RuleApplied:
    """The robot goes in as few pieces as allowed."""
    partition, _profile, settings = _cut(subject)
    count = len(partition.pieces)
    least = "no fewer possible" if partition.proven_least else "fewer may be possible"
    if partition.unparted:
        return RuleApplied(checked=count, note="cannot be cut in pieces that lie flat")
    if count <= settings.most and not partition.unfinished:
        return RuleApplied(checked=count, note=f"{counted(count, 'piece')}, {least}")
    many = f"at least {count}" if partition.unfinished else f"{count}"
    message = (
        f"{many} pieces are needed to lie flat ({least}): set build.pieces.most to {count} or "
        "more, or have fewer or shorter branches"
    )
    violation = Violation(message=message, measured=float(count), limit=float(settings.most))
    return RuleApplied(checked=count, violations=(violation,))


@design_rule(
    "VF-J03",
    broken="a lap is too weak or too short",
    unit="N/mm",
    safety_factor=1.5,
    reason="the pressure pulls a sleeve apart with P w / (2 pi) per millimetre of its rim; only "
    "laps that failed in a test forbid, what they bore is a lower bound",
    remedy="a lower working pressure or a narrower branch at the joint; burst lap coupons",
)
def check_laps(subject: Subject, limits: Limits) -> RuleApplied:
    """Laps bear the working pressure."""
    partition, profile, pieces = _cut(subject)
    sleeves, recipe = partition.sleeves, profile.recipe
    if not sleeves:
        return RuleApplied(checked=0)
    reason = f"recipe {recipe.name} has no table [lap]: nothing is known of the bond of sleeves"
    bond = needed(recipe.lap, f"{reason}; burst lap coupons and calibrate it")
    limit_n_mm = bond.load_n_per_mm.value / limits["safety_factor"]
    severity = Severity.ERROR if bond.is_measured_limit else Severity.WARNING
    bears, violations = Limits({severity.value: limit_n_mm}), []
    for sleeve in sleeves:
        row = sleeve.branch
        load_n_mm = lap_load_n_mm(subject.design.build.pressure_kpa, sleeve.width_mm)
        if broken := bears.most(load_n_mm):
            message = (
                f"the lap of plug {sleeve.label}, {sleeve.width_mm:.1f} mm wide, may be loaded "
                f"with {limit_n_mm:.3f} N per mm of rim with safety ({bond.words()}): lower the "
                "pressure or narrow the branch"
                f"{'' if bond.is_measured_limit else ', or burst lap coupons'}"
            )
            share = sleeve.outer_from_mm / float(subject.layout.tree.length_mm[row])
            violations.append(broken.on(subject, [row], message, at=share))
    if pieces.lap_mm < bond.band_mm.value:
        rows = [sleeve.branch for sleeve in sleeves]
        violations.append(
            Violation(
                message=f"a band of {bond.band_mm.value:g} mm, that of the recipe, has no room on "
                f"laps of {pieces.lap_mm:g} mm: lengthen them ([build] pieces.lap_mm)",
                severity=Severity.WARNING,
                branches=subject.ids(*rows),
                aspect="band",
                title="a lap is too short for its band",
            )
        )
    return RuleApplied(checked=len(sleeves), violations=tuple(violations))


@design_rule(
    "VF-J06",
    broken="sockets are too narrow or too wide for their plugs",
    unit="mm",
    films=1.0,
    rooms=2.0,
    reason="flat, a plug is as thick as all plies, and as much wider must a socket be; half the "
    "ease is gathered on each side within the room that the lap leaves to its band, at 45 degrees "
    "at most, or folds lead out of the lap (assumed)",
    remedy="an ease between the film's thickness and the lap less the band's width",
)
def check_ease(subject: Subject, limits: Limits) -> RuleApplied:
    """Sockets fit their plugs."""
    partition, profile, pieces = _cut(subject)
    bond, film_mm = profile.recipe.lap, profile.material.film_mm
    room_mm = max(0.0, pieces.lap_mm - (bond.band_mm.value if bond else 0.0)) / 2.0
    least_mm, most_mm = limits["films"] * film_mm, limits["rooms"] * room_mm
    tight = Limits({"error": least_mm}).least(pieces.ease_mm)
    loose = Limits({"warning": most_mm}).most(pieces.ease_mm)
    broken = (tight or loose) if partition.sleeves else None
    if broken is None:
        return RuleApplied(checked=len(partition.sleeves))
    message = (
        f"the film is {film_mm:g} mm thick, and a plug as thick does not go in: widen the sockets"
        if tight
        else f"the lap has {room_mm:g} mm next to its band on each side, where a socket must be"
        " gathered onto its plug: lessen the ease, or lengthen the lap"
    )
    violation = replace(
        broken,
        message=f"{message} ([build] pieces.ease_mm)",
        branches=subject.ids(*(sleeve.branch for sleeve in partition.sleeves)),
    )
    return RuleApplied(checked=len(partition.sleeves), violations=(violation,))


def fullest_laps(
    design: Design,
    sleeves: Iterable[Sleeve],
    film_mm: float,
    packing: float,
    passages: Floats,
) -> dict[int, tuple[int, float]]:
    """Return, for each level that laps ride in, its fullest branch and how much is filled.

    The branch is the row of its last straight part in the layout. What rides in a child comes
    through the passage of its joint, shape (n,) for all branches.
    """
    level, fullest = design.tree.level, dict[int, tuple[int, float]]()
    last = design.tree.straight.last_parts
    for branch, found in lap_occupancies(design, sleeves, film_mm, packing).items():
        at = int(level[branch])
        share = found / float(passages[branch])
        if share > fullest.get(at, (-1, 0.0))[1]:
            fullest[at] = int(last[branch]), share
    return fullest


def widest_cut_mm(build: Build, profile: LaserProfile, changed: LimitChanges) -> float:
    """Return the widest branch whose sleeve keeps VF-J03 and VF-J06; 0 if there is none."""
    least_mm = check_ease.limits_under(changed)["films"] * profile.material.film_mm
    if Limits({"error": least_mm}).least((build.pieces or PieceSettings()).ease_mm):
        return 0.0
    bond, load = profile.recipe.lap, lap_load_n_mm(build.pressure_kpa, 1.0)
    if bond is None or not bond.is_measured_limit or load == 0.0:
        return math.inf
    factor = check_laps.limits_under(changed)["safety_factor"]
    return (1.0 + ROUNDING) * bond.load_n_per_mm.value / factor / load


@design_rule(
    "VF-J04",
    broken="too much folded film and laps ride in a branch",
    unit="%",
    error=60.0,
    warning=30.0,
    packing=0.1,
    reason="the film of a lap is doubled and rides inside the body like all of it (uncalibrated)",
    remedy="fewer laps in one branch, shorter laps, or a wider parent",
)
def check_lap_packing(subject: Subject, limits: Limits) -> RuleApplied:
    """Folded film leaves room where laps double it.

    As for VF-W03, what rides in a child comes through its joint's passage, where that is known.
    """
    partition, profile, _ = _cut(subject)
    fullest = fullest_laps(
        subject.design,
        partition.sleeves,
        profile.material.film_mm,
        limits["packing"],
        passages_of(subject.design, subject.pattern),
    )
    message = (
        "folded film may jam here, doubled by laps: fewer or narrower children, fewer cuts below, "
        "or a wider branch"
    )
    violations = [
        broken.on(subject, [branch], message)
        for branch, share in fullest.values()
        if (broken := limits.most(100.0 * share))
    ]
    return RuleApplied(checked=len(fullest), violations=tuple(violations))


@design_rule(
    "VF-J05",
    broken="labels of pieces or joints are missing",
    on={Scope.SHEET, Scope.PATHS},
    reason="pieces look alike, and a mirrored branch joined the wrong way up cannot be undone",
    remedy="more room next to the piece, or mark it by hand before it leaves the bed",
)
def check_piece_labels(subject: Subject, _: Limits) -> RuleApplied:
    """Every piece, plug and socket is labelled."""
    partition, job = (
        _cut(subject)[0],
        needed(subject.job, "needs a recipe, which the marks follow from"),
    )
    if len(partition.pieces) == 1:
        return RuleApplied(checked=0)
    design = subject.design.name
    wanted = [piece_mark(piece_name(design, piece.label)) for piece in partition.pieces]
    for sleeve in partition.sleeves:
        wanted.append(joint_mark(SOCKET, sleeve.label, piece_name(design, sleeve.socket_on)))
        wanted.append(joint_mark(PLUG, sleeve.label, piece_name(design, sleeve.plug_on)))
    made = {path.label.split(", part ")[0] for path in job.along(Operation.MARK)}
    missing = [label for label in wanted if label not in made]
    if not missing:
        return RuleApplied(checked=len(wanted))
    violation = Violation(
        message=f"{counted(len(missing), 'label')} {agreeing(len(missing), 'is', 'are')} missing "
        f"on the film ({_few(missing)}): write them by hand, "
        "after assembly.svg, before a piece is lifted out",
        severity=Severity.WARNING,
        measured=float(len(missing)),
        limit=0.0,
    )
    return RuleApplied(checked=len(wanted), violations=(violation,))
