"""The registry of tasks."""

from collections.abc import Callable, Mapping

from vinefab.core.registry import Registry, with_parameters
from vinefab.tasks.anchoring_force import Anchoring
from vinefab.tasks.coverage import Coverage
from vinefab.tasks.reach import Reach
from vinefab.tasks.task import Task

TASKS: Registry[Callable[..., Task]] = Registry(
    "task",
    {"coverage": Coverage, "reach": Reach, "anchoring": Anchoring},
    group="vinefab.tasks",
)


def make_task(name: str, parameters: Mapping[str, object] | None = None) -> Task:
    """Return a task with its parameters.

    Examples
    --------
    >>> make_task("coverage", {"radius_mm": 60}).radius_mm
    60.0
    """
    return with_parameters(TASKS[name], "task", parameters or {})
