"""How far walls of maps from photos are off, and how far they say: over blur, angle, light, JPEG.

Four markers lie around, and that is said: photos that show fewer are refused.

Run: python tests/photos/measure_shape.py [PHOTOS] [--jobs N] [--out FILE] [--blur PX] [--first N]
"""

import argparse
import json
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import shapely
from PIL import Image, ImageDraw, ImageFilter
from scipy import ndimage

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tests.photos.conftest import Floor, TrueCamera, light_of
from tests.photos.measure_walls import BRICK, TABLE, scattered
from vinefab.core.errors import VinefabError
from vinefab.maps.importers.import_options import ImportOptions, PhotoOptions
from vinefab.maps.importers.importers import import_map
from vinefab.model.map import Map, corner_markers
from vinefab.photos.photo import projected

BLURS_PX = (0.0, 0.7, 1.0, 1.5, 2.0, 3.0)
AROUND_MM = 42.0  # from the corner of the first marker to the table's


def table_of(bricks, rng):
    """Return a light table with stains, markers around it and dark bricks painted on it."""
    left, low, right, top = TABLE.bounds
    floor = Floor.plain((left - 80.0, low - 80.0, right + 80.0, top + 80.0), 0.5)
    stains = rng.normal(0.0, 60.0, floor.pixels.shape[:2])
    floor.pixels += ndimage.gaussian_filter(stains, 6.0)[..., None]
    floor.paint(corner_markers(TABLE_MAP))
    rows, columns = floor.pixels.shape[:2]
    mask = Image.new("L", (4 * columns, 4 * rows), 0)
    for brick in bricks:
        corners = 4.0 * projected(floor.matrix(), np.array(brick.exterior.coords)) - 0.5
        ImageDraw.Draw(mask).polygon([tuple(place) for place in corners], fill=255)
    share = (np.asarray(mask.reduce(4), dtype=float) / 255.0)[..., None]
    light = (1.0 - share) * light_of(floor.pixels) + share * light_of(BRICK)
    floor.pixels = 255.0 * light ** (1.0 / 2.2)
    return floor


def photo_of(number, blur_px=None):
    """Return a photo, its bricks, and how it was taken."""
    rng = np.random.default_rng(7000 + number)
    camera = TrueCamera(
        target_mm=(300.0, 225.0),
        distance_mm=float(rng.uniform(950.0, 1150.0)),
        tilt_deg=float(rng.uniform(0.0, 28.0)),
        towards_deg=float(rng.uniform(0.0, 360.0)),
        turn_deg=float(rng.uniform(-25.0, 25.0)),
        focal_px=float(rng.choice([1000.0, 1300.0])),
        size_px=(1640, 1230),
    )
    taken = {
        "blur_px": float(rng.choice(BLURS_PX)) if blur_px is None else blur_px,
        "kind": str(rng.choice(["light", "stored"])) if blur_px is None else "stored",
        "jpeg": int(rng.integers(55, 95)),
        "gain": float(rng.uniform(0.55, 1.0)),
        "tilt": round(camera.tilt_deg, 1),
    }
    bricks = scattered(number, int(rng.integers(3, 9)))
    in_light = taken["blur_px"] if taken["kind"] == "light" else 0.0
    seen = table_of(bricks, rng).photographed(
        camera,
        noise=4.0,
        blur_px=float(np.hypot(0.7, in_light)),
        seed=number,
        supersampling=2,
    )
    side = np.linspace(taken["gain"], 1.0, seen.width_px)[None, :, None]
    picture = Image.fromarray((seen.pixels * side).astype(np.uint8))
    if taken["kind"] == "stored" and taken["blur_px"]:  # smoothed by software, as it is stored
        picture = picture.filter(ImageFilter.GaussianBlur(taken["blur_px"]))
    return picture, bricks, taken


TABLE_MAP = Map(name="table", bounds=TABLE, obstacles=())


