"""Maps that other programs wrote, by the kind of file."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from vinefab.core.errors import BadInputError
from vinefab.core.registry import Registry
from vinefab.environments.resize import scaled
from vinefab.files.map import read_map
from vinefab.files.ros import RosOptions, import_ros
from vinefab.model.map import Map, Pose


@dataclass(frozen=True, slots=True, kw_only=True)
class ImportOptions:
    """What a user may choose about an import; None leaves it to the importer.

    Parameters
    ----------
    scale_mm_per_unit
        Millimetres of the map per unit of the source (per metre for ROS maps).
    simplify_mm
        Largest distance between imported walls and those of the source.
    unknown
        What cells of a ROS map that were never seen count as: ``obstacle`` or ``free``.
    start
        Where robots start, in the map's millimetres.
    """

    scale_mm_per_unit: float | None = None
    simplify_mm: float | None = None
    unknown: str | None = None
    start: Pose | None = None


Importer = Callable[[Path, ImportOptions], Map]


def import_map(source: Path, options: ImportOptions) -> Map:
    """Return the map in a file of another program, by its suffix.

    Raises
    ------
    BadInputError, UnreadableFileError
        If there is no importer for such files, or the file cannot be used.
    """
    suffix = source.suffix.lower()
    if suffix not in IMPORTERS:
        raise BadInputError("source", str(source), f"a file ending in {', '.join(IMPORTERS)}")
    return IMPORTERS[suffix](source, options)


def _ros(path: Path, options: ImportOptions) -> Map:
    given = {name: getattr(options, name) for name in ("scale_mm_per_unit", "unknown", "start")}
    chosen = {name: value for name, value in given.items() if value is not None}
    return import_ros(path, RosOptions(simplify_mm=options.simplify_mm, **chosen))


def _geojson(path: Path, options: ImportOptions) -> Map:
    for name in ("simplify_mm", "unknown", "start"):
        if getattr(options, name) is not None:
            raise BadInputError(name, getattr(options, name), "nothing for a GeoJSON file", path)
    world = read_map(path)
    factor = 1.0 if options.scale_mm_per_unit is None else options.scale_mm_per_unit
    return replace(scaled(world, factor), facts={**world.facts, "source": path.name})


IMPORTERS: Registry[Importer] = Registry(
    "kind of map file", {".yaml": _ros, ".yml": _ros, ".geojson": _geojson, ".json": _geojson}
)
"""Importers by suffix."""
