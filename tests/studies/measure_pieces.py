"""What pieces bring back: ``python tests/studies/measure_pieces.py OUT [SEEDS]``, ten by default.

The same search four times for every seed, task and environment: free, one flat outline, at most
three and at most six pieces. The robots are those of ``examples/contest/bench*.toml``; anchors have
the build and the space of ``examples/six_branch_anchor.toml``. Each run is one file in OUT, and
what is there is not done again; seed by seed, so that a campaign cut short is balanced. The tables
are printed at the end; with 0 seeds, those of what is there.
"""

import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from vinefab.core.atomic import write_text
from vinefab.core.plain_text import json_text
from vinefab.core.rng import child
from vinefab.core.validation import Floats
from vinefab.fabrication.checking import check_design
from vinefab.fabrication.pieces.partition import partition_of
from vinefab.model.design import Design, PieceSettings, design_text
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.laser import read_profile
from vinefab.search.run import Search, fresh_maps, generated_maps, penalty_of
from vinefab.search.settings import PartSettings, RunSettings, read_run
from vinefab.studies.optimizer_contest import FIRST_CONTEST_SEED
from vinefab.tasks import make_task
from vinefab.tasks.evaluate import PreparedMap, poses_on, score_design

EXAMPLES = Path(__file__).parents[2] / "examples"
UNSEEN, POSES = 100, 1
HOMES = ("grid", "cave")
TASKS = ("coverage", "reach", "anchoring")
CONDITIONS = {"free": 0, "one outline": 1, "at most 3": 3, "at most 6": 6}
"""The most pieces; 0: none of the rules of manufacturing counts."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PieceRun:
    """One search and the test of its winner."""

    home: str
    task: str
    condition: str
    number: int  # of the seed, from 0

    @property
    def file(self) -> str:
        """Name of the run's file."""
        return f"{self.number:02d}_{self.home}_{self.task}_{CONDITIONS[self.condition]}.json"

    def settings(self) -> RunSettings:
        """Return the run."""
        run = read_run(EXAMPLES / "contest" / "bench.toml")
        if self.task == "anchoring":
            anchor = read_run(EXAMPLES / "six_branch_anchor.toml")
            run = run.changed(space=anchor.space, build=anchor.build, growth=anchor.growth)
        most = CONDITIONS[self.condition]
        if most == 0:
            evaluation = run.evaluation.changed(fabricable=False)
            run = run.changed(evaluation=evaluation, optimizer=PartSettings(name="cmaes"))
        if most > 1:
            run = run.changed(build=run.build.changed(pieces=PieceSettings(most=most)))
        first = run.maps.seed + self.number * run.maps.count
        return run.changed(
            name=f"{self.task}_{self.home}",
            maps=run.maps.changed(environment=self.home, seed=first),
            task=PartSettings(name=self.task),
            search=run.search.changed(seed=run.search.seed + self.number),
        )

    def done(self) -> dict[str, object]:
        """Search, test the winner on unseen maps, and return what its file holds."""
        began_s, settings = time.process_time(), self.settings()
        maps, fresh = generated_maps(settings.maps), fresh_maps(settings)
        result = Search.of(settings, maps, penalty_of(settings), fresh_maps=fresh).run()
        tests = settings.maps.changed(seed=FIRST_CONTEST_SEED, count=UNSEEN)
        sites = tuple(PreparedMap.of(world) for world in generated_maps(tests))
        poses = poses_on(sites, POSES, range(UNSEEN))
        task = make_task(settings.task.name, settings.task.parameters)
        score = score_design(result.best, sites, poses, task, settings.growth)
        return {
            "unseen": score.composite["mean"],
            "fresh": result.score.composite["mean"],
            "penalty": result.finalists[0].penalty,
            "evaluations": result.evaluations,
            "branches": result.best.branch_count,
            "design": design_text(result.best),
            "cpu_s": time.process_time() - began_s,
        }


