"""Laser profiles: machines, materials and recipes, every number with its standing."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from vinefab.core.errors import BadInputError
from vinefab.core.validation import number

LARGEST_QUANTITY = 1e12
"""Limit of every number with a standing, in its unit."""


class Standing(StrEnum):
    """How far a number may be trusted."""

    MEASURED = "measured"
    PAPER = "paper"
    PUBLISHED = "published"
    COMPUTED = "computed"
    ASSUMED = "assumed"


@dataclass(frozen=True, slots=True, kw_only=True)
class Quantity:
    """A number with its standing and source; its unit is in the name of the field that holds it.

    Parameters
    ----------
    value
        The number.
    standing
        How far it may be trusted.
    source
        Where it comes from, in words.
    uncertainty
        Standard uncertainty in the number's own unit, or None if unknown.
    uncertainty_95
        Half of its 95 % interval, wider than two standard uncertainties where readings were few;
        None if unknown.
    """

    value: float
    standing: Standing
    source: str = ""
    uncertainty: float | None = None
    # Like the other one it changes nothing that is predicted: no part of a recipe's fingerprint.
    uncertainty_95: float | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        number("value", self.value, -LARGEST_QUANTITY, LARGEST_QUANTITY)
        for name in ("uncertainty", "uncertainty_95"):
            if (given := getattr(self, name)) is not None:
                number(name, given, 0.0, LARGEST_QUANTITY)

    def __float__(self) -> float:
        return self.value

    def words(self) -> str:
        """Return the number and, if known, its 95 % interval or else its standard uncertainty.

        >>> Quantity(value=0.26, standing=Standing.MEASURED, uncertainty=0.013).words()
        '0.26 +- 0.013'
        >>> Quantity(value=0.26, standing=Standing.MEASURED, uncertainty_95=0.056).words()
        '0.26 +- 0.056 (95 %)'
        """
        if self.uncertainty_95 is not None:
            return f"{self.value:g} +- {self.uncertainty_95:.2g} (95 %)"
        spread = "" if self.uncertainty is None else f" +- {self.uncertainty:.2g}"
        return f"{self.value:g}{spread}"


class RecipeStatus(StrEnum):
    """How far a recipe is verified on the user's machine."""

    UNVERIFIED = "unverified"
    COUPON_OK = "coupon_ok"
    BURST_TESTED = "burst_tested"


class Tool(StrEnum):
    """What runs an operation."""

    LASER = "laser"
    IMPULSE_SEALER = "impulse_sealer"


@dataclass(frozen=True, slots=True, kw_only=True)
class Machine:
    """A laser cutter.

    Parameters
    ----------
    name, title
        File name and full name.
    bed_width_mm, bed_height_mm, margin_mm
        Size of the bed, and the unused rim of it.
    power_w
        Rated power.
    spot_mm, rayleigh_mm
        Beam diameter at focus and Rayleigh length.
    speed_max_mm_s, acceleration_mm_s2
        Limits of motion.
    colours
        Name of its software's colour preset.
    hairline_mm
        Stroke width that its software reads as a vector path.
    """

    name: str
    title: str
    bed_width_mm: Quantity
    bed_height_mm: Quantity
    margin_mm: Quantity
    power_w: Quantity
    spot_mm: Quantity
    rayleigh_mm: Quantity
    speed_max_mm_s: Quantity
    acceleration_mm_s2: Quantity
    colours: str = "default"
    hairline_mm: float = 0.01

    def __post_init__(self) -> None:
        least_mm = min(self.bed_width_mm.value, self.bed_height_mm.value)
        if 2.0 * self.margin_mm.value >= least_mm:
            allowed = f"less than half of the bed ({least_mm:g} mm)"
            raise BadInputError("margin_mm", self.margin_mm.value, allowed)

    @property
    def usable_mm(self) -> tuple[float, float]:
        """Width and height of the bed inside its margins."""
        margin = 2.0 * self.margin_mm.value
        return self.bed_width_mm.value - margin, self.bed_height_mm.value - margin


SHRINKAGE_PERCENT = (-20.0, 50.0)
"""Least and greatest shrinkage of a film; below 0 it grows."""

NO_SHRINKAGE = Quantity(
    value=0.0, standing=Standing.ASSUMED, source="not given: film is taken to keep its size"
)

