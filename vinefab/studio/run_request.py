"""The form of a search on the page: its proposals, and the run file of the chosen values."""

import math
import os
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w

from vinefab.core.codec import Record
from vinefab.core.errors import BadInputError
from vinefab.core.limits import deg
from vinefab.core.plain_text import GENERATOR, counted
from vinefab.core.table import declared_keys
from vinefab.core.validation import whole
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.model.design import (
    MOST_LEVELS,
    Branch,
    Design,
    Level,
    design_content,
    design_text,
)
from vinefab.model.files.shipped import DEFAULT_RECIPE
from vinefab.model.map import map_text
from vinefab.search.optimizers.optimizer import OPTIMIZERS
from vinefab.search.space import COSTS, LIMITS, BuildSettings, SpaceSettings
from vinefab.studio.state import PAGE, StudioState, label_of, texts_at
from vinefab.tasks import TASKS

RUN_FILE, START_FILE, SHOWN_MAP_FILE = "run.toml", "start.toml", "map.geojson"
"""Files that a search of the page begins with."""

_LEVEL = {key.field: key for key in declared_keys(Level) if key.field in LIMITS}
"""Variables of a level, by their names in a space."""

_NAMES = {key.name: name for name, key in _LEVEL.items()}


@dataclass(frozen=True, slots=True, kw_only=True)
class DesignValue(Record):
    """A value of the design that a search may change, as the page shows it."""

    key: str  # as in a design: ``level.0.angle_deg``
    level: int  # 1 for the trunk
    label: str
    unit: str
    value: float
    range: tuple[float, float]  # that is proposed
    limits: tuple[float, float]
    locked: bool
    whole: bool

    @classmethod
    def of(cls, key: str, level: int, name: str, value: float, *, locked: bool) -> "DesignValue":
        """Return a value with a range around it; ``name`` is that in a space: ``angle_deg``."""
        low, high = LIMITS[name]
        if name == "branches":
            around = value - 1.0, value + 1.0
        elif name == "angle_deg":
            around = round(value - 40.0), round(value + 40.0)
        else:
            around = max(min(1.0, value), round(0.6 * value)), round(1.4 * value) + 1.0
        return cls(
            key=key,
            level=level,
            label=label_of(_LEVEL[name]).lower(),
            unit=_LEVEL[name].unit,
            value=value,
            # The value lies within, so that the search can begin at it.
            range=(max(low, min(around[0], value)), min(high, max(around[1], value))),
            limits=LIMITS[name],
            locked=locked,
            whole=name == "branches",
        )

    @property
    def name(self) -> str:
        """What it is called in a space."""
        return _NAMES[self.key.rpartition(".")[2]]


def design_values(design: Design, locks: frozenset[str]) -> tuple[DesignValue, ...]:
    """Return the values of a design that are variables of a space, trunk first.

    Those of branches of their own stand together for each level, with ranges that hold them all.
    """
    if design.branches is not None:
        return tuple(_values_of_branches(design))
    values = [("trunk.length", 1, "length_mm", design.trunk_length_mm)]
    for index, level in enumerate(design.levels):
        values += [
            (f"level.{index}.{key.name}", index + 2, name, getattr(level, name))
            for name, key in _LEVEL.items()
        ]
    return tuple(
        DesignValue.of(key, level, name, value, locked=key in locks)
        for key, level, name, value in values
    )


def _values_of_branches(design: Design) -> Iterator[DesignValue]:
    """Yield trunk length, then longest branch, widest fan and most children of each level."""
    tree = design.tree
    children = np.bincount(tree.parent[1:], minlength=len(tree))
    trunk = design.trunk_length_mm
    yield DesignValue.of("trunk.length", 1, "length_mm", trunk, locked=False)
    for level in range(2, design.depth + 1):
        rows = tree.level == level
        shortest_mm = float(tree.length_mm[rows].min())
        fan_deg = min(360.0, 2.0 * float(np.abs(np.degrees(tree.offset_rad[rows])).max()))
        most = {
            "length_mm": float(tree.length_mm[rows].max()),
            "angle_deg": fan_deg,
            "branches": float(children[tree.level == level - 1].max()),
            "growth_percent": 100.0,
        }
        lowest = {
            "length_mm": math.floor(0.6 * shortest_mm),
            "angle_deg": 0.0,
            "branches": 1.0,
            "growth_percent": 100.0,
        }
        for name, key in _LEVEL.items():
            locked = name == "growth_percent"
            place = f"level.{level - 2}.{key.name}"
            value = DesignValue.of(place, level, name, most[name], locked=locked)
            low, high = value.range
            low = min(low, max(value.limits[0], lowest[name]))
            yield replace(value, range=(low, high))


