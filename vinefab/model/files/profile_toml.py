"""Laser profiles: machine, material and recipe files (TOML), each number with its standing."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, Field

from vinefab.core.errors import BadInputError, located
from vinefab.model.files.shipped import locate
from vinefab.model.files.toml import Form, read_toml, validated
from vinefab.model.laser import (
    SEAM_KEYS,
    EnergyWindow,
    LapBond,
    LapMethod,
    LaserProfile,
    Machine,
    Material,
    OperationSettings,
    Quantity,
    Recipe,
    RecipeStatus,
    Standing,
    Tool,
)

# --- Schemas ------------------------------------------------------------------------------------


class QuantityForm(Form):
    """Inline table ``{ value, standing, source }``: a number is never without its standing.

    ``uncertainty`` may be added: one standard deviation, in the number's own unit.
    """

    value: float
    standing: Annotated[Standing, Field(strict=False)]
    source: Annotated[str, Field(min_length=1)]
    uncertainty: Annotated[float, Field(ge=0)] | None = None

    def noun(self) -> Quantity:
        """Return the number with its standing."""
        return Quantity(
            value=self.value,
            standing=self.standing,
            source=self.source,
            uncertainty=self.uncertainty,
        )


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
    """Keys of every profile file."""

    name: FileName
    title: str


F = TypeVar("F", bound=NamedForm)


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
    burst_kpa: Positive | None = None
    burst_width_mm: Positive | None = None
    survived_kpa: Positive | None = None
    survived_width_mm: Positive | None = None


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
    weldcut: OperationForm | None = None
    cut: OperationForm


class SealerForm(Form):
    """The table ``[sealer]`` of a recipe whose seams an impulse sealer makes."""

    temperature_c: Positive
    dwell_s: Positive
    seam_width_mm: Positive


class MeasuredForm(Form):
    """The table ``[measured]`` of a recipe: measured values that replace the material's."""

    burst_kpa: Positive | None = None
    burst_width_mm: Positive | None = None
    survived_kpa: Positive | None = None
    survived_width_mm: Positive | None = None
    friction: NotNegative | None = None


class GrowthForm(Form):
    """The table ``[growth]`` of a recipe: growth-pressure constants of the user's own tube."""

    yield_kpa: NotNegative
    drag_kpa_m: NotNegative
    storage_kpa: NotNegative
    friction: NotNegative
    width_mm: Positive


class WindowForm(Form):
    """A table ``[[coupons.windows]]``: line energies at which coupons passed."""

    operation: Literal["weld", "weldcut"]
    focus_mm: Annotated[float, Field(ge=-1000, le=1000)]
    least_mj_mm: Positive | None = None
    most_mj_mm: Positive | None = None


class CouponsForm(Form):
    """The table ``[coupons]`` of a recipe: coupon results that no other table holds."""

    peel_n_mm: NotNegative | None = None
    crotch_burst_kpa: Positive | None = None
    crotch_fillet_mm: Positive | None = None
    windows: list[WindowForm] = Field(default_factory=list)


class LapForm(Form):
    """The table ``[lap]`` of a recipe: the bond of sleeve joints."""

    method: Annotated[LapMethod, Field(strict=False)]
    band_mm: Positive
    strength_n_per_mm: Positive | None = None
    survived_n_per_mm: Positive | None = None


class RecipeForm(NamedForm):
    """A file in ``laser_profiles/recipes``."""

    schema_: Literal["vinefab/recipe-1"] = Field(alias="schema")
    machine: FileName
    material: FileName
    status: Annotated[RecipeStatus, Field(strict=False)]
    source: Annotated[str, Field(min_length=1)]
    operations: OperationsForm
    sealer: SealerForm | None = None
    measured: MeasuredForm | None = None
    growth: GrowthForm | None = None
    coupons: CouponsForm | None = None
    lap: LapForm | None = None
    limits: dict[str, dict[str, float]] = Field(default_factory=dict)


# --- Reading ------------------------------------------------------------------------------------


def read_profile(recipe: str | Path) -> LaserProfile:
    """Return a recipe with its machine and its material.

    Parameters
    ----------
    recipe
        Path of a recipe file, or the name of one of the user's own or a shipped one. Its machine
        and material are searched in ``../machines`` and ``../materials`` beside it, then by name.
        Measured values of the film (table ``[measured]``) replace the material's.
    """
    path = locate("recipe", recipe)
    return profile_of(read_toml(path), path)


def profile_of(document: Mapping[str, Any], path: Path) -> LaserProfile:
    """Return the profile of a recipe file's content."""
    form = _formed(RecipeForm, document, path)
    _ensure_seals(form, path)
    material = _material_at(_beside(path, "material", form.material))
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
            lap=_lap(form.lap, path),
        ),
    )


def _with_measured(material: Material, form: MeasuredForm | None) -> Material:
    """Return a material with its measured values replaced."""
    found = _nouns(form) if form else {}
    friction = found.pop("friction", material.friction)
    if not found:
        return replace(material, friction=friction)
    known = material.seam
    burst = "burst_kpa" in found or ("survived_kpa" not in found and known.burst)
    kind = "burst" if burst else "survived"
    # A width alone is that of the tube whose pressure is known, whether it burst or not.
    alone = next((found[name] for name in found if name.endswith("_width_mm")), known.width_mm)
    seam: dict[str, Any] = dict.fromkeys(SEAM_KEYS)
    seam[f"{kind}_kpa"] = found.get(f"{kind}_kpa", known.pressure_kpa)
    seam[f"{kind}_width_mm"] = found.get(f"{kind}_width_mm", alone)
    return replace(material, friction=friction, **seam)


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


def _lap(form: LapForm | None, path: Path) -> LapBond | None:
    if form is None:
        return None
    with located(path):
        return LapBond(method=form.method, **_nouns(form))


def read_machine(name_or_path: str | Path) -> Machine:
    """Return a machine; errors as in `read_profile`."""
    return _machine(_read(MachineForm, locate("machine", name_or_path)))


def read_material(name_or_path: str | Path) -> Material:
    """Return a material; errors as in `read_profile`."""
    return _material_at(locate("material", name_or_path))


def _ensure_seals(form: RecipeForm, path: Path) -> None:
    """Refuse a recipe without a seam, or with two tools for the same seam."""
    welded = form.operations.weld is not None
    if form.sealer is None and not welded and form.operations.weldcut is None:
        raise BadInputError(
            "operations", "cut only", "weldcut, weld or a [sealer], for the seam", path
        )
    if form.sealer is not None and welded:
        raise BadInputError("sealer", "given with operations.weld", "one of the two", path)


def _operations(form: RecipeForm) -> dict[str, OperationSettings]:
    """Return the settings by operation; the sealer's is the ``weld``."""
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


def _material_at(path: Path) -> Material:
    form = _read(MaterialForm, path)
    with located(path):
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
