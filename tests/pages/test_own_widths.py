"""Branches that have a width of their own are drawn as wide as they are."""

import io
import math
import re

import numpy as np
import pytest
import shapely
from PIL import Image

from vinefab.model.design import Branch, Build, Design
from vinefab.model.map import Map, Pose
from vinefab.pages.animation import Scene
from vinefab.pages.panel import Shape
from vinefab.pages.plan import body_cells, deployment_plan
from vinefab.pages.plan_svg import robot_svg
from vinefab.prediction.deploy import deploy

WIDTHS_MM = {"wide": 30.0, "usual": 18.0, "narrow": 9.0}


@pytest.fixture(scope="module")
def grown():
    branches = [
        Branch(name=name, angle_deg=angle, length_mm=80.0, width_mm=None if name == "usual" else w)
        for angle, (name, w) in zip((-70.0, 0.0, 70.0), WIDTHS_MM.items(), strict=True)
    ]
    build = Build(widths_mm=(40.0, 18.0))
    design = Design.of_branches(branches, trunk_length_mm=60.0, build=build, name="uneven")
    world = Map(name="w", bounds=shapely.box(0, 0, 300, 240))
    return deploy(design, world, Pose(x_mm=150.0, y_mm=30.0, heading_rad=math.pi / 2))


def across(widths_mm):
    return [2.0 * width / math.pi for width in widths_mm]


def stroke_widths(text):
    return [float(found) for found in re.findall(r'stroke-width[:="]+([\d.]+)', text)]


def test_the_studio_draws_each_body_as_wide_as_it_is(grown):
    for detail in (True, False):
        text = robot_svg(grown.deployment, grown.deployment.tree.width_mm, detail=detail)
        found = stroke_widths(text)  # the level's is its widest; others say their own
        assert found == pytest.approx(across([30.0, 18.0, 9.0, 40.0]), abs=6e-4)


def cross_section(deployment, branch):
    """Points 0.05 mm apart across a branch, where no other body lies, shape (800, 2)."""
    start, end = deployment.chain_mm(branch)[[0, -1]]
    along = (end - start) / math.dist(start, end)
    aside = np.arange(-20.0, 20.0, 0.05)[:, None] * np.array([-along[1], along[0]])
    return start + 0.7 * (end - start) + aside


def test_plans_cells_and_animations_show_each_width(grown):
    deployment, widths_mm = grown.deployment, grown.deployment.tree.width_mm
    cells = body_cells(deployment, widths_mm, (0.0, 0.0), 0.5, (480, 600))
    panel = deployment_plan(grown.world, deployment, widths_mm).panels[0]
    bodies = shapely.union_all(
        [
            shapely.Polygon(one.chains[0])
            for one in panel.primitives
            if isinstance(one, Shape) and one.closed and one.ink.fill_alpha == 0.3
        ]
    )
    scene = Scene.of(grown.world, grown.history.even_steps(2), widths_mm)
    film = Image.open(io.BytesIO(grown.animation(".gif", 2)))
    film.seek(film.n_frames - 1)
    shades = np.asarray(film.convert("L"))
    for branch, width_mm in enumerate(WIDTHS_MM.values(), start=1):
        points, wanted = cross_section(deployment, branch), 2.0 * width_mm / math.pi
        rows, columns = (points[:, ::-1] / 0.5).astype(int).T
        assert 0.05 * cells[rows, columns].sum() == pytest.approx(wanted, abs=1.5)
        line = shapely.LineString(points)
        assert line.intersection(bodies).length == pytest.approx(wanted, rel=0.01)
        columns, rows = (scene.stage.place(points) + np.array([scene.margin_px, 0.0])).astype(int).T
        dark = (shades[rows, columns] < 245).sum() * 0.05
        assert dark == pytest.approx(wanted, abs=2.5 / scene.stage.px_per_mm)
    found = stroke_widths(grown.animation(".svg", 2).decode())
    for width_mm in widths_mm.tolist():
        wanted = 2.0 * width_mm / math.pi * scene.stage.px_per_mm
        assert min(abs(one - wanted) for one in found) < 0.01


def test_a_wide_branch_without_room_says_its_own_radius(grown):
    walls = [shapely.box(0, 0, 142, 100), shapely.box(158, 0, 300, 100)]
    world = Map(name="w", bounds=shapely.box(0, 0, 300, 240), obstacles=tuple(walls))
    build = grown.design.build.changed(widths_mm=(20.0, 10.0))
    design = grown.design.changed(build=build).with_branch("usual", width_mm=19.0)
    placed = deploy(design, world, grown.deployment.pose).without_room
    radii = {place.branch: place.radius_mm for place in placed}
    assert radii["0.0"] == pytest.approx(30.0 / math.pi)
