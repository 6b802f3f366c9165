import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vinefab.core.errors import BadInputError
from vinefab.model.laser import Standing
from vinefab.physics.growth_pressure import (
    FITTED,
    capstan_factor,
    growth_pressure_bound_kpa,
    growth_pressure_kpa,
)

RIGHT = math.pi / 2


@pytest.mark.parametrize(("turns", "expected"), [(0, 10.5), (2, 20.3), (4, 40.9), (6, 83.7)])
def test_right_angles_between_segments_of_300_mm(turns: int, expected: float) -> None:
    found = growth_pressure_kpa([300.0] * (turns + 1), [RIGHT] * turns)
    assert found == pytest.approx(expected, abs=0.05)


@given(
    st.lists(st.tuples(st.floats(0, 2000), st.floats(-2, 2)), min_size=1, max_size=8),
    st.floats(0, 2000),
)
def test_the_summed_form_is_an_upper_bound(
    steps: list[tuple[float, float]], last_mm: float
) -> None:
    lengths, turns = [length for length, _ in steps] + [last_mm], [turn for _, turn in steps]
    bound = growth_pressure_bound_kpa(sum(lengths), float(np.abs(turns).sum()))
    assert growth_pressure_kpa(lengths, turns) <= bound * (1 + 1e-12)


def test_the_bound_is_reached_when_the_turn_comes_last() -> None:
    assert growth_pressure_kpa([500.0, 0.0], [1.0]) == pytest.approx(
        growth_pressure_bound_kpa(500.0, 1.0)
    )


def test_a_late_turn_costs_more_than_an_early_one() -> None:
    early, late = [100.0, 900.0], [900.0, 100.0]
    assert growth_pressure_kpa(late, [RIGHT]) > growth_pressure_kpa(early, [RIGHT])


def test_turns_count_whichever_way_they_go() -> None:
    left, right = growth_pressure_kpa([1.0, 1.0], [0.7]), growth_pressure_kpa([1.0, 1.0], [-0.7])
    assert left == right


def test_one_turn_too_many_is_refused() -> None:
    with pytest.raises(BadInputError, match="turns_rad"):
        growth_pressure_kpa([300.0], [RIGHT])


def test_half_the_diameter_takes_twice_the_pressure_and_is_only_assumed() -> None:
    thin = FITTED.at_diameter(10.0, 20.0)
    assert growth_pressure_kpa([700.0], [], thin) == pytest.approx(
        2 * growth_pressure_kpa([700.0], [])
    )
    assert thin.yield_kpa.standing is Standing.ASSUMED
    assert thin.friction == FITTED.friction


def test_capstan_multiplies_over_turns() -> None:
    whole = capstan_factor(0.3, 2.0)
    assert capstan_factor(0.3, 0.5) * capstan_factor(0.3, -1.5) == pytest.approx(whole)
    assert whole == pytest.approx(math.exp(0.6))
