"""Runs shown to the user: the listing of records, files rebuilt from one, sections of a report."""

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vinefab.core.atomic import write_bytes, write_text
from vinefab.core.errors import BadInputError, UnreadableFileError
from vinefab.core.jsontext import json_text
from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats
from vinefab.core.view import (
    Block,
    Data,
    Number,
    Picture,
    Remark,
    Result,
    Rows,
    Section,
    Value,
)
from vinefab.model.files.design_toml import design_text
from vinefab.model.map import Map
from vinefab.pages.charts import fitness_curve
from vinefab.pages.page_svg import page_svg
from vinefab.pages.panel import Page
from vinefab.pages.plan import map_plan
from vinefab.search.record.generations import Generation, curve_of
from vinefab.search.record.result import (
    RECORD_FILE,
    RunArchive,
    RunResult,
    damage_errors,
    plain_summary,
    records_in,
)
from vinefab.search.settings import run_task
from vinefab.tasks.targets import task_targets


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class RunListing(Result):
    """The records of runs below some folders.

    Parameters
    ----------
    rows
        The summary of each, in plain values: ``folder``, ``name``, ``seed``, ``winner_score``, ...
    broken
        One line for each that is unreadable.
    whole
        Whether all runs have ended whose best winner was written.
    """

    rows: tuple[dict[str, Any], ...]
    broken: tuple[str, ...]
    whole: bool = True

    schema = "vinefab/runs-1"

    def view(self) -> Iterator[Block]:
        """Yield the runs, those that differ in their seed alone together, and broken records."""
        yield Rows(
            caption=counted(len(self.rows), "run"),
            headings=("folder", "run", "generations", "best fitness", "winner on fresh poses", ""),
            rows=tuple(map(_run_cells, self.rows)),
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
            data=tuple(summary.content for summary in self.seeds),
        )  # fmt: skip
        yield Data({"runs": list(self.rows), "broken": list(self.broken)})

    @property
    def exit_code(self) -> int:
        """The exit code of the command: 1 where runs miss, or none can be read."""
        return int(not self.whole or bool(self.broken and not self.rows))

    @property
    def seeds(self) -> tuple["SeedSummary", ...]:
        """The runs that differ in their seed alone, of which there are several, together."""
        alike: dict[str, list[dict[str, Any]]] = {}
        for row in self.rows:
            alike.setdefault(row["seedless_run"], []).append(row)
        return tuple(SeedSummary.of(rows) for rows in alike.values() if len(rows) > 1)


@dataclass(frozen=True, slots=True, kw_only=True)
class SeedSummary:
    """Runs that differ in their seed alone."""

    name: str
    optimizer: str
    unended: tuple[str, ...]  # folders of runs that have not ended
    # of the runs that have ended, one per seed, best winner first, as in `RunListing.rows`
    ended: tuple[dict[str, Any], ...]

    @classmethod
    def of(cls, rows: Sequence[dict[str, Any]]) -> "SeedSummary":
        """Return the summary of some runs, at least one."""
        # A run that lies in two folders is one run.
        ended = {row["seed"]: row for row in rows if row["winner_fitness"] is not None}
        by_seed = [ended[seed] for seed in sorted(ended)]
        return cls(
            name=rows[0]["name"],
            optimizer=rows[0]["optimizer"],
            unended=tuple(r["folder"] for r in rows if r["seed"] not in ended),
            ended=tuple(sorted(by_seed, key=lambda row: -row["winner_fitness"])),
        )

    @property
    def scores(self) -> Floats:
        """Mean score of each winner on its fresh poses, best winner first."""
        return np.array([row["winner_score"]["mean"] for row in self.ended])

    @property
    def deviation(self) -> float | None:
        """Standard deviation of the scores over seeds; None for a single one."""
        return float(self.scores.std(ddof=1)) if len(self.ended) > 1 else None

    @property
    def manufacturable(self) -> int | None:
        """Number of manufacturable winners; None where none was asked for."""
        known = [row["manufacturable"] for row in self.ended]
        return None if None in known else sum(known)

    @property
    def cells(self) -> tuple[Value, ...]:
        """The summary as a row: names, seeds, scores, how many manufacturable, the best."""
        ended, waiting = len(self.ended), len(self.unended)
        scores, best = self.scores, self.ended[0] if ended else None
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
            "-" if best is None else f"seed {best['seed']}",
            "-" if best is None else best["folder"],
        )

    @property
    def content(self) -> dict[str, Any]:
        """What stands in JSON beside the row."""
        best = self.ended[0] if self.ended else {"folder": None, "seed": None}
        return {
            "seeds": sorted(row["seed"] for row in self.ended),
            "unended": list(self.unended),
            "best": best["folder"],
            "best_seed": best["seed"],
        }


