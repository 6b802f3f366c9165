import itertools
import re
from importlib.resources import files

import numpy as np
import pytest
import shapely

from vinefab.growth.batch import grow_on
from vinefab.growth.options import GrowthOptions
from vinefab.growth.terrain import Terrain
from vinefab.model.design import Build, Design, Level
from vinefab.model.map import Map, Pose
from vinefab.pages.page_files import page_svg
from vinefab.pages.panel import (
    HEAT_COLOURS,
    INK,
    LEVEL_COLOURS,
    ROCK,
    ROCK_EDGE,
    SOFT,
    Marks,
    Shape,
    Words,
    text_width,
)
from vinefab.pages.plan import (
    RANGE_LABEL,
    UNSEEN_DETAIL,
    deployment_plan,
    longer_mm,
    map_plan,
    robot_view,
    rock_in,
)
from vinefab.prediction.deploy import deploy

POSE = Pose(x_mm=50.0, y_mm=5.0, heading_rad=1.5)


def world_of(side_mm):
    corners = np.mgrid[20 : side_mm - 20 : 20, 20 : side_mm - 20 : 20].reshape(2, -1)
    boxes = shapely.box(*corners, *(corners + 8))
    return Map(name="w", bounds=shapely.box(0, 0, side_mm, side_mm), obstacles=tuple(boxes))


def deployed(world):
    fork = Level(branches=2, length_mm=30.0, fan_rad=1.0)
    design = Design(name="y", trunk_length_mm=40.0, levels=(fork,), build=Build.standard(2, 4.0))
    return grow_on(design, Terrain.of(world), POSE, GrowthOptions.published())


def written(panel):
    return [one for one in panel.primitives if isinstance(one, Words)]


def test_a_small_robot_on_a_large_map_is_drawn_with_its_surroundings_only():
    near, far = world_of(100), world_of(1000)
    assert robot_view(near, deployed(near)) == near.bounds.bounds
    deployment = deployed(far)
    x_min, y_min, x_max, y_max = robot_view(far, deployment)
    assert 60.0 < longer_mm((x_min, y_min, x_max, y_max)) < 130.0
    assert ((x_min, y_min) <= deployment.points_mm.min(axis=0)).all()
    assert ((x_max, y_max) >= deployment.points_mm.max(axis=0)).all()
    plan = deployment_plan(far, deployment, np.array([4.0, 2.0, 2.0]))
    assert "1000 x 1000 mm" in plan.panels[0].title
    assert len(page_svg(plan)) < 100_000


def test_walls_are_drawn_where_they_are():
    world = world_of(1000)
    box = (100.0, 100.0, 220.0, 180.0)
    shown = shapely.union_all(rock_in(world, box)) & shapely.box(*box)
    real = shapely.union_all(world.obstacles) & shapely.box(*box)
    assert real.area > 1000
    assert shown.hausdorff_distance(real) <= UNSEEN_DETAIL * 120.0
    assert all(part.distance(shapely.box(*box)) < 40.0 for part in rock_in(world, box))


def test_names_of_branches_are_written_once_each():
    world = world_of(100)
    plan = deployment_plan(world, deployed(world), np.array([4.0, 2.0, 2.0]), named=True)
    names = [name for words in written(plan.panels[0]) for name in words.text.split(", ")]
    assert sorted(names) == ["0", "0.0", "0.1"]


def test_numbers_in_paths_are_short_and_text_stays_text():
    world = world_of(100)
    picture = page_svg(deployment_plan(world, deployed(world), np.array([4.0, 2.0, 2.0])))
    assert not re.search(rb' d="[^"]*\.\d\d\d', picture)
    assert b">grown in full (3)</text>" in picture


