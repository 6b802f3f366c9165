"""A robot in the fewest flat pieces that pass every rule about room on the sheet.

On a piece lie whole branches, stubs and outer parts, one of them with a socket. Each is measured by
capsules, as whole robots are: ends that are flat in film count as round.
"""

import math
import os
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from enum import IntEnum
from pathlib import Path

import numpy as np
import scipy  # its parts load at their first use
from numpy.typing import NDArray

from vinefab.core.hashing import fingerprint
from vinefab.core.validation import Floats
from vinefab.fabrication.job.passes import (
    BESIDE_MM,
    STRAIGHT_AFTER_MM,
    STRAIGHT_BEFORE_MM,
    SleeveSize,
    body_paths,
    piece_ends,
    reach_mm,
    sleeve_size,
)
from vinefab.fabrication.job.placement import place_contours
from vinefab.fabrication.rules.catalog import by_rule, changed_limits, rules_on, run_checks
from vinefab.fabrication.rules.clearance_rules import (
    check_clearance,
    check_overlap,
    check_pouch,
    least_gap_mm,
)
from vinefab.fabrication.rules.rule import ROUNDING, LimitChanges, Scope, Subject
from vinefab.fabrication.rules.spacing import Capsules, capsules_of, spacing
from vinefab.fabrication.rules.tree_rules import (
    check_lap_packing,
    fullest_laps,
    passages_of,
    widest_cut_mm,
)
from vinefab.inflation.pattern import Pattern
from vinefab.model.design import Build, Design, PieceSettings
from vinefab.model.laser import LaserProfile
from vinefab.model.tree import Partition, Piece, Sleeve, Unparted, piece_label
from vinefab.outline.body_outline import (
    FlatLayout,
    PieceEnds,
    body_outline,
    outline_parts,
)
from vinefab.outline.joint import taper_rad


