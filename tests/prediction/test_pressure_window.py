import numpy as np
import pytest

from vinefab.core.view import document
from vinefab.model.design import Build, Design, Pouch
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.laser import read_profile
from vinefab.model.quantity import Standing
from vinefab.pages.panel import Shape
from vinefab.prediction.family_deployments import PredictionPlan, PreparedFamily, deploy_family
from vinefab.prediction.measures import LOOSE_PRESSURE, TIGHT_PRESSURE, MeasureTable
from vinefab.prediction.pressure_window import window_blocks, window_chart, window_of


def test_a_robot_without_room_has_no_pressure(straight):
    design, family = straight
    wide = design.changed(build=Build.standard(1, trunk_width_mm=2000.0))
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


def known_window(most_kpa=30.0):
    """Needs evenly spread from 0 to a pressure, twice that with tight film."""
    needs = np.append(np.linspace(0.0, most_kpa, 101), np.nan)
    values = {LOOSE_PRESSURE.key: needs, TIGHT_PRESSURE.key: 2.0 * needs}
    table = MeasureTable(label="l", map_names=("m",) * 102, poses=(None,) * 102, values=values)
    pouch = Pouch(shape="rectangle", length_mm=30.0, width_mm=40.0)
    build = Build.standard(1, trunk_width_mm=20.0).changed(pouch=pouch, pressure_kpa=15.0)
    design = Design(name="v", trunk_length_mm=100.0, build=build)
    return window_of(design, read_profile(DEFAULT_RECIPE), [table])


def test_needs_are_percentiles_over_the_deployments_that_emerged():
    window = known_window()
    loose, tight = window.loose, window.tight
    assert (loose.p05_kpa, loose.median_kpa, loose.p95_kpa) == pytest.approx((1.5, 15.0, 28.5))
    assert (loose.greatest_kpa, tight.p95_kpa, tight.greatest_kpa) == pytest.approx((30, 57, 60))
    assert window.needed_kpa == loose.p95_kpa


def test_what_widths_may_take_follows_from_the_burst_test():
    window = known_window()
    trunk, pouch = window.levels
    # 70 kPa at 20 mm and a factor of 1.5; twice the width stands half of it.
    assert (trunk.burst_kpa, trunk.allowed_kpa) == pytest.approx((70.0, 70.0 / 1.5))
    assert (pouch.width_mm, pouch.burst_kpa) == pytest.approx((40.0, 35.0))
    assert window.allowed_kpa == pytest.approx(35.0 / 1.5)
    assert trunk.inflated_mm == pytest.approx(40.0 / np.pi)
    # Hoop stress P w / (pi t) over 30 MPa.
    strain = 15e-3 * 20.0 / np.pi / 0.0375 / 30.0
    assert trunk.strain_percent == pytest.approx(100.0 * strain)
    # 23.3 of 30 kPa: 78 of 101 needs; with tight film half as many.
    assert window.loose.enough_percent == pytest.approx(100.0 * 78 / 101)
    assert window.tight.enough_percent == pytest.approx(100.0 * 39 / 101)


def test_a_window_is_open_only_where_needs_lie_below_limits():
    # 95 % of the needs are 0.95 of the greatest; 23.3 kPa are allowed, 15 kPa is the pressure.
    found = [
        (w.is_open, w.is_open_tight, w.holds_working)
        for w in map(known_window, (12.0, 15.0, 20.0, 25.0))
    ]
    assert found == [
        (True, True, True), (True, False, True), (True, False, False), (False, False, False)
    ]  # fmt: skip


def test_tables_chart_and_json_show_the_window():
    window = known_window(20.0)
    data, section = window_blocks(window, "basis")
    needs, limits = ([tuple(map(str, row)) for row in table.rows] for table in section.tables)
    assert needs[0] == ("loosely", "1.0", "10.0", "19.0", "20.0", "100.0 %")
    assert needs[1] == ("tightly", "2.0", "20.0", "38.0", "40.0", "58.4 %")
    assert limits[0] == ("trunk", "20.00", "12.73", "70.0", "46.7", "8 %")
    assert limits[1] == ("pouch", "40.00", "25.46", "35.0", "23.3", "17 %")
    (panel,) = window_chart(window).panels
    assert panel.title == "window 19.0 to 23.3 kPa"
    shapes = [one for one in panel.primitives if isinstance(one, Shape) and one.closed]
    filled = [one.chains[0][:2, 0] for one in shapes]
    room, *bars = [ends.tolist() for ends in filled[:4]]
    assert room == pytest.approx([19.0, 23.3], abs=0.05)
    assert bars[0] == pytest.approx([1.0, 19.0])
    assert bars[1] == pytest.approx([2.0, 38.0])
    assert bars[2] == pytest.approx([0.0, 70.0 / 1.5])
    (closed,) = window_chart(known_window(30.0)).panels
    assert closed.title == "no window: 5.2 kPa missing"
    content = document([data, section])["pressure_window"]
    assert (content["needed_kpa"], content["allowed_kpa"]) == (19.0, 23.3)
    assert content["needs"][1]["p95_kpa"] == 38.0
    assert content["needs"][1]["enough_percent"] == 58.4
    assert content["widths"][1]["strain_percent"] == 17
