"""Laser profiles: machines, materials and recipes, every number with its standing.

Each is declared once: as the table of a file (TOML) and as the noun that rooms share. Files of
recipes name those of their machine and material.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from annotated_types import Ge, Interval, Le, Unit
from pydantic import Field, model_validator
from typing_extensions import Doc

from vinefab.core.errors import BadInputError, UnfitInputError, UnknownNameError
from vinefab.core.limits import SMALLEST
from vinefab.core.plain_text import quoted, visible
from vinefab.core.table import Table, validated
from vinefab.model.files.shipped import file_named, is_inside, locate, names, user_names
from vinefab.model.files.toml import read_toml

LARGEST_QUANTITY = 1e12
"""Limit of every number with a standing, in its unit."""


class Standing(StrEnum):
    """How far a number may be trusted."""

    MEASURED = "measured"
    PAPER = "paper"
    PUBLISHED = "published"
    COMPUTED = "computed"
    ASSUMED = "assumed"


class Quantity(Table):
    """A number with its standing and source; its unit is in the name of the field that holds it.

    In files: the inline table ``{ value, standing, source }``.
    """

    value: Annotated[
        float,
        Interval(ge=-LARGEST_QUANTITY, le=LARGEST_QUANTITY),
        Doc("in the unit that ends the key"),
    ]
    standing: Annotated[Standing, Field(strict=False), Doc("how far it may be trusted")]
    source: Annotated[str, Field(min_length=1), Doc("who says so, or how it was found")]
    uncertainty: Annotated[
        float | None,
        Interval(ge=0, le=LARGEST_QUANTITY),
        Doc("one standard deviation, in the same unit"),
    ] = None
    # It changes nothing that is predicted: no part of a recipe's fingerprint.
    uncertainty_95: Annotated[
        float | None,
        Interval(ge=0, le=LARGEST_QUANTITY),
        Field(repr=False),
        Doc(
            "half of the 95 % interval, in the same unit; wider than two standard deviations where"
            " readings were few"
        ),
    ] = None

    def __float__(self) -> float:
        return self.value

    def __ge__(self, least: float) -> bool:  # fields declare ranges of quantities as of numbers
        return self.value >= least

    def __le__(self, most: float) -> bool:
        return self.value <= most

    def words(self) -> str:
        """Return the number and, if known, its 95 % interval or else its standard uncertainty.

        >>> friction = Quantity(value=0.26, standing=Standing.MEASURED, source="my incline")
        >>> friction.changed(uncertainty=0.013).words()
        '0.26 +- 0.013'
        >>> friction.changed(uncertainty_95=0.056).words()
        '0.26 +- 0.056 (95 %)'
        """
        if self.uncertainty_95 is not None:
            return f"{self.value:g} +- {self.uncertainty_95:.2g} (95 %)"
        spread = "" if self.uncertainty is None else f" +- {self.uncertainty:.2g}"
        return f"{self.value:g}{spread}"


_POSITIVE = Interval(ge=SMALLEST, le=1e9)
_NOT_NEGATIVE = Interval(ge=0, le=1e9)
_LENGTH = Interval(ge=SMALLEST, le=1e5)
_BREADTH = Interval(ge=0, le=1e3)
_FRICTION = Interval(ge=0, le=10)

FileName = Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_.-]*$", max_length=100)]
_Name = Annotated[FileName, Doc("as the file, without its suffix")]
_Title = Annotated[str, Doc("for people")]


def quantities(table: Table) -> dict[str, Quantity]:
    """Return the numbers with a standing that a table holds, by key."""
    return {name: value for name, value in table if isinstance(value, Quantity)}


class Machine(Table):
    """A laser cutter: a file in ``laser_profiles/machines``."""

    schema_: Annotated[
        Literal["vinefab/machine-1"],
        Field(alias="schema", repr=False),
        Doc("kind of file and its version"),
    ] = "vinefab/machine-1"
    name: _Name
    title: _Title
    bed_width_mm: Annotated[Quantity, _LENGTH, Unit("mm"), Doc("along x")]
    bed_height_mm: Annotated[Quantity, _LENGTH, Unit("mm"), Doc("along y")]
    margin_mm: Annotated[Quantity, _BREADTH, Unit("mm"), Doc("rim of the bed that stays free")]
    power_w: Annotated[Quantity, _POSITIVE, Unit("W"), Doc("of the laser")]
    spot_mm: Annotated[Quantity, _POSITIVE, Unit("mm"), Doc("diameter in focus")]
    rayleigh_mm: Annotated[
        Quantity, _POSITIVE, Unit("mm"), Doc("depth over which the spot grows by the root of 2")
    ]
    speed_max_mm_s: Annotated[Quantity, _POSITIVE, Unit("mm/s"), Doc("of the head")]
    acceleration_mm_s2: Annotated[Quantity, _POSITIVE, Unit("mm/s2"), Doc("of the head")]
    colours: Annotated[str, Doc("preset of its software")] = "default"
    hairline_mm: Annotated[
        float, Ge(SMALLEST), Le(10), Unit("mm"), Doc("line width that its driver takes for a cut")
    ] = 0.01

    @model_validator(mode="after")
    def _has_room(self) -> "Machine":
        least_mm = min(self.bed_width_mm.value, self.bed_height_mm.value)
        if 2.0 * self.margin_mm.value >= least_mm:
            allowed = f"less than half of the bed ({least_mm:g} mm)"
            raise BadInputError("margin_mm", self.margin_mm.value, allowed)
        return self

    @property
    def usable_mm(self) -> tuple[float, float]:
        """Width and height of the bed inside its margins."""
        margin = 2.0 * self.margin_mm.value
        return self.bed_width_mm.value - margin, self.bed_height_mm.value - margin

    @property
    def usable_box_mm(self) -> tuple[float, float, float, float]:
        """The bed inside its margins: least x, least y, greatest x, greatest y."""
        margin, (width, height) = self.margin_mm.value, self.usable_mm
        return margin, margin, margin + width, margin + height


SHRINKAGE_PERCENT = (-20.0, 50.0)
"""Least and greatest shrinkage of a film; below 0 it grows."""

NO_SHRINKAGE = Quantity(
    value=0.0, standing=Standing.ASSUMED, source="not given: film is taken to keep its size"
)

CLOSING_GAIN = (0.0, 3.0)
"""Least and greatest closing gain of joints."""

SEAM_KEYS = ("burst_kpa", "burst_width_mm", "survived_kpa", "survived_width_mm")
"""Fields of a material on its seam."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SeamTest:
    """What is known of the pressure that a welded tube stands."""

    pressure_kpa: Quantity  # gauge pressure in a tube
    width_mm: Quantity  # its lay-flat width
    burst: bool  # there; one that survived stands more, it is unknown how much

    @property
    def is_measured_limit(self) -> bool:
        """Whether seams are known to fail there: a tube of known width burst in a test."""
        standings = {self.pressure_kpa.standing, self.width_mm.standing}
        return self.burst and standings == {Standing.MEASURED}

    def words(self) -> str:
        """Return the test as text.

        >>> assumed = {"standing": Standing.ASSUMED, "source": "a guess"}
        >>> pressure, width = Quantity(value=70.0, **assumed), Quantity(value=20.0, **assumed)
        >>> SeamTest(pressure_kpa=pressure, width_mm=width, burst=False).words()
        'a tube of 20 mm (assumed) survived 70 kPa (assumed)'
        """
        happened = "burst at" if self.burst else "survived"
        return (
            f"a tube of {self.width_mm.value:g} mm ({self.width_mm.standing}) {happened} "
            f"{self.pressure_kpa.value:g} kPa ({self.pressure_kpa.standing})"
        )


