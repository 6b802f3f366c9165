"""Loose obstacles with pegs, the board that holds them, and obstacles cut in layers."""

import math

import numpy as np
import pytest
import shapely
from shapely import Point, box
from shapely.affinity import translate

from vinefab.core.errors import BadInputError
from vinefab.model.job import Operation
from vinefab.rig.board import PEG_SHORTER_MM, build_board
from vinefab.rig.comparison_with_map import compare_with_map
from vinefab.rig.laser_cut import board_jobs, layer_jobs, lid_jobs
from vinefab.rig.laser_cut_files import dxf_files, dxf_problems, material_left
from vinefab.rig.loose import RIM_MM, pegs_in
from vinefab.rig.options import RigOptions
from vinefab.rig.stl_format import check_stl, stl_bytes

BOARD = RigOptions(style="board", most_parts=200)
SHEET = RigOptions(style="sheet", most_parts=200)


@pytest.fixture
def made(crooked_map, make_printer):
    world = crooked_map(3, 6, 4)
    return world, *build_board(world, make_printer(), BOARD)


def _on_plan(rig, world):
    low = world.bounds.bounds[:2]
    return shapely.transform(rig.plate, lambda points: points - low)


def test_loose_parts_are_solids_and_together_the_map(made, faces_at):
    world, rig, pieces = made
    assert [part.number for part in rig.parts] == [piece.number for piece in pieces]
    for part in rig.parts:
        assert check_stl(stl_bytes(part.vertices_mm, part.faces, part.name), part) == ()
        assert part.vertices_mm.min(axis=0) == pytest.approx((0, 0, 0), abs=1e-6)
    walls = shapely.intersection(shapely.union_all(world.obstacles), world.bounds)
    top = faces_at(rig, 30.0).union(faces_at(rig, 29.6)).intersection(world.bounds)
    assert shapely.symmetric_difference(top, walls).area < 1e-4 * walls.area
    assert compare_with_map(rig, world).share < 1e-4


def test_parts_lie_top_down_with_pegs_upwards(made):
    _, rig, pieces = made
    for part, piece in zip(rig.parts, pieces, strict=True):
        peg_mm = BOARD.plate_mm - PEG_SHORTER_MM if piece.pegs else 0.0
        assert part.size_mm[2] == pytest.approx(30.0 + peg_mm)
        assert np.linalg.det(part.to_map[:3, :3]) == pytest.approx(1.0)
        standing = part.vertices_mm @ part.to_map[:3, :3].T + part.to_map[:3, 3]
        assert standing[:, 2].min() == pytest.approx(-peg_mm, abs=1e-5)
        assert standing[:, 2].max() == pytest.approx(30.0, abs=1e-5)


def test_pegs_lie_within_their_piece_and_apart():
    for outline in (box(0, 0, 30, 20), box(0, 0, 100, 4.5), Point(0, 0).buffer(4.0)):
        pegs = pegs_in(outline, 5.0)
        assert pegs
        for peg in pegs:
            assert outline.buffer(-RIM_MM + 0.01).covers(peg.outline)
        if len(pegs) == 2:
            apart_mm = math.dist((pegs[0].x_mm, pegs[0].y_mm), (pegs[1].x_mm, pegs[1].y_mm))
            assert apart_mm > pegs[0].diameter_mm
    assert len(pegs_in(box(0, 0, 30, 20), 5.0)) == 2
    assert len(pegs_in(Point(0, 0).buffer(4.0), 5.0)) == 1
    assert pegs_in(box(0, 0, 100, 3), 5.0) == ()


