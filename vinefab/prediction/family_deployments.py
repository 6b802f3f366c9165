"""A design deployed on families of maps from many poses, and what each deployment measures."""

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.core.limits import MOST_SEED
from vinefab.core.plain_text import counted
from vinefab.core.registry import with_parameters
from vinefab.core.validation import whole
from vinefab.growth.batch import GROWTHS_PER_CALL, Batch, Launches, TerrainSet
from vinefab.growth.options import GrowthOptions
from vinefab.growth.plan import Plans
from vinefab.maps.generators.environments import ENVIRONMENTS
from vinefab.maps.poses import spread_notes
from vinefab.model.deployment import Deployment
from vinefab.model.design import Design
from vinefab.model.map import Map
from vinefab.prediction.deploy import stayed_text
from vinefab.prediction.measures import MEASURES, MeasureTable, measured_shapes, worst_pressures_of
from vinefab.tasks.anchoring_force import Anchoring
from vinefab.tasks.evaluate import Poses, PreparedMap, poses_on, trunks_with_room

FIRST_UNSEEN = 10_000_000
"""Maps for predictions have seeds from here on, out of the way of those that designs train on."""

MOST_MAPS = 10_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MapFamily:
    """Maps that are evaluated together."""

    label: str  # what reports call them
    worlds: tuple[Map, ...]  # the maps


def map_families(given: Sequence[Map], unseen: MapFamily | None) -> tuple[MapFamily, ...]:
    """Return the families to predict for."""
    if not given and unseen is None:
        raise BadInputError("--maps", None, "map files, or --environment for unseen maps")
    label = "the map given" if len(given) == 1 else f"the {len(given)} maps given"
    families = [MapFamily(label=label, worlds=tuple(given))] if given else []
    return (*families, *([unseen] if unseen else []))


def unseen_maps(
    environment: str, count: int, seed: int, parameters: Mapping[str, object] | None = None
) -> MapFamily:
    """Generate maps of an environment that no design was trained on."""
    whole("--count", count, 1, MOST_MAPS)
    whole("--seed", seed, 0, MOST_SEED)
    kind = ENVIRONMENTS[environment]
    options = with_parameters(kind.options, environment, parameters or {})
    first = FIRST_UNSEEN + MOST_MAPS * seed
    worlds = tuple(kind.make(first + index, options) for index in range(count))
    return MapFamily(label=counted(count, f"unseen {environment} map"), worlds=worlds)


def numbered_names(names: Sequence[str]) -> tuple[str, ...]:
    """Return names that are all different: equal ones get a number."""
    total, seen = Counter(names), Counter[str]()
    found = []
    for name in names:
        seen[name] += 1
        found.append(f"{name} ({seen[name]})" if total[name] > 1 else name)
    return tuple(found)


ProgressCallback = Callable[[float, str], None]
"""Called with the share of the work that is done and a short text."""


def no_progress(_share: float, _words: str) -> None:
    """Report nothing."""


def part_of(progress: ProgressCallback, start: float, end: float) -> ProgressCallback:
    """Return what tells the progress of a part of the work."""
    return lambda share, words: progress(start + (end - start) * share, words)


