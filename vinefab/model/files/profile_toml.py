"""Laser profiles: machine, material and recipe files (TOML), each number with its standing."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from vinefab.core.errors import BadInputError, UnknownNameError
from vinefab.core.table import validated
from vinefab.model.files.shipped import file_named, is_inside, locate, names, user_names
from vinefab.model.files.toml import read_toml
from vinefab.model.laser import LaserProfile, Machine, Material, Recipe

P = TypeVar("P", Machine, Material, Recipe)


def read_profile(recipe: str | Path) -> LaserProfile:
    """Return a recipe with its machine and its material.

    Parameters
    ----------
    recipe
        Path of a recipe file, or the name of one of the user's own or a shipped one. Its machine
        and material are searched in ``../machines`` and ``../materials`` next to it, in its own
        folder, then by name.
        Measured values of the film (table ``[measured]``) replace the material's.
    """
    path = locate("recipe", recipe)
    return profile_of(read_toml(path), path)


def profile_files(recipe: str | Path) -> dict[str, Path]:
    """Return the files that `read_profile` reads: ``recipe``, ``machine`` and ``material``."""
    path = locate("recipe", recipe)
    found = _read(Recipe, path)
    named = {"machine": found.machine, "material": found.material}
    return {"recipe": path, **{kind: _beside(path, kind, name) for kind, name in named.items()}}


def profile_of(document: Mapping[str, Any], path: Path) -> LaserProfile:
    """Return the profile of a recipe file's content."""
    recipe = _named_as_its_file(Recipe, document, path)
    material = _read(Material, _beside(path, "material", recipe.material))
    return LaserProfile(
        machine=_read(Machine, _beside(path, "machine", recipe.machine)),
        material=material if recipe.measured is None else recipe.measured.replaced_in(material),
        recipe=recipe,
    )


def read_machine(name_or_path: str | Path) -> Machine:
    """Return a machine; errors as in `read_profile`."""
    return _read(Machine, locate("machine", name_or_path))


def read_material(name_or_path: str | Path) -> Material:
    """Return a material; errors as in `read_profile`."""
    return _read(Material, locate("material", name_or_path))


def _beside(recipe: Path, kind: str, name: str) -> Path:
    """Return the file of a recipe's machine or material."""
    folder = recipe.resolve().parent
    file_name = f"{name.removesuffix('.toml')}.toml"
    near = (folder.parent / f"{kind}s" / file_name, folder / file_name)
    others = (path for path in near if path != recipe.resolve() and path.is_file())
    own = next((path for path in others if is_inside(path, (path.parent,))), None)
    own = own or file_named(kind, name)
    if own is None:
        raise UnknownNameError(kind, name, {*names(kind), *user_names(kind)})
    return own


def _read(kind: type[P], path: Path) -> P:
    return _named_as_its_file(kind, read_toml(path), path)


def _named_as_its_file(kind: type[P], document: Mapping[str, Any], path: Path) -> P:
    found = validated(kind, document, path)
    if found.name != path.stem:
        # Other files refer to a profile by its file name: two names would be a trap.
        raise BadInputError("name", found.name, f"{path.stem!r}, the name of the file", path)
    return found
