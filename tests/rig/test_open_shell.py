"""Obstacles as open shells."""

import math
import re
import subprocess
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import settings as effort
from hypothesis import strategies as st
from shapely import Polygon, box

from vinefab.core.errors import BadInputError
from vinefab.maps.generators.corridors import CorridorsOptions, corridors_map
from vinefab.maps.generators.grid import GridOptions, grid_map
from vinefab.maps.generators.rubble import RubbleOptions, rubble_map
from vinefab.rig.build import build_board, build_rig, compare_with_map
from vinefab.rig.make import RigRequest, make_rig
from vinefab.rig.part import Mesh, Printer, RigOptions, manifold_of, read_printer
from vinefab.rig.part_files import (
    JERK_MM_S,
    STL,
    PartFileSpec,
    PartItem,
    print_estimate,
    printing_of,
    read_back_problems,
)
from vinefab.rig.rig_plan import polygon_parts
from vinefab.rig.solid import (
    CORBEL_STEP_MM,
    LEAST_ROOM_MM,
    RIB_SPAN_MM,
    Course,
    built_of,
    cavities_in,
    outlines_at,
    plan_volume_mm3,
    shell_wall_mm,
    shell_walls,
)

PRINTER = Printer(name="bench", bed_width_mm=220, bed_depth_mm=220, height_mm=100)
BOARD = RigOptions(style="board", most_parts=200)


def _problems(part):
    item = PartItem(part=part)
    return read_back_problems(STL, STL.write(PartFileSpec(items=[item], title=part.name)), [item])[
        part.name
    ]


def _is_wall(shape, wall_mm):
    """Tell whether a shape is nowhere thinner than a wall: what an opening loses is crumbs."""
    opened = shape.buffer(-0.5 * wall_mm + 2e-3).buffer(0.5 * wall_mm + 1e-3, quad_segs=32)
    corners_mm2 = 0.05 * wall_mm**2  # an opening rounds every corner off
    lost = shapely.get_parts(shape.difference(opened))
    return bool((shapely.area(lost) < corners_mm2 + wall_mm**2).all()) and not opened.is_empty


@effort(max_examples=3)
@given(
    seed=st.integers(0, 10_000),
    scale=st.sampled_from([0.3, 0.6, 1.0]),
    wall_mm=st.sampled_from([0.8, 1.2, 1.6]),
    top_mm=st.sampled_from([0.0, 0.0, 0.8]),
)
def test_shells_are_closed_solids_within_the_obstacle(seed, scale, wall_mm, top_mm):
    world = grid_map(seed, GridOptions(columns=2, rows=2, size_mm=180.0))
    options = BOARD.changed(scale=scale, wall_mm=wall_mm, top_mm=top_mm)
    rig, pieces = build_board(world, PRINTER, options)
    comparison = compare_with_map(rig, world)
    assert comparison.share < 1e-3
    for part, piece in zip(rig.parts, pieces, strict=True):
        assert _problems(part) == ()
        whole = piece.outline.area * 30.0 + sum(peg.outline.area for peg in piece.pegs) * 2.8
        assert part.volume_mm3 <= whole * (1.0 + 1e-6)
        cavities = cavities_in(piece.outline, wall_mm)
        assert part.hollow == bool(len(cavities))
        for one in cavities:
            assert piece.outline.exterior.distance(one) >= wall_mm
            others = shapely.union_all([other for other in cavities if other is not one])
            assert others.is_empty or one.distance(others) >= wall_mm
            assert not one.buffer(-0.49 * LEAST_ROOM_MM).is_empty
    assert any(part.hollow for part in rig.parts)


def test_the_cut_of_a_shell_is_a_wall_all_around():
    # From the triangles, not from the plan: half way up, between top and corbels.
    world = grid_map(3, GridOptions(columns=2, rows=2, size_mm=180.0))
    rig, pieces = build_board(world, PRINTER, BOARD)
    for part, piece in zip(rig.parts, pieces, strict=True):
        cut = outlines_at(manifold_of(part.vertices_mm, part.faces), 15.0)
        assert cut.area < 0.6 * piece.outline.area
        assert Polygon(cut.exterior).area == pytest.approx(piece.outline.area, rel=1e-4)
        for hole in cut.interiors:
            assert cut.exterior.distance(hole) >= 0.8 - 5e-3
        assert _is_wall(cut, 0.8)


