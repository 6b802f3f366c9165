import math
import re
from collections import Counter
from dataclasses import replace
from itertools import pairwise
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import shapely
import svgelements
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely.ops import substring

from vinefab.growth.options import GrowthOptions
from vinefab.maps.generators.cave import CaveOptions, cave_map
from vinefab.maps.generators.grid import GridOptions, grid_map
from vinefab.maps.generators.pegs import PegsOptions, pegs_map
from vinefab.model.deployment import Stop
from vinefab.model.design import Design
from vinefab.model.map import Map, Pose
from vinefab.model.outline import Contour
from vinefab.outline.body_outline import body_outline
from vinefab.pages import plan_svg
from vinefab.pages.plan import STOP_WORDS, UNSEEN_DETAIL
from vinefab.pages.plan_svg import (
    STOP_SIGNS,
    contour_path,
    ground_svg,
    outline_svg,
    pose_svg,
    robot_svg,
    stop_class,
    view_box,
)
from vinefab.prediction.deploy import deploy

UP = np.array([1.0, -1.0])
ROBOTS = {
    "bent round walls": ("grid_explorer_levels", cave_map(1, CaveOptions()), {"body": "inflated"}),
    "a line among stones": (
        "cave_explorer_levels",
        grid_map(1, GridOptions()),
        {"body": "centerline"},
    ),
    "most of it inside": ("three_level_tree", pegs_map(1, PegsOptions()), {"body": "inflated"}),
    "children of the stuck": (
        "grid_explorer_levels",
        cave_map(2, CaveOptions()),
        {"body": "inflated", "children_of_stuck": "deploy"},
    ),
}


@pytest.fixture(scope="module", params=ROBOTS)
def grown(request):
    name, world, given_options = ROBOTS[request.param]
    return deploy(Design.read(name), world, None, GrowthOptions.published(**given_options).content)


def parsed(text):
    return ET.fromstring(text)  # noqa: S314  our own text


def drawn(grown, **options):
    return parsed(robot_svg(grown.deployment, grown.deployment.tree.width_mm, **options))


def corners(path):
    """Return the corners of a path of straight lines in map coordinates, read by svgelements."""
    return np.array([[step.end.x, step.end.y] for step in svgelements.Path(path)]) * UP


def rings(path):
    """Return the closed rings of a path, each with its corners as in `corners`."""
    parts = svgelements.Path(path).as_subpaths()
    return [np.array([[step.end.x, step.end.y] for step in part]) * UP for part in parts]


def polygon(path):
    """Return what a path of rings encloses, holes left open."""
    solid = shapely.Polygon()
    for ring in rings(path):
        solid = solid.symmetric_difference(shapely.Polygon(ring))
    return solid


def shown_until(path, front_mm):
    """Return the part of a chain that a page shows at a front length by its dashes."""
    chain = corners(path.get("d"))
    length = front_mm - float(path.get("data-base"))
    if length <= 0.0:
        return None
    if length >= float(path.get("data-grown")):
        return chain
    line = shapely.LineString(chain)
    return np.array(substring(line, 0.0, length).coords)


# --- Ground


def frame_world():
    bounds = shapely.Polygon(
        [(0, 0), (90, 0), (90, 60), (40, 60), (40, 90), (0, 90)],
        [[(10, 10), (20, 10), (20, 20), (10, 20)]],
    )
    ring = shapely.box(30, 5, 60, 35) - shapely.box(40, 15, 50, 25)
    return Map(
        name="w",
        bounds=bounds,
        obstacles=(ring, shapely.box(55.123, 30, 80, 55), ring.exterior.convex_hull),
    )


def test_every_obstacle_is_a_path_with_its_number():
    for world in (frame_world(), cave_map(1, CaveOptions()), pegs_map(1, PegsOptions())):
        ground = parsed(ground_svg(world))
        paths = [path for path in ground if path.get("data-obstacle")]
        assert [int(path.get("data-obstacle")) for path in paths] == [*range(len(world.obstacles))]
        for path, obstacle in zip(paths, world.obstacles, strict=True):
            assert polygon(path.get("d")).hausdorff_distance(obstacle) < 0.011
            assert path.get("class") == "rock"


