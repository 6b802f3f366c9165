import math
from dataclasses import replace

import numpy as np
import pytest
import shapely
from manifold3d import Manifold, OpType
from shapely import Point, Polygon, box

from vinefab.core.errors import BadInputError
from vinefab.rig.build import build_rig, compare_with_map
from vinefab.rig.part import RigOptions, manifold_of
from vinefab.rig.part_files import STL, PartFileSpec, PartItem, read_back_problems
from vinefab.rig.solid import engraved_marks


def _solid(**sizes):
    """Return options of a solid rig on plates."""
    return RigOptions(**({"style": "plate", "wall_mm": 0.0} | sizes))


PLAIN = _solid(mark_depth_mm=0.0)
"""Without numbers on the underside: areas and volumes are those of plate and walls alone."""


def _problems(rig):
    items = [PartItem(part=part) for part in rig.parts]
    found = [
        read_back_problems(STL, STL.write(PartFileSpec(items=[one], title=one.part.name)), [one])
        for one in items
    ]
    return [problem for one in found for problems in one.values() for problem in problems]


def _hanging_mm2(part):
    """Area, seen from below, of what does not lie on the bed."""
    corners = part.vertices_mm[part.faces]
    doubled = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])[:, 2]
    return -0.5 * doubled[(doubled < 0.0) & (corners[:, :, 2] > 0.0).any(axis=1)].sum()


def _xor(one, other):
    return shapely.symmetric_difference(one, other).area


def _walls(world):
    return shapely.intersection(shapely.union_all(world.obstacles), world.bounds)


def test_the_volume_of_a_small_rig_is_plate_and_walls(make_map, make_printer):
    world = make_map(box(30, 60, 60, 90), box(120, 70, 150, 130))
    rig = build_rig(
        world, make_printer(), _solid(border_mm=5.0, entry_width_mm=40.0, mark_depth_mm=0.0)
    )
    plate_mm2 = 190.0 * 160.0
    walls_mm2 = 30.0 * 30.0 + 30.0 * 60.0 + (plate_mm2 - 180.0 * 150.0) - 40.0 * 5.0
    assert len(rig.parts) == 1
    assert rig.volume_mm3 == pytest.approx(3.0 * plate_mm2 + 30.0 * walls_mm2, rel=1e-9)
    assert rig.parts[0].size_mm == pytest.approx((190.0, 160.0, 33.0))
    assert _problems(rig) == []


@pytest.mark.parametrize("bed_mm", [(400.0, 400.0), (220.0, 220.0), (120.0, 95.0), (95.0, 120.0)])
def test_the_assembled_rig_is_the_map(crooked_map, make_printer, faces_at, bed_mm):
    world = crooked_map(3, 7, 5)
    printer = make_printer(*bed_mm)
    rig = build_rig(world, printer, PLAIN)
    walls = _walls(world)
    assert _xor(faces_at(rig, 30.0).intersection(world.bounds), walls) < 1e-4 * walls.area
    assert rig.volume_mm3 == pytest.approx(
        build_rig(world, make_printer(2000, 2000), PLAIN).volume_mm3 - rig.joint_gap_mm3, rel=1e-6
    )
    for part in rig.parts:
        assert part.size_mm[0] <= printer.bed_width_mm - 10.0 + 1e-3
        assert part.size_mm[1] <= printer.bed_depth_mm - 10.0 + 1e-3
    assert _problems(rig) == []


def test_parts_do_not_run_into_each_other_and_leave_only_the_gaps(crooked_map, make_printer):
    rig = build_rig(crooked_map(4, 6, 4), make_printer(130.0, 130.0, clearance_mm=0.3), _solid())
    assert len(rig.parts) > 4
    assert rig.counts["joints"] >= len(rig.parts)
    placed = [
        manifold_of(part.vertices_mm, part.faces).transform(part.to_map[:3]) for part in rig.parts
    ]
    together = Manifold.batch_boolean(placed, OpType.Add)
    assert together.volume() == pytest.approx(rig.volume_mm3, rel=1e-6)
    # A dovetail that is 8 mm deep has about 26 mm of outline in its socket.
    gap_mm3 = rig.counts["joints"] * 3.0 * 0.3 * (13.0 + 2.0 * math.hypot(8.0, 2.5))
    assert rig.joint_gap_mm3 == pytest.approx(gap_mm3, rel=0.05)


