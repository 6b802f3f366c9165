"""Records of runs: listed, and turned into files again."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from vinefab.core.atomic import write_bytes, write_text
from vinefab.core.errors import BadInputError, UnreadableFileError
from vinefab.core.jsontext import json_text
from vinefab.model.files.design_toml import design_text
from vinefab.pages.charts import fitness_curve
from vinefab.pages.drawing import map_plan
from vinefab.pages.figure import svg_bytes
from vinefab.search.record.record_reading import FILE_NAME, damage_errors
from vinefab.search.record.result import Generation
from vinefab.search.record.run_archive import RunArchive, plain_summary, records_in


@dataclass(frozen=True, slots=True, kw_only=True)
class Listing:
    """The records below a folder."""

    rows: tuple[dict[str, Any], ...]  # what each says, in plain values
    broken: tuple[str, ...]  # what was found but cannot be read: one line each

    def json(self) -> str:
        """Return the listing as JSON."""
        content = {"runs": list(self.rows), "broken": list(self.broken)}
        return json_text("vinefab/runs-1", content)


def list_runs(folder: Path) -> Listing:
    """Return the records below a folder; one that cannot be read does not hide the others."""
    paths = records_in(folder)
    if not paths:
        raise BadInputError("DIR", str(folder), f"a folder with a {FILE_NAME} in it or below")
    rows, broken = [], []
    for path in paths:
        try:
            with damage_errors(path):
                rows.append(plain_summary(RunArchive.read(path)))
        except UnreadableFileError as error:
            broken.append(str(error))
    return Listing(rows=tuple(rows), broken=tuple(broken))


def run_words(row: dict[str, Any]) -> str:
    """Return one record of a listing as a line for the user."""
    best = "nothing yet" if row["best_fitness"] is None else f"best {row['best_fitness']:.4f}"
    state = f"stopped by {row['stopped']}" if row["stopped"] else "can be resumed"
    done = f"{row['generations']}/{row['most_generations']} generations"
    what = f"{row['name']} ({row['optimizer']}, seed {row['seed']}, run {row['run']})"
    return f"{row['folder']}: {what}: {done}, {best}, {state}"


def rebuild(folder: Path, out: Path, *, force: bool = False) -> tuple[Path, ...]:
    """Write what a run ended with anew, from its record alone."""
    archive = RunArchive.read(folder / FILE_NAME)
    best = design_text(archive.result().best)
    written = [write_text(out / "best.toml", best, force=force)]
    pictures = {"history.svg": history_svg(archive.history)}
    pictures |= {f"map_{m.name}.svg": svg_bytes(map_plan(m)) for m in archive.maps}
    written += [write_bytes(out / name, data, force=force) for name, data in pictures.items()]
    return tuple(written)


def history_svg(history: tuple[Generation, ...]) -> bytes:
    """Return the course of a search as a picture."""
    best = np.maximum.accumulate([generation.best for generation in history])
    mean = [np.nanmean(generation.composite) for generation in history]
    spread = [np.nanstd(generation.composite) for generation in history]
    return svg_bytes(fitness_curve(best, mean, spread))
