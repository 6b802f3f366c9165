import math

import numpy as np
import pytest

from tests.oracles.anchoring import pouch_contact_mm2
from vinefab.core.errors import BadInputError
from vinefab.physics.anchoring import (
    ASSUMED_FRICTION,
    FILM_N_MM,
    SEAM_N_MM,
    NumberRange,
    amplification,
    amplification_interval,
    branch_limit_n,
    payload_over_mass,
    pouch_contacts_mm2,
)

TURN_RAD = math.log(6.86 / 6.0) / 0.3
"""Mean turn of a branch that makes six of them hold 6.86 times one pouch at mu = 0.3."""


def test_the_papers_six_branches() -> None:
    for engaged, expected in ((6, 6.86), (5, 5.72), (4, 4.57)):
        assert amplification([TURN_RAD] * engaged, 0.3) == pytest.approx(expected, abs=0.005)


MEASURED, POUCH_N, HELD_N = 6.54, 0.65, 4.25
"""Of the paper's robot: how much more than one pouch it held, what one held, what it held."""


def test_the_papers_measurement_lies_in_the_interval_of_its_engaged_branches() -> None:
    """One of its six branches touched nothing, one hung slack: four or five were engaged."""
    found = amplification_interval([TURN_RAD] * 6, 4, 5)
    assert found.low == pytest.approx(4 * math.exp(0.2 * TURN_RAD))
    assert found.value == pytest.approx(5.72, abs=0.005)
    assert found.high == pytest.approx(5 * math.exp(0.8 * TURN_RAD))
    assert found.low <= MEASURED <= found.high
    assert POUCH_N * found.low <= HELD_N <= POUCH_N * found.high


def test_that_interval_could_have_missed_the_measurement() -> None:
    """With four engaged, with all six, or at the friction of the prediction it does miss it."""
    assert amplification_interval([TURN_RAD] * 6, 4, 4).high < MEASURED
    assert amplification_interval([TURN_RAD] * 6, 6).low > MEASURED
    likely = NumberRange(low=0.3, value=0.3, high=0.3)
    assert amplification_interval([TURN_RAD] * 6, 4, 5, likely).high < MEASURED


def test_the_bounds_take_the_branches_that_turned_least_and_most() -> None:
    friction = NumberRange(low=0.1, value=0.2, high=0.3)
    found = amplification_interval([2.0, 0.0, 1.0], 1, 2, friction)
    assert found.low == 1.0
    assert found.high == pytest.approx(math.exp(0.3) + math.exp(0.6))
    assert found.value == pytest.approx(2 / 3 * (1.0 + math.exp(0.2) + math.exp(0.4)))
    assert amplification_interval([2.0, 0.0], 0).low == 0.0
    for fewest, most in ((2, 1), (0, 2), (-1, 1)):
        with pytest.raises(BadInputError, match="fewest, most"):
            amplification_interval([1.0], fewest, most)


def test_pouches_press_from_where_they_are_wider_than_the_gap():
    touching = 2 * 40.0 / math.pi
    gaps = np.array([touching, 1.001 * touching, 0.999 * touching, 0.0])
    *apart, near, flat = pouch_contacts_mm2(np.full(4, 30.0), np.full(4, 40.0), gaps).tolist()
    assert (apart, flat) == ([0.0, 0.0], 1200.0)
    assert 0.0 < near < 3.0
    rng = np.random.default_rng(1)
    length, width, gap = rng.uniform(0.0, 50.0, (3, 200))
    gap[:3] = 2.0 * width[0] / math.pi, math.inf, 0.0
    alone = [pouch_contact_mm2(*one) for one in zip(length, width, gap, strict=True)]
    assert pouch_contacts_mm2(length, width, gap).tolist() == alone
    assert 0 < np.count_nonzero(alone) < 200


def test_film_and_seam_cap_a_branch() -> None:
    # 14 mm: film 27.6 MPa x 0.0375 mm x 28 mm = 29 N, seam 0.446 N/mm x 28 mm = 12.5 N
    assert branch_limit_n(14.0, SEAM_N_MM) == pytest.approx(12.48, abs=0.01)
    assert branch_limit_n(14.0, FILM_N_MM) == pytest.approx(28.98, abs=0.01)


def test_the_heavy_anchor_needs_24_mm_of_its_film() -> None:
    # 0.05 mm of film at 27.6 MPa hold 66.7 N from 24.2 mm on, if the seam does not open before.
    assert branch_limit_n(24.2, 27.6 * 0.05) == pytest.approx(66.7, abs=0.15)


def test_5_g_hold_575_g() -> None:
    assert payload_over_mass(0.575 * 9.80665, 5.0) == pytest.approx(115.0)


def test_intervals_rise() -> None:
    assert (ASSUMED_FRICTION.low, ASSUMED_FRICTION.high) == (0.2, 0.8)
    with pytest.raises(BadInputError, match="rising"):
        NumberRange(low=1.0, value=0.5, high=2.0)
