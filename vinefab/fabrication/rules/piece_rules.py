"""Rules about robots in pieces: their number, their sleeves, labels."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace

from vinefab.core.plain_text import agreeing, counted
from vinefab.fabrication.job.marks import PLUG, SOCKET, joint_mark, piece_mark
from vinefab.fabrication.job.placement import piece_name
from vinefab.fabrication.rules.rule import (
    ROUNDING,
    LimitChanges,
    Limits,
    Rule,
    RuleApplied,
    Violation,
    branch_point_mm,
    mark_branches,
    needed,
)
from vinefab.fabrication.rules.subject import Subject
from vinefab.fabrication.rules.tree_rules import lap_occupancies, passages_of
from vinefab.model.design import Build, Design, PieceSettings
from vinefab.model.finding import Severity
from vinefab.model.job import Operation
from vinefab.model.laser import LaserProfile
from vinefab.model.tree import Partition, Sleeve, branch_tree
from vinefab.physics.seam import lap_load_n_mm


def _cut(subject: Subject) -> tuple[Partition, LaserProfile, PieceSettings]:
    """Return the pieces of a robot, its recipe and the design's settings of pieces."""
    many = f"{counted(len(subject.names), 'branch')} are too many to look for the fewest pieces"
    settings = needed(
        subject.design.build.pieces, "one flat outline: the design has no build.pieces"
    )
    profile = needed(subject.profile, "needs a recipe, for the size of its sleeves")
    return needed(subject.partition, many), profile, settings


_MOST_NAMED = 4


def check_sleeve_room(subject: Subject, _: Limits) -> RuleApplied:
    """VF-J01: where a robot must be parted, a branch has room for a sleeve."""
    partition, violations = _cut(subject)[0], []
    for found in partition.unparted:
        named = found.branches[:_MOST_NAMED]
        names = ", ".join(subject.ids(*named))
        names += ", ..." if len(found.branches) > len(named) else ""
        message = f"{names} {found.why}, and cutting in pieces cannot help: "
        if found.between:
            between = ", ".join(subject.ids(*found.between[:_MOST_NAMED]))
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
                branches=subject.ids(*named),
                at_mm=branch_point_mm(subject.layout, found.branches[0], 0.5),
                marker=mark_branches(subject.layout, found.branches),
                aspect=found.why,
            )
        )
    checked = len(partition.sleeves) + len(violations)
    return RuleApplied(checked=checked, violations=tuple(violations))


def check_piece_count(subject: Subject, _: Limits) -> RuleApplied:
    """VF-J02: a robot needs no more pieces than its design allows."""
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


def check_laps(subject: Subject, limits: Limits) -> RuleApplied:
    """VF-J03: the laps of sleeves bear the working pressure with a safety factor."""
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


def check_ease(subject: Subject, limits: Limits) -> RuleApplied:
    """VF-J06: plugs go into their sockets, and these lie on them without steep folds."""
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
    passages: Mapping[int, float],
) -> dict[int, tuple[int, float]]:
    """Return, for each level that laps ride in, its fullest branch and how much is filled.

    What rides in a child comes through the passage of its joint; ``passages`` has them by level.
    """
    level, fullest = branch_tree(design).level, dict[int, tuple[int, float]]()
    for branch, found in lap_occupancies(design, sleeves, film_mm, packing).items():
        at = int(level[branch])
        share = found / passages.get(at, 1.0)
        if share > fullest.get(at, (-1, 0.0))[1]:
            fullest[at] = branch, share
    return fullest


def widest_cut_mm(build: Build, profile: LaserProfile, changed: LimitChanges) -> float:
    """Return the widest branch whose sleeve keeps VF-J03 and VF-J06; 0 if there is none."""
    least_mm = EASE.limits_with(changed.get(EASE.id, {}))["films"] * profile.material.film_mm
    if Limits({"error": least_mm}).least((build.pieces or PieceSettings()).ease_mm):
        return 0.0
    bond, load = profile.recipe.lap, lap_load_n_mm(build.pressure_kpa, 1.0)
    if bond is None or not bond.is_measured_limit or load == 0.0:
        return math.inf
    factor = LAP.limits_with(changed.get(LAP.id, {}))["safety_factor"]
    return (1.0 + ROUNDING) * bond.load_n_per_mm.value / factor / load