@dataclass(frozen=True, slots=True)
class Clause:
    """One of some branches is cut, or one of others is not."""

    cut: frozenset[int]
    uncut: frozenset[int] = frozenset()

    @property
    def literals(self) -> frozenset[tuple[int, bool]]:
        """Branches, each with whether it is to be cut."""
        return frozenset(
            {*((row, True) for row in self.cut), *((row, False) for row in self.uncut)}
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Multicut:
    """The branches to cut."""

    cut: tuple[int, ...]  # ascending
    proven_least: bool
    broken: tuple[int, ...] = ()  # places of clauses that no cut can keep; then nothing is cut


def multicut(clauses: Sequence[Clause], weights: Mapping[int, float]) -> Multicut:
    """Return the fewest branches whose cutting keeps all clauses, of least total weight.

    Parameters
    ----------
    weights
        Branches that can be cut, each with its weight.
    """
    kept = [possible(clause, weights.keys()) for clause in clauses]
    hopeless = tuple(place for place, clause in enumerate(kept) if clause == _NEVER)
    if hopeless:
        return Multicut(cut=(), proven_least=True, broken=hopeless)
    needed = simplified(clause for clause in kept if clause is not None)
    if not needed:
        return Multicut(cut=(), proven_least=True)
    if _NEVER not in needed:
        rows = sorted({row for clause in needed for row in (*clause.cut, *clause.uncut)})
        heaviest = 1.0 + 2.0 * sum(weights[row] for row in rows)
        # One more cut always outweighs all differences of weight.
        costs = np.array([1.0 + weights[row] / heaviest for row in rows])
        result = _program(needed, rows, costs, slack=False)
        if result.x is not None:
            chosen = tuple(row for row, value in zip(rows, result.x, strict=True) if value > 0.5)
            return Multicut(cut=chosen, proven_least=result.status == 0)
    # No cut keeps all: as few clauses as possible are broken.
    asked = [(place, clause) for place, clause in enumerate(kept) if clause is not None]
    rows = sorted(weights)
    result = _program([clause for _, clause in asked], rows, np.zeros(len(rows)), slack=True)
    loose = [True] * len(asked) if result.x is None else (result.x[len(rows) :] > 0.5).tolist()
    broken = tuple(place for (place, _), lost in zip(asked, loose, strict=True) if lost)
    return Multicut(cut=(), proven_least=True, broken=broken)


_NEVER = Clause(frozenset())


def possible(clause: Clause, cuttable: Iterable[int]) -> Clause | None:
    """Return the rest of a clause if only some branches can be cut; None if it always holds."""
    can = frozenset(cuttable)
    if not clause.uncut <= can or clause.cut & clause.uncut:
        return None
    return Clause(clause.cut & can, clause.uncut)


def simplified(clauses: Iterable[Clause]) -> list[Clause]:
    """Return clauses that say the same, fewer of them.

    Two that differ in one branch alone, cut or uncut, say that it does not matter; a clause that
    another one implies says nothing more. An empty clause alone is left where they contradict.
    """
    left = set(clauses)
    for clause in sorted(left, key=_order):
        for row in sorted(clause.uncut):
            twin = Clause(clause.cut | {row}, clause.uncut - {row})
            # One branch that must and must not be cut is for the program to find.
            if len(clause.literals) > 1 and clause in left and twin in left:
                left -= {clause, twin}
                left.add(Clause(clause.cut, clause.uncut - {row}))
    if _NEVER in left:
        return [_NEVER]
    watched: dict[tuple[int, bool], list[frozenset[tuple[int, bool]]]] = defaultdict(list)
    kept = []
    for clause in sorted(left, key=_order):
        literals = clause.literals
        if any(one <= literals for literal in literals for one in watched[literal]):
            continue
        kept.append(clause)
        rarest = min(literals, key=lambda literal: (len(watched[literal]), literal))
        watched[rarest].append(literals)
    return kept


def _order(clause: Clause) -> tuple[int, list[int], list[int]]:
    return len(clause.cut) + len(clause.uncut), sorted(clause.cut), sorted(clause.uncut)


def _program(
    clauses: Sequence[Clause], rows: Sequence[int], costs: np.ndarray, *, slack: bool
) -> "scipy.optimize.OptimizeResult":
    """Solve for one variable per branch and, with slack, one per clause that may break."""
    place = {row: number for number, row in enumerate(rows)}
    entries = [
        (number, place[row], sign)
        for number, clause in enumerate(clauses)
        for sign, group in ((1.0, clause.cut), (-1.0, clause.uncut))
        for row in group
    ]
    height, column, value = (np.array(one) for one in zip(*entries, strict=True))
    matrix = scipy.sparse.csr_array((value, (height, column)), shape=(len(clauses), len(rows)))
    if slack:
        matrix = scipy.sparse.hstack([matrix, scipy.sparse.eye_array(len(clauses))], format="csr")
        costs = np.concatenate([costs, np.ones(len(clauses))])
    least = np.array([1.0 - len(clause.uncut) for clause in clauses])
    # Nodes of the search tree of one program; a count, not a time, so that results are the same.
    most_nodes = 20_000
    with _clean_output():
        return scipy.optimize.milp(
            costs,
            integrality=np.ones(len(costs), dtype=np.int64),
            bounds=scipy.optimize.Bounds(0.0, 1.0),
            constraints=scipy.optimize.LinearConstraint(matrix, lb=least),
            options={"node_limit": most_nodes, "mip_rel_gap": 0.0, "presolve": False},
        )


@contextmanager
def _clean_output() -> Iterator[None]:
    """Keep standard output clean of the lines that the solver prints past the switch of its log.

    They come with a few of the large programs, and would end up in ``--json -``.
    """
    try:
        kept = os.dup(1)
    except OSError:  # no standard output to keep clean
        yield
        return
    try:
        with Path(os.devnull).open("wb") as nowhere:
            os.dup2(nowhere.fileno(), 1)
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)


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
    half, far = layout.width_mm / 2.0, layout.end_width_mm / 2.0
    lean = np.array([taper_rad(*one) for one in zip(half, far, tree.length_mm, strict=True)])
    for offset in offsets_mm:
        pattern = outline_parts(design, offset)
        for row in range(len(tree)):
            base, tip = map(max, pattern.used_mm(row))
            cos, sin = np.cos(lean[row]), np.sin(lean[row])
            side = tree.length_mm[row] * cos
            along = (half[row] + offset) * sin
            starts[row] = max(starts[row], base * cos + along)
            end = (side - tip) * cos + along
            ends[row] = end if offset == offsets_mm[0] else min(ends[row], end)
    return StraightSides(start_mm=starts, end_mm=ends)


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
    """Return the distance of stub ends' cuts outside the lumens, with room between sockets."""
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


