"""Types of the page's state from the declared tables: ``python tests/page/state_types.py``."""

import types
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from pydantic import BaseModel

from vinefab.core.table import declared_keys, inner_table
from vinefab.core.view import Tone
from vinefab.growth.options import GrowthOptions
from vinefab.model.design import Design
from vinefab.model.finding import Severity
from vinefab.model.target import Target
from vinefab.studio.executors import PANELS
from vinefab.studio.file_exports import EXPORTS, SNAPSHOT
from vinefab.studio.file_store import FILE_REQUESTS
from vinefab.studio.searches import SEARCH_REQUESTS
from vinefab.studio.state import Family, Frame

STATE = Path(__file__).with_name("state.d.ts")
TABLES = (Design, GrowthOptions, Family, Frame, Target)
NAMES = {
    "Panel": PANELS,
    "RequestName": (*FILE_REQUESTS, *SEARCH_REQUESTS),
    "ExportKind": (*EXPORTS, SNAPSHOT),
    "Severity": map(str, Severity),
    "Tone": get_args(Tone),
}
PLAIN = {str: "string", int: "number", float: "number", bool: "boolean", Any: "unknown"}


def state_types() -> str:
    """Return the declaration file of all tables and names."""
    head = "// Written by state_types.py from the declared tables of vinefab: edit those.\n"
    names = [f"type {name} = {_choice(values)};\n" for name, values in NAMES.items()]
    tables = dict.fromkeys(inner for table in TABLES for inner in _with_inner(table))
    return "\n".join([head, *names, *map(_table, tables)])


def _with_inner(table: type[BaseModel]) -> Iterator[type[BaseModel]]:
    for key in declared_keys(table):
        inner = inner_table(key.annotation)
        if inner is not None:
            yield from _with_inner(inner)
    yield table


def _table(table: type[BaseModel]) -> str:
    about = (table.__doc__ or "").partition("\n")[0]
    lines = [f"/** {about} */", f"type {table.__name__} = {{"]
    for key in declared_keys(table):
        # What is empty, and words at their default, are not in a file's content.
        kinds = [kind for kind in _members(key.annotation) if kind is not type(None)]
        optional = len(kinds) < len(_members(key.annotation)) or isinstance(key.default, str)
        missing = "?" if optional else ""
        about = ": ".join(filter(None, (key.unit, key.meaning)))
        lines += [f"  /** {about} */"] if about else []
        lines.append(f"  {key.name}{missing}: {' | '.join(map(_type, kinds))};")
    return "\n".join([*lines, "};", ""])


def _members(kind: Any) -> list[Any]:
    kind = get_args(kind)[0] if get_origin(kind) is Annotated else kind
    return list(get_args(kind)) if get_origin(kind) in (Union, types.UnionType) else [kind]


def _type(kind: Any) -> str:
    origin, inner = get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _type(inner[0])
    if origin is Literal:
        return _choice(inner)
    if origin is tuple:
        many = inner[-1] is Ellipsis
        return f"{_type(inner[0])}[]" if many else f"[{', '.join(map(_type, inner))}]"
    if origin is Mapping:
        return f"Record<string, {_type(inner[1])}>"
    return PLAIN.get(kind) or str(kind.__name__)


def _choice(values: Any) -> str:
    return " | ".join(f'"{value}"' for value in values)


if __name__ == "__main__":
    STATE.write_text(state_types(), encoding="utf-8")
