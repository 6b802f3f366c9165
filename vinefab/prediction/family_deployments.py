"""A design deployed on families of maps from many poses, and what each deployment measures."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.registry import with_parameters
from vinefab.core.validation import whole
from vinefab.growth.batch import Batch, Launches, TerrainSet
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plans
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.map import Map
from vinefab.prediction.measures import MEASURES, MeasureTable, measure_deployment
from vinefab.tasks.evaluate import Poses, PreparedMap, poses_on

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


Tell = Callable[[float, str], None]
"""Called with the share of the work that is done and a few words."""


def silent(_share: float, _words: str) -> None:
    """Say nothing of how far the work is."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PredictionPlan:
    """How often, and by which rules, a design is deployed."""

    poses: int = 3  # poses per map, drawn from the ranges of the maps' starts
    seed: int = 0  # seed of the poses; map ``i`` of a field gets ``seed + i``
    # the growth model's choices; the inflated body by default, for a body has a width
    options: GrowthOptions = field(default_factory=lambda: GrowthOptions(body="inflated"))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PreparedFamily:
    """A field made ready: its maps with their poses."""

    label: str  # what reports call it
    sites: tuple[PreparedMap, ...]  # the maps
    poses: Poses  # for each map, the poses

    @classmethod
    def of(cls, ground: MapFamily, trials: PredictionPlan) -> "PreparedFamily":
        """Return the place of a field, with its poses drawn."""
        sites = tuple(PreparedMap.of(world) for world in ground.worlds)
        seeds = [trials.seed + index for index in range(len(sites))]
        return cls(label=ground.label, sites=sites, poses=poses_on(sites, trials.poses, seeds))

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each map; maps of one name are told apart by a number."""
        names = [site.world.name for site in self.sites]
        return tuple(
            f"{name} ({names[: index + 1].count(name)})" if names.count(name) > 1 else name
            for index, name in enumerate(names)
        )

    def launches(self) -> Launches:
        """Return the place as launches of a batch."""
        return Launches.of(TerrainSet([site.terrain for site in self.sites]), self.poses)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FamilyDeployments:
    """A design's deployments in one place."""

    place: PreparedFamily  # where
    deployments: tuple[Deployment, ...]  # map by map, pose by pose
    outcomes: MeasureTable  # what each came to

    def site(self, index: int) -> PreparedMap:
        """Return the map of one deployment."""
        return self.place.sites[index // len(self.place.poses[0])]


def deploy_family(
    design: Design, place: PreparedFamily, trials: PredictionPlan, tell: Tell = silent
) -> FamilyDeployments:
    """Deploy a design from every pose of a place and measure every deployment."""
    tell(0.0, f"{design.name}: growing")
    launches = place.launches()
    batch = Batch(Plans.of([design], trials.options), launches, trials.options)
    deployments = tuple(batch.deployments())
    columns = np.empty((len(deployments), len(MEASURES)))
    terrain = launches.terrain.tolist()
    for index, deployment in enumerate(deployments):
        columns[index] = measure_deployment(deployment, design, place.sites[terrain[index]].ground)
        tell((index + 1) / len(deployments), f"{index + 1} of {len(deployments)} deployments")
    names = place.names
    outcomes = MeasureTable(
        label=place.label,
        maps=tuple(names[index] for index in terrain),
        poses=launches.poses,
        values={m.key: columns[:, i].copy() for i, m in enumerate(MEASURES)},
    )
    return FamilyDeployments(place=place, deployments=deployments, outcomes=outcomes)


def typical(outcomes: MeasureTable, key: str, shares: Sequence[float]) -> list[int]:
    """Return the deployments that stand at some shares of a measure's order."""
    order = np.argsort(outcomes.values[key], kind="stable")
    return [int(order[round(share * (len(order) - 1))]) for share in shares]
