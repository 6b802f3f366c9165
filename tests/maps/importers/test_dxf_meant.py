"""DXF drawings as CAD programs show them: widths, heights, blocks and rooms of lines.

Right areas are those of the figures that are drawn here.
"""

import math
import re
import shlex

import ezdxf
import pytest

from vinefab.core.errors import BadInputError, UnfitInputError
from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.importers.importers import import_map

FINE = ImportOptions(simplify_mm=0.001)


@pytest.fixture
def drawn(tmp_path):
    """Return a function that draws in bounds of 400 x 300 mm and returns the imported map."""

    def draw(add, options=FINE, *, bounds=True, name="plan.dxf", **header):
        document = ezdxf.new("R2010")
        document.header["$INSUNITS"] = 4
        for key, value in header.items():
            document.header[f"${key}"] = value
        space = document.modelspace()
        if bounds:
            space.add_lwpolyline([(0, 0), (400, 0), (400, 300), (0, 300)], close=True)
        add(space)
        document.saveas(tmp_path / name)
        return import_map(tmp_path / name, options)

    return draw


def closed_ring(space):
    ring = [(100, 100), (150, 100), (150, 140), (100, 140)]
    space.add_lwpolyline(ring, close=True, dxfattribs={"const_width": 10})


def old_ring(space):
    ring = [(100, 100), (150, 100), (150, 140), (100, 140)]
    wide = {"default_start_width": 10, "default_end_width": 10}
    space.add_polyline2d(ring, close=True, dxfattribs=wide)


def donut(space):
    halves = [(100, 100, 1), (140, 100, 1)]
    space.add_lwpolyline(halves, format="xyb", close=True, dxfattribs={"const_width": 12})


def disc(space):
    halves = [(100, 100, 1), (140, 100, 1)]
    space.add_lwpolyline(halves, format="xyb", close=True, dxfattribs={"const_width": 40})


def arrow(space):
    space.add_lwpolyline([(100, 100, 20, 0), (160, 100, 0, 0)], format="xyse")


WIDE = {
    "ring": (closed_ring, 60 * 50 - 40 * 30),
    "old ring": (old_ring, 60 * 50 - 40 * 30),
    "wall": (
        lambda s: s.add_lwpolyline([(100, 0), (100, 200)], dxfattribs={"const_width": 10}),
        2000,
    ),
    "donut": (donut, math.pi * (26**2 - 14**2)),
    "disc": (disc, math.pi * 40**2),
    "arrow": (arrow, 600),
}


@pytest.mark.parametrize("kind", WIDE)
def test_a_line_with_a_width_is_a_wall_of_it(drawn, kind):
    add, area = WIDE[kind]
    world = drawn(add)
    assert 120_000 - world.free_space.area == pytest.approx(area, rel=1e-4)


def test_a_room_whose_wall_has_a_width_is_the_space_in_it(drawn):
    corners = [(0, 0), (400, 0), (400, 300), (0, 300)]
    world = drawn(
        lambda s: s.add_lwpolyline(corners, close=True, dxfattribs={"const_width": 20}),
        bounds=False,
    )
    assert world.size_mm == pytest.approx((420, 320))
    assert world.free_space.area == pytest.approx(380 * 280)


def test_heights_that_change_no_plan_are_counted(drawn):
    def add(space):
        space.add_line((50, 50, 0), (50, 50, 100))
        space.add_polyline3d(
            [(100, 100, 0), (140, 100, 2), (140, 120, 2), (100, 120, 1)], close=True
        )

    world = drawn(add)
    assert world.free_space.area == pytest.approx(120_000 - 800)
    assert world.facts["vertical_lines_left_out"] == 1
    assert world.facts["largest_rise_in_units"] == 100.0


def test_heights_that_matter_are_named_and_flatten_sees_them_from_above(drawn):
    def add(space):
        space.add_polyline3d([(100, 100, 0), (140, 100, 30), (140, 120, 0)], close=True)

    with pytest.raises(
        UnfitInputError, match=r"POLYLINE \(handle .*z from 0 to 30; --flatten sees"
    ):
        drawn(add)
    assert drawn(add, ImportOptions(flatten=True)).free_space.area == pytest.approx(120_000 - 400)


def test_blocks_of_height_zero_and_what_never_plots(drawn):
    def add(space):
        block = space.doc.blocks.new("TABLE")
        block.add_lwpolyline([(0, 0), (40, 0), (40, 20), (0, 20)], close=True)
        outer = space.doc.blocks.new("ROOM")
        outer.add_blockref("TABLE", (100, 100), dxfattribs={"zscale": 0.0})
        space.add_blockref("ROOM", (0, 0), dxfattribs={"zscale": 0.0})
        space.add_circle((300, 100), 20, dxfattribs={"layer": "Defpoints"})

    world = drawn(add)
    assert world.free_space.area == pytest.approx(120_000 - 800)
    assert world.facts["ignored"] == {"on layer Defpoints, which never plots": 1}


@pytest.mark.parametrize(
    ("size", "measurement", "mm"), [(16, 0, 25.4), (16, 1, 1.0), (400, 0, 1.0)]
)
def test_a_drawing_without_unit_is_in_inches_where_it_is_english_and_fits(
    drawn, size, measurement, mm
):
    world = drawn(
        lambda s: s.add_lwpolyline([(0, 0), (size, 0), (size, 12), (0, 12)], close=True),
        bounds=False,
        INSUNITS=0,
        MEASUREMENT=measurement,
    )
    assert world.size_mm[0] == pytest.approx(size * mm)
    assert ("English" in world.facts["unit"]) == (measurement == 0)


ROOM = [((0, 0), (800, 0)), ((800, 0), (800, 600)), ((800, 600), (450, 600)),
        ((350, 600), (0, 600)), ((0, 600), (0, 0))]  # fmt: skip


def test_a_room_of_lines_with_a_door_takes_the_command_that_is_proposed(drawn, tmp_path):
    def add(space):
        for begin, end in ROOM:
            space.add_line(begin, end)
        for x in (100, 300):
            space.add_lwpolyline([(x, 100), (x + 50, 100), (x + 50, 140), (x, 140)], close=True)

    with pytest.raises(BadInputError) as caught:
        drawn(add, bounds=False, name="my plan.dxf")
    message = str(caught.value)
    assert re.search(r"LINE \(handle \w+\) from \(\d+, \d+\) to \(\d+, \d+\)", message)
    ends = {
        tuple(map(int, re.findall(r"\d+", pair)))
        for pair in re.findall(r"from (.*? to \(.*?\))", message)
    }
    assert ends <= {(*begin, *end) for begin, end in ROOM}
    words = shlex.split(message.partition("assumed): ")[2])
    assert words[:4] == ["vinefab", "map", "import", str(tmp_path / "my plan.dxf")]
    options = dict(zip(words[4::2], words[5::2], strict=True))
    world = import_map(
        tmp_path / "my plan.dxf",
        ImportOptions(
            wall_mm=float(options["--wall-mm"]),
            open_lines=options["--open"],
            bounds=options["--bounds"],
            margin_mm=float(options["--margin-mm"]),
        ),
    )
    assert world.size_mm == (804, 604)
    assert world.free_space.area == pytest.approx(796 * 596 + 100 * 4 - 2 * 50 * 40)
