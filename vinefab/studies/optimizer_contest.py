"""Optimizers against each other on the same problems, at equal numbers of evaluations."""

import json
import os
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Annotated

import numpy as np
from numpy.typing import ArrayLike

from vinefab.core.atomic import ensure_writable, folder_to_fill, is_ours
from vinefab.core.codec import IF_KNOWN, MaybeNan, Record
from vinefab.core.errors import BadInputError, UnreadableFileError, located
from vinefab.core.hashing import fingerprint
from vinefab.core.plain_text import GENERATOR, counted, json_text
from vinefab.core.progress import phase
from vinefab.core.statistics import LEVEL, SIGNIFICANT, mean_interval, mean_p
from vinefab.core.validation import Floats, whole
from vinefab.core.view import Block, Number, Rows, Value, p_value
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.model.design import Design
from vinefab.model.files.run_context import package_versions
from vinefab.pages.page_files import page_svg
from vinefab.pages.panel import Ink, Page, Panel, ends_of, jitter, page_of_rows, series_colour
from vinefab.search.optimizers.optimizer import OptimizerConfig
from vinefab.search.record.generations import RunIdentity
from vinefab.search.run import Search, fresh_maps, penalty_of, training_maps
from vinefab.search.settings import (
    MapSettings,
    PartSettings,
    RunSettings,
    has_own_targets,
    plain_settings,
)
from vinefab.studies.workers import WorkerProcesses
from vinefab.tasks import make_task
from vinefab.tasks.evaluate import PreparedMap, poses_on, score_design

FIRST_CONTEST_SEED = 500_001
"""Seed of the first map for testing; runs train on maps with much smaller seeds."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Contender:
    """An optimizer with parameters."""

    label: str  # what tables call it
    part: PartSettings  # name and parameters
    own: OptimizerConfig | None = None  # one of the caller's in place of it; runs in this process


@dataclass(frozen=True, slots=True, kw_only=True)
class Contest:
    """The protocol of a comparison."""

    # runs with generated maps; their optimizer and seeds are replaced
    problems: tuple[RunSettings, ...]
    contenders: tuple[Contender, ...]  # the first is what the others are compared with
    # runs of each contender on each problem. With the same number, all contenders search with the
    # same seed on the same maps and meet the same poses; every number has its own maps.
    seeds: int = 10
    # unseen, poses: maps that no run has trained on, and poses on each, to test every winner on
    unseen: int = 25
    poses: int = 3
    sources: tuple[Path, ...] = ()  # the problems' files, for errors; may be left out

    def __post_init__(self) -> None:
        whole("--seeds", self.seeds, 1, 1000)
        whole("--unseen", self.unseen, 1, 10_000)
        whole("--poses", self.poses, 1, 1000)
        for key, names in (
            ("RUN.toml", [problem.name for problem in self.problems]),
            ("--optimizer", [contender.label for contender in self.contenders]),
        ):
            if not names or len(set(names)) < len(names):
                raise BadInputError(key, names, "at least one, each once")
        for problem in self.problems:
            if problem.maps.files:
                allowed = f"generated maps, in the comparison of {problem.name}"
                raise BadInputError("maps.files", [str(f) for f in problem.maps.files], allowed)

    def runs(self) -> list["ContestRun"]:
        """Return every run, problem by problem, so that early results compare all contenders."""
        return [
            ContestRun.of(problem, contender, number, self)
            for number in range(self.seeds)
            for problem in self.problems
            for contender in self.contenders
        ]


@dataclass(frozen=True, slots=True, kw_only=True)
class ContestRun:
    """One run of a comparison."""

    # contender, number: who, and which of its seeds
    contender: str
    number: int
    settings: RunSettings  # the run
    # unseen, poses: as in `Contest`
    unseen: int
    poses: int
    own: OptimizerConfig | None = None  # as in `Contender`

    @classmethod
    def of(
        cls, problem: RunSettings, contender: Contender, number: int, contest: Contest
    ) -> "ContestRun":
        """Return a contender's run on a problem."""
        maps = problem.maps.changed(seed=problem.maps.seed + number * problem.maps.count)
        if maps.seed + maps.count > FIRST_CONTEST_SEED:
            raise BadInputError(
                "maps.seed", maps.seed, f"less than {FIRST_CONTEST_SEED - maps.count}"
            )
        search = problem.search.changed(seed=problem.search.seed + number)
        settings = problem.changed(maps=maps, search=search, optimizer=contender.part)
        return cls(
            contender=contender.label,
            number=number,
            settings=settings,
            unseen=contest.unseen,
            poses=contest.poses,
            own=contender.own,
        )

    @property
    def key(self) -> str:
        """Its fingerprint, the same in every session."""
        identity = RunIdentity.of(self.settings, ())
        return fingerprint(identity.run_id, self.contender, self.unseen, self.poses)