_BurstPressure = Annotated[
    Quantity | None, _POSITIVE, Unit("kPa"), Doc("at which a welded tube burst")
]
_SurvivedPressure = Annotated[
    Quantity | None, _POSITIVE, Unit("kPa"), Doc("that a welded tube bore: a lower bound")
]
_TubeWidth = Annotated[Quantity | None, _POSITIVE, Unit("mm"), Doc("lay-flat width of that tube")]
_CLOSING = Interval(ge=CLOSING_GAIN[0], le=CLOSING_GAIN[1])
_SHRINKAGE = Interval(ge=SHRINKAGE_PERCENT[0], le=SHRINKAGE_PERCENT[1])


class Material(Table):
    """A film and its seam: a file in ``laser_profiles/materials``."""

    schema_: Annotated[
        Literal["vinefab/material-1"],
        Field(alias="schema", repr=False),
        Doc("kind of file and its version"),
    ] = "vinefab/material-1"
    name: _Name
    title: _Title
    ply_mm: Annotated[Quantity, _POSITIVE, Unit("mm"), Doc("thickness of one layer")]
    plies: Annotated[int, Ge(1), Le(10), Doc("layers that are welded at once")]
    roll_width_mm: Annotated[Quantity, _LENGTH, Unit("mm"), Doc("of the film as it is bought")]
    density_kg_m3: Annotated[Quantity, _POSITIVE, Unit("kg/m3"), Doc("of the film")]
    modulus_mpa: Annotated[Quantity, _POSITIVE, Unit("MPa"), Doc("of elasticity")]
    strength_mpa: Annotated[Quantity, _POSITIVE, Unit("MPa"), Doc("in tension")]
    friction: Annotated[Quantity, _FRICTION, Doc("against the environment")]
    burst_kpa: _BurstPressure = None
    burst_width_mm: _TubeWidth = None
    survived_kpa: _SurvivedPressure = None
    survived_width_mm: _TubeWidth = None
    weldable: Annotated[bool, Doc("whether a laser can weld it")]
    lamination: Annotated[
        str,
        Field(repr=False, max_length=200),
        Doc("how plies are pressed on each other before they are welded, with its source"),
    ] = ""
    lamination_ply_mm: Annotated[
        float | None,
        _LENGTH,
        Field(repr=False),
        Unit("mm"),
        Doc("thickness of one layer of the film that lamination is for"),
    ] = None
    # Predictions do not use it: no part of the recipe's fingerprint in their reports.
    shrinkage_percent: Annotated[
        Quantity,
        _SHRINKAGE,
        Field(repr=False),
        Unit("%"),
        Doc("by how much welded film comes out shorter than drawn; none: taken as 0 (assumed)"),
    ] = NO_SHRINKAGE
    # Shown in fingerprints only where it is known: those of films without it stay as they were.
    closing_gain: Annotated[
        Quantity | None,
        _CLOSING,
        Field(repr=False),
        Doc(
            "by how much joints bend under pressure, over the simulated; 0: not at all; none: taken"
            " as 1 (assumed)"
        ),
    ] = None

    def __repr_args__(self) -> Iterable[tuple[str | None, Any]]:
        yield from super().__repr_args__()
        if self.closing_gain is not None:
            yield "closing_gain", self.closing_gain

    @model_validator(mode="after")
    def _seam_is_known(self) -> "Material":
        burst = self.burst_kpa is not None, self.burst_width_mm is not None
        survived = self.survived_kpa is not None, self.survived_width_mm is not None
        if burst[0] != burst[1] or survived[0] != survived[1] or not (burst[0] or survived[0]):
            given = [name for name in SEAM_KEYS if getattr(self, name) is not None]
            remedy = (
                "give burst_kpa with burst_width_mm, survived_kpa with survived_width_mm, or both"
            )
            problem = f"{' and '.join(given) or 'nothing'} alone tells no strength"
            raise UnfitInputError("seam", problem, remedy)
        return self

    @property
    def film_mm(self) -> float:
        """Thickness of all plies."""
        return self.ply_mm.value * self.plies

    @property
    def lamination_words(self) -> str:
        """How plies are pressed on each other, and whether that is known of another film alone."""
        known_mm = self.lamination_ply_mm
        if (
            not self.lamination
            or known_mm is None
            or abs(self.ply_mm.value / known_mm - 1.0) < SAME_FILM
        ):
            return self.lamination
        return f"{self.lamination}; known of plies of {known_mm:g} mm only: try it on a scrap first"

    @property
    def seam(self) -> SeamTest:
        """What is known of the pressure that its welded tubes stand."""
        for kpa, width_mm, burst in (
            (self.burst_kpa, self.burst_width_mm, True),
            (self.survived_kpa, self.survived_width_mm, False),
        ):
            if kpa is not None and width_mm is not None:
                return SeamTest(pressure_kpa=kpa, width_mm=width_mm, burst=burst)
        raise AssertionError


