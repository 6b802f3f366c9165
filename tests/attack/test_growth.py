"""A little of ``make fuzz``; that failures are seen, in every run of the tests."""

import pytest

from tests.attack import growth as fuzz

GROWTHS = 600


def test_every_growth_option_is_tried():
    rng = fuzz.np.random.default_rng(1)
    drawn = [fuzz.nasty_options(rng) for _ in range(60)]
    for name in fuzz.GrowthOptions.model_fields:
        assert len({getattr(one, name) for one in drawn}) > 1 or name in ("contacts", "surface")


@pytest.mark.thorough
def test_growth_on_nasty_maps():
    found = fuzz.fuzz(GROWTHS)
    assert sum(counts.growths for counts in found.values()) >= GROWTHS
    for kind, counts in found.items():
        assert counts.failures == 0, (kind, counts)
    # Maps and pressure are in the way of many, and many bodies are wide.
    branches = sum(counts.branches for counts in found.values())
    assert branches > sum(counts.growths for counts in found.values())
    assert sum(counts.events for counts in found.values()) > branches
    assert sum(counts.held for counts in found.values()) > branches / 10
    assert sum(counts.inflated for counts in found.values()) > branches / 10


def test_both_engines_draw_the_same_children_of_every_launch():
    counts = fuzz.Counts()
    fuzz.fuzz_map(counts, "gaps", 11)
    assert counts.stayed_in > 10
    assert counts.failures == 0


def test_failures_are_seen(monkeypatch):
    monkeypatch.setattr(fuzz, "MOST_EVENTS", 3)
    monkeypatch.setattr(fuzz, "EXACT", -1.0)
    counts = fuzz.Counts()
    fuzz.fuzz_map(counts, "rounded", 2)
    assert counts.endless == 1
    assert counts.outside == counts.disagree == counts.growths > 0
    assert counts.seeds == [2]


def test_moved_worlds_give_the_same_growths():
    found = fuzz.moves(240)
    assert set(found) == set(fuzz.MOVES)
    for name, counts in found.items():
        assert counts.differ == 0, (name, counts)
        assert counts.ties <= counts.growths // 4
        assert counts.stopped > 0


def test_growths_that_differ_are_seen(monkeypatch):
    monkeypatch.setattr(fuzz, "SAME", -1.0)
    monkeypatch.setattr(fuzz, "is_tie", lambda *_: False)
    counts = fuzz.MoveCounts()
    fuzz.move_map(counts, "turn", "stars", 1)
    assert counts.differ == counts.growths > 0
    assert counts.seeds[0] == ("stars", 1)


def test_a_start_beside_a_corner_is_a_tie():
    """Half a nudge to one side it slides along the wall, to the other it passes."""
    world = fuzz.Map(name="m", bounds=fuzz.box(0, 0, 9, 9), obstacles=(fuzz.box(4, 4, 5, 5),))
    terrain, options = fuzz.Terrain.of(world), fuzz.GrowthOptions.published()
    design = fuzz.Design(name="d", trunk_length_mm=6.0, build=fuzz.Build.standard(1))
    for x_mm, tie in ((4.0, True), (3.0, False)):
        pose = fuzz.Pose(x_mm=x_mm, y_mm=1.0, heading_rad=fuzz.math.pi / 2.0)
        grown = fuzz.grow_on(design, terrain, pose, options, "kernel")
        assert fuzz.is_tie(grown, design, terrain, options, 1) == tie
