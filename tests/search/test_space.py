import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vinefab.core.errors import BadInputError
from vinefab.model.design import Design
from vinefab.search.space import Bounds, BuildSettings, Space, SpaceSettings

TABLE_1 = Space(SpaceSettings(), BuildSettings())
POINTS = st.lists(st.floats(0.0, 1.0), min_size=18, max_size=18).map(np.array)


@given(POINTS)
def test_every_point_is_a_design_within_table_1(x):
    design = TABLE_1.design(x)
    assert 2 <= design.depth <= 5
    assert 10.0 <= design.trunk_length_mm <= 205.0
    for level in design.levels:
        assert 10.0 <= level.length_mm <= 205.0
        assert np.radians(20.0) <= level.fan_rad <= np.radians(160.0)
        assert 2 <= level.branches <= 4
        assert 0.1 <= level.growth <= 1.6


@given(POINTS)
def test_a_design_leads_back_to_itself(x):
    design = TABLE_1.design(x)
    assert TABLE_1.design(TABLE_1.vector(design)) == design


@given(POINTS)
def test_levels_that_a_design_does_not_have_do_not_matter(x):
    depth = TABLE_1.design(x).depth
    other = x.copy()
    for index, variable in enumerate(TABLE_1.variables):
        if variable.level > depth:
            other[index] = 1.0 - other[index]
    assert TABLE_1.design(other) == TABLE_1.design(x)


def test_whole_numbers_have_equal_shares():
    x = np.full(18, 0.5)
    depths = []
    for share in np.linspace(0.0, 1.0, 401):
        x[0] = share
        depths.append(TABLE_1.design(x).depth)
    counts = np.bincount(depths)[2:]
    assert counts.tolist() == pytest.approx([100, 100, 100, 101])


def test_the_ends_of_the_cube_are_the_ends_of_the_ranges():
    least, most = TABLE_1.design(np.zeros(18)), TABLE_1.design(np.ones(18))
    assert (least.depth, least.trunk_length_mm, least.levels[0].branches) == (2, 10.0, 2)
    assert (most.depth, most.trunk_length_mm, most.levels[3].branches) == (5, 205.0, 4)


def test_numbers_are_written_in_hundredths():
    design = TABLE_1.design(np.random.default_rng(1).random(18))
    assert design.trunk_length_mm == round(design.trunk_length_mm, 2)


def test_fixed_values_and_single_levels_leave_the_vector():
    settings = SpaceSettings(
        levels=Bounds(low=3, high=3),
        branches=Bounds(low=2, high=2),
        by_level={1: {"length_mm": Bounds(low=80.0, high=80.0)}},
    )
    space = Space(settings, BuildSettings(trunk_width_mm=30.0, width_ratio=0.5))
    assert [(v.level, v.name) for v in space.variables] == [
        (level, name) for level in (2, 3) for name in ("length_mm", "angle_deg", "growth_percent")
    ]
    design = space.design(np.full(6, 0.3))
    assert design.trunk_length_mm == 80.0
    assert design.depth == 3
    assert design.build.widths_mm == (30.0, 15.0, 7.5)


def test_a_plain_vine_is_a_point_too():
    space = Space(SpaceSettings(levels=Bounds(low=1, high=1)), BuildSettings())
    assert len(space) == 1
    assert space.design(np.array([1.0])).levels == ()


def test_a_design_outside_the_bounds_gives_the_nearest_point():
    far = Design(name="far", trunk_length_mm=900.0, build=BuildSettings().build(1))
    assert TABLE_1.design(TABLE_1.vector(far)).trunk_length_mm == 205.0


@pytest.mark.parametrize(
    ("key", "bounds"),
    [
        ("levels", Bounds(low=0, high=3)),
        ("levels", Bounds(low=2, high=11)),
        ("branches", Bounds(low=2.5, high=3)),
        ("length_mm", Bounds(low=20, high=10)),
        ("angle_deg", Bounds(low=0, high=361)),
        ("growth_percent", [float("nan"), 100]),
    ],
)
def test_impossible_bounds_are_refused(key, bounds):
    with pytest.raises(BadInputError, match=f"^{key}"):
        SpaceSettings(**{key: bounds})


def test_the_widths_of_the_first_levels_may_be_given():
    build = BuildSettings(widths_mm=(36.0, 20.0), width_ratio=0.5)
    assert build.build(1).widths_mm == (36.0,)
    assert build.build(4).widths_mm == (36.0, 20.0, 10.0, 5.0)
    assert BuildSettings().build(3).widths_mm == BuildSettings(widths_mm=(40.0,)).build(3).widths_mm
    with pytest.raises(BadInputError, match=r"^widths_mm\[2\] is 0"):
        BuildSettings(widths_mm=(36.0, 0.0))
    with pytest.raises(BadInputError, match="at most 10"):
        BuildSettings(widths_mm=(1.0,) * 11)
