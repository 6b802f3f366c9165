"""Measures against closed forms and against other ways to the same numbers."""

import numpy as np
import pytest

from vinefab.physics.growth_path import grown_paths, riding_mm
from vinefab.prediction.family_deployments import PredictionPlan, PreparedFamily, deploy_family
from vinefab.prediction.growth_pressures import (
    LOOSE,
    TIGHT,
    constants_by_level,
    growth_pressures_kpa,
)
from vinefab.prediction.measures import GROWN, LOOSE_PRESSURE, MEASURES, REACH, SEEN, STUCK


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
    assert (found[GROWN.key], found[STUCK.key]) == (100.0, 0.0)
    # Y and f of the 25 mm tube, times its diameter over this one's.
    scale = 25.0 / (2.0 * 20.0 / np.pi)
    assert found[LOOSE_PRESSURE.key] == pytest.approx(scale * (1.92 + 0.771 * 0.1))


def test_pressures_on_arrays_are_those_of_paths_from_the_base(result, explorer):
    riding = riding_mm(result.deployments[0].tree, explorer.build.widths_mm)
    turned = 0
    for deployment in result.deployments:
        rows = growth_pressures_kpa(deployment, explorer)
        assert (np.isfinite(rows) == deployment.deployed).all()
        for fit, row in zip((LOOSE, TIGHT), rows, strict=True):
            levels = constants_by_level(explorer, fit)
            for branch, path in grown_paths(deployment).items():
                own = levels[deployment.tree.level[branch] - 1]
                turned += path.turn_rad > 1.0
                expected = path.pressure_kpa(own, float(riding[branch]))
                assert row[branch] == pytest.approx(expected, rel=1e-12)
    assert turned > 100


def test_spread_of_means_is_taken_over_maps(result):
    spread = result.outcomes.spread(SEEN)
    values = result.outcomes.values[SEEN.key]
    assert spread.count == 10
    assert spread.mean == pytest.approx(values.mean())
    assert spread.least <= spread.p05 <= spread.median <= spread.p95 <= spread.greatest
    assert spread.low < spread.mean < spread.high
