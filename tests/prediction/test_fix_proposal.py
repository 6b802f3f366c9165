import math
import re
from dataclasses import replace

import pytest

from vinefab.fabrication.checking import check_design
from vinefab.growth.options import GrowthOptions
from vinefab.maps.generators.grid import grid_map
from vinefab.model.design import (
    Build,
    Design,
    Level,
    PieceSettings,
    Waiver,
    default_fillets_mm,
)
from vinefab.model.laser import read_profile
from vinefab.model.quantity import Quantity, Standing
from vinefab.prediction.deploy import deploy_from_starts
from vinefab.prediction.fix_proposal import propose_fix, score_change_lines


@pytest.fixture(scope="module")
def profile():
    return read_profile("co2_60w__stretchlon_200")


def fork(widths_mm, length_mm=200.0, angle_deg=60.0, **changes):
    level = Level(branches=2, length_mm=length_mm, fan_rad=math.radians(angle_deg))
    build = Build(widths_mm=widths_mm, fillet_mm=default_fillets_mm(widths_mm), **changes)
    return Design(name="fork", trunk_length_mm=250.0, levels=(level,), build=build)


def test_a_sound_design_gets_no_proposal(profile):
    found = propose_fix(fork((40.0, 24.0)), profile)
    assert (found.design, found.failed) == (None, False)
    assert "nothing to fix" in found.lines()[0]


def test_a_proposal_has_a_name_and_an_origin_of_its_own(profile):
    design = fork((40.0, 24.0), tail_mm=120.0)
    found = propose_fix(design, profile)
    assert found.design.name == found.after.design == "fork_mended"
    assert found.design.origin["mended_from"] == "fork"
    assert found.design.origin["changes"] == ["the tail: 120 -> 150 mm (+25.0 %)"]
    assert found.lines()[0].startswith("fix: 1 change clears VF-B01")
    assert check_design(found.design, profile).blocking == ()


def test_an_error_that_no_change_clears_is_reported(profile):
    limits = {"VF-L04": {"error": 0.01}}
    found = propose_fix(fork((40.0, 24.0), tail_mm=120.0), profile, limits)
    assert found.failed
    assert found.design is None
    assert "VF-L04" in found.lines()[0]
    assert "VF-B01" not in found.lines()[0]


@pytest.mark.parametrize(
    "keep",
    [
        pytest.param([], marks=pytest.mark.thorough),
        pytest.param(["branches"], marks=pytest.mark.thorough),
        ["branches", "length", "width"],
    ],
)
def test_one_fan_that_is_too_narrow_is_opened_and_nothing_else_changes(profile, keep):
    """What clears the quick rules at the lowest cost does not pass the full check here."""
    design = Design.read("three_level_tree").with_level(2, angle_deg=8.0)
    found = propose_fix(design, profile, keep=frozenset(keep))
    (change,) = found.changes
    assert change.text.startswith("level 2 fan: 8 -> 28.5")
    assert change.cost < 0.36
    assert check_design(found.design, profile).blocking == ()


def test_waived_errors_need_no_fix(profile):
    design = fork((40.0, 24.0), tail_mm=120.0)
    (error,) = check_design(design, profile).blocking
    waived = Design(
        name="fork",
        trunk_length_mm=250.0,
        levels=design.levels,
        build=design.build,
        waivers=(Waiver(fingerprint=error.fingerprint, reason="tried"),),
    )
    assert not propose_fix(waived, profile).failed


def measured_film(profile, storage_kpa):
    """The same film where a tube of 20 mm burst at 70 kPa, and with a fit of growth: measured."""

    def measured(value):
        return Quantity(value=value, standing=Standing.MEASURED, source="a test")

    material = profile.material.changed(burst_kpa=measured(70.0), burst_width_mm=measured(20.0),
        survived_kpa=None, survived_width_mm=None,
    )  # fmt: skip
    growth = {
        "yield_kpa": measured(1.92), "drag_kpa_m": measured(0.771), "friction": measured(0.234),
        "storage_kpa": measured(storage_kpa), "width_mm": measured(25.0 * math.pi / 2.0),
    }  # fmt: skip
    return replace(profile, material=material, recipe=profile.recipe.changed(growth=growth))


