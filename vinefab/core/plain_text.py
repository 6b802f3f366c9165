"""Texts: of users, in which nothing is obeyed, words with counts, and JSON.

JSON as vinefab writes it is deterministic, without NaN; numpy values are allowed.
"""

import json
import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

from vinefab.core import __version__


def visible(text: str) -> str:
    """Return a text to print: what a terminal would obey (escapes, marks of direction) is shown."""
    return "".join(
        letter if letter.isprintable() or letter == "\n" else "\N{REPLACEMENT CHARACTER}"
        for letter in readable(text)
    )


def readable(text: str) -> str:
    r"""Return a text with the bytes of file names that the locale cannot read as UTF-8 letters.

    Bytes that are no UTF-8 either are shown as escapes, so that each text can be written.

    >>> readable("r\udcc3\udcb6hre")
    'röhre'
    """
    if text.isascii():
        return text
    data = text.encode("utf-8", "surrogatepass" if _HIGH.search(text) else "surrogateescape")
    return data.decode("utf-8", "backslashreplace")


def quoted(text: str) -> str:
    r"""Return a text in quotation marks, escaped as Python does but for letters in file names.

    >>> print(quoted("r\udcc3\udcb6hre"))
    'röhre'
    """
    return repr(readable(text))


_HIGH = re.compile("[\ud800-\udc7f\udd00-\udfff]")  # surrogates that stand for no byte


def one_line(text: str) -> str:
    """Return a text without line breaks and control characters, which end a DXF or XML string."""
    printable = (letter if letter.isprintable() else " " for letter in readable(text))
    return " ".join("".join(printable).split())


def agreeing(count: int, one: str, several: str) -> str:
    """Return the word that agrees with a count.

    >>> [f"{counted(n, 'wall')} {agreeing(n, 'was', 'were')} joined" for n in (1, 2)]
    ['1 wall was joined', '2 walls were joined']
    """
    return one if count == 1 else several


def counted(count: int, noun: str) -> str:
    """Return a count with its noun, which is regular.

    >>> [counted(n, noun) for n, noun in ((1, "branch"), (2, "branch"), (0, "wall"), (3, "entry"))]
    ['1 branch', '2 branches', '0 walls', '3 entries']
    """
    if count == 1:
        return f"1 {noun}"
    if noun.endswith(("s", "x", "z", "ch", "sh")):
        return f"{count} {noun}es"
    if noun.endswith("y") and noun[-2:-1] not in "aeiou":
        return f"{count} {noun[:-1]}ies"
    return f"{count} {noun}s"


def some_of(names: Sequence[str], most: int) -> str:
    """Return the first of some names, and how many more there are.

    >>> some_of(["a", "b", "c"], 3), some_of(["a", "b", "c"], 2)
    ('a, b, c', 'a, b and 1 more')
    """
    more = f" and {len(names) - most} more" if len(names) > most else ""
    return f"{', '.join(names[:most])}{more}"


OWN_MARK = b"written by vinefab"
GENERATOR = f"{OWN_MARK.decode()} {__version__}"
"""The mark of files that vinefab wrote (see `vinefab.core.atomic`)."""


def json_text(schema: str, content: Mapping[str, object]) -> str:
    """Return a document with its schema and generator first, keys in the order given."""
    document = {"schema": schema, "generator": GENERATOR, **content}
    return json.dumps(document, indent=1, allow_nan=False, default=plain) + "\n"


def rounded(value: Any, digits: int) -> Any:  # noqa: ANN401  any plain value
    """Return a value with its numbers, also those in tables and lists, rounded; None for NaN."""
    if isinstance(value, float):
        # Adding 0 turns a rounded -0.0 into 0.0.
        return round(value, digits) + 0.0 if math.isfinite(value) else None
    if isinstance(value, list | tuple):
        return [rounded(one, digits) for one in value]
    if isinstance(value, Mapping):
        return {key: rounded(one, digits) for key, one in value.items()}
    return value


def plain(value: object) -> object:
    """Return a numpy scalar or array as plain Python values."""
    if type(value).__module__ == "numpy":  # not loaded for its own sake
        return value.tolist()  # type: ignore[attr-defined]
    raise TypeError(f"{type(value).__name__} has no JSON form")
