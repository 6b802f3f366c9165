"""Runs killed at random moments: ``python tests/search/kill.py 50``, or with names of optimizers.

Every run is a process of ``vinefab optimize``. It is killed (SIGKILL), interrupted (Ctrl-C) or
stopped by a disk that is full (a limit on the size of files) at a random moment, resumed, and
disturbed again. After every blow the record must be sound; in the end record and ``best.toml``
must be those of an undisturbed run, bit for bit.
"""

import random
import resource
import signal
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

from vinefab.search.optimizers.optimizer import OPTIMIZERS
from vinefab.search.record.result import RECORD_FILE

GENERATIONS = 300
OPTIONS = ("--resume", "--workers", "2", "-q")
BLOWS_PER_RUN = 6
MAPS = ""
"""Further lines of the table ``[maps]``."""
QUESTIONS = {
    "run": "SELECT * FROM run ORDER BY 1",
    "map": "SELECT * FROM map ORDER BY 1",
    "generation": "SELECT number, x, fitness, composite, penalty FROM generation ORDER BY 1",
    "term": "SELECT * FROM term ORDER BY 1, 2",
    "optimizer": "SELECT * FROM optimizer",
    "finalist": "SELECT * FROM finalist ORDER BY 1",
}

Content = dict[str, list[tuple[object, ...]]]


def run_text(optimizer):
    """Return a run file whose generations take some milliseconds each."""
    return f"""schema = "vinefab/run-1"
name = "killed"
[maps]
count = 2
{MAPS}
[optimizer]
name = "{optimizer}"
population = 16
generations = {GENERATIONS}
[evaluation]
fabricable = false
finalists = 3
final_poses_per_map = 2
"""


def content(folder):
    """Return the content of a record without times."""
    connection = sqlite3.connect(folder / RECORD_FILE)
    try:
        return {key: connection.execute(text).fetchall() for key, text in QUESTIONS.items()}
    finally:
        connection.close()


def generations(folder):
    """Return the number of generations in a record, after checking that it is consistent."""
    if not (folder / RECORD_FILE).exists():
        return 0
    connection = sqlite3.connect(folder / RECORD_FILE)
    try:
        assert connection.execute("PRAGMA integrity_check").fetchall() == [("ok",)]
        if not connection.execute("SELECT name FROM sqlite_master").fetchall():
            return 0
        numbers = [n for (n,) in connection.execute("SELECT number FROM generation ORDER BY 1")]
        states = connection.execute("SELECT count(*) FROM optimizer").fetchone()[0]
    finally:
        connection.close()
    assert numbers == list(range(len(numbers)))
    assert states == (1 if numbers else 0)
    return len(numbers)


def start(run_file, folder, limit=None):
    command = [sys.executable, "-m", "vinefab", "optimize", str(run_file), "--out", str(folder)]
    return subprocess.Popen(
        [*command, *OPTIONS],
        stderr=subprocess.PIPE,
        text=True,
        errors="replace",
        preexec_fn=limit,  # noqa: PLW1509 - this process has one thread
    )


@dataclass
class Course:
    """What was done to the runs of one optimizer.

    Parameters
    ----------
    optimizer
        Its name.
    folder
        Where its runs are.
    rng
        Decides about blows.
    """

    optimizer: str
    folder: Path
    rng: random.Random
    blows: Counter[str] = field(default_factory=Counter)
    recorded: list[int] = field(default_factory=list)
    runs: int = 0

    def __post_init__(self):
        self.run_file = self.folder / "killed.toml"
        self.run_file.write_text(run_text(self.optimizer))
        whole = self.folder / "whole"
        began_s = time.monotonic()
        process = start(self.run_file, whole)
        while not (whole / RECORD_FILE).exists() and process.poll() is None:
            time.sleep(0.01)
        self.ready_s = time.monotonic() - began_s
        assert process.communicate()[1] == ""
        self.longest_s = time.monotonic() - began_s
        self.expected = content(whole)
        self.best = (whole / "best.toml").read_bytes()
        self.size = (whole / RECORD_FILE).stat().st_size

    def disturbed_run(self, most):
        """Strike a run at most so often, let it end, and compare it with the undisturbed one."""
        folder = Path(tempfile.mkdtemp(dir=self.folder))
        for _ in range(most):
            kind = self.rng.choice(["kill", "kill", "kill", "interrupt", "full disk"])
            if not self._strike(folder, kind):
                break
            self.recorded.append(generations(folder))
        self._finish(folder)
        assert content(folder) == self.expected, f"{folder} differs from the undisturbed run"
        assert (folder / "best.toml").read_bytes() == self.best
        self.runs += 1

    def _strike(self, folder, kind):
        """Tell whether a blow met the run before it had ended."""
        most = self.rng.randrange(4_000, int(1.2 * self.size))
        limit = None
        if kind == "full disk":

            def limit():
                resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))

        process = start(self.run_file, folder, limit)
        try:
            delay_s = None if limit else self._moment_s()
            _, words = process.communicate(timeout=delay_s)
        except subprocess.TimeoutExpired:
            process.send_signal(signal.SIGKILL if kind == "kill" else signal.SIGINT)
            _, words = process.communicate()
        if process.returncode == 0:
            return False
        if kind == "full disk":
            assert (process.returncode, words.count("\n")) == (2, 1), words
        self.blows[kind] += 1
        return True

    def _moment_s(self):
        """Return when to strike: at any moment of a run, but mostly after it has begun."""
        first_s = 0.0 if self.rng.random() < 0.2 else 0.9 * self.ready_s
        return self.rng.uniform(first_s, 1.05 * self.longest_s)

    def _finish(self, folder):
        process = start(self.run_file, folder)
        _, words = process.communicate()
        assert process.returncode == 0, words


def main(arguments):
    blows = int(arguments[0]) if arguments else 50
    names = arguments[1:] or list(OPTIMIZERS)
    rng = random.Random(17)  # noqa: S311
    for name in names:
        wanted = -(-blows // len(names))
        with tempfile.TemporaryDirectory() as folder:
            course = Course(name, Path(folder), rng)
            while len(course.recorded) < wanted:
                course.disturbed_run(min(BLOWS_PER_RUN, wanted - len(course.recorded)))
        struck = ", ".join(f"{kind} {count}" for kind, count in sorted(course.blows.items()))
        middle = sum(0 < count < GENERATIONS for count in course.recorded)
        sys.stdout.write(
            f"{name}: {struck}; {middle} of {len(course.recorded)} blows left a run half done; "
            f"all {course.runs} runs ended as the undisturbed one\n"
        )
        sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1:])
