import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st

from vinefab.core.errors import BadInputError
from vinefab.maps import passages
from vinefab.maps.generators.cave import CaveOptions, cave_map
from vinefab.maps.generators.grid import grid_map
from vinefab.maps.passages import narrow_passages

ROOM = shapely.box(0, 0, 100, 60)


def widths_of(free, most=5):
    return [passage.width_mm for passage in narrow_passages(free, most)]


def test_two_boxes_a_gap_apart():
    free = ROOM - shapely.box(20, 20, 40, 40) - shapely.box(47, 20, 70, 40)
    first = narrow_passages(free, 1)[0]
    assert first.width_mm == pytest.approx(7.0, abs=1e-9)
    assert first.middle_mm == pytest.approx((43.5, 30.0), abs=1e-9)
    # The rest: 20 below and above each of the boxes, 20 to the left and 30 to the right.
    assert widths_of(free, 9) == pytest.approx([7.0, 20.0, 20.0, 20.0, 20.0, 20.0, 30.0])


def test_corner_to_corner_and_corner_to_wall():
    free = ROOM - shapely.Polygon([(30, 0), (50, 20), (70, 0)]) - shapely.box(53, 24, 90, 60)
    first = narrow_passages(free, 1)[0]
    assert first.width_mm == pytest.approx(5.0)
    assert set(first.ends_mm) == {(50.0, 20.0), (53.0, 24.0)}
    wedge = ROOM - shapely.Polygon([(20, 60), (50, 11), (80, 60)])
    assert widths_of(wedge) == pytest.approx([11.0])


def test_a_corridor_is_one_passage_at_its_middle():
    rooms = shapely.union_all(
        [shapely.box(0, 0, 30, 60), shapely.box(70, 0, 100, 60), shapely.box(30, 25, 70, 35)]
    )
    found = narrow_passages(rooms)
    assert [passage.width_mm for passage in found] == pytest.approx([10.0, 30.0, 30.0])
    assert found[0].middle_mm == pytest.approx((50.0, 30.0))


def test_a_long_room_is_a_corridor_and_a_square_one_is_not():
    assert widths_of(shapely.box(0, 0, 100, 10)) == pytest.approx([10.0])
    assert widths_of(shapely.Polygon([(0, 0), (50, 5), (40, 45), (-3, 40)])) == []
    assert narrow_passages(shapely.Polygon()) == ()


def test_two_doors_of_a_chamber_are_two_passages_but_a_rough_corridor_is_one():
    chamber = shapely.Point(0, 0).buffer(30)
    doors = [shapely.box(-60, -5, 0, 5), shapely.box(0, -4, 60, 4)]
    ends = [shapely.box(-80, -20, -60, 20), shapely.box(60, -20, 80, 20)]
    found = narrow_passages(shapely.union_all([chamber, *doors, *ends]), 3)
    assert [passage.width_mm for passage in found] == pytest.approx([8.0, 10.0, 20.0])
    along = np.linspace(0.0, 100.0, 51)
    rough = np.random.default_rng(4).uniform(0.0, 0.8, (2, 51))
    wall = np.vstack(
        [np.column_stack([along, -5 - rough[0]]), np.column_stack([along, 5 + rough[1]])[::-1]]
    )
    corridor = shapely.union_all(
        [shapely.Polygon(wall), shapely.box(-50, -40, 0, 40), shapely.box(100, -40, 150, 40)]
    )
    widths = widths_of(corridor, 4)
    assert 10.0 <= widths[0] <= 11.0
    assert min(widths[1:], default=40.0) > 30.0


def test_pegs_have_a_gate_between_each_two():
    pegs = [shapely.Point(x, y).buffer(2.0, quad_segs=16) for x in (0, 20, 40) for y in (0, 20, 40)]
    free = shapely.box(-60, -60, 100, 100) - shapely.union_all(pegs)
    found = narrow_passages(free, 12)
    assert len(found) == 12
    for passage in found:
        assert passage.width_mm == pytest.approx(16.0, abs=1e-9)
    middles = sorted((round(x), round(y)) for x, y in (passage.middle_mm for passage in found))
    across = [(x, y) for x in (10, 30) for y in (0, 20, 40)]
    assert middles == sorted(across + [(y, x) for x, y in across])


def test_passages_lead_through_free_space_and_touch_both_walls():
    for world in (grid_map(2), cave_map(2)):
        free = world.free_space
        for passage in narrow_passages(free, 12):
            line = shapely.LineString(passage.ends_mm)
            circle = shapely.Point(passage.middle_mm).buffer(0.4999 * passage.width_mm)
            assert line.length == pytest.approx(passage.width_mm)
            assert free.covers(circle)
            for end in line.boundary.geoms:
                assert end.distance(free.boundary) < 1e-9


