"""Laser profiles: machine, material and recipe files (TOML), each number with its standing."""

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Literal, TypeVar

from pydantic import AfterValidator, Field

from vinefab.core.errors import BadInputError
from vinefab.files.shipped import locate
from vinefab.files.toml import Form, check, read_toml
from vinefab.model.laser import (
    LaserProfile,
    Machine,
    Material,
    OperationSettings,
    Quantity,
    Recipe,
    RecipeStatus,
    Standing,
)

F = TypeVar("F", bound="NamedForm")


class QuantityForm(Form):
    """Inline table ``{ value, standing, source }``: a number is never without its standing."""

    value: float
    standing: Annotated[Standing, Field(strict=False)]
    source: Annotated[str, Field(min_length=1)]

    def noun(self) -> Quantity:
        """Return the number with its standing."""
        return Quantity(value=self.value, standing=self.standing, source=self.source)


def _within(low: float, high: float) -> Callable[[QuantityForm], QuantityForm]:
    def check_value(form: QuantityForm) -> QuantityForm:
        if not low <= form.value <= high:
            raise ValueError(f"a value from {low:g} to {high:g}")
        return form

    return check_value


Positive = Annotated[QuantityForm, AfterValidator(_within(1e-6, 1e9))]
NotNegative = Annotated[QuantityForm, AfterValidator(_within(0.0, 1e9))]
Percent = Annotated[QuantityForm, AfterValidator(_within(0.0, 100.0))]
Offset = Annotated[QuantityForm, AfterValidator(_within(-1000.0, 1000.0))]
FileName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=100)]


class NamedForm(Form):
    """What every profile file has."""

    name: FileName
    title: str


class MachineForm(NamedForm):
    """A file in ``laser_profiles/machines``."""

    schema_: Literal["vinefab/machine-1"] = Field(alias="schema")
    colours: str = "default"
    hairline_mm: Annotated[float, Field(gt=0, le=10)] = 0.01
    bed_width_mm: Positive
    bed_height_mm: Positive
    margin_mm: NotNegative
    power_w: Positive
    spot_mm: Positive
    rayleigh_mm: Positive
    speed_max_mm_s: Positive
    acceleration_mm_s2: Positive


class MaterialForm(NamedForm):
    """A file in ``laser_profiles/materials``."""

    schema_: Literal["vinefab/material-1"] = Field(alias="schema")
    plies: Annotated[int, Field(ge=1, le=10)]
    weldable: bool
    ply_mm: Positive
    roll_width_mm: Positive
    density_kg_m3: Positive
    modulus_mpa: Positive
    strength_mpa: Positive
    friction: NotNegative
    burst_kpa: Positive
    burst_width_mm: Positive


class OperationForm(Form):
    """A table ``[operations.NAME]`` of a recipe."""

    passes: Annotated[int, Field(ge=1, le=100)]
    air_assist: bool
    power_percent: Percent
    min_power_percent: Percent
    speed_mm_s: Positive
    focus_offset_mm: Offset
    frequency_hz: NotNegative
    spot_mm: Positive
    kerf_mm: NotNegative
    seam_width_mm: NotNegative
    overcut_mm: NotNegative


class OperationsForm(Form):
    """The tables ``[operations.NAME]`` of a recipe."""

    mark: OperationForm | None = None
    weld: OperationForm | None = None
    weldcut: OperationForm
    cut: OperationForm


class RecipeForm(NamedForm):
    """A file in ``laser_profiles/recipes``."""

    schema_: Literal["vinefab/recipe-1"] = Field(alias="schema")
    machine: FileName
    material: FileName
    status: Annotated[RecipeStatus, Field(strict=False)]
    source: Annotated[str, Field(min_length=1)]
    operations: OperationsForm


def read_profile(recipe: str | Path) -> LaserProfile:
    """Return a recipe with its machine and its material.

    Parameters
    ----------
    recipe
        Path of a recipe file or the name of a shipped one. Its machine and material are looked
        for in ``../machines`` and ``../materials`` beside it, then among the shipped ones.

    Raises
    ------
    UnreadableFileError, UnknownNameError, BadInputError
        With the file, the key, the value and what is allowed.
    """
    path = locate("recipe", recipe)
    form = _read(RecipeForm, path)
    return LaserProfile(
        machine=_machine(_read(MachineForm, _beside(path, "machine", form.machine))),
        material=_material(_read(MaterialForm, _beside(path, "material", form.material))),
        recipe=Recipe(
            name=form.name,
            title=form.title,
            status=form.status,
            source=form.source,
            operations={name: _operation(given) for name, given in form.operations if given},
        ),
    )


def _beside(recipe: Path, kind: str, name: str) -> Path:
    own = recipe.resolve().parent.parent / f"{kind}s" / f"{name}.toml"
    return own if own.is_file() else locate(kind, name)


def _read(form_class: type[F], path: Path) -> F:
    form = check(form_class, read_toml(path), path)
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
    return OperationSettings(passes=form.passes, air_assist=form.air_assist, **_nouns(form))
