"""Every writing command, killed at random moments: ``python tests/attack/kills.py 20 --seed 1``.

A command runs again and again over what an earlier run wrote, with files of a user beside it, and
gets SIGKILL, SIGINT, SIGTERM or SIGHUP, as a terminal sends it: to all its processes. A third of
the blows come at any moment of the run, a quarter while it writes, the others while its outputs
are replaced; for these the folder is watched. After every blow the user's files must be as they
were, byte for byte, and every output must be that of a whole run, or be marked as incomplete; the
exit code must tell the signal. After every few blows an undisturbed run must end well. Names of
commands after the count select some. Exits with 1 on any loss.
"""

import argparse
import io
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
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import redirect_stderr, redirect_stdout, suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import NoReturn

from PIL import Image

from vinefab.app.verbs import VERBS
from vinefab.cli.commands import command_for
from vinefab.cli.main import main as run_command
from vinefab.cli.main import run as run_program
from vinefab.core.atomic import INCOMPLETE_NAME
from vinefab.core.hashing import MANIFEST_NAME, digests_in, sha256_of_file

SIGNALS = (signal.SIGKILL, signal.SIGKILL, signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
WRITES_NOTHING = {"designs", "printers", "profiles", "recipes", "rules", "studio"}
"""The studio writes when its page asks for it, a file in one step (`tests/studio`)."""
UNDISTURBED_EVERY = 7
LONGEST_S = 600.0
POLL_S = 0.002
ANY, WRITING, REPLACING = "any", "writing", "replacing"
PHASES = (ANY, ANY, ANY, WRITING, WRITING, REPLACING, REPLACING, REPLACING, REPLACING)
"""When a blow comes, as often as listed: at any moment; after the first file, hidden or not, came
or went; after the first one did that is not hidden."""

GROW = "grow three_level_tree --map grid.geojson"
COMMAND_LINES = {
    "demo": "demo --generations {n} --population 4 --out demo",
    "coupon": "coupon --recipe {recipe} --out coupons",
    "fabricate tiled": "fabricate long{n}.toml --out package --allow-uncalibrated",
    "fabricate": "fabricate plain{n}.toml --out package --zip --allow-uncalibrated",
    "fabricate nested": "fabricate plain{n}.toml --copies 3 --out package --allow-uncalibrated",
    "rig": "rig grid.geojson --height-mm 3{n} --no-pictures --out rig",
    "reproduce": "reproduce transfer --quick --workers {n} --out study",
    "optimize front": "optimize front.toml --out run --resume --workers {n}",
    "optimize": "optimize run.toml --out run --resume --workers {n}",
    "optimize cluster": "optimize run.toml --out run --resume --cluster local:{n} --workers 0",
    "contest": "study contest run.toml --optimizer pso --optimizer cmaes --seeds 2 --unseen 2 "
    "--jobs {n} --out contest",
    "runs": "runs record{n} --rebuild rebuilt --best best.toml --json runs.json",
    "grow pictures": f"{GROW} --head-on-half-angle-deg {{n}} --json g.json --svg g.svg --history 9",
    "grow animation": f"{GROW} --head-on-half-angle-deg {{n}} --animate g.gif --frames 8",
    "check": "check three_level_tree --limit VF-C01.warning={n} --svg c.svg --dxf c.dxf "
    "--json c.json",
    "inflate": "inflate plain{n}.toml --alone --mesh body.stl --out i.svg --json i.json",
    "fix": "fix broken{n}.toml --out fixed.toml",
    "calibrate": "calibrate results{n}.csv --out mine.toml --json fit.json",
    "map info": "map info grid.geojson --width-mm 2{n} --json info.json --svg info.svg",
    "map grid": "map grid --seed {n} --columns 3 --rows 3 --size 300 --out m.geojson",
    "map import": "map import drawing{n}.svg --out m.geojson",
    "score": "score three_level_tree --map grid.geojson --seed {n} --json score.json",
    "compare": "compare cave_explorer three_level_tree --map grid.geojson --poses 1 --seed {n} "
    "--out c.html --json c.json",
    "aim": "aim plain_vine --map grid.geojson --deployments 5000 --seed {n} --out a.html "
    "--json a.json",
    "observe": "observe photo{n}.png --map grid.geojson --design plain{n}.toml --out o.html "
    "--corners 10,310,310,310,310,10,10,10 --json o.json",
    "fit-observations": "fit-observations seen{n}.json --out fitted.toml --json fit.json",
    "map start": "map start grid.geojson --start {n}50,20,90+-20 --out m.geojson",
    "map photo": "map import floor{n}.png --points 0,0;160,0 --distance-mm 320 --out m.geojson "
    "--preview m.png",
    "new": "new design new{n}.toml --force",
    "examples": "examples --out examples{n} --force",
    "study": "study contest run.toml --optimizer pso --optimizer cmaes --seeds 2 --unseen 2 "
    "--jobs {n} --out contest",
    "report": "report three_level_tree --map grid.geojson --poses 1 --seed {n} --out r.html "
    "--json r.json",
    "bench": "bench --json bench.json",
}
"""By what is told of a command: its words, with 1 or 2 for n so that two runs write differently."""

RECORDS = {"optimize", "optimize cluster", "optimize front", "contest", "study", "reproduce"}
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


BEGUN_STUDY = "study/settings.json"
"""What says of a folder that a study was begun there."""

WITH_PROCESSES = {"optimize cluster", "contest", "study", "reproduce"}

SMALL_BENCH = """
import os
os.environ["OPENBLAS_NUM_THREADS"] = "1"  # as `run` sets it, before NumPy is loaded
from vinefab.cli.main import run
from vinefab.studies import benchmark
benchmark.SIZES, benchmark.BATCH_SIZES, benchmark.MEMORY_AFTER = (300,), (1,), (100,)
benchmark.SEARCHES, benchmark.GROWTHS, benchmark.BENCH_GENERATIONS = ("cmaes",), 20, 3
benchmark.FIRST_GROWTHS = {"interpreted": ""}
"""
"""The benchmark in seconds: nothing but its sizes is changed."""


def program(*words: object) -> list[str]:
    """Return the words that start a command."""
    how = ["-c", f"{SMALL_BENCH}run()"] if words[0] == "bench" else ["-m", "vinefab"]
    return [sys.executable, *how, *map(str, words)]


def entries(folder: Path, *, hidden: bool) -> set[tuple[str, int]]:
    """Return paths and inodes of what is in a folder; a file that is replaced has a new one."""
    found = set()
    with suppress(FileNotFoundError), os.scandir(folder) as places:
        for place in places:
            if hidden or not place.name.startswith("."):
                found.add((place.path, place.inode()))
                if place.is_dir(follow_symlinks=False):
                    found |= entries(Path(place.path), hidden=hidden)
    return found


class ForkedRun:
    """A run in a copy of this process, which has loaded the command: most of a run is loading."""

    def __init__(self, words: list[str], folder: Path) -> None:
        self.returncode: int | None = None
        self._complaints = tempfile.TemporaryFile("w+")  # noqa: SIM115  read when the run ended
        self.pid = os.fork()
        if self.pid == 0:
            self._be(words, folder)

    def _be(self, words: list[str], folder: Path) -> NoReturn:
        code: object = 99
        try:
            os.setsid()
            os.chdir(folder)
            os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
            os.dup2(self._complaints.fileno(), 2)
            sys.argv = ["vinefab", *words]
            run_program()
        except SystemExit as ended:
            code = ended.code
        finally:
            os._exit(code if isinstance(code, int) else 0)

    def poll(self) -> int | None:
        """Return the exit code, or None before the end."""
        if self.returncode is None:
            ended, status = os.waitpid(self.pid, os.WNOHANG)
            self.returncode = os.waitstatus_to_exitcode(status) if ended else None
        return self.returncode

    def communicate(self, timeout: float = LONGEST_S) -> tuple[str, str]:
        """Wait for the end and return what was said, as a process of `subprocess` does."""
        until_s = time.monotonic() + timeout
        while self.poll() is None:
            if time.monotonic() > until_s:
                raise subprocess.TimeoutExpired("vinefab", timeout)
            time.sleep(POLL_S)
        self._complaints.seek(0)
        return "", self._complaints.read()


@dataclass
class Watch:
    """When a run writes, by looking at its folder again and again."""

    folder: Path
    process: "subprocess.Popen[str] | ForkedRun"

    def await_change(self, *, hidden: bool) -> bool:
        """Wait for the first file that comes or goes; tell whether one did before the end."""
        before = entries(self.folder, hidden=hidden)
        while self.process.poll() is None:
            if entries(self.folder, hidden=hidden) != before:
                return True
            time.sleep(POLL_S)
        return False

    def spans_s(self) -> dict[str, float]:
        """Watch a run to its end; return how long each phase lasts, to its last change."""
        began_s = time.monotonic()
        first_s: dict[str, float] = {}
        before = {kind: entries(self.folder, hidden=kind) for kind in (True, False)}
        seen, last_s = before[True], began_s
        while self.process.poll() is None:
            now, now_s = entries(self.folder, hidden=True), time.monotonic()
            if now != seen:
                seen, last_s = now, now_s
                first_s.setdefault(WRITING, now_s)
                if entries(self.folder, hidden=False) != before[False]:
                    first_s.setdefault(REPLACING, now_s)
            time.sleep(POLL_S)
        spans_s = {phase: last_s - since_s for phase, since_s in first_s.items()}
        return {ANY: time.monotonic() - began_s, **spans_s}


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
        photo = Image.new("RGB", (320, 320), (180, 180, 176))
        photo.paste((214, 88, 40), (147, 240, 173, 300 + n))
        photo.save(folder / f"photo{n}.png")
        seen = f"observe photo{n}.png --map grid.geojson --design plain{n}.toml --json seen{n}.json"
        corners = "--corners 10,310,310,310,310,10,10,10"
        subprocess.run(program(*seen.split(), *corners.split(), "-q"), cwd=folder, check=True)
        floor = Image.new("RGB", (160, 120), (200, 200, 196))
        floor.paste((20, 20, 20), (60, 40, 80 + n, 70))
        floor.save(folder / f"floor{n}.png")
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
    phases: Counter[str] = field(default_factory=Counter)
    endings: Counter[str] = field(default_factory=Counter)  # exit codes of runs that were struck
    spans_s: dict[str, float] = field(default_factory=dict)  # how long each phase lasts
    middle: int = 0  # blows that left something hidden, or a mark
    losses: list[str] = field(default_factory=list)
    hidden: set[str] = field(default_factory=set)  # hidden files and marks that SIGKILL left
    longest_end_s: float = 0.0  # from a signal to the end

    def words(self, n: int) -> list[str]:
        """Return the command line of one of the two versions."""
        recipe = ("co2_60w__stretchlon_200", "co2_60w__tpu_nylon_70d")[n - 1]
        return COMMAND_LINES[self.name].format(n=n, recipe=recipe).split()

    def begin(self) -> None:
        """Run both versions, put files of a user beside what they wrote, and note all content."""
        inputs = set(files_in(self.folder))
        self.whole: dict[str, set[str]] = {}
        self.codes: dict[int, int] = {}
        for n in (2, 1):
            process = self.start(n)
            for phase, span_s in Watch(self.folder, process).spans_s().items():
                self.spans_s[phase] = max(span_s, self.spans_s.get(phase, 0.0))
            words = process.communicate()[1]
            self.codes[n] = process.returncode
            assert process.returncode in (0, 1), (self.name, words)
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

    def start(self, n: int) -> "subprocess.Popen[str]":
        """Start a version, in a group of processes of its own."""
        return subprocess.Popen(
            program(*self.words(n)),
            cwd=self.folder,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            start_new_session=True,
        )

    def load(self) -> None:
        """Run a version in this process, so that its copies need not load it."""
        exec(SMALL_BENCH)  # noqa: S102  sizes of the benchmark
        os.chdir(self.folder)
        with redirect_stdout(io.StringIO()), redirect_stderr(io.StringIO()):
            assert run_command(self.words(1)) == self.codes[1]

    def strike(self, n: int) -> None:
        """Run a version, stop it at a random moment, and look at what is left."""
        if self.name in RECORDS:
            self.begin_again()
        number, phase = self.rng.choice(SIGNALS), self.rng.choice(PHASES)
        delay_s = self.rng.uniform(0.0, 1.02 * self.spans_s.get(phase, 0.1))
        whole = phase == ANY or self.name in WITH_PROCESSES
        process = self.start(n) if whole else ForkedRun(self.words(n), self.folder)
        if phase != ANY:
            Watch(self.folder, process).await_change(hidden=phase == WRITING)
        try:
            process.communicate(timeout=delay_s)
            self.blows["too late"] += 1
            if phase == ANY:
                self.spans_s[ANY] *= 0.9  # the computer may have been busy before
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, number)
            self.await_end(process, number)
            met = process.returncode not in self.codes.values()
            self.blows[number.name if met else "too late"] += 1
            self.phases[phase] += met
        self.look(f"{number.name} {delay_s:.3f} s into {phase}")

    def begin_again(self) -> None:
        """Remove a record, sometimes: else every blow would meet a run that is complete."""
        if self.rng.random() < 0.7:
            # Without its settings, a study takes a folder with a user's files for another's.
            for name in sorted(self.outputs - {BEGUN_STUDY}):
                (self.folder / name).unlink(missing_ok=True)

    def await_end(
        self, process: "subprocess.Popen[str] | ForkedRun", number: signal.Signals
    ) -> None:
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
        code = process.returncode
        self.endings[str(code)] += 1
        if code not in (-number, 128 + number, *self.codes.values()):
            self.losses.append(f"{number.name}: ends with {code}: {words[-300:]}")
        if number is not signal.SIGKILL and "Traceback" in words and "error: " in words:
            self.losses.append(f"{number.name}: a traceback: {words[-300:]}")

    def look(self, when: str) -> None:
        """Check that nothing is lost or half written."""
        now = files_in(self.folder)
        gone = [name for name, digest in self.theirs.items() if now.get(name) != digest]
        self.losses += [f"{when}: the user's {name} is changed or gone" for name in gone]
        hidden = [name for name in now if any(part[0] == "." for part in name.split("/"))]
        hidden += [name for name in now if name.endswith(INCOMPLETE_NAME)]
        self.middle += not self.hidden.issuperset(hidden)
        self.hidden = set(hidden)
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
        process = self.start(n)
        words = process.communicate(timeout=LONGEST_S)[1]
        if process.returncode != self.codes[n]:
            problem = f"the next run ends with {process.returncode}: {words[-300:]}"
            self.losses.append(problem)
        self.look("the next run")

    def do(self, count: int) -> "Campaign":
        """Strike so often."""
        self.begin()
        if self.name not in WITH_PROCESSES:
            self.load()
        while self.blows.total() - self.blows["too late"] < count and not self.losses:
            if self.blows["too late"] > 3 * count:
                break
            self.strike(self.rng.choice((1, 2)))
            if self.blows.total() % UNDISTURBED_EVERY == 0:
                self.go_on(1)
        self.go_on(2)
        return self

    def line(self) -> str:
        """Return a line of the table."""
        struck = [f"{self.blows[number]:4}" for number in dict.fromkeys(s.name for s in SIGNALS)]
        phases = "/".join(str(self.phases[phase]) for phase in dict.fromkeys(PHASES))
        spans = "/".join(f"{self.spans_s.get(phase, 0.0):.2f}" for phase in dict.fromkeys(PHASES))
        codes = " ".join(f"{code}:{count}" for code, count in sorted(self.endings.items()))
        kept = "all kept" if not self.losses else "LOST"
        return (
            f"{self.name:17}{''.join(struck)}   {kept:8} {phases:>8} of {spans:>17} s  "
            f"middle {self.middle:2}  ends in {self.longest_end_s:4.1f} s  codes {codes}"
        )


