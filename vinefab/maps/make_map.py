"""The public functions that make maps: generated, read and imported."""

from collections.abc import Mapping, Sequence
from os import PathLike
from typing import Any

from vinefab.core.errors import BadInputError, nearest
from vinefab.core.front_door import python_words
from vinefab.core.registry import with_parameters
from vinefab.core.validation import whole
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.maps.importers.importers import import_map, import_suffixes
from vinefab.maps.importers.photo_options import PhotoOptions
from vinefab.maps.importers.source_drawing import ImportOptions
from vinefab.model.files.shipped import path_given
from vinefab.model.map import Map, Pose, Start
from vinefab.model.start_place import start_given, with_starts

_MOST_SEED = 2**62


def generate(environment: str, seed: int = 0, **options: object) -> Map:
    """Make one instance of an environment; the same arguments give the same map.

    Parameters
    ----------
    environment
        ``grid``, ``cave``, ``corridors``, ``pegs``, ``rubble``, or one that a plug-in offers.
    seed
        0 to 2^62.
    **options
        What ``vinefab map ENVIRONMENT --help`` lists, with the units in the names.

    Raises
    ------
    BadInputError
        If there is no such option, or a value cannot be used.
    UnknownNameError
        If there is no such environment.

    Examples
    --------
    >>> generate("pegs", seed=4, columns=6, rows=5).size_mm
    (260.0, 220.0)
    """
    if not isinstance(environment, str):
        raise BadInputError("environment", environment, f"one of {', '.join(ENVIRONMENTS)}")
    kind = ENVIRONMENTS[environment]
    return kind.make(
        whole("seed", seed, 0, _MOST_SEED), with_parameters(kind.options, environment, options)
    )


def grid(seed: int = 0, **options: object) -> Map:
    """Make a Grid map: many convex polygons, one per cell of a grid.

    Parameters
    ----------
    seed
        0 to 2^62; the same seed gives the same map.
    **options
        Such as ``size_mm`` (500), ``columns`` and ``rows`` (6), ``gap_mm`` (8); all of them:
        `vinefab.maps.generators.grid.GridOptions`.

    Raises
    ------
    BadInputError
        If there is no such option, or a value cannot be used.

    Examples
    --------
    >>> len(grid(seed=3, columns=4, rows=4).obstacles)
    16
    """
    return generate("grid", seed, **options)


def cave(seed: int = 0, **options: object) -> Map:
    """Make a Cave map: interconnected passages and chambers in solid rock.

    Parameters
    ----------
    seed
        0 to 2^62; the same seed gives the same map.
    **options
        Such as ``size_mm``; all of them: `vinefab.maps.generators.cave.CaveOptions`.

    Raises
    ------
    BadInputError
        If there is no such option, or a value cannot be used.

    Examples
    --------
    >>> cave(seed=3).environment
    'cave'
    """
    return generate("cave", seed, **options)


def corridors(seed: int = 0, **options: object) -> Map:
    """Make a Corridors map: a floor plan of halls, rooms and doors.

    Parameters
    ----------
    seed
        0 to 2^62; the same seed gives the same map.
    **options
        All of them: `vinefab.maps.generators.corridors.CorridorsOptions`.

    Raises
    ------
    BadInputError
        If there is no such option, or a value cannot be used.

    Examples
    --------
    >>> corridors(seed=3).environment
    'corridors'
    """
    return generate("corridors", seed, **options)


def pegs(seed: int = 0, **options: object) -> Map:
    """Make a Pegs map: a peg board, round pegs in some holes of a lattice.

    Parameters
    ----------
    seed
        0 to 2^62; the same seed gives the same map.
    **options
        Such as ``columns`` and ``rows`` (12), ``pitch_mm``, ``diameter_mm``; all of them:
        `vinefab.maps.generators.pegs.PegsOptions`.

    Raises
    ------
    BadInputError
        If there is no such option, or a value cannot be used.

    Examples
    --------
    >>> pegs(seed=4, columns=6, rows=6).name
    'pegs_4'
    """
    return generate("pegs", seed, **options)


def rubble(seed: int = 0, **options: object) -> Map:
    """Make a Rubble map: a collapsed building, broken slabs of many sizes that lie one way.

    Parameters
    ----------
    seed
        0 to 2^62; the same seed gives the same map.
    **options
        All of them: `vinefab.maps.generators.rubble.RubbleOptions`.

    Raises
    ------
    BadInputError
        If there is no such option, or a value cannot be used.

    Examples
    --------
    >>> rubble(seed=3).environment
    'rubble'
    """
    return generate("rubble", seed, **options)


