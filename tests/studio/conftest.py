"""The studio as a user starts it, and a real browser in front of it."""

import json
import os
import re
import shutil
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

import vinefab as vf
from vinefab.core.interruption import STOP_WITH_INPUT
from vinefab.model.design import design_of

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


TWIG = """# Two arms, to be dragged.
schema = "vinefab/design-1"
name = "twig"

[trunk]
length = 90.0              # up to the fork

[[level]]
branches = 2
length = 70.0              # of both arms
angle_deg = 100.0
growth_percent = 100.0

[build]
widths_mm = [24.0, 14.0]
fillet_mm = [4.0]
tail_mm = 200.0
pressure_kpa = 20.0
"""

PATIENCE_S = 120.0
"""Tests wait for a state of page or server, not for a time: the cap is for busy computers."""


STILL = """async (selector) => {
  for (let [last, same] = ["", 0]; ; ) {
    await new Promise(requestAnimationFrame);
    const box = document.querySelector(selector)?.getBoundingClientRect();
    const now = JSON.stringify(box ?? "");
    same = box && now === last ? same + 1 : 0;
    last = now;
    if (same === 2) return box.toJSON();
  }
}"""
"""The box of an element, once it is the same in painted frames that follow each other."""

IS_UNDER = """([selector, x, y]) => {
  const isIn = (node) => Boolean(node?.closest(selector));
  const isUnder = isIn(document.elementFromPoint(x, y));
  const note = (event) => { globalThis.isGrasped = isIn(event.target); };
  if (isUnder) addEventListener("pointerdown", note, {capture: true, once: true});
  return isUnder;
}"""
"""Whether the pointer would press an element; the page then notes whether it did."""


class TabSession:
    """A page, and what went wrong in it."""

    def __init__(self, page):
        self.page = page
        page.set_default_timeout(1000 * PATIENCE_S)
        self.problems = []
        page.on("pageerror", lambda error: self.problems.append(str(error)))
        page.on("console", self._heard)
        page.on("dialog", lambda dialog: dialog.accept())
        page.on("request", self._asked)
        page.add_init_script(
            "addEventListener('securitypolicyviolation', (event) =>"
            " console.error('CSP', event.violatedDirective, event.blockedURI))"
        )

    def _heard(self, message):
        if message.type in ("error", "warning"):
            self.problems.append(message.text)

    def _asked(self, request):
        is_file = self.page.url.startswith("file:")
        near = ("file:", "data:") if is_file else ("http://127.0.0.1:", "file:", "data:", "blob:")
        if not request.url.startswith(near):
            self.problems.append(f"asks the network: {request.url}")

    def open(self, address):
        self.page.goto(address)
        self.page.wait_for_selector("#scores .score")
        return self

    def box(self, selector):
        """Return the box of an element that stands still: answers that come move the panels."""
        return self.page.evaluate(STILL, selector)

    def middle(self, selector):
        box = self.box(selector)
        return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2

    def grasp(self, selector):
        """Press on an element, tried again if it moved away meanwhile; return the place."""
        end, mouse = time.monotonic() + PATIENCE_S, self.page.mouse
        while True:
            place = self.middle(selector)
            mouse.move(*place)
            if self.page.evaluate(IS_UNDER, [selector, *place]):
                mouse.down()
                if self.page.evaluate("isGrasped"):
                    return place
                mouse.up()
            assert time.monotonic() < end, f"{selector} is covered"

    def drag(self, selector, by, steps=5, *, drop=True):
        """Press on an element, move by some pixels, release; return where it was pressed."""
        x, y = self.grasp(selector)
        self.page.mouse.move(x + by[0], y + by[1], steps=steps)
        if drop:
            self.page.mouse.up()
        return x, y

    def state(self):
        return self.page.evaluate("studio.store.get()")

    def design(self):
        return design_of(self.state()["design"], "the page")

    def set(self, key, value):
        """Type an exact number."""
        number = self.page.locator(f'input[type=number][data-key="{key}"]')
        number.fill(str(value))
        number.press("Enter")
        return number

    def until(self, script, value=None):
        """Wait until a function of the page gives true; Playwright's own wait needs `eval`."""
        self.soon(True, lambda: bool(self.page.evaluate(script, value)), script)  # noqa: FBT003

    def soon(self, wanted, found, about=""):
        """Wait until something is so."""
        end = time.monotonic() + PATIENCE_S
        while (now := found()) != wanted:
            line = self.page.text_content("#status")
            assert time.monotonic() < end, (about, now, wanted, line, self.problems)
            self.page.wait_for_timeout(50)

    def rest(self):
        """Wait until every panel has answered, so that nothing moves any more."""
        self.until(
            """() => document.querySelector("#sheet").ariaBusy === "false" && studio.answers.cut
              && studio.answers.live.engine === "kernel" && studio.answers.width
              && !document.querySelector(".width.stale:not([hidden]), .scores.stale")"""
        )
        self.painted()

    def painted(self):
        """Wait until what has been answered is drawn."""
        self.page.evaluate(
            "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
        )

    def robot(self):
        """Return the paths of the robot on the map, by branch."""
        return self.page.evaluate(
            """Object.fromEntries([...document.querySelectorAll(".robot-layer path[data-branch]")]
              .map((path) => [path.dataset.branch, path.getAttribute("d")]))"""
        )

    def score(self, task="coverage"):
        return float(self.page.inner_text(f'.score[data-task="{task}"] .value'))

    def shown(self):
        """Return the name of the open file, and what stands beside it."""
        mark = self.page.text_content(".file-mark").removeprefix("● ")
        return self.page.text_content(".file-name"), mark