class Measured(Table):
    """The table ``[measured]`` of a recipe: measured values that replace the material's."""

    burst_kpa: _BurstPressure = None
    burst_width_mm: _TubeWidth = None
    survived_kpa: _SurvivedPressure = None
    survived_width_mm: _TubeWidth = None
    friction: Annotated[Quantity | None, _FRICTION, Doc("of your film on your obstacles")] = None
    shrinkage_percent: Annotated[
        Quantity | None, _SHRINKAGE, Unit("%"), Doc("of your film where it is welded")
    ] = None
    modulus_mpa: Annotated[
        Quantity | None, _POSITIVE, Unit("MPa"), Doc("of your film, at working pressure")
    ] = None
    closing_gain: Annotated[
        Quantity | None, _CLOSING, Doc("of your joints: how far they bend over the simulated")
    ] = None

    def replaced_in(self, material: Material) -> Material:
        """Return a material with these values."""
        found: dict[str, Quantity | None] = {**quantities(self)}
        seam = {name: found.pop(name) for name in SEAM_KEYS if name in found}
        if seam:
            known = material.seam
            burst = "burst_kpa" in seam or ("survived_kpa" not in seam and known.burst)
            kind = "burst" if burst else "survived"
            # A width alone is that of the tube whose pressure is known, whether it burst or not.
            alone = next((seam[key] for key in seam if key.endswith("_width_mm")), known.width_mm)
            found |= dict.fromkeys(SEAM_KEYS)
            found[f"{kind}_kpa"] = seam.get(f"{kind}_kpa", known.pressure_kpa)
            found[f"{kind}_width_mm"] = seam.get(f"{kind}_width_mm", alone)
        return material.changed(**found)


