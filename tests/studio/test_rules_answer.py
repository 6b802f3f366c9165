"""The sheet's panel says what the full check says, with the place of every finding."""

import json

import pytest

from vinefab.fabrication import checking
from vinefab.fabrication.checking import check_design
from vinefab.model.design import Design
from vinefab.model.files.design_toml import design_content
from vinefab.prediction.deploy import deploy
from vinefab.studio.sheet_answers import rules_answer
from vinefab.studio.state import StudioState

GRID = {"source": {"environment": "grid", "seed": 3}, "edits": []}


def answered(name="three_level_tree", world=None, edit=None, **more):
    content = design_content(Design.read(name))
    if edit is not None:
        edit(content)
    state = StudioState.of({"design": content, "map": world, **more})
    answer = rules_answer(state, {}, lambda *_: None)
    json.dumps(answer, allow_nan=False)
    return state, answer


def narrow(content):
    content["level"][0]["angle_deg"] = 40.0
    content["build"]["compensation"] = "none"


def test_the_answer_is_that_of_the_check():
    state, answer = answered("cave_explorer_pieces")
    report = check_design(state.design, state.profile)
    assert answer["verdict"] == report.verdict
    assert {one["fingerprint"] for one in answer["findings"]} == {
        finding.fingerprint for finding in report.findings
    }
    assert answer["pieces_words"] == "2 pieces, no fewer possible"
    assert len(answer["rules_skipped"]) == len(report.skipped)
    assert "free space only" in answer["deployed_problem"]


def test_errors_come_first_and_waived_ones_last():
    _, answer = answered(edit=narrow)
    severities = [one["severity"] for one in answer["findings"]]
    assert answer["errors"] > 0
    assert severities == sorted(severities, key=["error", "warning", "info"].index)
    first = answer["findings"][0]
    assert first["reason"]
    assert first["at_mm"] is not None
    waiver = {"fingerprint": first["fingerprint"], "reason": "only a trial"}
    _, waived = answered(edit=lambda c: (narrow(c), c["waive"].append(waiver)))
    assert waived["errors"] < answer["errors"]
    assert waived["findings"][-1]["waiver_reason"] == "only a trial"


def test_findings_beyond_the_most_are_counted(monkeypatch):
    monkeypatch.setattr("vinefab.studio.sheet_answers.MOST_FINDINGS", 2)
    state, answer = answered(edit=narrow)
    total = len(check_design(state.design, state.profile).findings)
    assert (len(answer["findings"]), answer["findings_left_out"]) == (2, total - 2)


def test_the_gauge_has_the_pressure_that_the_rule_compares():
    state, answer = answered(world=GRID)
    deployed = (("grid_3", deploy(state.design, state.world, state.start).deployment),)
    weak = {"VF-P03": {"safety_factor": 30.0}}
    report = check_design(state.design, state.profile, weak, deployed=deployed)
    (window,) = (one for one in report.findings if one.rule == "VF-P03")
    gauge = answer["gauge"]
    assert window.measured == pytest.approx(gauge["needed_loose"]["kpa"])
    assert gauge["needed_loose"]["kpa"] < gauge["needed_tight"]["kpa"]
    assert gauge["needed_standing"] == "simulated, constants assumed"
    assert answered()[1]["gauge"]["needed_standing"] == "computed, constants assumed"


def test_a_start_inside_of_an_obstacle_leaves_the_other_rules():
    world = {**GRID, "edits": [["add", [[0, 0], [400, 0], [400, 400], [0, 400]]]]}
    _, answer = answered(world=world)
    assert answer["deployed"] == []
    assert "not grown on map" in answer["deployed_problem"]
    assert answer["rules_run"] > 20


def test_a_large_design_that_is_forbidden_has_findings_without_a_sheet(monkeypatch):
    monkeypatch.setattr(checking, "MANY_BRANCHES", 5)
    _, answer = answered(edit=narrow)
    assert answer["sheet_svg"] == ""
    assert answer["errors"] > 0
    assert [line["item"] for line in answer["bill"]] == ["film in branches"]
