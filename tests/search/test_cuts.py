"""The cuts that a search finds: against what each case needs, and against the exact outlines."""

import math
from itertools import combinations

import numpy as np
import pytest

from tests.oracles.quick_cuts import PieceLimits, _TreeCuts
from vinefab.fabrication.pieces.partition import partition_of
from vinefab.model.design import Design, Level, PieceSettings
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.laser import read_profile
from vinefab.search.penalty_batch import MOST_PIECE_BRANCHES, PenaltyRules
from vinefab.search.space import Bounds, BuildSettings, Space, SpaceSettings

PROFILE = read_profile(DEFAULT_RECIPE)
CROSSING = Space(
    SpaceSettings(
        levels=Bounds(low=2, high=4),
        branches=Bounds(low=1, high=3),
        length_mm=Bounds(low=40, high=140),
        angle_deg=Bounds(low=20, high=300),
    ),
    BuildSettings(
        trunk_width_mm=24.0, width_ratio=0.65, pieces=PieceSettings(), compensation="none"
    ),
)


WHOLE_BED = (980.0, 580.0)


def cuts(design, most=6, sheet_mm=WHOLE_BED, **settings):
    """Branches that the search cuts, and what is left of conflicts."""
    pieces = PieceSettings(most=most, **settings)
    design = design.changed(build=design.build.changed(pieces=pieces))
    found = PenaltyRules.of(design.build, PROFILE, {}, sheet_mm).found([design])
    assert len(found.cut) == found.joints[0]
    return tuple(found.cut.tolist()), found.left


def tree(*levels):
    build = BuildSettings(
        trunk_width_mm=24.0, width_ratio=0.65, pieces=PieceSettings(), compensation="none"
    )
    return Design(
        name="tree", trunk_length_mm=120.0, levels=levels, build=build.build(1 + len(levels))
    )


def fan(branches, length_mm, angle_deg):
    return Level(branches=branches, length_mm=length_mm, fan_rad=math.radians(angle_deg))


CROSSED = tree(fan(2, 100.0, 60.0), fan(2, 150.0, 130.0))
"""The inner grandchildren of both sides cross once."""


def random_designs(count, seed=1):
    random = np.random.default_rng(seed)
    return [CROSSING.design(point) for point in random.random((count, len(CROSSING)))]


def test_a_crossing_takes_one_cut_where_a_sleeve_has_room():
    (branch,), left = cuts(CROSSED)
    assert left == 0.0
    assert branch in (1, 2, 4, 5)
    for nothing, left in (cuts(CROSSED, most=2, lap_mm=150.0), cuts(CROSSED, most=2, ease_mm=0.0)):
        assert nothing == ()
        assert left > 0.0
    assert cuts(tree(fan(3, 120.0, 150.0))) == ((), 0.0)


def test_pieces_that_are_larger_than_the_sheet_are_cut_further():
    vine = tree(fan(1, 400.0, 0.0))
    assert cuts(vine, sheet_mm=(5000.0, 5000.0)) == ((), 0.0)
    assert cuts(vine, sheet_mm=(600.0, 60.0)) == ((1,), 0.0)
    assert cuts(vine, sheet_mm=(200.0, 60.0))[1] > 0.0


def test_too_large_trees_are_not_looked_at():
    large = tree(fan(21, 100.0, 300.0), fan(21, 60.0, 160.0))
    assert large.branch_count > MOST_PIECE_BRANCHES
    assert PenaltyRules.of(large.build, PROFILE, {}, WHOLE_BED).found([large]).left == math.inf


def test_no_smaller_set_of_cuts_leaves_nothing():
    """Every smaller set is tried; the search may stop early, but hardly ever does."""
    missed, tried = 0, 0
    for design in random_designs(150, seed=2):
        every = _TreeCuts(design, PieceLimits.of(design.build, PROFILE, {}, WHOLE_BED))
        found, left = cuts(design)
        if left > 0.0 or len(found) not in (1, 2, 3):
            continue
        assert every.left(set(found)) == left
        tried += 1
        fewer = combinations(every.stub, len(found) - 1)
        missed += any(every.left(set(cut)) == 0.0 for cut in fewer)
    assert tried >= 10
    assert missed <= 0.05 * tried


def test_what_is_left_falls_as_branches_part():
    lefts = []
    for angle_deg in np.linspace(20.0, 70.0, 26):
        design = tree(fan(3, 60.0, 2.0 * angle_deg), fan(3, 70.0, 140.0))
        lefts.append(cuts(design, most=2)[1])
    assert lefts[0] > 1.0
    assert lefts[-1] < 0.5 * lefts[0]
    assert (np.diff(lefts) <= 0.15 * lefts[0]).all()


@pytest.mark.parametrize("taper", [(), (0.9, 0.9, 0.9)], ids=["even", "tapered"])
def test_cuts_without_anything_left_pass_as_pieces(taper):
    design = CROSSED.changed(build=CROSSED.build.changed(taper=taper))
    found, left = cuts(design)
    assert left == 0.0
    partition = partition_of(design, PROFILE)
    assert not partition.unparted
    assert len(partition.pieces) == 1 + len(found)