_ORDERS = 8
"""Orders in which branches are given up to find the least part that does not fit the bed."""

TOO_LARGE = "do not fit the bed in one piece"


def partition_of(
    design: Design,
    profile: LaserProfile,
    limits: LimitChanges | None = None,
    *,
    separate: bool = False,
    passages: Floats | None = None,
) -> Partition:
    """Return the fewest pieces of a design that lie flat; the whole robot where none are allowed.

    The number may exceed ``build.pieces.most``: rule VF-J02 reports that. Far beyond it, it is a
    lower bound, and the partition is unfinished.

    Parameters
    ----------
    limits
        Limits that override those of recipe and design.
    separate
        Whether the robot is welded and cut in two passes although the recipe has one for both.
    passages
        Into each branch, shape (n,), as far as they are known.

    Notes
    -----
    Branches are cut as the 0-1 program says in which every pair of bodies that come too near each
    other on one piece is a clause. The pieces are then outlined as they will be cut; what the rules
    still find there becomes a clause more, until they find nothing. Every clause holds for all
    partitions that pass, so the least number is proven if that of the last program is. Cuts whose
    laps would burst or overfill a lumen (VF-J03, VF-J04) are avoided where others serve, within the
    pieces that are allowed.
    """
    if design.build.pieces is None:
        return one_piece(design)
    cutter = _Cutter(design, design.build.pieces, profile, limits, separate=separate)
    return cutter.partition(np.ones(len(design.tree)) if passages is None else passages)


def pieces_of(
    pattern: Pattern,
    profile: LaserProfile,
    limits: LimitChanges | None = None,
    *,
    separate: bool = False,
) -> Partition:
    """Return the fewest pieces of a pattern, as `partition_of`."""
    if pattern.flat.build.pieces is None:
        return one_piece(pattern.flat)
    passages = passages_of(pattern.design, pattern)
    return partition_of(pattern.flat, profile, limits, separate=separate, passages=passages)


def one_piece(design: Design) -> Partition:
    """Return a robot in one piece."""
    branches = tuple(range(len(design.tree.straight)))
    return Partition(pieces=(Piece(label="A", root=0, branches=branches),))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Conflict:
    """What must not be on one piece."""

    why: str
    branches: tuple[int, ...]
    clause: Clause


