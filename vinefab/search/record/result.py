"""The result and the record of a run: read, and the serialized form of everything in it."""

import base64
import json
import math
import os
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import asdict, dataclass, field, replace
from os import PathLike
from pathlib import Path
from typing import Any, TypeVar, cast

import numpy as np
import shapely
from shapely.errors import ShapelyError

from vinefab.core.atomic import write_text
from vinefab.core.codec import Record, from_json
from vinefab.core.errors import (
    CannotWriteError,
    UnfitInputError,
    UnreadableFileError,
    VinefabError,
)
from vinefab.core.front_door import ABOVE
from vinefab.core.hashing import sha256_of
from vinefab.core.plain_text import counted
from vinefab.core.statistics import MeanValue
from vinefab.core.validation import Floats
from vinefab.core.view import (
    Answer,
    Block,
    Data,
    Fact,
    Facts,
    Notes,
    Number,
    Picture,
    Result,
    Rows,
    Tone,
)
from vinefab.growth.options import growth_text, trained_growth
from vinefab.model.design import Design, design_text
from vinefab.model.files.run_context import RunContext, RunRecipe, shape_fingerprint
from vinefab.model.files.shipped import path_given
from vinefab.model.map import Map, Start
from vinefab.model.score import Score, composite_fact, composite_text
from vinefab.model.start import start_of_record, start_record, start_text
from vinefab.model.target import TargetsResult
from vinefab.search.evaluator import TimeSplit, final_seed
from vinefab.search.free_space import space_of
from vinefab.search.record.generations import Extension, Finalist, Generation, RunIdentity
from vinefab.search.record.winner import WinnerPrediction, mean_number
from vinefab.search.settings import (
    RunSettings,
    plain_settings,
    settings_from_plain,
)
from vinefab.search.space import DesignSpace


def design_of_finalist(
    finalist: Finalist,
    settings: RunSettings,
    run_id: str,
    versions: Mapping[str, str],
    worlds: Sequence[Map],
) -> Design:
    """Return a finalist's design with its name and origin, the context of the run among it.

    The origin holds no times: the same run gives the same bytes.
    """
    space = space_of(settings.space, settings.build)
    parameters = cast("dict[str, Any]", plain_settings(settings.task.parameters))
    asked = {world.targets for world in worlds}
    context = RunContext(  # the recipe comes with the result
        run=run_id,
        run_name=settings.name,
        task=settings.task.name,
        task_parameters={key: value for key, value in parameters.items() if value is not None},
        targets=tuple(one.content for one in asked.pop()) if len(asked) == 1 else (),
        maps=tuple(map(shape_fingerprint, worlds)),
        growth=settings.growth.content,
    )
    origin: dict[str, object] = {
        **context.kept,
        "optimizer": settings.optimizer.name,
        "seed": settings.search.seed,
        "population": settings.search.population,
        "generations": settings.search.generations,
        "penalty": finalist.penalty,
        "evaluations_of_score": len(finalist.score.evaluations),
        "poses_of_score": settings.evaluation.final_poses_per_map,
        "seed_of_score": final_seed(settings.search.seed),
        **{f"score_{name}": value for name, value in finalist.score.composite.items()},
        **({"start": start_text(start)} if (start := settings.maps.start) else {}),
        **({"limits": limits} if (limits := space.limits_text(finalist.design)) else {}),
        "versions": ", ".join(f"{name} {number}" for name, number in sorted(versions.items())),
    }
    return finalist.design.changed(name=settings.name, origin=origin)


