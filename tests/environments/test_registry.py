import pytest
import shapely

from vinefab.core.errors import UnknownNameError
from vinefab.environments.poses import draw_poses
from vinefab.environments.registry import ENVIRONMENTS


@pytest.mark.parametrize("name", sorted(ENVIRONMENTS))
@pytest.mark.parametrize("seed", range(4))
def test_every_environment_keeps_the_common_promises(name: str, seed: int) -> None:
    environment = ENVIRONMENTS[name]
    world = environment.make(seed, environment.options())
    again = environment.make(seed, environment.options())
    assert world.environment == name
    assert world.seed == seed
    assert [p.wkb for p in world.obstacles] == [p.wkb for p in again.obstacles]
    assert world.bounds.wkb == again.bounds.wkb
    areas = shapely.area(list(world.obstacles))
    assert shapely.union_all(world.obstacles).area == pytest.approx(areas.sum())
    assert world.free_space.geom_type == "Polygon"
    assert len(draw_poses(world, 20, seed)) == 20


def test_an_unknown_environment_gets_the_nearest_spelling() -> None:
    with pytest.raises(UnknownNameError, match="grid"):
        ENVIRONMENTS["gird"]