class _Cutter:
    """The search for the pieces of one design."""

    def __init__(
        self,
        design: Design,
        settings: PieceSettings,
        profile: LaserProfile,
        limits: LimitChanges | None,
        *,
        separate: bool,
    ) -> None:
        self.design, self.profile, self.limits, self.separate = design, profile, limits, separate
        self.values = by_rule(changed_limits(design, profile, limits))
        self.most = settings.most
        self.size = sleeve_size(design.build, profile, separate=separate)
        self.subject = replace(Subject.of(design), profile=profile, separate=separate)
        layout = self.subject.layout
        self.parent: list[int] = layout.tree.parent.tolist()
        self.level: list[int] = layout.tree.level.tolist()
        reach = reach_mm(profile, separate=separate)
        self.sides: StraightSides = sleeve_sides(design, layout, self.size, reach)
        self.sleeves: dict[int, Sleeve] = sleeves_of(layout, self.sides, self.size)
        self.bodies: Bodies = bodies_of(layout, design.build, self.sleeves)
        self.reaches = Reaches(self.bodies, len(self.parent), profile.machine.usable_mm)
        self.known: dict[tuple[tuple[int, ...], ...], tuple[_Conflict, ...]] = {}
        self.waived = {waiver.fingerprint for waiver in design.waivers}

    def partition(self, passages: Floats) -> Partition:
        """Return the fewest pieces that pass."""
        conflicts, beyond = [*self._pairs()], 0
        flat: Partition | None = None  # the first whose pieces pass, whatever their laps
        weights = {row: sleeve.width_mm for row, sleeve in self.sleeves.items()}
        # The same once more pieces are needed than the design allows: then only the report gains.
        rounds_beyond = 8
        # Times that cuts are looked for again after a rule found something on a piece.
        most_rounds = 300
        for _ in range(most_rounds):
            found = multicut([conflict.clause for conflict in conflicts], weights)
            if found.broken:
                return flat or self._uncut(conflicts, found)
            cut = self._cut(found.cut, proven_least=found.proven_least)
            if flat is not None and len(cut.pieces) > self.most:
                return flat
            more = list[_Conflict]()
            for piece in cut.pieces:  # the same piece comes back in many partitions
                key = piece.branches, piece.stubs
                if key not in self.known:
                    self.known[key] = tuple(self._found_on(cut, piece))
                more += self.known[key]
            if not more:
                flat = flat or cut
                more = [*self._laps(cut, passages)]
                if not more:
                    return cut
            known = {conflict.clause for conflict in conflicts}
            beyond += len(cut.pieces) > self.most
            if beyond > rounds_beyond or all(one.clause in known for one in more):
                break
            conflicts += more
        return flat or replace(cut, unfinished=True)

    def _laps(self, cut: Partition, passages: Floats) -> Iterator[_Conflict]:
        """Yield the conflicts of a partition's sleeves: further cuts only add to them."""
        widest_mm = widest_cut_mm(self.design.build, self.profile, self.values)
        cuts = frozenset(sleeve.branch for sleeve in cut.sleeves)
        for sleeve in cut.sleeves:
            if sleeve.width_mm > widest_mm:
                alone = Clause(frozenset(), frozenset({sleeve.branch}))
                yield _Conflict(why="load its lap", branches=(sleeve.branch,), clause=alone)
        limits = check_lap_packing.limits_under(self.values)
        film_mm, packing = self.profile.material.film_mm, limits["packing"]
        fullest = fullest_laps(self.design, cut.sleeves, film_mm, packing, passages)
        for branch, share in fullest.values():
            if 100.0 * share > limits["error"] * (1.0 + ROUNDING):
                within = frozenset(row for row in cuts if branch in self._path(0, row) - {row})
                clause = Clause(frozenset(), within or cuts)
                yield _Conflict(why="overfill a lumen", branches=(branch,), clause=clause)

    # --- what must not be on one piece -----------------------------------------------------------

    def _pairs(self) -> Iterator[_Conflict]:
        """Yield every pair of bodies that come too near each other."""
        near_mm, pouch_mm = (
            least_gap_mm(rule, self.values, self.subject.taken_mm)
            for rule in (check_clearance, check_pouch)
        )
        capsules, kind = self.bodies.capsules, self.bodies.kind
        found = spacing(capsules, max(near_mm, pouch_mm, 0.0))
        one, two = capsules.branch[found.first], capsules.branch[found.second]
        parent = np.array(self.parent)
        own = found.joined & ((parent[one] == two) | (parent[two] == one))
        limit = np.where(found.joined, pouch_mm, near_mm)
        # How near a pouch may come to its own parent depends on fillets: the outline decides.
        rows = np.flatnonzero((found.gap_mm < np.maximum(limit, 0.0)) & ~own)
        ends = np.column_stack([one, kind[found.first], two, kind[found.second], found.joined])[
            rows
        ]
        depth = found.gap_mm[rows]
        order = np.lexsort((depth, *ends.T))
        _, first = np.unique(ends[order], axis=0, return_index=True)
        for row in order[first].tolist():
            a, kind_a, b, kind_b, joined = ends[row].tolist()
            rule = check_pouch if joined else check_overlap if depth[row] < 0.0 else check_clearance
            if self.waived:
                names = self.subject.ids(*sorted((a, b)))
                if fingerprint(rule.id, "", *names) in self.waived:
                    continue
            clause = self._apart((a, BodyKind(kind_a)), (b, BodyKind(kind_b)))
            if clause is not None:
                why = "overlap" if depth[row] < 0.0 else "come too near each other"
                yield _Conflict(why=why, branches=(a, b), clause=clause)

    def _apart(self, one: tuple[int, BodyKind], two: tuple[int, BodyKind]) -> Clause | None:
        """Return the clause that two bodies do not lie on one piece; None if they never do."""
        nodes, cut, uncut = [], set[int](), set[int]()
        for branch, kind in (one, two):
            nodes.append(self.parent[branch] if kind is BodyKind.STUB else branch)
            (cut if kind is BodyKind.WHOLE else uncut).add(branch)
        cut |= self._path(*nodes)
        # The trunk is always whole.
        clause = Clause(frozenset(cut - {0}), frozenset(uncut))
        return None if clause.cut & clause.uncut else clause

    def _path(self, one: int, two: int) -> set[int]:
        """Return the branches between two nodes of the tree whose cutting parts them."""
        found = set()
        while one != two:
            if self.level[one] >= self.level[two]:
                found.add(one)
                one = self.parent[one]
            else:
                found.add(two)
                two = self.parent[two]
        return found

    def _found_on(self, cut: Partition, piece: Piece) -> Iterator[_Conflict]:
        """Yield the conflicts that the rules still find on a piece as it will be cut."""
        ends, room_mm = piece_ends(cut, piece), self.profile.machine.usable_mm
        fits = not self.reaches.exceed(piece.branches)
        if fits:  # with its seam and its cuts too?
            paths = body_paths(self.design, self.profile, separate=self.separate, ends=ends).paths
            corner_mm = self.profile.machine.margin_mm.value
            fits = place_contours([path.contour for path in paths], room_mm, corner_mm).fits
        if not fits:
            for part in self._too_large(piece):
                yield _Conflict(why=TOO_LARGE, branches=piece.branches, clause=part)
            return  # what its parts break is seen when they are parted
        subject = _on_piece(self.subject, self.bodies, piece, ends)
        for finding in run_checks(subject, self.limits, only=rules_on(Scope.ROOM)).blocking:
            rows = tuple(self.subject.names.index(name) for name in finding.branches)
            if len(rows) != 2:
                continue
            one, two = ((row, _kind_on(piece, row)) for row in rows)
            clause = self._apart(one, two)
            if clause is not None:
                why = f"break {finding.rule} on one piece"
                yield _Conflict(why=why, branches=rows, clause=clause)

    def _too_large(self, piece: Piece) -> Iterator[Clause]:
        """Yield clauses that a piece which does not fit the bed is cut.

        Of a piece as small a part as possible is sought that does not fit either, several times,
        giving up branches in another order each time. Where only seam, kerf and marks make the
        piece too large, there is none but the piece.
        """
        apart = frozenset(row for row in piece.branches if row != piece.root)
        if not apart or not self.reaches.exceed(piece.branches):
            # Without its socket a piece is a part of a larger one, whatever else is cut.
            yield Clause(apart, frozenset({piece.root} - {0}))
            return
        orders = (piece.branches, piece.branches[::-1])
        rolled = [piece.branches[k:] + piece.branches[:k] for k in range(0, len(apart), 7)][
            :_ORDERS
        ]
        found = {self._least_too_large(piece.branches, order) for order in (*orders, *rolled)}
        yield from sorted(found, key=lambda clause: sorted(clause.cut))

    def _least_too_large(self, rows: tuple[int, ...], order: tuple[int, ...]) -> Clause:
        """Return the clause that a least connected part of a piece is cut, which does not fit.

        Its first branch counts with its outer part alone, as if it were cut.
        """
        kept = set(rows)
        for row in order:
            children = [one for one in kept if self.parent[one] == row]
            is_top = self.parent[row] not in kept
            if len(kept) < 3 or len(children) > is_top:
                continue  # without it the rest would fall apart
            if self.reaches.exceed(kept - {row}):
                kept.discard(row)
        top = next(row for row in sorted(kept) if self.parent[row] not in kept)
        return Clause(frozenset(kept - {top}))

    # --- the pieces ------------------------------------------------------------------------------

    def _cut(self, cut: tuple[int, ...], *, proven_least: bool) -> Partition:
        """Return the pieces that some cuts leave, from the base outward."""
        roots = (0, *cut)
        label = {root: piece_label(number) for number, root in enumerate(roots)}
        home = [0] * len(self.parent)
        for row in range(1, len(self.parent)):
            home[row] = row if row in label else home[self.parent[row]]
        pieces = tuple(
            Piece(
                label=label[root],
                root=root,
                branches=tuple(row for row, at in enumerate(home) if at == root),
                stubs=tuple(row for row in cut if home[self.parent[row]] == root),
            )
            for root in roots
        )
        sleeves = tuple(
            replace(self.sleeves[row], label=label[row], inner=label[home[self.parent[row]]])
            for row in cut
        )
        return Partition(pieces=pieces, sleeves=sleeves, proven_least=proven_least)

    def _uncut(self, conflicts: list[_Conflict], found: Multicut) -> Partition:
        """Return the whole robot with the conflicts that no cut parts.

        One that lies flat is only too large for the bed: it may still be made in tiles.
        """
        if all(conflict.why == TOO_LARGE for conflict in conflicts):
            return one_piece(self.design)
        room_mm, unparted = self.sides.room_mm(), {}
        for place in found.broken:
            conflict = conflicts[place]
            between = tuple(sorted(conflict.clause.cut - {0}))
            short = [row for row in between if row not in self.sleeves]
            unparted[conflict.branches] = Unparted(
                why=conflict.why,
                branches=conflict.branches,
                between=between,
                room_mm=max((float(room_mm[row]) for row in short), default=0.0),
                needed_mm=self.size.room_mm,
            )
        return replace(one_piece(self.design), unparted=tuple(unparted.values()))