def test_holes_in_obstacles_and_bounds(make_map, make_printer, faces_at):
    ring = box(40, 60, 90, 110).difference(box(50, 70, 80, 100))
    bounds = box(10, 20, 190, 170).difference(box(120, 80, 140, 100))
    world = make_map(ring, bounds=bounds)
    rig = build_rig(world, make_printer(), _solid())
    inside = faces_at(rig, 30.0).intersection(box(10, 20, 190, 170))
    assert _xor(inside, ring.union(box(120, 80, 140, 100))) < 0.1
    assert faces_at(rig, 0.0).contains(Point(65, 85))


@pytest.mark.parametrize(
    "obstacle",
    [
        box(10, 60, 40, 90),  # shares an edge with the bounds
        box(-30, 60, 40, 90),  # reaches over them, and over the border
        box(-30, 60, 14, 90),
        Polygon([(10, 75), (40, 60), (40, 90)]),  # touches them with one corner
        Polygon([(10.0004, 75), (40, 60), (40, 90)]),  # nearly so
        box(180, 160, 300, 300),  # over the corner
    ],
)
def test_obstacles_at_the_border(make_map, make_printer, faces_at, obstacle):
    world = make_map(obstacle, box(100, 100, 120, 120))
    rig = build_rig(world, make_printer(100.0, 100.0), _solid())
    inside = faces_at(rig, 30.0).intersection(world.bounds)
    assert _xor(inside, _walls(world)) < 1e-3 * _walls(world).area
    assert _problems(rig) == []
    assert rig.parts[0].vertices_mm.min(axis=0) == pytest.approx((0, 0, 0))


def test_obstacles_that_touch_in_a_corner_are_joined_and_counted(make_map, make_printer):
    world = make_map(box(40, 60, 60, 80), box(60, 80, 80, 100), box(80, 60, 100, 80))
    rig = build_rig(world, make_printer(), _solid())
    assert rig.counts["bridges"] == 2
    assert any("touched in one point" in note for note in rig.notes)
    assert _problems(rig) == []


def test_a_cut_through_a_touching_corner_stays_closed(make_map, make_printer):
    obstacles = [box(x, y, x + 10, y + 10) for x in range(0, 300, 20) for y in range(20, 90, 20)]
    obstacles += [box(x + 10, y, x + 20, y + 10) for x in range(0, 300, 20) for y in (30, 50, 70)]
    world = make_map(*obstacles, bounds=box(0, 0, 320, 120), starts=())
    rig = build_rig(world, make_printer(120.0, 90.0), _solid())
    assert rig.counts["bridges"] > 100
    assert _problems(rig) == []


def test_a_notch_that_ends_on_a_cut_stays_closed(make_map, make_printer):
    # Two full tiles: the cut lies at x = 198 and cannot move. Right of it the block is two pieces
    # that touch where the notch ends.
    block = Polygon([(100, 50), (300, 50), (198, 80), (300, 110), (100, 110)])
    world = make_map(block, bounds=box(0, 0, 396, 150), starts=())
    rig = build_rig(world, make_printer(), _solid())
    assert len(rig.parts) == 2
    assert rig.parts[1].to_map[0, 3] == 198.0
    assert _problems(rig) == []


def test_slivers_and_slits_are_left_out_and_counted(make_map, make_printer, faces_at):
    slit = box(40, 60, 60, 80).difference(box(45, 70, 55, 70.02))
    world = make_map(box(100, 100, 140, 100.03), slit)
    rig = build_rig(world, make_printer(), _solid())
    assert (rig.counts["slivers"], rig.counts["slits"]) == (1, 1)
    assert _xor(faces_at(rig, 30.0).intersection(world.bounds), box(40, 60, 60, 80)) < 0.1
    kept = build_rig(world, make_printer(), _solid(sliver_mm=0.0))
    assert (kept.counts["slivers"], kept.counts["slits"]) == (0, 0)
    assert kept.volume_mm3 == pytest.approx(rig.volume_mm3 + 30.0 * (40 * 0.03 - 10 * 0.02))
    assert _problems(kept) == []


