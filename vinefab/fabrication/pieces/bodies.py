"""What may lie on a piece: whole branches, stubs and outer parts, one of them with a socket.

Each is measured by capsules, as whole robots are: ends that are flat in film count as round.
"""

import math
from collections.abc import Collection
from dataclasses import dataclass, replace
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from vinefab.core.validation import Floats
from vinefab.fabrication.job.sleeve import (
    BESIDE_MM,
    STRAIGHT_AFTER_MM,
    STRAIGHT_BEFORE_MM,
    SleeveSize,
)
from vinefab.fabrication.outline.exactness import OutlineParts, outline_parts
from vinefab.fabrication.outline.gap import taper_rad
from vinefab.fabrication.outline.layout import FlatLayout
from vinefab.fabrication.rules.spacing import Capsules, capsules_of
from vinefab.model.design import Build, Design
from vinefab.model.pieces import Sleeve


class BodyKind(IntEnum):
    """What of a branch a body is."""

    WHOLE = 0
    STUB = 1  # from the joint to the end of the lap, of a branch that is cut
    OUTER = 2  # from the lap on


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StraightSides:
    """Where both sides of each branch run straight, along its axis, n branches."""

    start_mm: Floats  # beyond the last fillet, shape (n,)
    end_mm: Floats  # before the branch's own joint, tip or pouch, shape (n,)

    def room_mm(self) -> Floats:
        """Return the length of each, shape (n,)."""
        return self.end_mm - self.start_mm


def straight_sides(
    design: Design, layout: FlatLayout, offsets_mm: tuple[float, ...]
) -> StraightSides:
    """Return where the sides of every branch are straight in outlines at all of some offsets."""
    tree = layout.tree
    starts, ends = np.zeros(len(tree)), np.zeros(len(tree))
    siblings, seen = [0] * len(tree), [0] * len(tree)
    for row, above in enumerate(tree.parent.tolist()):
        if above >= 0:
            siblings[row] = seen[above]
            seen[above] += 1
    half, far = layout.width_mm / 2.0, layout.end_width_mm / 2.0
    lean = np.array([taper_rad(*one) for one in zip(half, far, tree.length_mm, strict=True)])
    for offset in offsets_mm:
        pattern = outline_parts(design, offset)
        for row in range(len(tree)):
            level, sibling = int(tree.level[row]), siblings[row]
            base = _base_used_mm(pattern, level, sibling)
            tip = _end_used_mm(pattern, level, sibling)
            cos, sin = np.cos(lean[row]), np.sin(lean[row])
            side = tree.length_mm[row] * cos
            along = (half[row] + offset) * sin
            starts[row] = max(starts[row], base * cos + along)
            end = (side - tip) * cos + along
            ends[row] = end if offset == offsets_mm[0] else min(ends[row], end)
    return StraightSides(start_mm=starts, end_mm=ends)


def _base_used_mm(pattern: OutlineParts, level: int, sibling: int) -> float:
    """Return how much of a branch's sides the joint at its base takes."""
    if level == 1:
        return 0.0
    kinds = pattern.joints[level - 2]
    return max(
        max(joint.gaps[sibling].second_used_mm, joint.gaps[sibling + 1].first_used_mm)
        for joint in kinds
    )


def _end_used_mm(pattern: OutlineParts, level: int, sibling: int) -> float:
    """Return how much of a branch's sides the joint, tip or pouch at its end takes."""
    if level > len(pattern.joints):
        return pattern.tip(sibling).used_mm
    gaps = pattern.joint(level, sibling).gaps
    return max(gaps[0].first_used_mm, gaps[-1].second_used_mm)