def read(path: str | PathLike[str]) -> Map:
    """Return the map in a GeoJSON file in millimetres, as `Map.read` does.

    Parameters
    ----------
    path
        A file that ``Map.write`` or ``vinefab map`` wrote, or plain polygons.

    Raises
    ------
    BadInputError
        If it is no path, or a value in the file cannot be used.
    UnreadableFileError
        If there is no such file, or it is not JSON.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     read(grid(seed=3).write(f"{folder}/grid.geojson")).name
    'grid_3'
    """
    return Map.read(path)


def import_(
    path: str | PathLike[str],
    *,
    scale_mm_per_unit: float | None = None,
    start: Start | Pose | tuple[float, float, float] | str | None = None,
    layers: Sequence[str] = (),
    **options: Any,  # noqa: ANN401  each has its own type, see `ImportOptions`
) -> Map:
    """Return the map in a file of another program: a drawing, a GIS layer, a ROS map or a photo.

    Parameters
    ----------
    path
        The file; its ending says what it is.
    scale_mm_per_unit
        Millimetres of the map per unit of the source (ROS: per metre), instead of the unit that
        the file names.
    start
        Where robots start, as in `Map.with_start`: ``(x_mm, y_mm, heading_deg)`` in the map, or
        words such as ``"left side"``; the roomiest place if None.
    layers
        Read only these layers (DXF, GeoPackage) or groups (SVG).
    **options
        ``simplify_mm``, ``join_mm``, ``drawn``, ``bounds``, ``margin_mm``, ``wall_mm``,
        ``open_lines``, ``unknown``, as in `vinefab.maps.importers.source_drawing.ImportOptions`;
        of a photo also ``marker_mm``, ``height_mm``, ``points_px``, ``distance_mm``,
        ``rectangle_mm``, ``obstacles``, ``threshold``, ``crop_mm``, as in
        `vinefab.maps.importers.photo_options.PhotoOptions`.

    Raises
    ------
    BadInputError
        If an option means nothing for the kind of file, or a value cannot be used.
    UnreadableFileError
        If there is no such file, or it is not of the kind that its ending says.

    Examples
    --------
    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     drawn = Path(folder) / "room.svg"
    ...     text = '<svg xmlns="http://www.w3.org/2000/svg"><rect width="40" height="30"/></svg>'
    ...     _ = drawn.write_text(text)
    ...     import_(drawn, scale_mm_per_unit=10.0).size_mm
    (400.0, 300.0)
    """
    source = path_given("path", path, f"a file ending in {', '.join(import_suffixes())}")
    known = [name for name in ImportOptions.__dataclass_fields__ if name != "photo"]
    of_photos = PhotoOptions.__dataclass_fields__
    for name, value in options.items():
        if name not in (*known, *of_photos, "photo"):
            allowed = f"one of {', '.join(known)}; of a photo one of {', '.join(of_photos)}"
            raise BadInputError(name, value, f"{allowed}{nearest(name, [*known, *of_photos])}")
    flat = {name: options.pop(name) for name in list(options) if name in of_photos}
    if flat and "photo" in options:
        raise BadInputError(next(iter(flat)), next(iter(flat.values())), "not beside photo")
    if isinstance(layers, str):
        layers = (layers,)
    if not isinstance(layers, Sequence) or not all(isinstance(name, str) for name in layers):
        raise BadInputError("layers", layers, "names of layers")
    if flat or "photo" in options:
        options["photo"] = _photo_options(flat or options["photo"])
    given = None if start is None else start_given(start)
    chosen = ImportOptions(
        scale_mm_per_unit=scale_mm_per_unit,
        start=given.pose if isinstance(given, Start) else None,
        layers=tuple(layers),
        **options,
    )
    with python_words():
        world = import_map(source, chosen)
    return world if given is None else with_starts(world, [given])


def _photo_options(given: object) -> PhotoOptions | None:
    """Return the options of a photo, also from a table of them."""
    if given is None or isinstance(given, PhotoOptions):
        return given
    if not isinstance(given, Mapping):
        raise BadInputError("photo", given, "PhotoOptions, or a dict of them")
    known = PhotoOptions.__dataclass_fields__
    for name, value in given.items():
        if name not in known:
            allowed = f"one of {', '.join(known)}{nearest(str(name), known)}"
            raise BadInputError(f"photo.{name}", value, allowed)
    return PhotoOptions(**given)