def test_thin_walls_are_thickened_and_reported(make_map, make_printer, faces_at):
    dumbbell = shapely.union_all([box(30, 60, 50, 80), box(50, 70, 90, 70.5), box(90, 60, 110, 80)])
    world, options = make_map(dumbbell), _solid(scale=0.9)
    rig = build_rig(world, make_printer(least_wall_mm=0.8), options)
    (place,) = rig.thin_places
    assert 50 < place.x_mm < 90
    assert place.y_mm == pytest.approx(70.25, abs=0.3)
    assert place.area_mm2 == pytest.approx(0.81 * 40 * 0.5, rel=0.05)
    assert any("thinner than the 0.8 mm" in note for note in rig.notes)
    wall = faces_at(rig, 30.0 / 0.9).intersection(box(55, 60, 85, 80))
    thick_mm = 0.9 * wall.area / 30.0
    assert 0.8 <= thick_mm <= 1.0 + 1e-3
    assert wall.bounds[1] == pytest.approx(70.25 - 0.5 * thick_mm / 0.9, abs=0.01)
    assert _problems(rig) == []
    comparison = compare_with_map(rig, world)
    assert comparison.share < 1e-4
    assert comparison.thickened_mm2 == pytest.approx(wall.area * 40 / 30 - 40 * 0.5, rel=0.05)
    assert (
        build_rig(make_map(dumbbell), make_printer(least_wall_mm=0.4), _solid()).thin_places == ()
    )


def test_numbers_are_grooves_that_a_printer_bridges(crooked_map, make_printer):
    world, printer = crooked_map(5, 6, 6), make_printer(110.0, 140.0)
    rig, plain = build_rig(world, printer, _solid()), build_rig(world, printer, PLAIN)
    assert rig.counts["unmarked"] == 0
    assert [part.number for part in rig.parts] == list(range(1, len(rig.parts) + 1))
    for part, bare in zip(rig.parts, plain.parts, strict=True):
        roof = [
            shapely.Polygon(corners[:, :2])
            for corners in part.vertices_mm[part.faces]
            if np.abs(corners[:, 2] - 0.4).max() < 1e-6
        ]
        groove = shapely.union_all(roof)
        assert groove.area * 0.4 == pytest.approx(bare.volume_mm3 - part.volume_mm3, rel=1e-3)
        # One millimetre wide; a little more where strokes meet.
        assert groove.buffer(-1.2).is_empty
        assert part.size_mm == pytest.approx(bare.size_mm)
    assert _problems(rig) == []


def test_the_arrow_points_to_north_and_the_number_reads_from_below():
    marks = shapely.union_all(engraved_marks(1, box(0, 0, 60, 60)))
    arrow, digit = sorted(shapely.get_parts(marks), key=lambda piece: -piece.bounds[3])
    assert arrow.centroid.x > 30 > digit.centroid.x
    widest = [arrow.intersection(box(0, y, 60, y + 0.5)).area for y in np.arange(24, 37, 1.0)]
    assert int(np.argmax(widest)) > 6  # the head is above the middle
    # A 1 has its flag to the left of its stem; mirrored, to the right.
    top = digit.intersection(box(0, digit.bounds[3] - 2.5, 60, 60))
    assert top.centroid.x > digit.centroid.x
    assert len(engraved_marks(7, box(0, 0, 8, 8))) == 0  # dust has no room


def test_cube_and_arrow_stand_beside_the_rig(make_map, make_printer):
    rig = build_rig(make_map(box(30, 60, 60, 90)), make_printer(), _solid(scale=0.5))
    cube, arrow = rig.extras
    assert cube.size_mm == (20.0, 20.0, 20.0)
    assert _problems(replace(rig, parts=rig.extras)) == []
    for part in rig.extras:
        placed = part.vertices_mm @ part.to_map[:3, :3].T + part.to_map[:3, 3]
        assert placed[:, 0].min() > rig.plate.bounds[2]
        assert placed[:, 2].min() == pytest.approx(-3.0 / 0.5)
    assert np.ptp(cube.vertices_mm @ cube.to_map[:3, :3].T, axis=0) == pytest.approx(40.0)
    tip = arrow.vertices_mm[arrow.vertices_mm[:, 1].argmax()]
    assert tip[0] == pytest.approx(0.5 * arrow.size_mm[0])


