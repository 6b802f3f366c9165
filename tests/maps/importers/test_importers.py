"""What every registered importer promises."""

import io
import warnings
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
import shapely
from PIL import Image

from vinefab.core.errors import BadInputError, UnreadableFileError
from vinefab.maps.importers import importers
from vinefab.maps.importers.import_options import ImportOptions, PhotoOptions
from vinefab.maps.importers.importers import IMPORTERS, import_map, import_suffixes
from vinefab.model.map import Map

ROOM = [(0, 0), (100, 0), (100, 60), (0, 60)]
PILLAR = [(40, 20), (60, 20), (60, 40), (40, 40)]


def csv_sample() -> bytes:
    rows = [(name, *point) for name, ring in (("room", ROOM), ("pillar", PILLAR)) for point in ring]
    return "".join(f"{name},{x},{y}\n" for name, x, y in rows).encode()


def svg_sample() -> bytes:
    shapes = (" ".join(f"{x},{60 - y}" for x, y in ring) for ring in (ROOM, PILLAR))
    return (
        '<svg xmlns="http://www.w3.org/2000/svg" width="100mm" height="60mm" viewBox="0 0 100 60">'
        + "".join(f'<polygon points="{points}"/>' for points in shapes)
        + "</svg>"
    ).encode()


def geojson_sample() -> bytes:
    rings = str([[list(point) for point in ring] for ring in (ROOM, PILLAR)])
    return f'{{"type": "Polygon", "coordinates": {rings}}}'.encode()


def dxf_sample() -> bytes:
    lines = [
        f"0\nLINE\n8\n0\n10\n{a[0]}\n20\n{a[1]}\n11\n{b[0]}\n21\n{b[1]}\n"
        for ring in (ROOM, PILLAR)
        for a, b in zip(ring, [*ring[1:], ring[0]], strict=True)
    ]
    return f"0\nSECTION\n2\nENTITIES\n{''.join(lines)}0\nENDSEC\n0\nEOF\n".encode()


def ros_sample() -> bytes:
    return (
        b"image: cells.pgm\nresolution: 0.01\norigin: [0, 0, 0]\n"
        b"negate: 0\noccupied_thresh: 0.65\nfree_thresh: 0.196\n"
    )


def ros_image() -> bytes:
    cells = np.full((6, 10), 254, dtype=np.uint8)
    cells[2:4, 4:6] = 0
    return b"P5 10 6 255\n" + cells.tobytes()


@cache
def gis_sample(suffix: str) -> bytes:
    """Return a file that GDAL wrote; of a Shapefile ``.shx`` is the index that lies next to it."""
    raw = pytest.importorskip("pyogrio.raw")
    shapes = shapely.to_wkb(np.array([shapely.Polygon(ring) for ring in (ROOM, PILLAR)]))
    with TemporaryDirectory() as folder, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # no reference system: mm
        path = Path(folder) / f"sample{suffix}"
        written = path.with_suffix(".shp" if suffix == ".shx" else suffix)
        raw.write(str(written), shapes, [], [], geometry_type="Polygon")
        return path.read_bytes()


def photo_sample() -> bytes:
    pixels = np.full((60, 100), 240, dtype=np.uint8)
    pixels[20:40, 40:60] = 20
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "PNG")
    return file.getvalue()


SAMPLES = {
    "csv": csv_sample,
    "dxf": dxf_sample,
    "flatgeobuf": partial(gis_sample, ".fgb"),
    "geojson": geojson_sample,
    "geopackage": partial(gis_sample, ".gpkg"),
    "photo": photo_sample,
    "ros": ros_sample,
    "shapefile": partial(gis_sample, ".shp"),
    "svg": svg_sample,
}
"""The smallest file of each format that shows the room with its pillar."""

NAMES = sorted(IMPORTERS)
SCALED = PhotoOptions(points_px=((0.0, 0.0), (0.0, 60.0)), distance_mm=60.0)
EVERY_SUFFIX = [(name, suffix) for name in NAMES for suffix in IMPORTERS[name].suffixes]


def imported(folder: Path, suffix: str, data: bytes) -> Map:
    """Import data as a file with a suffix; what ROS maps and Shapefiles need lies next to it."""
    (folder / "cells.pgm").write_bytes(ros_image())
    if suffix.lower() == ".shp":
        (folder / "sample.shx").write_bytes(gis_sample(".shx"))
    path = folder / f"sample{suffix}"
    path.write_bytes(data)
    kind = suffix.lower()
    options = ImportOptions(
        scale_mm_per_unit=1000.0 if kind in IMPORTERS["ros"].suffixes else None,
        photo=SCALED if kind in IMPORTERS["photo"].suffixes else None,
    )
    return import_map(path, options)


def assert_refused(folder: Path, suffix: str, data: bytes) -> None:
    """Refused by one line that names the file once."""
    with pytest.raises((BadInputError, UnreadableFileError)) as caught:
        imported(folder, suffix, data)
    message = str(caught.value)
    assert message.count(f"sample{suffix}") == 1
    assert "\n" not in message
    assert len(message) < 400


