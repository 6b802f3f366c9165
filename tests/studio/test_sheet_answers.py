"""The sheet's panel says what the full check says; a fix keeps what is locked, and has a cost."""

import json
import math

import pytest

from vinefab.core.errors import BadInputError
from vinefab.core.progress import heard_by
from vinefab.fabrication import checking
from vinefab.fabrication.checking import check_design
from vinefab.model.design import Build, Design, Level, default_fillets_mm, design_content, design_of
from vinefab.prediction.deploy import deploy
from vinefab.studio.sheet_answers import fix_answer, kept_kinds, rules_answer
from vinefab.studio.state import PAGE, StudioState

GRID = {"source": {"environment": "grid", "seed": 3}, "edits": []}


def answered(name="three_level_tree", world=None, edit=None, **more):
    content = design_content(Design.read(name))
    if edit is not None:
        edit(content)
    state = StudioState.of({"design": content, "map": world, **more})
    answer = rules_answer(state, {})
    json.dumps(answer, allow_nan=False)
    return state, answer


def narrow(content):
    content["level"][0]["angle_deg"] = 40.0
    content["build"]["compensation"] = "none"


def test_the_answer_is_that_of_the_check():
    state, answer = answered("cave_explorer_pieces_levels")
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


def fork(**changes):
    widths = (40.0, 24.0)
    level = Level(branches=2, length_mm=200.0, fan_rad=math.radians(60.0))
    build = Build(widths_mm=widths, fillet_mm=default_fillets_mm(widths), **changes)
    return Design(name="fork", trunk_length_mm=250.0, levels=(level,), build=build)


def fixed(design, ask=None, **more):
    state = StudioState.of({"design": design_content(design), **more})
    told = []
    with heard_by(told.append):
        answer = fix_answer(state, ask or {})
    json.dumps(answer, allow_nan=False)
    assert all(one.share is None or 0.0 <= one.share <= 1.0 for one in told)
    return answer


@pytest.mark.parametrize(
    ("lock", "kept"),
    [
        ("level.0.angle_deg", {"angle"}),
        ("level.1.length", {"length"}),
        ("level.1.growth_percent", {"length"}),
        ("trunk.length", {"length"}),
        ("level.0.branches", {"branches"}),
        ("build.widths_mm.2", {"width"}),
        ("build.pouch.radius_mm", {"width"}),
        ("build.tail_mm", set()),
    ],
)
def test_a_lock_keeps_its_kind(lock, kept):
    keep, words = kept_kinds(frozenset({lock}), [])
    assert keep == kept
    assert [lock in sentence for sentence in words] == [True] * len(kept)


def test_words_that_are_asked_for_are_kept_too():
    assert kept_kinds(frozenset(), ["length", "angle"]) == ({"length", "angle"}, [])
    with pytest.raises(BadInputError, match="colour"):
        kept_kinds(frozenset(), ["colour"])
    with pytest.raises(BadInputError, match=r"fix\.keep"):
        kept_kinds(frozenset(), 7)


def test_a_fix_has_the_design_its_changes_and_what_it_costs():
    answer = fixed(fork(tail_mm=120.0), map=GRID, locks=["build.tail_mm", "level.0.angle_deg"])
    proposed = design_of(answer["design"], PAGE)
    assert (proposed.name, proposed.build.tail_mm) == ("fork", 150.0)
    assert answer["changes"] == ["the tail: 120 -> 150 mm (+25.0 %)"]
    assert not check_design(proposed, StudioState.of({"design": answer["design"]}).profile).blocking
    assert answer["keep"] == ["angle"]
    assert answer["locks_changed"] == ["build.tail_mm"]
    assert [score["task"] for score in answer["scores"]] == [
        "coverage", "reach", "anchoring, ideal case",
    ]  # fmt: skip
    # The tail lies outside of the map.
    assert all(score["before"] == score["after"] for score in answer["scores"])
    assert "simulated" in answer["scores_note"]


def test_without_errors_there_is_nothing_to_fix():
    answer = fixed(fork())
    assert (answer["lines"], answer["design"]) == (["no errors, nothing to fix"], None)


def test_a_fix_that_fails_says_so():
    design = fork().changed(limits={"VF-L04": {"error": 0.01}})
    answer = fixed(design, map=GRID)
    assert (answer["design"], answer["changes"], answer["scores"]) == (None, [], [])
    assert "no change of the design was found that clears VF-L04" in answer["lines"][0]
