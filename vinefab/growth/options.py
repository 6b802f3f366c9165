"""Options of the growth model, and which of them a command takes."""

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Gt, Le, Unit
from pydantic import BeforeValidator, Field, model_validator
from typing_extensions import Doc

from vinefab.core.errors import BadInputError, UnfitInputError, UnknownNameError, located, nearest
from vinefab.core.limits import deg, rad
from vinefab.core.table import Slider, Table, declared_keys
from vinefab.core.validation import Floats, number
from vinefab.model.contacts import (
    SURFACES,
    MeasuredContacts,
    MeasuredNumber,
    Side,
    Surface,
    contacts_of,
    surface_known,
)
from vinefab.model.design import ORIGIN_GROWTH, Design
from vinefab.model.inputs import Body, ChildrenOfStuck
from vinefab.model.map import Map
from vinefab.model.tree import BranchTree
from vinefab.physics.growth_pressure import FITTED_DIAMETER_MM
from vinefab.physics.tube import inflated_radius_mm

DEFAULT_HEAD_ON_HALF_ANGLE_RAD = math.radians(1.0)

UNMEASURED_DEG = (1.0, 30.0)
"""Head-on half-angles that a prediction is shown for where nothing was measured [assumed]: the tips
that were seen slid on smooth walls, and others stopped on rough ones. A surface that a map names,
and measurements of a user's own robots, replace them (`GrowthOptions.contact_angles_deg`)."""

HALF_ANGLE_DEG = "head_on_half_angle_deg"

BranchContact = Literal["stop", "pass"]

DEFAULT_BRANCH_CONTACT: BranchContact = "pass"
"""What a tip does at the body of another branch, where no option gives it [assumed]."""

UnknownRule = Literal["branch_contact", "emergence"]
"""Growth options that predictions are shown for each choice of."""

BRANCH_CONTACTS: tuple[BranchContact, ...] = ("pass", "stop")
"""Both are shown together: real tubes climb over or jam, and no measurement tells which."""

EMERGENCES = (1.0, 0.95, 0.9)
"""Probabilities that a child comes out, which predictions are shown for [assumed]: growth was seen
to be prevented at branching points, and no count of it exists."""

_CONTACT_WORDS = {
    "pass": "bodies pass through each other (assumed)",
    "stop": "a tip stops at another branch (assumed)",
}


def _half_angle_rad(given: Any) -> float | tuple[float, float]:  # noqa: ANN401  of a file
    """Return a head-on half-angle, or its range, from degrees."""
    ends: list[Any] = list(given) if isinstance(given, list | tuple) else [given, given]
    if len(ends) != 2:
        raise BadInputError(HALF_ANGLE_DEG, given, "a number, or a range [low, high]")
    for end in ends:
        if isinstance(end, bool):
            raise BadInputError(HALF_ANGLE_DEG, end, "0 to 90 deg")
    low_rad, high_rad = (rad(number(HALF_ANGLE_DEG, end, 0.0, 90.0, "deg")) for end in ends)
    return low_rad if low_rad == high_rad else (low_rad, high_rad)


