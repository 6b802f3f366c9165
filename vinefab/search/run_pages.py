"""Runs on pages: the live page, the listing of records, a report's section, and the front."""

import os
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType

import numpy as np
from numpy.typing import ArrayLike

from vinefab.core.atomic import write_files, write_text
from vinefab.core.errors import (
    BadInputError,
    CannotWriteError,
    ForeignFileError,
    InterruptedRunError,
    UnfitInputError,
    UnreadableFileError,
)
from vinefab.core.plain_text import counted
from vinefab.core.progress import Progress
from vinefab.core.validation import Floats
from vinefab.core.view import (
    Answer,
    Block,
    Code,
    Data,
    Fact,
    Facts,
    Notes,
    Number,
    Picture,
    Remark,
    Result,
    Rows,
    Section,
    Text,
    Value,
)
from vinefab.growth.batch import grow_on
from vinefab.growth.terrain import Terrain
from vinefab.model.design import Design, design_text
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.map import Map
from vinefab.pages.html import Live, page
from vinefab.pages.page_files import page_svg
from vinefab.pages.panel import (
    LEVEL_COLOURS,
    Ink,
    Page,
    Panel,
    ends_of,
    page_of,
)
from vinefab.pages.plan import deployment_plan, map_plan
from vinefab.search.evaluator import INVALID_FITNESS
from vinefab.search.free_space import space_of
from vinefab.search.manufacturability import ManufacturabilityPenalty, run_profile
from vinefab.search.record.generations import Generation, SearchProgress, curve_of
from vinefab.search.record.result import (
    RECORD_FILE,
    RunArchive,
    RunResult,
    RunSummary,
    damage_errors,
    records_in,
    size_words,
)
from vinefab.search.run import first_map
from vinefab.search.settings import RunSettings, run_task
from vinefab.tasks.reach import task_targets, touched_targets


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class RunListing(Result):
    """The records of runs below some folders.

    Parameters
    ----------
    rows
        The summary of each: its ``folder``, ``name``, ``seed``, ``winner_score`` and others.
    broken
        One line for each that is unreadable.
    whole
        Whether all runs have ended whose best winner was written.
    """

    rows: tuple[RunSummary, ...]
    broken: tuple[str, ...]
    whole: bool = True

    schema = "vinefab/runs-1"

    def view(self) -> Iterator[Block]:
        """Yield the runs, those that differ in their seed alone together, and broken records."""
        yield Rows(
            caption=counted(len(self.rows), "run"),
            headings=("folder", "run", "generations", "best fitness", "winner on fresh poses", ""),
            rows=tuple(
                (
                    row.folder,
                    f"{row.name} ({row.optimizer}, seed {row.seed}, run {row.run})",
                    f"{row.generations}/{row.most_generations}",
                    Number(row.best_fitness, form=".4f"),
                    Number(row.winner_mean, form=".4f"),
                    f"stopped by {row.stopped}" if row.stopped else "can be resumed",
                )
                for row in self.rows
            ),
        )
        yield from (Remark(f"unreadable: {line}", "warning") for line in self.broken)
        yield Rows(
            caption="runs that differ in their seed alone: winners' mean scores (simulated, each "
            "on its own fresh poses on the training maps); the best of several is partly luck: "
            "compare winners on unseen maps with vinefab compare",
            headings=("run", "optimizer", "seeds ended", "mean", "standard deviation", "lowest",
                      "highest", "manufacturable", "best", "its folder"),
            rows=tuple(summary.cells for summary in self.seeds),
            key="seeds",
            keys=("name", "optimizer", "", "mean", "deviation", "lowest", "highest",
                  "manufacturable", "", ""),
            data=tuple(
                {
                    "seeds": sorted(row.seed for row in summary.ended),
                    "unended": summary.unended,
                    "best": summary.best and summary.best.folder,
                    "best_seed": summary.best and summary.best.seed,
                }
                for summary in self.seeds
            ),
        )  # fmt: skip
        yield Data({"runs": [row.content for row in self.rows], "broken": list(self.broken)})

    @property
    def exit_code(self) -> int:
        """The exit code of the command: 1 where runs miss, or none can be read."""
        return int(not self.whole or bool(self.broken and not self.rows))

    @property
    def seeds(self) -> tuple["SeedSummary", ...]:
        """The runs that differ in their seed alone, of which there are several, together."""
        alike: dict[str, list[RunSummary]] = {}
        for row in self.rows:
            alike.setdefault(row.seedless_run, []).append(row)
        return tuple(SeedSummary.of(rows) for rows in alike.values() if len(rows) > 1)


