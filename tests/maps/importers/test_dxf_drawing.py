import io
import math
import subprocess
from itertools import pairwise

import ezdxf
import numpy as np
import pytest
import shapely
from ezdxf.math import fit_points_to_cad_cv
from shapely import Polygon

from vinefab.core import bounded
from vinefab.core.errors import BadInputError, UnknownNameError, UnreadableFileError
from vinefab.maps.generators.grid import grid_map
from vinefab.maps.importers import dxf_drawing, source_drawing
from vinefab.maps.importers.import_options import ImportOptions
from vinefab.maps.importers.importers import import_map
from vinefab.model.map import Map, map_text

VERSIONS = ("R12", "R2000", "R2010", "R2018")
BOX = [(0, 0), (500, 0), (500, 400), (0, 400)]
FINE = ImportOptions(simplify_mm=0.001)


@pytest.fixture
def drawn(tmp_path):
    """Return a function that draws in a file with bounds of 500 x 400 mm and imports it."""

    def draw(add, version="R2010", options=FINE, units=4, *, bounds=True):
        document = ezdxf.new(version)
        if version != "R12":
            document.units = units
        space = document.modelspace()
        if bounds:
            space.add_polyline2d(BOX, close=True)
        add(space)
        path = tmp_path / "drawing.dxf"
        document.saveas(path)
        return import_map(path, options)

    return draw


def add_square_of_lines(space):
    for a, b in pairwise([(10, 10), (30, 10), (30, 30), (10, 30), (10, 10)]):
        space.add_line(b, a)


def add_half_disc(space):
    space.add_arc((100, 100), 20, 0, 180)
    space.add_line((80, 100), (120, 100))


def add_stadium(space):
    vertices = [(50, 50, 0), (100, 50, 1), (100, 90, 0), (50, 90, -0.5)]
    space.add_polyline2d(vertices, format="xyb", close=True)


def add_insert(space):
    block = space.doc.blocks.new("PILLAR")
    block.add_circle((10, 0), 5)
    outer = space.doc.blocks.new("PAIR")
    outer.add_blockref("PILLAR", (0, 0))
    outer.add_blockref("PILLAR", (0, 0), dxfattribs={"rotation": 180, "xscale": 2, "yscale": 2})
    space.add_blockref("PAIR", (200, 200), dxfattribs={"rotation": 30, "xscale": 2, "yscale": -1})


BULGE = 40**2 / 8 * math.pi
DENT = 25**2 * 2 * math.atan(0.5) - 15 * 20
ANY_VERSION = {
    "lines": (add_square_of_lines, 400),
    "circle": (lambda space: space.add_circle((60, 60), 30), 900 * math.pi),
    "arc and line": (add_half_disc, 200 * math.pi),
    "polyline with bulges": (add_stadium, 50 * 40 + BULGE - DENT),
    "solid": (lambda space: space.add_solid([(10, 10), (40, 10), (10, 40), (40, 40)]), 900),
    "trace": (lambda space: space.add_trace([(10, 10), (40, 10), (20, 40), (30, 40)]), 600),
    "nested blocks": (add_insert, 2 * 25 * math.pi * (1 + 4)),
}


@pytest.mark.parametrize("version", VERSIONS)
@pytest.mark.parametrize("kind", ANY_VERSION)
def test_entities_that_every_version_has(drawn, kind, version):
    add, area = ANY_VERSION[kind]
    world = drawn(add, version)
    assert sum(p.area for p in world.obstacles) == pytest.approx(area, rel=1e-4)
    assert world.bounds.area == 200_000
    assert world.facts["dxf_version"] == version


def add_hatch_with_island(space):
    hatch = space.add_hatch()
    hatch.paths.add_polyline_path([(40, 40), (120, 40), (120, 120), (40, 120)], is_closed=True)
    edges = hatch.paths.add_edge_path(flags=16)
    edges.add_arc((80, 80), 20, 0, 360)


