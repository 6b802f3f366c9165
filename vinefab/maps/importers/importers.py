"""Maps that other programs wrote, by the kind of file."""

from collections.abc import Callable
from pathlib import Path

from vinefab.core.errors import BadInputError
from vinefab.core.registry import Registry
from vinefab.maps.importers.csv_polygons import import_csv
from vinefab.maps.importers.geojson_any import import_geojson
from vinefab.maps.importers.ros_map import RosOptions, import_ros
from vinefab.maps.importers.source_drawing import ImportOptions
from vinefab.maps.importers.svg_drawing import import_svg
from vinefab.model.map import Map

Importer = Callable[[Path, ImportOptions], Map]

_NOT_FOR_ROS = ("join_mm", "layers", "bounds", "margin_mm", "wall_mm", "open_lines")


def import_map(source: Path, options: ImportOptions) -> Map:
    """Return the map in a file of another program, by its suffix."""
    suffix = source.suffix.lower()
    if suffix not in IMPORTERS:
        raise BadInputError("source", str(source), f"a file ending in {', '.join(IMPORTERS)}")
    return IMPORTERS[suffix](source, options)


def _dxf(path: Path, options: ImportOptions) -> Map:
    from vinefab.maps.importers.dxf_drawing import import_dxf  # noqa: PLC0415  ezdxf takes a second to import

    return import_dxf(path, options)


def _ros(path: Path, options: ImportOptions) -> Map:
    options.refuse(_NOT_FOR_ROS, "a ROS map", path)
    given = {name: getattr(options, name) for name in ("scale_mm_per_unit", "unknown", "start")}
    chosen = {name: value for name, value in given.items() if value is not None}
    return import_ros(path, RosOptions(simplify_mm=options.simplify_mm, **chosen))


IMPORTERS: Registry[Importer] = Registry(
    "kind of map file",
    {
        ".yaml": _ros,
        ".yml": _ros,
        ".geojson": import_geojson,
        ".json": import_geojson,
        ".dxf": _dxf,
        ".svg": import_svg,
        ".csv": import_csv,
    },
)
"""Importers by suffix."""