@dataclass(frozen=True, slots=True, kw_only=True, repr=False, eq=False)
class RunResult(Result):
    """The result of a run.

    Parameters
    ----------
    run_id
        The same for the same settings and maps.
    best
        The winner, with its origin.
    finalists
        Best first; the winner is the first.
    history
        Every generation.
    stopped
        Why it stopped: ``generations``, ``evaluations``, ``stall`` or ``wall_time``.
    times
        Of this session.
    checked
        Whether manufacturability was checked.
    repair
        Message on the feasibility repair; empty where none was needed.
    notes
        What a user should know about the starts, a sentence each.
    drift
        Packages with other versions than when the run began.
    extensions
        Each time that its limits were raised.
    prediction
        What the winner is expected to do elsewhere; None where that was not asked.
    recipe
        The recipe by which designs were judged; None where none was asked for.
    violations
        Which rules and limits the winner violates; empty where none, or where that is not known.
    front
        The front of a run with several objectives.
    again
        The call that gives the winner's score again.
    """

    run_id: str
    best: Design
    finalists: tuple[Finalist, ...]
    history: tuple[Generation, ...]
    stopped: str
    times: TimeSplit = field(default_factory=TimeSplit)
    checked: bool = True
    repair: str = ""
    notes: tuple[str, ...] = ()
    drift: tuple[str, ...] = ()
    extensions: tuple[Extension, ...] = ()
    prediction: WinnerPrediction | None = None
    recipe: RunRecipe | None = None
    violations: str = ""
    front: Rows | None = None
    again: str = ""
    schema = "vinefab/run-result-1"

    @property
    def exit_code(self) -> int:
        """The exit code of the command: 1 where no manufacturable robot was found."""
        return int(bool(self.violations))

    @property
    def details(self) -> tuple[str, ...]:
        """The summary, and where the time went."""
        return (*self.summary, self.times.summary)

    @property
    def targets(self) -> TargetsResult | None:
        """Which targets the winner touches; None where there are none."""
        return self.score.targets

    def view(self) -> Iterator[Block]:
        """Yield the winner, what it scores, how it was found, and the finalists."""
        yield self.answer
        if self.targets is not None:
            yield from self.targets.below
        if (picture := self.best._repr_svg_()) is not None:
            yield Picture(image=picture.encode(), caption=f"{self.best.name}, flat (computed).")
        best, found, growth = self.best, self.prediction, trained_growth(self.best)
        fresh = counted(len(self.score.evaluations), "fresh pose")
        scores = {
            kind: composite_fact(
                self.score,
                kind,
                f"{kind} {self.score.title_of_task} on the training maps",
                f"{made}; {fresh}" if (made := composite_text(kind)) else fresh,
                "simulated",
            )
            for kind in self.score.composite
        }
        pieces = Fact("cut in", self.pieces_words, standing="computed")
        yield Facts(
            (
                *(found.lead_facts if found else [scores.pop("mean")]),
                Fact(
                    "by the rules",
                    self.made,
                    "fabricable",
                    tone="bad" if self.violations else "plain",
                    data=self.fabricable,
                ),
                *([found.pressure_window.fact] if found and found.pressure_window else []),
                *([pieces] if self.pieces_words else []),
            ),
            lead=True,
        )
        designs = counted(self.evaluations, "design")
        yield Facts(
            (
                *scores.values(),
                Fact("winner", best.name, "winner", detail=size_words(best)),
                *(found.width_facts if found else ()),
                *([Fact("limits", str(best.origin["limits"]), detail="planned")]
                  if "limits" in best.origin else []),
                Fact("growth", growth_text(growth, [best]), "growth", data=growth.content),
                Fact("evaluated", f"{designs} in {counted(len(self.history), 'generation')}",
                     "evaluations", data=self.evaluations),
                Fact("stopped by", self.stopped, "stopped"),
                Fact("run", self.run_id, "run"),
                *([Fact("the score again", self.again)] if self.again else []),
            )
        )  # fmt: skip
        if self.front is not None:
            yield self.front
        if found:
            yield from found.tables
        yield Rows(
            caption="finalists on the same fresh poses, the winner first (simulated)",
            headings=("fitness", "mean score", "penalty", "branches", "levels"),
            rows=tuple(
                (Number(one.fitness, form=".4f"), Number(one.score.composite["mean"], form=".4f"),
                 Number(one.penalty, form=".3g"), one.design.branch_count, one.design.depth)
                for one in self.finalists
            ),
            key="finalists",
            keys=("fitness", "", "penalty", "", ""),
            data=tuple({"composite": dict(one.score.composite)} for one in self.finalists),
            folded=True,
        )  # fmt: skip
        drift = "; ".join(self.drift)
        yield Notes(
            (
                *([found.note] if found and found.note else []),
                *(extension.text for extension in self.extensions),
                *([f"repair: {self.repair}"] if self.repair else []),
                *([f"resumed with other package versions, so the last digits may differ: {drift}"]
                  if drift else []),
            )
        )  # fmt: skip
        missed = self.targets is not None and not self.targets.all_touched
        why = f"{self.targets.headline}: " if missed and self.targets is not None else ""
        yield Notes(tuple(f"{why}{note}" for note in self.notes))  # last, with the verdict
        yield Data(
            {
                "notes": [*self.notes],
                "repair": self.repair,
                "extensions": [extension.content for extension in self.extensions],
                "prediction": None if found is None else found.content,
                "generations": [
                    {
                        "best": g.best,
                        "mean": float(np.nanmean(g.composite)) if g.has_designs else None,
                        "spread": float(np.nanstd(g.composite)) if g.has_designs else None,
                        "fabricable_share": g.fabricable_share,
                        "seconds": g.seconds,
                    }
                    for g in self.history
                ],
                "times": {**self.times.content, "shares": self.times.shares},
            }
        )

    @property
    def answer(self) -> Answer:
        """The targets it touches, its score and size, and whether it can be made."""
        if self.targets is None:
            return self._found
        tones: list[Tone] = [self.targets.tone, self._found.tone]
        worst = max(tones, key=("plain", "good", "caution", "bad").index)
        return Answer(f"{self.targets.headline}: {self._found.text}", worst)

    @property
    def _found(self) -> Answer:
        if self.violations:
            beyond = self.violations.startswith(LIMITED)
            asked = "robot within the limits" if beyond else "manufacturable robot"
            return Answer(f"found no {asked}: the winner violates {self.violations}", "bad")
        mean = f"{self.score.composite['mean']:.3f} on fresh poses on the training maps"
        window = None
        if self.prediction is not None:
            unseen, window = self.prediction.unseen, self.prediction.pressure_window
            mean = f"{mean_number(unseen.score)} on {unseen.label}"
        size = "; ".join(filter(None, (size_words(self.best), self.pieces_words)))
        made = self.made if self.checked else "not checked whether it is manufacturable"
        tone: Tone = "plain" if self.checked and self.fabricable else "caution"
        if window and not window.holds_working:
            tone = "caution" if window.is_open else "bad"
        made += f", {window.words}" if window and self.fabricable else ""
        return Answer(
            f"found {self.best.name}: {self.score.title_of_task} {mean} (simulated); {size}; "
            f"{made}",
            tone,
        )

    @property
    def made(self) -> str:
        """Whether the winner is manufacturable."""
        if not self.checked:
            return "not checked (`fabricable = false`)"
        if self.violations:
            beyond = self.violations.startswith(LIMITED)
            return f"{'manufacturable, but' if beyond else 'not manufacturable:'} {self.violations}"
        # The search is stricter than the rules where that keeps it from their edges.
        beyond_search = "beyond limits of the search (see `vinefab check`)"
        return "manufacturable" if self.fabricable else beyond_search

    @classmethod
    def read(cls, folder: str | PathLike[str]) -> "RunResult":
        """Return the result of a run that has ended, from the record in its folder.

        Parameters
        ----------
        folder
            What ``vinefab optimize`` or ``vf.optimize(out=...)`` wrote, or the record in it.

        Raises
        ------
        BadInputError
            If the run has not ended; ``vf.optimize(..., resume=True)`` continues it.
        UnreadableFileError
            If there is no record, or it is damaged.

        Examples
        --------
        >>> RunResult.read("moon")
        Traceback (most recent call last):
        vinefab.core.errors.UnreadableFileError: moon/run.sqlite: there is no such file
        """
        path = path_given("folder", folder)
        return RunArchive.read(path if path.is_file() else path / RECORD_FILE).result()

    @property
    def score(self) -> Score:
        """The winner's score on fresh poses on the training maps."""
        return self.finalists[0].score

    def drawing(self) -> Any:  # noqa: ANN401  a page of a room above
        """Return the chart of the fitness over the generations."""
        return ABOVE.history_page(self.history)

    def with_prediction(self, prediction: WinnerPrediction) -> "RunResult":
        """Return the result with the winner's prediction, also in the winner's origin."""
        best = self.best.changed(origin={**self.best.origin, **prediction.origin})
        return replace(self, best=best, prediction=prediction)

    def with_recipe(self, recipe: RunRecipe, folder: Path | None = None) -> "RunResult":
        """Return the result with the recipe of the run, which is copied into its folder."""
        origin = {**self.best.origin, "recipe": recipe.remembered.content}
        return replace(self, recipe=recipe, best=self.best.changed(origin=origin, folder=folder))

    def write_winner(self, folder: Path, *, force: bool = False) -> None:
        """Write the winner into a folder, with the files of the recipe that its origin names."""
        write_text(folder / "best.toml", design_text(self.best), force=force)
        if self.recipe is not None:
            self.recipe.write(folder)

    @property
    def pieces_words(self) -> str:
        """In how many pieces the winner is cut; empty where it must be one or that is not known."""
        pieces = self.prediction and self.prediction.pieces
        return pieces.words if pieces else ""

    @property
    def fabricable(self) -> bool:
        """Whether the winner has no penalty: it passes what was checked, and keeps the limits."""
        return self.finalists[0].penalty == 0.0

    @property
    def evaluations(self) -> int:
        """Number of designs that the search evaluated."""
        return sum(len(generation.fitness) for generation in self.history)


