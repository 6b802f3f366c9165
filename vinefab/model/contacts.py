"""What was measured of contacts: numbers with intervals, read by predictions."""

from collections.abc import Mapping, Sequence
from os import PathLike
from pathlib import Path
from typing import Annotated, Final, Literal

import tomli_w
from annotated_types import Ge, Interval, Le, Unit
from pydantic import Field, model_validator
from typing_extensions import Doc

from vinefab.core.errors import BadInputError, UnfitInputError, UnknownNameError
from vinefab.core.plain_text import GENERATOR, counted
from vinefab.core.table import Table, validated
from vinefab.core.validation import number
from vinefab.model.files.shipped import locate
from vinefab.model.files.toml import read_toml

Side = Literal["both", "upper", "lower"]
"""Whether an interval has both ends, or the photos gave only an upper or only a lower bound."""

FEW_PHOTOS = 5
"""With fewer, photos that differ from each other cannot be told from photos that are alike."""

_MOST = 1e6
_ANY = Interval(ge=-_MOST, le=_MOST)
_COUNT = Interval(ge=1, le=10**6)


class MeasuredNumber(Table):
    """A number with its 95 % interval and its sample; its unit is in its name."""

    low: Annotated[float, _ANY, Doc("of the 95 % interval")]
    high: Annotated[float, _ANY, Doc("of the 95 % interval")]
    value: Annotated[
        float | None, Doc("the most likely one; left out where only a bound is known")
    ] = None
    side: Annotated[Side, Doc("both: an interval; lower or upper: only that bound is known")] = (
        "both"
    )
    count: Annotated[int, _COUNT, Doc("of contacts or places that it rests on")]
    photos: Annotated[int, _COUNT, Doc("that they were seen on")]
    source: Annotated[str, Field(min_length=1), Doc("which photos, and how")]
    standing: Annotated[Literal["measured"], Doc("always that")] = "measured"

    @model_validator(mode="after")
    def _is_an_interval(self) -> "MeasuredNumber":
        number("high", self.high, self.low, _MOST)
        if (self.value is None) != (self.side != "both"):
            problem = "a bound has no value" if self.value is not None else "is missing"
            remedy = "leave it out, or set side = 'both'" if self.value is not None else "give it"
            raise UnfitInputError("value", problem, remedy)
        if self.value is not None:
            number("value", self.value, self.low, self.high)
        return self

    def __ge__(self, least: float) -> bool:  # fields declare ranges as of plain numbers
        return self.low >= least

    def __le__(self, most: float) -> bool:
        return self.high <= most

    def text(self, unit: str = "") -> str:
        """Return its source: ``12 contacts on 4 photos, 95 % interval 3 to 7 deg``."""
        ends = {
            "both": f"95 % interval {self.low:g} to {self.high:g}",
            "upper": f"at most {self.high:g}",
            "lower": f"at least {self.low:g}",
        }[self.side]
        few = f"; too few photos, from {FEW_PHOTOS} on" if self.photos < FEW_PHOTOS else ""
        return f"{self.counted}, {ends}{f' {unit}' if unit else ''}{few}"

    @property
    def counted(self) -> str:
        """How much it was measured from: ``12 contacts on 4 photos``."""
        photos = counted(self.photos, "photo")
        return f"{counted(self.count, 'contact')} on {photos}"


_SHARE = Interval(ge=0, le=1)


class MeasuredShare(Table):
    """A share of trials with its 95 % interval."""

    low: Annotated[float, _SHARE, Doc("of the 95 % interval")]
    high: Annotated[float, _SHARE, Doc("of the 95 % interval")]
    count: Annotated[int, _COUNT, Doc("that came out")]
    tried: Annotated[int, _COUNT, Doc("that were tried")]
    pressure_kpa: Annotated[float, Ge(0), Le(1000), Unit("kPa"), Doc("at which they were tried")]
    source: Annotated[str, Field(min_length=1), Doc("which coupons, and how")]
    standing: Annotated[Literal["measured"], Doc("always that")] = "measured"

    @model_validator(mode="after")
    def _is_an_interval(self) -> "MeasuredShare":
        number("tried", self.tried, self.count, 10**6)
        number("high", self.high, self.low, 1.0)
        number("count / tried", self.value, self.low, self.high)
        return self

    @property
    def value(self) -> float:
        """The share itself."""
        return self.count / self.tried

    @property
    def text(self) -> str:
        """Where it comes from: ``17 of 18 children at 20 kPa, 95 % interval 0.76 to 0.99``."""
        tried = f"{self.count} of {self.tried} children at {self.pressure_kpa:g} kPa"
        return f"{tried}, 95 % interval {self.low:.2f} to {self.high:.2f}"


