"""Several robots on one sheet: each is measured in the sheet's own paths, and named."""

import math
from dataclasses import replace

import pytest

from vinefab.fabrication.job.laser_job import laser_job
from vinefab.fabrication.job.placement import SheetOptions
from vinefab.fabrication.package.prepare import prepare
from vinefab.fabrication.rules.catalog import SLEEVE_RULES, rules_on, run_checks
from vinefab.fabrication.rules.rule import Scope, Subject
from vinefab.model.finding import Severity
from vinefab.model.job import Operation


@pytest.fixture
def fork(make):
    return make((2, 150.0, 70.0)).changed(name="fork")


@pytest.fixture
def vine(make):
    return make().changed(name="vine")


def squeezed(contour, share):
    """Return a contour with everything nearer to its mouth's middle, as wrong units would."""
    middle = (contour.points_mm[0] + contour.points_mm[-1]) / 2.0
    return replace(contour, points_mm=middle + share * (contour.points_mm - middle))


def with_path(job, label, change):
    paths = tuple(change(path) if path.label == label else path for path in job.paths)
    assert any(path.label == label for path in job.paths)
    return replace(job, paths=paths)


def found(design, profile, job, rule):
    report = run_checks(Subject.on_sheet(design, profile, job), only=(rule,))
    return list(report.findings)


def test_widths_of_every_robot_are_measured_where_it_lies(fork, vine, profile):
    job = laser_job(fork, profile, SheetOptions(copies=2, beside=(vine,)))
    for design, checked in ((fork, 2 * 3), (vine, 1)):
        report = run_checks(Subject.on_sheet(design, profile, job), only=("VF-W04",))
        assert report.run[0].checked == checked
        assert report.findings == ()


@pytest.mark.parametrize(
    ("label", "of_fork", "of_vine"),
    [("fork, part 2 of 3", 1, 0), ("vine, part 3 of 3", 0, 1)],
)
def test_the_robot_that_came_out_narrow_is_named(fork, vine, profile, label, of_fork, of_vine):
    job = laser_job(fork, profile, SheetOptions(copies=2, beside=(vine,)))
    wrong = with_path(
        job,
        f"outline of {label}",
        lambda path: replace(path, contour=squeezed(path.contour, 0.98)),
    )
    forks, vines = (
        [f for f in found(design, profile, wrong, "VF-W04") if f.branches == ("0",)]
        for design in (fork, vine)
    )
    assert (len(forks), len(vines)) == (of_fork, of_vine)
    assert all(f"'outline of {label}'" in finding.message for finding in forks)
    assert not {"VF-W04", "VF-P05"} & rules_on(Scope.SHEET)
    # a seam too narrow by a fiftieth of the tube, on one side and the other
    seams = [len(found(design, profile, wrong, "VF-P05")) for design in (fork, vine)]
    assert [count > 0 for count in seams] == [of_fork > 0, of_vine > 0]


def test_a_mark_without_room_is_a_notice(fork, profile):
    job = laser_job(fork, profile)
    told = replace(job, facts={**job.facts, "marks_left_out": ["no room for the label of fork"]})
    (finding,) = found(fork, profile, told, "VF-L01")
    assert finding.severity is Severity.INFO
    assert "label of fork: write it on the film by hand" in finding.message
    assert found(fork, profile, job, "VF-L01") == []


def test_a_cut_into_the_seam_is_found(fork, profile):
    sheet = SheetOptions(process="weld+cut")
    job = laser_job(fork, profile, sheet)
    assert found(fork, profile, job, "VF-L02") == []
    seam = profile.settings(Operation.WELD).seam_width_mm
    wide = profile.settings("weld").changed(seam_width_mm=seam.changed(value=seam.value + 4.2))
    operations = {**profile.recipe.by_operation, "weld": wide}
    asking = replace(profile, recipe=profile.recipe.changed(operations=operations))
    # 2 mm of web and 2.1 mm more on this side of the seam: 0.1 mm is gone
    along = {f.branches: f for f in found(fork, asking, job, "VF-L02")}
    assert along[("0.0",)].measured == pytest.approx(-0.1, abs=0.02)
    assert "into 'seam of fork' along 'cut around fork'" in along[("0.0",)].message
    x, y = along[("0.0",)].x_mm, along[("0.0",)].y_mm
    assert math.hypot(x - 300.0, y) < 160.0 < math.hypot(x + 60.0, y)


def test_a_cut_that_ends_where_it_began_is_found(fork, profile):
    cut = profile.settings("cut")
    bare = cut.changed(overcut_mm=cut.overcut_mm.changed(value=0.5))
    operations = {**profile.recipe.by_operation, "cut": bare}
    short = replace(profile, recipe=profile.recipe.changed(operations=operations))
    job = laser_job(fork, short, SheetOptions(process="weld+cut"))
    (finding,) = found(fork, profile, job, "VF-P05")
    assert (finding.measured, finding.limit) == (pytest.approx(0.5), cut.overcut_mm.value)
    assert "around the robot" in finding.message


def test_reports_of_robots_in_one_piece_name_no_rule_about_pieces(fork, vine, profile):
    made = prepare(fork, profile, sheet=SheetOptions(copies=1, beside=(vine,)))
    assert made.beside
    for report in (made.report, *made.beside):
        named = {entry.rule for entry in (*report.run, *report.skipped)}
        assert "VF-B01" in named
        assert not named & SLEEVE_RULES