LIMITED = "space."
"""How violations begin that are of limits of the space alone."""


def size_words(design: Design) -> str:
    """Return the numbers of branches and levels of a design as a phrase."""
    return f"{counted(design.branch_count, 'branch')} on {counted(design.depth, 'level')}"


# --- The serialized form -------------------------------------------------------------------------


def to_blob(values: Floats) -> bytes:
    """Return numbers as 64-bit little-endian floats, in order."""
    return np.ascontiguousarray(values, dtype="<f8").tobytes()


def from_blob(data: bytes, rows: int | None = None) -> Floats:
    """Return the numbers of `to_blob`, shape (n,), or (rows, n / rows)."""
    values = np.frombuffer(data, dtype="<f8").astype(np.float64)
    return values if rows is None else values.reshape(rows, -1)


def state_to_text(state: Mapping[str, object]) -> str:
    """Return an optimizer's state as JSON, arrays of floats as their bits."""
    return json.dumps(state, allow_nan=False, default=_bits)


def _bits(value: object) -> dict[str, object]:
    """Return an array as JSON."""
    if not isinstance(value, np.ndarray):
        raise TypeError(f"Object of type {type(value).__name__} is not JSON serializable")
    return {"shape": value.shape, "bits": base64.b64encode(to_blob(value)).decode()}


