"""Files as other programs draw them, compared with the model pixel by pixel at 0.05 mm."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import shapely
from PIL import Image

from vinefab.fabrication.calibration.coupons import balloon_designs, crotch_designs
from vinefab.fabrication.formats.dxf_format import dxf_text
from vinefab.fabrication.formats.lightburn_format import lightburn_text
from vinefab.fabrication.formats.svg_format import svg_text
from vinefab.fabrication.job.laser_job import laser_job
from vinefab.model.design import Design
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.laser import LaserProfile, read_profile

PIXEL_MM = 0.05
PARTS = [balloon_designs()[0], crotch_designs()[0]]
Program = Callable[[str, str], str]


@pytest.fixture(scope="module")
def profile() -> LaserProfile:
    return read_profile("co2_60w__stretchlon_200")


@pytest.fixture(params=PARTS, ids=[design.name for design in PARTS])
def part(request: pytest.FixtureRequest, profile: LaserProfile) -> Job:
    """A small part alone on a sheet of its own size, its outline only."""
    design: Design = request.param
    whole = laser_job(design, profile)
    (outline,) = whole.along(Operation.WELDCUT)
    x0, y0, x1, y1 = outline.contour.box_mm
    moved = outline.contour.moved(0.0, 1.0 - x0, 1.0 - y0)
    path = LaserPath(operation=Operation.WELDCUT, contour=moved)
    width, height = np.ceil([x1 - x0 + 2.0, y1 - y0 + 2.0]).tolist()
    return Job(name="part", sheet_width_mm=width, sheet_height_mm=height, paths=(path,))


def model(job: Job) -> shapely.Polygon:
    return shapely.Polygon(job.paths[0].contour.flattened_mm(1e-4))


def centres(job: Job) -> tuple[np.ndarray, np.ndarray]:
    """Return x and y (up) of every pixel's centre, top row first, as pictures are stored."""
    columns = round(job.sheet_width_mm / PIXEL_MM)
    rows = round(job.sheet_height_mm / PIXEL_MM)
    x = (np.arange(columns) + 0.5) * PIXEL_MM
    y = job.sheet_height_mm - (np.arange(rows) + 0.5) * PIXEL_MM
    return np.meshgrid(x, y)


def agree(job: Job, inside: np.ndarray) -> None:
    """Every pixel that differs from the model lies within one pixel of its outline."""
    polygon = model(job)
    x, y = centres(job)
    differs = inside != shapely.contains_xy(polygon, x, y)
    strays = shapely.points(x[differs], y[differs])
    assert (shapely.distance(polygon.exterior, strays) <= PIXEL_MM).all()
    assert differs.sum() * PIXEL_MM**2 <= 0.6 * PIXEL_MM * polygon.length
    assert inside.sum() * PIXEL_MM**2 == pytest.approx(polygon.area, rel=2e-3)


def test_rsvg_fills_the_same_pixels(part: Job, tmp_path: Path, program: Program) -> None:
    text = svg_text(part).replace('fill="none"', 'fill="#000"').replace("fill:none", "fill:#000")
    (tmp_path / "a.svg").write_text(text)
    dots = str(round(25.4 / PIXEL_MM))
    command = [program("rsvg-convert", "librsvg2-bin"), "-d", dots, "-p", dots]
    command += ["-o", str(tmp_path / "a.png"), str(tmp_path / "a.svg")]
    done = subprocess.run(
        command, capture_output=True, text=True, errors="replace", timeout=60, check=True
    )
    assert done.stderr == ""
    with Image.open(tmp_path / "a.png") as image:
        inside = np.asarray(image.convert("RGBA"))[:, :, 3] > 127
    assert inside.shape == centres(part)[0].shape
    agree(part, inside)


@pytest.mark.parametrize("arcs", ["true arcs", "chords"])
def test_ogr_fills_the_same_pixels(part: Job, arcs: str, tmp_path: Path, program: Program) -> None:
    (tmp_path / "a.dxf").write_text(dxf_text(part, polyline=arcs == "chords"))
    options = ["--config", "OGR_ARC_STEPSIZE", "0.25", "-lco", "COORDINATE_PRECISION=9"]
    command = [program("ogr2ogr", "gdal-bin"), "-f", "GeoJSON", *options, "-a_srs", "EPSG:3857"]
    command += [str(tmp_path / "a.geojson"), str(tmp_path / "a.dxf")]
    subprocess.run(command, capture_output=True, timeout=60, check=True)
    (feature,) = json.loads((tmp_path / "a.geojson").read_text())["features"]
    read = shapely.Polygon(np.array(feature["geometry"]["coordinates"])[:, :2])
    agree(part, shapely.contains_xy(read, *centres(part)))


def test_lightburns_lines_fill_the_same_pixels(part: Job, profile: LaserProfile) -> None:
    text = lightburn_text(part, profile)
    vertices = text[text.index("<VertList>") + 10 : text.index("</VertList>")].split("V")[1:]
    points = [[float(word) for word in vertex.split("c")[0].split()] for vertex in vertices]
    agree(part, shapely.contains_xy(shapely.Polygon(points), *centres(part)))


def test_a_wrong_fillet_would_be_seen(part: Job) -> None:
    shrunk = model(part).buffer(-0.3).buffer(0.3, join_style="mitre")
    with pytest.raises(AssertionError):
        agree(part, shapely.contains_xy(shrunk.buffer(0.1), *centres(part)))


SCRIPT = """
import hashlib, sys
from vinefab.fabrication.package.prepare import zip_bytes
from vinefab.fabrication.formats.laser_drawing import LaserFileSpec
from vinefab.fabrication.formats.laser_formats import laser_files
from vinefab.model.design import Design
from vinefab.model.laser import (read_profile)
from vinefab.fabrication.job.laser_job import laser_job
profile = read_profile("co2_60w__stretchlon_200")
job = laser_job(Design.read("three_level_tree"), profile)
files = laser_files(LaserFileSpec(job=job, profile=profile), requested=["dxf_r12"]).files
for name, data in [*files.items(), ("zip", zip_bytes(files, "a"))]:
    print(name, hashlib.sha256(data).hexdigest())
"""


@pytest.mark.thorough
def test_every_laser_file_has_the_same_bytes_in_another_process() -> None:
    said = {
        subprocess.run(
            [sys.executable, "-c", SCRIPT],
            env={**os.environ, "PYTHONHASHSEED": seed},
            capture_output=True,
            text=True,
            errors="replace",
            check=True,
            timeout=120,
        ).stdout
        for seed in ("1", "4242")
    }
    assert len(said) == 1
    names = [line.partition(" ")[0] for line in said.pop().splitlines()]
    assert {"outline.dxf", "outline_r12.dxf", "outline_weldcut.svg", "zip"} <= set(names)
