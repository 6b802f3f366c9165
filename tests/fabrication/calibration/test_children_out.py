"""Which children of joint coupons came out: from the table to measured contacts and predictions."""

import math

import numpy as np
import pytest

import vinefab as vf
from vinefab.core.errors import BadInputError
from vinefab.fabrication.calibration.coupons import (
    JOINT_KPA,
    joint_designs,
    read_results,
    results_text,
)
from vinefab.fabrication.calibration.fit_recipe import children_out
from vinefab.growth.options import GrowthOptions, growth_text, measured_values
from vinefab.model.contacts import read_contacts
from vinefab.model.design import Design
from vinefab.model.laser import read_profile

HEADER = "measure,setting,value,unit,uncertainty\n"
HALF_ANGLE = """schema = "vinefab/contacts-1"
[head_on_half_angle_deg]
value = 4.5
low = 3.0
high = 6.0
count = 12
photos = 6
source = "photos"
[method]
kept = true
"""


def table(tmp_path, rows):
    path = tmp_path / "results.csv"
    lines = [f"children_out,{name} {kpa:g},{out},children," for name, kpa, out in rows]
    path.write_text(HEADER + "\n".join(lines) + "\n")
    return path


def test_shares_of_each_pressure_have_jeffreys_intervals(tmp_path):
    pair, elbow = "PAIR-60-W20", "ELBOW-60-W40"
    rows = [(pair, 20, 2)] * 8 + [(pair, 20, 1), (elbow, 20, 1), (pair, 10, 1)]
    low, usual = children_out(read_results(table(tmp_path, rows)))
    assert (low.pressure_kpa, low.count, low.tried) == (10.0, 1, 2)
    assert (usual.pressure_kpa, usual.count, usual.tried) == (20.0, 18, 19)
    # Jeffreys: 2.5 % of the posterior of the prior 1 / sqrt(p (1 - p)) lie below and above.
    share = np.linspace(0.0, 1.0, 400_001)[1:-1]
    posterior = share**17.5 * (1.0 - share) ** 0.5
    for end, part in ((usual.low, 0.025), (usual.high, 0.975)):
        assert posterior[share < end].sum() / posterior.sum() == pytest.approx(part, abs=1e-4)
    assert usual.low < 18 / 19 < usual.high < 1.0
    (all_out,) = children_out(read_results(table(tmp_path, [(pair, 20, 2)] * 5)))
    assert all_out.high == all_out.value == 1.0
    assert math.isclose(all_out.low, 0.7828, abs_tol=2e-3)  # tables of the Jeffreys interval, 10/10


@pytest.mark.parametrize(
    ("name", "kpa", "out"),
    [("PAIR-60-W20", 20, 3), ("PAIR-60-W20", 20, 0.5), ("KERF", 20, 1), ("PAIR-60-W20", 20, 0)],
)
def test_rows_that_cannot_be_are_named(tmp_path, name, kpa, out):
    with pytest.raises(BadInputError, match="children_out"):
        children_out(read_results(table(tmp_path, [(name, kpa, out)])))


def test_the_table_asks_for_every_joint_coupon():
    rows = results_text(read_profile("co2_60w__stretchlon_200"), None).splitlines()
    asked = [row.split(",")[1] for row in rows if row.startswith("children_out")]
    assert asked == [f"{joint.name} {JOINT_KPA:g}" for joint in joint_designs()]


def test_calibration_adds_the_share_to_measured_contacts(tmp_path):
    results = table(tmp_path, [("PAIR-60-W20", 20, 2)] * 9 + [("PAIR-60-W20", 20, 0)])
    contacts = tmp_path / "contacts.toml"
    contacts.write_text("# vinefab\n" + HALF_ANGLE)
    vf.calibrate(results, out=tmp_path / "mine.toml", contacts=contacts, force=True)
    found = read_contacts(contacts)
    assert found.head_on_half_angle_deg.value == 4.5
    assert found.emergence.value == 0.9
    assert "kept = true" in contacts.read_text()
    values = measured_values(found)
    assert values["emergence"] == 0.9
    options = GrowthOptions.of({"contacts": found})
    assert options.emergence == 0.9
    assert options.emergences == (found.emergence.high, 0.9, found.emergence.low)
    text = growth_text(options, [Design.read("grid_explorer_levels")])
    assert (
        "probability 0.9 (measured: 18 of 20 children at 20 kPa, 95 % interval 0.72 to 0.98)"
        in text
    )


def test_contacts_need_rows(tmp_path):
    results = tmp_path / "results.csv"
    results.write_text(HEADER + "burst,20,80,kPa,\nburst,20,82,kPa,\nburst,20,84,kPa,\n")
    with pytest.raises(BadInputError, match="children_out"):
        vf.calibrate(results, out=tmp_path / "m.toml", contacts=tmp_path / "contacts.toml")
