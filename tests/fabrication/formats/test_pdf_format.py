"""The pattern on paper: what is drawn for hands, and files that miss a part of it."""

import io
import re

import pypdf
import pypdfium2
import pytest
from shapely import LineString

from tests.fabrication.conftest import fan, plan
from vinefab.core.errors import UnreadableFileError
from vinefab.fabrication.formats.laser_drawing import LaserFileSpec, file_problems, package_spec
from vinefab.fabrication.formats.pdf_format import pdf_format, read_pdf
from vinefab.fabrication.job.bar_strokes import bar_strokes
from vinefab.fabrication.job.laser_job import laser_job
from vinefab.model.laser import read_profile

A4 = pdf_format("a4")
PT_PER_MM = 72.0 / 25.4


@pytest.fixture(scope="module")
def spec() -> LaserFileSpec:
    profile = read_profile("impulse_sealer_300__stretchlon_800")
    tree = plan((40.0, 20.0), levels=[fan(2, 130.0, 100.0)], trunk=100.0, tail=110.0)
    return package_spec(laser_job(tree, profile), profile)


@pytest.fixture(scope="module")
def data(spec: LaserFileSpec) -> bytes:
    return A4.write(spec).encode("latin-1")


def test_a_page_that_is_missing_is_found_out(spec: LaserFileSpec, data: bytes) -> None:
    assert file_problems(A4, data, spec) == ()
    count = len(pypdf.PdfReader(io.BytesIO(data)).pages)
    assert count > 2
    for gone in range(1, count):
        writer, stream = pypdf.PdfWriter(), io.BytesIO()
        for number, page in enumerate(pypdf.PdfReader(io.BytesIO(data)).pages):
            if number != gone:
                writer.add_page(page)
        writer.write(stream)
        assert "no page shows whole" in "; ".join(file_problems(A4, stream.getvalue(), spec))


def test_every_stretch_is_drawn_from_tick_to_tick_with_its_number(
    spec: LaserFileSpec, data: bytes
) -> None:
    strokes = bar_strokes(spec.job, spec.profile)
    document = pypdfium2.PdfDocument(data)
    words = " ".join(page.get_textpage().get_text_bounded() for page in document).split()
    assert {str(row) for row in range(1, len(strokes) + 1)} <= set(words)
    (form,) = pypdf.PdfReader(io.BytesIO(data)).pages[1]["/Resources"]["/XObject"].values()
    content = form.get_object().get_data().decode("latin-1")
    number, other = r"(-?[\d.]+)", r"-?[\d.]+"
    drawn = [
        LineString([(float(a) / PT_PER_MM, float(b) / PT_PER_MM) for a, b in (ends[:2], ends[2:])])
        for ends in re.findall(
            rf"{number} {number} m {number} {number} l\b(?! {other} {other} l)", content
        )
    ]
    for stroke in strokes:
        wanted = LineString([stroke.segment.start_mm, stroke.segment.end_mm])
        assert min(one.hausdorff_distance(wanted) for one in drawn) < 1e-3


@pytest.mark.parametrize("text", ["", "%PDF-1.4", "no pdf", "%PDF-1.4\n%%EOF"])
def test_what_is_no_pattern_of_ours_is_refused(text: str) -> None:
    with pytest.raises(UnreadableFileError):
        read_pdf(text)
