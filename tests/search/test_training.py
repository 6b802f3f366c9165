import pytest

from vinefab.core.errors import BadInputError, UnknownNameError
from vinefab.search.run import generated_maps
from vinefab.search.settings import MapSettings


def test_maps_have_seeds_in_a_row_and_the_options_asked_for() -> None:
    maps = generated_maps(MapSettings(count=3, seed=7, options={"size_mm": 300, "columns": 3}))
    assert [world.seed for world in maps] == [7, 8, 9]
    assert maps[0].size_mm == (300.0, 600.0)
    assert maps[0].obstacles != maps[1].obstacles


def test_unknown_environments_and_options_are_refused() -> None:
    with pytest.raises(UnknownNameError, match="environment"):
        generated_maps(MapSettings(environment="forest"))
    with pytest.raises(BadInputError, match=r"maps\.options\.colums"):
        generated_maps(MapSettings(options={"colums": 3}))
