import math
from itertools import pairwise

import numpy as np
import pytest
import shapely
from shapely import LineString, Polygon

from tests.oracles.body_outline import Twin
from vinefab.fabrication.outline.body_outline import ProblemKind, body_outline, flat_layout
from vinefab.fabrication.outline.joint import LEAST_CUT_MM, LEAST_SEGMENT_MM, level_tapers_rad
from vinefab.model.design import Collar, Pouch
from vinefab.model.outline import Part

FINE_MM = 1e-4


def flat(contour):
    return Polygon(contour.flattened_mm(FINE_MM))


def hausdorff_mm(first, second):
    return shapely.hausdorff_distance(
        *(shapely.segmentize(shape.exterior, 2.0) for shape in (first, second))
    )


def distances_mm(points_mm, line):
    """Return how far points are from a line of many chords, by an index of the chords."""
    ends = shapely.get_coordinates(line)
    chords = shapely.STRtree(shapely.linestrings(np.stack([ends[:-1], ends[1:]], axis=1)))
    points = shapely.points(points_mm)
    return chords.query_nearest(points, return_distance=True, all_matches=False)[1]


def kinds(outline):
    return {problem.kind for problem in outline.problems}


def test_walk_equals_the_union_of_plain_shapes(sound_design, sound_body):
    outline = body_outline(sound_design)
    union = sound_body()
    assert outline.problems == ()
    assert union.geom_type == "Polygon"
    assert len(union.interiors) == 0
    assert flat(outline.contour).is_valid
    assert hausdorff_mm(flat(outline.contour), union) <= 0.01
    assert outline.contour.signed_area_mm2 == pytest.approx(union.area, rel=1e-5)
    assert flat(outline.contour).symmetric_difference(union).area <= 1e-5 * union.area


@pytest.mark.parametrize("offset_mm", [0.55, 2.0, 6.0, -1.5])
def test_every_point_of_an_offset_is_that_far_from_the_lumen(sound_design, sound_body, offset_mm):
    outline = body_outline(sound_design, offset_mm)
    edge = sound_body(beyond_mm=50.0).exterior
    line = shapely.segmentize(LineString(outline.contour.flattened_mm(FINE_MM)), 1.0)
    distances = distances_mm(shapely.get_coordinates(line), edge)
    assert outline.problems == ()
    assert flat(outline.contour).is_valid
    assert np.abs(distances - abs(offset_mm)).max() < 1e-3
    assert outline.contour.points_mm[[0, -1], 0].tolist() == [-sound_design.build.tail_mm] * 2


def test_offset_for_seam_and_kerf_equals_the_buffer_of_the_lumen(sound_design, sound_body):
    lumen = sound_body(beyond_mm=50.0)
    x0, y0, x1, y1 = lumen.buffer(5.0).bounds
    buffered = lumen.buffer(0.55, quad_segs=256)
    buffered = buffered.intersection(shapely.box(max(x0, -sound_design.build.tail_mm), y0, x1, y1))
    offset = flat(body_outline(sound_design, 0.55).contour)
    assert hausdorff_mm(offset, buffered) <= 0.01
    assert offset.area == pytest.approx(buffered.area, rel=1e-4)


def test_all_joins_are_tangent_where_the_design_is(sound_design):
    segments = list(body_outline(sound_design).contour.segments)
    jumps = [
        abs(math.remainder(after.direction_rad() - before.direction_rad(at_end=True), math.tau))
        for before, after in pairwise(segments)
    ]
    sharp = sum(jump > 1e-6 for jump in jumps)
    # Without fillets, three children meet the disc of their joint in six bare corners; the two
    # between child and child lie so that each side meets the disc, not the other side.
    bare = 6 if sound_design.build.fillet_mm == (0.0,) else 0
    # Where an arc at the base of a tapered trunk would be too short to cut, its sides meet.
    (lean,) = set(level_tapers_rad(sound_design, 1))
    bend = sound_design.build.widths_mm[0] / 2 * lean
    assert sharp == bare + (2 if 0.0 < bend < LEAST_CUT_MM else 0)


def test_segments_are_long_enough_and_arcs_turn_less_than_175_degrees(sound_design):
    for offset_mm in (0.0, 0.55):
        for segment in body_outline(sound_design, offset_mm).contour.segments:
            assert segment.length_mm >= 0.05
            assert abs(math.degrees(segment.turn_rad)) < 175.0


def test_fillet_between_almost_parallel_children_is_split(make_plan, make_fan):
    contour = body_outline(make_plan((40.0, 4.0), (2.0,), [make_fan(2, 400, 4)])).contour
    assert max(abs(math.degrees(s.turn_rad)) for s in contour.segments) < 175.0
    between = [s for s in contour.segments if s.part is Part.FILLET and s.turn_rad < -1.5]
    assert [math.degrees(s.turn_rad) for s in between] == pytest.approx([-88.0, -88.0])
    assert [s.radius_mm for s in between] == pytest.approx([2.0, 2.0])