def check_lap_packing(subject: Subject, limits: Limits) -> RuleApplied:
    """VF-J04: folded film leaves room in the lumen that it rides in also where laps double it.

    As for VF-W03, what rides in a child comes through its joint's passage, where that is known.
    """
    partition, profile, _ = _cut(subject)
    fullest = fullest_laps(
        subject.design,
        partition.sleeves,
        profile.material.film_mm,
        limits["packing"],
        passages_of(subject.pattern),
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


def check_piece_labels(subject: Subject, _: Limits) -> RuleApplied:
    """VF-J05: every piece and both ends of every joint have labels next to them."""
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
    few = ", ".join(missing[:_MOST_NAMED]) + (", ..." if len(missing) > _MOST_NAMED else "")
    violation = Violation(
        message=f"{counted(len(missing), 'label')} {agreeing(len(missing), 'is', 'are')} missing "
        f"on the film ({few}): write them by hand, "
        "after assembly.svg, before a piece is lifted out",
        severity=Severity.WARNING,
        measured=float(len(missing)),
        limit=0.0,
    )
    return RuleApplied(checked=len(wanted), violations=(violation,))


SLEEVE_ROOM = Rule(
    id="VF-J01",
    title="branches to be cut have room for a sleeve",
    broken="no room for a sleeve where the robot must be cut",
    unit="mm",
    reason="plug and socket need a straight stretch, away from fillets, tips and pouches",
    remedy="lengthen the branch named, or shorten fillets, lap or pouch",
    check=check_sleeve_room,
)
PIECE_COUNT = Rule(
    id="VF-J02",
    title="the robot goes in as few pieces as allowed",
    broken="the robot needs too many pieces",
    reason="each joint is one more place to leak and some minutes of work",
    remedy="allow more pieces, or change what makes branches overlap",
    check=check_piece_count,
)
LAP = Rule(
    id="VF-J03",
    title="laps bear the working pressure",
    broken="a lap is too weak or too short",
    unit="N/mm",
    limits={"safety_factor": 1.5},
    reason="the pressure pulls a sleeve apart with P w / (2 pi) per millimetre of its rim; only "
    "laps that failed in a test forbid, what they bore is a lower bound",
    remedy="a lower working pressure or a narrower branch at the joint; burst lap coupons",
    check=check_laps,
)
LAP_PACKING = Rule(
    id="VF-J04",
    title="folded film leaves room where laps double it",
    broken="too much folded film and laps ride in a branch",
    unit="%",
    limits={"error": 60.0, "warning": 30.0, "packing": 0.1},
    reason="the film of a lap is doubled and rides inside the body like all of it (uncalibrated)",
    remedy="fewer laps in one branch, shorter laps, or a wider parent",
    check=check_lap_packing,
)
PIECE_LABELS = Rule(
    id="VF-J05",
    title="every piece, plug and socket is labelled",
    broken="labels of pieces or joints are missing",
    reason="pieces look alike, and a mirrored branch joined the wrong way up cannot be undone",
    remedy="more room next to the piece, or mark it by hand before it leaves the bed",
    check=check_piece_labels,
)
EASE = Rule(
    id="VF-J06",
    title="sockets fit their plugs",
    broken="sockets are too narrow or too wide for their plugs",
    unit="mm",
    limits={"films": 1.0, "rooms": 2.0},
    reason="flat, a plug is as thick as all plies, and as much wider must a socket be; half the "
    "ease is gathered on each side within the room that the lap leaves to its band, at 45 degrees "
    "at most, or folds lead out of the lap (assumed)",
    remedy="an ease between the film's thickness and the lap less the band's width",
    check=check_ease,
)
