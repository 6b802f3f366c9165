"""Sets of robots that cover most: the greedy choice against all sets, and what one covers."""

from itertools import combinations

import numpy as np
import pytest
import shapely

from tests.prediction.test_pose_search import ERRORS, ROOM, trial_on
from vinefab.core.errors import BadInputError
from vinefab.core.rng import child
from vinefab.prediction.pose_search import PoseLandscape
from vinefab.prediction.robot_set import (
    GREEDY_SHARE,
    CoveredSets,
    TeamSearch,
    candidate_poses,
    chosen_greedily,
)
from vinefab.tasks.anchoring_force import Anchoring
from vinefab.tasks.coverage import Coverage
from vinefab.tasks.reach import Reach
from vinefab.tasks.task import cover_of


def random_sets(seed, candidates=9, draws=3, elements=37):
    rng = np.random.default_rng(seed)
    covered = rng.random((candidates, draws, elements)) < rng.uniform(0.05, 0.5, (candidates, 1, 1))
    weight = rng.random(elements)
    sets = CoveredSets(bits=np.packbits(covered, axis=-1), weight=weight / weight.sum())
    return sets, covered


@pytest.mark.parametrize("seed", range(12))
def test_greedy_sets_hold_their_bounds_against_all_sets(seed):
    sets, covered = random_sets(seed)

    def share(members):
        return float((covered[list(members)].any(axis=0) @ sets.weight).mean())

    found = chosen_greedily(sets, 4)
    for count in range(1, 5):
        best = max(share(members) for members in combinations(range(len(sets)), count))
        got = found.covered[count - 1]
        assert got == pytest.approx(share(found.chosen[:count]))
        assert GREEDY_SHARE * best <= got <= best + 1e-12
        assert best <= found.bounds[count - 1] + 1e-12
    assert found.covered[0] == pytest.approx(found.bounds[0])


def test_gains_are_what_each_candidate_adds():
    sets, covered = random_sets(3)
    held = covered[[1, 4]].any(axis=0)
    gains = sets.gains(held)
    for index in range(len(sets)):
        added = sets.share(held | covered[index]) - sets.share(held)
        assert gains[index] == pytest.approx(added)
    assert gains[[1, 4]] == pytest.approx([0.0, 0.0])


def test_more_robots_than_candidates_are_all_of_them():
    sets, _ = random_sets(5, candidates=2)
    found = chosen_greedily(sets, 5)
    assert sorted(found.chosen) == [0, 1]
    assert len(found.bounds) == 2


def test_what_one_deployment_covers_has_the_area_that_the_task_measures():
    trial = trial_on(ROOM)
    pose, draws = np.array([(30.0, 40.0, 0.7)]), ERRORS.even(3)
    context = trial.prepared.context
    for task in (Reach(), Coverage(), Coverage(clip="sight")):
        cover = cover_of(task, context)
        (bits,) = trial.each(pose, draws, cover.covered)
        shares = bits @ cover.weight
        for grown, share in zip(trial.deployments(pose[0], draws), shares, strict=True):
            score, terms = task.evaluate(grown, context)
            assert share == pytest.approx(terms.get("area", score), abs=0.012)
    assert cover_of(Reach(), context).weight.sum() == pytest.approx(1.0)


def test_targets_are_covered_where_the_task_counts_them():
    trial = trial_on(ROOM)
    task = Reach(targets=((60.0, 60.0), (290.0, 190.0), (20.0, 30.0)), falloff_mm=0.0)
    cover = cover_of(task, trial.prepared.context)
    pose, draws = np.array([(20.0, 30.0, 0.7)]), ERRORS.even(4)
    (bits,) = trial.each(pose, draws, cover.covered)
    scores = trial.scores(task, pose, draws)[0]
    assert bits @ cover.weight == pytest.approx(scores)
    assert bits[:, 2].all()
    assert not bits[:, 1].any()


def test_a_task_without_a_union_is_refused():
    with pytest.raises(BadInputError, match="anchoring"):
        cover_of(Anchoring(), trial_on(ROOM).prepared.context)


def landscape_of(places, scores):
    return PoseLandscape(
        places_mm=np.array(places),
        spacing_mm=10.0,
        headings_rad=np.linspace(0.0, 2.0 * np.pi, scores.shape[1], endpoint=False),
        scores=scores,
        draws=4,
    )


def test_candidates_are_peaks_of_every_place_first():
    scores = np.array([[0.1, 0.9, 0.8, 0.2, 0.3, 0.2], [np.nan] * 6, [0.5, np.nan, 0.1, 0.4, 0, 0]])
    landscape = landscape_of([(0.0, 0.0), (1.0, 0.0), (2.0, 0.0)], scores)
    extra = np.array([(9.0, 9.0, 9.0)])
    found = candidate_poses(landscape, 4, extra)
    assert found[0].tolist() == [9.0, 9.0, 9.0]
    turns = (found[1:, 2] / (np.pi / 3.0)).round().astype(int).tolist()
    assert list(zip(found[1:, 0].tolist(), turns, strict=True)) == [(0, 1), (0, 4), (2, 0), (2, 3)]


def test_two_robots_take_two_rooms():
    """Two rooms with a wall between: whatever the first covers, the second is in the other one."""
    wall = shapely.box(148.0, 0.0, 152.0, 200.0)
    world = type(ROOM)(name="rooms", bounds=ROOM.bounds, obstacles=(wall,))
    trial = trial_on(world)
    context = trial.prepared.context
    places = [(x, 100.0) for x in (40.0, 60.0, 200.0, 260.0)]
    landscape = landscape_of(places, np.full((4, 4), 0.5))
    team = TeamSearch(
        trial=trial, cover=cover_of(Reach(), context), errors=ERRORS, tell=lambda _: None
    )
    found = team.choose(landscape, np.array([40.0, 100.0, 0.0]), 2, 100, child(0, 1))
    assert len({x < 150.0 for x, _, _ in found.poses}) == 2
    assert (np.diff(found.fresh, axis=0) > 0.1).all()
    assert found.fresh[1].mean() == pytest.approx(found.choice.covered[1], abs=0.05)
    assert GREEDY_SHARE <= found.least_share <= 1.0
