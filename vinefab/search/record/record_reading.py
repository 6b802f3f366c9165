"""Settings, maps and rows of the record of a run, read whoever wrote them."""

import base64
import json
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import shapely
from shapely.errors import ShapelyError

from vinefab.core.errors import CannotWriteError, UnreadableFileError, VinefabError
from vinefab.core.validation import Floats
from vinefab.growth.options import GrowthOptions
from vinefab.model.design import Pouch
from vinefab.model.map import Map, Pose, Start
from vinefab.model.score import Evaluation, Score
from vinefab.search.record.identity import RunIdentity
from vinefab.search.record.result import Finalist, Generation
from vinefab.search.settings import (
    EvaluationSettings,
    MapSettings,
    PartSettings,
    RunSettings,
    SearchSettings,
)
from vinefab.search.space import Bounds, BuildSettings, Space, SpaceSettings
from vinefab.tasks.evaluate import composite


def to_blob(values: Floats) -> bytes:
    """Return numbers as 64-bit little-endian floats, in order."""
    return np.ascontiguousarray(values, dtype="<f8").tobytes()


def from_blob(data: bytes, rows: int | None = None) -> Floats:
    """Return the numbers of `to_blob`, shape (n,), or (rows, n / rows)."""
    values = np.frombuffer(data, dtype="<f8").astype(np.float64)
    return values if rows is None else values.reshape(rows, -1)


def state_to_text(state: Mapping[str, object]) -> str:
    """Return an optimizer's state as JSON, arrays of floats as the bits that they are made of."""
    plain = {
        name: {"shape": value.shape, "bits": base64.b64encode(to_blob(value)).decode()}
        if isinstance(value, np.ndarray)
        else value
        for name, value in state.items()
    }
    return json.dumps(plain, allow_nan=False)


def state_from_text(text: str) -> dict[str, Any]:
    """Return the state of `state_to_text`; arrays are arrays of floats again."""
    return {
        name: from_blob(base64.b64decode(value["bits"])).reshape(value["shape"])
        if isinstance(value, dict)
        else value
        for name, value in json.loads(text).items()
    }


def score_to_text(score: Score) -> str:
    """Return a score as JSON; floats are written so that they read back the same."""
    evaluations = [
        {
            "map": evaluation.map_name,
            "pose": asdict(evaluation.pose),
            "score": evaluation.score,
            "terms": dict(evaluation.terms),
        }
        for evaluation in score.evaluations
    ]
    return json.dumps({"task": score.task, "evaluations": evaluations}, allow_nan=False)


def score_from_text(text: str) -> Score:
    """Return the score of `score_to_text`."""
    record = json.loads(text)
    evaluations = tuple(
        Evaluation(
            map_name=entry["map"],
            pose=Pose(**entry["pose"]),
            score=entry["score"],
            terms=entry["terms"],
        )
        for entry in record["evaluations"]
    )
    return Score(
        task=record["task"],
        evaluations=evaluations,
        composite=composite([evaluation.score for evaluation in evaluations]),
    )


def settings_from_plain(record: Mapping[str, Any]) -> RunSettings:
    """Return the settings of `vinefab.search.settings.plain_settings`."""
    maps = dict(record["maps"])
    maps["files"] = tuple(Path(name) for name in maps["files"])
    return RunSettings(
        name=record["name"],
        maps=MapSettings(**maps),
        task=PartSettings(**record["task"]),
        space=_space(record["space"]),
        build=_build(record["build"]),
        growth=GrowthOptions(**record["growth"]),
        optimizer=PartSettings(**record["optimizer"]),
        search=SearchSettings(**record["search"]),
        evaluation=EvaluationSettings(**record["evaluation"]),
        objectives=tuple(record.get("objectives", ())),
    )


def _build(record: Mapping[str, Any]) -> BuildSettings:
    given = dict(record)
    pouch = given.pop("pouch", None)
    return BuildSettings(pouch=None if pouch is None else Pouch(**pouch), **given)


def _space(record: Mapping[str, Any]) -> SpaceSettings:
    ranges = {name: Bounds(**ends) for name, ends in record.items() if name != "by_level"}
    by_level = {
        int(level): {name: Bounds(**ends) for name, ends in table.items()}
        for level, table in record["by_level"].items()
    }
    return SpaceSettings(by_level=by_level, **ranges)


