"""The context of a design: keys of ``[origin]`` in which the run that found it is remembered.

Small values stand there themselves: task, growth options, fingerprints of the training maps. The
recipe is a copy next to the design file, with its digest.
"""

import platform
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Annotated, Any, Self

import shapely
from pydantic import Field
from typing_extensions import Doc

from vinefab.core import __version__
from vinefab.core.atomic import write_text
from vinefab.core.codec import Record
from vinefab.core.errors import BadInputError, located, values_hidden
from vinefab.core.hashing import fingerprint
from vinefab.core.plain_text import counted, visible
from vinefab.core.table import Table, validated
from vinefab.model.design import Design
from vinefab.model.files.shipped import DEFAULT_RECIPE, file_named, locate, path_inside, read_text
from vinefab.model.files.toml import read_toml
from vinefab.model.laser import LaserProfile, profile_files, read_profile
from vinefab.model.map import Map
from vinefab.model.start import start_record
from vinefab.model.target import Target, targets_given

RECORD = "the record of the run"
COPY_FOLDER = "recipe_of_run"
"""Folder of the copy, next to the design file."""

PLACES = "targets"
"""Parameter of tasks that holds places on the maps of a run."""

_Text = Annotated[str, Field(pattern=r"^[^\x00]+$")]
_Title = Annotated[str, Field(pattern=r"^[^\x00-\x1f\x7f]*$")]


class RecipeOfRun(Table):
    """Table ``[origin.recipe]``: the recipe by which a run judged its designs."""

    name: Annotated[_Text, Doc("of the recipe")]
    file: Annotated[_Text, Doc("its copy, below the folder of the design file")]
    digest: Annotated[_Text, Doc("of the content of recipe, machine and material")]


class RunContext(Table):
    """Keys of ``[origin]`` of a design that commands use unless they are told otherwise."""

    run: Annotated[_Title, Doc("id of the run")] = ""
    run_name: Annotated[_Title, Doc("its name")] = ""
    task: Annotated[_Title, Doc("of the run")] = ""
    task_parameters: Annotated[
        Mapping[str, Any], Doc("of the task, targets among them; defaults for all others")
    ] = {}
    targets: Annotated[
        tuple[Mapping[str, Any], ...],
        Field(strict=False),
        Doc("of the training maps, where all have the same; the task may have others"),
    ] = ()
    maps: Annotated[
        tuple[str, ...], Field(strict=False), Doc("`shape_fingerprint` of each training map")
    ] = ()
    growth: Annotated[Mapping[str, Any], Doc("growth options of the run")] = {}
    recipe: Annotated[RecipeOfRun | None, Doc("by which the run judged")] = None

    @classmethod
    def of(cls, design: Design) -> Self:
        """Return the memory of a design; empty for one that no run has made.

        Raises
        ------
        BadInputError
            If a key cannot be used.
        """
        known = {key: design.origin[key] for key in cls.model_fields if key in design.origin}
        try:
            return validated(cls, known)
        except BadInputError as error:
            key = f"origin.{error.key}"
            raise error.under(key, f"design {design.name}") from None

    @property
    def kept(self) -> dict[str, Any]:
        """The keys with something in them, as an origin has them."""
        return {key: value for key, value in self.content.items() if value}

    @property
    def title(self) -> str:
        """What the run is called in messages."""
        if not self.run:
            return "the design's origin"
        return f"run {self.run_name} ({self.run})" if self.run_name else f"run {self.run}"

    @property
    def places(self) -> tuple[Target, ...]:
        """The targets of the run: its task's, else those of its maps."""
        named, key = self.task_parameters, "origin.task_parameters"
        if self.has_places:
            return targets_given(named[PLACES], f"{key}.targets")
        return targets_given(self.targets, "origin.targets")

    @property
    def has_places(self) -> bool:
        """Whether its task has targets, which took the place of those of its maps."""
        return bool(self.task_parameters.get(PLACES))

    @property
    def without_places(self) -> Self:
        """The same without targets."""
        named = {key: value for key, value in self.task_parameters.items() if key != PLACES}
        return self.changed(task_parameters=named, targets=())

    def trained_on(self, worlds: Iterable[Map]) -> list[bool]:
        """Return of which maps the run trained on the bounds and obstacles; none if not known."""
        return [shape_fingerprint(world) in self.maps for world in worlds] if self.maps else []

    def with_places(self, worlds: Sequence[Map]) -> list[Map]:
        """Return maps, those that the run trained on with its targets.

        The targets of its maps give way to what the files have since.
        """
        places, holds = self.places, self.has_places
        return [
            world.with_targets(*places)
            if places and (holds or not world.targets) and any(self.trained_on([world]))
            else world
            for world in worlds
        ]

    def seen_words(self, worlds: Iterable[Map]) -> str:
        """Return the number of maps that the run trained on; empty where it is unknown."""
        seen = self.trained_on(worlds)
        if not seen:
            return ""
        maps = "this map" if len(seen) == 1 else f"these {counted(len(seen), 'map')}"
        if any(seen):
            return f"{self.title} trained on {maps if all(seen) else f'{sum(seen)} of {maps}'}"
        return f"{self.title} trained on {'other maps' if len(seen) == 1 else f'none of {maps}'}"


