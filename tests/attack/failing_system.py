"""Every writing command on a system that fails: ``python tests/attack/failing_system.py 2``.

A command runs over what an earlier run wrote, with files of a user beside it, as in `kills`, while

* calls to write, rename or fsync fail (EIO, EDQUOT, ENOSPC, EROFS), once or from then on;
* the disk gets full, or read-only in the middle, in truth: on a file system of its own;
* memory is short, at several limits;
* the calendar clock jumps by twenty years, back and forth;
* one of its processes is killed.

It must end well, or with one line and an exit code that is not 0; nothing of the user may change,
outputs are whole or marked, and the next run works. A clock changes no result. The first number is
how often each is tried; names of commands after it select some. Exits with 1 on any failure.
"""

import argparse
import errno
import os
import random
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from kills import (
    ANY,
    BEGUN_STUDY,
    COMMAND_LINES,
    RECORDS,
    WRITING,
    Campaign,
    Watch,
    prepare_inputs,
    program,
    show,
)

CALLS = ("write", "rename", "fsync")
ERRORS = (errno.EIO, errno.EDQUOT, errno.ENOSPC, errno.EROFS)
MEMORY_MB = (150, 300, 450, 700, 1000, 1500)
YEARS_20_S = 631_152_000
LONGEST_S = 180.0
WITH_WORKERS = {"optimize cluster", "contest", "reproduce"}
WITH_CLOCK = {"optimize", "optimize cluster", "optimize front", "contest", "fabricate", "report"}

ON_SMALL_DISK = """
mount -t tmpfs -o size=512m tmpfs "$PLACE" && cp -a "$SOURCE/." "$PLACE" && cd "$PLACE" || exit 99
room=$(df -k --output=avail . | tail -1)
head -c $(((room - FREE_KB) * 1024)) /dev/zero > .ballast
"$@"
code=$?
rm -f .ballast
cp -a . "$RESULT"
exit $code
"""
ON_READ_ONLY_DISK = """
mount -t tmpfs -o size=512m tmpfs "$PLACE" && cp -a "$SOURCE/." "$PLACE" && cd "$PLACE" || exit 99
(sleep "$AFTER_S"; until mount -o remount,ro "$PLACE" 2> /dev/null; do sleep 0.01; done) &
"$@"
code=$?
kill $! 2> /dev/null
cp -a . "$RESULT"
exit $code
"""
"""A disk of its own in place of a command's folder; only this process and its children see it."""


PROGRESS = re.compile(r"^(?!error: )[a-z -]+: .* \(\d[^)]*\)(: .*)?$")
"""What a slow command says of its progress, before its one line about an error."""


@dataclass(frozen=True, slots=True)
class Ended:
    """How a disturbed run ended."""

    code: int
    words: str  # its complaints
    took_s: float


