import io

import numpy as np
import pytest
import svgelements

from vinefab.fabrication.formats.laser_drawing import DEFAULT, PRESETS, LaserFileSpec, metadata
from vinefab.fabrication.formats.laser_formats import laser_files
from vinefab.fabrication.formats.svg_format import svg_text
from vinefab.fabrication.job.laser_job import laser_job
from vinefab.model.design import Design
from vinefab.model.files.shipped import locate, names
from vinefab.model.job import Job
from vinefab.model.laser import read_profile

RECIPE = "co2_60w__stretchlon_200"


@pytest.fixture(params=names("design"))
def shipped(request: pytest.FixtureRequest) -> Job:
    return laser_job(Design.read(locate("design", request.param)), read_profile(RECIPE))


@pytest.mark.parametrize("preset", PRESETS)
def test_shipped_designs_are_written_right(shipped: Job, preset: str) -> None:
    written = laser_files(LaserFileSpec(job=shipped, colours=PRESETS[preset]))
    assert set(written.problems.values()) == {()}


def test_svgelements_sees_the_shipped_designs_as_they_are(shipped: Job) -> None:
    drawing = svgelements.SVG.parse(io.StringIO(svg_text(shipped)), ppi=25.4)
    paths = [element for element in drawing.elements() if isinstance(element, svgelements.Path)]
    assert len(paths) == len(shipped.paths)
    for read, path in zip(paths, shipped.paths, strict=True):
        x0, y0, x1, y1 = path.contour.box_mm
        height = shipped.sheet_height_mm
        assert np.allclose(read.bbox(), (x0, height - y1, x1, height - y0), atol=2e-3)
        # Every corner is written to 0.001 mm; the letters of a label have some ten.
        assert read.length() == pytest.approx(path.contour.length_mm, rel=1e-5, abs=5e-3)


def test_the_offsets_that_were_applied_stand_in_every_file(shipped: Job) -> None:
    offset = f"{shipped.facts['weldcut_offset_mm']:g}"
    for data in laser_files(LaserFileSpec(job=shipped)).files.values():
        assert "weldcut_offset_mm" in data.decode()
        assert offset in data.decode()


def test_a_fact_cannot_hide_who_wrote_the_file(job: Job) -> None:
    sly = Job(
        name="sly",
        sheet_width_mm=150,
        sheet_height_mm=80,
        paths=job.paths,
        facts={"generator": "somebody", "units": "inch"},
    )
    said = metadata(sly, DEFAULT)
    assert said["generator"].startswith("written by vinefab")
    assert said["units"] == "mm"