class RecipeStatus(StrEnum):
    """How far a recipe is verified on the user's machine."""

    UNVERIFIED = "unverified"
    COUPON_OK = "coupon_ok"
    BURST_TESTED = "burst_tested"


class Tool(StrEnum):
    """What runs an operation."""

    LASER = "laser"
    IMPULSE_SEALER = "impulse_sealer"


class OperationSettings(Table):
    """How the laser runs one operation: a table ``[operations.NAME]`` of a recipe."""

    power_percent: Annotated[Quantity, Interval(ge=1e-6, le=100), Unit("%"), Doc("of the laser")]
    min_power_percent: Annotated[Quantity, Interval(ge=0, le=100), Unit("%"), Doc("in corners")]
    speed_mm_s: Annotated[Quantity, _POSITIVE, Unit("mm/s"), Doc("of the head")]
    passes: Annotated[int, Ge(1), Le(100), Doc("over the same path")]
    focus_offset_mm: Annotated[
        Quantity,
        Interval(ge=-1000, le=1000),
        Unit("mm"),
        Doc("above the focus; widens the spot"),
    ]
    frequency_hz: Annotated[Quantity, _NOT_NEGATIVE, Unit("Hz"), Doc("of pulses")]
    air_assist: Annotated[bool, Doc("whether air blows on the cut")]
    spot_mm: Annotated[Quantity, _POSITIVE, Unit("mm"), Doc("diameter at this offset")]
    kerf_mm: Annotated[Quantity, _BREADTH, Unit("mm"), Doc("width that is removed")]
    seam_width_mm: Annotated[
        Quantity, _BREADTH, Unit("mm"), Doc("width that is fused inward of the kerf")
    ]
    overcut_mm: Annotated[
        Quantity, _BREADTH, Unit("mm"), Doc("that a closed path runs past its start")
    ]

    @model_validator(mode="after")
    def _corners_have_less(self) -> "OperationSettings":
        power, least = self.power_percent.value, self.min_power_percent.value
        if least > power:
            raise BadInputError("min_power_percent", least, f"at most power_percent, {power:g}")
        return self

    @property
    def by_laser(self) -> bool:
        """Whether the laser runs it."""
        return not isinstance(self, SealerSettings)

    def line_energy_mj_mm(self, machine: Machine) -> float:
        """Return the energy per length of path, all passes: power over speed."""
        power_w = machine.power_w.value * self.power_percent.value / 100.0
        return 1000.0 * self.passes * power_w / self.speed_mm_s.value

    def fluence_j_cm2(self, machine: Machine) -> float:
        """Return the energy per area of the beam's track: line energy over the spot."""
        return 0.1 * self.line_energy_mj_mm(machine) / self.spot_mm.value

    def __repr_name__(self) -> str:
        return "OperationSettings"

    def __repr_args__(self) -> Iterable[tuple[str, Any]]:
        return self.record().items()

    def record(self) -> dict[str, object]:
        """Return the settings and their tool as reports have them (and fingerprint them)."""
        values = dict(self)
        values.pop("pin_mm", None)  # it changes no prediction: fingerprints stay as they were
        sealing = {name: values.pop(name, None) for name in ("temperature_c", "dwell_s")}
        tool = Tool.LASER if self.by_laser else Tool.IMPULSE_SEALER
        return {**values, "tool": tool, **sealing}


