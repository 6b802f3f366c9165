"""Manufacturability in a search: penalty, full check, and spaces that are refused."""

import math
from dataclasses import replace

import numpy as np
import pytest

from vinefab.core.errors import BadInputError
from vinefab.fabrication.checking import check_design
from vinefab.model.design import Build, Design, Level, Pouch, Waiver
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.laser import read_profile
from vinefab.model.quantity import Quantity, Standing
from vinefab.search.manufacturability import (
    ManufacturabilityPenalty,
    SpaceQuery,
    refuse_infeasible_space,
)
from vinefab.search.settings import RunSettings
from vinefab.search.space import Bounds, BuildSettings, Space, SpaceSettings


@pytest.fixture(scope="module")
def penalty():
    return ManufacturabilityPenalty(profile=read_profile(DEFAULT_RECIPE))


def fork(fan_rad, length_mm=200.0):
    """Return a fork that is cut as designed."""
    level = Level(branches=2, length_mm=length_mm, fan_rad=fan_rad)
    build = Build.standard(2).changed(compensation="none")
    return Design(name="fork", trunk_length_mm=150.0, levels=(level,), build=build)


def test_the_pattern_decides_what_can_be_cut(penalty):
    """At 13 degrees no crotch has room; what deploys there is cut at 37 and passes."""
    compensated = Build.standard(2).changed(compensation="inflation")
    narrow, nearer = fork(0.23), fork(0.1)
    for build, can_be_cut in ((narrow.build, False), (compensated, True)):
        design = narrow.changed(build=build)
        assert (penalty(design) == 0.0) == penalty.passes(design) == can_be_cut
    # Inflated siblings that lie on each other are left out by a search, and warned of by the check.
    assert penalty(nearer.changed(build=compensated)) > 0.0
    assert penalty.passes(nearer.changed(build=compensated))


def test_a_search_keeps_to_one_bed_though_larger_robots_may_be_cut_in_tiles(penalty):
    long = fork(1.2, 900.0)
    assert penalty(long) > 0.0
    assert penalty.passes(long)
    endless = fork(1.2, 90_000.0)
    assert penalty(endless) > penalty(long)
    assert not penalty.passes(endless)


def test_a_waived_finding_does_not_count_against_a_design(penalty):
    narrow = fork(0.24)
    waivers = tuple(
        Waiver(fingerprint=finding.fingerprint, reason="tried")
        for finding in check_design(narrow, penalty.profile).blocking
    )
    assert waivers
    assert penalty.passes(narrow.changed(waivers=waivers))


def test_leaves_that_cannot_grow_at_what_the_trunk_stands_are_seen_by_both(penalty):
    build = Build(widths_mm=(60.0, 24.0), fillet_mm=(6.0,), pressure_kpa=10.0)
    wide = fork(1.2, 200.0).changed(build=build)
    assert penalty.passes(wide)
    build = Build(widths_mm=(80.0, 6.0), fillet_mm=(3.0,), pressure_kpa=10.0)
    narrow = fork(1.2, 300.0).changed(build=build)
    assert penalty(narrow) > 0.0
    # The check forbids what was measured; a search keeps to limits that are only assumed, too.
    assert penalty.passes(narrow)
    known = ManufacturabilityPenalty(profile=measured_film(penalty.profile))
    assert known(narrow) > 0.0
    assert not known.passes(narrow)


def measured_film(profile):
    """The same film where a tube of 20 mm burst at 70 kPa, and the published growth: measured."""

    def measured(value):
        return Quantity(value=value, standing=Standing.MEASURED, source="a test")

    seam = {"burst_kpa": measured(70.0), "burst_width_mm": measured(20.0)}
    none = {"survived_kpa": None, "survived_width_mm": None}
    growth = {
        "yield_kpa": measured(1.92),
        "drag_kpa_m": measured(0.771),
        "storage_kpa": measured(0.0),
        "friction": measured(0.234),
        "width_mm": measured(25.0 * math.pi / 2.0),
    }
    return replace(
        profile,
        material=profile.material.changed(**seam, **none),
        recipe=profile.recipe.changed(growth=growth),
    )


def test_a_complaint_names_the_rules_that_forbid_a_design(penalty):
    assert penalty.violations(fork(1.2)) == ""
    message = penalty.violations(fork(0.1))
    assert message.startswith("VF-T02, VF-C02, VF-C03, VF-I01, VF-L02 (the outline")
    # It needs tiles, which a search does not take but the check does.
    assert penalty.violations(fork(1.2, 900.0)) == ""


PROFILE = read_profile(DEFAULT_RECIPE)
PENALTY = ManufacturabilityPenalty(profile=PROFILE)
THREE = Bounds(low=3, high=5)


def refused(settings, profile=PROFILE):
    """Return why a run is refused; empty if it is not."""
    penalty = ManufacturabilityPenalty(profile=profile)
    try:
        refuse_infeasible_space(SpaceQuery.of(settings, profile, penalty.sheet_mm))
    except BadInputError as error:
        return str(error)
    return ""


def run(levels=THREE, build=None, **space):
    settings = SpaceSettings(levels=levels, **space)
    return RunSettings(space=settings, build=build or BuildSettings())


def bounds(low, high):
    return Bounds(low=low, high=high)