def test_what_lies_outside_of_the_bounds_is_rock_too():
    world = frame_world()
    ground = parsed(ground_svg(world))
    kinds = Counter(path.get("class") for path in ground)
    assert kinds == {"free": 1, "rock": 5, "bounds": 1}  # 3 obstacles, a hole and a corner
    outside = [polygon(path.get("d")) for path in ground
               if path.get("class") == "rock" and not path.get("data-obstacle")]  # fmt: skip
    assert sum(part.area for part in outside) == pytest.approx(100.0 + 50.0 * 30.0)
    assert polygon(ground[0].get("d")).area == pytest.approx(world.bounds.area)
    assert "data-obstacle" not in ground_svg(Map(name="m", bounds=shapely.box(0, 0, 9, 9)))


def test_a_small_picture_has_one_path_for_all_that_is_solid():
    world = frame_world()
    ground = parsed(ground_svg(world, detail=False))
    assert [path.get("class") for path in ground] == ["free", "rock merged", "bounds"]
    # Filled where rings wind around a place: outer ones one way, holes the other.
    turns = [shapely.LinearRing(ring).is_ccw for ring in rings(ground[1].get("d"))]
    assert len(set(turns)) == 2
    assert Counter(turns)[False] == 1


def test_a_map_of_a_thousand_walls_stays_small_and_an_endless_one_is_simplified():
    pegs = pegs_map(1, PegsOptions())
    assert pegs.wall_count > 1000
    assert len(ground_svg(pegs)) < 15 * pegs.wall_count
    assert len(ground_svg(pegs, detail=False)) < 10 * pegs.wall_count
    around = np.linspace(0.0, math.tau, 4000, endpoint=False)
    circle = np.column_stack([np.cos(around), np.sin(around)])
    stones = tuple(shapely.Polygon((x, 50) + 10 * circle) for x in (20, 45, 70))
    text = ground_svg(Map(name="fine", bounds=shapely.box(0, 0, 100, 100), obstacles=stones))
    assert len(text) < 12_000
    for path, stone in zip(parsed(text)[1:-1], stones, strict=True):
        assert polygon(path.get("d")).hausdorff_distance(stone) <= 100 * UNSEEN_DETAIL + 0.011
    small = parsed(ground_svg(Map(name="s", bounds=shapely.box(0, 0, 100, 100),
                                  obstacles=stones), detail=False))[1].get("d")  # fmt: skip
    assert len(small) < 1_500
    shown = polygon(small)
    assert shown.hausdorff_distance(shapely.union_all(stones)) <= 5 * 100 * UNSEEN_DETAIL + 0.011


def test_a_map_of_endless_obstacles_is_one_path(monkeypatch):
    world = frame_world()
    monkeypatch.setattr(plan_svg, "MOST_OBSTACLES", 2)
    kinds = [path.get("class") for path in parsed(ground_svg(world))]
    assert kinds == ["free", "rock merged", "bounds"]


# --- Robot


def test_every_branch_is_drawn_where_it_lies(grown):
    robot, final = drawn(grown), grown.deployment
    place = {name: branch for branch, name in enumerate(final.tree.ids)}
    out = np.flatnonzero(final.deployed).tolist()
    for kind in ("body", "line"):
        paths = robot.findall(f".//g[@class='{kind}']/path")
        assert sorted(place[path.get("data-branch")] for path in paths) == out
        for path in paths:
            branch = place[path.get("data-branch")]
            chain = final.chain_mm(branch)
            assert corners(path.get("d")) == pytest.approx(chain, abs=6e-4)
            assert float(path.get("data-grown")) == pytest.approx(final.grown_mm[branch], abs=6e-4)
    assert float(robot.get("data-full")) == pytest.approx(grown.history.full_mm, abs=6e-4)


