"""Fixes against a grid search and against values computed by hand."""

import functools
import math
from collections.abc import Callable
from itertools import combinations, product

import numpy as np
import pytest

from tests.oracles.penalty import bare_gaps
from tests.search.fix_many import fix_many
from vinefab.core.errors import BadInputError
from vinefab.fabrication.checking import check_design
from vinefab.fabrication.rules.catalog import run_checks
from vinefab.fabrication.rules.clearance_rules import level_joints
from vinefab.fabrication.rules.pressure_rules import worst_growths
from vinefab.fabrication.rules.rule import Subject
from vinefab.model.design import Design, Pouch
from vinefab.model.laser import LaserProfile
from vinefab.physics.growth_pressure import FITTED, NO_TENSION, riding_mm
from vinefab.search.fix import fix_design, fix_in_step
from vinefab.search.fix_changes import change_cost, design_changes, pruning_cost
from vinefab.search.fix_space import (
    FILLETS,
    KEEPS,
    FixSpace,
    fix_stages,
    kept_branches,
    parsed_keeps,
)
from vinefab.search.fix_targets import FixTargets
from vinefab.search.tree_batch import TreeBatch

Make = Callable[..., Design]


@pytest.fixture
def make(make):
    """Return what makes designs that are cut as designed: no joint is simulated."""
    return functools.partial(make, compensation="none")


def only_change(design, profile):
    found = fix_design(design, FixTargets.of(design, profile))
    assert found is not None
    assert run_checks(Subject.of(found.design, profile)).blocking == ()
    (change,) = design_changes(design, found.design)
    return change.text


def test_a_sound_design_is_left_alone(make, profile):
    design = make((3, 200.0, 120.0), (2, 120.0, 50.0))
    found = fix_design(design, FixTargets.of(design, profile))
    assert (found.design, found.cost) == (design, 0.0)


def test_each_simple_fault_is_fixed_where_it_is(make, profile):
    fan = make((2, 300.0, 14.0), widths_mm=(20.0, 6.0))
    assert only_change(fan, profile).startswith("level 2 fan: 14 -> 15")
    assert only_change(make(tail_mm=100.0), profile) == "the tail: 100 -> 150 mm (+50.0 %)"
    hot = make((2, 200.0, 60.0), pressure_kpa=30.0)
    assert only_change(hot, profile) == "the pressure: 30 -> 23.33 kPa (-22.2 %)"
    sharp = make((2, 200.0, 60.0), fillet_mm=(0.5,))
    assert only_change(sharp, profile).startswith("level 2 fillet: 0.5 -> 1.05")
    wide = make((2, 200.0, 60.0), widths_mm=(23.0, 20.0))
    assert only_change(wide, profile).startswith(
        ("level 1 width: 23 -> 24", "level 2 width: 20 -> 19.16")
    )


@pytest.mark.thorough
def test_the_change_is_near_the_smallest_that_a_grid_finds(
    make: Make, profile: LaserProfile
) -> None:
    # Three cousins overlap: fan, length and width can each part them, and together.
    design = make((2, 110.0, 30.0), (2, 70.0, 110.0))
    targets = FixTargets.of(design, profile)
    found = fix_design(design, targets)
    space = FixSpace.of(design, (2, 2), targets)
    names = {variable: entry for entry, variable in enumerate(space.variables)}
    steps = {
        ("fan", 1): np.linspace(0.0, 0.6, 9),
        ("fan", 2): np.linspace(-0.6, 0.0, 3),
        ("length", 1): np.linspace(0.0, 0.3, 3),
        ("length", 2): np.linspace(-0.6, 0.0, 3),
        ("width", 2): np.linspace(-0.6, 0.0, 3),
    }
    least = math.inf
    for values in product(*steps.values()):
        x = np.zeros(len(space))
        for variable, value in zip(steps, values, strict=True):
            x[names[variable]] = value
        changed = space.at(x)
        cost = change_cost(design, changed)
        if cost < least and targets.penalties([changed])[0] == 0.0:
            least = cost
    assert 0.1 < least < 1.0, (least, found.cost, design_changes(design, found.design))
    assert found.cost < 1.15 * least, (least, found.cost, design_changes(design, found.design))


def test_the_search_is_repeatable(make, profile):
    design = make((2, 90.0, 70.0), (2, 60.0, 100.0))
    one, two = (fix_design(design, FixTargets.of(design, profile)) for _ in range(2))
    assert one == two


def test_pouches_and_waivers_and_limits_go_along(make, profile):
    design = make((2, 150.0, 40.0), pouch=Pouch(shape="round", radius_mm=60.0)).changed(
        limits={"VF-C07": {"warning": 3.5}},
    )
    found = fix_design(design, FixTargets.of(design, profile)).design
    assert found.limits == design.limits
    assert found.build.pouch is not None
    assert run_checks(Subject.of(found, profile)).blocking == ()