def run_proposal(state: StudioState) -> dict[str, Any]:
    """Return the form of a search around the page's design, with its proposals."""
    is_free = state.design.branches is not None
    deeper, depth = SpaceSettings(), state.design.depth
    environment = state.world.environment if state.world else ""
    # What stands on the page is what is searched for: its targets, and its map.
    has_targets = state.world is not None and bool(state.world.targets)
    generated = {
        "environment": environment if environment in ENVIRONMENTS else "grid",
        "count": 4,
        "seed": 1,
    }
    costs = {name: f"little {name.replace('_', ' ')}" for name in COSTS}
    costs["branches"] = "few branches"
    build = state.design.build  # a search leaves some of it out
    tasks = TASKS.names()
    left = [name for name, given in (("taper", build.taper), ("collar", build.collar)) if given]
    notes = [f"{' and '.join(left)}: not in a search; what it finds has none"] if left else []
    own = [
        f"{name}s" if name != "pouch" else "pouches"
        for name in ("width", "taper", "fillet", "pouch")
        if is_free and any(_has_own(branch, name) for branch in state.design.branches or ())
    ]
    if own:
        notes.append(f"own {', '.join(own)} of branches: a search takes those of their levels")
    if state.design.limits:
        notes.append("the design's own limits of rules: a search takes the recipe's")
    return {
        "values": [value.content for value in design_values(state.design, state.locks)],
        "levels": [depth, depth],
        "most_levels": MOST_LEVELS,
        "deeper": {
            label_of(key).lower(): [getattr(deeper, name).low, getattr(deeper, name).high, key.unit]
            for name, key in _LEVEL.items()
        },
        "notes": notes,
        "tasks": list(tasks),
        "objectives": [
            *({"name": name, "kind": "cost", "words": words} for name, words in costs.items()),
            *({"name": name, "kind": "task", "words": f"{name} score"} for name in tasks),
        ],
        "optimizers": list(OPTIMIZERS.names()),
        "environments": list(ENVIRONMENTS.names()),
        "has_map": state.world is not None,
        "has_targets": has_targets,
        "settings": {
            "task": "reach" if has_targets else state.task,
            "objectives": [],
            "maps": {**generated, "shown": state.world is not None},
            "fabricable": True,
            "population": 24,
            "generations": 300,
            "optimizer": "",
            "seed": 1,
            "start_here": True,
            "free": is_free,
            "only": None,
        },
        "must_be_free": is_free,
    }


def _has_own(branch: Branch, name: str) -> bool:
    """Return whether a branch sets its width, taper, fillet or pouch itself."""
    key = name if name in ("taper", "pouch") else f"{name}_mm"
    return getattr(branch, key) is not None


def run_files(state: StudioState, ask: Mapping[str, Any], folder: Path) -> dict[str, str]:
    """Return the files of a search by their names: the run file, and its inputs.

    Parameters
    ----------
    ask
        ``task``, ``objectives``, ``maps``, ``levels``, ``ranges`` by key of the design,
        ``fabricable``, ``population``, ``generations``, ``optimizer``, ``seed``, ``start_here``,
        ``free``: whether every branch has its own angle and length; ``only``: the branch that alone
        may change, null for all; what is left out is as in `run_proposal`.
    folder
        Where the files will be; the run is called after it.
    """
    given = {**run_proposal(state)["settings"], **ask}
    is_free = bool(given["free"]) or state.design.branches is not None
    objectives = texts_at("objectives", given["objectives"])
    files: dict[str, str] = {}
    content: dict[str, Any] = {"schema": "vinefab/run-1", "name": folder.name}
    content["maps"] = _maps(state, given["maps"], folder, files)
    content["task"] = {"name": given["task"]}
    if objectives:
        others = [name for name in objectives if name != given["task"]]
        content["task"]["objectives"] = [given["task"], *others]
    content["space"] = _space(state, ask) | (_free(state.design) if is_free else {})
    if (only := given["only"]) is not None:
        if only not in state.design.names or not given["start_here"]:
            allowed = "a branch of a design of branches, at which the search begins"
            raise BadInputError("only", only, allowed, PAGE)
        content["space"]["only"] = [only]
    build = design_content(state.design)["build"]  # as the page's, without settings that no run has
    content["build"] = {name: build[name] for name in BuildSettings.model_fields if name in build}
    content["growth"] = {
        key: list(value) if isinstance(value, tuple) else value
        for key, value in state.growth.values.items()
        if value is not None
    }
    content["optimizer"] = {
        **({"name": given["optimizer"]} if given["optimizer"] else {}),
        **{key: given[key] for key in ("population", "generations", "seed")},
    }
    usual = "islands" if given["fabricable"] and not objectives else "another"
    # Of the searches of levels only islands can.
    if given["start_here"] and (is_free or (given["optimizer"] or usual) == "islands"):
        content["optimizer"]["start_from"] = [START_FILE]
        files[START_FILE] = design_text(state.design)
    recipe = "" if state.recipe == DEFAULT_RECIPE else state.recipe
    if Path(recipe).is_file():
        recipe = str(Path(recipe).resolve())  # a run file names it from any folder
    content["evaluation"] = {"fabricable": given["fabricable"], "recipe": recipe}
    head = f"# {GENERATOR}: a search begun on the studio's page\n"
    try:
        text = tomli_w.dumps(content)
    except (TypeError, ValueError) as error:
        raise BadInputError("settings", str(error), "texts, numbers and lists", PAGE) from None
    # Each list of plain values in one line, as people write them.
    text = _LIST.sub(lambda found: f"[{', '.join(found[1].split(_BETWEEN))[4:-2]}]", text)
    return {**files, RUN_FILE: head + text}


