"""Every line that a page or a help tells a user to type, typed in order in an empty folder.

The wheel is built and installed into an empty environment, without the network: what it depends on
comes from the environment of the tests. Lines go through a shell, as users type them; Python goes
into the interpreter of that environment, in its place between them.
"""

import os
import re
import signal
import site
import subprocess
import sys
import time
import venv
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from written_lines import (
    FENCE,
    PAGES,
    ROOT,
    WrittenLine,
    help_examples,
    languages_of,
    written_on,
)

TUTORIALS = ROOT / "docs" / "tutorials"
ONE_AFTER_THE_OTHER = {"arena_and_rig": ("my_arena", "rig_and_reality")}
"""Tutorials that go on in the folder of the one before; every other page begins in an empty one."""

IN_A_CHECKOUT = ("knee", "pieces", "testing")
"""Pages whose lines are programs of the project itself; they say so above their lines."""

STAYS_OPEN = re.compile(r"vinefab studio\b(?!.*--snapshot\b)")
"""Commands that end with Ctrl-C."""

COMPLAINT = re.compile(r"^(error: |bash: |Traceback )", re.M)
"""What a line in a loop or in the background prints when it fails, whatever the exit code."""

HELPS = "helps"
LEAST_LINES = 140
MOST_LEFT_OUT = 25
PATIENCE_S = 900.0


def stories() -> dict[str, list[WrittenLine]]:
    """Return what is typed one after the other in one folder, by name."""
    found = {page: written_on(page) for page in PAGES}
    told = {
        name: [line for part in parts for line in found.pop(TUTORIALS / f"{part}.md")]
        for name, parts in ONE_AFTER_THE_OTHER.items()
    }
    told[HELPS] = []  # found when it is told: looking at every help loads every command
    for page, lines in found.items():
        name = page.stem if page.stem != "README" else page.parent.name or "README"
        if lines:
            told["readme" if page.parent == ROOT else name] = lines
    return told


STORIES = stories()


def lines_of(story: str) -> list[WrittenLine]:
    """Return the lines of a story."""
    return help_examples() if story == HELPS else STORIES[story]


def readings() -> list[str]:
    """Return the rows that the tutorial fills in when it calibrates a laser."""
    page = (TUTORIALS / "search_to_laser.md").read_text(encoding="utf-8")
    (block,) = (block for _, _, block in FENCE.findall(page) if block.startswith("kerf_piece"))
    return block.splitlines()


def fill_in(table: Path) -> None:
    """Put the tutorial's readings into the first empty rows of their measure and setting.

    The table of another process does not have them: its page fills in its own.
    """
    rows = table.read_text(encoding="utf-8").splitlines()
    for reading in readings():
        empty = ",".join(reading.split(",")[:2]) + ",,"
        place = next((index for index, row in enumerate(rows) if row.startswith(empty)), None)
        if place is not None:
            rows[place] = reading
    table.write_text("\n".join(rows) + "\n", encoding="utf-8")


