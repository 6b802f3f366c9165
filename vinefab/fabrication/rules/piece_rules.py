"""Rules about robots in pieces: their number, room for their sleeves, labels."""

from collections.abc import Iterator

from vinefab.fabrication.job.piece_marks import PLUG, SOCKET, joint_mark, piece_mark
from vinefab.fabrication.job.placement import piece_name
from vinefab.fabrication.rules.rule import (
    Limits,
    Rule,
    RuleApplied,
    RuleNotApplicable,
    Violation,
    branch_middle_mm,
    mark_branches,
)
from vinefab.fabrication.rules.subject import Subject
from vinefab.model.finding import Severity
from vinefab.model.job import Operation
from vinefab.model.pieces import Unparted


def _no_partition(subject: Subject) -> RuleNotApplicable:
    """Return why a robot is not looked at in pieces."""
    if subject.design.build.pieces is None:
        return RuleNotApplicable(reason="one flat outline: the design has no build.pieces")
    if subject.profile is None:
        return RuleNotApplicable(reason="needs a recipe, for the size of its sleeves")
    return RuleNotApplicable(
        reason=f"{len(subject.names)} branches are too many to look for the fewest pieces"
    )


_MOST_NAMED = 4


def check_sleeve_room(subject: Subject, _: Limits) -> RuleApplied | RuleNotApplicable:
    """VF-J01: where a robot must be parted, a branch has room for a sleeve."""
    partition = subject.partition
    if partition is None:
        return _no_partition(subject)
    violations = tuple(_unparted(subject, one) for one in partition.unparted)
    return RuleApplied(checked=len(partition.sleeves) + len(violations), violations=violations)


def _unparted(subject: Subject, found: Unparted) -> Violation:
    named = found.branches[:_MOST_NAMED]
    names = ", ".join(subject.ids(*named)) + (", ..." if len(found.branches) > len(named) else "")
    message = f"{names} {found.why}, and cutting in pieces cannot help: "
    if found.between:
        between = ", ".join(subject.ids(*found.between[:_MOST_NAMED]))
        message += (
            f"no branch between them ({between}) has {found.needed_mm:.1f} mm of straight side for "
            "a sleeve: lengthen one, or shorten fillets, lap or pouch"
        )
    else:
        message += "no branch lies between them, or only ones whose stubs are in the way"
    return Violation(
        message=message,
        measured=found.room_mm,
        limit=found.needed_mm,
        branches=subject.ids(*named),
        at_mm=branch_middle_mm(subject.layout, found.branches[0]),
        marker=mark_branches(subject.layout, found.branches),
        aspect=found.why,
    )


def check_piece_count(subject: Subject, _: Limits) -> RuleApplied | RuleNotApplicable:
    """VF-J02: a robot needs no more pieces than its design allows."""
    partition, settings = subject.partition, subject.design.build.pieces
    if partition is None or settings is None:
        return _no_partition(subject)
    count = len(partition.pieces)
    least = "no fewer possible" if partition.proven_least else "fewer may be possible"
    if partition.unparted:
        return RuleApplied(checked=count, note="cannot be cut in pieces that lie flat")
    if count <= settings.most:
        return RuleApplied(checked=count, note=f"{count} piece{'s' * (count > 1)}, {least}")
    message = (
        f"it takes {count} pieces to lie flat ({least}): set build.pieces.most to {count}, or have "
        "fewer or shorter branches"
    )
    violation = Violation(message=message, measured=float(count), limit=float(settings.most))
    return RuleApplied(checked=count, violations=(violation,))


def check_piece_labels(subject: Subject, _: Limits) -> RuleApplied | RuleNotApplicable:
    """VF-J05: every piece and both ends of every joint are labelled beside them."""
    partition, job, profile = subject.partition, subject.job, subject.profile
    if partition is None:
        return _no_partition(subject)
    if job is None or profile is None:
        return RuleNotApplicable(reason="needs a recipe, which the marks follow from")
    if len(partition.pieces) == 1:
        return RuleApplied(checked=0)
    wanted = list(_wanted(subject))
    made = {path.label.split(", part ")[0] for path in job.along(Operation.MARK)}
    missing = [label for label in wanted if label not in made]
    if not missing:
        return RuleApplied(checked=len(wanted))
    few = ", ".join(missing[:_MOST_NAMED]) + (", ..." if len(missing) > _MOST_NAMED else "")
    violation = Violation(
        message=f"{len(missing)} labels are missing on the film ({few}): write them by hand, "
        "after assembly.svg, before a piece is lifted out",
        severity=Severity.WARNING,
        measured=float(len(missing)),
        limit=0.0,
    )
    return RuleApplied(checked=len(wanted), violations=(violation,))


def _wanted(subject: Subject) -> Iterator[str]:
    """Yield the names of all labels that a robot in pieces needs."""
    partition, design = subject.partition, subject.design.name
    if partition is None:
        return
    for piece in partition.pieces:
        yield piece_mark(piece_name(design, piece.label))
    for sleeve in partition.sleeves:
        yield joint_mark(SOCKET, sleeve.label, piece_name(design, sleeve.label))
        yield joint_mark(PLUG, sleeve.label, piece_name(design, sleeve.inner))


SLEEVE_ROOM = Rule(
    id="VF-J01",
    title="room for a sleeve where the robot must be parted",
    unit="mm",
    reason="plug and socket need a straight stretch, away from fillets, tips and pouches",
    check=check_sleeve_room,
)
PIECE_COUNT = Rule(
    id="VF-J02",
    title="number of pieces",
    reason="each joint is one more place to leak and some minutes of work",
    check=check_piece_count,
)
PIECE_LABELS = Rule(
    id="VF-J05",
    title="a label beside every piece, plug and socket",
    reason="pieces look alike, and a mirrored branch joined the wrong way up cannot be undone",
    check=check_piece_labels,
)