def sleeves_of(layout: FlatLayout, sides: StraightSides, size: SleeveSize) -> dict[int, Sleeve]:
    """Return the sleeve that each branch with enough room would have, by index, without labels.

    The plug of a tapered branch is wider at its rim than farther out, where the socket's rim is on
    a stub: the socket is so much wider that the plug goes in.
    """
    found = {}
    for row in range(1, len(layout.tree)):
        half, far = layout.width_mm[row] / 2.0, layout.end_width_mm[row] / 2.0
        lean = taper_rad(float(half), float(far), float(layout.tree.length_mm[row]))
        narrows_mm = size.lap_mm * math.sin(lean) if size.socket_on_stub else 0.0
        own = replace(size, rise_mm=size.rise_mm + narrows_mm)
        begin, end = float(sides.start_mm[row]) + STRAIGHT_BEFORE_MM, float(sides.end_mm[row])
        if begin + own.lap_mm + own.blend_mm + STRAIGHT_AFTER_MM > end:
            continue
        first = begin + own.blend_mm if own.socket_on_stub else begin
        last = first + own.lap_mm
        found[row] = Sleeve(
            label="",
            inner="",
            branch=row,
            socket_mm=last if own.socket_on_stub else first,
            plug_mm=first if own.socket_on_stub else last,
            blend_end_mm=begin if own.socket_on_stub else last + own.blend_mm,
            rise_mm=own.rise_mm,
            width_mm=2.0 * _half_at_mm(layout, row, first),
        )
    return found


def beside_mm(size: SleeveSize, reach_mm: float) -> float:
    """Return how far outside the lumens cuts of stubs' ends run, with room between sockets."""
    return reach_mm + size.rise_mm + BESIDE_MM if size.socket_on_stub else reach_mm


def sleeve_sides(
    design: Design, layout: FlatLayout, size: SleeveSize, reach_mm: float
) -> StraightSides:
    """Return where a sleeve may lie on each branch, as far as its own joints are concerned.

    Sockets on stubs that share a joint part before they reach their full width.

    Parameters
    ----------
    reach_mm
        How far outside the lumen's edge the paths of the robot reach.
    """
    sides = straight_sides(design, layout, (0.0, reach_mm))
    wide = straight_sides(design, layout, (beside_mm(size, reach_mm),)).start_mm
    start = np.maximum(sides.start_mm, wide - STRAIGHT_BEFORE_MM - size.blend_mm)
    return replace(sides, start_mm=start)


def _half_at_mm(layout: FlatLayout, row: int, along_mm: float) -> float:
    """Return half the lay-flat width of a branch at a place along it."""
    share = along_mm / float(layout.tree.length_mm[row])
    return float((1.0 - share) * layout.width_mm[row] + share * layout.end_width_mm[row]) / 2.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bodies:
    """All bodies that may lie on a piece, as capsules."""

    capsules: Capsules  # m of them
    kind: NDArray[np.int64]  # `BodyKind` of each capsule, shape (m,)

    def of(self, chosen: NDArray[np.bool_]) -> Capsules:
        """Return some of the capsules, shape (m,) of booleans."""
        every = self.capsules
        return Capsules(
            start_mm=every.start_mm[chosen],
            end_mm=every.end_mm[chosen],
            half_mm=every.half_mm[chosen],
            end_half_mm=every.end_half_mm[chosen],
            branch=every.branch[chosen],
            pouch=every.pouch[chosen],
            parent=every.parent,
        )