@dataclass(frozen=True, slots=True, kw_only=True)
class ContestRow(Record):
    """The outcome of one run."""

    key: str  # fingerprint of the run
    # problem, contender, number: what it was
    problem: str
    contender: str
    number: int
    unseen: float  # the winner's composite on unseen maps: what counts
    fresh: float  # the same on fresh poses on the training maps, by which the winner was chosen
    lucky: float  # the best fitness that the search ever saw
    penalty: float  # the winner's; 0 when manufacturable, or not checked (`fabricable = false`)
    evaluations: int  # designs evaluated by the search
    # optimizer_s, total_s: time of asking and telling, and of everything
    optimizer_s: float
    total_s: float


def run_contest(contest_run: ContestRun) -> ContestRow:
    """Do one run of a comparison."""
    began_s = time.perf_counter()
    settings = contest_run.settings
    result = _search(settings, contest_run.own).run()
    weighed = settings.evaluation.composite
    return ContestRow(
        key=contest_run.key,
        problem=settings.name,
        contender=contest_run.contender,
        number=contest_run.number,
        unseen=unseen_score(result.best, settings, contest_run.unseen, contest_run.poses),
        fresh=result.score.composite[weighed],
        lucky=max(generation.best for generation in result.history),
        penalty=result.finalists[0].penalty,
        evaluations=result.evaluations,
        optimizer_s=result.times.optimizer_s,
        total_s=time.perf_counter() - began_s,
    )


def unseen_score(design: Design, settings: RunSettings, unseen: int, poses: int) -> float:
    """Return a design's composite on maps that no run trains on.

    A task with targets is tested on the run's maps, from poses that it has not seen.
    """
    if has_own_targets(settings):
        sites = tuple(map(PreparedMap.of, training_maps(settings)))
        drawn = poses_on(sites, unseen * poses, [FIRST_CONTEST_SEED] * len(sites))
    else:
        sites = unseen_sites(settings.maps, unseen)
        drawn = poses_on(sites, poses, range(unseen))
    task = make_task(settings.task.name, settings.task.parameters)
    score = score_design(design, sites, drawn, task, settings.growth)
    return float(score.composite[settings.evaluation.composite])


def unseen_sites(maps: MapSettings, count: int) -> tuple[PreparedMap, ...]:
    """Return the maps of an environment that winners are tested on."""
    return _unseen_sites(maps.environment, json.dumps(dict(maps.options)), count)


@lru_cache(maxsize=4)
def _unseen_sites(environment: str, options: str, count: int) -> tuple[PreparedMap, ...]:
    settings = MapSettings(environment=environment, options=json.loads(options))
    made = settings.environment_options()
    make = ENVIRONMENTS[environment].generate
    return tuple(PreparedMap.of(make(FIRST_CONTEST_SEED + index, made)) for index in range(count))


def contest_rows(
    contest: Contest,
    record: Path,
    *,
    jobs: int = 1,
    force: bool = False,
) -> list[ContestRow]:
    """Do the runs that a record does not hold yet, and return all of them."""
    # A record that grows has a mark without a digest.
    ensure_writable(record, force=force or (record.is_file() and is_ours(record)))
    known = _recorded(record)
    contest_runs = contest.runs()
    todo = [contest_run for contest_run in contest_runs if contest_run.key not in known]
    # A problem that cannot be run is named with its file before anything is run.
    names = [problem.name for problem in contest.problems]
    sources: dict[str, str | Path] = dict(zip(names, contest.sources or names, strict=True))
    checked = set[tuple[str, str]]()
    for run in todo:
        if (run.settings.name, run.contender) not in checked:
            checked.add((run.settings.name, run.contender))
            with located(sources[run.settings.name]):
                _search(run.settings, run.own)
    total, begun = len(contest_runs), len(contest_runs) - len(todo)
    processes = WorkerProcesses(jobs) if jobs > 1 and len(todo) > 1 else nullcontext()
    with processes as pool, phase("runs", total) as told:
        told.at(begun)
        rows = map(run_contest, todo) if pool is None else pool.map(run_contest, todo)
        for done, row in enumerate(rows, start=begun + 1):
            with folder_to_fill(record.parent), record.open("a", encoding="utf-8") as stream:
                if stream.tell() == 0:
                    stream.write(
                        json.dumps({"schema": "vinefab/bouts-1", "generator": GENERATOR}) + "\n"
                    )
                stream.write(f"{row.as_json}\n")
            known[row.key] = row
            last = f"{row.problem} {row.contender} {row.unseen:.4f}"
            told.at(done, f"the last {last}")
    return [known[contest_run.key] for contest_run in contest_runs]


