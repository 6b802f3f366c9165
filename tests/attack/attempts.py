"""Command lines that are tried one by one in a process with limits, and judged.

A command must end with exit code 0 and sound files, with 1 where its findings say so, or with 2
and one line of complaint and no file; in 10 s of processor time and 2 GB. What was given to it
stays as it was, and nothing outside its folder is written. Anything else is a failure.
"""

import csv
import io
import json
import os
import resource
import signal
import sqlite3
import subprocess
import sys
import tomllib
import warnings
import zipfile
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

VINEFAB = "vinefab.cli.main:main"
MOST_BYTES = 2 << 30
MOST_CPU_S = 10.0
MOST_WALL_S = 120.0
LONGEST_LINE = 3_000
ATTEMPTS_PER_PROCESS = 300
MAY_FIND = ("check", "fabricate", "rig", "coupon", "optimize", "runs")
READ_BACK = "@read-back"  # in place of a command: read a file as our own are read back
OUTCOMES = ("accepted", "findings", "refused", "failed")


@dataclass(frozen=True, slots=True, kw_only=True)
class Attempt:
    """One command line in a folder of its own."""

    name: str  # what reproduces it
    arguments: tuple[str, ...]
    folder: str  # it runs in here; what is in it now was given to it
    rewrites: bool = False  # it may change what was given to it
    endless: bool = False  # it may go on until it is stopped, once it has written something
    cpu_s: float = MOST_CPU_S


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """What became of an attempt."""

    name: str
    outcome: str  # one of `OUTCOMES`
    reason: str  # of a failure
    words: str  # the end of its complaints
    arguments: tuple[str, ...] = ()
    cpu_s: float = 0.0
    peak_bytes: int = 0  # of the process until now


@dataclass
class Tally:
    """Verdicts counted by kind."""

    counts: dict[str, Counter[str]] = field(default_factory=dict)
    failures: list[Verdict] = field(default_factory=list)
    slowest_refused: Verdict | None = None
    peak_bytes: int = 0

    def add(self, kind: str, verdict: Verdict) -> None:
        self.counts.setdefault(kind, Counter())[verdict.outcome] += 1
        self.peak_bytes = max(self.peak_bytes, verdict.peak_bytes)
        if verdict.outcome == "failed":
            self.failures.append(verdict)
        slowest = self.slowest_refused
        if verdict.outcome == "refused" and (slowest is None or slowest.cpu_s < verdict.cpu_s):
            self.slowest_refused = verdict

    def report(self, script: str) -> str:
        """Return a table of the counts, and how to see each failure again."""
        lines = [f"{'kind':12s}{'tried':>8s}" + "".join(f"{one:>10s}" for one in OUTCOMES)]
        total = Counter[str]()
        for counts in self.counts.values():
            total += counts
        for kind, counts in [*self.counts.items(), ("all", total)]:
            lines.append(
                f"{kind:12s}{counts.total():8d}"
                + "".join(f"{counts[outcome]:10d}" for outcome in OUTCOMES)
            )
        lines.extend(
            f"python {script} {one.name}   {one.reason}: {one.words[-300:]!r}"
            for one in self.failures
        )
        if self.slowest_refused is not None:
            slow = self.slowest_refused
            lines.append(f"slowest refusal {slow.cpu_s:.1f} s ({slow.name})")
        lines.append(f"most memory {self.peak_bytes / 2**20:.0f} MiB")
        return "\n".join(lines) + "\n"


def judged(attempts: Iterator[Attempt], program: str = VINEFAB) -> Iterator[Verdict]:
    """Yield the verdict on each attempt; a process that dies is replaced by another."""
    waiting = next(attempts, None)
    while waiting is not None:
        with subprocess.Popen(
            [sys.executable, __file__, program],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
            start_new_session=True,
            env=os.environ | {"PYTHONIOENCODING": "utf-8:strict", "COLUMNS": "100"},
        ) as process:
            assert process.stdin is not None
            assert process.stdout is not None
            try:
                for _ in range(ATTEMPTS_PER_PROCESS):
                    process.stdin.write(json.dumps(asdict(waiting)) + "\n")
                    process.stdin.flush()
                    answer = process.stdout.readline()
                    if not answer:
                        yield _verdict_on_dead(waiting, process.wait())
                        waiting = next(attempts, None)
                        break
                    yield Verdict(**json.loads(answer))
                    waiting = next(attempts, None)
                    if waiting is None:
                        break
            finally:
                process.kill()


def _verdict_on_dead(attempt: Attempt, code: int) -> Verdict:
    killed = {-signal.SIGPROF: "out of processor time", -signal.SIGALRM: "hangs"}
    reason = killed.get(code, f"the process ended with {code}")
    started = attempt.endless and _given(Path(attempt.folder), attempt.arguments)
    outcome = "accepted" if started and -code == signal.SIGPROF else "failed"
    words = (Path(attempt.folder).parent / "stderr").read_text(errors="replace")
    return Verdict(
        name=attempt.name,
        outcome=outcome,
        reason=reason,
        words=words,
        arguments=tuple(attempt.arguments),
        cpu_s=attempt.cpu_s,
    )