def test_radii_are_the_designed_ones(make_plan, make_fan):
    pouch = Pouch(shape="round", radius_mm=16.0)
    design = make_plan((40.0, 20.0), (6.5,), [make_fan(3, 120, 160)], pouch=pouch)
    for offset_mm in (0.0, 0.55):
        expected = {Part.FILLET: 6.5 - offset_mm, Part.POUCH: 16.0 + offset_mm}
        expected |= {Part.JOINT: 20.0 + offset_mm}
        arcs = [s for s in body_outline(design, offset_mm).contour.segments if s.bulge]
        assert {arc.part for arc in arcs} == set(expected)
        for arc in arcs:
            assert arc.radius_mm == pytest.approx(expected[arc.part], abs=1e-9)


def test_fillets_turn_clockwise_and_everything_else_counter_clockwise(sound_design):
    for arc in body_outline(sound_design).contour.segments:
        if arc.bulge:
            assert (arc.bulge < 0.0) == (arc.part is Part.FILLET) or arc.part is Part.COLLAR


def test_contour_runs_from_mouth_corner_to_mouth_corner(sound_design):
    contour = body_outline(sound_design).contour
    half, mouth = sound_design.build.mouth_width_mm / 2, -sound_design.build.tail_mm
    assert not contour.closed
    assert contour.points_mm[0].tolist() == [mouth, -half]
    assert contour.points_mm[-1].tolist() == [mouth, half]
    assert contour.signed_area_mm2 > 0.0


def test_segments_lie_on_the_branch_that_they_name(sound_design):
    layout = flat_layout(sound_design)
    contour = body_outline(sound_design).contour
    row = {name: number for number, name in enumerate(layout.tree.ids)}
    assert set(contour.branches) == set(row)
    for segment in contour.segments:
        branch = row[segment.branch]
        if segment.part is Part.SIDE:
            axis = layout.start_mm[branch], layout.end_mm[branch]
            away = LineString(axis).distance(LineString([segment.start_mm, segment.end_mm]))
            half, end_half = layout.width_mm[branch] / 2, layout.end_width_mm[branch] / 2
            assert min(half, end_half) - 1e-6 <= away <= max(half, end_half) + 1e-6
        if segment.part in (Part.TIP, Part.POUCH) and sound_design.build.pouch is None:
            assert segment.center_mm == pytest.approx(layout.end_mm[branch], abs=1e-6)
        if segment.part is Part.TAIL:
            # The corner of a tapered trunk lies past its base by half the arc that it stands for.
            assert max(segment.start_mm[0], segment.end_mm[0]) <= LEAST_CUT_MM / 2


def test_walk_meets_the_branches_in_the_order_of_a_depth_first_tour(make_plan, make_fan):
    levels = [make_fan(2, 150, 90), make_fan(2, 80, 70)]
    contour = body_outline(make_plan((40.0, 24.0, 12.0), levels=levels)).contour
    tips = [s.branch for s in contour.segments if s.part is Part.TIP]
    assert list(dict.fromkeys(tips)) == ["0.0.0", "0.0.1", "0.1.0", "0.1.1"]


def test_parents_side_shows_again_behind_children_that_bend_backwards(make_plan, make_fan):
    design = make_plan((40.0, 16.0), levels=[make_fan(2, 150, 270)], trunk=200.0)
    contour = body_outline(design).contour
    parents = [s for s in contour.segments if s.part is Part.SIDE and s.branch == "0"]
    # From the tail to each crotch, and from behind each child to the end of the trunk.
    assert len(parents) == 4
    assert {abs(segment.end_mm[1]) for segment in parents} == {20.0}


def test_tail_shorter_than_a_segment_joins_the_trunks_side(make_plan):
    parts = [s.part for s in body_outline(make_plan((40.0,), tail=0.01)).contour.segments]
    assert parts == [Part.SIDE, Part.TIP, Part.TIP, Part.SIDE]


def test_fillet_is_capped_so_that_the_crotch_ends_at_half_the_shorter_child(make_plan, make_fan):
    design = make_plan((40.0, 24.0), (30.0,), [make_fan(2, 150, 45, 0.8)])
    contour = body_outline(design).contour
    half_sin = math.sin(math.radians(45.0) / 2)
    cap = (0.5 * 0.8 * 150 * half_sin - 12.0) / (1 - half_sin)
    between = [s for s in contour.segments if s.part is Part.FILLET and s.turn_rad < -2.0]
    assert [fillet.radius_mm for fillet in between] == pytest.approx([cap])
    near = math.dist(between[0].center_mm, (120.0, 0.0)) - cap
    assert near == pytest.approx(0.5 * 0.8 * 150)


