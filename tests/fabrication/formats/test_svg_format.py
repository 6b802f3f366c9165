import io
import math
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable

import numpy as np
import pytest
import svgelements

from vinefab.core.plain_text import OWN_MARK
from vinefab.fabrication.formats.svg_format import svg_contour, svg_text
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.outline import Contour, Segment

SVG = "{http://www.w3.org/2000/svg}"
INKSCAPE = "{http://www.inkscape.org/namespaces/inkscape}"


def elements(text: str) -> list[svgelements.Path]:
    # With ppi 25.4 svgelements takes a millimetre for a user unit, as the equal view box says.
    drawing = svgelements.SVG.parse(io.StringIO(text), ppi=25.4)
    return [element for element in drawing.elements() if isinstance(element, svgelements.Path)]


def test_svgelements_sees_the_same_lengths_and_boxes(job: Job) -> None:
    paths = elements(svg_text(job))
    assert len(paths) == len(job.paths)
    for read, path in zip(paths, job.paths, strict=True):
        x0, y0, x1, y1 = path.contour.box_mm
        assert np.allclose(read.bbox(), (x0, 80.0 - y1, x1, 80.0 - y0), atol=2e-3)
        assert read.length() == pytest.approx(path.contour.length_mm, abs=5e-3)
        assert isinstance(read[-1], svgelements.Close) is path.contour.closed


def test_svgelements_sees_every_arc_on_its_circle(
    one_path: Callable[[Contour], Job], segment_of: Callable[..., Segment]
) -> None:
    for turn in (3.0, 44.0, 91.0, 175.0, 180.0, -179.9, -260.0, 300.0):
        arc = segment_of((500.0, 400.0), 120.0, 33.0, 33.0 + turn)
        (read,) = elements(svg_text(one_path(Contour.from_segments([arc], closed=False))))
        points = np.array([read.point(t) for t in np.linspace(0.0, 1.0, 60)])
        x, y = points[:, 0] - 500.0, 777.125 - points[:, 1] - 400.0
        assert np.allclose(np.hypot(x, y), 120.0, atol=2e-3)
        angles = np.degrees(np.unwrap(np.arctan2(y, x)))
        assert angles[-1] - angles[0] == pytest.approx(turn, abs=0.01)


def test_a_user_unit_is_a_millimetre_and_nothing_is_transformed(job: Job) -> None:
    text = svg_text(job)
    root = ET.fromstring(text.encode())  # noqa: S314
    assert (root.get("width"), root.get("height")) == ("150.000mm", "80.000mm")
    assert root.get("viewBox") == "0 0 150.000 80.000"
    assert "transform" not in text
    assert {element.tag for element in root.iter()} == {
        SVG + name for name in ("svg", "title", "desc", "defs", "style", "g", "path")
    }


def test_layers_are_inkscape_groups_in_process_order(job: Job) -> None:
    groups = ET.fromstring(svg_text(job).encode()).findall(f"{SVG}g")  # noqa: S314
    labels = [group.get(f"{INKSCAPE}label") for group in groups]
    assert labels == [op.layer for op in Operation]
    assert {group.get(f"{INKSCAPE}groupmode") for group in groups} == {"layer"}
    assert [len(group) for group in groups] == [len(job.along(op)) for op in Operation]


def test_paths_use_four_commands_and_three_decimals(job: Job) -> None:
    paths = list(ET.fromstring(svg_text(job).encode()).iter(f"{SVG}path"))  # noqa: S314
    for path in paths:
        words = (path.get("d") or "").split()
        assert {word for word in words if word.isalpha()} <= set("MLAZ")
        assert words.count("M") == 1
        numbers = [word for word in words if not word.isalpha()]
        assert all(re.fullmatch(r"-?\d+\.\d{3}|[01]", number) for number in numbers)
        assert "-0.000" not in numbers


def test_stroke_is_a_hairline_twice_and_there_is_no_fill(job: Job) -> None:
    for path in ET.fromstring(svg_text(job).encode()).iter(f"{SVG}path"):  # noqa: S314
        rgb = path.get("stroke")
        assert path.get("style") == f"fill:none;stroke:{rgb};stroke-width:0.01"
        assert (path.get("fill"), path.get("stroke-width")) == ("none", "0.01")


def test_no_arc_is_written_with_a_radius_below_half_its_chord(
    one_path: Callable[[Contour], Job], segment_of: Callable[..., Segment]
) -> None:
    for radius in np.linspace(0.02, 3.0, 200).tolist():
        arc = segment_of((10.0, 10.0), radius, 12.3, 192.3)
        text = svg_text(one_path(Contour.from_segments([arc], closed=False)))
        x, y = (float(value) for value in re.findall(r"M ([\d.]+) ([\d.]+)", text)[0])
        for radius_text, x_text, y_text in re.findall(
            r"A ([\d.]+) \S+ 0 0 [01] ([\d.]+) ([\d.]+)", text
        ):
            assert float(radius_text) > math.hypot(float(x_text) - x, float(y_text) - y) / 2
            x, y = float(x_text), float(y_text)


def test_arcs_flatter_than_the_rounding_become_lines(segment_of: Callable[..., Segment]) -> None:
    flat = Segment(start_mm=(0.0, 0.0), end_mm=(100.0, 0.0), bulge=9e-6)
    curved = Segment(start_mm=(100.0, 0.0), end_mm=(200.0, 0.0), bulge=1.1e-5)
    drawn = svg_contour(Contour.from_segments([flat, curved], closed=False))
    assert (drawn.bulges != 0).tolist() == [False, True]
    tiny = segment_of((0.0, 0.0), 0.0001, 0.0, 270.0)
    assert svg_contour(Contour.from_segments([tiny], closed=False)).arc_count == 3


def test_the_file_is_known_as_ours_and_tells_how_it_was_made(job: Job) -> None:
    text = svg_text(job)
    assert OWN_MARK in text.encode()[:8192]
    desc = ET.fromstring(text.encode()).findtext(f"{SVG}desc") or ""  # noqa: S314
    assert "offset_mm: 0.65" in desc.splitlines()
    assert "kerf at 0" in desc


def test_odd_names_cannot_break_the_file(finger: Contour) -> None:
    label = "a\x00<b>\n]]>&\u2028'\"\x1b"
    path = LaserPath(operation=Operation.CUT, contour=finger, label=label)
    facts = {"<!DOCTYPE": "x\n\x0b"}
    job = Job(name="n", sheet_width_mm=150, sheet_height_mm=80, paths=(path,), facts=facts)
    root = ET.fromstring(svg_text(job).encode())  # noqa: S314
    assert root.find(f".//{SVG}path").get(f"{INKSCAPE}label") == "a <b> ]]>& '\""