SEAM_KEYS = ("burst_kpa", "burst_width_mm", "survived_kpa", "survived_width_mm")
"""Fields of a material that say what is known of its seam."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SeamTest:
    """What is known of the pressure that a welded tube stands.

    Parameters
    ----------
    pressure_kpa, width_mm
        Gauge pressure in a tube, and its lay-flat width.
    burst
        Whether the tube burst there. One that survived stands more, nobody knows how much.
    """

    pressure_kpa: Quantity
    width_mm: Quantity
    burst: bool

    @property
    def is_measured_limit(self) -> bool:
        """Whether seams are known to fail there: a tube of known width burst in a test."""
        standings = {self.pressure_kpa.standing, self.width_mm.standing}
        return self.burst and standings == {Standing.MEASURED}

    def words(self) -> str:
        """Return the test in words.

        >>> assumed = {"standing": Standing.ASSUMED}
        >>> pressure, width = Quantity(value=70.0, **assumed), Quantity(value=20.0, **assumed)
        >>> SeamTest(pressure_kpa=pressure, width_mm=width, burst=False).words()
        'a tube of 20 mm (assumed) survived 70 kPa (assumed)'
        """
        happened = "burst at" if self.burst else "survived"
        return (
            f"a tube of {self.width_mm.value:g} mm ({self.width_mm.standing}) {happened} "
            f"{self.pressure_kpa.value:g} kPa ({self.pressure_kpa.standing})"
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Material:
    """A film and its seam.

    Parameters
    ----------
    name, title
        File name and full name.
    ply_mm, plies
        Thickness of one ply, number of welded plies.
    roll_width_mm
        Width of the film roll.
    density_kg_m3, modulus_mpa, strength_mpa
        Density, Young's modulus and tensile strength of the film.
    friction
        Coefficient of friction against the environment.
    burst_kpa, burst_width_mm
        Pressure at which a welded tube of that lay-flat width burst; None if none was burst.
    survived_kpa, survived_width_mm
        Pressure that a welded tube of that lay-flat width stood: a lower bound, which counts where
        none was burst.
    weldable
        Whether a laser can weld it.
    shrinkage_percent
        By how much welded film comes out shorter than drawn. Predictions do not use it, so that it
        is no part of the recipe's fingerprint in their reports.
    """

    name: str
    title: str
    ply_mm: Quantity
    plies: int
    roll_width_mm: Quantity
    density_kg_m3: Quantity
    modulus_mpa: Quantity
    strength_mpa: Quantity
    friction: Quantity
    burst_kpa: Quantity | None = None
    burst_width_mm: Quantity | None = None
    survived_kpa: Quantity | None = None
    survived_width_mm: Quantity | None = None
    weldable: bool
    shrinkage_percent: Quantity = field(default=NO_SHRINKAGE, repr=False)

    @property
    def film_mm(self) -> float:
        """Thickness of all plies."""
        return self.ply_mm.value * self.plies

    def __post_init__(self) -> None:
        burst = self.burst_kpa is not None, self.burst_width_mm is not None
        survived = self.survived_kpa is not None, self.survived_width_mm is not None
        if burst[0] != burst[1] or survived[0] != survived[1] or not (burst[0] or survived[0]):
            given = [name for name in SEAM_KEYS if getattr(self, name) is not None]
            allowed = "burst_kpa with burst_width_mm, survived_kpa with survived_width_mm, or both"
            raise BadInputError("seam", ", ".join(given) or "no test", allowed)

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


@dataclass(frozen=True, slots=True, kw_only=True)
class OperationSettings:
    """How the laser runs one operation.

    Parameters
    ----------
    power_percent, min_power_percent
        Share of the machine's rated power; the lower one in corners.
    speed_mm_s, passes, focus_offset_mm, frequency_hz, air_assist
        The rest of the machine's settings.
    spot_mm, kerf_mm, seam_width_mm, overcut_mm
        Beam diameter on the film, width removed, width fused inward of the kerf, and overlap where
        a closed path meets its start.
    tool
        Tool of the operation. Unless it is the laser, power and speed are 0 and its paths are
        lines to seal along by hand.
    temperature_c, dwell_s
        Settings of an impulse sealer: jaw temperature and time under heat.
    """

    power_percent: Quantity
    min_power_percent: Quantity
    speed_mm_s: Quantity
    passes: int
    focus_offset_mm: Quantity
    frequency_hz: Quantity
    air_assist: bool
    spot_mm: Quantity
    kerf_mm: Quantity
    seam_width_mm: Quantity
    overcut_mm: Quantity
    tool: Tool = Tool.LASER
    temperature_c: Quantity | None = None
    dwell_s: Quantity | None = None

    @property
    def by_laser(self) -> bool:
        """Whether the laser runs it."""
        return self.tool is Tool.LASER

    def line_energy_mj_mm(self, machine: Machine) -> float:
        """Return the energy per length of path, all passes: power over speed."""
        power_w = machine.power_w.value * self.power_percent.value / 100.0
        return 1000.0 * self.passes * power_w / self.speed_mm_s.value


@dataclass(frozen=True, slots=True, kw_only=True)
class EnergyWindow:
    """The range of line energies at which coupons passed.

    Parameters
    ----------
    operation
        The operation tested: ``weld`` sealed, ``weldcut`` sealed and cut.
    focus_mm
        Focus offset of the coupons.
    least_mj_mm, most_mj_mm
        The range, or None if no coupon passed.
    """

    operation: str
    focus_mm: float
    least_mj_mm: Quantity | None
    most_mj_mm: Quantity | None

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


class LapMethod(StrEnum):
    """How a socket is bonded to the plug inside it."""

    IMPULSE_SEAL = "impulse_seal"  # a sealed band around the lap, over a release strip in the plug
    ADHESIVE_FILM = "adhesive_film"  # a band of adhesive film between plug and socket


@dataclass(frozen=True, slots=True, kw_only=True)
class LapBond:
    """The bond of a sleeve joint: a band around the lap of socket and plug, loaded in shear."""

    method: LapMethod
    band_mm: Quantity  # width of the band, along the branch
    # Load per millimetre of the plug's rim at which laps failed; None if none did.
    strength_n_per_mm: Quantity | None = None
    # Load that laps bore without failing: a lower bound, which counts where none failed.
    survived_n_per_mm: Quantity | None = None

    def __post_init__(self) -> None:
        if self.strength_n_per_mm is None and self.survived_n_per_mm is None:
            raise BadInputError("lap", "no load", "strength_n_per_mm, survived_n_per_mm, or both")

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
        """Return the bond in words.

        >>> assumed = {"standing": Standing.ASSUMED}
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