def state_from_text(text: str) -> dict[str, Any]:
    """Return the state of `state_to_text`; all arrays are arrays of floats."""
    state: dict[str, Any] = json.loads(text, object_hook=_array_of)
    return state


def _array_of(value: dict[str, Any]) -> object:
    """Return the array that a JSON object stands for; other objects as they are."""
    if value.keys() != {"shape", "bits"}:
        return value
    return from_blob(base64.b64decode(value["bits"])).reshape(value["shape"])


def map_to_text(world: Map) -> str:
    """Return a map as JSON, coordinates as their bits."""
    record = {
        "name": world.name,
        "bounds": world.bounds.wkb_hex,
        "obstacles": [obstacle.wkb_hex for obstacle in world.obstacles],
        "starts": [start_record(start) for start in world.starts],
        "targets": [target.content for target in world.targets],
        "environment": world.environment,
        "seed": world.seed,
        **({"surface": world.surface} if world.surface else {}),
    }
    return json.dumps(record)


def map_from_text(text: str) -> Map:
    """Return the map of `map_to_text`, without its ``facts``."""
    record = json.loads(text)
    return Map(
        name=record["name"],
        bounds=shapely.from_wkb(record["bounds"]),
        obstacles=tuple(shapely.from_wkb(wkb) for wkb in record["obstacles"]),
        starts=tuple(cast("Start", start_of_record(start)) for start in record["starts"]),
        targets=tuple(record.get("targets", ())),
        environment=record["environment"],
        seed=record["seed"],
        surface=record.get("surface", ""),
    )


RECORD_FILE = "run.sqlite"
RECORD_SCHEMA = "vinefab/run-store-3"


def recorded_identity(entries: Mapping[str, str], path: Path) -> RunIdentity:
    """Return the identity of the run in a record."""
    if entries.get("schema") != RECORD_SCHEMA:
        raise UnreadableFileError(
            path, f"has schema {entries.get('schema')}; this vinefab reads {RECORD_SCHEMA}"
        )
    return RunIdentity(
        settings=json.loads(entries["settings"]),
        maps=tuple(json.loads(entries["maps"])),
        versions=json.loads(entries["versions"]),
    )


R = TypeVar("R", bound=Record)


def recorded_entry(entries: Mapping[str, str], key: str, kind: type[R]) -> R | None:
    """Return the value that a record has under a key; None without one."""
    return kind.of_json(entries[key]) if key in entries else None


EXTENSION_TABLE = "CREATE TABLE IF NOT EXISTS extension (number INTEGER PRIMARY KEY, content TEXT)"


