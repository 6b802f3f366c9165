"""What the record of a run says while it goes on and afterwards: curve, best design, front."""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from vinefab.core.errors import (
    BadInputError,
    UnreadableFileError,
    VinefabError,
)
from vinefab.core.plain_text import counted
from vinefab.core.validation import Floats
from vinefab.model.design import Design
from vinefab.model.files.design_toml import design_content
from vinefab.model.files.shipped import path_inside
from vinefab.model.score import Score
from vinefab.search.costs import COSTS
from vinefab.search.evaluator import INVALID_FITNESS
from vinefab.search.front import minimized, non_dominated, spread_out
from vinefab.search.record.generations import Generation
from vinefab.search.record.result import RECORD_FILE, RecordTail, RunArchive
from vinefab.search.settings import RunSettings
from vinefab.search.space import Space

MOST_CURVE_POINTS, MOST_FRONT_POINTS = 240, 120
MOST_FRONT_KEPT = 360
"""A front of three aims may hold most designs of a run: beyond this, some spread over it stay."""

_SIMULATED = "simulated"


@dataclass(slots=True)
class FollowedRecord:
    """A record that is read bit by bit while its run goes on."""

    path: Path
    has_front: bool = True  # whether the front so far is wanted
    settings: RunSettings | None = None  # None before there is a record
    generations: int = 0  # read so far
    evaluations: int = 0
    best: float = INVALID_FITNESS  # best fitness
    best_at: tuple[int, int] | None = None  # its generation and row
    best_breaks: bool = False  # whether it has a penalty
    best_x: Floats = field(default_factory=lambda: np.empty(0))
    curve: list[tuple[int, float]] = field(default_factory=list)  # evaluations and best fitness
    stopped: str = ""
    winner_score: Score | None = None  # on fresh poses, once the run has ended
    front: "LiveFront | None" = None

    def look(self) -> None:
        """Read what is new."""
        tail = RecordTail.read(self.path, self.generations)
        if tail is None:
            return
        if self.settings is None and tail.settings.objectives and self.has_front:
            self.front = LiveFront(tail.settings)
        self.settings, self.stopped = tail.settings, tail.stopped
        self.winner_score = tail.winner_score
        for generation in tail.generations:
            self._take(generation)

    def _take(self, generation: Generation) -> None:
        self.generations = generation.number + 1
        self.evaluations += len(generation.fitness)
        if generation.best > self.best:
            row = int(np.argmax(generation.fitness))
            if self.best_breaks and generation.penalty[row] == 0.0:
                # Designs that break something rank below all others, on a scale of their own.
                self.curve.clear()
            self.best, self.best_at = generation.best, (generation.number, row)
            self.best_x = generation.x[row]
            self.best_breaks = bool(generation.penalty[row] > 0.0)
            self.curve.append((self.evaluations, self.best))
        if self.front is not None:
            self.front.take(generation)

    @property
    def share(self) -> float:
        """Share of the generations that are done; runs with other limits may end before."""
        if self.settings is None:
            return 0.0
        return min(1.0, self.generations / self.settings.search.generations)

    def best_content(self) -> dict[str, Any] | None:
        """Return the best design so far; None before there is one."""
        if self.settings is None or self.best_at is None:
            return None
        space = Space(self.settings.space, self.settings.build)
        return design_content(space.design(self.best_x, self.settings.name))

    def curve_points(self) -> list[list[float]]:
        """Return the curve up to now, in a bounded number of points."""
        points = [list(point) for point in self.curve]
        if points and points[-1][0] < self.evaluations:
            points.append([self.evaluations, self.best])
        if len(points) <= MOST_CURVE_POINTS:
            return points
        chosen = np.linspace(0, len(points) - 1, MOST_CURVE_POINTS).round().astype(int)
        return [points[place] for place in chosen.tolist()]


class LiveFront:
    """The designs of a run with several objectives that no other dominates so far."""

    def __init__(self, settings: RunSettings) -> None:
        self._settings = settings
        self._space = Space(settings.space, settings.build)
        self._at: list[tuple[int, int]] = []  # generation and row of each
        self._fitness, self._costs = np.empty(0), np.empty((0, len(settings.further_objectives)))

    def take(self, generation: Generation) -> None:
        """Let the designs of a generation that break nothing join, and drop what they dominate."""
        names = self._settings.further_objectives
        costs = minimized(generation.x, generation.terms, self._space, names)
        valid = np.isfinite(generation.composite) & (generation.penalty == 0.0)
        rows = np.flatnonzero(valid & np.isfinite(costs).all(axis=1))
        at = [*self._at, *((generation.number, row) for row in rows.tolist())]
        fitness = np.concatenate([self._fitness, generation.fitness[rows]])
        costs = np.vstack([self._costs, costs[rows]])
        kept = np.flatnonzero(non_dominated(fitness, costs))
        if len(kept) > MOST_FRONT_KEPT:
            kept = kept[spread_out(costs[kept], MOST_FRONT_POINTS)]
        self._at = [at[place] for place in kept.tolist()]
        self._fitness, self._costs = fitness[kept], costs[kept]

    def plain(self) -> dict[str, Any]:
        """Return the front for the page, its points in the order of the first further objective."""
        settings = self._settings
        signs = [1.0 if name in COSTS else -1.0 for name in settings.further_objectives]
        points = [
            {
                "point": "{}:{}".format(*self._at[place]),
                "label": f"generation {self._at[place][0] + 1}",
                "values": [
                    float(self._fitness[place]),
                    *(s * float(c) for s, c in zip(signs, self._costs[place], strict=True)),
                ],
                "breaks": False,
            }
            for place in spread_out(self._costs, MOST_FRONT_POINTS)
        ]
        names = (settings.task.name, *settings.further_objectives)
        return {
            "objectives": [_objective(name) for name in names],
            "points": points,
            "is_final": False,
        }