def _given(folder: Path, arguments: tuple[str, ...]) -> bool:
    """Tell whether a command that was stopped had begun its real work."""
    out = folder / arguments[arguments.index("--out") + 1] if "--out" in arguments else folder
    return out.exists()


# ---- In the process with limits ----


def _load(program: str) -> Callable[[list[str]], int]:
    module, _, function = program.partition(":")
    return getattr(__import__(module, fromlist=[function]), function)


def serve(program: str) -> None:
    """Read attempts from standard input, try them, and write verdicts."""
    resource.setrlimit(resource.RLIMIT_DATA, (MOST_BYTES, MOST_BYTES))
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    requests, answers = os.fdopen(os.dup(0)), os.fdopen(os.dup(1), "w")
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    run = _load(program)

    def main(arguments: list[str]) -> int:
        return read_back(Path(arguments[1])) if arguments[0] == READ_BACK else run(arguments)

    for category in (UserWarning, RuntimeWarning, FutureWarning):
        warnings.simplefilter("always", category)
    for line in requests:
        attempt = Attempt(**json.loads(line))
        answers.write(json.dumps(asdict(_tried(attempt, main))) + "\n")
        answers.flush()


def read_back(path: Path) -> int:
    """Read a file as vinefab reads what it has written itself; return what a command would."""
    from vinefab.core.errors import UnreadableFileError  # noqa: PLC0415
    from vinefab.fabrication.formats.laser_formats import LASER_FORMATS  # noqa: PLC0415
    from vinefab.rig.part_files import PART_FORMATS  # noqa: PLC0415

    readers: dict[str, Callable[[bytes], object]] = {
        one.suffix: one.read for one in PART_FORMATS.values()
    }
    for form in LASER_FORMATS.values():
        readers[form.suffix] = lambda data, form=form: form.read(data.decode(errors="replace"))
    try:
        readers[path.suffix](path.read_bytes())
    except UnreadableFileError as error:
        sys.stderr.write(f"error: {' '.join(str(error).split())}\n")
        return 2
    return 0


def _tried(attempt: Attempt, main: Callable[[list[str]], int]) -> Verdict:
    folder = Path(attempt.folder)
    before = _contents(folder)
    around = _contents(folder.parent, folder)
    streams = [folder.parent / "stdout", folder.parent / "stderr"]
    for number, path in enumerate(streams, start=1):
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
        os.dup2(handle, number)
        os.close(handle)
    os.chdir(folder)
    begin = _cpu_s()
    signal.setitimer(signal.ITIMER_PROF, attempt.cpu_s)
    signal.setitimer(signal.ITIMER_REAL, MOST_WALL_S)
    try:
        code = main(list(attempt.arguments))
    except BaseException as error:  # whatever it is, it should not come here
        code = f"{type(error).__name__} left the program: {error}"
    signal.setitimer(signal.ITIMER_PROF, 0.0)
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    if readers := sys.modules.get("vinefab.core.bounded"):
        readers.end_children()  # their time and memory count once they have ended
    cpu_s = _cpu_s() - begin
    sys.stdout.flush()
    sys.stderr.flush()
    words = streams[1].read_text(errors="replace")
    reason = _reason(attempt, code, words, streams[0].read_text(errors="replace"))
    reason = reason or _reason_of_files(attempt, code, before)
    if not reason and not attempt.endless and cpu_s > attempt.cpu_s:
        reason = "out of processor time, its children counted"
    if not reason and _contents(folder.parent, folder) != around:
        reason = "wrote outside its folder"
    return Verdict(
        name=attempt.name,
        outcome="failed" if reason else ("accepted", "findings", "refused")[int(code)],
        reason=reason,
        words=words[-2_000:],
        arguments=tuple(attempt.arguments),
        cpu_s=cpu_s,
        peak_bytes=1024
        * max(
            resource.getrusage(who).ru_maxrss
            for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
        ),
    )


def _cpu_s() -> float:
    """Return the processor time of this process and of the children that it waited for."""
    who = (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)
    return sum(use.ru_utime + use.ru_stime for use in map(resource.getrusage, who))


