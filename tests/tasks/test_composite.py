import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vinefab.tasks.composite import COMPOSITES, composite, composites

SCORES = st.lists(st.floats(0.0, 1.0), min_size=1, max_size=20)


def test_the_three_ways_on_numbers_done_by_hand() -> None:
    values = composite([0.2, 0.4, 0.6])
    deviation = (0.08 / 3) ** 0.5
    assert (*values, "single") == COMPOSITES
    assert values["mean"] == pytest.approx(0.4)
    assert values["best"] == 0.6
    assert values["min_deviation"] == pytest.approx(0.25 * 0.4 + 0.75 * (1 - deviation / 0.5))


@given(SCORES)
def test_order_does_not_matter_and_bounds_hold(scores: list[float]) -> None:
    values = composite(scores)
    assert values == pytest.approx(composite(scores[::-1]))
    assert min(scores) - 1e-12 <= values["mean"] <= values["best"] + 1e-12
    assert 0.0 <= values["min_deviation"] <= 1.0 + 1e-12


def test_wide_scores_earn_nothing_for_steadiness() -> None:
    assert composite([0.0, 100.0])["min_deviation"] == pytest.approx(0.25 * 50.0)


@given(
    st.lists(SCORES, min_size=1, max_size=5).map(lambda r: [row[: min(map(len, r))] for row in r])
)
def test_many_rows_are_weighed_as_each_alone(rows: list[list[float]]) -> None:
    for kind in COMPOSITES:
        alone = [composite(row, 0.3)["mean" if kind == "single" else kind] for row in rows]
        assert composites(np.array(rows), kind, 0.3).tolist() == alone
