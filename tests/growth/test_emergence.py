"""Children that fail to come out: how often, the same for all designs, and what stays in."""

import math

import numpy as np
import shapely
from scipy.stats import binomtest

from vinefab.growth.batch import Batch, Launches, TerrainSet
from vinefab.growth.options import GrowthChoice, GrowthOptions
from vinefab.growth.plan import Plans
from vinefab.growth.terrain import Terrain
from vinefab.model.deployment import Stop
from vinefab.model.design import Build, Design, Level
from vinefab.model.map import Map, Pose

EMPTY = Terrain.of(Map(name="empty", bounds=shapely.box(-1000, -1000, 1000, 1000), obstacles=()))
POSE = Pose(x_mm=0.0, y_mm=-500.0, heading_rad=math.pi / 2.0)
TREE = Design(
    name="tree",
    trunk_length_mm=80.0,
    levels=(Level.of(3, 90.0, 120.0, 100.0), Level.of(2, 70.0, 60.0, 100.0)),
    build=Build(widths_mm=(20, 14, 10)),
)


def deployments(emergence, count=400, designs=(TREE,), seeds=(), **options):
    growth = GrowthOptions(emergence=emergence, pressure_stop=False, **options)
    launches = Launches.of(TerrainSet([EMPTY]), [[POSE] * count], (), seeds)
    return Batch(Plans.of(designs, growth), launches, growth).deployments()


def test_as_many_children_stay_in_as_asked_and_their_own_children_too():
    failed = tried = 0
    for grown in deployments(0.9):
        assert grown.stop[0] == Stop.FULL_LENGTH
        for branch, parent in enumerate(grown.tree.parent.tolist()[1:], start=1):
            if grown.stop[parent] != Stop.FULL_LENGTH:
                assert grown.stop[branch] == Stop.NOT_DEPLOYED
                continue
            tried += 1
            if grown.stop[branch] == Stop.NOT_EVERTED:
                failed += 1
                chain = grown.chain_mm(branch)
                assert grown.grown_mm[branch] == 0.0
                assert (chain == grown.chain_mm(parent)[-1]).all()
            else:
                assert grown.stop[branch] == Stop.FULL_LENGTH
    assert binomtest(failed, tried, 0.1).pvalue > 0.001
    assert failed > 100


def test_all_designs_of_a_launch_draw_alike_and_launches_differ():
    other = TREE.changed(trunk_length_mm=120.0)
    grown = deployments(0.7, count=30, designs=(TREE, other))
    for one, two in zip(grown[::2], grown[1::2], strict=True):
        assert one.stop.tolist() == two.stop.tolist()
    assert len({tuple(one.stop.tolist()) for one in grown}) > 10


def test_seeds_decide_what_is_drawn():
    here = [g.stop.tolist() for g in deployments(0.7, count=20, seeds=range(50, 70))]
    again = [g.stop.tolist() for g in deployments(0.7, count=20, seeds=range(50, 70))]
    other = [g.stop.tolist() for g in deployments(0.7, count=20, seeds=range(20))]
    assert here == again != other


def test_certain_emergence_gives_the_same_bytes_and_none_a_bare_trunk():
    (plain,), (certain,) = deployments(1.0, 1), deployments(1.0 - 1e-15, 1)
    assert (plain.points_mm == certain.points_mm).all()
    (none,) = deployments(1e-9, 1)
    assert none.stop.tolist() == [
        Stop.FULL_LENGTH,
        *[Stop.NOT_EVERTED] * 3,
        *[Stop.NOT_DEPLOYED] * 6,
    ]


def test_what_stays_in_stops_nothing():
    fork = TREE.changed(levels=(Level.of(2, 100.0, 90.0, 100.0), Level.of(2, 150.0, 270.0, 100.0)))
    counts = [
        grown.stops.get("branch", 0)
        for grown in deployments(0.5, 60, (fork,), branch_contact="stop")
    ]
    assert 0 in counts
    assert max(counts) == 2


def test_a_single_growth_shows_all_children_and_says_so():
    choice = GrowthChoice.of([TREE], {"emergence": 0.9})
    assert choice.options.content["emergence"] == 0.9
    assert choice.single.options.emergence == 1.0
    assert any("every child comes out" in note for note in choice.single.notes)
    assert np.isclose(GrowthOptions.of(choice.options.content).emergence, 0.9)