@dataclass(frozen=True, slots=True, kw_only=True)
class PredictionPlan:
    """How often, and by which rules, a design is deployed."""

    poses: int = 3  # poses per map, drawn from the ranges of the maps' starts
    seed: int = 0  # seed of the poses; map ``i`` of a family gets ``seed + i``
    options: GrowthOptions = field(default_factory=GrowthOptions)  # the growth model's choices
    anchoring: Anchoring = field(default_factory=Anchoring)  # how anchoring is scored


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PreparedFamily:
    """A family made ready: its maps with their poses."""

    label: str  # what reports call it
    maps: tuple[PreparedMap, ...]  # the maps
    poses: Poses  # for each map, the poses
    atlas: TerrainSet = field(init=False)  # their terrains, joined once for all deployments

    def __post_init__(self) -> None:
        atlas = TerrainSet([prepared_map.terrain for prepared_map in self.maps])
        object.__setattr__(self, "atlas", atlas)

    @classmethod
    def of(cls, family: MapFamily, plan: PredictionPlan) -> "PreparedFamily":
        """Return a family made ready, with its poses drawn."""
        maps = tuple(PreparedMap.of(world) for world in family.worlds)
        seeds = [plan.seed + index for index in range(len(maps))]
        repeats = plan.options.draws
        poses = poses_on(maps, plan.poses, seeds, repeats=repeats)
        return cls(label=family.label, maps=maps, poses=poses)

    @property
    def names(self) -> tuple[str, ...]:
        """Name of each map; maps of one name are told apart by a number."""
        return numbered_names([prepared_map.world.name for prepared_map in self.maps])

    @property
    def launch_names(self) -> list[str]:
        """The name of the map of each deployment."""
        names = self.names
        return [name for name, places in zip(names, self.poses, strict=True) for _ in places]

    @property
    def distinct(self) -> "PreparedFamily":
        """The same with every pose once: all deployments have the same contacts."""
        once = replace(self, poses=tuple(tuple(dict.fromkeys(places)) for places in self.poses))
        object.__setattr__(once, "atlas", self.atlas)
        return once

    def launches(self) -> Launches:
        """Return every pose of every map as launches of a batch."""
        return Launches.of(self.atlas, self.poses)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FamilyDeployments:
    """A design's deployments on one family of maps."""

    prepared: PreparedFamily
    # deployments, unpressed: map by map, pose by pose, and the same where no pressure stops them;
    # grown again when asked for
    deployments: Sequence[Deployment]
    unpressed: Sequence[Deployment]
    outcomes: MeasureTable  # one row of measures for each

    def prepared_map(self, index: int) -> PreparedMap:
        """Return the map of one deployment."""
        return self.prepared.maps[self.map_of[index]]

    def aimed(self) -> Iterator[tuple[Deployment, Map]]:
        """Yield each deployment with its map; none where no map has targets."""
        if any(prepared.world.targets for prepared in self.prepared.maps):
            for index, deployment in enumerate(self.deployments):
                yield deployment, self.prepared_map(index).world

    @property
    def map_of(self) -> tuple[int, ...]:
        """Index of the map of each deployment."""
        poses = self.prepared.poses
        return tuple(index for index, places in enumerate(poses) for _ in places)


def deploy_family(
    design: Design,
    prepared: PreparedFamily,
    plan: PredictionPlan,
    progress: ProgressCallback = no_progress,
) -> FamilyDeployments:
    """Deploy a design from every pose on a family of maps and measure every deployment."""
    progress(0.0, f"{design.name}: growing")
    launches = prepared.launches()
    batch = Batch(Plans.of([design], plan.options), launches, plan.options)
    deployments = batch.regrown()
    # What growth to every tip needs is known only where no pressure stops it.
    unpressed = deployments
    if plan.options.pressure_stop and design.build.pressure_kpa > 0.0:
        free = plan.options.changed(pressure_stop=False)
        unpressed = Batch(Plans.of([design], free), launches, free).regrown()
    columns = np.empty((len(deployments), len(MEASURES)))
    terrain = launches.terrain.tolist()
    contexts = [prepared_map.context for prepared_map in prepared.maps]
    done = 0
    for rows in batch.each(lambda block: measured_shapes(block, design, contexts, plan.anchoring)):
        columns[done : done + len(rows), :-2] = rows
        done += len(rows)
        words = f"{done} of {counted(len(deployments), 'deployment')}"
        progress(done / len(deployments), words)
    one_by_one, first = iter(unpressed), 0
    while some := list(islice(one_by_one, GROWTHS_PER_CALL)):
        columns[first : first + len(some), -2:] = worst_pressures_of(some, design).T
        first += len(some)
    names = prepared.names
    outcomes = MeasureTable(
        label=prepared.label,
        maps=tuple(names[index] for index in terrain),
        poses=launches.poses,
        values={m.key: columns[:, i].copy() for i, m in enumerate(MEASURES)},
    )
    return FamilyDeployments(
        prepared=prepared, deployments=deployments, unpressed=unpressed, outcomes=outcomes
    )


def deployment_notes(
    prepared: Sequence[PreparedFamily], plan: PredictionPlan, named: Mapping[str, Design]
) -> tuple[str, ...]:
    """Return what a user should know about how often designs were deployed, and how they began.

    Parameters
    ----------
    named
        The designs by what their notes begin with; nothing for one alone.
    """
    worlds = [place.world for family in prepared for place in family.maps]
    notes = spread_notes(worlds, plan.poses, repeats=plan.options.draws)
    for name, design in named.items():
        left = [
            has_room
            for family in prepared
            for has_room in trunks_with_room(design, family.maps, family.poses, plan.options)
        ]
        notes += [f"{name}{note}" for note in stayed_text(left, design, plan.options)]
    return tuple(notes)


def typical(outcomes: MeasureTable, shares: Sequence[float], *keys: str) -> list[int]:
    """Return the deployments that stand at some shares of the order of measures, one by one."""
    order = np.lexsort([outcomes.values[key] for key in reversed(keys)])
    return [int(order[round(share * (len(order) - 1))]) for share in shares]
