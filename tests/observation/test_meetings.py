"""Meetings of tips with walls, replayed from where branches were seen to begin."""

import math

import numpy as np
import pytest
import shapely

from vinefab.model.map import Map
from vinefab.observation.beside_prediction import (
    Replays,
    SeenBranch,
    apart_mm,
    seen_meetings,
    wall_order,
)

WORLD = Map(
    name="walls",
    bounds=shapely.box(0, 0, 200, 200),
    obstacles=(shapely.box(20, 100, 180, 120),),
)
BASE = np.array([100.0, 40.0])
RADIUS = 4.0


def seen_of(points, planned, heading_deg, *, early):
    return SeenBranch(
        points_mm=np.array(points, dtype=float),
        length_mm=float(np.hypot(*np.diff(np.array(points, dtype=float), axis=0).T).sum()),
        planned_mm=planned,
        ends_early=early,
        radius_mm=RADIUS,
        heading_rad=math.radians(heading_deg),
        heading_error_deg=0.5,
    )


@pytest.mark.parametrize("off_deg", [5.0, 20.0, 45.0])
def test_a_wall_is_met_at_the_angle_between_heading_and_normal(off_deg):
    replay = Replays(WORLD).grown(BASE, math.radians(90.0 - off_deg), 150.0, RADIUS)
    first = replay.meetings[0]
    assert first.angle_from_normal_deg == pytest.approx(off_deg, abs=1e-6)
    assert first.y_mm == pytest.approx(100.0 - RADIUS)
    assert first.wall == "obstacle 0"
    assert first.front_mm == pytest.approx(56.0 / math.cos(math.radians(off_deg)))


def test_a_tip_that_slid_and_one_that_stopped_are_told_apart():
    replays = Replays(WORLD)
    slid = replays.grown(BASE, math.radians(80.0), 90.0, RADIUS)
    contacts, stop = seen_meetings(replays, seen_of(slid.chain_mm, 90.0, 80.0, early=False))
    assert [contact.outcome for contact in contacts] == ["slid"]
    assert stop == "full_length"
    tip = BASE + 56.0 / math.cos(math.radians(10.0)) * np.array(
        [math.cos(math.radians(80.0)), math.sin(math.radians(80.0))]
    )
    contacts, stop = seen_meetings(replays, seen_of([BASE, tip], 90.0, 80.0, early=True))
    assert [contact.outcome for contact in contacts] == ["stopped"]
    assert contacts[0].angle_from_normal_deg == pytest.approx(10.0, abs=0.6)
    assert contacts[0].distance_mm == pytest.approx(RADIUS, abs=0.1)
    assert stop == "head_on"


def test_a_branch_that_ends_in_the_open_is_unclear():
    seen = seen_of([BASE, (100.0, 70.0)], 90.0, 90.0, early=True)
    assert seen_meetings(Replays(WORLD), seen) == ((), "unclear")


def test_what_is_met_within_the_error_of_the_length_is_unclear():
    replays = Replays(WORLD)
    short = replays.grown(BASE, math.radians(80.0), 57.5, RADIUS)  # 56.9 mm to the wall
    assert len(short.meetings) == 1
    contacts, _ = seen_meetings(replays, seen_of(short.chain_mm, 57.5, 80.0, early=False))
    assert [contact.outcome for contact in contacts] == ["unclear"]


def test_a_slide_counts_only_where_the_replay_lies_within_millimetres_of_the_line():
    replays = Replays(WORLD)
    slid = replays.grown(BASE, math.radians(80.0), 90.0, RADIUS)
    for off_mm, outcome in ((1.0, "slid"), (12.0, "unclear")):
        # Bent to the side halfway to the wall; along the wall it lies where the replay does.
        bent = 0.5 * (BASE + slid.chain_mm[1]) + (off_mm, 0.0)
        drawn = np.array([BASE, bent, *slid.chain_mm[1:]])
        contacts, _ = seen_meetings(replays, seen_of(drawn, 90.0, 80.0, early=False))
        assert [contact.outcome for contact in contacts] == [outcome], off_mm


def test_distance_and_order():
    line = np.array([(0.0, 0.0), (50.0, 0.0)])
    assert apart_mm(line, np.add(line, (0.0, 3.0))) == pytest.approx(3.0)
    assert apart_mm(line, np.zeros((0, 2))) == float("inf")
    assert wall_order([]) == []
