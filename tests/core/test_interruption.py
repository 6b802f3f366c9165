"""Ctrl-C, SIGTERM and SIGHUP end code alike; what is ignored stays ignored."""

import importlib
import os
import signal
import subprocess
import sys
import threading

import pytest

from vinefab.core import interruption
from vinefab.core.interruption import (
    REQUESTS,
    STOP_WITH_INPUT,
    stop_requests,
    stops_deferred,
)


@pytest.mark.parametrize("number", REQUESTS)
def test_each_request_is_a_keyboard_interrupt_and_gives_its_exit_code(number):
    usual = signal.getsignal(number)
    with pytest.raises(KeyboardInterrupt), stop_requests() as request:
        signal.raise_signal(number)
    assert request.exit_code == 128 + number
    assert signal.getsignal(number) is usual


def test_a_request_that_the_caller_ignores_stays_ignored():
    usual = signal.signal(signal.SIGHUP, signal.SIG_IGN)
    try:
        with stop_requests() as request:
            signal.raise_signal(signal.SIGHUP)
        assert request.number == 0
    finally:
        signal.signal(signal.SIGHUP, usual)


@pytest.mark.parametrize("number", REQUESTS)
def test_a_deferred_request_is_raised_after_the_block(number):
    done = []

    def deferred():
        with stops_deferred():
            os.kill(os.getpid(), number)
            done.append("rest of the block")
            raise OSError("a process got the request too")

    with stop_requests() as request:
        with pytest.raises(KeyboardInterrupt):
            deferred()
        assert request.number == number
    assert done
    assert not signal.pthread_sigmask(signal.SIG_BLOCK, ())


def test_a_request_that_no_exception_could_report_comes_again():
    class Swallowing:
        def __del__(self):
            signal.raise_signal(signal.SIGTERM)

    def swallowed():
        Swallowing()
        threading.Event().wait(5.0)

    with stop_requests() as request, pytest.raises(KeyboardInterrupt):
        swallowed()
    assert request.exit_code == 143


def test_another_thread_than_the_main_one_is_left_alone():
    failed = []

    def work():
        try:
            with stop_requests(), stops_deferred():
                pass
        except ValueError as error:
            failed.append(error)

    thread = threading.Thread(target=work)
    thread.start()
    thread.join()
    assert not failed


HELD = """
import time
from vinefab.core.interruption import stop_requests, stop_with_input
with stop_requests() as request:
    stop_with_input()
    try:
        print("ready", flush=True)
        time.sleep(60)
    except KeyboardInterrupt:
        print("stopped", request.exit_code)
"""


@pytest.mark.parametrize("how", ["closed", "written to"])
def test_a_command_stops_when_whoever_began_it_is_gone(how):
    environment = {**os.environ, STOP_WITH_INPUT: "1"}
    with subprocess.Popen(
        [sys.executable, "-c", HELD],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        env=environment,
        text=True,
    ) as command:
        assert command.stdout.readline() == "ready\n"
        if how == "closed":
            command.stdin.close()
        else:
            os.write(command.stdin.fileno(), b"\n")
        assert command.stdout.readline() == "stopped 130\n"
        assert command.wait(30) == 0


@pytest.mark.parametrize("number", REQUESTS)
def test_a_request_waits_until_a_module_is_loaded(number, tmp_path, monkeypatch):
    # Compiled modules such as numpy's print a traceback of what interrupts them on the way.
    module = f"loaded_when_{number}"
    text = f"import signal, time\nsignal.raise_signal({int(number)})\ntime.sleep(0.12)\nend = 1\n"
    (tmp_path / f"{module}.py").write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))

    def load_then_wait():
        importlib.import_module(module)
        threading.Event().wait(5.0)

    with stop_requests() as request, pytest.raises(KeyboardInterrupt):
        load_then_wait()
    assert request.exit_code == 128 + number
    assert sys.modules.pop(module).end == 1


def test_a_module_that_never_ends_loading_is_interrupted(tmp_path, monkeypatch):
    monkeypatch.setattr(interruption, "_LOADING_S", 0.1)
    text = "import signal, time\nsignal.raise_signal(signal.SIGINT)\ntime.sleep(20.0)\n"
    (tmp_path / "never_loaded.py").write_text(text)
    monkeypatch.syspath_prepend(str(tmp_path))
    with stop_requests(), pytest.raises(KeyboardInterrupt):
        importlib.import_module("never_loaded")