def read_extensions(connection: sqlite3.Connection) -> tuple[Extension, ...]:
    """Return every time that the limits of a run were raised, in order."""
    named = "SELECT 1 FROM sqlite_master WHERE name = 'extension'"
    if connection.execute(named).fetchone() is None:
        return ()
    rows = connection.execute("SELECT content FROM extension ORDER BY number").fetchall()
    return tuple(Extension.of_json(text) for (text,) in rows)


def resumed_limits(folder: Path, settings: RunSettings) -> RunSettings:
    """Return the settings of a run with the limits that its record has, if it has one.

    A run file gives the first settings, also after the limits were raised. One that gives
    neither these nor the present ones is left as it is, to be refused when the record is opened.
    """
    path = folder / RECORD_FILE
    if not path.is_file():
        return settings
    with damage_errors(path), closing(_connected(path)) as connection:
        tables = {name for (name,) in connection.execute("SELECT name FROM sqlite_master")}
        if "run" not in tables:
            return settings
        entries = dict(connection.execute("SELECT key, value FROM run").fetchall())
        identity = recorded_identity(entries, path)
        limits = identity.limits
        known = [limits, *(one.before for one in read_extensions(connection))]
        if {name: getattr(settings.search, name) for name in limits} not in known:
            return settings
        return settings.changed(search=settings.search.changed(**limits))


def _connected(path: Path) -> sqlite3.Connection:
    # Not read-only: even a reader may have to create the WAL files.
    return sqlite3.connect(f"{Path(os.path.realpath(path)).as_uri()}?mode=rw", uri=True)


def chained_digest(before: str, row: Sequence[object], *more: object) -> str:
    """Return the digest of a row of a record, and of its terms, after an earlier digest."""
    return sha256_of(repr((before, tuple(row), *more)).encode())


def recorded_digests(connection: sqlite3.Connection, part: str, first: int = 0) -> dict[int, str]:
    """Return the digests of a part by number, from a number on."""
    query = "SELECT number, value FROM digest WHERE part = ? AND number >= ?"
    return dict(connection.execute(query, (part, first)).fetchall())


def last_digest(connection: sqlite3.Connection) -> str:
    """Return the digest of the last generation; empty before there is one."""
    query = "SELECT value FROM digest WHERE part = 'generation' ORDER BY number DESC LIMIT 1"
    row = connection.execute(query).fetchone()
    return "" if row is None else str(row[0])


_CHANGED = "is not as it was recorded: restore the file, or begin again in another folder"


def ensure_recorded(connection: sqlite3.Connection, part: str, row: Sequence[object]) -> None:
    """Raise `ValueError` where the optimizer's state or the finalists were changed."""
    found = recorded_digests(connection, part).get(0)
    is_there = bool(row) or found is not None
    if is_there and found != chained_digest(last_digest(connection), row):
        raise ValueError(f"its part {part} {_CHANGED}")


def _ensure_generations(
    digests: Mapping[int, str], first: int, rows: Sequence[tuple[Sequence[Any], Sequence[Any]]]
) -> None:
    """Raise `ValueError` that names the first generation that was changed or taken away."""
    for number in range(first, max([first + len(rows), *(1 + known for known in digests)])):
        row, terms = rows[number - first] if number - first < len(rows) else ((None,), ())
        value = chained_digest(digests.get(number - 1, ""), row, terms)
        if row[0] != number or value != digests.get(number):
            raise ValueError(f"generation {number + 1} {_CHANGED}")


def generation_rows(
    connection: sqlite3.Connection, first: int = 0
) -> list[tuple[tuple[Any, ...], list[tuple[str, bytes]]]]:
    """Return the rows of generations from a number on, each with those of its terms, in order."""
    rows = connection.execute(
        "SELECT number, x, fitness, composite, penalty, seconds FROM generation WHERE number >= ? "
        "ORDER BY 1",
        (first,),
    ).fetchall()
    query = "SELECT name, value FROM term WHERE generation = ? ORDER BY rowid"
    return [(row, connection.execute(query, row[:1]).fetchall()) for row in rows]


def read_generations(connection: sqlite3.Connection, first: int = 0) -> list[Generation]:
    """Return every generation recorded, in order, from a number on.

    Within a transaction, unless there is no writer: rows and digests are compared.
    """
    rows = generation_rows(connection, first)
    _ensure_generations(recorded_digests(connection, "generation", first - 1), first, rows)
    found = list[Generation]()
    for (number, x, fitness, composites, penalty, seconds), terms in rows:
        found.append(
            Generation(
                number=number,
                x=from_blob(x, rows=len(from_blob(fitness))),
                fitness=_scores(fitness),
                composite=_scores(composites),
                penalty=_scores(penalty),
                terms={name: from_blob(value) for name, value in terms},
                seconds=seconds,
            )
        )
    return found


