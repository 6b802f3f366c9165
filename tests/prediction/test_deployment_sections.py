import math

import numpy as np
import pytest
import shapely

from vinefab.growth.options import GrowthOptions
from vinefab.model.deployment import Deployment, Stop
from vinefab.model.design import Build, Design, Level
from vinefab.model.map import Map, Pose
from vinefab.model.tree import branch_tree
from vinefab.pages.map_view import STOP_WORDS
from vinefab.prediction.family_deployments import deployment_section, spread_blocks, spread_chart
from vinefab.prediction.measures import MEASURES, SEEN, MeasureTable

POSE = Pose(x_mm=12.345, y_mm=0.0, heading_rad=math.radians(30.0))


def known_table():
    columns = {m.key: np.full(4, np.nan) for m in MEASURES}
    columns[SEEN.key] = np.array([10.0, 20.0, 30.0, 60.0])
    maps = ("a", "a", "a", "b")
    return MeasureTable(label="two maps", maps=maps, poses=(POSE,) * 4, values=columns)


def test_the_spread_of_known_values_stands_in_the_table():
    _, section = spread_blocks([known_table()])
    numbers, every = section.tables
    # Maps of mean 20 and 60; deviation and percentiles of 10, 20, 30, 60.
    (row,) = numbers.rows
    assert [*map(str, row)] == [
        "free space seen by sensors (%)",
        "40.0 [0.0, 100.0; 2 maps]", "18.7", "11.5", "25.0", "55.5", "10.0", "60.0", "4",
    ]  # fmt: skip
    assert section.paragraphs[0].startswith("Two maps: 4 deployments (simulated).")
    assert [*map(str, every.rows[3])][:6] == ["b", "12.35", "0.00", "30.00", "-", "60.0"]


def test_the_chart_draws_mean_and_percentiles():
    (panel,) = spread_chart(SEEN, {"l": np.array([0.0, 10.0, 20.0, 30.0, 60.0])}).panels
    bar, mean, dots, name = panel.primitives
    assert dots.points[:, 0].tolist() == [0.0, 10.0, 20.0, 30.0, 60.0]
    assert bar.chains[0][:, 0].tolist() == pytest.approx([2.0, 54.0])
    assert mean.chains[0][:, 0].tolist() == [24.0, 24.0]
    assert name.text == "l"


def test_endings_are_counted_level_by_level():
    fan = Level(branches=4, length_mm=40.0, fan_rad=1.0)
    design = Design(name="d", trunk_length_mm=80.0, levels=(fan,), build=Build.standard(2))
    chain = [[0.0, 0.0], [80.0, 0.0]]
    deployment = Deployment(
        tree=branch_tree(design),
        pose=Pose(x_mm=0.0, y_mm=0.0, heading_rad=0.0),
        points_mm=np.array(chain + [[80.0, 0.0], [90.0, 0.0]] * 3),
        first_point=np.array([0, 2, 4, 6, 8, 8]),
        stop=np.array(
            [Stop.FULL_LENGTH, Stop.HEAD_ON, Stop.CORNER, Stop.HEAD_ON, Stop.NOT_DEPLOYED]
        ),
        grown_mm=np.array([80.0, 10.0, 20.0, 36.0, 0.0]),
        contact_turn_rad=np.zeros(5),
    )
    world = Map(name="room", bounds=shapely.box(0, -50, 100, 50))
    section = deployment_section(
        design,
        [("one", world, deployment)],
        [("maps", [deployment, deployment])],
        GrowthOptions(),
    )
    assert "as wide as they inflate" in section.paragraphs[0]
    (table,) = section.tables
    assert table.rows == (
        ("1", "100.0 %", *["0.0 %"] * 4, "-"),
        ("2", "0.0 %", "50.0 %", "25.0 %", "25.0 %", "0.0 %", "50 %"),
    )
    assert "how 10 branches of 2 deployments ended" in table.caption
    assert set(STOP_WORDS) == set(Stop)
