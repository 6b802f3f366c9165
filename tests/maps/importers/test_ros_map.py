import math
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import shapely
from PIL import Image
from shapely import Point, Polygon

from vinefab.core.errors import BadInputError, UnreadableFileError
from vinefab.core.hashing import sha256_of_file
from vinefab.maps.cleanup import raster
from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.importers.ros_map import import_ros
from vinefab.model.map import Map

FREE, UNKNOWN, OCCUPIED = 254, 205, 0
Import = Callable[..., Map]


def yaml_text(**changes: Any) -> str:
    values = {
        "image": "world.pgm",
        "resolution": 0.05,
        "origin": "[-1.0, 2.0, 0.0]",
        "negate": 0,
        "occupied_thresh": 0.65,
        "free_thresh": 0.196,
        **changes,
    }
    return "".join(f"{key}: {value}\n" for key, value in values.items() if value is not None)


def box_world() -> np.ndarray:
    """Return an image: a free room of 10 x 6 cells, a block at its upper left, unknown around."""
    pixels = np.full((12, 16), UNKNOWN, dtype=np.uint8)
    pixels[2:10, 2:14] = OCCUPIED
    pixels[3:9, 3:13] = FREE
    pixels[4:6, 4:7] = OCCUPIED
    return pixels


@pytest.fixture
def importing(tmp_path: Path) -> Import:
    def run(picture: Any, options: ImportOptions | None = None, **changes: Any) -> Map:
        name = str(changes.get("image", "world.pgm"))
        if isinstance(picture, bytes):
            (tmp_path / name).write_bytes(picture)
        elif picture is not None:
            image = picture if isinstance(picture, Image.Image) else Image.fromarray(picture)
            image.save(tmp_path / name)
        (tmp_path / "world.yaml").write_text(yaml_text(**changes), encoding="utf-8")
        return import_ros(tmp_path / "world.yaml", options or ImportOptions())

    return run


def test_the_first_row_is_the_top_and_the_origin_the_lower_left_corner(
    importing: Import, tmp_path: Path
) -> None:
    world = importing(box_world())
    # The room: columns 3 to 13, rows 3 to 9 from the top of 12, so 3 to 9 from below.
    assert world.bounds.equals(shapely.box(-850, 2150, -350, 2450))
    (block,) = world.obstacles
    assert block.equals(shapely.box(-800, 2300, -650, 2400))
    assert (world.environment, world.seed, world.name) == ("ros", None, "world")
    facts = world.facts
    assert facts["cells"] == [16, 12]
    assert (facts["cells_free"], facts["cells_occupied"], facts["cells_unknown"]) == (54, 42, 96)
    assert facts["image_sha256"] == sha256_of_file(tmp_path / "world.pgm")
    assert facts["simplify_mm"] == 50.0


def test_a_table_top_is_the_same_world_scaled(importing: Import) -> None:
    small = importing(box_world(), ImportOptions(scale_mm_per_unit=50.0))
    assert small.bounds.equals(shapely.box(-42.5, 107.5, -17.5, 122.5))
    assert small.facts["simplify_mm"] == 2.5


def test_yaw_turns_the_map_about_its_origin(importing: Import) -> None:
    world = importing(box_world(), origin=f"[-1.0, 2.0, {math.pi / 2}]")
    assert world.bounds.equals(shapely.box(-1450, 2150, -1150, 2650))
    slanted = importing(box_world(), origin="[-1.0, 2.0, 0.3]")
    straight = shapely.box(-850, 2150, -350, 2450)
    expected = shapely.affinity.rotate(straight, 0.3, origin=(-1000, 2000), use_radians=True)
    assert slanted.bounds.symmetric_difference(expected).area < 1.0


def test_negated_images_mean_the_same(importing: Import) -> None:
    pixels = 255 - box_world()
    plain, negated = importing(box_world()), importing(pixels, negate=1)
    assert negated.free_space.equals(plain.free_space)
    assert importing(pixels, negate="true").free_space.equals(plain.free_space)