def test_every_format_has_a_sample() -> None:
    assert sorted(SAMPLES) == NAMES


def test_suffixes_are_lower_case_and_belong_to_one_format() -> None:
    suffixes = [suffix for _, suffix in EVERY_SUFFIX]
    assert sorted(import_suffixes()) == sorted(suffixes)
    assert all(suffix == suffix.lower() and suffix.startswith(".") for suffix in suffixes)


@pytest.mark.parametrize(("name", "suffix"), EVERY_SUFFIX)
@pytest.mark.parametrize("case", [str.lower, str.upper])
def test_the_smallest_valid_file_becomes_a_map(
    tmp_path: Path, name: str, suffix: str, case: Callable[[str], str]
) -> None:
    world = imported(tmp_path, case(suffix), SAMPLES[name]())
    assert world.bounds.equals(shapely.Polygon(ROOM))
    (pillar,) = world.obstacles
    assert pillar.equals(shapely.Polygon(PILLAR))
    assert len(world.starts) == 1
    assert world.facts["source"].lower() == f"sample{suffix}"


@pytest.mark.usefixtures("limits")
@pytest.mark.parametrize("name", NAMES)
def test_a_malformed_file_is_refused(tmp_path: Path, name: str) -> None:
    importer = IMPORTERS[name]
    assert importer.malformed.strip()
    assert_refused(tmp_path, importer.suffixes[0], importer.malformed)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("empty", [b"", b"\n  \n"])
def test_an_empty_file_is_refused(tmp_path: Path, name: str, empty: bytes) -> None:
    assert_refused(tmp_path, IMPORTERS[name].suffixes[0], empty)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seed", range(2))
def test_random_bytes_are_refused(tmp_path: Path, name: str, seed: int) -> None:
    noise = np.random.default_rng(seed).bytes(3000)
    assert_refused(tmp_path, IMPORTERS[name].suffixes[0], noise)
    assert_refused(tmp_path, IMPORTERS[name].suffixes[0], bytes(range(256)))


@pytest.mark.parametrize("name", NAMES)
def test_no_file_cut_short_is_a_crash(tmp_path: Path, name: str) -> None:
    data, messages = SAMPLES[name](), []
    for end in range(0, len(data), max(1, len(data) // 25)):
        try:
            imported(tmp_path, IMPORTERS[name].suffixes[0], data[:end])
        except (BadInputError, UnreadableFileError) as error:
            messages.append(str(error))
    assert len(messages) > 10
    assert all("sample" in message for message in messages)


def test_an_unknown_suffix_is_refused_with_the_known_ones() -> None:
    with pytest.raises(BadInputError, match=r"plan\.txt.*ending in .*\.yaml.*\.svg"):
        import_map(Path("plan.txt"), ImportOptions())


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("plan.pdf", "Inkscape.*pdftocairo"),
        ("plan.AI", "Inkscape"),
        ("plan.dwg", "save it as DXF"),
        ("arena.stl", "cut it at one height"),
        ("cave.kml", "in degrees: project it"),
        ("cave.dbf", "give the .shp"),
        ("cave.th2", "export map"),
        ("plan.tiff", "save it as PNG"),
        ("plan.svgz", "unpack it"),
        ("world.pgm", "world.yaml with the lines image: world.pgm, resolution"),
        ("plan.xlsx", "save the sheet as CSV"),
    ],
)
def test_a_kind_of_file_that_is_near_gets_a_hint(name: str, words: str) -> None:
    with pytest.raises(BadInputError, match=words) as caught:
        import_map(Path(name), ImportOptions())
    assert "\n" not in str(caught.value)


def test_the_image_of_a_ros_map_leads_to_its_yaml(tmp_path: Path) -> None:
    (tmp_path / "world.yaml").write_bytes(ros_sample())
    with pytest.raises(BadInputError, match=r"give world\.yaml, which lies next to it"):
        import_map(tmp_path / "world.pgm", ImportOptions())


def test_a_dwg_file_with_the_name_of_a_dxf_is_named(tmp_path: Path) -> None:
    path = tmp_path / "plan.dxf"
    path.write_bytes(b"AC1032" + bytes(200))
    with pytest.raises(UnreadableFileError, match="is a DWG file, not DXF: save it as DXF"):
        import_map(path, ImportOptions())


@pytest.mark.parametrize(
    ("document", "kind"),
    [
        ('{"type": "Topology", "arcs": []}', "TopoJSON"),
        ('{"geometryType": "esriGeometryPolygon", "features": []}', "Esri JSON"),
    ],
)
def test_other_json_is_named(tmp_path: Path, document: str, kind: str) -> None:
    path = tmp_path / "plan.json"
    path.write_text(document)
    with pytest.raises(BadInputError, match=f"{kind}.*ogr2ogr"):
        import_map(path, ImportOptions())


def test_no_hint_is_about_a_kind_that_is_read() -> None:
    near = {end for ends in importers._ADVICE for end in ends.split()}
    assert not near & {suffix.removeprefix(".") for suffix in import_suffixes()}
