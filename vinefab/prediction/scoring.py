"""A design's score on a task over maps and poses."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from vinefab.core.errors import BadInputError
from vinefab.growth.batch import Launches, TerrainSet
from vinefab.growth.options import GrowthChoice, GrowthOptions, growth_text
from vinefab.maps.poses import spread_notes
from vinefab.model.design import Design
from vinefab.model.map import Map
from vinefab.model.score import Score
from vinefab.prediction.deploy import stayed_text
from vinefab.tasks.evaluate import (
    PreparedMap,
    map_weights,
    poses_on,
    score_design,
    trunks_with_room,
)
from vinefab.tasks.shipped_tasks import make_task
from vinefab.tasks.targets import design_touches
from vinefab.tasks.task import Task, score_parts


@dataclass(frozen=True, slots=True, kw_only=True)
class ScorePlan:
    """What a design is to be tried at."""

    task: str | Task = "coverage"  # name of the task, or the task itself
    # parameters of a task that is named, where they differ from its defaults
    parameters: Mapping[str, object] = field(default_factory=dict)
    poses: int = 3  # poses drawn per map from the range around its starts
    seed: int = 0  # seed of the poses; map ``i`` gets ``seed + i``


def score_design_on_task(
    design: Design, maps: Sequence[Map], plan: ScorePlan, options: GrowthOptions | None = None
) -> Score:
    """Return a design's score, one evaluation per map and pose.

    Parameters
    ----------
    options
        The growth model's choices; those that the design was trained with if None.
    """
    if not maps:
        raise BadInputError("--maps", "none", "at least one map")
    options = options or GrowthChoice.of([design]).options
    task = plan.task
    if isinstance(task, str):
        task = make_task(task, plan.parameters)
    prepared_maps = [PreparedMap.of(world) for world in maps]
    seeds = [plan.seed + index for index in range(len(prepared_maps))]
    varied = options.draws
    poses = poses_on(prepared_maps, plan.poses, seeds, repeats=varied)
    score = score_design(design, prepared_maps, poses, task, options)
    terrains = TerrainSet([prepared.terrain for prepared in prepared_maps])
    stayed = stayed_text(trunks_with_room(design, prepared_maps, poses, options), design, options)
    # What earned and cost how much of it.
    evaluations = tuple(
        replace(each, parts=score_parts(task, each.score, each.terms)) for each in score.evaluations
    )
    names = tuple(evaluations[0].parts)
    table = np.array([[each.parts[name] for name in names] for each in evaluations])
    weights = map_weights([len(places) for places in poses])
    means = np.average(table, axis=0, weights=weights).tolist() if names else []
    return replace(
        score,
        evaluations=evaluations,
        parts=dict(zip(names, means, strict=True)),
        growth=options.content,
        grown=growth_text(options, [design]),
        targets=design_touches(design, maps, Launches.of(terrains, poses), options, task),
        notes=(*spread_notes(maps, plan.poses, repeats=varied), *stayed),
    )
