"""The flow of air of all tips: closed forms, and the growing volume cut into small steps."""

import json
import math

import numpy as np
import pytest

from vinefab.cli.main import main
from vinefab.core.errors import BadInputError
from vinefab.model.design import Build, Design, Level
from vinefab.physics.supply import SupplyFlow


def test_one_tube_takes_its_cross_section_times_its_speed():
    vine = Design(name="vine", trunk_length_mm=600.0, build=Build(widths_mm=(20.0,), fillet_mm=()))
    flow = SupplyFlow.of(vine.tree, 30.0, 10.0)
    radius_mm = 20.0 / math.pi
    assert flow.peak_l_min == pytest.approx(10.0 * math.pi * radius_mm**2 * 60.0 / 1e6)
    assert flow.free_l_min / flow.peak_l_min == pytest.approx(131.325 / 101.325)
    assert (flow.tips, flow.time_s) == (1, 60.0)
    assert flow.volume_l == pytest.approx(600.0 * math.pi * radius_mm**2 / 1e6)


def test_narrow_children_together_may_take_more_than_their_trunk():
    fork = Level(branches=3, length_mm=50.0, angle_deg=60.0)
    build = Build(widths_mm=(20.0, 16.0), fillet_mm=(3.0,))
    robot = Design(name="fork", trunk_length_mm=100.0, levels=(fork,), build=build)
    flow = SupplyFlow.of(robot.tree, 20.0, 1.0)
    assert flow.tips == 3
    assert flow.peak_l_min == pytest.approx(3.0 * 16.0**2 / math.pi * 60.0 / 1e6)


def volume_mm3(tree, begin, front_mm, steps=200):
    """What has been opened when the front is somewhere, by the midpoint rule."""
    found = 0.0
    for row in range(len(tree)):
        grown = min(max(front_mm - begin[row], 0.0), tree.length_mm[row])
        at = (np.arange(steps) + 0.5) / steps * grown / tree.length_mm[row]
        width = tree.width_mm[row] + at * (tree.end_width_mm[row] - tree.width_mm[row])
        found += np.mean(width**2 / math.pi) * grown
    return found


@pytest.mark.parametrize("name", ["three_level_tree", "grid_explorer", "cave_explorer_pieces"])
def test_the_peak_is_the_steepest_rise_of_the_volume(name):
    tree = Design.read(name).tree
    begin = [0.0]
    for row in range(1, len(tree)):
        begin.append(begin[tree.parent[row]] + tree.length_mm[tree.parent[row]])
    flow = SupplyFlow.of(tree, 20.0, 4.0)
    fronts = np.linspace(0.0, 4.0 * flow.time_s, 400)
    volumes = np.array([volume_mm3(tree, begin, front) for front in fronts])
    assert volumes[-1] / 1e6 == pytest.approx(flow.volume_l, rel=1e-4)
    steepest = np.diff(volumes).max() / (fronts[1] - fronts[0]) * 4.0 * 60.0 / 1e6
    assert 0.9 * flow.peak_l_min <= steepest <= flow.peak_l_min * (1.0 + 1e-6)


def test_a_tapered_tube_takes_most_where_it_is_widest():
    build = Build(widths_mm=(20.0,), fillet_mm=(), taper=(0.5,))
    vine = Design(name="vine", trunk_length_mm=100.0, build=build)
    flow = SupplyFlow.of(vine.tree, 20.0, 1.0)
    assert flow.peak_l_min == pytest.approx(400.0 / math.pi * 60.0 / 1e6)
    assert flow.volume_l == pytest.approx(100.0 * (400 + 200 + 100) / 3.0 / math.pi / 1e6)


@pytest.mark.parametrize("speed", [0.0, -1.0, math.inf, math.nan])
def test_a_speed_is_a_positive_number(speed):
    with pytest.raises(BadInputError, match="tip_speed_mm_s"):
        SupplyFlow.of(Design.read("plain_vine").tree, 20.0, speed)


def test_a_report_names_the_flow_of_the_speed_that_is_asked_for(tmp_path, capsys):
    call = ["report", "plain_vine", "--environment", "pegs", "--count", "1", "--poses", "1"]
    call += ["--out", str(tmp_path / "page.html"), "--json", "-", "--force"]
    assert main([*call, "--tip-speed-mm-s", "25"]) == 0
    words = capsys.readouterr().out
    found = json.loads(words[words.index("{") : words.rindex("}") + 1])["supply"]
    vine = Design.read("plain_vine")
    flow = SupplyFlow.of(vine.tree, vine.build.pressure_kpa, 25.0)
    assert found["peak_l_min"] == pytest.approx(flow.peak_l_min)
    assert f"{flow.peak_l_min:.2g} litres per minute" in (tmp_path / "page.html").read_text()
    assert main([*call, "--tip-speed-mm-s", "0"]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
