"""Forms on the page: what tables declare of every key of theirs, as plain values."""

import types
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Le
from pydantic import BaseModel

from vinefab.core.table import DeclaredKey, declared_keys, inner_table
from vinefab.growth.options import GrowthOptions
from vinefab.model.design import MOST_LEVELS, PER_LEVEL, Build, Design

_UNITS = {"deg": "°"}


def design_form() -> dict[str, Any]:
    """Return the rows of a design's tables: keys with a slider, with a choice, with own rows."""
    return {"most_levels": MOST_LEVELS - 1, "rows": _rows(Design)}


def growth_form() -> list[dict[str, Any]]:
    """Return the rows of the growth options; measured contacts are a file of their own."""
    return [row for row in _rows(GrowthOptions) if "rows" not in row]


def _rows(table: type[BaseModel]) -> list[dict[str, Any]]:
    rows = []
    for key in declared_keys(table):
        shown = _shown(key) | ({} if table is not Build else _per_level(key))
        if shown and key.name != "schema":
            rows.append({"key": key.name, "label": label_of(key), "about": key.meaning, **shown})
    return rows


def _shown(key: DeclaredKey) -> dict[str, Any]:
    """Return how the page shows a key; nothing for one that it does not."""
    inner, kind = inner_table(key.annotation), key.annotation
    if inner is not None:
        rows = _rows(inner)
        return {"rows": rows, "many": get_origin(kind) is tuple} if rows else {}
    if get_origin(kind) in (Union, types.UnionType):  # of an optional value
        kind = get_args(kind)[0]
    kind = get_args(kind)[0] if get_origin(kind) is Annotated else kind
    if get_origin(kind) is Literal:
        return {"choices": list(get_args(kind)), "default": key.default}
    if kind is bool:
        return {"flag": True, "default": key.default}
    if key.slider is None:
        return {}
    return {
        "unit": _UNITS.get(key.unit, key.unit),
        "least": next((limit.ge for limit in key.limits if isinstance(limit, Ge)), None),
        "most": next((limit.le for limit in key.limits if isinstance(limit, Le)), None),
        "slider": [key.slider.low, key.slider.high],
        "step": key.slider.step,
        "whole": kind is int,
        "default": key.default if isinstance(key.default, int | float) else None,
    }


def _per_level(key: DeclaredKey) -> dict[str, Any]:
    mark = PER_LEVEL.get(key.field)
    return {} if mark is None else {"first": mark.first, "absent": mark.absent}


def label_of(key: DeclaredKey) -> str:
    """Return what the page calls a key: its title, or its name without the unit."""
    unit = "percent" if key.unit == "%" else key.unit.lower()
    return key.title or key.name.removesuffix(f"_{unit}").replace("_", " ").capitalize()