class Trial(Campaign):
    """What is done to one command."""

    def run(
        self,
        n: int,
        *,
        extra: Mapping[str, str] | None = None,
        limit: Callable[[], None] | None = None,
        before: tuple[str, ...] = (),
        meanwhile: Callable[["subprocess.Popen[str]"], None] | None = None,
    ) -> Ended:
        """Run a version, disturbed."""
        began_s = time.monotonic()
        process = subprocess.Popen(
            [*before, *program(*self.words(n))],
            cwd=self.folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            errors="replace",
            start_new_session=True,
            env=os.environ | dict(extra or {}),
            preexec_fn=limit,  # noqa: PLW1509  it only sets a limit
        )
        if meanwhile is not None:
            meanwhile(process)
        try:
            words = process.communicate(timeout=LONGEST_S)[1]
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            words = process.communicate()[1] + "\nhangs"
        return Ended(process.returncode, words, time.monotonic() - began_s)

    def judge(self, way: str, ended: Ended) -> None:
        """Count how a run ended, and note what is wrong with that."""
        good = ended.code in self.codes.values()
        lines = [
            line for line in ended.words.splitlines() if line.strip() and not PROGRESS.search(line)
        ]
        self.blows[f"{way.split(maxsplit=1)[0]} {'unharmed' if good else 'refused'}"] += 1
        self.longest_end_s = max(self.longest_end_s, ended.took_s)
        if not good and (ended.code != 2 or len(lines) != 1 or not lines[0].startswith("error: ")):
            self.losses.append(f"{way}: code {ended.code}, said: {ended.words[-400:]!r}")
        elif "Traceback" in ended.words or "hangs" in lines:
            self.losses.append(f"{way}: {ended.words[-400:]!r}")
        self.look(way)

    def fail_calls(self, shim: Path) -> None:
        """Let a kind of call fail."""
        call, number = self.rng.choice(CALLS), self.rng.choice(ERRORS)
        at = int(2 ** self.rng.uniform(0.0, 6.0))
        extra = {
            "LD_PRELOAD": str(shim),
            "FAIL_CALL": call,
            "FAIL_AT": str(at),
            "FAIL_ERRNO": str(number),
            "FAIL_UNDER": str(self.folder),
        }
        if lasting := self.rng.random() < 0.5:
            extra["FAIL_ON"] = "1"
        way = f"{call} {at}{' and on' if lasting else ''} {errno.errorcode[number]}"
        self.judge(way, self.run(self.rng.choice((1, 2)), extra=extra))

    def fail_disk(self, way: str, script: str, extra: Mapping[str, str]) -> None:
        """Run on a disk of its own, and take what is on it in the end."""
        source, after = (self.folder.with_suffix(suffix) for suffix in (".source", ".after"))
        shutil.copytree(self.folder, source)
        after.mkdir()
        places = {"PLACE": str(self.folder), "SOURCE": str(source), "RESULT": str(after)}
        before = ("unshare", "-m", "sh", "-c", script, "sh")
        ended = self.run(self.rng.choice((1, 2)), extra={**places, **extra}, before=before)
        shutil.rmtree(self.folder)
        shutil.rmtree(source)
        after.rename(self.folder)
        self.judge(way, ended)

    def fill_disk(self) -> None:
        """Leave so little room that a run meets its end early or late."""
        free_kb = int(2 ** self.rng.uniform(2.0, 10.0))
        self.fail_disk(f"full {free_kb} KB free", ON_SMALL_DISK, {"FREE_KB": str(free_kb)})

    def lock_disk(self) -> None:
        """Make the disk read-only at a random moment."""
        after_s = self.rng.uniform(0.0, 1.1 * self.spans_s[ANY])
        extra = {"AFTER_S": f"{after_s:.3f}"}
        self.fail_disk(f"read-only after {after_s:.2f} s", ON_READ_ONLY_DISK, extra)

    def starve(self, most_mb: int) -> None:
        """Limit the memory."""
        most = most_mb << 20
        limit = partial(resource.setrlimit, resource.RLIMIT_AS, (most, most))
        self.judge(f"memory {most_mb} MB", self.run(self.rng.choice((1, 2)), limit=limit))

    def jump(self, shim: Path) -> None:
        """Let the calendar clock jump; outputs must be those of a run without."""
        extra = {"LD_PRELOAD": str(shim), "CLOCK_JUMP_S": str(YEARS_20_S)}
        self.forget_record()
        ended = self.run(1, extra=extra)
        self.judge("clock", ended)
        if ended.code != self.codes[1]:
            self.losses.append(f"clock: ends with {ended.code}: {ended.words[-300:]}")

    def forget_record(self) -> None:
        """Remove what a run would go on from."""
        if self.name in RECORDS:
            for name in self.outputs - {BEGUN_STUDY}:  # a study goes on in its own folder alone
                (self.folder / name).unlink(missing_ok=True)

    def kill_worker(self) -> None:
        """Kill one of the processes that a run began."""
        self.forget_record()
        self.judge("worker", self.run(2, meanwhile=self._kill_one))

    def _kill_one(self, process: "subprocess.Popen[str]") -> None:
        Watch(self.folder, process).await_change(hidden=True)
        while process.poll() is None and not (workers := workers_of(process.pid)):
            time.sleep(0.01)
        time.sleep(self.rng.uniform(0.0, self.spans_s.get(WRITING, 1.0)))
        if process.poll() is None and (workers := workers_of(process.pid)):
            os.kill(self.rng.choice(workers), signal.SIGKILL)
            self.blows["workers killed"] += 1

    def try_all(self, count: int, shim: Path | None, *, disks: bool) -> "Trial":
        """Try every way of failing so often."""
        self.begin()
        for number in range(count):
            if shim is not None:
                for _ in range(3):
                    self.fail_calls(shim)
            if disks:
                self.fill_disk()
                self.lock_disk()
            self.starve(MEMORY_MB[number % len(MEMORY_MB)])
            self.starve(self.rng.randrange(MEMORY_MB[0], MEMORY_MB[-1]))
            self.go_on(1)
        if shim is not None and self.name in WITH_CLOCK:
            self.jump(shim)
        if self.name in WITH_WORKERS:
            for _ in range(count):
                self.kill_worker()
        self.go_on(2)
        return self

    def line(self) -> str:
        """Return a line of the table."""
        counts = ", ".join(f"{way} {count}" for way, count in sorted(self.blows.items()))
        kept = "FAILED" if self.losses else "sound"
        return f"{self.name:17} {kept:6} {counts}; longest {self.longest_end_s:.0f} s"


