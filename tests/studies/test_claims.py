import numpy as np
import pytest
from scipy.stats import norm

from vinefab.studies.claims import (
    Claim,
    ConfidenceInterval,
    StudyResult,
    difference,
    held,
    held_corrected,
    interval,
    interval_text,
    p_text,
    peak,
    percent_text,
    ratio,
    seed_mean,
    share_interval,
    spread,
)


@pytest.fixture
def rng():
    return np.random.default_rng(5)


def test_the_interval_of_a_mean_is_that_of_the_normal_law(rng):
    """Maps drawn independently, one pose, one run: the closed form is known."""
    values = rng.normal(2.0, 1.0, (1, 400, 1))
    found = interval(values)
    half = norm.ppf(0.975) * values.std() / np.sqrt(400)
    assert found.value == pytest.approx(values.mean())
    assert (found.low, found.high) == pytest.approx(
        (values.mean() - half, values.mean() + half), abs=0.01
    )
    assert found.held


def test_poses_on_a_map_do_not_count_as_maps(rng):
    """Copies of the same pose bring no confidence."""
    values = rng.normal(0.0, 1.0, (1, 30, 1))
    once, copied = interval(values), interval(np.repeat(values, 10, axis=2))
    assert (copied.low, copied.high) == pytest.approx((once.low, once.high))


def test_seeds_count_for_what_differs_between_them(rng):
    """Runs far apart from each other leave a wide interval however many maps there are."""
    runs = np.array([0.0, 1.0, 2.0, 3.0, 4.0])[:, None, None]
    found = interval(runs + 0.01 * rng.normal(size=(5, 200, 1)))
    # Student's law with four degrees of freedom, as of five numbers: 0 to 4.
    assert found.high - found.low == pytest.approx(2.0 * 2.776 * np.sqrt(2.5 / 5), rel=0.02)


def test_shared_maps_are_paired(rng):
    """A small gain on every one of very different maps is seen only when maps are paired."""
    maps = rng.normal(0.0, 1.0, (1, 25, 1))
    better = maps + 0.05
    assert difference(better, maps).held
    assert difference(better, maps).low == pytest.approx(0.05)
    assert difference(better, maps).p == pytest.approx(0.0, abs=1e-9)
    assert difference(better, maps, same_maps=False).verdict == "not held: undecided"


def test_paired_runs_are_drawn_together(rng):
    """Every run gains a little over its pair; runs differ far more from each other."""
    runs = rng.normal(0.0, 1.0, (6, 25, 1)) + rng.normal(0.0, 3.0, (6, 1, 1))
    better = runs + 0.05
    found = difference(better, runs, same_runs=True)
    assert (found.low, found.high) == (pytest.approx(0.05), pytest.approx(0.05))
    assert not difference(better, runs).held


def test_p_agrees_with_the_normal_law_and_with_the_interval(rng):
    values = rng.normal(0.0, 1.0, (1, 300, 1))
    for shift in (-0.2, -0.05, 0.0, 0.03, 0.1, 0.3):
        moved = values - values.mean() + shift
        found = interval(moved)
        known = 2.0 * norm.sf(abs(shift) / (values.std() / np.sqrt(300)))
        assert found.p == pytest.approx(min(1.0, known), abs=0.03)
        assert (found.p < 0.05) == (found.low > 0.0 or found.high < 0.0)


@pytest.mark.parametrize("statistic", [seed_mean, spread, peak])
def test_a_group_does_not_differ_from_itself(rng, statistic):
    values = rng.normal(size=(1, 20, 3))
    found = difference(values, values, statistic)
    assert (found.value, found.low, found.high, found.above) == (0.0, 0.0, 0.0, 0.5)
    assert not found.held


def test_a_reversed_order_is_called_so(rng):
    low, high = rng.normal(0.0, 0.1, (2, 3, 20, 2))
    assert difference(low, high + 1.0).verdict == "not held: reversed"


def test_spread_and_peak_are_those_of_each_run(rng):
    values = rng.normal(size=(3, 40, 2))
    flat = values.reshape(3, -1)
    assert interval(values, spread).value == pytest.approx(flat.std(axis=1).mean())
    assert interval(values, peak).value == pytest.approx(np.percentile(flat, 95, axis=1).mean())
    # The standard error of the spread of 400 normal numbers, known in closed form.
    error = interval(rng.normal(size=(1, 400, 1)), spread).error
    assert error == pytest.approx(1.0 / np.sqrt(2 * 400), rel=0.2)


def test_intervals_of_shares_end_at_0_and_1():
    found = share_interval(np.array([1.0, 1.0, 0.9, 1.0])[None, :, None])
    assert found.value == pytest.approx(0.975)
    assert (found.low > 0.85, found.high) == (True, 1.0)
    assert share_interval(np.array([0.0, 0.1, 0.0])[None, :, None]).low == 0.0


def test_a_ratio_is_that_of_the_means(rng):
    first, second = rng.normal(2.0, 0.1, (1, 50, 3)), rng.normal(4.0, 0.1, (1, 6, 3))
    found = ratio(first, second)
    assert found.value == pytest.approx(first.mean() / second.mean() - 1.0)
    assert found.low < -0.5 < found.high or abs(found.value + 0.5) < 0.05
    beyond = ratio(first, second, beyond=-0.6)
    assert beyond.value == pytest.approx(found.value + 0.6)
    assert beyond.held