def test_tiles_without_joints_only_meet(crooked_map, make_printer):
    world, printer = crooked_map(4, 6, 4), make_printer(130.0, 130.0)
    rig = build_rig(world, printer, _solid(joint="none", mark_depth_mm=0.0))
    assert rig.counts["joints"] == 0
    whole = build_rig(world, make_printer(2000, 2000), PLAIN)
    assert rig.volume_mm3 == pytest.approx(whole.volume_mm3, rel=1e-6)


def test_turned_tiles_join_too(crooked_map, make_printer, faces_at):
    world = crooked_map(8, 8, 2)
    rig = build_rig(world, make_printer(120.0, 190.0), _solid())
    assert rig.parts[0].to_map[0, 1] == 1.0
    assert np.linalg.det(rig.parts[0].to_map[:3, :3]) == pytest.approx(1.0)
    assert len(rig.parts) == 2
    walls = _walls(world)
    assert _xor(faces_at(rig, 30.0).intersection(world.bounds), walls) < 1e-4 * walls.area
    assert _problems(rig) == []


def test_far_from_the_origin_nothing_is_lost(crooked_map, make_map, make_printer):
    near = crooked_map(2, 4, 3)
    moved = [shapely.affinity.translate(p, 3e6, -3e6) for p in (near.bounds, *near.obstacles)]
    far = make_map(*moved[1:], bounds=moved[0], starts=())
    closed = _solid(entry_width_mm=0.0)
    rig = build_rig(far, make_printer(), closed)
    volume_mm3 = build_rig(near, make_printer(), closed).volume_mm3
    assert rig.volume_mm3 == pytest.approx(volume_mm3, rel=1e-6)
    assert _problems(rig) == []


@pytest.mark.parametrize("seed", range(3))
def test_whatever_overlaps_comes_out_closed(make_map, make_printer, seed):
    rng = np.random.default_rng(seed)
    obstacles = []
    for x, y, size in rng.uniform((0, 0, 1), (200, 180, 40), (30, 3)):
        spikes = np.sort(rng.uniform(0, 2 * np.pi, 9))
        reach = size * rng.uniform(0.3, 1.0, 9)
        star = Polygon(np.c_[x + reach * np.cos(spikes), y + reach * np.sin(spikes)])
        if star.is_valid:
            obstacles.append(star)
        lattice = 10 * round(x / 10), 10 * round(y / 10)
        obstacles.append(box(*lattice, lattice[0] + 10, lattice[1] + 10))
    bounds = shapely.affinity.rotate(box(10, 20, 190, 170), float(rng.uniform(0, 90)))
    rig = build_rig(make_map(*obstacles, bounds=bounds), make_printer(100.0, 120.0), PLAIN)
    assert len(rig.parts) > 1
    assert _problems(rig) == []
    # On a slanted edge, snapping must not leave a solid hanging over its plate.
    assert max(_hanging_mm2(part) for part in rig.parts) < 2e-3


def test_a_concave_hall_gives_one_part_for_each_piece(make_map, make_printer):
    comb = box(0, 0, 300, 40).union(box(0, 0, 40, 200)).union(box(260, 0, 300, 200))
    rig = build_rig(make_map(bounds=comb, starts=()), make_printer(330.0, 150.0), _solid())
    assert [(part.row, part.column) for part in rig.parts] == [(1, 1), (2, 1), (2, 1)]
    assert len({part.name for part in rig.parts}) == 3
    assert _problems(rig) == []


@pytest.mark.parametrize(
    ("options", "bed_mm", "words"),
    [
        ({"height_mm": 98.0}, 220.0, r"height_mm is 98.* at most 97 mm"),
        ({"most_parts": 2}, 110.0, r"needs \d+ parts, and 2 are allowed"),
        ({}, 50.0, r"printer.bed"),
    ],
)
def test_what_cannot_be_printed_is_refused(make_map, make_printer, options, bed_mm, words):
    with pytest.raises(BadInputError, match=words):
        build_rig(make_map(), make_printer(bed_mm, bed_mm), _solid(**options))
