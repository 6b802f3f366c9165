import xml.etree.ElementTree as ET
from html.parser import HTMLParser

import numpy as np
import pytest
import shapely

from vinefab.core.view import Answer, Block, Fact, Facts, Number, Picture, Rows, Section
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Build, Design, Level
from vinefab.model.map import Map, Pose, Start
from vinefab.pages.html import page
from vinefab.pages.page_files import page_png, page_svg
from vinefab.pages.panel import Shape
from vinefab.pages.plan import deployment_plan, map_plan
from vinefab.search.run_pages import fitness_curve
from vinefab.studies.optimizer_contest import panels_of_strips


@pytest.fixture
def world():
    pose = Pose(x_mm=50.0, y_mm=0.0, heading_rad=1.5)
    hole = shapely.box(20, 20, 40, 40) - shapely.box(25, 25, 30, 30)
    return Map(
        name="w", bounds=shapely.box(0, 0, 100, 80), obstacles=(hole,), starts=(Start(pose=pose),)
    )


@pytest.fixture
def deployment():
    fork = Level(branches=2, length_mm=20.0, fan_rad=1.0)
    design = Design(name="y", trunk_length_mm=30.0, levels=(fork,), build=Build.standard(2))
    return Deployment(
        tree=design.tree,
        pose=Pose(x_mm=50.0, y_mm=0.0, heading_rad=1.5),
        points_mm=np.array([[50.0, 0], [60, 10], [50, 30], [50, 30], [40, 45.0]]),
        first_point=np.array([0, 3, 5, 5]),
        stop=np.array([Stop.FULL_LENGTH, Stop.HEAD_ON, Stop.NOT_DEPLOYED]),
        grown_mm=np.array([36.5, 18.0, 0.0]),
        contact_turn_rad=np.zeros(3),
    )


class Links(HTMLParser):
    """Collects every address that a page would load and every tag left open."""

    def __init__(self):
        super().__init__()
        self.addresses = []
        self.open = []

    def handle_starttag(self, tag, attrs):
        self.addresses += [value for key, value in attrs if key in ("src", "href")]
        if tag not in ("meta", "img", "link", "br"):
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


def blocks(picture: Picture) -> tuple[Block, ...]:
    table = Rows(caption="<b>bold</b>", headings=("a", "b"), rows=(("1", Number(2.0)),))
    section = Section(title="T", paragraphs=("x < y",), tables=(table,), pictures=(picture,))
    return Answer("V", "bad"), Facts((Fact("f", "1 mm"),)), section


def test_page_is_whole_escapes_text_and_loads_nothing(world):
    shown = page("R", blocks(Picture(image=page_svg(map_plan(world)), caption='say "hi"')))
    links = Links()
    links.feed(shown)
    assert links.open == []
    assert len(links.addresses) == 1
    assert links.addresses[0].startswith("data:image/svg+xml;base64,")
    assert "<b>bold</b>" not in shown
    assert "x &lt; y" in shown
    assert "written by vinefab" in shown[:8192]


def test_pictures_are_the_same_bytes_every_time(world, deployment):
    def draw() -> bytes:
        return page_svg(deployment_plan(world, deployment, deployment.tree.width_mm))

    assert draw() == draw()


def test_plan_draws_obstacles_with_holes_branches_and_reasons(world, deployment):
    panel = deployment_plan(world, deployment, deployment.tree.width_mm).panels[0]
    assert panel.legend.keys() == {
        "level 1 (1 of 1)", "level 2 (1 of 2)", "contact (1)", "start",
        "grown in full (1)", "stopped head-on (1)", "never emerged (1)",
    }  # fmt: skip
    shapes = [one for one in panel.primitives if isinstance(one, Shape) and one.closed]
    assert any(len(shape.chains) == 2 for shape in shapes)


def test_figures_are_xml_and_png(world):
    root = ET.fromstring(page_svg(map_plan(world)))  # noqa: S314  our own text
    assert root.tag.endswith("svg")
    assert page_png(map_plan(world), dpi=40).startswith(b"\x89PNG")
    assert b"written by vinefab" in page_png(map_plan(world), dpi=40)[:8192]


def test_charts_show_every_generation_and_group():
    (curve,) = fitness_curve([0.1, 0.2], [0.0, 0.1], [0.1, 0.1]).panels
    assert [len(line.chains[0]) for line in curve.legend.values()] == [2, 2]
    (strips,) = panels_of_strips({"p": {"a": [1.0, 2.0], "b": [3.0]}}, "score").panels
    assert [words for _, words in strips.ticks(1)] == ["a", "b"]