@dataclass(frozen=True, slots=True, kw_only=True)
class SeedSummary:
    """Runs that differ in their seed alone."""

    name: str
    optimizer: str
    unended: tuple[str, ...]  # folders of runs that have not ended
    # of the runs that have ended, one per seed, best winner first, as in `RunListing.rows`
    ended: tuple[RunSummary, ...]

    @classmethod
    def of(cls, rows: Sequence[RunSummary]) -> "SeedSummary":
        """Return the summary of some runs, at least one."""
        # A run that lies in two folders is one run.
        ended = {row.seed: row for row in rows if row.winner_fitness is not None}
        by_seed = [ended[seed] for seed in sorted(ended)]
        return cls(
            name=rows[0].name,
            optimizer=rows[0].optimizer,
            unended=tuple(r.folder for r in rows if r.seed not in ended),
            ended=tuple(sorted(by_seed, key=lambda row: row.rank, reverse=True)),
        )

    @property
    def scores(self) -> Floats:
        """Mean score of each winner on its fresh poses, best winner first."""
        return np.array([row.winner_mean for row in self.ended], dtype=np.float64)

    @property
    def deviation(self) -> float | None:
        """Standard deviation of the scores over seeds; None for a single one."""
        return float(self.scores.std(ddof=1)) if len(self.ended) > 1 else None

    @property
    def manufacturable(self) -> int | None:
        """Number of manufacturable winners; None where none was asked for."""
        known = [row.manufacturable for row in self.ended]
        return None if None in known else sum(map(bool, known))

    @property
    def cells(self) -> tuple[Value, ...]:
        """The summary as a row: names, seeds, scores, how many manufacturable, the best."""
        ended, waiting = len(self.ended), len(self.unended)
        scores, best = self.scores, self.best
        ends = (scores.mean(), scores.min(), scores.max()) if ended else (None, None, None)
        mean, lowest, highest = (
            Number(None if value is None else float(value), form=".4f") for value in ends
        )
        return (
            self.name,
            self.optimizer,
            f"{ended} of {ended + waiting}",
            mean,
            Number(self.deviation, form=".4f"),
            lowest,
            highest,
            Number(self.manufacturable, form="d"),
            "-" if best is None else f"seed {best.seed}",
            "-" if best is None else best.folder,
        )

    @property
    def best(self) -> RunSummary | None:
        """The run with the best winner."""
        return self.ended[0] if self.ended else None


def list_runs(folders: Sequence[Path]) -> RunListing:
    """Return the records below folders; one that is unreadable does not hide the others."""
    paths: dict[Path, Path] = {}  # keyed without links: folders may overlap
    for folder in folders:
        below = records_in(folder)
        if not below:
            problem = f"no {RECORD_FILE} is in {folder} or below"
            raise UnfitInputError("DIR", problem, "name the folder of a run")
        for path in below:
            paths.setdefault(Path(os.path.realpath(path)), path)
    rows, broken = [], []
    for path in paths.values():
        try:
            with damage_errors(path):
                row = RunArchive.read(path).summary
                _ = row.as_json  # raises ValueError if a number is not finite
            rows.append(row)
        except UnreadableFileError as error:
            broken.append(str(error))
    return RunListing(rows=tuple(rows), broken=tuple(broken))


def write_best(listing: RunListing, path: Path, *, force: bool = False) -> bool:
    """Write the best winner of runs that differ in their seed alone; return whether all ended."""
    kinds = {row.seedless_run for row in listing.rows}
    if len(kinds) != 1:
        problem = f"these are {counted(len(kinds), 'kind')} of runs"
        remedy = "name folders whose runs differ in their seed alone"
        raise UnfitInputError("--best", problem, remedy)
    summary = SeedSummary.of(listing.rows)
    if not summary.ended:
        raise UnfitInputError("--best", "no run has ended", "wait for one")
    archive = RunArchive.read(Path(summary.ended[0].folder) / RECORD_FILE)
    write_text(path, design_text(archive.result().best), force=force)
    if archive.recipe is not None:
        archive.recipe.write(path.parent)
    return not (summary.unended or listing.broken)


