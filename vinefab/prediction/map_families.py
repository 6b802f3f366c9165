"""Where predictions are made: maps that were given, and unseen ones of an environment."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from vinefab.core.errors import BadInputError
from vinefab.core.registry import with_parameters
from vinefab.core.validation import whole
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.model.map import Map

FIRST_UNSEEN = 10_000_000
"""Maps for predictions have seeds from here on, out of the way of those that designs train on."""

MOST_MAPS = 10_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MapFamily:
    """Maps that are looked at together."""

    label: str  # what reports call them
    worlds: tuple[Map, ...]  # the maps


def map_families(given: Sequence[Map], unseen: MapFamily | None) -> tuple[MapFamily, ...]:
    """Return the fields to predict for."""
    if not given and unseen is None:
        raise BadInputError("--maps", None, "map files, or --environment for unseen maps")
    label = "the map given" if len(given) == 1 else f"the {len(given)} maps given"
    fields = [MapFamily(label=label, worlds=tuple(given))] if given else []
    return (*fields, *([unseen] if unseen else []))


def unseen_maps(
    environment: str, count: int, seed: int, parameters: Mapping[str, object] | None = None
) -> MapFamily:
    """Generate maps of an environment that no design was trained on."""
    whole("--count", count, 1, MOST_MAPS)
    whole("--seed", seed, 0, 2**31)
    kind = ENVIRONMENTS[environment]
    options = with_parameters(kind.options, environment, parameters or {})
    first = FIRST_UNSEEN + MOST_MAPS * seed
    worlds = tuple(kind.make(first + index, options) for index in range(count))
    return MapFamily(label=f"{count} unseen {environment} maps", worlds=worlds)
