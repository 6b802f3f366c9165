"""The known machines, materials and recipes, and their numbers."""

from pathlib import Path

from vinefab.core.errors import UnknownNameError
from vinefab.core.jsontext import json_text
from vinefab.core.table import Table
from vinefab.fabrication.package.job_json import (
    fluence_mj_mm2,
    operation_energy_mj_mm,
    plain_quantity,
)
from vinefab.model.files.profile_toml import read_machine, read_material, read_profile
from vinefab.model.files.shipped import existing_file, locate, names, user_names, user_root
from vinefab.model.files.toml import read_toml
from vinefab.model.laser import LaserProfile, Quantity, SealerSettings, quantities

_SCHEMA = "vinefab/profiles-1"
PROFILE_KINDS = ("machine", "material", "recipe")


def profile_list() -> list[str]:
    """Return one line for every machine, material and recipe, the user's own marked."""
    lines = []
    for kind in PROFILE_KINDS:
        own = user_names(kind)
        lines.append(f"{kind}s")
        for name in sorted({*names(kind), *own}):
            mark = " (yours)" if name in own else ""
            lines.append(f"  {name}{mark}: {_summary(kind, name)}")
    lines.append(f"your own files belong into {user_root()} (variable VINEFAB_PROFILES)")
    return lines


def kind_of(name: str) -> str:
    """Return the kind of a profile by its name or path: machine, material or recipe."""
    path = Path(name)
    if path.suffix or path.parent != Path():
        schema = str(read_toml(existing_file(path)).get("schema", ""))
        kinds = (kind for kind in PROFILE_KINDS if schema.startswith(f"vinefab/{kind}-"))
        return next(kinds, "recipe")
    known = {kind: {*names(kind), *user_names(kind)} for kind in PROFILE_KINDS}
    found = [kind for kind, known_names in known.items() if name in known_names]
    if not found:
        raise UnknownNameError("profile", name, set().union(*known.values()))
    return found[0]


def profile_numbers(name: str) -> dict[str, Quantity]:
    """Return every number of a machine, material or recipe, by its key.

    Those of a recipe include line energy and fluence, which are computed.
    """
    kind = kind_of(name)
    if kind == "machine":
        return quantities(read_machine(name))
    if kind == "material":
        return quantities(read_material(name))
    return _recipe_numbers(read_profile(name))


def explain(name: str) -> list[str]:
    """Return a profile as lines for the user: title, then each number with standing and source."""
    kind = kind_of(name)
    lines = [f"{kind} {_summary(kind, name)}", f"file {locate(kind, name)}"]
    if kind == "recipe":
        profile = read_profile(name)
        lines.append(f"machine {profile.machine.name}: {profile.machine.title}")
        lines.append(f"material {profile.material.name}: {profile.material.title}")
    numbers = profile_numbers(name)
    width = max(len(key) for key in numbers)
    for key, number in numbers.items():
        lines.append(f"  {key:<{width}}  {number.words()}  {number.standing}: {number.source}")
    return lines


def profile_json(name: str | None) -> str:
    """Return one profile, or the names of all, as JSON."""
    if name is None:
        known = {kind: sorted({*names(kind), *user_names(kind)}) for kind in PROFILE_KINDS}
        return json_text(_SCHEMA, {**known, "user_folder": str(user_root())})
    kind = kind_of(name)
    return json_text(
        _SCHEMA,
        {
            "kind": kind,
            "name": name,
            "file": str(locate(kind, name)),
            "numbers": {key: plain_quantity(q) for key, q in profile_numbers(name).items()},
        },
    )


def _recipe_numbers(profile: LaserProfile) -> dict[str, Quantity]:
    recipe = profile.recipe
    numbers: dict[str, Quantity] = {}
    for operation, settings in recipe.by_operation.items():
        if isinstance(settings, SealerSettings):
            numbers |= _prefixed(operation, recipe.sealer)
            continue
        numbers |= _prefixed(operation, settings)
        numbers[f"{operation}.line_energy_mj_mm"] = operation_energy_mj_mm(
            profile.machine, settings
        )
        numbers[f"{operation}.fluence_mj_mm2"] = fluence_mj_mm2(profile.machine, settings)
    numbers |= _prefixed("growth", recipe.growth) | _prefixed("coupons", recipe.coupons)
    for window in recipe.coupons.windows:
        numbers |= _prefixed(f"{window.operation}.focus_{window.focus_mm:g}_mm", window)
    lap = recipe.lap
    return numbers | (_prefixed(f"lap.{lap.method}", lap) if lap else {})


def _prefixed(prefix: str, table: Table | None) -> dict[str, Quantity]:
    found = {} if table is None else quantities(table)
    return {f"{prefix}.{key}": number for key, number in found.items()}


def _summary(kind: str, name: str) -> str:
    if kind == "machine":
        return read_machine(name).title
    if kind == "material":
        return read_material(name).title
    recipe = read_profile(name).recipe
    return f"{recipe.title} [{recipe.status}]"
