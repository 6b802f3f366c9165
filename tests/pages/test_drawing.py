import itertools
import re

import numpy as np
import pytest
import shapely
from matplotlib.lines import Line2D

from vinefab.growth.options import GrowthOptions
from vinefab.growth.simulator import grow
from vinefab.growth.terrain import Terrain
from vinefab.model.design import Build, Design, Level
from vinefab.model.map import Map, Pose
from vinefab.pages.colours import HEAT_COLOURS, INK, LEVEL_COLOURS, ROCK, ROCK_EDGE, SOFT
from vinefab.pages.drawing import RANGE_LABEL, deployment_plan, legend_entries, map_plan
from vinefab.pages.figure import svg_bytes
from vinefab.pages.map_view import UNSEEN_DETAIL, longer_mm, robot_view, rock_in
from vinefab.pages.plan_document import plan_css
from vinefab.prediction.deploy import deploy

POSE = Pose(x_mm=50.0, y_mm=5.0, heading_rad=1.5)


def world_of(side_mm):
    corners = np.mgrid[20 : side_mm - 20 : 20, 20 : side_mm - 20 : 20].reshape(2, -1)
    boxes = shapely.box(*corners, *(corners + 8))
    return Map(name="w", bounds=shapely.box(0, 0, side_mm, side_mm), obstacles=tuple(boxes))


def deployed(world):
    fork = Level(branches=2, length_mm=30.0, fan_rad=1.0)
    design = Design(name="y", trunk_length_mm=40.0, levels=(fork,), build=Build.standard(2, 4.0))
    return grow(design, Terrain.of(world), POSE, GrowthOptions.published())


def test_a_small_robot_on_a_large_map_is_drawn_with_its_surroundings_only():
    near, far = world_of(100), world_of(1000)
    assert robot_view(near, deployed(near)) == near.bounds.bounds
    deployment = deployed(far)
    x_min, y_min, x_max, y_max = robot_view(far, deployment)
    assert 60.0 < longer_mm((x_min, y_min, x_max, y_max)) < 130.0
    assert ((x_min, y_min) <= deployment.points_mm.min(axis=0)).all()
    assert ((x_max, y_max) >= deployment.points_mm.max(axis=0)).all()
    figure = deployment_plan(far, deployment, (4.0, 2.0))
    assert "1000 x 1000 mm" in figure.axes[0].get_title()
    assert len(svg_bytes(figure)) < 100_000


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
    texts = [text.get_text() for text in deployment_plan(
        world, deployed(world), (4.0, 2.0), named=True
    ).axes[0].texts]  # fmt: skip
    names = [name for text in texts for name in text.split(", ") if text]
    assert sorted(names) == ["0", "0.0", "0.1"]


def test_numbers_in_paths_are_short_but_letters_keep_their_size():
    world = world_of(100)
    picture = svg_bytes(deployment_plan(world, deployed(world), (4.0, 2.0)))
    assert not re.search(rb' d="[^"]*\.\d\d\d', picture)
    assert b"scale(0.015625)" in picture


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


DARK = dict(re.findall(r"--([\w-]+): (#\w{6});", plan_css().partition("/* Dark")[2]))
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
    light = dict(re.findall(r"var\(--([\w-]+), (#\w{6})\)", plan_css()))
    assert [light[f"level-{level}"] for level in range(1, 8)] == list(LEVEL_COLOURS)
    names = {"ink": INK, "soft": SOFT, "rock": ROCK, "rock-edge": ROCK_EDGE, "free": "#ffffff"}
    assert {name: light[name] for name in names} == names
    assert light.keys() == DARK.keys()
    # Chosen by the page or by the system: the same colours.
    chosen, _, preferred = plan_css().partition("/* Dark")[2].partition("@media")
    pairs = [re.findall(r"--([\w-]+): (#\w{6});", text) for text in (chosen, preferred)]
    assert pairs[0] == pairs[1]


