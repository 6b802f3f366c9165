"""What the nouns show at a prompt: short, whatever their size."""

import math

import numpy as np
import pytest
from shapely import box

from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import MOST_LEVELS, Build, Design, Level
from vinefab.model.finding import CheckReport, Finding, RuleRun, RuleSkipped, Severity
from vinefab.model.job import Job, LaserPath, Operation
from vinefab.model.map import Map, Pose, Start
from vinefab.model.outline import Contour
from vinefab.model.score import Evaluation, Score

LONGEST = 150
POSE = Pose(x_mm=250.0, y_mm=15.0, heading_rad=math.pi / 2)


def design(name: str = "fork", depth: int = 2) -> Design:
    level = Level(branches=2, length_mm=50.0, fan_rad=1.0)
    return Design(
        name=name,
        trunk_length_mm=100.0,
        levels=(level,) * (depth - 1),
        build=Build.standard(depth),
        origin={"scores": list(range(1000))},
    )


def world(name: str = "room", obstacles: int = 2) -> Map:
    blocks = tuple(box(3 * k, 10, 3 * k + 1, 20) for k in range(obstacles))
    return Map(
        name=name, bounds=box(0, 0, 500, 400.5), obstacles=blocks, starts=(Start(pose=POSE),)
    )


def deployment(robot: Design) -> Deployment:
    """The trunk grew in full, its first child 20 mm; all others stayed inside."""
    tree = robot.tree
    stop = np.full(len(tree), int(Stop.NOT_DEPLOYED))
    stop[:2] = Stop.FULL_LENGTH, Stop.HEAD_ON
    grown_mm = np.zeros(len(tree))
    grown_mm[:2] = 100.0, 20.0
    first_point = np.full(len(tree) + 1, 4)
    first_point[:3] = 0, 2, 4
    return Deployment(
        tree=tree,
        pose=POSE,
        points_mm=np.zeros((4, 2)),
        first_point=first_point,
        stop=stop,
        grown_mm=grown_mm,
        contact_turn_rad=np.zeros(len(tree)),
    )


def contour(points: int = 4) -> Contour:
    angles = np.arange(points) * math.tau / points
    return Contour.polyline(100.0 * np.column_stack([np.cos(angles), np.sin(angles)]), closed=True)


def score(evaluations: int = 2) -> Score:
    one = Evaluation(map_name="grid_1", pose=POSE, score=0.4, terms={"area": 0.5})
    composite = {"mean": 0.4, "best": 0.4, "min_deviation": 0.85}
    return Score(task="coverage", evaluations=(one,) * evaluations, composite=composite)


def job(name: str = "fork", paths: int = 2) -> Job:
    path = LaserPath(operation=Operation.WELDCUT, contour=contour(), label="outline of fork")
    mark = LaserPath(operation=Operation.MARK, contour=contour())
    return Job(
        name=name, sheet_width_mm=600.0, sheet_height_mm=400.0, paths=(mark,) + (path,) * paths
    )


def report(name: str = "fork", findings: int = 2) -> CheckReport:
    found = Finding(rule="VF-C01", severity=Severity.ERROR, message="too narrow")
    return CheckReport(
        design=name,
        recipe="co2_60w__stretchlon_200",
        run=(RuleRun(rule="VF-C01", checked=7, findings=findings),),
        skipped=(RuleSkipped(rule="VF-J01", reason="no job"),),
        findings=(found,) * findings,
    )


@pytest.mark.parametrize(
    ("noun", "shown"),
    [
        (design(), "<Design 'fork': 2 levels of 100 + 50 mm, 3 branches, trunk 40 mm wide>"),
        (world(), "<Map 'room': 500 x 400.5 mm, 2 obstacles, 12 walls, 1 start>"),
        (design().tree, "<BranchTree: 3 branches on 2 levels, 200 mm>"),
        (
            deployment(design()),
            "<Deployment: 120 of 200 mm grown, 3 branches: "
            "1 full_length, 1 head_on, 1 not_deployed>",
        ),
        (contour(), "<Contour: closed, 4 segments (0 arcs), 565.69 mm long, 200 x 200 mm>"),
        (
            job(),
            "<Job 'fork': 600 x 400 mm sheet, paths: 1 mark, 2 weldcut>",
        ),
    ],
    ids=lambda value: type(value).__name__,
)
def test_nouns_say_what_they_are(noun, shown):
    assert repr(noun) == shown


@pytest.mark.parametrize(
    "noun",
    [
        design("n" * 100, MOST_LEVELS),
        world("n" * 1000, 150),
        design(depth=MOST_LEVELS).tree,
        deployment(design(depth=MOST_LEVELS)),
        contour(5000),
        job("n" * 1000, 500),
        job().paths[1],
    ],
    ids=lambda value: type(value).__name__,
)
def test_large_nouns_stay_short(noun):
    assert len(repr(noun)) <= LONGEST
    assert "\n" not in repr(noun)


@pytest.mark.parametrize(
    ("small", "large"),
    [(score(), score(5000)), (report(), report("n" * 100, 500))],
    ids=lambda value: type(value).__name__,
)
def test_results_show_their_summary(small, large):
    name = type(small).__name__
    assert repr(small).splitlines() == [f"<{name}>", *small.summary]
    assert len(repr(large).splitlines()) < 100