def test_the_designs_own_limits_are_kept_to(make, profile):
    design = make((2, 200.0, 60.0)).changed(limits={"VF-B01": {"error": 250.0}})
    assert fix_design(design, FixTargets.of(design, profile)).design.build.tail_mm == 250.0


@pytest.mark.parametrize("keep", [[], ["width"], ["length,width"]])
def test_nothing_is_found_for_an_impossible_limit(make, profile, keep):
    """Also where a vine has nothing left that may change."""
    design = make()
    targets = FixTargets.of(design, profile, {"VF-W01": {"error": 50.0}, "VF-B02": {"error": 45.0}})
    assert fix_design(design, targets, keep=parsed_keeps(keep)) is None


def test_ways_to_prune_begin_with_none_and_end_with_the_trunk(make):
    design = make((3, 100.0, 90.0), (4, 50.0, 90.0))
    ways = kept_branches(design)
    assert ways[0] == (3, 4)
    assert ways[-1] == ()
    assert len(set(ways)) == len(ways) == 1 + 3 + 3 * 4
    # 300 + 300 + 600 mm planned, of which 600 are left
    assert pruning_cost(design, (3,)) == pytest.approx(2.0 * math.log(2.0))


def test_the_window_of_the_targets_is_never_below_the_rules_own(make, profile):
    for fans in (((2, 200.0, 60.0),), ((3, 100.0, 170.0), (4, 80.0, 100.0))):
        design = make(*fans, widths_mm=(90.0, 12.0, 7.0)[: 1 + len(fans)])
        subject = Subject.of(design, profile)
        worst = worst_growths(subject, (FITTED.changed(storage_kpa=NO_TENSION),), 25.0)[0]
        allowed = 70.0 * 20.0 / 90.0 / 1.5 / 1.2
        assert riding_mm(subject.layout.tree)[0] > 0.0
        trees = TreeBatch.of([design.tree])
        assert FixTargets.of(design, profile)._excess(trees, [design.build])[0] == pytest.approx(
            max(0.0, worst.pressure_kpa / allowed - 1.0)
        )


@pytest.mark.thorough
def test_random_designs_of_table_1_are_fixed(profile):
    cases = fix_many(4, profile, deepest=2)
    assert all(case.fixed is not None for case in cases)
    for case in cases:
        assert check_design(case.fixed, profile).blocking == ()
        assert 0.0 < case.size < 6.0


def only_fillets(design, targets):
    return fix_in_step(design, targets, (FILLETS,)).get(FILLETS)


def test_a_smaller_fillet_is_tried_before_anything_else(make, profile):
    design = make((2, 45.0, 150.0), (2, 80.0, 200.0), trunk_mm=250.0, fillet_mm=(6.0, 14.0))
    found = run_checks(Subject.of(design, profile)).blocking
    assert "VF-C03" in {finding.rule for finding in found}
    targets = FixTargets.of(design, profile, margin=0.005)
    fixed = fix_design(design, targets)
    assert fixed == only_fillets(design, targets)
    assert fixed.design.build.changed(fillet_mm=design.build.fillet_mm) == design.build
    assert all(radius > 1.0 for radius in fixed.design.build.fillet_mm)
    assert run_checks(Subject.of(fixed.design, profile)).blocking == ()


def test_fillets_stop_at_the_limit_of_the_recipe(make, profile):
    design = make((2, 45.0, 150.0), (2, 80.0, 200.0), trunk_mm=250.0, fillet_mm=(6.0, 14.0))
    targets = FixTargets.of(design, profile, {"VF-C04": {"error": 5.9}})
    assert min(only_fillets(design, targets).design.build.fillet_mm) >= 5.9
    strict = FixTargets.of(design, profile, {"VF-C04": {"error": 13.0}})
    assert only_fillets(design, strict) is None


def short(make):
    """A fork whose children end within the end of its trunk, and whose crotch is too long."""
    return make((2, 36.0, 80.0), trunk_mm=100.0)


def changed(design, profile, keep):
    """Fix a design, and return which kinds of values changed."""
    found = fix_design(design, FixTargets.of(design, profile), keep=parsed_keeps([keep]))
    assert run_checks(Subject.of(found.design, profile)).blocking == ()
    return {change.what.split()[-1] for change in design_changes(design, found.design)}


