"""Tasks: what a deployment scores, one file per task, and scores over maps and poses.

Here is their registry (`TASKS`, `make_task`), which loads nothing of them. Other rooms use
``evaluate`` (`PreparedMap`, `poses_on`, `score_design`, `score_designs`, `scores_of`, `composite`),
``task`` (`Task`, `TaskOutcomes`, `outcomes`, `HeadOnPenalty`), ``map_context`` (`MapContext`),
``areas`` (`Cover`), ``reach`` (targets) and the tasks themselves (`Coverage`, `Reach`,
`Anchoring`). Areas and kernels belong to this room alone.
"""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING

from vinefab.core.foreign import is_own
from vinefab.core.registry import Registry, with_parameters

if TYPE_CHECKING:
    from vinefab.tasks.task import Task

TASKS: Registry["Callable[..., Task]"] = Registry(
    "task",
    {
        "coverage": "vinefab.tasks.coverage:Coverage",
        "reach": "vinefab.tasks.reach:Reach",
        "anchoring": "vinefab.tasks.anchoring_force:Anchoring",
    },
    group="vinefab.tasks",
)


def make_task(name: str, parameters: Mapping[str, object] | None = None) -> "Task":
    """Return a task with its parameters.

    Parameters
    ----------
    name
        Name of a shipped task or of a plug-in.
    parameters
        Values of the task's fields; defaults for all others.

    Raises
    ------
    UnknownNameError
        If there is no such task.
    BadInputError
        If a parameter is unknown or its value not allowed.

    Examples
    --------
    >>> make_task("coverage", {"radius_mm": 60}).radius_mm
    60.0
    """
    task = with_parameters(TASKS[name], "task", parameters or {})
    if not is_own(task):
        from vinefab.tasks.task import ensure_task  # noqa: PLC0415  it waits for a foreign task

        ensure_task(task)
    return task
