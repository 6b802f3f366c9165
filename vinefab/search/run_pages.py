"""Runs shown to the user: the listing of records, files rebuilt from one, sections of a report."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from vinefab.core.atomic import write_bytes, write_text
from vinefab.core.errors import BadInputError, UnreadableFileError
from vinefab.core.jsontext import json_text
from vinefab.model.files.design_toml import design_text
from vinefab.model.map import Map
from vinefab.pages.charts import fitness_curve
from vinefab.pages.drawing import map_plan
from vinefab.pages.figure import svg_bytes
from vinefab.pages.html import Picture, Section, Table
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
    """The records below a folder."""

    rows: tuple[dict[str, Any], ...]  # the summary of each, in plain values
    broken: tuple[str, ...]  # one line for each that is unreadable

    def json(self) -> str:
        """Return the listing as JSON: ``vinefab/runs-1``."""
        content = {"runs": list(self.rows), "broken": list(self.broken)}
        return json_text("vinefab/runs-1", content)


def list_runs(folder: Path) -> RunListing:
    """Return the records below a folder; one that is unreadable does not hide the others."""
    paths = records_in(folder)
    if not paths:
        raise BadInputError("DIR", str(folder), f"a folder with a {RECORD_FILE} in it or below")
    rows, broken = [], []
    for path in paths:
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
    return f"{row['folder']}: {run}: {done}, {best}, {state}"


def rebuild(folder: Path, out: Path, *, force: bool = False) -> tuple[Path, ...]:
    """Write the winner and the figures of a run from its record alone."""
    archive = RunArchive.read(folder / RECORD_FILE)
    best = design_text(archive.result().best)
    written = [write_text(out / "best.toml", best, force=force)]
    pictures = {"history.svg": svg_bytes(history_figure(archive.history))}
    for world in archive.maps:
        plan = map_plan(world, targets_mm=targets_mm(archive.settings))
        pictures[f"map_{world.name}.svg"] = svg_bytes(plan)
    written += [write_bytes(out / name, data, force=force) for name, data in pictures.items()]
    return tuple(written)


def history_figure(history: Sequence[Generation]) -> Figure:
    """Return the chart of fitness per generation."""
    return fitness_curve(*curve_of(history))


MOST_MAPS_SHOWN = 4
"""Most training maps that a report shows."""


def search_section(result: RunResult, training: Sequence[Map]) -> Section:
    """Return the report's section on a search and its training maps."""
    curve = Picture(
        image=svg_bytes(history_figure(result.history)),
        caption="Fitness per generation (simulated). New poses are drawn for every generation, so "
        "a best value can be luck: finalists are evaluated again on fresh poses.",
        wide=True,
    )
    maps = tuple(
        Picture(
            image=svg_bytes(map_plan(world, longest_in=4.0)), caption=f"Training map {world.name}"
        )
        for world in training[:MOST_MAPS_SHOWN]
    )
    summary = (
        f"Run {result.run_id}: {len(result.history)} generations, {result.evaluations} designs "
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
