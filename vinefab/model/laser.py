"""Profiles: materials and recipes, with the machines that recipes name.

Each is declared once: as the table of a file (TOML) and as the noun that rooms share. Files of
recipes name those of their machines and material.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any, Literal, TypeVar

from annotated_types import Ge, Interval, Le, Unit
from pydantic import Field, model_validator
from typing_extensions import Doc

from vinefab.core.errors import BadInputError, UnfitInputError, UnknownNameError
from vinefab.core.plain_text import quoted, visible
from vinefab.core.table import Table, validated
from vinefab.model.files.shipped import file_named, is_inside, locate, names, user_names
from vinefab.model.files.toml import read_toml
from vinefab.model.machine import (
    MACHINES,
    FileName,
    HotTip,
    Knife,
    LaserMachine,
    LaserSettings,
    LiftingMachine,
    Machine,
    OperationSettings,
    ProfileName,
    ProfileTitle,
    Scissors,
    Sealer,
    Tool,
)
from vinefab.model.quantity import (
    FRICTION,
    LENGTH,
    NOT_NEGATIVE,
    POSITIVE,
    Quantity,
    Standing,
    quantities,
)

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
    Quantity | None, POSITIVE, Unit("kPa"), Doc("at which a welded tube burst")
]
_SurvivedPressure = Annotated[
    Quantity | None, POSITIVE, Unit("kPa"), Doc("that a welded tube bore: a lower bound")
]
_TubeWidth = Annotated[Quantity | None, POSITIVE, Unit("mm"), Doc("lay-flat width of that tube")]
_CLOSING = Interval(ge=CLOSING_GAIN[0], le=CLOSING_GAIN[1])
_SHRINKAGE = Interval(ge=SHRINKAGE_PERCENT[0], le=SHRINKAGE_PERCENT[1])


class Material(Table):
    """A film and its seam: a file in ``laser_profiles/materials``."""

    schema_: Annotated[
        Literal["vinefab/material-1"],
        Field(alias="schema", repr=False),
        Doc("kind of file and its version"),
    ] = "vinefab/material-1"
    name: ProfileName
    title: ProfileTitle
    ply_mm: Annotated[Quantity, POSITIVE, Unit("mm"), Doc("thickness of one layer")]
    plies: Annotated[int, Ge(1), Le(10), Doc("layers that are welded at once")]
    roll_width_mm: Annotated[Quantity, LENGTH, Unit("mm"), Doc("of the film as it is bought")]
    density_kg_m3: Annotated[Quantity, POSITIVE, Unit("kg/m3"), Doc("of the film")]
    modulus_mpa: Annotated[Quantity, POSITIVE, Unit("MPa"), Doc("of elasticity")]
    strength_mpa: Annotated[Quantity, POSITIVE, Unit("MPa"), Doc("in tension")]
    friction: Annotated[Quantity, FRICTION, Doc("against the environment")]
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
        LENGTH,
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
    friction: Annotated[Quantity | None, FRICTION, Doc("of your film on your obstacles")] = None
    shrinkage_percent: Annotated[
        Quantity | None, _SHRINKAGE, Unit("%"), Doc("of your film where it is welded")
    ] = None
    modulus_mpa: Annotated[
        Quantity | None, POSITIVE, Unit("MPa"), Doc("of your film, at working pressure")
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


class Operations(Table):
    """What a laser runs: the tables ``[operations.NAME]`` of a recipe."""

    mark: Annotated[LaserSettings | None, Doc("labels next to the body")] = None
    weld: Annotated[LaserSettings | None, Doc("seam only")] = None
    weldcut: Annotated[LaserSettings | None, Doc("seam and cut in one pass")] = None
    cut: Annotated[LaserSettings, Doc("mouth and sheet")]

    @model_validator(mode="after")
    def _seams_seal(self) -> "Operations":
        for name, settings in (("weld", self.weld), ("weldcut", self.weldcut)):
            if settings is not None and settings.seam_width_mm.value == 0.0:
                raise BadInputError(f"{name}.seam_width_mm", 0.0, "more than 0: it seals")
        if self.weld is not None and self.weld.kerf_mm.value > 0.0:
            problem = f"a weld removes nothing, and this is {self.weld.kerf_mm.value:g} mm"
            raise UnfitInputError("weld.kerf_mm", problem, "set it to 0, or make it a weldcut")
        return self


class GrowthConstants(Table):
    """The four constants of the growth-pressure model, each with its standing."""

    yield_kpa: Annotated[
        Quantity, NOT_NEGATIVE, Unit("kPa"), Doc("below which film does not evert")
    ]
    drag_kpa_m: Annotated[Quantity, NOT_NEGATIVE, Unit("kPa/m"), Doc("per metre of path")]
    # The published value is for a spool; crumpled storage is unknown, 0 to 8 kPa.
    storage_kpa: Annotated[
        Quantity, NOT_NEGATIVE, Unit("kPa"), Doc("tension of the film in its store")
    ]
    friction: Annotated[Quantity, FRICTION, Doc("film on film, per radian of turn")]

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
        Quantity, POSITIVE, Unit("mm"), Doc("lay-flat width of the tube that was grown")
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
    least_mj_mm: Annotated[Quantity | None, POSITIVE, Unit("mJ/mm"), Doc("that welded")] = None
    most_mj_mm: Annotated[
        Quantity | None, POSITIVE, Unit("mJ/mm"), Doc("that did not cut through")
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
        NOT_NEGATIVE,
        Unit("N/mm"),
        Doc("force per width at which a strip peeled"),
    ] = None
    crotch_burst_kpa: Annotated[
        Quantity | None, POSITIVE, Unit("kPa"), Doc("of the crotch coupon")
    ] = None
    crotch_fillet_mm: Annotated[Quantity | None, POSITIVE, Unit("mm"), Doc("its radius")] = None
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
    band_mm: Annotated[Quantity, POSITIVE, Unit("mm"), Doc("width of the bond, along the branch")]
    strength_n_per_mm: Annotated[
        Quantity | None,
        POSITIVE,
        Unit("N/mm"),
        Doc("per millimetre of the plug's rim, at which laps failed"),
    ] = None
    survived_n_per_mm: Annotated[
        Quantity | None,
        POSITIVE,
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
        float, LENGTH, Unit("mm"), Doc("thickness of all plies, while the settings were found")
    ]
    melt_j_cm2: Annotated[
        Quantity | None, POSITIVE, Unit("J/cm2"), Doc("that film takes to melt")
    ] = None
    cut_j_cm2: Annotated[
        Quantity | None, POSITIVE, Unit("J/cm2"), Doc("that film takes to be cut")
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
    """Settings for one material: a file in ``laser_profiles/recipes``.

    One machine seals and cuts, or ``machine`` seals and ``cutter`` cuts. What no machine does,
    people do: seal along the lines with a ``[sealer]``, cut along them with scissors.
    """

    schema_: Annotated[
        Literal["vinefab/recipe-1"], Field(alias="schema"), Doc("kind of file and its version")
    ] = "vinefab/recipe-1"
    name: ProfileName
    title: ProfileTitle
    machine: Annotated[FileName, Doc("its profile: a name, or a file in the recipe's folder")]
    cutter: Annotated[
        FileName | None, Doc("the machine that cuts, if another one than seals: as machine")
    ] = None
    material: Annotated[FileName, Doc("its profile: a name, or a file in the recipe's folder")]
    status: Annotated[
        RecipeStatus, Field(strict=False), Doc("how far it is verified on your machine")
    ]
    source: Annotated[str, Field(min_length=1), Doc("where the settings come from")]
    operations: Annotated[Operations | None, Doc("of a laser: settings of each operation")] = None
    sealer: Annotated[Sealer | None, Doc("in place of laser welds")] = None
    hot_tip: Annotated[HotTip | None, Doc("how a hot tip seals")] = None
    knife: Annotated[Knife | None, Doc("how a blade cuts")] = None
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
        laser = self.operations
        welded = laser is not None and laser.weld is not None
        one_pass = laser is not None and laser.weldcut is not None
        if self.hot_tip is not None and (welded or one_pass or self.sealer is not None):
            problem = "is given together with another seam"
            raise UnfitInputError("hot_tip", problem, "leave [sealer] and welds of a laser out")
        if self.sealer is not None and welded:
            raise UnfitInputError(
                "sealer", "is given together with operations.weld", "leave one of them out"
            )
        if self.hot_tip is None and self.sealer is None and not (welded or one_pass):
            if laser is None:
                raise UnfitInputError("operations", "is missing", "give it")
            remedy = "add weldcut, weld or a [sealer]"
            raise UnfitInputError("operations", "nothing makes the seam", remedy)
        if self.knife is not None and laser is not None:
            problem = "is given together with operations.cut"
            raise UnfitInputError("knife", problem, "leave one of them out")
        return self

    @cached_property
    def by_operation(self) -> Mapping[str, OperationSettings]:
        """Settings by operation; a sealer or a hot tip makes the ``weld``."""
        found: dict[str, OperationSettings] = {
            name: given for name, given in self.operations or () if given is not None
        }
        found.setdefault("cut", self.knife or Scissors())
        seals = self.sealer or self.hot_tip
        return found if seals is None else {"weld": seals, **found}

    def table_of(self, operation: str) -> tuple[str, ...]:
        """Return the table of the file that holds an operation's settings, if there is one."""
        tables: dict[Tool, str] = {
            Tool.LASER: f"[operations.{operation}]",
            Tool.HOT_TIP: "[hot_tip]",
            Tool.KNIFE: "[knife]",
            Tool.IMPULSE_SEALER: "[sealer]",
        }
        table = tables.get(self.by_operation[operation].tool)
        return () if table is None else (table,)

    @property
    def seals(self) -> str:
        """The operation that makes the seam."""
        return "weldcut" if "weldcut" in self.by_operation else "weld"

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
    cutter
        The machine that cuts, if another one than seals.
    """

    machine: Machine
    material: Material
    recipe: Recipe
    cutter: Machine | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        for name, settings in self.recipe.by_operation.items():
            if not settings.tool.by_hand and self.machine_of(settings.tool) is None:
                named = " nor ".join(one.name for one in self.machines)
                tool = settings.tool.replace("_", " ")
                problem = f"{name} takes a {tool}, and {named} is none"
                remedy = "name one as machine or as cutter"
                raise UnfitInputError(f"recipe {self.recipe.name}", problem, remedy)
        tip, machine = self.recipe.hot_tip, self.machine_of(Tool.HOT_TIP)
        if tip is not None and isinstance(machine, LiftingMachine):
            touch_mm, travel_mm = tip.touch_z_mm.value, machine.travel_z_mm.value
            if touch_mm >= travel_mm:
                allowed = f"below travel_z_mm of {machine.name}, {travel_mm:g} mm"
                raise BadInputError("hot_tip.touch_z_mm", touch_mm, allowed)

    @property
    def machines(self) -> tuple[Machine, ...]:
        """The machines on which the film lies, in this order."""
        return (self.machine,) if self.cutter is None else (self.machine, self.cutter)

    def machine_of(self, tool: Tool) -> Machine | None:
        """Return the machine that has a tool."""
        return next((one for one in self.machines if one.tool is tool), None)

    @property
    def tools(self) -> frozenset[Tool]:
        """What runs the recipe's operations."""
        return frozenset(one.tool for one in self.recipe.by_operation.values())

    @property
    def beams(self) -> Iterator[tuple[str, LaserSettings, LaserMachine]]:
        """The operations that a laser runs, with settings and machine."""
        for name, settings in self.recipe.by_operation.items():
            machine = self.machine_of(settings.tool)
            if isinstance(settings, LaserSettings) and isinstance(machine, LaserMachine):
                yield name, settings, machine

    @property
    def status(self) -> RecipeStatus:
        """How far the recipe is verified with this film: not at all, with another one."""
        return RecipeStatus.UNVERIFIED if self.stale_words else self.recipe.status

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
        known, film = self.recipe.derived_for, self.material
        if known is None or not known.is_other(film):
            return ""
        return (
            f"the settings were derived for film of {known.film_mm:g} mm in all plies, and this is "
            f"{film.film_mm:g} mm: {self._scaled_words(known, known.share(film))}, cut the coupons "
            "of `vinefab coupon` anew, and run `vinefab calibrate`"
        )

    def _scaled_words(self, known: DerivedFor, share: float) -> str:
        """Return the settings of the seam and, where it is cut apart, of the cut: scaled."""
        operations = self.recipe.by_operation
        by_laser = {name: machine for name, _, machine in self.beams}
        scaled = ["weldcut"] if "weldcut" in operations else ["weld", "cut"]
        found = []
        for name in scaled:
            settings = operations[name]
            words = settings.scaled_words(name, share)
            # A laser that only welds stays far below what cuts: the cut tells.
            if not words or (name == "weld" and name in by_laser):
                continue
            if isinstance(settings, LaserSettings) and known.cut_j_cm2 is not None:
                needs = share * known.cut_j_cm2.value
                gives = settings.fluence_j_cm2(by_laser[name])
                words = (
                    f"to cut it takes about {needs:.0f} J/cm^2 ({known.cut_j_cm2.standing}: "
                    f"{known.cut_j_cm2.value:g}, scaled with the thickness), and {name} delivers "
                    f"{gives:.0f}, {'less' if gives < needs else 'more'} than that: {words}"
                )
            found.append(words)
        return "; ".join(found)


