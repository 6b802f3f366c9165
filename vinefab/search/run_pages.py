"""Runs shown to the user: the listing of records, files rebuilt from one, sections of a report."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vinefab.core.atomic import write_bytes, write_text
from vinefab.core.errors import BadInputError, UnreadableFileError
from vinefab.core.front_door import front_door
from vinefab.core.jsontext import json_text
from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats
from vinefab.model.files.design_toml import design_text
from vinefab.model.map import Map
from vinefab.pages.charts import fitness_curve
from vinefab.pages.html import Picture, Section, Table
from vinefab.pages.page_svg import page_svg
from vinefab.pages.panel import Page
from vinefab.pages.plan import map_plan
from vinefab.search.record.result import Generation, RunResult, curve_of
from vinefab.search.record.run_archive import (
    RECORD_FILE,
    RunArchive,
    damage_errors,
    plain_summary,
    records_in,
)
from vinefab.search.settings import targets_mm


@dataclass(frozen=True, slots=True, kw_only=True)
class RunListing:
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

    @property
    def exit_code(self) -> int:
        """The exit code of the command: 1 where runs miss, or none can be read."""
        return int(not self.whole or bool(self.broken and not self.rows))

    def __repr__(self) -> str:
        return "\n".join([f"<RunListing of {counted(len(self.rows), 'run')}>", *self.summary])

    def _repr_html_(self) -> str:
        """Show the listing in a notebook."""
        shown: str = front_door().html_of(self)
        return shown

    @property
    def seeds(self) -> tuple["SeedSummary", ...]:
        """The runs that differ in their seed alone, of which there are several, together."""
        alike: dict[str, list[dict[str, Any]]] = {}
        for row in self.rows:
            alike.setdefault(row["seedless_run"], []).append(row)
        return tuple(SeedSummary.of(rows) for rows in alike.values() if len(rows) > 1)

    @property
    def summary(self) -> tuple[str, ...]:
        """The listing, a line each."""
        broken = [f"unreadable: {line}" for line in self.broken]
        merged = [line for summary in self.seeds for line in summary.lines]
        return (*map(run_line, self.rows), *broken, *merged)

    def json_text(self) -> str:
        """Return the listing as JSON: ``vinefab/runs-1``."""
        seeds = [summary.plain() for summary in self.seeds]
        content = {"runs": list(self.rows), "broken": list(self.broken), "seeds": seeds}
        return json_text("vinefab/runs-1", content)


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

    def plain(self) -> dict[str, Any]:
        """Return the summary as plain values."""
        some = bool(self.ended)
        return {
            "name": self.name,
            "optimizer": self.optimizer,
            "seeds": sorted(row["seed"] for row in self.ended),
            "unended": list(self.unended),
            "manufacturable": self.manufacturable,
            "mean": float(self.scores.mean()) if some else None,
            "deviation": self.deviation,
            "lowest": float(self.scores.min()) if some else None,
            "highest": float(self.scores.max()) if some else None,
            "best": self.ended[0]["folder"] if some else None,
            "best_seed": self.ended[0]["seed"] if some else None,
        }

    @property
    def lines(self) -> list[str]:
        """The summary as lines for the user."""
        count, waiting = len(self.ended), len(self.unended)
        rest = f", {waiting} {'has' if waiting == 1 else 'have'} not" if waiting else ""
        heading = f"{self.name} ({self.optimizer}), {count} seed{'' if count == 1 else 's'} ended"
        if not count:
            return [f"{heading}{rest}"]
        spread = "" if self.deviation is None else f" +- {self.deviation:.4f} (standard deviation)"
        made = self.manufacturable
        makeable = "" if made is None else f", {made} of {count} manufacturable"
        best = self.ended[0]
        return [
            f"{heading}{rest}: winners' mean score {self.scores.mean():.4f}{spread}, "
            f"{self.scores.min():.4f} to {self.scores.max():.4f}{makeable} (simulated, each on its "
            "own fresh poses on the training maps)",
            f"best: seed {best['seed']} in {best['folder']}, mean score "
            f"{best['winner_score']['mean']:.4f}; the best of several is partly luck: compare "
            "winners on unseen maps with vinefab compare",
        ]


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


def run_line(row: dict[str, Any]) -> str:
    """Return one record of a listing as a line for the user."""
    best = "no fitness yet" if row["best_fitness"] is None else f"best {row['best_fitness']:.4f}"
    state = f"stopped by {row['stopped']}" if row["stopped"] else "can be resumed"
    done = f"{row['generations']}/{row['most_generations']} generations"
    run = f"{row['name']} ({row['optimizer']}, seed {row['seed']}, run {row['run']})"
    won = row["winner_score"]
    winner = "" if won is None else f", winner {won['mean']:.4f} on fresh poses"
    return f"{row['folder']}: {run}: {done}, {best}{winner}, {state}"


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
        plan = map_plan(world, targets_mm=targets_mm(archive.settings))
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
        wide=True,
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


def unseen_section(rows: tuple[tuple[str, str], ...]) -> Section:
    """Return the report's section on a run's test on unseen maps."""
    table = Table(
        caption="Means with 95 % bootstrap intervals over maps",
        headings=("", ""),
        rows=rows,
    )
    return Section(title="Result", tables=(table,))
