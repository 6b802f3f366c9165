"""Polygons as comma-separated values, one point per line.

Columns are ``polygon,x_mm,y_mm`` and optionally ``role`` (``bounds`` or ``obstacle``), in the
order of a header or, without one, in this order; points of one polygon follow one another. With
``x_mm,y_mm`` alone an empty line ends a polygon. Commas, semicolons or tabs separate; with the
last two a number may have a decimal comma. ``#`` begins a comment. Polygons need not repeat their
first point.
"""

import math
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from vinefab.core.errors import BadInputError, located
from vinefab.maps.cleanup.drawn_shapes import Role
from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.importers.source_drawing import (
    DrawingItem,
    Ring,
    SourceDrawing,
    Straight,
    drawing_map,
)
from vinefab.maps.importers.source_unit import SourceUnit
from vinefab.model.files.shipped import read_text
from vinefab.model.map import Map

_LARGEST_BYTES = 256 << 20
_NAMES = {
    "polygon": "polygon",
    "ring": "polygon",
    "id": "polygon",
    "x_mm": "x",
    "x": "x",
    "y_mm": "y",
    "y": "y",
    "role": "role",
}
_ORDER = {2: ("x", "y"), 3: ("polygon", "x", "y"), 4: ("polygon", "x", "y", "role")}
_ROLES: dict[str, Role | None] = {"": None, "bounds": "bounds", "obstacle": "obstacle"}


@dataclass(slots=True)
class _Polygon:
    line: int
    name: str
    role: str
    points: list[tuple[float, float]] = field(default_factory=list)


def import_csv(path: Path, options: ImportOptions) -> Map:
    """Return the map in a file of comma-separated polygons."""
    options.refuse(("layers",), "a CSV file", path)
    with located(path):
        text = read_text(path, _LARGEST_BYTES)
        polygons = _polygons(text)
    unit = SourceUnit(name="mm", mm=1.0, known="guess", by="a CSV of polygons is in mm")
    if "x_mm" in text[: text.find("\n") + 1].lower():
        unit = replace(unit, known="file", by="columns x_mm, y_mm")
    items = tuple(
        DrawingItem(
            rings=(Ring(pieces=(Straight(np.array(polygon.points)),)),),
            where=f"polygon {polygon.name} (line {polygon.line})",
            role=_ROLES[polygon.role],
        )
        for polygon in polygons
    )
    return drawing_map(path, SourceDrawing(items=items, unit=unit, curved=False), options)


def _polygons(text: str) -> list[_Polygon]:
    polygons: list[_Polygon] = []
    names: set[str] = set()
    columns: tuple[str, ...] = ()
    separator, fresh = "", True
    for number, raw in enumerate(text.splitlines(), start=1):
        line = raw.partition("#")[0].strip()
        if not line:
            fresh = fresh or not raw.strip()
            continue
        separator = separator or next((mark for mark in ";\t," if mark in line), ",")
        cells = [cell.strip().strip('"') for cell in line.split(separator)]
        if not columns:
            columns, is_header = _columns(number, [_plain(cell, separator) for cell in cells])
            if is_header:
                continue
        if len(cells) != len(columns):
            allowed = f"the columns {', '.join(columns)}"
            if separator == "," and len(cells) > len(columns):
                allowed += "; decimal commas need columns separated by ; or by tabs"
            raise BadInputError(f"line {number}", line, allowed)
        row = dict(zip(columns, cells, strict=True))
        name, role = row.get("polygon", ""), row.get("role", "").lower()
        if role not in _ROLES:
            raise BadInputError(f"line {number}: role", role, "bounds, obstacle or nothing")
        changed = not polygons or (name != polygons[-1].name if "polygon" in row else fresh)
        if changed:
            if name and name in names:
                raise BadInputError(
                    f"line {number}: polygon", name, "points of one polygon one after the other"
                )
            polygons.append(_Polygon(number, name or str(len(polygons) + 1), role))
            names.add(polygons[-1].name)
        if role != polygons[-1].role:
            raise BadInputError(f"line {number}: role", role, "one role for each polygon")
        place = (_coordinate(number, row[name], separator) for name in ("x", "y"))
        polygons[-1].points.append((next(place), next(place)))
        fresh = False
    return polygons


def _columns(number: int, cells: list[str]) -> tuple[tuple[str, ...], bool]:
    """Return the name of each column, and whether the line is a header."""
    named = tuple(_NAMES.get(cell.lower(), "") for cell in cells)
    if {"x", "y"} <= set(named) and "" not in named and len(set(named)) == len(named):
        return named, True
    if len(cells) not in _ORDER or not _is_number(cells[-2 if len(cells) == 4 else -1]):
        known_text = "; geometry as text (WKT) goes through GDAL: ogr2ogr plan.gpkg FILE"
        allowed = "polygon,x_mm,y_mm[,role] or x_mm,y_mm"
        has_text = any(cell.lower() in ("wkt", "geometry", "the_geom") for cell in cells)
        raise BadInputError(
            f"line {number}", ",".join(cells), allowed + (known_text if has_text else "")
        )
    return _ORDER[len(cells)], False


def _coordinate(number: int, text: str, separator: str) -> float:
    plain = _plain(text, separator)
    if not _is_number(plain):
        raise BadInputError(f"line {number}", text, "a finite number, such as 12.5")
    return float(plain)


def _plain(text: str, separator: str) -> str:
    """Return a number with a decimal point; ``12,5`` has a comma where others separate columns."""
    comma = separator != "," and "." not in text and text.count(",") == 1
    return text.replace(",", ".") if comma else text


def _is_number(text: str) -> bool:
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False
