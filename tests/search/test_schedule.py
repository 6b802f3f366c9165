"""Poses drawn ahead are those drawn one generation at a time."""

from dataclasses import replace

import numpy as np

from vinefab.model.map import Map
from vinefab.search.evaluator import Evaluator
from vinefab.search.loop import AHEAD, Schedule
from vinefab.search.settings import RunSettings


def test_whoever_draws_ahead_draws_the_same(small: RunSettings, maps: tuple[Map, ...]) -> None:
    trial = Evaluator.of(small, maps, None)
    schedule = Schedule(trial, 3)
    for generation in (0, 1, AHEAD - 1, AHEAD, 3 * AHEAD + 2, 5):
        poses = schedule.poses(generation)
        assert poses == trial.training_poses(3, generation)
        ready, anew = trial.launches(poses), trial.launches(tuple(poses))
        assert ready is trial.launches(poses)
        np.testing.assert_array_equal(ready.start, anew.start)
        np.testing.assert_array_equal(ready.terrain, anew.terrain)


def test_poses_that_are_not_redrawn_are_drawn_once(
    small: RunSettings, maps: tuple[Map, ...]
) -> None:
    still = replace(small, evaluation=replace(small.evaluation, redraw=False))
    schedule = Schedule(Evaluator.of(still, maps, None), 3)
    assert schedule.poses(0) is schedule.poses(77)