def add_hatch_of_edges(space):
    edges = space.add_hatch().paths.add_edge_path()
    edges.add_line((160, 50), (220, 50))
    edges.add_arc((220, 90), 40, -90, 90)
    edges.add_line((160, 130), (220, 130))  # against the direction of the others
    edges.add_ellipse((160, 90), (0, 40), 0.5, 0, 180)


def add_hatch_of_splines(space):
    edges = space.add_hatch().paths.add_edge_path()
    # Two quarter circles as rational curves, which only weights can make exact.
    for points in ([(60, 20), (60, 60), (20, 60)], [(-20, 20), (-20, -20), (20, -20)]):
        edges.add_spline(
            control_points=[(x + 100, y + 100) for x, y in points],
            weights=[1, math.sqrt(0.5), 1],
            degree=2,
            knot_values=[0, 0, 0, 1, 1, 1],
        )
        (x, y), (u, v) = ((20, 60), (-20, 20)) if points[0] == (60, 20) else ((20, -20), (60, 20))
        edges.add_line((x + 100, y + 100), (u + 100, v + 100))


def add_closed_spline(space):
    space.add_spline().set_closed(
        [(60, 60, 0), (100, 60, 0), (100, 100, 0), (60, 100, 0)], degree=2
    )


def add_mesh(space):
    with space.add_mesh().edit_data() as data:
        data.vertices = [(0, 0, 0), (9, 0, 0), (0, 9, 9)]
        data.faces = [(0, 1, 2)]


def add_mirrored(space):
    below = {"extrusion": (0, 0, -1)}
    space.add_lwpolyline([(-100, 50, 1), (-140, 50, 0)], "xyb", close=True, dxfattribs=below)
    hatch = space.add_hatch(dxfattribs=below)
    hatch.paths.add_edge_path().add_arc((-200, 200), 10, 0, 360)


NEWER = {
    "lwpolyline": (
        lambda s: s.add_lwpolyline([(10, 60, 1), (50, 60, 1)], "xyb", close=True),
        400 * math.pi,
    ),
    "ellipse": (lambda s: s.add_ellipse((100, 100), (40, 10), 0.4), 0.4 * 1700 * math.pi),
    # A closed quadratic B-spline over a square: 5/6 of it.
    "closed spline": (add_closed_spline, 1600 * 5 / 6),
    "hatch with island": (add_hatch_with_island, 6400 - 400 * math.pi),
    "hatch of edges": (add_hatch_of_edges, 60 * 80 + 800 * math.pi + 0.5 * math.pi * 40 * 20),
    "hatch of splines": (add_hatch_of_splines, 3200 + 2 * (400 * math.pi - 800)),
    "seen from below": (add_mirrored, 0.5 * 400 * math.pi + 100 * math.pi),
}


@pytest.mark.parametrize("version", VERSIONS[1::2])
@pytest.mark.parametrize("kind", NEWER)
def test_entities_that_newer_versions_have(drawn, kind, version):
    add, area = NEWER[kind]
    world = drawn(add, version)
    assert sum(p.area for p in world.obstacles) == pytest.approx(area, rel=2e-4)


def test_mirrored_entities_lie_where_they_are_seen(drawn):
    world = drawn(add_mirrored)
    assert sorted(round(p.centroid.x) for p in world.obstacles) == [120, 200]
    assert min(p.bounds[1] for p in world.obstacles) == pytest.approx(50, abs=0.01)


@pytest.mark.parametrize(("units", "mm"), [(1, 25.4), (2, 304.8), (4, 1), (5, 10), (6, 1000)])
def test_units_are_honoured(drawn, units, mm):
    world = drawn(lambda s: s.add_circle((60, 60), 30), units=units, options=ImportOptions())
    assert world.size_mm == pytest.approx((500 * mm, 400 * mm))
    assert world.facts["scale_mm_per_unit"] == mm


def test_the_scale_is_per_unit_of_the_file_and_a_missing_unit_is_reported(drawn):
    tenth = ImportOptions(scale_mm_per_unit=0.1)
    assert drawn(lambda _: None, units=6, options=tenth).size_mm == (50, 40)
    world = drawn(lambda _: None, units=0)
    assert world.size_mm == (500, 400)
    assert "names none" in world.facts["unit"]


