import json
import subprocess

import pytest
import shapely

from vinefab.core.errors import BadInputError, UnreadableFileError
from vinefab.maps.generators.cave import cave_map
from vinefab.maps.generators.grid import grid_map
from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.importers.importers import import_map
from vinefab.model.map import Map, Pose, map_text

ROOM = [[0, 0], [300, 0], [300, 200], [0, 200], [0, 0]]


def ring(x, y, size, step=0):
    return [[x, y], [x + size, y], [x + size, y + size], [x, y + size], [x, y]][: 5 - step]


def polygon(*rings):
    return {"type": "Polygon", "coordinates": list(rings)}


def line(*points):
    return {"type": "LineString", "coordinates": [list(point) for point in points]}


def features(*geometries):
    return {
        "type": "FeatureCollection",
        "features": [{"type": "Feature", "properties": None, "geometry": g} for g in geometries],
    }


@pytest.fixture
def reading(tmp_path):
    def read(document, **options):
        path = tmp_path / "site.geojson"
        path.write_text(document if isinstance(document, str) else json.dumps(document))
        return import_map(path, ImportOptions(**options))

    return read


def test_a_dirty_file_is_cleaned_and_every_change_counted(reading):
    doubled = [ROOM[0], ROOM[1], ROOM[1], *ROOM[2:4]]
    world = reading(
        features(
            polygon(doubled),
            polygon(ring(20, 20, 40)),
            polygon(ring(50, 40, 40)),
            polygon(ring(50, 40, 40)[::-1]),
            polygon([[100, 20], [140, 60], [140, 20], [100, 60]]),
            line((160, 20), (200, 20), (200, 60)),
            line((160, 20.02), (160, 60), (199.97, 60)),
            polygon(ring(220, 20, 20)),
            polygon(ring(240.03, 20, 20)),
            polygon([[280, 20], [280.05, 20], [280.05, 20.05]]),
            polygon(ring(20, 100, 80), ring(40, 120, 40)),
            polygon(ring(50, 130, 10)),
            {"type": "Point", "coordinates": [1, 1]},
            None,
        )
    )
    assert world.bounds.area == 60_000
    areas = sorted(round(p.area, 1) for p in world.obstacles)
    assert areas == pytest.approx([100, 400, 400, 800.6, 1600, 3000, 4800], abs=1.0)
    counted = {
        "rings_closed": 3,
        "duplicate_points_removed": 1,
        "repeated_outlines_removed": 1,
        "self_crossings_repaired": 1,
        "gaps_joined": 2,
        "gaps_between_obstacles_closed": 1,
        "slivers_dropped": 1,
        "overlapping_obstacles_merged": 4,
    }
    assert {name: world.facts.get(name) for name in counted} == counted
    assert world.facts["largest_gap_joined_mm"] == pytest.approx(0.03, abs=0.01)


def test_a_map_of_ours_is_read_as_it_is(tmp_path):
    world = grid_map(2)
    path = tmp_path / "grid.geojson"
    path.write_text(map_text(world))
    again = import_map(path, ImportOptions())
    assert again.bounds == Map.read(path).bounds
    assert (again.environment, again.seed) == ("grid", 2)
    assert import_map(path, ImportOptions(scale_mm_per_unit=2.0)).size_mm == (1000, 1000)
    with pytest.raises(BadInputError, match=r"wall_mm means nothing for a map that vin"):
        import_map(path, ImportOptions(wall_mm=3.0))


@pytest.mark.parametrize("world", [grid_map(1), cave_map(1)], ids=["grid", "cave"])
def test_a_map_survives_another_program(tmp_path, program, world):
    ours, theirs = tmp_path / "ours.geojson", tmp_path / "theirs.geojson"
    ours.write_text(map_text(world))
    chosen = ["-where", "role <> 'start'", "-select", "", "-lco", "RFC7946=NO"]
    command = [program("ogr2ogr", "gdal-bin"), "-f", "GeoJSON", theirs, ours, *chosen]
    subprocess.run(command, check=True, capture_output=True, timeout=60)
    again = import_map(theirs, ImportOptions())
    assert (again.free_space ^ world.free_space).area < 1e-6
    assert len(again.obstacles) == len(world.obstacles)


def test_roles_and_bare_geometries(reading):
    document = features(polygon(ring(0, 0, 50)), polygon(ring(40, 40, 400)), line(*ring(5, 5, 9)))
    for feature, role in zip(document["features"], ("bounds", "obstacle", "obstacle"), strict=True):
        feature["properties"] = {"role": role}
    world = reading(document)
    assert world.bounds.area == 2500
    assert sorted(p.area for p in world.obstacles) == [81, 100]
    multi = {"type": "MultiPolygon", "coordinates": [[ROOM], [ring(9, 9, 5)]]}
    collection = {"type": "GeometryCollection", "geometries": [multi]}
    for document in (multi, collection, features(collection)["features"][0]):
        assert [p.area for p in reading(document).obstacles] == [25]