def _scores(blob: bytes) -> Floats:
    values = from_blob(blob)
    largest_score = 1e100  # larger ones are damage: their squares overflow
    if (np.abs(values) > largest_score).any():
        raise ValueError(f"a score beyond {largest_score:g}")
    return values


def read_finalists(connection: sqlite3.Connection, space: DesignSpace) -> tuple[Finalist, ...]:
    """Return the finalists of a run that has ended, best first; none before."""
    rows = connection.execute(
        "SELECT place, x, penalty, fitness, score FROM finalist ORDER BY place"
    ).fetchall()
    ensure_recorded(connection, "finalists", rows)
    return tuple(
        Finalist(
            x=from_blob(x),
            design=space.design(from_blob(x)),
            score=from_json(Score, score),
            penalty=penalty,
            fitness=fitness,
        )
        for _, x, penalty, fitness, score in rows
    )


@contextmanager
def system_errors(path: Path) -> Iterator[None]:
    """Turn errors of SQLite and the system into errors of vinefab."""
    try:
        yield
    except VinefabError:
        raise
    except sqlite3.IntegrityError:
        problem = BUSY
        raise CannotWriteError(path, problem) from None
    except sqlite3.OperationalError as error:
        raise CannotWriteError(path, _system_problem(error) or str(error)) from None
    except sqlite3.DatabaseError as error:
        raise UnreadableFileError(path, str(error)) from None
    except UnicodeDecodeError as error:  # SQLite quotes damaged bytes
        raise UnreadableFileError(path, f"is damaged or no record ({error})") from None
    except OSError as error:
        raise CannotWriteError(path, error.strerror or str(error)) from None


_WRITE_FAILED = (
    sqlite3.SQLITE_FULL, sqlite3.SQLITE_IOERR_WRITE, sqlite3.SQLITE_IOERR_FSYNC,
    sqlite3.SQLITE_IOERR_TRUNCATE, sqlite3.SQLITE_IOERR_SHMSIZE, sqlite3.SQLITE_IOERR_SHMMAP,
)  # fmt: skip


def _system_problem(error: Exception) -> str:
    """Return the system's problem that an error of SQLite reports; empty if the file is at fault.

    Even a reader writes: it makes the index of the write-ahead log.
    """
    code = getattr(error, "sqlite_errorcode", None)  # none of an error that Python itself raises
    if code in _WRITE_FAILED:
        return "the disk is full, or a file may not become so large (ulimit -f)"
    of_system = (sqlite3.SQLITE_CANTOPEN, sqlite3.SQLITE_READONLY, sqlite3.SQLITE_PERM)
    locked = (sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED)
    return str(error) if code is not None and code & 0xFF in (*of_system, *locked) else ""


BUSY = "another process is working on the same run"

_DAMAGE = (ValueError, KeyError, TypeError, IndexError, AttributeError, OverflowError, ShapelyError)
"""Errors that decoding damaged text and numbers can raise."""


@contextmanager
def damage_errors(path: Path) -> Iterator[None]:
    """Turn errors while a record is read into one that says that it is damaged."""
    try:
        yield
    except (sqlite3.Error, *_DAMAGE) as error:
        if problem := _system_problem(error):
            raise CannotWriteError(path, problem) from None
        reason = " ".join(str(error).split())[:120]
        raise UnreadableFileError(path, f"is damaged or no record ({reason})") from None
    except OSError as error:
        if isinstance(error, VinefabError):
            raise
        raise UnreadableFileError(path, error.strerror or str(error)) from None


@dataclass(frozen=True, slots=True, kw_only=True)
class Session(TimeSplit):
    """One session of a run."""

    began_utc: str  # ISO 8601