def test_layers_are_chosen_and_hidden_ones_counted(drawn):
    def add(space):
        layers = space.doc.layers
        layers.add("OFF").off()
        layers.add("FROZEN").freeze()
        layers.add("WALLS")
        for layer in ("OFF", "FROZEN", "WALLS", "0"):
            x = 60 + 80 * len(layer)
            space.add_circle((x, 60), 30, dxfattribs={"layer": layer})
        block = space.doc.blocks.new("B")
        block.add_circle((0, 0), 10)
        space.add_blockref("B", (100, 300), dxfattribs={"layer": "WALLS"})
        space.add_text("kitchen")

    world = drawn(add)
    assert len(world.obstacles) == 3
    assert world.facts["ignored"] == {
        "on layer OFF, which is off": 1,
        "on layer FROZEN, which is frozen": 1,
        "TEXT": 1,
    }
    box = ImportOptions(layers=("walls",), bounds="box", margin_mm=10.0)
    chosen = drawn(add, options=box)
    assert len(chosen.obstacles) == 2
    with pytest.raises(UnknownNameError, match="did you mean 'WALLS'"):
        drawn(add, options=ImportOptions(layers=("WALL",)))


def test_survey_coordinates_are_moved_near_the_origin(drawn):
    def add(space):
        x, y = 512_345.678, 5_250_345.6
        ring = [(x, y), (x + 80, y), (x + 80, y + 50), (x, y + 50)]
        hatch = space.add_hatch()
        hatch.paths.add_polyline_path(ring, is_closed=True)
        hatch.paths.add_edge_path(flags=16).add_arc((x + 30, y + 20), 5, 0, 360)
        space.add_lwpolyline(ring, close=True)

    world = drawn(add, units=6, bounds=False, options=ImportOptions(scale_mm_per_unit=10.0))
    assert world.bounds.bounds == pytest.approx((0, 0, 800, 500), abs=1e-3)
    assert world.facts["origin_at_source"] == pytest.approx([512_345.678, 5_250_345.6])
    assert world.facts["repeated_outlines_removed"] == 1
    (pillar,) = world.obstacles
    assert (pillar.centroid.x, pillar.centroid.y) == pytest.approx((300, 200), abs=0.01)


@pytest.mark.parametrize("kind", [[], ["-nlt", "LINESTRING"]])
def test_a_map_survives_another_program(tmp_path, program, kind):
    world = grid_map(4)
    ours, theirs = tmp_path / "grid.geojson", tmp_path / "grid.dxf"
    ours.write_text(map_text(world))
    chosen = ["-where", "role <> 'start'", "-lco", "x=y", "-select", ""]
    command = [program("ogr2ogr", "gdal-bin"), "-f", "DXF", theirs, ours, *chosen, *kind]
    subprocess.run(command, check=True, capture_output=True, timeout=60)
    again = import_map(theirs, ImportOptions(scale_mm_per_unit=1.0))
    assert len(again.obstacles) == len(world.obstacles)
    assert again.bounds.symmetric_difference(world.bounds).area < 1e-6
    difference = shapely.symmetric_difference(
        shapely.union_all(again.obstacles), shapely.union_all(world.obstacles)
    )
    assert difference.area < 1e-6
    assert Map.read(ours).wall_count == again.wall_count


def test_a_hand_written_file_without_any_header(tmp_path):
    path = tmp_path / "minimal.dxf"
    corners = [(0, 0), (90, 0), (90, 60), (0, 60), (0, 0)]
    tags = ["0", "SECTION", "2", "ENTITIES"]
    for (x, y), (u, v) in pairwise(corners):
        tags += ["0", "LINE", "8", "0", "10", x, "20", y, "11", u, "21", v]
    tags += ["0", "CIRCLE", "8", "0", "10", 30, "20", 30, "40", 10]
    path.write_text("\n".join(str(tag) for tag in [*tags, "0", "ENDSEC", "0", "EOF", ""]))
    world = import_map(path, FINE)
    assert world.bounds.equals(Polygon(corners))
    assert world.obstacles[0].area == pytest.approx(100 * math.pi, rel=1e-4)


