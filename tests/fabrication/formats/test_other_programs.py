"""Files of packages in programs of others, each installed by itself.

``make readers`` installs them into ``.readers``; VINEFAB_READERS names another such folder. Without
them the tests are skipped.
"""

import json
import os
import shutil
import subprocess
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import shapely

from vinefab.fabrication.formats.laser_drawing import package_spec
from vinefab.fabrication.formats.laser_formats import laser_files
from vinefab.fabrication.job.laser_job import laser_job
from vinefab.model.design import Design
from vinefab.model.job import Job, Operation
from vinefab.model.laser import read_profile

ROOT = Path(__file__).resolve().parents[3]
READERS = Path(os.environ.get("VINEFAB_READERS", ROOT / ".readers"))
LBRNTS = READERS / "node_modules" / "lbrnts"


@cache
def job_of(recipe: str) -> Job:
    return laser_job(Design.read("plain_vine"), read_profile(recipe))


def written(recipe: str) -> dict[str, bytes]:
    return dict(laser_files(package_spec(job_of(recipe), read_profile(recipe))).files)


@pytest.fixture(scope="module")
def microweldr() -> Path:
    """The Python of an environment that has microweldr."""
    python = READERS / "microweldr" / "bin" / "python"
    if not python.is_file():
        pytest.skip("no microweldr: make readers installs it")
    return python


POINTS = """
import json, sys
from pathlib import Path
from microweldr.generators.dxf_point_iterator import DXFPointIterator
paths = {}
for point in DXFPointIterator(dot_spacing=0.5).iterate_points(Path(sys.argv[1])):
    paths.setdefault(point["path_id"], []).append((point["x"], point["y"]))
print(json.dumps(list(paths.values())))
"""


@pytest.mark.parametrize("name", ["outline_weld.dxf", "outline_weld_polyline.dxf"])
def test_microweldr_welds_our_seams_and_leaves_the_mouth_open(
    microweldr: Path, tmp_path: Path, name: str
) -> None:
    recipe = "co2_60w__stretchlon_800"
    file = tmp_path / name
    file.write_bytes(written(recipe)[name])
    done = subprocess.run(
        [microweldr, "-c", POINTS, file], capture_output=True, text=True, check=True, timeout=60
    )
    welded = [np.array(path) for path in json.loads(done.stdout.splitlines()[-1])]
    seams = job_of(recipe).along(Operation.WELD)
    assert len(welded) == len(seams) == 1
    wanted = shapely.LineString(seams[0].contour.flattened_mm(0.001))
    dots = shapely.points(welded[0])
    assert float(shapely.distance(dots, wanted).max()) < 0.1
    # Every place of the seam has a dot within its spacing, and the mouth has none.
    along = shapely.points(shapely.get_coordinates(shapely.segmentize(wanted, 1.0)))
    assert float(shapely.distance(along, shapely.multipoints(dots)).max()) < 0.6
    (x0, y0), (x1, y1) = seams[0].contour.points_mm[[0, -1]].tolist()
    middle = shapely.Point((x0 + x1) / 2.0, (y0 + y1) / 2.0)
    assert float(shapely.distance(dots, middle).min()) > 15.0


LAYERS = """
const { LightBurnProject } = await import(process.argv[1]);
const { readFileSync } = await import("node:fs");
const project = LightBurnProject.parse(readFileSync(process.argv[2], "utf8"));
const found = { settings: [], paths: [] };
for (const one of project.children) {
  if (one.token === "CutSetting")
    found.settings.push(
      { index: one.index, name: one.name, speed: one.speed, power: one.maxPower });
  if (one.token === "Shape.Path")
    found.paths.push({
      layer: one.cutIndex, points: one.verts.map((v) => [v.x, v.y]), lines: one.prims.length });
}
console.log(JSON.stringify(found));
"""


def test_an_independent_reader_finds_paths_and_settings_in_lightburn_files(tmp_path: Path) -> None:
    node = shutil.which("node")
    if node is None or not LBRNTS.is_dir():
        pytest.skip("no lbrnts for Node.js: make readers installs it")
    recipe = "co2_60w__stretchlon_200"
    file = tmp_path / "outline.lbrn2"
    file.write_bytes(written(recipe)["outline.lbrn2"])
    done = subprocess.run(
        [node, "--input-type=module", "-e", LAYERS, str(LBRNTS / "dist" / "index.js"), str(file)],
        capture_output=True, text=True, check=True, timeout=60,
    )  # fmt: skip
    found = json.loads(done.stdout)
    job, profile = job_of(recipe), read_profile(recipe)
    names = {one["index"]: one["name"] for one in found["settings"]}
    for operation in (Operation.MARK, Operation.WELDCUT, Operation.CUT):
        (setting,) = (one for one in found["settings"] if one["name"] == operation.layer)
        (beam,) = (one for one in profile.beams if one[0] == operation)
        assert setting["speed"] == pytest.approx(beam[1].speed_mm_s.value)
        assert setting["power"] == pytest.approx(beam[1].power_percent.value)
        paths = [one for one in found["paths"] if names[one["layer"]] == operation.layer]
        meant = job.along(operation)
        assert len(paths) == len(meant)
        for read, path in zip(paths, meant, strict=True):
            points = read["points"]
            # An open path has a line less than points: nothing is drawn across the mouth.
            assert read["lines"] == len(points) - (not path.contour.closed)
            line = shapely.LineString(path.contour.flattened_mm(0.001))
            assert float(shapely.distance(shapely.points(np.array(points)), line).max()) < 0.002