def piece_runs(seeds: int, only: str = "") -> Iterator[PieceRun]:
    """Yield all runs, seed by seed."""
    for number, task, home, condition in product(range(seeds), TASKS, HOMES, CONDITIONS):
        run = PieceRun(home=home, task=task, condition=condition, number=number)
        if only in run.file:
            yield run


Rows = dict[str, Floats]
"""Scores of the same seeds by condition, shape (seeds,) each."""


def found_in(folder: Path, home: str, task: str) -> dict[str, list[dict[str, object]]]:
    """Return what the runs of a problem found, for the seeds that every condition has."""
    runs = {
        condition: PieceRun(home=home, task=task, condition=condition, number=0)
        for condition in CONDITIONS
    }
    numbers = [
        number
        for number in range(1000)
        if all((folder / replace(run, number=number).file).exists() for run in runs.values())
    ]
    return {
        condition: [json.loads((folder / replace(run, number=n).file).read_text()) for n in numbers]
        for condition, run in runs.items()
    }


def with_interval(values: dict[str, Floats], statistic: Callable[[Rows], float]) -> str:
    """Return a statistic with its 95 % bootstrap interval over seeds, as text."""
    count = len(next(iter(values.values())))
    draws = child(0, 1801).integers(0, count, (10_000, count))
    found = [statistic({name: of[draw] for name, of in values.items()}) for draw in draws]
    low, high = np.nanpercentile(found, [2.5, 97.5])
    return f"{statistic(values):.3f} [{low:.3f}, {high:.3f}]"


def table(folder: Path) -> Iterator[str]:
    """Yield the lines of the table."""
    for task, home in product(TASKS, HOMES):
        found = found_in(folder, home, task)
        scores = {name: np.array([run["unseen"] for run in of]) for name, of in found.items()}
        seeds = len(scores["free"])
        if seeds == 0:
            continue
        yield f"{task}, {home}: {seeds} seeds"
        for name, runs in found.items():
            cells = [with_interval(scores, lambda of, name=name: float(of[name].mean()))]
            if CONDITIONS[name] > 1:
                cells.append(
                    "regained " + with_interval(scores, lambda of, n=name: regained(of, n))
                )
            cells.append("branches " + " ".join(str(run["branches"]) for run in runs))
            if CONDITIONS[name] > 0:
                cells.append(making_text([str(run["design"]) for run in runs]))
            yield f"  {name:12} " + " | ".join(cells)


def regained(scores: Rows, name: str) -> float:
    """Return the share of what one outline loses that comes back with pieces."""
    lost = float(scores["free"].mean() - scores["one outline"].mean())
    return float(scores[name].mean() - scores["one outline"].mean()) / lost if lost else np.nan


def making_text(texts: Sequence[str]) -> str:
    """Return the pieces of some designs, and how many pass the check."""
    profile, counts, passing = read_profile(DEFAULT_RECIPE), [], 0
    with TemporaryDirectory() as folder:
        path = Path(folder) / "winner.toml"
        for text in texts:
            path.write_text(text)
            design = Design.read(path)
            counts.append(len(partition_of(design, profile).pieces))
            passing += not check_design(design, profile).blocking
    return f"pieces {' '.join(map(str, counts))} | {passing} of {len(texts)} pass"


def main(folder: Path, seeds: int, only: str) -> None:
    """Do the runs that are missing, and print the table."""
    for run in piece_runs(seeds, only):
        path = folder / run.file
        if not path.exists():
            done = run.done()
            write_text(path, json_text("vinefab/pieces-run-1", done))
            sys.stdout.write(f"{run.file}: {done['unseen']:.3f}, {done['cpu_s']:.0f} s\n")
            sys.stdout.flush()
    sys.stdout.write("\n".join([*table(folder), ""]))


if __name__ == "__main__":
    main(Path(sys.argv[1]), int((*sys.argv, 10)[2]), (*sys.argv, "", "")[3])