def _contents(folder: Path, but: Path | None = None) -> dict[str, bytes]:
    """Return what lies in a folder, without one folder in it and without captured streams."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
        and path.name not in ("stdout", "stderr")
        and (but is None or not path.is_relative_to(but))
    }


def _reason(attempt: Attempt, code: int | str, words: str, output: str) -> str:
    if isinstance(code, str) or code not in (0, 1, 2):
        return f"exit code {code}"
    if code == 1 and attempt.arguments[0] not in MAY_FIND:
        return "exit code 1 of a command without findings"
    if "Traceback" in output + words:
        return "a traceback"
    if code == 2:
        if not words.startswith("error: ") or words.count("\n") != 1:
            return f"{words.count(chr(10))} lines of complaint"
        return f"a line of {len(words)} characters" if len(words) > LONGEST_LINE else ""
    return "complaints of a success" if words.count("\n") > code else ""


def _reason_of_files(attempt: Attempt, code: int | str, before: dict[str, bytes]) -> str:
    after = _contents(Path(attempt.folder))
    if not attempt.rewrites:
        for name, data in before.items():
            if after.get(name) != data:
                return f"{name} was changed or lost"
        if code == 2 and len(after) > len(before):
            return f"refused, but left {sorted(set(after) - set(before))[:3]}"
    for name, data in after.items():
        if before.get(name) != data:
            problem = problem_of(name, data)
            if problem:
                return f"{name}: {problem}"
    return ""


def _no_constants(text: str) -> float:
    raise ValueError(f"{text} in JSON")


_TEMPLATES = Path(__file__).parents[2] / "vinefab" / "pages" / "templates"
OWN_SCRIPTS = {path.read_text("utf-8").strip() for path in _TEMPLATES.glob("*.js")}
"""Scripts of pages: nothing in them is filled in."""


class _Page(HTMLParser):
    """Finds foreign scripts, and handlers, in a page."""

    def handle_data(self, data: str) -> None:
        if self.cdata_elem == "script" and data.strip() not in OWN_SCRIPTS:
            raise ValueError("a foreign script in a page")

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        for name, value in attrs:
            if name.startswith("on") or "javascript:" in (value or "").lower():
                raise ValueError(f"<{tag} {name}> in a page")
        if tag in ("iframe", "object", "embed", "base") or (tag == "script" and attrs):
            raise ValueError(f"<{tag}> in a page")


def _check_xml(data: bytes) -> None:
    for element in ElementTree.fromstring(data).iter():  # noqa: S314  we wrote it
        if element.tag.lower().endswith("}script") or any(
            name.lower().startswith("on") for name in element.attrib
        ):
            raise ValueError("a script in a picture")


def _check_html(data: bytes) -> None:
    page = _Page()
    page.feed(data.decode("utf-8"))
    page.close()


def _check_dxf(data: bytes) -> None:
    from ezdxf import recover  # noqa: PLC0415  slow to load

    _, audit = recover.read(io.BytesIO(data))
    if audit.errors or audit.fixes:
        raise ValueError(f"ezdxf audit: {(audit.errors + audit.fixes)[0].message}")


def _check_image(data: bytes) -> None:
    from PIL import Image  # noqa: PLC0415  slow to load

    Image.open(io.BytesIO(data)).load()


def _check_zip(data: bytes) -> None:
    with zipfile.ZipFile(io.BytesIO(data)) as archive:
        if archive.testzip() is not None:
            raise ValueError("a damaged zip")
        for name in archive.namelist():
            if name.startswith("/") or ".." in Path(name).parts:
                raise ValueError(f"{name} in a zip")
            problem = problem_of(name, archive.read(name))
            if problem:
                raise ValueError(f"{name}: {problem}")


def _check_csv(data: bytes) -> None:
    for row in csv.reader(io.StringIO(data.decode("utf-8"))):
        for cell in row:
            if cell[:1] in ("=", "@", "\t", "\r"):
                raise ValueError(f"a cell that computes: {cell[:40]}")


def _check_sqlite(data: bytes) -> None:
    if data[:16] != b"SQLite format 3\x00":
        raise ValueError("no SQLite file")


SOUND: dict[str, Callable[[bytes], Any]] = {
    ".json": lambda data: json.loads(data, parse_constant=_no_constants),
    ".geojson": lambda data: json.loads(data, parse_constant=_no_constants),
    ".svg": _check_xml,
    ".lbrn2": _check_xml,
    ".html": _check_html,
    ".toml": lambda data: tomllib.loads(data.decode("utf-8")),
    ".dxf": _check_dxf,
    ".png": _check_image,
    ".gif": _check_image,
    ".zip": _check_zip,
    ".3mf": _check_zip,
    ".csv": _check_csv,
    ".txt": lambda data: data.decode("utf-8"),
    ".sqlite": _check_sqlite,
}


def problem_of(name: str, data: bytes) -> str:
    """Return what is wrong with a file that was written, or nothing."""
    try:
        SOUND.get(Path(name).suffix, len)(data)
    except (ValueError, OSError, SyntaxError, sqlite3.Error, zipfile.BadZipFile) as error:
        return f"{type(error).__name__}: {error}"[:300]
    except Exception as error:  # ezdxf raises its own errors
        return f"{type(error).__name__}: {error}"[:300]
    return ""


if __name__ == "__main__":
    sys.path.pop(0)  # this folder holds no module that a command should find
    serve(sys.argv[1])
