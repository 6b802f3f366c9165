from itertools import chain, combinations

import numpy as np
import pytest

from vinefab.fabrication.pieces.partition import Clause, multicut, simplified

ROWS = range(1, 9)


def clause(cut, uncut=()):
    return Clause(frozenset(cut), frozenset(uncut))


def holds(one, cut):
    return bool(one.cut & cut) or bool(one.uncut - cut)


def subsets():
    return chain.from_iterable(combinations(ROWS, size) for size in range(len(ROWS) + 1))


def random_clauses(random):
    found = []
    for _ in range(random.integers(1, 12)):
        cut = random.choice(ROWS, random.integers(0, 5), replace=False)
        uncut = random.choice(ROWS, random.integers(0, 2), replace=False)
        found.append(clause(map(int, cut), map(int, set(uncut) - set(cut))))
    return found


@pytest.mark.parametrize("seed", range(60))
def test_no_smaller_cut_keeps_all_clauses(seed):
    random = np.random.default_rng(seed)
    clauses = random_clauses(random)
    cuttable = [row for row in ROWS if random.random() < 0.8]
    weights = {row: float(random.integers(5, 25)) for row in cuttable}
    possible = [
        frozenset(cut)
        for cut in subsets()
        if set(cut) <= set(cuttable) and all(holds(one, frozenset(cut)) for one in clauses)
    ]
    found = multicut(clauses, weights)
    if not possible:
        assert found.broken
        assert not found.cut
        return
    best = min(possible, key=lambda cut: (len(cut), sum(weights[row] for row in cut)))
    assert not found.broken
    assert found.proven_least
    assert frozenset(found.cut) in possible
    assert len(found.cut) == len(best)
    # Of the least cuts, the narrowest branches: least rim to bond.
    assert sum(weights[row] for row in found.cut) == sum(weights[row] for row in best)


def test_what_cannot_be_parted_or_contradicts_itself_is_named():
    found = multicut([clause([1]), clause([5]), clause([2], [1])], {1: 10.0, 2: 8.0})
    assert found.broken == (1,)
    assert len(multicut([clause([1]), clause([], [1])], {1: 10.0}).broken) == 1


@pytest.mark.parametrize("seed", range(40))
def test_fewer_clauses_say_the_same(seed):
    clauses = random_clauses(np.random.default_rng(1000 + seed))
    fewer = simplified(clauses)
    assert len(fewer) <= len(clauses)
    for cut in map(frozenset, subsets()):
        assert all(holds(one, cut) for one in fewer) == all(holds(one, cut) for one in clauses)
