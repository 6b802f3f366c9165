"""What coupon readings tell, by simulation.

`python tests/fabrication/calibration/test_intervals.py` prints how often intervals hold the truth,
and the root mean square error of growth constants from today's paths and those of before.
"""

import math
import tomllib
from dataclasses import replace

import numpy as np
import pytest

from vinefab.fabrication.calibration.coupons import GROWTH_PATHS, read_results
from vinefab.fabrication.calibration.estimate import (
    GROWTH_CONSTANTS,
    GrownPath,
    fit_growth,
    mean_estimate,
)
from vinefab.fabrication.calibration.fit_recipe import calibrated_recipe, fitted_recipe
from vinefab.model.laser import read_profile
from vinefab.physics.growth_pressure import FITTED, growth_pressure_kpa

BEFORE = {"growth": ("300", "600", "300 90 300", "300 90 300 90 300", "300 180 300", "900 90 100")}
TRUE = {name: getattr(FITTED, name).value for name in GROWTH_CONSTANTS}
NOISES = {"0.2 kPa and 3 %": (0.2, 0.03), "0.5 kPa and 5 %": (0.5, 0.05)}
NEVER_KEPT = {name: 50.0 * value for name, value in TRUE.items()}


def exact_paths(paths, true, noise):
    """Return paths with exact pressures, by the model that predicts them, and their noise."""
    found = []
    for measure, settings in paths.items():
        for setting in settings:
            numbers = [float(word) for word in setting.split()]
            turns = tuple(math.radians(turn) for turn in numbers[1::2])
            is_free = measure == "growth_free"
            values = {**true, "storage_kpa": 0.0 if is_free else true["storage_kpa"]}
            constants = FITTED.changed(
                **{n: getattr(FITTED, n).changed(value=v) for n, v in values.items()}
            )
            kpa = growth_pressure_kpa(numbers[::2], turns, constants)
            found.append(
                GrownPath(
                    lengths_mm=tuple(numbers[::2]),
                    turns_rad=turns,
                    pressure_kpa=kpa,
                    sigma_kpa=math.hypot(noise[0], noise[1] * kpa),
                    is_free=is_free,
                )
            )
    return found


def fitted(exact, rng, usual=NEVER_KEPT, *, stated=False):
    """Return one fit to pressures with noise."""
    noisy = [
        replace(
            path,
            pressure_kpa=max(1e-3, rng.normal(path.pressure_kpa, path.sigma_kpa)),
            sigma_kpa=path.sigma_kpa if stated else None,
        )
        for path in exact
    ]
    return fit_growth(noisy, usual)


def relative_errors(paths, noise, true=TRUE):
    """Return the standard error of each constant over its value, by Fisher information.

    With it the condition number of the scaled sensitivities.
    """
    exact = exact_paths(paths, true, noise)
    sigma = np.array([path.sigma_kpa for path in exact])
    columns = []
    for name, value in true.items():
        ends = (exact_paths(paths, {**true, name: value * f}, noise) for f in (1.0001, 0.9999))
        more, less = (np.array([path.pressure_kpa for path in one]) for one in ends)
        columns.append((more - less) / 0.0002 / sigma)
    rows = np.array(columns).T
    return np.sqrt(np.diag(np.linalg.inv(rows.T @ rows))), np.linalg.cond(rows)


def held(readings, draws, seed=0):
    """Return how often mean +- 2 u, and the interval, hold the truth for so few readings."""
    rng = np.random.default_rng(seed)
    two, t = 0, 0
    for values in rng.normal(10.0, 1.0, (draws, readings)).tolist():
        found = mean_estimate(values, [None] * readings, "x")
        off = abs(found.value - 10.0)
        two, t = two + (off < 2.0 * found.uncertainty), t + (off < found.half_width())
    return two / draws, t / draws


@pytest.mark.parametrize("count", [2, 3, 5])
def test_intervals_of_few_readings_hold_the_truth_as_often_as_they_say(count):
    two_sigma, interval = held(count, 2000)
    assert interval == pytest.approx(0.95, abs=0.015)
    assert two_sigma < 0.9


