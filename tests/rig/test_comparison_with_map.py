from dataclasses import replace

import numpy as np
import pytest
import shapely

from vinefab.core.errors import BadInputError
from vinefab.rig.build import build_rig, compare_with_map
from vinefab.rig.part import RigOptions


@pytest.fixture(scope="module", params=[0.0, None])
def crooked(request, crooked_map, make_printer):
    """A rig on plates, solid and hollow."""
    wall_mm = request.param
    world = crooked_map(3, 6, 4)
    return world, build_rig(world, make_printer(130.0, 130.0), RigOptions(wall_mm=wall_mm))


def test_a_good_rig_differs_by_less_than_a_thousandth(crooked):
    world, rig = crooked
    comparison = compare_with_map(rig, world)
    assert comparison.share < 1e-4
    assert comparison.wall_mm2 == pytest.approx(shapely.area(list(world.obstacles)).sum())
    assert comparison.floor_missing_mm2 == pytest.approx(rig.joint_gap_mm3 / 3.0, rel=1e-3)


def test_a_part_in_the_wrong_place_is_seen(crooked):
    world, rig = crooked
    moved = np.array(rig.parts[1].to_map)
    moved[0, 3] += 2.0
    parts = (rig.parts[0], replace(rig.parts[1], to_map=moved), *rig.parts[2:])
    comparison = compare_with_map(replace(rig, parts=parts), world)
    assert comparison.share > 1e-3
    assert comparison.floor_missing_mm2 > 100.0


def test_a_missing_part_is_seen(crooked):
    world, rig = crooked
    comparison = compare_with_map(replace(rig, parts=rig.parts[1:]), world)
    assert comparison.missing_mm2 > 100.0
    assert comparison.excess_mm2 < 1.0


def test_another_map_is_seen(crooked, crooked_map):
    assert compare_with_map(crooked[1], crooked_map(4, 6, 4)).share > 0.05


def test_an_open_part_is_refused(crooked):
    world, rig = crooked
    broken = replace(rig.parts[0], faces=rig.parts[0].faces[:-1])
    with pytest.raises(BadInputError, match=rig.parts[0].name):
        compare_with_map(replace(rig, parts=(broken,)), world)