# Machado, Oliveira and Fernandes 2009, severity 1: what colour-blind readers see (linear RGB).
DEUTAN = [
    [0.367322, 0.860646, -0.227968],
    [0.280085, 0.672501, 0.047413],
    [-0.011820, 0.042940, 0.968881],
]
PROTAN = [
    [0.152286, 1.052583, -0.204868],
    [0.114503, 0.786281, 0.099216],
    [-0.003882, -0.048116, 1.051998],
]
TRITAN = [
    [1.255528, -0.076749, -0.178779],
    [-0.078411, 0.930809, 0.147602],
    [0.004733, 0.691367, 0.303900],
]
TO_XYZ = [
    [0.4124564, 0.3575761, 0.1804375],
    [0.2126729, 0.7151522, 0.0721750],
    [0.0193339, 0.1191920, 0.9503041],
]


def lab_of(colour, seen_as):
    """Return CIE L*, a*, b* of a colour as seen through a matrix."""
    parts = np.array([int(colour[place : place + 2], 16) for place in (1, 3, 5)]) / 255
    linear = np.where(parts <= 0.04045, parts / 12.92, ((parts + 0.055) / 1.055) ** 2.4)
    xyz = TO_XYZ @ np.clip(seen_as @ linear, 0, 1) / [0.95047, 1.0, 1.08883]
    f = np.where(xyz > 216 / 24389, np.cbrt(xyz), (24389 / 27 * xyz + 16) / 116)
    return np.array([116 * f[1] - 16, 500 * (f[0] - f[1]), 200 * (f[1] - f[2])])


PLAN_CSS = (files("vinefab.pages") / "templates" / "plan.css").read_text(encoding="utf-8")
DARK = dict(re.findall(r"--([\w-]+): (#\w{6});", PLAN_CSS.partition("/* Dark")[2]))
DARK_LEVELS = tuple(DARK[f"level-{level}"] for level in range(1, 8))
THEMES = {"light": (LEVEL_COLOURS, "#ffffff"), "dark": (DARK_LEVELS, DARK["free"])}


@pytest.mark.parametrize("theme", THEMES)
@pytest.mark.parametrize("seen_as", [np.eye(3), DEUTAN, PROTAN, TRITAN])
def test_levels_that_meet_are_told_apart_by_everybody(seen_as, theme):
    colours, paper = THEMES[theme]
    labs = [lab_of(colour, np.array(seen_as)) for colour in colours]
    apart = [np.linalg.norm(one - other) for one, other in itertools.pairwise(labs)]
    assert min(apart) > 30
    ground = lab_of(paper, np.array(seen_as))
    assert min(np.linalg.norm(lab - ground) for lab in labs) > 30


@pytest.mark.parametrize("seen_as", [np.eye(3), DEUTAN, PROTAN, TRITAN])
def test_heat_darkens_from_step_to_step_for_everybody(seen_as):
    lightness = [lab_of(colour, np.array(seen_as))[0] for colour in HEAT_COLOURS]
    assert max(np.diff(lightness)) < -10


@pytest.mark.parametrize("theme", THEMES)
def test_levels_that_meet_are_told_apart_in_grey(theme):
    lightness = [lab_of(colour, np.eye(3))[0] for colour in THEMES[theme][0]]
    assert min(np.abs(np.diff(lightness))) > 12


def test_the_style_of_plans_has_the_colours_of_all_pictures():
    light = dict(re.findall(r"var\(--([\w-]+), (#\w{6})\)", PLAN_CSS))
    assert [light[f"level-{level}"] for level in range(1, 8)] == list(LEVEL_COLOURS)
    names = {"ink": INK, "soft": SOFT, "rock": ROCK, "rock-edge": ROCK_EDGE, "free": "#ffffff"}
    assert {name: light[name] for name in names} == names
    assert light.keys() == DARK.keys()
    # Chosen by the page or by the system: the same colours.
    chosen, _, preferred = PLAN_CSS.partition("/* Dark")[2].partition("@media")
    pairs = [re.findall(r"--([\w-]+): (#\w{6});", text) for text in (chosen, preferred)]
    assert pairs[0] == pairs[1]


