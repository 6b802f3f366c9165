"""The studio as a user starts it, and a real browser in front of it."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterable
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, urlsplit

import pytest

from vinefab.core.interruption import STOP_WITH_INPUT

FIRST_LINE_S = 60.0
END_S = 10.0


def command_line(pid):
    """Return the command line of a process; nothing of one that has ended."""
    with suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_text()
    return ""


class RunningStudio:
    """A process of `vinefab studio`, with everything that it has started."""

    def __init__(self, arguments, folder, extra=()):
        environment = {
            **os.environ,
            "HOME": str(folder),
            "XDG_CONFIG_HOME": str(folder / "config"),
            "XDG_STATE_HOME": str(folder / "state"),
            "XDG_CACHE_HOME": str(folder / "cache"),
            "VINEFAB_PROFILES": str(folder / "profiles"),
            # It ends with the tests, however they end: its input does.
            STOP_WITH_INPUT: "1",
            **dict(extra),
        }
        self.folder = folder
        self.complaints = folder / "complaints.txt"
        browser = [] if "--browser" in arguments else ["--no-browser"]
        with self.complaints.open("ab") as complaints:
            # A session of its own: whatever the server leaves behind is ended with it.
            self.process = subprocess.Popen(
                [sys.executable, "-m", "vinefab", "studio", *browser, *map(str, arguments)],
                cwd=folder,
                env=environment,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=complaints,
                text=True,
                start_new_session=True,
            )
        self.line = self.process.stdout.readline()
        found = re.search(r"http://\S+", self.line)
        if found is None:
            self.end()
            pytest.fail(f"no address: {self.line!r} {self.complaints.read_text()!r}")
        self.address = found.group()
        parts = urlsplit(self.address)
        self.host, self.port = parts.netloc, parts.port
        self.token = parse_qs(parts.query)["token"][0]

    @property
    def origin(self):
        """What the server's own page names as its origin."""
        return f"http://{self.host}"

    def said(self):
        """Return what the server has complained of."""
        return self.complaints.read_text(encoding="utf-8")

    def family(self, running=""):
        """Return the processes that the server has started and that still run.

        ``running``: what stands in their command lines.
        """
        found = []
        for status in Path("/proc").glob("[0-9]*/stat"):
            with suppress(OSError):
                fields = status.read_text().rpartition(")")[2].split()
                if int(fields[3]) == self.process.pid and fields[0] != "Z":
                    found.append(int(status.parent.name))
        others = [pid for pid in found if pid != self.process.pid]
        return [pid for pid in others if running in command_line(pid)]

    def left(self, patience_s=1.0):
        """Return the command lines of what the server has left running."""
        until = time.monotonic() + patience_s
        while self.family() and time.monotonic() < until:
            time.sleep(0.05)
        return [command_line(pid) for pid in self.family()]

    def memory_mb(self):
        """Return the memory that the server holds, without its children."""
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(re.search(r"VmRSS:\s+(\d+)", status).group(1)) / 1024

    def interrupt(self, signal_number=signal.SIGINT, within_s=END_S):
        """Press Ctrl-C and return the exit code."""
        self.process.send_signal(signal_number)
        return self.process.wait(within_s)

    def end(self):
        """End the server and everything that it started, however it stands."""
        with suppress(ProcessLookupError):
            self.process.send_signal(signal.SIGINT)
        with suppress(subprocess.TimeoutExpired):
            self.process.wait(END_S)
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self.process.pid, signal.SIGKILL)
        self.process.wait()
        self.process.stdin.close()
        self.process.stdout.close()


@contextmanager
def running_studio(folder, *arguments, extra=()):
    """Run a studio in a folder; it is ended in any case."""
    studio = RunningStudio(arguments, folder, extra)
    try:
        yield studio
    finally:
        studio.end()


@pytest.fixture(scope="session")
def start_studio():
    """Return the context manager that runs a studio."""
    return running_studio


def chromium_path():
    """Return where Debian's browser is; missing, skip, or fail where CI must have it."""
    import shutil  # noqa: PLC0415

    found = shutil.which("chromium") or shutil.which("chromium-browser")
    if found is None and os.environ.get("CI") == "true":
        pytest.fail("chromium is missing; install chromium")
    if found is None:
        pytest.skip("chromium is not installed (Debian package chromium)")
    return found


@pytest.fixture(scope="module")
def browser():
    """One browser for a module; Playwright's loop must not outlive it."""
    path = chromium_path()
    from playwright.sync_api import sync_playwright  # noqa: PLC0415  only where there is a browser

    with sync_playwright() as playwright:
        # Root and containers have no sandbox for it.
        opened = playwright.chromium.launch(
            executable_path=path, args=["--no-sandbox", "--disable-gpu"], timeout=60_000
        )
        try:
            yield opened
        finally:
            opened.close()


PAGE = Path(__file__).parent / "page"


@pytest.fixture
def page_types(program, tmp_path):
    """Return a check of values, each with its name, against the types of the page."""
    program("npm", "npm")
    compiler = PAGE / "node_modules" / ".bin" / "tsc"

    def check(values: Iterable[tuple[str, Any]]) -> None:
        lines = [
            f"export const a{number}: {kind} = {json.dumps(value, allow_nan=False)};"
            for number, (kind, value) in enumerate(values)
        ]
        (tmp_path / "answers.ts").write_text("\n".join(lines), encoding="utf-8")
        include = [str(PAGE / "*.d.ts"), "answers.ts"]
        project = {"extends": str(PAGE / "tsconfig.json"), "include": include}
        (tmp_path / "tsconfig.json").write_text(json.dumps(project), encoding="utf-8")
        assert compiler.exists(), "`make page` installs the compiler"
        done = subprocess.run(
            [compiler, "-p", tmp_path], capture_output=True, text=True, check=False
        )
        assert done.returncode == 0, done.stdout

    return check
