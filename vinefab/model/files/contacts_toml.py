"""Measured contacts as TOML, schema ``vinefab/contacts-1``."""

from collections.abc import Mapping
from os import PathLike
from typing import Annotated, Literal

import tomli_w
from pydantic import Field

from vinefab.core.errors import BadInputError, located
from vinefab.core.jsontext import GENERATOR
from vinefab.model.contacts import MeasuredContacts, MeasuredNumber, Side
from vinefab.model.files.shipped import locate
from vinefab.model.files.toml import Form, read_toml, validated

CONTACTS_SCHEMA = "vinefab/contacts-1"


class MeasuredNumberForm(Form):
    """A table of one number; never without the standing ``measured`` and its source."""

    value: float | None = None  # the most likely one; left out where only a bound is known
    low: float  # of the 95 % interval
    high: float  # of the 95 % interval
    side: Side = "both"  # both: an interval; lower or upper: only that bound is known
    count: int  # of contacts or places that it rests on
    photos: int  # that they were seen on
    standing: Literal["measured"] = "measured"  # always that
    source: Annotated[str, Field(min_length=1)]  # which photos, and how


class NumbersForm(Form):
    """The numbers of `MeasuredContacts`."""

    head_on_half_angle_deg: MeasuredNumberForm | None = None  # within it of head-on a tip stopped
    # of the everting tip on the wall: tangent of the half-angle
    tip_friction: MeasuredNumberForm | None = None
    # how far centre lines keep from walls, over the nominal radius
    body_width_ratio: MeasuredNumberForm | None = None
    # breadth of the film as seen, over the nominal inflated width
    film_breadth_ratio: MeasuredNumberForm | None = None


class ContactsForm(NumbersForm):
    """A whole file."""

    schema_: Literal["vinefab/contacts-1"] = Field(alias="schema")  # kind of file and its version
    # how the numbers were fitted
    method: dict[str, str | float | int | bool | list[str]] = Field(default_factory=dict)


def contacts_given(given: object) -> MeasuredContacts:
    """Return measured contacts as a user gives them: also by the path or name of their file."""
    if isinstance(given, str | PathLike):
        return read_contacts(given)
    return contacts_of(given, "a file of measured contacts (TOML), or its name")


def contacts_of(
    given: object, allowed: str = "a table of numbers: a file is named by the user alone"
) -> MeasuredContacts:
    """Return measured contacts, given as such or as the table of a file."""
    if isinstance(given, MeasuredContacts):
        return given
    if not isinstance(given, Mapping):
        raise BadInputError("contacts", given, allowed)
    return _contacts(validated(NumbersForm, given, "contacts"))


def read_contacts(path_or_name: str | PathLike[str]) -> MeasuredContacts:
    """Return the measured contacts of a file, or of a name in the user's own folder."""
    path = locate("contacts file", path_or_name)
    form = validated(ContactsForm, read_toml(path), path)
    with located(path):
        return _contacts(form)


def contacts_text(contacts: MeasuredContacts, method: Mapping[str, object]) -> str:
    """Return measured contacts as a file.

    Parameters
    ----------
    method
        How they were found, for readers; vinefab does not read it.
    """
    content = {"schema": CONTACTS_SCHEMA, **contacts.content, "method": dict(method)}
    return f"# {GENERATOR}: what photos of grown robots measured\n{tomli_w.dumps(content)}"


def _contacts(form: NumbersForm) -> MeasuredContacts:
    numbers = {}
    for name in NumbersForm.model_fields:
        given: MeasuredNumberForm | None = getattr(form, name)
        if given is not None:
            try:
                numbers[name] = MeasuredNumber(**given.model_dump(exclude={"standing"}))
            except BadInputError as error:
                raise BadInputError(f"{name}.{error.key}", error.value, error.allowed) from error
    return MeasuredContacts(**numbers)