class Operations(Table):
    """The tables ``[operations.NAME]`` of a recipe."""

    mark: Annotated[OperationSettings | None, Doc("labels next to the body")] = None
    weld: Annotated[OperationSettings | None, Doc("seam only")] = None
    weldcut: Annotated[OperationSettings | None, Doc("seam and cut in one pass")] = None
    cut: Annotated[OperationSettings, Doc("mouth and sheet")]

    @model_validator(mode="after")
    def _seams_seal(self) -> "Operations":
        for name, settings in (("weld", self.weld), ("weldcut", self.weldcut)):
            if settings is not None and settings.seam_width_mm.value == 0.0:
                raise BadInputError(f"{name}.seam_width_mm", 0.0, "more than 0: it seals")
        if self.weld is not None and self.weld.kerf_mm.value > 0.0:
            problem = f"a weld removes nothing, and this is {self.weld.kerf_mm.value:g} mm"
            raise UnfitInputError("weld.kerf_mm", problem, "set it to 0, or make it a weldcut")
        return self


class Sealer(Table):
    """The table ``[sealer]`` of a recipe whose seams an impulse sealer makes."""

    temperature_c: Annotated[Quantity, _POSITIVE, Unit("C"), Doc("of the bar")]
    dwell_s: Annotated[Quantity, _POSITIVE, Unit("s"), Doc("for which it stays shut")]
    seam_width_mm: Annotated[Quantity, _POSITIVE, Unit("mm"), Doc("of the bar")]
    pin_mm: Annotated[
        Quantity,
        Interval(ge=1, le=20),
        Field(repr=False),
        Unit("mm"),
        Doc("diameter of the pins that a sheet is put back by"),
    ] = Quantity(value=4.0, standing=Standing.ASSUMED, source="common locating pin")


class SealerSettings(Sealer, OperationSettings):
    """Settings of lines to seal along by hand: power and speed of the laser are 0."""

    @classmethod
    def of(cls, sealer: Sealer) -> "SealerSettings":
        """Return the settings of a sealer."""
        given = Quantity(
            value=0.0, standing=Standing.COMPUTED, source="an impulse sealer makes the seam"
        )
        nothing = dict.fromkeys(OperationSettings.model_fields, given)
        # Not checked: what a laser cannot do either.
        values = {**nothing, **dict(sealer), "passes": 1, "air_assist": False}
        return cls.model_construct(**values)


class GrowthConstants(Table):
    """The four constants of the growth-pressure model, each with its standing."""

    yield_kpa: Annotated[
        Quantity, _NOT_NEGATIVE, Unit("kPa"), Doc("below which film does not evert")
    ]
    drag_kpa_m: Annotated[Quantity, _NOT_NEGATIVE, Unit("kPa/m"), Doc("per metre of path")]
    # The published value is for a spool; crumpled storage is unknown, 0 to 8 kPa.
    storage_kpa: Annotated[
        Quantity, _NOT_NEGATIVE, Unit("kPa"), Doc("tension of the film in its store")
    ]
    friction: Annotated[Quantity, _FRICTION, Doc("film on film, per radian of turn")]

    def at_diameter(self, diameter_mm: float, fitted_diameter_mm: float) -> "GrowthConstants":
        """Return the constants for another tube of the same film.

        Y, f and T are taken as inverse to the diameter (assumed: a 3 mm tube burst before it
        grew, 4 to 7 mm worked); mu stays.

        Parameters
        ----------
        diameter_mm
            Inflated diameter of the other tube.
        fitted_diameter_mm
            Inflated diameter of the tube that these constants were fitted to.
        """
        factor = fitted_diameter_mm / diameter_mm
        scaled: dict[str, Any] = {
            name: Quantity(
                value=quantity.value * factor,
                standing=Standing.ASSUMED,
                source=f"{quantity.source}; times {factor:.4g}, inverse to the diameter",
            )
            for name, quantity in (
                ("yield_kpa", self.yield_kpa),
                ("drag_kpa_m", self.drag_kpa_m),
                ("storage_kpa", self.storage_kpa),
            )
        }
        # Computed, not given: in a tube as thin as can be they leave the ranges of files.
        return GrowthConstants.model_construct(**scaled, friction=self.friction)

    @property
    def standing(self) -> Standing:
        """Standing of a pressure computed from these constants: that of the weakest one."""
        numbers = (self.yield_kpa, self.drag_kpa_m, self.storage_kpa, self.friction)
        assumed = any(number.standing is Standing.ASSUMED for number in numbers)
        return Standing.ASSUMED if assumed else Standing.COMPUTED