def test_pegs_need_no_supports():
    # Seen from below, each course hangs over the one beneath it by no more than a step.
    world = grid_map(4, GridOptions(columns=2, rows=2, size_mm=180.0))
    rig, pieces = build_board(world, PRINTER, BOARD)
    for part, piece in zip(rig.parts, pieces, strict=True):
        body = manifold_of(part.vertices_mm, part.faces)
        # From 1 mm: the grooves of the number are bridged, as in any top.
        heights = np.arange(1.1, part.size_mm[2], 0.2)
        cuts = [outlines_at(body, float(height)) for height in heights]
        for below, above in pairwise(cuts):
            assert above.difference(below.buffer(CORBEL_STEP_MM + 0.04)).area < 0.1
        pegs = shapely.union_all([peg.outline for peg in piece.pegs])
        assert cuts[-1].area == pytest.approx(pegs.area if piece.pegs else cuts[0].area, rel=0.05)


def test_long_cavities_have_ribs_and_rings_are_held():
    rooms = cavities_in(box(0, 0, 170, 4), 0.8)
    assert len(rooms) == math.ceil(170 / RIB_SPAN_MM)
    assert shapely.area(rooms).sum() == pytest.approx(168.4 * 2.4, rel=0.02)
    ring = box(0, 0, 40, 40) - box(15, 15, 25, 25)
    walls = shell_walls(ring, 0.8)
    assert walls.is_valid
    assert len(walls.interiors) >= 3  # the hole of the obstacle and at least two cavities
    assert ring.covers(walls)


def test_corners_a_rounding_error_apart_do_not_divide_by_zero():
    world = corridors_map(1, CorridorsOptions())
    options = RigOptions(style="board").fitted(world, 300.0)
    rig, _ = build_board(world, read_printer("generic_220"), options)
    assert any(part.hollow for part in rig.parts)  # a warning of a buffer fails the test


def test_corners_that_single_precision_melts_into_one_leave_no_flat_triangle():
    world = rubble_map(4, RubbleOptions())
    options = RigOptions(style="board", most_parts=200).fitted(world, 300.0)
    rig, _ = build_board(world, read_printer("generic_220"), options)
    meshes = {one.name: Mesh.of_corners(one.vertices_mm[one.faces]) for one in rig.parts}
    assert {
        name: mesh.form_problems() for name, mesh in meshes.items() if mesh.form_problems()
    } == {}


def mesh_of_courses(*courses):
    vertices, faces = built_of(courses)
    return Mesh.of_corners(vertices[faces])


@pytest.mark.parametrize(("low_mm", "high_mm", "over_mm"), [(0.0, 9.0, 0.0), (5.0, 8.0, 1e-6)])
def test_what_reaches_out_and_meets_a_wall_in_a_point_is_joined_to_it(low_mm, high_mm, over_mm):
    """Two tips, one from either wall, would share an edge of four triangles."""
    above = Polygon([(10, 17), (12, 19.5), (8, 19.5)])
    frame = shapely.union_all([box(0, 0, 20, 20) - box(1, 1, 19, 19), above])
    ring = Course(pieces=polygon_parts(frame), low_mm=0.0, high_mm=9.0)
    tip = Polygon([(10, 17 + over_mm), (12, 15), (12, 0.5), (8, 0.5), (8, 15)])
    tongue = Course(pieces=polygon_parts(tip), low_mm=low_mm, high_mm=high_mm)
    mesh = mesh_of_courses(ring, tongue)
    assert mesh.form_problems() == []
    extra_mm3 = mesh.volume_mm3 - plan_volume_mm3([ring, tongue])
    assert 0.01 < extra_mm3 < 0.3
    # What does not touch is left as it is.
    apart = replace(tongue, pieces=polygon_parts(shapely.affinity.translate(tip, 0.0, -0.5)))
    assert mesh_of_courses(ring, apart).volume_mm3 == pytest.approx(
        plan_volume_mm3([ring, apart]), rel=1e-6
    )


