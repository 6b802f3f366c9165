"""The compiled penalty of many designs against the readable one of each."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from tests.oracles.penalty import fabrication_penalty, path_excess, whole_penalty
from tests.oracles.quick_cuts import PieceLimits
from vinefab.fabrication.pieces.partition import in_pieces as in_its_pieces
from vinefab.fabrication.pieces.partition import partition_of, pieces_of
from vinefab.fabrication.rules.catalog import run_checks
from vinefab.fabrication.rules.rule import Subject
from vinefab.fabrication.rules.tree_rules import check_lap_packing
from vinefab.inflation.pattern import pattern_of, quick_pattern
from vinefab.model.design import (
    MOST_BRANCHES,
    Build,
    Collar,
    Compensation,
    Design,
    Level,
    PieceSettings,
    Pouch,
    default_fillets_mm,
)
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.laser import read_profile
from vinefab.model.quantity import Quantity, Standing
from vinefab.search.manufacturability import ManufacturabilityPenalty
from vinefab.search.penalty_batch import (
    MOST_CHECKED_BRANCHES,
    MOST_PIECE_BRANCHES,
    PenaltyRules,
)
from vinefab.search.space import Bounds, BuildSettings, Space, SpaceSettings

PENALTY = ManufacturabilityPenalty(profile=read_profile(DEFAULT_RECIPE))
MATERIAL = PENALTY.profile.material
TABLE_1 = SpaceSettings(levels=Bounds(low=1, high=5), branches=Bounds(low=1, high=4))
BENCH = SpaceSettings(
    levels=Bounds(low=2, high=4),
    branches=Bounds(low=2, high=3),
    length_mm=Bounds(low=20, high=120),
    angle_deg=Bounds(low=0, high=360),
)
CROSSING = SpaceSettings(
    levels=Bounds(low=3, high=4),
    branches=Bounds(low=2, high=3),
    length_mm=Bounds(low=40, high=140),
    angle_deg=Bounds(low=40, high=240),
)
RANGES = {"table 1": TABLE_1, "bench": BENCH, "crossing": CROSSING}
POUCHES = {
    "bare": None,
    "round": Pouch(shape="round", radius_mm=12.0),
    "rectangle": Pouch(shape="rectangle", length_mm=20.0, width_mm=30.0),
}


def readable(design):
    """Penalty of one design by the oracle."""
    return whole_penalty(design, PENALTY.profile)


def both(space, x):
    """Penalties of points, at once and one by one."""
    return PENALTY.within(space)(space.batch(x)), np.array([readable(space.design(p)) for p in x])


CHOICES: tuple[Compensation, ...] = ("inflation", "none")

WITHIN = {"inflation": 1e-6, "none": 1e-9}
"""Flat angles differ in their last digits, distances of lines that cross by the root of that."""


@pytest.mark.parametrize(
    ("settings", "ratio", "pouch", "compensation"),
    [  # each pair of values at least once
        ("table 1", 0.65, "bare", "inflation"),
        ("table 1", 1.0, "round", "none"),
        ("table 1", 0.65, "rectangle", "none"),
        ("bench", 1.0, "bare", "none"),
        ("bench", 0.65, "round", "inflation"),
        ("bench", 1.0, "rectangle", "inflation"),
    ],
)
def test_penalties_at_once_are_those_one_by_one(settings, ratio, pouch, compensation):
    build = BuildSettings(
        width_ratio=ratio, pouch=POUCHES[pouch], trunk_width_mm=30.0, compensation=compensation
    )
    space = Space(RANGES[settings], build)
    x = np.random.default_rng(3).random((120, len(space)))
    # Corners of the space, with branches that are parallel, coincide, or touch at their ends.
    x[:40] = np.round(x[:40])
    found, wanted = both(space, x)
    assert np.array_equal(found == 0.0, wanted == 0.0)
    assert np.abs(found - wanted).max() < WITHIN[compensation]
    assert (wanted > 0.0).sum() > 50


@pytest.mark.parametrize("widths_mm", [(34.0, 15.5, 12.0), (20.0, 24.0), (30.0,)], ids=str)
def test_penalties_at_once_know_widths_by_level(widths_mm):
    space = Space(BENCH, BuildSettings(widths_mm=widths_mm, width_ratio=0.7))
    found, wanted = both(space, np.random.default_rng(6).random((60, len(space))))
    assert np.array_equal(found == 0.0, wanted == 0.0)
    assert np.abs(found - wanted).max() < 1e-9


@pytest.mark.parametrize("gain", [0.7, 1.2])
def test_penalties_at_once_know_a_measured_gain_and_large_fans(gain):
    measured = Quantity(value=gain, standing=Standing.MEASURED, source="coupon")
    material = PENALTY.profile.material.changed(closing_gain=measured)
    penalty = replace(PENALTY, profile=replace(PENALTY.profile, material=material))
    settings = BENCH.changed(branches=Bounds(low=4, high=9), levels=Bounds(low=2, high=3))
    space = Space(settings, BuildSettings(compensation="inflation", width_ratio=0.5))
    x = np.random.default_rng(9).random((40, len(space)))
    found = penalty.within(space)(space.batch(x))
    wanted = [whole_penalty(space.design(point), penalty.profile) for point in x]
    assert np.abs(found - wanted).max() < WITHIN["inflation"]
    assert np.abs(found - PENALTY.within(space)(space.batch(x))).max() > 1e-3


def test_the_pattern_decides_and_too_narrow_fans_add_to_it():
    """Siblings 14 degrees apart are cut 37 apart; nearer ones lie on each other when inflated."""
    spaces = [Space(FORK, BuildSettings(compensation=choice)) for choice in CHOICES]
    angles_deg = np.array([1.0, 1.5, 2.0, 8.0, 14.0, 30.0])
    x = (angles_deg[:, None] - 1.0) / 29.0
    cut, designed = (PENALTY.within(space)(space.batch(x)) for space in spaces)
    assert ((designed > 0.0) == (angles_deg < 15.0)).all()
    assert (np.diff(cut[:5]) < 0.0).all()
    assert cut[3] > cut[4:].max() == 0.0


@pytest.mark.parametrize("compensation", CHOICES)
def test_both_agree_which_designs_have_none(compensation):
    space = Space(BENCH, BuildSettings(trunk_width_mm=24.0, compensation=compensation))
    found, wanted = both(space, 0.3 + 0.4 * np.random.default_rng(4).random((120, len(space))))
    assert 8 < (wanted == 0.0).sum() < 112
    assert np.array_equal(found == 0.0, wanted == 0.0)


def test_each_design_alone_has_the_penalty_that_it_has_among_others():
    space = Space(TABLE_1, BuildSettings())
    designs = space.batch(np.random.default_rng(5).random((30, len(space))))
    penalty = PENALTY.within(space)
    alone = [penalty(designs.part(np.array([row])))[0] for row in range(30)]
    assert penalty(designs).tolist() == alone


def test_large_trees_count_by_their_size_and_too_large_ones_have_no_penalty():
    wide = Bounds(low=50, high=50)
    settings = SpaceSettings(levels=Bounds(low=3, high=4), branches=wide)
    space = Space(settings, BuildSettings())
    x = np.full((2, len(space)), 0.5)
    x[:, 0] = 0.1, 0.9
    designs = space.batch(x)
    assert MOST_CHECKED_BRANCHES < designs.sizes[0] < MOST_BRANCHES < designs.sizes[1]
    large, invalid = PENALTY.within(space)(designs)
    assert large == pytest.approx(readable(space.design(x[0])), abs=1e-9)
    assert np.isnan(invalid)


def any_build(rng, *, pieces):
    """A design with a build of its own: widths, tapers, fillets, often a pouch and a collar."""
    depth, number = int(rng.integers(1, 5)), rng.uniform
    widths_mm = tuple((number(24, 50) * number(0.4, 1.05, depth).cumprod()).tolist())
    taper = tuple(number(0.4, 1.0, depth).tolist()) if rng.random() < 0.7 else ()
    length_mm, width_mm = number(0.2, 3.0, 2) * widths_mm[-1]
    pouches = [
        None,
        Pouch(shape="round", radius_mm=length_mm),
        Pouch(shape="rectangle", length_mm=length_mm, width_mm=width_mm),
    ]
    levels = tuple(
        Level(
            branches=int(rng.integers(1, 5)),
            length_mm=number(15, 220),
            fan_rad=number(0.0, 6.0),
            growth=number(0.5, 1.5),
        )
        for _ in range(depth - 1)
    )
    build = Build(
        widths_mm=widths_mm,
        fillet_mm=tuple(mm * number(0.2, 2.0) for mm in default_fillets_mm(widths_mm)),
        taper=taper,
        tail_mm=number(0, 300),
        pouch=pouches[rng.integers(3)],
        collar=Collar(clamp_diameter_mm=number(5, 60)) if rng.random() < 0.4 else None,
        compensation=rng.choice(CHOICES),
        pieces=PieceSettings(most=int(rng.integers(2, 6))) if pieces else None,
        mounting=rng.choice(["tail_inverted", "turned"]),
    )
    return Design(name="any", trunk_length_mm=number(20, 400), levels=levels, build=build)


def with_path_excess(rules, designs):
    at_once, trees = rules.at_once(designs)
    return at_once.with_path_excess(trees, np.arange(len(designs)), rules.known_sides(designs))


@pytest.mark.parametrize("pieces", [False, True])
def test_designs_with_builds_of_their_own_have_the_readable_penalties(*, pieces):
    """Tapers, collars and laser paths, as a fix asks for them; no pressure for growth."""
    rng, profile, sheet_mm = np.random.default_rng(12), PENALTY.profile, (700.0, 500.0)
    designs = [any_build(rng, pieces=pieces) for _ in range(40 if pieces else 80)]
    for design in designs:
        rules = PenaltyRules.of(design.build, profile, {}, sheet_mm, grows=False)
        of = {"profile": profile, "sheet_mm": sheet_mm}
        cuts = PieceLimits.of(design.build, profile, {}, sheet_mm) if pieces else None
        wanted = fabrication_penalty(design, {}, **of, pieces=cuts)
        (penalty,), (excess,) = with_path_excess(rules, [design])
        assert penalty == rules.penalties([design])[0] == pytest.approx(wanted, abs=1e-6)
        flat = quick_pattern(design, profile.material).flat
        assert excess == pytest.approx(path_excess(flat, profile, {}), abs=1e-9)


def test_a_batch_of_many_builds_has_the_penalties_of_each_alone():
    rng, sheet_mm = np.random.default_rng(13), (700.0, 500.0)
    designs = [any_build(rng, pieces=False).changed() for _ in range(40)]
    designs = [one.changed(build=one.build.changed(compensation="none")) for one in designs]
    rules = PenaltyRules.of(designs[0].build, PENALTY.profile, {}, sheet_mm, grows=False)
    alone = np.array([with_path_excess(rules, [design]) for design in designs])
    assert np.array_equal(np.transpose(with_path_excess(rules, designs)), alone[:, :, 0])


FORK = SpaceSettings(
    levels=Bounds(low=2, high=2),
    branches=Bounds(low=2, high=2),
    length_mm=Bounds(low=150, high=150),
    growth_percent=Bounds(low=100, high=100),
    angle_deg=Bounds(low=1, high=30),
)


@pytest.mark.parametrize(
    ("settings", "most", "mounting", "pouch", "compensation"),
    [  # each pair of values at least once
        ("table 1", 2, "tail_inverted", "bare", "inflation"),
        ("table 1", 6, "tail_inverted", "round", "none"),
        ("table 1", 6, "turned", "rectangle", "inflation"),
        ("bench", 2, "tail_inverted", "round", "none"),
        ("bench", 2, "tail_inverted", "rectangle", "none"),
        ("bench", 6, "tail_inverted", "rectangle", "inflation"),
        ("bench", 6, "turned", "bare", "none"),
        ("crossing", 2, "tail_inverted", "rectangle", "none"),
        ("crossing", 6, "tail_inverted", "bare", "inflation"),
        ("crossing", 6, "turned", "round", "inflation"),
    ],
)
def test_penalties_in_pieces_at_once_are_those_one_by_one(
    settings, most, mounting, pouch, compensation
):
    build = BuildSettings(
        pouch=POUCHES[pouch],
        trunk_width_mm=30.0,
        pieces=PieceSettings(most=most),
        mounting=mounting,
        compensation=compensation,
    )
    space = Space(RANGES[settings], build)
    x = np.random.default_rng(6).random((25, len(space)))
    x[:6] = np.round(x[:6])
    found, wanted = both(space, x)
    assert np.array_equal(found == 0.0, wanted == 0.0)
    assert np.abs(found - wanted).max() < WITHIN[compensation]


def in_pieces(most, compensation="none", trunk_width_mm=24.0):
    build = BuildSettings(
        trunk_width_mm=trunk_width_mm,
        width_ratio=0.65,
        pieces=PieceSettings(most=most),
        compensation=compensation,
    )
    return Space(CROSSING, build)


@pytest.mark.compiler
@pytest.mark.parametrize("compensation", CHOICES)
def test_designs_without_a_penalty_in_pieces_are_cut_in_as_few(compensation):
    """The search's number is never less than the exact one, and hardly ever more."""
    space = in_pieces(6, compensation)
    x = np.random.default_rng(7).random((600, len(space)))
    penalty, joints = PENALTY.within(space).with_joints(space.batch(x))
    rows = np.flatnonzero((penalty == 0.0) & (joints > 0))[:12]
    exact = [
        partition_of(quick_pattern(space.design(x[row]), MATERIAL).flat, PENALTY.profile)
        for row in rows
    ]
    assert len(rows) == 12
    assert not any(partition.unparted for partition in exact)
    pieces = np.array([len(partition.pieces) for partition in exact])
    assert (joints[rows] + 1 >= pieces).all()
    assert (joints[rows] + 1).sum() <= 1.05 * pieces.sum()