@dataclass(frozen=True, slots=True, kw_only=True)
class RunSummary(Record):
    """A record in numbers."""

    folder: str
    run: str  # its id
    seedless_run: str  # id of all runs that differ from it in their seed alone
    name: str
    task: str
    optimizer: str
    seed: int
    generations: int  # done
    most_generations: int
    evaluations: int
    seconds: float  # of all generations
    best_fitness: float | None
    stopped: str | None  # why; None before it has
    winner_score: Mapping[str, float] | None  # composites on fresh poses
    unseen_score: MeanValue | None  # of the winner
    extensions: tuple[Extension, ...]
    winner_fitness: float | None
    manufacturable: bool | None  # None where that was not asked
    sessions: tuple[Session, ...]
    versions: Mapping[str, str]

    @property
    def winner_mean(self) -> float | None:
        """The winner's mean score on fresh poses."""
        return None if self.winner_score is None else self.winner_score["mean"]

    @property
    def rank(self) -> float:
        """The winner's fitness: runs without one come last."""
        return -math.inf if self.winner_fitness is None else self.winner_fitness


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunArchive:
    """The content of a record.

    Examples
    --------
    >>> RunArchive.read(Path("run/run.sqlite")).result().best  # doctest: +SKIP
    """

    path: Path
    identity: RunIdentity
    settings: RunSettings
    maps: tuple[Map, ...]  # the training maps
    history: tuple[Generation, ...]  # every generation
    finalists: tuple[Finalist, ...]  # best first; empty before the run has ended
    stopped: str  # why it stopped; empty before it has
    sessions: tuple[Session, ...]  # in order
    repair: str = ""  # message on the feasibility repair
    notes: tuple[str, ...] = ()  # why no design may win, or why the winner misses targets
    extensions: tuple[Extension, ...] = ()  # each time that its limits were raised
    prediction: WinnerPrediction | None = None  # as in `RunResult`
    recipe: RunRecipe | None = None  # as in `RunResult`

    @classmethod
    def read(cls, path: Path) -> "RunArchive":
        """Read a record; the run may still be in progress.

        Raises
        ------
        UnreadableFileError
            Where there is no record, or a damaged one.
        """
        if not path.is_file():
            raise UnreadableFileError(path, "there is no such file")
        with damage_errors(path), closing(_connected(path)) as connection:
            tables = {name for (name,) in connection.execute("SELECT name FROM sqlite_master")}
            if "run" not in tables:
                raise UnreadableFileError(path, "is not the record of a run")
            connection.execute("BEGIN")  # so that all is of one moment
            entries = dict(connection.execute("SELECT key, value FROM run").fetchall())
            identity = recorded_identity(entries, path)
            settings = settings_from_plain(identity.settings)
            maps = connection.execute("SELECT content FROM map ORDER BY place").fetchall()
            sessions = connection.execute("SELECT began_utc, seconds FROM session ORDER BY number")
            space = space_of(settings.space, settings.build)
            archive = cls(
                path=path,
                identity=identity,
                settings=settings,
                maps=tuple(map_from_text(text) for (text,) in maps),
                history=tuple(read_generations(connection)),
                finalists=read_finalists(connection, space),
                stopped=entries.get("stopped", ""),
                sessions=tuple(
                    Session(began_utc=began_utc, **asdict(TimeSplit.of_json(seconds)))
                    for began_utc, seconds in sessions
                ),
                repair=entries.get("repair", ""),
                notes=tuple(json.loads(entries.get("notes", "[]"))),
                extensions=read_extensions(connection),
                prediction=recorded_entry(entries, "prediction", WinnerPrediction),
                recipe=recorded_entry(entries, "recipe", RunRecipe),
            )
            if not maps:
                raise UnreadableFileError(path, "is damaged: it holds no training map")
            return archive

    @property
    def summary(self) -> RunSummary:
        """The record in numbers."""
        settings, history = self.settings, self.history
        winner = self.finalists[0] if self.finalists else None
        checked = settings.evaluation.fabricable
        return RunSummary(
            folder=str(self.path.parent),
            run=self.identity.run_id,
            seedless_run=self.identity.seedless_id,
            name=settings.name,
            task=settings.task.name,
            optimizer=settings.optimizer.name,
            seed=settings.search.seed,
            generations=len(history),
            most_generations=settings.search.generations,
            evaluations=sum(len(generation.fitness) for generation in history),
            seconds=sum(generation.seconds for generation in history),
            best_fitness=max((one.best for one in history), default=None),
            stopped=self.stopped or None,
            winner_score=None if winner is None else winner.score.composite,
            unseen_score=None if self.prediction is None else self.prediction.unseen.score,
            extensions=self.extensions,
            winner_fitness=None if winner is None else winner.fitness,
            manufacturable=None if winner is None or not checked else winner.penalty == 0.0,
            sessions=self.sessions,
            versions=self.identity.versions,
        )

    def result(self) -> RunResult:
        """Return the result of a run that has ended."""
        if not self.finalists:
            raise UnfitInputError(str(self.path), "the run has not ended", "resume it (--resume)")
        if not self.sessions:
            raise UnreadableFileError(self.path, "is damaged: the row of its session is missing")
        run_id = self.identity.run_id
        result = RunResult(
            run_id=run_id,
            best=design_of_finalist(
                self.finalists[0], self.settings, run_id, self.identity.versions, self.maps
            ),
            finalists=self.finalists,
            history=self.history,
            stopped=self.stopped,
            times=self.sessions[-1],
            checked=self.settings.evaluation.fabricable,
            repair=self.repair,
            notes=self.notes,
            extensions=self.extensions,
        )
        if self.recipe is not None:
            result = result.with_recipe(self.recipe, self.path.parent)
        return result.with_prediction(self.prediction) if self.prediction else result


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RecordTail:
    """The part of a record from one generation on: for following a running search.

    Reading it does not keep the run waiting, and takes as long as what is new.
    """

    settings: RunSettings
    run_id: str
    generations: tuple[Generation, ...]  # those with the number asked for, or a later one
    stopped: str  # why the run stopped; empty before it has
    winner_score: Score | None  # of its winner, on fresh poses; None before it has one

    @classmethod
    def read(cls, path: Path, first: int = 0) -> "RecordTail | None":
        """Return the generations from a number on; None while there is no record yet.

        Raises
        ------
        UnreadableFileError
            For a damaged record.
        """
        if not is_record(path):
            return None
        with damage_errors(path), closing(_connected(path)) as connection:
            tables = {name for (name,) in connection.execute("SELECT name FROM sqlite_master")}
            if "run" not in tables:
                return None
            # One transaction, so that all is of one moment.
            connection.execute("BEGIN")
            entries = dict(connection.execute("SELECT key, value FROM run").fetchall())
            identity = recorded_identity(entries, path)
            winner = connection.execute("SELECT score FROM finalist WHERE place = 0").fetchone()
            return cls(
                settings=settings_from_plain(identity.settings),
                run_id=identity.run_id,
                generations=tuple(read_generations(connection, first)),
                stopped=entries.get("stopped", ""),
                winner_score=None if winner is None else from_json(Score, winner[0]),
            )


