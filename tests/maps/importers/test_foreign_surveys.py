"""One cave as other programs write it: the same free space from every file."""

from pathlib import Path

import numpy as np
import pytest
import shapely
from shapely import Polygon

from vinefab.core.errors import BadInputError
from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.importers.importers import import_map

FOREIGN = Path(__file__).parent / "foreign"

AREAS = (
    (
        (9.8872, 14.5104),
        (36.5429, 15.6156),
        (63.2298, 15.4762),
        (89.8763, 16.9471),
        (90.1102, 7.5922),
        (63.454, 6.5071),
        (36.7772, 6.2447),
        (10.1078, 5.6895),
    ),
    (
        (83.7429, 4.8035),
        (82.7061, 26.4685),
        (81.1909, 48.1114),
        (80.9124, 69.8113),
        (89.0508, 70.187),
        (90.1834, 48.5264),
        (91.7235, 26.8847),
        (92.5952, 5.2121),
    ),
    (
        (90.1021, 61.9156),
        (63.4392, 61.0978),
        (36.7867, 59.8669),
        (10.1145, 59.4193),
        (9.896, 68.1584),
        (36.5547, 69.1443),
        (63.2225, 69.7651),
        (89.8977, 70.0928),
    ),
    (
        (16.9406, 70.1544),
        (17.1758, 48.8076),
        (18.3071, 27.4888),
        (18.0788, 6.1275),
        (9.8275, 5.8696),
        (8.5338, 27.1833),
        (8.2923, 48.53),
        (7.3949, 69.8561),
    ),
    (
        (47.1967, 10.0967),
        (47.8604, 29.4301),
        (48.8195, 48.7534),
        (49.7156, 68.0788),
        (54.0441, 67.9295),
        (53.7404, 48.5837),
        (53.0486, 29.2512),
        (52.0527, 9.9292),
    ),
    ((110.0, 60.0), (110.0, 85.0), (80.0, 85.0), (80.0, 60.0)),
    (
        (119.0, 75.0),
        (116.364, 68.636),
        (110.0, 66.0),
        (103.636, 68.636),
        (101.0, 75.0),
        (103.636, 81.364),
        (110.0, 84.0),
        (116.364, 81.364),
    ),
)
"""What every file shows, in its own units."""

IN_METRES = {
    "ogr.fgb": 1000.0,
    "ogr.geojson": 1000.0,
    "ogr.shp": 1000.0,
    "ezdxf_R2004.dxf": 1000.0,
    "ezdxf_R2013.dxf": 1000.0,
}
"""Millimetres per unit, as the files say; those not named here are in mm."""

PIXEL_MM = 25.4 / 96.0
FILES = {
    "ogr.dxf": ({"scale_mm_per_unit": 1000.0}, 1000.0),
    "outline2d.shp": ({"scale_mm_per_unit": 1000.0}, 1000.0),
    "ezdxf_R12.dxf": ({}, 1.0),
    "ezdxf_drawing.svg": ({}, 130.0 / 111.6051),
    "svgwrite.svg": ({}, 1.0),
    "matplotlib.svg": ({}, 1.0),
    "chromium.svg": ({}, 1.0),
    "rsvg_cairo.svg": ({}, 1.0),
    "rsvg_cairo_mpl.svg": ({}, 1.0),
    "shapely.svg": ({}, 1.0),
    "trimesh.dxf": ({}, 1.0),
    "trimesh.svg": ({}, PIXEL_MM),
    "inkscape.svg": ({"layers": ("Passages",)}, 1.0),
    "therion.svg": ({"open_lines": "drop"}, 1.0),
    "survex.dxf": ({"layers": ("Passages",)}, 1.0),
    **{name: ({}, unit_mm) for name, unit_mm in IN_METRES.items()},
}
"""Options of each file, and mm of the map per unit of `AREAS`."""

MIRRORED = ("trimesh.svg",)
"""Written with y upward, into a format in which it points down."""


@pytest.mark.parametrize("name", FILES)
def test_a_file_of_another_program_gives_the_same_free_space(name):
    if name.endswith((".shp", ".fgb")):
        pytest.importorskip("pyogrio")
    options, unit_mm = FILES[name]
    world = import_map(FOREIGN / name, ImportOptions(drawn="free", **options))
    cave = shapely.union_all(shapely.polygons([Polygon(ring).exterior for ring in AREAS]))
    turned = np.array([1.0, -1.0 if name in MIRRORED else 1.0]) / unit_mm
    found = shapely.transform(world.free_space, lambda points: points * turned)
    moved = [there - here for there, here in zip(cave.bounds, found.bounds, strict=True)]
    found = shapely.affinity.translate(found, moved[0], moved[1])
    assert shapely.symmetric_difference(found, cave).area < 1e-3 * cave.area
    assert len(world.obstacles) == 2
    assert world.facts["areas_united"] == len(AREAS)


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("ogr_lonlat.shp", "in degrees.*project the layer"),
        ("ogr.kml", "in degrees: project it"),
        ("ogr.csv", r"WKT.*ogr2ogr plan\.gpkg"),
    ],
)
def test_what_is_near_is_refused_with_what_to_do(name, message):
    if name.endswith(".shp"):
        pytest.importorskip("pyogrio")
    with pytest.raises(BadInputError, match=message):
        import_map(FOREIGN / name, ImportOptions())


def test_inches_of_gdal_are_doubted_and_a_page_is_said():
    facts = import_map(FOREIGN / "ogr.dxf", ImportOptions(drawn="free")).facts
    assert facts["unit"].startswith("inches, guessed ($INSUNITS; GDAL and QGIS write so")
    facts = import_map(FOREIGN / "matplotlib.svg", ImportOptions()).facts
    assert "--drawn free if the areas on it" in facts["page"]