def rebuild(folder: Path, out: Path, *, force: bool = False) -> tuple[Path, ...]:
    """Write the winner and the figures of a run from its record alone."""
    archive = RunArchive.read(folder / RECORD_FILE)
    best = design_text(archive.result().best)
    files = {"best.toml": best.encode()}
    pictures = {"history.svg": page_svg(history_figure(archive.history))}
    for world in archive.maps:
        plan = map_plan(world, targets=task_targets(run_task(archive.settings), world))
        pictures[f"map_{world.name}.svg"] = page_svg(plan)
    written = {out / name: data for name, data in (files | pictures).items()}
    write_files(written, force=force)
    if archive.recipe is not None:
        archive.recipe.write(out)
    return tuple(written)


def history_figure(history: Sequence[Generation]) -> Page:
    """Return the chart of fitness per generation."""
    return fitness_curve(*curve_of(history))


def search_section(result: RunResult, training: Sequence[Map]) -> Section:
    """Return the report's section on a search and its training maps."""
    curve = Picture(
        image=page_svg(history_figure(result.history)),
        caption="Fitness per generation (simulated). New poses are drawn for every generation, so "
        "a best value can be luck: finalists are evaluated again on fresh poses.",
    )
    most_maps_shown = 4  # most training maps that a report shows
    maps = tuple(
        Picture(
            image=page_svg(map_plan(world, longest_pt=288.0)), caption=f"Training map {world.name}"
        )
        for world in training[:most_maps_shown]
    )
    summary = (
        f"Run {result.run_id}: {counted(len(result.history), 'generation')}, "
        f"{counted(result.evaluations, 'design')} "
        f"evaluated, stopped by {result.stopped}."
    )
    return Section(title="How it was found", paragraphs=(summary,), pictures=(curve, *maps))


PAGE_NAME = "index.html"
"""The page of a run in its folder."""

LEAST_PAUSE_S = 3.0
"""Between two versions of the live page, at least."""

_OF_PROCESSOR, _OF_TIME = 0.01, 0.05
"""Shares of the processor's time and of a run's time that its live page takes at most; writing to a
slow disk takes the second only. The first version loads what it needs, and is not counted."""

_REFRESH_S, _STOPPED_REFRESH_S = 5, 20
_PATIENCE_S = 90


