"""The cuts that a search finds: against what each case needs, and against the exact outlines."""

import math
from itertools import combinations

import numpy as np
import pytest

from vinefab.fabrication.job.passes import reach_mm
from vinefab.fabrication.job.sleeve import sleeve_size
from vinefab.fabrication.outline.layout import flat_layout
from vinefab.fabrication.pieces.bodies import sleeve_sides
from vinefab.fabrication.pieces.partition import partition_of
from vinefab.fabrication.pieces.quick_cuts import (
    MOST_PIECE_BRANCHES,
    PieceLimits,
    _TreeCuts,
    planned_sides,
    quick_cuts,
)
from vinefab.model.design import Build, Design, Level, PieceSettings
from vinefab.model.files.profile_toml import read_profile
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.search.space import Bounds, BuildSettings, Space, SpaceSettings

PROFILE = read_profile(DEFAULT_RECIPE)
CROSSING = Space(
    SpaceSettings(
        levels=Bounds(low=2, high=4),
        branches=Bounds(low=1, high=3),
        length_mm=Bounds(low=40, high=140),
        angle_deg=Bounds(low=20, high=300),
    ),
    BuildSettings(trunk_width_mm=24.0, width_ratio=0.65, pieces=PieceSettings()),
)


def limits(most: int = 6, sheet_mm: tuple[float, float] | None = (980.0, 580.0)) -> PieceLimits:
    build = Build.standard(1).changed(pieces=PieceSettings(most=most))
    return PieceLimits.of(build, PROFILE, {}, sheet_mm)


def tree(*levels: Level) -> Design:
    build = BuildSettings(trunk_width_mm=24.0, width_ratio=0.65, pieces=PieceSettings())
    return Design(
        name="tree", trunk_length_mm=120.0, levels=levels, build=build.build(1 + len(levels))
    )


def fan(branches: int, length_mm: float, angle_deg: float) -> Level:
    return Level(branches=branches, length_mm=length_mm, fan_rad=math.radians(angle_deg))


CROSSED = tree(fan(2, 100.0, 60.0), fan(2, 150.0, 130.0))
"""The inner grandchildren of both sides cross once."""


def random_designs(count: int, seed: int = 1) -> list[Design]:
    random = np.random.default_rng(seed)
    return [CROSSING.design(point) for point in random.random((count, len(CROSSING)))]


def test_one_crossing_takes_one_cut() -> None:
    found = quick_cuts(CROSSED, limits())
    assert found is not None
    assert found.left == 0.0
    assert len(found.branches) == 1
    assert found.branches[0] in (1, 2, 4, 5)


def test_what_lies_flat_takes_none() -> None:
    found = quick_cuts(tree(fan(3, 120.0, 150.0)), limits())
    assert found is not None
    assert (found.branches, found.left) == ((), 0.0)


def test_with_too_few_pieces_something_is_left() -> None:
    found = quick_cuts(CROSSED, limits(most=1))
    assert found is not None
    assert found.branches == ()
    assert found.left > 0.0


def test_a_branch_without_room_for_a_sleeve_is_not_cut() -> None:
    build = CROSSED.build.changed(pieces=PieceSettings(lap_mm=150.0))
    long = PieceLimits.of(build, PROFILE, {})
    found = quick_cuts(CROSSED, long)
    assert found is not None
    assert found.branches == ()
    assert found.left > 0.0


def test_pieces_that_are_larger_than_the_sheet_are_cut_further() -> None:
    vine = tree(fan(1, 400.0, 0.0))
    whole = quick_cuts(vine, limits(sheet_mm=None))
    fitted = quick_cuts(vine, limits(sheet_mm=(600.0, 60.0)))
    narrow = quick_cuts(vine, limits(sheet_mm=(200.0, 60.0)))
    assert whole is not None
    assert fitted is not None
    assert narrow is not None
    assert (whole.branches, whole.left) == ((), 0.0)
    assert (fitted.branches, fitted.left) == ((1,), 0.0)
    assert narrow.left > 0.0


def test_too_large_trees_are_not_looked_at() -> None:
    large = tree(fan(21, 100.0, 300.0), fan(21, 60.0, 160.0))
    assert large.branch_count > MOST_PIECE_BRANCHES
    assert quick_cuts(large, limits()) is None


def test_no_smaller_set_of_cuts_leaves_nothing() -> None:
    """Every smaller set is tried; the search may stop early, but hardly ever does."""
    missed, tried = 0, 0
    for design in random_designs(150, seed=2):
        rules = limits()
        found, every = quick_cuts(design, rules), _TreeCuts(design, rules)
        if found is None or found.left > 0.0 or len(found.branches) not in (1, 2, 3):
            continue
        assert every.left(set(found.branches)) == found.left
        tried += 1
        fewer = combinations(every.stub, len(found.branches) - 1)
        missed += any(every.left(set(cut)) == 0.0 for cut in fewer)
    assert tried >= 10
    assert missed <= 0.05 * tried


@pytest.mark.parametrize("mounting", ["tail_inverted", "turned"])
def test_where_sides_are_straight_is_never_better_than_in_the_outlines(mounting: str) -> None:
    reach, differing, sides = reach_mm(PROFILE), 0, 0
    size = sleeve_size(CROSSED.build.changed(mounting=mounting), PROFILE)
    for design in random_designs(40, seed=3):
        layout = flat_layout(design)
        exact = sleeve_sides(design, layout, size, reach)
        planned = planned_sides(design, layout, size, reach)
        assert (planned.start_mm >= exact.start_mm - 1e-6).all()
        assert (planned.end_mm <= exact.end_mm + 1e-6)[1:].all()
        differing += int((planned.start_mm > exact.start_mm + 1e-3).sum())
        sides += design.branch_count
    assert differing <= 0.1 * sides


def test_what_is_left_falls_as_branches_part() -> None:
    lefts = []
    for angle_deg in np.linspace(20.0, 70.0, 26):
        design = tree(fan(3, 60.0, 2.0 * angle_deg), fan(3, 70.0, 140.0))
        found = quick_cuts(design, limits(most=2))
        assert found is not None
        lefts.append(found.left)
    assert lefts[0] > 1.0
    assert lefts[-1] < 0.5 * lefts[0]
    assert (np.diff(lefts) <= 0.15 * lefts[0]).all()


@pytest.mark.parametrize("taper", [(), (0.9, 0.9, 0.9)], ids=["even", "tapered"])
def test_cuts_without_anything_left_pass_as_pieces(taper: tuple[float, ...]) -> None:
    design = CROSSED.changed(build=CROSSED.build.changed(taper=taper))
    found = quick_cuts(design, limits())
    assert found is not None
    assert found.left == 0.0
    partition = partition_of(design, PROFILE)
    assert not partition.unparted
    assert len(partition.pieces) == 1 + len(found.branches)
