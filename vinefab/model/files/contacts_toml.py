"""Measured contacts as TOML, schema ``vinefab/contacts-1``."""

from collections.abc import Mapping
from os import PathLike
from pathlib import Path

import tomli_w

from vinefab.core.errors import BadInputError
from vinefab.core.jsontext import GENERATOR
from vinefab.core.table import validated
from vinefab.model.contacts import CONTACTS_SCHEMA, ContactsFile, MeasuredContacts, MeasuredShare
from vinefab.model.files.shipped import locate
from vinefab.model.files.toml import read_toml


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


def contacts_with(emergence: MeasuredShare, path: Path) -> str:
    """Return a file of measured contacts, or a new one, with the share of children that come out.

    Its other numbers stay.
    """
    found, method = {}, {}
    if path.exists():
        before = validated(ContactsFile, read_toml(path), path)
        found = {name: getattr(before, name) for name in MeasuredContacts.model_fields}
        method = dict(before.method)
    return contacts_text(MeasuredContacts(**{**found, "emergence": emergence}), method)
