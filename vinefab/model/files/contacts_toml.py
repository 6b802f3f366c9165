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

    value: float | None = None
    low: float
    high: float
    side: Side = "both"
    count: int
    photos: int
    standing: Literal["measured"] = "measured"
    source: Annotated[str, Field(min_length=1)]


class NumbersForm(Form):
    """The numbers of `MeasuredContacts`."""

    head_on_half_angle_deg: MeasuredNumberForm | None = None
    tip_friction: MeasuredNumberForm | None = None
    body_width_ratio: MeasuredNumberForm | None = None
    film_breadth_ratio: MeasuredNumberForm | None = None


class ContactsForm(NumbersForm):
    """A whole file."""

    schema_: Literal["vinefab/contacts-1"] = Field(alias="schema")
    method: dict[str, str | float | int | bool | list[str]] = Field(default_factory=dict)


def contacts_given(given: object) -> MeasuredContacts:
    """Return measured contacts, given as such, as a table, or by the path or name of their file."""
    if isinstance(given, MeasuredContacts):
        return given
    if isinstance(given, Mapping):
        return _contacts(validated(NumbersForm, given, "contacts"))
    if not isinstance(given, str | PathLike):
        raise BadInputError("contacts", given, "a file of measured contacts (TOML), or its name")
    return read_contacts(given)


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
