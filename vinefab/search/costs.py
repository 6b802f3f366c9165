"""What a design costs, whatever it is worth: further objectives of a search, to be small."""

from collections.abc import Callable, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from vinefab.core.errors import BadInputError, nearest
from vinefab.core.validation import Floats
from vinefab.model.design import Design
from vinefab.model.tree import branch_tree
from vinefab.search.space import Space


def film_length_mm(design: Design) -> float:
    """Return the planned length of all branches together."""
    return branch_tree(design).total_length_mm


def film_area_mm2(design: Design) -> float:
    """Return the lay-flat area of all branches together, length times width."""
    tree = branch_tree(design)
    return float((tree.length_mm * np.array(design.build.widths_mm)[tree.level - 1]).sum())


def branches(design: Design) -> float:
    """Return the number of branches, the trunk included."""
    return float(design.branch_count)


COSTS: Mapping[str, tuple[Callable[[Design], float], str]] = MappingProxyType(
    {
        "film_length": (film_length_mm, "mm"),
        "film_area": (film_area_mm2, "mm2"),
        "branches": (branches, ""),
    }
)
"""Every cost by its name in run files, with its unit."""


def check_objectives(objectives: Sequence[str], task: str, optimizer: str) -> None:
    """Complain of objectives that make no sense together."""
    key, known = "task.objectives", (task, *COSTS)
    if not objectives:
        return
    for name in objectives:
        if name not in known:
            allowed = f"{task!r} and costs: {', '.join(COSTS)}{nearest(name, known)}"
            raise BadInputError(key, name, allowed)
        if list(objectives).count(name) > 1:
            raise BadInputError(key, name, "each objective once")
    if task not in objectives:
        raise BadInputError(key, list(objectives), f"the task's score, {task!r}, among them")
    if len(objectives) < 2:
        allowed = f"a cost beside the score ({', '.join(COSTS)}), or no objectives at all"
        raise BadInputError(key, list(objectives), allowed)
    if optimizer != "nsga2":
        raise BadInputError("optimizer.name", optimizer, "'nsga2' for several objectives")


def costs_of(x: Floats, space: Space, names: Sequence[str]) -> Floats:
    """Return the costs of points, shape (m, k); infinite where there is no design.

    Parameters
    ----------
    x
        The points, shape (m, d).
    """
    found = np.full((len(x), len(names)), np.inf)
    for row, point in enumerate(x):
        try:
            design = space.design(point)
        except BadInputError:
            continue
        found[row] = [COSTS[name][0](design) for name in names]
    return found