def test_the_narrowest_place_of_a_cave_keeps_its_promise():
    options = CaveOptions(passage_width_min_mm=20.0, roughness=0.0, wander=0.2)
    for seed in range(3):
        assert narrow_passages(cave_map(seed, options).free_space, 1)[0].width_mm > 19.9


@settings(max_examples=20, deadline=None)
@given(
    gap=st.floats(0.01, 8.0),
    turn=st.floats(0.0, 2 * math.pi),
    scale=st.floats(1e-3, 1e3),
)
def test_moving_and_scaling_the_map_moves_and_scales_the_passage(gap, turn, scale):
    free = ROOM - shapely.box(20, 20, 40, 40) - shapely.box(40 + gap, 12, 70, 32)
    rotation = scale * np.array(
        [[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]]
    )
    moved = shapely.transform(free, lambda points: points @ rotation + scale * 7.0)
    first = narrow_passages(moved, 1)[0]
    assert first.width_mm == pytest.approx(gap * scale, rel=1e-6)
    # The middle of where the boxes run beside each other, if they do so for long enough.
    expected = np.array([40 + 0.5 * gap, 26.0]) @ rotation + scale * 7.0
    assert np.hypot(*(np.array(first.middle_mm) - expected)) <= scale * 6.0 + 1e-6
    if gap < 5.0 and turn == 0.0:
        assert first.middle_mm == pytest.approx(tuple(expected), rel=1e-6)


def test_narrowest_passage_against_eroding_until_it_closes():
    free = grid_map(7).free_space
    width = narrow_passages(free, 1)[0].width_mm
    before = shapely.buffer(free, -0.5 * width * (1 - 2e-3), quad_segs=64)
    after = shapely.buffer(free, -0.5 * width * (1 + 2e-3), quad_segs=64)
    rings = [
        shapely.get_num_interior_rings(shapely.get_parts(shape)).sum() for shape in (before, after)
    ]
    parts = [shapely.get_num_geometries(shape) for shape in (before, after)]
    # Up to there nothing closes; beyond it, an island joins its neighbour or a way is cut.
    assert rings[0] == 36
    assert parts[0] == 1
    assert rings[1] < 36 or parts[1] > 1


# --- Notches and dead ends ------------------------------------------------------------------------

BODY_MM = 10.0
"""Of 78.5 mm2: dead ends with less are notches."""


def wall(*cut):
    """The free space of a room with a thick wall from below, with pieces cut out of the wall."""
    return shapely.union_all([ROOM - shapely.box(30, 0, 70, 40), *cut])


def corridors_of(free, body_mm=BODY_MM, **more):
    """Widths below the body's, of what is a corridor for it."""
    found = narrow_passages(free, 5, [body_mm], **more)
    return [passage.width_mm for passage in found if passage.width_mm < body_mm]


def test_a_notch_is_no_corridor():
    notched = wall(shapely.box(49.75, 36, 50.25, 40))
    first = narrow_passages(notched, 1)[0]
    assert first.width_mm == pytest.approx(0.5)
    # It is closed halfway along: what is cut off is 0.5 x 2 mm.
    assert first.dead_end_mm == pytest.approx(math.sqrt(4 / math.pi))
    assert corridors_of(notched) == []
    assert corridors_of(notched, 0.6) == pytest.approx([0.5])


def test_a_narrow_gap_through_one_wall_is_a_corridor():
    divided = wall(shapely.box(30, 20, 70, 20.5)) - shapely.box(30, 40, 70, 60)
    assert corridors_of(divided) == pytest.approx([0.5])
    assert narrow_passages(divided, 1)[0].dead_end_mm == math.inf


def test_a_gap_between_two_walls_is_a_corridor_however_little_is_behind_it():
    free = ROOM - shapely.box(20, 20, 40, 40) - shapely.box(40.5, 20, 60, 40)
    assert corridors_of(free) == pytest.approx([0.5])


@pytest.mark.parametrize(
    ("side_mm", "depth_mm", "widths"),
    [(12.0, 12.0, [4.0]), (8.0, 8.0, []), (4.0, 16.0, []), (4.0, 32.0, [4.0]), (12.0, 5.5, [])],
)
def test_a_dead_end_with_room_for_the_body_is_a_corridor(side_mm, depth_mm, widths):
    """A chamber behind a mouth of 4 mm width and 2 mm depth: its area decides."""
    chamber = shapely.box(50 - side_mm / 2, 38 - depth_mm, 50 + side_mm / 2, 38)
    assert corridors_of(wall(shapely.box(48, 37, 52, 40), chamber)) == pytest.approx(widths)


