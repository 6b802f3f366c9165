"""Every writing command, killed at random moments: ``python tests/attack/kills.py 20 --seed 1``.

A command runs again and again over what an earlier run wrote, with files of a user beside it, and
gets SIGKILL, SIGINT, SIGTERM or SIGHUP, as a terminal sends it: to all its processes. After every
blow the user's files must be as they were, and every output must be that of a whole run, or be
marked as incomplete. After every few blows an undisturbed run must end well. Names of commands
after the count select some. Exits with 1 on any loss.
"""

import argparse
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

from vinefab.cli.main import COMMANDS
from vinefab.core.hashing import MANIFEST_NAME, digests_in, sha256_of_file
from vinefab.core.replacement import INCOMPLETE_NAME

SIGNALS = (signal.SIGKILL, signal.SIGKILL, signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
WRITES_NOTHING = {"profiles"}
UNDISTURBED_EVERY = 5
LONGEST_S = 600.0

GROW = "grow three_level_tree --map grid.geojson"
COMMAND_LINES = {
    "map grid": "map grid --seed {n} --columns 3 --rows 3 --size 300 --out m.geojson",
    "map import": "map import drawing{n}.svg --out m.geojson",
    "map info": "map info grid.geojson --width-mm 2{n} --json info.json --svg info.svg",
    "grow pictures": f"{GROW} --head-on-half-angle-deg {{n}} --json g.json --svg g.svg --history 9",
    "grow animation": f"{GROW} --head-on-half-angle-deg {{n}} --animate g.gif --frames 8",
    "score": "score three_level_tree --map grid.geojson --seed {n} --json score.json",
    "check": "check three_level_tree --limit VF-C01.warning={n} --svg c.svg --dxf c.dxf "
    "--json c.json",
    "check --fix": "check broken{n}.toml --fix fixed.toml",
    "fabricate": "fabricate plain{n}.toml --out package --zip --allow-uncalibrated",
    "fabricate nested": "fabricate plain{n}.toml --copies 3 --out package --allow-uncalibrated",
    "fabricate tiled": "fabricate long{n}.toml --out package --allow-uncalibrated",
    "coupon": "coupon --recipe {recipe} --out coupons",
    "calibrate": "calibrate results{n}.csv --out mine.toml --json fit.json",
    "rig": "rig grid.geojson --height-mm 3{n} --no-pictures --out rig",
    "report": "report three_level_tree --map grid.geojson --seed {n} --out r.html --json r.json",
    "compare": "compare grid_explorer three_level_tree --map grid.geojson --seed {n} --out c.html "
    "--json c.json",
    "optimize": "optimize run.toml --out run --resume --workers {n}",
    "optimize cluster": "optimize run.toml --out run --resume --cluster local:{n}",
    "optimize front": "optimize front.toml --out run --resume --workers {n}",
    "runs": "runs record{n} --rebuild rebuilt --json runs.json",
    "contest": "contest run.toml --optimizer pso --optimizer cmaes --seeds 2 --unseen 2 --jobs {n} "
    "--out contest",
    "demo": "demo --generations {n} --population 4 --out demo",
    "reproduce": "reproduce transfer --quick --workers {n} --out study",
    "bench": "bench --json bench.json",
}
"""By what is told of a command: its words, with 1 or 2 for n so that two runs write differently."""

RECORDS = {"optimize", "optimize cluster", "optimize front", "contest", "reproduce"}
"""Commands that go on where a record ends: their files are of any moment, and have no manifest."""

RUN = """schema = "vinefab/run-1"
name = "killed"
[maps]
count = 1
[task]
{objectives}
[optimizer]
name = "{optimizer}"
population = 8
generations = 40
[evaluation]
fabricable = false
finalists = 2
final_poses_per_map = 1
"""


def program(*words: object) -> list[str]:
    """Return the words that start a command."""
    return [sys.executable, "-m", "vinefab", *map(str, words)]


def prepare_inputs(folder: Path) -> None:
    """Write what the commands read."""
    for n, length_mm in ((1, 180.0), (2, 200.0)):
        design = f'schema = "vinefab/design-1"\nname = "d"\n[trunk]\nlength = {length_mm}\n'
        (folder / f"plain{n}.toml").write_text(design)
        long = design.replace(f"{length_mm}", f"{10 * length_mm}")
        (folder / f"long{n}.toml").write_text(long)
        build = f"[build]\ntail_mm = 100.0\npressure_kpa = 3{n}.0\n"
        (folder / f"broken{n}.toml").write_text(f"{design}{build}")
        box = f'<rect width="300" height="{length_mm}"/><circle cx="99" cy="99" r="30"/>'
        drawing = f'<svg xmlns="http://www.w3.org/2000/svg" width="300mm" height="{length_mm}mm" '
        text = f'{drawing}viewBox="0 0 300 {length_mm}">{box}</svg>'
        (folder / f"drawing{n}.svg").write_text(text)
        run = RUN.format(optimizer="pso" if n == 1 else "cmaes", objectives="")
        (folder / f"record{n}.toml").write_text(run)
    (folder / "run.toml").write_text(RUN.format(optimizer="pso", objectives=""))
    objectives = 'objectives = ["coverage", "film_length"]'
    (folder / "front.toml").write_text(RUN.format(optimizer="nsga2", objectives=objectives))
    make = "map grid --columns 3 --rows 3 --size 300 --out grid.geojson"
    subprocess.run(program(*make.split(), "-q"), cwd=folder, check=True)
    for n in (1, 2):
        record = f"optimize record{n}.toml --out record{n} -q"
        subprocess.run(program(*record.split()), cwd=folder, check=True)
    for n in (1, 2):
        row = f"friction_incline,,2{n},deg,1\n"
        (folder / f"results{n}.csv").write_text(f"measure,setting,value,unit,uncertainty\n{row}")


def files_in(folder: Path) -> dict[str, str]:
    """Return the digests of all files in a folder, by name."""
    paths = [path for path in folder.rglob("*") if path.is_file()]
    return {path.relative_to(folder).as_posix(): sha256_of_file(path) for path in paths}


@dataclass
class Campaign:
    """The blows at one command, in a folder of its own."""

    name: str
    folder: Path
    rng: random.Random
    blows: Counter[str] = field(default_factory=Counter)
    moments_s: list[float] = field(default_factory=list)
    losses: list[str] = field(default_factory=list)
    left_over: int = 0  # hidden files that SIGKILL left
    longest_end_s: float = 0.0  # from a signal to the end

    def words(self, n: int) -> list[str]:
        """Return the command line of one of the two versions."""
        recipe = ("co2_60w__stretchlon_200", "co2_60w__tpu_nylon_70d")[n - 1]
        return COMMAND_LINES[self.name].format(n=n, recipe=recipe).split()

    def begin(self) -> None:
        """Run both versions, put files of a user beside what they wrote, and note all content."""
        inputs = set(files_in(self.folder))
        self.whole: dict[str, set[str]] = {}
        self.long_s = 0.0
        self.codes: dict[int, int] = {}
        for n in (2, 1):
            began_s = time.monotonic()
            ended = self.run(n)
            self.long_s = max(self.long_s, time.monotonic() - began_s)
            self.codes[n] = ended.returncode
            assert ended.returncode in (0, 1), (self.name, ended.stderr)
            self.note(inputs)
        self.outputs = set(self.whole)
        assert self.outputs, f"{self.name} wrote nothing"
        places = {(self.folder / name).parent for name in self.outputs}
        for number, place in enumerate(sorted(places)):
            (place / f"my notes {number}.txt").write_text(f"mine {self.rng.random()}")
            (place / "my photos").mkdir(exist_ok=True)
            (place / "my photos" / "robot.jpg").write_bytes(self.rng.randbytes(5000))
        every = files_in(self.folder)
        self.theirs = {name: every[name] for name in every if name not in self.outputs}

    def note(self, inputs: set[str]) -> None:
        """Add what an undisturbed run wrote."""
        for name, digest in files_in(self.folder).items():
            if name not in inputs:
                self.whole.setdefault(name, set()).add(digest)

    def run(self, n: int) -> "subprocess.CompletedProcess[str]":
        """Run a version undisturbed."""
        return subprocess.run(
            program(*self.words(n)),
            cwd=self.folder,
            capture_output=True,
            text=True,
            check=False,
            timeout=LONGEST_S,
        )

    def strike(self, n: int) -> None:
        """Run a version, stop it at a random moment, and look at what is left."""
        if self.name in RECORDS:
            self.begin_again()
        number = self.rng.choice(SIGNALS)
        early_s = 0.0 if self.rng.random() < 0.4 else 0.7 * self.long_s
        moment_s = self.rng.uniform(early_s, 1.02 * self.long_s)
        process = subprocess.Popen(
            program(*self.words(n)),
            cwd=self.folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )
        began_s = time.monotonic()
        try:
            process.communicate(timeout=moment_s)
            self.blows["too late"] += 1
            self.long_s = time.monotonic() - began_s  # the computer may have been busy before
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, number)
            self.blows[number.name] += 1
            self.moments_s.append(moment_s)
            self.await_end(process, number)
        self.look(f"{number.name} at {moment_s:.2f} s")

    def begin_again(self) -> None:
        """Remove a record, sometimes: else every blow would meet a run that is complete."""
        if self.rng.random() < 0.7:
            for name in self.outputs:
                (self.folder / name).unlink(missing_ok=True)

    def await_end(self, process: "subprocess.Popen[str]", number: signal.Signals) -> None:
        """Wait for the end, and check what was said."""
        struck_s = time.monotonic()
        try:
            words = process.communicate(timeout=60.0)[1]
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
            self.losses.append(f"{number.name}: hangs")
            return
        self.longest_end_s = max(self.longest_end_s, time.monotonic() - struck_s)
        if number is not signal.SIGKILL and "Traceback" in words and "error: " in words:
            self.losses.append(f"{number.name}: a traceback: {words[-300:]}")

    def look(self, when: str) -> None:
        """Check that nothing is lost or half written."""
        now = files_in(self.folder)
        gone = [name for name, digest in self.theirs.items() if now.get(name) != digest]
        self.losses += [f"{when}: the user's {name} is changed or gone" for name in gone]
        hidden = [name for name in now if any(part[0] == "." for part in name.split("/"))]
        self.left_over = max(self.left_over, len(hidden))
        for name in self.half_written(now):
            self.losses.append(f"{when}: {name} is neither old nor new")

    def half_written(self, now: dict[str, str]) -> Iterator[str]:
        """Yield outputs that are of no whole run, in a folder that is not marked."""
        if self.name in RECORDS:
            return
        for name in sorted(self.outputs):
            top = self.folder / name.split("/")[0]
            manifest = top / MANIFEST_NAME
            if (top / INCOMPLETE_NAME).exists():
                continue
            if manifest.exists():
                listed = digests_in(manifest.read_text()).get(name.partition("/")[2])
                if listed is not None and now.get(name) != listed:
                    yield name
            elif self.name != "bench" and now.get(name) not in self.whole[name]:
                yield name

    def go_on(self, n: int) -> None:
        """Run undisturbed over what was struck; it must end as it always does."""
        ended = self.run(n)
        if ended.returncode != self.codes[n]:
            problem = f"the next run ends with {ended.returncode}: {ended.stderr[-300:]}"
            self.losses.append(problem)
        self.look("the next run")

    def do(self, count: int) -> "Campaign":
        """Strike so often."""
        self.begin()
        while self.blows.total() - self.blows["too late"] < count and not self.losses:
            if self.blows["too late"] > count:
                break
            self.strike(self.rng.choice((1, 2)))
            if self.blows.total() % UNDISTURBED_EVERY == 0:
                self.go_on(1)
        self.go_on(2)
        return self

    def line(self) -> str:
        """Return a line of the table."""
        struck = [f"{self.blows[number]:4}" for number in dict.fromkeys(s.name for s in SIGNALS)]
        moments = [f"{at_s:.1f}" for at_s in sorted(self.moments_s)]
        span = f"{moments[0]}..{moments[-1]}" if moments else "-"
        kept = "all kept" if not self.losses else "LOST"
        return (
            f"{self.name:18}{''.join(struck)}   {kept:9} {span:>12} of {self.long_s:5.1f} s   "
            f"ends in {self.longest_end_s:4.1f} s   {self.left_over} hidden left"
        )


def show(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def main() -> int:
    """Strike every command and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int, nargs="?", default=20)
    parser.add_argument("names", nargs="*", help="Some of the commands; default: all.")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    given = parser.parse_intermixed_args()
    covered = {line.split()[0] for line in COMMAND_LINES.values()} | WRITES_NOTHING
    assert covered == set(COMMANDS), covered ^ set(COMMANDS)
    show("command            KILL INT TERM HUP")
    failed = 0
    with tempfile.TemporaryDirectory() as place, ThreadPoolExecutor(given.jobs) as pool:
        inputs = Path(place) / "inputs"
        inputs.mkdir()
        prepare_inputs(inputs)

        def campaign(name: str) -> Campaign:
            folder = Path(place) / name.replace(" ", "_")
            shutil.copytree(inputs, folder)
            rng = random.Random(f"{given.seed} {name}")  # noqa: S311
            return Campaign(name, folder, rng).do(given.count)

        for done in pool.map(campaign, given.names or COMMAND_LINES):
            show("\n    ".join([done.line(), *done.losses]))
            failed += bool(done.losses)
    show(f"{failed} commands lost something")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