def shape_fingerprint(world: Map) -> str:
    """Return a digest of the bounds and obstacles of a map, to 0.01 mm; names make no difference.

    Starts and targets make none either: a run may give a map its own.
    """
    shapes = shapely.normalize([world.bounds, *world.obstacles])
    bounds, *obstacles = shapely.to_wkt(shapes, rounding_precision=2)
    return fingerprint(bounds, sorted(obstacles))


def map_fingerprint(world: Map) -> str:
    """Return the fingerprint of a map's name, bounds, obstacles, starts and targets."""
    starts = [start_record(start) for start in world.starts]
    return fingerprint(
        world.name,
        world.bounds.wkb_hex,
        [obstacle.wkb_hex for obstacle in world.obstacles],
        starts,
        [target.content for target in world.targets],
    )


def recipe_digest(recipe: str | Path) -> str:
    """Return a digest of the content of a recipe, its machine and its material, comments apart."""
    return fingerprint(*(read_toml(path) for path in profile_files(recipe).values()))


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRecipe(Record):
    """The recipe of a run with the texts of its files."""

    name: str
    digest: str
    files: Mapping[str, str]  # text by path below the folder of the design; the recipe's first

    @classmethod
    def of(cls, recipe: str | Path) -> "RunRecipe":
        """Return a recipe, given by its path or name, with its files."""
        paths = profile_files(recipe)
        return cls(
            name=visible(paths["recipe"].stem),
            digest=recipe_digest(recipe),
            files={
                f"{COPY_FOLDER}/{kind}s/{path.name}": read_text(path)
                for kind, path in paths.items()
            },
        )

    @property
    def remembered(self) -> RecipeOfRun:
        """What a design remembers of it."""
        return RecipeOfRun(name=self.name, file=next(iter(self.files)), digest=self.digest)

    def write(self, folder: Path) -> None:
        """Write the files below a folder; those that are there already stay as they are."""
        texts = {
            path_inside("recipe.files", name, [folder], RECORD): text
            for name, text in self.files.items()
        }
        for path, text in texts.items():
            if not path.exists():
                write_text(path, text)


@dataclass(frozen=True, slots=True, kw_only=True)
class ChosenRecipe:
    """The recipe that a design is checked and made with."""

    recipe: str  # name or path by which it is read again
    profile: LaserProfile
    note: str = ""  # where it was found, as one line; empty where the design remembers none
    is_other: bool = False  # whether it differs from the recipe of the design's run

    @classmethod
    def of(cls, design: Design) -> "ChosenRecipe":
        """Return the recipe of a design's run, or else the default."""
        with values_hidden():
            run = RunContext.of(design)
            if run.recipe is None:
                return cls(recipe=DEFAULT_RECIPE, profile=read_profile(DEFAULT_RECIPE))
            return cls._of_run(design, run.recipe)

    @classmethod
    def _of_run(cls, design: Design, wanted: RecipeOfRun) -> "ChosenRecipe":
        copy = None
        if design.folder is not None:
            copy = path_inside("origin.recipe.file", wanted.file, [design.folder], "the design")
        places = [copy]
        if Path(wanted.name).name == wanted.name:  # here, the user's own or the shipped one
            places += [Path(f"{wanted.name}.toml"), file_named("recipe", wanted.name)]
        found = [path for path in places if path is not None and path.is_file()]
        for path in found:
            with located(path):
                digest = recipe_digest(path)
            if digest == wanted.digest:
                note = f"recipe {wanted.name} of the design's run ({path})"
                return cls(recipe=str(path), profile=read_profile(path), note=note)
        missing = f"recipe {wanted.name} of the design's run"
        missing += " has changed since" if copy in found else f" is missing ({copy or wanted.file})"
        path = found[0] if found else locate("recipe", DEFAULT_RECIPE)
        used = f"{path}, digest {recipe_digest(path)} in place of {wanted.digest}"
        note = f"{missing}: used is {used}"
        return cls(recipe=str(path), profile=read_profile(path), note=note, is_other=True)


_PACKAGES = ("cmaes", "numba", "numpy", "pymoo", "pyswarms", "scipy", "shapely")

_own_version = cache(version)  # to ask takes a millisecond; plug-ins are asked for each time


def package_versions(others: Iterable[str] = ()) -> dict[str, str]:
    """Return the versions of all packages that a run's numbers depend on."""
    versions = {"vinefab": __version__, "python": platform.python_version()}
    for name in (*_PACKAGES, *others):
        if name not in versions:
            try:
                versions[name] = (_own_version if name in _PACKAGES else version)(name)
            except PackageNotFoundError:
                versions[name] = "none"
    return versions