_WAL_PLACE, _WAL_VERSIONS = 18, b"\x02\x02"
"""Where the first page of a SQLite file says that it has a write-ahead log."""


def is_record(path: Path) -> bool:
    """Tell whether a file may be read as a record without disturbing the run that creates it.

    A new file is empty until its run has chosen the write-ahead log, for which it must be alone.
    """
    try:
        with path.open("rb") as stream:
            head = stream.read(_WAL_PLACE + len(_WAL_VERSIONS))
    except OSError:
        return False
    return head[_WAL_PLACE:] == _WAL_VERSIONS


MOST_FOLDERS = 20_000
"""Folders that are looked into for records: a walk over a whole disk would not end."""


def records_in(folder: Path, *, most: int = MOST_FOLDERS, deepest: int = 64) -> list[Path]:
    """Return the paths of all records in a folder and below, in order.

    Links and hidden folders are left out, and other file systems.

    Raises
    ------
    UnreadableFileError
        If there is no such folder, or if there are too many below.
    """
    if not folder.is_dir():
        raise UnreadableFileError(folder, "there is no such folder")
    found, is_whole = records_below((folder,), most=most, deepest=deepest)
    if not is_whole:
        problem = f"has more than {most:,} folders below; name folders of runs"
        raise UnreadableFileError(folder, problem)
    return sorted(found)


def records_below(roots: Sequence[Path], *, most: int, deepest: int) -> tuple[list[Path], bool]:
    """Return the records in folders and below, and whether all folders were looked at.

    Links and hidden folders are left out, and other file systems.
    """
    found: dict[Path, None] = {}
    looked = 0
    for root in roots:
        device = root.stat().st_dev if root.is_dir() else None
        for name, below, files in os.walk(root):
            folder = Path(name)
            looked += 1
            if looked > most:
                return list(found), False
            if RECORD_FILE in files:
                found[folder / RECORD_FILE] = None
            is_deepest = len(folder.relative_to(root).parts) >= deepest
            below[:] = (
                []
                if is_deepest
                else sorted(
                    one for one in below if one[0] != "." and _device(folder / one) == device
                )
            )
    return list(found), True


def _device(folder: Path) -> int | None:
    """Return the file system that a folder lies on; None if it cannot be asked."""
    try:
        return folder.stat().st_dev
    except OSError:
        return None
