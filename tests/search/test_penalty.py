"""The penalty against the rules that it stands for."""

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from vinefab.core.rng import child
from vinefab.fabrication.rules.catalog import run_checks
from vinefab.fabrication.rules.rule import Subject
from vinefab.model.design import Build, Design, Level, default_fillets_mm
from vinefab.model.finding import Severity
from vinefab.model.laser import read_profile
from vinefab.search.penalty_batch import PenaltyRules

Make = Callable[..., Design]

CHEAP = {
    *("VF-T02", "VF-T03", "VF-W01", "VF-W02", "VF-W03"),
    *("VF-C01", "VF-C02", "VF-C03", "VF-C07", "VF-S01"),
}
PROFILE = read_profile("co2_60w__stretchlon_200")
SHEET_MM = (980.0, 580.0)
"""The usable bed less 10 mm for seam, kerf and overcut."""


def errors(design, profile, only):
    """The rules that find errors; none of them needs laser paths, so none are laid out."""
    report = run_checks(replace(Subject.of(design), profile=profile), only=only)
    return {f.rule for f in report.findings if f.severity is Severity.ERROR}


NO_LASER = {
    "VF-L02": {"segment_error": 1e-9, "radius_error": -10.0},
    "VF-C04": {"error": 0.0},
}
"""Arcs come and go in steps: here, as if the laser could run the shortest of them."""


def penalty(design, limits=None, sheet_mm=(100000.0, 100000.0)):
    design = design.changed(build=design.build.changed(compensation="none"))
    rules = PenaltyRules.of(design.build, PROFILE, NO_LASER | (limits or {}), sheet_mm, grows=False)
    return float(rules.penalties([design])[0])


def window_penalty(design, profile, limits=None):
    """What the pressure for growth adds."""
    with_growth, without = (
        PenaltyRules.of(design.build, profile, limits or {}, (1e5, 1e5), grows=grows)
        for grows in (True, False)
    )
    return float(with_growth.penalties([design])[0] - without.penalties([design])[0])


@pytest.fixture(scope="module")
def penalties(profile, random_design):
    """Penalty of random designs, and the rules that find errors in them."""
    designs = [random_design(child(11, number)) for number in range(60)]
    return [
        (penalty(design, sheet_mm=SHEET_MM), errors(design, profile, CHEAP)) for design in designs
    ]


def test_no_penalty_means_no_errors_from_the_rules_it_stands_for(penalties):
    clean = [found for penalty, found in penalties if penalty == 0.0]
    assert len(clean) > 4
    assert all(found == set() for found in clean)
    assert sum(penalty > 0.0 and bool(found) for penalty, found in penalties) > 20


def test_a_clean_design_is_hardly_ever_penalized(penalties):
    clean = [penalty for penalty, found in penalties if not found]
    assert len(clean) > 6
    assert sum(penalty > 0.0 for penalty in clean) <= 0.1 * len(clean)


def test_the_penalty_falls_steadily_while_a_fan_opens(make):
    values = [
        penalty(make((2, 150.0, angle), (2, 120.0, 60.0))) for angle in np.linspace(10.0, 130.0, 80)
    ]
    steps = np.diff(values)
    assert values[0] > 0.3
    assert values[-1] == 0.0
    assert (steps <= 1e-9).all()
    assert np.abs(steps).max() < 0.4


def test_the_penalty_is_continuous_where_branches_begin_to_cross(make):
    angles = np.linspace(60.0, 100.0, 400)
    values = [penalty(make((2, 150.0, a), (2, 140.0, 80.0))) for a in angles]
    assert np.abs(np.diff(values)).max() < 0.05


@pytest.mark.parametrize(
    ("bad", "good"),
    [
        ({"widths_mm": (10.0, 4.0)}, {"widths_mm": (10.0, 5.0)}),
        ({"widths_mm": (20.0, 17.0)}, {"widths_mm": (20.0, 16.0)}),
    ],
)
def test_each_width_rule_alone_is_penalized(make, bad, good):
    assert penalty(make((2, 200.0, 60.0), **bad)) > 0.0
    assert penalty(make((2, 200.0, 60.0), **good)) == 0.0


def test_packing_crotch_angle_and_sheet_are_penalized(make):
    assert penalty(make((17, 400.0, 320.0), widths_mm=(40.0, 24.0))) > 0.0
    assert penalty(make((2, 47.0, 60.0))) > 0.0
    assert penalty(make((2, 300.0, 14.0), widths_mm=(20.0, 6.0))) > 0.0
    long = make(trunk_mm=1500.0)
    assert penalty(long) == 0.0
    assert penalty(long, sheet_mm=SHEET_MM) > 0.0


def test_the_penalty_is_bounded_and_finite_for_hopeless_trees(make):
    heap = make((10, 100.0, 0.0), (10, 100.0, 360.0), (9, 100.0, 0.0))
    assert 5.0 < penalty(heap) < 100.0
    forest = make((50, 100.0, 360.0), (50, 50.0, 360.0), (2, 10.0, 90.0))
    assert math.isfinite(penalty(forest))
    assert penalty(forest) > 0.0


def random_tree(rng):
    depth = int(rng.integers(1, 6))
    widths = tuple((60.0 * rng.uniform(0.4, 0.8, depth).cumprod()).tolist())
    levels = tuple(
        Level(
            branches=int(rng.integers(1, 4)),
            length_mm=float(rng.uniform(60, 900)),
            fan_rad=float(rng.uniform(0.2, 3.0)),
        )
        for _ in range(depth - 1)
    )
    build = Build(widths_mm=widths, fillet_mm=default_fillets_mm(widths))
    return Design(name="random", trunk_length_mm=300.0, levels=levels, build=build)


def test_the_window_penalty_is_zero_just_where_the_rule_finds_no_error(grown_profile):
    """Where limits were measured; a search keeps to those that are assumed too."""
    profile = grown_profile
    closed = 0
    for number in range(40):
        design = random_tree(child(5, number))
        if number % 2:  # a working pressure that grows some of them
            design = design.changed(build=design.build.changed(pressure_kpa=6.0))
        broken = bool(errors(design, profile, {"VF-P03"}))
        assert (window_penalty(design, profile) > 0.0) == broken
        closed += broken
    assert 5 < closed < 35


def test_the_window_penalty_falls_as_leaves_widen_and_follows_changed_limits(profile, make):
    values = [
        window_penalty(make((2, 300.0, 90.0), widths_mm=(60.0, width)), profile)
        for width in np.linspace(3.0, 40.0, 30)
    ]
    assert values[0] > 0.5
    assert values[-1] == 0.0
    assert (np.diff(values) <= 0.0).all()
    open_one = make((2, 300.0, 90.0), widths_mm=(60.0, 40.0))
    assert window_penalty(open_one, profile, {"VF-P03": {"loose_kpa": 20.0}}) > 0.0
