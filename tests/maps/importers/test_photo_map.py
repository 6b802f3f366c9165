"""Maps of photos and scans; the photos are rendered, so the truth is known."""

import numpy as np
import pytest
import shapely
from PIL import Image, ImageDraw, ImageFilter
from shapely import affinity, box

import vinefab as vf
from tests.photos.conftest import TrueCamera
from tests.photos.measure_walls import photo_of_bricks
from vinefab.cli.main import main
from vinefab.core.errors import BadInputError
from vinefab.core.hashing import sha256_of
from vinefab.maps.importers import photo_map
from vinefab.maps.importers.import_options import ImportOptions, PhotoOptions
from vinefab.maps.importers.importers import import_map
from vinefab.maps.importers.photo_map import read_photo_map
from vinefab.model.inputs import POINTS
from vinefab.model.map import Map, corner_markers
from vinefab.pages.panel import Raster, Shape
from vinefab.pages.plan import photo_preview
from vinefab.photos.found_markers import measured_markers
from vinefab.photos.photo import projected

TABLE = Map(name="table", bounds=box(0.0, 0.0, 400.0, 300.0), obstacles=())
BRICKS = (
    affinity.rotate(box(60.0, 50.0, 130.0, 90.0), 20.0),
    affinity.rotate(box(250.0, 180.0, 300.0, 240.0), -35.0),
    # So near to each other that the side of one leans over to where the other's top is seen.
    box(280.0, 40.0, 310.0, 100.0),
    box(323.0, 40.0, 353.0, 100.0),
)
HEIGHT_MM = 25.0
CAMERA = TrueCamera(target_mm=(200.0, 150.0), distance_mm=800.0, focal_px=665.0, size_px=(756, 567))
SHIFT = (-42.0, -42.0)
"""From a map of four markers, whose origin is the first marker's corner, to the table's."""


@pytest.fixture(scope="module")
def table(tmp_path_factory):
    """Return a photo of dark bricks on a light table with markers around."""
    markers = corner_markers(TABLE)
    picture = photo_of_bricks(CAMERA, TABLE.bounds, markers, BRICKS, HEIGHT_MM)
    path = tmp_path_factory.mktemp("photo") / "table.jpg"
    exif = Image.Exif()
    exif.get_ifd(0x8769)[0xA405] = 30  # focal length for film of 36 x 24 mm: truly 30.4
    picture.save(path, quality=88, exif=exif)
    return path


@pytest.fixture(scope="module")
def found(table):
    """Return what is read from the photo of the table, by its markers and its bricks' height."""
    options = ImportOptions(photo=PhotoOptions(marker_mm=30.0, height_mm=HEIGHT_MM))
    return read_photo_map(table, options)


@pytest.fixture(autouse=True)
def _markers_once(monkeypatch):
    """Measure the markers of one photo once."""
    monkeypatch.setattr(photo_map, "measured_markers", measured)


KNOWN = {}


def measured(photo):
    key = sha256_of(photo.pixels.tobytes())
    if key not in KNOWN:
        KNOWN[key] = measured_markers(photo)
    return KNOWN[key]


def imported(path, least_mm2=None, **photo):
    return import_map(
        path, ImportOptions(photo=PhotoOptions(**photo), least_obstacle_mm2=least_mm2)
    )


def off_mm(world, shift=(0.0, 0.0)):
    """Return the largest distance between the walls of each brick and those imported."""
    moved = [affinity.translate(obstacle, *shift) for obstacle in world.obstacles]
    assert len(moved) == len(BRICKS)
    nearest = [min(moved, key=brick.distance) for brick in BRICKS]
    return [
        shapely.hausdorff_distance(found.exterior, brick.exterior, densify=0.02)
        for found, brick in zip(nearest, BRICKS, strict=True)
    ]


def test_bricks_with_markers_around_have_their_walls_within_a_millimetre(found):
    world = found.world
    assert max(off_mm(world, SHIFT)) < 1.3
    assert world.environment == "photo"
    assert world.facts["markers"] == [0, 1, 2, 3]
    assert world.size_mm == pytest.approx((484.0, 384.0), abs=1.5)


@pytest.mark.thorough
def test_without_their_height_bricks_lean(table):
    world = imported(table, marker_mm=30.0)
    assert max(off_mm(world, SHIFT)) > 5.0
    assert "--height-mm" in world.facts["parallax_mm_per_mm_of_height"]


