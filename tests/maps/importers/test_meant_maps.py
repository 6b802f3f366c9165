"""Files as their makers mean them: which side is free, in which unit, and where the image lies.

Right values are those of the drawings, which are made here.
"""

import json

import numpy as np
import pytest
import shapely
from PIL import Image
from shapely.geometry import box, mapping

from vinefab.core.errors import BadInputError, UnfitInputError
from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.importers.importers import import_map
from vinefab.maps.summary import map_summary
from vinefab.model.map import Pose

ROOM_CELLS = (30, 50)
"""Rows and columns of the free cells of a saved map."""


def saved_map(folder, *, free_thresh=0.25, image="slam.pgm", unknown=205, size=(60, 80), **keys):
    """Write a map as Nav2's saver does: free 254 in walls 0, unknown around."""
    cells = np.full(size, unknown, dtype=np.uint8)
    cells[9 : 11 + ROOM_CELLS[0], 9 : 11 + ROOM_CELLS[1]] = 0
    cells[10 : 10 + ROOM_CELLS[0], 10 : 10 + ROOM_CELLS[1]] = 254
    cells[20:24, 20:26] = 0
    Image.fromarray(cells).save(folder / "slam.pgm")
    content = {"image": image, "resolution": 0.05, "origin": [0.0, 0.0, 0.0], "mode": "trinary"}
    content |= {"negate": 0, "occupied_thresh": 0.65, "free_thresh": free_thresh} | keys
    path = folder / "slam.yaml"
    path.write_text("".join(f"{key}: {json.dumps(value)}\n" for key, value in content.items()))
    return path


ROOM_MM2 = (30 * 50 - 4 * 6) * 50.0**2


def notes_of(world):
    return " ".join(world.facts.get("notes", ()))


def test_unknown_cells_of_savers_are_unknown_whatever_the_threshold(tmp_path):
    world = import_map(saved_map(tmp_path), ImportOptions())
    assert world.free_space.area == pytest.approx(ROOM_MM2, rel=1e-9)
    assert "205 are unknown" in notes_of(world)
    assert "--unknown free" in notes_of(world)
    plain = import_map(saved_map(tmp_path, free_thresh=0.196), ImportOptions())
    assert plain.free_space.equals(world.free_space)
    assert "notes" not in plain.facts


def test_other_values_keep_the_threshold_and_a_frame_is_doubted(tmp_path):
    world = import_map(saved_map(tmp_path, unknown=206), ImportOptions())
    assert world.size_mm == pytest.approx((4000.0, 3000.0))
    note = notes_of(world)
    assert "inside out" in note
    x, y, heading = map(float, note.partition("--start ")[2].split(" ")[0].split(","))
    options = ImportOptions(start=Pose(x_mm=x, y_mm=y, heading_rad=np.radians(heading)))
    again = import_map(saved_map(tmp_path, unknown=206), options)
    assert again.free_space.area == pytest.approx(ROOM_MM2, rel=1e-9)


@pytest.mark.parametrize(
    "image", ["/home/her/maps/slam.pgm", "~/maps/slam.pgm", "maps/slam.pgm", r"C:\maps\slam.pgm"]
)
def test_the_image_next_to_the_file_is_taken_and_told(tmp_path, image):
    world = import_map(saved_map(tmp_path, image=image), ImportOptions())
    assert world.free_space.area == pytest.approx(ROOM_MM2, rel=1e-9)
    assert f"which names {image}" in notes_of(world)
    (tmp_path / "slam.pgm").unlink()
    with pytest.raises(BadInputError, match=r"slam\.yaml: image: .*write image: slam\.pgm"):
        import_map(tmp_path / "slam.yaml", ImportOptions())


def test_a_large_hall_is_offered_scales_of_models(tmp_path):
    path = saved_map(tmp_path, free_thresh=0.196, resolution=0.5)
    (note,) = [line for line in map_summary(import_map(path, ImportOptions())) if "note" in line]
    assert "--scale-mm-per-unit 100 (2500 x 1500 mm)" in note
    assert "inch" not in note


def geojson(folder, *shapes, system=None):
    features = [
        {"type": "Feature", "properties": {}, "geometry": mapping(shape)} for shape in shapes
    ]
    content = {"type": "FeatureCollection", "features": features}
    if system:
        content["crs"] = {"type": "name", "properties": {"name": system}}
    path = folder / "plan.geojson"
    path.write_text(json.dumps(content))
    return path


CARD, ROOM, TABLE = box(0, 0, 400, 300), box(10, 10, 390, 290), box(100, 100, 140, 120)


def outlines(folder, *shapes):
    return geojson(folder, *(shapely.LineString(shape.exterior) for shape in shapes))


def test_a_frame_around_a_solid_with_the_rest_names_the_reading_that_takes_it(tmp_path):
    world = import_map(outlines(tmp_path, CARD, ROOM, TABLE), ImportOptions())
    assert "--bounds wall" in notes_of(world)
    again = import_map(outlines(tmp_path, CARD, ROOM, TABLE), ImportOptions(bounds="wall"))
    assert again.free_space.area == pytest.approx(ROOM.area - TABLE.area)
    assert "notes" not in again.facts


