"""The last net of the command line: what nobody foresaw is one line, a log and exit code 3."""

import contextlib
import logging
import os
import re
import shlex
import signal
import subprocess
import sys
import warnings
from pathlib import Path

import pytest

import vinefab
import vinefab.cli.main as main_module
from vinefab.cli.main import main, run
from vinefab.core import interruption

SOURCES = Path(vinefab.__file__).parent


def test_an_unforeseen_error_is_one_line_and_a_log(monkeypatch, capsys, tmp_path):
    def broken(*_: object) -> None:
        raise ZeroDivisionError("a secret of the inside")

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr("vinefab.fabrication.profile_listing.ProfileListing", broken)
    assert main(["profiles"]) == 3
    printed = capsys.readouterr()
    assert printed.out == ""
    (line,) = printed.err.splitlines()
    assert "fault of vinefab" in line
    assert "ZeroDivisionError" in line
    (log,) = tmp_path.glob("vinefab-error-*.log")
    assert str(log) in line
    text = log.read_text()
    assert "a secret of the inside" in text
    assert "vinefab profiles" in text
    assert vinefab.__version__ in text


def test_the_log_holds_arguments_that_are_no_text(monkeypatch, capsys, tmp_path):
    def broken(*_: object) -> None:
        raise ZeroDivisionError

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr("vinefab.fabrication.profile_listing.ProfileListing", broken)
    assert main(["profiles", "--json", "\udcff.json"]) == 3
    assert "fault of vinefab" in capsys.readouterr().err
    (log,) = tmp_path.glob("vinefab-error-*.log")
    assert "\\udcff.json" in log.read_text()


def test_letters_that_a_terminal_cannot_show_are_escaped(tmp_path):
    path = tmp_path / "\udcff.geojson"
    done = subprocess.run(
        [sys.executable, "-m", "vinefab", "map", "grid", "--out", path],
        env=os.environ | {"PYTHONIOENCODING": "ascii:strict"},
        capture_output=True,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"\\xff.geojson" in done.stdout
    assert path.is_file()


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no locale C")
@pytest.mark.parametrize(
    ("words", "code"),
    [
        (("new", "design", "{}.toml"), 0),
        (("new", "map", "{}.geojson"), 0),
        (("new", "recipe", "{}.toml"), 2),
        (("check", "{}.toml"), 2),
        (("check", "{}"), 2),
        (("check", "three_level_tree", "--out", "{}/c"), 2),
        (("score", "three_level_tree", "--environment", "{}"), 2),
        (("{}",), 2),
    ],
)
def test_names_with_umlauts_work_in_the_locale_c(tmp_path, words, code):
    name = "r\N{LATIN SMALL LETTER O WITH DIAERESIS}hre"
    done = subprocess.run(
        [sys.executable, "-m", "vinefab", *(os.fsencode(word.format(name)) for word in words)],
        env=os.environ | {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
        capture_output=True,
        check=False,
        cwd=tmp_path,
    )
    assert done.returncode == code, done.stderr
    assert rb"r\xf6hre" in (done.stderr if code else done.stdout)  # one letter, not two halves
    assert [path.stem for path in tmp_path.iterdir()] == ([] if code else [name])


def test_a_log_that_cannot_be_written_is_said(monkeypatch, capsys, tmp_path):
    def broken(*_: object) -> None:
        raise RecursionError

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "missing"))
    monkeypatch.setattr("vinefab.fabrication.profile_listing.ProfileListing", broken)
    assert main(["profiles"]) == 3
    assert "no log could be written" in capsys.readouterr().err


@pytest.mark.parametrize(
    "error", [MemoryError(), ImportError("lib.so: failed to map segment from shared object")]
)
def test_want_of_memory_is_no_fault(monkeypatch, capsys, error):
    def greedy(*_: object) -> None:
        raise error

    monkeypatch.setattr("vinefab.fabrication.profile_listing.ProfileListing", greedy)
    assert main(["profiles"]) == 2
    assert "not enough memory" in capsys.readouterr().err


