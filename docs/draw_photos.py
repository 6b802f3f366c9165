"""Render the photos of the tutorials anew: a table with three blocks, bare and with a grown robot.

Run it as ``python docs/draw_photos.py`` in a checkout; the renderer is that of the tests. No
camera took these photos: the truth is known, as a tutorial and its tests need.
"""

import io
import math
import sys
from importlib import import_module
from pathlib import Path

from PIL import Image
from PIL.ExifTags import IFD, Base

from vinefab.growth.batch import grow_on
from vinefab.growth.options import GrowthOptions
from vinefab.growth.terrain import Terrain
from vinefab.model.design import Build, Design
from vinefab.model.files.starters import starter_map
from vinefab.model.map import Pose

ROOT = Path(__file__).resolve().parent.parent
ARENA = ROOT / "examples" / "arena"
PIXELS = (1440, 1080)
HALF_ANGLE_DEG = 6.0
"""What the tutorial's fit should find."""

POSES = {
    "grown_1": (110, 90, 2),
    "grown_2": (110, 110, -5),
    "grown_3": (110, 80, 8),
    "grown_4": (110, 85, 12),
}


def main() -> None:
    sys.path.insert(0, str(ROOT / "tests" / "observation"))
    renderer = import_module("rendered_photo")
    world, robot = starter_map("table"), Design.read(ARENA / "sprig.toml")
    options = GrowthOptions.of({"head_on_half_angle_deg": HALF_ANGLE_DEG})
    bare = Design(name="none", trunk_length_mm=0.2, build=Build.standard(1, 0.5))
    scenes = {"table": (bare, Pose.of((20, 20, 180)), 9.0)}
    scenes |= {name: (robot, Pose.of(pose), 12.0) for name, pose in POSES.items()}
    for seed, (name, (design, pose, tilt_deg)) in enumerate(scenes.items(), 1):
        deployment = grow_on(design, Terrain.of(world), pose, options)
        look = renderer.Look(
            tilt_deg=tilt_deg,
            turn_deg=70.0 * seed,
            pixels=PIXELS,
            block=(50, 84, 176),
            noise=1.5,
            jpeg=80,
            seed=seed,
        )
        _, camera, jpeg = renderer.render(renderer.Scene(world, deployment, design.build, look))
        jpeg = with_focal_length(jpeg, camera.focal_px)
        (ARENA / f"{name}.jpg").write_bytes(jpeg)
        stops = {words: count for words, count in deployment.stops.items() if count}
        print(f"{name}.jpg: {len(jpeg) / 1000:.0f} kB, focal {camera.focal_px:.0f} px, {stops}")


def with_focal_length(jpeg: bytes, focal_px: float) -> bytes:
    """Return a photo that says its focal length for film of 36 x 24 mm, as those of phones do."""
    photo = Image.open(io.BytesIO(jpeg))
    exif = photo.getexif()
    exif.get_ifd(IFD.Exif)[Base.FocalLengthIn35mmFilm] = round(
        focal_px * math.hypot(36.0, 24.0) / math.hypot(*photo.size)
    )
    written = io.BytesIO()
    photo.save(written, "JPEG", quality="keep", exif=exif)
    return written.getvalue()


if __name__ == "__main__":
    main()