def test_every_peg_finds_its_hole(made):
    world, rig, pieces = made
    options = RigOptions(style="board", clearance_mm=0.15, kerf_mm=0.3)
    (job,) = board_jobs("table", _on_plan(rig, world), pieces, options)
    holes = [path.contour for path in job.along(Operation.CUT) if path.contour.arc_count]
    pegs = [peg for piece in pieces for peg in piece.pegs]
    assert len(holes) == len(pegs) > 20
    # The sheet begins half a kerf and the margin left of the plan's lower left corner at (-4, -4).
    shift = 4.0 + 5.0 + 0.15
    for peg in pegs:
        centre = np.array([peg.x_mm + shift, peg.y_mm + shift])
        away = [np.abs(hole.points_mm.mean(axis=0) - centre).max() for hole in holes]
        hole = holes[int(np.argmin(away))]
        assert min(away) < 1e-6
        radius_mm = next(iter(hole.segments)).radius_mm
        # The beam takes half a kerf on each side: what is left is the peg and its gap.
        assert radius_mm + 0.15 == pytest.approx(0.5 * peg.diameter_mm + 0.15)
    order = [path.operation for path in job.paths]
    assert order == sorted(order, key=list(Operation).index)
    files = dxf_files({"board.dxf": job})
    assert dxf_problems(files, {"board.dxf": job}) == {"board.dxf": ()}
    board = shapely.union_all(shapely.get_parts(material_left(files["board.dxf"], 0.3)))
    assert board.area == pytest.approx(_on_plan(rig, world).area, rel=1e-6)


def test_a_board_larger_than_the_sheet_is_divided_beside_the_holes(made):
    world, rig, pieces = made
    options = RigOptions(style="board", sheet_width_mm=150.0, sheet_depth_mm=120.0, kerf_mm=0.0)
    plate = _on_plan(rig, world)
    jobs = board_jobs("table", plate, pieces, options)
    assert len(jobs) > 3
    holes, area_mm2 = 0, 0.0
    for job in jobs:
        assert job.sheet_width_mm <= 150.0 + 1e-6
        assert job.sheet_height_mm <= 120.0 + 1e-6
        rings = [path.contour for path in job.along(Operation.CUT)]
        outline = shapely.Polygon(rings[-1].points_mm)
        for hole in rings[:-1]:
            assert outline.contains(Point(hole.points_mm.mean(axis=0)).buffer(1.5))
        holes += len(rings) - 1
        area_mm2 += outline.area
    assert holes == sum(len(piece.pegs) for piece in pieces)
    assert area_mm2 == pytest.approx(plate.area, rel=1e-6)


def test_a_lid_is_the_plate_without_holes(make_map, make_printer):
    far = make_map(box(30, 60, 60, 90), bounds=box(-100, -100, 300, 300))
    rig, _ = build_board(far, make_printer(), BOARD)
    plate = _on_plan(rig, far)
    assert len(plate.interiors) == 1  # the robot comes up from below
    (job,) = lid_jobs("table", plate, RigOptions(kerf_mm=0.2))
    (outline,) = [path.contour for path in job.along(Operation.CUT)]
    assert shapely.Polygon(outline.points_mm).area == pytest.approx(408.2**2, rel=1e-6)


def test_layers_are_the_pieces_as_often_as_needed(crooked_map, make_printer):
    world = crooked_map(5, 5, 4)
    _, pieces = build_board(world, make_printer(), SHEET)
    jobs, copies = layer_jobs("table", pieces, 10, SHEET)
    assert sorted((copy.piece.number, copy.layer) for copy in copies) == [
        (piece.number, layer) for piece in pieces for layer in range(1, 11)
    ]
    files = dxf_files({str(index): job for index, job in enumerate(jobs)})
    left = [material_left(data, SHEET.kerf_mm) for data in files.values()]
    area_mm2 = sum(piece.outline.area for piece in pieces)
    assert sum(one.area for one in left) == pytest.approx(10 * area_mm2, rel=1e-4)
    for copy in copies:
        meant = translate(copy.piece.outline, *copy.shift_mm)
        near = left[copy.sheet].intersection(meant.buffer(0.5))
        assert shapely.symmetric_difference(near, meant).area < 1e-3 * meant.area


def test_too_many_loose_pieces_are_refused_before_any_is_built(crooked_map, make_printer):
    with pytest.raises(BadInputError, match=r"rig.parts is 2\d; .*at most 20 loose pieces"):
        build_board(crooked_map(3, 6, 4), make_printer(), RigOptions(style="board", most_parts=20))
