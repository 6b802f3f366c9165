"""GeoPackage, Shapefile and FlatGeobuf: units, layers, heights, and what is refused."""

import sys
import warnings

import numpy as np
import pytest
import shapely

from vinefab.core.errors import (
    BadInputError,
    MissingPackageError,
    UnknownNameError,
    UnreadableFileError,
)
from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.importers.importers import import_map

raw = pytest.importorskip("pyogrio.raw")

ROOM = shapely.box(500_000.0, 5_250_000.0, 500_040.0, 5_250_030.0)
PILLAR = shapely.box(500_010.0, 5_250_010.0, 500_012.0, 5_250_011.0)
LOCAL_FEET = (
    'PROJCS["cave",GEOGCS["WGS 84",DATUM["WGS_1984",SPHEROID["WGS 84",6378137,298.257223563]],'
    'PRIMEM["Greenwich",0],UNIT["degree",0.0174532925199433]],PROJECTION["Transverse_Mercator"],'
    'PARAMETER["latitude_of_origin",0],PARAMETER["central_meridian",9],'
    'PARAMETER["scale_factor",1],PARAMETER["false_easting",0],PARAMETER["false_northing",0],'
    'UNIT["US survey foot",0.304800609601219]]'
)
US_FOOT_MM = 1200.0 / 3937.0 * 1000.0


def written(path, shapes, crs=None, layer=None, **columns):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        raw.write(
            str(path),
            shapely.to_wkb(np.array(shapes)),
            [np.array(values, dtype=object) for values in columns.values()],
            list(columns),
            geometry_type=shapes[0].geom_type + (" Z" if shapes[0].has_z else ""),
            crs=crs,
            layer=layer,
        )
    return path


@pytest.mark.parametrize(
    ("suffix", "crs", "mm"),
    [
        (".gpkg", None, 1.0),
        (".gpkg", "EPSG:32632", 1000.0),
        (".shp", "EPSG:2225", US_FOOT_MM),
        (".shp", LOCAL_FEET, US_FOOT_MM),
        (".fgb", "EPSG:2222", 304.8),
    ],
)
def test_the_unit_is_that_of_the_reference_system(tmp_path, suffix, crs, mm):
    path = written(tmp_path / f"cave{suffix}", [ROOM, PILLAR], crs)
    world = import_map(path, ImportOptions())
    assert world.size_mm == pytest.approx((40.0 * mm, 30.0 * mm), rel=1e-9)
    assert world.obstacles[0].area == pytest.approx(2.0 * mm**2, rel=1e-6)
    assert world.facts["scale_mm_per_unit"] == pytest.approx(mm, rel=1e-9)
    assert ("guess" in world.facts["unit"]) == (crs is None)
    model = import_map(path, ImportOptions(scale_mm_per_unit=10.0))
    assert model.size_mm == pytest.approx((400.0, 300.0), rel=1e-9)


@pytest.mark.parametrize("suffix", [".gpkg", ".shp", ".fgb"])
def test_degrees_are_refused_unless_a_scale_is_given(tmp_path, suffix):
    room = shapely.box(8.5, 47.3, 8.51, 47.31)
    path = written(tmp_path / f"cave{suffix}", [room], "EPSG:4326")
    with pytest.raises(BadInputError, match=r"EPSG:4326 is in degrees; project the layer"):
        import_map(path, ImportOptions())
    assert import_map(path, ImportOptions(scale_mm_per_unit=1e5)).size_mm[0] == pytest.approx(1e3)


def test_degrees_named_in_geojson_are_refused_too(tmp_path):
    path = written(tmp_path / "cave.geojson", [shapely.box(8.5, 47.3, 9.5, 48.3)], "EPSG:4326")
    with pytest.raises(BadInputError, match=r"CRS84 is in degrees.*project the layer"):
        import_map(path, ImportOptions())
    assert import_map(path, ImportOptions(scale_mm_per_unit=1e3)).size_mm[0] == pytest.approx(1e3)


