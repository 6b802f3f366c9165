"""Measures against closed forms and against other ways to the same numbers."""

import numpy as np
import pytest

from tests.oracles.grown_paths import grown_paths
from vinefab.core.statistics import mean_interval
from vinefab.model.deployment import Stop
from vinefab.model.map import Pose
from vinefab.physics.growth_pressure import growth_pressures_kpa, riding_mm
from vinefab.prediction.family_deployments import PredictionPlan, PreparedFamily, deploy_family
from vinefab.prediction.measures import (
    ANCHORING,
    COVERAGE,
    GROWN,
    IDEAL_ANCHORING,
    LOOSE,
    LOOSE_PRESSURE,
    MEASURES,
    REACH,
    SEEN,
    STUCK,
    TIGHT,
    TIGHT_PRESSURE,
    UNDEPLOYED,
    MeasureTable,
    shares_percent,
)


def test_a_straight_vine_in_an_empty_room_gives_what_paper_and_pencil_give(straight):
    design, family = straight
    result = deploy_family(
        design, PreparedFamily.of(family, PredictionPlan(poses=1)), PredictionPlan(poses=1)
    )
    found = {m.key: float(result.outcomes.values[m.key][0]) for m in MEASURES}
    room_mm2 = 400.0 * 200.0
    assert found[SEEN.key] == pytest.approx(100 * np.pi * 50.0**2 / room_mm2, rel=1e-3)
    stadium_mm2 = 100.0 * 80.0 + np.pi * 40.0**2
    assert found[REACH.key] == pytest.approx(100 * stadium_mm2 / room_mm2, rel=4e-3)
    assert (found[GROWN.key], found[STUCK.key], found[UNDEPLOYED.key]) == (100.0, 0.0, 0.0)
    # Y and f of the 25 mm tube, times its diameter over this one's.
    scale = 25.0 / (2.0 * 20.0 / np.pi)
    assert found[LOOSE_PRESSURE.key] == pytest.approx(scale * (1.92 + 0.771 * 0.1))
    assert found[TIGHT_PRESSURE.key] == pytest.approx(scale * (1.92 + 8.32 + 0.771 * 0.1))
    assert found[IDEAL_ANCHORING.key] == pytest.approx(1.0)
    assert np.isnan(found[ANCHORING.key])  # without pouches
    # One disc: nothing is seen twice, so only area and film count.
    film = 100.0 / (20.0 * np.hypot(400.0, 200.0))
    assert found[COVERAGE.key] == pytest.approx(found[SEEN.key] / 100.0 - 0.1 * film, rel=1e-3)


def test_pressures_on_arrays_are_those_of_paths_from_the_base(result, explorer):
    riding = riding_mm(result.deployments[0].tree)
    widths_mm = explorer.build.widths_mm
    tubes_mm = [2.0 * width_mm / np.pi for width_mm in widths_mm]
    several = [[fit.at_diameter(mm, 25.0) for mm in tubes_mm] for fit in (LOOSE, TIGHT)]
    turned = 0
    for deployment in result.deployments:
        rows = growth_pressures_kpa([deployment], (LOOSE, TIGHT))
        assert (np.isfinite(rows) == deployment.deployed).all()
        for levels, row in zip(several, rows, strict=True):
            for branch, path in grown_paths(deployment).items():
                own = levels[deployment.tree.level[branch] - 1]
                turned += path.turn_rad > 1.0
                expected = path.pressure_kpa(own, float(riding[branch]))
                assert row[branch] == pytest.approx(expected, rel=1e-12)
    assert turned > 100


def spread_of(values, maps, measure=COVERAGE):
    table = {measure.key: np.array(values)}
    return MeasureTable(label="", map_names=tuple(maps), poses=(), values=table).spread(measure)


def test_every_number_of_a_spread_is_what_its_name_says():
    values = np.append(np.arange(101.0)[::-1], np.nan)
    spread = spread_of(values, ["only map"] * 102)
    assert spread.count == 101
    assert (spread.p05, spread.median, spread.p95) == (5.0, 50.0, 95.0)
    assert (spread.least, spread.greatest, spread.mean) == (0.0, 100.0, 50.0)
    assert spread.deviation == pytest.approx(np.sqrt((101**2 - 1) / 12))
    # On one map the interval is over poses: 1.96 standard errors to either side, nearly.
    half = 1.96 * spread.deviation / np.sqrt(101)
    assert (spread.low, spread.high) == pytest.approx((50.0 - half, 50.0 + half), abs=0.1 * half)


def test_a_mean_and_its_interval_are_over_maps_and_not_over_deployments():
    # Means of the maps are 2 and 10.
    spread = spread_of([1.0, 2.0, 3.0, 10.0], ["a", "a", "a", "b"])
    assert (spread.mean, spread.over) == (6.0, "2 maps")
    assert (spread.low, spread.high) == mean_interval([2.0, 10.0])
    assert spread.median == 2.5
    alike = spread_of([4.0, 4.0], ["a", "b"])
    assert (alike.has_interval, alike.deviation) == (False, 0.0)
    shares = spread_of([2.0, 90.0], ["a", "b"], SEEN)
    assert (shares.low, shares.high) == (0.0, 100.0)  # no share lies outside
    assert spread_of([np.nan], ["a"]) is None


def test_a_table_counts_maps_and_refuses_columns_of_another_length():
    poses = (Pose(x_mm=0.0, y_mm=0.0, heading_rad=0.0),) * 3
    maps = ("a", "a", "b")
    table = MeasureTable(label="l", map_names=maps, poses=poses, values={SEEN.key: np.zeros(3)})
    assert (len(table), table.map_count) == (3, 2)
    with pytest.raises(ValueError, match="seen_percent"):
        MeasureTable(label="l", map_names=maps, poses=poses, values={SEEN.key: np.zeros(2)})


@pytest.mark.parametrize(
    ("measure", "value", "text"),
    [
        (SEEN, 12.34, "12.3 %"),
        (COVERAGE, 0.123456, "0.1235"),
        (ANCHORING, 6.864, "6.86 x"),
        (LOOSE_PRESSURE, 4.05, "4.0 kPa"),
        (SEEN, -0.01, "0.0 %"),
        (SEEN, np.nan, "-"),
    ],
)
def test_numbers_are_shown_with_their_digits_and_unit(measure, value, text):
    assert measure.text(value) == text


def test_shares_of_branches_are_counted():
    stop = [Stop.FULL_LENGTH, Stop.HEAD_ON, Stop.CORNER, Stop.NOT_DEPLOYED, Stop.FULL_LENGTH]
    grown_mm = np.array([80.0, 40.0, 10.0, 0.0, 50.0])
    found = shares_percent(np.array(stop), grown_mm, np.array([0, 4, 5]), np.array([200.0, 50.0]))
    # 130 of 200 mm; two of four branches stuck, one never emerged. Then one that grew in full.
    assert pytest.approx(np.array([(65.0, 50.0, 25.0), (100.0, 0.0, 0.0)])) == found.T