class GrowthOptions(Table):
    """Options of the growth model; recorded with every result, because results depend on them.

    ``head_on_half_angle_rad``: a tip that meets a wall with its heading within this angle of the
    wall's inward normal stops there. Surface and tube decide its value: 1 to 15 degrees on smooth
    walls, 15 to 45 on rough ones (assumed). For a tip that slides as a solid it is the angle whose
    tangent is the friction (Coulomb's cone); an everting tip lies below. A range (low, high) gives
    every evaluation another value: the same for all designs that are compared.

    ``body``: inflated, every level sees the free space shrunk by its inflated radius, lay-flat
    width / pi. The published model has a line, and no pressure.

    ``branch_contact``: branches of the published model pass through each other. Bodies meet with
    their inflated radii; bodies that are lines, where they cross.
    """

    head_on_half_angle_rad: Annotated[
        float | Annotated[tuple[float, float], Field(strict=False)],
        Field(alias=HALF_ANGLE_DEG),
        Unit("deg"),
        Slider(0, 45, 0.5),
        Doc("within it of head-on a tip stops, 0 to 90; [low, high]: drawn"),
    ] = DEFAULT_HEAD_ON_HALF_ANGLE_RAD
    children_of_stuck: Annotated[
        ChildrenOfStuck,
        Doc("of a branch that stopped early: they stay inside, or grow from where it stopped"),
    ] = "stop"
    body: Annotated[Body, Doc("inflated, or a line as in the paper")] = "inflated"
    pressure_stop: Annotated[
        bool, Doc("whether growth ends where the design's pressure no longer everts the film")
    ] = True
    storage_kpa: Annotated[
        float,
        Ge(0),
        Le(1000),
        Unit("kPa"),
        Slider(0, 12, 0.1),
        Doc("tension of the film in its store: 0 if it lies loosely, 8.32 on a tight spool"),
    ] = 0.0
    fitted_diameter_mm: Annotated[
        float,
        Ge(1),
        Le(1000),
        Unit("mm"),
        Slider(5, 100),
        Doc("of the tube of the published fit of the growth pressure (assumed)"),
    ] = FITTED_DIAMETER_MM.value
    branch_contact: Annotated[
        BranchContact,
        Doc("of a tip that meets the body of another branch: it stops there, or passes through"),
    ] = DEFAULT_BRANCH_CONTACT
    emergence: Annotated[
        float,
        Gt(0),
        Le(1),
        Slider(0.5, 1, 0.01),
        Doc("probability that a child comes out of its parent's tip; below 1: drawn"),
    ] = 1.0
    body_width_ratio: Annotated[
        float,
        Ge(0.5),
        Le(2),
        Slider(0.5, 2, 0.01),
        Doc("how far bodies keep their centre lines from walls, over lay-flat width / pi"),
    ] = 1.0
    contacts: Annotated[
        MeasuredContacts | None,
        BeforeValidator(lambda given: None if given is None else contacts_of(given)),
        Doc("measured: a file, relative to the run file, or its name; or the numbers themselves"),
    ] = None
    surface: Annotated[
        str | None,
        Field(exclude_if=lambda name: name is None),  # records of before have none
        Doc("of the walls: smooth, rough, or one of `contacts`; else the maps', where they say it"),
    ] = None

    @model_validator(mode="before")
    @classmethod
    def _degrees_of_files(cls, given: Any) -> Any:  # noqa: ANN401  what pydantic hands on
        if isinstance(given, Mapping) and HALF_ANGLE_DEG in given:
            return {**given, HALF_ANGLE_DEG: _half_angle_rad(given[HALF_ANGLE_DEG])}
        return given

    @model_validator(mode="after")
    def _half_angle_is_allowed(self) -> "GrowthOptions":
        low_rad, high_rad = self.half_angle_range_rad
        number(HALF_ANGLE_DEG, deg(high_rad), 0.0, 90.0, "deg")
        number(HALF_ANGLE_DEG, deg(low_rad), 0.0, deg(high_rad), "deg")
        if self.surface is not None:
            surface_known(self.surface, self.contacts)
        return self

    @classmethod
    def published(cls, **changes: Any) -> "GrowthOptions":  # noqa: ANN401  as the class
        """Return the published model: the body is a line, and stopped by walls alone."""
        published = {"body": "centerline", "pressure_stop": False, "branch_contact": "pass"}
        return cls(**{**published, **changes})

    @classmethod
    def of(
        cls, given: Mapping[str, object], base: "GrowthOptions | None" = None
    ) -> "GrowthOptions":
        """Return options from names and values as files have them, angles in degrees.

        Parameters
        ----------
        given
            Any of the options' names; the head-on half-angle is a number or ``[low, high]``, and
            ``contacts`` the numbers of measured contacts: they replace the half-angle and the
            ratio of widths where these are not given with them.
        base
            What the other options are; the defaults if None.

        Raises
        ------
        BadInputError
            If a value cannot be used.
        UnknownNameError
            If there is no such option.
        """
        for name in given:
            if name not in GROWTH_NAMES:
                raise UnknownNameError("growth option", name, GROWTH_NAMES)
        base, values = base or cls(), dict(given)
        surface: Any = values.get("surface", base.surface)
        if values.get("contacts") is not None:
            values = {**measured_values(values["contacts"], surface), **values}
        elif base.contacts and surface in [one.surface for one in base.contacts.surfaces]:
            ends_deg = KnownHalfAngle.of(base.contacts, surface).ends_deg
            values = {HALF_ANGLE_DEG: list(ends_deg), **values}
        kept = {name: getattr(base, name) for name in cls.model_fields if name not in values}
        if HALF_ANGLE_DEG in values:
            del kept["head_on_half_angle_rad"]
        return cls(**kept, **values)

    @property
    def content(self) -> dict[str, object]:
        """All options as files, records and pages have them."""
        return {name: value for name, value in self.values.items() if value is not None}

    @property
    def values(self) -> dict[str, object]:
        """All options as files have them; a surface only where it is known, as in older records."""
        plain = {name: getattr(self, name) for name in GROWTH_NAMES[1:]}
        if self.surface is None:
            del plain["surface"]
        measured = None if self.contacts is None else self.contacts.content
        return {HALF_ANGLE_DEG: self.half_angle_deg, **plain, "contacts": measured}

    def radius_mm(self, width_mm: float) -> float:
        """Return the distance of a body's centre line from walls, for some lay-flat width."""
        if self.body == "centerline":
            return 0.0
        return inflated_radius_mm(width_mm) * self.body_width_ratio

    def drawn_widths_mm(self, tree: BranchTree) -> Floats:
        """Return the lay-flat width of each branch in a picture: 0 where a line grew, shape (n,).

        >>> tree = Design.read("three_level_tree").tree
        >>> GrowthOptions().drawn_widths_mm(tree)[:3].tolist()
        [40.0, 24.0, 24.0]
        >>> GrowthOptions.published().drawn_widths_mm(tree)[:3].tolist()
        [0.0, 0.0, 0.0]
        """
        return np.zeros(len(tree)) if self.body == "centerline" else tree.width_mm

    @property
    def half_angle_range_rad(self) -> tuple[float, float]:
        """Least and greatest head-on half-angle."""
        angle = self.head_on_half_angle_rad
        return angle if isinstance(angle, tuple) else (angle, angle)

    @property
    def draws_half_angle(self) -> bool:
        """Whether every evaluation has its own head-on half-angle."""
        low_rad, high_rad = self.half_angle_range_rad
        return low_rad < high_rad

    @property
    def draws(self) -> bool:
        """Whether two evaluations from one pose differ."""
        return self.draws_half_angle or self.emergence < 1.0

    @property
    def emergence_standing(self) -> str:
        """Where the probability comes from: ``assumed``, or ``measured`` and how."""
        found = None if self.contacts is None else self.contacts.emergence
        if found is None or found.value != self.emergence:
            return "assumed"
        return f"measured: {found.text}"

    @property
    def emergences(self) -> tuple[float, ...]:
        """Probabilities of emergence that predictions are shown for: measured, or assumed."""
        found = None if self.contacts is None else self.contacts.emergence
        if found is None:
            return EMERGENCES
        return tuple(dict.fromkeys((found.high, found.value, max(found.low, 0.01))))

    @property
    def emergences_standing(self) -> str:
        """Where `emergences` come from: ``assumed``, or ``measured`` and how."""
        found = None if self.contacts is None else self.contacts.emergence
        return "assumed" if found is None else f"measured: {found.text}"

    def half_angles_rad(self, count: int) -> Floats:
        """Return one head-on half-angle for each of some launches, shape (count,).

        Of a range, they are spread evenly and in no order that a map or a pose could share: steps
        of the golden section. The same count gives the same angles.
        """
        low_rad, high_rad = self.half_angle_range_rad
        share = np.mod(0.5 + np.arange(count) * (math.sqrt(5.0) - 1.0) / 2.0, 1.0)
        return np.asarray(low_rad + (high_rad - low_rad) * share)

    @property
    def only_half_angle_rad(self) -> float:
        """The head-on half-angle of a single growth.

        Raises
        ------
        BadInputError
            If there is a range of them.
        """
        low_rad, high_rad = self.half_angle_range_rad
        if low_rad < high_rad:
            problem = f"{self.half_angle_deg} is a range, for scores over many deployments"
            raise UnfitInputError("head_on_half_angle_deg", problem, "give one number")
        return low_rad

    @property
    def at_one_angle(self) -> "GrowthOptions":
        """The options of a single growth: the measured half-angle, else the low end of a range.

        All its children come out.
        """
        angle_rad, known = self.half_angle_range_rad[0], self.known_half_angle
        if self.draws_half_angle and self.uses_measured and known.value_deg is not None:
            angle_rad = rad(known.value_deg)
        return self.changed(head_on_half_angle_rad=angle_rad, emergence=1.0)

    @property
    def in_the_middle(self) -> "GrowthOptions":
        """The options with the half-angle in the middle of its range."""
        return self.changed(head_on_half_angle_rad=rad(self.known_half_angle.middle_deg))

    @property
    def known_half_angle(self) -> "KnownHalfAngle":
        """What is known of the half-angle on this surface, whatever growth uses."""
        return KnownHalfAngle.of(self.contacts, self.surface)

    @property
    def uses_measured(self) -> bool:
        """Whether growth uses the measured half-angle; another one may have been given."""
        known = self.known_half_angle
        uses = known.ends_deg, (known.middle_deg, known.middle_deg)
        ends = [deg(angle_rad) for angle_rad in self.half_angle_range_rad]
        return known.is_measured and any(
            np.allclose(ends, use, rtol=0.0, atol=1e-7) for use in uses
        )

    @property
    def half_angle_standing(self) -> str:
        """Where the half-angle comes from: ``assumed``, or ``measured`` and how."""
        return self.known_half_angle.standing if self.uses_measured else "assumed"

    @property
    def contact_angles_deg(self) -> tuple[float, ...]:
        """Head-on half-angles that predictions are shown for: ends, middle and between."""
        return self.known_half_angle.angles_deg

    @property
    def contact_angles_standing(self) -> str:
        """Where `contact_angles_deg` come from: ``assumed``, or ``measured`` and how."""
        return self.known_half_angle.standing

    @property
    def half_angle_deg(self) -> float | list[float]:
        """The head-on half-angle in degrees, or its range, as files and reports have it."""
        low, high = (deg(angle_rad) for angle_rad in self.half_angle_range_rad)
        return low if low == high else [low, high]

    @property
    def half_angle_text(self) -> str:
        """The head-on half-angle as it is shown: ``1 deg``, or ``1 to 15 deg``."""
        low_rad, high_rad = self.half_angle_range_rad
        low, high = f"{deg(low_rad):g}", f"{deg(high_rad):g}"
        return f"{low} deg" if low == high else f"{low} to {high} deg"

    @property
    def deploys_stuck(self) -> bool:
        """Whether children of a stuck branch grow from where it stopped."""
        return self.children_of_stuck == "deploy"


