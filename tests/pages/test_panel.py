"""The drawing layer: places on paper, ticks, legends, and that its renderers agree."""

import base64
import io
import re
import zlib
from collections import defaultdict
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import shapely
from PIL import Image, ImageFont

from tests.pages.drawn import placed_texts, texts_of
from vinefab.pages.page_files import page_png, page_svg
from vinefab.pages.page_pdf import page_pdf
from vinefab.pages.panel import (
    MIDDLE,
    MOST_LETTERS,
    Ink,
    Layer,
    Marks,
    Page,
    Panel,
    Raster,
    Shape,
    Words,
    blended,
    fitted,
    page_of,
    page_of_paper,
    page_of_rows,
    paper,
    plan_panel,
    round_ticks,
    text_width,
)

RED = (200, 0, 0)
INK = Ink(fill="#c80000")
HOLLOW = shapely.box(10, 10, 90, 90) - shapely.box(30, 30, 70, 70)


def pixels_of(page, per_pt=2):
    return np.asarray(Image.open(io.BytesIO(page_png(page, dpi=72 * per_pt))).convert("RGB"))


def test_a_plan_has_equal_scales_and_shows_its_box():
    for box in ((0, 0, 400, 100), (-50, -20, -40, 300), (0, 0, 0, 0)):
        panel = plan_panel(tuple(map(float, box)), 300.0)
        x0, y0, x1, y1 = panel.box
        assert panel.width_pt / (x1 - x0) == pytest.approx(panel.height_pt / (y1 - y0))
        assert (x0 <= box[0], y0 <= box[1], x1 >= box[2], y1 >= box[3]) == (True,) * 4
    assert panel.placed([(x0, y1), (x1, y0)]).tolist() == [
        [0.0, 0.0],
        pytest.approx([panel.width_pt, panel.height_pt]),
    ]


def test_holes_stay_open_and_alpha_mixes():
    panel = paper(100.0, 100.0)
    panel.polygons([HOLLOW], INK)
    panel.polygons([shapely.box(40, 40, 60, 60)], Ink(fill="#000000", fill_alpha=0.5))
    pixels = pixels_of(page_of_paper(panel))
    assert pixels.shape == (200, 200, 3)
    assert tuple(pixels[40, 40]) == RED
    assert tuple(pixels[70, 100]) == (255, 255, 255)  # in the hole
    assert pixels[100, 100] == pytest.approx([128, 128, 128], abs=2)
    picture = page_svg(page_of_paper(panel)).decode()
    assert picture.count('fill-rule="evenodd"') == 2
    assert 'fill-opacity="0.5"' in picture


def test_what_reaches_over_the_edge_of_a_panel_is_cut_off():
    panel = Panel(box=(0, 0, 10, 10), width_pt=100, height_pt=100, x_ticks=(), y_ticks=())
    panel.polygons([shapely.box(-50, 4, 50, 6)], INK)
    page = page_of(panel)
    red = (pixels_of(page) == RED).all(axis=2).any(axis=0)
    assert np.flatnonzero(red).size == pytest.approx(200, abs=2)
    nested = ET.fromstring(page_svg(page)).findall("{http://www.w3.org/2000/svg}svg")  # noqa: S314
    assert [float(nested[0].get("width")), len(nested)] == [100.0, 1]


def test_rank_says_what_lies_on_top():
    panel = paper(20.0, 20.0)
    panel.polygons([shapely.box(0, 0, 20, 20)], INK, rank=5.0)
    panel.polygons([shapely.box(0, 0, 20, 20)], Ink(fill="#00c800"), rank=1.0)
    assert tuple(pixels_of(page_of_paper(panel))[20, 20]) == RED


def test_ticks_are_round_and_have_the_digits_that_they_need():
    assert round_ticks(0.0, 1.0, 5) == [(k / 5, f"{k / 5:.1f}") for k in range(6)]
    assert [words for _, words in round_ticks(-0.011, 0.012, 5)] == [
        "-0.010",
        "-0.005",
        "0.000",
        "0.005",
        "0.010",
    ]
    assert [words for _, words in round_ticks(3.0, 1900.0, 4)] == ["500", "1000", "1500"]


def test_a_legend_explains_each_label_once_and_stands_on_no_other_text():
    panel = Panel(box=(0, 0, 1, 1), width_pt=250, height_pt=80, x_name="x", frame=True)
    for number in range(9):
        panel.line([(0, 0), (1, number)], Ink(line="#c80000"), label=f"entry {number % 5}")
    page = page_of(panel)
    assert [text for text in texts_of(page) if "entry" in text] == [f"entry {k}" for k in range(5)]
    boxes = [box for _, box in placed_texts(page)]
    one, other = shapely.STRtree(boxes).query(boxes, "intersects")
    assert (one == other).all()
    assert all(shapely.box(0, 0, page.width_pt, page.height_pt).covers(box) for box in boxes)


