from dataclasses import replace
from html import escape
from types import SimpleNamespace

import hypothesis.extra.numpy as hnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import t as student

from vinefab.core.statistics import PAIRED_TAILS, mean_interval, mean_p
from vinefab.core.view import p_value
from vinefab.growth.options import GrowthOptions
from vinefab.model.design import Design
from vinefab.pages.panel import Marks, Shape
from vinefab.prediction.comparison import (
    DesignComparison,
    PairedDifference,
    compare_designs,
    paired_difference_chart,
    paired_difference_table,
    paired_differences,
    side_by_side_table,
)
from vinefab.prediction.family_deployments import PredictionPlan, origin_of, unseen_maps
from vinefab.prediction.measures import ANCHORING, MEASURES, REACH, SEEN, STUCK, MeasureTable
from vinefab.prediction.prediction_width import scaled_tree

SMALL = {"columns": 3, "rows": 3, "size_mm": 300.0}


@pytest.fixture(scope="module")
def found():
    design = Design.read("three_level_tree")
    short = scaled_tree(design, 0.5).changed(name="short")
    family = unseen_maps("grid", 6, 0, SMALL)
    return compare_designs([design, short, design], [family], PredictionPlan(poses=2)), family


def outcomes_of(values, maps):
    return MeasureTable(
        label="l",
        map_names=tuple(maps),
        poses=(None,) * len(maps),
        values={SEEN.key: np.array(values)},
    )


def test_a_design_against_itself_is_a_draw(found):
    comparison, _ = found
    assert comparison.names == ("three_level_tree (1)", "short", "three_level_tree (2)")
    twins = [
        difference
        for difference in comparison.differences
        if "short" not in (difference.first, difference.second)
    ]
    assert len(twins) == len(MEASURES) - 2  # without pouches: the ideal case alone; no targets
    for difference in twins:
        assert (difference.mean, difference.p, difference.won_percent) == (0.0, 1.0, 50.0)
        assert np.isnan(difference.low)  # six maps that are alike are too few for three pairs
        assert not difference.is_clear


def test_differences_are_paired_by_map():
    # The maps differ by far more than the designs do: unpaired, nothing would be seen.
    rng = np.random.default_rng(5)
    maps = [f"m{index}" for index in range(12) for _ in range(2)]
    base = np.repeat(rng.uniform(0, 100, 12), 2) + rng.normal(0, 0.1, 24)
    better = base + 1.0 + rng.normal(0, 0.2, 24)
    (difference,) = paired_differences(
        SEEN, ("a", "b"), (outcomes_of(better, maps), outcomes_of(base, maps))
    )
    assert difference.pairs == 12
    assert difference.mean == pytest.approx((better - base).mean())
    assert difference.low > 0.5
    means = (better - base).reshape(12, 2).mean(axis=1)
    assert (difference.low, difference.high) == mean_interval(means, tails=PAIRED_TAILS)
    assert (difference.p, difference.over) == (mean_p(means, PAIRED_TAILS), "12 maps")
    assert (difference.winner, difference.won_percent, difference.is_clear) == ("a", 100.0, True)


def test_p_values_are_adjusted_within_a_measure():
    maps = [f"m{index}" for index in range(5)]
    columns = ([1, 2, 3, 4, 5], [0, 0, 0, 0, 0], [1, 2, 2, 4, 4])
    three = [outcomes_of(np.array(column, float), maps) for column in columns]
    differences = paired_differences(SEEN, ("a", "b", "c"), three)
    for difference in differences:
        assert difference.p_adjusted == pytest.approx(min(1.0, 3 * difference.p))


@given(hnp.arrays(float, (3, 8), elements=st.integers(-3, 3)))
def test_no_interval_leaves_out_0_beside_a_p_value_that_is_not_small(columns):
    maps = [f"m{index}" for index in range(8)]
    three = [outcomes_of(column, maps) for column in columns]
    for difference in paired_differences(SEEN, ("a", "b", "c"), three):
        leaves_out = difference.low > 0.0 or difference.high < 0.0
        assert leaves_out == (difference.p_adjusted < 0.05) == difference.is_clear


def test_less_is_better_where_it_is():
    maps = ("m", "n")
    high = MeasureTable(
        label="l", map_names=maps, poses=(None, None), values={STUCK.key: np.ones(2)}
    )
    low = MeasureTable(
        label="l", map_names=maps, poses=(None, None), values={STUCK.key: np.zeros(2)}
    )
    (difference,) = paired_differences(STUCK, ("a", "b"), (high, low))
    assert (difference.winner, difference.won_percent) == ("b", 0.0)
    assert "no clear difference" in difference.words


def test_one_map_is_compared_pose_by_pose_and_gaps_are_left_out():
    one = outcomes_of([1.0, 2.0, np.nan, 4.0], ["m"] * 4)
    two = outcomes_of([0.0, 0.0, 0.0, 0.0], ["m"] * 4)
    (difference,) = paired_differences(SEEN, ("a", "b"), (one, two))
    assert (difference.pairs, difference.mean) == (3, pytest.approx(7 / 3))


def test_words_json_and_page_say_the_same(found):
    default, family = found
    comparison = replace(default, measure=REACH, growth_notes=("one thing to know",))
    origin = origin_of("vinefab compare", comparison.designs, None, [family])
    comparison = replace(comparison, origin=origin)
    document, page, lines = comparison.numbers, comparison.page(), comparison.summary
    best = comparison.ranked(REACH)[0][0]
    own = [one for one in comparison.in_measure(REACH) if best in (one.first, one.second)]
    assert ("not clearly ahead" in lines[0]) == (not all(one.is_clear for one in own))
    assert lines[1] == "one thing to know"
    assert document["schema"] == "vinefab/design-comparison-1"
    assert len(document["duels"]) == 3 * (len(MEASURES) - 2)
    assert document["designs"]["short"][REACH.key]["count"] == 12
    for difference in document["duels"]:
        if difference["measure"] == REACH.key:
            assert escape(p_value(difference["p_adjusted"]).text) in page
            low = difference["low"]
            ends = "(6 maps: no interval)" if low is None else f"[{low:.1f}, "
            assert any(f"{difference['mean']:.1f} {ends}" in line for line in lines)
    assert 'src="http' not in page
    assert document["growth"] == GrowthOptions().content
    assert comparison.growth in page
    assert f"growth: {comparison.growth}" in lines
    assert "one thing to know" in page


