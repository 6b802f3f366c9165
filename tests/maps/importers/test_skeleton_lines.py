"""Skeletons drawn in other programs: lines, curves, units, the marked base, and what is no tree."""

import itertools
import json
import math
import resource
import time
from pathlib import Path

import ezdxf
import numpy as np
import pytest

from vinefab.cli.main import main
from vinefab.maps.importers.skeleton_lines import chords
from vinefab.model.design import Design


@pytest.fixture(autouse=True)
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def drawn(file, *options):
    """Return the design of a drawing."""
    assert main(["new", "design", "drawn.toml", "--skeleton", file, "--force", *options]) == 0
    return Design.read("drawn.toml")


def refusal(capsys, file, *options):
    """Return the line by which a drawing is refused."""
    assert main(["new", "design", "drawn.toml", "--skeleton", file, *options]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    return said


def dxf(*, units=4, base=None, **layers):
    """Write polylines by layer, and a point on the layer ``base``."""
    document = ezdxf.new("R2010", units=units)
    space = document.modelspace()
    for layer, lines in layers.items():
        for line in lines:
            space.add_lwpolyline(line, dxfattribs={"layer": layer})
    if base is not None:
        space.add_point(base, dxfattribs={"layer": "Base"})
    document.saveas("a.dxf")


def svg(inside, head='width="300mm" height="400mm" viewBox="0 0 300 400"'):
    Path("a.svg").write_text(f'<svg xmlns="http://www.w3.org/2000/svg" {head}>{inside}</svg>')


def geojson(*features):
    made = [
        {"type": "Feature", "properties": named, "geometry": {"type": kind, "coordinates": at}}
        for kind, at, named in features
    ]
    Path("a.geojson").write_text(json.dumps({"type": "FeatureCollection", "features": made}))


TRUNK = [(0, 0), (0, 100)]
LEFT, RIGHT = [(0, 100), (-60, 160), (-60, 220)], [(0, 100), (50, 180)]


def test_polylines_of_a_dxf_are_branches_with_bends():
    dxf(lines=[TRUNK, LEFT, RIGHT[::-1]])
    design = drawn("a.dxf")
    assert design.names == ("trunk", "0", "1")
    assert design.tree.length_mm == pytest.approx([100, math.hypot(50, 80), 60 * math.sqrt(2) + 60])
    assert np.degrees(design.tree.bend_rad) == pytest.approx([-45.0])


def test_units_are_those_of_maps(capsys):
    dxf(units=5, lines=[[(0, 0), (0, 10)]])
    assert drawn("a.dxf").trunk_length_mm == 100.0
    assert "unit cm" in capsys.readouterr().out
    assert drawn("a.dxf", "--scale-mm-per-unit", "25.4").trunk_length_mm == pytest.approx(254.0)
    assert "unit cm, as given" in capsys.readouterr().out
    svg('<path d="M0 0V96"/>', head="")
    assert drawn("a.svg").trunk_length_mm == pytest.approx(25.4)
    svg('<g transform="scale(2)"><path d="M0 0V50"/></g>')
    assert drawn("a.svg").trunk_length_mm == pytest.approx(100.0)


def test_arcs_and_splines_become_bends_within_a_chord_tolerance():
    document = ezdxf.new("R2010", units=4)
    space = document.modelspace()
    space.add_line((0, 0), (0, 100))
    space.add_arc((-200, 100), 200, 0, 90)
    document.saveas("a.dxf")
    design = drawn("a.dxf", "--trunk-width-mm", "20", "--chord-mm", "1.5")
    turns = np.degrees(design.tree.bend_rad)
    # A chord of an arc of radius r that turns by t is r (1 - cos(t / 2)) off; both of its ends
    # turn by half of it, so that the first bend, where the arc begins, is half as large.
    each = math.degrees(2.0 * math.acos(1.0 - 1.5 / 200.0))
    count = math.ceil(90.0 / each)
    assert turns[0] == pytest.approx(45.0 / count, abs=0.2)
    assert turns[1:] == pytest.approx([90.0 / count] * (count - 1), abs=0.5)
    chain_mm = 100.0 + count * 400.0 * math.sin(math.radians(45.0 / count))
    assert design.trunk_length_mm == pytest.approx(chain_mm, abs=0.01)
    svg('<path d="M150 400V300C150 200 60 200 60 100"/>')
    bent = drawn("a.svg", "--trunk-width-mm", "10")
    assert len(bent.tree.bend_mm) >= 3
    x, y, heading = 150.0, 0.0, math.pi / 2
    for at, step in zip(
        [*bent.tree.bend_rad, 0.0], np.diff([0.0, *bent.tree.bend_mm, bent.trunk_length_mm]),
        strict=True,
    ):  # fmt: skip
        x, y = x + step * math.cos(heading), y + step * math.sin(heading)
        heading += at
    assert (x, y) == pytest.approx((60.0, 300.0), abs=1e-6)


def test_chords_are_the_fewest_and_no_point_is_farther_off_than_allowed():
    rng = np.random.default_rng(2)
    for _ in range(20):
        share = np.linspace(0.0, 1.0, 400)[:, None]
        a, b, c, d = rng.uniform(0, 200, (4, 2))
        rest = 1.0 - share
        curve = rest**3 * a + 3 * rest**2 * share * b + 3 * rest * share**2 * c + share**3 * d
        found = chords(curve, 2.0)
        rows = [int(np.flatnonzero((curve == one).all(axis=1))[0]) for one in found]
        assert (rows[0], rows[-1]) == (0, 399)
        for one, two in itertools.pairwise(rows):
            along = (curve[two] - curve[one]) / np.linalg.norm(curve[two] - curve[one])
            from_one = curve[one : two + 1] - curve[one]
            on = np.clip(from_one @ along, 0, np.linalg.norm(curve[two] - curve[one]))
            assert np.linalg.norm(from_one - on[:, None] * along, axis=1).max() <= 2.0 + 1e-9
        assert len(chords(curve, 4.0)) <= len(found) <= len(chords(curve, 1.0))


def test_the_base_is_the_end_that_is_marked(capsys):
    down = [(0, 100), (50, 0), (50, -50)]  # lower than the base
    dxf(lines=[TRUNK, LEFT, down], base=(0, 0))
    assert drawn("a.dxf").trunk_length_mm == 100.0
    assert "base at (0, 0) (as marked), heading 90" in capsys.readouterr().out
    assert drawn("a.dxf", "--base=50,-50").origin["drawn_at"] == [50.0, -50.0, 90.0]
    dxf(others=[LEFT, down], BASE=[TRUNK])
    assert drawn("a.dxf").trunk_length_mm == 100.0
    dxf(lines=[TRUNK, LEFT, down])
    assert drawn("a.dxf").origin["drawn_at"] == [50.0, -50.0, 90.0]
    assert "(the lowest)" in capsys.readouterr().out
    svg('<path d="M100 300V200M100 200L200 250V390"/><circle id="base" cx="100" cy="300" r="3"/>')
    assert drawn("a.svg").origin["drawn_at"] == pytest.approx([100.0, 100.0, 90.0])
    svg('<g id="x"><path d="M100 200L200 250V390"/></g><g id="base"><path d="M100 300V200"/></g>')
    assert drawn("a.svg").origin["drawn_at"] == pytest.approx([100.0, 100.0, 90.0])
    geojson(
        ("LineString", [*TRUNK], {}), ("LineString", down, {}), ("Point", [0, 0], {"name": "base"})
    )
    assert drawn("a.geojson").origin["drawn_at"] == [0.0, 0.0, 90.0]


def test_only_the_layers_asked_for_are_read(capsys):
    dxf(robot=[TRUNK, LEFT], frame=[[(-500, -500), (500, -500), (500, 500), (-500, -500)]])
    assert "joined to no others" in refusal(capsys, "a.dxf")
    assert drawn("a.dxf", "--layer", "robot").branch_count == 1
    assert "did you mean 'robot'" in refusal(capsys, "a.dxf", "--layer", "robots")


def test_widths_of_lines_are_lay_flat_widths():
    geojson(("LineString", TRUNK, {"width": 30}), ("LineString", RIGHT, {"width": 12.5}))
    assert drawn("a.geojson").tree.width_mm.tolist() == [30.0, 12.5]
    svg('<path d="M0 400V300" data-width="30" stroke-width="2"/><path d="M0 300V200"/>')
    assert drawn("a.svg").tree.width_mm.tolist() == [30.0]


def test_the_white_page_of_an_svg_is_no_line():
    svg('<rect width="300" height="400" fill="#fff"/><path d="M150 400V200"/>')
    assert drawn("a.svg").trunk_length_mm == 200.0


REFUSED = [
    (lambda: dxf(a=[TRUNK, LEFT], base=(0, 100)), [], "base: (0, 100) lies in the middle"),
    (lambda: dxf(a=[TRUNK, LEFT], base=(5, 5)), [], "no line ends within 1 mm of (5, 5)"),
    (lambda: dxf(BASE=[TRUNK, LEFT, RIGHT]), [], "calls 3 places base: (0, 0), (-60, 220)"),
    (lambda: dxf(a=[TRUNK, [(3, 100), (50, 150)]]), [], "at (3, 100) are joined to no others"),
    (lambda: dxf(a=[TRUNK, [*LEFT, (-60, 300), (0, 100)]]), [], "lines close a loop at (0, 100)"),
    (dxf, [], "a.dxf: the drawing has no lines: nothing"),
    (lambda: dxf(a=[TRUNK], units=1), ["--snap-mm", "-1"], "snap"),
    (lambda: dxf(a=[TRUNK]), ["--chord-mm", "0"], "chord-mm is 0"),
    (lambda: dxf(a=[TRUNK]), ["--scale-mm-per-unit", "nan"], "scale-mm-per-unit is nan"),
    (lambda: dxf(a=[TRUNK]), ["--scale-mm-per-unit", "1e8"], "segments[1]"),
    (lambda: dxf(a=[[(0, 0), (0, 0.4)]]), [], "a line at (0, 0) is 0.4 mm long"),
]


@pytest.mark.parametrize(("make", "options", "message"), REFUSED)
def test_what_is_no_tree_is_refused_by_its_place(make, options, message, capsys):
    make()
    assert message in refusal(capsys, "a.dxf", *options)


def test_closed_outlines_and_foreign_files_are_refused(capsys, here):
    svg('<path d="M0 400V200"/><circle id="peg" cx="20" cy="30" r="5"/>')
    assert "circle 'peg' (line 1) is closed, or an area, around (20, 370) mm" in refusal(
        capsys, "a.svg"
    )
    geojson(("Polygon", [[[0, 0], [9, 0], [9, 9], [0, 0]]], {}))
    assert "features[1] is closed" in refusal(capsys, "a.geojson")
    (here / "a.stl").write_text("solid")
    assert "a file ending in .csv, .dxf, .svg" in refusal(capsys, "a.stl")
    (here / "b.dxf").write_bytes(b"AC1032 and so on")
    assert "is a DWG file" in refusal(capsys, "b.dxf")
    assert "no such file" in refusal(capsys, "none.dxf")
    assert "layer means nothing for a CSV" in _layered_csv(capsys, here)
    assert main(["new", "design", "x.toml", "--chord-mm", "2"]) == 2
    assert "--chord-mm needs a drawing" in capsys.readouterr().err


def _layered_csv(capsys, here):
    (here / "a.csv").write_text("0,0,0,100\n")
    return refusal(capsys, "a.csv", "--layer", "0")


@pytest.mark.parametrize("count", [1001, pytest.param(120_000, marks=pytest.mark.thorough)])
def test_huge_drawings_are_refused_in_bounded_time_and_memory(count, capsys):
    lines = [[(0, 0), (0, 100)]] + [[(0, 100), (2 * n - count, 3000)] for n in range(count)]
    geojson(*(("LineString", line, {}) for line in lines))
    begin = time.perf_counter()
    said = refusal(capsys, "a.geojson")
    assert "at most 1000 branches" in said or "1 to 100000" in said
    assert time.perf_counter() - begin < 60.0
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss < 2**21


def test_ten_thousand_bends_are_answered(capsys):
    turn = np.cumsum(np.where(np.arange(10_001) % 4 < 2, 0.1, -0.1))
    steps = 50.0 * np.column_stack([np.sin(turn), np.cos(turn)])
    points = np.vstack([[0.0, 0.0], np.cumsum(steps, axis=0)])
    geojson(("LineString", points.tolist(), {}))
    assert "bends of the line from (0, 0) to" in (said := refusal(capsys, "a.geojson"))
    assert "at most 1000 of one branch" in said
