import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vinefab.core.errors import BadInputError
from vinefab.search.optimizers.optimizer import SearchAxes
from vinefab.search.space import Bounds, BuildSettings, Space, SpaceSettings

SPACES = [
    Space(SpaceSettings(), BuildSettings()),
    Space(SpaceSettings(levels=Bounds(low=3, high=3)), BuildSettings()),
    Space(
        SpaceSettings(levels=Bounds(low=1, high=4), branches=Bounds(low=2, high=2)), BuildSettings()
    ),
]


@pytest.mark.parametrize("space", SPACES)
@given(seed=st.integers(0, 10_000))
def test_points_settle_without_changing_their_design(space, seed):
    x = np.random.default_rng(seed).random((4, len(space)))
    settled = space.axes.canonical(x)
    assert [space.design(row) for row in settled] == [space.design(row) for row in x]
    np.testing.assert_array_equal(space.axes.canonical(settled), settled)


@pytest.mark.parametrize("space", SPACES)
def test_what_is_called_inactive_changes_no_design_and_what_is_active_does(space):
    rng = np.random.default_rng(3)
    for x in rng.random((60, len(space))):
        active = space.axes.active(x[None])[0]
        for axis in range(len(space)):
            moved = x.copy()
            moved[axis] = (x[axis] + 0.5) % 1.0
            assert (space.design(moved) != space.design(x)) == active[axis]


def test_whole_numbers_have_equal_shares():
    axes = SearchAxes(choices=(3, 0), levels=(0, 0))
    x = np.array([[0.0, 0.3], [0.34, 0.3], [0.67, 0.3], [1.0, 0.3]])
    assert axes.indices(x)[:, 0].tolist() == [0, 1, 2, 2]
    np.testing.assert_allclose(axes.canonical(x)[:, 0], [1 / 6, 1 / 2, 5 / 6, 5 / 6])


def test_axes_must_agree():
    with pytest.raises(BadInputError, match="axes"):
        SearchAxes(choices=(), levels=())
    with pytest.raises(BadInputError, match="axes"):
        SearchAxes(choices=(0, 0), levels=(0,))
