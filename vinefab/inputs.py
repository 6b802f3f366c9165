"""What callers of the public functions pass, turned into nouns; anything else is a BadInputError.

A design, map, recipe or printer may be an object, a path or a name.
"""
# ruff: noqa: PLC0415  the rooms of tasks and runs are loaded when a task or a run is given

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any

from vinefab.core.errors import BadInputError
from vinefab.core.progress_lines import progress_shown
from vinefab.model.design import Design
from vinefab.model.files.design_toml import read_design
from vinefab.model.files.profile_toml import read_profile
from vinefab.model.files.run_recipe import ChosenRecipe
from vinefab.model.files.shipped import locate, names, path_given, user_names
from vinefab.model.laser import LaserProfile
from vinefab.model.map import Map, Pose

if TYPE_CHECKING:
    from vinefab.search.settings import RunSettings
    from vinefab.tasks.task import Task

DesignLike = Design | str | PathLike[str]
MapLike = Map | str | PathLike[str]
ContactsLike = Mapping[str, object] | str | PathLike[str]
ProgressLike = Callable[[float, str], None] | bool | None
PoseLike = Pose | tuple[float, float, float]
RecipeLike = LaserProfile | str | PathLike[str]


def all_names(kind: str) -> tuple[str, ...]:
    """Return the names of the shipped files of a kind and of the user's own."""
    return tuple(sorted({*names(kind), *user_names(kind)}))


def name_or_path(key: str, given: object, allowed: str) -> str | Path:
    """Return what a file is looked up by, or raise BadInputError for anything else."""
    return given if isinstance(given, str) else path_given(key, given, allowed)


def design_given(given: DesignLike, key: str = "design") -> Design:
    """Return a design, given as such, by its path or by its name."""
    if isinstance(given, Design):
        return given
    allowed = f"a Design, a path, or one of {', '.join(all_names('design'))}"
    return read_design(name_or_path(key, given, allowed))


def recipe_given(given: RecipeLike) -> LaserProfile:
    """Return a laser profile, given as such, or by its recipe's path or name."""
    if isinstance(given, LaserProfile):
        return given
    allowed = f"a LaserProfile, a path, or one of {', '.join(all_names('recipe'))}"
    return read_profile(name_or_path("recipe", given, allowed))


def recipe_for(design: Design, given: RecipeLike | None) -> ChosenRecipe:
    """Return the recipe to make a design with: the one given, that of its run, or the default."""
    if isinstance(given, LaserProfile):
        return ChosenRecipe(recipe="", profile=given)
    if given is not None:
        return ChosenRecipe(recipe=str(given), profile=recipe_given(given))
    chosen = ChosenRecipe.of(design)
    if chosen.is_other:
        warnings.warn(chosen.note, stacklevel=3)
    return chosen


def map_given(given: MapLike, key: str = "map") -> Map:
    """Return a map, given as such or by the path of its file."""
    if isinstance(given, Map):
        return given
    path = path_given(key, given, "a Map, or the path of a map file (GeoJSON)")
    if str(given) in maps_made_here() and not path.exists():
        allowed = f"a Map such as vf.maps.{given}(seed=1), or the path of a map file (GeoJSON)"
        raise BadInputError(key, given, allowed)
    return Map.read(path)


def maps_made_here() -> tuple[str, ...]:
    """Return the names of the functions that make maps."""
    from vinefab import maps

    return tuple(name for name in maps.__all__ if name not in ("read", "import_"))


def maps_given(given: MapLike | Iterable[MapLike]) -> list[Map]:
    """Return one or several maps, each as in `map_given`."""
    return [map_given(one, "maps") for one in several_given(given, Map)]


def several_given(given: Any, kind: type) -> Sequence[Any]:  # noqa: ANN401  judged one by one
    """Return one thing, or an iterable of them, as a sequence."""
    if isinstance(given, Mapping):
        given = given.values()
    alone = isinstance(given, kind | str | PathLike) or not isinstance(given, Iterable)
    return (given,) if alone else tuple(given)


def name_given(key: str, given: object) -> str:
    """Return a name, or raise BadInputError for what is no text."""
    if not isinstance(given, str):
        raise BadInputError(key, given, "a name")
    return given


def mapping_given(key: str, given: object) -> Mapping[str, Any]:
    """Return names with values; none for None."""
    if given is not None and not isinstance(given, Mapping):
        raise BadInputError(key, given, "names with their values, a dict")
    return given or {}


def limits_given(given: object) -> dict[str, Mapping[str, Any]]:
    """Return limits of rules by rule and name."""
    named = mapping_given("limits", given)
    return {str(rule): mapping_given(f"limits.{rule}", values) for rule, values in named.items()}


def growth_given(given: object, **shortcuts: object) -> Mapping[str, Any]:
    """Return growth options by name: those of a mapping, and those with a parameter of their own.

    A parameter that is None was not given.
    """
    options = dict(mapping_given("growth", given))
    for name, value in shortcuts.items():
        if value is None:
            continue
        if name in options and options[name] != value:
            raise BadInputError(name, value, f"not beside another one in growth, {options[name]!r}")
        options[name] = value
    if isinstance(options.get("contacts"), str | PathLike):
        from vinefab.model.files.contacts_toml import read_contacts

        options["contacts"] = read_contacts(options["contacts"])
    return options


@contextmanager
def progress_given(title: str, given: ProgressLike) -> Iterator[Callable[[float, str], None]]:
    """Return what to tell progress to: the function given, or a line for somebody who watches."""
    if callable(given):
        yield given
        return
    if given is not None and not isinstance(given, bool):
        raise BadInputError("progress", given, "True, False, or a function")
    with progress_shown(title, shown=bool(given)) as tell:
        yield tell


def flags_given(**given: object) -> None:
    """Raise BadInputError for what is no yes or no: the text ``"no"`` would count as yes."""
    for key, value in given.items():
        if not isinstance(value, bool):
            raise BadInputError(key, value, "True or False")


def listed_given(key: str, given: object, allowed: str) -> tuple[Any, ...]:
    """Return several values, or raise BadInputError for what is one thing."""
    if isinstance(given, str) or not isinstance(given, Iterable):
        raise BadInputError(key, given, allowed)
    return tuple(given)


def task_given(task: str | Task, parameters: Mapping[str, object]) -> Task:
    """Return a task by its name, or the one given."""
    from vinefab.tasks.shipped_tasks import TASKS, make_task

    if isinstance(task, str):
        return make_task(task, parameters)
    if isinstance(task, type) or not all(hasattr(task, n) for n in ("name", "lowest", "evaluate")):
        allowed = f"{', '.join(TASKS)}, or an object with name, lowest and evaluate"
        raise BadInputError("task", task, allowed)
    for name, value in parameters.items():
        raise BadInputError(name, value, "a parameter of a task that is named, not of an object")
    return task


def run_given(given: RunSettings | str | PathLike[str]) -> tuple[RunSettings, Path | None]:
    """Return the settings of a run, and the file that they come from."""
    from vinefab.search.settings import RunSettings, read_run

    if isinstance(given, RunSettings):
        return given, None
    allowed = "RunSettings, the path of a run file (TOML), or the name of a shipped one"
    path = locate("run file", name_or_path("run", given, allowed))
    return read_run(path), path


def call_text(given: object) -> str:
    """Return how a call names something: a text that can be passed again, if it was one."""
    if isinstance(given, LaserProfile):
        return f"<LaserProfile {given.recipe.name}>"
    if isinstance(given, Design | Map):
        return f"<{type(given).__name__} {given.name}>"
    return repr(str(given))