def _search(settings: RunSettings, own: OptimizerConfig | None = None) -> Search:
    maps, fresh = training_maps(settings), fresh_maps(settings)
    return Search.of(settings, maps, penalty_of(settings), optimizer=own, fresh_maps=fresh)


def _recorded(record: Path) -> dict[str, ContestRow]:
    """Return the rows of a record, and drop a last line that a kill cut off."""
    if not record.exists():
        return {}
    text = record.read_text(encoding="utf-8")
    lines = text.split("\n")
    if lines.pop():
        os.truncate(record, len("".join(f"{line}\n" for line in lines).encode()))
    try:
        rows = [ContestRow.of_json(line) for line in lines[1:]]
    except ValueError:
        raise UnreadableFileError(record, "is not a record of a comparison") from None
    return {row.key: row for row in rows}


def comparison_json(contest: Contest, rows: Sequence[ContestRow]) -> str:
    """Return a comparison as JSON: ``vinefab/comparison-1``."""
    content = {
        "seeds": contest.seeds,
        "unseen_maps": contest.unseen,
        "poses_per_unseen_map": contest.poses,
        "reference": contest.contenders[0].label,
        "problems": {problem.name: plain_settings(problem) for problem in contest.problems},
        "table": [entry.content for entry in comparison_table(contest, rows)],
        "runs": [row.content for row in rows],
        "versions": package_versions(),
    }
    return json_text("vinefab/comparison-1", content)


@dataclass(frozen=True, slots=True, kw_only=True)
class SeedMean:
    """A mean over seeds with its 95 % interval; NaN where there is none."""

    mean: float
    low: MaybeNan
    high: MaybeNan

    @classmethod
    def of(cls, values: Floats) -> "SeedMean":
        """Return the mean of scores: means over many maps are nearly normal."""
        low, high = mean_interval(values, LEVEL, tails=0.0)
        return cls(mean=float(values.mean()), low=low, high=high)