def off_mm(world, bricks):
    """Return distances of walls from the true ones, after the best turn and shift."""
    true = shapely.union_all([brick.exterior for brick in bricks])
    found = [np.array(shapely.segmentize(o.exterior, 1.0).coords) for o in world.obstacles]
    points = np.vstack(found) - AROUND_MM
    for _ in range(12):
        line = shapely.shortest_line(shapely.points(points), true)
        goal = shapely.get_coordinates(line)[1::2]
        one, two = points - points.mean(axis=0), goal - goal.mean(axis=0)
        turn = np.vdot(one @ (1.0, 1.0j), two @ (1.0, 1.0j))
        turned = (one @ (1.0, 1.0j)) * turn / abs(turn)
        points = np.column_stack([turned.real, turned.imag]) + goal.mean(axis=0)
    back = shapely.multipoints(points)
    corners = shapely.points(np.vstack([np.array(b.exterior.coords) for b in bricks]))
    return shapely.distance(shapely.points(points), true), shapely.distance(corners, back)


def judged(number, blur_px=None):
    """Return how far the walls of one photo's map are off, and what it says."""
    picture, bricks, taken = photo_of(number, blur_px)
    with TemporaryDirectory() as folder:
        path = Path(folder) / "table.jpg"
        picture.save(path, quality=taken["jpeg"])
        try:
            world = import_map(
                path, ImportOptions(photo=PhotoOptions(marker_mm=30.0, marker_count=4))
            )
        except VinefabError as error:
            return {"photo": number, **taken, "refused": str(error).split(": ", 1)[-1]}
    off, corners = off_mm(world, bricks)
    size = np.ptp(np.array(world.bounds.exterior.coords), axis=0) / np.array([684.0, 534.0]) - 1.0
    return {
        "photo": number, **taken, "bricks": len(bricks), "obstacles": len(world.obstacles),
        "median_mm": round(float(np.median(off)), 3),
        "p95_mm": round(float(np.quantile(off, 0.95)), 3),
        "most_mm": round(float(off.max()), 3), "corner_mm": round(float(corners.max()), 3),
        "stated_mm": world.facts["shape_within_mm"],
        "walls": sum(len(o.exterior.coords) - 1 for o in world.obstacles),
        "size_off": [round(float(s), 5) for s in size],
        "blur_seen_px": world.facts.get("blur_px"),
    }  # fmt: skip


def main():
    """Print figures over many photos; exit 1 if stated errors hold too seldom."""
    parser = argparse.ArgumentParser()
    parser.add_argument("photos", type=int, nargs="?", default=100)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--blur", type=float)
    parser.add_argument("--out", type=Path)
    given = parser.parse_args()
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    numbers = range(given.first, given.first + given.photos)
    rows = []
    with ProcessPoolExecutor(given.jobs) as pool:
        for row in pool.map(partial(judged, blur_px=given.blur), numbers):
            rows.append(row)
            print(json.dumps(row), flush=True)  # noqa: T201
    read = [row for row in rows if "refused" not in row]
    if not read:
        return 1
    held = [row for row in read if max(row["most_mm"], row["corner_mm"]) <= row["stated_mm"]]
    found = {
        "photos": len(rows),
        "refused": len(rows) - len(read),
        "stated_error_holds": f"{len(held)} of {len(read)}",
        "median_stated_mm": float(np.median([row["stated_mm"] for row in read])),
        "median_most_mm": float(np.median([row["most_mm"] for row in read])),
        "largest_mm": max(row["most_mm"] for row in read),
        "obstacles_right": sum(row["obstacles"] == row["bricks"] for row in read),
        "walls_per_box": sum(r["walls"] for r in read) / sum(r["obstacles"] for r in read),
    }
    print(json.dumps(found, indent=1))  # noqa: T201
    if given.out:
        given.out.write_text(json.dumps({"summary": found, "photos": rows}, indent=1))
    return 0 if len(held) >= 0.95 * len(read) else 1


if __name__ == "__main__":
    sys.exit(main())
