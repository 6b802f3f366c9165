import math
from collections.abc import Callable

import pytest

from vinefab.model.deployment import Deployment
from vinefab.model.design import Build, Design, Level
from vinefab.tasks.anchoring import Anchoring, path_turn_rad
from vinefab.tasks.ground import Ground

LINE = [(0, 0), (10, 10)]


def test_turns_add_up_along_each_path_and_leaves_add_up(
    fork: Design, ended: Callable[..., Deployment], room_ground: Ground
) -> None:
    end = ended(fork, [LINE] * 3, turns=[1.0, 0.5, 2.0])
    score, terms = Anchoring(friction=0.3).evaluate(end, room_ground)
    assert score == pytest.approx(math.exp(0.3 * 1.5) + math.exp(0.3 * 3.0))
    assert terms["engaged"] == 2
    assert terms["largest_turn_rad"] == pytest.approx(3.0)


def test_a_leaf_that_did_not_emerge_holds_nothing(
    fork: Design, ended: Callable[..., Deployment], room_ground: Ground
) -> None:
    end = ended(fork, [LINE, LINE, None], turns=[0.0, 0.0, 0.0])
    assert Anchoring().evaluate(end, room_ground)[0] == pytest.approx(1.0)
    nothing = ended(fork, [LINE, None, None])
    assert Anchoring().evaluate(nothing, room_ground)[0] == 0.0


def test_six_branches_without_turns_hold_six_times_one(
    ended: Callable[..., Deployment], room_ground: Ground
) -> None:
    levels = tuple(Level(branches=k, length_mm=50.0, fan_rad=1.0) for k in (2, 3))
    design = Design(name="six", trunk_length_mm=100.0, levels=levels, build=Build.standard(3))
    end = ended(design, [LINE] * 9)
    assert Anchoring().evaluate(end, room_ground)[0] == pytest.approx(6.0)


def test_turns_reach_the_third_level(ended: Callable[..., Deployment]) -> None:
    levels = (Level(branches=2, length_mm=50.0, fan_rad=1.0),) * 2
    design = Design(name="deep", trunk_length_mm=100.0, levels=levels, build=Build.standard(3))
    turns = [1.0, 10.0, 20.0, 100.0, 200.0, 300.0, 400.0]
    total = path_turn_rad(ended(design, [LINE] * 7, turns=turns))
    assert total.tolist() == [1.0, 11.0, 21.0, 111.0, 211.0, 321.0, 421.0]
