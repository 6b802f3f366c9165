"""Sections on how a design was found."""

from collections.abc import Sequence

import numpy as np

from vinefab.model.map import Map
from vinefab.pages.charts import fitness_curve
from vinefab.pages.drawing import map_plan
from vinefab.pages.figure import svg_bytes
from vinefab.pages.html import Picture, Section, Table
from vinefab.search.record.result import RunResult

MOST_MAPS = 4


def search_section(result: RunResult, training: Sequence[Map]) -> Section:
    """Return the course of a search and the maps that it trained on."""
    best = np.maximum.accumulate([generation.best for generation in result.history])
    mean = [np.nanmean(generation.composite) for generation in result.history]
    spread = [np.nanstd(generation.composite) for generation in result.history]
    curve = Picture(
        image=svg_bytes(fitness_curve(best, mean, spread)),
        caption="Fitness per generation (simulated). New poses are drawn for every generation, so "
        "a best value can be a lucky one: the finalists are judged again on fresh poses.",
        wide=True,
    )
    maps = tuple(
        Picture(
            image=svg_bytes(map_plan(world, longest_in=4.0)), caption=f"Training map {world.name}"
        )
        for world in training[:MOST_MAPS]
    )
    words = (
        f"Run {result.run_id}: {len(result.history)} generations, {result.evaluations} designs "
        f"evaluated, stopped by {result.stopped}."
    )
    return Section(title="How it was found", paragraphs=(words,), pictures=(curve, *maps))


def unseen_section(rows: tuple[tuple[str, str], ...]) -> Section:
    """Return the summary of a run with its test on unseen maps."""
    table = Table(
        caption="Means with 95 % bootstrap intervals over maps and poses",
        headings=("", ""),
        rows=rows,
    )
    return Section(title="Result", tables=(table,))