@pytest.mark.parametrize("noise", NOISES.values(), ids=NOISES)
def test_the_paths_of_the_table_tell_the_growth_constants_apart(noise):
    table, condition = relative_errors(GROWTH_PATHS, noise)
    before, condition_before = relative_errors(BEFORE, noise)
    assert table.max() < 0.25
    assert condition < 10.0
    assert before.max() > 3.0
    assert condition_before > 200.0
    exact, rng = exact_paths(GROWTH_PATHS, TRUE, noise), np.random.default_rng(3)
    fits = [fitted(exact, rng) for _ in range(60)]
    for place, (name, true) in enumerate(TRUE.items()):
        off = np.array([fit[name].value - true for fit in fits])
        assert math.sqrt(np.mean(off**2)) < 1.4 * table[place] * true
        assert np.mean(np.abs(off) < [fit[name].half_width() for fit in fits]) >= 0.85


def test_growth_constants_that_readings_do_not_tell_are_kept_and_said_so(tmp_path):
    exact, rng = exact_paths(BEFORE, TRUE, NOISES["0.2 kPa and 3 %"]), np.random.default_rng(5)
    lines = [
        f"growth,{setting},{rng.normal(path.pressure_kpa, path.sigma_kpa):.3f},kPa"
        for setting, path in zip(BEFORE["growth"], exact, strict=True)
    ]
    width_mm = 25.0 * math.pi / 2.0  # inflates to the published tube's diameter
    table = tmp_path / "results.csv"
    rows = [f"growth_width,,{width_mm},mm", *lines]
    table.write_text("measure,setting,value,unit\n" + "\n".join(rows) + "\n")
    profile = read_profile("co2_60w__stretchlon_200")
    calibration = fitted_recipe(read_results(table), profile)
    kept = {name for name in TRUE if calibration.fitted[f"growth.{name}"].readings == 0}
    assert "yield_kpa" in kept < set(TRUE)
    assert calibration.fitted["growth.yield_kpa"].value == pytest.approx(TRUE["yield_kpa"])
    assert any("growth.yield_kpa" in remark for remark in calibration.remarks)
    growth = {name: calibration.fitted[f"growth.{name}"] for name in TRUE}
    text = calibrated_recipe(calibration, "co2_60w__stretchlon_200", tmp_path / "mine.toml", table)
    written = tomllib.loads(text)["growth"]
    assert {name for name in growth if written[name]["standing"] == "assumed"} == kept


def measured():
    """Yield the figures as lines."""
    for readings in (2, 3, 5, 10):
        two, t = held(readings, 2000)
        yield f"{readings} readings, 2,000 draws: 2 u holds {two:.1%}, the t interval {t:.1%}"
    for words, noise in NOISES.items():
        for when, paths in (("before", BEFORE), ("today", GROWTH_PATHS)):
            fisher, condition = relative_errors(paths, noise)
            exact, rng = exact_paths(paths, TRUE, noise), np.random.default_rng(1)
            fits = [fitted(exact, rng) for _ in range(300)]
            whole = [fit for fit in fits if all(one.readings for one in fit.values())]
            yield f"noise {words}, {when}: condition {condition:.0f}, {len(whole)} of 300 whole"
            for place, (name, true) in enumerate(TRUE.items()):
                off = np.array([fit[name].value - true for fit in whole])
                inside = np.mean(np.abs(off) < [fit[name].half_width() for fit in whole])
                rms = math.sqrt(np.mean(off**2)) / true
                yield f"  {name}: Fisher {fisher[place]:.1%}, rms {rms:.1%}, held {inside:.1%}"
            usual = {name: 1.5 * value for name, value in TRUE.items()}
            some = [fitted(exact, rng, usual) for _ in range(100)]
            kept = {name: sum(one[name].readings == 0 for one in some) for name in TRUE}
            yield f"  kept from elsewhere in so many of 100 fits: {kept}"


if __name__ == "__main__":
    for line in measured():
        print(line)  # noqa: T201