_LIST = re.compile(r"\[\n((?: +[^\[\]\n]*,\n)+)\]")
_BETWEEN = ",\n    "


def _maps(state: StudioState, given: object, folder: Path, files: dict[str, str]) -> dict[str, Any]:
    """Return the table of the training maps; the map on the page becomes a file of the run."""
    allowed = "environment, count and seed; files; or shown = true"
    if not isinstance(given, Mapping):
        raise BadInputError("maps", given, allowed, PAGE)
    if given.get("shown"):
        if state.world is None:
            raise BadInputError("maps.shown", "no map is open", "a map on the page", PAGE)
        files[SHOWN_MAP_FILE] = map_text(state.world)
        table: dict[str, Any] = {"files": [SHOWN_MAP_FILE]}
        if (pose := state.pose) is not None:  # else the map's own start is taken
            heading_deg = deg(pose.heading_rad)
            table["start"] = {"x_mm": pose.x_mm, "y_mm": pose.y_mm, "heading_deg": heading_deg}
        return table
    if "files" in given:
        names = texts_at("maps.files", given["files"])
        return {"files": [os.path.relpath(name, folder) for name in names]}
    return {key: given[key] for key in ("environment", "count", "seed") if key in given}


def _space(state: StudioState, ask: Mapping[str, Any]) -> dict[str, Any]:
    """Return the table of the space: a range for every value of the design, one for its depth.

    Levels that the design does not have keep the default ranges.
    """
    values = design_values(state.design, state.locks)
    depth = state.design.depth
    levels = ask.get("levels", [depth, depth])
    if not isinstance(levels, list) or len(levels) != 2:
        raise BadInputError("levels", levels, "[fewest, most]", PAGE)
    least = whole("levels", levels[0], 1, MOST_LEVELS)
    most = whole("levels", levels[1], least, MOST_LEVELS)
    locked = max((value.level for value in values if value.locked), default=1)
    if least < locked:
        allowed = f"at least {counted(locked, 'level')}: level {locked} has locked values"
        raise BadInputError("levels", levels, allowed, PAGE)
    ranges = ask.get("ranges") or {}
    known = {value.key for value in values}
    if not isinstance(ranges, Mapping) or not known.issuperset(ranges):
        raise BadInputError("ranges", ranges, f"ranges of {', '.join(sorted(known))}", PAGE)
    tables: dict[int, dict[str, Any]] = {}
    for value in values:
        if value.level <= most:
            table = tables.setdefault(value.level, {"number": value.level})
            asked = ranges.get(value.key, list(value.range))
            table[value.name] = _tidy(value.value if value.locked else asked)
    return {"levels": [least, most], "level": list(tables.values())}


def _free(design: Design) -> dict[str, Any]:
    """Return what makes a space one of free trees, with as many bends as a design has."""
    bends = int(np.bincount(design.tree.bend_branch).max(initial=0))
    return {"tree": "free"} | ({"bends": [0, bends]} if bends else {})


def _tidy(given: object) -> object:
    """Return whole numbers without a decimal point."""
    if isinstance(given, list):
        return [_tidy(value) for value in given]
    return int(given) if isinstance(given, float) and given.is_integer() else given