def _objective(name: str) -> dict[str, str]:
    """Return an objective as charts name it."""
    is_cost = name in COSTS
    return {
        "name": name.replace("_", " ") if is_cost else f"{name} score",
        "unit": COSTS[name].unit if is_cost else "",
        "better": "smaller" if is_cost else "larger",
        # A cost follows from the design alone.
        "kind": "planned" if is_cost else _SIMULATED,
    }


def best_words(record: FollowedRecord) -> str:
    """Return what the best design so far is worth, in words."""
    if record.best_at is None:
        return f"no valid design yet ({_SIMULATED})"
    breaks = "; it breaks fabrication rules or limits" if record.best_breaks else ""
    where = f"generation {record.best_at[0] + 1}"
    return f"best fitness so far, of many tries: likely too good ({_SIMULATED}, {where}{breaks})"


def winner_words(score: Score) -> str:
    """Return over what a winner's score is a mean, in words."""
    return (
        f"mean score of the winner on {counted(len(score.evaluations), 'fresh pose')} "
        f"({_SIMULATED})"
    )


def listed_score(record: FollowedRecord) -> tuple[float | None, str]:
    """Return the score of a run's winner, or the best fitness so far, and what it is."""
    score = record.winner_score
    if record.stopped and score is not None:
        return score.composite["mean"], winner_words(score)
    return record.best if record.best_at is not None else None, best_words(record)


def best_of(folder: Path) -> tuple[dict[str, Any], str]:
    """Return the winner of a run that has ended, or the best design so far."""
    record = FollowedRecord(folder / RECORD_FILE, has_front=False)
    record.look()
    if record.stopped:
        result = RunArchive.read(record.path).result()
        words = f"{result.score.composite['mean']:.4f}: {winner_words(result.score)}"
        return design_content(result.best), words
    content = record.best_content()
    if content is None:
        raise BadInputError("point", "best", "a run with a valid design", folder)
    return content, f"fitness {record.best:.4f}: {best_words(record)}"


def point_of(folder: Path, point: str) -> tuple[dict[str, Any], str]:
    """Return the design in a row of a generation."""
    wanted, _, row = point.partition(":")
    tail = None
    if wanted.isascii() and wanted.isdigit() and row.isascii() and row.isdigit():
        tail = RecordTail.read(folder / RECORD_FILE, min(int(wanted), 2**62))
    found = [] if tail is None else [g for g in tail.generations if g.number == int(wanted)]
    if tail is None or not found or int(row) >= len(found[0].x):
        raise BadInputError("point", point, "G:R, a row of a generation of the run", folder)
    generation, place = found[0], int(row)
    design = Space(tail.settings.space, tail.settings.build).design(generation.x[place])
    content = {**design_content(design), "name": f"{tail.settings.name}_{wanted}_{row}"[:100]}
    words = f"fitness {generation.fitness[place]:.4f} in the search: likely too good ({_SIMULATED})"
    return content, words


def front_design(folder: Path, name: str) -> tuple[dict[str, Any], str]:
    """Return a design of the front that a run ended with."""
    record = FollowedRecord(folder / RECORD_FILE, has_front=False)
    record.look()
    front = final_front(folder, record)
    known = {} if front is None else {point["point"]: point for point in front["points"]}
    if name not in known:
        raise BadInputError("point", name, f"one of {', '.join(known) or 'none'}", folder)
    values = known[name]["values"]
    words = f"score {values[0]:.4f} on fresh poses ({_SIMULATED})"
    path = path_inside("design", f"front/{name}.toml", (folder,), folder / "front.json")
    return design_content(Design.read(path)), words


_MOST_FRONT_BYTES = 1 << 24


def final_front(folder: Path, record: FollowedRecord) -> dict[str, Any] | None:
    """Return the front that a run ended with, from its ``front.json``; None without one."""
    path, settings = folder / "front.json", record.settings
    if settings is None or not settings.objectives or not record.stopped:
        return None
    # The task first, as in the live front.
    names = [settings.task.name, *settings.further_objectives]
    try:
        if path.stat().st_size > _MOST_FRONT_BYTES:
            raise UnreadableFileError(path, "is too large for a front")
        content = json.loads(path.read_text(encoding="utf-8"))
        points = [_final_point(entry, names) for entry in content["designs"]]
    except FileNotFoundError:
        return None
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        if isinstance(error, VinefabError):
            raise
        raise UnreadableFileError(path, f"is no front of a run ({error})") from error
    return {"objectives": [_objective(n) for n in names], "points": points, "is_final": True}


def _final_point(entry: Mapping[str, Any], names: list[str]) -> dict[str, Any]:
    name = str(entry["design"])
    if "/" in name or "\\" in name:
        raise ValueError(f"a design called {name!r}")
    knee = ", knee" if entry["knee"] else ""
    return {
        "point": name,
        "label": f"{name}{knee}",
        "values": [float(entry[objective]) for objective in names],
        "breaks": entry["penalty"] > 0.0,
    }
