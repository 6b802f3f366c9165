"""Schemas of laser profiles: machine, material and recipe files, each number with its standing."""

from collections.abc import Callable
from typing import Annotated, Literal

from pydantic import AfterValidator, Field

from vinefab.model.files.toml import Form
from vinefab.model.laser import Quantity, RecipeStatus, Standing


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
    weldcut: OperationForm | None = None
    cut: OperationForm


class SealerForm(Form):
    """The table ``[sealer]`` of a recipe whose seams an impulse sealer makes."""

    temperature_c: Positive
    dwell_s: Positive
    seam_width_mm: Positive


class MeasuredForm(Form):
    """The table ``[measured]`` of a recipe: measured numbers that take its film's place."""

    burst_kpa: Positive | None = None
    burst_width_mm: Positive | None = None
    friction: NotNegative | None = None


class GrowthForm(Form):
    """The table ``[growth]`` of a recipe: growth-pressure constants of the user's own tube."""

    yield_kpa: NotNegative
    drag_kpa_m: NotNegative
    storage_kpa: NotNegative
    friction: NotNegative
    width_mm: Positive


class WindowForm(Form):
    """A table ``[[coupons.windows]]``: line energies at which coupons came out right."""

    operation: Literal["weld", "weldcut"]
    focus_mm: Annotated[float, Field(ge=-1000, le=1000)]
    least_mj_mm: Positive | None = None
    most_mj_mm: Positive | None = None


class CouponsForm(Form):
    """The table ``[coupons]`` of a recipe: what coupons said that no other table holds."""

    peel_n_mm: NotNegative | None = None
    crotch_burst_kpa: Positive | None = None
    crotch_fillet_mm: Positive | None = None
    windows: list[WindowForm] = Field(default_factory=list)


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
    limits: dict[str, dict[str, float]] = Field(default_factory=dict)
