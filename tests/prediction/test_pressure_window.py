from dataclasses import replace

import numpy as np
import pytest

from vinefab.model.design import Build
from vinefab.model.files.profile_toml import read_profile
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.laser import Standing
from vinefab.prediction.family_deployments import PredictionPlan, PreparedFamily, deploy_family
from vinefab.prediction.measures import LOOSE_PRESSURE
from vinefab.prediction.pressure_window import window_of


def test_a_robot_without_room_has_no_pressure(straight):
    design, family = straight
    wide = replace(design, build=Build.standard(1, trunk_width_mm=2000.0))
    result = deploy_family(
        wide, PreparedFamily.of(family, PredictionPlan(poses=1)), PredictionPlan(poses=1)
    )
    assert result.outcomes.spread(LOOSE_PRESSURE) is None
    assert window_of(wide, read_profile(DEFAULT_RECIPE), [result.outcomes]) is None


def test_window_is_between_what_growth_takes_and_what_the_trunk_stands(result, explorer):
    window = window_of(explorer, read_profile(DEFAULT_RECIPE), [result.outcomes])
    loose = result.outcomes.values[LOOSE_PRESSURE.key]
    assert window.needed_kpa == pytest.approx(np.percentile(loose, 95))
    # 70 kPa at 20 mm, a trunk of 24 mm, a factor of 1.5.
    assert window.allowed_kpa == pytest.approx(70.0 * 20.0 / 24.0 / 1.5)
    assert window.is_open == (window.needed_kpa < window.allowed_kpa)
    assert window.standing is Standing.ASSUMED
    assert window.loose.enough_percent == 100.0 * np.mean(loose <= window.allowed_kpa)