def test_thresholds_are_strict_as_ros_has_them(importing: Import) -> None:
    row = np.array([[0, 102, 103, 153, 154, 254]], dtype=np.uint8)
    pixels = np.vstack([np.full((1, 6), 254, dtype=np.uint8), row])
    # 102 is p = 0.6 exactly, 153 is p = 0.4 exactly: neither above nor below.
    facts = importing(pixels, occupied_thresh=0.6, free_thresh=0.4).facts
    assert (facts["cells_occupied"], facts["cells_unknown"], facts["cells_free"]) == (1, 3, 8)


def test_unknown_cells_can_count_as_free(importing: Import) -> None:
    pixels = np.full((9, 12), UNKNOWN, dtype=np.uint8)
    pixels[4, 5] = FREE
    pixels[2, 2:4] = OCCUPIED
    assert importing(pixels).bounds.area == pytest.approx(2500)
    world = importing(pixels, ImportOptions(unknown="free"))
    assert world.bounds.equals(shapely.box(-1000, 2000, -400, 2450))
    assert len(world.obstacles) == 1


def test_plain_and_deep_and_binary_pgm_read_alike(importing: Import) -> None:
    pixels = box_world()
    expected = importing(pixels).free_space
    rows = "\n".join(" ".join(map(str, row)) for row in pixels)
    plain = f"P2\n# made by hand\n16 12\n255\n{rows}\n".encode()
    assert importing(plain).free_space.equals(expected)
    deep = b"P5 16 12 65535\n" + (pixels.astype(">u2") * 257).tobytes()
    assert importing(deep).free_space.equals(expected)
    coarse = b"P5 16 12 5\n" + (pixels // 51).astype(np.uint8).tobytes()
    facts = importing(coarse, free_thresh=0.25, occupied_thresh=0.9).facts
    assert (facts["cells_occupied"], facts["cells_free"]) == (42, 54 + 96)


def test_png_in_grey_colour_and_palette_read_alike(importing: Import) -> None:
    expected = importing(box_world()).free_space
    grey = Image.fromarray(box_world())
    for mode in ("L", "RGB", "P", "RGBA", "LA"):
        world = importing(grey.convert(mode), image="w.png", free_thresh=0.1)
        assert world.free_space.equals(expected), mode


def test_alpha_is_a_fourth_colour_in_trinary_and_unknown_in_scale(importing: Import) -> None:
    alpha = np.full((12, 16), 255, dtype=np.uint8)
    alpha[3:9, 8:13] = 0
    pixels = np.dstack([box_world()] * 3 + [alpha])
    # Free and transparent: (3 * 254 + 0) / 4 = 190.5, p = 0.25. Unknown and opaque: p = 0.15.
    assert importing(pixels, image="w.png", free_thresh=0.1).facts["cells_free"] == 24
    assert importing(pixels, image="w.png", free_thresh=0.2).facts["cells_free"] == 24 + 96
    assert importing(pixels, image="w.png", free_thresh=0.3).facts["cells_free"] == 54 + 96
    scale = importing(pixels, image="w.png", free_thresh=0.1, mode="scale").facts
    assert (scale["cells_free"], scale["cells_unknown"]) == (24, 96 + 30)


def test_raw_values_are_percent(importing: Import) -> None:
    pixels = np.array([[0, 19, 20, 65, 66, 100, 101, 255]], dtype=np.uint8)
    facts = importing(pixels, mode="raw", free_thresh=0.2, negate=1).facts
    assert (facts["cells_free"], facts["cells_occupied"], facts["cells_unknown"]) == (2, 2, 4)


def ring_world(cells: int = 160) -> tuple[np.ndarray, Polygon, list[Point]]:
    """Return a lidar-like map: a hexagon of thin walls, round pillars that are hollow inside."""
    angles = np.radians(12 + 60 * np.arange(6))
    middle, radius = cells / 2, 0.42 * cells
    room = Polygon(middle + radius * np.column_stack([np.cos(angles), np.sin(angles)]))
    pillars = [
        Point(middle + x * cells / 6, middle + y * cells / 6)
        for x in (-1, 0, 1)
        for y in (-1, 0, 1)
    ]
    x, y = (grid.ravel() for grid in np.meshgrid(np.arange(cells) + 0.5, np.arange(cells) + 0.5))
    spots = shapely.points(x, y)
    pixels = np.full(cells * cells, UNKNOWN, dtype=np.uint8)
    pixels[shapely.contains(room, spots)] = FREE
    pixels[shapely.distance(room.exterior, spots) < 0.8] = OCCUPIED
    for pillar in pillars:
        off = shapely.distance(pillar, spots)
        pixels[off < 5.0] = UNKNOWN
        pixels[np.abs(off - 4.2) < 0.8] = OCCUPIED
    return pixels.reshape(cells, cells)[::-1], room, pillars


def test_a_ring_shaped_world_comes_out_clean(importing: Import) -> None:
    pixels, room, pillars = ring_world()
    world = importing(pixels, origin="[0, 0, 0]")
    room_mm = shapely.transform(room.buffer(-0.8, join_style="mitre"), lambda xy: xy * 50)
    assert len(world.bounds.exterior.coords) - 1 <= 9
    assert world.bounds.symmetric_difference(room_mm).area < 0.01 * room_mm.area
    assert len(world.obstacles) == len(pillars)
    for obstacle in world.obstacles:
        assert 6 <= len(obstacle.exterior.coords) - 1 <= 16
        assert obstacle.area == pytest.approx(math.pi * 250**2, rel=0.08)
        assert 4 * math.pi * obstacle.area / obstacle.length**2 > 0.9
        centre = shapely.points(obstacle.centroid.x / 50, obstacle.centroid.y / 50)
        assert min(centre.distance(pillar) for pillar in pillars) < 0.4
    assert world.facts["deviation_mm"] <= 50.0


def test_a_given_tolerance_is_kept_and_saves_walls(importing: Import) -> None:
    pixels, _, _ = ring_world()
    fine = importing(pixels, ImportOptions(simplify_mm=38.0))
    coarse = importing(pixels, ImportOptions(simplify_mm=150.0))
    assert fine.facts["deviation_mm"] <= 38.0
    assert coarse.facts["deviation_mm"] <= 150.0
    assert coarse.wall_count < fine.wall_count


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"resolution": None}, "resolution is missing"),
        ({"resolution": 0}, "resolution is 0.0"),
        ({"resolution": -0.05}, "resolution"),
        ({"resolution": ".nan"}, "resolution is nan"),
        ({"resolution": "fine"}, "resolution is 'fine'; allowed: a number"),
        ({"origin": "[0, 0]"}, r"origin is \[0, 0\]; allowed: \[x, y, yaw\]"),
        ({"origin": "[0, here, 0]"}, "origin is 'here'"),
        ({"origin": "[1e300, 0, 0]"}, "origin"),
        ({"negate": 2}, "negate is 2; allowed: 0 or 1"),
        ({"negate": None}, "negate is missing"),
        ({"occupied_thresh": 1.5}, "occupied_thresh"),
        ({"free_thresh": 0.7}, "free_thresh is 0.7; allowed: 0 to 0.65"),
        ({"mode": "binary"}, "mode is 'binary'; allowed: trinary, scale, raw"),
        ({"image": None}, "image is missing"),
    ],
)
def test_bad_values_name_file_and_key(
    importing: Import, changes: dict[str, Any], message: str
) -> None:
    with pytest.raises(BadInputError, match=message) as caught:
        importing(None, **changes)
    assert "world.yaml" in str(caught.value)