def test_levels_lie_on_each_other_with_the_trunk_on_top_and_have_their_width(grown):
    robot, widths_mm = drawn(grown), grown.design.build.widths_mm
    levels = [group.get("class") for group in robot if group.get("class").startswith("level")]
    assert levels == [f"level level-{level}" for level in range(len(widths_mm), 0, -1)]
    for group, width_mm in zip(robot, reversed(widths_mm), strict=False):
        body = group.find("g[@class='body']")
        assert float(body.get("stroke-width")) == pytest.approx(2 * width_mm / math.pi, abs=6e-4)
    assert [group.get("class") for group in robot][-2:] == ["contacts", "tips"]


@pytest.mark.parametrize("share", [0.02, 0.31, 0.5, 0.67, 0.83, 0.97, 1.0])
def test_dashes_show_what_has_grown_up_to_the_last_contact(grown, share):
    frame = grown.history.at(front_mm := share * grown.history.full_mm)
    then = frame.deployment
    paths = {path.get("data-branch"): path
             for path in drawn(grown).findall(".//g[@class='line']/path")}  # fmt: skip
    shown = {name: shown_until(path, front_mm) for name, path in paths.items()}
    assert {name for name, chain in shown.items() if chain is not None} <= set(then.tree.ids)
    for branch in np.flatnonzero(then.deployed).tolist():
        wanted, chain = then.chain_mm(branch), shown[then.tree.ids[branch]]
        if chain is None:
            assert then.grown_mm[branch] == pytest.approx(0.0, abs=0.01)
            continue
        assert shapely.LineString(chain).length == pytest.approx(then.grown_mm[branch], abs=0.01)
        # A tip that slides turns the stretch behind it: that one is where it will lie later.
        still = len(wanted) - bool(frame.is_growing[branch])
        assert chain[:still] == pytest.approx(wanted[:still], abs=0.01)


@pytest.mark.parametrize("share", [0.02, 0.31, 0.67, 0.97])
def test_a_frame_is_drawn_as_it_is_and_what_grows_on_has_no_mark(grown, share):
    frame = grown.history.at(share * grown.history.full_mm)
    then = frame.deployment
    widths_mm = grown.options.drawn_widths_mm(then.tree)
    robot = parsed(robot_svg(then, widths_mm, is_growing=frame.is_growing))
    for path in robot.findall(".//g[@class='line']/path"):
        chain = then.chain_mm(then.tree.ids.index(path.get("data-branch")))
        assert corners(path.get("d")) == pytest.approx(chain, abs=6e-4)
    marked = {mark.get("data-branch") for mark in robot.findall("./g[@class='tips']/g")}
    still = np.flatnonzero(then.deployed & ~frame.is_growing)
    assert marked == {then.tree.ids[branch] for branch in still}


def test_the_shape_at_a_tip_says_why_it_stopped(grown):
    robot, final = drawn(grown), grown.deployment
    rings = robot.findall("./g[@class='tips']/g[@class='mark stop-not-deployed']")
    lost = [int(ring.find("title").text.split()[0]) for ring in rings]
    assert sum(lost) == final.stops["not_deployed"]
    marks = robot.findall("./g[@class='tips']/g[@data-branch]")
    names, fronts_mm = final.tree.ids, final.base_mm + final.grown_mm
    assert len(marks) == np.count_nonzero(final.deployed)
    for mark in marks:
        branch = names.index(mark.get("data-branch"))
        stop = Stop(final.stop[branch])
        assert mark.get("class") == f"mark {stop_class(stop)}"
        assert ET.tostring(mark[0]) == ET.tostring(parsed(STOP_SIGNS[stop]))
        assert float(mark.get("data-front")) == pytest.approx(fronts_mm[branch], abs=6e-4)
        assert place_of(mark) == pytest.approx(final.chain_mm(branch)[-1], abs=6e-4)
        said = mark.find("title").text
        assert said.startswith(f"{names[branch]}: {STOP_WORDS[stop]}, ")
        grown_mm, planned_mm = final.grown_mm[branch], final.tree.length_mm[branch]
        assert said.endswith(f" {grown_mm:.1f} of {planned_mm:.1f} mm (simulated)")
    assert len(set(STOP_SIGNS.values())) == len(STOP_SIGNS)


