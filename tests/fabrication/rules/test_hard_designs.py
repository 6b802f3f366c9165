"""Whatever a design file can say, the checks answer with findings, never with an exception."""

import itertools
import math

import pytest

from vinefab.core.rng import child
from vinefab.fabrication.rules.catalog import run_checks
from vinefab.fabrication.rules.rule import Subject
from vinefab.model.design import Build, Design, Level, Pouch
from vinefab.search.penalty_batch import PenaltyRules

POUCHES = (
    None,
    None,
    Pouch(shape="round", radius_mm=0.01),
    Pouch(shape="round", radius_mm=500.0),
    Pouch(shape="rectangle", length_mm=0.5, width_mm=90.0),
    Pouch(shape="rectangle", length_mm=900.0, width_mm=1.0),
)


def hard_design(rng):
    depth = int(rng.integers(1, 5))
    levels = tuple(
        Level(
            branches=int(rng.choice([1, 1, 2, 3, 9])),
            length_mm=float(rng.choice([1e-6, 0.1, 10.0, 150.0, 1e6])),
            fan_rad=math.radians(float(rng.choice([0.0, 1e-9, 60.0, 180.0, 359.0, 360.0]))),
            growth=float(rng.choice([0.001, 1.0, 100.0])),
        )
        for _ in range(depth - 1)
    )
    build = Build(
        widths_mm=tuple(rng.choice([1e-4, 5.0, 20.0, 40.0, 5000.0], depth).tolist()),
        fillet_mm=tuple(rng.choice([0.0, 1e-9, 4.0, 1e5], depth - 1).tolist()),
        tail_mm=float(rng.choice([0.0, 1e-9, 200.0, 1e6])),
        pressure_kpa=float(rng.choice([0.0, 20.0, 10_000.0])),
        pouch=POUCHES[int(rng.integers(len(POUCHES)))],
    )
    trunk_mm = float(rng.choice([1e-6, 5.0, 300.0, 1e6]))
    return Design(name="hard", trunk_length_mm=trunk_mm, levels=levels, build=build)


MOST_BRANCHES = 12
"""Larger trees take most of the time, and are made of the same hard parts."""


def hard_designs(count, block, most):
    """Yield so many hard designs, none with more branches than ``most``."""
    designs = (hard_design(child(23, block, number)) for number in itertools.count())
    return itertools.islice((one for one in designs if one.branch_count <= most), count)


def is_finite(finding):
    numbers = (finding.measured, finding.limit, finding.x_mm, finding.y_mm)
    return all(number is None or math.isfinite(number) for number in numbers)


def assert_answered(designs, profile):
    for design in designs:
        report = run_checks(Subject.of(design, profile))
        assert all(is_finite(finding) for finding in report.findings), design
        rules = PenaltyRules.of(design.build, profile, {}, (900.0, 500.0))
        assert 0.0 <= rules.penalties([design])[0] < 200.0


@pytest.mark.parametrize("block", range(3))
def test_hard_designs_are_answered(block, profile):
    assert_answered(hard_designs(12, block, MOST_BRANCHES), profile)


@pytest.mark.thorough
@pytest.mark.parametrize("block", range(16))
def test_large_hard_designs_are_answered(block, profile):
    assert_answered(hard_designs(100, block, 1000), profile)


def test_a_robot_of_a_kilometre_is_refused_at_once(profile):
    endless = Design(name="endless", trunk_length_mm=1e6, build=Build.standard(1))
    found = [f for f in run_checks(Subject.of(endless, profile)).findings if f.rule == "VF-S01"]
    assert len(found) == 1
    assert "more than 64 tiles" in found[0].message