def test_a_measure_that_no_design_has_is_refused_by_name(found):
    design, family = found[0].designs[0], found[1]
    with pytest.raises(ValueError, match="ideal_anchoring_amplification"):
        compare_designs([design] * 2, [family], PredictionPlan(poses=1), measure=ANCHORING)


@pytest.mark.parametrize("count", [1, 13])
def test_too_few_or_too_many_are_refused(found, count):
    design = found[0].designs[0]
    with pytest.raises(ValueError, match="2 to 12"):
        compare_designs([design] * count, [found[1]], PredictionPlan())


def known_difference(**changes):
    numbers = {"mean": 4.0, "low": 1.5, "high": 6.0, "p": 0.01, "p_adjusted": 0.03}
    return PairedDifference(
        measure=SEEN,
        first="a",
        second="b",
        won_percent=75.0,
        pairs=8,
        over="8 maps",
        **{**numbers, **changes},
    )


def test_two_maps_give_a_mean_and_interval_of_their_differences():
    # Differences of 2 and 10: Student's interval with one degree of freedom.
    one = outcomes_of([1.0, 3.0, 10.0], ["m", "m", "n"])
    two = outcomes_of([0.0, 0.0, 0.0], ["m", "m", "n"])
    (found,) = paired_differences(SEEN, ("a", "b"), (one, two))
    half = 4.0 * student.ppf(0.975, 1)
    assert (found.mean, found.low, found.pairs) == (6.0, pytest.approx(6.0 - half), 2)
    assert found.won_percent == 100.0
    (back,) = paired_differences(SEEN, ("b", "a"), (two, one))
    assert (back.mean, back.high, back.won_percent) == (-6.0, -found.low, 0.0)


def test_ties_count_as_half_a_win():
    one = outcomes_of([1.0, 0.0, 0.0, -1.0, 2.0], list("klmno"))
    two = outcomes_of([0.0] * 5, list("klmno"))
    (found,) = paired_differences(SEEN, ("a", "b"), (one, two))
    assert found.won_percent == pytest.approx(100.0 * (2 + 2 * 0.5) / 5)


def test_rows_and_chart_show_a_known_difference():
    clear, open_ = known_difference(), known_difference(low=-1.5, p_adjusted=0.2)
    row, other = (tuple(map(str, r)) for r in paired_difference_table([clear, open_]).rows)
    assert row[2:] == ("4.0 [1.5, 6.0; 8 maps]", "0.010", "0.030", "75 %", "8", "a")
    assert other[2:] == ("4.0 [-1.5, 6.0; 8 maps]", "0.010", "0.200", "75 %", "8", "not clear")
    drawn = paired_difference_chart(SEEN, [clear, open_]).panels[0].primitives
    lines = [one.chains[0][:, 0].tolist() for one in drawn if isinstance(one, Shape)]
    assert lines[1:] == [[1.5, 6.0], [-1.5, 6.0]]
    assert [one.points[0, 0] for one in drawn if isinstance(one, Marks)] == [4.0, 4.0]
    assert clear.words.startswith("free space seen by sensors: a is better; ")
    assert clear.words.endswith("4.0 [1.5, 6.0; 8 maps] %, p = 0.030")


def test_a_difference_is_clear_below_five_percent():
    assert [known_difference(p_adjusted=p).is_clear for p in (0.0499, 0.05)] == [True, False]


def test_designs_side_by_side_have_means_over_maps():
    maps = ["a", "a", "a", "b"]
    values = {m.key: np.full(4, np.nan) for m in MEASURES}
    table = MeasureTable(
        label="l",
        map_names=tuple(maps),
        poses=(None,) * 4,
        values={**values, SEEN.key: np.array([1.0, 2.0, 3.0, 10.0])},
    )
    table = side_by_side_table({"one": table, "two": table})
    assert [tuple(map(str, row)) for row in table.rows] == [
        ("free space seen by sensors (%)", *["6.0 [0.0, 56.8; 2 maps]"] * 2),
    ]
    assert "4 deployments of each design" in table.caption


def test_designs_are_ranked_by_their_mean_and_shown_at_a_median_deployment():
    columns = {"a": [1.0, 2.0, 9.0], "b": [5.0, 6.0, 7.0], "c": [3.0, 0.0, 4.0]}
    results = tuple(
        SimpleNamespace(
            outcomes=MeasureTable(
                label="l",
                map_names=("k", "m", "n"),
                poses=(None,) * 3,
                values={SEEN.key: np.array(column), STUCK.key: np.array(column)},
            )
        )
        for column in columns.values()
    )
    comparison = DesignComparison(
        names=tuple(columns),
        designs=(),
        results=results,
        differences=(),
        contacts=(),
        plan=PredictionPlan(),
    )
    assert comparison.ranked(SEEN) == [
        ("b", 6.0), ("a", 4.0), ("c", pytest.approx(7.0 / 3.0))
    ]  # fmt: skip
    assert [name for name, _ in comparison.ranked(STUCK)] == ["c", "a", "b"]
    # Means of the deployments are 3, 2.67 and 6.67.
    assert comparison.median_deployment(SEEN) == 0