_ANGLE = Interval(ge=0, le=90)


class SurfaceAngle(Table):
    """The head-on half-angle on one surface: the likely value, and the range that it lies in."""

    low: Annotated[float, _ANGLE, Unit("deg"), Doc("least; 0 where every tip grew on")]
    high: Annotated[float, _ANGLE, Unit("deg"), Doc("greatest; 90 where every tip stopped")]
    value: Annotated[
        float | None, Unit("deg"), Doc("the most likely one; left out where it is not known")
    ] = None

    @model_validator(mode="after")
    def _is_an_interval(self) -> "SurfaceAngle":
        number("high", self.high, self.low, 90.0)
        if self.value is not None:
            number("value", self.value, self.low, self.high)
        return self


class Surface(Table):
    """Contacts with one kind of wall: the half-angle belongs to a surface with a film."""

    surface: Annotated[str, Field(min_length=1, max_length=80), Doc("its name")]
    half_angle_deg: Annotated[
        SurfaceAngle, Unit("deg"), Doc("within it of a wall's normal, head-on, a tip stops")
    ]
    contacts: Annotated[int, Ge(0), Le(10**6), Doc("that were seen; 0: no count is published")]
    tube_diameter_mm: Annotated[
        float | None, Ge(0.1), Le(1e4), Unit("mm"), Doc("of the tubes; left out: not known")
    ] = None
    film: Annotated[str, Field(exclude_if=lambda name: not name), Doc("of the tubes")] = ""
    source: Annotated[str, Field(min_length=1), Doc("who saw them, and how")]
    standing: Annotated[
        Literal["measured", "published", "assumed"], Doc("where the half-angle comes from")
    ] = "measured"

    @property
    def text(self) -> str:
        """Its source in a few words: ``on rough, 40 contacts, 95 % interval 9 to 16 deg``."""
        ends = f"{self.half_angle_deg.low:g} to {self.half_angle_deg.high:g} deg"
        kind = "95 % interval " if self.standing == "measured" else ""
        return f"on {self.surface}, {self.counted}, {kind}{ends}"

    @property
    def counted(self) -> str:
        """How many contacts were seen: ``17 contacts``."""
        return counted(self.contacts, "contact") if self.contacts else "contacts not counted"


SURFACES = (
    Surface(
        surface="smooth",
        half_angle_deg=SurfaceAngle(low=1.0, high=15.0),
        contacts=17,
        source="17 lasting contacts on films of others (DiffVineSimPy), all slid, 19 degrees or "
        "more from head-on; one more of a 24 mm tube slid at 16.3 (Jitosho 2021)",
        standing="assumed",
    ),
    Surface(
        surface="rough",
        half_angle_deg=SurfaceAngle(low=15.0, high=45.0),
        contacts=0,
        source="one abstract: robots pinned after 24 cm between rough cylinders of 8 cm "
        "(Murray-Cooper et al., APS March Meeting 2019, S64.8)",
        standing="assumed",
    ),
)
"""Surfaces that every map may name; measured ones of a contacts file take their places."""


