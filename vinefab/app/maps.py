"""Verbs about maps: generated, read, imported, given other starts, described."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any

from vinefab.app.common import PictureFile, ensure_apart, page_path, write_page
from vinefab.core.progress import phase
from vinefab.core.verbs import (
    Doc,
    FieldsOf,
    Force,
    Kind,
    ProgressLike,
    Seed,
    also,
    note,
    told,
    verb,
    wrote,
)
from vinefab.model.inputs import (
    MAP_SUFFIXES,
    POINTS,
    MapLike,
    PathText,
    StartsLike,
    as_map,
    as_path,
    as_starts,
)
from vinefab.model.inputs import written as file_kind

if TYPE_CHECKING:
    from vinefab.maps.importers.import_options import PhotoOptions
    from vinefab.model.map import Map
    from vinefab.prediction.map_info import MapInfo

    Layers = str | Sequence[str]
else:
    Layers = Annotated[object, Kind(metavar="NAME", several=True)]
SurfaceName = Annotated[
    str, Doc("What the walls are like: smooth, rough, or a surface of your contacts file.")
]
MapOut = Annotated[PathText | None, file_kind(*MAP_SUFFIXES), Doc("The map file to write.")]


def _kept(
    world: Map, out: Any, *, force: bool, is_new: bool = True, surface: str | None = None
) -> Map:
    """Write a map if a file is asked for, and return it; of a new one, tell how it was made."""
    if surface is not None:
        world = replace(world, surface=surface)
    for key, value in world.facts.items() if is_new else ():
        if value is not None and key not in ("notes", "free_apart"):  # told as sentences
            shown = f"{value:.6g}" if isinstance(value, float) else value
            note(f"  {key}: {shown}", only_in_shell=True)
    if out is not None:
        path = as_path("out", out)
        world.write(path, force=force)
        wrote(path)
    return world


@verb
def generate(
    environment: str,
    seed: Seed = 0,
    *,
    start: StartsLike = (),
    surface: SurfaceName | None = None,
    out: MapOut = None,
    force: Force = False,
    **options: object,
) -> Map:
    """Make one instance of an environment; the same arguments give the same map.

    Parameters
    ----------
    environment
        A registered environment, also one that a plug-in offers.
    **options
        What ``vinefab map NAME --help`` lists, with the units in the names.

    Raises
    ------
    BadInputError
        If there is no such option, or a value cannot be used.
    UnknownNameError
        If there is no such environment.

    Examples
    --------
    $ vinefab map grid --seed 3 --out grid.geojson

    >>> generate("pegs", seed=4, columns=6, rows=5).size_mm
    (260.0, 220.0)
    """
    from vinefab.core.registry import with_parameters
    from vinefab.maps.generators.environments import ENVIRONMENTS

    kind = ENVIRONMENTS[environment]
    made = kind.generate(seed, with_parameters(kind.options, environment, options))
    return _kept(as_map(made, start=start), out, force=force, surface=surface)


def generator(environment: str) -> Callable[..., Map]:
    """Return the function that makes maps of one environment: ``vinefab.maps.grid``."""
    from vinefab.maps.generators.environments import ENVIRONMENTS

    kind = ENVIRONMENTS[environment]

    def made(seed: int = 0, **options: Any) -> Map:
        return generate(environment, seed, **options)

    made.__name__ = made.__qualname__ = environment
    made.__doc__ = f"""Make a map: {kind.description}.

Parameters
----------
seed
    The same seed gives the same map.
**options
    The fields of `{kind.options.__module__}.{kind.options.__name__}`, and ``start``, ``surface``,
    ``out`` and ``force`` as in `generate`.

Raises
------
BadInputError
    If there is no such option, or a value cannot be used.

