"""JSON as vinefab writes it: deterministic, without NaN, numpy values allowed."""

import json
from collections.abc import Mapping

from vinefab.core.version import __version__

OWN_MARK = b"written by vinefab"
GENERATOR = f"{OWN_MARK.decode()} {__version__}"
"""The mark of files that vinefab wrote (see `vinefab.core.atomic`)."""


def json_text(schema: str, content: Mapping[str, object]) -> str:
    """Return a document with its schema and generator first, keys in the order given."""
    document = {"schema": schema, "generator": GENERATOR, **content}
    return json.dumps(document, indent=1, allow_nan=False, default=plain) + "\n"


def plain(value: object) -> object:
    """Return a numpy scalar or array as plain Python values."""
    if type(value).__module__ == "numpy":  # not loaded for its own sake
        return value.tolist()  # type: ignore[attr-defined]
    raise TypeError(f"{type(value).__name__} has no JSON form")
