"""How the pieces of a robot are joined: the order, and the means at each joint.

Outermost joints first. A strip keeps the two plies of a plug apart while the lap around it is
sealed, and is drawn out through the stub and the open base of the stub's piece: it passes no joint
that is already made. Once all stubs of a piece are taken, its base is its only opening, so each
part of the robot can be tested before it is joined to the next. The piece with the tail comes last.
"""

from collections.abc import Collection
from dataclasses import dataclass

from vinefab.model.design import Build, Design
from vinefab.model.laser import LapMethod, LaserProfile
from vinefab.model.tree import Partition, Sleeve

STRIP_HANDLE_MM = 50.0
"""How far a release strip hangs out of the base of its piece (assumed)."""

TRIM_MM = 2.0
"""Most that is trimmed off a rim whose plies are fused (assumed)."""

MINUTES_PER_JOINT = 8.0
"""Time to lay, seal and inspect one joint (assumed: none has been timed)."""

TEST_SHARE = 0.25
"""Pressure of the first test for leaks over the working pressure (assumed)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JoiningStep:
    """One joint, in the order of work."""

    number: int  # from 1
    sleeve: Sleeve
    branch: str  # id of the branch that it lies on
    way_mm: float  # from the stub's rim inside its piece to the piece's base
    strip_leaves: bool  # whether that base is still open
    joined: tuple[str, ...]  # labels of all pieces that hang together after it
    is_last_of_inner: bool  # whether it takes the last stub of its inner piece

    @property
    def strip_mm(self) -> float:
        """Length of the release strip with its pull tape."""
        return self.way_mm + STRIP_HANDLE_MM


def joining_order(design: Design, partition: Partition) -> tuple[JoiningStep, ...]:
    """Return every joint once; a piece is complete before it is joined to its inner one."""
    outer: dict[str, list[Sleeve]] = {piece.label: [] for piece in partition.pieces}
    for sleeve in partition.sleeves:
        outer[sleeve.inner].append(sleeve)
    ways, ids = _ways_mm(design, partition), design.tree.straight.ids
    held = {label: [label] for label in outer}
    steps: list[JoiningStep] = []

    def complete(label: str) -> None:
        for sleeve in outer[label]:
            complete(sleeve.label)
        for sleeve in outer[label]:
            held[label] += held[sleeve.label]
            steps.append(
                JoiningStep(
                    number=len(steps) + 1,
                    sleeve=sleeve,
                    branch=ids[sleeve.branch],
                    way_mm=ways[sleeve.label],
                    strip_leaves=sleeve.inner
                    in open_ends(partition, sleeve, {step.sleeve.label for step in steps}),
                    joined=tuple(held[label]),
                    is_last_of_inner=sleeve is outer[label][-1],
                )
            )

    complete(partition.pieces[0].label)
    return tuple(steps)


def open_ends(partition: Partition, sleeve: Sleeve, made: Collection[str]) -> set[str]:
    """Return by which open ends of its two pieces a joint's strip may leave, once it is sealed.

    An end is named by the joint that is to be made there; the mouth by the first piece, whose base
    it is.

    Parameters
    ----------
    made
        Labels of the joints that are made before.
    """
    own = sleeve.inner, sleeve.label
    stubs = {other.label for other in partition.sleeves if other.inner in own}
    return {sleeve.inner, *stubs} - {sleeve.label, *made}


def _ways_mm(design: Design, partition: Partition) -> dict[str, float]:
    """Return by joint how far its stub's rim is from the base of the stub's piece."""
    tree, build = design.tree.straight, design.build
    roots = {piece.label: piece.root for piece in partition.pieces}
    # What a piece lacks of its first branch; the first piece has the tail besides.
    cut_mm = {sleeve.label: sleeve.outer_from_mm for sleeve in partition.sleeves}
    ways = {}
    for sleeve in partition.sleeves:
        way = sleeve.stub_to_mm - cut_mm.get(sleeve.inner, -build.tail_mm)
        branch = sleeve.branch
        while branch != roots[sleeve.inner]:
            branch = int(tree.parent[branch])
            way += float(tree.length_mm[branch])
        ways[sleeve.label] = way
    return ways


def needs_strips(profile: LaserProfile) -> bool:
    """Whether the plies of a plug must be kept apart; so too where the recipe says nothing."""
    lap = profile.recipe.lap
    return lap is None or lap.method is LapMethod.IMPULSE_SEAL


def order_reasons(profile: LaserProfile) -> str:
    """Return the reasons to make the outermost joints first, as text."""
    strips = (
        " The release strip inside a plug is drawn out through the stub and the open base of the"
        " stub's piece, so it never has to pass a joint that is already made."
    )
    sealer = (
        " Small parts are also easier to lay into an impulse sealer, whose bars must reach across"
        " the lap: fold neighbouring branches out of the way."
    )
    tail = " The piece with the tail comes last: its strips leave through the mouth."
    by_strip = needs_strips(profile)
    return (
        f"Outermost joints first.{strips if by_strip else ''} When all stubs of a piece are taken,"
        " its base is its only opening: test that part for leaks before you go on."
        f"{sealer + tail if by_strip else ' The piece with the tail comes last.'}"
    )


def pieces_words(partition: Partition) -> str:
    """Return the number of a robot's pieces and the joints that hold them, without a full stop."""
    count = len(partition.sleeves)
    hold = f"{count} sleeve joints hold" if count > 1 else "a sleeve joint holds"
    into = (
        "the base of the outer piece, the plug, goes into the widened stub of the inner one, the"
        " socket"
        if partition.sleeves[0].socket_on_stub
        else "the widened base of the outer piece, the socket, goes over the stub of the inner one,"
        " the plug"
    )
    return f"The robot is in {len(partition.pieces)} flat pieces that {hold} together: {into}"


def widest_socket_mm(partition: Partition) -> float:
    """Return the lay-flat lumen width of the widest socket."""
    return max((one.width_mm + 2.0 * one.rise_mm for one in partition.sleeves), default=0.0)


def face_words(build: Build) -> str:
    """Return the face that ends outside, as a sentence without a full stop."""
    if build.mounting == "turned":
        return "Deployed, the face that lies outside as cut is outside again"
    return "Deployed, the face that lies inside as cut is outside"