@pytest.fixture(scope="session")
def studio(tmp_path_factory, start_studio):
    """One server, in a folder with a design and a map of its own."""
    folder = tmp_path_factory.mktemp("studio")
    (folder / "twig.toml").write_text(TWIG)
    vf.maps.grid(2, columns=3, rows=3, size_mm=300).write(folder / "grid.geojson")
    with start_studio(folder, "twig.toml", "--map", "grid.geojson") as started:
        yield started
        assert "Traceback" not in started.said()


@pytest.fixture
def twig(studio):
    """The file that the command names, as it was; nothing unsaved is left of other tests."""
    shutil.rmtree(studio.folder / "profiles", ignore_errors=True)
    path = studio.folder / "twig.toml"
    path.write_text(TWIG)
    return path


FORGET = """async () => {
  const {request} = globalThis.studio ?? {};
  if (!request) return;
  studio.request = async () => ({});
  studio.remember = () => {};
  await request("autosaves").catch(() => {});
}"""
"""Let a tab keep no unsaved work any more: the next test would be offered it."""


WINDOW = {"width": 1280, "height": 900}


@pytest.fixture(scope="module")
def open_context(browser):
    """Return a function that opens a context: what pages of one user share."""
    contexts = []

    def opened():
        contexts.append(
            browser.new_context(viewport=WINDOW, locale="de-DE", reduced_motion="reduce")
        )
        return contexts[-1]

    yield opened
    for context in contexts:
        context.close()


@pytest.fixture
def open_tab(studio, twig, open_context):  # noqa: ARG001  a fresh file
    """Return a function that opens a tab, in a context of its own where none is given.

    Problems in it fail the test.
    """
    tabs = []

    def opened(address=None, context=None):
        tabs.append(TabSession((context or open_context()).new_page()))
        return tabs[-1].open(address or studio.address)

    yield opened
    for tab in tabs:
        if not tab.page.is_closed():
            tab.page.evaluate(FORGET)
            tab.page.close()
    assert [problem for tab in tabs for problem in tab.problems] == []


@pytest.fixture(scope="module")
def module_tab(open_context):
    return TabSession(open_context().new_page())


@pytest.fixture
def tab(studio, twig, module_tab):  # noqa: ARG001  a fresh file
    """The tab of all tests of a module, with the studio opened anew."""
    module_tab.page.set_viewport_size(WINDOW)
    yield module_tab.open(studio.address)
    module_tab.page.mouse.up()
    module_tab.page.mouse.move(0, 0)
    module_tab.page.evaluate(FORGET)
    module_tab.page.evaluate("sessionStorage.clear()")
    module_tab.page.goto("about:blank")
    problems = module_tab.problems[:]
    module_tab.problems.clear()
    assert problems == []


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