@pytest.mark.parametrize(("inner_mm", "widths"), [(12.0, [4.0]), (7.0, [])])
@pytest.mark.parametrize("turn_deg", [0, 90, 180, 270])
def test_a_u_shaped_wall_is_one_wall_with_a_dead_end(inner_mm, widths, turn_deg):
    top_mm = 24 + inner_mm
    u = shapely.box(38, 18, 62, top_mm + 3) - shapely.box(48, top_mm, 52, top_mm + 3)
    u -= shapely.box(50 - inner_mm / 2, 24, 50 + inner_mm / 2, top_mm)
    free = ROOM - shapely.affinity.rotate(u, turn_deg)
    assert corridors_of(free) == pytest.approx(widths)


def test_a_dead_end_with_a_start_is_a_corridor():
    alcove = wall(shapely.box(48, 34, 52, 40))
    assert corridors_of(alcove, starts_mm=[(10, 10)]) == []
    assert corridors_of(alcove, starts_mm=[(10, 10), (50, 35)]) == pytest.approx([4.0])


def test_notches_hide_no_corridor():
    """Neither the one in whose wall they are, nor by being many and narrower."""
    notches = [shapely.box(x, 19, x + 0.1, 21.1) for x in range(36, 66, 3)]
    door = wall(shapely.box(30, 20, 70, 21)) - shapely.box(30, 40, 70, 60)
    free = shapely.union_all([door, *notches])
    assert widths_of(free) == pytest.approx([0.1] * 5)
    assert corridors_of(free) == pytest.approx([1.0])


def test_a_room_that_is_too_narrow_everywhere_has_corridors():
    assert corridors_of(shapely.box(0, 0, 40, 9), 20.0) == pytest.approx([9.0])


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 10_000), turn=st.floats(0.0, 360.0))
def test_dead_ends_are_what_closing_a_passage_cuts_off(seed, turn):
    rng = np.random.default_rng(seed)
    boxes = [
        shapely.box(x, y, x + w, y + h) for x, y, w, h in rng.uniform(2, 30, (9, 4)) * (3, 2, 1, 1)
    ]
    room = shapely.box(-5, -5, 130, 95) - shapely.union_all(boxes)
    free = shapely.affinity.rotate(room, turn, origin=(0, 0))
    for passage in narrow_passages(free, 6):
        slit = shapely.affinity.scale(shapely.LineString(passage.ends_mm), 1.0001, 1.0001)
        (part,) = [one for one in shapely.get_parts(free) if one.distance(slit.centroid) == 0.0]
        pieces = shapely.get_parts(part - slit.buffer(1e-6, cap_style="flat"))
        filled = sorted(shapely.Polygon(one.exterior).area for one in pieces)  # islands count in
        outside = shapely.Polygon(part.exterior).area
        cut_off = min(filled[0], outside - filled[0]) if len(filled) > 1 else math.inf
        expected = math.sqrt(4 * cut_off / math.pi) if cut_off < 0.1 * outside else math.inf
        assert passage.dead_end_mm == pytest.approx(expected, rel=1e-3, abs=1e-2)


def jagged(corners):
    angle = np.arange(corners) * 2.0 * np.pi / corners
    radius = np.where(np.arange(corners) % 2, 90.0, 130.0)[:, None]
    points = [430, 230] + radius * np.column_stack([np.cos(angle), np.sin(angle)])
    return shapely.box(0, 0, 600, 400) - shapely.Polygon(points)


def test_many_jagged_corners_are_searched():
    assert widths_of(jagged(1_000)) == pytest.approx([40.0, 40.0, 100.0, 300.0], rel=1e-3)


@pytest.mark.parametrize("seed", range(3))
def test_simplified_walls_have_the_same_passages(seed, monkeypatch):
    free = grid_map(seed).free_space
    exact = widths_of(free, 8)
    monkeypatch.setattr(passages, "_SOME_PAIRS", 0.0)  # parallel walls by their direction
    assert widths_of(free, 8) == exact
    monkeypatch.setattr(passages, "_MANY_PAIRS", 0.0)
    assert widths_of(free, 8) == pytest.approx(exact, rel=1e-3)
    monkeypatch.setattr(passages, "_MOST_PAIRS", 0.0)
    with pytest.raises(BadInputError, match="--simplify-mm"):
        narrow_passages(free)
