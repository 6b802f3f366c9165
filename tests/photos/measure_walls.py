"""Measure the walls read from rendered photos of bricks: ``python tests/photos/measure_walls.py``.

Each photo has 2 megapixels, another camera, brightness that falls off, soft shadows of 30 %, noise
of 4 of 255 and JPEG of quality 85. Bricks are 10 to 40 mm high; four markers lie around.
"""

import dataclasses
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import shapely
from PIL import Image, ImageDraw
from scipy import ndimage
from shapely import Polygon, affinity, box

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tests.photos.conftest import Floor, TrueCamera, light_of
from vinefab.maps.importers.import_options import ImportOptions, PhotoOptions
from vinefab.maps.importers.importers import import_map
from vinefab.model.map import CornerMarker, Map, corner_markers
from vinefab.photos.photo import projected

BRICK = (60, 40, 40)
TABLE = box(0.0, 0.0, 600.0, 450.0)


def photo_of_bricks(
    camera: TrueCamera,
    table: Polygon,
    markers: Sequence[CornerMarker],
    bricks: Sequence[Polygon],
    height_mm: float,
    seed: int = 0,
) -> Image.Image:
    """Return a photo of dark bricks on a light table with markers around."""
    rng = np.random.default_rng(seed)
    left, low, right, top = table.bounds
    floor = Floor.plain((left - 80.0, low - 80.0, right + 80.0, top + 80.0), 0.5)
    stains = rng.normal(0.0, 60.0, floor.pixels.shape[:2])
    floor.pixels += ndimage.gaussian_filter(stains, 6.0)[..., None]
    floor.paint(markers)
    floor.pixels *= 1.0 - 0.3 * _shadows(floor, bricks, height_mm)[..., None]
    columns, rows = camera.size_px
    large = dataclasses.replace(
        camera, focal_px=3 * camera.focal_px, size_px=(3 * columns, 3 * rows)
    )
    picture = Image.fromarray(floor.photographed(large, supersampling=1).pixels)
    pen = ImageDraw.Draw(picture)
    for brick in bricks:
        corners = np.array(brick.exterior.coords)
        for height in np.linspace(0.0, height_mm, max(2, round(2 * height_mm))):
            places = projected(large.homography(height), corners) - 0.5
            pen.polygon([tuple(place) for place in places], fill=BRICK)
    # A lens mixes light, and the camera stores its 2.2th root.
    light = light_of(picture)
    light = light.reshape(rows, 3, columns, 3, 3).mean(axis=(1, 3))
    row, column = np.mgrid[0:rows, 0:columns]
    aside = (column / columns - 0.55) ** 2 + (row / rows - 0.4) ** 2
    light = ndimage.gaussian_filter(light * (1.0 - aside)[..., None], (0.7, 0.7, 0.0))
    seen = 255.0 * light ** (1.0 / 2.2) + rng.normal(0.0, 4.0, light.shape)
    return Image.fromarray(np.clip(np.round(seen), 0, 255).astype(np.uint8))


def _shadows(floor: Floor, bricks: Sequence[Polygon], height_mm: float) -> np.ndarray:
    """Return soft shadows to the right and below."""
    mask = Image.new("L", floor.pixels.shape[1::-1], 0)
    for share in np.linspace(0.0, 1.0, 9):
        for brick in bricks:
            moved = np.array(brick.exterior.coords) + share * height_mm * np.array([0.35, -0.25])
            places = projected(floor.matrix(), moved)
            ImageDraw.Draw(mask).polygon([tuple(place) for place in places], fill=255)
    return ndimage.gaussian_filter(np.asarray(mask, dtype=np.float64) / 255.0, 5.0)


def scattered(seed: int, count: int = 12) -> list[Polygon]:
    """Return bricks on the table, at least 14 mm apart."""
    rng, bricks = np.random.default_rng(seed), []
    left, low, right, top = TABLE.bounds
    while len(bricks) < count:
        x, y = rng.uniform((left + 50.0, low + 50.0), (right - 50.0, top - 50.0))
        long, wide = rng.uniform((25.0, 18.0), (80.0, 45.0)) / 2.0
        brick = affinity.rotate(box(x - long, y - wide, x + long, y + wide), rng.uniform(0, 180))
        if TABLE.buffer(-12.0).contains(brick) and all(brick.distance(o) > 14.0 for o in bricks):
            bricks.append(brick)
    return bricks


def wall_errors(world: Map, bricks: Sequence[Polygon]) -> dict[str, float]:
    """Return how far walls are from the bricks' and how much larger the obstacles are."""
    around = 42.0  # from the corner of the first marker, the map's origin, to the table's
    moved = [affinity.translate(obstacle, -around, -around) for obstacle in world.obstacles]
    found = [max(moved, key=lambda one, b=brick: one.intersection(b).area) for brick in bricks]
    pairs = list(zip(found, bricks, strict=True))
    off = [
        shapely.distance(shapely.points(shapely.segmentize(one.exterior, 0.5).coords), b.exterior)
        for one, b in pairs
    ]
    apart = [shapely.hausdorff_distance(one.exterior, b.exterior, densify=0.01) for one, b in pairs]
    return {
        "obstacles": len(moved),
        "median_mm": float(np.median(np.concatenate(off))),
        "p95_mm": float(np.quantile(np.concatenate(off), 0.95)),
        "hausdorff_mm": float(max(apart)),
        "area_share": sum(one.area for one in moved) / sum(b.area for b in bricks) - 1.0,
    }


def main(photos: int = 12) -> None:
    markers = corner_markers(Map(name="table", bounds=TABLE, obstacles=()))
    rows = []
    for seed in range(photos):
        rng = np.random.default_rng(seed)
        camera = TrueCamera(
            target_mm=(300.0, 225.0),
            distance_mm=rng.uniform(950.0, 1100.0),
            tilt_deg=rng.uniform(5.0, 20.0),
            towards_deg=rng.uniform(0.0, 360.0),
            turn_deg=rng.uniform(-8.0, 8.0),
        )
        bricks, height_mm = scattered(seed), float(rng.uniform(10.0, 40.0))
        with TemporaryDirectory() as folder:
            path = Path(folder) / "table.jpg"
            photo_of_bricks(camera, TABLE, markers, bricks, height_mm, seed).save(path, quality=85)
            options = ImportOptions(photo=PhotoOptions(marker_mm=30.0, height_mm=height_mm))
            begin = time.process_time()
            world = import_map(path, options)
        row = wall_errors(world, bricks) | {"cpu_s": time.process_time() - begin}
        print(seed, {key: round(value, 3) for key, value in row.items()}, flush=True)  # noqa: T201
        rows.append(row)
    for words, choose in (("median", np.median), ("largest", np.max)):
        print(words, {key: round(float(choose([r[key] for r in rows])), 3) for key in rows[0]})  # noqa: T201


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
