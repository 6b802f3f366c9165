"""A reader of a foreign file ends within its time and memory, and its process with ours."""

import os
import re
import signal
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from vinefab.core import bounded as limits
from vinefab.core.bounded import bounded
from vinefab.core.errors import BadInputError, UnreadableFileError
from vinefab.core.limits import number

LINUX = pytest.mark.skipif(sys.platform != "linux", reason="limits of the system")
ADVICE = "save only what is a wall, with fewer points and copies"


def refusal(path, why=""):
    """Return the whole sentence, as a pattern."""
    return "^" + re.escape(f"{path}: cannot be read within 1 s and 1.5 GiB{why}: {ADVICE}") + "$"


@pytest.fixture
def path(tmp_path, monkeypatch):
    monkeypatch.setattr(limits, "_CPU_S", 1)
    path = tmp_path / "plan.svg"
    path.write_text("x")
    return path


@LINUX
@pytest.mark.parametrize(
    ("code", "why"),
    [
        ("while True: pass", ""),
        ("held = []\nwhile True: held.append(bytes(1 << 20))", ""),
        ("bytes(2 << 30)", ""),
        ("import os; os.kill(os.getpid(), 9)", ""),
        ("import os; os.abort()", " (its reader ends with code -6)"),
    ],
)
def test_a_reader_without_end_is_a_refusal(path, code, why):
    begin = time.process_time()
    with pytest.raises(UnreadableFileError, match=refusal(path, why)):
        bounded(path, exec, code)
    assert time.process_time() - begin < 1.0


@LINUX
def test_processor_time_ends_a_reader_before_the_clock_does(path, monkeypatch):
    monkeypatch.setattr(limits, "_WALL_S_PER_CPU_S", 600)
    code = "import time; end = time.process_time() + 3.0\nwhile time.process_time() < end: pass"
    with pytest.raises(UnreadableFileError, match=refusal(path)):
        bounded(path, exec, code)


def test_a_reader_that_waits_is_a_refusal(path, monkeypatch):
    monkeypatch.setattr(limits, "_WALL_S_PER_CPU_S", 0.5)
    with pytest.raises(UnreadableFileError, match=refusal(path)):
        bounded(path, time.sleep, 99.0)


@LINUX
def test_every_file_has_its_own_time_and_a_larger_one_more(path, monkeypatch):
    code = "import time; end = time.process_time() + 0.8\nwhile time.process_time() < end: pass"
    for _ in range(2):
        bounded(path, exec, code)
    monkeypatch.setattr(limits, "_CPU_S_PER_MB", 1)
    monkeypatch.setattr(limits, "_CPU_S", -2)
    path.write_bytes(bytes(3_000_000))
    with pytest.raises(UnreadableFileError, match="within 1 s"):
        bounded(path, exec, "while True: pass")


def test_results_and_errors_come_back_from_one_process(tmp_path, monkeypatch):
    first = bounded(tmp_path, os.getpid)
    with pytest.raises(BadInputError, match=r"line 3 is 5.0; allowed: 0 to 1") as caught:
        bounded(tmp_path, number, "line 3", 5.0, 0.0, 1.0)
    assert caught.value.key == "line 3"
    monkeypatch.chdir(tmp_path)
    assert bounded(tmp_path, os.getcwd) == str(tmp_path)
    facts = "__import__('vinefab.core.frozen').core.frozen.FrozenMapping({'read': 3})"
    assert bounded(tmp_path, eval, facts) == {"read": 3}
    assert bounded(tmp_path, os.getpid) == first != os.getpid()
    with pytest.raises(ZeroDivisionError) as unforeseen:
        bounded(tmp_path, divmod, 1, 0)
    assert "bounded.py" in unforeseen.value.__notes__[0]
    assert bounded(tmp_path, print, "in the way of answers") is None


def test_a_process_that_is_begun_early_has_loaded_its_reader(tmp_path):
    limits.end_children()
    limits.begin_reader("vinefab.core.rng")
    loaded = "'vinefab.core.rng' in __import__('sys').modules"
    assert bounded(tmp_path, eval, loaded)


def test_threads_read_at_once(tmp_path):
    found = []
    threads = [
        threading.Thread(target=lambda: found.append(bounded(tmp_path, time.sleep, 0.5)))
        for _ in range(2)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert found == [None, None]


SCRIPT = """
import os, sys, threading, time
from pathlib import Path
from vinefab.core.bounded import bounded
print(bounded(Path("."), os.getpid), flush=True)
{then}
"""


def run(then, *arguments, **options):
    program = [sys.executable, *(arguments or ("-c", SCRIPT.format(then=then)))]
    return subprocess.Popen(program, stdout=subprocess.PIPE, text=True, **options)


def ended(pid):
    for _ in range(100):
        if not Path(f"/proc/{pid}").exists():
            return True
        time.sleep(0.05)
    return False


@LINUX
@pytest.mark.parametrize(
    ("then", "by"),
    [
        ("", None),
        ("bounded(Path('.'), time.sleep, 99)", signal.SIGKILL),
        pytest.param(
            "bounded(Path('.'), exec, 'while True: pass')",
            signal.SIGKILL,
            marks=pytest.mark.thorough,
        ),
        ("bounded(Path('.'), time.sleep, 99)", signal.SIGINT),
    ],
)
def test_the_process_ends_with_ours(then, by):
    with run(then, stderr=subprocess.DEVNULL) as process:
        child = int(process.stdout.readline())
        if by is not None:
            time.sleep(0.3)
            process.send_signal(by)
        assert process.wait(5) == (0 if by is None else -by)
    assert ended(child)


def test_scripts_without_a_guard_daemons_and_standard_input(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(SCRIPT.format(then="print('once')"))
    with run("", str(script)) as process:
        assert process.stdout.read().split()[1:] == ["once"]
    with run("", "-", stdin=subprocess.PIPE) as process:
        assert process.communicate(script.read_text())[0].split()[1:] == ["once"]
    daemon = (
        "import multiprocessing\n"
        "process = multiprocessing.get_context('fork').Process(\n"
        "    target=lambda: print(bounded(Path('.'), max, 1, 2), flush=True), daemon=True)\n"
        "process.start()\nprocess.join()"
    )
    with run(daemon) as process:
        assert process.stdout.read().split()[1:] == ["2"]