def test_panels_of_rows_are_flush_and_titles_have_room():
    long = "a title that is much longer than its panel is wide, by far"
    panels = [plan_panel((0.0, 0.0, 100.0, 100.0), 90.0) for _ in range(4)]
    panels[0].title = long
    page = page_of_rows([panels[:2], panels[2:]])
    boxes = dict(placed_texts(page))
    assert all(
        shapely.box(0, 0, page.width_pt, page.height_pt).covers(box) for box in boxes.values()
    )
    lefts = [layer.window[0] for layer in page.layers if layer.window]
    assert lefts[0] == lefts[2] < lefts[1] == lefts[3]


def test_names_of_any_length_and_letters_give_a_picture():
    hostile = "cost $\\foo$ <script>&amp; %s\x07 \u202e 樹 " * 40
    panel = plan_panel((0.0, 0.0, 100.0, 100.0), 200.0)
    panel.title = panel.x_name = hostile
    panel.line([(0, 0), (1, 1)], Ink(line="#c80000"), label=hostile)
    page = page_of(panel)
    assert max(map(len, texts_of(page))) <= MOST_LETTERS + 5
    ET.fromstring(page_svg(page))  # noqa: S314
    assert b"<script" not in page_svg(page)
    assert page_png(page).startswith(b"\x89PNG")
    assert page_pdf(page).startswith(b"%PDF")


def operators_of(pdf):
    """Return the numbers before each operator of a page, in order, by operator."""
    streams = re.findall(rb"/ASCII85Decode /FlateDecode.*?stream\s(.*?)~>", pdf, re.DOTALL)
    texts = [zlib.decompress(base64.a85decode(one)).decode("latin-1") for one in streams]
    (text,) = [one for one in texts if " cm" in one]
    found = defaultdict(list)
    for numbers, name in re.findall(r"((?:-?[\d.]+ )+)(re|m|l|c|cm|Tm)\b", text):
        found[name].append(tuple(map(float, numbers.split())))
    return found


def test_a_page_as_pdf_has_everything_in_its_place_upside_up():
    ink = Ink(line="#000000")
    layers = (
        Layer(primitives=(Shape([np.array([(10.0, 20.0), (30.0, 45.0)])], ink),),
              window=(5.0, 15.0, 50.0, 60.0)),
        Layer(primitives=(Raster((12.0, 24.0, 30.0, 31.0), np.zeros((2, 2, 4), np.uint8)),)),
        Layer(primitives=(Marks(np.array([(40.0, 22.0)]), "^", 8.0, ink),)),
        Layer(primitives=(Marks(np.array([(60.0, 23.0)]), "o", 6.0, ink),)),
        Layer(primitives=(Words((50.0, 30.0), "up", 10.0, shift_pt=(2.0, 7.0), turned=True),)),
    )  # fmt: skip
    found = operators_of(page_pdf(Page(width_pt=100.0, height_pt=80.0, layers=layers)))
    assert found["re"] == [(5.0, 20.0, 45.0, 45.0)]
    assert found["m"][:2] == [(10.0, 60.0), (40.0, 62.0)]  # the tip of the sign is its top
    assert found["l"] == [(30.0, 35.0), (44.0, 54.0), (36.0, 54.0)]
    assert (found["m"][2][1], {y for *_, y in found["c"]}) == (57.0, {54.0, 57.0, 60.0})
    assert (18.0, 0.0, 0.0, 7.0, 12.0, 49.0) in found["cm"]
    assert (0.0, 1.0, -1.0, 0.0, 52.0, 57.0) in found["cm"]  # turned to the left
    (tm,) = found["Tm"]
    assert tm == (1.0, 0.0, 0.0, 1.0, 0.0, pytest.approx(-10.0 * MIDDLE))


def test_the_same_page_gives_the_same_bytes():
    panel = plan_panel((0.0, 0.0, 100.0, 100.0), 100.0)
    panel.polygons([HOLLOW], Ink(fill="#c80000", line="#000000", dash_pt=(3.0, 2.0)))
    panel.add(Marks(np.array([(20.0, 20.0)]), "+", 8.0, Ink(line="#000000")))
    panel.add(Raster((0.0, 0.0, 50.0, 50.0), blended(np.eye(4), ("#ffffff", "#000000"))))
    for write in (page_svg, page_png, page_pdf):
        assert write(page_of(panel)) == write(page_of(panel))


def test_widths_of_letters_are_those_of_the_font():
    import matplotlib as mpl  # noqa: PLC0415

    font = ImageFont.truetype(f"{mpl.get_data_path()}/fonts/ttf/DejaVuSans.ttf", 200)
    for text in ("Growth model: inflated, 12.5 mm [0.1, 0.9]", "WiM~{}", "level 1 (3 of 18)"):
        assert text_width(text, 200.0) == pytest.approx(font.getlength(text), rel=0.03)
    assert text_width(fitted("W" * 500, 80.0, 8.0), 8.0) <= 80.0


def test_text_in_pictures_can_be_searched():
    panel = paper(100.0, 20.0)
    panel.written((5.0, 5.0), "1.  B into A", 8.0)
    assert re.search(
        r'xml:space="preserve".*>1\.  B into A</text>',
        page_svg(page_of_paper(panel)).decode(),
        re.DOTALL,
    )