def test_numbers_that_yaml_takes_for_words_are_numbers(importing: Import) -> None:
    assert importing(box_world(), resolution="5e-2").bounds.area == pytest.approx(500 * 300)


def test_a_scale_that_leaves_nothing_of_a_cell_is_named(importing: Import) -> None:
    with pytest.raises(BadInputError, match=r"scale_mm_per_unit is 1e-09"):
        importing(box_world(), ImportOptions(scale_mm_per_unit=1e-9))


def test_other_problems_are_one_clear_line(importing: Import, tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match=r"there is no .gone.pgm.; put gone.pgm next to world"):
        importing(None, image="gone.pgm")
    with pytest.raises(UnreadableFileError, match="is not an image"):
        importing(b"P5 16 12 255\nshort")
    with pytest.raises(UnreadableFileError, match="is not an image"):
        importing(b"hello")
    with pytest.raises(UnreadableFileError, match="pixels of kind CMYK"):
        importing(Image.new("CMYK", (4, 4)), image="w.tif")
    with pytest.raises(UnreadableFileError, match="89 million"):
        importing(b"P5 20000 20000 255\n")
    with pytest.raises(BadInputError, match="no free cell"):
        importing(np.full((5, 5), UNKNOWN, dtype=np.uint8))
    with pytest.raises(BadInputError, match=r"simplify_mm is 20.*at least 37.5 mm"):
        importing(box_world(), ImportOptions(simplify_mm=20.0))
    for text, problem in (("- 1\n", "not a ROS map"), ("a: [", "not YAML"), ("\tx", "not YAML")):
        (tmp_path / "bad.yaml").write_text(text, encoding="utf-8")
        with pytest.raises(UnreadableFileError, match=problem) as caught:
            import_ros(tmp_path / "bad.yaml", ImportOptions())
        assert "bad.yaml" in str(caught.value)