class GrowthFit(GrowthConstants):
    """The table ``[growth]`` of a recipe: growth-pressure constants of the user's own tube."""

    width_mm: Annotated[
        Quantity, _POSITIVE, Unit("mm"), Doc("lay-flat width of the tube that was grown")
    ]


class EnergyWindow(Table):
    """The range of line energies at which coupons passed: a table ``[[coupons.windows]]``.

    Both ends are None where no coupon passed.
    """

    operation: Annotated[
        Literal["weld", "weldcut"], Doc("whose energies these are: weld sealed, weldcut also cut")
    ]
    focus_mm: Annotated[
        float, Ge(-1000), Le(1000), Unit("mm"), Doc("offset at which they were cut")
    ]
    least_mj_mm: Annotated[Quantity | None, _POSITIVE, Unit("mJ/mm"), Doc("that welded")] = None
    most_mj_mm: Annotated[
        Quantity | None, _POSITIVE, Unit("mJ/mm"), Doc("that did not cut through")
    ] = None

    @model_validator(mode="after")
    def _least_is_less(self) -> "EnergyWindow":
        least, most = self.least_mj_mm, self.most_mj_mm
        if least is not None and most is not None and least.value > most.value:
            raise BadInputError("least_mj_mm", least.value, f"at most most_mj_mm, {most.value:g}")
        return self

    def holds(self, energy_mj_mm: float) -> bool:
        """Return whether a line energy lies within the range, give or take 1 %."""
        if self.least_mj_mm is None or self.most_mj_mm is None:
            return False
        return 0.99 * self.least_mj_mm.value <= energy_mj_mm <= 1.01 * self.most_mj_mm.value

    def words(self) -> str:
        """Return the range as one line."""
        did = "sealed and cut" if self.operation == "weldcut" else "sealed without cutting"
        where = f"{self.operation} at focus {self.focus_mm:g} mm"
        if self.least_mj_mm is None or self.most_mj_mm is None:
            return f"{where}: nowhere {did}"
        low, high = self.least_mj_mm.value, self.most_mj_mm.value
        return f"{where}: {did} from {low:.1f} to {high:.1f} mJ/mm"


class Coupons(Table):
    """The table ``[coupons]`` of a recipe: results that no other table holds, nor a prediction."""

    peel_n_mm: Annotated[
        Quantity | None,
        _NOT_NEGATIVE,
        Unit("N/mm"),
        Doc("force per width at which a strip peeled"),
    ] = None
    crotch_burst_kpa: Annotated[
        Quantity | None, _POSITIVE, Unit("kPa"), Doc("of the crotch coupon")
    ] = None
    crotch_fillet_mm: Annotated[Quantity | None, _POSITIVE, Unit("mm"), Doc("its radius")] = None
    windows: Annotated[
        tuple[EnergyWindow, ...], Field(strict=False), Doc("line energies that passed")
    ] = ()


class LapMethod(StrEnum):
    """How a socket is bonded to the plug inside it."""

    IMPULSE_SEAL = "impulse_seal"  # a sealed band around the lap, over a release strip in the plug
    ADHESIVE_FILM = "adhesive_film"  # a band of adhesive film between plug and socket


