"""The formats that maps can be imported from.

To add one: a file with ``read(path, options)``, an entry here, a valid sample in the contract test.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import TYPE_CHECKING

from vinefab.core.bounded import begin_reader, bounded
from vinefab.core.errors import BadInputError
from vinefab.core.foreign import reading
from vinefab.core.front_door import imported_later
from vinefab.core.registry import Registry
from vinefab.maps.importers.import_options import PHOTO_SUFFIXES, ImportOptions

if TYPE_CHECKING:
    from pathlib import Path

    import numpy as np

    from vinefab.model.map import Map
else:
    np = imported_later("numpy")


_ROOM = "vinefab.maps.importers"


@dataclass(frozen=True, slots=True, kw_only=True)
class MapImporter:
    """Reads maps in one format.

    What is wrong with a file is a BadInputError or an UnreadableFileError that names the file.
    """

    suffixes: tuple[str, ...]  # of its files, in lower case with the dot
    reader: str  # MODULE:FUNCTION; only the process that reads a file loads it
    malformed: bytes  # a damaged file, which must be refused

    def read(self, path: Path, options: ImportOptions) -> Map:
        """Return the map in a file, read in this process and without limits."""
        module, _, function = self.reader.partition(":")
        # Later steps refuse sizes near the limits of floats, or find them equal.
        with np.errstate(all="ignore"), reading(path):
            world: Map = getattr(import_module(module), function)(path, options)
            checked: Map = import_module(f"{_ROOM}.doubts").with_doubts(world)
        return checked


IMPORTERS: Registry[MapImporter] = Registry(
    "map format",
    {
        "ros": MapImporter(
            suffixes=(".yaml", ".yml"),
            reader=f"{_ROOM}.ros_map:import_ros",
            malformed=b"image: world.pgm\nresolution: 0.05\norigin: [0.0, 0.0]\n",
        ),
        "geojson": MapImporter(
            suffixes=(".geojson", ".json"),
            reader=f"{_ROOM}.geojson_any:import_geojson",
            malformed=b'{"type": "Polygon", "coordinates": [[[0, 0], [9, 0], ["9", 9]]]}',
        ),
        "dxf": MapImporter(
            suffixes=(".dxf",),
            reader=f"{_ROOM}.dxf_drawing:import_dxf",
            malformed=b"0\nSECTION\n2\nENTITIES\n0\nLINE\n10\nhere\n0\nENDSEC\n0\nEOF\n",
        ),
        "svg": MapImporter(
            suffixes=(".svg",),
            reader=f"{_ROOM}.svg_drawing:import_svg",
            malformed=b'<svg xmlns="http://www.w3.org/2000/svg"><path d="M 0 0 L 9 x"/></svg>',
        ),
        "csv": MapImporter(
            suffixes=(".csv",),
            reader=f"{_ROOM}.csv_polygons:import_csv",
            malformed=b"polygon,x_mm,y_mm\nroom,0,0\nroom,100\n",
        ),
        "geopackage": MapImporter(
            suffixes=(".gpkg",),
            reader=f"{_ROOM}.gis_layers:import_gis",
            malformed=b"SQLite format 3\0 and no pages",
        ),
        "shapefile": MapImporter(
            suffixes=(".shp",),
            reader=f"{_ROOM}.gis_layers:import_gis",
            malformed=b"\0\0\x27\x0a and no header",
        ),
        "flatgeobuf": MapImporter(
            suffixes=(".fgb",),
            reader=f"{_ROOM}.gis_layers:import_gis",
            malformed=b"fgb\x03fgb\0 and no header",
        ),
        "photo": MapImporter(
            suffixes=PHOTO_SUFFIXES,
            reader=f"{_ROOM}.photo_map:import_photo",
            malformed=b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR\0\0\0\x08\0\0\0\x08\x08\0\0\0\0",
        ),
    },
)


_SVG = "open it in Inkscape, or the program that drew it, and save as SVG or DXF"
_CUT = (
    "a solid is not a plan: cut it at one height and save the section as DXF or SVG (FreeCAD: Part "
    "section; OpenSCAD: projection(cut = true))"
)
_DEGREES = (
    "it is in degrees: project it in QGIS, or ogr2ogr -t_srs EPSG:32632 (your zone) plan.gpkg FILE"
)
_AS_LAYERS = "save it as GeoPackage in QGIS, or ogr2ogr plan.gpkg FILE"
_PIXELS = "save it as PNG or JPEG"
_UNPACK = "unpack it, and give the drawing in it"
_CLOUD = "a cloud of points is not a plan: make an occupancy grid of it (a ROS map: .yaml and .pgm)"
_ADVICE = {
    "pdf": f"{_SVG} (or: pdftocairo -svg FILE plan.svg)",
    "ai eps ps cdr odg vsd vsdx drawio sketch fig afdesign": _SVG,
    "dwg dws dwt": "save it as DXF in a CAD program (LibreCAD, QCAD; or dwg2dxf of LibreDWG)",
    "dgn vwx skb rvt rfa ifc pln": "export a plan at one height as DXF",
    "stl obj 3mf amf step stp iges igs brep fcstd sldprt skp f3d blend scad glb gltf": _CUT,
    "ply las laz pcd e57 bt ot": _CLOUD,
    "kml kmz gpx": _DEGREES,
    "shx dbf prj cpg": "give the .shp that lies next to it",
    "gml tab mif gdb sqlite geojsonl geojsons topojson osm": _AS_LAYERS,
    "qgz qgs": "a project: export its layer (Export, Save Features As, GeoPackage)",
    "th th2 thconfig lox": "export it in Therion: export map -format esri (or dxf), import that",
    "svx 3d": "export the passages in Survex's aven as Shapefile, DXF or SVG",
    "tif tiff bmp gif webp heic xcf psd": _PIXELS,
    "svgz gz zip shz 7z tar tgz": _UNPACK,
    "txt dat xyz asc": "polygons as text go in a .csv: polygon,x_mm,y_mm, a point per line",
    "xlsx xls ods": "save the sheet as CSV: polygon,x_mm,y_mm, a point per line",
}
"""What to do with kinds of files that are near, by the ends of their names."""


def _advice(source: Path) -> str:
    """Return the advice on a file that no importer reads, as the end of a sentence."""
    suffix = source.suffix.lower().removeprefix(".")
    if suffix in ("pgm", "pnm"):
        beside = source.with_suffix(".yaml")
        if beside.is_file():
            return f"; of a ROS map give {beside.name}, which lies next to it"
        return (
            f"; a ROS map is given by its .yaml: {beside.name} with the lines image: "
            f"{source.name}, resolution: 0.05 (m per cell), origin: [0, 0, 0], negate: 0, "
            "occupied_thresh: 0.65, free_thresh: 0.196"
        )
    return next((f"; {words}" for ends, words in _ADVICE.items() if suffix in ends.split()), "")


def import_suffixes() -> dict[str, MapImporter]:
    """Return the importers by the suffixes of their files."""
    return {suffix: importer for importer in IMPORTERS.values() for suffix in importer.suffixes}


def begin_importing(source: Path) -> None:
    """Begin the process that will read a file, as `import_map` will be asked for it."""
    importer = import_suffixes().get(source.suffix.lower())
    if importer is not None and source.suffix.lower() not in PHOTO_SUFFIXES:
        begin_reader(importer.reader.partition(":")[0])


def import_map(source: Path, options: ImportOptions) -> Map:
    """Return the map in a file of another program.

    Parameters
    ----------
    source
        Its suffix, in upper or lower case, says which importer reads it.

    Raises
    ------
    BadInputError
        If no importer knows the suffix, an option means nothing for the format, or the content
        is not a map; the message says where in the file.
    UnreadableFileError
        If the file is missing, damaged or of another format than its suffix says, or takes too
        much time or memory to read (`bounded`).
    """
    known = import_suffixes()
    suffix = source.suffix.lower()
    if suffix not in known:
        raise BadInputError(
            "source", str(source), f"a file ending in {', '.join(known)}{_advice(source)}"
        )
    if options.photo is not None and suffix not in PHOTO_SUFFIXES:
        options.photo.refuse(source)
    if suffix in PHOTO_SUFFIXES:
        # Their pixels are counted before they are decoded, and bound the work, as in `observe`.
        return known[suffix].read(source, options)
    return bounded(source, known[suffix].read, source, options)