def show(line: str) -> None:
    """Print a line at once."""
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()


def campaign_line(name: str, inputs: Path, count: int, seed: int) -> tuple[str, bool]:
    """Strike a command in this process; return its part of the table, and whether all was kept."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place) / "work"
        shutil.copytree(inputs, folder)
        rng = random.Random(f"{seed} {name}")  # noqa: S311
        done = Campaign(name, folder, rng).do(count)
        os.chdir(inputs)
    return "\n    ".join([done.line(), *done.losses]), not done.losses


def main() -> int:
    """Strike every command, each from a process of its own, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int, nargs="?", default=20)
    parser.add_argument("names", nargs="*", help="Some of the commands; default: all.")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--inputs", type=Path, help="Strike one command, in this process.")
    given = parser.parse_intermixed_args()
    for number in set(SIGNALS) - {signal.SIGKILL}:
        # Begun in the background of a shell or under nohup, the commands would ignore them.
        signal.signal(number, signal.SIG_DFL)
    if given.inputs:
        line, kept = campaign_line(given.names[0], given.inputs, given.count, given.seed)
        show(line)
        return 0 if kept else 1
    covered = {command_for(line.split())[0].split()[0] for line in COMMAND_LINES.values()}
    known = {name.split()[0] for name in VERBS} - WRITES_NOTHING
    assert covered == known, covered ^ known
    show("command          KILL INT TERM HUP         any/writing/replacing, and how long each is")
    failed = 0
    with tempfile.TemporaryDirectory() as inputs, ThreadPoolExecutor(given.jobs) as pool:
        prepare_inputs(Path(inputs))
        how = [sys.executable, __file__, "--seed", str(given.seed), "--inputs", inputs]

        def campaign(name: str) -> "subprocess.CompletedProcess[str]":
            words = [*how, str(given.count), name]
            return subprocess.run(words, capture_output=True, text=True, check=False)

        begun = [pool.submit(campaign, name) for name in given.names or COMMAND_LINES]
        for done in (future.result() for future in as_completed(begun)):
            show((done.stdout + done.stderr).rstrip())
            failed += done.returncode != 0
    show(f"{failed} commands lost something")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