class LapBond(Table):
    """The bond of a sleeve joint, the table ``[lap]`` of a recipe.

    It is a band around the lap of socket and plug, loaded in shear.
    """

    method: Annotated[
        LapMethod, Field(strict=False), Doc("how the socket is bonded to the plug inside it")
    ]
    band_mm: Annotated[Quantity, _POSITIVE, Unit("mm"), Doc("width of the bond, along the branch")]
    strength_n_per_mm: Annotated[
        Quantity | None,
        _POSITIVE,
        Unit("N/mm"),
        Doc("per millimetre of the plug's rim, at which laps failed"),
    ] = None
    survived_n_per_mm: Annotated[
        Quantity | None,
        _POSITIVE,
        Unit("N/mm"),
        Doc("per millimetre of rim, that laps bore: a lower bound, which counts where none failed"),
    ] = None

    @model_validator(mode="after")
    def _has_a_load(self) -> "LapBond":
        if self.strength_n_per_mm is None and self.survived_n_per_mm is None:
            remedy = "give strength_n_per_mm, survived_n_per_mm, or both"
            raise UnfitInputError("strength_n_per_mm", "is missing", remedy)
        return self

    @property
    def load_n_per_mm(self) -> Quantity:
        """Load per millimetre of rim that laps are known, or assumed, to bear."""
        for load in (self.strength_n_per_mm, self.survived_n_per_mm):
            if load is not None:
                return load
        raise AssertionError

    @property
    def is_measured_limit(self) -> bool:
        """Whether laps are known to fail there: some did, in a test."""
        strength = self.strength_n_per_mm
        return strength is not None and strength.standing is Standing.MEASURED

    def words(self) -> str:
        """Return the bond as text.

        >>> assumed = {"standing": Standing.ASSUMED, "source": "a guess"}
        >>> band, load = Quantity(value=5.0, **assumed), Quantity(value=0.4, **assumed)
        >>> LapBond(method=LapMethod.IMPULSE_SEAL, band_mm=band, survived_n_per_mm=load).words()
        'an impulse-sealed band of 5 mm (assumed) bore 0.4 N/mm (assumed)'
        """
        sealed = self.method is LapMethod.IMPULSE_SEAL
        band = "an impulse-sealed band" if sealed else "a band of adhesive film"
        did = "bore" if self.strength_n_per_mm is None else "fails at"
        load = self.load_n_per_mm
        return (
            f"{band} of {self.band_mm.value:g} mm ({self.band_mm.standing}) {did} "
            f"{load.value:.3g} N/mm ({load.standing})"
        )


class DerivedFor(Table):
    """The table ``[derived_for]`` of a recipe: the film that its settings were derived for."""

    film_mm: Annotated[
        float, _LENGTH, Unit("mm"), Doc("thickness of all plies, while the settings were found")
    ]
    melt_j_cm2: Annotated[
        Quantity | None, _POSITIVE, Unit("J/cm2"), Doc("that film takes to melt")
    ] = None
    cut_j_cm2: Annotated[
        Quantity | None, _POSITIVE, Unit("J/cm2"), Doc("that film takes to be cut")
    ] = None

    def share(self, material: Material) -> float:
        """Return the thickness of a film over that of the film that the settings are for."""
        return material.film_mm / self.film_mm

    def is_other(self, material: Material) -> bool:
        """Whether a film is so much thicker or thinner that its energies differ."""
        return abs(self.share(material) - 1.0) > SAME_FILM


SAME_FILM = 0.02
"""Relative difference of thickness up to which two films count as the same (assumed)."""