def place_of(group):
    x, y = re.fullmatch(r"translate\((\S+) (\S+)\)", group.get("transform")).groups()
    return float(x), -float(y)


def test_contacts_are_marked_with_the_front_that_comes_there(grown):
    final = grown.deployment
    marks = drawn(grown).findall("./g[@class='contacts']/g")
    wanted = []
    for branch in np.flatnonzero(final.deployed).tolist():
        way_mm, chain = float(final.base_mm[branch]), final.chain_mm(branch)
        for before, contact in pairwise(chain[:-1]):
            way_mm += math.dist(before, contact)
            wanted.append((*contact, way_mm))
    found = [(*place_of(mark), float(mark.get("data-front"))) for mark in marks]
    assert len(found) == len(wanted)
    assert np.array(found) == pytest.approx(np.array(wanted), abs=2e-3)


def test_without_detail_a_level_is_one_path(grown, monkeypatch):
    final, widths_mm = grown.deployment, grown.deployment.tree.width_mm
    plain = robot_svg(final, widths_mm, detail=False)
    assert "data-branch" not in plain
    assert "mark" not in plain
    for group in parsed(plain):
        level = int(group.get("class")[-1])
        here = np.flatnonzero((final.tree.level == level) & final.deployed)
        chains = [final.chain_mm(branch) for branch in here]
        paths = group.findall("./g[@class='line']/path")
        assert len(paths) == min(1, len(chains))
        if chains:
            assert corners(paths[0].get("d")) == pytest.approx(np.concatenate(chains), abs=6e-4)
    monkeypatch.setattr(plan_svg, "_MOST_BRANCHES", len(final.tree) - 1)
    assert robot_svg(final, widths_mm) == plain


def test_a_robot_that_never_emerged_and_one_without_widths_are_drawn():
    world = grid_map(1, GridOptions())
    inside = deploy(
        Design.read("six_branch_anchor"), world, Pose(x_mm=250.0, y_mm=0.5, heading_rad=1.5),
        GrowthOptions.published(body="inflated").content,
    )  # fmt: skip
    assert inside.stops["not_deployed"] == len(inside.deployment.tree)
    assert not drawn(inside).findall(".//path")
    bare = robot_svg(inside.deployment, np.zeros(len(inside.deployment.tree)))
    assert 'class="body"' not in bare


# --- Outlines


def measured(path):
    """Return length and area of a closed path of lines and arcs as svgelements reads it."""
    length, area = 0.0, 0.0
    for step in svgelements.Path(path):
        if isinstance(step, svgelements.Move):
            continue
        (x0, y0), (x1, y1) = (step.start.x, -step.start.y), (step.end.x, -step.end.y)
        area += (x0 * y1 - x1 * y0) / 2.0
        if isinstance(step, svgelements.Arc):
            turn, radius = -step.sweep, step.rx
            assert step.rx == pytest.approx(step.ry)
            length += abs(turn) * radius
            area += radius**2 * (turn - math.sin(turn)) / 2.0
        else:
            length += math.hypot(x1 - x0, y1 - y0)
    return length, area


@pytest.mark.parametrize(
    "name", ["three_level_tree", "grid_explorer_pieces_levels", "six_branch_anchor"]
)
def test_the_outline_of_a_robot_keeps_its_arcs(name):
    contour = body_outline(Design.read(name)).contour
    root = parsed(outline_svg(contour))
    length_mm, area_mm2 = measured(root.get("d") + ("" if contour.closed else "Z"))
    gap_mm = 0.0 if contour.closed else math.dist(contour.points_mm[0], contour.points_mm[-1])
    assert contour.arc_count > 10
    assert root.get("d").count("A") >= contour.arc_count
    assert length_mm - gap_mm == pytest.approx(contour.length_mm, abs=2e-3 * len(contour))
    assert area_mm2 == pytest.approx(contour.signed_area_mm2, rel=1e-5)
    assert (root.get("class"), root.get("d")) == ("outline", contour_path(contour))


ANGLES = st.lists(
    st.floats(0.0, math.tau), min_size=3, max_size=8, unique_by=lambda angle: round(angle, 1)
)
BULGES = st.sampled_from([0.0, 1e-9, 0.01, -0.3, 0.5, 0.999, 1.0, -1.0, 1.7, -8.0])