def test_narrow_obstacles_stay_solid():
    assert len(cavities_in(box(0, 0, 50, 2.5), 0.8)) == 0
    assert len(cavities_in(box(0, 0, 50, 3.0), 0.8)) == 1
    assert shell_walls(box(0, 0, 50, 2.5), 0.8).equals(box(0, 0, 50, 2.5))


@pytest.mark.parametrize(
    ("wall_mm", "printer", "used_mm"),
    [
        (None, PRINTER, 0.8),
        (None, PRINTER.changed(least_wall_mm=0.9), 1.2),
        (None, PRINTER.changed(nozzle_mm=0.6, least_wall_mm=1.2), 1.2),
        (1.2, PRINTER, 1.2),
        (0.0, PRINTER, 0.0),
    ],
)
def test_walls_are_whole_lines(wall_mm, printer, used_mm):
    assert shell_wall_mm(printer, RigOptions(wall_mm=wall_mm)) == pytest.approx(used_mm)


@pytest.mark.parametrize("wall_mm", [0.4, 0.9, 1.0])
def test_other_walls_are_refused_with_what_is_allowed(wall_mm):
    words = r"wall_mm is 0.4|wall_mm is 0.9|wall_mm is 1"
    with pytest.raises(BadInputError, match=rf"({words}).*0 \(solid\).*0.8, 1.2, 1.6"):
        make_rig(grid_map(1, GridOptions()), PRINTER, RigOptions(wall_mm=wall_mm))


def test_a_top_closes_loose_shells_and_plates_stay_filled_under_it():
    world = grid_map(3, GridOptions(columns=2, rows=2, size_mm=180.0))
    rig, pieces = build_board(world, PRINTER, BOARD.changed(top_mm=0.8))
    for part, piece in zip(rig.parts, pieces, strict=True):
        body = manifold_of(part.vertices_mm, part.faces)
        # 0.6 mm from the bed the top is whole; at 0.9 mm it is over.
        assert outlines_at(body, 0.6).area == pytest.approx(piece.outline.area, rel=1e-3)
        assert outlines_at(body, 0.9).area < 0.6 * piece.outline.area
    closed = build_rig(world, PRINTER, RigOptions(top_mm=0.8))
    assert not any(part.hollow for part in closed.parts)
    assert any(part.hollow for part in build_rig(world, PRINTER).parts)


def test_the_quicker_style_is_taken_and_the_other_told():
    world = grid_map(1, GridOptions(columns=2, rows=2, size_mm=180.0))
    made = make_rig(world, PRINTER, RigOptions(), RigRequest(pictures=False))
    assert made.rig.style == "board"
    assert made.rig.options.style == "board"
    loose, plate = build_board(world, PRINTER, BOARD)[0], build_rig(world, PRINTER)
    assert printing_of(loose).total.time_s < printing_of(plate).total.time_s
    assert printing_of(plate).total.words() in made.why_style
    few = make_rig(world, PRINTER, RigOptions(most_parts=4), RigRequest(pictures=False))
    assert few.rig.style == "plate"
    assert "style board was refused: parts: the rig has" in few.why_style


def test_the_demo_rig_prints_in_a_day_and_with_half_a_spool():
    world, printer = grid_map(100_002, GridOptions()), read_printer("generic_220")
    rig, _ = build_board(world, printer, BOARD)
    total = printing_of(rig).total
    assert total.time_s <= 20 * 3600.0
    assert total.mass_g <= 450.0
    assert compare_with_map(rig, world).share < 1e-3


_WIDTHS = ("", "first-layer-", "perimeter-", "external-perimeter-", "infill-", "solid-infill-")


@dataclass(frozen=True, slots=True)
class _Sliced:
    """What a slicer says of a part."""

    plastic_mm3: float
    time_s: float | None  # None: this slicer says nothing about time


