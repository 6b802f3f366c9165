"""Settings and maps as texts in a record, and back."""

import json
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import shapely

from vinefab.growth.options import GrowthOptions
from vinefab.model.design import Pouch
from vinefab.model.map import Map, Pose, Start
from vinefab.optimize.bounds import Bounds, BuildSettings, SpaceSettings
from vinefab.optimize.settings import (
    EvaluationSettings,
    MapSettings,
    PartSettings,
    RunSettings,
    SearchSettings,
)


def settings_from_plain(record: Mapping[str, Any]) -> RunSettings:
    """Return the settings of `vinefab.optimize.settings.plain_settings`."""
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
