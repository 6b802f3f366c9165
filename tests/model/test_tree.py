import math

import numpy as np
import pytest

from vinefab.model.design import Build, Design, Level
from vinefab.model.tree import child_lengths_mm, fan_offsets_rad


def fan(branches: int, fan_rad: float = 1.2, growth: float = 0.5) -> Level:
    return Level(branches=branches, length_mm=100.0, fan_rad=fan_rad, growth=growth)


def test_offsets_run_from_clockwise_to_counter_clockwise():
    assert fan_offsets_rad(fan(3)) == pytest.approx([-0.6, 0.0, 0.6])
    assert fan_offsets_rad(fan(2)) == pytest.approx([-0.6, 0.6])


def test_a_single_child_goes_straight_on_at_full_length():
    assert fan_offsets_rad(fan(1)).tolist() == [0.0]
    assert child_lengths_mm(fan(1)).tolist() == [100.0]


def test_growth_is_the_last_childs_length_over_the_firsts():
    assert child_lengths_mm(fan(3)) == pytest.approx([100.0, 75.0, 50.0])


def test_tree_has_every_branch_with_the_id_of_its_path():
    design = Design(
        name="t", trunk_length_mm=50.0, levels=(fan(2), fan(3)), build=Build.standard(3)
    )
    tree = design.tree
    assert len(tree) == design.branch_count == 9
    assert tree.ids[:3] == ("0", "0.0", "0.1")
    assert tree.ids[-1] == "0.1.2"
    assert tree.level.tolist() == [1, 2, 2, 3, 3, 3, 3, 3, 3]
    assert tree.is_leaf.tolist() == [False] * 3 + [True] * 6
    assert (tree.parent[1:] < np.arange(1, 9)).all()
    assert math.isclose(tree.total_length_mm, 50 + 150 + 2 * 225)


def test_a_plain_vine_is_one_leaf():
    tree = Design(name="v", trunk_length_mm=5.0, build=Build.standard(1)).tree
    assert tree.ids == ("0",)
    assert tree.is_leaf.tolist() == [True]