def test_rounding_puts_no_bound_beyond_a_ratio_of_scores_without_spread():
    for one, other in np.random.default_rng(0).random((300, 2)):
        found = ratio(np.full((2, 3, 2), one), np.full((2, 3, 2), other))
        assert found.low <= found.value <= found.high


def experiments(rng, groups, runs, maps):
    """Groups of designs of one kind on the same maps: runs, maps and both together differ."""
    ease = rng.normal(0.0, 0.1, (1, maps, 1))
    for _ in range(groups):
        worth = rng.normal(0.0, 0.05, (runs, 1, 1)) + rng.normal(0.0, 0.05, (runs, maps, 1))
        yield ease + worth + rng.normal(0.0, 0.08, (runs, maps, 3))


def off_0(found):
    return found.low > 0.0 or found.high < 0.0


@pytest.mark.parametrize("runs", [5, 10])
def test_false_alarms_are_about_5_percent(runs):
    """Of 500 differences that are 0, 13 to 38 look real: 99 % of samples from a law of 5 %."""
    rng = np.random.default_rng(8)
    alarms = 0
    for _ in range(500):
        one, two = experiments(rng, 2, runs, 25)
        alarms += off_0(difference(one, two))
    assert 13 <= alarms <= 38


def test_intervals_of_means_ratios_and_paired_runs_cover_the_truth_as_often_as_they_say():
    """Each of three kinds of 95 % intervals misses the truth 5 % of the time."""
    rng = np.random.default_rng(9)
    missed = np.zeros(3)
    for _ in range(250):
        (one,), (other,) = experiments(rng, 1, 10, 25), experiments(rng, 1, 10, 40)
        missed[0] += off_0(interval(one))
        missed[1] += off_0(ratio(2.0 + one, 2.0 + other))
        kind = rng.normal(0.0, 0.1, (10, 1, 1))
        (one, two) = experiments(rng, 2, 10, 25)
        missed[2] += off_0(difference(kind + one, kind + two, same_runs=True))
    assert np.all(missed >= 4)
    assert np.all(missed <= 22)


def test_what_runs_and_maps_both_hold_is_counted_once():
    """Ten groups of noise without runs or maps that differ: its error is that of all its cells."""
    rng = np.random.default_rng(4)
    errors = [interval(rng.normal(0.0, 1.0, (10, 25, 1))).error for _ in range(100)]
    assert np.mean(errors) == pytest.approx(1.0 / np.sqrt(250), rel=0.25)


def known_interval(value=0.25, error=0.05, degrees=1e9, half=0.15):
    return ConfidenceInterval(
        value=value, low=value - half, high=value + half, error=error, degrees=degrees
    )


@pytest.mark.parametrize(
    ("value", "error", "p"),
    [(2.0, 1.0, 0.0455), (-2.0, 1.0, 0.0455), (0.0, 1.0, 1.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)],
)
def test_p_is_that_of_students_law(value, error, p):
    assert known_interval(value, error).p == pytest.approx(p, abs=1e-4)
    assert known_interval(12.706, 1.0, degrees=1.0).p == pytest.approx(0.05, abs=1e-4)


def test_numbers_are_written_with_their_interval():
    assert interval_text(known_interval()) == "0.250 [0.100, 0.400]"
    assert interval_text(known_interval(), 1) == "0.2 [0.1, 0.4]"
    assert percent_text(known_interval()) == "25.0 % [10.0, 40.0]"
    assert (p_text(0.0009), p_text(0.05)) == ("< 0.001", "0.050")


def test_a_claim_shows_difference_p_confidence_and_the_kept_designs():
    claim = Claim(
        text="t",
        tested=known_interval(error=0.1),
        kept=known_interval(half=0.35),
        kind="calibrated",
    )
    assert claim.cells() == (
        "held", "calibrated", "t", "0.250 [0.100, 0.400]", "0.012", "99.4 %",
        "0.250 [-0.100, 0.600], not held: undecided",
    )  # fmt: skip
    sure = Claim(text="t", tested=known_interval(), digits=2)
    assert sure.cells()[1:] == (
        "of the paper", "t", "0.25 [0.10, 0.40]", "< 0.001", "> 99.9 %", "-"
    )  # fmt: skip
    assert claim.plain()["kind"] == "calibrated"
    assert claim.plain()["difference"] == {
        "value": 0.25, "low": pytest.approx(0.1), "high": 0.4,
        "above": pytest.approx(0.9938, abs=1e-4), "p": pytest.approx(0.0124, abs=1e-4),
    }  # fmt: skip


def test_held_claims_are_counted_and_corrected_for_their_number():
    def result(*intervals):
        claims = tuple(Claim(text="t", tested=found) for found in intervals)
        return StudyResult(name="n", title="t", protocol=(), rows=(), claims=claims)

    sure, weak = known_interval(), known_interval(error=0.12)
    open_ = known_interval(half=0.35, error=0.2)
    results = [result(sure, weak), result(open_)]
    assert held(results) == (2, 3)
    # Twice 0.037 is more than 5 %: only the sure one is left.
    assert held_corrected(results) == 1


@pytest.mark.parametrize("kind", ["our threshold", "calibrated"])
def test_only_claims_of_the_paper_are_counted(kind):
    claims = (
        Claim(text="t", tested=known_interval()),
        Claim(text="u", tested=known_interval(), kind=kind),
        Claim(text="v", tested=known_interval(-0.25), kind=kind),
    )
    results = [StudyResult(name="n", title="t", protocol=(), rows=(), claims=claims)]
    assert held(results) == (1, 1)
    assert held_corrected(results) == 1
