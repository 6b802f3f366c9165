import numpy as np
import pytest

from vinefab.growth.options import GrowthOptions
from vinefab.maps.generators.grid import GridOptions, grid_map
from vinefab.prediction.family_deployments import (
    FIRST_UNSEEN,
    MapFamily,
    PredictionPlan,
    PreparedFamily,
    deploy_family,
    map_families,
    typical,
    unseen_maps,
)
from vinefab.prediction.measures import SEEN


def test_unseen_maps_are_their_own_and_repeat(result):
    again = unseen_maps("grid", 5, 0, SMALL).worlds
    other = unseen_maps("grid", 5, 1, SMALL).worlds
    seeds = [world.seed for world in again]
    assert seeds == list(range(FIRST_UNSEEN, FIRST_UNSEEN + 5))
    assert not {world.seed for world in other} & set(seeds)
    assert again[2].obstacles == result.prepared.maps[2].world.obstacles
    assert len(again[0].obstacles) == 16


SMALL = {"columns": 4, "rows": 4, "size_mm": 350.0}


def test_fields_need_a_map(straight):
    _, family = straight
    assert [found.label for found in map_families(family.worlds, family)] == [
        "the map given",
        "room",
    ]
    with pytest.raises(ValueError, match="--environment"):
        map_families([], None)


def test_maps_of_one_name_are_told_apart(straight):
    _, family = straight
    prepared = PreparedFamily.of(
        MapFamily(label="two", worlds=family.worlds * 2), PredictionPlan(poses=1)
    )
    assert prepared.names == ("room (1)", "room (2)")


def test_outcomes_name_every_deployment(result):
    assert len(result.outcomes) == len(result.deployments) == 10
    assert result.outcomes.map_count == 5
    assert result.prepared_map(7).world.name == result.outcomes.maps[7]
    assert result.deployments[7].pose == result.outcomes.poses[7]
    least, most = typical(result.outcomes, (0.0, 1.0), SEEN.key)
    values = result.outcomes.values[SEEN.key]
    assert (values[least], values[most]) == (values.min(), values.max())


def test_a_line_and_a_body_predict_different_things(explorer, result):
    line = PredictionPlan(poses=2, seed=3, options=GrowthOptions(body="centerline"))
    other = deploy_family(explorer, PreparedFamily.of(unseen_maps("grid", 5, 0, SMALL), line), line)
    assert other.outcomes.poses == result.outcomes.poses
    assert not np.array_equal(other.outcomes.values[SEEN.key], result.outcomes.values[SEEN.key])


def test_grid_options_reach_the_generator():
    assert unseen_maps("grid", 1, 4).worlds[0].seed == FIRST_UNSEEN + 40_000
    plain = grid_map(FIRST_UNSEEN, GridOptions(columns=4, rows=4, size_mm=350.0))
    assert plain.obstacles == unseen_maps("grid", 1, 0, SMALL).worlds[0].obstacles
    with pytest.raises(ValueError, match=r"grid\.colums"):
        unseen_maps("grid", 1, 0, {"colums": 4})