def _kind_on(piece: Piece, row: int) -> BodyKind:
    """Return what of a branch lies on a piece."""
    if row in piece.stubs:
        return BodyKind.STUB
    return BodyKind.OUTER if row == piece.root and row else BodyKind.WHOLE


def _on_piece(subject: Subject, bodies: Bodies, piece: Piece, ends: PieceEnds) -> Subject:
    """Return a piece as what the rules check: its capsules and its outline."""
    lies = {row: _kind_on(piece, row) for row in (*piece.branches, *piece.stubs)}
    every = zip(bodies.capsules.branch.tolist(), bodies.kind.tolist(), strict=True)
    chosen = np.array([lies.get(branch) == kind for branch, kind in every])
    return replace(
        subject,
        capsules=bodies.of(chosen),
        outline=body_outline(subject.design, ends=ends),
        piece=piece,
    )


def in_pieces(subject: Subject, partition: Partition) -> Subject:
    """Return a subject with its pieces, each as the rules check it; a whole robot has none.

    Parameters
    ----------
    subject
        A design with its profile and, if it has any, its paths.
    """
    if subject.design.build.pieces is None or subject.profile is None:
        return subject
    known = replace(subject, partition=partition)
    if len(partition.pieces) == 1:
        return known
    sleeves = {sleeve.branch: sleeve for sleeve in partition.sleeves}
    bodies = bodies_of(subject.layout, subject.design.build, sleeves)
    pieces = tuple(
        _on_piece(known, bodies, piece, piece_ends(partition, piece)) for piece in partition.pieces
    )
    return replace(known, pieces=pieces)
