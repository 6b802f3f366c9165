import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from vinefab.search import evaluation as module
from vinefab.search.evaluation import INVALID_FITNESS

SCORES = st.floats(-1.0, 1e4)
PENALTIES = st.floats(1e-12, 1e3)


def objective(composite: float, penalty: float, lowest: float, weight: float) -> float:
    (found,) = module.objective(np.array([composite]), np.array([penalty]), lowest, weight)
    return float(found)


@given(SCORES, SCORES, PENALTIES)
def test_a_design_that_cannot_be_made_is_worth_less_than_any_that_can(
    made: float, dreamt: float, penalty: float
) -> None:
    possible = objective(made, 0.0, lowest=-1.0, weight=1.0)
    assert possible == made
    assert INVALID_FITNESS < objective(dreamt, penalty, lowest=-1.0, weight=1.0) < possible


def test_less_penalty_and_a_better_score_both_help_designs_that_cannot_be_made() -> None:
    worth = objective(0.5, 0.3, lowest=-1.0, weight=2.0)
    assert objective(0.5, 0.2, lowest=-1.0, weight=2.0) > worth
    assert objective(0.6, 0.3, lowest=-1.0, weight=2.0) > worth


def test_what_is_no_number_is_worth_least() -> None:
    assert objective(math.nan, 0.0, lowest=0.0, weight=1.0) == INVALID_FITNESS
    assert objective(0.5, math.inf, lowest=0.0, weight=1.0) == INVALID_FITNESS
    assert objective(0.5, math.nan, lowest=0.0, weight=1.0) == INVALID_FITNESS
