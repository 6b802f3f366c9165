from dataclasses import replace

import pytest

from vinefab.fabrication.rules.catalog import run_checks
from vinefab.fabrication.rules.rule import Subject
from vinefab.model.design import Collar
from vinefab.model.finding import Severity
from vinefab.model.quantity import Quantity, Standing


def asking(profile, operation, **changes_mm):
    """Return a recipe that asks for more than the paths were drawn with."""
    operations = dict(profile.recipe.by_operation)
    settings = operations[operation]
    changes = {
        name: getattr(settings, name).changed(value=getattr(settings, name).value + more)
        for name, more in changes_mm.items()
    }
    operations[operation] = settings.changed(**changes)
    return replace(profile, recipe=profile.recipe.changed(operations=operations))


def seam_findings(subject):
    report = run_checks(subject)
    (checked,) = [run.checked for run in report.run if run.rule == "VF-P05"]
    return checked, [finding for finding in report.findings if finding.rule == "VF-P05"]


@pytest.mark.parametrize("fans", [(), ((3, 200.0, 120.0), (2, 120.0, 50.0))])
def test_paths_drawn_by_the_recipe_are_checked_in_full(make, profile, fans):
    subject = Subject.of(make(*fans), profile)
    # every branch has two sides here, and the mouth two corners
    assert seam_findings(subject) == (len(subject.layout.tree) + 2, [])


def test_a_seam_narrower_than_the_recipes_is_measured(make, profile):
    subject = Subject.of(make((2, 200.0, 60.0)), profile)
    wider = asking(profile, "weldcut", seam_width_mm=0.1)
    _, (found,) = seam_findings(replace(subject, profile=wider))
    assert found.severity is Severity.WARNING
    assert (found.measured, found.limit) == (pytest.approx(0.4), pytest.approx(0.5))
    assert "3 branches" in found.message


@pytest.mark.parametrize(("more_mm", "count"), [(0.004, 0), (0.006, 1)])
def test_an_overcut_shorter_than_the_recipes_is_found(make, profile, more_mm, count):
    subject = Subject.of(make((2, 200.0, 60.0)), profile)
    longer = asking(profile, "cut", overcut_mm=more_mm)
    _, found = seam_findings(replace(subject, profile=longer))
    assert len(found) == count
    assert all(finding.measured == pytest.approx(2.0) for finding in found)


def test_a_collar_is_as_wide_as_its_clamp_and_not_as_the_trunk(make, profile):
    """Its straight part is longer here than all else of the trunk."""
    collar = Collar(clamp_diameter_mm=50.0, length_mm=250.0, flare_mm=60.0)
    design = make(trunk_mm=200.0, tail_mm=330.0, collar=collar)
    report = run_checks(Subject.of(design, profile), only=("VF-W04", "VF-P05"))
    assert report.findings == ()
    assert [run.checked for run in report.run] == [1, 1 + 2]


@pytest.mark.parametrize(
    ("percent", "severity"), [(0.0, None), (0.2, Severity.INFO), (2.0, Severity.WARNING)]
)
def test_a_known_shrinkage_is_said_and_moves_no_path(make, profile, percent, severity):
    shrinkage = Quantity(value=percent, standing=Standing.MEASURED, source="a test")
    material = profile.material.changed(shrinkage_percent=shrinkage)
    shrinking = replace(profile, material=material)
    design = make((2, 200.0, 60.0), widths_mm=(40.0, 20.0))
    subject, plain = Subject.of(design, shrinking), Subject.of(design, profile)
    assert subject.job is not None
    assert plain.job is not None
    boxes = ([path.contour.box_mm for path in job.paths] for job in (subject.job, plain.job))
    assert next(boxes) == next(boxes)
    found = run_checks(subject, only=("VF-W04",)).findings
    assert [finding.severity for finding in found] == ([severity] if severity else [])
    for finding in found:
        assert finding.measured == pytest.approx(0.01 * percent * 40.0)
        trunk_mm = subject.layout.tree.length_mm[0]
        assert f"{(trunk_mm + 200.0) * (1.0 - 0.01 * percent):.0f}" in finding.message
