"""Laser profiles: machine, material and recipe files (TOML), each number with its standing."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from pydantic import AfterValidator, Field

from vinefab.core.errors import BadInputError, located
from vinefab.core.validation import SMALLEST
from vinefab.model.files.named_file import is_inside
from vinefab.model.files.shipped import locate
from vinefab.model.files.toml import Form, read_toml, validated
from vinefab.model.laser import (
    LARGEST_QUANTITY,
    SEAM_KEYS,
    SHRINKAGE_PERCENT,
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

    ``uncertainty`` and ``uncertainty_95`` may be added, in the number's own unit.
    """

    value: float  # in the unit that ends the key
    # measured, paper, published, computed or assumed
    standing: Annotated[Standing, Field(strict=False)]
    source: Annotated[str, Field(min_length=1)]  # who says so, or how it was found
    # one standard deviation, in the same unit
    uncertainty: Annotated[float, Field(ge=0, le=LARGEST_QUANTITY)] | None = None
    # half of the 95 % interval, in the same unit
    uncertainty_95: Annotated[float, Field(ge=0, le=LARGEST_QUANTITY)] | None = None

    def noun(self) -> Quantity:
        """Return the number with its standing."""
        return Quantity(
            value=self.value,
            standing=self.standing,
            source=self.source,
            uncertainty=self.uncertainty,
            uncertainty_95=self.uncertainty_95,
        )


def _within(low: float, high: float) -> Callable[[QuantityForm], QuantityForm]:
    def check_value(form: QuantityForm) -> QuantityForm:
        if not low <= form.value <= high:
            raise ValueError(f"a value from {low:g} to {high:g}")
        return form

    return check_value


Positive = Annotated[QuantityForm, AfterValidator(_within(SMALLEST, 1e9))]
Shrinkage = Annotated[QuantityForm, AfterValidator(_within(*SHRINKAGE_PERCENT))]
NotNegative = Annotated[QuantityForm, AfterValidator(_within(0.0, 1e9))]
Length = Annotated[QuantityForm, AfterValidator(_within(SMALLEST, 1e5))]
Breadth = Annotated[QuantityForm, AfterValidator(_within(0.0, 1e3))]
Friction = Annotated[QuantityForm, AfterValidator(_within(0.0, 10.0))]
Percent = Annotated[QuantityForm, AfterValidator(_within(0.0, 100.0))]
Power = Annotated[QuantityForm, AfterValidator(_within(1e-6, 100.0))]
Offset = Annotated[QuantityForm, AfterValidator(_within(-1000.0, 1000.0))]
FileName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=100)]


class NamedForm(Form):
    """Keys of every profile file."""

    name: FileName  # as the file, without its suffix
    title: str  # for people


F = TypeVar("F", bound=NamedForm)


class MachineForm(NamedForm):
    """A file in ``laser_profiles/machines``."""

    schema_: Literal["vinefab/machine-1"] = Field(alias="schema")  # kind of file and its version
    colours: str = "default"  # preset of its software
    # line width that its driver takes for a cut
    hairline_mm: Annotated[float, Field(ge=SMALLEST, le=10)] = 0.01
    bed_width_mm: Length  # along x
    bed_height_mm: Length  # along y
    margin_mm: Breadth  # rim of the bed that stays free
    power_w: Positive  # of the laser
    spot_mm: Positive  # diameter in focus
    rayleigh_mm: Positive  # depth over which the spot grows by the root of 2
    speed_max_mm_s: Positive  # of the head
    acceleration_mm_s2: Positive  # of the head


class MaterialForm(NamedForm):
    """A file in ``laser_profiles/materials``."""

    schema_: Literal["vinefab/material-1"] = Field(alias="schema")  # kind of file and its version
    plies: Annotated[int, Field(ge=1, le=10)]  # layers that are welded at once
    weldable: bool  # whether a laser can weld it
    ply_mm: Positive  # thickness of one layer
    roll_width_mm: Length  # of the film as it is bought
    density_kg_m3: Positive  # of the film
    modulus_mpa: Positive  # of elasticity
    strength_mpa: Positive  # in tension
    friction: Friction  # against the environment
    burst_kpa: Positive | None = None  # at which a tube burst
    burst_width_mm: Positive | None = None  # lay-flat width of that tube
    survived_kpa: Positive | None = None  # that a tube bore
    survived_width_mm: Positive | None = None  # lay-flat width of that tube
    # by how much welded film comes out shorter than drawn; none: taken as 0 (assumed)
    shrinkage_percent: Shrinkage | None = None