def test_plans_show_the_range_of_starts_and_explain_it_once():
    world = world_of(400.0).with_start(
        "left side, heading +-30", "area 90,15 300,60, clear 2", "195,195,0"
    )
    (panel,) = map_plan(world).panels
    assert list(panel.legend) == [RANGE_LABEL, "start"]
    dashed = [one for one in panel.primitives if isinstance(one, Shape) and one.ink.dash_pt]
    assert dashed[0].chains[0][:, 0].tolist() == [15.0, 15.0]
    assert page_svg(map_plan(world)).count(RANGE_LABEL.encode()) == 1
    (plain,) = map_plan(world_of(400.0).with_start("195,195,0")).panels
    assert list(plain.legend) == ["start"]


def test_a_range_beyond_what_is_shown_does_not_widen_the_picture():
    one = map_plan(world_of(400.0).with_start("195,195,0")).panels[0]
    two = map_plan(world_of(400.0).with_start("left side, heading +-180")).panels[0]
    assert two.box == one.box


def test_every_entry_of_a_legend_has_a_symbol():
    design = Design.read("six_branch_anchor")
    world = world_of(300).with_start("left side, heading +-30")
    inside = design.grow(world, pose=(150, 1, 90), body="inflated")
    assert inside.stops["not_deployed"] == len(inside.tree)
    entries = deployment_plan(world, inside, inside.tree.width_mm).panels[0].legend
    assert {RANGE_LABEL, "start", f"never emerged ({len(inside.tree)})"} <= entries.keys()
    assert all(symbol.ink.fill or symbol.ink.line for symbol in entries.values())
    rings = entries[f"never emerged ({len(inside.tree)})"]
    assert isinstance(rings, Marks)
    assert rings.points.tolist() == [[150.0, 1.0]]


def test_a_body_that_is_a_line_is_drawn_as_one_and_the_picture_says_so():
    world, design = world_of(400), Design.read("three_level_tree")
    wide = GrowthOptions().drawn_widths_mm(design.tree)
    line = GrowthOptions.published().drawn_widths_mm(design.tree)
    assert wide.tolist() == design.tree.width_mm.tolist()
    assert line.tolist() == [0.0] * design.branch_count
    thin = deploy(design, world, POSE, {"body": "centerline"})
    assert thin.picture(".svg") == page_svg(deployment_plan(world, thin.deployment, line))
    plans = [deployment_plan(world, thin.deployment, w) for w in (line, wide)]
    filled = [
        sum(isinstance(one, Shape) and one.closed for one in plan.panels[0].primitives)
        for plan in plans
    ]
    assert filled[1] - filled[0] == len({*thin.deployment.tree.level.tolist()})
    words = [plan.panels[0].legend for plan in plans]
    assert ["body: a line without width" in some for some in words] == [True, False]
    moving = [deploy(design, world, POSE, {"body": body}).animation(".svg", 2) for body in
              ("centerline", "inflated")]  # fmt: skip
    assert [b"bodies are lines" in picture for picture in moving] == [True, False]
    notebook = [design.grow(world, pose=POSE, body=body)._repr_svg_() for body in
                ("centerline", "inflated")]  # fmt: skip
    assert ["body: a line without width" in text for text in notebook] == [True, False]


def test_ids_of_branches_lie_on_none_other():
    design = Design.read("grid_explorer_levels")
    grown = design.grow(world_of(700), pose=(350, 350, 90), body="centerline")
    (panel,) = deployment_plan(world_of(700), grown, np.zeros(len(grown.tree)), named=True).panels
    texts = written(panel)
    middles = np.array([panel.placed([w.at])[0] + (w.shift_pt[0], -w.shift_pt[1]) for w in texts])
    half = np.array([(text_width(w.text, w.size_pt) / 2.0, w.size_pt / 2.0) for w in texts])
    boxes = shapely.box(*(middles - half).T, *(middles + half).T)
    assert len(boxes) > 20
    one, other = shapely.STRtree(boxes).query(boxes, "intersects")
    met = shapely.area(shapely.intersection(boxes[one], boxes[other]))[one < other]
    assert met.max(initial=0.0) < 0.3 * shapely.area(boxes).min()
