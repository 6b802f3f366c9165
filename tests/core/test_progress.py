"""Progress: phases with counts, who hears them, and the lines of those who watch or read."""

import builtins
import io
import threading
import time
from contextlib import nullcontext
from itertools import pairwise

import pytest

import vinefab as vf
from vinefab.cli.commands import Terminal
from vinefab.core import progress as module
from vinefab.core.progress import (
    COMPILING,
    Progress,
    ProgressLine,
    ProgressLines,
    announce,
    announce_to_all,
    each,
    heard_by,
    is_heard,
    phase,
    progress_in_lines,
    progress_seen,
    progress_shown,
)


@pytest.fixture
def heard():
    """What the work of a test announces."""
    told = []
    with heard_by(told.append):
        yield told


def test_a_phase_inside_another_is_told_with_it(heard):
    with phase("finalists", 2) as finalists:
        for _ in each("joints", range(2), lambda joint: f"level {joint + 2}"):
            announce(Progress(phase="Newton steps", done=3))
        finalists.more()
    announce(Progress(phase="page"))
    assert [str(one) for one in heard] == [
        "finalists 0 of 2",
        "finalists 0 of 2, joints 0 of 2",
        "finalists 0 of 2, joints 0 of 2: level 2",
        "finalists 0 of 2, joints 0 of 2, Newton steps 3",
        "finalists 0 of 2, joints 1 of 2: level 3",
        "finalists 0 of 2, joints 1 of 2, Newton steps 3",
        "finalists 1 of 2",
        "page",
    ]
    assert [one.share for one in heard] == [0.0] * 6 + [0.5, None]


