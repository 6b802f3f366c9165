"""What a run is told about making robots."""

from dataclasses import replace

import pytest

from vinefab.fabrication.checking import check_design
from vinefab.model.design import Build, Design, Level, Waiver
from vinefab.model.files.profile_toml import read_profile
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.search.evaluator import FullCheck
from vinefab.search.manufacturability import ManufacturabilityPenalty


@pytest.fixture(scope="module")
def making() -> ManufacturabilityPenalty:
    return ManufacturabilityPenalty(profile=read_profile(DEFAULT_RECIPE))


def fork(fan_rad: float, length_mm: float = 200.0) -> Design:
    level = Level(branches=2, length_mm=length_mm, fan_rad=fan_rad)
    return Design(name="fork", trunk_length_mm=150.0, levels=(level,), build=Build.standard(2))


def test_a_good_design_has_no_penalty_and_passes(making: ManufacturabilityPenalty) -> None:
    assert isinstance(making, FullCheck)
    assert making(fork(1.2)) == 0.0
    assert making.passes(fork(1.2))


def test_a_search_keeps_to_one_bed_though_larger_robots_may_be_cut_in_tiles(
    making: ManufacturabilityPenalty,
) -> None:
    long = fork(1.2, 900.0)
    assert making(long) > 0.0
    assert making.passes(long)
    endless = fork(1.2, 90_000.0)
    assert making(endless) > making(long)
    assert not making.passes(endless)


def test_a_narrow_fan_is_seen_by_both(making: ManufacturabilityPenalty) -> None:
    assert making(fork(0.1)) > 0.0
    assert not making.passes(fork(0.1))


def test_a_waived_finding_does_not_count_against_a_design(making: ManufacturabilityPenalty) -> None:
    narrow = fork(0.24)
    waivers = tuple(
        Waiver(fingerprint=finding.fingerprint, reason="tried")
        for finding in check_design(narrow, making.profile).blocking
    )
    assert waivers
    assert making.passes(replace(narrow, waivers=waivers))


def test_leaves_that_cannot_grow_at_what_the_trunk_stands_are_seen_by_both(
    making: ManufacturabilityPenalty,
) -> None:
    build = Build(widths_mm=(60.0, 24.0), fillet_mm=(6.0,), pressure_kpa=10.0)
    wide = replace(fork(1.2, 200.0), build=build)
    assert making.passes(wide)
    build = Build(widths_mm=(80.0, 6.0), fillet_mm=(3.0,), pressure_kpa=10.0)
    narrow = replace(fork(1.2, 300.0), build=build)
    assert making(narrow) > 0.0
    assert not making.passes(narrow)


def test_a_complaint_names_the_rules_that_forbid_a_design(making: ManufacturabilityPenalty) -> None:
    assert making.complaint(fork(1.2)) == ""
    told = making.complaint(fork(0.1))
    assert told.startswith("VF-T02, VF-C02, VF-C03 (the outline crosses itself")
    # It needs tiles, which a search does not take but the check does.
    assert making.complaint(fork(1.2, 900.0)) == ""