class OperationForm(Form):
    """A table ``[operations.NAME]`` of a recipe."""

    passes: Annotated[int, Field(ge=1, le=100)]  # over the same path
    air_assist: bool  # whether air blows on the cut
    power_percent: Power  # of the laser
    min_power_percent: Percent  # in corners
    speed_mm_s: Positive  # of the head
    focus_offset_mm: Offset  # above the focus; widens the spot
    frequency_hz: NotNegative  # of pulses
    spot_mm: Positive  # diameter at this offset
    kerf_mm: Breadth  # width that is removed
    seam_width_mm: Breadth  # width that is fused beside the kerf
    overcut_mm: Breadth  # that a closed path runs past its start


class OperationsForm(Form):
    """The tables ``[operations.NAME]`` of a recipe."""

    mark: OperationForm | None = None  # labels beside the body
    weld: OperationForm | None = None  # seam only
    weldcut: OperationForm | None = None  # seam and cut in one pass
    cut: OperationForm  # mouth and sheet


class SealerForm(Form):
    """The table ``[sealer]`` of a recipe whose seams an impulse sealer makes."""

    temperature_c: Positive  # of the bar
    dwell_s: Positive  # for which it stays shut
    seam_width_mm: Positive  # of the bar


class MeasuredForm(Form):
    """The table ``[measured]`` of a recipe: measured values that replace the material's."""

    burst_kpa: Positive | None = None  # at which a tube of yours burst
    burst_width_mm: Positive | None = None  # lay-flat width of that tube
    survived_kpa: Positive | None = None  # that a tube of yours bore
    survived_width_mm: Positive | None = None  # lay-flat width of that tube
    friction: Friction | None = None  # of your film on your obstacles
    shrinkage_percent: Shrinkage | None = None  # of your film where it is welded


class GrowthForm(Form):
    """The table ``[growth]`` of a recipe: growth-pressure constants of the user's own tube."""

    yield_kpa: NotNegative  # below which film does not evert
    drag_kpa_m: NotNegative  # per metre of path
    storage_kpa: NotNegative  # tension of the film in its store
    friction: Friction  # film on film, per radian of turn
    width_mm: Positive  # lay-flat width of the tube that was grown


class WindowForm(Form):
    """A table ``[[coupons.windows]]``: line energies at which coupons passed."""

    operation: Literal["weld", "weldcut"]  # whose energies these are
    focus_mm: Annotated[float, Field(ge=-1000, le=1000)]  # offset at which they were cut
    least_mj_mm: Positive | None = None  # that welded
    most_mj_mm: Positive | None = None  # that did not cut through


class CouponsForm(Form):
    """The table ``[coupons]`` of a recipe: coupon results that no other table holds."""

    peel_n_mm: NotNegative | None = None  # force per width at which a strip peeled
    crotch_burst_kpa: Positive | None = None  # of the crotch coupon
    crotch_fillet_mm: Positive | None = None  # its radius
    windows: list[WindowForm] = Field(default_factory=list)  # line energies that passed


class LapForm(Form):
    """The table ``[lap]`` of a recipe: the bond of sleeve joints."""

    # impulse_seal or adhesive_film
    method: Annotated[LapMethod, Field(strict=False)]
    band_mm: Positive  # width of the bond, along the branch
    strength_n_per_mm: Positive | None = None  # per millimetre of rim, at which it failed
    survived_n_per_mm: Positive | None = None  # per millimetre of rim, that it bore


class RecipeForm(NamedForm):
    """A file in ``laser_profiles/recipes``."""

    schema_: Literal["vinefab/recipe-1"] = Field(alias="schema")  # kind of file and its version
    machine: FileName  # its profile, by name or beside the recipe
    material: FileName  # its profile, by name or beside the recipe
    status: Annotated[RecipeStatus, Field(strict=False)]  # unverified, coupon_ok or burst_tested
    source: Annotated[str, Field(min_length=1)]  # where the settings come from
    operations: OperationsForm  # settings of each operation
    sealer: SealerForm | None = None  # in place of laser welds
    measured: MeasuredForm | None = None  # values of your film, in place of the material's
    growth: GrowthForm | None = None  # constants of growth pressure, if you measured them
    coupons: CouponsForm | None = None  # what else the coupons gave
    lap: LapForm | None = None  # the bond of robots in pieces
    limits: dict[str, dict[str, float]] = Field(default_factory=dict)  # of rules, for this recipe