def test_plans_show_the_range_of_starts_and_explain_it_once():
    world = world_of(400.0).with_start(
        "left side, heading +-30", "area 90,15 300,60, clear 2", "195,195,0"
    )
    figure = map_plan(world)
    (axes,) = figure.axes
    assert {line.get_label() for line in axes.lines} >= {RANGE_LABEL, "start"}
    lines = [line for line in axes.lines if line.get_label() == RANGE_LABEL]
    assert tuple(lines[0].get_xdata()) == (15.0, 15.0)
    grown = deployment_plan(world, deployed(world), (4.0, 4.0))
    words = [text.get_text() for text in grown.axes[0].get_legend().get_texts()]
    assert words.count(RANGE_LABEL) == 1
    plain = map_plan(world_of(400.0).with_start("195,195,0"))
    assert RANGE_LABEL not in {line.get_label() for line in plain.axes[0].lines}


def test_a_range_beyond_what_is_shown_does_not_widen_the_picture():
    one = map_plan(world_of(400.0).with_start("195,195,0")).axes[0]
    two = map_plan(world_of(400.0).with_start("left side, heading +-180")).axes[0]
    assert two.get_xlim() == one.get_xlim()
    assert two.get_ylim() == one.get_ylim()


def test_every_entry_of_a_legend_has_a_symbol():
    design = Design.read("six_branch_anchor")
    world = world_of(300).with_start("left side, heading +-30")
    inside = design.grow(world, pose=(150, 1, 90), body="inflated")
    assert inside.stops["not_deployed"] == len(inside.tree)
    (axes,) = deployment_plan(world, inside, design.build.widths_mm).axes
    entries = dict(legend_entries(axes))
    assert {RANGE_LABEL, "start", f"never emerged ({len(inside.tree)})"} <= entries.keys()
    for words, symbol in entries.items():
        if isinstance(symbol, Line2D):
            is_seen = symbol.get_marker() not in {" ", "None"} or symbol.get_linestyle() == "-"
            assert is_seen, words
        else:
            assert symbol.get_facecolor()[3] > 0.0, words
    rings = next(line for line in axes.lines if str(line.get_label()).startswith("never"))
    assert rings.get_xydata().tolist() == [[150.0, 1.0]]


def test_a_body_that_is_a_line_is_drawn_as_one_and_the_picture_says_so():
    world, design = world_of(400), Design.read("three_level_tree")
    line = GrowthOptions.published().drawn_widths_mm(design.build.widths_mm)
    assert line == (0.0, 0.0, 0.0)
    assert GrowthOptions().drawn_widths_mm(design.build.widths_mm) == design.build.widths_mm
    thin = deploy(design, world, POSE, {"body": "centerline"})
    assert thin.picture(".svg") == svg_bytes(deployment_plan(world, thin.deployment, line))
    plans = [deployment_plan(world, thin.deployment, w) for w in (line, design.build.widths_mm)]
    filled = [len(plan.axes[0].patches) for plan in plans]
    assert filled[1] - filled[0] == len({*thin.deployment.tree.level.tolist()})
    words = [[text.get_text() for text in p.axes[0].get_legend().get_texts()] for p in plans]
    assert ["body: a line without width" in some for some in words] == [True, False]
    moving = [deploy(design, world, POSE, {"body": body}).animation(".svg", 2) for body in
              ("centerline", "inflated")]  # fmt: skip
    assert [b"bodies are lines" in picture for picture in moving] == [True, False]
    notebook = [design.grow(world, pose=POSE, body=body)._repr_svg_() for body in
                ("centerline", "inflated")]  # fmt: skip
    assert ['class="body"' in text for text in notebook] == [False, True]
    assert ["body: a line without width" in text for text in notebook] == [True, False]


def test_ids_of_branches_lie_on_none_other():
    design = Design.read("grid_explorer")
    grown = design.grow(world_of(700), pose=(350, 350, 90), body="centerline")
    (axes,) = deployment_plan(world_of(700), grown, (0.0,) * 4, named=True).axes
    axes.figure.draw_without_rendering()
    boxes = np.array([shapely.box(*t.get_window_extent().extents) for t in axes.texts])
    boxes = boxes[[bool(text.get_text()) for text in axes.texts]]
    assert len(boxes) > 20
    one, other = shapely.STRtree(boxes).query(boxes, "intersects")
    met = shapely.area(shapely.intersection(boxes[one], boxes[other]))[one < other]
    assert met.max(initial=0.0) < 0.3 * shapely.area(boxes).min()
