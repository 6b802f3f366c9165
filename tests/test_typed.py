"""Every command line of the README and the tutorials, typed in order in an empty folder.

The wheel is built and installed into an empty environment, without the network: what it depends on
comes from the environment of the tests. Lines go through a shell, as users type them.
"""

import os
import re
import signal
import site
import subprocess
import sys
import venv
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
TUTORIALS = ROOT / "docs" / "tutorials"
STORIES = {
    "readme": [ROOT / "README.md"],
    "first_robot": [TUTORIALS / "first_robot.md"],
    "arena_and_rig": [TUTORIALS / "my_arena.md", TUTORIALS / "rig_and_reality.md"],
    "search_to_laser": [TUTORIALS / "search_to_laser.md"],
}
"""Pages whose lines are typed one after the other in one folder."""

NOT_TYPED = ("pip install", "make", "source")
"""Beginnings of lines that set up a checkout or an environment; they are counted."""

STAYS_OPEN = ("vinefab studio", "vinefab watch")
"""Beginnings of commands that end with Ctrl-C."""

PATIENCE_S = 900.0


@dataclass(frozen=True, slots=True)
class TypedLine:
    """A line of a page's shell blocks, and the exit code that the page says."""

    page: Path
    text: str
    code: int

    @property
    def skipped(self) -> bool:
        return self.text.startswith(NOT_TYPED)


def lines_of(page: Path) -> list[TypedLine]:
    """Return the lines of a page's shell blocks; `# exit code 1` beside one says how it ends."""
    lines = []
    for block in re.findall(r"^```sh\n(.*?)^```", page.read_text(encoding="utf-8"), re.S | re.M):
        for line in block.replace("\\\n", " ").splitlines():
            text, _, remark = line.partition(" #")
            said = re.search(r"exit code (\d+)", remark)
            if text.strip() and not text.startswith("#"):
                lines.append(TypedLine(page, text.strip(), int(said[1]) if said else 0))
    return lines


def readings() -> list[str]:
    """Return the rows that the tutorial fills in when it calibrates a laser."""
    page = (TUTORIALS / "search_to_laser.md").read_text(encoding="utf-8")
    (block,) = re.findall(r"^```text\n(kerf_piece.*?)^```", page, re.S | re.M)
    return block.splitlines()


def fill_in(table: Path) -> None:
    """Put the tutorial's readings into the first empty rows of their measure and setting."""
    rows = table.read_text(encoding="utf-8").splitlines()
    for reading in readings():
        empty = ",".join(reading.split(",")[:2]) + ",,"
        place = next(index for index, row in enumerate(rows) if row.startswith(empty))
        rows[place] = reading
    table.write_text("\n".join(rows) + "\n", encoding="utf-8")


@pytest.fixture(scope="module")
def environment(tmp_path_factory):
    """Variables of a shell in which the installed wheel is the only vinefab."""
    folder = tmp_path_factory.mktemp("installed")
    build = [sys.executable, "-m", "build", "--wheel", "--no-isolation", "--outdir", str(folder)]
    subprocess.run([*build, str(ROOT)], check=True, capture_output=True)
    (wheel,) = folder.glob("*.whl")
    home = folder / "venv"
    venv.create(home)
    python = home / "bin" / "python"
    install = [sys.executable, "-m", "pip", "--python", str(python), "install", "--quiet"]
    offline = ["--disable-pip-version-check", "--no-deps", "--no-index", str(wheel)]
    subprocess.run([*install, *offline], check=True, capture_output=True)
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


def ended_by_hand(line: TypedLine, folder: Path, environment: dict[str, str]) -> tuple[int, str]:
    """Start a command that stays open, wait for its first line, and press Ctrl-C."""
    program = subprocess.Popen(
        ["bash", "-c", f"exec {line.text}"],
        cwd=folder,
        env={**environment, "PYTHONUNBUFFERED": "1"},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
    )
    assert program.stdout is not None
    first = program.stdout.readline()
    program.send_signal(signal.SIGINT)
    rest, _ = program.communicate(timeout=60.0)
    return program.returncode, first + rest


def typed(line: TypedLine, folder: Path, environment: dict[str, str]) -> tuple[int, str]:
    """Type a line and return its exit code and all that it printed."""
    if line.text.startswith(STAYS_OPEN):
        return ended_by_hand(line, folder, environment)
    if line.text.startswith("vinefab calibrate"):
        fill_in(folder / "coupons" / "results.csv")
    done = subprocess.run(
        ["bash", "-c", line.text],
        cwd=folder,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        timeout=PATIENCE_S,
        check=False,
    )
    return done.returncode, done.stdout


def test_the_lines_of_a_page_are_found(tmp_path):
    page = tmp_path / "page.md"
    page.write_text(
        "```sh\npip install .   # once\n# a remark\nvinefab check a --fix b   # exit code 1: bad\n"
        "vinefab map info a \\\n  --svg b\n```\n```python\nimport x\n```\n"
    )
    found = [(" ".join(line.text.split()), line.code, line.skipped) for line in lines_of(page)]
    assert found == [
        ("pip install .", 0, True),
        ("vinefab check a --fix b", 1, False),
        ("vinefab map info a --svg b", 0, False),
    ]


def test_only_set_up_and_vinefab_are_typed():
    lines = [line for pages in STORIES.values() for page in pages for line in lines_of(page)]
    assert [line.text for line in lines if not (line.skipped or "vinefab " in line.text)] == []
    assert sum(line.skipped for line in lines) < 6


@pytest.mark.thorough
@pytest.mark.parametrize("story", STORIES)
def test_every_line_runs_as_typed(story, environment, tmp_path):
    """Run with `-s` for all that is printed and the counts."""
    lines = [line for page in STORIES[story] for line in lines_of(page)]
    failed = []
    for line in lines:
        if line.skipped:
            continue
        code, printed = typed(line, tmp_path, environment)
        sys.stdout.write(f"\n[{code}] {line.page.name}: {line.text}\n{printed}")
        if code != line.code:
            failed.append((line.page.name, line.text, code, printed[-500:]))
    skipped = sum(line.skipped for line in lines)
    counts = f"{len(lines)} lines, {skipped} not typed, {len(failed)} failed"
    sys.stdout.write(f"\n{story}: {counts}\n")
    assert failed == []