def list_runs(folders: Sequence[Path]) -> RunListing:
    """Return the records below folders; one that is unreadable does not hide the others."""
    paths: dict[Path, Path] = {}  # by what they are without links: folders may overlap
    for folder in folders:
        below = records_in(folder)
        if not below:
            raise BadInputError("DIR", str(folder), f"a folder with a {RECORD_FILE} in it or below")
        for path in below:
            paths.setdefault(Path(os.path.realpath(path)), path)
    rows, broken = [], []
    for path in paths.values():
        try:
            with damage_errors(path):
                row = plain_summary(RunArchive.read(path))
                json_text("vinefab/runs-1", row)  # raises ValueError if a number is not finite
            rows.append(row)
        except UnreadableFileError as error:
            broken.append(str(error))
    return RunListing(rows=tuple(rows), broken=tuple(broken))


def _run_cells(row: dict[str, Any]) -> tuple[Value, ...]:
    """Return one record as a row."""
    won = row["winner_score"]
    return (
        row["folder"],
        f"{row['name']} ({row['optimizer']}, seed {row['seed']}, run {row['run']})",
        f"{row['generations']}/{row['most_generations']}",
        Number(row["best_fitness"], form=".4f"),
        Number(None if won is None else won["mean"], form=".4f"),
        f"stopped by {row['stopped']}" if row["stopped"] else "can be resumed",
    )


def write_best(listing: RunListing, path: Path, *, force: bool = False) -> bool:
    """Write the best winner of runs that differ in their seed alone; return whether all ended."""
    kinds = {row["seedless_run"] for row in listing.rows}
    if len(kinds) != 1:
        allowed = "with folders whose runs differ in their seed alone"
        raise BadInputError("--best", f"{counted(len(kinds), 'kind')} of runs", allowed)
    summary = SeedSummary.of(listing.rows)
    if not summary.ended:
        raise BadInputError("--best", "no run that has ended", "once a run has ended")
    archive = RunArchive.read(Path(summary.ended[0]["folder"]) / RECORD_FILE)
    write_text(path, design_text(archive.result().best), force=force)
    if archive.recipe is not None:
        archive.recipe.write(path.parent)
    return not (summary.unended or listing.broken)


def rebuild(folder: Path, out: Path, *, force: bool = False) -> tuple[Path, ...]:
    """Write the winner and the figures of a run from its record alone."""
    archive = RunArchive.read(folder / RECORD_FILE)
    best = design_text(archive.result().best)
    written = [write_text(out / "best.toml", best, force=force)]
    if archive.recipe is not None:
        archive.recipe.write(out)
    pictures = {"history.svg": page_svg(history_figure(archive.history))}
    for world in archive.maps:
        plan = map_plan(world, targets=task_targets(run_task(archive.settings), world))
        pictures[f"map_{world.name}.svg"] = page_svg(plan)
    written += [write_bytes(out / name, data, force=force) for name, data in pictures.items()]
    return tuple(written)


def history_figure(history: Sequence[Generation]) -> Page:
    """Return the chart of fitness per generation."""
    return fitness_curve(*curve_of(history))


MOST_MAPS_SHOWN = 4
"""Most training maps that a report shows."""


def search_section(result: RunResult, training: Sequence[Map]) -> Section:
    """Return the report's section on a search and its training maps."""
    curve = Picture(
        image=page_svg(history_figure(result.history)),
        caption="Fitness per generation (simulated). New poses are drawn for every generation, so "
        "a best value can be luck: finalists are evaluated again on fresh poses.",
    )
    maps = tuple(
        Picture(
            image=page_svg(map_plan(world, longest_pt=288.0)), caption=f"Training map {world.name}"
        )
        for world in training[:MOST_MAPS_SHOWN]
    )
    summary = (
        f"Run {result.run_id}: {counted(len(result.history), 'generation')}, "
        f"{counted(result.evaluations, 'design')} "
        f"evaluated, stopped by {result.stopped}."
    )
    return Section(title="How it was found", paragraphs=(summary,), pictures=(curve, *maps))