GROWTH_NAMES = tuple(key.name for key in declared_keys(GrowthOptions))
"""Names of the options in files and on the command line."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GrowthChoice:
    """The growth options that a command takes, and the notes about them for its user."""

    options: GrowthOptions
    notes: tuple[str, ...] = ()  # a sentence each

    @classmethod
    def of(
        cls, designs: Sequence[Design], given: Mapping[str, object] | None = None
    ) -> "GrowthChoice":
        """Choose: what the user gave, else what the designs were trained with, else the defaults.

        Parameters
        ----------
        designs
            The designs; those that no run has made grow as the others were trained, and where
            these were trained with different options, the defaults count.
        given
            Some options by name, as in `GrowthOptions.of`.

        Raises
        ------
        BadInputError
            If a value that was given, or one in a design's origin, cannot be used.
        UnknownNameError
            If there is no such option.
        """
        given = given or {}
        trained = list[GrowthOptions]()
        for design in designs:
            with located(f"design {design.name}"):
                trained.append(trained_growth(design))
        made_by_runs = [
            options
            for design, options in zip(designs, trained, strict=True)
            if ORIGIN_GROWTH in design.origin
        ]
        chosen = [GrowthOptions.of(given, options) for options in made_by_runs or trained]
        if all(options == chosen[0] for options in chosen):
            return cls(options=chosen[0])
        note = "designs trained with different growth options: all are grown with the defaults"
        return cls(options=GrowthOptions.of(given), notes=(note,))

    @property
    def single(self) -> "GrowthChoice":
        """The same for a single growth, which has one head-on half-angle."""
        options, notes = self.options.at_one_angle, self.notes
        if self.options.emergence < 1.0:
            notes = (*notes, f"emergence {self.options.emergence:g}: here every child comes out")
        if not self.options.draws_half_angle:
            return GrowthChoice(options=options, notes=notes)
        at_low_end = options.half_angle_range_rad[0] == self.options.half_angle_range_rad[0]
        which = "the low end" if at_low_end else "the measured value"
        note = (
            f"head-on half-angle {options.half_angle_text}: "
            f"{which} of its range, {self.options.half_angle_text}"
        )
        return GrowthChoice(options=options, notes=(*notes, note))


def shown_growth(choice: GrowthChoice, given: Mapping[str, object]) -> GrowthChoice:
    """Return how designs are grown for a prediction: in the middle of the range of half-angles.

    Parameters
    ----------
    given
        Options that the caller gave; with a half-angle among them that one counts.
    """
    if HALF_ANGLE_DEG in given:
        return choice
    trained, known = choice.options, choice.options.known_half_angle
    low, high = known.ends_deg
    note = (
        f"grown at a head-on half-angle of {known.middle_deg:g} deg, the middle of {low:g} to "
        f"{high:g} ({known.standing}); trained at {trained.half_angle_text}"
    )
    return GrowthChoice(options=trained.in_the_middle, notes=(*choice.notes, note))


def trained_growth(design: Design) -> GrowthOptions:
    """Return the growth options that a design was trained with; the defaults where none stand."""
    table = design.origin.get(ORIGIN_GROWTH, {})
    if not isinstance(table, Mapping):
        raise BadInputError(_origin_key(), table, "a table of growth options")
    try:
        return GrowthOptions.of(table)
    except BadInputError as error:
        raise error.under(_origin_key(error.key)) from None
    except UnknownNameError as error:
        remedy = nearest(error.name, error.known).removeprefix("; ") or "leave it out"
        listed = f"options: {', '.join(error.known)}"
        key = _origin_key(error.name)
        raise UnfitInputError(key, "there is no such option", f"{remedy} ({listed})") from None


def _origin_key(name: str = "") -> str:
    return ".".join(filter(None, ("origin", ORIGIN_GROWTH, name)))


def growth_text(options: GrowthOptions, designs: Sequence[Design]) -> str:
    """Return the rules by which designs grow, as printed with every score."""
    half_angle = f"head-on half-angle {options.half_angle_text} ({options.half_angle_standing})"
    parts = [f"{options.body} body", half_angle]
    ratio = options.body_width_ratio
    if ratio != 1.0 and options.body != "centerline":
        found = None if options.contacts is None else options.contacts.body_width_ratio
        is_measured = found is not None and found.value == ratio
        standing = f"measured: {found.text()}" if found and is_measured else "assumed"
        parts.append(f"{ratio:g} of the nominal radius from walls ({standing})")
    pressures_kpa = {design.build.pressure_kpa for design in designs}
    if options.pressure_stop and any(pressures_kpa):
        held = f"held back by {options.storage_kpa:g} kPa"
        film = held if options.storage_kpa else "stored loosely"
        only = len(pressures_kpa) == 1
        at = f"{max(pressures_kpa):g} kPa" if only else "each design's pressure"
        parts.append(f"stops at {at} (film {film}, assumed)")
    else:
        parts.append("no pressure stops it")
    if any(design.branch_count > 1 for design in designs):
        parts.append(_CONTACT_WORDS[options.branch_contact])
    if options.emergence < 1.0:
        share = f"{options.emergence:g} ({options.emergence_standing})"
        parts.append(f"a child comes out with probability {share}")
    if options.deploys_stuck:
        parts.append("children of a stuck branch grow all the same")
    cut = [design.name for design in designs if design.shape is not None]
    if cut:
        names = " and ".join(dict.fromkeys(cut))
        parts.append(f"{names} with the angles at which its flat ones deploy (simulated)")
    return ", ".join(parts)


@dataclass(frozen=True, slots=True, kw_only=True)
class KnownHalfAngle:
    """What is known of the head-on half-angle on a surface, measured or assumed."""

    ends_deg: tuple[float, float]  # the range that predictions are shown for
    standing: str  # ``assumed``, with a colon and how; or ``measured`` and how
    value_deg: float | None = None  # the most likely one, where it is known
    source: str = ""  # who saw the contacts, and how
    measured_deg: tuple[float, ...] = ()  # the numbers among these that were measured

    @classmethod
    def of(cls, contacts: MeasuredContacts | None, surface: str | None) -> "KnownHalfAngle":
        """Return the half-angle that was measured on a surface, else on photos, else assumed.

        A file with one surface alone holds for maps that name none.
        """
        measured = () if contacts is None else contacts.surfaces
        on_photos = None if contacts is None else contacts.head_on_half_angle_deg
        if surface is None and on_photos is None and len(measured) == 1:
            return cls.on_surface(measured[0])
        if surface is not None and (surface in [one.surface for one in measured] or not on_photos):
            return cls.on_surface(surface_known(surface, contacts))
        return cls(ends_deg=UNMEASURED_DEG, standing="assumed") if on_photos is None else (
            cls.on_photos(on_photos)
        )  # fmt: skip

    @classmethod
    def on_surface(cls, found: Surface) -> "KnownHalfAngle":
        """Return the half-angle of a surface."""
        low, high, value = (getattr(found.half_angle_deg, end) for end in ("low", "high", "value"))
        side: Side = "both"
        if value is None and found.standing == "measured":
            side = "upper" if low == 0.0 else "lower" if high == 90.0 else "both"
        ends, left_open = _left_open(side, low, high)
        return cls(
            ends_deg=ends,
            standing=f"{found.standing}: {found.text}{left_open}",
            value_deg=value,
            source=found.source,
            measured_deg=_numbers(side, low, high, value) * (found.standing == "measured"),
        )

    @classmethod
    def on_photos(cls, found: MeasuredNumber) -> "KnownHalfAngle":
        """Return the half-angle that photos of grown robots measured."""
        ends, left_open = _left_open(found.side, found.low, found.high)
        return cls(
            ends_deg=ends,
            standing=f"measured: {found.text('deg')}{left_open}",
            value_deg=found.value,
            source=found.source,
            measured_deg=_numbers(found.side, found.low, found.high, found.value),
        )

    @property
    def is_measured(self) -> bool:
        """Whether it was measured."""
        return self.standing.startswith("measured")

    @property
    def middle_deg(self) -> float:
        """The most likely half-angle, else the middle of the range."""
        return sum(self.ends_deg) / 2.0 if self.value_deg is None else self.value_deg

    @property
    def angles_deg(self) -> tuple[float, ...]:
        """The half-angles that predictions are shown for, least first."""
        (low, high), middle = self.ends_deg, self.middle_deg
        between = (round((low + middle) / 2.0, 2), middle, round((middle + high) / 2.0, 2))
        return tuple(dict.fromkeys((low, *between, high)))


CONTACT_ANGLES_DEG = KnownHalfAngle(ends_deg=UNMEASURED_DEG, standing="assumed").angles_deg
"""Half-angles that predictions are shown for where nothing was measured and no surface is named."""


def _numbers(side: Side, low: float, high: float, value: float | None) -> tuple[float, ...]:
    """Return the numbers of a measurement: value and interval, or the one bound."""
    bounds = {"both": (low, high), "upper": (high,), "lower": (low,)}[side]
    return bounds if value is None else (value, *bounds)


def _left_open(side: Side, low: float, high: float) -> tuple[tuple[float, float], str]:
    """Return the range of half-angles that a measurement leaves open, and its assumed part.

    Where there is only a bound, the other end is the assumed one, as far as the bound allows.
    """
    least, most = UNMEASURED_DEG
    if side == "upper":
        ends = min(least, high), min(most, high)
        between = f"; {ends[0]:g} to {most:g} deg assumed"
        return ends, between if most < high else f"; {ends[0]:g} deg assumed"
    if side == "lower":
        ends = low, most if low < most else high
        return ends, f"; {ends[1]:g} deg assumed"
    return (low, high), ""


def measured_values(given: object, surface: str | None = None) -> dict[str, Any]:
    """Return the growth options that measured contacts give, as files have them."""
    contacts = None if given is None else contacts_of(given)
    known, values = KnownHalfAngle.of(contacts, surface), dict[str, Any]()
    if known.is_measured:
        values[HALF_ANGLE_DEG] = list(known.ends_deg)
    if contacts is None:
        return values
    if contacts.body_width_ratio is not None and contacts.body_width_ratio.value is not None:
        values["body_width_ratio"] = contacts.body_width_ratio.value
    if contacts.emergence is not None:
        values["emergence"] = contacts.emergence.value
    return values


def surface_words() -> str:
    """Return what is known of half-angles in general, by surface."""
    known = (
        f"{one.half_angle_deg.low:g} to {one.half_angle_deg.high:g} degrees where walls are "
        f"{one.surface} ({one.standing}, {one.counted})"
        for one in SURFACES
    )
    return f"surface and tube decide: {', '.join(known)}"


def on_surface(given: Mapping[str, Any] | None, worlds: Iterable[Map]) -> dict[str, Any]:
    """Return growth options by name with the surface that maps name, where none is given."""
    options = dict(given or {})
    if options.get("surface") is None and (surface := surface_of(worlds)):
        options["surface"] = surface
    return options


def on_maps(growth: GrowthOptions, worlds: Iterable[Map]) -> GrowthOptions:
    """Return growth options that know the surface of maps; the half-angle stays."""
    surface = growth.surface or surface_of(worlds)
    return growth if surface is None else growth.changed(surface=surface)


def surface_of(worlds: Iterable[Map]) -> str | None:
    """Return the surface that maps name; None where none names one.

    Raises
    ------
    UnfitInputError
        If they name different ones.
    """
    named = dict.fromkeys(world.surface for world in worlds)
    if len(named) > 1:
        words = ", ".join(name or "none" for name in named)
        remedy = "take maps of one surface, or give --growth surface=NAME"
        raise UnfitInputError("maps", f"they name different surfaces: {words}", remedy)
    return next(iter(named), None) or None