def test_what_is_kept_and_what_of_it_is_in_the_way_is_told(profile):
    design = fork((40.0, 24.0), length_mm=36.0, angle_deg=80.0)
    found = propose_fix(design, profile, keep=frozenset({"branches", "length"}))
    assert found.design.levels == design.levels
    assert found.lines()[0].endswith("every branch stays")
    found = propose_fix(design, profile, keep=frozenset({"length", "angle", "width"}))
    assert found.lines()[0].endswith("nothing was found that keeps every branch")
    found = propose_fix(design, profile, keep=frozenset({"angle", "branches", "length", "width"}))
    assert found.failed
    assert found.lines() == [
        "fix: no change of the design was found that clears VF-C03 and keeps angle, branches, "
        "length and width; nothing written",
        "  in the way: a change was found without --keep branches, --keep length or --keep width",
    ]
    assert "--keep length and --keep width" in replace(found, is_enough=False).lines()[1]


def test_a_score_has_an_interval_over_maps_or_poses():
    design = fork((40.0, 24.0), tail_mm=120.0)
    longer = design.changed(levels=(design.levels[0].changed(length_mm=300.0),))
    worlds = [grid_map(seed=8), grid_map(seed=9)]
    two, one = (score_change_lines(design, longer, maps)[1] for maps in (worlds, worlds[:1]))
    assert re.fullmatch(
        r"  coverage, mean over 2 maps: 0\.\d{4} -> 0\.\d{4} \(simulated; "
        r"[+-]0\.\d{4}, 95 % interval [+-]0\.\d{4} to [+-]0\.\d{4} over 2 maps\)",
        two,
    )
    assert one.endswith("over 3 poses)")
    (advice,) = score_change_lines(design, longer, [])
    assert "--map" in advice


@pytest.mark.thorough
def test_branches_that_cross_need_no_change_in_pieces(profile):
    levels = tuple(
        Level(branches=count, length_mm=length_mm, fan_rad=math.radians(angle_deg))
        for count, length_mm, angle_deg in ((2, 34.0, 60.0), (2, 90.0, 120.0))
    )
    build = Build(
        widths_mm=(40.0, 24.0, 12.0),
        fillet_mm=(6.0, 3.0),
        pieces=PieceSettings(),
        compensation="none",
    )
    design = Design(name="tree", trunk_length_mm=150.0, levels=levels, build=build)
    found = propose_fix(design, profile)
    assert "VF-C03" in {finding.rule for finding in found.before.blocking}
    assert found.design.levels[1] == design.levels[1]
    assert found.design.build.pieces == build.pieces
    assert check_design(found.design, profile).blocking == ()


def test_a_large_change_names_the_other_way(profile):
    found = propose_fix(fork((40.0, 24.0), length_mm=200.0, tail_mm=120.0), profile)
    assert len(found.lines()) == 2
    large = replace(found, changes=(replace(found.changes[0], cost=1.1),))
    assert large.lines()[-1].endswith("fewer branches instead: --keep length,angle")
    kept = replace(large, keep=frozenset({"branches"}))
    assert kept.lines()[1:] == large.lines()[1:-1]


def test_a_working_pressure_that_grows_no_leaf_is_raised(profile):
    profile = measured_film(profile, 0.0)
    weak = fork((24.0, 12.0), pressure_kpa=1.0)
    found = propose_fix(weak, profile)
    assert {finding.rule for finding in found.before.blocking} == {"VF-P03"}
    (pressed,) = found.changes
    assert (pressed.what, pressed.before) == ("the pressure", 1.0)
    assert found.design.build.changed(pressure_kpa=1.0) == weak.build


def test_growth_on_a_map_has_to_stay_in_the_window(profile):
    world, limits = grid_map(seed=8), {}
    profile = measured_film(profile, 6.5)
    trained = {"growth": GrowthOptions(storage_kpa=0.0).content}
    design = fork((24.0, 12.0), pressure_kpa=35.0).changed(origin=trained)
    free, grown = (
        check_design(design, profile, limits, deployed)
        for deployed in ((), deploy_from_starts(design, [world]))
    )
    assert {finding.rule for finding in grown.blocking} == {"VF-P03"}
    assert free.blocking == ()
    found = propose_fix(design, profile, limits, [world])
    assert found.design is not None
    assert found.design.origin["growth"] == trained["growth"]
    deployed = deploy_from_starts(found.design, [world])
    assert check_design(found.design, profile, limits, deployed).blocking == ()
    words = score_change_lines(design, found.design, [world])
    assert words[0] == (
        "  scores of inflated body, head-on half-angle 1 deg (assumed), "
        "stops at 35 kPa (film stored loosely, assumed), "
        "bodies pass through each other (assumed):"
    )
    tasks = [line.split(",")[0].strip() for line in words[1:]]
    assert tasks == ["coverage", "reach", "anchoring"]