@settings(max_examples=40, deadline=None)
@given(angles=ANGLES, bulges=st.lists(BULGES, min_size=8, max_size=8))
def test_arcs_of_any_angle_keep_their_length_and_area(angles, bulges):
    corners_mm = 40.0 * np.column_stack([np.cos(sorted(angles)), np.sin(sorted(angles))])
    count = len(corners_mm)
    contour = Contour.polyline(corners_mm, closed=True)
    contour = Contour(
        points_mm=corners_mm, bulges=np.array(bulges[:count]), parts=contour.parts,
        branches=contour.branches, closed=True,
    )  # fmt: skip
    length_mm, area_mm2 = measured(contour_path(contour))
    assert length_mm == pytest.approx(contour.length_mm, abs=0.02, rel=1e-4)
    assert area_mm2 == pytest.approx(contour.signed_area_mm2, abs=0.02 * contour.length_mm)


# --- Start, box


def test_a_start_is_placed_by_its_group_alone():
    pose = Pose(x_mm=10.0, y_mm=20.0, heading_rad=math.pi / 2)
    group = parsed(pose_svg(pose, 30.0))
    assert group.get("transform") == "translate(10 -20) rotate(-90)"
    assert [part.get("class") for part in group] == ["shaft", "handle heading", "handle base"]
    assert corners(group[1].get("d"))[0] == pytest.approx([30.0, 0.0])
    turned = svgelements.Path(group[1].get("d")) * svgelements.Matrix(group.get("transform"))
    turned.reify()
    assert (turned[0].end.x, turned[0].end.y) == pytest.approx((10.0, -50.0))  # upwards


def test_the_box_of_a_view_counts_downwards():
    assert view_box((10.0, 20.0, 110.0, 70.0), 5.0) == "5 -75 110 60"
    assert view_box((0.0, 0.0, 1.0, 2.0)) == "0 -2 1 2"


RANGED = Map(name="m", bounds=shapely.box(0, 0, 100, 80), obstacles=(shapely.box(0, 30, 20, 50),))


def test_the_line_of_a_start_its_free_pieces_and_its_headings_are_drawn():
    ground = parsed(ground_svg(RANGED.with_start("line 10,5 10,75, clear 2, heading 0+-30")))
    (group,) = [part for part in ground if part.get("class") == "range"]
    fan, *free, whole = group
    assert [part.get("class") for part in group] == ["fan", "places", "places", "whole"]
    assert whole.get("d") == "M10 -5L10 -75"
    assert [path.get("d") for path in free] == ["M10 -5L10 -28", "M10 -52L10 -75"]
    base, *arc = corners(fan.get("d"))[:-1]
    turned = np.degrees(np.arctan2(*(np.array(arc) - base).T[::-1]))
    assert (turned.min(), turned.max()) == pytest.approx((-30.0, 30.0), abs=0.1)


def test_an_area_is_drawn_where_it_is_free_and_a_single_pose_has_no_range():
    ground = parsed(ground_svg(RANGED.with_start("area 5,5 25,75, clear 2")))
    (group,) = [part for part in ground if part.get("class") == "range"]
    assert [part.get("class") for part in group] == ["fan", "whole"]
    solid = polygon(group[0].get("d"))
    assert not solid.intersects(shapely.box(0, -51.9, 21.9, -28.1))
    assert 'class="range"' not in ground_svg(RANGED.with_start("50,10,90"))
    assert 'class="range"' in ground_svg(RANGED.with_start("50,10,90+-5"), detail=False)
    assert "range of starts" in RANGED.with_start("50,10,90+-5")._repr_svg_()


def test_a_line_that_obstacles_were_moved_over_is_drawn_all_the_same():
    world = RANGED.with_start("line 50,10 50,40")
    closed = replace(world, obstacles=(shapely.box(0, 0, 90, 70),))
    (group,) = [p for p in parsed(ground_svg(closed)) if p.get("class") == "range"]
    assert [part.get("class") for part in group] == ["whole"]