def test_of_several_layers_one_must_be_chosen(tmp_path):
    path = written(tmp_path / "site.gpkg", [ROOM], "EPSG:32632", layer="rooms")
    written(path, [PILLAR], "EPSG:32632", layer="rocks")
    with pytest.raises(BadInputError, match=r"--layer is missing; give one of rooms, rocks"):
        import_map(path, ImportOptions())
    assert len(import_map(path, ImportOptions(layers=("rooms",))).obstacles) == 0
    both = import_map(path, ImportOptions(layers=("rooms", "rocks")))
    assert len(both.obstacles) == 1
    with pytest.raises(UnknownNameError, match=r"site\.gpkg.*did you mean 'rocks'"):
        import_map(path, ImportOptions(layers=("rock",)))


def test_heights_are_dropped_and_said_and_points_left_out(tmp_path):
    high = shapely.force_3d(np.array([ROOM, PILLAR]), 417.0)
    world = import_map(written(tmp_path / "a.gpkg", list(high), "EPSG:32632"), ImportOptions())
    assert world.facts["heights_dropped"] == 2
    assert world.size_mm == pytest.approx((40_000.0, 30_000.0))
    path = written(tmp_path / "b.gpkg", [ROOM], "EPSG:32632", layer="rooms")
    written(path, [shapely.Point(500_001, 5_250_001)], "EPSG:32632", layer="stations")
    found = import_map(path, ImportOptions(layers=("rooms", "stations")))
    assert found.facts["ignored"] == {"Point": 1}


def test_a_column_may_name_bounds_and_obstacles(tmp_path):
    path = written(tmp_path / "a.gpkg", [PILLAR, ROOM], "EPSG:32632", role=["obstacle", "bounds"])
    assert "calls bounds" in import_map(path, ImportOptions()).facts["bounds_are"]


def test_passages_of_several_kinds_of_geometry_are_united(tmp_path):
    halls = shapely.MultiPolygon([ROOM, shapely.box(500_039, 5_250_010, 500_090, 5_250_020)])
    path = written(tmp_path / "a.fgb", [halls], "EPSG:32632")
    world = import_map(path, ImportOptions(drawn="free"))
    assert world.free_space.area == pytest.approx(1e6 * (1200.0 + 500.0))


def test_what_is_missing_or_of_another_kind_is_one_line(tmp_path, monkeypatch):
    path = written(tmp_path / "cave.shp", [ROOM, PILLAR], "EPSG:32632")
    (tmp_path / "cave.prj").unlink()
    assert "no .prj" in import_map(path, ImportOptions()).facts["unit"]
    (tmp_path / "cave.shx").unlink()
    with pytest.raises(UnreadableFileError, match=r"needs cave[.]shx next to it"):
        import_map(path, ImportOptions())
    # GDAL would follow what such a file names.
    virtual = tmp_path / "virtual.gpkg"
    virtual.write_text("<OGRVRTDataSource><OGRVRTLayer name='a'/></OGRVRTDataSource>")
    with pytest.raises(UnreadableFileError, match=r"is not a \.gpkg file"):
        import_map(virtual, ImportOptions())
    good = written(tmp_path / "cave.gpkg", [ROOM], "EPSG:32632")
    monkeypatch.setitem(sys.modules, "pyogrio", None)
    with pytest.raises(MissingPackageError, match=r"cave.gpkg.*pip install 'vinefab\[gis\]'"):
        import_map(good, ImportOptions())


def test_names_of_columns_in_another_encoding_are_refused(tmp_path):
    path = written(tmp_path / "plan.shp", [ROOM], name=["room"])
    table = path.with_suffix(".dbf")
    table.write_bytes(table.read_bytes().replace(b"name", b"\x95ame"))
    with pytest.raises(UnreadableFileError, match=r"plan\.shp: cannot be read by GDAL: 'utf-8'"):
        import_map(path, ImportOptions())


def test_a_file_name_that_is_no_text_makes_a_name_that_is_or_is_refused(tmp_path):
    path = tmp_path / "\udcff.csv"
    path.write_text("room,0,0\nroom,9,0\nroom,9,9\n")
    assert import_map(path, ImportOptions()).name == r"\xff"
    survey = written(tmp_path / "plan.fgb", [ROOM], crs="EPSG:32632").rename(
        path.with_suffix(".fgb")
    )
    with pytest.raises(UnreadableFileError, match="cannot be read by GDAL"):
        import_map(survey, ImportOptions())