def test_collar_has_the_clamps_width_and_arcs_of_one_radius(make_plan):
    collar = Collar(clamp_diameter_mm=30.0, length_mm=20.0, flare_mm=40.0)
    design = make_plan((30.0,), tail=120.0, collar=collar)
    contour = body_outline(design).contour
    mouth = math.dist(contour.points_mm[0], contour.points_mm[-1])
    assert mouth == pytest.approx(math.pi * 30.0 / 2)
    arcs = [s for s in contour.segments if s.part is Part.COLLAR]
    rise = (mouth - 30.0) / 2
    assert [arc.radius_mm for arc in arcs] == pytest.approx([(40**2 / rise + rise) / 4] * 4)
    assert {round(arc.start_mm[0], 9) for arc in arcs} >= {-100.0, -80.0}
    straight = [s for s in contour.segments if s.part is Part.TAIL]
    assert sorted(round(s.length_mm, 9) for s in straight) == [20.0, 20.0, 60.0, 60.0]


@pytest.mark.parametrize(
    ("collar", "kind"),
    [
        (Collar(clamp_diameter_mm=30.0, length_mm=30.0, flare_mm=30.0), ProblemKind.COLLAR),
        (Collar(clamp_diameter_mm=60.0, length_mm=5.0, flare_mm=1.0), ProblemKind.COLLAR_FLARE),
    ],
)
def test_collar_that_cannot_be_drawn_is_named(make_plan, collar, kind):
    assert kind in kinds(body_outline(make_plan((30.0,), tail=60.0, collar=collar), 0.55))


def test_tapered_sides_touch_the_discs_at_both_ends(make_plan):
    contour = body_outline(make_plan((40.0,), taper=(0.5,))).contour
    lean = math.asin((20.0 - 10.0) / 120.0)
    sides = [s for s in contour.segments if s.part is Part.SIDE]
    assert [s.length_mm for s in sides] == pytest.approx([120.0 * math.cos(lean)] * 2)
    assert [abs(s.direction_rad()) for s in sides] == pytest.approx([lean, math.pi - lean])
    tips = [s for s in contour.segments if s.part is Part.TIP]
    assert sum(s.turn_rad for s in tips) == pytest.approx(math.pi - 2 * lean)


@pytest.mark.parametrize("offset_mm", [0.0, 0.55])
@pytest.mark.parametrize(
    ("width", "ratio", "trunk"),
    [(40.0, 0.95, 120.0), (40.0, 0.9, 400.0), (20.0, 0.8, 120.0), (6.0, 0.5, 40.0)],
)
def test_a_tapered_trunk_has_a_corner_where_an_arc_would_be_too_short_to_cut(
    make_plan, width, ratio, trunk, offset_mm
):
    design = make_plan((width,), trunk=trunk, taper=(ratio,))
    lean = math.asin(width / 2 * (1 - ratio) / trunk)
    assert LEAST_SEGMENT_MM < width / 2 * lean < LEAST_CUT_MM
    outline = body_outline(design, offset_mm)
    assert outline.problems == ()
    assert Part.JOINT not in [segment.part for segment in outline.contour.segments]
    assert min(segment.length_mm for segment in outline.contour.segments) >= LEAST_CUT_MM
    body = Twin(design, FINE_MM).body(beyond_mm=50.0).buffer(offset_mm, quad_segs=512)
    body = body.intersection(shapely.box(-design.build.tail_mm, -1e3, 1e3, 1e3))
    assert hausdorff_mm(flat(outline.contour), body) <= 0.0025


def test_a_longer_bend_of_a_tapered_trunk_stays_an_arc(make_plan):
    contour = body_outline(make_plan((40.0,), taper=(0.85,))).contour
    bends = [segment for segment in contour.segments if segment.part is Part.JOINT]
    assert [bend.radius_mm for bend in bends] == pytest.approx([20.0] * 2)
    assert bends[0].length_mm >= LEAST_CUT_MM


def test_a_tail_too_short_to_cut_joins_the_side_of_an_even_trunk(make_plan):
    contour = body_outline(make_plan((40.0,), tail=0.15)).contour
    assert [s.part for s in contour.segments] == [Part.SIDE, Part.TIP, Part.TIP, Part.SIDE]


def test_outward_offset_beyond_the_fillet_leaves_an_exact_corner(make_plan, make_fan):
    design = make_plan((40.0, 24.0), (3.0,), [make_fan(2, 160, 60)])
    contour = body_outline(design, 4.0).contour
    assert Part.FILLET not in contour.parts
    corner = 120.0 + (12.0 + 4.0) / math.sin(math.radians(30.0))
    assert np.abs(contour.points_mm - [corner, 0.0]).sum(axis=1).min() < 1e-9


