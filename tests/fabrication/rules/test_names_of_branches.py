"""How findings call the branches of designs that are written branch by branch."""

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