class LivePage:
    """The page of a running search: rewritten now and then, and when it is stopped.

    Nothing but the page depends on it: where it cannot be written, the run continues without.

    Attributes
    ----------
    problem
        Why the page could not be written; empty if it could.
    """

    def __init__(self, folder: Path, settings: RunSettings, again: str) -> None:
        self.path = folder / PAGE_NAME
        self.problem = ""
        self._settings, self._again = settings, again
        self._last: SearchProgress | None = None
        self._next_s, self._pause_s = 0.0, LEAST_PAUSE_S
        self._best = _BestSoFar(settings)

    def __enter__(self) -> "LivePage":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, _: TracebackType | None
    ) -> None:
        """Say on the page that the run was stopped."""
        # Before the first generation of this session the page may be of another one.
        if kind is None or self._last is None:
            return
        interrupted = issubclass(kind, KeyboardInterrupt | InterruptedRunError)
        why = "Interrupted" if interrupted else f"Stopped by an error ({error})"
        count = f"{self._last.done} of {self._last.total} {self._last.phase}"
        self._write(f"{why} after {count}.", running=False)

    def update(self, progress: Progress) -> None:
        """Write the page, unless that was just done; before the first generation there is none."""
        if isinstance(progress, SearchProgress) and progress.within is None:
            self._follow(progress)
        elif self._last is None or progress.within is not None:
            return
        began_s, worked_s = time.monotonic(), time.thread_time()
        if began_s < self._next_s or self.problem:
            return
        left = ""
        if (left_s := progress.left_s) is not None:
            left = f"{round(left_s)} s" if left_s < 90.0 else f"{round(left_s / 60.0)} min"
            left = left if left_s < 7170.0 else f"{left_s / 3600.0:.1f} h"
            left = f"; about {left} left"
        self._write(f"Running: {progress.count}{left}.", running=True)
        now_s = time.monotonic()
        if self._next_s:
            working_s = (time.thread_time() - worked_s) / _OF_PROCESSOR
            self._pause_s = max(LEAST_PAUSE_S, working_s, (now_s - began_s) / _OF_TIME)
        self._next_s = now_s + self._pause_s

    def _follow(self, progress: SearchProgress) -> None:
        """Note a generation."""
        if self._last is None:  # remove half-written versions of killed sessions
            with suppress(OSError):
                for path in self.path.parent.glob(f".{PAGE_NAME}.*"):
                    path.unlink(missing_ok=True)
        self._last = progress
        self._best.look(progress.history)

    def _write(self, state: str, *, running: bool) -> None:
        try:
            write_text(self.path, self._page(state, running=running))
        except (CannotWriteError, ForeignFileError) as error:
            self.problem = str(error)

    def _page(self, state: str, *, running: bool) -> str:
        progress, settings = self._last, self._settings
        if progress is None:
            raise BadInputError("progress", None, "that of a generation")
        pace_s = progress.elapsed_s / max(1, progress.done)
        patience_s = round(_PATIENCE_S + 5.0 * pace_s + self._pause_s)
        return page(
            f"{settings.name}: search for the best design",
            (
                Answer(state, "good" if running else "caution"),
                Notes(() if running else (f"To go on: {self._again}",)),
                *([Remark(progress.advice, "warning")] if progress.advice else []),
                Facts(tuple(self._headlines(progress)), lead=True),
                *self._best.view(),
                Picture(
                    image=page_svg(fitness_curve(*curve_of(progress.history))),
                    caption="Best fitness so far, and the scores of each generation (simulated). "
                    "A best value can be luck: at the end finalists are evaluated again on fresh "
                    "poses.",
                ),
                Facts(run_facts(settings)),
                Text(
                    "Every generation is recorded. After Ctrl-C, a kill or a power cut this goes "
                    "on as if nothing had happened:"
                ),
                Code(self._again),
            ),
            Live(
                refresh_s=_REFRESH_S if running else _STOPPED_REFRESH_S,
                written_ms=int(1000 * time.time()),
                patience_s=patience_s if running else 0,
                again=self._again,
            ),
        )

    def _headlines(self, progress: SearchProgress) -> Iterator[Fact]:
        best = progress.best
        yield Fact(
            "best fitness so far",
            f"{best:.4f}" if best > INVALID_FITNESS else "none",
            detail="in the search, of many tries: likely too good (simulated)",
        )
        if progress.targets_text:
            yield Fact(
                "targets of the best so far",
                progress.targets_text,
                detail="mean of its deployments (simulated)",
                tone="good" if progress.touches_all else "caution",
            )
        yield Fact(
            "mean of the last generation",
            f"{progress.mean:.4f}",
            detail=f"standard deviation {progress.spread:.4f} (simulated)",
        )
        if self._settings.evaluation.fabricable:
            yield Fact(
                "the best is manufacturable",
                progress.manufacturable,
                detail=f"{100.0 * progress.fabricable_share:.0f} % of the last generation are, by "
                "the quick rules; the winner's joints are simulated at the end",
                tone="caution" if progress.passes is False else "good",
            )


