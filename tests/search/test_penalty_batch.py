"""The compiled penalty of many designs against the readable one of each."""

import numpy as np
import pytest

from vinefab.fabrication.rules.penalty import MOST_CHECKED_BRANCHES
from vinefab.model.design import MOST_BRANCHES, Pouch
from vinefab.model.files.profile_toml import read_profile
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.search.evaluator import SpacePenalty
from vinefab.search.manufacturability import ManufacturabilityPenalty
from vinefab.search.space import Bounds, BuildSettings, Space, SpaceSettings

PENALTY = ManufacturabilityPenalty(profile=read_profile(DEFAULT_RECIPE))
TABLE_1 = SpaceSettings(levels=Bounds(low=1, high=5), branches=Bounds(low=1, high=4))
BENCH = SpaceSettings(
    levels=Bounds(low=2, high=4),
    branches=Bounds(low=2, high=3),
    length_mm=Bounds(low=20, high=120),
    angle_deg=Bounds(low=0, high=360),
)
POUCHES = {
    "bare": None,
    "round": Pouch(shape="round", radius_mm=12.0),
    "rectangle": Pouch(shape="rectangle", length_mm=20.0, width_mm=30.0),
}


def both(space: Space, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Penalties of points, at once and one by one."""
    return PENALTY.within(space)(space.batch(x)), np.array([PENALTY(space.design(p)) for p in x])


@pytest.mark.parametrize("pouch", POUCHES.values(), ids=POUCHES)
@pytest.mark.parametrize("ratio", [0.65, 1.0])
@pytest.mark.parametrize("settings", [TABLE_1, BENCH], ids=["table 1", "bench"])
def test_penalties_at_once_are_those_one_by_one(
    settings: SpaceSettings, ratio: float, pouch: Pouch | None
) -> None:
    space = Space(settings, BuildSettings(width_ratio=ratio, pouch=pouch, trunk_width_mm=30.0))
    x = np.random.default_rng(3).random((120, len(space)))
    # Corners of the space, with branches that are parallel, coincide, or touch at their ends.
    x[:40] = np.round(x[:40])
    found, wanted = both(space, x)
    assert np.array_equal(found == 0.0, wanted == 0.0)
    assert np.abs(found - wanted).max() < 1e-9
    assert (wanted > 0.0).sum() > 50


def test_both_agree_which_designs_have_none() -> None:
    space = Space(BENCH, BuildSettings(trunk_width_mm=24.0))
    found, wanted = both(space, 0.3 + 0.4 * np.random.default_rng(4).random((300, len(space))))
    assert 20 < (wanted == 0.0).sum() < 280
    assert np.array_equal(found == 0.0, wanted == 0.0)


def test_each_design_alone_has_the_penalty_that_it_has_among_others() -> None:
    space = Space(TABLE_1, BuildSettings())
    designs = space.batch(np.random.default_rng(5).random((30, len(space))))
    penalty = PENALTY.within(space)
    alone = [penalty(designs.part(np.array([row])))[0] for row in range(30)]
    assert penalty(designs).tolist() == alone


def test_large_trees_count_by_their_size_and_too_large_ones_have_no_penalty() -> None:
    wide = Bounds(low=50, high=50)
    settings = SpaceSettings(levels=Bounds(low=3, high=4), branches=wide)
    space = Space(settings, BuildSettings())
    x = np.full((2, len(space)), 0.5)
    x[:, 0] = 0.1, 0.9
    designs = space.batch(x)
    assert MOST_CHECKED_BRANCHES < designs.sizes[0] < MOST_BRANCHES < designs.sizes[1]
    large, invalid = PENALTY.within(space)(designs)
    assert large == pytest.approx(PENALTY(space.design(x[0])), abs=1e-9)
    assert np.isnan(invalid)


def test_the_search_takes_the_faster_one() -> None:
    assert isinstance(PENALTY, SpacePenalty)