def test_four_corners_of_a_rectangle_give_the_perspective(table):
    corners = projected(CAMERA.homography(), np.array([(0, 0), (400, 0), (400, 300), (0, 300)]))
    world = imported(
        table,
        points_px=tuple(map(tuple, corners.tolist())),
        rectangle_mm=(400.0, 300.0),
        height_mm=HEIGHT_MM,
    )
    assert world.bounds.equals(box(0.0, 0.0, 400.0, 300.0)) or (
        shapely.hausdorff_distance(world.bounds, box(0.0, 0.0, 400.0, 300.0)) < 0.5
    )
    assert max(off_mm(world)) < 1.2


def test_obstacles_may_be_told_by_their_colour(table):
    options = {"marker_mm": 30.0, "height_mm": HEIGHT_MM}
    world = imported(table, obstacles="60,40,40,70", **options)
    assert max(off_mm(world, SHIFT)) < 2.0  # the tolerance says where a wall is, not half the light
    assert world.facts["threshold"] is None


@pytest.mark.thorough
def test_a_crop_keeps_its_place_also_where_it_is_looked_at_in_parts(table, monkeypatch):
    options = {"marker_mm": 30.0, "height_mm": HEIGHT_MM, "crop_mm": (50.0, 60.0, 220.0, 200.0)}
    world = imported(table, **options)
    monkeypatch.setattr(photo_map, "_TILE", 37)
    in_parts = imported(table, **options)
    assert (in_parts.obstacles, in_parts.facts) == (world.obstacles, world.facts)
    assert world.bounds.bounds == pytest.approx((50.0, 60.0, 220.0, 200.0), abs=1.0)
    (brick,) = world.obstacles
    moved = affinity.translate(brick, *SHIFT)
    assert moved.intersection(BRICKS[0]).area > 0.95 * BRICKS[0].union(moved).area


def test_one_marker_is_enough(table, tmp_path):
    pixels = np.asarray(Image.open(table)).copy()
    for marker in corner_markers(TABLE)[1:]:
        column, row = projected(CAMERA.homography(), marker.corners_mm).mean(axis=0).astype(int)
        pixels[row - 60 : row + 60, column - 60 : column + 60] = 205
    path = tmp_path / "one.png"
    Image.fromarray(pixels).save(path)
    world = imported(path, marker_mm=30.0, crop_mm=(40.0, 40.0, 250.0, 200.0))
    assert world.facts["markers"] == [0]
    assert len(world.obstacles) == 1
    assert world.facts["shape_within_mm"] > 1.0  # far from one small square little is known


@pytest.mark.thorough
def test_a_picture_smoothed_by_software_keeps_its_scale_within_what_is_stated(table, tmp_path):
    blur_px = 1.2
    path = tmp_path / "soft.jpg"
    with Image.open(table) as picture:
        soft = picture.filter(ImageFilter.GaussianBlur(blur_px))
        soft.save(path, quality=85, exif=picture.getexif())
    world = imported(path, marker_mm=30.0, height_mm=HEIGHT_MM)
    assert world.size_mm == pytest.approx((484.0, 384.0), rel=0.003)
    assert max(off_mm(world, SHIFT)) < world.facts["shape_within_mm"] < 6.0
    assert world.facts["blur_px"] > blur_px
    assert sum(len(one.exterior.coords) - 1 for one in world.obstacles) <= 7 * len(BRICKS)


def test_a_photo_too_blurred_for_a_scale_is_refused(table, tmp_path):
    path = tmp_path / "soft.png"
    with Image.open(table) as picture:
        picture.filter(ImageFilter.GaussianBlur(1.9)).save(path)
    with pytest.raises(BadInputError, match=r"sharper or nearer photo|seen whole and sharp"):
        imported(path, marker_mm=30.0)


def test_the_distance_of_two_markers_gives_the_scale(table):
    true_mm = 400.0 + 2 * (12.0 + 15.0)
    world = imported(table, marker_mm=30.0, height_mm=HEIGHT_MM, distance_mm=true_mm)
    assert world.size_mm == pytest.approx((484.0, 384.0), abs=0.5)
    assert max(off_mm(world, SHIFT)) < world.facts["shape_within_mm"] < 3.0
    assert world.facts["scale_by"] == "the distance of two markers"