# --- Reading ------------------------------------------------------------------------------------


def read_profile(recipe: str | Path) -> LaserProfile:
    """Return a recipe with its machine and its material.

    Parameters
    ----------
    recipe
        Path of a recipe file, or the name of one of the user's own or a shipped one. Its machine
        and material are searched in ``../machines`` and ``../materials`` beside it, in its own
        folder, then by name.
        Measured values of the film (table ``[measured]``) replace the material's.
    """
    path = locate("recipe", recipe)
    return profile_of(read_toml(path), path)


def profile_files(recipe: str | Path) -> dict[str, Path]:
    """Return the files that `read_profile` reads: ``recipe``, ``machine`` and ``material``."""
    path = locate("recipe", recipe)
    form = _read(RecipeForm, path)
    named = {"machine": form.machine, "material": form.material}
    return {"recipe": path, **{kind: _beside(path, kind, name) for kind, name in named.items()}}


def profile_of(document: Mapping[str, Any], path: Path) -> LaserProfile:
    """Return the profile of a recipe file's content."""
    form = _formed(RecipeForm, document, path)
    with located(path):
        _ensure_seals(form)
        _ensure_consistent(form)
    material = _material_at(_beside(path, "material", form.material))
    return LaserProfile(
        machine=_machine_at(_beside(path, "machine", form.machine)),
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
    seam = {name: found.pop(name) for name in SEAM_KEYS if name in found}
    changed: dict[str, Any] = dict(found)
    if seam:
        known = material.seam
        burst = "burst_kpa" in seam or ("survived_kpa" not in seam and known.burst)
        kind = "burst" if burst else "survived"
        # A width alone is that of the tube whose pressure is known, whether it burst or not.
        alone = next((seam[name] for name in seam if name.endswith("_width_mm")), known.width_mm)
        changed |= dict.fromkeys(SEAM_KEYS)
        changed[f"{kind}_kpa"] = seam.get(f"{kind}_kpa", known.pressure_kpa)
        changed[f"{kind}_width_mm"] = seam.get(f"{kind}_width_mm", alone)
    return replace(material, **changed)


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
    return _machine_at(locate("machine", name_or_path))


def read_material(name_or_path: str | Path) -> Material:
    """Return a material; errors as in `read_profile`."""
    return _material_at(locate("material", name_or_path))


def _ensure_seals(form: RecipeForm) -> None:
    """Refuse a recipe without a seam, or with two tools for the same seam."""
    welded = form.operations.weld is not None
    if form.sealer is None and not welded and form.operations.weldcut is None:
        raise BadInputError("operations", "cut only", "weldcut, weld or a [sealer], for the seam")
    if form.sealer is not None and welded:
        raise BadInputError("sealer", "given with operations.weld", "one of the two")


def _ensure_consistent(form: RecipeForm) -> None:
    """Refuse settings that contradict each other or their operation."""
    for name, settings in form.operations:
        if settings is None:
            continue
        power, least = settings.power_percent.value, settings.min_power_percent.value
        if least > power:
            allowed = f"at most power_percent, {power:g}"
            raise BadInputError(f"operations.{name}.min_power_percent", least, allowed)
        seam, kerf = settings.seam_width_mm.value, settings.kerf_mm.value
        if name in ("weld", "weldcut") and seam == 0.0:
            raise BadInputError(f"operations.{name}.seam_width_mm", seam, "more than 0: it seals")
        if name == "weld" and kerf > 0.0:
            allowed = "0: a weld removes nothing; what seals and cuts is a weldcut"
            raise BadInputError("operations.weld.kerf_mm", kerf, allowed)
    for number, window in enumerate(form.coupons.windows if form.coupons else (), start=1):
        least_energy, most = window.least_mj_mm, window.most_mj_mm
        if least_energy and most and least_energy.value > most.value:
            key = f"coupons.windows[{number}].least_mj_mm"
            raise BadInputError(key, least_energy.value, f"at most most_mj_mm, {most.value:g}")


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
    """Return the file of a recipe's machine or material."""
    folder = recipe.resolve().parent
    file_name = f"{name.removesuffix('.toml')}.toml"
    near = (folder.parent / f"{kind}s" / file_name, folder / file_name)
    others = (path for path in near if path != recipe.resolve() and path.is_file())
    own = next((path for path in others if is_inside(path, (path.parent,))), None)
    return own or locate(kind, name)


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


def _machine_at(path: Path) -> Machine:
    form = _read(MachineForm, path)
    with located(path):
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