def write_down(table: Path) -> None:
    """Let the tips of a contact coupon slide from 15 degrees on."""
    first, *rows = table.read_text(encoding="utf-8").splitlines()
    rows = [
        row.replace(",,", ",no," if float(row.split(",")[0]) < 15.0 else ",yes,") for row in rows
    ]
    table.write_text("\n".join([first, *rows]) + "\n", encoding="utf-8")


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """The wheel of the working tree."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder)]
    subprocess.run([*build, str(ROOT)], check=True, capture_output=True)
    (path,) = folder.glob("*.whl")
    return path


def installed(wheel: Path, folder: Path) -> dict[str, str]:
    """Return the variables of a shell in which the installed wheel is the only vinefab."""
    home = folder / "venv"
    venv.create(home)
    python = home / "bin" / "python"
    pip = home / "bin" / "pip"
    offline = "--disable-pip-version-check --no-index --no-build-isolation"
    runs = f'exec "{sys.executable}" -m pip --python "{python}" "$command" {offline} "$@"'
    pip.write_text(f"#!/bin/sh\ncommand=$1\nshift\n{runs}\n", encoding="utf-8")
    pip.chmod(0o755)
    install = [str(pip), "install", "--quiet", "--no-deps", str(wheel)]
    subprocess.run(install, check=True, capture_output=True)
    (packages,) = (home / "lib").glob("python*/site-packages")
    borrowed = [path for path in site.getsitepackages() if Path(path).is_dir()]
    (packages / "dependencies.pth").write_text("\n".join(borrowed) + "\n", encoding="utf-8")
    kept = {
        name: value
        for name, value in os.environ.items()
        if name not in {"PYTHONPATH", "VINEFAB_PROFILES", "PYTEST_CURRENT_TEST"}
    }
    return {
        **kept,
        "PATH": f"{home / 'bin'}{os.pathsep}{kept['PATH']}",
        "XDG_CONFIG_HOME": str(folder / "config"),
        "BROWSER": "true",  # nothing opens
    }


@dataclass(slots=True)
class Typist:
    """A user with a shell in a folder."""

    folder: Path
    environment: dict[str, str]

    def types(self, line: WrittenLine) -> tuple[int, str]:
        """Type a line and return its exit code and all that it printed."""
        if line.python:
            return self._runs(["python", "-c", line.text])
        if line.text.startswith("cd "):
            self.folder /= line.text.removeprefix("cd ")
            return 0, ""
        if STAYS_OPEN.match(line.text):
            return self._ends_by_hand(line.text)
        if line.text.startswith("vinefab calibrate") and line.page.name != "README.md":
            fill_in(self.folder / "coupons" / "results.csv")
        if line.text.startswith("vinefab fit-observations coupon/") and line.code == 0:
            write_down(self.folder / "coupon" / "contacts.csv")
        return self._runs(["bash", "-c", line.text])

    def _runs(self, words: list[str]) -> tuple[int, str]:
        done = subprocess.run(
            words,
            cwd=self.folder,
            env=self.environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
            timeout=PATIENCE_S,
            check=False,
        )
        return done.returncode, done.stdout

    def _ends_by_hand(self, text: str) -> tuple[int, str]:
        """Start a command that stays open, wait for its first line, and press Ctrl-C."""
        program = subprocess.Popen(
            ["bash", "-c", f"exec {text}"],
            cwd=self.folder,
            env={**self.environment, "PYTHONUNBUFFERED": "1"},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
        )
        assert program.stdout is not None
        first = program.stdout.readline()
        if not COMPLAINT.match(first):
            program.send_signal(signal.SIGINT)
        rest, _ = program.communicate(timeout=60.0)
        return program.returncode, first + rest


def went_as_said(line: WrittenLine, code: int, printed: str) -> bool:
    """Tell whether a line ended as its page says, and nothing in a loop of it failed."""
    return code == line.code and not (code == 0 and COMPLAINT.search(printed))


def test_lines_that_fail_are_noticed(tmp_path):
    (tmp_path / "below").mkdir()
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    typist = Typist(tmp_path, {**os.environ, "PATH": path})

    def right(text, code=0, *, python=False):
        line = WrittenLine(tmp_path, text, code=code, python=python)
        return went_as_said(line, *typist.types(line))

    assert right("ls below")
    assert right("false", 1)
    assert not right("false")
    assert not right("for seed in 1 2; do bash none.sh & done; wait")
    assert right("print(1)", python=True)
    assert not right("print(one)", python=True)
    assert right("cd below")
    assert not right("ls below")


def test_the_lines_of_a_page_are_found(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "```sh\nmake x   # once\n# a remark\nvinefab fix a --out b   # exit code 1: bad\n"
        "vinefab map info a \\\n  --svg b\n```\n```python\nimport x\n```\n"
        "1. step\n   ```sh\n   vinefab study contest a   # takes hours: all of it\n   ```\n"
    )
    found = [(line.text, line.code, line.left_out) for line in written_on(page)]
    assert found == [
        ("make x", 0, "sets up a checkout"),
        ("vinefab fix a --out b", 1, ""),
        ("vinefab map info a --svg b", 0, ""),
        ("import x\n", 0, ""),
        ("vinefab study contest a", 0, "takes hours"),
    ]


def test_every_page_with_something_to_type_belongs_to_a_story():
    told = {line.page for lines in STORIES.values() for line in lines}
    tells = {page for page in PAGES if {"sh", "python"} & set(languages_of(page))}
    assert tells <= told


def test_no_line_hides_in_a_block_of_another_kind():
    known = {"sh", "python", "text", "toml", "json", "{toctree}"}
    assert {
        page.name: languages_of(page) for page in PAGES if set(languages_of(page)) - known
    } == {}
    looks_typed = re.compile(r"^(\$ )?(vinefab|python|pip) [a-z]", re.M)
    hidden = [
        (page.name, block)
        for page in PAGES
        for _, language, block in FENCE.findall(page.read_text(encoding="utf-8"))
        if language == "text" and looks_typed.search(block)
    ]
    assert hidden == []


def test_few_lines_are_left_out_and_pages_of_a_checkout_say_so():
    lines = [line for story in STORIES for line in lines_of(story)]
    assert len(lines) >= LEAST_LINES
    assert sum(bool(line.left_out) for line in lines) <= MOST_LEFT_OUT
    for page in PAGES:
        said = "\nIn a checkout of the project:\n```sh" in page.read_text(encoding="utf-8")
        assert said == (page.stem in IN_A_CHECKOUT), page.name


@pytest.mark.thorough
@pytest.mark.parametrize("story", STORIES)
def test_every_line_runs_as_typed(story, wheel, tmp_path):
    """Run with `-s` for all that is printed and the counts."""
    typist = Typist(tmp_path / "empty", installed(wheel, tmp_path))
    typist.folder.mkdir()
    if story in IN_A_CHECKOUT:
        (typist.folder / "tests").symlink_to(ROOT / "tests")
    failed = []
    begun, before = time.perf_counter(), os.times()
    lines = lines_of(story)
    for line in lines:
        if line.left_out:
            continue
        code, printed = typist.types(line)
        sys.stdout.write(f"\n[{code}] {line.page.name}: {line.text}\n{printed}")
        if not went_as_said(line, code, printed):
            failed.append((line.page.name, line.text, code, printed[-500:]))
    after = os.times()
    cpu_s = sum(after[2:4]) - sum(before[2:4])
    reasons = Counter(line.left_out for line in lines if line.left_out)
    sys.stdout.write(
        f"\nstory {story}: {len(lines)} lines, {reasons.total()} not typed "
        f"{dict(reasons)}, {len(failed)} failed; {time.perf_counter() - begun:.0f} s, "
        f"{cpu_s:.0f} s of processor time\n"
    )
    assert failed == []
