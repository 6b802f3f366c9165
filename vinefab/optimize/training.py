"""The maps that a run trains on, when they are generated."""

from typing import Any

from vinefab.environments.registry import ENVIRONMENTS
from vinefab.model.map import Map
from vinefab.optimize.settings import MapSettings
from vinefab.tasks.parameters import with_parameters


def environment_options(maps: MapSettings) -> Any:  # noqa: ANN401 - every environment has its own
    """Return the options of a run's environment.

    Raises
    ------
    UnknownNameError
        If there is no such environment.
    BadInputError
        If an option is unknown or cannot be used.
    """
    return with_parameters(ENVIRONMENTS[maps.environment].options, "maps.options", maps.options)


def generated_maps(maps: MapSettings) -> tuple[Map, ...]:
    """Return the maps that an environment gives for a run's seeds.

    Maps from files are read by whoever may read files.
    """
    options = environment_options(maps)
    make = ENVIRONMENTS[maps.environment].make
    return tuple(make(maps.seed + index, options) for index in range(maps.count))
