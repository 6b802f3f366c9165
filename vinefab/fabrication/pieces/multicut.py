"""Which branches to cut: the fewest that part all conflicts, as a 0-1 program over the branches.

What must hold is a set of clauses. A conflict of two bodies is one clause: a branch on the tree
path between them is cut, or one of the bodies is not there because its branch is cut (then there is
no whole branch) or is not (then there is neither stub nor socket).
"""

import os
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy  # its parts load at their first use

MOST_NODES = 20_000
"""Nodes of the search tree of one program; a count, not a time, so that results are the same."""


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
    found = None if _NEVER in needed else _solved(needed, weights)
    if found is None:
        return Multicut(cut=(), proven_least=True, broken=_most_stubborn(kept, weights))
    return found


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


def _solved(clauses: Sequence[Clause], weights: Mapping[int, float]) -> Multicut | None:
    """Return the least cut, or None if there is none."""
    rows = sorted({row for clause in clauses for row in (*clause.cut, *clause.uncut)})
    heaviest = 1.0 + 2.0 * sum(weights[row] for row in rows)
    # One more cut always outweighs all differences of weight.
    costs = np.array([1.0 + weights[row] / heaviest for row in rows])
    result = _program(clauses, rows, costs, slack=False)
    if result.x is None:
        return None
    chosen = tuple(row for row, value in zip(rows, result.x, strict=True) if value > 0.5)
    return Multicut(cut=chosen, proven_least=result.status == 0)


def _most_stubborn(
    clauses: Sequence[Clause | None], weights: Mapping[int, float]
) -> tuple[int, ...]:
    """Return the places of clauses that are broken when as few as possible are."""
    places = [place for place, clause in enumerate(clauses) if clause is not None]
    asked = [clause for clause in clauses if clause is not None]
    rows = sorted(weights)
    result = _program(asked, rows, np.zeros(len(rows)), slack=True)
    if result.x is None:
        return tuple(places)
    loose = result.x[len(rows) :] > 0.5
    return tuple(place for place, broken in zip(places, loose.tolist(), strict=True) if broken)


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
    with _clean_output():
        return scipy.optimize.milp(
            costs,
            integrality=np.ones(len(costs), dtype=np.int64),
            bounds=scipy.optimize.Bounds(0.0, 1.0),
            constraints=scipy.optimize.LinearConstraint(matrix, lb=least),
            options={"node_limit": MOST_NODES, "mip_rel_gap": 0.0, "presolve": False},
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
