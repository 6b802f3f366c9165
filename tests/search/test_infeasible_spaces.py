"""What is refused before a search, against designs drawn from what is refused."""

from dataclasses import replace

import numpy as np
import pytest

from vinefab.core.errors import BadInputError
from vinefab.model.design import Pouch
from vinefab.model.files.profile_toml import read_profile
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.laser import LaserProfile
from vinefab.search.manufacturability import (
    ManufacturabilityPenalty,
    SpaceQuery,
    refuse_infeasible_space,
)
from vinefab.search.settings import RunSettings
from vinefab.search.space import Bounds, BuildSettings, Space, SpaceSettings

PROFILE = read_profile(DEFAULT_RECIPE)
MAKING = ManufacturabilityPenalty(profile=PROFILE)
THREE = Bounds(low=3, high=5)


def refused(settings: RunSettings, profile: LaserProfile = PROFILE) -> str:
    """Return why a run is refused; empty if it is not."""
    making = ManufacturabilityPenalty(profile=profile)
    try:
        refuse_infeasible_space(SpaceQuery.of(settings, profile, making.sheet_mm))
    except BadInputError as error:
        return str(error)
    return ""


def run(levels: Bounds = THREE, build: BuildSettings | None = None, **space: Bounds) -> RunSettings:
    settings = SpaceSettings(levels=levels, **space)
    return RunSettings(space=settings, build=build or BuildSettings())


def bounds(low: float, high: float) -> Bounds:
    return Bounds(low=low, high=high)


WIDE = Pouch(shape="rectangle", length_mm=3.0, width_mm=45.0)
SMALL = Pouch(shape="round", radius_mm=2.0)
IMPOSSIBLE = {
    "narrow trunk": (run(build=BuildSettings(trunk_width_mm=2.0)), "trunk_width_mm is 2.0", "W01"),
    "narrow level": (run(build=BuildSettings(trunk_width_mm=12.0)), "at least 13.9 mm", "W01"),
    "wide trunk": (run(build=BuildSettings(trunk_width_mm=120.0)), "at most 100 mm", "B02"),
    "wide children": (run(build=BuildSettings(width_ratio=0.9)), "at most 0.833", "W02"),
    "short tail": (run(build=BuildSettings(tail_mm=100.0)), "build.tail_mm is 100.0", "B01"),
    "long tail": (run(build=BuildSettings(tail_mm=3000.0)), "build.tail_mm is 3000.0", "S01"),
    "pressure": (run(build=BuildSettings(pressure_kpa=60.0)), "build.pressure_kpa is 60.0", "P01"),
    "short pouch": (
        run(build=BuildSettings(pouch=WIDE, pressure_kpa=5.0)), "pouch.length_mm is 3.0", "C07"
    ),
    "narrow pouch": (run(build=BuildSettings(pouch=SMALL)), "4 mm wide", "C07"),
    "narrow fan": (run(angle_deg=bounds(1, 10)), "space.angle_deg is [1, 10]", "C02"),
    "folded fan": (run(angle_deg=bounds(340, 360)), "from 15 to 330", "C02"),
    "crowd": (run(bounds(2, 2), branches=bounds(30, 40)), "11 children or fewer", "C02"),
    "short branches": (run(length_mm=bounds(1, 20)), "lengths from 40 mm on", "C03"),
    "long trunk": (run(length_mm=bounds(1000, 1200)), "space.length_mm is [1000, 1200]", "S01"),
    "full": (run(bounds(4, 4), branches=bounds(4, 4)), "would fill 81 %", "W03"),
    "thin leaves": (
        run(build=BuildSettings(trunk_width_mm=90.0, width_ratio=0.25, pressure_kpa=5.0)),
        "build.width_ratio is 0.25", "P03",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("settings", "words", "rule"), IMPOSSIBLE.values(), ids=IMPOSSIBLE)
def test_what_is_refused_has_no_design_that_can_be_made(
    settings: RunSettings, words: str, rule: str
) -> None:
    told = refused(settings)
    assert words in told
    assert f"(VF-{rule}), or evaluation.fabricable = false" in told
    space = Space(settings.space, settings.build)
    for x in np.random.default_rng(5).random((12, len(space))):
        design = space.design(x)
        assert MAKING(design) > 0.0 or not MAKING.passes(design)


POSSIBLE = {
    "the paper's": RunSettings(),
    "deep": run(bounds(5, 5), branches=bounds(2, 2)),
    "narrow": run(bounds(2, 5), BuildSettings(trunk_width_mm=8.4)),
    "wide children": run(bounds(2, 2), BuildSettings(width_ratio=0.83)),
    "short tail": run(build=BuildSettings(tail_mm=150.0)),
    "vines": run(bounds(1, 5), BuildSettings(trunk_width_mm=5.0), length_mm=bounds(1, 300)),
    "eleven": run(bounds(2, 2), branches=bounds(11, 12), angle_deg=bounds(20, 160)),
    "short branches": run(bounds(2, 2), length_mm=bounds(1, 41)),
}


@pytest.mark.parametrize("settings", POSSIBLE.values(), ids=POSSIBLE)
def test_what_one_rule_alone_allows_is_left_to_the_search(settings: RunSettings) -> None:
    assert refused(settings) == ""


def test_a_level_of_its_own_is_named() -> None:
    by_level = {3: {"angle_deg": bounds(2, 9)}}
    told = refused(RunSettings(space=SpaceSettings(levels=THREE, by_level=by_level)))
    assert "space.level 3.angle_deg is [2, 9]" in told
    # Not where designs may do without that level.
    assert refused(RunSettings(space=SpaceSettings(levels=bounds(2, 5), by_level=by_level))) == ""


def test_the_limits_of_the_recipe_count() -> None:
    settings = run(build=BuildSettings(trunk_width_mm=14.0))
    assert refused(settings) == ""
    recipe = replace(PROFILE.recipe, limits={"VF-W01": {"error": 6.0}})
    assert "(VF-W01)" in refused(settings, replace(PROFILE, recipe=recipe))
    film = replace(PROFILE.material, weldable=False)
    told = refused(settings, replace(PROFILE, material=film))
    assert "evaluation.recipe is" in told
    assert "does not weld" in told
