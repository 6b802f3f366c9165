"""A little of ``make fuzz`` in every run of the tests."""

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

GROWTHS = 600


@pytest.fixture(scope="module")
def fuzz() -> ModuleType:
    spec = importlib.util.spec_from_file_location("fuzz", Path(__file__).with_name("fuzz.py"))
    module = importlib.util.module_from_spec(spec)
    sys.modules["fuzz"] = module
    spec.loader.exec_module(module)
    return module


def test_growth_on_nasty_maps(fuzz):
    found = fuzz.fuzz(GROWTHS)
    assert sum(counts.growths for counts in found.values()) >= GROWTHS
    for kind, counts in found.items():
        assert counts.failures == 0, (kind, counts)
        # The maps are in the way: more events than branches, and trees beyond the trunk.
        assert counts.events > 1.5 * counts.branches > 1.5 * counts.growths


def test_failures_are_seen(fuzz, monkeypatch):
    monkeypatch.setattr(fuzz, "MOST_EVENTS", 3)
    monkeypatch.setattr(fuzz, "EXACT", -1.0)
    counts = fuzz.Counts()
    fuzz.fuzz_map(counts, "rounded", 1)
    assert counts.endless == 1
    assert counts.outside == counts.disagree == counts.growths > 0
    assert counts.seeds == [1]
