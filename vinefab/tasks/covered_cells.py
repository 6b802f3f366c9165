"""What each deployment covers, as a set: what several robots cover together is the sets' union."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
import shapely
from numpy.typing import NDArray

from vinefab.core.compiling import imported_later
from vinefab.core.errors import BadInputError
from vinefab.core.validation import Floats
from vinefab.growth.batch import GrowthBlock
from vinefab.tasks.exact_areas import seen_areas
from vinefab.tasks.fast_areas import Chains
from vinefab.tasks.map_context import MapContext
from vinefab.tasks.task import Task

if TYPE_CHECKING:
    from vinefab.tasks.kernels import areas_kernel
else:
    areas_kernel = imported_later("vinefab.tasks.kernels.areas_kernel")

USUAL_CELLS, MOST_COVER_CELLS = 20_000, 250_000
CELLS_PER_RADIUS, FEWEST_PER_RADIUS = 10.0, 4.0
"""Cells across the radius of the covered area: the first where `USUAL_CELLS` are enough for that,
at least the second."""


class Cover(Protocol):
    """Elements that deployments cover, with the share of the whole that each is."""

    @property
    def weight(self) -> Floats:
        """Share of the whole of each element, shape (e,)."""
        ...

    @property
    def words(self) -> str:
        """What is covered, for people."""
        ...

    def covered(self, block: GrowthBlock) -> NDArray[np.bool_]:
        """Return the mask of the elements that each growth of a block covers, shape (j, e)."""
        ...


def cover_of(task: Task, context: MapContext) -> Cover:
    """Return the measure of the area that a task's deployments cover on a map.

    A task may define ``cover(context: MapContext) -> Cover``.

    Raises
    ------
    BadInputError
        If the task does not define the covered area, or the map is too large.
    """
    offered: Callable[[MapContext], Cover] | None = getattr(task, "cover", None)
    if offered is None:
        allowed = "coverage, reach, or a task with a method cover: others have no union"
        raise BadInputError("task of several robots", task.name, allowed)
    return offered(context)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CellGrid:
    """Square cells of a free space."""

    box: Floats  # lower left corner and side of the cells, mm; shape (3,)
    free_mm2: Floats  # free area of each cell, shape (rows, columns)

    @classmethod
    def of(cls, context: MapContext, radius_mm: float) -> "CellGrid":
        """Return the cells for areas within a radius of something."""
        edges_mm = context.edges_mm
        low = edges_mm.min(axis=(0, 1))
        size = edges_mm.max(axis=(0, 1)) - low
        side_mm = max(radius_mm / CELLS_PER_RADIUS, math.sqrt(float(size.prod()) / USUAL_CELLS))
        side_mm = min(side_mm, radius_mm / FEWEST_PER_RADIUS)
        columns, rows = (max(1, math.ceil(float(length) / side_mm)) for length in size)
        if columns * rows > MOST_COVER_CELLS:
            allowed = (
                f"at most {MOST_COVER_CELLS} cells of a quarter of the radius {radius_mm:g} mm"
            )
            raise BadInputError("map for several robots", f"{columns} x {rows} cells", allowed)
        strips, box = np.zeros((rows, columns + 1)), np.array([*low, side_mm])
        areas_kernel.fill_strips(edges_mm, box, strips, np.zeros_like(strips))
        # Rounding leaves cells without any free area a little above or below none.
        free_mm2 = np.diff(strips, axis=1)
        return cls(box=box, free_mm2=np.where(free_mm2 > 1e-9 * side_mm**2, free_mm2, 0.0))

    @property
    def is_free(self) -> NDArray[np.bool_]:
        """Which cells have free area, shape (rows * columns,)."""
        return np.asarray((self.free_mm2 > 0.0).ravel())

    @property
    def weight(self) -> Floats:
        """Share of the free space of each cell that has some, shape (e,)."""
        free_mm2 = self.free_mm2.ravel()[self.is_free]
        return np.asarray(free_mm2 / free_mm2.sum())

    @property
    def centres_mm(self) -> Floats:
        """Centre of each cell that has free area, shape (e, 2)."""
        rows, columns = np.nonzero(self.free_mm2 > 0.0)
        return np.asarray(self.box[:2] + self.box[2] * (np.column_stack([columns, rows]) + 0.5))

    def near(self, chains: Chains, radius_mm: float) -> NDArray[np.bool_]:
        """Return the mask of cells with centres within a radius of each body, shape (j, e)."""
        count, is_free = len(chains.branch) - 1, self.is_free
        found = np.empty((count, int(is_free.sum())), dtype=np.bool_)
        level, mark = np.empty(self.free_mm2.shape), np.zeros(self.free_mm2.shape, dtype=np.int64)
        for index in range(count):
            first, last = chains.branch[index], chains.branch[index + 1]
            mark[:] = 0
            areas_kernel.reach_areas(
                chains.points_mm,
                chains.first_point[first + index : last + index + 1],
                np.array([0, last - first]),
                chains.room[index : index + 1],
                radius_mm,
                self.free_mm2,
                self.box,
                level,
                mark,
                np.zeros(1),
            )
            # A centre on the radius counts as a half.
            found[index] = ((mark == 1) & (level >= 0.5)).ravel()[is_free]
        return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BodyCover:
    """Free space within a distance of a body."""

    grid: CellGrid
    radius_mm: float

    @property
    def weight(self) -> Floats:
        """Share of the free space of each cell."""
        return self.grid.weight

    @property
    def words(self) -> str:
        """What is covered."""
        return f"free space within {self.radius_mm:g} mm of a body"

    def covered(self, block: GrowthBlock) -> NDArray[np.bool_]:
        """Return the mask of the cells that each growth comes near to."""
        return self.grid.near(_bodies(block), self.radius_mm)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TipCover:
    """Free space that sensors at tips see."""

    grid: CellGrid
    radius_mm: float
    edges_mm: Floats | None  # walls that hide what is behind them; None: nothing is hidden

    @property
    def weight(self) -> Floats:
        """Share of the free space of each cell."""
        return self.grid.weight

    @property
    def words(self) -> str:
        """What is covered."""
        sight = "" if self.edges_mm is None else ", in sight"
        return f"free space within {self.radius_mm:g} mm of a tip{sight}"

    def covered(self, block: GrowthBlock) -> NDArray[np.bool_]:
        """Return the mask of the cells that each growth's sensors see."""
        tips_mm, first = block.tips_mm()
        if self.edges_mm is None:
            # A tip is a body of no length.
            points = np.repeat(tips_mm, 2, axis=0)
            steps = [2 * np.arange(n + 1) for n in np.diff(first).tolist()]
            chains = Chains(points, np.concatenate(steps), first, 2 * first)
            return self.grid.near(chains, self.radius_mm)
        centres = self.grid.centres_mm
        found = np.zeros((len(block), len(centres)), dtype=np.bool_)
        for index in range(len(block)):
            tips = tips_mm[first[index] : first[index + 1]]
            if len(tips):
                _, seen = seen_areas(tips, self.radius_mm, self.edges_mm)
                shapely.prepare(seen)
                found[index] = shapely.intersects_xy(seen, centres)
        return found


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TargetCover:
    """Targets that bodies or tips come to."""

    targets_mm: Floats  # shape (t, 2)
    away_mm: Callable[[Chains], Floats]  # how far bodies are from them, shape (j, t)
    tolerance_mm: Floats  # of each target, shape (t,)

    @property
    def weight(self) -> Floats:
        """Share of each target."""
        return np.full(len(self.targets_mm), 1.0 / len(self.targets_mm))

    @property
    def words(self) -> str:
        """What is covered."""
        low_mm, high_mm = self.tolerance_mm.min(), self.tolerance_mm.max()
        most = "" if low_mm == high_mm else f" to {high_mm:g}"
        return f"targets within {low_mm:g}{most} mm"

    def covered(self, block: GrowthBlock) -> NDArray[np.bool_]:
        """Return the mask of the targets that each growth reaches."""
        return np.asarray(self.away_mm(_bodies(block)) <= self.tolerance_mm)


def _bodies(block: GrowthBlock) -> Chains:
    """Return the bodies of a block's growths."""
    growth = block.growth
    return Chains(growth.points, growth.first_point, block.branch, block.room)