@dataclass(frozen=True, slots=True, kw_only=True)
class Recipe:
    """Settings for one material on one machine.

    Parameters
    ----------
    name, title
        File name (``machine__material``) and full name.
    status
        How far it is verified.
    source
        Where it comes from.
    operations
        Settings by operation (``weldcut``, ``weld``, ``cut``, ``mark``).
    growth
        Growth-pressure constants fitted to the user's own tube (``yield_kpa``, ``drag_kpa_m``,
        ``storage_kpa``, ``friction``, ``width_mm``); empty if not measured.
    limits
        Limits of design rules that differ for this recipe: rule id to name to value.
    coupons
        Other coupon results (``peel_n_mm``, ``crotch_burst_kpa``, ``crotch_fillet_mm``); no
        prediction uses them.
    windows
        Ranges of line energies at which coupons passed.
    lap
        The bond of sleeve joints; None if nothing is known of it. Robots in one piece have none, so
        that it is no part of the recipe's fingerprint in their reports.
    """

    name: str
    title: str
    status: RecipeStatus
    source: str
    operations: Mapping[str, OperationSettings]
    growth: Mapping[str, Quantity] = field(default_factory=dict)
    limits: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    coupons: Mapping[str, Quantity] = field(default_factory=dict)
    windows: tuple[EnergyWindow, ...] = ()
    lap: LapBond | None = field(default=None, repr=False)


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
        """Return how one operation is run.

        Raises
        ------
        BadInputError
            If the recipe does not have it.
        """
        if operation not in self.recipe.operations:
            known = ", ".join(self.recipe.operations)
            raise BadInputError(f"recipe {self.recipe.name}", str(operation), f"one of {known}")
        return self.recipe.operations[operation]