WIDE = Pouch(shape="rectangle", length_mm=3.0, width_mm=45.0)
SMALL = Pouch(shape="round", radius_mm=2.0)
FULL = Pouch(shape="rectangle", length_mm=40.0, width_mm=40.0)
INFEASIBLE = {
    "narrow trunk": (run(build=BuildSettings(trunk_width_mm=2.0)), "trunk_width_mm is 2.0", "W01"),
    "narrow level": (run(build=BuildSettings(trunk_width_mm=12.0)), "at least 13.9 mm", "W01"),
    "wide trunk": (run(build=BuildSettings(trunk_width_mm=120.0)), "at most 100 mm", "B02"),
    "wide children": (run(build=BuildSettings(width_ratio=0.9)), "at most 0.833", "W02"),
    "wide child": (
        run(build=BuildSettings(widths_mm=(40.0, 36.0))), "on level 2 at most 33.3333 mm", "W02"
    ),
    "narrow child": (
        run(build=BuildSettings(widths_mm=(40.0, 8.0))),
        "at least 8.4 mm on level 2, as width_ratio narrows it to level 3", "W01",
    ),
    "narrow child alone": (
        run(build=BuildSettings(widths_mm=(40.0, 20.0, 4.0))), "at least 5 mm on level 3", "W01"
    ),
    "short tail": (run(build=BuildSettings(tail_mm=100.0)), "build.tail_mm is 100.0", "B01"),
    "long tail": (
        run(build=BuildSettings(tail_mm=3000.0)), "tail_mm: the shortest trunk and its tail", "S01"
    ),
    "full pouch": (
        run(bounds(2, 2), BuildSettings(trunk_width_mm=30.0, width_ratio=0.4, pouch=FULL)),
        "its film would fill 65 % of the narrowest", "W03",
    ),
    "short pouch": (
        run(build=BuildSettings(pouch=WIDE, pressure_kpa=5.0)), "pouch.length_mm is 3.0", "C07"
    ),
    "narrow pouch": (run(build=BuildSettings(pouch=SMALL)), "4 mm are no wider than", "C07"),
    "narrow fan": (run(angle_deg=bounds(1, 10)), "space.angle_deg is [1, 10]", "C02"),
    "folded fan": (run(angle_deg=bounds(340, 360)), "from 15 to 330", "C02"),
    "crowd": (run(bounds(2, 2), branches=bounds(30, 40)), "11 children or fewer", "C02"),
    "short branches": (run(length_mm=bounds(1, 20)), "lengths from 40 mm", "C03"),
    "long trunk": (run(length_mm=bounds(1000, 1200)), "space.length_mm: the shortest trunk", "S01"),
    "full": (
        run(bounds(4, 4), branches=bounds(4, 4)),
        "of the trunk (VF-W03); allow fewer, or set build.trunk_width_mm = 54.3", "W03",
    ),
    "thin leaves": (
        run(build=BuildSettings(trunk_width_mm=90.0, width_ratio=0.25, pressure_kpa=5.0)),
        "build.width_ratio: growth through the leaves", "P03",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("settings", "words", "rule"), INFEASIBLE.values(), ids=INFEASIBLE)
def test_refused_spaces_have_no_manufacturable_design(settings, words, rule):
    message = refused(settings)
    assert words in message
    assert f"(VF-{rule})" in message
    assert message.endswith(", or evaluation.fabricable = false")
    space = Space(settings.space, settings.build)
    for x in np.random.default_rng(5).random((12, len(space))):
        design = space.design(x)
        assert PENALTY(design) > 0.0 or not PENALTY.passes(design)


def test_the_width_that_is_named_holds_the_film():
    wide = run(bounds(4, 4), BuildSettings(trunk_width_mm=54.3), branches=bounds(4, 4))
    assert "W03" not in refused(wide)


def test_a_pressure_is_refused_where_the_seams_limit_was_measured():
    settings = run(build=BuildSettings(pressure_kpa=60.0))
    assert refused(settings) == ""
    message = refused(settings, measured_film(PROFILE))
    assert message.startswith("build.pressure_kpa: a tube 40.0 mm wide")
    assert "(VF-P01); lower the pressure" in message


FEASIBLE = {
    "the paper's": RunSettings(),
    "deep": run(bounds(5, 5), branches=bounds(2, 2)),
    "narrow": run(bounds(2, 5), BuildSettings(trunk_width_mm=8.4)),
    "wide children": run(bounds(2, 2), BuildSettings(width_ratio=0.83)),
    "short tail": run(build=BuildSettings(tail_mm=150.0)),
    "vines": run(bounds(1, 5), BuildSettings(trunk_width_mm=5.0), length_mm=bounds(1, 300)),
    "eleven": run(bounds(2, 2), branches=bounds(11, 12), angle_deg=bounds(20, 160)),
    "short branches": run(bounds(2, 2), length_mm=bounds(1, 41)),
}


@pytest.mark.parametrize("settings", FEASIBLE.values(), ids=FEASIBLE)
def test_spaces_with_a_corner_that_passes_each_rule_are_left_to_the_search(settings):
    assert refused(settings) == ""


def test_a_level_of_its_own_is_named():
    by_level = {3: {"angle_deg": bounds(2, 9)}}
    message = refused(RunSettings(space=SpaceSettings(levels=THREE, by_level=by_level)))
    assert "space.level 3.angle_deg is [2, 9]" in message
    # Not where designs may do without that level.
    assert refused(RunSettings(space=SpaceSettings(levels=bounds(2, 5), by_level=by_level))) == ""


def test_the_limits_of_the_recipe_count():
    settings = run(build=BuildSettings(trunk_width_mm=14.0))
    assert refused(settings) == ""
    recipe = PROFILE.recipe.changed(limits={"VF-W01": {"error": 6.0}})
    assert "(VF-W01)" in refused(settings, replace(PROFILE, recipe=recipe))
    film = PROFILE.material.changed(weldable=False)
    message = refused(settings, replace(PROFILE, material=film))
    assert "evaluation.recipe: " in message
    assert "does not weld" in message
