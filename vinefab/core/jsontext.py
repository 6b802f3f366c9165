"""JSON as vinefab writes it: deterministic, without NaN, numpy values allowed."""

import json
import math
from collections.abc import Mapping
from typing import Any

from vinefab.core.version import __version__

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
