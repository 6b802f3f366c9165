"""Rules of the laser that hang on coupons, on a second machine, or on a sheet put back by hand."""

from dataclasses import replace

import pytest

from vinefab.core.table import Table
from vinefab.fabrication.job.laser_job import laser_job
from vinefab.fabrication.job.placement import SheetOptions
from vinefab.fabrication.rules.catalog import run_checks
from vinefab.fabrication.rules.rule import Subject
from vinefab.model.finding import Severity
from vinefab.model.laser import EnergyWindow, read_profile
from vinefab.model.quantity import Quantity, Standing


def measured(value):
    return Quantity(value=value, standing=Standing.MEASURED, source="a test")


def changed(table: Table, **values: float) -> Table:
    """Return a table with other numbers."""
    return table.changed(
        **{name: getattr(table, name).changed(value=value) for name, value in values.items()}
    )


def found_by(rule, subject):
    return [one for one in run_checks(subject, only=(rule,)).findings if one.rule == rule]


@pytest.mark.parametrize(
    ("low", "high", "focus_mm", "holds"),
    [
        (0.5, 2.0, 0.0, True),
        (1.0, 2.0, 0.0, True),
        (1.02, 2.0, 0.0, False),
        (0.5, 0.98, 0.0, False),
        (None, None, 0.0, False),
        (1.02, 2.0, 3.0, True),  # of another focus: it says nothing
    ],
)
def test_energies_lie_where_coupons_passed(make, profile, low, high, focus_mm, holds):
    """Ends of the window as shares of the energy that the recipe runs."""
    name, run, machine = next(beam for beam in profile.beams if beam[0] == "weldcut")
    energy = run.line_energy_mj_mm(machine)
    window = EnergyWindow(
        operation=name,
        focus_mm=run.focus_offset_mm.value + focus_mm,
        least_mj_mm=None if low is None else measured(low * energy),
        most_mj_mm=None if high is None else measured(high * energy),
    )
    coupons = profile.recipe.coupons.changed(windows=(window,))
    tried = replace(profile, recipe=profile.recipe.changed(coupons=coupons))
    said = [
        one for one in found_by("VF-L06", Subject.of(make(), tried)) if "coupons say" in one.message
    ]
    assert [one.severity for one in said] == ([] if holds else [Severity.WARNING])
    assert all(f"{energy:.1f} mJ/mm" in one.message for one in said)
    assert all(("nowhere" in one.message) == (low is None) for one in said)


@pytest.mark.parametrize("bed_mm", [100.0, 2000.0])
def test_a_sheet_must_lie_on_the_cutter_s_bed_too(make, bed_mm):
    profile = read_profile("hot_tip_220_knife__stretchlon_200")
    cutter = changed(profile.cutter, bed_width_mm=bed_mm, bed_height_mm=bed_mm)
    subject = Subject.of(make(trunk_mm=60.0, tail_mm=100.0), replace(profile, cutter=cutter))
    said = [one for one in found_by("VF-S01", subject) if one.message.startswith("what ")]
    fits = bed_mm > 1000.0
    assert [one.severity for one in said] == ([] if fits else [Severity.ERROR])
    if not fits:
        assert f"what {cutter.name} cuts does not lie on its bed" in said[0].message
        assert 0.0 < said[0].measured < 1000.0


def test_robots_that_find_no_room_are_counted(make, profile):
    wide = make((3, 250.0, 150.0))
    job = laser_job(wide, profile, sheet=SheetOptions(copies=12))
    (said,) = found_by("VF-S01", Subject.on_sheet(wide, profile, job))
    placed = job.facts["robots_placed"]
    assert 1 <= placed < 12
    assert f"only {placed} of 12 robots" in said.message


@pytest.mark.parametrize(
    "recipe", ["hot_tip_220__stretchlon_200", "impulse_sealer_300__stretchlon_800"]
)
def test_thickness_is_asked_of_a_laser_only(make, recipe):
    report = run_checks(Subject.of(make(), read_profile(recipe)), only=("VF-L04",))
    assert [one.rule for one in report.skipped] == ["VF-L04"]
    assert "makes the seams of this recipe" in report.skipped[0].reason
    assert not report.run
