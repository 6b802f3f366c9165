"""The fix of the studio keeps what is locked, and says what it changes and what that costs."""

import json
import math

import pytest

from vinefab.core.errors import BadInputError
from vinefab.model.design import Build, Design, Level, default_fillets_mm, design_of
from vinefab.model.files.design_toml import design_content
from vinefab.studio.sheet_answers import fix_answer, kept_kinds
from vinefab.studio.state import PAGE, StudioState

GRID = {"source": {"environment": "grid", "seed": 3}, "edits": []}


def fork(**changes):
    widths = (40.0, 24.0)
    level = Level(branches=2, length_mm=200.0, fan_rad=math.radians(60.0))
    build = Build(widths_mm=widths, fillet_mm=default_fillets_mm(widths), **changes)
    return Design(name="fork", trunk_length_mm=250.0, levels=(level,), build=build)


def answered(design, ask=None, **more):
    state = StudioState.of({"design": design_content(design), **more})
    told = []
    answer = fix_answer(state, ask or {}, lambda *now: told.append(now[0]))
    json.dumps(answer, allow_nan=False)
    assert all(0.0 <= share <= 1.0 for share in told)
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
    answer = answered(fork(tail_mm=120.0), map=GRID, locks=["build.tail_mm", "level.0.angle_deg"])
    proposed = design_of(answer["design"], PAGE)
    assert (proposed.name, proposed.build.tail_mm) == ("fork", 150.0)
    assert [change["text"] for change in answer["changes"]] == ["the tail: 120 -> 150 mm (+25.0 %)"]
    assert answer["report"]["manufacturable"]
    assert answer["keep"] == ["angle"]
    assert answer["locks_changed"] == ["build.tail_mm"]
    assert [score["task"] for score in answer["scores"]] == [
        "coverage", "reach", "anchoring, ideal case",
    ]  # fmt: skip
    # The tail lies outside of the map.
    assert all(score["before"] == score["after"] for score in answer["scores"])
    assert "simulated" in answer["scores_note"]


def test_without_errors_there_is_nothing_to_fix():
    answer = answered(fork())
    assert (answer["nothing_to_fix"], answer["design"]) == (True, None)


def test_a_fix_that_fails_says_so():
    design = fork().changed(limits={"VF-L04": {"error": 0.01}})
    answer = answered(design, map=GRID)
    assert answer["failed"]
    assert (answer["design"], answer["changes"], answer["scores"]) == (None, [], [])
    assert "no change of the design was found that clears VF-L04" in answer["lines"][0]