P = TypeVar("P", Material, Recipe)
N = TypeVar("N", Machine, Material, Recipe)


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
    """Return the files that `read_profile` reads: ``recipe``, ``machine`` and so on."""
    path = locate("recipe", recipe)
    found = _read(Recipe, path)
    files = {"recipe": path, "machine": _beside(path, "machine", found.machine)}
    if found.cutter is not None:
        files["cutter"] = _beside(path, "machine", found.cutter)
    return {**files, "material": _beside(path, "material", found.material)}


def profile_of(document: Mapping[str, Any], path: Path) -> LaserProfile:
    """Return the profile of a recipe file's content."""
    recipe = _named_as_its_file(Recipe, document, path)
    material = _read(Material, _beside(path, "material", recipe.material))
    cutter = None if recipe.cutter is None else _beside(path, "machine", recipe.cutter)
    return LaserProfile(
        machine=read_machine(_beside(path, "machine", recipe.machine)),
        material=material if recipe.measured is None else recipe.measured.replaced_in(material),
        recipe=recipe,
        cutter=None if cutter is None else read_machine(cutter),
    )


def read_machine(name_or_path: str | Path) -> Machine:
    """Return a machine; errors as in `read_profile`."""
    path = locate("machine", name_or_path)
    document = read_toml(path)
    kind = document.get("kind", "laser")
    if not isinstance(kind, str) or kind not in MACHINES:
        raise BadInputError("kind", kind, f"one of {', '.join(MACHINES)}", path)
    return _named_as_its_file(MACHINES[kind], document, path)


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


def _named_as_its_file(kind: type[N], document: Mapping[str, Any], path: Path) -> N:
    found = validated(kind, document, path)
    if found.name != visible(path.stem):
        # Other files refer to a profile by its file name: two names would be a trap.
        problem = f"{quoted(found.name)} is not the name of the file"
        raise UnfitInputError("name", problem, f"call it {quoted(path.stem)}", path)
    return found