def thick(**recipe):
    """Two plies of 0.1 mm, with changes of the recipe."""
    profile = PENALTY.profile
    film = Quantity(value=0.1, standing=Standing.MEASURED, source="gauge")
    material = profile.material.changed(ply_mm=film)
    changed = profile.recipe.changed(**recipe)
    return ManufacturabilityPenalty(profile=replace(profile, material=material, recipe=changed))


@pytest.mark.compiler
@pytest.mark.parametrize("compensation", CHOICES)
def test_film_with_laps_in_it_keeps_within_its_lumen(compensation):
    """VF-J04, in the search and in the partition that is cut."""
    penalty, any_laps = thick(), thick(limits={"VF-J04": {"error": 1000.0}})
    space = in_pieces(6, compensation, trunk_width_mm=36.0)
    x = np.random.default_rng(7).random((2000, len(space)))
    designs = space.batch(x)
    found, joints = penalty.within(space).with_joints(designs)
    loose = any_laps.within(space)(designs)
    decided = np.flatnonzero((found > 0.0) & (loose == 0.0))
    passing = np.flatnonzero((found == 0.0) & (joints > 0))
    assert len(decided) > 5
    assert len(passing) > 5
    for row in (*decided[:6], *passing[:6]):
        assert found[row] == pytest.approx(
            whole_penalty(space.design(x[row]), penalty.profile), abs=1e-9
        )
    # What is cut as designed has joints whose passages the search does not know.
    for row in passing[:4] if compensation == "inflation" else ():
        pattern = pattern_of(space.design(x[row]), penalty.profile, known_only=True)
        flat = Subject.of(pattern.flat)
        flat = replace(flat, profile=penalty.profile, pattern=pattern)
        cut = in_its_pieces(flat, pieces_of(pattern, penalty.profile))
        assert not run_checks(cut, only={check_lap_packing.id}).blocking


