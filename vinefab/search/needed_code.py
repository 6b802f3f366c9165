"""The compiled functions that a run needs: compiled together before it begins, and no others."""

from collections.abc import Sequence

from vinefab.model.map import Map
from vinefab.search.settings import RunSettings
from vinefab.tasks import make_task
from vinefab.tasks.anchoring_force import Anchoring
from vinefab.tasks.coverage import Coverage
from vinefab.tasks.reach import Reach
from vinefab.tasks.task import Task

_GROWTH = (
    "growth.batch_kernel.plan_trees",
    "growth.batch_kernel.riding_film",
    "growth.kernel.grow_jobs",
    "growth.contact_kernel.settle_jobs",  # for the winner, of whom fewer children may come out
)
_CELLS = ("tasks.areas_kernel.count_walls", "tasks.areas_kernel.place_walls")
_SEEN = ("growth.batch_kernel.gather_tips", "tasks.areas_kernel.fill_strips")
_REACHED = ("tasks.areas_kernel.fill_strips", "tasks.areas_kernel.reach_areas")
_HELD = ("tasks.tips_kernel.gaps", "tasks.tips_kernel.tensions", "tasks.tips_kernel.turns")

PREDICTION = (
    *_GROWTH[2:],
    *_SEEN,
    "tasks.areas_kernel.cover_areas",
    "tasks.areas_kernel.reach_areas",
    "tasks.tips_kernel.tensions",
    "tasks.tips_kernel.turns",
)
"""Functions of a report on many deployments."""


def needed_code(settings: RunSettings, maps: Sequence[Map]) -> tuple[str, ...]:
    """Return the names of the compiled functions that a run needs, for `precompile`.

    Of tasks of other packages nothing is known: what they need is compiled when it is called.
    """
    names = [*_GROWTH]
    if settings.evaluation.fabricable:
        pieces = settings.build.pieces
        cut = pieces is not None and pieces.most > 1
        names.append(f"search.penalty_kernel.{'penalize_pieces' if cut else 'penalize'}")
    for part in (settings.task, *settings.other_tasks):
        names += _of_task(make_task(part.name, part.parameters), maps)
    return tuple(dict.fromkeys(names))


def _of_task(task: Task, maps: Sequence[Map]) -> tuple[str, ...]:
    """Return the compiled functions that a task needs in a search, and to score its winner."""
    if isinstance(task, Anchoring):
        return (*_CELLS, *_HELD)
    if isinstance(task, Coverage) and task.clip == "sight":
        return (*_SEEN[:1], *_CELLS, "tasks.areas_kernel.seen_areas_by_lines")
    if isinstance(task, Coverage):
        fast = () if task.area == "exact" else (*_SEEN, "tasks.areas_kernel.cover_areas")
        return (*fast, "tasks.union_kernel.union_areas")
    if isinstance(task, Reach) and not task.targets and not any(world.targets for world in maps):
        return _REACHED
    return ()