def _sliced(program: str, stl: Path, printer: Printer) -> _Sliced:
    """Slice an STL file with slic3r or prusa-slicer."""
    walls, levels = printer.shell_mm / printer.nozzle_mm, printer.shell_mm / printer.layer_mm
    settings = {
        "nozzle-diameter": printer.nozzle_mm,
        "layer-height": printer.layer_mm,
        "first-layer-height": printer.layer_mm,
        "perimeters": round(walls),
        "top-solid-layers": round(levels),
        "bottom-solid-layers": round(levels),
        "fill-density": f"{100 * printer.infill:g}%",
        "filament-diameter": printer.filament_mm,
        "skirts": 0,
        "travel-speed": printer.travel_speed_mm_s,
    }
    settings |= {f"{part}extrusion-width": printer.nozzle_mm for part in _WIDTHS}
    wall, fill = printer.wall_speed_mm_s, printer.fill_speed_mm_s
    settings |= {f"{part}perimeter-speed": wall for part in ("", "external-", "small-")}
    settings |= {f"{part}infill-speed": fill for part in ("", "solid-", "top-solid-")}
    settings |= {"gap-fill-speed": wall, "bridge-speed": wall}
    command, out = [program], stl.with_suffix(".gcode")
    if "prusa" in Path(program).name:
        slope = printer.acceleration_mm_s2
        kinds = ("extruding", "travel", "x", "y")
        settings |= {f"machine-max-acceleration-{kind}": slope for kind in kinds}
        settings |= {f"machine-max-jerk-{axis}": JERK_MM_S for axis in "xy"}
        settings["gcode-flavor"] = "marlin"
        command.append("-g")
    words = [word for key, value in settings.items() for word in (f"--{key}", str(value))]
    subprocess.run([*command, *words, "-o", out, stl], capture_output=True, timeout=300, check=True)
    return _read(out.read_text())


def _read(gcode: str) -> _Sliced:
    plastic = re.search(r"filament used (?:\[cm3\] = |= [\d.]+mm \()([\d.]+)", gcode)
    found = re.search(r"estimated printing time \(normal mode\) = (.*)", gcode)
    time_s = None
    if found:
        lengths = {"d": 86400.0, "h": 3600.0, "m": 60.0, "s": 1.0}
        parts = re.findall(r"(\d+)([dhms])", found[1])
        time_s = sum(lengths[unit] * float(count) for count, unit in parts)
    return _Sliced(1000.0 * float(plastic[1]), time_s)


def _part_to_slice(kind):
    """Return a solid piece, a shell, a closed shell, or a tile of either kind, and its printer."""
    printer = read_printer("generic_220")
    world = grid_map(3, GridOptions(columns=2, rows=2, size_mm=180.0))
    sizes = {"solid": {"wall_mm": 0.0}, "closed": {"top_mm": 0.8}}.get(kind.split()[0], {})
    if kind.endswith("plate"):
        return printer, build_rig(world, printer, RigOptions(**sizes)).parts[0]
    rig, _ = build_board(world, printer, BOARD.changed(**sizes))
    return printer, max(rig.parts, key=lambda part: min(part.size_mm[:2]) < 100)


def _compare_with_slicer(kind, path, slicer):
    printer, part = _part_to_slice(kind)
    path.write_bytes(STL.write(PartFileSpec(items=[PartItem(part=part)], title="part")))
    seen, estimate = _sliced(slicer, path, printer), print_estimate([part], printer)
    assert estimate.plastic_mm3 == pytest.approx(seen.plastic_mm3, rel=0.25)
    return seen, estimate


@pytest.mark.parametrize("kind", ["shell", "solid"])
def test_slic3r_needs_as_much_filament(kind, tmp_path, program):
    _compare_with_slicer(kind, tmp_path / "part.stl", program("slic3r", "slic3r"))


@pytest.mark.thorough
@pytest.mark.parametrize("kind", ["shell", "solid", "closed", "plate", "solid plate"])
def test_prusa_slicer_takes_as_long(kind, tmp_path, program):
    slicer = program("prusa-slicer", "prusa-slicer")
    seen, estimate = _compare_with_slicer(kind, tmp_path / "part.stl", slicer)
    assert estimate.time_s == pytest.approx(seen.time_s, rel=0.25)