REFUSED = {
    "slanted line": (lambda s: s.add_line((0, 0, 0), (9, 0, 5)), r"LINE \(handle .*3-D, z from"),
    "3-D polyline": (lambda s: s.add_polyline3d([(0, 0, 0), (9, 9, 9)]), "POLYLINE .*3-D"),
    "slanted circle": (
        lambda s: s.add_circle((0, 0), 5, dxfattribs={"extrusion": (0, 1, 1)}),
        "CIRCLE .*3-D, z from 0 to 3.5",
    ),
    "mesh": (add_mesh, "MESH .*flat drawings"),
    "open line": (
        lambda s: s.add_line((10, 20), (90, 20)),
        r"a line does not close within --join-mm \(0.1\): LINE \(handle \w+\) from \(10, 20\) to",
    ),
    "outside": (
        lambda s: s.add_circle((900, 60), 30),
        r"CIRCLE \(handle \w+\) at \(900, 60\).*outside of the largest outline.*--bounds",
    ),
    "equal points on a spline": (
        lambda s: s.add_spline([(50, 50), (50, 50), (90, 90), (50, 90)]),
        "SPLINE .*equal or infinite points",
    ),
    "block without end": (
        lambda s: s.doc.blocks.new("A").add_blockref("A", (1, 1)) and s.add_blockref("A", (0, 0)),
        r"INSERT \(handle \w+\) is 'a block A in itself'",
    ),
}


@pytest.mark.parametrize("kind", REFUSED)
def test_what_is_not_clear_is_refused_with_its_place(drawn, kind):
    add, message = REFUSED[kind]
    with pytest.raises(BadInputError, match=message) as caught:
        drawn(add)
    assert "\n" not in str(caught.value)
    assert "drawing.dxf" in str(caught.value)


@pytest.mark.parametrize("tangents", [None, [(1, 2, 0), (-3, 1, 0)]])
@pytest.mark.parametrize("count", [2, 3, 4, 9])
def test_a_spline_through_points_is_that_of_cad_programs(count, tangents):
    points = np.random.default_rng(count).uniform(0.0, 100.0, (count, 3)) * (1, 1, 0)
    expected = fit_points_to_cad_cv(points, tangents)
    found = dxf_drawing._spline_through(points, tangents or (None, None))
    assert found.knots() == pytest.approx(expected.knots(), abs=1e-12)
    assert np.allclose(found.control_points, expected.control_points, atol=1e-9)


def circle_of(count):
    turns = 2.0 * np.pi * np.arange(count + 1) / count
    points = 200.0 + 100.0 * np.column_stack([np.cos(turns), np.sin(turns)])
    return [*points[:-1], points[0]]


@pytest.mark.parametrize("as_hatch", [False, True])
def test_thousands_of_points_on_a_spline_are_read(drawn, as_hatch):
    def add(space):
        points = circle_of(5_000)
        if as_hatch:
            space.add_hatch().paths.add_edge_path().add_spline(fit_points=points)
        else:
            space.add_spline(points)

    (disc,) = drawn(add).obstacles
    assert disc.area == pytest.approx(1e4 * math.pi, rel=1e-4)


def test_a_spline_that_takes_too_many_chords_is_refused(drawn, monkeypatch):
    monkeypatch.setattr(source_drawing, "_MOST_POINTS", 5_000)
    ways = np.arange(2_000)
    controls = np.column_stack([50 + ways % 7, 50 + ways % 11, 0 * ways]).tolist()
    with pytest.raises(BadInputError, match=r"points, and 5000 are allowed"):
        drawn(lambda space: space.add_open_spline(controls))