def workers_of(group: int) -> list[int]:
    """Return the processes of a group, but for its first, that do a command's work."""
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        with suppress(OSError, IndexError):
            facts = (place / "stat").read_text().rpartition(")")[2].split()
            words = (place / "cmdline").read_bytes()
            if int(facts[2]) == group and b"spawn_main" in words:
                found.append(int(place.name))
    return [number for number in found if number != group]


def compiled(folder: Path) -> Path | None:
    """Return the library of failing calls, or None where there is no C compiler."""
    compiler, shim = shutil.which("cc"), folder / "failing_calls.so"
    if compiler is None:
        return None
    source = str(Path(__file__).with_name("failing_calls.c"))
    subprocess.run([compiler, "-O2", "-shared", "-fPIC", "-o", str(shim), source], check=True)
    return shim


def has_own_disks() -> bool:
    """Tell whether a process may have a file system of its own."""
    asked = ["unshare", "-m", "mount", "-t", "tmpfs", "tmpfs", "/mnt"]
    try:
        return subprocess.run(asked, capture_output=True, check=False).returncode == 0
    except FileNotFoundError:
        return False


def main() -> int:
    """Try every command and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int, nargs="?", default=2)
    parser.add_argument("names", nargs="*", help="Some of the commands; default: all.")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_intermixed_args()
    total, failed = Counter[str](), 0
    with tempfile.TemporaryDirectory() as place, ThreadPoolExecutor(given.jobs) as pool:
        shim, disks, inputs = compiled(Path(place)), has_own_disks(), Path(place) / "inputs"
        if shim is None:
            show("NOT TRIED: failing calls and a clock that jumps, as there is no C compiler")
        if not disks:
            show("NOT TRIED: full and read-only disks, as only root may mount them")
        inputs.mkdir()
        prepare_inputs(inputs)

        def trial(name: str) -> Trial:
            folder = Path(place) / name.replace(" ", "_")
            shutil.copytree(inputs, folder)
            rng = random.Random(f"{given.seed} {name}")  # noqa: S311
            return Trial(name, folder, rng).try_all(given.count, shim, disks=disks)

        begun = [pool.submit(trial, name) for name in given.names or COMMAND_LINES]
        for done in (future.result() for future in as_completed(begun)):
            show("\n    ".join([done.line(), *done.losses]))
            total += done.blows
            failed += bool(done.losses)
    show(", ".join(f"{way} {count}" for way, count in sorted(total.items())))
    show(f"{failed} commands failed")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