def test_widths_narrow_into_the_joint(make, profile):
    design = short(make)
    found = fix_design(design, FixTargets.of(design, profile)).design
    assert run_checks(Subject.of(found, profile)).blocking == ()
    assert (found.levels, found.build.widths_mm[0]) == (design.levels, design.build.widths_mm[0])
    assert found.build.taper[0] == pytest.approx(0.9, abs=0.01)
    # By hand: two children of width w part w / 2 / sin(40 deg) from the joint, at most 18 mm.
    assert found.build.widths_mm[1] < 36.0 * math.sin(math.radians(40.0))


def test_what_is_kept_does_not_change(make, profile):
    design = short(make)
    assert changed(design, profile, "width") == {"length"}
    assert changed(design, profile, "width, length,angle") == {"branches"}
    crossed = make((2, 110.0, 30.0), (2, 70.0, 110.0))
    assert changed(crossed, profile, "branches,length") <= {"fan", "width", "taper", "fillet"}


def test_branches_go_only_if_nothing_else_helps(make: Make, profile: LaserProfile) -> None:
    # To prune one of four would be the smallest change here.
    design = make((4, 60.0, 60.0))
    found = fix_design(design, FixTargets.of(design, profile))
    assert found.design.branch_count == design.branch_count
    everything = frozenset(KEEPS)
    assert fix_design(short(make), FixTargets.of(design, profile), keep=everything) is None
    assert [{stage.prunes for stage in step} for step in fix_stages()] == [{False}, {False}, {True}]
    assert fix_stages(everything) == ((FILLETS,),)


WORDS = ("length", "angle", "width")


def kept_with_branches():
    """Return what may be kept besides the branches, the most first."""
    sizes = range(len(WORDS), -1, -1)
    return [frozenset(words) for size in sizes for words in combinations(WORDS, size)]


def worst_of_narrower(costs):
    """Yield what was kept, its cost and the least cost where more was kept."""
    for words, cost in costs.items():
        narrower = [other for more, other in costs.items() if more > words]
        yield words, cost, min(narrower, default=math.inf)


CROWDED = [
    pytest.param([(3, 90.0, 40.0), (2, 70.0, 110.0)], marks=pytest.mark.thorough),
    pytest.param([(2, 110.0, 30.0), (2, 70.0, 110.0)], marks=pytest.mark.thorough),
    [(4, 60.0, 60.0)],
]


@pytest.mark.parametrize("fans", CROWDED)
def test_what_is_found_while_more_is_kept_is_no_smaller_change(make, profile, fans):
    design = make(*fans)
    targets, costs = FixTargets.of(design, profile), {}
    for words in kept_with_branches():
        found = fix_design(design, targets, keep=words | {"branches"})
        costs[words] = found.cost if found else math.inf
    assert min(costs.values()) < math.inf
    for words, cost, narrower in worst_of_narrower(costs):
        assert cost <= narrower, (words, costs)


def test_stages_with_less_to_change_are_among_those_with_more():
    stages = {words: set(fix_stages(words | {"branches"})[-1]) for words in kept_with_branches()}
    for words, some in stages.items():
        for more in (other for other in stages if other > words):
            assert stages[more] - {FILLETS} <= some


def test_a_tapered_design_loses_whole_levels_too(make, profile):
    design = make((2, 36.0, 80.0), (2, 20.0, 80.0), taper=(0.9, 0.9, 1.0))
    keep = parsed_keeps(["length,width", "angle"])
    found = fix_design(design, FixTargets.of(design, profile), keep=keep).design
    assert found.depth < design.depth
    assert len(found.build.taper) == found.depth


@pytest.mark.parametrize("word", ["", "branch", "length,", "Length", "growth", "x" * 100_000])
def test_a_word_that_says_nothing_is_refused(word):
    with pytest.raises(BadInputError, match="branches, length, angle, width") as caught:
        parsed_keeps(["branches", word])
    assert len(str(caught.value)) < 300


def test_tapered_crotches_are_reckoned_as_they_are_drawn(make: Make, profile: LaserProfile) -> None:
    # 23 mm are less than the children's crotch needs at their full width, and enough as they lean.
    even = make((2, 60.0, 45.0), widths_mm=(40.0, 24.0))
    leaning = even.changed(build=even.build.changed(taper=(1.0, 0.7)))
    reaches = [
        max(gap.reach_mm for gap in level_joints(design)[0].gaps) for design in (even, leaning)
    ]
    shares = [max(share for _, share in bare_gaps(design)) for design in (even, leaning)]
    assert reaches[1] < 30.001 < reaches[0]
    assert shares[1] < 0.5 < shares[0]
    blocked = [run_checks(Subject.of(design, profile)).blocking for design in (even, leaning)]
    assert [{finding.rule for finding in found} for found in blocked] == [{"VF-C03"}, set()]
