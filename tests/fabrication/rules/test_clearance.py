"""Clearance rules against the drawn outline: what closing it by a disc adds is a notch or gap."""

import importlib.util
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import shapely

from vinefab.core.rng import child
from vinefab.fabrication.job.passes import taken_mm
from vinefab.fabrication.rules.catalog import run_checks
from vinefab.fabrication.rules.clearance_rules import lies_between, notches
from vinefab.fabrication.rules.rule import Subject
from vinefab.model.design import Pouch
from vinefab.model.finding import Severity

ASKED_MM = {"error": 3.0, "warning": 5.0}
"""Of lumens: nothing is taken where there is no recipe."""

SEEDED = np.random.default_rng(1), 2.0
SPOILT = {"VF-T02", "VF-T03", "VF-C02", "VF-C03", "VF-C04", "VF-C05"}


@pytest.mark.parametrize("block", range(2))
def test_the_outline_has_a_narrow_notch_exactly_where_a_rule_says_so(block, random_design):
    quiet = 0
    for number in range(40):
        subject = Subject.of(
            random_design(child(31, block, number), shortest_mm=40.0, pouched=True)
        )
        if not subject.body.is_valid:
            continue
        findings = run_checks(subject, {"VF-C01": ASKED_MM, "VF-C07": ASKED_MM}).findings
        errors = {f.rule for f in findings if f.severity is Severity.ERROR}
        small = [f for f in findings if f.rule == "VF-C04" and (f.measured or 0.0) < 1.5]
        if errors & SPOILT or small:
            continue  # other rules forbid what the outline looks like there
        narrow = notches(subject.body, 2.98)
        quiet += not narrow
        assert bool(narrow) == bool(errors & {"VF-C01", "VF-C07"}), (block, number, errors)
    assert quiet > 15


def test_a_gap_between_pouches_is_a_notch_of_its_width(make):
    # Tips of 200 mm, 40 degrees apart, are 136.8 mm from each other.
    pouch = Pouch(shape="round", radius_mm=(400.0 * math.sin(math.radians(20.0)) - 4.0) / 2.0)
    subject = Subject.of(make((2, 200.0, 40.0), pouch=pouch))
    assert notches(subject.body, 3.9) == []
    assert lies_between(subject, notches(subject.body, 4.2), ("0.0", "0.1"), 4.2)


def test_a_fillet_is_no_notch_and_a_sharper_one_is(make):
    body = Subject.of(make((2, 200.0, 60.0), fillet_mm=(3.0,))).body
    assert notches(body, 5.9) == []
    assert len(notches(body, 8.0)) == 3


def test_a_pouch_that_bends_back_to_its_parent_is_found(make, profile):
    # 320 degrees of fan: both children lie along the trunk, their pouches come near it.
    design = make(
        (2, 150.0, 310.0), widths_mm=(40.0, 16.0), pouch=Pouch(shape="round", radius_mm=41.0)
    )
    found = [f for f in run_checks(Subject.of(design, profile)).findings if f.rule == "VF-C07"]
    assert found
    assert {f.branches for f in found} == {("0", "0.0"), ("0", "0.1")}
    body = Subject.of(design).body
    gap = min(f.measured for f in found)
    assert 0.0 < gap < 2.0
    assert shapely.is_valid(body)
    assert notches(body, gap + 2.0 * taken_mm(profile) + 0.3)


def test_no_written_cut_comes_near_a_seam_that_is_not_its_own(monkeypatch):
    path = Path(__file__).with_name("cuts_clear.py")
    spec = importlib.util.spec_from_file_location("cuts_clear", path)
    cuts_clear = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(cuts_clear)
    assert cuts_clear.main(12, seed=2) == 0
    passing = replace(run_checks(Subject.of(cuts_clear.near_the_limit(*SEEDED))), findings=())
    monkeypatch.setattr(cuts_clear, "run_checks", lambda *_, **__: passing)
    assert cuts_clear.main(12, seed=2) > 0, "without the rules some robot is cut wrongly"