@pytest.mark.compiler
def test_branches_whose_lap_would_burst_or_whose_plug_does_not_go_in_are_not_cut():
    """VF-J03 forbids where laps were measured, VF-J06 where the film is thicker than the ease."""
    lap = PENALTY.profile.recipe.lap
    assert lap is not None
    weak = Quantity(value=0.05, standing=Standing.MEASURED, source="coupon")
    recipe = PENALTY.profile.recipe.changed(lap=lap.changed(strength_n_per_mm=weak))
    penalty = replace(PENALTY, profile=replace(PENALTY.profile, recipe=recipe))
    space = in_pieces(6)
    x = np.random.default_rng(7).random((300, len(space)))
    designs = space.batch(x)
    free, bound = PENALTY.within(space)(designs), penalty.within(space)(designs)
    assert not ((bound == 0.0) & (free > 0.0)).any()
    rows = np.flatnonzero((free == 0.0) & (bound > 0.0))
    assert len(rows) > 3
    for row in rows[:5]:
        assert bound[row] == pytest.approx(
            whole_penalty(space.design(x[row]), penalty.profile), abs=1e-9
        )
    tight = in_pieces(6)
    tight = Space(CROSSING, tight.build.changed(pieces=PieceSettings(most=6, ease_mm=0.05)))
    assert not PENALTY.within(tight).with_joints(designs)[1].any()