@pytest.mark.skipif(os.name != "posix", reason="exit codes that tell a signal")
@pytest.mark.parametrize(("name", "code"), [("SIGINT", 130), ("SIGTERM", 143), ("SIGHUP", 129)])
def test_a_signal_while_a_dataclass_is_made_gives_its_own_exit_code(name, code, tmp_path):
    program = (
        "from vinefab.cli import main as program\n"
        "def interrupted(_):\n"
        f"    exec('import signal; signal.raise_signal(signal.{name})')\n"
        "program.dispatch = interrupted\n"
        "program.run()\n"
    )
    (tmp_path / "interrupted_program.py").write_text(program)
    search = os.pathsep.join([str(tmp_path), str(SOURCES.parent)])
    ended = subprocess.run(
        [sys.executable, "-m", "interrupted_program"],
        env=os.environ | {"PYTHONPATH": search},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (ended.returncode, ended.stderr.count("\n")) == (code, 1)


def test_a_request_to_end_while_an_error_is_printed_is_one_line(monkeypatch, capsys):
    shown = main_module._print_error

    def interrupted(message: str, code: int) -> int:
        if message != main_module.INTERRUPTED:
            raise KeyboardInterrupt
        return shown(message, code)

    monkeypatch.setattr(main_module, "_print_error", interrupted)
    assert main(["check", "missing.toml"]) == 130
    assert capsys.readouterr().err == f"error: {main_module.INTERRUPTED}\n"


def test_there_is_no_other_net():
    nets = re.compile(r"except\s*:|except\s+\(?[^:]*\bException\b")
    found = [
        path.relative_to(SOURCES).as_posix()
        for path in SOURCES.rglob("*.py")
        for line in path.read_text(encoding="utf-8").splitlines()
        if nets.search(line)
    ]
    assert found == ["cli/main.py"]


def test_warnings_of_packages_are_shown_to_developers_alone(monkeypatch, capsys):
    def noisy(_: object) -> int:
        warnings.warn("overflow encountered in exp", RuntimeWarning, stacklevel=1)
        logging.getLogger("matplotlib.font_manager").warning("findfont: not found")
        return 0

    monkeypatch.setattr("vinefab.cli.main.main", noisy)
    monkeypatch.setattr("sys.warnoptions", [])
    with pytest.raises(SystemExit):
        run()
    assert capsys.readouterr().err == ""
    monkeypatch.setattr("sys.warnoptions", ["error"])
    with pytest.raises(RuntimeWarning, match="overflow"):
        run()


@pytest.mark.parametrize(
    ("redirection", "code"),
    [
        ("profiles >&-", 0),
        ("profiles >/dev/full", 2),
        ("profiles <&- >/dev/null", 0),
        ("profiles nothing 2>/dev/full", 2),
        ("profiles nothing >&- 2>&-", 2),
    ],
)
def test_closed_and_full_outputs_are_no_fault(redirection, code):
    script = f"{shlex.quote(sys.executable)} -m vinefab {redirection}"
    ended = subprocess.run(["sh", "-c", script], capture_output=True, text=True, check=False)
    assert (ended.returncode, "fault" in ended.stderr) == (code, False), ended.stderr


def test_a_reader_that_closes_the_pipe_is_told_by_the_exit_code():
    reading, writing = os.pipe()
    os.close(reading)
    command = [sys.executable, "-m", "vinefab", "profiles"]
    ended = subprocess.run(command, stdout=writing, stderr=subprocess.PIPE, check=False)
    os.close(writing)
    assert (ended.returncode, ended.stderr) == (141, b"")


@pytest.mark.skipif(os.name != "posix", reason="signals that tell of a closed terminal")
def test_a_closed_terminal_is_one_line_at_every_moment_of_the_program(capsys):
    """SIGHUP at each line of the program and its handling of signals, first to last."""
    codes, line = [], 0
    while not codes or codes[-1] is not None:
        codes.append(_code_when_hung_up_at(line))
        line += 1
    assert set(codes) == {129, 0, None}  # 0: all was done
    assert codes.index(0) > 20
    assert "Traceback" not in capsys.readouterr().err


def _code_when_hung_up_at(line: int) -> int | None:
    """Return the exit code of a program that a signal meets, None if it has too few lines."""
    left, places = line, (main_module.__file__, interruption.__file__, contextlib.__file__)

    def count(frame, event, _):
        nonlocal left
        if frame.f_code.co_filename not in places:
            return None
        if event == "line" and signal.getsignal(signal.SIGHUP) is not signal.SIG_DFL:
            left -= 1
            if left == -1:
                signal.raise_signal(signal.SIGHUP)
        return count

    usual = sys.gettrace()
    sys.settrace(count)
    try:
        code = main(["--version"])
    except KeyboardInterrupt:  # would be a traceback
        code = 1
    finally:
        sys.settrace(usual)
        signal.signal(signal.SIGHUP, signal.SIG_DFL)
    return code if left < 0 else None