def map_to_text(world: Map) -> str:
    """Return a map as JSON, coordinates as the bits that they are made of."""
    record = {
        "name": world.name,
        "bounds": world.bounds.wkb_hex,
        "obstacles": [obstacle.wkb_hex for obstacle in world.obstacles],
        "starts": [asdict(start) for start in world.starts],
        "environment": world.environment,
        "seed": world.seed,
    }
    return json.dumps(record)


def map_from_text(text: str) -> Map:
    """Return the map of `map_to_text`; how it was made (``facts``) is not kept."""
    record = json.loads(text)
    starts = [dict(start) for start in record["starts"]]
    return Map(
        name=record["name"],
        bounds=shapely.from_wkb(record["bounds"]),
        obstacles=tuple(shapely.from_wkb(wkb) for wkb in record["obstacles"]),
        starts=tuple(Start(pose=Pose(**start.pop("pose")), **start) for start in starts),
        environment=record["environment"],
        seed=record["seed"],
    )


FILE_NAME = "run.sqlite"
SCHEMA = "vinefab/run-store-2"


def recorded_identity(kept: Mapping[str, str], path: Path) -> RunIdentity:
    """Return what a record is of."""
    if kept.get("schema") != SCHEMA:
        raise UnreadableFileError(
            path, f"is of form {kept.get('schema')}; this vinefab reads {SCHEMA}"
        )
    return RunIdentity(
        settings=json.loads(kept["settings"]),
        maps=tuple(json.loads(kept["maps"])),
        versions=json.loads(kept["versions"]),
    )


def read_generations(connection: sqlite3.Connection) -> list[Generation]:
    """Return every generation recorded, in order."""
    rows = connection.execute(
        "SELECT number, x, fitness, composite, penalty, seconds FROM generation ORDER BY 1"
    ).fetchall()
    return [_generation(connection, row) for row in rows]


def _generation(connection: sqlite3.Connection, row: tuple[Any, ...]) -> Generation:
    number, x, fitness, composite, penalty, seconds = row
    terms = connection.execute(
        "SELECT name, value FROM term WHERE generation = ? ORDER BY rowid", (number,)
    ).fetchall()
    return Generation(
        number=number,
        x=from_blob(x, rows=len(from_blob(fitness))),
        fitness=from_blob(fitness),
        composite=from_blob(composite),
        penalty=from_blob(penalty),
        terms={name: from_blob(value) for name, value in terms},
        seconds=seconds,
    )


def read_finalists(connection: sqlite3.Connection, space: Space) -> tuple[Finalist, ...]:
    """Return the finalists of a run that has ended, best first; none before."""
    rows = connection.execute(
        "SELECT x, penalty, fitness, score FROM finalist ORDER BY place"
    ).fetchall()
    return tuple(
        Finalist(
            x=from_blob(x),
            design=space.design(from_blob(x)),
            score=score_from_text(score),
            penalty=penalty,
            fitness=fitness,
        )
        for x, penalty, fitness, score in rows
    )


@contextmanager
def system_errors(path: Path) -> Iterator[None]:
    """Turn what SQLite and the system say into errors of ours."""
    try:
        yield
    except VinefabError:
        raise
    except sqlite3.IntegrityError as error:
        problem = "another process is going on with the same run"
        raise CannotWriteError(path, problem) from error
    except sqlite3.OperationalError as error:
        raise CannotWriteError(path, str(error)) from error
    except sqlite3.DatabaseError as error:
        raise UnreadableFileError(path, str(error)) from error
    except UnicodeDecodeError as error:  # SQLite quotes damaged bytes
        raise UnreadableFileError(path, f"is damaged or no record ({error})") from error
    except OSError as error:
        raise CannotWriteError(path, error.strerror or str(error)) from error


_DAMAGE = (ValueError, KeyError, TypeError, IndexError, AttributeError, OverflowError, ShapelyError)
"""What making sense of damaged texts and numbers raises."""


@contextmanager
def damage_errors(path: Path) -> Iterator[None]:
    """Say of whatever goes wrong while a record is read that the record is damaged."""
    try:
        yield
    except (sqlite3.Error, *_DAMAGE) as error:
        words = " ".join(str(error).split())[:80]
        raise UnreadableFileError(path, f"is damaged or no record ({words})") from error
    except OSError as error:
        if isinstance(error, VinefabError):
            raise
        raise UnreadableFileError(path, error.strerror or str(error)) from error