@pytest.mark.parametrize(("trunk", "hidden"), [(13.9, True), (14.2, False)])
def test_a_taper_whose_end_hides_in_its_base_is_named(make_plan, trunk, hidden):
    """Discs of 20 and 6 mm: nearer than 14 mm / 0.99, the hull has no side to be drawn."""
    outline = body_outline(make_plan((40.0,), trunk=trunk, taper=(0.3,)))
    assert (ProblemKind.NO_ROOM in kinds(outline)) is hidden
    if not hidden:
        tip = max(outline.contour.points_mm[:, 0])
        assert trunk < tip <= trunk + 6.0


@pytest.mark.parametrize(
    ("widths", "level", "options", "kind"),
    [
        ((40.0, 40.0), (2, 150, 80), {}, ProblemKind.CHILD_WIDTH),
        ((40.0, 44.0), (2, 150, 80), {}, ProblemKind.CHILD_WIDTH),
        ((40.0, 24.0), (2, 150, 0), {}, ProblemKind.NARROW_CROTCH),
        ((40.0, 24.0), (2, 60, 30), {}, ProblemKind.NARROW_CROTCH),
        ((40.0, 24.0), (2, 150, 360), {}, ProblemKind.NARROW_CROTCH),
        ((40.0, 24.0), (1, 10, 0), {}, ProblemKind.NO_ROOM),
        (
            (40.0, 24.0),
            (1, 150, 0),
            {"pouch": Pouch(shape="round", radius_mm=12.0)},
            ProblemKind.POUCH_WIDTH,
        ),
        (
            (40.0, 24.0),
            (1, 150, 0),
            {"pouch": Pouch(shape="rectangle", length_mm=30.0, width_mm=20.0)},
            ProblemKind.POUCH_WIDTH,
        ),
        (
            (40.0, 24.0),
            (1, 30, 0),
            {"pouch": Pouch(shape="round", radius_mm=20.0)},
            ProblemKind.NO_ROOM,
        ),
    ],
)
def test_shapes_that_cannot_be_drawn_are_named(make_plan, make_fan, widths, level, options, kind):
    outline = body_outline(make_plan(widths, levels=[make_fan(*level)], **options))
    assert kind in kinds(outline)
    assert np.isfinite(outline.contour.points_mm).all()
    for problem in outline.problems:
        assert problem.branches[0] in problem.message
        assert math.isfinite(problem.measured_mm)


def test_obtuse_angle_beside_a_wide_parent_is_no_narrow_crotch(make_plan, make_fan):
    # The lines of the parent's and the child's side cross 25 mm from the joint, behind its disc.
    outline = body_outline(make_plan((24.0, 12.0), (2.0,), [make_fan(2, 36, 60)]))
    assert outline.problems == ()
    fillets = [s.radius_mm for s in outline.contour.segments if s.part is Part.FILLET]
    assert fillets == pytest.approx([2.0] * 3)


def test_inward_offset_that_leaves_nothing_is_named(make_plan, make_fan):
    outline = body_outline(make_plan((40.0, 10.0), levels=[make_fan(2, 100, 90)]), -5.0)
    assert kinds(outline) == {ProblemKind.VANISHED}
    assert [problem.branches for problem in outline.problems] == [("0.0",)]


def test_a_problem_of_a_level_is_reported_once_with_its_count(make_plan, make_fan):
    levels = [make_fan(2, 150, 120), make_fan(2, 40, 30)]
    outline = body_outline(make_plan((40.0, 24.0, 12.0), levels=levels))
    crotches = [p for p in outline.problems if p.kind is ProblemKind.NARROW_CROTCH]
    assert [(p.branches, p.count) for p in crotches] == [(("0.0.0", "0.0.1"), 2)]
    # Where the sides would cross: the half width over the sine of half the angle.
    assert crotches[0].measured_mm == pytest.approx(6.0 / math.sin(math.radians(15.0)))
    assert crotches[0].limit_mm == 20.0


def test_sub_millimetre_fillet_at_a_sharp_angle_is_named_not_lost(make_plan, make_fan):
    outline = body_outline(make_plan((40.0, 24.0), (0.015,), [make_fan(2, 200, 30)]))
    assert kinds(outline) == {ProblemKind.SHORT_SEGMENT}


def test_disc_that_shows_for_less_than_a_segment_is_named(make_plan, make_fan):
    # Balls of 5 mm on both sides leave 0.03 mm of the joint's disc between them.
    angle_deg = 2 * math.degrees(math.asin(15 / 25)) + 0.1
    outline = body_outline(make_plan((40.0, 20.0), (5.0,), [make_fan(2, 150, angle_deg)]))
    assert [(p.kind, p.branches) for p in outline.problems] == [
        (ProblemKind.SHORT_SEGMENT, ("0.0", "0.1"))
    ]