def test_only_text_is_no_drawing(drawn):
    with pytest.raises(BadInputError, match=r"has no outlines: .*'TEXT': 2"):
        drawn(lambda s: [s.add_text("a"), s.add_text("b")], bounds=False)


def test_open_lines_may_be_dropped_or_made_walls(drawn):
    def add(space):
        space.add_line((100, 0), (100, 150))

    dropped = drawn(add, options=ImportOptions(open_lines="drop"))
    assert dropped.obstacles == ()
    assert dropped.facts["open_lines_left_out"] == 1
    assert "from (100, 0) to (100, 150)" in dropped.facts["open_lines"][0]
    walls = drawn(add, options=ImportOptions(wall_mm=10.0))
    assert walls.bounds.bounds == (-5, -5, 505, 405)
    assert walls.free_space.area == pytest.approx(490 * 390 - 10 * 145)


HUGE = {
    "bulge": lambda s: s.add_lwpolyline([(9, 9, 1e308), (80, 9, 0), (80, 60, 0)], "xyb"),
    "angle": lambda s: s.add_arc((90, 90), 40, 0, 1e308),
    "radius": lambda s: s.add_circle((90, 90), 1e308),
}


@pytest.mark.parametrize("kind", HUGE)
def test_huge_numbers_are_refused_without_a_warning(drawn, recwarn, kind):
    with pytest.raises((UnreadableFileError, BadInputError)):
        drawn(HUGE[kind])
    assert not recwarn.list


def binary(version):
    """A binary drawing of a square with a circular block in it."""
    document = ezdxf.new(version)
    document.header["$INSUNITS"] = 4
    document.modelspace().add_polyline2d(BOX, close=True)
    document.blocks.new("B").add_circle((0, 0), 10)
    document.modelspace().add_blockref("B", (150, 100), dxfattribs={"xscale": 2, "yscale": 2})
    stream = io.BytesIO()
    document.write(stream, fmt="bin")
    return stream.getvalue()


@pytest.mark.parametrize("version", VERSIONS)
def test_binary_drawings(tmp_path, version):
    path = tmp_path / "binary.dxf"
    path.write_bytes(binary(version))
    world = import_map(path, FINE)
    assert world.bounds.area == 200_000
    assert world.obstacles[0].area == pytest.approx(400 * math.pi, rel=1e-4)


@pytest.mark.parametrize(("version", "lost"), [("R12", 14), ("R2010", 59), ("R2010", 9000)])
def test_truncated_binary_drawings(tmp_path, version, lost):
    path = tmp_path / "broken.dxf"
    path.write_bytes(binary(version)[:-lost])  # within a number, but for the last
    with pytest.raises(UnreadableFileError, match=r"not a DXF file|damaged"):
        import_map(path, ImportOptions())


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"AutoCAD Binary DXF\r\n" + bytes(5_000_000), "is not a DXF file"),
        (b"0\nLINE\n" * 900_000, "cannot be read within 1 s"),
    ],
    ids=["binary", "text"],
)
def test_large_files_without_a_drawing_are_refused(tmp_path, limits, data, words):
    limits.setattr(bounded, "_CPU_S", 1)
    limits.setattr(bounded, "_CPU_S_PER_MB", 0)
    path = tmp_path / "large.dxf"
    path.write_bytes(data)
    with pytest.raises(UnreadableFileError, match=words):
        import_map(path, ImportOptions())


@pytest.mark.parametrize("value", ["6Q0.0", "nan", "1e300", "inf"])
def test_numbers_that_can_only_be_guessed_or_are_no_places_are_refused(drawn, tmp_path, value):
    drawn(lambda s: s.add_circle((60, 60), 30))
    path = tmp_path / "drawing.dxf"
    text = path.read_text()
    assert "\n60.0\n" in text
    path.write_text(text.replace("\n60.0\n", f"\n{value}\n", 1))
    with pytest.raises(
        (UnreadableFileError, BadInputError), match=r"damaged.*6Q0\.0|finite|size|wide"
    ):
        import_map(path, ImportOptions())