@pytest.mark.parametrize(
    "shapes",
    [(CARD, TABLE), (CARD, box(50, 50, 150, 150), box(60, 60, 140, 140)), (CARD, ROOM)],
    ids=["table", "hollow table", "one block"],
)
def test_ordinary_rooms_are_not_doubted(tmp_path, shapes):
    assert "notes" not in import_map(outlines(tmp_path, *shapes), ImportOptions()).facts


def test_most_of_the_free_area_out_of_reach_is_told(tmp_path):
    rooms = [shapely.LineString(box(x, 0, x + 90, 100).exterior) for x in (0, 100, 200)]
    world = import_map(geojson(tmp_path, *rooms), ImportOptions(bounds="box", wall_mm=4.0))
    assert "of the free area cannot be reached from the start: --start" in notes_of(world)


UTM, MERCATOR = "urn:ogc:def:crs:EPSG::25832", "urn:ogc:def:crs:EPSG::3857"


def test_lengths_of_a_named_system_have_its_unit(tmp_path):
    pytest.importorskip("pyproj")
    there = shapely.affinity.translate(box(0, 0, 40, 30), 691000.0, 5335000.0)
    world = import_map(geojson(tmp_path, there, system=UTM), ImportOptions())
    assert world.size_mm == pytest.approx((40_000.0, 30_000.0))
    assert world.facts["unit"].startswith("metre, as the file says (EPSG:25832): 40 x 30, 1000 mm")


def test_web_mercator_is_divided_by_its_stretch(tmp_path):
    pytest.importorskip("pyproj")
    there = shapely.affinity.translate(box(0, 0, 40, 30), 1_280_000.0, 6_125_000.0)
    world = import_map(geojson(tmp_path, there, system=MERCATOR), ImportOptions())
    radius = 6_378_137.0  # of the sphere that the projection takes
    latitude = 2.0 * np.arctan(np.exp(6_125_015.0 / radius)) - 0.5 * np.pi
    assert world.size_mm[0] == pytest.approx(40_000.0 * np.cos(latitude), rel=1e-4)
    assert "times too long at latitude 48.109" in world.facts["unit"]
    given = ImportOptions(scale_mm_per_unit=10.0)
    assert import_map(tmp_path / "plan.geojson", given).size_mm == pytest.approx((400.0, 300.0))


@pytest.mark.parametrize(
    ("system", "words"),
    [
        ("urn:ogc:def:crs:EPSG::4258", "is in degrees.*EPSG:32632"),
        ("urn:ogc:def:crs:OGC:1.3:CRS84", "is in degrees"),
        ("EPSG:4087", "stretches this place 50 %"),
        ("EPSG:999999", "is unknown; give --scale-mm-per-unit"),
        (None, "longitude and latitude.*EPSG:32632.*--scale-mm-per-unit"),
    ],
)
def test_what_is_no_length_is_refused_with_the_projection_to_use(tmp_path, system, words):
    pytest.importorskip("pyproj")
    place = (11.5, 48.1) if system != "EPSG:4087" else (1_280_000.0, 5_355_000.0)
    there = shapely.affinity.translate(box(0, 0, 0.02, 0.015), *place)
    with pytest.raises(UnfitInputError, match=words):
        import_map(geojson(tmp_path, there, system=system), ImportOptions())


def test_a_text_sequence_is_one_collection(tmp_path):
    features = [
        {"type": "Feature", "properties": {}, "geometry": mapping(one)} for one in (CARD, TABLE)
    ]
    path = tmp_path / "lines.geojson"
    for begin in ("", "\x1e"):
        path.write_text("".join(f"{begin}{json.dumps(one)}\n" for one in features))
        world = import_map(path, ImportOptions())
        assert world.free_space.area == pytest.approx(CARD.area - TABLE.area)
        assert "text sequence: 2 records" in notes_of(world)


def test_a_surface_of_triangles_is_named(tmp_path):
    path = tmp_path / "tin.geojson"
    path.write_text('{"type": "TIN", "coordinates": [[[[0,0,1],[9,0,1],[0,9,2],[0,0,1]]]]}')
    with pytest.raises(UnfitInputError, match=r"triangles \(TIN\).*ogr2ogr -nlt MULTIPOLYGON"):
        import_map(path, ImportOptions())


def test_decimal_commas_between_semicolons_are_numbers(tmp_path):
    path = tmp_path / "plan.csv"
    rows = [("Raum", x, y) for x, y in ((0, 0), (400.5, 0), (400.5, 300), (0, 300))]
    lines = [f"{name};{x};{y}".replace(".", ",") for name, x, y in rows]
    path.write_text("\n".join(["Polygon;X;Y", *lines]))
    world = import_map(path, ImportOptions())
    assert world.size_mm == pytest.approx((400.5, 300.0))
    assert world.facts["unit_known_by"] == "guess"
    path.write_text("x,y\n0,0,0,0\n")
    with pytest.raises(BadInputError, match="decimal commas need columns separated by ;"):
        import_map(path, ImportOptions())
