"""Two of the cases of `target_cases.py`: one is solved, of the other a run says what stops it."""

import pytest

from tests.search import target_cases


def searched(folder, kind, number, population, generations, **build):
    """Return whether a small search of a case is solved, a line about it, and its result."""
    cases = target_cases.cases(folder, generations)
    case = next(one for known, place, one in cases if (known, place) == (kind, number))
    small = case.changed(
        build=case.build.changed(**build),
        search=case.search.changed(population=population),
        evaluation=case.evaluation.changed(finalists=2),
    )
    return target_cases.solved(small, folder / "run")


def test_a_search_touches_three_of_three_points(tmp_path):
    is_solved, words, result = searched(tmp_path, "shipped film, pieces", 8, 40, 8)
    assert is_solved, words
    assert result.score.composite["mean"] == 1.0
    assert words == "3 of 3 touched"


@pytest.mark.thorough
def test_a_run_that_misses_targets_says_which_rules_stop_robots_that_touch_them(tmp_path):
    kind = "0.1 mm, 300 mm roll, pieces"
    is_solved, words, _ = searched(tmp_path, kind, 4, 20, 3, trunk_width_mm=24.0)
    assert not is_solved
    assert "robots that may break the rules touch more (3 of 3 touched), but break VF-J02" in words
