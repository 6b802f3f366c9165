"""Public values of vinefab as plain ones, by the list of public names."""

import base64
from collections import defaultdict
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from pathlib import Path

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

NAMES = Path(__file__).with_name("public_api.txt")


def _attributes() -> dict[str, list[str]]:
    """Return the attributes, no methods, of every public class."""
    found: dict[str, list[str]] = defaultdict(list)
    for line in NAMES.read_text().splitlines():
        owner, dot, rest = line.partition(".")
        name = rest.partition(":")[0]
        if dot and owner.isidentifier() and owner[0].isupper() and "(" not in name:
            found[owner].append(name)
    return found


PUBLIC = _attributes()


def plain(value: object) -> object:
    """Return a value of lists, names and numbers; of an object its public attributes."""
    if isinstance(value, Enum):
        return value.name
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, BaseGeometry):
        return shapely.geometry.mapping(value)
    return _parts(value)


def _parts(value: object) -> object:
    if isinstance(value, Mapping):
        return {str(key): plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    if isinstance(value, set | frozenset):
        return sorted((plain(part) for part in value), key=str)
    if isinstance(value, bytes):
        return base64.b64encode(value).decode()
    return _object(value)


def _object(value: object) -> object:
    kind = type(value)
    if kind.__name__ in PUBLIC:
        names = PUBLIC[kind.__name__]
    elif is_dataclass(kind):
        names = [field.name for field in fields(kind) if not field.name.startswith("_")]
    else:
        return str(value) if isinstance(value, Path) else kind.__name__
    return {name: _attribute(value, name) for name in names}


def _attribute(value: object, name: str) -> object:
    try:
        return plain(getattr(value, name, "missing"))
    except (IndexError, ValueError) as error:  # some parts of a result have no summary
        return f"refused: {type(error).__name__}"
