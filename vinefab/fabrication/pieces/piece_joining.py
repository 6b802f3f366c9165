"""In which order the pieces of a robot are joined, and how the release strip of each joint leaves.

Outermost joints first. A strip keeps the two plies of a plug apart while the lap over it is sealed,
and is drawn out through the open base of the same piece: it passes no joint that is already made.
Once all plugs of a piece are taken, its base is its only opening, so each part of the robot can be
tested before it is joined to the next. The piece with the tail comes last.
"""

from dataclasses import dataclass

from vinefab.model.design import Design
from vinefab.model.pieces import Partition, Sleeve
from vinefab.model.tree import branch_tree

STRIP_HANDLE_MM = 50.0
"""How far a release strip hangs out of the base of its piece (assumed)."""

MINUTES_PER_JOINT = 8.0
"""Time to lay, seal and inspect one joint (assumed: nobody has timed one)."""

TEST_SHARE = 0.25
"""Pressure of the first test for leaks over the working pressure (assumed)."""


@dataclass(frozen=True, slots=True, kw_only=True)
class JoiningStep:
    """One joint, in the order of work."""

    number: int  # from 1
    sleeve: Sleeve
    branch: str  # id of the branch that it lies on
    way_mm: float  # from the plug's rim inside its piece to the piece's open base
    joined: tuple[str, ...]  # labels of all pieces that hang together after it
    is_last_of_inner: bool  # whether it takes the last plug of its inner piece

    @property
    def strip_mm(self) -> float:
        """Length of the release strip with its pull tape."""
        return self.way_mm + STRIP_HANDLE_MM


def joining_order(design: Design, partition: Partition) -> tuple[JoiningStep, ...]:
    """Return every joint once; a piece is complete before it is joined to its inner one."""
    outer: dict[str, list[Sleeve]] = {piece.label: [] for piece in partition.pieces}
    for sleeve in partition.sleeves:
        outer[sleeve.inner].append(sleeve)
    ways, ids = _ways_mm(design, partition), branch_tree(design).ids
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
                    joined=tuple(held[label]),
                    is_last_of_inner=sleeve is outer[label][-1],
                )
            )

    complete(partition.pieces[0].label)
    return tuple(steps)


def _ways_mm(design: Design, partition: Partition) -> dict[str, float]:
    """Return by joint how far its plug's rim is from the open base of the plug's piece."""
    tree, build = branch_tree(design), design.build
    roots = {piece.label: piece.root for piece in partition.pieces}
    # What a piece lacks of its first branch; the first piece has the tail besides.
    cut_mm = {sleeve.label: sleeve.socket_mm for sleeve in partition.sleeves}
    ways = {}
    for sleeve in partition.sleeves:
        way = sleeve.plug_mm - cut_mm.get(sleeve.inner, -build.tail_mm)
        branch = sleeve.branch
        while branch != roots[sleeve.inner]:
            branch = int(tree.parent[branch])
            way += float(tree.length_mm[branch])
        ways[sleeve.label] = way
    return ways
