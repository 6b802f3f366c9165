"""Laser profiles: machine, material and recipe files (TOML), each number with its standing."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

from vinefab.core.errors import BadInputError
from vinefab.model.files.profile_forms import (
    CouponsForm,
    MachineForm,
    MaterialForm,
    MeasuredForm,
    NamedForm,
    OperationForm,
    QuantityForm,
    RecipeForm,
    SealerForm,
)
from vinefab.model.files.shipped import locate
from vinefab.model.files.toml import Form, read_toml, validated
from vinefab.model.laser import (
    EnergyWindow,
    LaserProfile,
    Machine,
    Material,
    OperationSettings,
    Quantity,
    Recipe,
    Standing,
    Tool,
)

F = TypeVar("F", bound=NamedForm)


def read_profile(recipe: str | Path) -> LaserProfile:
    """Return a recipe with its machine and its material.

    Parameters
    ----------
    recipe
        Path of a recipe file, or the name of one of the user's own or a shipped one. Its machine
        and material are looked for in ``../machines`` and ``../materials`` beside it, then by
        name. What was measured of the film (table ``[measured]``) takes the material's place.
    """
    path = locate("recipe", recipe)
    return profile_of(read_toml(path), path)


def profile_of(document: Mapping[str, Any], path: Path) -> LaserProfile:
    """Return the profile of a recipe file's content."""
    form = _formed(RecipeForm, document, path)
    _ensure_seals(form, path)
    material = _material(_read(MaterialForm, _beside(path, "material", form.material)))
    return LaserProfile(
        machine=_machine(_read(MachineForm, _beside(path, "machine", form.machine))),
        material=_with_measured(material, form.measured),
        recipe=Recipe(
            name=form.name,
            title=form.title,
            status=form.status,
            source=form.source,
            operations=_operations(form),
            growth=_nouns(form.growth) if form.growth else {},
            limits=form.limits,
            coupons=_nouns(form.coupons) if form.coupons else {},
            windows=_windows(form.coupons),
        ),
    )


def _with_measured(material: Material, form: MeasuredForm | None) -> Material:
    """Return a material with the numbers that were measured of it, all others as they are."""
    found = _nouns(form) if form else {}
    return replace(
        material,
        burst_kpa=found.get("burst_kpa", material.burst_kpa),
        burst_width_mm=found.get("burst_width_mm", material.burst_width_mm),
        friction=found.get("friction", material.friction),
    )


def _windows(form: CouponsForm | None) -> tuple[EnergyWindow, ...]:
    return tuple(
        EnergyWindow(
            operation=window.operation,
            focus_mm=window.focus_mm,
            least_mj_mm=window.least_mj_mm.noun() if window.least_mj_mm else None,
            most_mj_mm=window.most_mj_mm.noun() if window.most_mj_mm else None,
        )
        for window in (form.windows if form else ())
    )


def read_machine(name_or_path: str | Path) -> Machine:
    """Return a machine; errors as in `read_profile`."""
    return _machine(_read(MachineForm, locate("machine", name_or_path)))


def read_material(name_or_path: str | Path) -> Material:
    """Return a material; errors as in `read_profile`."""
    return _material(_read(MaterialForm, locate("material", name_or_path)))


def _ensure_seals(form: RecipeForm, path: Path) -> None:
    """Refuse a recipe that makes no seam, or the same seam with two tools."""
    welded = form.operations.weld is not None
    if form.sealer is None and not welded and form.operations.weldcut is None:
        raise BadInputError(
            "operations", "cut only", "weldcut, weld or a [sealer], for the seam", path
        )
    if form.sealer is not None and welded:
        raise BadInputError("sealer", "given with operations.weld", "one of the two", path)


def _operations(form: RecipeForm) -> dict[str, OperationSettings]:
    """Return the settings by operation; what a sealer does is the ``weld``."""
    found = {name: _operation(given) for name, given in form.operations if given}
    if form.sealer is None:
        return found
    return {"weld": _sealing(form.sealer), **found}


def _sealing(form: SealerForm) -> OperationSettings:
    none = Quantity(
        value=0.0, standing=Standing.COMPUTED, source="an impulse sealer makes the seam"
    )
    return OperationSettings(
        power_percent=none,
        min_power_percent=none,
        speed_mm_s=none,
        passes=1,
        focus_offset_mm=none,
        frequency_hz=none,
        air_assist=False,
        spot_mm=none,
        kerf_mm=none,
        overcut_mm=none,
        tool=Tool.IMPULSE_SEALER,
        temperature_c=form.temperature_c.noun(),
        dwell_s=form.dwell_s.noun(),
        seam_width_mm=form.seam_width_mm.noun(),
    )


def _beside(recipe: Path, kind: str, name: str) -> Path:
    own = recipe.resolve().parent.parent / f"{kind}s" / f"{name}.toml"
    return own if own.is_file() else locate(kind, name)


def _read(form_class: type[F], path: Path) -> F:
    return _formed(form_class, read_toml(path), path)


def _formed(form_class: type[F], document: Mapping[str, Any], path: Path) -> F:
    form = validated(form_class, document, path)
    if form.name != path.stem:
        # Other files refer to a profile by its file name: two names would be a trap.
        raise BadInputError("name", form.name, f"{path.stem!r}, the name of the file", path)
    return form


def _nouns(form: Form) -> dict[str, Quantity]:
    values = ((name, getattr(form, name)) for name in type(form).model_fields)
    return {name: value.noun() for name, value in values if isinstance(value, QuantityForm)}


def _machine(form: MachineForm) -> Machine:
    return Machine(
        name=form.name,
        title=form.title,
        colours=form.colours,
        hairline_mm=form.hairline_mm,
        **_nouns(form),
    )


def _material(form: MaterialForm) -> Material:
    return Material(
        name=form.name,
        title=form.title,
        plies=form.plies,
        weldable=form.weldable,
        **_nouns(form),
    )


def _operation(form: OperationForm) -> OperationSettings:
    numbers: dict[str, Any] = dict(_nouns(form))
    return OperationSettings(passes=form.passes, air_assist=form.air_assist, **numbers)