def bodies_of(layout: FlatLayout, build: Build, sleeves: dict[int, Sleeve]) -> Bodies:
    """Return every body of a robot: whole branches, and both parts of those that may be cut.

    After the capsules of the flat robot come those of stubs, of outer parts and of sockets, each in
    the order of their branches.
    """
    whole = capsules_of(layout, build)
    rows = np.array(sorted(sleeves), dtype=np.int64)
    along = np.column_stack([np.cos(layout.heading_rad[rows]), np.sin(layout.heading_rad[rows])])
    base = layout.start_mm[rows]

    def place(name: str) -> tuple[Floats, Floats]:
        mm = np.array([getattr(sleeves[row], name) for row in rows.tolist()])
        halves = [_half_at_mm(layout, row, at) for row, at in zip(rows.tolist(), mm, strict=True)]
        return base + mm[:, None] * along, np.array(halves)

    (outer, outer_half), (stub, stub_half), (rim, rim_half), (blend, blend_half) = map(
        place, ("outer_from_mm", "stub_to_mm", "socket_mm", "blend_end_mm")
    )
    rise = np.array([sleeves[row].rise_mm for row in rows.tolist()])
    on_stub = any(sleeve.socket_on_stub for sleeve in sleeves.values())
    pouches = np.flatnonzero(whole.pouch & np.isin(whole.branch, rows))
    groups = [
        (BodyKind.STUB, base, stub, layout.width_mm[rows] / 2.0, stub_half, rows),
        (
            BodyKind.OUTER,
            outer,
            layout.end_mm[rows],
            outer_half,
            layout.end_width_mm[rows] / 2.0,
            rows,
        ),
        (
            BodyKind.STUB if on_stub else BodyKind.OUTER,
            rim,
            blend,
            rim_half + rise,
            blend_half + rise,
            rows,
        ),
        (
            BodyKind.OUTER,
            whole.start_mm[pouches],
            whole.end_mm[pouches],
            whole.half_mm[pouches],
            whole.end_half_mm[pouches],
            whole.branch[pouches],
        ),
    ]
    kinds = [np.full(len(whole), BodyKind.WHOLE), *(np.full(len(g[1]), g[0]) for g in groups)]
    is_pouch = [whole.pouch, *(np.zeros(len(rows), dtype=np.bool_) for _ in groups[:-1])]
    is_pouch.append(np.ones(len(pouches), dtype=np.bool_))
    capsules = Capsules(
        start_mm=np.concatenate([whole.start_mm, *(g[1] for g in groups)]),
        end_mm=np.concatenate([whole.end_mm, *(g[2] for g in groups)]),
        half_mm=np.concatenate([whole.half_mm, *(g[3] for g in groups)]),
        end_half_mm=np.concatenate([whole.end_half_mm, *(g[4] for g in groups)]),
        branch=np.concatenate([whole.branch, *(g[5] for g in groups)]),
        pouch=np.concatenate(is_pouch),
        parent=whole.parent,
    )
    return Bodies(capsules=capsules, kind=np.concatenate(kinds).astype(np.int64))


_TURNS = 361
"""Rotations of the bed that are tried, over half a turn."""


class Reaches:
    """How far branches reach in every direction: whether some of them can share a bed."""

    def __init__(self, bodies: Bodies, branches: int, room_mm: tuple[float, float]) -> None:
        turns = np.linspace(0.0, np.pi, _TURNS)
        self.step_rad = float(turns[1])
        across = np.stack([np.cos(turns), np.sin(turns)])
        along = np.stack([-np.sin(turns), np.cos(turns)])
        self.room_mm = np.array(room_mm)
        # Both ways of each axis, by branch: of whole ones, and of outer parts without sockets.
        self.whole_mm = np.full((branches, 4, _TURNS), -np.inf)
        self.outer_mm = np.full((branches, 4, _TURNS), -np.inf)
        axes = np.stack([across, -across, along, -along])
        capsules, seen = bodies.capsules, set[int]()
        for row, (branch, kind) in enumerate(
            zip(capsules.branch.tolist(), bodies.kind.tolist(), strict=True)
        ):
            if kind == BodyKind.STUB:
                continue
            far = np.maximum(
                np.tensordot(axes, capsules.start_mm[row], (1, 0)) + capsules.half_mm[row],
                np.tensordot(axes, capsules.end_mm[row], (1, 0)) + capsules.end_half_mm[row],
            )
            into = self.whole_mm if kind == BodyKind.WHOLE else self.outer_mm
            if kind == BodyKind.OUTER and branch in seen and not capsules.pouch[row]:
                continue  # the socket: a branch that is not cut has none
            seen |= {branch} if kind == BodyKind.OUTER else set()
            np.maximum(into[branch], far, out=into[branch])

    def exceed(self, rows: Collection[int]) -> bool:
        """Whether branches fit no bed together, of the first of them only its outer part.

        Between the rotations tried a size changes by no more than the diameter times half a step.
        """
        order = sorted(rows)
        far = self.whole_mm[order].max(axis=0)
        if order[0]:
            first = self.outer_mm[order[0]]
            far = np.maximum(first, self.whole_mm[order[1:]].max(axis=0)) if order[1:] else first
        wide, high = far[0] + far[1], far[2] + far[3]
        slack_mm = float(np.hypot(wide, high).max()) * self.step_rad / 2.0
        over = np.minimum(
            np.maximum(wide - self.room_mm[0], high - self.room_mm[1]),
            np.maximum(wide - self.room_mm[1], high - self.room_mm[0]),
        )
        return bool(over.min() > slack_mm)
