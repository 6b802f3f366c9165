"""Limits of a run raised when it is resumed."""

import pytest

from tests.search.conftest import followed
from tests.search.kill import content
from vinefab.core.errors import BadInputError
from vinefab.search.record.result import RECORD_FILE, RunArchive
from vinefab.search.run import run_search
from vinefab.search.settings import MapSettings, PartSettings


def of_generations(settings, generations, **changed):
    search = settings.search.changed(generations=generations, **changed)  # type: ignore[arg-type]
    return settings.changed(search=search, maps=MapSettings(count=1))


def extended(folder, settings, **limits):
    return run_search(settings, folder, resume=True, limits=limits)


@pytest.mark.parametrize("name", ["islands", "particleswarm"])
def test_an_extended_run_is_the_one_asked_for_at_once(tmp_path, small, name):
    settings = small.changed(optimizer=PartSettings(name=name))
    first = run_search(of_generations(settings, 2), tmp_path / "run")
    second = extended(tmp_path / "run", of_generations(settings, 2), generations=4)
    whole = run_search(of_generations(settings, 4), tmp_path / "whole")
    assert len(first.history) == 2
    assert (second.best, second.run_id) == (whole.best, whole.run_id)
    assert content(tmp_path / "run") == content(tmp_path / "whole")


def test_an_extension_is_recorded_and_holds_for_all_later_sessions(tmp_path, small):
    asked = of_generations(small, 2)
    first = run_search(asked, tmp_path)
    second = extended(tmp_path, asked, generations=3)
    (extension,) = second.extensions
    assert extension.generations_done == 2
    assert extension.stopped == "generations"
    assert (extension.before["generations"], extension.after["generations"]) == (2, 3)
    assert extension.score == first.score.composite["mean"]
    assert any("generations 2 -> 3" in line for line in second.summary)
    assert '"generations_done": 2' in second.json_text()
    # The run file still says what was asked for first, or now what holds.
    for settings in (asked, of_generations(small, 3)):
        again = run_search(settings, tmp_path, resume=True)
        assert (again.best, again.extensions) == (second.best, second.extensions)
    archive = RunArchive.read(tmp_path / RECORD_FILE)
    assert archive.settings.search.generations == 3
    assert archive.result().extensions == second.extensions
    assert archive.summary.extensions[0].after["generations"] == 3


def test_an_extension_that_is_interrupted_goes_on(tmp_path, small):
    asked = of_generations(small, 2)

    def stop(progress):
        if progress.done == 3:
            raise KeyboardInterrupt

    run_search(asked, tmp_path / "run")
    with pytest.raises(KeyboardInterrupt), followed(stop):
        run_search(asked, tmp_path / "run", resume=True, limits={"generations": 5})
    run_search(asked, tmp_path / "run", resume=True)
    run_search(of_generations(small, 5), tmp_path / "whole")
    assert content(tmp_path / "run") == content(tmp_path / "whole")


def test_evaluations_are_a_limit_that_can_be_raised_or_lifted(tmp_path, small):
    asked = of_generations(small, 5, evaluations=6)
    assert run_search(asked, tmp_path).stopped == "evaluations"
    assert len(extended(tmp_path, asked, evaluations=13).history) == 3
    assert len(extended(tmp_path, asked, evaluations=0).history) == 5


@pytest.mark.parametrize(
    ("limits", "allowed"),
    [
        ({"generations": 1}, "--generations is 1; allowed: at least the 2 that the run has"),
        ({"evaluations": 99}, "--evaluations is 99; allowed: 0: it has no limit"),
        ({"wall_time_s": 2.0}, "allowed: at least the 900.0 that the run has, or 0 for no limit"),
        ({"wall_time_s": 1e4}, "the run has stopped by --generations; give more"),
        (
            {"generations": 10**9},
            "--generations is 1000000000; allowed: less than or equal to 1000000",
        ),
    ],
)
def test_limits_that_do_not_let_a_run_go_on_are_refused_and_nothing_changes(
    tmp_path, small, limits, allowed
):
    asked = of_generations(small, 2, wall_time_s=900.0)
    run_search(asked, tmp_path)
    before = content(tmp_path)
    with pytest.raises(BadInputError) as refused:
        extended(tmp_path, asked, **limits)
    assert allowed in str(refused.value)
    assert content(tmp_path) == before


def test_a_changed_run_file_is_told_of_the_option(tmp_path, small):
    run_search(of_generations(small, 2), tmp_path)
    with pytest.raises(BadInputError, match=r"the run began with 2; .*--generations raises it"):
        run_search(of_generations(small, 3), tmp_path, resume=True)
    other = of_generations(small, 2).changed(name="other")
    with pytest.raises(BadInputError, match="name: 'other' is asked for"):
        extended(tmp_path, other, generations=3)


def test_a_limit_raised_to_what_it_is_only_reports(tmp_path, small):
    asked = of_generations(small, 2)
    first = run_search(asked, tmp_path)
    again = extended(tmp_path, asked, generations=2)
    assert (again.best, again.extensions) == (first.best, ())
