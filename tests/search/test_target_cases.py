"""Two of the cases of `target_cases.py`: one is solved, of the other a run says what stops it."""

from tests.search import target_cases


def test_a_search_touches_three_of_three_points(tmp_path):
    asked = {(kind, number): one for kind, number, one in target_cases.cases(tmp_path, 12)}
    is_solved, words, result = target_cases.solved(
        asked["shipped film, pieces", 8], tmp_path / "run"
    )
    assert is_solved, words
    assert result.score.composite["mean"] == 1.0
    assert words == "3 of 3 touched"


def test_a_run_that_misses_targets_says_which_rules_stop_robots_that_touch_them(tmp_path):
    asked = {(kind, number): one for kind, number, one in target_cases.cases(tmp_path, 3)}
    thick = asked["0.1 mm, 300 mm roll, pieces", 4]
    narrow = thick.changed(
        build=thick.build.changed(trunk_width_mm=24.0),
        search=thick.search.changed(population=20),
    )
    is_solved, words, _ = target_cases.solved(narrow, tmp_path / "run")
    assert not is_solved
    assert "robots that no rule stops: " in words
    assert "they break VF-W03" in words
