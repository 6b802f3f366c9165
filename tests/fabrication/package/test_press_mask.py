"""The mask for a heat press: the lumen, with a tab at its mouth, at true scale."""

import io
import math
import re
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pypdfium2
import pytest
import shapely
from shapely import LineString

from tests.fabrication.conftest import fan, plan
from vinefab.fabrication.job.laser_job import laser_job
from vinefab.fabrication.package.press_mask import TAB_MM, mask_files, masks_of
from vinefab.model.job import Operation
from vinefab.model.laser import read_profile
from vinefab.outline.body_outline import body_outline

MM_PER_PT = 25.4 / 72.0
TREE = plan((40.0, 20.0), levels=[fan(3, 130.0, 150.0)], trunk=100.0, tail=110.0)


@pytest.fixture(scope="module")
def files() -> dict[str, bytes]:
    profile = read_profile("impulse_sealer_300__stretchlon_800")
    return mask_files(laser_job(TREE, profile), profile, "a4")


def test_the_mask_is_the_lumen_with_a_tab_beyond_the_mouth(files: dict[str, bytes]) -> None:
    root = ElementTree.fromstring(files["mask.svg"])  # noqa: S314
    (line,) = (one.get("d") for one in root.iter() if one.tag.endswith("path"))
    drawn = np.array(re.findall(r"(-?[\d.]+)[ ,](-?[\d.]+)", line), dtype=float) * MM_PER_PT
    mask = shapely.Polygon(drawn * (1.0, -1.0))
    outline = body_outline(TREE).contour.flattened_mm()
    (x0, _), width = outline[0], np.hypot(*(outline[-1] - outline[0]))
    tab = shapely.box(x0 - TAB_MM, -width / 2.0, x0, width / 2.0)
    wanted = shapely.union(shapely.Polygon(outline), tab)
    assert mask.area == pytest.approx(wanted.area, rel=2e-3)
    # It may lie turned on its sheet: the same sides, and as far around.
    assert mask.length == pytest.approx(wanted.length, rel=2e-3)
    sizes = [
        sorted(np.hypot(*np.diff(shapely.get_coordinates(box)[:3], axis=0).T))
        for box in map(shapely.minimum_rotated_rectangle, (mask, wanted))
    ]
    assert sizes[0] == pytest.approx(sizes[1], abs=0.1)


def test_the_pdf_shows_all_of_it_on_sheets_of_paper(files: dict[str, bytes]) -> None:
    document = pypdfium2.PdfDocument(io.BytesIO(files["mask.pdf"]))
    words = document[0].get_textpage().get_text_bounded()
    assert f"a tab of {TAB_MM:g} mm at every open end" in " ".join(words.split())
    assert len(document) > 2


def test_no_tab_covers_the_seam_of_a_neighbour() -> None:
    profile = read_profile("impulse_sealer_300__stretchlon_800")
    job = laser_job(plan((40.0,)), profile)
    (seam,) = job.along(Operation.WELD)
    x0, _, x1, y1 = seam.contour.box_mm
    # Another one stands on its side: its mouth is 10 mm away from the first.
    turned = seam.contour.moved(math.pi / 2.0, 0.0, 0.0)
    low = turned.box_mm
    other = turned.moved(0.0, (x0 + x1) / 2.0 - low[0], y1 + 10.0 - low[1])
    both = replace(
        job, paths=(seam, replace(seam, contour=other, label="another")), sheet_height_mm=2000.0
    )
    masks = masks_of(both, profile)
    lines = [LineString(path.contour.flattened_mm()) for path in both.paths]
    bands = shapely.union_all(lines).buffer(0.99, cap_style="flat")
    assert masks.intersection(bands).area == pytest.approx(0.0, abs=1e-6)
    lumens = [shapely.Polygon(line.coords).buffer(-1.01) for line in lines]
    assert all(masks.contains(lumen) for lumen in lumens)
    between = shapely.box(other.box_mm[0] + 1.1, y1 + 1.1, other.box_mm[2] - 1.1, y1 + 9.0)
    assert masks.contains(between)  # the tab, up to the seam of the first


def test_film_that_a_machine_marks_needs_no_mask() -> None:
    for recipe in ("co2_60w__stretchlon_800", "hot_tip_220__stretchlon_200"):
        profile = read_profile(recipe)
        assert mask_files(laser_job(TREE, profile), profile, "a4") == {}
