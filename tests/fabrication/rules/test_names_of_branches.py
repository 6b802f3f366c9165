"""How findings call the branches of designs that are written branch by branch."""

import re

from vinefab.fabrication.rules.catalog import run_checks
from vinefab.fabrication.rules.rule import Subject
from vinefab.model.design import Branch, Design


def test_findings_of_branches_are_called_by_their_names_and_keep_their_ids():
    branches = [
        Branch(name="left", angle_deg=-40.0, length_mm=120.0, bends=((40.0, 20.0),)),
        Branch(name="right", angle_deg=-22.0, length_mm=120.0),
    ]
    design = Design.of_branches(branches, trunk_length_mm=150.0)
    report = run_checks(Subject.of(design))
    found = {finding.branches: finding for finding in report.findings if finding.branches}
    assert found["0.1", "0.0/1"].names == ("right", "left after its bend 1")
    assert all(len(one.names) == len(one.branches) for one in found.values())
    assert "[right, left after its bend 1] " in found["0.1", "0.0/1"].words
    levels = run_checks(Subject.of(Design.read("three_level_tree")))
    assert all(one.names == () and one.places == one.branches for one in levels.findings)


def test_messages_of_findings_say_names_and_levels_keep_ids():
    branches = [
        Branch(name="left", angle_deg=-10.0, length_mm=120.0, bends=((10.0, 80.0),)),
        Branch(name="right", angle_deg=-2.0, length_mm=9.0),
        Branch(name="end", of="right", angle_deg=0.0, length_mm=4.0),
    ]
    design = Design.of_branches(branches, trunk_length_mm=150.0)
    report = run_checks(Subject.of(design))
    said = " ".join(one.message for one in report.findings)
    assert {"left", "right", "left after its bend 1"} <= {
        name for one in report.findings for name in one.names if name in one.message
    }
    ids = {one for finding in report.findings for one in finding.branches if "." in one}
    assert ids
    assert not [one for one in ids if re.search(rf"(?<![\d.]){re.escape(one)}(?![\d.])", said)]
    levels = Design.read("three_level_tree")
    close = levels.with_level(2, angle_deg=20.0)
    report = run_checks(Subject.of(close))
    assert any("0.0 and 0.1" in one.message for one in report.findings)
