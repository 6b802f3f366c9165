import json
from dataclasses import replace

import numpy as np
import pytest

from vinefab.model.files.design_toml import read_design
from vinefab.prediction.comparison import (
    compare_designs,
    comparison_lines,
    comparison_page,
    comparison_text,
    paired_differences,
)
from vinefab.prediction.family_deployments import PredictionPlan, unseen_maps
from vinefab.prediction.measures import MEASURES, REACH, SEEN, STUCK, MeasureTable
from vinefab.prediction.provenance import origin_of
from vinefab.prediction.sensitivity import scaled_tree

SMALL = {"columns": 3, "rows": 3, "size_mm": 300.0}


@pytest.fixture(scope="module")
def found():
    design = read_design("three_level_tree")
    short = replace(scaled_tree(design, 0.5), name="short")
    family = unseen_maps("grid", 6, 0, SMALL)
    return compare_designs([design, short, design], [family], PredictionPlan(poses=2)), family


def outcomes_of(values, maps):
    return MeasureTable(
        label="l", maps=tuple(maps), poses=(None,) * len(maps), values={SEEN.key: np.array(values)}
    )


def test_a_design_against_itself_is_a_draw(found):
    comparison, _ = found
    assert comparison.names == ("three_level_tree (1)", "short", "three_level_tree (2)")
    twins = [
        difference
        for difference in comparison.differences
        if "short" not in (difference.first, difference.second)
    ]
    assert len(twins) == len(MEASURES)
    for difference in twins:
        assert (
            difference.mean,
            difference.low,
            difference.high,
            difference.p,
            difference.won_percent,
        ) == (0, 0, 0, 1.0, 50.0)
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
    assert difference.p == pytest.approx(2 / 2**12)
    assert (difference.winner, difference.won_percent, difference.is_clear) == ("a", 100.0, True)


def test_p_values_are_adjusted_within_a_measure():
    maps = [f"m{index}" for index in range(5)]
    columns = ([1, 2, 3, 4, 5], [0, 0, 0, 0, 0], [1, 2, 2, 4, 4])
    three = [outcomes_of(np.array(column, float), maps) for column in columns]
    differences = paired_differences(SEEN, ("a", "b", "c"), three)
    assert [difference.p for difference in differences] == pytest.approx([2 / 32, 0.5, 2 / 32])
    assert [difference.p_adjusted for difference in differences] == pytest.approx(
        [6 / 32, 0.5, 6 / 32]
    )


def test_less_is_better_where_it_is():
    maps = ("m", "n")
    high = MeasureTable(label="l", maps=maps, poses=(None, None), values={STUCK.key: np.ones(2)})
    low = MeasureTable(label="l", maps=maps, poses=(None, None), values={STUCK.key: np.zeros(2)})
    (difference,) = paired_differences(STUCK, ("a", "b"), (high, low))
    assert (difference.winner, difference.won_percent) == ("b", 0.0)
    assert "no clear difference" in difference.words


def test_one_map_is_compared_pose_by_pose_and_gaps_are_left_out():
    one = outcomes_of([1.0, 2.0, np.nan, 4.0], ["m"] * 4)
    two = outcomes_of([0.0, 0.0, 0.0, 0.0], ["m"] * 4)
    (difference,) = paired_differences(SEEN, ("a", "b"), (one, two))
    assert (difference.pairs, difference.mean) == (3, pytest.approx(7 / 3))


def test_words_json_and_page_say_the_same(found):
    comparison, family = found
    origin = origin_of("vinefab compare", comparison.designs, None, [family])
    document = json.loads(comparison_text(comparison, REACH, origin))
    page = comparison_page(comparison, REACH, PredictionPlan(poses=2), origin)
    lines = comparison_lines(comparison, REACH)
    assert document["schema"] == "vinefab/design-comparison-1"
    assert len(document["duels"]) == 3 * len(MEASURES)
    assert document["designs"]["short"][REACH.key]["count"] == 12
    for difference in document["duels"]:
        if difference["measure"] == REACH.key:
            assert f"{difference['p_adjusted']:.5f}" in page
            assert any(
                f"{difference['mean']:.1f} [{difference['low']:.1f}, " in line for line in lines
            )
    assert 'src="http' not in page


@pytest.mark.parametrize("count", [1, 13])
def test_too_few_or_too_many_are_refused(found, count):
    design = found[0].designs[0]
    with pytest.raises(ValueError, match="2 to 12"):
        compare_designs([design] * count, [found[1]], PredictionPlan())
