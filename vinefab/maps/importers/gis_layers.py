"""GeoPackage, Shapefile and FlatGeobuf layers, read by GDAL (pyogrio, the extra ``gis``)."""

import re
import warnings
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import shapely
from shapely import Polygon
from shapely.geometry.base import BaseGeometry

from vinefab.core.errors import (
    BadInputError,
    UnfitInputError,
    UnknownNameError,
    UnreadableFileError,
    located,
)
from vinefab.core.extras import ensure_extra
from vinefab.core.front_door import imported_later
from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.importers.source_drawing import (
    DrawingItem,
    Ring,
    SourceDrawing,
    Straight,
    drawing_map,
    drawn_points,
)
from vinefab.maps.importers.source_unit import TRIANGLES_ADVICE, SourceUnit, unit_of
from vinefab.model.files.shipped import existing_file
from vinefab.model.map import Map

if TYPE_CHECKING:
    import pyogrio
else:
    pyogrio = imported_later("pyogrio")

_BEGINNINGS = {
    ".gpkg": b"SQLite format 3\0",
    ".shp": b"\0\0\x27\x0a",
    ".fgb": b"fgb\x03fgb",
}
"""GDAL detects a file's kind from its content; only these kinds are given to it."""
_ROLES = ("bounds", "obstacle")


def import_gis(path: Path, options: ImportOptions) -> Map:
    """Return the map in a layer of a geographic information system.

    Polygons are areas, closed lines outlines, open ones are joined; points are counted and left
    out, as are heights. A column ``role`` may name bounds and obstacles. The unit is that of the
    coordinate reference system.
    """
    existing_file(path)
    begin = _BEGINNINGS[path.suffix.lower()]
    with path.open("rb") as file:
        if file.read(len(begin)) != begin:
            raise UnreadableFileError(path, f"is not a {path.suffix.lower()} file, or is damaged")
    if path.suffix.lower() == ".shp" and _beside(path, ".shx") is None:
        problem = f"needs {path.stem}.shx next to it: a Shapefile is several files, copy them all"
        raise UnreadableFileError(path, problem)
    with located(path), warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        ensure_extra("gis", f"{path.name} (GeoPackage, Shapefile, FlatGeobuf)")
        drawing = _drawing(path.resolve(), options)
    most_warnings = 5
    if said:
        lines = sorted({" ".join(str(one.message).split())[:200] for one in said})
        drawing = replace(
            drawing, facts={**drawing.facts, "reader_warnings": lines[:most_warnings]}
        )
    return replace(drawing_map(path, drawing, options), environment="gis")


def _beside(path: Path, suffix: str) -> Path | None:
    """Return the file of the same name with another suffix, in lower or upper case."""
    places = (path.with_suffix(case) for case in (suffix, suffix.upper()))
    return next((place for place in places if place.is_file()), None)


@dataclass(slots=True)
class _Read:
    """What was read from the layers of a file."""

    items: list[DrawingItem] = field(default_factory=list)
    kinds: Counter[str] = field(default_factory=Counter)
    empty: int = 0  # features without geometry
    heights: int = 0  # features with z
    systems: dict[str, str] = field(default_factory=dict)  # reference system by layer


