"""Loose obstacles with pegs."""

import math

import numpy as np
import pytest
import shapely
from shapely import Point, box

from vinefab.core.errors import BadInputError
from vinefab.model.map import Map
from vinefab.rig.build import PEG_RECESS_MM, RIM_MM, build_board, compare_with_map, pegs_in
from vinefab.rig.part import RigOptions

BOARD = RigOptions(style="board", most_parts=200, wall_mm=0.0)


@pytest.fixture
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
    with pytest.raises(BadInputError, match=r"^parts is 2\d; .*at most 20 loose pieces"):
        build_board(crooked_map(3, 6, 4), make_printer(), RigOptions(style="board", most_parts=20))


def test_a_large_board_is_refused_by_its_pieces_not_by_its_area(make_printer):
    """1300 x 1300 mm are 49 beds, but border and obstacle are 25 pieces."""
    world = Map(name="hall", bounds=box(0, 0, 1300, 1300), obstacles=(box(600, 600, 700, 700),))
    rig, pieces = build_board(world, make_printer(), BOARD.changed(most_parts=40))
    assert len(pieces) == len(rig.parts) == 25
    with pytest.raises(BadInputError, match="at most 20 loose pieces: --most-parts allows more"):
        build_board(world, make_printer(), BOARD.changed(most_parts=20))