@pytest.mark.compiler
def test_more_pieces_never_make_a_penalty_larger_and_save_many_designs():
    x = np.random.default_rng(8).random((400, len(in_pieces(2))))
    settings = [None, *(PieceSettings(most=most) for most in (1, 2, 3, 6))]
    spaces = [Space(CROSSING, BuildSettings(trunk_width_mm=24.0, pieces=one)) for one in settings]
    whole, one, *more = (PENALTY.within(space)(space.batch(x)) for space in spaces)
    assert np.array_equal(whole, one)
    passing = [(found == 0.0).sum() for found in (one, *more)]
    assert sorted(passing) == passing
    assert passing[-1] > 1.5 * passing[0]
    for fewer, found in pairwise([one, *more]):
        assert not ((fewer == 0.0) & (found > 0.0)).any()


def test_a_robot_that_is_larger_than_the_bed_is_cut_to_fit_it():
    """Nothing crosses: two trunks' lengths of branches in a row are too long for any turn."""
    levels = {
        1: {"length_mm": Bounds(low=590, high=600)},
        2: {"length_mm": Bounds(low=590, high=600)},
    }
    settings = SpaceSettings(
        levels=Bounds(low=2, high=2), branches=Bounds(low=1, high=1), by_level=levels
    )
    whole = Space(settings, BuildSettings())
    parts = Space(settings, BuildSettings(pieces=PieceSettings(most=2)))
    x = np.full((1, len(whole)), 0.5)
    assert PENALTY.within(whole)(whole.batch(x))[0] > 0.0
    penalty, joints = PENALTY.within(parts).with_joints(parts.batch(x))
    assert (penalty[0], joints[0]) == (0.0, 1)
    assert len(partition_of(parts.design(x[0]), PENALTY.profile).pieces) == 2


