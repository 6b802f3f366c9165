"""A robot in the fewest flat pieces that pass every rule about room on the sheet."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

import numpy as np

from vinefab.core.hashing import fingerprint
from vinefab.fabrication.job.passes import body_paths, reach_mm
from vinefab.fabrication.job.placement import place_contours
from vinefab.fabrication.job.sleeve import piece_ends, sleeve_size
from vinefab.fabrication.outline.body_outline import PieceEnds, body_outline
from vinefab.fabrication.pieces.bodies import (
    Bodies,
    BodyKind,
    Reaches,
    StraightSides,
    bodies_of,
    sleeve_sides,
    sleeves_of,
)
from vinefab.fabrication.pieces.multicut import Clause, Multicut, multicut
from vinefab.fabrication.rules.catalog import ROOM_RULES, by_rule, changed_limits
from vinefab.fabrication.rules.clearance import CLEARANCE, OVERLAP, POUCH, least_gap_mm
from vinefab.fabrication.rules.piece_rules import LAP_PACKING, fullest_laps, widest_cut_mm
from vinefab.fabrication.rules.rule import ROUNDING, LimitChanges
from vinefab.fabrication.rules.run_rules import run_checks
from vinefab.fabrication.rules.spacing import spacing
from vinefab.fabrication.rules.subject import Subject
from vinefab.fabrication.rules.widths import passages_of
from vinefab.inflation.pattern import Pattern
from vinefab.model.design import Design, PieceSettings
from vinefab.model.finding import Finding
from vinefab.model.laser import LaserProfile
from vinefab.model.pieces import Partition, Piece, Sleeve, Unparted, piece_label

_ORDERS = 8
"""Orders in which branches are given up to find the least part that does not fit the bed."""

TOO_LARGE = "do not fit the bed in one piece"

_MOST_ROUNDS = 300
"""Times that cuts are looked for again after a rule found something on a piece."""

ROUNDS_BEYOND = 8
"""The same once more pieces are needed than the design allows: then only the report gains."""


def partition_of(
    design: Design,
    profile: LaserProfile,
    limits: LimitChanges | None = None,
    *,
    separate: bool = False,
    passages: Mapping[int, float] | None = None,
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
        Into the branches of each level, as far as they are known.

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
    return cutter.partition(passages or {})


def pieces_of(
    pattern: Pattern,
    profile: LaserProfile,
    limits: LimitChanges | None = None,
    *,
    separate: bool = False,
) -> Partition:
    """Return the fewest pieces of a pattern, as `partition_of`."""
    passages = passages_of(pattern)
    return partition_of(pattern.flat, profile, limits, separate=separate, passages=passages)


def one_piece(design: Design) -> Partition:
    """Return a robot in one piece."""
    return Partition(pieces=(Piece(label="A", root=0, branches=tuple(range(design.branch_count))),))


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

    def partition(self, passages: Mapping[int, float]) -> Partition:
        """Return the fewest pieces that pass."""
        conflicts, beyond = [*self._pairs()], 0
        flat: Partition | None = None  # the first whose pieces pass, whatever their laps
        weights = {row: sleeve.width_mm for row, sleeve in self.sleeves.items()}
        for _ in range(_MOST_ROUNDS):
            found = multicut([conflict.clause for conflict in conflicts], weights)
            if found.broken:
                return flat or self._uncut(conflicts, found)
            cut = self._cut(found.cut, proven_least=found.proven_least)
            if flat is not None and len(cut.pieces) > self.most:
                return flat
            more = [one for piece in cut.pieces for one in self._known_of(cut, piece)]
            if not more:
                flat = flat or cut
                more = [*self._laps(cut, passages)]
                if not more:
                    return cut
            known = {conflict.clause for conflict in conflicts}
            beyond += len(cut.pieces) > self.most
            if beyond > ROUNDS_BEYOND or all(one.clause in known for one in more):
                break
            conflicts += more
        return flat or replace(cut, unfinished=True)

    def _laps(self, cut: Partition, passages: Mapping[int, float]) -> Iterator[_Conflict]:
        """Yield what forbids the sleeves of a partition: further cuts only add to it."""
        values = by_rule(changed_limits(self.design, self.profile, self.limits))
        widest_mm = widest_cut_mm(self.design.build, self.profile, values)
        cuts = frozenset(sleeve.branch for sleeve in cut.sleeves)
        for sleeve in cut.sleeves:
            if sleeve.width_mm > widest_mm:
                alone = Clause(frozenset(), frozenset({sleeve.branch}))
                yield _Conflict(why="load its lap", branches=(sleeve.branch,), clause=alone)
        limits = LAP_PACKING.limits_with(values.get(LAP_PACKING.id, {}))
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
        values = by_rule(changed_limits(self.design, self.profile, self.limits))
        near_mm, pouch_mm = (
            least_gap_mm(rule, values, self.subject.taken_mm) for rule in (CLEARANCE, POUCH)
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
            rule = POUCH if joined else OVERLAP if depth[row] < 0.0 else CLEARANCE
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

    def _known_of(self, cut: Partition, piece: Piece) -> tuple[_Conflict, ...]:
        """Return what is found on a piece; the same piece comes back in many partitions."""
        key = piece.branches, piece.stubs
        if key not in self.known:
            self.known[key] = tuple(self._found_on(cut, piece))
        return self.known[key]

    def _found_on(self, cut: Partition, piece: Piece) -> Iterator[_Conflict]:
        """Yield what the rules still find on a piece as it will be cut."""
        ends = piece_ends(cut, piece)
        if not self._fits(piece, ends):
            for part in self._too_large(piece):
                yield _Conflict(why=TOO_LARGE, branches=piece.branches, clause=part)
            return  # what its parts break is seen when they are parted
        subject = _on_piece(self.subject, self.bodies, piece, ends)
        for finding in run_checks(subject, self.limits, only=ROOM_RULES).blocking:
            clause = self._clause_of(piece, finding)
            if clause is not None:
                rows = tuple(self.subject.names.index(name) for name in finding.branches)
                yield _Conflict(
                    why=f"break {finding.rule} on one piece", branches=rows, clause=clause
                )

    def _fits(self, piece: Piece, ends: PieceEnds) -> bool:
        """Whether a piece fits the bed, with its seam and its cuts."""
        if self.reaches.exceed(piece.branches):
            return False
        paths = body_paths(self.design, self.profile, separate=self.separate, ends=ends).paths
        corner, room = self.profile.machine.margin_mm.value, self.profile.machine.usable_mm
        return place_contours([path.contour for path in paths], room, corner).fits

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

    def _clause_of(self, piece: Piece, finding: Finding) -> Clause | None:
        """Return the clause that the two bodies of a finding are apart."""
        rows = [self.subject.names.index(name) for name in finding.branches]
        if len(rows) != 2:
            return None
        kinds = [
            BodyKind.STUB
            if row in piece.stubs
            else BodyKind.OUTER
            if row == piece.root and row
            else BodyKind.WHOLE
            for row in rows
        ]
        return self._apart((rows[0], kinds[0]), (rows[1], kinds[1]))

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


def _on_piece(subject: Subject, bodies: Bodies, piece: Piece, ends: PieceEnds) -> Subject:
    """Return a piece as what the rules check: its capsules and its outline."""
    kind, branch = bodies.kind, bodies.capsules.branch
    full = [row for row in piece.branches if row != piece.root or not row]
    chosen = (kind == BodyKind.WHOLE) & np.isin(branch, full)
    chosen |= (kind == BodyKind.STUB) & np.isin(branch, piece.stubs)
    chosen |= (kind == BodyKind.OUTER) & (branch == piece.root)
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
