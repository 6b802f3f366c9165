"""Where the time of a run is said to go."""

import time

import pytest

from vinefab.search.evaluator import Ledger, TimeSplit, Work


def test_every_part_counts_once():
    ledger = Ledger(2)
    with ledger.spending("evaluating"):
        with ledger.spending("loading"):
            time.sleep(0.03)
        time.sleep(0.02)
        with ledger.spending("store"):
            time.sleep(0.01)
    with ledger.spending("store"):
        time.sleep(0.01)
    ledger.add(Work(growth_s=0.01, scoring_s=0.02))
    split = ledger.split()
    assert split.loading_s >= 0.03
    assert 0.03 <= split.evaluating_s < split.total_s - split.loading_s
    assert 0.01 <= split.beside_s < split.evaluating_s
    assert split.store_s >= 0.01
    parts = ("loading", "evaluating", "optimizer", "store", "other")
    assert sum(split.shares[part] for part in parts) == pytest.approx(1.0)
    assert split.shares["busy"] == pytest.approx(0.03 / (2 * split.evaluating_s))
    assert TimeSplit.from_plain(split.plain()) == split