class MeasuredContacts(Table):
    """What was measured of contacts: a number that was not is None.

    Several photos together give all but the share of children that come out and the surfaces, which
    coupons give.
    """

    head_on_half_angle_deg: Annotated[
        MeasuredNumber | None,
        Ge(0),
        Le(90),
        Unit("deg"),
        Doc("within it of a wall's normal, head-on, a tip stops"),
    ] = None
    # Not the friction of a body that is pulled around an obstacle (that of anchoring).
    tip_friction: Annotated[
        MeasuredNumber | None,
        Ge(0),
        Le(1e6),
        Doc("of the everting tip on the wall: tangent of the half-angle"),
    ] = None
    body_width_ratio: Annotated[
        MeasuredNumber | None,
        Ge(0.5),
        Le(2),
        Doc("how far centre lines keep from walls that bodies touch, over lay-flat width / pi"),
    ] = None
    film_breadth_ratio: Annotated[
        MeasuredNumber | None,
        Ge(0.1),
        Le(10),
        Doc("breadth of the film as seen from above, over 2 lay-flat width / pi"),
    ] = None

    emergence: Annotated[
        MeasuredShare | None,
        Doc("share of the children that come out of their parent's tip"),
    ] = None
    surfaces: Annotated[
        tuple[Surface, ...],
        Field(strict=False, exclude_if=lambda found: not found),
        Doc("half-angles by surface, which maps and rigs name"),
    ] = ()

    @model_validator(mode="after")
    def _has_a_number(self) -> "MeasuredContacts":
        names = MeasuredContacts.model_fields
        if not any(getattr(self, name) for name in names):
            raise UnfitInputError("contacts", "hold no number", f"give one of {', '.join(names)}")
        named = [one.surface for one in self.surfaces]
        if len(set(named)) < len(named):
            twice = next(name for name in named if named.count(name) > 1)
            raise UnfitInputError("surfaces", f"{twice} is there twice", "leave one of them out")
        return self


def surface_known(name: str, contacts: MeasuredContacts | None) -> Surface:
    """Return the surface of a name: a measured one, else one that ships.

    Raises
    ------
    UnknownNameError
        If there is none.
    """
    known = {one.surface: one for one in SURFACES}
    if contacts is not None:
        known |= {one.surface: one for one in contacts.surfaces}
    if name not in known:
        raise UnknownNameError("surface", name, known)
    return known[name]


CONTACTS_SCHEMA: Final = "vinefab/contacts-1"


class ContactsFile(MeasuredContacts):
    """A file of measured contacts."""

    schema_: Annotated[
        Literal["vinefab/contacts-1"], Field(alias="schema"), Doc("kind of file and its version")
    ] = CONTACTS_SCHEMA
    method: Annotated[
        dict[str, str | float | int | bool | list[str]], Doc("how the numbers were fitted")
    ] = Field(default_factory=dict)


def contacts_of(
    given: object, allowed: str = "a table of numbers: a file is named by the user alone"
) -> MeasuredContacts:
    """Return measured contacts, given as such or as the table of a file."""
    if isinstance(given, MeasuredContacts):
        return given
    if not isinstance(given, Mapping):
        raise BadInputError("contacts", given, allowed)
    return validated(MeasuredContacts, given, "contacts")


def read_contacts(path_or_name: str | PathLike[str]) -> MeasuredContacts:
    """Return the measured contacts of a file, or of a name in the user's own folder."""
    path = locate("contacts file", path_or_name)
    found = validated(ContactsFile, read_toml(path), path)
    return MeasuredContacts(
        **{name: getattr(found, name) for name in MeasuredContacts.model_fields}
    )


def contacts_text(contacts: MeasuredContacts, method: Mapping[str, object]) -> str:
    """Return measured contacts as a file.

    Parameters
    ----------
    method
        How they were found, for readers; vinefab does not read it.
    """
    content = {"schema": CONTACTS_SCHEMA, **contacts.content, "method": dict(method)}
    return f"# {GENERATOR}: measured contacts\n{tomli_w.dumps(content)}"


def contacts_with(
    path: Path, emergence: MeasuredShare | None = None, surfaces: Sequence[Surface] = ()
) -> str:
    """Return a file of measured contacts, or a new one, with more numbers; its others stay.

    Parameters
    ----------
    emergence
        The share of children that come out, if it was measured.
    surfaces
        Surfaces that were measured; those of the same names in the file are replaced.
    """
    found, method = dict[str, object](), dict[str, object]()
    if path.exists():
        before = validated(ContactsFile, read_toml(path), path)
        found = {name: getattr(before, name) for name in MeasuredContacts.model_fields}
        named = {one.surface for one in surfaces}
        surfaces = [*(one for one in before.surfaces if one.surface not in named), *surfaces]
        method = dict(before.method)
    if emergence is not None:
        found["emergence"] = emergence
    return contacts_text(MeasuredContacts(**{**found, "surfaces": tuple(surfaces)}), method)