class _BestSoFar:
    """The design with the best fitness of a run so far, on its first training map."""

    def __init__(self, settings: RunSettings) -> None:
        self._settings, self._world = settings, first_map(settings)
        self._space = space_of(settings.space, settings.build)
        self._seen, self._fitness = 0, INVALID_FITNESS
        self._at = 0
        self._design: Design | None = None
        self._drawn: tuple[Design, bytes] | None = None

    def look(self, history: Sequence[Generation]) -> None:
        """Look for a better design in the generations that are new."""
        for generation in history[self._seen :]:
            if generation.best > self._fitness:
                row = int(np.argmax(generation.fitness))
                self._fitness, self._at = generation.best, generation.number + 1
                self._design = self._space.design(generation.x[row], self._settings.name)
        self._seen = len(history)

    def view(self) -> Iterator[Block]:
        """Yield the best design so far, with a picture."""
        design = self._design
        if design is None:
            yield Text("No point of the space was a design yet.")
            return
        size = f"{size_words(design)}{self._pieces_words(design)}"
        if self._drawn is None or self._drawn[0] is not design:
            growth, pose = self._settings.growth.at_one_angle, self._world.starts[0].pose
            deployment = grow_on(design, Terrain.of(self._world), pose, growth)
            touched = touched_targets([(deployment, self._world)], run_task(self._settings))
            widths_mm = growth.drawn_widths_mm(deployment.tree)
            plan = deployment_plan(self._world, deployment, widths_mm, touched=touched)
            self._drawn = design, page_svg(plan)
        yield Picture(
            image=self._drawn[1],
            caption=f"The best so far, from the start of {self._world.name} (simulated): {size}, "
            f"found in generation {self._at}.",
        )

    def _pieces_words(self, design: Design) -> str:
        """Return the search's number of pieces of a design, as text; empty where it must be one."""
        settings, evaluation = design.build.pieces, self._settings.evaluation
        if settings is None or not evaluation.fabricable:
            return ""
        penalty = ManufacturabilityPenalty(profile=run_profile(evaluation))
        count = penalty.pieces(design)
        if count is None:
            return f", not yet in {counted(settings.most, 'piece')} that lie flat"
        return f", {counted(count, 'piece')} by the quick rules"


def run_facts(settings: RunSettings) -> tuple[Fact, ...]:
    """Return names and values of a run's settings."""
    search, maps = settings.search, settings.maps
    where = "from files" if maps.files else f"of {maps.environment}, seed {maps.seed}"
    evaluation = settings.evaluation
    made = f"recipe {evaluation.recipe or DEFAULT_RECIPE}" if evaluation.fabricable else "not asked"
    pieces, weight = settings.build.pieces, evaluation.joint_weight
    charged = f", every joint costs {weight:g} of the fitness" if weight else ""
    return (
        Fact("task", settings.task.name),
        Fact("training maps", f"{maps.count} {where}"),
        Fact("optimizer", f"{settings.optimizer.name}, seed {search.seed}"),
        Fact(
            "size",
            f"{counted(search.population, 'design')} x {counted(search.generations, 'generation')}",
        ),
        Fact("manufacturability", made),
        *([Fact("pieces", f"at most {pieces.most}, joined by sleeves{charged}")] if pieces else []),
    )


MOST_POINTS = 400
"""Longer curves are thinned out."""


def fitness_curve(best: ArrayLike, mean: ArrayLike, spread: ArrayLike) -> Page:
    """Return the fitness per generation of a search.

    The axis shows the scores; a best fitness below them, of designs with a penalty, lies on its
    lower end.

    Parameters
    ----------
    best
        Best fitness found so far, shape (g,).
    mean, spread
        Mean and standard deviation over each generation's candidates, shape (g,).
    """
    rows = np.array([np.asarray(values, dtype=float) for values in (best, mean, spread)])
    count = rows.shape[1]
    kept = np.unique(np.linspace(0, max(0, count - 1), min(count, MOST_POINTS)).astype(int))
    top, middle, wide = rows[:, kept]
    low, high = middle - wide, middle + wide
    known = middle[np.isfinite(middle)]
    y0, y1 = ends_of(low, high, top[top >= known.min()] if len(known) else [])
    x0, x1 = ends_of(kept + 1)
    panel = Panel(
        box=(x0, y0, x1, y1), width_pt=400.0, height_pt=200.0, frame=True,
        x_name="generation", y_name="fitness (simulated)",
    )  # fmt: skip
    panel.band(kept + 1, low, high, LEVEL_COLOURS[0], 0.15)
    words = "mean of the generation, shaded: one standard deviation"
    for values, colour, label in (
        (middle, LEVEL_COLOURS[0], words),
        (np.clip(top, y0, y1), LEVEL_COLOURS[1], "best so far"),
    ):
        points = np.column_stack([kept + 1, values])[np.isfinite(values)]
        panel.line(points, Ink(line=colour, width_pt=1.5), label=label)
        if len(points) == 1:
            panel.marks(points, "o", 5.0, Ink(fill=colour))
    return page_of(panel)
