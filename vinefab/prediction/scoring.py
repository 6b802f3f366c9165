"""A design's score on a task over maps and poses."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from vinefab.core.errors import BadInputError
from vinefab.growth.options import GrowthOptions
from vinefab.model.design import Design
from vinefab.model.map import Map
from vinefab.model.score import Score
from vinefab.prediction.deploy import pose_text
from vinefab.tasks.evaluate import PreparedMap, poses_on, score_design
from vinefab.tasks.shipped_tasks import make_task
from vinefab.tasks.task import Task


@dataclass(frozen=True, slots=True, kw_only=True)
class ScorePlan:
    """What a design is to be tried at."""

    task: str | Task = "coverage"  # name of the task, or the task itself
    # parameters of a task that is named, where they differ from its defaults
    parameters: Mapping[str, object] = field(default_factory=dict)
    poses: int = 1  # poses drawn per map from the range around its starts
    seed: int = 0  # seed of the poses; map ``i`` gets ``seed + i``


def score_design_on_task(
    design: Design, maps: Sequence[Map], plan: ScorePlan, options: GrowthOptions | None = None
) -> Score:
    """Return a design's score, one evaluation per map and pose."""
    if not maps:
        raise BadInputError("--maps", "none", "at least one map")
    task = plan.task
    if isinstance(task, str):
        task = make_task(task, plan.parameters)
    prepared_maps = [PreparedMap.of(world) for world in maps]
    seeds = [plan.seed + index for index in range(len(prepared_maps))]
    return score_design(
        design, prepared_maps, poses_on(prepared_maps, plan.poses, seeds), task, options
    )


def score_lines(result: Score, most: int = 30) -> list[str]:
    """Return a score as lines for the user: evaluations, then composites."""
    lines = [
        f"  {evaluation.score:8.4f}  {evaluation.map_name}  {pose_text(evaluation.pose)}"
        for evaluation in result.evaluations[:most]
    ]
    hidden = len(result.evaluations) - len(lines)
    lines += [f"  ... and {hidden} more"] if hidden else []
    weighed = ", ".join(f"{name} {value:.4f}" for name, value in result.composite.items())
    return [
        f"task {result.task}, {len(result.evaluations)} evaluations (simulated)",
        *lines,
        f"composite: {weighed}",
    ]
