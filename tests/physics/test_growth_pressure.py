"""Growth pressure along a path, and along every path of a tree."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vinefab.core.errors import BadInputError
from vinefab.model.design import Build, Design, Level
from vinefab.model.quantity import Standing
from vinefab.physics.growth_pressure import (
    FITTED,
    GrowthPath,
    capstan_factor,
    growth_pressure_kpa,
    planned_growth_kpa,
    planned_paths,
    riding_mm,
)
from vinefab.physics.tube import inflated_diameter_mm

# --- One path --------------------------------------------------------------------------------

RIGHT = math.pi / 2


def _bound_kpa(length_mm: float, turn_rad: float) -> float:
    """Y + (f L + T) e^(mu sum |theta|): the pressure if every turn came at the path's very end."""
    drag_kpa = FITTED.drag_kpa_m.value * length_mm / 1000.0
    factor = math.exp(FITTED.friction.value * turn_rad)
    return FITTED.yield_kpa.value + (drag_kpa + FITTED.storage_kpa.value) * factor


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
    bound = _bound_kpa(sum(lengths), float(np.abs(turns).sum()))
    assert growth_pressure_kpa(lengths, turns) <= bound * (1 + 1e-12)


def test_the_bound_is_reached_when_the_turn_comes_last() -> None:
    assert growth_pressure_kpa([500.0, 0.0], [1.0]) == pytest.approx(_bound_kpa(500.0, 1.0))


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


# --- Paths through a tree --------------------------------------------------------------------

FORK = Level(branches=2, length_mm=100.0, fan_rad=1.0, growth=0.5)
TREE = Design(name="tree", trunk_length_mm=200.0, levels=(FORK, FORK), build=Build.standard(3))


def test_planned_paths_turn_at_joints_only() -> None:
    paths = planned_paths(TREE.tree)
    assert paths[0] == GrowthPath(lengths_mm=(200.0,), turns_rad=())
    assert paths[-1] == GrowthPath(lengths_mm=(200.0, 50.0, 50.0), turns_rad=(0.5, 0.5))
    assert paths[-1].length_mm == 300.0
    assert paths[-1].turn_rad == 1.0


def test_film_that_rides_along_costs_drag_before_every_turn() -> None:
    path = GrowthPath(lengths_mm=(0.0, 42.0, 30.0), turns_rad=(math.pi / 4, math.pi / 4))
    by_hand = growth_pressure_kpa(path.lengths_mm, path.turns_rad)
    assert path.pressure_kpa(FITTED) == by_hand
    riding = 0.771 * math.exp(0.234 * math.pi / 2)
    assert path.pressure_kpa(FITTED, riding_mm=1000.0) == pytest.approx(by_hand + riding)


def test_descendants_ride_weighted_by_their_width() -> None:
    tree = TREE.tree
    widths_mm = np.array([40.0, 24.0, 12.0])[tree.level - 1]
    riding = riding_mm(replace(tree, width_mm=widths_mm))
    # each child carries 100 + 50 mm of half its width; the trunk carries all of it
    assert riding[1:3] == pytest.approx([75.0, 75.0])
    assert riding[0] == pytest.approx((150.0 * 24.0 + 300.0 * 12.0) / 40.0)
    assert riding[3:] == pytest.approx(0.0)


# --- All paths of a tree at once -------------------------------------------------------------


@pytest.mark.parametrize("depth", [1, 2, 4])
def test_the_tree_at_once_is_what_each_path_gives(depth: int) -> None:
    fan = Level(branches=3, length_mm=80.0, fan_rad=2.0, growth=0.6)
    build = Build.standard(depth, 30.0)
    levels = (fan,) * (depth - 1)
    tree = Design(name="t", trunk_length_mm=150.0, levels=levels, build=build).tree
    riding = riding_mm(tree)
    expected = [
        path.pressure_kpa(
            FITTED.at_diameter(inflated_diameter_mm(build.widths_mm[level - 1]), 25.0), ride
        )
        for path, level, ride in zip(
            planned_paths(tree), tree.level.tolist(), riding.tolist(), strict=True
        )
    ]
    found = planned_growth_kpa(tree, FITTED, 25.0)
    assert found.tolist() == pytest.approx(expected, rel=1e-12)