REFUSED = {
    "fewer markers": (
        {"marker_count": 5},
        r"markers in the photo: there are 4 \(number 0, 1, 2, 3\)",
    ),
    "too large": (
        {"crop_mm": (0.0, 0.0, 3400.0, 90.0)},
        "it is 3400 mm wide, and markers of 30 mm",
    ),
    "nothing there": ({"obstacles": "0,0,255,5"}, "no obstacles are seen in the photo"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_what_gives_no_map_is_refused(table, case):
    given, words = REFUSED[case]
    with pytest.raises(BadInputError, match=words):
        imported(table, marker_mm=30.0, **given)


def ink(size=(600, 400)):
    page = Image.new("L", size, 250)
    return page, ImageDraw.Draw(page)


def test_a_scan_takes_its_scale_from_two_points(tmp_path):
    page, pen = ink()
    pen.rectangle((100, 100, 199, 149), fill=10)
    page.save(tmp_path / "scan.png")
    world = imported(
        tmp_path / "scan.png", points_px=((100.0, 100.0), (200.0, 100.0)), distance_mm=50.0
    )
    assert world.size_mm == (300.0, 200.0)
    assert world.obstacles[0].equals(box(50.0, 125.0, 100.0, 150.0))
    by_pixel = import_map(tmp_path / "scan.png", ImportOptions(scale_mm_per_unit=0.5))
    assert by_pixel.obstacles[0].equals(world.obstacles[0])


def test_specks_are_left_out_and_counted(tmp_path):
    page, pen = ink()
    pen.rectangle((100, 100, 199, 149), fill=10)
    for place in range(20, 580, 40):
        pen.rectangle((place, 300, place + 2, 302), fill=10)
    page.save(tmp_path / "scan.png")
    scale = {"points_px": ((0.0, 0.0), (600.0, 0.0)), "distance_mm": 600.0}
    world = imported(tmp_path / "scan.png", **scale)
    assert len(world.obstacles) == 1
    assert world.facts["obstacles_left_out"] == 14
    assert len(imported(tmp_path / "scan.png", least_mm2=0.0, **scale).obstacles) == 15


def test_light_obstacles_and_a_threshold_of_ones_own(tmp_path):
    page, pen = ink()
    pen.rectangle((0, 0, 600, 400), fill=40)
    pen.rectangle((100, 100, 199, 149), fill=200)
    pen.rectangle((300, 100, 399, 149), fill=90)
    page.save(tmp_path / "scan.png")
    scale = {"points_px": ((0.0, 0.0), (600.0, 0.0)), "distance_mm": 600.0}
    assert len(imported(tmp_path / "scan.png", obstacles="light", **scale).obstacles) == 1
    both = imported(tmp_path / "scan.png", obstacles="light", threshold=65.0, **scale)
    assert len(both.obstacles) == 2


def test_a_picture_of_one_tone_asks_for_a_threshold(tmp_path):
    ink()[0].save(tmp_path / "scan.png")
    with pytest.raises(BadInputError, match="--threshold 0 to 255"):
        import_map(tmp_path / "scan.png", ImportOptions(scale_mm_per_unit=1.0))


def test_a_height_without_a_camera_is_refused(tmp_path):
    page, _ = ink()
    page.save(tmp_path / "scan.png")
    with pytest.raises(BadInputError, match=r"height_mm needs .*focal length"):
        imported(tmp_path / "scan.png", points_px=((0, 0), (9, 0)), distance_mm=9.0, height_mm=9.0)


WRONG = {
    "no scale": ({}, r"scale of the photo is missing; give --points 'X,Y;X,Y'"),
    "two scales": ({"scale_mm_per_unit": 1.0, "marker_mm": 9.0}, "given together with marker_mm"),
    "points alone": (
        {"points_px": ((0, 0), (1, 1))},
        "2 points are given with nothing; .*--distance-mm",
    ),
    "three points": ({"points_px": ((0, 0), (1, 1), (2, 0))}, "two, or the four"),
    "points of the wrong kind": (
        {"points_px": ((0, 0), (1, 1)), "rectangle_mm": (1.0, 1.0)},
        "2 points are given with rectangle-mm; give them with --distance-mm",
    ),
    "a distance alone": ({"distance_mm": 9.0}, "give two --points"),
    "a rectangle alone": ({"rectangle_mm": (9.0, 9.0)}, "give four --points"),
    "points at one place": ({"points_px": ((5, 5), (5, 6)), "distance_mm": 9.0}, "pixels apart"),
    "corners the wrong way round": (
        {"points_px": ((0, 0), (9, 0), (9, 9), (0, 9)), "rectangle_mm": (9.0, 9.0)},
        "do not run counter-clockwise from the lower left",
    ),
    "a colour unheard of": ({"obstacles": "pink"}, "dark, light, or a colour R,G,B"),
    "a threshold of a colour": ({"obstacles": "1,2,3", "threshold": 9.0}, "TOLERANCE"),
    "no marker": ({"marker_mm": 9.0}, "there are none; show one or more ArUco"),
    "an empty crop": (
        {"points_px": ((0, 0), (9, 0)), "distance_mm": 9.0, "crop_mm": (5.0, 0.0, 1.0, 9.0)},
        "LEFT,LOW,RIGHT,TOP",
    ),
    "another format's option": ({"wall_mm": 3.0}, "wall_mm means nothing for a photo"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_options_say_what_is_allowed(tmp_path, case):
    given, words = WRONG[case]
    path = tmp_path / "scan.png"
    ink()[0].save(path)
    ours = {key: given[key] for key in given if key not in ("scale_mm_per_unit", "wall_mm")}
    others = {key: given[key] for key in given if key not in ours}
    with pytest.raises(BadInputError, match=words) as caught:
        import_map(path, ImportOptions(photo=PhotoOptions(**ours), **others))
    assert "\n" not in str(caught.value)


def test_options_of_photos_are_refused_for_drawings(tmp_path):
    with pytest.raises(BadInputError, match=r"plan\.svg: marker_mm is for photos and scans"):
        imported(tmp_path / "plan.svg", marker_mm=9.0)


@pytest.mark.parametrize("text", ["", "1,2;", "1;2", "1,2,3", "1,nan", "a,b"])
def test_points_that_are_none_are_refused(text):
    with pytest.raises(BadInputError, match="points"):
        PhotoOptions(points_px=POINTS.read(text))


def test_the_preview_shows_the_photo_and_its_walls(found):
    assert found.markers_mm.shape == (4, 4, 2)
    (panel,) = photo_preview(found).panels
    kinds = [type(primitive) for primitive in panel.primitives]
    assert kinds.count(Raster) == 1
    outlines = [one for one in panel.primitives if isinstance(one, Shape) and one.closed]
    assert len(outlines) == 2
    assert f"{len(BRICKS)} obstacles" in panel.title


def test_the_command_writes_map_and_preview(tmp_path, capsys):
    page, pen = ink()
    pen.rectangle((100, 100, 199, 149), fill=10)
    page.save(tmp_path / "scan.png")
    out, preview = tmp_path / "arena.geojson", tmp_path / "preview.png"
    words = ["map", "import", str(tmp_path / "scan.png"), "--scale-mm-per-unit", "0.5"]
    assert main([*words, "--out", str(out), "--preview", str(preview)]) == 0
    assert f"wrote {preview}" in capsys.readouterr().out
    assert len(Map.read(out).obstacles) == 1
    with Image.open(preview) as picture:
        assert picture.width > 500


def test_a_preview_of_a_drawing_is_refused(tmp_path, capsys):
    words = ["map", "import", "plan.svg", "--out", str(tmp_path / "a.geojson")]
    assert main([*words, "--preview", str(tmp_path / "a.png")]) == 2
    assert "preview is for photos and scans" in capsys.readouterr().err


def test_python_takes_the_options_of_a_photo_as_a_table(tmp_path):
    page, pen = ink()
    pen.rectangle((100, 100, 199, 149), fill=10)
    page.save(tmp_path / "scan.png")
    scale = {"points_px": ((0, 0), (600, 0)), "distance_mm": 300.0}
    assert vf.maps.import_(tmp_path / "scan.png", photo=scale).size_mm == (300.0, 200.0)
    with pytest.raises(
        BadInputError, match=r"photo\.point: there is no such option; did you mean 'points_px'"
    ):
        vf.maps.import_(tmp_path / "scan.png", photo={"point": ((0, 0), (600, 0))})
    with pytest.raises(BadInputError, match="photo is 3; allowed: PhotoOptions"):
        vf.maps.import_(tmp_path / "scan.png", photo=3)
