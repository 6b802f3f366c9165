"""Progress of long commands where no terminal shows a bar."""

import builtins
import io
import time

import pytest

from vinefab.cli.commands import Terminal
from vinefab.core import verbs
from vinefab.core.verbs import _State, progress_in_lines, progress_shown


@pytest.fixture
def often(monkeypatch):
    """Lines follow each other in hundredths of a second."""
    for name in ("FIRST_S", "STEP_S", "MOST_STEP_S"):
        monkeypatch.setattr(verbs, name, 0.01)


def written(capsys, least):
    """Wait until some lines are written to standard error, and return them."""
    text, ends_s = "", time.monotonic() + 5.0
    while text.count("\n") < least and time.monotonic() < ends_s:
        time.sleep(0.01)
        text += capsys.readouterr().err
    return text.splitlines()


@pytest.mark.usefixtures("often")
def test_a_piped_command_tells_how_far_it_is_while_a_step_lasts(capsys):
    with Terminal().progress("working") as show:
        show(0.25, "1 of 4")
        lines = written(capsys, 2)
    assert len(lines) >= 2
    assert lines[-1].startswith("working: 25 % after 0 s")
    assert lines[-1].endswith(": 1 of 4")
    capsys.readouterr()  # a line may have come just before the end
    time.sleep(0.05)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("quiet", [True, False])
def test_quiet_commands_and_quick_ones_write_no_line(capsys, quiet, monkeypatch):
    if quiet:
        monkeypatch.setattr(verbs, "FIRST_S", 0.001)
    with Terminal(quiet=quiet).progress("working") as show:
        show(0.5, "half")
        time.sleep(0.05)
    assert capsys.readouterr().err == ""


def test_the_time_left_is_that_at_the_pace_of_this_session(monkeypatch):
    now_s = [100.0]
    monkeypatch.setattr(verbs.time, "monotonic", lambda: now_s[0])
    state = _State("run")
    assert state.line() == "run: 0 % after 0 s"
    now_s[0] += 5.0
    state.update(0.5, "as recorded")  # of an earlier session
    now_s[0] += 60.0
    state.update(0.75, "75 of 100")
    assert state.line() == "run: 75 % after 1 min 5 s, about 1 min 0 s left: 75 of 100"
    state.update(0.1, "the next part")
    assert state.line() == "run: 10 % after 1 min 5 s: the next part"


@pytest.mark.usefixtures("often")
def test_nobody_listening_ends_nothing(monkeypatch):
    monkeypatch.setattr(verbs.sys, "stderr", None)
    with progress_in_lines("working") as show:
        show(0.5, "half")
        time.sleep(0.05)


class Screen(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self):
        return True


@pytest.fixture
def soon(monkeypatch):
    """What is shown to somebody who watches is shown within hundredths of a second."""
    monkeypatch.setattr(verbs, "SHOWN_AFTER_S", 0.01)
    monkeypatch.setattr(verbs, "SHOWN_EVERY_S", 0.01)


def shown_line(stream):
    """Let a block of work be shown, and return what was."""
    with progress_shown("aim", shown=True) as tell:
        tell(0.25, "1 of 4")
        ends_s = time.monotonic() + 5.0
        while "1 of 4" not in stream.getvalue() and time.monotonic() < ends_s:
            time.sleep(0.01)
    return stream.getvalue()


@pytest.mark.usefixtures("soon")
@pytest.mark.parametrize("place", ["terminal", "notebook"])
def test_a_function_shows_one_line_to_who_watches_and_clears_it(place, monkeypatch):
    screen = Screen() if place == "terminal" else io.StringIO()
    monkeypatch.setattr(verbs.sys, "stderr" if place == "terminal" else "stdout", screen)
    if place == "notebook":
        monkeypatch.setattr(builtins, "get_ipython", object, raising=False)
    text = shown_line(screen)
    assert "\raim: 25 % after 0 s: 1 of 4" in text
    assert "\n" not in text
    assert text.endswith(" \r")


@pytest.mark.usefixtures("soon")
@pytest.mark.parametrize("shown", [True, False])
def test_a_function_is_quiet_where_nobody_watches_or_nothing_was_asked_for(
    shown, monkeypatch, capsys
):
    screen = io.StringIO() if shown else Screen()
    monkeypatch.setattr(verbs.sys, "stderr", screen)
    with progress_shown("aim", shown=shown) as tell:
        tell(0.5, "half")
        time.sleep(0.05)
    assert screen.getvalue() == capsys.readouterr().out == ""


def test_quick_functions_show_nothing(monkeypatch):
    screen = Screen()
    monkeypatch.setattr(verbs.sys, "stderr", screen)
    with progress_shown("aim", shown=True) as tell:
        tell(0.5, "half")
    assert screen.getvalue() == ""