def test_bounds_by_choice(reading):
    pegs = features(*(polygon(ring(30 * k, 0, 10)) for k in range(4)))
    with pytest.raises(BadInputError, match=r"features\[2\] at \(35, 5\).*--bounds box"):
        reading(pegs)
    boxed = reading(pegs, bounds="box", margin_mm=20.0)
    assert boxed.bounds.bounds == (-20, -20, 120, 30)
    assert len(boxed.obstacles) == 4
    assert "rectangle around everything, 20 mm" in boxed.facts["bounds_are"]
    apart = features(polygon(ROOM), polygon(ring(10, 10, 20)), polygon(ring(280, 10, 60)))
    with pytest.raises(BadInputError, match="outside of the largest outline"):
        reading(apart)
    cut = reading(apart, bounds="largest")
    assert sorted(p.area for p in cut.obstacles) == [400, 1200]
    assert cut.facts["obstacles_cut_at_bounds"] == 1


def test_the_start(reading):
    document = features(polygon(ROOM), polygon(ring(10, 10, 100)))
    free = reading(document).starts[0].pose
    assert free.x_mm > 110
    given = Pose(x_mm=5.0, y_mm=5.0, heading_rad=1.0)
    assert reading(document, start=given).starts[0].pose == given
    with pytest.raises(BadInputError, match=r"start: \(50, 50\) mm lies outside"):
        reading(document, start=Pose(x_mm=50.0, y_mm=50.0, heading_rad=0.0))
    with pytest.raises(BadInputError, match="no free space"):
        reading(features(polygon(ROOM, ROOM), polygon(ring(-9, -9, 400))), bounds="wall")


def test_written_and_read_again(reading, tmp_path):
    world = reading(features(polygon(ROOM), polygon(ring(0.1, 1 / 3, 50), ring(9, 9, 1e-3))))
    path = tmp_path / "again.geojson"
    path.write_text(map_text(world))
    again = Map.read(path)
    assert shapely.equals(again.bounds, world.bounds)
    assert shapely.equals(again.obstacles, world.obstacles).all()
    assert world.facts["slivers_dropped"] == 1


@pytest.mark.parametrize(
    ("document", "message"),
    [
        ({"type": "FeatureCollection", "features": []}, "has no outlines"),
        ({"type": "FeatureCollection", "features": 3}, "features is 3"),
        ({"type": "FeatureCollection", "features": [3]}, r"features\[1\] is 3"),
        (features({"type": "Curve", "coordinates": []}), r"features\[1\].geometry.type is 'Curve'"),
        (features(polygon([[0, 0], [1, "x"]])), r"features\[1\] ring 1 position 2 is \[1, 'x'\]"),
        (features(line((0, 0), (9, 9))), r"features\[1\] from \(0, 0\) to \(9, 9\)"),
        (features(polygon([[0, 0], [1, 0]])), "no outlines but 1 without area"),
        (features({"type": "Point", "coordinates": [0, 0]}), "has no outlines"),
        ('{"type": "Polygon", "coordinates": [[[0, 0], [NaN, 1], [1, 1]]]}', "finite numbers"),
        ('{"type": "Polygon", "coordinates": [[[0, 0], [1e400, 1], [1, 1]]]}', "finite numbers"),
        (features(polygon(ring(0, 0, 1e9))), "1e[+]09 mm wide"),
        (features(polygon(ring(13.37, 52.5, 1e-4))), "degrees.*EPSG:32633.*--scale-mm-per-unit"),
        ("[1]", "type is missing"),
    ],
)
def test_bad_files_are_refused_in_one_line(reading, document, message):
    with pytest.raises(BadInputError, match=message) as caught:
        reading(document)
    assert "site.geojson" in str(caught.value)


@pytest.mark.parametrize("text", ["", "{", "[" * 100_000, "\0"])
def test_no_json(reading, text):
    with pytest.raises(UnreadableFileError, match="not JSON"):
        reading(text)


def test_options_that_mean_nothing_here_are_refused(reading):
    with pytest.raises(BadInputError, match="unknown means nothing for a GeoJSON"):
        reading(features(polygon(ROOM)), unknown="free")
    with pytest.raises(BadInputError, match="bounds is 'moon'; allowed: outline, largest, wall"):
        reading(features(polygon(ROOM)), bounds="moon")
    with pytest.raises(BadInputError, match="join_mm"):
        reading(features(polygon(ROOM)), join_mm=90.0)
