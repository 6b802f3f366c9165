"""The last net of the command line: what nobody foresaw is one line, a log and exit code 3."""

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

import vinefab
from vinefab.cli.common_options import CommandOutput
from vinefab.cli.main import main

SOURCES = Path(vinefab.__file__).parent


def test_an_unforeseen_error_is_one_line_and_a_log(monkeypatch, capsys, tmp_path):
    def broken(*_: object) -> None:
        raise ZeroDivisionError("a secret of the inside")

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    monkeypatch.setattr("vinefab.cli.profiles.profile_list", broken)
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


def test_a_log_that_cannot_be_written_is_said(monkeypatch, capsys, tmp_path):
    def broken(*_: object) -> None:
        raise RecursionError

    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "missing"))
    monkeypatch.setattr("vinefab.cli.profiles.profile_list", broken)
    assert main(["profiles"]) == 3
    assert "no log could be written" in capsys.readouterr().err


def test_there_is_no_other_net():
    nets = re.compile(r"except\s*:|except\s+\(?[^:]*\bException\b")
    found = [
        path.relative_to(SOURCES).as_posix()
        for path in SOURCES.rglob("*.py")
        for line in path.read_text(encoding="utf-8").splitlines()
        if nets.search(line)
    ]
    assert found == ["cli/main.py"]


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


def test_what_an_earlier_version_moved_aside_is_named_and_kept(tmp_path, capsys):
    aside = tmp_path / ".coupons.old.abc"
    aside.mkdir()
    (aside / "notes.txt").write_text("mine")
    CommandOutput().ensure_folder(tmp_path / "coupons", "coupon.json")
    assert f"note: {aside} has files of" in capsys.readouterr().out
    assert (aside / "notes.txt").read_text() == "mine"
