"""The known machines, materials and recipes, and their numbers."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from vinefab.core.errors import UnknownNameError
from vinefab.core.table import Table
from vinefab.core.view import Answer, Block, Data, Fact, Facts, Result, Rows, Text
from vinefab.fabrication.package.bom import computed_energies
from vinefab.model.files.shipped import existing_file, locate, names, user_names, user_root
from vinefab.model.files.toml import read_toml
from vinefab.model.laser import read_machine, read_material, read_profile
from vinefab.model.quantity import Quantity, quantities

PROFILE_KINDS = ("machine", "material", "recipe")


class ProfileListing(Result):
    """The names of all machines, materials and recipes."""

    schema = "vinefab/profiles-1"

    def view(self) -> Iterator[Block]:
        """Yield one row for every profile, the user's own marked."""
        for kind in PROFILE_KINDS:
            own = user_names(kind)
            known = sorted({*names(kind), *own})
            yield Rows(
                caption=f"{kind}s",
                headings=("", "", ""),
                rows=tuple(
                    (name, _summary(kind, name), "yours" if name in own else "") for name in known
                ),
            )
            yield Data({kind: known})
        yield Text(f"your own files belong into {user_root()} (variable VINEFAB_PROFILES)")
        yield Data({"user_folder": str(user_root())})


@dataclass(frozen=True, slots=True, kw_only=True, repr=False)
class ProfileNumbers(Result):
    """What is known of a machine, a material or a recipe: every number with its standing.

    Parameters
    ----------
    name
        Its name or path.
    """

    name: str
    schema = "vinefab/profiles-1"

    def view(self) -> Iterator[Block]:
        """Yield title and file, then each number with standing and source."""
        kind, numbers = kind_of(self.name), profile_numbers(self.name)
        file = str(locate(kind, self.name))
        yield Answer(f"{kind} {_summary(kind, self.name)}")
        parts = tuple[Fact, ...]()
        if kind == "recipe":
            profile = read_profile(self.name)
            machine, material = profile.machine, profile.material
            parts = (Fact("machine", f"{machine.name}: {machine.title}"),
                     Fact("material", f"{material.name}: {material.title}"))  # fmt: skip
        yield Facts((Fact("file", file, "file"), *parts))
        yield Rows(
            caption="",
            headings=("", "", "", ""),
            rows=tuple((k, q.words(), str(q.standing), q.source) for k, q in numbers.items()),
        )
        plain = {key: quantity.content for key, quantity in numbers.items()}
        yield Data({"kind": kind, "name": self.name, "numbers": plain})


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
    profile = read_profile(name)
    recipe = profile.recipe
    numbers: dict[str, Quantity] = {}
    for operation, settings in recipe.by_operation.items():
        numbers |= _prefixed(operation, settings)
        energies = computed_energies(profile, settings)
        numbers |= {f"{operation}.{key}": energy for key, energy in energies.items()}
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