@pytest.mark.parametrize(
    ("options", "key"),
    [
        ({"scale_mm_per_unit": 0.0}, "scale_mm_per_unit"),
        ({"scale_mm_per_unit": math.inf}, "scale_mm_per_unit"),
        ({"unknown": "maybe"}, "unknown"),
    ],
)
def test_bad_import_options_name_the_option(
    importing: Import, options: dict[str, Any], key: str
) -> None:
    with pytest.raises(BadInputError) as caught:
        importing(box_world(), ImportOptions(**options))
    assert caught.value.key == key


def noisy_room(cells: int, share: float) -> np.ndarray:
    """Return an image: a free room in which a share of the cells, drawn at random, is occupied."""
    pixels = np.full((cells, cells), FREE, dtype=np.uint8)
    pixels[np.random.default_rng(1).random(pixels.shape) < share] = OCCUPIED
    return pixels


def test_noise_is_refused_at_once_and_can_be_left_out(
    importing: Import, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(raster, "MANY_EDGES", 3_000)
    monkeypatch.setattr(raster, "MOST_OBSTACLES", 100)
    with monkeypatch.context() as patch:
        patch.setattr(raster, "straighten", None)
        with pytest.raises(BadInputError, match=r"obstacles with .* as of noise.*least-obstacle"):
            importing(noisy_room(100, 0.3))
    world = importing(noisy_room(100, 0.3), ImportOptions(least_obstacle_mm2=40 * 50.0**2))
    assert 0 < len(world.obstacles) < 100
    assert world.facts["obstacles_left_out"] > 100


def test_a_large_image_takes_few_bytes_per_cell() -> None:
    free = np.ones((1000, 1000), dtype=np.bool_)
    placement = raster.GridPlacement(cell_mm=10.0)
    tracemalloc.start()
    raster.raster_map("large", free, placement, ImportOptions(), {})
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 9 * free.size


def test_what_yaml_says_in_two_lines_is_one(tmp_path: Path) -> None:
    path = tmp_path / "world.yaml"
    path.write_bytes(b"image: world.pgm\nres\x00olution: 0.05\n")
    with pytest.raises(UnreadableFileError, match="is not YAML: unacceptable character") as caught:
        import_ros(path, ImportOptions())
    assert "\n" not in str(caught.value)