def test_no_count_passes_its_total_and_a_phase_that_fails_is_left(heard):
    with phase("maps", 3) as maps:
        maps.at(5)
    with pytest.raises(ZeroDivisionError), phase("maps", 3):
        [1 // number for number in each("walls", range(3))]
    announce(Progress(phase="rules"))
    assert heard[1].done == 3
    assert str(heard[-1]) == "rules"


def test_several_may_hear_and_without_one_work_is_the_same():
    first, second = [], []
    with heard_by(first.append):
        announce(Progress(phase="one"))
        with heard_by(second.append):
            announce(Progress(phase="two"))
        assert is_heard()
    assert list(each("things", "ab")) == ["a", "b"]
    assert not is_heard()
    assert ([one.phase for one in first], [one.phase for one in second]) == (
        ["one", "two"],
        ["two"],
    )


class Clock:
    """Seconds that pass when a test says so."""

    def __init__(self):
        self.now_s = 100.0

    def __call__(self):
        return self.now_s


@pytest.fixture
def clock():
    return Clock()


def test_the_time_left_is_that_of_the_phase_at_its_own_pace(clock):
    line = ProgressLine("run", clock)
    assert line.text() == "run (0 s)"
    clock.now_s += 5.0
    line.hear(Progress(phase="generations", done=50, total=100))  # of an earlier session
    clock.now_s += 60.0
    line.hear(Progress(phase="generations", done=75, total=100, words="best 0.5"))
    assert line.text() == "run: generations 75 of 100 (1 min 5 s, about 1 min 0 s left): best 0.5"
    clock.now_s += 20.0  # one that takes its time: the estimate goes on
    assert line.text() == "run: generations 75 of 100 (1 min 25 s, about 40 s left): best 0.5"
    clock.now_s += 60.0  # and never stands at no time left
    assert line.text() == "run: generations 75 of 100 (2 min 25 s): best 0.5"
    line.hear(Progress(phase="finalists", total=8))
    assert line.text() == "run: finalists 0 of 8 (2 min 25 s)"
    line.hear(Progress(phase="generations", done=1, total=100))  # it begins anew
    assert line.text() == "run: generations 1 of 100 (2 min 25 s)"


def test_a_phase_that_knows_its_time_left_is_believed(clock):
    line = ProgressLine("run", clock)
    line.hear(Progress(phase="generations", done=1, total=9, left_s=30.0))
    clock.now_s += 10.0
    assert line.text() == "run: generations 1 of 9 (10 s, about 20 s left)"


def lines_of(events, clock, until_s):
    """Return the times and texts of the lines that a pipe gets: events at times, in seconds."""
    written, begin_s, ahead = [], clock.now_s, list(events)
    line = ProgressLine("demo", clock)
    lines = ProgressLines(line, lambda text: written.append((clock.now_s - begin_s, text)))
    while clock.now_s < begin_s + until_s:
        while ahead and ahead[0][0] <= clock.now_s - begin_s:
            line.hear(ahead.pop(0)[1])
        lines.look()
        clock.now_s += 0.5
    return written


def test_no_line_of_a_pipe_stands_longer_than_ten_seconds_while_a_number_changes(clock):
    functions = [(float(at), Progress(phase="compiling", done=at // 20, total=3, left_s=60.0 - at))
                 for at in range(60)]  # fmt: skip
    maps = [(60.0, Progress(phase="maps", total=4)), (61.0, Progress(phase="walls", total=4))]
    generations = [
        (62.0 + at, Progress(phase="generations", done=at, total=40)) for at in range(40)
    ]
    written = lines_of([*functions, *maps, *generations], clock, 102.0)
    times = [at_s for at_s, _ in written]
    assert times[0] == 10.0
    assert max(later - at_s for at_s, later in pairwise(times)) <= 10.0
    assert len({text for _, text in written}) == len(written)
    assert written[0][1] == "demo: compiling 0 of 3 (10 s, about 50 s left)\n"
    # A phase that begins is a line at once, but not two within two seconds.
    assert [(at_s, text.split(" (")[0]) for at_s, text in written if at_s >= 59.0] == [
        (60.0, "demo: maps 0 of 4"),
        (62.0, "demo: generations 0 of 40"),
        (72.0, "demo: generations 10 of 40"),
        (82.0, "demo: generations 20 of 40"),
        (92.0, "demo: generations 30 of 40"),
    ]


def test_a_pipe_gets_nothing_early_and_little_where_nothing_changes(clock):
    assert lines_of([(0.0, Progress(phase="rules"))], clock, 9.9) == []
    standing = lines_of([(0.0, Progress(phase="rules"))], clock, 100.0)
    assert [at_s for at_s, _ in standing] == [10.0, 40.0, 70.0]
    assert lines_of([], clock, 100.0) == []


def test_lines_of_long_runs_become_rare(clock):
    counts = [(30.0 * at, Progress(phase="runs", done=at, total=10_000)) for at in range(1200)]
    times = [at_s for at_s, _ in lines_of(counts, clock, 36_000.0)]
    pauses = [later - at_s for at_s, later in pairwise(times)]
    assert max(pauses[:9]) <= 30.0
    assert pauses[-1] == 300.0


@pytest.fixture
def often(monkeypatch):
    """What is shown is shown within hundredths of a second."""
    for name in ("FIRST_S", "STEP_S", "PHASE_S", "LOOK_S", "SHOWN_AFTER_S"):
        monkeypatch.setattr(module, name, 0.01)


def wait_for(found):
    """Wait until something is there."""
    ends_s = time.monotonic() + 20.0
    while not found() and time.monotonic() < ends_s:
        time.sleep(0.01)
    assert found()


@pytest.mark.usefixtures("often")
def test_a_piped_command_writes_lines_until_it_ends(capsys):
    text = []

    def written():
        text.append(capsys.readouterr().err)
        return "1 of 4" in "".join(text)

    with Terminal().progress("working") as hear:
        hear(Progress(phase="maps", done=1, total=4))
        wait_for(written)
    assert "".join(text).startswith("working: maps 1 of 4 (0 s)\n")
    capsys.readouterr()  # a line may have come just before the end
    time.sleep(0.05)
    assert capsys.readouterr().err == ""


@pytest.mark.parametrize("quiet", [True, False])
def test_quiet_commands_and_quick_ones_write_no_line(capsys, quiet, monkeypatch):
    monkeypatch.setattr(module, "LOOK_S", 0.001)
    if quiet:
        monkeypatch.setattr(module, "FIRST_S", 0.001)
    with Terminal(quiet=quiet).progress("working") as hear:
        hear(Progress(phase="maps"))
        time.sleep(0.05)
    captured = capsys.readouterr()
    assert captured.out == captured.err == ""


@pytest.mark.usefixtures("often")
def test_nobody_reading_ends_nothing(monkeypatch):
    monkeypatch.setattr(module.sys, "stderr", None)
    with progress_in_lines("working") as hear:
        hear(Progress(phase="maps"))
        time.sleep(0.05)


class Screen(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self):
        return True


@pytest.mark.usefixtures("often")
@pytest.mark.parametrize("place", ["terminal", "notebook"])
def test_a_function_shows_one_line_to_who_watches_and_clears_it(place, monkeypatch):
    screen = Screen() if place == "terminal" else io.StringIO()
    monkeypatch.setattr(module.sys, "stderr" if place == "terminal" else "stdout", screen)
    if place == "notebook":
        monkeypatch.setattr(builtins, "get_ipython", object, raising=False)
    with progress_shown("aim") as hear:
        hear(Progress(phase="deployments", done=1, total=4))
        wait_for(lambda: "1 of 4" in screen.getvalue())
    text = screen.getvalue()
    assert "\raim: deployments 1 of 4 (0 s)" in text
    assert "\n" not in text
    assert text.endswith(" \r")


@pytest.mark.usefixtures("often")
def test_a_function_is_quiet_where_nobody_watches(monkeypatch, capsys):
    screen = io.StringIO()
    monkeypatch.setattr(module.sys, "stderr", screen)
    with progress_shown("aim") as hear:
        hear(Progress(phase="maps"))
        time.sleep(0.05)
    assert screen.getvalue() == capsys.readouterr().out == ""


def test_quick_functions_show_nothing(monkeypatch):
    screen = Screen()
    monkeypatch.setattr(module.sys, "stderr", screen)
    with progress_shown("aim") as hear:
        hear(Progress(phase="maps"))
    assert screen.getvalue() == ""


@pytest.mark.usefixtures("often")
def test_a_terminal_shows_phase_bar_and_time(monkeypatch):
    monkeypatch.setattr("vinefab.cli.commands.SHOWN_AFTER_S", 0.01)
    screen = Screen()
    monkeypatch.setattr("sys.stdout", screen)
    with Terminal().progress("report") as hear:
        hear(Progress(phase="rules", done=3, total=40, words="neighbours"))
        wait_for(lambda: "rules 3 of 40" in screen.getvalue())
        hear(Progress(phase="page"))
        wait_for(lambda: "report: page" in screen.getvalue())
    assert "neighbours" in screen.getvalue()


@pytest.mark.usefixtures("often")
def test_who_follows_sees_a_line_whenever_it_is_another():
    seen, done = [], threading.Event()

    def see(line):
        seen.append(line.what)
        done.set()

    with progress_seen(see) as hear:
        hear(Progress(phase="maps", total=2))
        assert done.wait(20.0)
        time.sleep(0.05)
    assert seen == ["maps 0 of 2"]


def test_a_function_of_the_users_hears_every_phase_of_a_verb():
    told = []
    vf.aim("plain_vine", vf.maps.grid(seed=1), deployments=5000, alone=True, progress=told.append)
    assert all(isinstance(one, Progress) for one in told)
    phases = [one.chain[-1].phase for one in told]
    assert "trial deployments" in phases
    assert str(told[0]) == "robots 0 of 1"


@pytest.mark.parametrize(("value", "refused"), [("yes", True), (3, True), (False, False)])
def test_progress_is_true_false_or_a_function(value, refused):
    with pytest.raises(vf.BadInputError, match="progress is") if refused else nullcontext():
        vf.aim("plain_vine", vf.maps.grid(seed=1), deployments=5000, alone=True, progress=value)


def test_code_that_is_compiled_is_shown_until_it_is_there_in_whatever_thread(clock):
    line = ProgressLine("report", clock)
    told = []
    with heard_by(line.hear), heard_by(told.append):
        announce(Progress(phase="walls of maps", done=3, total=20))
        compiled = Progress(phase=COMPILING, done=1, total=2, left_s=8.0)
        other = threading.Thread(target=announce_to_all, args=(compiled,))
        other.start()
        other.join()
        announce(Progress(phase="walls of maps", done=4, total=20))
        clock.now_s += 3.0
        shown = line.text()
        announce_to_all(Progress(phase=COMPILING, done=2, total=2))
    words = "report: compiling once on this computer, functions 1 of 2 (3 s, about 5 s left)"
    assert shown == words
    assert line.text() == "report: walls of maps 4 of 20 (3 s)"
    assert [one.done for one in told] == [3, 1, 4, 2]