Examples
--------
>>> {environment}(seed=3).environment
'{environment}'
"""
    return made


@verb
def read(path: Annotated[PathText, Kind(metavar="MAP")]) -> Map:
    """Return the map in a GeoJSON file in millimetres, as `Map.read` does.

    Parameters
    ----------
    path
        A file that ``Map.write`` or ``vinefab map`` wrote, or plain polygons.

    Raises
    ------
    BadInputError
        If it is not a path, or a value in the file cannot be used.
    UnreadableFileError
        If there is no such file, or it is not JSON.

    Examples
    --------
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     read(generate("grid", 3).write(f"{folder}/grid.geojson")).name
    'grid_3'
    """
    from vinefab.model.map import Map

    return Map.read(as_path("path", path))


@verb
def start(
    map: MapLike,
    *,
    start: StartsLike,
    out: MapOut = None,
    force: Force = False,
) -> Map:
    """Give a map other starts: a pose, a side, a line or an area, each with a range of headings.

    Poses are drawn evenly from the free part of a line or area, 15 mm from walls (clear MM).

    Raises
    ------
    BadInputError
        If the words are no start, or nothing of a start is in free space.
    UnreadableFileError
        If a file cannot be read.

    Examples
    --------
    $ vinefab map start grid.geojson --start "left side, heading 0+-20" --out left.geojson
    $ vinefab map start grid.geojson --start "area 0,0 50,480, clear 20" --out area.geojson

    >>> start(generate("pegs", 1), start="left side, heading 0+-20").starts[0].pose.heading_deg
    0.0
    """
    from vinefab.core.errors import BadInputError
    from vinefab.model.start import START_WAYS

    if not as_starts(start):
        raise BadInputError("start", None, START_WAYS)
    return _kept(as_map(map, start=start), out, force=force, is_new=False)


@verb
def info(
    map: MapLike,
    *,
    width_mm: float | None = None,
    start: StartsLike = (),
    passages: int = 5,
    out: PictureFile = None,
    force: Force = False,
) -> MapInfo:
    """Describe a map: its size, its narrowest passages, and the widest robot that fits.

    Parameters
    ----------
    width_mm
        Lay-flat width of a body to check.
    passages
        How many of the narrowest passages to find.

    Raises
    ------
    BadInputError
        If a value cannot be used.
    UnreadableFileError
        If a file cannot be read.

    Examples
    --------
    $ vinefab map info cave.geojson --width-mm 20 --svg cave.svg

    >>> info(generate("pegs", 1), width_mm=20).summary[0]
    'map: pegs_1'
    """
    from vinefab.prediction.map_info import map_info

    picture = page_path("out", out, force=force)
    found = map_info(as_map(map, start=start), width_mm=width_mm, passages=passages)
    if picture is not None:
        write_page(picture, found.picture(picture.suffix), force=force)
    return found


_OF_PHOTOS = "vinefab.maps.importers.import_options:PhotoOptions"
_OF_DRAWINGS = "vinefab.maps.importers.import_options:ImportOptions"


@verb
def import_(
    path: Annotated[PathText, Kind(metavar="SOURCE")],
    *,
    out: MapOut = None,
    start: StartsLike = (),
    surface: SurfaceName | None = None,
    layers: Annotated[Layers, also("--layer")] = (),
    preview: Annotated[PathText | None, file_kind(".png")] = None,
    progress: ProgressLike = True,
    force: Force = False,
    **options: Annotated[
        Any,
        FieldsOf(
            (_OF_DRAWINGS, _OF_PHOTOS),
            without=("start", "layers", "photo"),
            also={"open_lines": ("--open",)},
            kinds={"points_px": POINTS},
        ),
    ],
) -> Map:
    """Import a map from a file of another program, or from a photo.

    Everything that was repaired or left out is counted in its facts.

    Parameters
    ----------
    path
        The file: a drawing, a GIS layer, a ROS map or a photo; its ending tells the kind.
    start
        Where robots start, in the map; default: the roomiest place.
    layers
        Read only these layers (DXF, GeoPackage) or groups (SVG: id or label); may be repeated.
    preview
        Of a photo: a picture of it, rectified, with the walls drawn over.
    **options
        Fields of `vinefab.maps.importers.import_options.ImportOptions`; of a photo also of
        `vinefab.maps.importers.import_options.PhotoOptions`.

    Raises
    ------
    BadInputError
        If an option means nothing for the kind of file, or a value cannot be used.
    UnreadableFileError
        If there is no such file, or it is not of the kind that its ending says.

    Examples
    --------
    $ vinefab map import examples/imports/cave.dxf --drawn free --out plan.geojson
    $ vinefab map import examples/arena/table.jpg --marker-mm 30 --height-mm 30
      --obstacles 50,84,176,75 --crop 42,42,642,442 --out arena.geojson

    >>> from pathlib import Path
    >>> from tempfile import TemporaryDirectory
    >>> with TemporaryDirectory() as folder:
    ...     drawn = Path(folder) / "room.svg"
    ...     text = '<svg xmlns="http://www.w3.org/2000/svg"><rect width="40" height="30"/></svg>'
    ...     _ = drawn.write_text(text)
    ...     import_(drawn, scale_mm_per_unit=10.0).size_mm
    (400.0, 300.0)
    """
    from vinefab.maps.importers.importers import begin_importing, import_map, import_suffixes

    source = as_path("path", path, f"a file ending in {', '.join(import_suffixes())}")
    begin_importing(source)  # first: what follows takes as long to load as the reader

    from vinefab.core.atomic import ensure_writable, write_bytes
    from vinefab.core.errors import BadInputError, UnfitInputError
    from vinefab.maps.importers.import_options import PHOTO_SUFFIXES, ImportOptions
    from vinefab.model.map import Start
    from vinefab.model.start import start_given

    for name, file in (("out", out), ("preview", preview)):
        if file is not None:
            target = as_path(name, file)
            ensure_apart(name, target, source, "the one to import")
            ensure_writable(target, force=force)
    names = (layers,) if isinstance(layers, str) else layers
    if not isinstance(names, Sequence) or not all(isinstance(name, str) for name in names):
        raise BadInputError("layers", layers, "names of layers")
    places = [start_given(one) for one in as_starts(start)]
    chosen = ImportOptions(
        start=next((one.pose for one in places if isinstance(one, Start)), None),
        layers=tuple(names),
        photo=_photo_options(options),
        **_known(options),
    )
    with told(progress), phase("reading the source"):
        if preview is None:
            world = as_map(import_map(source, chosen), start=places)
            return _kept(world, out, force=force, surface=surface)
        if source.suffix.lower() not in PHOTO_SUFFIXES:
            problem = f"is for photos and scans ({', '.join(PHOTO_SUFFIXES)}) alone"
            raise UnfitInputError("preview", problem, "leave it out", source)
        from vinefab.maps.importers.photo_map import read_photo_map
        from vinefab.pages.page_files import page_png
        from vinefab.pages.plan import photo_preview

        imported = read_photo_map(source, chosen)
        picture = page_png(photo_preview(imported))
    world = as_map(imported.world, start=places)
    world = _kept(world, out, force=force, surface=surface)
    target = as_path("preview", preview)
    write_bytes(target, picture, force=force)
    wrote(target)
    return world


def _known(options: dict[str, Any]) -> dict[str, Any]:
    """Return the options of an import, once all of them are known; those of photos are gone."""
    from vinefab.core.errors import UnfitInputError, nearest
    from vinefab.maps.importers.import_options import ImportOptions, PhotoOptions

    of_photos = PhotoOptions.__dataclass_fields__
    known = [name for name in ImportOptions.__dataclass_fields__ if name != "photo"]
    for name in options:
        if name not in known:
            remedy = nearest(name, [*known, *of_photos]).removeprefix("; ") or "leave it out"
            listed = f"options: {', '.join(known)}; of a photo: {', '.join(of_photos)}"
            raise UnfitInputError(name, "there is no such option", f"{remedy} ({listed})")
    return options


def _photo_options(options: dict[str, Any]) -> PhotoOptions | None:
    """Take the options of a photo out of the others, also from a table of them."""
    from collections.abc import Mapping

    from vinefab.core.errors import BadInputError, UnfitInputError, nearest
    from vinefab.maps.importers.import_options import PhotoOptions

    known = PhotoOptions.__dataclass_fields__
    flat = {name: options.pop(name) for name in list(options) if name in known}
    given = options.pop("photo", None)
    if flat and given is not None:
        name = next(iter(flat))
        raise UnfitInputError(name, "is given together with photo", "give it as a part of photo")
    if given is None or isinstance(given, PhotoOptions):
        return PhotoOptions(**flat) if flat else given
    if not isinstance(given, Mapping):
        raise BadInputError("photo", given, "PhotoOptions, or a dict of them")
    for name in given:
        if name not in known:
            remedy = nearest(str(name), known).removeprefix("; ") or "leave it out"
            listed = f"options: {', '.join(known)}"
            raise UnfitInputError(
                f"photo.{name}", "there is no such option", f"{remedy} ({listed})"
            )
    return PhotoOptions(**given)