class Recipe(Table):
    """Settings for one material on one machine: a file in ``laser_profiles/recipes``."""

    schema_: Annotated[
        Literal["vinefab/recipe-1"], Field(alias="schema"), Doc("kind of file and its version")
    ] = "vinefab/recipe-1"
    name: _Name
    title: _Title
    machine: Annotated[FileName, Doc("its profile: a name, or a file in the recipe's folder")]
    material: Annotated[FileName, Doc("its profile: a name, or a file in the recipe's folder")]
    status: Annotated[
        RecipeStatus, Field(strict=False), Doc("how far it is verified on your machine")
    ]
    source: Annotated[str, Field(min_length=1), Doc("where the settings come from")]
    operations: Annotated[Operations, Doc("settings of each operation")]
    sealer: Annotated[Sealer | None, Doc("in place of laser welds")] = None
    measured: Annotated[Measured | None, Doc("values of your film, in place of the material's")] = (
        None
    )
    growth: Annotated[
        GrowthFit | None, Doc("constants of growth pressure, if you measured them")
    ] = None
    coupons: Annotated[Coupons, Doc("what else the coupons gave")] = Coupons()
    lap: Annotated[LapBond | None, Doc("the bond of robots in pieces")] = None
    derived_for: Annotated[
        DerivedFor | None,
        Doc("the film that the settings were derived for; with another they are stale (VF-L06)"),
    ] = None
    limits: Annotated[dict[str, dict[str, float]], Doc("of rules, for this recipe")] = Field(
        default_factory=dict
    )

    @model_validator(mode="after")
    def _one_tool_seals(self) -> "Recipe":
        welded = self.operations.weld is not None
        if self.sealer is None and not welded and self.operations.weldcut is None:
            remedy = "add weldcut, weld or a [sealer]"
            raise UnfitInputError("operations", "nothing makes the seam", remedy)
        if self.sealer is not None and welded:
            raise UnfitInputError(
                "sealer", "is given together with operations.weld", "leave one of them out"
            )
        return self

    @cached_property
    def by_operation(self) -> Mapping[str, OperationSettings]:
        """Settings by operation; those of a sealer are the ``weld``."""
        found = {name: given for name, given in self.operations if given is not None}
        if self.sealer is None:
            return found
        return {"weld": SealerSettings.of(self.sealer), **found}

    def __repr_args__(self) -> Iterable[tuple[str, Any]]:
        """Yield the values that predictions of a robot in one piece use, for fingerprints."""
        yield from ((name, getattr(self, name)) for name in ("name", "title", "status", "source"))
        yield "operations", self.by_operation
        yield "growth", {} if self.growth is None else quantities(self.growth)
        yield "limits", self.limits
        yield "coupons", quantities(self.coupons)
        yield "windows", self.coupons.windows


@dataclass(frozen=True, slots=True, kw_only=True)
class LaserProfile:
    """A recipe with its machine and its material.

    Parameters
    ----------
    machine, material, recipe
        Its three parts.
    """

    machine: Machine
    material: Material
    recipe: Recipe

    def settings(self, operation: str) -> OperationSettings:
        """Return the settings of one operation.

        Raises
        ------
        BadInputError
            If the recipe does not have it.
        """
        known = self.recipe.by_operation
        if operation not in known:
            problem = f"it has no operation {operation}"
            remedy = f"add it, or use one of {', '.join(known)}"
            raise UnfitInputError(f"recipe {self.recipe.name}", problem, remedy)
        return known[operation]

    @property
    def stale_words(self) -> str:
        """How stale the settings are with this film, with a scaled estimate; empty if they fit."""
        known, film, operations = self.recipe.derived_for, self.material, self.recipe.by_operation
        if known is None or not known.is_other(film):
            return ""
        cutting = next((name for name in ("weldcut", "cut") if name in operations), "")
        settings = operations[cutting]
        message = (
            f"the settings were derived for film of {known.film_mm:g} mm in all plies, and this is "
            f"{film.film_mm:g} mm: "
        )
        if known.cut_j_cm2 is not None:
            needs = known.share(film) * known.cut_j_cm2.value
            gives = settings.fluence_j_cm2(self.machine)
            message += (
                f"to cut it takes about {needs:.0f} J/cm^2 ({known.cut_j_cm2.standing}: "
                f"{known.cut_j_cm2.value:g}, scaled with the thickness), and {cutting} delivers "
                f"{gives:.0f}, "
                f"{'less' if gives < needs else 'more'} than that: "
            )
        speed = settings.speed_mm_s.value / known.share(film)
        return (
            f"{message}run {cutting} at about {speed:.0f} mm/s in place of "
            f"{settings.speed_mm_s.value:g} (scaled), cut the coupons of `vinefab coupon` anew, "
            "and run `vinefab calibrate`"
        )


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
    if found.name != visible(path.stem):
        # Other files refer to a profile by its file name: two names would be a trap.
        problem = f"{quoted(found.name)} is not the name of the file"
        raise UnfitInputError("name", problem, f"call it {quoted(path.stem)}", path)
    return found
