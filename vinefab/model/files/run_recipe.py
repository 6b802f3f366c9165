"""The recipe of a run: its copy beside the winner, and which recipe a design is made with.

``[origin] recipe`` of a design holds the name of the recipe, the path of the copy below the folder
of the design file, and a digest of recipe, machine and material together.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from vinefab.core.atomic import write_text
from vinefab.core.errors import BadInputError, UnknownNameError, values_hidden
from vinefab.core.hashing import fingerprint
from vinefab.model.design import ORIGIN_RECIPE, Design
from vinefab.model.files.named_file import path_inside
from vinefab.model.files.profile_toml import profile_files, read_profile
from vinefab.model.files.shipped import DEFAULT_RECIPE, locate, read_text
from vinefab.model.files.toml import read_toml
from vinefab.model.laser import LaserProfile

RECORD = "the record of the run"
COPY_FOLDER = "recipe_of_run"
"""Folder of the copy, beside the design file."""

_KEYS = ("name", "file", "digest")


def recipe_digest(recipe: str | Path) -> str:
    """Return a digest of the content of a recipe, its machine and its material, comments apart."""
    return fingerprint(*(read_toml(path) for path in profile_files(recipe).values()))


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRecipe:
    """The recipe of a run with the texts of its files."""

    name: str
    digest: str
    files: Mapping[str, str]  # text by path below the folder of the design; the recipe's first

    @classmethod
    def of(cls, recipe: str | Path) -> "RunRecipe":
        """Return a recipe, given by its path or name, with its files."""
        paths = profile_files(recipe)
        return cls(
            name=paths["recipe"].stem,
            digest=recipe_digest(recipe),
            files={
                f"{COPY_FOLDER}/{kind}s/{path.name}": read_text(path)
                for kind, path in paths.items()
            },
        )

    @property
    def origin(self) -> dict[str, str]:
        """What the origin of a design says of it."""
        return {"name": self.name, "file": next(iter(self.files)), "digest": self.digest}

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
    note: str = ""  # why it was chosen, as one line; empty where nothing else was asked for
    is_other: bool = False  # whether it differs from the recipe of the design's run

    @classmethod
    def of(cls, design: Design, recipe: str | Path | None = None) -> "ChosenRecipe":
        """Return the recipe named, or else that of the design's run, or else the default."""
        if recipe is not None:
            return cls(recipe=str(recipe), profile=read_profile(recipe))
        with values_hidden():
            return cls._of_origin(design)

    @classmethod
    def _of_origin(cls, design: Design) -> "ChosenRecipe":
        if ORIGIN_RECIPE not in design.origin:
            return cls(recipe=DEFAULT_RECIPE, profile=read_profile(DEFAULT_RECIPE))
        name, file, digest = _origin(design)
        copy = None
        if design.folder is not None:
            copy = path_inside(f"origin.{ORIGIN_RECIPE}.file", file, [design.folder], "the design")
        found = [*([copy] if copy is not None and copy.is_file() else []), *_named(name)]
        for path in found:
            if recipe_digest(path) == digest:
                said = f"recipe {name} of the design's run ({path})"
                return cls(recipe=str(path), profile=read_profile(path), note=said)
        missing = f"recipe {name} of the design's run"
        missing += " has changed since" if copy in found else f" is missing ({copy or file})"
        path = found[0] if found else locate("recipe", DEFAULT_RECIPE)
        used = f"{path}, digest {recipe_digest(path)} in place of {digest}"
        note = f"{missing}: used is {used}"
        return cls(recipe=str(path), profile=read_profile(path), note=note, is_other=True)


def _origin(design: Design) -> tuple[str, str, str]:
    """Return name, file and digest of the recipe in a design's origin."""
    table, key = design.origin[ORIGIN_RECIPE], f"origin.{ORIGIN_RECIPE}"
    if not isinstance(table, Mapping):
        raise BadInputError(key, table, f"a table with {', '.join(_KEYS)}")
    name, file, digest = (table.get(one) for one in _KEYS)
    for one in _KEYS:
        if not isinstance(table.get(one), str) or not table[one] or "\0" in table[one]:
            raise BadInputError(f"{key}.{one}", table.get(one), "a text")
    return str(name), str(file), str(digest)


def _named(name: str) -> list[Path]:
    """Return the user's own or the shipped recipe of a name, if there is one."""
    try:
        return [locate("recipe", name)] if Path(name).name == name else []
    except UnknownNameError:
        return []
