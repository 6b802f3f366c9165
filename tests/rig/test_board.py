"""Loose obstacles with pegs, and what a laser cuts for them: the drilled board and a lid."""

import io
import math

import ezdxf
import numpy as np
import pytest
import shapely
from shapely import Point, Polygon, box

from vinefab.core.errors import BadInputError
from vinefab.model.job import Operation
from vinefab.model.map import Map
from vinefab.rig.build import (
    PEG_RECESS_MM,
    RIM_MM,
    LoosePiece,
    Peg,
    build_board,
    compare_with_map,
    pegs_in,
)
from vinefab.rig.make import SHEET_MARGIN_MM, board_jobs, lid_jobs, sheet_file
from vinefab.rig.part import RigOptions

BOARD = RigOptions(style="board", most_parts=200, wall_mm=0.0)


@pytest.fixture(scope="module")
def made(crooked_map, make_printer):
    world = crooked_map(3, 6, 4)
    return world, *build_board(world, make_printer(), BOARD)


def test_loose_parts_are_solids_and_together_the_map(made, faces_at, stl_problems):
    world, rig, pieces = made
    assert [part.number for part in rig.parts] == [piece.number for piece in pieces]
    for part in rig.parts:
        assert stl_problems(part) == ()
        assert part.vertices_mm.min(axis=0) == pytest.approx((0, 0, 0), abs=1e-6)
    walls = shapely.intersection(shapely.union_all(world.obstacles), world.bounds)
    top = faces_at(rig, 30.0).union(faces_at(rig, 29.6)).intersection(world.bounds)
    assert shapely.symmetric_difference(top, walls).area < 1e-4 * walls.area
    assert compare_with_map(rig, world).share < 1e-4


def test_parts_lie_top_down_with_pegs_upwards(made):
    _, rig, pieces = made
    for part, piece in zip(rig.parts, pieces, strict=True):
        peg_mm = BOARD.plate_mm - PEG_RECESS_MM if piece.pegs else 0.0
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


def test_too_many_loose_pieces_are_refused_before_any_is_built(crooked_map, make_printer):
    with pytest.raises(
        BadInputError, match=r"^parts: the rig has 2\d loose pieces, and 20 are allowed"
    ):
        build_board(crooked_map(3, 6, 4), make_printer(), RigOptions(style="board", most_parts=20))


def test_a_large_board_is_refused_by_its_pieces_not_by_its_area(make_printer):
    """1300 x 1300 mm are 49 beds, but border and obstacle are 25 pieces."""
    world = Map(name="hall", bounds=box(0, 0, 1300, 1300), obstacles=(box(600, 600, 700, 700),))
    rig, pieces = build_board(world, make_printer(), BOARD.changed(most_parts=40))
    assert len(pieces) == len(rig.parts) == 25
    with pytest.raises(
        BadInputError, match="25 loose pieces, and 20 are allowed; give more --most-parts"
    ):
        build_board(world, make_printer(), BOARD.changed(most_parts=20))


# --- Sheets for the laser


def _on_plan(rig, world):
    low = world.bounds.bounds[:2]
    return shapely.transform(rig.plate, lambda points: points - low)


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
    (outline,), _ = _beam(job)
    board = outline.buffer(-0.15, join_style="mitre")
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


KERFS_MM = [0.0, 0.2, 0.5]
WIDE_MM, DEEP_MM, PEG_MM, FIT_MM = 40.0, 30.0, 5.0, 0.1
PIECE = LoosePiece(
    number=1,
    outline=box(10, 10, 10 + WIDE_MM, 10 + DEEP_MM),
    pegs=(Peg(x_mm=20.0, y_mm=25.0, diameter_mm=PEG_MM), Peg(x_mm=40, y_mm=25, diameter_mm=PEG_MM)),
)
FRAME = box(10, 60, 110, 140) - box(30, 80, 70, 120)
"""A plate of 100 x 80 mm with an opening of 40 x 40 mm."""


def _beam(job):
    """Return where the beam runs on cuts: polygons and circles (x, y, radius).

    Read by ezdxf alone from the written file.
    """
    polygons, circles = [], []
    for line in ezdxf.read(io.StringIO(sheet_file("sheet.dxf", job).decode())).modelspace():
        if line.dxf.layer != Operation.CUT.layer:
            continue
        points = np.array(line.get_points("xyb"))
        if points[:, 2].any():
            middle = points[:, :2].mean(axis=0)
            circles.append((*middle, np.hypot(*(points[0, :2] - middle))))
        else:
            polygons.append(Polygon(points[:, :2]))
    return sorted(polygons, key=lambda one: one.area), circles


def _size(polygon):
    x_min, y_min, x_max, y_max = polygon.bounds
    return x_max - x_min, y_max - y_min


@pytest.mark.parametrize("kerf_mm", KERFS_MM)
def test_the_board_is_a_kerf_larger_and_its_holes_a_kerf_smaller_than_the_beam_cuts(kerf_mm):
    options = RigOptions(style="board", kerf_mm=kerf_mm, clearance_mm=FIT_MM)
    (job,) = board_jobs("b", box(0, 0, 100, 80), (PIECE,), options)
    (outline,), holes = _beam(job)
    assert _size(outline) == pytest.approx((100 + kerf_mm, 80 + kerf_mm))
    assert outline.bounds[:2] == pytest.approx((SHEET_MARGIN_MM, SHEET_MARGIN_MM))
    # The sheet ends a margin beyond the cut, half a kerf beside the beam's path.
    sheet_mm = 100 + kerf_mm + 2 * SHEET_MARGIN_MM, 80 + kerf_mm + 2 * SHEET_MARGIN_MM
    assert (job.sheet_width_mm, job.sheet_height_mm) == pytest.approx(sheet_mm)
    assert len(holes) == 2
    low = SHEET_MARGIN_MM + 0.5 * kerf_mm
    for (x_mm, y_mm, radius_mm), peg in zip(sorted(holes), PIECE.pegs, strict=True):
        assert 2 * radius_mm + kerf_mm == pytest.approx(PEG_MM + 2 * FIT_MM)
        assert (x_mm, y_mm) == pytest.approx((peg.x_mm + low, peg.y_mm + low))


@pytest.mark.parametrize("kerf_mm", KERFS_MM)
def test_a_lid_is_as_large_as_the_plate_after_the_kerf(kerf_mm):
    (job,) = lid_jobs("l", box(0, 0, 100, 80), RigOptions(kerf_mm=kerf_mm))
    (outline,), holes = _beam(job)
    assert _size(outline) == pytest.approx((100 + kerf_mm, 80 + kerf_mm))
    assert holes == []


@pytest.mark.parametrize("kerf_mm", KERFS_MM)
def test_openings_are_a_kerf_smaller_than_the_beam_cuts(kerf_mm):
    (job,) = board_jobs("b", FRAME, (), RigOptions(style="board", kerf_mm=kerf_mm))
    (opening, outline), _ = _beam(job)
    assert _size(opening) == pytest.approx((40 - kerf_mm, 40 - kerf_mm))
    assert _size(outline) == pytest.approx((100 + kerf_mm, 80 + kerf_mm))