def _drawing(path: Path, options: ImportOptions) -> SourceDrawing:
    found = _Read()
    try:
        known = [str(name) for name, kind in pyogrio.list_layers(path) if kind is not None]
        for name in options.layers:
            if name not in known:
                raise UnknownNameError("layer", name, known)
        names = list(options.layers) or known
        if not known:
            raise BadInputError("layers", "none with geometry", "at least one")
        if not options.layers and len(known) > 1:
            allowed = f"one of {', '.join(known[:20])} (repeatable: what is read together)"
            raise BadInputError("--layer", None, allowed)
        for name in names:
            _read_layer(path, name, found, several=len(names) > 1)
    except (
        pyogrio.errors.DataSourceError,
        pyogrio.errors.DataLayerError,
        shapely.GEOSException,
        UnicodeError,  # names of columns in another encoding than the .cpg says; of files
    ) as error:
        problem = " ".join(str(error).replace(str(path), "").split())
        raise UnreadableFileError(path, f"cannot be read by GDAL: {problem[:200]}") from None
    systems = len(set(found.systems.values()))
    if systems > 1:
        problem = f"they have {systems} reference systems"
        raise UnfitInputError("layers", problem, "give layers of one")
    system = next(iter(found.systems.values()), "")
    beside = " (no .prj next to it)" if path.suffix.lower() == ".shp" else ""
    missing = f"the file names no reference system{beside}"
    unit = SourceUnit(name="mm", mm=1.0, known="guess", by=missing)
    if options.scale_mm_per_unit is not None:
        unit = SourceUnit(name="unit", mm=1.0, known="file")
    elif found.items:
        unit = unit_of(system, drawn_points(found.items), unit)
    points = {kind: count for kind, count in found.kinds.items() if "Point" in kind}
    return SourceDrawing(
        items=tuple(found.items),
        unit=unit,
        curved=False,
        layered=len(found.systems) > 1,
        facts={
            "reference_system": system[:60] or "none",
            "layers": sorted(found.systems),
            "geometries": {k: n for k, n in found.kinds.items() if k not in points},
            **({"ignored": points} if points else {}),
            **({"features_without_geometry": found.empty} if found.empty else {}),
            **({"heights_dropped": found.heights} if found.heights else {}),
        },
    )


def _read_layer(path: Path, name: str, found: _Read, *, several: bool) -> None:
    info = pyogrio.read_info(path, layer=name)
    if re.search("TIN|Polyhedral|Triangle", info["geometry_type"] or ""):
        problem = f"holds a surface of triangles ({info['geometry_type']}), not a plan"
        raise UnfitInputError(f"layer {name}", problem, TRIANGLES_ADVICE)
    found.systems[name] = info["crs"] or ""
    columns = ["role"] if "role" in info["fields"] else []
    _, fids, wkb, columns_read = pyogrio.raw.read(
        path, layer=name, columns=columns, return_fids=True
    )
    roles = columns_read[0] if columns else np.full(len(wkb), None)
    shapes = shapely.from_wkb(wkb)
    found.heights += int(shapely.has_z(shapes).sum())
    for fid, shape, role in zip(fids.tolist(), shapes, roles, strict=True):
        if shape is None or shape.is_empty:
            found.empty += 1
            continue
        found.kinds[shape.geom_type] += 1
        where = f"{name} feature {fid}" if several else f"feature {fid}"
        found.items += _items(where, shape, role if role in _ROLES else None)


def _items(where: str, shape: BaseGeometry, role: Any) -> Iterator[DrawingItem]:  # noqa: ANN401  any column
    parts = _leaves(shape)
    for number, part in enumerate(parts, start=1):
        key = where if len(parts) == 1 else f"{where} part {number}"
        if part.is_empty or part.geom_type == "Point":
            continue
        if isinstance(part, Polygon):
            holes = tuple(_ring(ring) for ring in part.interiors)
            shell = _ring(part.exterior)
            yield DrawingItem(rings=(shell,), where=key, filled=True, holes=holes, role=role)
        else:
            yield DrawingItem(rings=(_ring(part),), where=key, closed=role is not None, role=role)


def _leaves(shape: BaseGeometry) -> list[BaseGeometry]:
    """Return the geometries in a collection that are no collections."""
    parts = shapely.get_parts(shape)
    if not any(hasattr(part, "geoms") for part in parts):
        return list(parts)
    return [leaf for part in parts for leaf in _leaves(part)]


def _ring(line: BaseGeometry) -> Ring:
    return Ring(pieces=(Straight(shapely.get_coordinates(line)),))