def test_huge_trees_count_as_one_outline():
    settings = SpaceSettings(levels=Bounds(low=3, high=3), branches=Bounds(low=20, high=21))
    whole = Space(settings, BuildSettings())
    parts = Space(settings, BuildSettings(pieces=PieceSettings()))
    x = np.full((1, len(whole)), 0.4)
    assert MOST_PIECE_BRANCHES < whole.batch(x).sizes[0] < MOST_CHECKED_BRANCHES
    found, wanted = both(parts, x)
    assert found == pytest.approx(wanted, abs=1e-9)
    assert found[0] == PENALTY.within(whole)(whole.batch(x))[0]


@pytest.mark.compiler
def test_a_fillet_that_the_seam_turns_into_a_corner_is_no_reason():
    """A seam 5 mm wide runs 2.5 mm outside the lumen: third levels of 24 mm trunks pass the check.

    Their fillets of 2.5 mm are corners there; those of 2.8 mm are arcs too small to run.
    """
    sealed = ManufacturabilityPenalty(profile=read_profile("co2_60w__tpu_nylon_70d"))
    settings = SpaceSettings(levels=Bounds(low=3, high=3), branches=Bounds(low=1, high=2))
    shares = []
    for width_mm in (24.0, 26.5):
        build = BuildSettings(trunk_width_mm=width_mm, width_ratio=0.65)
        space = Space(settings, build)
        x = np.random.default_rng(2).random((300, len(space)))
        found = sealed.within(space)(space.batch(x))
        shares.append((found == 0.0).mean())
        for row in np.flatnonzero(found == 0.0)[:3]:
            design = space.design(x[row])
            assert sealed(design) == 0.0
            rules = {finding.rule for finding in sealed.broken(design) or ()}
            assert rules <= {"VF-L02"}
            assert "VF-C04" not in rules
    assert shares[0] > 0.05
    assert shares[1] == 0.0


def test_no_design_without_a_penalty_has_an_end_between_fillets_too_short_to_be_run():
    """Of a fork that opens from 78 to 86 degrees, the trunk's round end comes into view."""
    settings = SpaceSettings(
        levels=Bounds(low=2, high=2),
        branches=Bounds(low=2, high=2),
        length_mm=Bounds(low=100, high=100),
        growth_percent=Bounds(low=100, high=100),
        angle_deg=Bounds(low=78, high=86),
    )
    space = Space(settings, BuildSettings(trunk_width_mm=24.0, width_ratio=0.65))
    found, wanted = both(space, np.linspace(0.0, 1.0, 41)[:, None])
    assert found == pytest.approx(wanted, abs=1e-6)
    broken = [PENALTY.broken(space.design(np.array([share]))) for share in np.linspace(0, 1, 41)]
    short = np.array([{one.rule for one in rules or ()} == {"VF-L02"} for rules in broken])
    assert short.any()
    assert (found[short] > 0.0).all()
    assert (found[[0, -1]] == 0.0).all()
    assert 0 < (found > 0.0).sum() - short.sum() <= 3