@dataclass(frozen=True, slots=True, kw_only=True)
class SeedDifference(SeedMean):
    """A mean difference over seeds, adjusted for the number of contenders; only p is not."""

    p: float  # two-sided, of no difference; 1 where there is none, or one pair only
    p_adjusted: float

    @classmethod
    def between(cls, one: Floats, other: Floats, contenders: int) -> "SeedDifference":
        """Return the difference of scores, paired by seed."""
        values = one - other
        low, high = mean_interval(values, 1.0 - SIGNIFICANT / contenders, tails=0.0)
        p = mean_p(values, tails=0.0) if len(values) > 1 else 1.0
        return cls(
            mean=float(values.mean()), low=low, high=high, p=p, p_adjusted=min(1.0, contenders * p)
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ContestEntry(Record):
    """A contender on a problem, or on all of them together; means over seeds."""

    problem: str
    optimizer: str
    unseen: SeedMean  # score of the winners on unseen maps
    fresh: float
    lucky: float
    evaluations: float
    optimizer_s: float
    can_be_made: float  # share of the winners
    difference: Annotated[SeedDifference | None, IF_KNOWN] = None  # None of the first contender

    def cells(self, over: str) -> tuple[Value, ...]:
        """Return the entry as a row."""
        number, unseen, more = partial(Number, over=over), self.unseen, self.difference
        score = number(unseen.mean, form=".4f", interval=(unseen.low, unseen.high))
        above: tuple[Value, Value] = ("", "")
        if more is not None:
            ends = more.low, more.high
            above = number(more.mean, form="+.4f", interval=ends), p_value(more.p_adjusted)
        return self.problem, self.optimizer, score, *above


def comparison_table(contest: Contest, rows: Sequence[ContestRow]) -> list[ContestEntry]:
    """Return one entry per problem and contender, and over all problems together.

    Scores are those of the winners on unseen maps. ``difference`` is to the first contender,
    paired by seed; interval and p-value are those of one t test over seeds, both corrected for the
    number of contenders (Bonferroni): ``p_adjusted`` is below 0.05 where the interval leaves out 0.
    """
    names = [problem.name for problem in contest.problems]
    table = []
    for problem in names:
        scores = [_scores(rows, problem, c.label) for c in contest.contenders]
        table += _block(contest, problem, scores, rows)
    if len(names) > 1:
        scores = [
            np.mean([_scores(rows, problem, c.label) for problem in names], axis=0)
            for c in contest.contenders
        ]
        table += _block(contest, "all", scores, rows)
    return table


def _scores(rows: Sequence[ContestRow], problem: str, label: str) -> Floats:
    return np.array([r.unseen for r in rows if (r.problem, r.contender) == (problem, label)])


def _block(
    contest: Contest, problem: str, scores: Sequence[Floats], rows: Sequence[ContestRow]
) -> list[ContestEntry]:
    block, others = [], max(1, len(scores) - 1)
    for place, (contender, values) in enumerate(zip(contest.contenders, scores, strict=True)):
        mine = [r for r in rows if r.contender == contender.label and problem in (r.problem, "all")]
        block.append(
            ContestEntry(
                problem=problem,
                optimizer=contender.label,
                unseen=SeedMean.of(values),
                fresh=float(np.mean([r.fresh for r in mine])),
                lucky=float(np.mean([r.lucky for r in mine])),
                evaluations=float(np.mean([r.evaluations for r in mine])),
                optimizer_s=float(np.mean([r.optimizer_s for r in mine])),
                can_be_made=float(np.mean([r.penalty == 0.0 for r in mine])),
                difference=SeedDifference.between(values, scores[0], others) if place else None,
            )
        )
    return block


def comparison_blocks(contest: Contest, rows: Sequence[ContestRow]) -> Iterator[Block]:
    """Yield the table of a comparison, and whether there are too few seeds."""
    maps, seeds = counted(contest.unseen, "unseen map"), counted(contest.seeds, "seed")
    yield Rows(
        caption=f"mean score of {seeds} on {maps} each (simulated) [95 % interval]; differences "
        "are paired by seed, p of the paired t test, both adjusted for the number of contenders",
        headings=(
            "problem",
            "optimizer",
            "score",
            f"difference to {contest.contenders[0].label}",
            "p",
        ),
        rows=tuple(entry.cells(seeds) for entry in comparison_table(contest, rows)),
    )


def comparison_svg(contest: Contest, rows: Sequence[ContestRow]) -> bytes:
    """Return every winner's score on unseen maps as a dot, a panel per problem."""
    panels = {
        problem.name: {c.label: _scores(rows, problem.name, c.label) for c in contest.contenders}
        for problem in contest.problems
    }
    return page_svg(panels_of_strips(panels, "score on unseen maps (simulated)"))


def panels_of_strips(panels: Mapping[str, Mapping[str, ArrayLike]], label: str) -> Page:
    """Return every score of every group as a dot, with the group's mean; a panel per problem.

    Parameters
    ----------
    panels
        By problem, scores by group, each shape (n,).
    """
    rows = []
    for title, scores in panels.items():
        columns = [np.asarray(group, dtype=float) for group in scores.values()]
        x0, x1 = ends_of(*columns)
        panel = Panel(
            box=(x0, len(columns) - 0.4, x1, -0.6),
            width_pt=360.0,
            height_pt=23.0 * max(2, len(columns)),
            title=title,
            frame=True,
            y_ticks=[(row, name) for row, name in enumerate(scores)],
        )
        for row, values in enumerate(columns):
            colour = series_colour(row)
            dots = np.column_stack([values, row + 0.18 * jitter(len(values))])
            panel.marks(dots, "o", 4.0, Ink(fill=colour, fill_alpha=0.55))
            mean = values.mean()
            panel.line([(mean, row - 0.32), (mean, row + 0.32)], Ink(line=colour, width_pt=2.0))
        rows.append([panel])
    rows[-1][0].x_name = f"{label}; bars: means"
    return page_of_rows(rows)
